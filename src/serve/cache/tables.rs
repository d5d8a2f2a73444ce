//! The most recently used tables of artifacts.

use std::sync::Arc;

use super::evaluation_columns::{by_predictor, source_rows};
use super::lru::LruCache;
use crate::artifact_data::elements;
use crate::http::ApiError;
use deaflow_base::ArtifactId;
use deaflow_content::StoredAttribute;
use deaflow_pattern::{Coverage, Pattern, Raster};
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
    let is_pattern = |content: &&Content| {
        content.axes.len() == 3
            && content.axes[0] == rows.axis
            && content.axes[1..] == ["y", "x"]
            && !content.path.starts_with("covered/")
    };
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
    let patterns = match artifact.contents()?.iter().any(|content| content.path == SHARES) {
        true => covered(artifact, raster, shape[0])?,
        false => {
            let columns = raster.columns();
            let pattern = |cells: &[u8]| Pattern::from_groups(raster, |x, y| cells[y * columns + x]);
            cells.chunks(raster.cells()).map(pattern).collect()
        }
    };
    let fractions = patterns.iter().map(|pattern| pattern.area_fraction(free.as_ref()));
    Ok(Some(RowColumn {
        name: "area".to_owned(),
        description: "Electrode area, a share of the free membrane.".to_owned(),
        values: Data::F64(fractions.collect()),
    }))
}

/// The array of the shares of cells that are covered in part.
const SHARES: &str = "covered/share";

/// Returns the patterns of an artifact with cells that are covered in part.
fn covered(artifact: &Artifact, raster: Raster, count: usize) -> Result<Vec<Pattern>, ApiError> {
    let damaged = |why: String| ApiError::new(409, format!("the covered shares of cells cannot be used: {why}"));
    let (Data::F64(shares), Data::U8(groups)) = (
        elements(artifact, SHARES, 0..count)?,
        elements(artifact, "covered/group", 0..count)?,
    ) else {
        return Err(damaged("they have other types".to_owned()));
    };
    let rows = shares.chunks(raster.cells()).zip(groups.chunks(raster.cells()));
    let pattern = |(shares, groups): (&[f64], &[u8])| {
        let coverage = Coverage::new(raster, groups, shares).map_err(|error| damaged(error.to_string()))?;
        Ok(Pattern::of_coverage(coverage))
    };
    rows.map(pattern).collect()
}
