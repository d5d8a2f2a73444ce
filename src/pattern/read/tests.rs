use std::fs;
use std::path::PathBuf;

use super::*;
use crate::{CELLS, Membrane, Raster};

pub fn wanted() -> Pattern {
    // Asymmetric under every transposition and mirror.
    Pattern::from_fn(Raster::PAPER, |x, y| {
        x < 10 && y < 20 || (x, y) == (30, 49) || (x + 3 * y) % 11 == 0
    })
}

pub struct Folder(tempfile::TempDir);

/// Reads untrusted files for the tests of this crate, which start their program with this test only.
#[test]
#[ignore = "the process that other tests start"]
fn the_process_that_other_tests_start() {
    deaflow_hdf::serve().unwrap();
}

impl Folder {
    pub fn new() -> Self {
        deaflow_hdf::read_by_test();
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn read(&self, name: &str) -> Result<Vec<Pattern>, String> {
        Ok(self.noted(name)?.patterns)
    }

    fn noted(&self, name: &str) -> Result<FilePatterns, String> {
        read_patterns(
            self.path(name).to_str().unwrap(),
            PatternForm::PAPER,
            &DrawingOptions::default(),
        )
        .map_err(|e| format!("{e:?}"))
    }

    fn read_bytes(&self, name: &str, bytes: &[u8]) -> Result<Vec<Pattern>, String> {
        fs::write(self.path(name), bytes).unwrap();
        self.read(name)
    }

    fn refusal(&self, name: &str, bytes: &[u8]) -> String {
        let message = self.read_bytes(name, bytes).expect_err("it should be refused");
        assert!(message.contains(name), "the file is named: {message}");
        message
    }
}

#[test]
fn a_whole_table_of_other_cells_says_how_to_simulate_them() {
    let folder = Folder::new();
    let table = |columns: usize, rows: usize| format!("{}\n", vec!["1"; columns].join(",")).repeat(rows);
    let square = "or simulate 20 × 20 cells: `--set geometry.cells=20` (of a pipeline `--set scene.geometry.cells=20`)";
    for (columns, rows, told) in [
        (20, 20, Some(square)),
        (
            50,
            20,
            Some("or simulate 50 × 20 cells: `--set geometry.cells=[50, 20]`"),
        ),
        (
            20,
            50,
            Some("or simulate 20 × 50 cells: `--set geometry.cells=[20, 50]`"),
        ),
        (401, 20, None),
        (1, 50, None),
    ] {
        let message = folder.refusal("own.csv", table(columns, rows).as_bytes());
        assert_eq!(message.contains("--set"), told.is_some(), "{message}");
        let told = told.unwrap_or("allowed: 50 lines of 50 values");
        assert!(message.contains(told), "{message}");
    }
    let message = folder.refusal("own.csv", format!("{}1,0\n", table(20, 20)).as_bytes());
    assert!(!message.contains("--set"), "lines of several lengths: {message}");
}

pub fn cells() -> Vec<f64> {
    wanted().cells().iter().map(|&c| f64::from(c)).collect()
}

/// As `numpy.save` of NumPy 2.4 writes it: the header padded with blanks to 128 bytes in all.
fn npy(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
    let mut bytes = b"\x93NUMPY\x01\x00v\x00".to_vec();
    bytes.extend(format!("{text:<117}\n").bytes());
    assert_eq!(bytes.len(), 128);
    bytes.extend(data);
    bytes
}

#[test]
fn numpy_files_of_every_type_and_order() {
    let folder = Folder::new();
    let encoded: Vec<(&str, Vec<u8>)> = vec![
        ("|b1", wanted().cells().to_vec()),
        ("|u1", wanted().cells().to_vec()),
        ("<i8", cells().iter().flat_map(|c| (*c as i64).to_le_bytes()).collect()),
        (">i2", cells().iter().flat_map(|c| (*c as i16).to_be_bytes()).collect()),
        (
            "<f2",
            cells()
                .iter()
                .flat_map(|c| [0, if *c == 1.0 { 0x3c } else { 0 }])
                .collect(),
        ),
        (">f4", cells().iter().flat_map(|c| (*c as f32).to_be_bytes()).collect()),
        ("<f8", cells().iter().flat_map(|c| (-0.0 + c).to_le_bytes()).collect()),
    ];
    for (descr, data) in encoded {
        assert_eq!(
            folder
                .read_bytes("a.npy", &npy(descr, "False", "(50, 50)", &data))
                .unwrap(),
            [wanted()],
            "{descr}"
        );
        let twice = [data.clone(), data].concat();
        let both = folder
            .read_bytes("a.NPY", &npy(descr, "False", "(2, 50, 50)", &twice))
            .unwrap();
        assert_eq!(both, [wanted(), wanted()]);
    }
}

#[test]
fn fortran_order_puts_the_first_index_fastest() {
    let folder = Folder::new();
    let other = Pattern::from_fn(Raster::PAPER, |x, _| x == 7);
    let mut data = Vec::new();
    for x in 0..CELLS {
        for y in 0..CELLS {
            data.extend([&wanted(), &other].map(|p| u8::from(p.is_active(x, y))));
        }
    }
    let read = folder
        .read_bytes("f.npy", &npy("|u1", "True", "(2, 50, 50)", &data))
        .unwrap();
    assert_eq!(read, [wanted(), other]);
}

#[test]
fn numpy_files_that_are_not_patterns() {
    let folder = Folder::new();
    let ok = vec![0; 2500];
    let mut two = ok.clone();
    two[3 * 50 + 4] = 2;
    assert!(
        folder
            .refusal("v.npy", &npy("|u1", "False", "(50, 50)", &two))
            .contains("[y=3][x=4] is 2")
    );
    let stack = [ok.clone(), two].concat();
    assert!(
        folder
            .refusal("v.npy", &npy("|u1", "False", "(2, 50, 50)", &stack))
            .contains("[1][y=3][x=4] is 2")
    );
    let nan: Vec<u8> = [f64::NAN].repeat(2500).iter().flat_map(|v| v.to_le_bytes()).collect();
    assert!(
        folder
            .refusal("v.npy", &npy("<f8", "False", "(50, 50)", &nan))
            .contains("is NaN")
    );
    for (shape, said) in [
        ("(0, 50, 50)", "no pattern"),
        ("(2500,)", "shape (2500,)"),
        ("(51, 51)", "shape (51, 51)"),
        ("()", "shape ()"),
        ("(1, 1, 50, 50)", "shape (1, 1, 50, 50)"),
        ("(18446744073709551615, 50, 50)", "at most 20000"),
        ("(18446744073709551616, 50, 50)", "`shape`"),
        ("(2, 50, 50)", "5000 bytes"),
    ] {
        let message = folder.refusal("s.npy", &npy("|u1", "False", shape, &ok));
        assert!(message.contains(said), "{shape}: {message}");
    }
    assert!(
        folder
            .refusal("t.npy", &npy("<U1", "False", "(50, 50)", &ok))
            .contains("<U1")
    );
    assert!(
        folder
            .refusal("t.npy", &npy("|u1", "False", "(50, 50)", &ok)[..2000])
            .contains("truncated")
    );
}

#[test]
fn hostile_numpy_headers() {
    let folder = Folder::new();
    for bytes in [
        b"\x93NUM".to_vec(),
        b"\x93NUMPY".to_vec(),
        b"\x93NUMPY\x01\x00\xff".to_vec(),
        b"\x93NUMPY\x01\x00\xff\xff{".to_vec(),
        b"\x93NUMPY\x02\x00\xff\xff\xff\xff{'descr'".to_vec(),
        b"\x93NUMPY\x09\x07\x00\x00".to_vec(),
        [b"\x93NUMPY\x02\x00\x00\x01\x00\x00".to_vec(), vec![b'('; 256]].concat(),
        [b"\x93NUMPY\x01\x00\x10\x00".to_vec(), vec![0xff; 16]].concat(),
        npy("|u1", "Maybe", "(50, 50)", &[0; 2500]),
        npy("|u1", "False", "(-50, 50)", &[0; 2500]),
    ] {
        folder.refusal("h.npy", &bytes);
    }
}

fn csv_text(cell: impl Fn(bool) -> &'static str) -> String {
    let row = |y| {
        (0..CELLS)
            .map(|x| cell(wanted().is_active(x, y)))
            .collect::<Vec<_>>()
            .join(",")
    };
    (0..CELLS).map(|y| row(y) + "\n").collect()
}

#[test]
fn the_first_csv_line_is_the_lower_edge() {
    let folder = Folder::new();
    let plain = csv_text(|on| if on { "1" } else { "0" });
    // `numpy.savetxt` writes "%.18e" unless told otherwise.
    let savetxt = csv_text(|on| {
        if on {
            "1.000000000000000000e+00"
        } else {
            "0.000000000000000000e+00"
        }
    });
    for text in [
        plain.clone(),
        savetxt,
        plain.replace('\n', "\r\n"),
        format!("# made by hand\n{plain}\n\n"),
        format!("\u{feff}{plain}"),
        plain.replace(',', ", "),
        plain.trim_end().to_owned(),
    ] {
        assert_eq!(folder.read_bytes("p.csv", text.as_bytes()).unwrap(), [wanted()]);
    }
    assert!(wanted().is_active(30, 49) && plain.lines().last().unwrap().split(',').nth(30) == Some("1"));
}

#[test]
fn semicolons_tabs_and_spaces_separate_too() {
    let folder = Folder::new();
    let plain = csv_text(|on| if on { "1" } else { "0" });
    for separator in [";", "\t", " ", "; ", "  ", "   ", ",0;", ",0\t", ",0  "] {
        let text = format!("# a comment, with commas\n{}", plain.replace(',', separator));
        assert_eq!(
            folder.read_bytes("q.csv", text.as_bytes()).unwrap(),
            [wanted()],
            "{separator:?}"
        );
    }
}

#[test]
fn csv_files_that_are_not_patterns() {
    let folder = Folder::new();
    let plain = csv_text(|on| if on { "1" } else { "0" });
    let refusal = |text: String| folder.refusal("q.csv", text.as_bytes());
    assert!(refusal(plain.replace(',', "|")).contains("line 1 has 1 values"));
    assert!(refusal(plain.replacen(',', ";", 1)).contains("line 1 has 2 values"));
    assert!(refusal(plain.lines().take(49).map(|l| format!("{l}\n")).collect()).contains("49 lines"));
    assert!(refusal(format!("{plain}{plain}")).contains("100 lines"));
    assert!(refusal(plain.replacen("0,", "0.5,", 1)).contains("is 0.5"));
    assert!(refusal(plain.replacen("0,", "nan,", 1)).contains("is NaN"));
    assert!(refusal(plain.replacen("0,", "x,", 1)).contains("line 1: value 11"));
    // Empty cells, as spreadsheets write them.
    for separator in [",", ";", "\t"] {
        let values = plain.lines().nth(2).unwrap();
        for (line, at) in [
            (format!(",{}", &values[2..]), 1),
            (format!("{},", &values[..97]), 50),
            (format!("{},,{}", &values[..3], &values[6..]), 3),
        ] {
            let said = refusal(plain.replacen(values, &line, 1).replace(',', separator));
            assert!(
                said.contains(&format!("line 3: value {at} is empty")),
                "{separator:?} {at}: {said}"
            );
        }
    }
    assert!(refusal(plain.replacen("0,", "1e300,", 1)).contains("is 1e300"));
    assert!(refusal("# nothing\n".into()).contains("0 lines"));
    folder.refusal("q.csv", &[0xff; 5000]);
    assert!(folder.refusal("q.csv", &vec![b'1'; 2 << 20]).contains("at most"));
}

fn png(width: u32, height: u32, colour: ::png::ColorType, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
    bytes
}

/// Pixels from the top, `block` to a cell.
fn pixels(block: usize, dark: &[u8], light: &[u8]) -> Vec<u8> {
    let side = CELLS * block;
    let colour = |at: usize| {
        let (column, row) = (at % side / block, at / side / block);
        if wanted().is_active(column, CELLS - 1 - row) {
            dark
        } else {
            light
        }
    };
    (0..side * side).flat_map(|at| colour(at).to_vec()).collect()
}

#[test]
fn images_with_the_top_row_at_the_upper_edge() {
    use ::png::ColorType::{Grayscale, GrayscaleAlpha, Rgb, Rgba};
    let folder = Folder::new();
    for (colour, dark, light) in [
        (Grayscale, &[0][..], &[255][..]),
        (Grayscale, &[60], &[200]),
        (Rgb, &[10, 20, 120], &[255, 255, 200]),
        (Rgba, &[0, 0, 0, 255], &[0, 0, 0, 0]),
        (GrayscaleAlpha, &[0, 255], &[0, 20]),
    ] {
        for block in [1, 3] {
            let side = 50 * block as u32;
            let image = png(side, side, colour, &pixels(block, dark, light));
            assert_eq!(
                folder.read_bytes("i.png", &image).unwrap(),
                [wanted()],
                "{colour:?} {block}"
            );
        }
    }
}

#[test]
fn images_that_are_not_patterns() {
    use ::png::ColorType::{Grayscale, Rgb};
    let folder = Folder::new();
    let plain = pixels(1, &[0], &[255]);
    // A mask has a pixel per cell, so its greys mean nothing.
    let mut grey = plain.clone();
    grey[2 * 50 + 7] = 128;
    fs::write(folder.path("g.png"), png(50, 50, Grayscale, &grey)).unwrap();
    let said = read_mask(&folder.path("g.png")).unwrap_err().to_string();
    assert!(
        said.contains("column 7, row 2 from the top) is neither dark nor light: its brightness is 50 %"),
        "{said}"
    );
    for (width, height) in [(50, 100), (50, 52), (640, 480)] {
        let image = png(width, height, Rgb, &vec![0; 3 * (width * height) as usize]);
        assert!(
            folder
                .refusal("s.png", &image)
                .contains(&format!("{width} × {height} pixels"))
        );
    }
    let whole = png(50, 50, Grayscale, &plain);
    for cut in [4, 20, 40, 60, whole.len() - 14] {
        folder.refusal("c.png", &whole[..cut]);
    }
    // The header claims 4 billion pixels a side.
    let mut huge = whole.clone();
    huge[16..24].fill(0xff);
    folder.refusal("h.png", &huge);
    let mut flipped = whole;
    flipped[50] ^= 0x55;
    folder.refusal("f.png", &flipped);
}

#[test]
fn pictures_are_read_by_coverage_and_the_area_is_stated() {
    use ::png::ColorType::Grayscale;
    let folder = Folder::new();
    let noted = |name: &str, side: u32, data: &[u8]| {
        fs::write(folder.path(name), png(side, side, Grayscale, data)).unwrap();
        folder.noted(name).unwrap()
    };
    // A disc of radius 0.3 of the side, from the top, anti-aliased by 4 × 4 points for each pixel.
    let disc = |side: usize| -> Vec<u8> {
        let dark = |x: f64, y: f64| (x - 0.6).hypot(y - 0.4) < 0.3;
        let level = |at: usize| {
            let points = (0..16).filter(|k| {
                let place = |pixel: usize, k: usize| (pixel as f64 + (k as f64 + 0.5) / 4.0) / side as f64;
                dark(place(at % side, k % 4), place(at / side, k / 4))
            });
            (255.0 * (1.0 - points.count() as f64 / 16.0)) as u8
        };
        (0..side * side).map(level).collect()
    };
    let exact = Pattern::from_fn(Raster::PAPER, |x, y| {
        ((x as f64 + 0.5) / 50.0 - 0.6).hypot((y as f64 + 0.5) / 50.0 - 0.6) < 0.3
    });
    for side in [50, 500, 512, 37, 333] {
        let read = noted("disc.png", side, &disc(side as usize));
        let differing = read.patterns[0]
            .cells()
            .iter()
            .zip(exact.cells())
            .filter(|(a, b)| a != b);
        let most = if side < 50 { 60 } else { 8 };
        assert!(differing.count() <= most, "{side}");
        let note = &read.notes[0];
        assert!(
            note.starts_with(&format!("{side} × {side} pixels read by coverage")),
            "{note}"
        );
        // π 0.3² = 28.27 %.
        let of_picture = note.split("picture ").nth(1).unwrap().split(' ').next().unwrap();
        assert!((of_picture.parse::<f64>().unwrap() - 28.27).abs() < 0.15, "{note}");
    }
    // Two greys are dark and light, and the area is that of the darker.
    let faint: Vec<u8> = pixels(1, &[120], &[135]);
    let read = noted("faint.png", 50, &faint);
    let area = format!("{:.1} %", 100.0 * wanted().area_fraction(None));
    assert_eq!(read.patterns, [wanted()]);
    assert!(
        read.notes[0].ends_with(&format!(
            "(brightness 47.1 % is dark, 52.9 % light); area of the picture {area}, of the cells {area}"
        )),
        "{}",
        read.notes[0]
    );
    // Light greys alone are no electrode.
    let light = noted("light.png", 50, &pixels(1, &[200], &[254]));
    assert_eq!(light.notes, ["the pattern has no electrode"]);
    // Blocks of equal pixels are exact, and need no note; one odd pixel is a part of its cell.
    let mut uneven = pixels(2, &[0], &[255]);
    assert_eq!(noted("even.png", 100, &uneven).notes, [""; 0]);
    uneven[101] = 255 - uneven[101];
    let read = noted("uneven.png", 100, &uneven);
    assert_eq!((read.patterns, read.notes.len()), (vec![wanted()], 1));
    // The parts of a cell add up to it.
    for (cells, pixels) in [(50, 512), (50, 37), (7, 400), (3, 1)] {
        for at in 0..cells {
            let sum: f64 = super::picture::parts(at, cells, pixels)
                .iter()
                .map(|(_, part)| part)
                .sum();
            assert!((sum - 1.0).abs() < 1e-12, "{cells} {pixels} {at}");
        }
    }
}

#[test]
fn greys_of_pictures_cover_parts_of_cells() {
    use ::png::ColorType::Grayscale;
    let folder = Folder::new();
    let options = DrawingOptions {
        edges: crate::Edges::Coverage,
        ..DrawingOptions::default()
    };
    let read = |name: &str, groups: usize| {
        let form = PatternForm::of_square_cells(Raster::new(3, 2).unwrap(), groups);
        read_patterns_of(&folder.path(name), None, form, &options).map_err(|error| error.to_string())
    };
    // The first row is the upper edge; 1 − g/255.
    fs::write(
        folder.path("grey.png"),
        png(3, 2, Grayscale, &[0, 255, 204, 255, 51, 127]),
    )
    .unwrap();
    let found = read("grey.png", 1).unwrap();
    let coverage = found.patterns[0].coverage().unwrap();
    let expected = [0.0, 0.8, 128.0 / 255.0, 1.0, 0.0, 0.2];
    for (share, expected) in coverage.shares().into_iter().zip(expected) {
        assert!((share - expected).abs() < 1e-9, "{share} {expected}");
    }
    assert_eq!(
        (found.patterns[0].cells(), found.notes.len()),
        (&[0, 1, 1, 1, 0, 0][..], 0)
    );
    // Pixels are averaged over a cell.
    let halves: Vec<u8> = (0..24).map(|at| if at % 6 == 0 { 0 } else { 255 }).collect();
    fs::write(folder.path("fine.png"), png(6, 4, Grayscale, &halves)).unwrap();
    let found = read("fine.png", 1).unwrap();
    assert_eq!(
        found.patterns[0].coverage().unwrap().shares(),
        [0.5, 0.0, 0.0, 0.5, 0.0, 0.0]
    );
    // Black and white are whole cells.
    fs::write(
        folder.path("whole.png"),
        png(3, 2, Grayscale, &[0, 255, 0, 255, 0, 255]),
    )
    .unwrap();
    let found = read("whole.png", 1).unwrap();
    assert!(found.patterns[0].coverage().is_none());
    assert_eq!(found.patterns[0].cells(), [0, 1, 0, 1, 0, 1]);
    assert!(
        read("grey.png", 2)
            .unwrap_err()
            .contains("number of an electrode group")
    );
    fs::write(folder.path("wrong.png"), png(2, 9, Grayscale, &[0; 18])).unwrap();
    assert_eq!(read("wrong.png", 1).unwrap_err(), "the image has 2 × 9 pixels");
    fs::write(folder.path("cells.csv"), "0,1,0\n1,1,1\n").unwrap();
    assert!(
        read("cells.csv", 1)
            .unwrap_err()
            .contains("drawings and pictures alone")
    );
}

#[test]
fn pictures_have_the_ratio_of_the_cells_or_that_of_the_membrane() {
    use ::png::ColorType::Grayscale;
    let folder = Folder::new();
    // 20 × 10 cells on 60 × 20 mm: a cell is 3 mm wide and 2 mm high.
    let raster = Raster::new(20, 10).unwrap();
    let membrane = Membrane {
        raster,
        size_mm: [60.0, 20.0],
    };
    let form = PatternForm::on(&membrane, 1);
    let wanted = Pattern::from_fn(raster, |x, y| x < 4 || (x, y) == (19, 9) || (x + 3 * y) % 7 == 0);
    let read = |width: u32, height: u32, form: PatternForm| {
        let level = |at: u32| {
            let [column, row] = [at % width * 20 / width, at / width * 10 / height];
            if wanted.is_active(column as usize, 9 - row as usize) {
                0
            } else {
                255
            }
        };
        let image: Vec<u8> = (0..width * height).map(level).collect();
        fs::write(folder.path("r.png"), png(width, height, Grayscale, &image)).unwrap();
        read_patterns(folder.path("r.png").to_str().unwrap(), form, &DrawingOptions::default())
            .map_err(|error| format!("{error:?}"))
    };
    // Pixels per cell of both ratios, and 30 × 20 ones at 10.3 per mm, rounded; none leaves a note.
    for [width, height] in [[20, 10], [60, 30], [60, 20], [620, 210]] {
        let found = read(width, height, form).unwrap();
        assert_eq!(
            (found.patterns, found.notes.len()),
            (vec![wanted.clone()], 0),
            "{width} × {height}"
        );
    }
    // Pixels that divide no cell, in the ratio of the membrane and in that of the cells.
    for [width, height] in [[450, 150], [451, 150], [350, 175]] {
        let found = read(width, height, form).unwrap();
        assert_eq!(
            (found.patterns, found.notes.len()),
            (vec![wanted.clone()], 1),
            "{width} × {height}"
        );
    }
    // Another ratio, as that of a picture that was turned or cut, and that of the membrane if it is not known.
    for [width, height] in [[10, 20], [20, 20], [100, 10], [400, 150], [480, 150]] {
        let refused = read(width, height, form).unwrap_err();
        assert!(refused.contains(&format!("{width} × {height} pixels")), "{refused}");
        assert!(refused.contains("or that of the membrane, 3.000"), "{refused}");
    }
    let refused = read(60, 20, PatternForm::of_square_cells(raster, 1)).unwrap_err();
    assert!(!refused.contains("membrane"), "{refused}");
    // Several groups, whose cells are blocks.
    let groups = PatternForm::on(&membrane, 2);
    assert_eq!(read(60, 20, groups).unwrap().patterns[0], wanted);
    assert!(read(450, 150, groups).is_err());
}

#[test]
fn a_shape_in_the_transparency_is_read() {
    use ::png::ColorType::{GrayscaleAlpha, Rgba};
    let folder = Folder::new();
    for (colour, opaque, transparent) in [
        (Rgba, &[255, 255, 255, 255][..], &[255, 255, 255, 0][..]),
        (Rgba, &[255, 255, 255, 255], &[0, 0, 0, 0]),
        (Rgba, &[200, 30, 30, 255], &[200, 30, 30, 0]),
        (GrayscaleAlpha, &[180, 255], &[0, 0]),
    ] {
        fs::write(
            folder.path("a.png"),
            png(50, 50, colour, &pixels(1, opaque, transparent)),
        )
        .unwrap();
        let read = folder.noted("a.png").unwrap();
        assert_eq!(read.patterns, [wanted()], "{colour:?} {opaque:?}");
        assert_eq!(read.notes, ["shape taken from the transparency: opaque = electrode"]);
    }
    // With two colours the transparency is a background.
    let both = pixels(1, &[0, 255], &[255, 200]);
    fs::write(folder.path("b.png"), png(50, 50, GrayscaleAlpha, &both)).unwrap();
    let read = folder.noted("b.png").unwrap();
    assert_eq!((read.patterns, read.notes.len()), (vec![wanted()], 0));
}

#[test]
fn masks_of_0_and_255_are_read_as_0_and_1() {
    let folder = Folder::new();
    let mask = |high: u16| -> Vec<u8> {
        let values = wanted()
            .cells()
            .iter()
            .map(|&cell| u16::from(cell) * high)
            .collect::<Vec<_>>();
        npy(
            "<u2",
            "False",
            "(50, 50)",
            &values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>(),
        )
    };
    for high in [255, 65535] {
        fs::write(folder.path("m.npy"), mask(high)).unwrap();
        let read = folder.noted("m.npy").unwrap();
        assert_eq!(read.patterns, [wanted()]);
        assert_eq!(read.notes, [format!("values 0 and {high} read as 0 and 1")]);
    }
    assert!(folder.refusal("m.npy", &mask(254)).contains("is 254"));
    let mut mixed: Vec<u8> = wanted().cells().iter().map(|&cell| 255 * cell).collect();
    mixed[2499] = 1;
    let said = folder.refusal("m.npy", &npy("|u1", "False", "(50, 50)", &mixed));
    assert!(said.contains("[y=0][x=0] is 255"), "{said}");
    fs::write(folder.path("m.csv"), csv_text(|on| if on { "255" } else { "0" })).unwrap();
    assert_eq!(folder.read("m.csv").unwrap(), [wanted()]);
    assert_eq!(read_mask(&folder.path("m.csv")).unwrap(), wanted());
}

#[test]
fn a_pattern_without_electrode_or_covered_completely_is_noted() {
    let folder = Folder::new();
    for (cell, note) in [
        (0, "the pattern has no electrode"),
        (1, "the pattern is covered completely"),
    ] {
        fs::write(folder.path("e.npy"), npy("|u1", "False", "(50, 50)", &[cell; 2500])).unwrap();
        assert_eq!(folder.noted("e.npy").unwrap().notes, [note]);
    }
    let three = [vec![0; 5000], wanted().cells().to_vec()].concat();
    fs::write(folder.path("e.npy"), npy("|u1", "False", "(3, 50, 50)", &three)).unwrap();
    assert_eq!(
        folder.noted("e.npy").unwrap().notes,
        ["2 of 3 patterns: each has no electrode"]
    );
}

#[test]
fn other_names_are_rejected_with_the_allowed_ones() {
    let folder = Folder::new();
    for name in ["p.doc", "p.tar.gz", "p", ".npy", "p.npy", "p.h5", "p.txt", "p.nc:/p"] {
        let message = folder.read(name).unwrap_err();
        assert!(message.contains("FILE.csv"), "{name}: {message}");
    }
    assert!(folder.refusal("e.npy", b"").contains("empty"));
    fs::create_dir(folder.path("d.npy")).unwrap();
    assert!(folder.read("d.npy").unwrap_err().contains("not a file"));
}

/// A pattern of three groups without symmetry.
fn grouped(raster: Raster) -> Pattern {
    Pattern::from_groups(raster, |x, y| ((x + 2 * y + x * y) % 4) as u8)
}

fn read_groups(folder: &Folder, name: &str, form: PatternForm) -> Result<Vec<Pattern>, String> {
    let read = read_patterns(folder.path(name).to_str().unwrap(), form, &DrawingOptions::default());
    read.map(|read| read.patterns).map_err(|e| format!("{e:?}"))
}

#[test]
fn groups_are_read_as_numbers_grey_levels_and_indices() {
    let folder = Folder::new();
    let raster = Raster::new(7, 5).unwrap();
    let (form, wanted) = (PatternForm::of_square_cells(raster, 3), grouped(raster));
    let lines = wanted
        .cells()
        .chunks(7)
        .map(|row| row.iter().map(u8::to_string).collect::<Vec<_>>().join(",") + "\n");
    fs::write(folder.path("g.csv"), lines.collect::<String>()).unwrap();
    fs::write(folder.path("g.npy"), npy("|u1", "False", "(5, 7)", wanted.cells())).unwrap();
    let image = |name: &str, colour: ::png::ColorType, depth: ::png::BitDepth, data: &[u8]| {
        let mut encoder = ::png::Encoder::new(fs::File::create(folder.path(name)).unwrap(), 7, 5);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if colour == ::png::ColorType::Indexed {
            encoder.set_palette(vec![255, 255, 255, 200, 0, 0, 0, 200, 0, 0, 0, 200, 9, 9, 9]);
        }
        encoder.write_header().unwrap().write_image_data(data).unwrap();
    };
    let rows: Vec<&[u8]> = wanted.cells().chunks(7).rev().collect();
    let grey = |group: u8| match group {
        0 => 255,
        group => (255.0 * f64::from(group - 1) / 3.0) as u8,
    };
    let greys: Vec<u8> = rows
        .iter()
        .flat_map(|row| row.iter().map(|&group| grey(group)))
        .collect();
    image("grey.png", ::png::ColorType::Grayscale, ::png::BitDepth::Eight, &greys);
    image(
        "index.png",
        ::png::ColorType::Indexed,
        ::png::BitDepth::Eight,
        &rows.concat(),
    );
    // Two bits each, four to a byte.
    let packed = rows.iter().flat_map(|row| {
        let bytes = row.chunks(4).map(|part| {
            let bits = part.iter().fold(0, |byte, &group| byte << 2 | group);
            bits << (2 * (4 - part.len()))
        });
        bytes.collect::<Vec<u8>>()
    });
    image(
        "packed.png",
        ::png::ColorType::Indexed,
        ::png::BitDepth::Two,
        &packed.collect::<Vec<_>>(),
    );
    for name in ["g.csv", "g.npy", "grey.png", "index.png", "packed.png"] {
        assert_eq!(
            read_groups(&folder, name, form).unwrap(),
            vec![wanted.clone()],
            "{name}"
        );
    }
    // With fewer groups the file, the cell and what is allowed are named.
    let fewer = PatternForm::of_square_cells(raster, 2);
    for (name, says) in [
        ("g.csv", "[y=0][x=3] is 3"),
        ("g.npy", "[y=0][x=3] is 3"),
        ("grey.png", "is not the colour of an electrode group"),
        ("index.png", "colour 3 of the palette"),
    ] {
        let refusal = read_groups(&folder, name, fewer).unwrap_err();
        assert!(refusal.contains(says) && refusal.contains(name), "{refusal}");
    }
    assert!(read_groups(&folder, "g.csv", fewer).unwrap_err().contains("1 to 2"));
}

#[test]
fn files_without_names_have_no_named_datasets() {
    let folder = Folder::new();
    for (name, end) in [("a.npy", "npy"), ("A.CSV", "csv"), ("a.png", "png")] {
        fs::write(folder.path(name), "x").unwrap();
        let spec = format!("{}:/x", folder.path(name).display());
        let error = read_patterns(&spec, PatternForm::PAPER, &DrawingOptions::default()).unwrap_err();
        let said = format!("`.{end}` files have no named datasets");
        assert!(error.to_string().contains(&said), "{error}");
    }
}

#[test]
fn a_threshold_says_how_dark_electrodes_are() {
    use ::png::ColorType::Grayscale;
    let folder = Folder::new();
    // Black in the corner, 60 % dark on the left, white on the right.
    let level = |at: usize| match (at, at % 50 < 25) {
        (0, _) => 0,
        (_, true) => 102,
        (_, false) => 255,
    };
    fs::write(
        folder.path("grey.png"),
        png(50, 50, Grayscale, &(0..2500).map(level).collect::<Vec<u8>>()),
    )
    .unwrap();
    let area = |threshold: f64| {
        let drawings = DrawingOptions {
            threshold,
            ..DrawingOptions::default()
        };
        let read = read_patterns(folder.path("grey.png").to_str().unwrap(), PatternForm::PAPER, &drawings).unwrap();
        (read.patterns[0].area_fraction(None) * 2500.0, read.notes)
    };
    let (cells, notes) = area(0.5);
    assert!(
        cells == 1250.0 && notes[0].contains("at least half of a cell is dark"),
        "{cells} {notes:?}"
    );
    let (cells, notes) = area(0.7);
    assert!(
        cells == 1.0 && notes[0].contains("at least 70.0 % of a cell is dark"),
        "{cells} {notes:?}"
    );
    assert_eq!(area(0.55).0, 1250.0);
}
