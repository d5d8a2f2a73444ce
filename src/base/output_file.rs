//! Output files named by the user. They appear complete or not at all, and replace regular files only: a device, a pipe
//! or a folder is an error, and a link is followed to its file, never replaced.

use std::fs::{self, Metadata, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::temporary::temporary_output;

/// A file that cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The path is not a regular file.
    #[error("{path} is {found}; only a regular file can be replaced", path = path.display())]
    Occupied {
        /// The path.
        path: PathBuf,
        /// The kind of file, such as "a device".
        found: &'static str,
    },
    /// The path of a folder is something else.
    #[error("{path} is {found}, not a folder", path = path.display())]
    NotAFolder {
        /// The path.
        path: PathBuf,
        /// The kind of file, such as "a device".
        found: &'static str,
    },
    /// The path is a link to nothing.
    #[error("{path} is a dangling symbolic link; remove it or choose another name", path = path.display())]
    DanglingLink {
        /// The link.
        path: PathBuf,
    },
    /// The folder of the file does not exist.
    #[error("cannot write in {folder}: the folder does not exist", folder = folder.display())]
    NoFolder {
        /// The folder.
        folder: PathBuf,
    },
    /// The system reported an error.
    #[error("cannot write {path}: {source}", path = path.display())]
    Io {
        /// The path.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
}

/// A path at which a file can be written.
#[derive(Clone, Debug)]
pub struct OutputFile {
    given: PathBuf,
    /// The path after all links, with its folder, which is `.` for a bare name.
    target: PathBuf,
}

impl OutputFile {
    /// Checks that a file can be written at a path, without changing anything.
    ///
    /// # Errors
    /// When the path is not a regular file, or its folder does not exist.
    pub fn new(path: &Path) -> Result<Self, OutputError> {
        let name = path.file_name().filter(|_| !names_a_folder(path));
        let Some(name) = name else {
            return match path.is_dir() {
                true => Err(occupied(path, "a folder")),
                false => Err(no_folder(path)),
            };
        };
        let is_link = fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_symlink());
        let target = match fs::metadata(path) {
            Ok(metadata) if !metadata.is_file() => return Err(occupied(path, kind_of(&metadata))),
            Ok(_) if is_link => fs::canonicalize(path).map_err(|_| dangling_link(path))?,
            Err(_) if is_link => return Err(dangling_link(path)),
            Err(error) if !matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Err(failed(path)(error));
            }
            _ => folder_of(path).join(name),
        };
        match folder_of(path).is_dir() {
            true => Ok(Self {
                given: path.to_owned(),
                target,
            }),
            false => Err(no_folder(folder_of(path))),
        }
    }

    /// The folder of the file. A temporary file in it is on the same file system.
    #[must_use]
    pub fn folder(&self) -> &Path {
        folder_of(&self.target)
    }

    /// The path of the file, after all links.
    #[must_use]
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Writes the file, with the permissions of the user's umask.
    ///
    /// # Errors
    /// When the system reports an error; an existing file then remains.
    pub fn write(&self, bytes: &[u8]) -> Result<(), OutputError> {
        let failed = || failed(&self.given);
        let mut file = temporary_output(self.folder()).map_err(failed())?;
        // The error of the file itself does not name the temporary path.
        file.as_file_mut().write_all(bytes).map_err(failed())?;
        // If the disk is full, this fails before the existing file is replaced.
        file.as_file().sync_data().map_err(failed())?;
        self.recheck()?;
        file.persist(&self.target).map_err(|e| failed()(e.error))?;
        Ok(())
    }

    /// Checks again that the path can be replaced; minutes may have passed since [`OutputFile::new`].
    ///
    /// # Errors
    /// As for [`OutputFile::new`].
    pub fn recheck(&self) -> Result<(), OutputError> {
        match fs::symlink_metadata(&self.target) {
            Ok(metadata) if !metadata.is_file() => Err(occupied(&self.given, kind_of(&metadata))),
            _ => Ok(()),
        }
    }
}

/// Writes a file that appears complete or not at all.
///
/// # Errors
/// When the path is not a regular file, its folder does not exist, or the system reports an error.
pub fn write_output(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    OutputFile::new(path)?.write(bytes)
}

/// Creates a folder if it does not exist, and checks that files can be created in it.
///
/// # Errors
/// When the path is not a folder, or the system reports an error.
pub fn output_folder(path: &Path) -> Result<(), OutputError> {
    if let Ok(metadata) = fs::metadata(path)
        && !metadata.is_dir()
    {
        return Err(OutputError::NotAFolder {
            path: path.to_owned(),
            found: kind_of(&metadata),
        });
    }
    if is_dangling_link(path) {
        return Err(dangling_link(path));
    }
    let made = fs::create_dir_all(path).and_then(|()| tempfile::tempfile_in(path));
    made.map(drop).map_err(failed(path))
}

/// Creates an empty file with a random name, which is removed when dropped. It has the permissions of the user's umask.
///
/// # Errors
/// When the system reports an error.
pub fn temporary_file(folder: &Path) -> io::Result<NamedTempFile> {
    tempfile::Builder::new()
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)
}

/// Returns whether a path is a link to nothing, or part of a cycle of links.
#[must_use]
pub fn is_dangling_link(path: &Path) -> bool {
    let is_link = fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_symlink());
    is_link && fs::metadata(path).is_err()
}

/// Returns whether a path ends with a slash or a dot, as only a folder can; the standard library drops these.
fn names_a_folder(path: &Path) -> bool {
    let bytes = path.as_os_str().as_bytes();
    bytes.ends_with(b"/") || bytes.ends_with(b"/.")
}

/// Returns the folder of a path, `.` for a bare name.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Returns the kind of a file in words.
#[must_use]
pub fn kind_of(metadata: &Metadata) -> &'static str {
    let kind = metadata.file_type();
    match () {
        () if kind.is_file() => "a regular file",
        () if kind.is_dir() => "a folder",
        () if kind.is_fifo() => "a pipe",
        () if kind.is_socket() => "a socket",
        () if kind.is_symlink() => "a link",
        () => "a device",
    }
}

fn occupied(path: &Path, found: &'static str) -> OutputError {
    OutputError::Occupied {
        path: path.to_owned(),
        found,
    }
}

fn no_folder(folder: &Path) -> OutputError {
    OutputError::NoFolder {
        folder: folder.to_owned(),
    }
}

fn dangling_link(path: &Path) -> OutputError {
    OutputError::DanglingLink { path: path.to_owned() }
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> OutputError + use<> {
    let path = path.to_owned();
    move |source| OutputError::Io { path, source }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{MetadataExt, symlink};
    use std::os::unix::net::UnixListener;

    use super::*;

    #[test]
    fn only_regular_files_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("folder")).unwrap();
        let _socket = UnixListener::bind(at("socket")).unwrap();
        symlink("/dev/null", at("linked device")).unwrap();
        symlink("nothing", at("dangling")).unwrap();
        symlink("circle", at("circle")).unwrap();
        for (name, said) in [
            ("folder", "is a folder"),
            ("folder/.", "is a folder"),
            ("new/", "does not exist"),
            ("new/.", "does not exist"),
            ("socket", "is a socket"),
            ("linked device", "is a device"),
            ("/dev/null", "is a device"),
            ("dangling", "dangling"),
            ("circle", "dangling"),
            ("none/new", "does not exist"),
            ("socket/new", "does not exist"),
        ] {
            let error = write_output(&at(name), b"text").unwrap_err().to_string();
            assert!(error.contains(said), "{name}: {error}");
        }
        assert_eq!(
            fs::read_dir(folder.path()).unwrap().count(),
            5,
            "nothing is left or lost"
        );
        assert!(!fs::symlink_metadata("/dev/null").unwrap().is_file());
    }

    #[test]
    fn the_file_behind_a_link_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("far")).unwrap();
        fs::write(at("far/file"), "old").unwrap();
        symlink("far/file", at("near")).unwrap();
        symlink("near", at("link")).unwrap();
        let before = fs::metadata(at("far/file")).unwrap().ino();
        write_output(&at("link"), b"new").unwrap();
        assert_eq!(fs::read(at("far/file")).unwrap(), b"new");
        assert_ne!(
            fs::metadata(at("far/file")).unwrap().ino(),
            before,
            "another file, complete at once"
        );
        assert!(fs::symlink_metadata(at("link")).unwrap().is_symlink());
        assert!(fs::symlink_metadata(at("near")).unwrap().is_symlink());
    }

    #[test]
    fn other_files_that_appear_later_are_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let output = OutputFile::new(&path).unwrap();
        symlink("/dev/null", &path).unwrap();
        assert!(matches!(output.write(b"text"), Err(OutputError::Occupied { .. })));
    }

    #[test]
    fn folders_are_created_and_other_files_are_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        output_folder(&at("new/er")).unwrap();
        assert!(at("new/er").is_dir());
        symlink("new", at("link")).unwrap();
        output_folder(&at("link")).unwrap();
        fs::write(at("file"), "").unwrap();
        symlink("nothing", at("dangling")).unwrap();
        assert!(matches!(
            output_folder(&at("file")),
            Err(OutputError::NotAFolder { .. })
        ));
        assert!(matches!(
            output_folder(&at("dangling")),
            Err(OutputError::DanglingLink { .. })
        ));
        assert!(!at("nothing").exists());
    }
}
