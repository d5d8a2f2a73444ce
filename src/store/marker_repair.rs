//! A store whose marker is lost is a store still.

use std::path::Path;

use super::error::StoreError;
use super::fsck::Damage;
use super::layout::Layout;
use super::lock;
use super::marker;
use super::open::Store;
use super::quarantine::quarantine;

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
        let alone = lock::try_exclusive(&layout.run_lock())?;
        let _alone = alone.ok_or_else(|| StoreError::Busy { path: root.to_owned() })?;
        let quarantined = quarantine(&layout, &path)?;
        let folder = layout.temporary();
        let folder = tempfile::tempdir_in(&folder).map_err(StoreError::io("write in", &folder))?;
        marker::write(folder.path(), &path)?;
        Ok(Some(Damage {
            path,
            quarantined,
            reason,
        }))
    }
}
