//! Damaged HDF5 files are read or rejected; tests/it/fuzz/patterns.rs has the other formats.

use std::fs;

use bolero::check;

use super::super::array::tests::sound;
use super::tests::{Folder, wanted};

/// The changes of inputs of all fuzz targets.
#[path = "../../../tests/it/fuzz/mutate.rs"]
pub mod mutate;
use mutate::Seeds;

#[test]
fn damaged_hdf5_files_are_read_or_rejected() {
    let folder = Folder::new();
    let seeds = Seeds::new("h5", [sound(&folder)], &[]);
    fs::write(folder.path("damaged.h5"), &seeds.inputs[..seeds.valid][0]).unwrap();
    assert_eq!(folder.read("damaged.h5:/p").unwrap(), [wanted()]);
    check!().with_iterations(250).for_each(|entropy: &[u8]| {
        fs::write(folder.path("damaged.h5"), seeds.mutated(entropy)).unwrap();
        match folder.read("damaged.h5:/p") {
            Ok(patterns) => assert_eq!(patterns.len(), 1),
            Err(message) => assert!(message.contains("damaged.h5") && message.len() < 4000, "{message}"),
        }
    });
}
