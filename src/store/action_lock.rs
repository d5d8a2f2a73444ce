//! Locks of actions, which keep two processes from building the same artifact.

use std::time::Duration;

use super::error::StoreError;
use super::lock::{self, Guard};
use super::open::Store;
use deaflow_base::ActionKey;

impl Store {
    /// Waits for the lock of an action; returns `None` as soon as `stopped` returns true.
    ///
    /// # Errors
    /// If the lock file cannot be opened.
    pub fn lock_action(&self, key: &ActionKey, stopped: &dyn Fn() -> bool) -> Result<Option<Guard>, StoreError> {
        let mut pause = Duration::from_millis(5);
        loop {
            if let Some(guard) = self.try_lock_action(key)? {
                return Ok(Some(guard));
            }
            if stopped() {
                return Ok(None);
            }
            std::thread::sleep(pause);
            pause = (2 * pause).min(Duration::from_secs(1));
        }
    }

    /// Whether another process or thread is running this action, or one that shares its lock file. That may have
    /// changed when this returns.
    ///
    /// # Errors
    /// If the lock file cannot be opened.
    pub fn is_busy(&self, key: &ActionKey) -> Result<bool, StoreError> {
        match &self.session.claims {
            Some(claims) => Ok(claims.owner(&key.to_string()).is_some()),
            None => lock::is_held(&self.layout.action_lock(key)),
        }
    }

    /// Returns a description of the process that runs this action, if known.
    pub fn action_owner(&self, key: &ActionKey) -> Option<String> {
        self.session.action_owner(&self.layout, key)
    }

    /// Claims a name unless another process has it. Always `None` if the store uses file locks.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn try_reserve(&self, name: &str) -> Result<Option<Guard>, StoreError> {
        match &self.session.claims {
            Some(claims) => Ok(claims.try_take(name)?.map(Guard::from)),
            None => Ok(None),
        }
    }

    /// Returns the name of this process in the store, if the store uses claims.
    #[must_use]
    pub fn process_name(&self) -> Option<&str> {
        self.session.claims.as_ref().map(|claims| claims.process())
    }

    /// Takes the lock of an action unless another process or thread has it, or that of one that shares its lock file.
    ///
    /// # Errors
    /// If the lock file cannot be opened.
    pub fn try_lock_action(&self, key: &ActionKey) -> Result<Option<Guard>, StoreError> {
        let path = self.layout.action_lock(key);
        self.clear_file(&path)?;
        self.session.try_action(&self.layout, key)
    }
}
