//! The tables of artifacts that were looked at last.

use std::sync::Arc;

use super::judged::{by_predictor, sources};
use super::kept::Kept;
use crate::http::Refusal;
use deaflow_base::ArtifactId;
use deaflow_pattern::Raster;
use deaflow_report::{RowColumn, Rows};
use deaflow_store::{Artifact, Content, Data, Store};

/// Tables that are kept: a person looks at few artifacts at a time.
const KEPT: usize = 6;

/// By what a table is known: its artifact, and its axis where one was named.
type Key = (ArtifactId, Option<String>);

/// Tables that were looked at last. An artifact never changes, so neither does its table.
pub struct Tables(Kept<Key, Rows>);

impl Default for Tables {
    fn default() -> Self {
        Self(Kept::new(KEPT))
    }
}

impl Tables {
    /// The table of an artifact, along an axis where one is named.
    ///
    /// # Errors
    /// When it has none, or cannot be read.
    pub fn of(&self, store: &Store, artifact: &Artifact, along: Option<&str>) -> Result<Arc<Rows>, Refusal> {
        let key = (artifact.digest(), along.map(str::to_owned));
        if let Some(known) = self.0.get(&key) {
            return Ok(known);
        }
        let mut rows = Rows::of(artifact, along)?;
        if let Some(area) = area(artifact, &rows)? {
            rows.columns.push(area);
        }
        let judged = by_predictor(artifact, &rows)?;
        rows.columns.extend(judged);
        let sources = sources(store, artifact, &rows)?;
        rows.columns.extend(sources);
        let rows = Arc::new(rows);
        self.0.put(key, &rows);
        Ok(rows)
    }
}

/// The area fraction of each pattern, where there are patterns and the artifact does not say it.
fn area(artifact: &Artifact, rows: &Rows) -> Result<Option<RowColumn>, Refusal> {
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
    let share = |cells: &[u8]| cells.iter().filter(|&&cell| cell != 0).count() as f64 / raster.cells() as f64;
    Ok(Some(RowColumn {
        name: "area".to_owned(),
        description: "Area fraction of the electrode.".to_owned(),
        values: Data::F64(cells.chunks(raster.cells()).map(share).collect()),
    }))
}
