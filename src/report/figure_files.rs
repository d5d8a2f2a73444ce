//! The files of figures in a store, by the artifacts that they show.

use std::collections::BTreeSet;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use super::error::ReportError;
use super::results::WHOSE;
use deaflow_base::{ArtifactId, read_own};
use deaflow_store::Store;

/// A figure takes less, bytes.
const LONGEST: u64 = 64 << 20;

/// The file of a figure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FigureFile {
    /// Where it is.
    pub path: PathBuf,
    /// Its length, bytes.
    pub bytes: u64,
}

/// The figures in a store that show one of some artifacts, as they say themselves. What is no figure of this program, and links, are passed
/// over.
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

/// Removes figures, and the folders that hold none any more.
///
/// # Errors
/// When the system refuses.
pub fn remove_figures(figures: &[FigureFile]) -> Result<(), ReportError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        |source| ReportError::Replace { path, source }
    };
    for figure in figures {
        fs::remove_file(&figure.path).map_err(failed(&figure.path))?;
    }
    let folders: BTreeSet<&Path> = figures.iter().filter_map(|figure| figure.path.parent()).collect();
    for folder in folders {
        let whose = folder.join(WHOSE);
        if entries(folder) == [whose.clone()] {
            fs::remove_file(&whose).map_err(failed(&whose))?;
            fs::remove_dir(folder).map_err(failed(folder))?;
        }
    }
    Ok(())
}

/// The artifacts that a figure says it shows; none of a file that is no figure of this program.
fn shown(path: &Path) -> Option<Vec<ArtifactId>> {
    let bytes = read_own(path, LONGEST).ok()?;
    let reader = png::Decoder::new(Cursor::new(bytes)).read_info().ok()?;
    let text = |keyword: &str| {
        let texts = &reader.info().utf8_text;
        texts.iter().find(|text| text.keyword == keyword)?.get_text().ok()
    };
    text("Software").filter(|software| software.starts_with("deaflow"))?;
    text("Source")?.split(' ').map(|digest| digest.parse().ok()).collect()
}

/// What is in a folder, in order; nothing where it cannot be read.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort_unstable();
    paths
}
