//! Single rows of an audited dataset, to be shown.

use std::path::Path;

use super::source::Source;
use deaflow_content::Audit;
use deaflow_dataset::audit::RowSource;
use deaflow_scene::Scene;
use deaflow_store::{Artifact, StoreError};

/// The dataset that was audited.
#[derive(Clone, Copy)]
pub enum Audited<'a> {
    /// A file from elsewhere.
    File(&'a Path),
    /// The artifact of a stage.
    Artifact(&'a Artifact),
}

/// Access to the rows of an audited dataset.
pub struct SourceRows {
    source: Source,
    /// The scene of the audit.
    pub scene: Scene,
}

impl SourceRows {
    /// Returns the cells and displacements of a row, or `None` if they are not numbers.
    #[must_use]
    pub fn row(&self, index: usize) -> Option<(Vec<u8>, Vec<f64>)> {
        let batch = self.source.read(index..index + 1).ok()?;
        let cells = batch.cells.iter().map(|&cell| cell as u8).collect();
        // An incomplete field cannot be drawn.
        let numbers = !batch.displacement.is_empty() && batch.displacement.iter().all(|u| u.is_finite());
        numbers.then_some((cells, batch.displacement))
    }
}

/// Opens the rows of an audited dataset.
///
/// # Errors
/// If they cannot be read.
pub fn rows(dataset: Audited<'_>, audit: &Audit) -> Result<SourceRows, StoreError> {
    let raster = audit.scene.membrane().raster;
    let source = match dataset {
        Audited::File(path) => Source::of_file(path, raster),
        Audited::Artifact(artifact) => Source::of_artifact(artifact, raster),
    };
    Ok(SourceRows {
        scene: audit.scene.clone(),
        source: source?,
    })
}
