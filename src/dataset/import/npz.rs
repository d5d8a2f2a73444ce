//! Reader of NumPy archives: zip files with one array per member, stored (numpy.savez) or deflated
//! (numpy.savez_compressed).

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use flate2::CrcReader;
use flate2::read::DeflateDecoder;
use zip::{CompressionMethod, ZipArchive};

use super::error::ImportError;
use super::shape::{DISPLACEMENT, PATTERNS, count_rows};
use deaflow_base::{NpyHeader, open_regular};
use deaflow_pattern::Raster;

/// The largest compression ratio of DEFLATE (RFC 1951: 258 bytes from 2 bits).
const MAX_RATIO: u64 = 1032;

/// The largest array in Fortran order, in bytes. Its rows are not contiguous, so it is read completely.
const MAX_FORTRAN: u64 = 1 << 30;

/// A NumPy archive with both arrays.
pub struct Npz {
    path: PathBuf,
    patterns: Member,
    displacement: Member,
    len: usize,
}

/// An array in the archive.
struct Member {
    name: &'static str,
    position: MemberPosition,
    header: NpyHeader,
}

/// Position of a member in the file, its packed and unpacked size, and its checksum.
struct MemberPosition {
    start: u64,
    packed: u64,
    size: u64,
    checksum: u32,
    is_deflated: bool,
}

impl Npz {
    /// Opens an archive and checks the shapes and checksums of its arrays.
    pub fn open(path: &Path, raster: Raster) -> Result<Self, ImportError> {
        let file = open_regular(path).map_err(unreadable)?;
        let mut archive = ZipArchive::new(BufReader::new(file))
            .map_err(|e| ImportError::Unreadable(format!("not a NumPy archive: {e}")))?;
        let patterns = Member::find(&mut archive, path, PATTERNS)?;
        let displacement = Member::find(&mut archive, path, DISPLACEMENT)?;
        // Checking the shapes first limits how much is unpacked.
        let len = count_rows(&patterns.header.shape, &displacement.header.shape, raster)?;
        patterns.check(path)?;
        displacement.check(path)?;
        Ok(Self {
            path: path.to_owned(),
            patterns,
            displacement,
            len,
        })
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Reads a range of rows of both arrays.
    pub fn numbers(&self, rows: Range<usize>) -> Result<(Vec<f64>, Vec<f64>), ImportError> {
        let cells = self.patterns.numbers(&self.path, rows.clone())?;
        Ok((cells, self.displacement.numbers(&self.path, rows)?))
    }
}

impl Member {
    /// Finds an array and checks that its length matches its shape.
    fn find(archive: &mut ZipArchive<BufReader<File>>, path: &Path, name: &'static str) -> Result<Self, ImportError> {
        let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
        let position = MemberPosition::find(archive, name, bytes)?;
        let elements = |why: String| ImportError::Elements { name, why };
        let header = NpyHeader::read(&mut position.read(path, 0)?).map_err(|e| elements(e.to_string()))?;
        let data = header.data_bytes().and_then(|data| data.checked_add(header.bytes));
        let size = position.size;
        match data {
            Some(data) if data == size => {}
            Some(data) => return Err(elements(format!("its shape needs {data} bytes, but it has {size}"))),
            None => return Err(elements("the number of bytes of its shape exceeds 64 bits".to_owned())),
        }
        if header.fortran && size > MAX_FORTRAN {
            return Err(elements(format!(
                "has {size} bytes in Fortran order, at most {MAX_FORTRAN} are allowed; write it in C order"
            )));
        }
        Ok(Self { name, position, header })
    }

    /// Compares the bytes with their checksum.
    fn check(&self, path: &Path) -> Result<(), ImportError> {
        let mut reader = CrcReader::new(self.position.read(path, 0)?);
        let length = io::copy(&mut reader, &mut io::sink()).map_err(unreadable)?;
        match length == self.position.size && reader.crc().sum() == self.position.checksum {
            true => Ok(()),
            false => Err(ImportError::Elements {
                name: self.name,
                why: "checksum does not match: the file is damaged".to_owned(),
            }),
        }
    }

    fn numbers(&self, path: &Path, rows: Range<usize>) -> Result<Vec<f64>, ImportError> {
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
        from.read_exact(&mut read).map_err(unreadable)?;
        Ok(self.header.element.values(&read))
    }

    /// Reads rows of an array in Fortran order, whose first index runs fastest.
    fn fortran_rows(&self, path: &Path, rows: Range<usize>, of_row: usize) -> Result<Vec<f64>, ImportError> {
        let mut bytes = Vec::new();
        self.position
            .read(path, self.header.bytes)?
            .read_to_end(&mut bytes)
            .map_err(unreadable)?;
        let all = self.header.element.values(&bytes);
        let extents: Vec<usize> = self.header.shape.iter().map(|&n| n as usize).collect();
        if all.len() != extents.iter().product::<usize>() {
            return Err(unreadable(io::ErrorKind::UnexpectedEof.into()));
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

impl MemberPosition {
    /// Finds the position of an array in a file of `bytes` bytes.
    fn find(archive: &mut ZipArchive<BufReader<File>>, name: &'static str, bytes: u64) -> Result<Self, ImportError> {
        let Some(index) = archive.index_for_name(&format!("{name}.npy")) else {
            let there = archive.file_names().map(str::to_owned).collect();
            return Err(ImportError::Missing { name, there });
        };
        let elements = |why: &str| ImportError::Elements {
            name,
            why: why.to_owned(),
        };
        let member = archive.by_index_raw(index).map_err(|e| elements(&e.to_string()))?;
        let method = member.compression();
        let is_deflated = method == CompressionMethod::DEFLATE;
        if member.encrypted() || !(is_deflated || method == CompressionMethod::STORE) {
            return Err(elements(
                "compression method is not supported; allowed: stored, deflated, not encrypted",
            ));
        }
        let found = Self {
            start: member
                .data_start()
                .ok_or_else(|| elements("its position in the file is missing"))?,
            packed: member.compressed_size(),
            size: member.size(),
            checksum: member.crc32(),
            is_deflated,
        };
        let most = found.packed.saturating_mul(if is_deflated { MAX_RATIO } else { 1 });
        if found.start.checked_add(found.packed).is_none_or(|end| end > bytes) || found.size > most {
            let claimed = found.size.max(found.packed);
            return Err(ImportError::Overlong { name, claimed, bytes });
        }
        Ok(found)
    }

    /// Opens a reader of the unpacked bytes from `offset` on, limited to the declared size.
    fn read(&self, path: &Path, offset: u64) -> Result<Box<dyn Read>, ImportError> {
        let mut file = open_regular(path).map_err(unreadable)?;
        let skipped = if self.is_deflated { 0 } else { offset.min(self.packed) };
        file.seek(SeekFrom::Start(self.start + skipped)).map_err(unreadable)?;
        let stored = BufReader::with_capacity(1 << 16, file).take(self.packed - skipped);
        if !self.is_deflated {
            return Ok(Box::new(stored));
        }
        let mut unpacked = DeflateDecoder::new(stored).take(self.size);
        let passed = io::copy(&mut unpacked.by_ref().take(offset), &mut io::sink()).map_err(unreadable)?;
        match passed == offset {
            true => Ok(Box::new(unpacked)),
            false => Err(unreadable(io::ErrorKind::UnexpectedEof.into())),
        }
    }
}

fn unreadable(error: io::Error) -> ImportError {
    ImportError::Unreadable(error.to_string())
}
