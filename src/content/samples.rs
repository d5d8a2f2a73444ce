//! The artifact of a sample or a patterns stage.

use super::macros::arrays;
use deaflow_pattern::Pattern;

/// The kinds of stages whose artifacts these are.
pub const SAMPLED: [&str; 2] = ["sample", "patterns"];

/// The family of patterns that no family has drawn: they come from a file.
pub const FROM_FILE: &str = "file";

arrays! {
    /// Patterns that were drawn, or read from files.
    #[derive(Default)]
    pub struct Samples, SamplesView {
        /// The patterns and where they come from.
        rows: SampleRows = group(""),
        /// Area fraction of the electrode.
        area: Vec<f64> = array("area", "1", [sample]),
    }
}

arrays! {
    /// Which patterns these are.
    #[derive(Default)]
    pub struct SampleRows, SampleRowsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// Family that the pattern was drawn from; `file` where it was read from one.
        family: Vec<String> = array("family", "", [sample]),
        /// Number of the sample within its family, parameters and seed; of one from a file its place among all of the stage.
        index: Vec<u64> = array("index", "1", [sample]),
        /// Units across the membrane (large-grid), 0 elsewhere.
        units: Vec<u64> = array("units", "1", [sample]),
    }
}

impl SampleRows {
    /// Some of the rows, in the order of their numbers.
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
