//! NumPy's archive of arrays: a zip file with an array in each member, stored or deflated (numpy.savez, numpy.savez_compressed).

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use flate2::CrcReader;
use flate2::read::DeflateDecoder;
use zip::{CompressionMethod, ZipArchive};

use super::error::ImportError;
use super::{DISPLACEMENT, PATTERNS, count};
use deaflow_base::{NpyHeader, open_regular};
use deaflow_pattern::Raster;

/// How many times as long as its place in the file a deflated array can be at the most (RFC 1951: 258 bytes from 2 bits).
const PACKED: u64 = 1032;

/// The longest array in Fortran order, bytes: it is read as a whole, since its rows lie scattered.
const MOST_FORTRAN: u64 = 1 << 30;

/// An archive with both arrays.
pub struct Npz {
    path: PathBuf,
    patterns: Member,
    displacement: Member,
    len: usize,
}

/// An array in the archive.
struct Member {
    name: &'static str,
    place: Place,
    header: NpyHeader,
}

/// Where the bytes of a member begin in the file, how many there are, and how many are packed in them, with what checksum.
struct Place {
    start: u64,
    packed: u64,
    size: u64,
    checksum: u32,
    is_deflated: bool,
}

impl Npz {
    /// Looks at an archive, and compares its arrays with their checksums.
    pub fn open(path: &Path, raster: Raster) -> Result<Self, ImportError> {
        let file = open_regular(path).map_err(unreadable)?;
        let mut archive = ZipArchive::new(BufReader::new(file))
            .map_err(|e| ImportError::Unreadable(format!("not a NumPy archive: {e}")))?;
        let patterns = Member::find(&mut archive, path, PATTERNS)?;
        let displacement = Member::find(&mut archive, path, DISPLACEMENT)?;
        // What is unpacked is bounded by then.
        let len = count(&patterns.header.shape, &displacement.header.shape, raster)?;
        patterns.check(path)?;
        displacement.check(path)?;
        Ok(Self {
            path: path.to_owned(),
            patterns,
            displacement,
            len,
        })
    }

    /// How many rows it has.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The numbers of some rows, of both arrays.
    pub fn numbers(&self, rows: Range<usize>) -> Result<(Vec<f64>, Vec<f64>), ImportError> {
        let cells = self.patterns.numbers(&self.path, rows.clone())?;
        Ok((cells, self.displacement.numbers(&self.path, rows)?))
    }
}

impl Member {
    /// An array whose length is that of its shape.
    fn find(archive: &mut ZipArchive<BufReader<File>>, path: &Path, name: &'static str) -> Result<Self, ImportError> {
        let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
        let place = Place::find(archive, name, bytes)?;
        let elements = |why: String| ImportError::Elements { name, why };
        let header = NpyHeader::read(&mut place.read(path, 0)?).map_err(|e| elements(e.to_string()))?;
        let data = header.data_bytes().and_then(|data| data.checked_add(header.bytes));
        let size = place.size;
        match data {
            Some(data) if data == size => {}
            Some(data) => return Err(elements(format!("its shape takes {data} bytes, and it has {size}"))),
            None => return Err(elements("its shape takes more bytes than can be counted".to_owned())),
        }
        if header.fortran && size > MOST_FORTRAN {
            return Err(elements(format!(
                "it has {size} bytes in Fortran order; write it in C order"
            )));
        }
        Ok(Self { name, place, header })
    }

    /// Refuses other bytes than were written.
    fn check(&self, path: &Path) -> Result<(), ImportError> {
        let mut whole = CrcReader::new(self.place.read(path, 0)?);
        let read = io::copy(&mut whole, &mut io::sink()).map_err(unreadable)?;
        match read == self.place.size && whole.crc().sum() == self.place.checksum {
            true => Ok(()),
            false => Err(ImportError::Elements {
                name: self.name,
                why: "its bytes are not those that were written".to_owned(),
            }),
        }
    }

    fn numbers(&self, path: &Path, rows: Range<usize>) -> Result<Vec<f64>, ImportError> {
        let extents = self.header.shape.iter().skip(1);
        let of_row = extents.product::<u64>() as usize;
        if self.header.fortran {
            return self.scattered(path, rows, of_row);
        }
        let bytes = (of_row * self.header.element.size()) as u64;
        let mut from = self.place.read(path, self.header.bytes + rows.start as u64 * bytes)?;
        let mut read = vec![0; rows.len() * bytes as usize];
        from.read_exact(&mut read).map_err(unreadable)?;
        Ok(self.header.element.values(&read))
    }

    /// Rows of an array whose first index runs fastest.
    fn scattered(&self, path: &Path, rows: Range<usize>, of_row: usize) -> Result<Vec<f64>, ImportError> {
        let mut bytes = Vec::new();
        self.place
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

impl Place {
    /// Where an array is in a file of so many bytes.
    fn find(archive: &mut ZipArchive<BufReader<File>>, name: &'static str, bytes: u64) -> Result<Self, ImportError> {
        let Some(index) = archive.index_for_name(&format!("{name}.npy")) else {
            let there = archive.file_names().map(str::to_owned);
            let there = there.collect();
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
            return Err(elements("it is neither stored nor deflated, but packed in another way"));
        }
        let found = Self {
            start: member
                .data_start()
                .ok_or_else(|| elements("it has no place in the file"))?,
            packed: member.compressed_size(),
            size: member.size(),
            checksum: member.crc32(),
            is_deflated,
        };
        let most = found.packed.saturating_mul(if is_deflated { PACKED } else { 1 });
        if found.start.checked_add(found.packed).is_none_or(|end| end > bytes) || found.size > most {
            let claimed = found.size.max(found.packed);
            return Err(ImportError::Overlong { name, claimed, bytes });
        }
        Ok(found)
    }

    /// The bytes of the member from some place on, and no more than there should be.
    fn read(&self, path: &Path, place: u64) -> Result<Box<dyn Read>, ImportError> {
        let mut file = open_regular(path).map_err(unreadable)?;
        let skipped = if self.is_deflated { 0 } else { place.min(self.packed) };
        file.seek(SeekFrom::Start(self.start + skipped)).map_err(unreadable)?;
        let stored = BufReader::with_capacity(1 << 16, file).take(self.packed - skipped);
        if !self.is_deflated {
            return Ok(Box::new(stored));
        }
        let mut unpacked = DeflateDecoder::new(stored).take(self.size);
        let passed = io::copy(&mut unpacked.by_ref().take(place), &mut io::sink()).map_err(unreadable)?;
        match passed == place {
            true => Ok(Box::new(unpacked)),
            false => Err(unreadable(io::ErrorKind::UnexpectedEof.into())),
        }
    }
}

fn unreadable(error: io::Error) -> ImportError {
    ImportError::Unreadable(error.to_string())
}
