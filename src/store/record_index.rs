//! An index of the records in a store, from their file names only.
//!
//! Listing a folder takes little longer than opening one file, so the missing chunks of a stage with very many chunks
//! are found quickly.

use rayon::prelude::*;

use super::entries::{is_folder, names_in};
use super::error::StoreError;
use super::open::Store;
use super::record::Record;
use deaflow_base::ActionKey;

/// The actions with a record at one time.
#[derive(Debug, Default)]
pub struct RecordIndex(Vec<ActionKey>);

impl RecordIndex {
    /// Whether an action had a record, which may be damaged or without its artifact.
    #[must_use]
    pub fn contains(&self, key: &ActionKey) -> bool {
        self.0.binary_search(key).is_ok()
    }
}

impl Store {
    /// Lists the records.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn record_index(&self) -> Result<RecordIndex, StoreError> {
        let keys: Result<Vec<Vec<ActionKey>>, StoreError> = (0..=u8::MAX)
            .into_par_iter()
            .map(|first| {
                let folder = self.layout.records().join(format!("{first:02x}"));
                if !is_folder(&folder) {
                    return Ok(Vec::new());
                }
                let keys = names_in(&folder)?.into_iter().filter_map(|name| name.parse().ok());
                Ok(keys.filter(|key: &ActionKey| key.as_bytes()[0] == first).collect())
            })
            .collect();
        let mut keys = keys?.concat();
        keys.par_sort_unstable();
        Ok(RecordIndex(keys))
    }

    /// Whether the file of what a record says is here and as long as it was written: what stands in it is verified when
    /// it is read.
    #[must_use]
    pub fn has_artifact_of(&self, record: &Record) -> bool {
        let file = std::fs::symlink_metadata(self.layout.object(&record.artifact));
        file.is_ok_and(|file| file.is_file() && file.len() == record.size)
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
        assert!(!keys.iter().any(|key| store.record_index().unwrap().contains(key)));
        for key in keys.iter().step_by(2) {
            let path = store.layout.record(key);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        let odd = store.layout.record(&keys[0]);
        fs::write(odd.with_file_name("notes"), "").unwrap();
        fs::write(store.layout.records().join("notes"), "").unwrap();
        for name in [
            "other",
            if keys[1].to_string().starts_with("00") {
                "01"
            } else {
                "00"
            },
        ] {
            let other = odd.parent().unwrap().with_file_name(name);
            fs::create_dir_all(&other).unwrap();
            fs::write(other.join(keys[1].to_string()), "").unwrap();
        }
        let recorded = store.record_index().unwrap();
        let found: Vec<bool> = keys.iter().map(|key| recorded.contains(key)).collect();
        let expected: Vec<bool> = (0..1000).map(|n| n % 2 == 0).collect();
        assert_eq!(found, expected);
    }
}
