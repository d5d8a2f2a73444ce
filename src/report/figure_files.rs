//! Finds and removes the figure files of artifacts in a store.

use std::collections::BTreeSet;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use super::error::ReportError;
use super::results::OWNER_FILE;
use deaflow_base::{ArtifactId, read_own};
use deaflow_store::Store;

/// The largest figure file, bytes.
const MAX_BYTES: u64 = 64 << 20;

/// A figure file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FigureFile {
    /// Its path.
    pub path: PathBuf,
    /// Its size, bytes.
    pub bytes: u64,
}

/// Finds the figures of some artifacts in a store, by the texts in the files. Other files and links are ignored.
#[must_use]
pub fn figures_of(store: &Store, artifacts: &BTreeSet<ArtifactId>) -> Vec<FigureFile> {
    if artifacts.is_empty() {
        return Vec::new();
    }
    let folders = entries(&store.root().join("figures")).into_iter();
    let folders = folders.filter(|path| fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_dir()));
    let figures = folders.flat_map(|folder| entries(&folder)).filter_map(|path| {
        let metadata = fs::symlink_metadata(&path).ok().filter(fs::Metadata::is_file)?;
        let is_png = path.extension().is_some_and(|extension| extension == "png");
        let shows = is_png.then(|| shown(&path)).flatten()?;
        let is_of_them = shows.iter().any(|digest| artifacts.contains(digest));
        let bytes = metadata.len();
        is_of_them.then_some(FigureFile { path, bytes })
    });
    figures.collect()
}

/// Removes figures, and folders that become empty. Returns the removed figures, and the first error: a file that
/// cannot be removed does not keep the others.
pub fn remove_figures(figures: Vec<FigureFile>) -> (Vec<FigureFile>, Result<(), ReportError>) {
    let failed = |path: &Path| {
        let path = path.to_owned();
        |source| ReportError::Replace { path, source }
    };
    let (mut removed, mut done) = (Vec::new(), Ok(()));
    for figure in figures {
        match fs::remove_file(&figure.path).map_err(failed(&figure.path)) {
            Ok(()) => removed.push(figure),
            error => done = done.and(error),
        }
    }
    let folders: BTreeSet<&Path> = removed.iter().filter_map(|figure| figure.path.parent()).collect();
    for folder in folders {
        let owner = folder.join(OWNER_FILE);
        if entries(folder) == [owner.clone()] {
            done = done
                .and(fs::remove_file(&owner).map_err(failed(&owner)))
                .and_then(|()| fs::remove_dir(folder).map_err(failed(folder)));
        }
    }
    (removed, done)
}

/// Returns the artifacts that a figure shows, according to its texts; `None` for other files.
fn shown(path: &Path) -> Option<Vec<ArtifactId>> {
    let bytes = read_own(path, MAX_BYTES).ok()?;
    let reader = png::Decoder::new(Cursor::new(bytes)).read_info().ok()?;
    let text = |keyword: &str| {
        let texts = &reader.info().utf8_text;
        texts.iter().find(|text| text.keyword == keyword)?.get_text().ok()
    };
    text("Software").filter(|software| software.starts_with("deaflow"))?;
    text("Source")?.split(' ').map(|digest| digest.parse().ok()).collect()
}

/// Returns the sorted entries of a folder; none if it cannot be read.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort_unstable();
    paths
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_that_cannot_be_removed_is_not_counted_and_keeps_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let figure = |name: &str| FigureFile {
            path: folder.path().join(name),
            bytes: 1,
        };
        let (first, stays, last) = (figure("a.png"), figure("b.png"), figure("c.png"));
        for figure in [&first, &last] {
            fs::write(&figure.path, "x").unwrap();
        }
        // A folder is not removed as a file.
        fs::create_dir(&stays.path).unwrap();
        let (removed, done) = remove_figures(vec![first.clone(), stays.clone(), last.clone()]);
        assert_eq!(removed, [first, last]);
        assert!(done.unwrap_err().to_string().contains("b.png"));
        assert!(stays.path.exists());
    }
}
