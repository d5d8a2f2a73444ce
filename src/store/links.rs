//! Finds links in a store, which never creates any.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::entries::{entries, is_folder, is_link};
use super::layout::Layout;
use deaflow_base::is_dangling_link;

/// Maximum depth of the folders of a store.
const DEEPEST: u32 = 3;

/// All links below the folders of a store, which are followed by nobody. Figures may be linked to other places by
/// whoever likes; of those only the links that lead nowhere count. A folder that cannot be read, or goes meanwhile,
/// shows none.
pub fn links(layout: &Layout) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    for folder in layout.own_folders() {
        let figures = folder == layout.figures();
        let mut note = |path: PathBuf| {
            if !figures || is_dangling_link(&path) {
                found.insert(path);
            }
        };
        if folder != layout.quarantine() && is_folder(&folder) {
            links_below(&folder, DEEPEST, &mut note);
        }
    }
    found
}

fn links_below(folder: &Path, depth: u32, note: &mut dyn FnMut(PathBuf)) {
    for entry in entries(folder).unwrap_or_default() {
        if is_link(&entry) {
            note(entry.path());
        } else if depth > 0 && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            links_below(&entry.path(), depth - 1, note);
        }
    }
}
