//! Rows of an HDF5 file that need not be ours: read by ranges, so that a file need not fit into memory, and with
//! nothing taken for granted, since whoever looks into a strange file wants to know what is wrong with it.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::error::StoreError;
use super::object::Data;
use super::read::Access;
use deaflow_hdf::{HdfError, HdfFile};

/// An open HDF5 file.
pub struct RowFile {
    file: HdfFile,
    access: Access,
    path: PathBuf,
}

impl RowFile {
    /// Opens an untrusted file, which another process reads.
    ///
    /// # Errors
    /// If it is not an HDF5 file.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        Self::of(Access::Apart, path)
    }

    /// Opens a file with the given access.
    pub(super) fn of(access: Access, path: &Path) -> Result<Self, StoreError> {
        Ok(Self {
            file: access.open(path)?,
            access,
            path: path.to_owned(),
        })
    }

    fn failed(&self) -> impl Fn(HdfError) -> StoreError {
        |error| self.access.error("read", &self.path, error)
    }

    /// Returns the extents of a dataset, if it exists.
    ///
    /// # Errors
    /// If it is behind a link, or cannot be read.
    pub fn shape(&self, dataset: &str) -> Result<Option<Vec<usize>>, StoreError> {
        let found = self.file.find(dataset).map_err(self.failed())?;
        Ok(found.map(|found| found.shape.iter().map(|&n| n as usize).collect()))
    }

    /// Reads rows of a dataset, which must have a type of artifacts.
    ///
    /// # Errors
    /// If it does not exist, or the rows cannot be read.
    pub fn elements(&self, dataset: &str, rows: Range<usize>) -> Result<Data, StoreError> {
        self.file.rows(dataset, rows).map_err(self.failed())
    }

    /// Reads rows of numbers of any type.
    ///
    /// # Errors
    /// If it does not exist, does not contain numbers, or the rows cannot be read.
    pub fn numbers(&self, dataset: &str, rows: Range<usize>) -> Result<Vec<f64>, StoreError> {
        self.file.numbers(dataset, rows).map_err(self.failed())
    }

    /// Reads a dataset of texts.
    ///
    /// # Errors
    /// If it does not exist, or does not contain texts.
    pub fn texts(&self, dataset: &str) -> Result<Vec<String>, StoreError> {
        self.file.texts(dataset).map_err(self.failed())
    }

    /// Reads a dataset of texts, or of integers as decimal texts.
    ///
    /// # Errors
    /// If it does not exist, or contains neither.
    pub fn words(&self, dataset: &str) -> Result<Vec<String>, StoreError> {
        self.file.words(dataset).map_err(self.failed())
    }

    /// Returns a text attribute of the file; `None` if it does not exist or is not a text.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn attribute(&self, name: &str) -> Result<Option<String>, StoreError> {
        self.file.attribute(name).map_err(self.failed())
    }
}

#[cfg(test)]
mod tests {
    use hdf5::types::{FixedAscii, VarLenUnicode};

    use super::*;
    use crate::{Object, Provenance, write_file};

    #[test]
    fn rows_are_read_by_ranges_and_texts_whatever_their_form() {
        deaflow_hdf::read_by_test();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.h5");
        let numbers = crate::Dataset::new("mm", "d", &[3, 2], Data::F32(vec![1.0, 2.0, 3.0, f32::NAN, 5.0, 6.0]));
        let words = crate::Dataset::new("", "d", &[2], Data::Text(vec!["a".into(), "b".into()]));
        let object = Object::default()
            .with("n", numbers)
            .with("t", words)
            .attribute("s", "é");
        write_file(&path, &object, &Provenance::default()).unwrap();
        {
            let file = hdf5::File::open_rw(&path).unwrap();
            let texts: Vec<VarLenUnicode> = ["x", "yy"].map(|t| t.parse().unwrap()).to_vec();
            let variable = file.new_dataset::<VarLenUnicode>().shape([2]).create("v").unwrap();
            variable.write_raw(&texts).unwrap();
            let ascii = [FixedAscii::<4>::from_ascii("four").unwrap()];
            file.new_dataset::<FixedAscii<4>>()
                .shape([1])
                .create("a")
                .unwrap()
                .write_raw(&ascii)
                .unwrap();
            file.new_dataset::<i16>()
                .shape([2])
                .create("i")
                .unwrap()
                .write_raw(&[-3_i16, 4])
                .unwrap();
        }
        let file = RowFile::open(&path).unwrap();
        let rows = file.numbers("n", 1..3).unwrap();
        assert!(rows[0] == 3.0 && rows[1].is_nan() && rows[2..] == [5.0, 6.0]);
        assert_eq!(file.numbers("n", 2..2).unwrap(), Vec::<f64>::new());
        assert_eq!(
            (file.texts("t").unwrap(), file.texts("v").unwrap()),
            (vec!["a".into(), "b".into()], vec!["x".into(), "yy".into()])
        );
        assert_eq!(file.texts("a").unwrap(), ["four"]);
        assert_eq!(
            (file.words("i").unwrap(), file.words("v").unwrap()),
            (vec!["-3".into(), "4".into()], vec!["x".into(), "yy".into()])
        );
        assert!(file.words("n").is_err() && file.texts("i").is_err());
        assert_eq!(file.shape("n").unwrap(), Some(vec![3, 2]));
        assert_eq!(file.shape("none").unwrap(), None);
        assert_eq!(file.attribute("s").unwrap().as_deref(), Some("é"));
        assert_eq!(file.attribute("none").unwrap(), None);
        assert!(file.texts("n").is_err() && file.numbers("t", 0..1).is_err() && file.numbers("n", 2..9).is_err());
        assert!(RowFile::open(&folder.path().join("gone.h5")).is_err());
    }
}
