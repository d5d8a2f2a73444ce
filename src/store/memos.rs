//! Cached results that are short but expensive to compute, by the digest of their inputs: `memos/<digest>.json`.
//!
//! They are no truth of their own: no key, no artifact and no record depends on one, and any may be deleted at any
//! time. One that cannot be read is found again.

use std::fs;
use std::path::PathBuf;
use std::time::SystemTime;

use super::atomic;
use super::entries::files_in;
use super::error::StoreError;
use super::layout::MEMOS;
use super::open::Store;
use deaflow_base::{Digest, read_own};

/// Number of results that are kept.
const KEPT: usize = 1000;

/// Maximum length of a result, bytes.
const MAX_BYTES: u64 = 1 << 20;

impl Store {
    /// Returns the cached lines for a digest, if any.
    #[must_use]
    pub fn memo(&self, of: &Digest) -> Option<Vec<String>> {
        let bytes = read_own(&self.memo_path(of), MAX_BYTES).ok()?;
        serde_json::from_slice(&bytes).ok()
    }

    /// Caches lines for a digest, and removes the oldest beyond a thousand.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn put_memo(&self, of: &Digest, lines: &[String]) -> Result<(), StoreError> {
        let folder = self.root().join(MEMOS);
        self.clear_folder(&folder)?;
        fs::create_dir_all(&folder).map_err(StoreError::io("create", &folder))?;
        let text = serde_json::to_vec(lines)?;
        let temporary = self.temporary()?;
        atomic::write(&temporary.path().join("memo"), &self.memo_path(of), &text)?;
        let mut memos: Vec<(SystemTime, PathBuf)> = files_in(&folder)?
            .into_iter()
            .filter(|path| is_memo(path))
            .filter_map(|path| Some((fs::metadata(&path).ok()?.modified().ok()?, path)))
            .collect();
        memos.sort_unstable_by(|a, b| b.cmp(a));
        for (_, old) in memos.iter().skip(KEPT) {
            let _ = fs::remove_file(old);
        }
        Ok(())
    }

    fn memo_path(&self, of: &Digest) -> PathBuf {
        self.root().join(MEMOS).join(format!("{of}.json"))
    }
}

/// Whether a file has the name of a cached result.
fn is_memo(path: &std::path::Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let digest = name.strip_suffix(".json").unwrap_or_default();
    digest.len() == 64 && digest.bytes().all(|byte| byte.is_ascii_hexdigit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_there_until_it_is_damaged_or_a_thousand_came_after_it() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let of = |number: u32| Digest::of(&number.to_le_bytes());
        let lines = vec!["one".to_owned(), "two".to_owned()];
        assert_eq!(store.memo(&of(0)), None);
        store.put_memo(&of(0), &lines).unwrap();
        assert_eq!(store.memo(&of(0)), Some(lines.clone()));
        fs::write(store.memo_path(&of(0)), "[\"one").unwrap();
        assert_eq!(store.memo(&of(0)), None);
        store.put_memo(&of(0), &[]).unwrap();
        assert_eq!(store.memo(&of(0)), Some(Vec::new()));
        let note = folder.path().join(MEMOS).join("note.txt");
        fs::write(&note, "").unwrap();
        let old = fs::File::options().write(true).open(store.memo_path(&of(0))).unwrap();
        old.set_modified(SystemTime::UNIX_EPOCH).unwrap();
        for number in 1..1000 {
            fs::write(store.memo_path(&of(number)), "[]").unwrap();
        }
        store.put_memo(&of(1000), &lines).unwrap();
        assert_eq!(store.memo(&of(0)), None, "the oldest went");
        assert!(store.memo(&of(1)).is_some() && note.exists());
    }
}
