//! An open file, in this or in the child process.

use std::collections::BTreeSet;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use hdf5::types::{FixedAscii, FixedUnicode, TypeDescriptor, VarLenAscii, VarLenUnicode};
use hdf5::{Dataset, File, Location};

use super::attributes::{self, utf8};
use super::elements::{Element, Elements};
use super::error::{Failure, system_error};
use super::limits::{CHUNK, ROW};
use super::links;
use super::message::{DatasetInfo, Form};
use super::storage;
use super::tree::{self, Tree};

/// Maximum width of texts of fixed length, bytes.
const WIDTH: usize = 1024;

/// The attribute of a dataset with its unit.
const UNITS: &str = "units";

/// The attributes of a dataset with the factor and the offset of its values.
const PACKING: [&str; 2] = ["scale_factor", "add_offset"];

/// The beginning of the user block of a file that MATLAB saved with `-v7.3`.
const MATLAB_BLOCK: &[u8] = b"MATLAB 7.3 MAT-file";

/// The attribute of a dataset that MATLAB wrote, with the class of its elements.
const MATLAB_CLASS: &str = "MATLAB_class";

/// The attribute of a dataset that stands for an empty array of MATLAB; its elements are the extents.
const MATLAB_EMPTY: &str = "MATLAB_empty";

/// An open HDF5 file.
pub(super) struct OpenFile {
    path: PathBuf,
    file: File,
    /// Whether MATLAB wrote it.
    is_of_matlab: bool,
    /// Datasets that have been checked.
    checked: Mutex<BTreeSet<String>>,
}

impl OpenFile {
    /// Opens a file. The cache holds a chunk, so that one that is read in slices is decompressed once.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        // Reading a pipe or a device could block.
        let file = deaflow_base::open_regular(path).map_err(|e| Failure::unopened(&e))?;
        let mut start = Vec::new();
        file.take(MATLAB_BLOCK.len() as u64)
            .read_to_end(&mut start)
            .map_err(|e| Failure::unopened(&e))?;
        let mut builder = File::with_options();
        // Files of a store never change, and locks may fail or block on network file systems.
        builder.with_fapl(|access| access.file_locking(false).chunk_cache(521, CHUNK as usize, 0.75));
        Ok(Self {
            file: builder
                .open(path)
                .map_err(|e| Failure::Unopened(e.to_string(), system_error(&e)))?,
            path: path.to_owned(),
            is_of_matlab: start == MATLAB_BLOCK,
            checked: Mutex::default(),
        })
    }

    /// Returns the paths of the datasets, up to a maximum; an error if there are only links that lead to other files
    /// or nowhere.
    pub fn names(&self) -> Result<Vec<String>, Failure> {
        links::contents(&self.file)?.named(&self.file)
    }

    /// Returns type and shape of a dataset, if it exists.
    pub fn find(&self, dataset: &str) -> Result<Option<DatasetInfo>, Failure> {
        let Some(found) = storage::find(&self.file, dataset)? else {
            return Ok(None);
        };
        let mut shape: Vec<u64> = found.get_shape()?.iter().map(|&n| n as u64).collect();
        let is_reversed = self.is_reversed(&found)?;
        if is_reversed {
            shape.reverse();
        }
        if has_attribute(&found, MATLAB_EMPTY)? {
            shape = vec![0];
        }
        Ok(Some(DatasetInfo {
            shape,
            element: storage::element(&found)?,
            packing: packing(&found)?,
            is_reversed,
        }))
    }

    /// Whether MATLAB wrote a dataset with several axes. Its `h5write` leaves no mark.
    fn is_reversed(&self, dataset: &Dataset) -> Result<bool, Failure> {
        let has_axes = dataset.get_shape()?.len() > 1;
        Ok(has_axes && (self.is_of_matlab || has_attribute(dataset, MATLAB_CLASS)?))
    }

    /// Reads everything except the elements.
    pub fn tree(&self) -> Result<Tree, Failure> {
        tree::read(&self.path, &self.file)
    }

    /// Returns a text attribute of the file; `None` if it does not exist or is not a text.
    pub fn attribute(&self, name: &str) -> Result<Option<String>, Failure> {
        if self.file.attr_names()?.iter().any(|other| other == name) {
            return Ok(attributes::one(&self.file, name).ok());
        }
        let long = storage::find(&self.file, &format!("{}/{name}", attributes::LONG))?;
        let Some(long) = long else { return Ok(None) };
        storage::check(&self.path, &long)?;
        Ok(storage::whole(&long).and_then(|bytes| utf8(bytes, name)).ok())
    }

    /// Returns the unit of a dataset; `None` if it has none, or it is not a text.
    pub fn units(&self, dataset: &str) -> Result<Option<String>, Failure> {
        let Some(found) = storage::find(&self.file, dataset)? else {
            return Ok(None);
        };
        match has_attribute(&found, UNITS)? {
            true => Ok(attributes::one(&found, UNITS).ok()),
            false => Ok(None),
        }
    }

    /// Reads rows of a dataset.
    pub fn rows(&self, dataset: &str, rows: Range<u64>, form: Form) -> Result<Elements, Failure> {
        let found = storage::find(&self.file, dataset)?;
        let found = found.ok_or_else(|| Failure::Refused(format!("the file has no dataset {dataset:?}")))?;
        self.check(dataset, &found)?;
        let shape = found.get_shape()?;
        let is_reversed = self.is_reversed(&found)?;
        let first = if is_reversed { shape.last() } else { shape.first() };
        let extent = first.map_or(1, |&n| n as u64);
        if rows.start > rows.end || rows.end > extent {
            let why = format!(
                "`{dataset}` has {extent} rows, requested were {} to {}",
                rows.start, rows.end
            );
            return Err(Failure::Refused(why));
        }
        if is_reversed && form != Form::Numbers {
            return Err(Failure::Refused(format!("`{dataset}` is an array of MATLAB")));
        }
        let read = match form {
            Form::Own => own(&found, dataset, rows),
            Form::Numbers => numbers(&found, dataset, rows, is_reversed),
            Form::Texts => texts(&found, dataset, rows),
            Form::Words => words(&found, dataset, rows),
        };
        read.map_err(|why| match why {
            Failure::Library(words, number) => Failure::Library(format!("`{dataset}`: {words}"), number),
            other => other,
        })
    }

    fn check(&self, name: &str, dataset: &Dataset) -> Result<(), Failure> {
        // Names are inserted in one step, so the set is valid even after a panic.
        let mut checked = self.checked.lock().unwrap_or_else(PoisonError::into_inner);
        if !checked.contains(name) {
            storage::check(&self.path, dataset).map_err(|failure| match failure {
                Failure::Refused(why) => Failure::Refused(format!("`{name}`: {why}")),
                other => other,
            })?;
            checked.insert(name.to_owned());
        }
        Ok(())
    }
}

fn own(found: &Dataset, name: &str, rows: Range<u64>) -> Result<Elements, Failure> {
    Ok(match storage::element(found)? {
        Element::U8 => Elements::U8(storage::rows(found, rows)?),
        Element::U32 => Elements::U32(storage::rows(found, rows)?),
        Element::U64 => Elements::U64(storage::rows(found, rows)?),
        Element::F32 => Elements::F32(storage::rows(found, rows)?),
        Element::F64 => Elements::F64(storage::rows(found, rows)?),
        Element::Text(_) => return texts(found, name, rows),
        other => return Err(Failure::Refused(format!("`{name}` has elements of type {other:?}"))),
    })
}

fn numbers(found: &Dataset, name: &str, rows: Range<u64>, is_reversed: bool) -> Result<Elements, Failure> {
    if !storage::element(found)?.is_number() {
        return Err(Failure::Refused(format!("the elements of `{name}` are not numbers")));
    }
    let mut values: Vec<f64> = match is_reversed {
        true => storage::last_rows(found, rows)?,
        false => storage::rows(found, rows)?,
    };
    if let Some([factor, offset]) = packing(found)? {
        values.iter_mut().for_each(|value| *value = factor * *value + offset);
    }
    Ok(Elements::F64(values))
}

/// Returns the factor and the offset of packed values, after the conventions of netCDF.
fn packing(dataset: &Dataset) -> Result<Option<[f64; 2]>, Failure> {
    let mut found = [None; 2];
    for (name, value) in PACKING.into_iter().zip(&mut found) {
        if has_attribute(dataset, name)? {
            // One element, which netCDF writes as an array.
            let values = dataset.attr(name)?.read_raw::<f64>()?;
            let [number] = values[..] else {
                return Err(Failure::Refused(format!(
                    "the attribute `{name}` has {} numbers",
                    values.len()
                )));
            };
            *value = Some(number);
        }
    }
    Ok(match found {
        [None, None] => None,
        [factor, offset] => Some([factor.unwrap_or(1.0), offset.unwrap_or(0.0)]),
    })
}

fn has_attribute(location: &Location, name: &str) -> hdf5::Result<bool> {
    Ok(location.attr_names()?.iter().any(|other| other == name))
}

fn texts(found: &Dataset, name: &str, rows: Range<u64>) -> Result<Elements, Failure> {
    let texts = match found.dtype()?.to_descriptor()? {
        TypeDescriptor::VarLenUnicode => owned(storage::rows::<VarLenUnicode>(found, rows)?, |t| t.as_bytes()),
        TypeDescriptor::VarLenAscii => owned(storage::rows::<VarLenAscii>(found, rows)?, |t| t.as_bytes()),
        TypeDescriptor::FixedUnicode(n) if n <= 64 => {
            owned(storage::rows::<FixedUnicode<64>>(found, rows)?, |t| t.as_bytes())
        }
        TypeDescriptor::FixedUnicode(n) if n <= WIDTH => {
            owned(storage::rows::<FixedUnicode<WIDTH>>(found, rows)?, |t| t.as_bytes())
        }
        TypeDescriptor::FixedAscii(n) if n <= WIDTH => {
            owned(storage::rows::<FixedAscii<WIDTH>>(found, rows)?, |t| t.as_bytes())
        }
        other => {
            return Err(Failure::Refused(format!(
                "`{name}` has elements of type {other}, not texts"
            )));
        }
    };
    Ok(Elements::Text(texts?))
}

fn words(found: &Dataset, name: &str, rows: Range<u64>) -> Result<Elements, Failure> {
    let element = found.dtype()?;
    let described = (element.size() <= 8).then(|| element.to_descriptor()).transpose()?;
    match described {
        Some(TypeDescriptor::Integer(_)) => Ok(decimal(&storage::rows::<i64>(found, rows)?)),
        Some(TypeDescriptor::Unsigned(_)) => Ok(decimal(&storage::rows::<u64>(found, rows)?)),
        _ => texts(found, name, rows),
    }
}

fn decimal<T: ToString>(numbers: &[T]) -> Elements {
    Elements::Text(numbers.iter().map(ToString::to_string).collect())
}

/// Copies texts. Their total length is limited: each may be as long as the file.
fn owned<T>(texts: Vec<T>, bytes: fn(&T) -> &[u8]) -> hdf5::Result<Vec<String>> {
    let length: usize = texts.iter().map(|text| bytes(text).len()).sum();
    if length as u64 > ROW {
        return Err(format!("the texts have {length} bytes, more than allowed").into());
    }
    texts.iter().map(|text| utf8(bytes(text).to_vec(), "text")).collect()
}
