//! Files that a document names: beside it or below, and nowhere else.
//!
//! Whoever runs a pipeline of somebody else's must not be made to read what lies elsewhere.

use std::path::{Path, PathBuf};

/// A name that leads to no file of the folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfinedError {
    /// There is nothing of the name.
    #[error("it does not exist")]
    Missing,
    /// It is somewhere else.
    #[error("it is outside the folder of the pipeline")]
    Outside,
}

impl ConfinedError {
    /// What to do about it.
    #[must_use]
    pub fn help(self) -> &'static str {
        match self {
            Self::Missing => "it is named relative to the pipeline's file",
            Self::Outside => "put it beside the pipeline or in a folder below, without a link that leads out",
        }
    }
}

/// Where a file of that name really is, links followed, if that is in the folder or below.
///
/// # Errors
/// When there is none, its name is absolute, or a link or `..` leads out.
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
    fn links_may_lead_about_in_the_folder_and_not_out_of_it() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("pipelines");
        std::fs::create_dir_all(folder.join("below")).unwrap();
        std::fs::write(folder.join("below/own"), "1").unwrap();
        std::fs::write(place.path().join("other"), "1").unwrap();
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
