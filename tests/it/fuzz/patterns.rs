//! Images and tables of patterns; src/pattern/read/fuzz.rs has HDF5 files.

use std::fs;

use bolero::check;
use deaflow::pattern::{DrawingOptions, PatternForm, read_patterns};

use super::checked::{check_message, checked};
use super::mutate::Seeds;

fn cell(x: usize, y: usize) -> u8 {
    u8::from((x * 7 + y * 11) % 13 < 6)
}

/// Reads a file of a form: patterns, or a refusal.
fn reader(form: &'static str) -> impl Fn(&[u8]) -> bool {
    let place = tempfile::tempdir().unwrap();
    move |bytes| {
        let path = place.path().join(format!("p.{form}"));
        fs::write(&path, bytes).unwrap();
        match read_patterns(path.to_str().unwrap(), PatternForm::PAPER, &DrawingOptions::default()) {
            Ok(read) => {
                assert!(!read.patterns.is_empty());
                true
            }
            Err(error) => {
                check_message(&error.to_string());
                false
            }
        }
    }
}

#[test]
fn arrays_of_numpy() {
    let of = |descr: &str, shape: &str, data: Vec<u8>| {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
        let header = format!("{header:<117}\n");
        [b"\x93NUMPY\x01\x00v\x00", header.as_bytes(), &data].concat()
    };
    let cells: Vec<u8> = (0..2500).map(|i| cell(i % 50, i / 50)).collect();
    let floats = cells.iter().flat_map(|c| f64::from(*c).to_le_bytes()).collect();
    let seeds = Seeds::new(
        "npy",
        [
            of("|u1", "(1, 50, 50)", cells.clone()),
            of("|b1", "(50, 50)", cells.clone()),
            of("<f8", "(50, 50)", floats),
        ],
        &[
            "'",
            "(",
            ")",
            ",",
            "{",
            "}",
            "True",
            "<f8",
            ">i4",
            "|O",
            "999999999999999999",
            "descr",
            "\n",
        ],
    );
    check!().with_iterations(400).for_each(checked(&seeds, reader("npy")));
}

#[test]
fn tables() {
    let row = |y: usize| (0..50).map(|x| cell(x, y).to_string()).collect::<Vec<_>>().join(",") + "\n";
    let table: String = (0..50).map(row).collect();
    let seeds = Seeds::new(
        "csv",
        [table.clone().into_bytes(), table.replace(',', ";").into_bytes()],
        &[
            "\n", ",", ";", "\"", "\r\n", "nan", "-0", "1e9", "\t", "\0", "é", "\u{feff}",
        ],
    );
    check!().with_iterations(300).for_each(checked(&seeds, reader("csv")));
}

#[test]
fn images() {
    let png = |color: png::ColorType, data: Vec<u8>| {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 50, 50);
        encoder.set_color(color);
        encoder.write_header().unwrap().write_image_data(&data).unwrap();
        bytes
    };
    let level = |i: usize| 255 * (1 - cell(i % 50, i / 50));
    let seeds = Seeds::new(
        "png",
        [
            png(png::ColorType::Grayscale, (0..2500).map(level).collect()),
            png(png::ColorType::Rgba, (0..10_000).map(|i| level(i / 4)).collect()),
        ],
        &["IHDR", "IDAT", "IEND", "PLTE", "tRNS", "iCCP", "zTXt"],
    );
    check!().with_iterations(400).for_each(checked(&seeds, reader("png")));
}

#[test]
fn names() {
    let valid = [
        "p.npy",
        "a/b.png",
        "x.h5:/patterns",
        "x.h5:/patterns[3]",
        "quickstart.yaml:designs",
    ];
    let seeds = Seeds::new(
        "name",
        valid.map(|name| name.as_bytes().to_vec()),
        &[":", "/", "[", "]", ".h5", "..", "\0", "-1"],
    );
    let read = checked(&seeds, |bytes| {
        // None of these files is there.
        let refusal = read_patterns(
            &format!("nowhere/{}", String::from_utf8_lossy(bytes)),
            PatternForm::PAPER,
            &DrawingOptions::default(),
        )
        .unwrap_err();
        check_message(&refusal.to_string());
        true
    });
    check!().with_iterations(400).for_each(read);
}
