//! The artifact of a sample or a patterns stage.

use super::macros::arrays;
use deaflow_pattern::Pattern;

/// The kinds of stages with this artifact.
pub const SAMPLED: [&str; 2] = ["sample", "patterns"];

/// The family of patterns from files.
pub const FROM_FILE: &str = "file";

arrays! {
    /// Patterns that were sampled or read from files.
    #[derive(Default)]
    pub struct Samples, SamplesView {
        /// The patterns and their origin.
        rows: SampleRows = group(""),
        /// Electrode area, a share of the free membrane.
        area: Vec<f64> = array("area", "1", [sample]),
    }
}

arrays! {
    /// Patterns and their origin.
    #[derive(Default)]
    pub struct SampleRows, SampleRowsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// Family of the pattern; `file` if it was read from a file.
        family: Vec<String> = array("family", "", [sample]),
        /// Number of the sample within its family, parameters and seed; for a pattern from a file its number in the
        /// stage.
        index: Vec<u64> = array("index", "1", [sample]),
        /// Units across the membrane for the family large-grid, 0 for others.
        units: Vec<u64> = array("units", "1", [sample]),
    }
}

impl SampleRows {
    /// Returns some of the rows, in the order of `rows`.
    #[must_use]
    pub fn select(&self, rows: &[usize]) -> Self {
        Self {
            patterns: rows.iter().map(|&row| self.patterns[row].clone()).collect(),
            family: rows.iter().map(|&row| self.family[row].clone()).collect(),
            index: rows.iter().map(|&row| self.index[row]).collect(),
            units: rows.iter().map(|&row| self.units[row]).collect(),
        }
    }
}
