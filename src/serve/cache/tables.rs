//! The most recently used tables of artifacts.

use std::sync::Arc;

use super::evaluation_columns::{by_predictor, source_rows};
use super::lru::LruCache;
use crate::http::ApiError;
use deaflow_base::ArtifactId;
use deaflow_content::StoredAttribute;
use deaflow_pattern::{Pattern, Raster};
use deaflow_report::{RowColumn, Rows};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Content, Data, Store};

/// Number of tables kept.
const MAX_TABLES: usize = 6;

/// The artifact of a table, and its axis if the request names one.
type TableKey = (ArtifactId, Option<String>);

/// The most recently used tables. An artifact never changes, so its table does not either.
pub struct TableCache(LruCache<TableKey, Rows>);

impl Default for TableCache {
    fn default() -> Self {
        Self(LruCache::new(MAX_TABLES))
    }
}

impl TableCache {
    /// Returns the table of an artifact, along an axis if one is named.
    ///
    /// # Errors
    /// If it has no table, or cannot be read.
    pub fn table(&self, store: &Store, artifact: &Artifact, along: Option<&str>) -> Result<Arc<Rows>, ApiError> {
        let key = (artifact.digest(), along.map(str::to_owned));
        self.0.get_or_insert(&key, || {
            let mut rows = Rows::of(artifact, along)?;
            rows.columns.extend(area(artifact, &rows)?);
            rows.columns.extend(by_predictor(artifact, &rows)?);
            rows.columns.extend(source_rows(store, artifact, &rows)?);
            Ok(rows)
        })
    }
}

/// Computes the area fraction of each pattern, if there are patterns and no array has it.
fn area(artifact: &Artifact, rows: &Rows) -> Result<Option<RowColumn>, ApiError> {
    let is_known = |column: &RowColumn| column.name == "area" || column.name.ends_with("/area");
    let is_pattern =
        |content: &&Content| content.axes.len() == 3 && content.axes[0] == rows.axis && content.axes[1..] == ["y", "x"];
    if rows.columns.iter().any(is_known) {
        return Ok(None);
    }
    let Some(content) = artifact.contents()?.iter().find(is_pattern) else {
        return Ok(None);
    };
    let (shape, cells) = artifact.u8s(&content.path)?;
    let Some(raster) = Raster::new(shape[2], shape[1]).filter(|_| shape[0] == rows.len()) else {
        return Ok(None);
    };
    let scene: Option<Scene> = StoredAttribute::new(artifact, "scene").read()?;
    let free = scene.and_then(|scene| scene.free_cells());
    let fraction = |cells: &[u8]| {
        let columns = raster.columns();
        Pattern::from_groups(raster, |x, y| cells[y * columns + x]).area_fraction(free.as_ref())
    };
    Ok(Some(RowColumn {
        name: "area".to_owned(),
        description: "Electrode area, a share of the free membrane.".to_owned(),
        values: Data::F64(cells.chunks(raster.cells()).map(fraction).collect()),
    }))
}
