//! Which actions have a record, by the names of the records alone.
//!
//! To list a folder costs a file system little more than to open one file in it: where a stage has very many chunks, those that are not
//! built are known so without asking for each.

use rayon::prelude::*;

use super::entries::{files_in, is_folder, names_in};
use super::error::StoreError;
use super::open::Store;
use crate::base::ActionKey;

/// The actions that had a record in a store when it was looked at.
#[derive(Debug, Default)]
pub struct Recorded(Vec<ActionKey>);

impl Recorded {
    /// Whether an action had a record. Whether that is sound, and what it names is there, has yet to be seen.
    #[must_use]
    pub fn contains(&self, key: &ActionKey) -> bool {
        self.0.binary_search(key).is_ok()
    }
}

impl Store {
    /// Lists the records here.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn recorded(&self) -> Result<Recorded, StoreError> {
        let folders = files_in(&self.layout.records())?;
        let folders = folders.par_iter().filter(|folder| is_folder(folder));
        let keys: Result<Vec<Vec<ActionKey>>, StoreError> = folders
            .map(|folder| {
                let names = names_in(folder)?;
                let is_here = |key: &ActionKey| folder.ends_with(&key.to_string()[..2]);
                Ok(names
                    .iter()
                    .filter_map(|name| name.parse().ok())
                    .filter(is_here)
                    .collect())
            })
            .collect();
        let mut keys = keys?.concat();
        keys.par_sort_unstable();
        Ok(Recorded(keys))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn records_are_known_by_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let keys: Vec<ActionKey> = (0..1000_u32).map(|n| ActionKey::of(&n.to_le_bytes())).collect();
        assert!(!keys.iter().any(|key| store.recorded().unwrap().contains(key)));
        for key in keys.iter().step_by(2) {
            let path = store.layout.record(key);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        let odd = store.layout.record(&keys[0]);
        fs::write(odd.with_file_name("notes"), "").unwrap();
        fs::write(store.layout.records().join("notes"), "").unwrap();
        let other = odd.parent().unwrap().with_file_name("other");
        fs::create_dir(&other).unwrap();
        fs::write(other.join(keys[1].to_string()), "").unwrap();
        let recorded = store.recorded().unwrap();
        let found: Vec<bool> = keys.iter().map(|key| recorded.contains(key)).collect();
        let expected: Vec<bool> = (0..1000).map(|n| n % 2 == 0).collect();
        assert_eq!(found, expected);
    }
}
