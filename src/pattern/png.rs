//! Reads patterns from images: dark pixels are electrodes, as in the figures of the source paper; the top row is the
//! upper edge.
//!
//! The image must show each cell as one pixel or as a block of equal pixels. Grey pixels come from resampling, which no
//! threshold can undo. With several electrode groups, the index in a palette is the number of the group; without a
//! palette, group g of n has the grey level (g − 1)/n from black to white.

use std::io::Cursor;
use std::path::Path;

use png::{ColorType, Decoder, DecodingError, Reader, Transformations};

use super::file::{PatternFileError, bytes};
use super::raster::{Pattern, PatternForm};

/// Largest number of pixels along the side of a cell.
const LARGEST_BLOCK: usize = 64;

/// Largest number of pixels of an image; decoded, it takes at most 41 MB, whatever its header claims.
const MOST_PIXELS: usize = 3200 * 3200;

const MAX_BYTES: u64 = 64 << 20;

fn allowed(form: PatternForm) -> String {
    let ([columns, rows], groups) = (form.raster.sides(), form.groups);
    let colours = match groups {
        1 => "dark (brightness below 25 %) = electrode, light (above 75 %) = bare".to_owned(),
        _ => {
            let level = |group: usize| format!("group {group} = {:.0} %", 100.0 * (group - 1) as f64 / groups as f64);
            let levels: Vec<String> = (1..=groups).map(level).collect();
            format!(
                "the number of the group as palette index, or as brightness: {}, bare = 100 %",
                levels.join(", ")
            )
        }
    };
    format!(
        "allowed: {columns} × {rows} pixels, or k·{columns} × k·{rows} (k to {LARGEST_BLOCK}) with k × k pixels of one \
         colour per cell; {colours}; no smoothing when scaling"
    )
}

/// Returns the numbers of columns and rows of an image with one pixel per cell.
pub(super) fn sides(path: &Path) -> Result<[usize; 2], PatternFileError> {
    let bytes = bytes(path, MAX_BYTES)?;
    let broken = |e: DecodingError| PatternFileError::new(format!("not a readable PNG: {e}"));
    let mut decoder = Decoder::new(Cursor::new(&bytes[..]));
    let (width, height) = decoder.read_header_info().map_err(broken)?.size();
    Ok([width as usize, height as usize])
}

pub(super) fn read(path: &Path, form: PatternForm) -> Result<Vec<Pattern>, PatternFileError> {
    let of_form = |refusal: PatternFileError| refusal.help(allowed(form));
    let (block, pixels) = decode(&bytes(path, MAX_BYTES)?, form)?;
    let (width, rows) = (block * form.raster.columns(), form.raster.rows());
    let groups = pixels
        .iter()
        .enumerate()
        .map(|(at, pixel)| {
            let undecided = || undecided([at % width, at / width], *pixel, form.groups);
            pixel.group(form.groups).ok_or_else(|| of_form(undecided()))
        })
        .collect::<Result<Vec<u8>, _>>()?;
    // Image rows run downwards, patterns upwards.
    let cell = |x: usize, y: usize| groups[(rows - 1 - y) * block * width + x * block];
    let of_cell = |at: usize| cell(at % width / block, rows - 1 - at / width / block);
    if let Some(at) = (0..groups.len()).find(|&at| groups[at] != of_cell(at)) {
        return Err(of_form(PatternFileError::new(format!(
            "pixel (column {}, row {} from the top) differs from others of its {block} × {block} block",
            at % width,
            at / width
        ))));
    }
    Ok(vec![Pattern::from_groups(form.raster, cell)])
}

/// The value of a pixel.
#[derive(Clone, Copy)]
enum Pixel {
    /// A grey level, 0 (black) to 1 (white).
    Grey(f64),
    /// An index into a palette.
    Index(u8),
}

impl Pixel {
    /// Returns the electrode group of a pixel, 0 for bare; `None` if the value is ambiguous.
    fn group(self, groups: usize) -> Option<u8> {
        match self {
            Self::Index(index) => (usize::from(index) <= groups).then_some(index),
            Self::Grey(level) => {
                let step = level * groups as f64;
                let is_plain = (step - step.round()).abs() < 0.25;
                let group = if step.round() as usize == groups {
                    0
                } else {
                    step.round() as u8 + 1
                };
                is_plain.then_some(group)
            }
        }
    }
}

fn undecided([column, row]: [usize; 2], pixel: Pixel, groups: usize) -> PatternFileError {
    let found = match pixel {
        Pixel::Grey(grey) if groups == 1 => {
            format!(
                "neither dark nor light: its brightness is {:.0} % (black 0 %, white 100 %)",
                100.0 * grey
            )
        }
        Pixel::Grey(grey) => format!(
            "not the colour of an electrode group: its brightness is {:.0} % (black 0 %, white 100 %)",
            100.0 * grey
        ),
        Pixel::Index(index) => format!("colour {index} of the palette, which is not an electrode group"),
    };
    PatternFileError::new(format!("pixel (column {column}, row {row} from the top) is {found}"))
}

/// Returns the number of pixels along the side of a cell, and the pixels from the top.
fn decode(bytes: &[u8], form: PatternForm) -> Result<(usize, Vec<Pixel>), PatternFileError> {
    let broken = |e: DecodingError| PatternFileError::new(format!("not a readable PNG: {e}"));
    let mut decoder = Decoder::new(Cursor::new(bytes));
    let info = decoder.read_header_info().map_err(broken)?;
    let (width, height) = info.size();
    let is_indexed = form.groups > 1 && info.color_type == ColorType::Indexed;
    let depth = info.bit_depth as usize;
    decoder.set_transformations(match is_indexed {
        true => Transformations::IDENTITY,
        false => Transformations::EXPAND | Transformations::STRIP_16,
    });
    let [columns, rows] = form.raster.sides();
    let (wide, high) = (width as usize, height as usize);
    let block = wide / columns;
    let is_whole = (block * columns, block * rows) == (wide, high) && (1..=LARGEST_BLOCK).contains(&block);
    if !is_whole || wide.saturating_mul(high) > MOST_PIXELS {
        return Err(PatternFileError::new(format!("the image has {width} × {height} pixels")).help(allowed(form)));
    }
    let reader = decoder.read_info().map_err(broken)?;
    let pixels = match is_indexed {
        true => indices(reader, [wide, high], depth),
        false => greys(reader),
    };
    let pixels = pixels.map_err(broken)?;
    if pixels.len() != wide * high {
        return Err(PatternFileError::new(format!(
            "{} pixels where {} were promised",
            pixels.len(),
            wide * high
        )));
    }
    Ok((block, pixels))
}

fn greys(mut reader: Reader<Cursor<&[u8]>>) -> Result<Vec<Pixel>, DecodingError> {
    let mut pixels = vec![0; reader.output_buffer_size()];
    let frame = reader.next_frame(&mut pixels)?;
    let channels = frame.color_type.samples();
    let greys = pixels[..frame.buffer_size()].chunks_exact(channels);
    Ok(greys
        .map(|pixel| Pixel::Grey(grey_level(frame.color_type, pixel)))
        .collect())
}

/// Unpacks indices of some bits each; each row takes whole bytes.
fn indices(
    mut reader: Reader<Cursor<&[u8]>>,
    [width, height]: [usize; 2],
    bits: usize,
) -> Result<Vec<Pixel>, DecodingError> {
    let mut bytes = vec![0; reader.output_buffer_size()];
    let frame = reader.next_frame(&mut bytes)?;
    let (per_byte, mask) = (8 / bits, u8::MAX >> (8 - bits));
    let rows = bytes[..frame.buffer_size()].chunks_exact(frame.line_size).take(height);
    let index = |row: &[u8], x: usize| row[x / per_byte] >> ((per_byte - 1 - x % per_byte) * bits) & mask;
    Ok(rows
        .flat_map(|row| (0..width).map(move |x| Pixel::Index(index(row, x))))
        .collect())
}

/// Returns the luma after Rec. ITU-R BT.601, over a white background.
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
