//! PNG: black electrode on white, one bit per pixel, with its physical size in the `pHYs` chunk. Group g of n
//! electrodes is (g − 1)/n grey, eight bits per pixel, as patterns are read.

use std::ops::Range;

use ::png::{BitDepth, ColorType, Compression, Encoder, EncodingError, PixelDimensions, Unit};

use super::{Drawing, Layer, Point};

/// The largest number of pixels along a side.
pub const MOST_PIXELS: usize = 20_000;

/// Writes the drawing with a number of pixels along its sides; a pixel is black if its centre is within the electrode.
/// The top row is the upper edge.
///
/// # Errors
/// If the encoder fails.
pub fn png(drawing: &Drawing, pixels: [usize; 2]) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, pixels[0] as u32, pixels[1] as u32);
    encoder.set_color(ColorType::Grayscale);
    let several = drawing.layers.len() > 1;
    encoder.set_depth(if several { BitDepth::Eight } else { BitDepth::One });
    encoder.set_compression(Compression::Best);
    let [xppu, yppu] = [0, 1].map(|axis| (1e3 * pixels[axis] as f64 / drawing.size[axis]).round() as u32);
    encoder.set_pixel_dims(Some(PixelDimensions {
        xppu,
        yppu,
        unit: Unit::Meter,
    }));
    encoder.add_itxt_chunk("Title".to_owned(), drawing.title.clone())?;
    encoder.add_itxt_chunk("Description".to_owned(), drawing.notes.join("\n"))?;
    let mut writer = encoder.write_header()?;
    let image = if several {
        grey_image(drawing, pixels)
    } else {
        image(drawing, pixels)
    };
    writer.write_image_data(&image)?;
    writer.finish()?;
    Ok(bytes)
}

/// Returns rows from the top, padded to bytes; a set bit is white.
fn image(drawing: &Drawing, [width, height]: [usize; 2]) -> Vec<u8> {
    let row_bytes = width.div_ceil(8);
    let mut image = vec![0xff_u8; row_bytes * height];
    for layer in &drawing.layers {
        each_span(layer, drawing.size, [width, height], |row, columns| {
            for column in columns {
                image[row * row_bytes + column / 8] &= !(0x80 >> (column % 8));
            }
        });
    }
    image
}

/// Returns rows from the top, a byte for each pixel.
fn grey_image(drawing: &Drawing, [width, height]: [usize; 2]) -> Vec<u8> {
    let mut image = vec![u8::MAX; width * height];
    for (at, layer) in drawing.layers.iter().enumerate() {
        let level = (255.0 * at as f64 / drawing.layers.len() as f64).round() as u8;
        each_span(layer, drawing.size, [width, height], |row, columns| {
            image[row * width..][..width][columns].fill(level);
        });
    }
    image
}

/// Calls `fill` for the pixels of a layer: rows from the top, and columns.
fn each_span(layer: &Layer, size: [f64; 2], [width, height]: [usize; 2], mut fill: impl FnMut(usize, Range<usize>)) {
    let scale = [width as f64 / size[0], height as f64 / size[1]];
    let edges: Vec<[Point; 2]> = layer.rings().flat_map(|ring| edges(ring, scale)).collect();
    for row in 0..height {
        let mut crossings = crossings(&edges, (height - 1 - row) as f64 + 0.5);
        crossings.sort_unstable_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            // Pixels whose centres lie between two crossings.
            let [first, end] = [pair[0], pair[1]].map(|x| ((x - 0.5).ceil().max(0.0) as usize).min(width));
            fill(row, first..end);
        }
    }
}

/// Returns the sides of a ring in pixels.
fn edges(ring: &[Point], scale: [f64; 2]) -> impl Iterator<Item = [Point; 2]> {
    let next = ring.iter().cycle().skip(1);
    ring.iter()
        .zip(next)
        .map(move |(a, b)| [a, b].map(|[x, y]| [x * scale[0], y * scale[1]]))
}

/// Returns where sides cross a horizontal line; a point on the line belongs to the side above it.
fn crossings(edges: &[[Point; 2]], y: f64) -> Vec<f64> {
    let crossing =
        |[a, b]: &[Point; 2]| ((a[1] <= y) != (b[1] <= y)).then(|| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
    edges.iter().filter_map(crossing).collect()
}
