use std::fs;
use std::io::Write;
use std::path::PathBuf;

use flate2::Compression;
use flate2::write::DeflateEncoder;

use super::*;
use deaflow_base::Stream;
use deaflow_pattern::{CELLS, Membrane, Symmetries};

const CORNERS: usize = CELLS + 1;

fn device() -> Arc<Device> {
    Arc::new(Device::new(Membrane::square(50.0), 1, Symmetries::SQUARE, None))
}

struct Folder(tempfile::TempDir);

/// Reads HDF5 files for the tests of this crate, which start the test program again with this test only.
#[test]
#[ignore = "the process that other tests start"]
fn the_process_that_other_tests_start() {
    deaflow_hdf::serve().unwrap();
}

impl Folder {
    fn new() -> Self {
        deaflow_hdf::read_by_test();
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn read(&self, name: &str) -> Result<Rows, String> {
        self.read_of(&device(), name)
    }

    fn read_of(&self, device: &Arc<Device>, name: &str) -> Result<Rows, String> {
        let said = |e: ImportError| format!("{e} ({})", e.help(device));
        let file = ImportFile::open(&self.path(name), device).map_err(said)?;
        file.rows(0..file.len()).map_err(said)
    }

    fn read_bytes(&self, name: &str, bytes: &[u8]) -> Result<Rows, String> {
        fs::write(self.path(name), bytes).unwrap();
        self.read(name)
    }

    fn refusal(&self, name: &str, bytes: &[u8]) -> String {
        self.read_bytes(name, bytes).expect_err("it should be refused")
    }
}

/// Cells of two patterns that no symmetry exchanges.
fn cells() -> Vec<f64> {
    let cell = |i: usize| f64::from(u8::from((i / 7).is_multiple_of(3) || i % 50 < 4));
    (0..2 * CELLS * CELLS).map(cell).collect()
}

/// Fields of numbers that single precision holds, zero on the frame.
fn fields() -> Vec<f64> {
    let value = |i: usize| {
        let (x, y) = (i / 2 % CORNERS, i / 2 / CORNERS % CORNERS);
        let on_frame = [x, y].iter().any(|&place| place == 0 || place == CELLS);
        if on_frame {
            0.0
        } else {
            ((i * 37 % 101) as f64 - 50.0) / 64.0
        }
    };
    (0..2 * CORNERS * CORNERS * 2).map(value).collect()
}

fn encoded(descr: &str, values: &[f64]) -> Vec<u8> {
    let bytes = |value: f64| match descr {
        "|u1" => vec![value as u8],
        "<i8" => (value as i64).to_le_bytes().to_vec(),
        "<f4" => (value as f32).to_le_bytes().to_vec(),
        ">f4" => (value as f32).to_be_bytes().to_vec(),
        ">f8" => value.to_be_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    };
    values.iter().flat_map(|&value| bytes(value)).collect()
}

fn npy(descr: &str, shape: &[usize], values: &[f64], fortran: bool) -> Vec<u8> {
    let extents: Vec<String> = shape.iter().map(usize::to_string).collect();
    let order = if fortran { "True" } else { "False" };
    let text = format!(
        "{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({},), }}\n",
        extents.join(", ")
    );
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.bytes());
    match fortran {
        false => bytes.extend(encoded(descr, values)),
        true => bytes.extend(encoded(descr, &scattered(shape, values))),
    }
    bytes
}

/// Values with the first index fastest.
fn scattered(shape: &[usize], values: &[f64]) -> Vec<f64> {
    let mut out = Vec::with_capacity(values.len());
    for mut at in 0..values.len() {
        let mut indices = Vec::new();
        for extent in shape {
            indices.push(at % extent);
            at /= extent;
        }
        let place = indices
            .iter()
            .zip(shape)
            .fold(0, |place, (index, extent)| place * extent + index);
        out.push(values[place]);
    }
    out
}

/// A zip file as the format's description has it (APPNOTE 6.3.3).
fn archive(members: &[(&str, Vec<u8>)], deflated: bool) -> Vec<u8> {
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for (name, bytes) in members {
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(bytes).unwrap();
        let packed = if deflated {
            encoder.finish().unwrap()
        } else {
            bytes.clone()
        };
        let mut crc = flate2::Crc::new();
        crc.update(bytes);
        let mut common = vec![20, 0, 0, 0, if deflated { 8 } else { 0 }, 0, 0, 0, 0x21, 0];
        common.extend(crc.sum().to_le_bytes());
        common.extend((packed.len() as u32).to_le_bytes());
        common.extend((bytes.len() as u32).to_le_bytes());
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0, 0]);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&common);
        directory.extend([0; 10]);
        directory.extend((file.len() as u32).to_le_bytes());
        directory.extend(name.bytes());
        file.extend(b"PK\x03\x04");
        file.extend(&common);
        file.extend(name.bytes());
        file.extend(&packed);
    }
    let (start, count) = (file.len() as u32, members.len() as u16);
    file.extend(&directory);
    file.extend(b"PK\x05\x06\0\0\0\0");
    file.extend([count.to_le_bytes(), count.to_le_bytes()].concat());
    file.extend((directory.len() as u32).to_le_bytes());
    file.extend(start.to_le_bytes());
    file.extend([0, 0]);
    file
}

fn npz(cells: &[f64], fields: &[f64]) -> Vec<u8> {
    let n = cells.len() / (CELLS * CELLS);
    let patterns = npy("|u1", &[n, 50, 50], cells, false);
    let displacement = npy("<f8", &[fields.len() / 5202, 51, 51, 2], fields, false);
    archive(&[("patterns.npy", patterns), ("displacement.npy", displacement)], false)
}

fn csv_text(cells: &[f64], fields: &[f64]) -> String {
    let mut text = csv::COLUMNS.join(",") + "\n";
    // In another order than they are kept.
    for corner in (0..fields.len() / 2).rev() {
        let (sample, place) = (corner / (CORNERS * CORNERS), corner % (CORNERS * CORNERS));
        let (x, y) = (place % CORNERS, place / CORNERS);
        let electrode = match x < CELLS && y < CELLS {
            true => cells[sample * CELLS * CELLS + y * CELLS + x].to_string(),
            false => String::new(),
        };
        let (ux, uy) = (fields[2 * corner], fields[2 * corner + 1]);
        text += &format!("{sample},{x},{y},{ux},{uy},{electrode}\n");
    }
    text
}

fn h5(path: &Path, write: impl Fn(&hdf5::File)) {
    write(&hdf5::File::create(path).unwrap());
}

fn put(file: &hdf5::File, name: &str, shape: &[usize], values: &[f64]) -> hdf5::Dataset {
    let dataset = file.new_dataset::<f64>().shape(shape).create(name).unwrap();
    dataset.write_raw(values).unwrap();
    dataset
}

fn text_attribute(at: &hdf5::Location, name: &str, text: &str) {
    let text: hdf5::types::VarLenUnicode = text.parse().unwrap();
    at.new_attr::<hdf5::types::VarLenUnicode>()
        .create(name)
        .unwrap()
        .write_scalar(&text)
        .unwrap();
}

#[test]
fn every_format_type_and_order_gives_the_same_rows() {
    let folder = Folder::new();
    let wanted = Rows::new(&cells(), fields(), 0, &device()).unwrap();
    let digest = wanted.digest();
    for (of_cells, of_fields) in [("|u1", "<f8"), ("<i8", ">f8"), ("<f4", "<f4"), (">f8", ">f4")] {
        for fortran in [false, true] {
            for deflated in [false, true] {
                let patterns = npy(of_cells, &[2, 50, 50], &cells(), fortran);
                let displacement = npy(of_fields, &[2, 51, 51, 2], &fields(), fortran);
                let members = [
                    ("displacement.npy", displacement),
                    ("more.npy", vec![1]),
                    ("patterns.npy", patterns),
                ];
                let read = folder.read_bytes("a.npz", &archive(&members, deflated)).unwrap();
                assert_eq!(read, wanted, "{of_cells} {of_fields} {fortran} {deflated}");
                assert_eq!(read.digest(), digest);
            }
        }
    }
    assert_eq!(
        folder
            .read_bytes("a.csv", csv_text(&cells(), &fields()).as_bytes())
            .unwrap(),
        wanted
    );
    // As European spreadsheets and numpy.savetxt write tables.
    let plain = csv_text(&cells(), &fields());
    let comma = |line: &str| line.replace(',', ";").replace('.', ",") + ";a note\r\n";
    let european: String = plain.lines().map(comma).collect();
    let european = european.replacen("sample;x_mm", "Sample;X_mm", 1);
    let zeros = plain.replace(",\n", ",0\n");
    let blanks = |line: &str| {
        let number = |field: &str| {
            field
                .parse::<f64>()
                .map_or("nan".to_owned(), |value| format!("{value:.18e}"))
        };
        line.split(',').map(number).collect::<Vec<_>>().join(" ") + "\n"
    };
    let savetxt: String = plain.lines().skip(1).map(blanks).collect();
    let savetxt = format!("# {}\n{savetxt}", csv::COLUMNS.join(" "));
    for (name, text) in [("b.csv", european), ("b.txt", savetxt), ("b.dat", zeros)] {
        assert_eq!(folder.read_bytes(name, text.as_bytes()).unwrap(), wanted, "{name}");
    }
    h5(&folder.path("a.h5"), |file| {
        put(file, "patterns", &[2, 50, 50], &cells());
        let displacement = put(file, "displacement", &[2, 51, 51, 2], &fields());
        text_attribute(&displacement, "units", "mm");
        text_attribute(file, "scene", "some");
    });
    assert_eq!(folder.read("a.h5").unwrap(), wanted);
    assert_eq!(
        ImportFile::open(&folder.path("a.h5"), &device()).unwrap().scene(),
        Some("some")
    );
}

/// MATLAB writes the axes in reverse and says so in an attribute.
#[test]
fn arrays_of_matlab_give_the_same_rows() {
    let folder = Folder::new();
    let wanted = Rows::new(&cells(), fields(), 0, &device()).unwrap();
    h5(&folder.path("m.mat"), |file| {
        for (name, shape, values) in [
            ("patterns", &[2, 50, 50][..], cells()),
            ("displacement", &[2, 51, 51, 2], fields()),
        ] {
            let reversed: Vec<usize> = shape.iter().rev().copied().collect();
            let dataset = put(file, name, &reversed, &scattered(shape, &values));
            text_attribute(&dataset, "MATLAB_class", "double");
        }
    });
    assert_eq!(folder.read("m.mat").unwrap(), wanted);
    let file = ImportFile::open(&folder.path("m.mat"), &device()).unwrap();
    assert_eq!(file.notes(), ["axes in MATLAB's order, reversed"]);
    assert_eq!(file.rows(1..2).unwrap(), wanted.part(1..2));
}

#[test]
fn rows_are_read_by_their_numbers_and_another_row_is_another_digest() {
    let folder = Folder::new();
    fs::write(folder.path("a.npz"), npz(&cells(), &fields())).unwrap();
    let file = ImportFile::open(&folder.path("a.npz"), &device()).unwrap();
    let (both, second) = (file.rows(0..2).unwrap(), file.rows(1..2).unwrap());
    assert_eq!(second, both.part(1..2));
    assert_ne!(second.digest(), both.part(0..1).digest());
    let mut moved = fields();
    moved[2 * (CORNERS + 1)] += 1e-9;
    assert_ne!(
        Rows::new(&cells(), moved, 0, &device()).unwrap().digest(),
        both.digest()
    );
    let zeros = |zero: f64| {
        Rows::new(&[0.0; 2500], vec![zero; 5202], 0, &device())
            .unwrap()
            .digest()
    };
    assert_eq!(zeros(0.0), zeros(-0.0));
}

#[test]
fn numbers_that_are_no_pattern_or_no_field_are_named_by_row_and_place() {
    let folder = Folder::new();
    let with = |place: usize, value: f64| {
        let mut fields = fields();
        fields[place] = value;
        folder.read_bytes("a.npz", &npz(&cells(), &fields))
    };
    let inner = 5202 + 2 * (3 * CORNERS + 4);
    for (place, value, said) in [
        (inner, f64::NAN, "row 1: `displacement` [y=3][x=4] is NaN"),
        (inner + 1, f64::NEG_INFINITY, "[y=3][x=4] is -inf"),
        (
            inner,
            1200.0,
            "on a membrane of 50 mm (convert displacements to mm: divide µm",
        ),
        (5202, 2e-6, "row 1: the frame moves by 2.000e-6 mm at [y=0][x=0]"),
        (2 * 50, -0.1, "row 0: the frame moves by 1.000e-1 mm at [y=0][x=50]"),
    ] {
        let message = with(place, value).unwrap_err();
        assert!(message.contains(said), "{message}");
    }
    let rounded = with(5202, -1e-6).unwrap();
    assert_eq!(
        rounded,
        Rows::new(&cells(), fields(), 0, &device()).unwrap(),
        "rounding is no displacement"
    );
    for value in [2.0, 0.5, f64::NAN] {
        let mut cells = cells();
        cells[2500 + 50 * 3 + 4] = value;
        let patterns = npy("<f8", &[2, 50, 50], &cells, false);
        let displacement = npy("<f8", &[2, 51, 51, 2], &fields(), false);
        let file = archive(&[("patterns.npy", patterns), ("displacement.npy", displacement)], true);
        let message = folder.refusal("a.npz", &file);
        assert!(
            message.contains(&format!("row 1: `patterns` [y=3][x=4] is {value}")),
            "{message}"
        );
    }
}

#[test]
fn archives_that_are_no_dataset_are_refused_before_anything_large_is_made() {
    let folder = Folder::new();
    let patterns = || ("patterns.npy", npy("|u1", &[2, 50, 50], &cells(), false));
    let displacement = || ("displacement.npy", npy("<f8", &[2, 51, 51, 2], &fields(), false));
    let (c, f) = (cells(), fields());
    let vast = npy("|u1", &[1_000_000_000, 50, 50], &[], false);
    let odd = npy("|u1", &[2, 50, 50], &cells()[..4000], false);
    let flat = npy("<f8", &[2, 51, 51], &vec![0.0; 5202], false);
    let one = npy("<f8", &[1, 51, 51, 2], &f[..5202], false);
    let none = [
        npy("|u1", &[0, 50, 50], &[], false),
        npy("<f8", &[0, 51, 51, 2], &[], false),
    ];
    let [no_patterns, no_fields] = none;
    for (members, said) in [
        (
            vec![patterns()],
            "`displacement` is missing; the file has patterns (needed: ",
        ),
        (vec![displacement()], "`patterns` is missing; the file has displacement"),
        (
            vec![("readme.txt", b"hello".to_vec())],
            "`patterns` is missing; the file has readme.txt",
        ),
        (vec![], "`patterns` is missing; the file has nothing"),
        (
            vec![patterns(), ("displacement.npy", one)],
            "2 patterns and 1 displacement fields",
        ),
        (
            vec![patterns(), ("displacement.npy", flat)],
            "shape (2, 51, 51) (allowed: (n, 51, 51, 2))",
        ),
        (
            vec![("patterns.npy", vast), displacement()],
            "1000000000 patterns and 2 displacement fields",
        ),
        (
            vec![("patterns.npy", odd), displacement()],
            "`patterns`: its shape needs",
        ),
        (
            vec![("patterns.npy", b"PK\x03\x04".to_vec()), displacement()],
            "`patterns`: not a NumPy file",
        ),
        (
            vec![("patterns.npy", no_patterns), ("displacement.npy", no_fields)],
            "the file has no rows",
        ),
    ] {
        for deflated in [false, true] {
            let message = folder.refusal("a.npz", &archive(&members, deflated));
            assert!(message.contains(said), "{said}: {message}");
        }
    }
    let sound = npz(&c, &f);
    for cut in [0, 10, 200, 5200, sound.len() - 1, sound.len() - 60] {
        folder.refusal("a.npz", &sound[..cut]);
    }
    let mut damaged = sound.clone();
    damaged[20_000] ^= 0x40;
    let message = folder.refusal("a.npz", &damaged);
    assert!(message.contains("`displacement`: checksum does not match"), "{message}");
    assert!(folder.refusal("a.zip", &sound).contains("format `.zip`"));
}

/// The sizes in a zip file are claims: here 4 GB in a few hundred bytes.
#[test]
fn an_archive_that_claims_more_than_it_holds_is_refused() {
    let folder = Folder::new();
    let mut file = npz(&cells(), &fields());
    let mut at = 0;
    while let Some(next) = file[at..].windows(4).position(|w| w == b"PK\x01\x02") {
        at += next + 4;
        file[at + 20..at + 24].copy_from_slice(&0xffff_fff0_u32.to_le_bytes());
    }
    let message = folder.refusal("a.npz", &file);
    assert!(message.contains("cannot hold them"), "{message}");
}

#[test]
fn hdf5_files_that_are_no_dataset() {
    let folder = Folder::new();
    let refusal = |name: &str, write: &dyn Fn(&hdf5::File)| {
        h5(&folder.path(name), write);
        folder.read(name).unwrap_err()
    };
    let both = |file: &hdf5::File| {
        put(file, "patterns", &[2, 50, 50], &cells());
        put(file, "displacement", &[2, 51, 51, 2], &fields())
    };
    let said = refusal("units.h5", &|file| text_attribute(&both(file), "units", "m"));
    assert!(said.contains("`units` of `displacement` is \"m\""), "{said}");
    let said = refusal("alone.h5", &|file| {
        put(file, "patterns", &[2, 50, 50], &cells());
    });
    assert!(
        said.contains("`displacement` is missing; the file has patterns"),
        "{said}"
    );
    let said = refusal("vast.h5", &|file| {
        let vast = file.new_dataset::<u8>().chunk([1, 50, 50]);
        vast.shape([1_000_000_000, 50, 50]).create("patterns").unwrap();
        let vast = file.new_dataset::<f64>().chunk([1, 51, 51, 2]);
        vast.shape([1_000_000_000, 51, 51, 2]).create("displacement").unwrap();
    });
    assert!(said.contains("cannot hold them"), "{said}");
    let said = refusal("guess.h5", &|file| {
        both(file);
        let words = ["converged", "estimated"].map(|word| word.parse::<hdf5::types::FixedUnicode<16>>().unwrap());
        let outcome = file
            .new_dataset::<hdf5::types::FixedUnicode<16>>()
            .shape([2])
            .create("outcome")
            .unwrap();
        outcome.write_raw(&words).unwrap();
    });
    assert!(
        said.contains("row 1 is not simulated: its `outcome` is estimated"),
        "{said}"
    );
    let said = folder.refusal("x.h5", b"\x89HDF\r\n\x1a\n and then nothing");
    assert!(said.contains("not a readable HDF5 file"), "{said}");
}

#[test]
fn lines_that_are_no_dataset_are_named() {
    let folder = Folder::new();
    let text = csv_text(&cells(), &fields());
    let lines: Vec<&str> = text.lines().collect();
    let with = |line: usize, other: &str| {
        let mut lines = lines.clone();
        lines[line] = other;
        folder.refusal("a.csv", lines.join("\n").as_bytes())
    };
    for (line, other, said) in [
        (
            0,
            "sample,x,y,ux,uy,electrode",
            "the column x_mm is missing; the columns are sample, x, y",
        ),
        (1, "1,50,50,0,0,1", "line 2: `electrode` is given, but there is no cell"),
        (
            1,
            "1,50.3,50,0,0,",
            "line 2: no corner at 50.3 mm: corners are 1 mm apart",
        ),
        (1, "1,49,50,0,0,", "line 3: the corner has more than one line"),
        (1, "one,50,50,0,0,", "line 2: `sample`: \"one\" is not a number"),
        (60, "1,40,49,0.1,0.1,", "line 61: `electrode` is empty"),
        (60, "1,40,49,0.1,x,0", "`uy_mm`: \"x\" is not a number"),
        (60, "1,40,49,0.1,0", "`electrode` is empty"),
        (60, "1,40,49,0.1", "`uy_mm`: \"\" is not a number"),
        (60, "1,40,49,0.1,0,0,7", "line 61: the line has 7 values, the header 6"),
        (60, "1.5,40,49,0.1,0,0", "`sample` is \"1.5\", not a whole number"),
    ] {
        let message = with(line, other);
        assert!(message.contains(said), "{said}: {message}");
    }
    let few = format!("{}\n0,0,0,0,0,1\n1,0,0,0,0,1\n", lines[0]);
    let message = folder.refusal("a.csv", few.as_bytes());
    assert!(
        message.contains("line 2: the file is too short for this number of samples"),
        "{message}"
    );
    let short = lines[..lines.len() - 1].join("\n");
    let message = folder.refusal("a.csv", short.as_bytes());
    assert!(
        message.contains("sample 0 has no line for the corner x = 0 mm, y = 0 mm"),
        "{message}"
    );
    assert!(folder.refusal("a.csv", lines[0].as_bytes()).contains("no rows"));
}

/// Bytes changed at random places, the same each time: read or refused, and nothing worse.
#[test]
fn broken_files_are_read_or_refused() {
    let folder = Folder::new();
    let one = (cells()[..2500].to_vec(), fields()[..5202].to_vec());
    let text = csv_text(&one.0, &one.1).into_bytes();
    let mut stream = Stream::new(1, "harm", 0);
    for (name, sound) in [("a.npz", npz(&one.0, &one.1)), ("a.csv", text)] {
        for _ in 0..300 {
            let mut harmed = sound.clone();
            for _ in 0..=stream.index(3) {
                // Headers and the directory at the end are worth more than numbers.
                let at = match stream.index(3) {
                    0 => stream.index(200),
                    1 => harmed.len() - 1 - stream.index(200),
                    _ => stream.index(harmed.len()),
                };
                harmed[at] = stream.index(256) as u8;
            }
            if let Ok(rows) = folder.read_bytes(name, &harmed) {
                assert!(rows.len() <= 1);
            }
        }
    }
}

#[test]
fn masks_are_read_as_patterns_and_noted() {
    let folder = Folder::new();
    let bytes = |cells: &[f64]| {
        let patterns = npy("|u1", &[2, CELLS, CELLS], cells, false);
        let fields = npy("<f8", &[2, CORNERS, CORNERS, 2], &fields(), false);
        archive(&[("patterns.npy", patterns), ("displacement.npy", fields)], false)
    };
    let plain = folder.read_bytes("plain.npz", &bytes(&cells())).unwrap();
    let masks: Vec<f64> = cells().iter().map(|cell| 255.0 * cell).collect();
    assert_eq!(folder.read_bytes("mask.npz", &bytes(&masks)).unwrap(), plain);
    let notes = |name: &str| ImportFile::open(&folder.path(name), &device()).unwrap().notes();
    assert_eq!(notes("mask.npz"), ["values 0 and 255 of `patterns` read as 0 and 1"]);
    assert!(notes("plain.npz").is_empty());
    let mut mixed = masks;
    let bare = mixed.iter().position(|cell| *cell == 0.0).unwrap();
    mixed[bare] = 1.0;
    assert!(folder.refusal("mixed.npz", &bytes(&mixed)).contains("is 1"));
}

#[test]
fn packed_values_of_netcdf_are_unpacked() {
    let folder = Folder::new();
    let write = |name: &str, factor: Option<f32>, offset: Option<f64>| {
        let mut builder = hdf5::FileBuilder::new();
        builder.with_fapl(|access| access.file_locking(false));
        let file = builder.create(folder.path(name)).unwrap();
        let patterns = file
            .new_dataset::<u8>()
            .shape([2, CELLS, CELLS])
            .create("patterns")
            .unwrap();
        patterns
            .write_raw(&cells().iter().map(|cell| *cell as u8).collect::<Vec<_>>())
            .unwrap();
        let packed: Vec<i16> = fields().iter().map(|value| (64.0 * value) as i16).collect();
        let shape = [2, CORNERS, CORNERS, 2];
        let displacement = file.new_dataset::<i16>().shape(shape).create("displacement").unwrap();
        displacement.write_raw(&packed).unwrap();
        if let Some(factor) = factor {
            let attribute = displacement
                .new_attr::<f32>()
                .shape([1])
                .create("scale_factor")
                .unwrap();
            attribute.write_raw(&[factor]).unwrap();
        }
        if let Some(offset) = offset {
            let attribute = displacement.new_attr::<f64>().create("add_offset").unwrap();
            attribute.write_scalar(&offset).unwrap();
        }
    };
    write("packed.nc", Some(1.0 / 64.0), Some(0.0));
    assert_eq!(
        folder.read("packed.nc").unwrap().fields[1].values(),
        &fields()[fields().len() / 2..]
    );
    let notes = ImportFile::open(&folder.path("packed.nc"), &device()).unwrap().notes();
    assert_eq!(notes, ["values unpacked: times 0.015625, plus 0"]);
    // An offset alone moves the frame.
    write("moved.nc", None, Some(0.5));
    assert!(folder.read("moved.nc").unwrap_err().contains("frame"));
}
