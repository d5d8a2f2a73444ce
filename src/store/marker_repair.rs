//! Repairs the marker of a store.

use std::path::Path;

use super::error::StoreError;
use super::fsck::Damage;
use super::layout::Layout;
use super::marker;
use super::open::Store;
use super::quarantine::quarantine;
use super::session::StoreSession;

impl Store {
    /// Writes the marker of a store if it is damaged or missing; a damaged one is moved to quarantine.
    ///
    /// # Errors
    /// If the folder is not a store, the marker is of another version, another process uses the store, or the system
    /// reports an error.
    pub fn repair_marker(root: &Path) -> Result<Option<Damage>, StoreError> {
        let layout = Layout::of(root)?;
        let path = layout.marker();
        // A device may fail once.
        let reason = match layout.look().or_else(|_| layout.look()) {
            Err(StoreError::Marker { reason, .. }) => reason,
            Err(StoreError::NotAStore { .. }) => return Err(StoreError::NoStore { path: root.to_owned() }),
            looked => return looked.map(|()| None),
        };
        layout.make_folders()?;
        let alone = StoreSession::alone(&layout)?;
        let quarantined = quarantine(&layout, &path)?;
        let temporary = layout.temporary();
        let failed = StoreError::io("write in", &temporary);
        let folder = alone.temporary_folder.folder().map_err(failed)?;
        marker::write(&folder, &path)?;
        Ok(Some(Damage {
            path,
            quarantined,
            reason,
        }))
    }
}
