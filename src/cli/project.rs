//! Finds the store of a project, in whatever folder of it a command is given.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use deaflow_base::folder_of;
use deaflow_store::Store;

/// The name of a project's store.
const STORE: &str = "store";

/// What stands at the top of a project.
const MARK: &str = ".git";

/// A folder in which everybody may put what they like, as in `/tmp`: what is found there is nobody's project.
const PUBLIC: u32 = 0o1002;

/// The folder of the store for a pipeline, or without one for the folder at hand: that of the nearest folder above which has a store or
/// is the top of a Git repository. Where there is none, it is beside the pipeline, or here if the pipeline is in a folder of this one.
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
    as_seen_from(&here, &root).join(STORE)
}

/// The nearest folder with a store, at or above `folder`, up to the top of the project; or that top.
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

/// A folder as people would name it: from here if it is above or below, and else from the root. Both are without links.
fn as_seen_from(here: &Path, folder: &Path) -> PathBuf {
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
        let seen = |folder: &str| as_seen_from(Path::new("/a/b"), Path::new(folder)).join("store");
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
