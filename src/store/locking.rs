//! How processes avoid conflicts in a store: by file locks if all machines see them, otherwise by claims.
//!
//! Network file systems often grant locks on one machine without asking the server (NFS with `local_lock`, Lustre with
//! `localflock`), or do not support them. So locks are used only on local file systems. Once a store has been opened
//! with claims, all processes use them, because the file system may be local on the server only.

use std::io;
use std::path::Path;

use rustix::fs::statfs;

use super::error::StoreError;
use super::layout::Layout;
use super::lock;

/// Local file systems by their `statfs` numbers (linux/magic.h).
const LOCAL: [(u64, &str); 14] = [
    (0xEF53, "ext4"),
    (0x5846_5342, "xfs"),
    (0x9123_683E, "btrfs"),
    (0x0102_1994, "tmpfs"),
    (0x8584_58F6, "ramfs"),
    (0x794C_7630, "overlayfs"),
    (0x2FC1_2FC1, "zfs"),
    (0xF2F5_2010, "f2fs"),
    (0xCA45_1A4E, "bcachefs"),
    (0x3153_464A, "jfs"),
    (0x5265_4973, "reiserfs"),
    (0x7366_746E, "ntfs3"),
    (0x4D44, "vfat"),
    (0x2011_BAB0, "exfat"),
];

/// Shared file systems, for the output of `deaflow doctor`.
const SHARED: [(u64, &str); 11] = [
    (0x6969, "NFS"),
    (0x6573_5546, "FUSE"),
    (0x0BD0_0BD0, "Lustre"),
    (0xFF53_4D42, "CIFS"),
    (0xFE53_4D42, "SMB2"),
    (0x00C3_6400, "Ceph"),
    (0x1983_0326, "BeeGFS"),
    (0x4750_4653, "GPFS"),
    (0x0102_1997, "9p"),
    (0x5346_414F, "AFS"),
    (0x7461_636F, "OCFS2"),
];

/// How processes avoid conflicts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LockingMethod {
    /// File locks, which end with their process.
    Locks,
    /// Claims with heartbeats.
    Claims,
}

/// A locking method and the reason for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LockingChoice {
    /// The method.
    pub method: LockingMethod,
    /// Why, for people.
    pub reason: String,
}

/// Chooses the locking method of a store.
pub fn choose(layout: &Layout) -> LockingChoice {
    let claims = |reason: String| LockingChoice {
        method: LockingMethod::Claims,
        reason,
    };
    let (kind, is_local) = file_system(layout.root());
    if !is_local {
        return claims(format!("locks on {kind} may not be visible on other machines"));
    }
    match lock::try_shared(&layout.run_lock()) {
        Err(StoreError::Io { source, .. }) if is_without_locks(&source) => {
            claims(format!("the file system does not support locks: {source}"))
        }
        _ if layout.processes().is_dir() => claims("other processes have opened the store with claims".to_owned()),
        _ => LockingChoice {
            method: LockingMethod::Locks,
            reason: format!("locks on {kind} are reliable"),
        },
    }
}

/// Returns the name of the file system of a folder, and whether it is local.
pub fn file_system(folder: &Path) -> (String, bool) {
    let Ok(found) = statfs(folder) else {
        return ("an unknown file system".to_owned(), false);
    };
    // The field is signed on some machines, and has 32 bits.
    #[allow(clippy::unnecessary_cast)]
    let number = (found.f_type as u64) & 0xFFFF_FFFF;
    let name = |list: &[(u64, &str)]| {
        list.iter()
            .find(|(known, _)| *known == number)
            .map(|(_, name)| (*name).to_owned())
    };
    match (name(&LOCAL), name(&SHARED)) {
        (Some(name), _) => (name, true),
        (_, Some(name)) => (name, false),
        _ => (format!("a file system of type {number:#x}"), false),
    }
}

/// Whether an error means that the file system does not support locks.
fn is_without_locks(error: &io::Error) -> bool {
    const NOT_THERE: [rustix::io::Errno; 4] = [
        rustix::io::Errno::NOLCK,
        rustix::io::Errno::NOSYS,
        rustix::io::Errno::OPNOTSUPP,
        rustix::io::Errno::INVAL,
    ];
    rustix::io::Errno::from_io_error(error).is_some_and(|errno| NOT_THERE.contains(&errno))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_store_on_a_disk_has_locks_until_somebody_claims() {
        let folder = tempfile::tempdir_in(env!("CARGO_MANIFEST_DIR").to_owned() + "/../../target")
            .or_else(|_| tempfile::tempdir())
            .unwrap();
        let layout = Layout::open(&folder.path().join("store")).unwrap();
        let (kind, is_local) = file_system(layout.root());
        let choice = choose(&layout);
        assert_eq!(choice.method == LockingMethod::Locks, is_local, "{kind}: {choice:?}");
        std::fs::create_dir_all(layout.processes()).unwrap();
        assert_eq!(choose(&layout).method, LockingMethod::Claims);
    }
}
