//! Errors of a trained network on the rows of its own datasets.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};

use crate::artifact_data::{cells_of, inputs_of, labels, patterns};
use crate::http::ApiError;
use deaflow_base::{ArtifactId, is_interrupted};
use deaflow_content::{ALL_FAMILIES, ArtifactKind, Balanced};
use deaflow_dataset::Split;
use deaflow_field::Predictor;
use deaflow_pattern::Pattern;
use deaflow_store::{Artifact, Store, StoreError};
use deaflow_surrogate::{PatternScore, Score, Surrogate};

/// Patterns that are predicted; an `evaluate` stage has no such limit.
const MAX_PATTERNS: usize = 20_000;

/// Rows of each family with the smallest errors that are returned, for comparison with the largest ones.
const BEST_ROWS: usize = 3;

/// Rows of a dataset that are read at a time: 42 MB of fields on 50 × 50 cells.
const BLOCK: usize = 1024;

/// Errors of a network on a part of its own datasets.
pub struct ModelErrors {
    network: &'static str,
    split: Split,
    sets: Vec<ArtifactId>,
    /// From the largest error.
    rows: Vec<RowError>,
    /// Rows of that part; those beyond [`MAX_PATTERNS`] are not predicted.
    total: usize,
    /// The largest displacements of the training rows in mm, in ascending order.
    learned: Vec<f64>,
    /// Number of training rows of each family.
    families: BTreeMap<String, usize>,
}

/// The error of a row.
struct RowError {
    set: ArtifactId,
    row: usize,
    family: String,
    area: f64,
    score: PatternScore,
}

impl ModelErrors {
    /// Predicts the rows of a part of the datasets that a model was trained on.
    ///
    /// # Errors
    /// If the model was not trained on a balanced dataset, or it is not in the store.
    pub fn of(store: &Store, model: &Artifact, network: &Surrogate, split: Split) -> Result<Self, ApiError> {
        let mut found = Self {
            network: network.kind().name(),
            split,
            sets: Vec::new(),
            rows: Vec::new(),
            total: 0,
            learned: Vec::new(),
            families: BTreeMap::new(),
        };
        for set in Self::training_sets(store, model)? {
            found.add(&set, network)?;
        }
        found.learned.sort_by(f64::total_cmp);
        let error = |row: &RowError| row.score.max_error_mm;
        found.rows.sort_by(|a, b| error(b).total_cmp(&error(a)));
        Ok(found)
    }

    fn add(&mut self, set: &Artifact, network: &Surrogate) -> Result<(), ApiError> {
        let view = Balanced::open(set)?;
        let (families, splits, moved) = (
            view.family().read()?,
            view.split().read()?,
            view.max_displacement().read()?,
        );
        self.sets.push(set.digest());
        for (row, split) in splits.iter().enumerate() {
            if split == Split::Train.name() {
                self.learned.push(moved[row]);
                *self.families.entry(families[row].clone()).or_default() += 1;
            }
        }
        let (path, [count, _, _]) = patterns(set)?;
        let cells = network.form().raster.cells();
        let free = view.scene().read()?.free_cells();
        for start in (0..count).step_by(BLOCK) {
            if is_interrupted() {
                return Err(ApiError::new(408, "the request was interrupted"));
            }
            let block = start..(start + BLOCK).min(count);
            let mut rows: Vec<usize> = block.clone().filter(|&row| splits[row] == self.split.name()).collect();
            self.total += rows.len();
            rows.truncate(MAX_PATTERNS - self.rows.len());
            if rows.is_empty() {
                continue;
            }
            let read = cells_of(set, &path, block.clone())?;
            let labels = labels(set, &path, network.form(), block)?;
            let of_row = |&row: &usize| Pattern::of_form(network.form(), &read[(row - start) * cells..][..cells]);
            let selected: Vec<Pattern> = rows.iter().map(of_row).collect::<Result<_, _>>()?;
            let predicted = network.predict(&selected)?;
            for ((row, pattern), field) in rows.into_iter().zip(&selected).zip(&predicted) {
                self.rows.push(RowError {
                    set: set.digest(),
                    row,
                    family: families[row].clone(),
                    area: pattern.area_fraction(free.as_ref()),
                    score: PatternScore::of(field, &labels[row - start]),
                });
            }
        }
        Ok(())
    }

    /// Returns the errors by family, and the rows with the largest errors.
    #[must_use]
    pub fn document(&self, limit: usize) -> Value {
        let named: BTreeSet<&str> = self.rows.iter().map(|row| row.family.as_str()).collect();
        let family = |family: &str| {
            let is_own = |own: &str| family == ALL_FAMILIES || own == family;
            let scores = self.rows.iter().filter(|row| is_own(&row.family)).map(|row| &row.score);
            let learned = self
                .families
                .iter()
                .filter(|(own, _)| is_own(own))
                .map(|(_, count)| count);
            Score::of(scores).map(|score| {
                json!({
                    "family": family,
                    "samples": score.samples,
                    "learned": learned.sum::<usize>(),
                    "rmse_mm": score.rmse_mm,
                    "max_error_mm": score.max_error_mm,
                })
            })
        };
        let best = |family: &&str| -> Vec<Value> {
            let own = self.rows.iter().rev().filter(|row| row.family == **family);
            own.take(BEST_ROWS)
                .map(|row| json!({ "set": row.set.to_string(), "row": row.row, "family": row.family }))
                .collect()
        };
        let row = |row: &RowError| {
            let mut document = score_document(&row.score);
            document["set"] = json!(row.set.to_string());
            document["row"] = json!(row.row);
            document["family"] = json!(row.family);
            document["area"] = json!(row.area);
            let below = self
                .learned
                .partition_point(|moved| *moved < row.score.simulated_max_mm);
            document["moves_more_than"] =
                json!((!self.learned.is_empty()).then(|| below as f64 / self.learned.len() as f64));
            document
        };
        json!({
            "network": self.network,
            "split": self.split.name(),
            "best": named.iter().flat_map(best).collect::<Vec<_>>(),
            "sets": self.sets.iter().map(ArtifactId::to_string).collect::<Vec<_>>(),
            "judged": self.rows.len(),
            "total": self.total,
            "learned": self.learned.len(),
            "families": named.into_iter().chain([ALL_FAMILIES]).filter_map(family).collect::<Vec<_>>(),
            "rows": self.rows.iter().take(limit).map(row).collect::<Vec<_>>(),
        })
    }

    /// Returns the balanced datasets that a model was trained on, at least one.
    ///
    /// # Errors
    /// If there is none, or it is not in the store.
    pub fn training_sets(store: &Store, model: &Artifact) -> Result<Vec<Artifact>, ApiError> {
        let mut found = Vec::new();
        for digest in inputs_of(model)? {
            match store.artifact(&digest) {
                Ok(input) if ArtifactKind::Balance.is_of(&input) => found.push(input),
                Ok(_) => {}
                Err(StoreError::Missing { .. }) => {
                    let message = format!("the training dataset {} is not in the store", digest.short());
                    return Err(ApiError::not_found(message).help("`deaflow run` builds it again"));
                }
                Err(error) => return Err(error.into()),
            }
        }
        match found.is_empty() {
            false => Ok(found),
            true => Err(
                ApiError::not_found("the model was not trained on a balanced dataset, so it has no test rows")
                    .help("use an `evaluate` stage"),
            ),
        }
    }
}

/// Returns the errors of one pattern as a document.
#[must_use]
pub fn score_document(score: &PatternScore) -> Value {
    json!({
        "rms_mm": score.rms_mm,
        "max_error_mm": score.max_error_mm,
        "predicted_max_mm": score.predicted_max_mm,
        "simulated_max_mm": score.simulated_max_mm,
    })
}
