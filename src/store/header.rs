//! The header of every artifact file: which artifact it is, its length, and a digest of every byte.
//!
//! It is in the HDF5 *user block* (HDF5 File Format Specification 3.0, §II.A: bytes before the superblock belong to the
//! user), so every HDF5 tool still reads the file. A file is opened with the HDF5 library only after its header has
//! been verified, because the library is not robust against damaged files.

use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::Path;

use super::error::StoreError;
use deaflow_base::{ArtifactId, Digest, FileDigest, open_regular};

/// Length of the user block in bytes: the minimum in HDF5.
pub const BLOCK: usize = 512;

/// Bytes that are copied at a time.
const PIECE: usize = 1 << 20;

const TITLE: &str = "deaflow-artifact 1";

/// The header of an artifact file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The artifact: the digest of the logical content.
    pub content: ArtifactId,
    /// BLAKE3 digest of all bytes after the user block.
    pub file: FileDigest,
    /// Length of the file in bytes, user block included.
    pub size: u64,
}

impl Header {
    fn block(&self) -> [u8; BLOCK] {
        let text = format!("{TITLE}\n{}\n{}\n{}\n", self.content, self.file, self.size);
        let mut block = [0; BLOCK];
        block[..text.len()].copy_from_slice(text.as_bytes());
        block
    }

    fn parse(block: &[u8; BLOCK]) -> Option<Self> {
        let text = std::str::from_utf8(block).ok()?;
        let mut lines = text.lines();
        (lines.next()? == TITLE).then_some(())?;
        let header = Self {
            content: lines.next()?.parse().ok()?,
            file: lines.next()?.parse().ok()?,
            size: lines.next()?.parse().ok()?,
        };
        // Compares every byte, including the padding.
        (header.block() == *block).then_some(header)
    }

    /// Writes the header of a finished HDF5 file and syncs the file.
    pub fn write(path: &Path, content: ArtifactId) -> Result<Self, StoreError> {
        let refused = |error| StoreError::io("write the header of", path)(error);
        let mut file = File::options().read(true).write(true).open(path).map_err(refused)?;
        let (digest, rest) = digest_rest(&mut file).map_err(refused)?;
        let header = Self {
            content,
            file: digest,
            size: BLOCK as u64 + rest,
        };
        file.seek(SeekFrom::Start(0)).map_err(refused)?;
        file.write_all(&header.block()).map_err(refused)?;
        file.sync_data().map_err(refused)?;
        Ok(header)
    }

    /// Reads the header and compares the length of the file, but not its bytes.
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        Self::read_open(path, &mut open(path)?)
    }

    /// Reads the header and verifies the digest of the file.
    pub fn verify(path: &Path) -> Result<Self, StoreError> {
        let mut file = open(path)?;
        let header = Self::read_open(path, &mut file)?;
        let (digest, _) = digest_rest(&mut file).map_err(StoreError::io("read", path))?;
        if digest == header.file {
            Ok(header)
        } else {
            Err(altered(path))
        }
    }

    /// Copies the file of an artifact, verifies the digest, and syncs the copy.
    ///
    /// # Errors
    /// If the file is damaged (the copy must not be used then), or the system reports an error.
    pub fn copy(from: &Path, to: &Path) -> Result<Self, StoreError> {
        let refused = |error| StoreError::io("write", to)(error);
        let mut source = open(from)?;
        let header = Self::read_open(from, &mut source)?;
        let mut copy = File::create(to).map_err(refused)?;
        copy.write_all(&header.block()).map_err(refused)?;
        let mut hasher = blake3::Hasher::new();
        let mut buffer = vec![0; PIECE];
        loop {
            let length = source.read(&mut buffer).map_err(StoreError::io("read", from))?;
            if length == 0 {
                break;
            }
            hasher.update(&buffer[..length]);
            copy.write_all(&buffer[..length]).map_err(refused)?;
        }
        let digest = FileDigest::from(Digest::from_bytes(*hasher.finalize().as_bytes()));
        if digest != header.file {
            return Err(altered(from));
        }
        copy.sync_data().map_err(refused)?;
        Ok(header)
    }

    fn read_open(path: &Path, file: &mut File) -> Result<Self, StoreError> {
        let size = file.metadata().map_err(StoreError::io("read", path))?.len();
        if size < BLOCK as u64 {
            return Err(StoreError::damaged(
                path,
                format!("{size} bytes are too short for an artifact"),
            ));
        }
        let mut block = [0; BLOCK];
        file.read_exact(&mut block).map_err(StoreError::io("read", path))?;
        let header = Self::parse(&block).ok_or_else(|| StoreError::damaged(path, "its header cannot be read"))?;
        if header.size == size {
            Ok(header)
        } else {
            Err(StoreError::damaged(
                path,
                format!("it has {size} bytes, but {} were written", header.size),
            ))
        }
    }
}

impl Header {
    /// Whether a file starts like an artifact; the rest may be damaged.
    pub fn is_at(path: &Path) -> bool {
        let mut begin = [0; TITLE.len()];
        let read = open_regular(path).and_then(|mut file| file.read_exact(&mut begin));
        read.is_ok() && begin == *TITLE.as_bytes()
    }
}

fn altered(path: &Path) -> StoreError {
    StoreError::damaged(path, "its bytes have changed")
}

fn open(path: &Path) -> Result<File, StoreError> {
    open_regular(path).map_err(|error| match error.kind() {
        ErrorKind::InvalidInput => StoreError::damaged(path, "it is not a file"),
        _ => StoreError::io("open", path)(error),
    })
}

/// Returns digest and number of the bytes after the user block.
fn digest_rest(file: &mut File) -> std::io::Result<(FileDigest, u64)> {
    file.seek(SeekFrom::Start(BLOCK as u64))?;
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(file)?;
    let digest = Digest::from_bytes(*hasher.finalize().as_bytes());
    Ok((digest.into(), hasher.count()))
}
