//! Decodes PNG.

use std::io::Cursor;

use png::{ColorType, Decoder, DecodingError, Reader, Transformations};

use super::{Image, Pixel};
use crate::PatternFileError;

fn broken(error: DecodingError) -> PatternFileError {
    PatternFileError::new(format!("not a readable PNG: {error}"))
}

/// Returns width and height in pixels.
pub fn sides(bytes: &[u8]) -> Result<[usize; 2], PatternFileError> {
    let mut decoder = Decoder::new(Cursor::new(bytes));
    let (width, height) = decoder.read_header_info().map_err(broken)?.size();
    Ok([width as usize, height as usize])
}

/// Decodes an image; one with a palette to its indices if these are wanted.
pub fn decode(
    bytes: &[u8],
    with_indices: bool,
    check: &dyn Fn([usize; 2]) -> Result<(), PatternFileError>,
) -> Result<Image, PatternFileError> {
    let mut decoder = Decoder::new(Cursor::new(bytes));
    let info = decoder.read_header_info().map_err(broken)?;
    let (width, height) = info.size();
    let is_indexed = with_indices && info.color_type == ColorType::Indexed;
    let depth = info.bit_depth as usize;
    decoder.set_transformations(match is_indexed {
        true => Transformations::IDENTITY,
        false => Transformations::EXPAND | Transformations::STRIP_16,
    });
    let sides = [width as usize, height as usize];
    check(sides)?;
    let reader = decoder.read_info().map_err(broken)?;
    let image = match is_indexed {
        true => Image {
            sides,
            pixels: indices(reader, sides, depth).map_err(broken)?,
            is_transparency: false,
            is_turned: false,
        },
        false => greys(reader, sides).map_err(broken)?,
    };
    let (found, promised) = (image.pixels.len(), sides[0] * sides[1]);
    match found == promised {
        true => Ok(image),
        false => Err(PatternFileError::new(format!(
            "{found} pixels where {promised} were promised"
        ))),
    }
}

fn greys(mut reader: Reader<Cursor<&[u8]>>, sides: [usize; 2]) -> Result<Image, DecodingError> {
    let mut samples = vec![0; reader.output_buffer_size()];
    let frame = reader.next_frame(&mut samples)?;
    let samples = &samples[..frame.buffer_size()];
    Ok(Image::of_samples(sides, samples, frame.color_type.samples()))
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
