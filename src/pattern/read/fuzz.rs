//! Files of every form, broken at random: read or refused, and never worse. What is read is patterns.

use std::fs;

use proptest::prelude::*;
use proptest::test_runner::RngSeed;

use super::super::h5::tests::sound as h5;
use super::tests::{Folder, wanted};

/// Where bytes are put, which, and how much of the file is left.
#[derive(Clone, Debug)]
struct Harm {
    bytes: Vec<(usize, u8)>,
    left: usize,
}

fn harm() -> impl Strategy<Value = Harm> {
    let place = prop_oneof![3 => 0..200usize, 1 => 0..20_000usize];
    let bytes = prop::collection::vec((place, any::<u8>()), 0..6);
    (bytes, prop_oneof![3 => Just(usize::MAX), 1 => 0..5000usize]).prop_map(|(bytes, left)| Harm { bytes, left })
}

impl Harm {
    fn done_to(&self, sound: &[u8]) -> Vec<u8> {
        let mut bytes = sound.to_vec();
        for &(at, value) in &self.bytes {
            let at = at % bytes.len();
            bytes[at] = value;
        }
        bytes.truncate(self.left);
        bytes
    }
}

/// Sound files by extension, with what follows the file's name.
fn sound() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    let folder = Folder::new();
    let cells = wanted().cells().to_vec();
    let header = format!(
        "{:<117}\n",
        "{'descr': '|u1', 'fortran_order': False, 'shape': (1, 50, 50), }"
    );
    let npy = [b"\x93NUMPY\x01\x00v\x00", header.as_bytes(), &cells].concat();
    let lines = cells
        .chunks(50)
        .map(|row| row.iter().map(u8::to_string).collect::<Vec<_>>().join(","));
    let csv = lines.collect::<Vec<_>>().join("\n").into_bytes();
    let mut png = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut png, 50, 50);
    encoder.set_color(::png::ColorType::Grayscale);
    let levels: Vec<u8> = cells.chunks(50).rev().flatten().map(|&cell| 255 * (1 - cell)).collect();
    encoder.write_header().unwrap().write_image_data(&levels).unwrap();
    vec![
        ("npy", "", npy),
        ("csv", "", csv),
        ("png", "", png),
        ("h5", ":/p", h5(&folder)),
    ]
}

#[test]
fn broken_files_are_read_or_refused() {
    let folder = Folder::new();
    let config = ProptestConfig {
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(21),
        ..ProptestConfig::with_cases(250)
    };
    for (form, suffix, bytes) in sound() {
        let name = format!("broken.{form}");
        fs::write(folder.path(&name), &bytes).unwrap();
        assert_eq!(folder.read(&format!("{name}{suffix}")).unwrap(), [wanted()], "{form}");
        proptest!(config.clone(), |(harm in harm())| {
            fs::write(folder.path(&name), harm.done_to(&bytes)).unwrap();
            match folder.read(&format!("{name}{suffix}")) {
                Ok(patterns) => prop_assert!(patterns.len() == 1),
                Err(message) => prop_assert!(message.contains(&name) && message.len() < 4000),
            }
        });
    }
}
