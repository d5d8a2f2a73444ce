//! Plain log files of runs: what was built, how each stage ended, and what was warned of. They are for people, and
//! decide nothing.

use std::fs::{self, File};
use std::path::PathBuf;

use super::entries::{files_in, files_in_optional};
use super::error::StoreError;
use super::layout::LOGS;
use super::open::Store;
use deaflow_base::read_own;

/// Number of log files that are kept.
const KEPT: usize = 1000;

/// Maximum length of a log file that is read, bytes.
const LONG: u64 = 16 << 20;

/// The name of a log file, in the folder of the store, of a run that begins at a time (RFC 3339, UTC) in a process.
#[must_use]
pub fn log_name(time: &str, process: u32) -> String {
    format!("{LOGS}/{}-{process}.log", time.replace(':', "-"))
}

impl Store {
    /// Returns the log files, newest first, relative to the store.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn logs(&self) -> Result<Vec<String>, StoreError> {
        let folder = self.root().join(LOGS);
        let mut logs: Vec<PathBuf> = files_in_optional(&folder)?
            .into_iter()
            .filter(|path| is_log(path))
            .collect();
        logs.sort_unstable_by(|a, b| b.cmp(a));
        let name = |path: &PathBuf| Some(format!("{LOGS}/{}", path.file_name()?.to_str()?));
        Ok(logs.iter().filter_map(name).collect())
    }

    /// Returns the content of a log file, if it can be read.
    #[must_use]
    pub fn read_log(&self, name: &str) -> Option<String> {
        let bytes = read_own(&self.root().join(name), LONG).ok()?;
        Some(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Creates a log file, and removes the oldest beyond a thousand; those that cannot be removed stay until the next
    /// run.
    ///
    /// # Errors
    /// If the file exists, or the system reports an error.
    pub fn create_log(&self, name: &str) -> Result<File, StoreError> {
        let folder = self.root().join(LOGS);
        self.clear_folder(&folder)?;
        fs::create_dir_all(&folder).map_err(StoreError::io("create", &folder))?;
        let path = self.root().join(name);
        let file = File::create_new(&path).map_err(StoreError::io("create", &path))?;
        let mut logs: Vec<PathBuf> = files_in(&folder)?.into_iter().filter(|path| is_log(path)).collect();
        logs.sort_unstable_by(|a, b| b.cmp(a));
        for old in logs.iter().skip(KEPT) {
            let _ = fs::remove_file(old);
        }
        Ok(file)
    }
}

/// Whether a file has the name of a log file: `2026-01-01T00-00-01.000Z-1234.log`.
fn is_log(path: &std::path::Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let process = name
        .strip_suffix(".log")
        .and_then(|name| name.get(24..)?.strip_prefix('-'));
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let time = name.get(..24).unwrap_or_default();
    let is_time = time.ends_with('Z') && time.get(10..11) == Some("T") && is_number(time.get(..4).unwrap_or_default());
    is_time && process.is_some_and(is_number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_logs_are_kept_and_nothing_else_is_touched() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        let name = |number: u32| log_name(&format!("2026-01-01T00:{:02}:{:02}.000Z", number / 60, number % 60), 7);
        assert_eq!(name(61), "logs/2026-01-01T00-01-01.000Z-7.log");
        store.create_log(&name(0)).unwrap();
        for number in 1..1000 {
            fs::write(store.root().join(name(number)), "").unwrap();
        }
        for note in ["note.log", "2026-01-01T00-00-01.000Z-x.log", "2026.log"] {
            fs::write(store.root().join("logs").join(note), "").unwrap();
        }
        store.create_log(&name(1000)).unwrap();
        assert!(!store.root().join(name(0)).exists() && store.root().join(name(1)).exists());
        assert_eq!(fs::read_dir(store.root().join("logs")).unwrap().count(), 1003);
        assert!(store.create_log(&name(1000)).is_err(), "nothing is written over");
    }
}
