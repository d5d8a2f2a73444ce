//! A file with arrays.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::archive;
use super::array::{Array, Source};
use super::error::ArrayError;
use super::format::Format;
use super::numpy::Member;
use deaflow_base::open_regular;
use deaflow_hdf::HdfFile;

/// Formats that have an extension of HDF5 but are not: first bytes, name, and what to do.
const NOT_HDF5: [(&[u8], &str, &str); 2] = [
    (
        b"MATLAB 5.0 MAT-file",
        "a MATLAB file of version 7 or older",
        "save it in MATLAB with save('FILE.mat', 'p', '-v7.3')",
    ),
    (
        b"CDF",
        "a netCDF file of the classic format",
        "convert it with nccopy -k nc4 OLD.nc NEW.nc",
    ),
];

/// A file with arrays.
pub struct ArrayFile {
    path: PathBuf,
    content: Content,
}

enum Content {
    Npy,
    Npz,
    Hdf5(HdfFile),
}

impl ArrayFile {
    /// Opens a file of a format.
    ///
    /// # Errors
    /// When it cannot be read, or has another format.
    pub fn open(path: &Path, format: Format) -> Result<Self, ArrayError> {
        let content = match format {
            Format::Npy => Content::Npy,
            Format::Npz => Content::Npz,
            Format::Hdf5 => {
                refuse_others(open_regular(path)?)?;
                Content::Hdf5(HdfFile::open_untrusted(path)?)
            }
        };
        let path = path.to_owned();
        Ok(Self { path, content })
    }

    /// Returns the HDF5 file, for its attributes.
    #[must_use]
    pub fn hdf5(&self) -> Option<&HdfFile> {
        match &self.content {
            Content::Hdf5(file) => Some(file),
            Content::Npy | Content::Npz => None,
        }
    }

    /// Returns the names of the arrays; that of the only array of a `.npy` file is empty.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn names(&self) -> Result<Vec<String>, ArrayError> {
        match &self.content {
            Content::Npy => Ok(vec![String::new()]),
            Content::Npz => archive::names(&self.path),
            Content::Hdf5(file) => Ok(file.names()?),
        }
    }

    /// Returns an array by its name, which may begin with a slash.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn find(&self, name: &str) -> Result<Option<Array>, ArrayError> {
        let plain = name.trim_start_matches('/');
        let source = match &self.content {
            Content::Npy => Some(Source::Numpy(Member::of_file(&self.path)?)),
            Content::Npz => archive::find(&self.path, plain)?.map(Source::Numpy),
            Content::Hdf5(file) => file.find(name)?.map(Source::Hdf5),
        };
        Ok(source.map(|source| Array {
            path: self.path.clone(),
            name: plain.to_owned(),
            source,
        }))
    }

    /// Returns the only array that `fits`. Without one, or with several, lists all arrays.
    ///
    /// # Errors
    /// When an array cannot be read.
    pub fn only(&self, fits: impl Fn(&[u64]) -> bool) -> Result<Result<Array, Vec<String>>, ArrayError> {
        let names = self.names()?;
        let mut fitting = Vec::new();
        for name in &names {
            // Others, such as texts and notes of the writing program, do not matter.
            if let Ok(Some(array)) = self.find(name)
                && fits(array.shape())
            {
                fitting.push(array);
            }
        }
        match <[Array; 1]>::try_from(fitting) {
            Ok([array]) => Ok(Ok(array)),
            Err(_) => Ok(Err(names)),
        }
    }
}

fn refuse_others(file: File) -> Result<(), ArrayError> {
    let mut start = Vec::new();
    file.take(32).read_to_end(&mut start)?;
    match NOT_HDF5.iter().find(|(first, ..)| start.starts_with(first)) {
        Some((_, what, help)) => Err(ArrayError::new(*what, *help)),
        None => Ok(()),
    }
}
