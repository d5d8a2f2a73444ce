//! The same picture in each format, and files that are damaged.

use std::fs;
use std::path::PathBuf;

use bolero::check;
use image::codecs::bmp::BmpEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::tiff::TiffEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::*;
use crate::read::fuzz::mutate::Seeds;
use crate::{DrawingOptions, Edges, FilePatterns, read_mask, read_patterns_of};

/// The cells from the top; the files in `files` show the same, with 16 pixels for each side of a cell or one.
const CELLS: [&str; 4] = ["##.#..", "#....#", "###...", "#....."];

fn raster() -> Raster {
    Raster::new(6, 4).unwrap()
}

fn wanted() -> Pattern {
    Pattern::from_fn(raster(), |x, y| CELLS[3 - y].as_bytes()[x] == b'#')
}

/// Samples of the picture from the top, with some pixels for each side of a cell.
fn samples(block: usize, dark: &[u8], light: &[u8]) -> Vec<u8> {
    let (columns, rows) = (6 * block, 4 * block);
    let places = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    let of = |(x, y): (usize, usize)| match CELLS[y / block].as_bytes()[x / block] {
        b'#' => dark.to_vec(),
        _ => light.to_vec(),
    };
    places.flat_map(of).collect()
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    }

    /// Reads a file, as a device of some groups has it.
    fn read_by(&self, name: &str, bytes: &[u8], groups: usize, edges: Edges) -> Result<FilePatterns, String> {
        let path = self.write(name, bytes);
        let form = PatternForm::of_square_cells(raster(), groups);
        let options = DrawingOptions {
            edges,
            ..DrawingOptions::default()
        };
        let told = |error: PatternFileError| format!("{error} [{}]", error.advice(form));
        read_patterns_of(&path, None, form, &options).map_err(told)
    }

    fn read(&self, name: &str, bytes: &[u8]) -> Result<FilePatterns, String> {
        self.read_by(name, bytes, 1, Edges::Cells)
    }
}

/// A TIFF of one strip: its samples, and tags of 16 bits (TIFF 6.0, section 2).
fn tiff(sides: [u16; 2], bits: &[u16], colour: u16, more: &[(u16, Vec<u16>)], samples: &[u8]) -> Vec<u8> {
    let mut tags: Vec<(u16, Vec<u16>)> = vec![
        (256, vec![sides[0]]),
        (257, vec![sides[1]]),
        (258, bits.to_vec()),
        (259, vec![1]),
        (262, vec![colour]),
        (277, vec![bits.len() as u16]),
        (278, vec![sides[1]]),
    ];
    tags.extend(more.iter().cloned());
    let count = tags.len() + 2;
    let (mut beyond, mut at) = (Vec::new(), (8 + 2 + 12 * count + 4) as u32);
    let mut entries: Vec<(u16, Vec<u8>)> = Vec::new();
    for (tag, values) in tags {
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let mut entry = [
            &tag.to_le_bytes()[..],
            &3u16.to_le_bytes(),
            &(values.len() as u32).to_le_bytes(),
        ]
        .concat();
        if bytes.len() <= 4 {
            entry.extend(bytes.iter().copied().chain([0; 4]).take(4));
        } else {
            entry.extend(at.to_le_bytes());
            at += bytes.len() as u32;
            beyond.extend(bytes);
        }
        entries.push((tag, entry));
    }
    for (tag, value) in [(273u16, at), (279, samples.len() as u32)] {
        let entry = [
            &tag.to_le_bytes()[..],
            &4u16.to_le_bytes(),
            &1u32.to_le_bytes(),
            &value.to_le_bytes(),
        ]
        .concat();
        entries.push((tag, entry));
    }
    entries.sort();
    let mut file = [b"II*\0".as_slice(), &8u32.to_le_bytes(), &(count as u16).to_le_bytes()].concat();
    entries.into_iter().for_each(|(_, entry)| file.extend(entry));
    file.extend(0u32.to_le_bytes());
    [file, beyond, samples.to_vec()].concat()
}

fn encoded(format: PictureFormat, samples: &[u8], sides: [u32; 2], colour: ExtendedColorType) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let [width, height] = sides;
    match format {
        PictureFormat::Bmp => {
            let mut flat = Vec::new();
            BmpEncoder::new(&mut flat)
                .encode(samples, width, height, colour)
                .unwrap();
            return flat;
        }
        PictureFormat::Jpeg => {
            let encoder = JpegEncoder::new_with_quality(&mut bytes, 95);
            encoder.write_image(samples, width, height, colour).unwrap();
        }
        PictureFormat::Tiff => {
            let encoder = TiffEncoder::new(&mut bytes);
            encoder.write_image(samples, width, height, colour).unwrap();
        }
        PictureFormat::Png => {
            let mut encoder = ::png::Encoder::new(&mut bytes, width, height);
            encoder.set_color(match colour {
                ExtendedColorType::L8 | ExtendedColorType::L16 => ::png::ColorType::Grayscale,
                ExtendedColorType::La8 => ::png::ColorType::GrayscaleAlpha,
                ExtendedColorType::Rgba8 => ::png::ColorType::Rgba,
                _ => ::png::ColorType::Rgb,
            });
            let mut big_endian = samples.to_vec();
            if colour == ExtendedColorType::L16 {
                encoder.set_depth(::png::BitDepth::Sixteen);
                big_endian.chunks_exact_mut(2).for_each(|sample| sample.reverse());
            }
            encoder.write_header().unwrap().write_image_data(&big_endian).unwrap();
        }
    }
    bytes.into_inner()
}

fn name(format: PictureFormat) -> String {
    format!("picture.{}", format.name().to_ascii_lowercase())
}

#[test]
fn each_format_shows_the_same_cells() {
    use ExtendedColorType::{L8, L16, La8, Rgb8, Rgba8};
    use PictureFormat::{Bmp, Jpeg, Png, Tiff};
    let folder = Folder::new();
    let cases: [(PictureFormat, ExtendedColorType, &[u8], &[u8]); 13] = [
        (Png, L8, &[0], &[255]),
        (Bmp, L8, &[0], &[255]),
        (Jpeg, L8, &[0], &[255]),
        (Tiff, L8, &[0], &[255]),
        (Png, L16, &[9, 20], &[240, 255]),
        (Tiff, L16, &[9, 20], &[240, 255]),
        (Bmp, Rgb8, &[200, 0, 0], &[255, 255, 200]),
        (Jpeg, Rgb8, &[200, 0, 0], &[255, 255, 200]),
        (Tiff, Rgb8, &[200, 0, 0], &[255, 255, 200]),
        // The shape in the transparency alone, and black on transparent.
        (Png, Rgba8, &[200, 200, 200, 255], &[200, 200, 200, 0]),
        (Bmp, Rgba8, &[200, 200, 200, 255], &[200, 200, 200, 0]),
        (Tiff, Rgba8, &[200, 200, 200, 255], &[200, 200, 200, 0]),
        (Png, La8, &[0, 255], &[0, 0]),
    ];
    for (format, colour, dark, light) in cases {
        for block in [1, 16] {
            // The encoder of JPEG rounds blocks of 8 × 8 pixels.
            if format == Jpeg && block == 1 {
                continue;
            }
            let sides = [6 * block as u32, 4 * block as u32];
            let bytes = encoded(format, &samples(block, dark, light), sides, colour);
            let read = folder.read(&name(format), &bytes).unwrap();
            let of_transparency = usize::from(colour == Rgba8);
            assert_eq!(
                (read.patterns, read.notes.len()),
                (vec![wanted()], of_transparency),
                "{format:?} {colour:?}"
            );
            if block == 1 && colour != Rgba8 {
                let path = folder.write(&name(format), &bytes);
                assert_eq!(read_mask(&path).unwrap(), wanted(), "{format:?} {colour:?}");
            }
        }
    }
}

#[test]
fn greys_cover_the_same_shares_in_each_format() {
    let folder = Folder::new();
    let greys: Vec<u8> = (0..24 * 16 * 16)
        .map(|at: u32| (at / 96 * 4 + at % 96 / 2) as u8)
        .collect();
    let shares = |format: PictureFormat| {
        let bytes = encoded(format, &greys, [96, 64], ExtendedColorType::L8);
        let read = folder.read_by(&name(format), &bytes, 1, Edges::Coverage).unwrap();
        let pattern = read.patterns[0].clone();
        let coverage = pattern.coverage().unwrap().clone();
        (0..24)
            .map(move |at| coverage.share(at % 6, at / 6))
            .collect::<Vec<f64>>()
    };
    let of_png = shares(PictureFormat::Png);
    assert!(of_png.iter().all(|share| *share > 0.0 && *share < 1.0));
    assert_eq!(shares(PictureFormat::Bmp), of_png);
    assert_eq!(shares(PictureFormat::Tiff), of_png);
    for (lossy, exact) in shares(PictureFormat::Jpeg).iter().zip(&of_png) {
        assert!((lossy - exact).abs() < 0.005, "{lossy} {exact}");
    }
}

#[test]
fn kinds_of_files_from_other_programs_are_read() {
    let folder = Folder::new();
    for (name, bytes) in [
        ("cmyk.jpg", &include_bytes!("files/cmyk.jpg")[..]),
        ("bilevel_g4.tif", include_bytes!("files/bilevel_g4.tif")),
        ("lzw.tif", include_bytes!("files/lzw.tif")),
        ("deflate.tif", include_bytes!("files/deflate.tif")),
        ("packbits.tif", include_bytes!("files/packbits.tif")),
        ("jpeg.tif", include_bytes!("files/jpeg.tif")),
    ] {
        let read = folder.read(name, bytes).unwrap();
        assert_eq!((read.patterns, read.notes), (vec![wanted()], vec![]), "{name}");
    }
    // Greys, of which black is the largest; CMYK, of which only black is printed; planes.
    for (bits, colour, more, dark, light) in [
        (vec![8], 0, vec![], vec![255], vec![0]),
        (vec![8; 4], 5, vec![], vec![0, 0, 0, 255], vec![0; 4]),
        (vec![16; 3], 2, vec![], vec![9; 6], vec![240; 6]),
    ] {
        let bytes = tiff([6, 4], &bits, colour, &more, &samples(1, &dark, &light));
        assert_eq!(folder.read("own.tif", &bytes).unwrap().patterns, [wanted()], "{colour}");
    }
}

#[test]
fn the_orientation_in_a_file_is_applied() {
    let folder = Folder::new();
    let bytes = include_bytes!("files/progressive_turned.jpg");
    let read = folder.read("turned.jpg", bytes).unwrap();
    assert_eq!(read.patterns, [wanted()]);
    assert_eq!(read.notes, ["turned as the orientation in the file says"]);
    // What is stored for each orientation, by the definition of TIFF 6.0: row 0 and column 0 are these sides.
    let shown = samples(1, &[0], &[255]);
    let at = |x: usize, y: usize| shown[6 * y + x];
    let stored = |orientation: u16| -> ([u16; 2], Vec<u8>) {
        let place = |column: usize, row: usize| match orientation {
            1 => (column, row),
            2 => (5 - column, row),
            3 => (5 - column, 3 - row),
            4 => (column, 3 - row),
            // The row is a column of what is shown: row 0 is the left side, or the right.
            5 => (row, column),
            6 => (5 - row, column),
            7 => (5 - row, 3 - column),
            _ => (row, 3 - column),
        };
        let [columns, rows] = if orientation < 5 { [6, 4] } else { [4, 6] };
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let samples = places.map(|(column, row)| {
            let (x, y) = place(column, row);
            at(x, y)
        });
        ([columns as u16, rows as u16], samples.collect())
    };
    for orientation in 1..=8 {
        let (sides, samples) = stored(orientation);
        let bytes = tiff(sides, &[8], 1, &[(274, vec![orientation])], &samples);
        let read = folder.read("own.tif", &bytes).unwrap();
        assert_eq!(read.patterns, [wanted()], "{orientation}");
        assert_eq!(read.notes.len(), usize::from(orientation > 1));
        assert_eq!(read_mask(&folder.write("own.tif", &bytes)).unwrap(), wanted());
    }
}

#[test]
fn indices_of_palettes_are_numbers_of_groups() {
    let folder = Folder::new();
    let bytes = include_bytes!("files/palette.bmp");
    let read = folder.read_by("p.bmp", bytes, 2, Edges::Cells).unwrap();
    assert_eq!((read.patterns[0].group(0, 3), read.patterns[0].group(5, 0)), (1, 2));
    assert_eq!(read.patterns[0].group(1, 0), 0);
    let one = folder.read("p.bmp", bytes).unwrap();
    assert_eq!(
        one.patterns[0].active_cells(),
        wanted().active_cells() + 1,
        "dark colours"
    );
}

#[test]
fn pictures_of_other_kinds_are_refused() {
    let folder = Folder::new();
    let float: Vec<u8> = samples(1, &[0; 12], &[0; 12]);
    let bytes = tiff([6, 4], &[32; 3], 2, &[(339, vec![3; 3])], &float);
    let error = folder.read("f.tif", &bytes).unwrap_err();
    assert!(
        error.starts_with("cannot read a TIFF with samples of 32 bits [save it with 8"),
        "{error}"
    );
    let error = folder.read("p.tif", include_bytes!("files/palette.tif")).unwrap_err();
    assert!(
        error.starts_with("cannot read this kind of TIFF") && error.contains("[save it in greys or RGB"),
        "{error}"
    );
    let jpeg = include_bytes!("files/cmyk.jpg");
    let error = folder.read("wrong.png", jpeg).unwrap_err();
    assert_eq!(
        error,
        "the file is in JPEG, not in PNG [name it with the extension of JPEG]"
    );
    let error = folder.read("wrong.bmp", jpeg).unwrap_err();
    assert!(error.contains("in JPEG, not in BMP"), "{error}");
    for name in ["text.jpg", "text.tif", "text.bmp"] {
        let error = folder.read(name, b"no picture").unwrap_err();
        assert!(error.starts_with("not a readable "), "{error}");
    }
}

/// Headers may claim any size; it is refused before memory is taken.
#[test]
fn sizes_are_checked_before_pixels_are_read() {
    let folder = Folder::new();
    let mut jpeg = encoded(PictureFormat::Jpeg, &[0; 24], [6, 4], ExtendedColorType::L8);
    let frame = jpeg.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0xff; 4]);
    let mut bmp = encoded(PictureFormat::Bmp, &[0; 24], [6, 4], ExtendedColorType::L8);
    bmp[18..26].copy_from_slice(&[0xff, 0xff, 0, 0, 0xff, 0xff, 0, 0]);
    let tiff = tiff([65535, 65535], &[8], 1, &[], &[0; 24]);
    for (name, bytes) in [("h.jpg", jpeg), ("h.bmp", bmp), ("h.tif", tiff)] {
        let error = folder.read(name, &bytes).unwrap_err();
        assert!(error.contains("the image has 65535 × 65535 pixels"), "{name}: {error}");
        let error = read_mask(&folder.write(name, &bytes)).unwrap_err().to_string();
        assert!(error.contains("it has 65535 × 65535 cells"), "{name}: {error}");
    }
}

#[test]
fn damaged_pictures_are_read_or_refused() {
    let folder = Folder::new();
    let greys = samples(8, &[0], &[255]);
    let of = |format| encoded(format, &greys, [48, 32], ExtendedColorType::L8);
    let words = &["\0", "II*\0", "MM\0*", "JFIF", "Exif\0\0", "BM", "Adobe"];
    for (name, seeds) in [
        (
            "d.jpg",
            vec![
                of(PictureFormat::Jpeg),
                include_bytes!("files/cmyk.jpg").to_vec(),
                include_bytes!("files/progressive_turned.jpg").to_vec(),
            ],
        ),
        (
            "d.tif",
            vec![
                tiff([6, 4], &[8], 1, &[(274, vec![6])], &samples(1, &[0], &[255])),
                include_bytes!("files/bilevel_g4.tif").to_vec(),
                include_bytes!("files/jpeg.tif").to_vec(),
            ],
        ),
        (
            "d.bmp",
            vec![of(PictureFormat::Bmp), include_bytes!("files/palette.bmp").to_vec()],
        ),
    ] {
        let seeds = Seeds::new("picture", seeds, words);
        check!()
            .with_iterations(300)
            .for_each(|entropy: &[u8]| match folder.read(name, &seeds.mutated(entropy)) {
                Ok(read) => assert_eq!(read.patterns.len(), 1),
                Err(message) => assert!(message.len() < 2000, "{message}"),
            });
    }
}

#[test]
fn files_that_are_cut_are_refused() {
    let folder = Folder::new();
    let greys = samples(8, &[0], &[255]);
    let of = |format| encoded(format, &greys, [48, 32], ExtendedColorType::L8);
    let files = [
        ("c.jpg", of(PictureFormat::Jpeg)),
        ("c.jpg", include_bytes!("files/progressive_turned.jpg").to_vec()),
        ("c.tif", tiff([48, 32], &[8], 1, &[], &greys)),
        ("c.tif", include_bytes!("files/lzw.tif").to_vec()),
        ("c.bmp", of(PictureFormat::Bmp)),
    ];
    for (name, bytes) in files {
        assert!(folder.read(name, &bytes).is_ok());
        // The last bytes one by one: of TIFF they are samples or the list of tags, of JPEG its end.
        let ends = bytes.len() - 16..bytes.len() - 1;
        for length in (1..bytes.len() - 16).step_by(13).chain(ends) {
            match folder.read(name, &bytes[..length]) {
                Err(error) => assert!(error.len() < 1000, "{error}"),
                Ok(read) => panic!("{name} of {length} of {} bytes is read: {:?}", bytes.len(), read.notes),
            }
        }
    }
}
