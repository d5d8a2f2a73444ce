//! Restricts the files that a document can name to its folder.
//!
//! A pipeline from somebody else must not read files outside its folder.

use std::path::{Path, PathBuf};

/// A path that is not a file in the folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfinedError {
    /// The file does not exist.
    #[error("it does not exist")]
    Missing,
    /// The file is outside the folder.
    #[error("it is outside the folder of the pipeline")]
    Outside,
}

impl ConfinedError {
    /// Returns advice.
    #[must_use]
    pub fn help(self) -> &'static str {
        match self {
            Self::Missing => "the path is relative to the file that names it",
            Self::Outside => "put it in the folder of that file or below, without links to the outside",
        }
    }
}

/// Returns the path of a file after all links, if it is in the folder or below.
///
/// # Errors
/// When it does not exist, its path is absolute, or a link or `..` leads outside.
pub fn confined(folder: &Path, named: &Path) -> Result<PathBuf, ConfinedError> {
    let found = folder.join(named).canonicalize();
    let (Ok(within), Ok(found)) = (Path::new(".").join(folder).canonicalize(), found) else {
        return Err(ConfinedError::Missing);
    };
    match !named.is_absolute() && found.starts_with(&within) {
        true => Ok(found),
        false => Err(ConfinedError::Outside),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_inside_the_folder_are_followed_and_links_to_the_outside_are_rejected() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("pipelines");
        std::fs::create_dir_all(folder.join("below")).unwrap();
        std::fs::write(folder.join("below/own"), "1").unwrap();
        std::fs::write(parent.path().join("other"), "1").unwrap();
        std::os::unix::fs::symlink("below/own", folder.join("in")).unwrap();
        std::os::unix::fs::symlink("../other", folder.join("out")).unwrap();
        let own = folder.join("below/own").canonicalize().unwrap();
        let found = |name: &str| confined(&folder, Path::new(name));
        assert_eq!(found("below/own"), Ok(own.clone()));
        assert_eq!(found("in"), Ok(own.clone()));
        for outside in ["out", "../other", own.to_str().unwrap()] {
            assert_eq!(found(outside), Err(ConfinedError::Outside), "{outside}");
        }
        assert_eq!(found("none"), Err(ConfinedError::Missing));
    }
}
