//! A store whose marker is lost is a store still.

use std::path::Path;

use super::error::StoreError;
use super::fsck::Damage;
use super::layout::Layout;
use super::marker;
use super::open::Store;
use super::quarantine::quarantine;
use super::session::StoreSession;

impl Store {
    /// Writes the marker of a store anew where it is damaged or gone; what stood in its place is quarantined. Nothing happens
    /// where it is sound.
    ///
    /// # Errors
    /// When the folder does not hold what every store holds, the marker is that of another version, another process works there,
    /// or the system refuses.
    pub fn repair_marker(root: &Path) -> Result<Option<Damage>, StoreError> {
        let layout = Layout::of(root)?;
        let path = layout.marker();
        let reason = match layout.look() {
            Err(StoreError::Marker { reason, .. }) => reason,
            Err(StoreError::NotAStore { .. }) => return Err(StoreError::NoStore { path: root.to_owned() }),
            looked => return looked.map(|()| None),
        };
        layout.make_folders()?;
        let alone = StoreSession::alone(&layout)?;
        let quarantined = quarantine(&layout, &path)?;
        let temporary = layout.temporary();
        let refused = StoreError::io("write in", &temporary);
        let folder = alone.temporary_folder.folder().map_err(refused)?;
        marker::write(&folder, &path)?;
        Ok(Some(Damage {
            path,
            quarantined,
            reason,
        }))
    }
}
