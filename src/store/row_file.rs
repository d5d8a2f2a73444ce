//! Rows of an HDF5 file that need not be ours: read by ranges, so that a file need not fit into memory, and with nothing
//! taken for granted, since whoever looks into a strange file wants to know what is wrong with it.

use std::ops::Range;
use std::path::{Path, PathBuf};

use hdf5::types::{FixedAscii, FixedUnicode, TypeDescriptor, VarLenAscii, VarLenUnicode};
use hdf5::{Dataset, File, Hyperslab, SliceOrIndex};
use ndarray::IxDyn;

use super::error::StoreError;

/// Longest texts of fixed length that are read, bytes.
const WIDTH: usize = 1024;

/// An open HDF5 file.
pub struct RowFile {
    file: File,
    path: PathBuf,
}

impl RowFile {
    /// Opens a file. That of an artifact is not verified here.
    ///
    /// # Errors
    /// When it is no HDF5 file.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        Ok(Self {
            file: File::open(path).map_err(StoreError::hdf5("open", path))?,
            path: path.to_owned(),
        })
    }

    /// The extents of a dataset; `None` where there is none of that path.
    #[must_use]
    pub fn shape(&self, dataset: &str) -> Option<Vec<usize>> {
        self.file.dataset(dataset).ok().map(|found| found.shape())
    }

    /// Some rows of a dataset of numbers, whatever their type.
    ///
    /// # Errors
    /// When there is none of that path, it does not hold numbers, or the rows cannot be read.
    pub fn numbers(&self, dataset: &str, rows: Range<usize>) -> Result<Vec<f64>, StoreError> {
        let read = || -> hdf5::Result<Vec<f64>> {
            let found = self.file.dataset(dataset)?;
            numeric(&found, dataset)?;
            if rows.is_empty() {
                return Ok(Vec::new());
            }
            let slab: Vec<SliceOrIndex> = found
                .shape()
                .iter()
                .enumerate()
                .map(|(axis, &extent)| if axis == 0 { rows.clone() } else { 0..extent }.into())
                .collect();
            let slice = found.read_slice::<f64, _, IxDyn>(Hyperslab::new(slab))?;
            // Read into a fresh array, row by row: its memory is the answer.
            Ok(slice.into_raw_vec_and_offset().0)
        };
        read().map_err(StoreError::hdf5("read", &self.path))
    }

    /// A whole dataset of texts.
    ///
    /// # Errors
    /// When there is none of that path, or it does not hold texts.
    pub fn texts(&self, dataset: &str) -> Result<Vec<String>, StoreError> {
        let read = || -> hdf5::Result<Vec<String>> {
            let found = self.file.dataset(dataset)?;
            match found.dtype()?.to_descriptor()? {
                TypeDescriptor::VarLenUnicode => owned(&found.read_raw::<VarLenUnicode>()?, |t| t.as_bytes()),
                TypeDescriptor::VarLenAscii => owned(&found.read_raw::<VarLenAscii>()?, |t| t.as_bytes()),
                TypeDescriptor::FixedUnicode(n) if n <= WIDTH => {
                    owned(&found.read_raw::<FixedUnicode<WIDTH>>()?, |t| t.as_bytes())
                }
                TypeDescriptor::FixedAscii(n) if n <= WIDTH => {
                    owned(&found.read_raw::<FixedAscii<WIDTH>>()?, |t| t.as_bytes())
                }
                other => Err(format!("`{dataset}` holds {other}, not texts").into()),
            }
        };
        read().map_err(StoreError::hdf5("read", &self.path))
    }

    /// A whole dataset of texts, or of whole numbers, which are given as decimal texts.
    ///
    /// # Errors
    /// When there is none of that path, or it holds neither.
    pub fn words(&self, dataset: &str) -> Result<Vec<String>, StoreError> {
        let read = || -> hdf5::Result<Option<Vec<String>>> {
            let found = self.file.dataset(dataset)?;
            let element = found.dtype()?;
            if element.size() > 8 {
                return Ok(None);
            }
            match element.to_descriptor()? {
                TypeDescriptor::Integer(_) => Ok(Some(decimal(&found.read_raw::<i64>()?))),
                TypeDescriptor::Unsigned(_) => Ok(Some(decimal(&found.read_raw::<u64>()?))),
                _ => Ok(None),
            }
        };
        match read().map_err(StoreError::hdf5("read", &self.path))? {
            Some(words) => Ok(words),
            None => self.texts(dataset),
        }
    }

    /// A text attribute of the file; `None` where there is none of that name, or it is no text.
    #[must_use]
    pub fn attribute(&self, name: &str) -> Option<String> {
        let value: VarLenUnicode = self.file.attr(name).ok()?.read_scalar().ok()?;
        String::from_utf8(value.as_bytes().to_vec()).ok()
    }
}

fn numeric(found: &Dataset, name: &str) -> hdf5::Result<()> {
    let element = found.dtype()?;
    // The size is checked first: the library describes enumerations of wider integers wrongly.
    let described = (element.size() <= 8).then(|| element.to_descriptor()).transpose()?;
    match described {
        Some(
            TypeDescriptor::Integer(_)
            | TypeDescriptor::Unsigned(_)
            | TypeDescriptor::Float(_)
            | TypeDescriptor::Boolean,
        ) => Ok(()),
        _ => Err(format!("`{name}` does not hold numbers").into()),
    }
}

fn decimal<T: ToString>(numbers: &[T]) -> Vec<String> {
    numbers.iter().map(ToString::to_string).collect()
}

/// The library's own conversion takes the bytes on trust.
fn owned<T>(texts: &[T], bytes: fn(&T) -> &[u8]) -> hdf5::Result<Vec<String>> {
    let read = |text| String::from_utf8(bytes(text).to_vec()).map_err(|_| "a text is not UTF-8".into());
    texts.iter().map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Data, Object, Provenance, write_file};

    #[test]
    fn rows_are_read_by_ranges_and_texts_whatever_their_form() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.h5");
        let numbers =
            crate::store::Dataset::new("mm", "d", &[3, 2], Data::F32(vec![1.0, 2.0, 3.0, f32::NAN, 5.0, 6.0]));
        let words = crate::store::Dataset::new("", "d", &[2], Data::Text(vec!["a".into(), "b".into()]));
        let object = Object::default()
            .with("n", numbers)
            .with("t", words)
            .attribute("s", "é");
        write_file(&path, &object, &Provenance::default()).unwrap();
        {
            let file = File::open_rw(&path).unwrap();
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
        assert_eq!((file.shape("n"), file.shape("none")), (Some(vec![3, 2]), None));
        assert_eq!((file.attribute("s"), file.attribute("none")), (Some("é".into()), None));
        assert!(file.texts("n").is_err() && file.numbers("t", 0..1).is_err() && file.numbers("n", 2..9).is_err());
        assert!(RowFile::open(&folder.path().join("gone.h5")).is_err());
    }
}
