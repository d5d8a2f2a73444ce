//! NumPy arrays in files and archives.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;

use flate2::CrcReader;
use flate2::read::DeflateDecoder;

use super::error::ArrayError;
use deaflow_base::{NpyHeader, open_regular};

/// The largest array in Fortran order, in bytes. Its rows are not contiguous, so it is read completely.
const MAX_FORTRAN: u64 = 1 << 30;

/// An array with its place in a file.
pub(super) struct Member {
    /// Its name; empty for the only array of a file.
    pub name: String,
    pub position: Position,
    pub header: NpyHeader,
}

/// Position of an array in a file, its packed and unpacked size, and its checksum if it has one.
pub(super) struct Position {
    pub start: u64,
    pub packed: u64,
    pub size: u64,
    pub checksum: Option<u32>,
    pub is_deflated: bool,
}

impl Member {
    /// Reads the header of the only array of a file.
    pub fn of_file(path: &Path) -> Result<Self, ArrayError> {
        let size = open_regular(path)?.metadata()?.len();
        let position = Position {
            start: 0,
            packed: size,
            size,
            checksum: None,
            is_deflated: false,
        };
        Self::read(path, "", position)
    }

    /// Reads the header at a position.
    pub fn read(path: &Path, name: &str, position: Position) -> Result<Self, ArrayError> {
        let header = NpyHeader::read(&mut position.read(path, 0)?).map_err(|e| ArrayError::from(e).of(name))?;
        let name = name.to_owned();
        Ok(Self { name, position, header })
    }

    /// Compares the number of bytes with the shape, and the bytes with their checksum.
    pub fn check(&self, path: &Path) -> Result<(), ArrayError> {
        let damaged = |why: String| Err(ArrayError::damaged(why).of(&self.name));
        let (size, header) = (self.position.size, &self.header);
        let data = header.data_bytes().and_then(|data| data.checked_add(header.bytes));
        match data {
            Some(data) if data == size => {}
            Some(data) => {
                let needed = data - header.bytes;
                let found = size.saturating_sub(header.bytes);
                return damaged(format!("its shape needs {needed} bytes of data, but it has {found}"));
            }
            None => return damaged("the number of bytes of its shape exceeds 64 bits".to_owned()),
        }
        if header.fortran && size > MAX_FORTRAN {
            let why = format!("has {size} bytes in Fortran order, at most {MAX_FORTRAN} are allowed");
            return Err(ArrayError::new(why, "write it in C order").of(&self.name));
        }
        let Some(checksum) = self.position.checksum else {
            return Ok(());
        };
        let mut reader = CrcReader::new(self.position.read(path, 0)?);
        let length = io::copy(&mut reader, &mut io::sink())?;
        match length == size && reader.crc().sum() == checksum {
            true => Ok(()),
            false => damaged("checksum does not match: the file is damaged".to_owned()),
        }
    }

    /// Reads rows along the first axis, in C order.
    pub fn rows(&self, path: &Path, rows: Range<usize>) -> Result<Vec<f64>, ArrayError> {
        let extents = self.header.shape.iter().skip(1);
        let of_row = extents.product::<u64>() as usize;
        if self.header.fortran {
            return self.fortran_rows(path, rows, of_row);
        }
        let bytes = (of_row * self.header.element.size()) as u64;
        let mut from = self
            .position
            .read(path, self.header.bytes + rows.start as u64 * bytes)?;
        let mut read = vec![0; rows.len() * bytes as usize];
        from.read_exact(&mut read)?;
        Ok(self.header.element.values(&read))
    }

    /// Reads rows of an array in Fortran order, whose first index runs fastest.
    fn fortran_rows(&self, path: &Path, rows: Range<usize>, of_row: usize) -> Result<Vec<f64>, ArrayError> {
        let mut bytes = Vec::new();
        self.position.read(path, self.header.bytes)?.read_to_end(&mut bytes)?;
        let all = self.header.element.values(&bytes);
        let extents: Vec<usize> = self.header.shape.iter().map(|&n| n as usize).collect();
        if all.len() != extents.iter().product::<usize>() {
            return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
        }
        let place = |row: usize, mut rest: usize| {
            let (mut place, mut stride) = (row, extents[0]);
            let mut indices = vec![0; extents.len()];
            for axis in (1..extents.len()).rev() {
                indices[axis] = rest % extents[axis];
                rest /= extents[axis];
            }
            for axis in 1..extents.len() {
                place += indices[axis] * stride;
                stride *= extents[axis];
            }
            place
        };
        let within: Vec<usize> = (0..of_row).map(|rest| place(0, rest)).collect();
        Ok(rows
            .flat_map(|row| within.iter().map(move |at| row + at))
            .map(|at| all[at])
            .collect())
    }
}

impl Position {
    /// Opens a reader of the unpacked bytes from `offset` on, limited to the declared size.
    pub fn read(&self, path: &Path, offset: u64) -> Result<Box<dyn Read>, ArrayError> {
        let mut file: File = open_regular(path)?;
        let skipped = if self.is_deflated { 0 } else { offset.min(self.packed) };
        file.seek(SeekFrom::Start(self.start + skipped))?;
        let stored = BufReader::with_capacity(1 << 16, file).take(self.packed - skipped);
        if !self.is_deflated {
            return Ok(Box::new(stored));
        }
        let mut unpacked = DeflateDecoder::new(stored).take(self.size);
        let passed = io::copy(&mut unpacked.by_ref().take(offset), &mut io::sink())?;
        match passed == offset {
            true => Ok(Box::new(unpacked)),
            false => Err(io::Error::from(io::ErrorKind::UnexpectedEof).into()),
        }
    }
}
