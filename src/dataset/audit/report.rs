//! The report of an audit.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::confidence::excluded_above;
use super::distribution::Distribution;
use super::finding::Finding;
use super::labels::LabelCheck;
use super::resimulate::Resimulated;

/// The result of an audit.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Findings, errors first.
    pub findings: Vec<Finding>,
    /// Summary.
    pub summary: Summary,
    /// Result for each label.
    pub labels: Vec<LabelCheck>,
    /// Largest displacement of each row, mm; 0 without a field.
    pub peaks: Vec<f64>,
    /// Rows that were simulated on a finer mesh.
    pub resimulated: Vec<Resimulated>,
}

/// Summary of an audit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Number of rows.
    pub samples: usize,
    /// Numbers of the first rows without a field.
    pub not_converged: Vec<usize>,
    /// The declared or identified mesh of the fields.
    pub made_by: String,
    /// Number of labels that were solved again on their own mesh.
    pub solved_again: usize,
    /// Number of labels that were compared with an estimate.
    pub compared: usize,
    /// Number of outliers among these.
    pub suspects: usize,
    /// Number of outliers that were not solved again, because few of the others were wrong.
    #[serde(default)]
    pub unsolved: usize,
    /// Number of rows that repeat a pattern.
    pub repeats: usize,
    /// Number of orbits.
    pub orbits: usize,
    /// Number of rows by split.
    pub splits: BTreeMap<String, usize>,
    /// Distribution of the active part of the membrane.
    pub area: Distribution,
    /// Distribution of the largest displacement, mm.
    pub displacement: Distribution,
    /// Results on finer meshes.
    pub resimulated: Resimulation,
}

/// Results of random rows on finer meshes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Resimulation {
    /// Number of rows.
    pub samples: usize,
    /// Number of faulty rows.
    pub faults: usize,
    /// Upper bound of the rate of faults with 95 % confidence.
    pub excluded_above: f64,
    /// Largest error, mm.
    pub largest_error: Option<f64>,
    /// Mean error, mm.
    pub mean_error: Option<f64>,
    /// Largest allowed error, mm.
    pub allowed: Option<f64>,
}

impl Resimulation {
    /// Summarises the results of random rows among `n` rows with a field.
    #[must_use]
    pub fn of(rows: &[Resimulated], faults: usize, n: usize) -> Self {
        let errors: Vec<f64> = rows.iter().filter_map(|row| row.error).collect();
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        Self {
            samples: rows.len(),
            faults,
            excluded_above: excluded_above(n, rows.len(), faults),
            largest_error: errors.iter().copied().reduce(f64::max),
            mean_error: (!errors.is_empty()).then_some(mean),
            allowed: rows.iter().filter_map(|row| row.allowed).reduce(f64::max),
        }
    }
}
