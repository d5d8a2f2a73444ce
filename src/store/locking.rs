//! How processes avoid conflicts in a store: by file locks if all machines see them, otherwise by claims.
//!
//! Network file systems often grant locks on one machine without asking the server (NFS with `local_lock`, Lustre with
//! `localflock`), or do not support them. So locks are used only on local file systems. Once a store has been opened
//! with claims, all processes use them, because the file system may be local on the server only.

use std::io;

use super::error::StoreError;
use super::file_system::file_system;
use super::layout::Layout;
use super::lock;

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
