//! What an audit says beside its findings.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::finding::{Finding, Severity};
use super::labels::LabelCheck;
use super::resimulate::Resimulated;
use super::spread::Spread;

/// The outcome of an audit.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// What is wrong, errors first.
    pub findings: Vec<Finding>,
    /// What was looked at, and what it says.
    pub summary: Summary,
    /// What is known of each label.
    pub labels: Vec<LabelCheck>,
    /// Largest displacement of each row, mm; 0 without a field.
    pub peaks: Vec<f64>,
    /// The rows that were simulated on a finer mesh.
    pub resimulated: Vec<Resimulated>,
}

impl Report {
    /// Whether a finding is an error.
    #[must_use]
    pub fn has_errors(&self) -> bool {
        self.findings.iter().any(|finding| finding.severity == Severity::Error)
    }
}

/// What was looked at, and what it says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Rows.
    pub samples: usize,
    /// Rows without a field, by number; the first only.
    pub not_converged: Vec<usize>,
    /// How the fields were found: the mesh, as declared or found out.
    pub made_by: String,
    /// Labels that were solved again on their own mesh.
    pub solved_again: usize,
    /// Labels that were compared with an estimate.
    pub compared: usize,
    /// Outliers among these, solved again on their own mesh.
    pub suspects: usize,
    /// Outliers that were not: among so many, few of the others were wrong.
    #[serde(default)]
    pub unsolved: usize,
    /// Rows that repeat a pattern.
    pub repeats: usize,
    /// Patterns that are different under the symmetries.
    pub orbits: usize,
    /// Rows by part of the dataset.
    pub splits: BTreeMap<String, usize>,
    /// Active part of the membrane.
    pub area: Spread,
    /// Largest displacement, mm.
    pub displacement: Spread,
    /// Rows that were simulated on a finer mesh.
    pub resimulated: Resimulation,
}

/// What rows on a finer mesh say.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Resimulation {
    /// How many.
    pub samples: usize,
    /// How many of them are at fault.
    pub faults: usize,
    /// Rates of faults above this are excluded at 95 %.
    pub excluded_above: f64,
    /// Largest error, mm.
    pub largest_error: Option<f64>,
    /// Mean error, mm.
    pub mean_error: Option<f64>,
    /// Largest error that is declared, mm.
    pub allowed: Option<f64>,
}

impl Resimulation {
    /// Of `n` rows that have a field.
    #[must_use]
    pub fn of(rows: &[Resimulated], faults: usize, n: usize) -> Self {
        let largest = |values: &mut dyn Iterator<Item = f64>| values.reduce(f64::max);
        let errors: Vec<f64> = rows.iter().filter_map(|row| row.error).collect();
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        Self {
            samples: rows.len(),
            faults,
            excluded_above: super::confidence::excluded_above(n, rows.len(), faults),
            largest_error: largest(&mut errors.iter().copied()),
            mean_error: (!errors.is_empty()).then_some(mean),
            allowed: largest(&mut rows.iter().filter_map(|row| row.allowed)),
        }
    }
}
