//! Images: dark pixels are electrodes, as in the figures of the source paper; the top row is the upper edge.
//!
//! Only images that say exactly which cell is what are taken: a pixel for each cell, or larger ones whose blocks are uniform.
//! Grey pixels come from resampling, and no threshold can undo that.

use std::io::Cursor;
use std::path::Path;

use png::{ColorType, Decoder, DecodingError, Transformations};

use super::raster::{Pattern, Raster};
use super::read::{Refusal, bytes};

/// Pixels along the side of a cell.
const LARGEST_BLOCK: usize = 64;

/// Pixels of an image; decoded it is then at most 41 MB, whatever its header claims.
const MOST_PIXELS: usize = 3200 * 3200;

const MAX_BYTES: u64 = 64 << 20;

fn form(raster: Raster) -> String {
    let [columns, rows] = raster.sides();
    format!(
        "allowed: {columns} × {rows} pixels, or k·{columns} × k·{rows} (k to {LARGEST_BLOCK}) with each k × k block of one colour; \
         dark (below 25 % grey) = electrode, light (above 75 %) = bare; no smoothing when scaling"
    )
}

pub(super) fn read(path: &Path, raster: Raster) -> Result<Vec<Pattern>, Refusal> {
    let of_form = |refusal: Refusal| refusal.help(form(raster));
    let (block, grey) = decode(&bytes(path, MAX_BYTES)?, raster)?;
    let (width, rows) = (block * raster.columns(), raster.rows());
    let dark = grey
        .iter()
        .enumerate()
        .map(|(at, level)| is_dark(*level).ok_or_else(|| of_form(undecided(at % width, at / width, *level))))
        .collect::<Result<Vec<bool>, _>>()?;
    // Image rows run downwards, patterns upwards.
    let cell = |x: usize, y: usize| dark[(rows - 1 - y) * block * width + x * block];
    let of_cell = |at: usize| cell(at % width / block, rows - 1 - at / width / block);
    if let Some(at) = (0..dark.len()).find(|&at| dark[at] != of_cell(at)) {
        return Err(of_form(Refusal::new(format!(
            "pixel (column {}, row {} from the top) differs from others of its {block} × {block} block",
            at % width,
            at / width
        ))));
    }
    Ok(vec![Pattern::from_fn(raster, cell)])
}

fn is_dark(grey: f64) -> Option<bool> {
    match grey {
        g if g < 0.25 => Some(true),
        g if g > 0.75 => Some(false),
        _ => None,
    }
}

fn undecided(column: usize, row: usize, grey: f64) -> Refusal {
    Refusal::new(format!(
        "pixel (column {column}, row {row} from the top) is {:.0} % grey, neither 0 nor 1",
        100.0 * grey
    ))
}

/// Pixels along the side of a cell, and grey levels, 0 (black) to 1 (white), from the top.
fn decode(bytes: &[u8], raster: Raster) -> Result<(usize, Vec<f64>), Refusal> {
    let broken = |e: DecodingError| Refusal::new(format!("not a readable PNG: {e}"));
    let mut decoder = Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
    let (width, height) = decoder.read_header_info().map_err(broken)?.size();
    let [columns, rows] = raster.sides();
    let (wide, high) = (width as usize, height as usize);
    let block = wide / columns;
    let is_whole = (block * columns, block * rows) == (wide, high) && (1..=LARGEST_BLOCK).contains(&block);
    if !is_whole || wide.saturating_mul(high) > MOST_PIXELS {
        return Err(Refusal::new(format!("the image has {width} × {height} pixels")).help(form(raster)));
    }
    let mut reader = decoder.read_info().map_err(broken)?;
    let mut pixels = vec![0; reader.output_buffer_size()];
    let frame = reader.next_frame(&mut pixels).map_err(broken)?;
    let channels = frame.color_type.samples();
    let grey = pixels[..frame.buffer_size()]
        .chunks_exact(channels)
        .map(|pixel| grey_level(frame.color_type, pixel))
        .collect::<Vec<_>>();
    if grey.len() != wide * high {
        return Err(Refusal::new(format!(
            "{} pixels where {} were promised",
            grey.len(),
            wide * high
        )));
    }
    Ok((block, grey))
}

/// Luma after Rec. ITU-R BT.601, over a white background.
fn grey_level(colour: ColorType, pixel: &[u8]) -> f64 {
    let unit = |k: usize| f64::from(pixel[k]) / 255.0;
    let luma = |k: usize| 0.299 * unit(k) + 0.587 * unit(k + 1) + 0.114 * unit(k + 2);
    let over_white = |level: f64, alpha: f64| alpha * level + 1.0 - alpha;
    match colour {
        ColorType::Rgba => over_white(luma(0), unit(3)),
        ColorType::GrayscaleAlpha => over_white(unit(0), unit(1)),
        ColorType::Rgb => luma(0),
        ColorType::Grayscale | ColorType::Indexed => unit(0),
    }
}
