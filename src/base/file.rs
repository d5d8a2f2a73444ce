//! Opening files that were named by somebody else, or that stand where anybody may have put something else.
//!
//! A pipe blocks whoever opens it, a device may never end, and a file may be larger than memory. All of them are refused
//! before a byte is read.

use std::fs::{self, File};
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Opens a file for reading. Links are followed; what they lead to must be a file too.
///
/// # Errors
/// When the system refuses, or it is a folder, a pipe or a device ([`ErrorKind::InvalidInput`]).
pub fn open_regular(path: &Path) -> Result<File> {
    // Looked at before it is opened: opening a pipe waits for its writer.
    if fs::metadata(path)?.is_file() {
        File::open(path)
    } else {
        Err(Error::new(ErrorKind::InvalidInput, "it is not a regular file"))
    }
}

/// All bytes of a file, of which there may be at most `limit`.
///
/// # Errors
/// As [`open_regular`], or when there are more ([`ErrorKind::FileTooLarge`]).
pub fn read_bounded(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let file = open_regular(path)?;
    let size = file.metadata()?.len();
    let too_large = |size: u64| {
        Error::new(
            ErrorKind::FileTooLarge,
            format!("{size} bytes; at most {limit} are read"),
        )
    };
    if size > limit {
        return Err(too_large(size));
    }
    let mut bytes = Vec::with_capacity(size as usize);
    // Some files (those of /proc) hold more than they say.
    file.take(limit + 1).read_to_end(&mut bytes)?;
    match bytes.len() as u64 {
        length if length > limit => Err(too_large(length)),
        _ => Ok(bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_are_read_and_only_up_to_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        fs::write(&path, "12345").unwrap();
        assert_eq!(read_bounded(&path, 5).unwrap(), b"12345");
        assert_eq!(read_bounded(&path, 4).unwrap_err().kind(), ErrorKind::FileTooLarge);
        for other in [folder.path(), Path::new("/dev/zero")] {
            assert_eq!(open_regular(other).unwrap_err().kind(), ErrorKind::InvalidInput);
        }
        assert_eq!(
            open_regular(&folder.path().join("none")).unwrap_err().kind(),
            ErrorKind::NotFound
        );
    }
}
