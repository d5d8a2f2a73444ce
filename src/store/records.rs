//! Reads and writes the records of a store.

use std::fs;
use std::path::Path;

use super::atomic;
use super::delayed_names;
use super::error::StoreError;
use super::open::Store;
use super::record::{self, Lookup, Record};
use deaflow_base::ActionKey;

impl Store {
    /// Looks up the record of an action.
    ///
    /// # Errors
    /// If the system reports an error; a damaged record is [`Lookup::Damaged`].
    pub fn record(&self, key: &ActionKey) -> Result<Lookup, StoreError> {
        Ok(self.or_upstream_record(record::read(&self.layout.record(key), key)?, key))
    }

    /// As [`Store::record`], for an action that this process has locked: also sees a record that another process has
    /// just written.
    ///
    /// # Errors
    /// As [`Store::record`].
    pub fn record_now(&self, key: &ActionKey) -> Result<Lookup, StoreError> {
        let path = self.layout.record(key);
        if let found @ (Lookup::Found(..) | Lookup::Damaged(_)) = record::read(&path, key)? {
            return Ok(found);
        }
        delayed_names::refresh(path.parent().unwrap_or(self.root()));
        // Waits only if the folder lists the record.
        let _ = delayed_names::if_listed(&path, || fs::symlink_metadata(&path));
        Ok(self.or_upstream_record(record::read(&path, key)?, key))
    }

    /// Writes a record. Its artifact must have been written before. A crash of the machine may lose the record until
    /// [`Store::settle_records`].
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn put_record(&self, record: &Record) -> Result<(), StoreError> {
        let bytes = record.to_bytes()?;
        let target = self.layout.record(&record.key);
        self.clear_folder(target.parent().unwrap_or(self.root()))?;
        let is_damaged = || Ok::<_, StoreError>(matches!(self.record(&record.key)?, Lookup::Damaged(_)));
        if is_damaged()? && is_damaged()? {
            self.quarantine(&target)?;
        }
        let temporary = self.temporary_file()?;
        atomic::write_unsettled(&temporary, &target, &bytes)?;
        let folder = target.parent().map(Path::to_owned);
        self.unsettled().extend(folder);
        Ok(())
    }

    /// Syncs the folders of all records that were written. Once for many is enough: a lost record only costs repeated
    /// work.
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn settle_records(&self) -> Result<(), StoreError> {
        let folders = std::mem::take(&mut *self.unsettled());
        folders.iter().try_for_each(|folder| atomic::sync_folder(folder))
    }
}
