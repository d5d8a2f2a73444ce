//! Decodes JPEG, TIFF and BMP.
//!
//! Samples of 16 bits are read by their upper 8, as in PNG. The orientation that a camera or scanner notes is applied:
//! programs show pictures so.

use std::io::Cursor;

use image::codecs::{bmp::BmpDecoder, jpeg::JpegDecoder, tiff::TiffDecoder};
use image::metadata::Orientation;
use image::{ColorType, ImageDecoder, ImageError, Limits};

use super::{Image, PictureFormat, Pixel};
use crate::PatternFileError;

/// The largest memory in bytes that a decoder may take in addition to the samples.
const MOST_MEMORY: u64 = 512 << 20;

type Bytes<'a> = Cursor<&'a [u8]>;

/// Returns width and height in pixels, as shown.
pub fn sides(bytes: &[u8], format: PictureFormat) -> Result<[usize; 2], PatternFileError> {
    let broken = |error: ImageError| refused(format, &error);
    let of = |decoder: &mut dyn ImageDecoder| {
        let orientation = decoder.orientation().map_err(broken)?;
        Ok(shown(stored(decoder), orientation))
    };
    let bytes = Cursor::new(bytes);
    match format {
        PictureFormat::Jpeg => of(&mut JpegDecoder::new(bytes).map_err(broken)?),
        PictureFormat::Tiff => of(&mut TiffDecoder::new(bytes).map_err(broken)?),
        PictureFormat::Bmp | PictureFormat::Png => of(&mut BmpDecoder::new(bytes).map_err(broken)?),
    }
}

/// Decodes an image; one with a palette to its indices if these are wanted.
pub fn decode(
    bytes: &[u8],
    format: PictureFormat,
    with_indices: bool,
    check: &dyn Fn([usize; 2]) -> Result<(), PatternFileError>,
) -> Result<Image, PatternFileError> {
    let broken = |error: ImageError| refused(format, &error);
    let source: Bytes<'_> = Cursor::new(bytes);
    match format {
        PictureFormat::Jpeg => {
            let decoder = JpegDecoder::new(source).map_err(broken)?;
            check(stored(&decoder))?;
            // The decoder fills what is missing with grey.
            if !has_end(bytes) {
                return Err(PatternFileError::new("the JPEG is incomplete: it has no end marker").help(WHOLE));
            }
            decoded(decoder, false, format)
        }
        PictureFormat::Tiff => {
            let decoder = TiffDecoder::new(source).map_err(broken)?;
            check(stored(&decoder))?;
            decoded(decoder, false, format)
        }
        PictureFormat::Bmp | PictureFormat::Png => {
            let mut decoder = BmpDecoder::new(source).map_err(broken)?;
            check(stored(&decoder))?;
            let is_indexed = with_indices && decoder.get_palette().is_some();
            decoder.set_indexed_color(is_indexed);
            decoded(decoder, is_indexed, format)
        }
    }
}

const WHOLE: &str = "copy or export it again";

fn decoded(mut decoder: impl ImageDecoder, is_indexed: bool, format: PictureFormat) -> Result<Image, PatternFileError> {
    let broken = |error: ImageError| refused(format, &error);
    let colour = decoder.color_type();
    if colour.bytes_per_pixel() / colour.channel_count() > 2 {
        return Err(
            PatternFileError::new(format!("cannot read a {} with samples of 32 bits", format.name()))
                .help("save it with 8 or 16 bits, or name an array: .npy"),
        );
    }
    let (sides, orientation) = (stored(&decoder), decoder.orientation().map_err(broken)?);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MOST_MEMORY);
    decoder.set_limits(limits).map_err(broken)?;
    // At most 8 bytes for each pixel, whose number has been checked.
    let size = sides[0] * sides[1] * usize::from(colour.bytes_per_pixel());
    let mut samples = vec![0; size];
    decoder.read_image(&mut samples).map_err(broken)?;
    let channels = usize::from(colour.channel_count());
    if usize::from(colour.bytes_per_pixel()) == 2 * channels {
        let upper = |sample: &[u8]| (u16::from_ne_bytes([sample[0], sample[1]]) >> 8) as u8;
        samples = samples.chunks_exact(2).map(upper).collect();
    }
    let image = match is_indexed && colour == ColorType::L8 {
        true => Image {
            sides,
            pixels: samples.into_iter().map(Pixel::Index).collect(),
            is_transparency: false,
            is_turned: false,
        },
        false => Image::of_samples(sides, &samples, channels),
    };
    Ok(turned(image, orientation))
}

/// Returns width and height in pixels, as stored.
fn stored(decoder: &(impl ImageDecoder + ?Sized)) -> [usize; 2] {
    let (width, height) = decoder.dimensions();
    [width as usize, height as usize]
}

/// Returns width and height after an image is turned.
fn shown([width, height]: [usize; 2], orientation: Orientation) -> [usize; 2] {
    use Orientation::{FlipHorizontal, FlipVertical, NoTransforms, Rotate180};
    match orientation {
        NoTransforms | FlipHorizontal | FlipVertical | Rotate180 => [width, height],
        _ => [height, width],
    }
}

fn turned(image: Image, orientation: Orientation) -> Image {
    use Orientation::{
        FlipHorizontal, FlipVertical, NoTransforms, Rotate90, Rotate90FlipH, Rotate180, Rotate270, Rotate270FlipH,
    };
    let [width, height] = image.sides;
    let [columns, rows] = shown(image.sides, orientation);
    let (right, bottom) = (width.saturating_sub(1), height.saturating_sub(1));
    // Where a pixel (column x, row y from the top) is stored.
    let place = |x: usize, y: usize| match orientation {
        NoTransforms => [x, y],
        FlipHorizontal => [right - x, y],
        Rotate180 => [right - x, bottom - y],
        FlipVertical => [x, bottom - y],
        Rotate90FlipH => [y, x],
        Rotate90 => [y, bottom - x],
        Rotate270FlipH => [right - y, bottom - x],
        Rotate270 => [right - y, x],
    };
    let of = |at: usize| {
        let [x, y] = place(at % columns, at / columns);
        image.pixels[y * width + x]
    };
    Image {
        sides: [columns, rows],
        pixels: (0..columns * rows).map(of).collect(),
        is_turned: orientation != NoTransforms,
        ..image
    }
}

/// Whether a JPEG has its end marker after the last scan (ITU-T T.81, B.1.1).
fn has_end(bytes: &[u8]) -> bool {
    const END: u8 = 0xd9;
    let mut at = 2;
    while let Some(&byte) = bytes.get(at) {
        let marker = bytes.get(at + 1).copied();
        match (byte, marker) {
            (0xff, Some(END)) => return true,
            // Fill bytes, stuffed zeros, restarts, and markers without a length.
            (0xff, Some(0xff)) => at += 1,
            (0xff, Some(0x00 | 0x01 | 0xd0..=0xd8)) => at += 2,
            // The data of a scan follow its header.
            (0xff, Some(_)) => {
                let (Some(&high), Some(&low)) = (bytes.get(at + 2), bytes.get(at + 3)) else {
                    return false;
                };
                at += 2 + usize::from(u16::from_be_bytes([high, low]));
            }
            _ => at += 1,
        }
    }
    false
}

fn refused(format: PictureFormat, error: &ImageError) -> PatternFileError {
    let name = format.name();
    match error {
        ImageError::Unsupported(_) => PatternFileError::new(format!("cannot read this kind of {name}: {error}"))
            .help("save it in greys or RGB with 8 bits and without layers, or as PNG"),
        ImageError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            PatternFileError::new(format!("the {name} is incomplete")).help(WHOLE)
        }
        _ => PatternFileError::new(format!("not a readable {name}: {error}")),
    }
}
