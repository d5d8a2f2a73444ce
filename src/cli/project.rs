//! Finds the store of a project from any of its folders.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use deaflow_base::folder_of;
use deaflow_store::Store;

/// The name of a project's store.
const STORE: &str = "store";

/// The entry that marks the top of a project.
const MARK: &str = ".git";

/// The permissions of a public folder such as `/tmp`, whose contents are not a project.
const PUBLIC: u32 = 0o1002;

/// Returns the folder of the store for a pipeline, or for the current folder: in the nearest folder at or above it that
/// has a
/// store or is the top of a Git repository. If there is none, it is next to the pipeline, or in the current folder if
/// the
/// pipeline is below that.
#[must_use]
pub fn store(pipeline: Option<&Path>) -> PathBuf {
    let here = std::env::current_dir().and_then(|here| here.canonicalize());
    let Ok(here) = here else {
        return PathBuf::from(STORE);
    };
    let from = pipeline.and_then(|pipeline| folder_of(pipeline).canonicalize().ok());
    let from = from.unwrap_or_else(|| here.clone());
    let is_inside = from.starts_with(&here);
    let root = root_above(&from).unwrap_or(if is_inside { here.clone() } else { from });
    relative_to(&here, &root).join(STORE)
}

/// Returns the nearest folder at or above `folder` with a store, or the top of the project.
fn root_above(folder: &Path) -> Option<PathBuf> {
    let own = folder.ancestors().take_while(|folder| !is_public(folder));
    for folder in own {
        if Store::is_at(&folder.join(STORE)) || folder.join(MARK).exists() {
            return Some(folder.to_owned());
        }
    }
    None
}

fn is_public(folder: &Path) -> bool {
    fs::metadata(folder).is_ok_and(|metadata| metadata.permissions().mode() & PUBLIC == PUBLIC)
}

/// Returns a folder relative to `here` if it is above or below, otherwise absolute. Both paths are without links.
fn relative_to(here: &Path, folder: &Path) -> PathBuf {
    if let Ok(below) = folder.strip_prefix(here) {
        return below.to_owned();
    }
    match here.strip_prefix(folder) {
        Ok(steps) => steps.iter().map(|_| "..").collect(),
        Err(_) => folder.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_named_as_seen_from_here() {
        let seen = |folder: &str| relative_to(Path::new("/a/b"), Path::new(folder)).join("store");
        for (folder, name) in [
            ("/a/b", "store"),
            ("/a/b/c", "c/store"),
            ("/a", "../store"),
            ("/", "../../store"),
            ("/a/x", "/a/x/store"),
        ] {
            assert_eq!(seen(folder), Path::new(name), "{folder}");
        }
    }

    #[test]
    fn the_nearest_store_or_repository_is_that_of_the_project() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("top/project/pipelines/deep")).unwrap();
        assert_eq!(root_above(&at("top/project/pipelines")), None);
        // A folder of another program.
        fs::create_dir(at("top/project/store")).unwrap();
        fs::write(at("top/project/store/letter"), "dear").unwrap();
        fs::create_dir(at("top/.git")).unwrap();
        assert_eq!(root_above(&at("top/project/pipelines/deep")), Some(at("top")));
        Store::open(&at("top/project/pipelines/store")).unwrap();
        assert_eq!(
            root_above(&at("top/project/pipelines/deep")),
            Some(at("top/project/pipelines"))
        );
        assert_eq!(root_above(&at("top/project")), Some(at("top")));
    }

    #[test]
    fn what_lies_in_a_folder_of_everybody_is_no_project() {
        let folder = tempfile::tempdir().unwrap();
        let public = folder.path().join("public");
        fs::create_dir_all(public.join("own")).unwrap();
        Store::open(&public.join("store")).unwrap();
        assert_eq!(root_above(&public.join("own")).as_deref(), Some(public.as_path()));
        fs::set_permissions(&public, fs::Permissions::from_mode(0o1777)).unwrap();
        assert_eq!(root_above(&public.join("own")), None);
    }
}
