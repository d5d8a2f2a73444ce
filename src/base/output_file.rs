//! Files that somebody asked for by name. They appear complete or not at all, and they replace regular files only: a device, a
//! pipe or a folder that stands in the way is refused, and a link is followed to its file, never replaced.

use std::fs::{self, Metadata, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// A file that cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// Something that is no regular file is there.
    #[error("{path} is {found}; only a regular file can be replaced", path = path.display())]
    Occupied {
        /// The path as it was given.
        path: PathBuf,
        /// What is there ("a device").
        found: &'static str,
    },
    /// A link that leads to no file.
    #[error("{path} is a dangling symbolic link; remove it or choose another name", path = path.display())]
    LeadsNowhere {
        /// The link.
        path: PathBuf,
    },
    /// The folder of the file is not there.
    #[error("cannot write in {folder}: the folder does not exist", folder = folder.display())]
    NoFolder {
        /// The folder.
        folder: PathBuf,
    },
    /// The system refused.
    #[error("cannot write {path}: {source}", path = path.display())]
    Io {
        /// The path as it was given.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// A place where a file may be written.
#[derive(Clone, Debug)]
pub struct OutputFile {
    given: PathBuf,
    /// Where links end; its folder is named even where that is the one at hand.
    target: PathBuf,
}

impl OutputFile {
    /// Looks at what is there, and touches nothing.
    ///
    /// # Errors
    /// When something is there that is not to be replaced, or the folder does not exist.
    pub fn at(path: &Path) -> Result<Self, OutputError> {
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
            Ok(_) if is_link => fs::canonicalize(path).map_err(|_| leads_nowhere(path))?,
            Err(_) if is_link => return Err(leads_nowhere(path)),
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

    /// The folder in which the file will be: what is written aside there crosses no file system.
    #[must_use]
    pub fn folder(&self) -> &Path {
        folder_of(&self.target)
    }

    /// Where the file will be.
    #[must_use]
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Writes all of it. Who may read it is for the user's mask to say.
    ///
    /// # Errors
    /// When the system refuses; what was there stays then.
    pub fn write(&self, bytes: &[u8]) -> Result<(), OutputError> {
        let failed = || failed(&self.given);
        let mut file = aside(self.folder()).map_err(failed())?;
        file.write_all(bytes).map_err(failed())?;
        // A disk that turns out to be full later must not have cost what was there.
        file.as_file().sync_data().map_err(failed())?;
        self.look_again()?;
        file.persist(&self.target).map_err(|e| failed()(e.error))?;
        Ok(())
    }

    /// Whether what is there may still be replaced: minutes may have passed since it was looked at.
    ///
    /// # Errors
    /// As [`OutputFile::at`].
    pub fn look_again(&self) -> Result<(), OutputError> {
        match fs::symlink_metadata(&self.target) {
            Ok(metadata) if !metadata.is_file() => Err(occupied(&self.given, kind_of(&metadata))),
            _ => Ok(()),
        }
    }
}

/// Writes a file that appears complete or not at all.
///
/// # Errors
/// When something is there that is not to be replaced, the folder does not exist, or the system refuses.
pub fn write_output(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    OutputFile::at(path)?.write(bytes)
}

/// Whether files can be made in a folder, which is made where there is none: permissions alone do not tell.
///
/// # Errors
/// When something else is there, or the system refuses.
pub fn output_folder(path: &Path) -> Result<(), OutputError> {
    if let Ok(metadata) = fs::metadata(path)
        && !metadata.is_dir()
    {
        return Err(occupied(path, kind_of(&metadata)));
    }
    if leads_nowhere_at(path) {
        return Err(leads_nowhere(path));
    }
    let made = fs::create_dir_all(path).and_then(|()| tempfile::tempfile_in(path));
    made.map(drop).map_err(failed(path))
}

/// An empty file with a random name, removed when dropped. Who may read it is for the user's mask to say, as with any other
/// file.
///
/// # Errors
/// When the system refuses.
pub fn aside(folder: &Path) -> io::Result<NamedTempFile> {
    tempfile::Builder::new()
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)
}

/// Whether a path is a link to nothing, or one of a circle of links.
#[must_use]
pub fn leads_nowhere_at(path: &Path) -> bool {
    let is_link = fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_symlink());
    is_link && fs::metadata(path).is_err()
}

/// The standard library drops a slash or a dot at the end, which only a folder can have.
fn names_a_folder(path: &Path) -> bool {
    let bytes = path.as_os_str().as_bytes();
    bytes.ends_with(b"/") || bytes.ends_with(b"/.")
}

/// The folder that a path is in; that of a bare name is the present one.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// What something is, in words.
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

fn leads_nowhere(path: &Path) -> OutputError {
    OutputError::LeadsNowhere { path: path.to_owned() }
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
    fn a_link_is_followed_and_its_file_is_replaced_beside_it() {
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
    fn what_comes_in_the_way_later_is_not_replaced_either() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let output = OutputFile::at(&path).unwrap();
        symlink("/dev/null", &path).unwrap();
        assert!(matches!(output.write(b"text"), Err(OutputError::Occupied { .. })));
    }

    #[test]
    fn folders_are_made_and_other_things_are_not_taken_for_them() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        output_folder(&at("new/er")).unwrap();
        assert!(at("new/er").is_dir());
        symlink("new", at("link")).unwrap();
        output_folder(&at("link")).unwrap();
        fs::write(at("file"), "").unwrap();
        symlink("nothing", at("dangling")).unwrap();
        assert!(matches!(output_folder(&at("file")), Err(OutputError::Occupied { .. })));
        assert!(matches!(
            output_folder(&at("dangling")),
            Err(OutputError::LeadsNowhere { .. })
        ));
        assert!(!at("nothing").exists());
    }
}
