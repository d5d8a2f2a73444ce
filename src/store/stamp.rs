//! The stamp of a file, which shows changes without reading the file, and when it is reliable.
//!
//! The stamp has size, times and inode, as in git's index. Programs cannot set the change time, so it also shows
//! changes after which the modification time was reset. But two changes within one tick of the clock of the file system
//! have the same time ("racy git", Documentation/technical/racy-git.txt in git's sources). So a stamp counts only if it
//! was taken after that tick.

use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// A time as files carry it: seconds since 1970, and nanoseconds.
pub type Time = (i64, i64);

/// Longest tick of the clock for files on Linux, ns.
const TICK: i64 = 10_000_000;

/// Tick of file systems with a resolution of one or two seconds (FAT), ns.
const COARSE_TICK: i64 = 2_000_000_000;

/// Shows whether a file has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Length in bytes.
    pub size: u64,
    /// When its bytes were last written; programs can set it.
    pub modified: Time,
    /// When its bytes, name or times were last changed; programs cannot set it.
    pub changed: Time,
    /// Its inode number; a copy has another one.
    pub inode: u64,
}

impl Stamp {
    pub fn of(metadata: &Metadata) -> Self {
        Self {
            size: metadata.len(),
            modified: (metadata.mtime(), metadata.mtime_nsec()),
            changed: (metadata.ctime(), metadata.ctime_nsec()),
            inode: metadata.ino(),
        }
    }

    /// Whether every change after `taken` changes the stamp: the tick of the last change was over then. A change time
    /// after `taken` means that the clock was set back; then the answer is no.
    pub fn is_settled(&self, taken: Time) -> bool {
        nanoseconds_between(self.changed, taken) >= 2 * self.tick()
    }

    /// Returns the time after its last change when the stamp is settled; a clock may be one tick behind.
    pub fn settles_after(&self) -> Duration {
        Duration::from_nanos(3 * self.tick().unsigned_abs())
    }

    fn tick(&self) -> i64 {
        if self.changed.1 == 0 && self.modified.1 == 0 {
            COARSE_TICK
        } else {
            TICK
        }
    }
}

/// Returns the difference of two times, ns; at most about 290 years.
fn nanoseconds_between(from: Time, to: Time) -> i64 {
    let seconds = to.0.saturating_sub(from.0);
    seconds
        .saturating_mul(1_000_000_000)
        .saturating_add(to.1.saturating_sub(from.1))
}

/// Returns the time of the clock of the file system of a folder, which may differ from that of this machine; `None` if
/// the folder is not writable.
pub fn file_system_time(folder: &Path) -> Option<Time> {
    let metadata = tempfile::tempfile_in(folder).ok()?.metadata().ok()?;
    Some((metadata.mtime(), metadata.mtime_nsec()))
}

/// Returns the time of the clock of this machine.
pub fn machine_time() -> Time {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    (
        i64::try_from(since.as_secs()).unwrap_or(i64::MAX),
        i64::from(since.subsec_nanos()),
    )
}

#[cfg(test)]
mod tests {
    use super::super::file_system::file_system;
    use super::*;

    fn changed(changed: Time) -> Stamp {
        Stamp {
            size: 1,
            modified: changed,
            changed,
            inode: 1,
        }
    }

    #[test]
    fn files_on_a_disk_have_the_time_of_this_machine() {
        let folder = tempfile::tempdir().unwrap();
        if !file_system(folder.path()).1 {
            return;
        }
        for _ in 0..50 {
            let (before, stamped) = (machine_time(), file_system_time(folder.path()).unwrap());
            // Stamps are of a clock that ticks, or of one that does not.
            assert!(nanoseconds_between(before, stamped) >= -TICK, "{before:?} {stamped:?}");
            assert!(nanoseconds_between(stamped, machine_time()) >= 0);
        }
    }

    #[test]
    fn a_stamp_is_settled_once_its_tick_is_over() {
        let stamp = changed((100, 500_000_000));
        assert!(!stamp.is_settled((100, 500_000_000)));
        assert!(!stamp.is_settled((100, 519_999_999)));
        assert!(stamp.is_settled((100, 520_000_000)));
        assert!(stamp.is_settled((101, 0)));
        assert!(!stamp.is_settled((99, 0)), "the clock was set back");
    }

    #[test]
    fn whole_seconds_are_taken_for_a_coarse_clock() {
        let stamp = changed((100, 0));
        assert!(!stamp.is_settled((103, 999_999_999)));
        assert!(stamp.is_settled((104, 0)));
    }

    #[test]
    fn times_at_the_ends_of_the_range_do_no_harm() {
        assert!(changed((i64::MIN, 1)).is_settled((i64::MAX, 999_999_999)));
        assert!(!changed((i64::MAX, 1)).is_settled((i64::MIN, 0)));
    }

    #[test]
    fn altered_bytes_show_even_where_the_modification_time_is_put_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, "one").unwrap();
        let before = std::fs::metadata(&path).unwrap();
        std::thread::sleep(Stamp::of(&before).settles_after());
        std::fs::write(&path, "two").unwrap();
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        file.set_modified(before.modified().unwrap()).unwrap();
        let after = Stamp::of(&std::fs::metadata(&path).unwrap());
        assert_eq!(after.modified, Stamp::of(&before).modified);
        assert_ne!(after, Stamp::of(&before));
    }
}
