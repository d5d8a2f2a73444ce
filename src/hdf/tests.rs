//! Files that harm libhdf5, and sound ones, read in another process.

use std::path::Path;

use super::*;

/// Serves the tests beside it, which start the program of the tests anew with this one alone.
#[test]
#[ignore = "the process that other tests start"]
fn the_process_that_other_tests_start() {
    serve().unwrap();
}

/// Writes a file without a lock, which a process that starts meanwhile would inherit and keep.
fn write(path: &Path, write: impl Fn(&hdf5::File)) {
    read_by_test();
    let mut builder = hdf5::FileBuilder::new();
    builder.with_fapl(|access| access.file_locking(false));
    write(&builder.create(path).unwrap());
}

/// A file with an array of each form that is read.
fn sound(path: &Path) {
    use hdf5::types::{FixedAscii, VarLenUnicode};
    write(path, |file| {
        let new = |name: &str| file.new_dataset::<f64>().shape([5, 2]).create(name).unwrap();
        new("plain")
            .write_raw(&(0..10).map(f64::from).collect::<Vec<_>>())
            .unwrap();
        new("unwritten");
        let packed = file.new_dataset::<i16>().chunk([2, 2]).deflate(4).shape([5, 2]);
        packed.create("group/packed").unwrap().write_raw(&[-3_i16; 10]).unwrap();
        let flags = file.new_dataset::<bool>().shape([2]).create("flags").unwrap();
        flags.write_raw(&[true, false]).unwrap();
        let texts: Vec<VarLenUnicode> = ["x", "yé"].map(|t| t.parse().unwrap()).to_vec();
        let variable = file
            .new_dataset::<VarLenUnicode>()
            .shape([2])
            .create("variable")
            .unwrap();
        variable.write_raw(&texts).unwrap();
        let fixed = [FixedAscii::<4>::from_ascii("four").unwrap()];
        let ascii = file.new_dataset::<FixedAscii<4>>().shape([1]).create("fixed").unwrap();
        ascii.write_raw(&fixed).unwrap();
        file.new_dataset::<u8>().shape([0, 3]).create("none").unwrap();
        file.new_attr::<VarLenUnicode>()
            .create("said")
            .unwrap()
            .write_scalar(&texts[1])
            .unwrap();
    });
}

#[test]
fn the_child_process_reads_the_same_as_this_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.h5");
    sound(&path);
    for file in [
        HdfFile::open_trusted(&path).unwrap(),
        HdfFile::open_untrusted(&path).unwrap(),
    ] {
        assert_eq!(file.numbers("plain", 1..3).unwrap(), [2.0, 3.0, 4.0, 5.0]);
        assert_eq!(file.numbers("group/packed", 0..5).unwrap(), [-3.0; 10]);
        assert_eq!(file.numbers("flags", 0..2).unwrap(), [1.0, 0.0]);
        assert_eq!(file.numbers("none", 0..0).unwrap(), Vec::<f64>::new());
        assert_eq!(file.numbers("unwritten", 0..5).unwrap(), [0.0; 10]);
        assert_eq!(file.texts("variable").unwrap(), ["x", "yé"]);
        assert_eq!(
            (file.texts("fixed").unwrap(), file.words("fixed").unwrap()),
            (vec!["four".into()], vec!["four".into()])
        );
        assert_eq!(
            file.elements("plain").unwrap(),
            Elements::F64((0..10).map(f64::from).collect())
        );
        assert_eq!(file.attribute("said").unwrap().as_deref(), Some("yé"));
        assert_eq!(
            (file.attribute("none").unwrap(), file.find("none at all").unwrap()),
            (None, None)
        );
        let names = [
            "fixed",
            "flags",
            "none",
            "plain",
            "unwritten",
            "variable",
            "group/packed",
        ];
        assert_eq!(file.names().unwrap(), names);
        assert_eq!(file.find("plain").unwrap().unwrap().shape, [5, 2]);
        for (dataset, rows) in [("plain", 4..6), ("variable", 0..1), ("gone", 0..1), ("group", 0..1)] {
            let error = file.numbers(dataset, rows).unwrap_err();
            assert!(error.is_of_the_file() && error.to_string().contains("x.h5"), "{error}");
        }
    }
}

#[test]
fn a_small_file_with_large_claims_is_rejected_before_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.h5");
    write(&path, |file| {
        let vast = file.new_dataset::<f64>().shape([1_000_000_000_usize]);
        vast.create("plain").unwrap();
        let chunked = file.new_dataset::<u8>().chunk([1, 50, 50]).shape([1 << 40, 50, 50]);
        chunked.create("chunked").unwrap();
    });
    let file = HdfFile::open_untrusted(&path).unwrap();
    for dataset in ["plain", "chunked"] {
        let error = file.numbers(dataset, 0..10).unwrap_err().to_string();
        assert!(error.contains("can contain only"), "{error}");
    }
}

#[test]
fn an_invalid_file_is_rejected_and_the_next_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let [noise, pipe, good] = ["noise.h5", "pipe.h5", "x.h5"].map(|name| folder.path().join(name));
    std::fs::write(&noise, b"\x89HDF\r\n\x1a\n and then nothing").unwrap();
    assert!(
        std::process::Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    for path in [&noise, &pipe, &folder.path().join("gone.h5")] {
        let error = HdfFile::open_untrusted(path).err().unwrap();
        assert!(error.to_string().contains("not a readable HDF5 file"), "{error}");
    }
    sound(&good);
    assert_eq!(
        HdfFile::open_untrusted(&good).unwrap().texts("variable").unwrap().len(),
        2
    );
    // Another file in its place is another file.
    write(&good, |file| {
        file.new_dataset::<u8>().shape([1]).create("other").unwrap();
    });
    assert_eq!(HdfFile::open_untrusted(&good).unwrap().names().unwrap(), ["other"]);
}

#[test]
fn links_within_a_file_are_followed_and_those_to_other_files_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let [inside, outside, other] = ["in.h5", "out.h5", "other.h5"].map(|name| folder.path().join(name));
    sound(&other);
    let with_links = |path: &Path, leads_outside: bool| {
        write(path, |file| {
            let dataset = file.new_dataset::<f64>().shape([2]).create("group/plain").unwrap();
            dataset.write_raw(&[1.0, 2.0]).unwrap();
            file.link_soft("/group/plain", "soft").unwrap();
            file.link_soft("/group", "way").unwrap();
            file.link_soft("/nothing", "dangling").unwrap();
            file.link_soft("/round", "round").unwrap();
            if leads_outside {
                file.link_external("other.h5", "/plain", "group/away").unwrap();
            }
        });
        HdfFile::open_untrusted(path).unwrap()
    };
    let file = with_links(&inside, false);
    for name in ["soft", "way/plain"] {
        assert_eq!(file.numbers(name, 0..2).unwrap(), [1.0, 2.0], "{name}");
    }
    assert_eq!(file.names().unwrap(), ["group/plain"]);
    for name in ["dangling", "round"] {
        let error = file.find(name).unwrap_err().to_string();
        assert!(error.contains("a link that leads nowhere"), "{error}");
    }
    let file = with_links(&outside, true);
    assert_eq!(file.numbers("group/plain", 0..2).unwrap(), [1.0, 2.0]);
    for (name, said) in [
        ("soft", "with links to other files"),
        ("group/away", "a link to another file"),
    ] {
        let error = file.find(name).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn a_file_of_links_alone_is_not_called_empty() {
    let folder = tempfile::tempdir().unwrap();
    let names = |name: &str, content: &dyn Fn(&hdf5::File)| {
        let path = folder.path().join(name);
        write(&path, |file| content(file));
        HdfFile::open_untrusted(&path).unwrap().names()
    };
    let circle = |file: &hdf5::File| {
        file.link_soft("/b", "a").unwrap();
        file.link_soft("/a", "b").unwrap();
    };
    let away = |file: &hdf5::File| {
        circle(file);
        file.link_external("other.h5", "/x", "group").unwrap();
    };
    for (name, content, said) in [
        (
            "circle.h5",
            &circle as &dyn Fn(&hdf5::File),
            "only links: \"a\" leads nowhere",
        ),
        ("away.h5", &away, "only links: \"group\" leads to another file"),
    ] {
        let error = names(name, content).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
    let group = |file: &hdf5::File| {
        file.create_group("g").unwrap();
        file.link_soft("/g", "way").unwrap();
    };
    assert!(names("group.h5", &group).unwrap().is_empty());
    assert!(names("empty.h5", &|_| ()).unwrap().is_empty());
}

/// MATLAB writes the array p(y, x) of 2 rows and 3 columns as a dataset of 3 × 2.
#[test]
fn axes_of_matlab_are_reversed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mat");
    let attribute = |dataset: &hdf5::Dataset, name: &str| {
        let class = hdf5::types::FixedAscii::<8>::from_ascii("double").unwrap();
        let created = dataset.new_attr::<hdf5::types::FixedAscii<8>>().create(name);
        created.unwrap().write_scalar(&class).unwrap();
    };
    write(&path, |file| {
        let new = |name: &str, shape: &[usize]| {
            let dataset = file.new_dataset::<f64>().shape(shape).create(name).unwrap();
            let values: Vec<f64> = (0..dataset.size()).map(|at| at as f64).collect();
            dataset.write_raw(&values).unwrap();
            dataset
        };
        new("plain", &[3, 2]);
        attribute(&new("two", &[3, 2]), "MATLAB_class");
        attribute(&new("three", &[4, 3, 2]), "MATLAB_class");
        attribute(&new("one", &[3]), "MATLAB_class");
        attribute(&new("empty", &[2]), "MATLAB_empty");
    });
    for file in [
        HdfFile::open_trusted(&path).unwrap(),
        HdfFile::open_untrusted(&path).unwrap(),
    ] {
        let info = |name: &str| file.find(name).unwrap().unwrap();
        assert_eq!((info("plain").shape, info("plain").is_reversed), (vec![3, 2], false));
        assert_eq!((info("two").shape, info("two").is_reversed), (vec![2, 3], true));
        assert_eq!((info("one").shape, info("one").is_reversed), (vec![3], false));
        assert_eq!(info("empty").shape, [0]);
        assert_eq!(file.numbers("plain", 0..1).unwrap(), [0.0, 1.0]);
        assert_eq!(file.numbers("two", 0..2).unwrap(), [0.0, 2.0, 4.0, 1.0, 3.0, 5.0]);
        assert_eq!(file.numbers("two", 1..2).unwrap(), [1.0, 3.0, 5.0]);
        assert_eq!(info("three").shape, [2, 3, 4]);
        let last: Vec<f64> = (0..3)
            .flat_map(|y| (0..4).map(move |x| f64::from(x * 6 + y * 2 + 1)))
            .collect();
        assert_eq!(file.numbers("three", 1..2).unwrap(), last);
    }
    // A file that MATLAB saved says so at its start.
    let block = folder.path().join("block.mat");
    let mut builder = hdf5::FileBuilder::new();
    builder
        .with_fapl(|access| access.file_locking(false))
        .with_fcpl(|create| create.userblock(512));
    let file = builder.create(&block).unwrap();
    file.new_dataset::<u8>()
        .shape([3, 2])
        .create("p")
        .unwrap()
        .write_raw(&[0_u8, 1, 2, 3, 4, 5])
        .unwrap();
    file.close().unwrap();
    let mut bytes = std::fs::read(&block).unwrap();
    let start = b"MATLAB 7.3 MAT-file, Platform: GLNXA64";
    bytes[..start.len()].copy_from_slice(start);
    std::fs::write(&block, bytes).unwrap();
    let file = HdfFile::open_untrusted(&block).unwrap();
    assert_eq!(file.find("p").unwrap().unwrap().shape, [2, 3]);
    assert_eq!(file.numbers("p", 0..1).unwrap(), [0.0, 2.0, 4.0]);
}
