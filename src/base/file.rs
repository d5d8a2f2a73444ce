//! Opens untrusted files safely.
//!
//! Opening a pipe blocks, a device may never end, and a file may be larger than memory. All are rejected before a byte
//! is read.

use std::fs::{self, File, Metadata};
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Opens a regular file for reading; links are followed.
///
/// # Errors
/// When the system reports an error, or it is a folder, a pipe or a device ([`ErrorKind::InvalidInput`]).
pub fn open_regular(path: &Path) -> Result<File> {
    // The check comes first, since opening a pipe waits for its writer.
    if fs::metadata(path)?.is_file() {
        File::open(path)
    } else {
        Err(Error::new(ErrorKind::InvalidInput, "it is not a regular file"))
    }
}

/// Returns the metadata of a file that this program wrote, without following links. If its parent is not a folder, the
/// error is [`ErrorKind::NotFound`].
///
/// # Errors
/// When the system reports an error.
pub fn own_metadata(path: &Path) -> Result<Metadata> {
    fs::symlink_metadata(path).map_err(|error| match path.parent().map(fs::symlink_metadata) {
        Some(Ok(folder)) if !folder.is_dir() => ErrorKind::NotFound.into(),
        _ => error,
    })
}

/// Opens a file that this program wrote. The program creates no links, so a link in its place is not followed.
///
/// # Errors
/// As for [`own_metadata`], or when it is not a regular file ([`ErrorKind::InvalidInput`]).
pub fn open_own(path: &Path) -> Result<File> {
    if own_metadata(path)?.is_symlink() {
        Err(Error::new(ErrorKind::InvalidInput, "it is a link"))
    } else {
        open_regular(path)
    }
}

/// Reads a file of at most `limit` bytes.
///
/// # Errors
/// As for [`open_regular`], or when there are more bytes ([`ErrorKind::FileTooLarge`]) or they do not fit into memory
/// ([`ErrorKind::OutOfMemory`]).
pub fn read_bounded(path: &Path, limit: u64) -> Result<Vec<u8>> {
    read_all(open_regular(path)?, limit)
}

/// Reads a file that this program wrote, of at most `limit` bytes.
///
/// # Errors
/// As for [`open_own`] and [`read_bounded`].
pub fn read_own(path: &Path, limit: u64) -> Result<Vec<u8>> {
    read_all(open_own(path)?, limit)
}

fn read_all(file: File, limit: u64) -> Result<Vec<u8>> {
    let size = file.metadata()?.len();
    let too_large = |size: u64| {
        Error::new(
            ErrorKind::FileTooLarge,
            format!("the file has {size} bytes; at most {limit} are allowed"),
        )
    };
    if size > limit {
        return Err(too_large(size));
    }
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(size as usize)
        .map_err(|error| Error::new(ErrorKind::OutOfMemory, error))?;
    // Some files, such as those in /proc, are larger than their metadata claim.
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
    fn links_are_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "12345").unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        assert_eq!(read_own(&file, 5).unwrap(), b"12345");
        assert_eq!(read_own(&link, 5).unwrap_err().kind(), ErrorKind::InvalidInput);
        assert_eq!(read_bounded(&link, 5).unwrap(), b"12345");
        for in_its_place in [&file, &folder.path().join("circle")] {
            let _ = std::os::unix::fs::symlink("circle", in_its_place);
            let error = read_own(&in_its_place.join("file"), 5).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::NotFound, "{}", in_its_place.display());
        }
    }

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
