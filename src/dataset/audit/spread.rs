//! How the rows are spread: what a dataset covers, and whether a balanced one is level.

use serde::{Deserialize, Serialize};

use super::finding::{Finding, Severity};
use crate::{Bins, Place};

/// Counts by equal bins.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Edges of the bins; one more than counts.
    pub edges: Vec<f64>,
    /// Rows in each bin.
    pub counts: Vec<u64>,
    /// Empty bins between the first and the last that hold anything.
    pub gaps: usize,
}

impl Spread {
    /// The spread of values over `count` bins from 0 to `high`; what lies above is left out.
    #[must_use]
    pub fn of(values: impl Iterator<Item = f64>, high: f64, count: usize) -> Self {
        // The upper edge belongs to no bin, and the largest value is to lie in one.
        let Ok(bins) = Bins::new(0.0, high.max(f64::MIN_POSITIVE).next_up(), count) else {
            return Self::default();
        };
        let mut counts = vec![0; count];
        for value in values {
            if let Place::Bin(bin) = bins.place(value) {
                counts[bin] += 1;
            }
        }
        let held = |count: &u64| *count > 0;
        let (first, last) = (counts.iter().position(held), counts.iter().rposition(held));
        let within = first.zip(last).map_or(&[][..], |(first, last)| &counts[first..=last]);
        Self {
            edges: (0..=count).map(|bin| bins.edge(bin)).collect(),
            gaps: within.iter().filter(|count| **count == 0).count(),
            counts,
        }
    }
}

/// What a balanced dataset says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// Edges of the bins of the largest displacement, mm.
    pub edges: Vec<f64>,
    /// Rows that each bin could give.
    pub available: Vec<u64>,
    /// Rows that each bin is said to hold.
    pub counts: Vec<u64>,
    /// The level.
    pub level: f64,
}

impl Level {
    /// What is wrong with the level, given the largest displacements of the rows in mm.
    #[must_use]
    pub fn findings(&self, peaks: &[f64]) -> Vec<Finding> {
        let bins = self.counts.len();
        if bins == 0 || self.edges.len() != bins + 1 || self.available.len() != bins {
            return vec![Finding::whole(
                "balance",
                Severity::Error,
                "the histograms of the balanced dataset differ in length",
            )];
        }
        let Ok(division) = Bins::new(self.edges[0], self.edges[bins], bins) else {
            return vec![Finding::whole("balance", Severity::Error, "the bins have no range")];
        };
        let mut counts = vec![0_u64; bins];
        let mut outside = Vec::new();
        for (row, &peak) in peaks.iter().enumerate() {
            match division.place(peak) {
                Place::Bin(bin) => counts[bin] += 1,
                Place::Below | Place::Above => outside.push(row),
            }
        }
        let mut findings = Vec::new();
        if !outside.is_empty() {
            let message = "the largest displacement lies outside the bins";
            findings.push(Finding::rows("balance", Severity::Error, &outside, message));
        }
        let moved: u64 = counts.iter().zip(&self.counts).map(|(a, b)| a.abs_diff(*b)).sum();
        // A row on an edge may have been put on its other side, by another machine.
        if moved > 2 {
            let message = format!(
                "{} rows are not in the bins that they are counted in",
                moved.div_ceil(2)
            );
            findings.push(Finding::whole("balance", Severity::Error, message));
        }
        let uneven = |&bin: &usize| {
            let wanted = (self.available[bin] as f64).min(self.level);
            (counts[bin] as f64 - wanted).abs() > 1.0 + f64::from(u8::from(moved > 0))
        };
        let uneven: Vec<usize> = (0..bins).filter(uneven).collect();
        if !uneven.is_empty() {
            let message = format!(
                "{} of {bins} bins hold neither the level of {:.1} rows nor all that they could give: the dataset is not level",
                uneven.len(),
                self.level
            );
            findings.push(Finding::whole("balance", Severity::Warning, message));
        }
        findings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_value_lies_in_the_last_bin_and_gaps_are_inside() {
        let spread = Spread::of([0.1, 0.9, 2.0].into_iter(), 2.0, 4);
        assert_eq!((spread.counts, spread.gaps), (vec![1, 1, 0, 1], 1));
        assert_eq!(Spread::of(std::iter::empty(), 0.0, 3).gaps, 0);
    }

    #[test]
    fn a_level_dataset_gives_no_finding_and_one_that_lost_rows_does() {
        let level = Level {
            edges: vec![0.0, 1.0, 2.0, 3.0],
            available: vec![9, 2, 40],
            counts: vec![5, 2, 5],
            level: 5.0,
        };
        let peaks = [vec![0.5; 5], vec![1.5; 2], vec![2.5; 5]].concat();
        assert_eq!(level.findings(&peaks), []);
        let fewer = &peaks[4..];
        let found = level.findings(fewer);
        let kinds: Vec<Severity> = found.iter().map(|f| f.severity).collect();
        assert_eq!(kinds, [Severity::Error, Severity::Warning], "{found:?}");
        assert_eq!(level.findings(&[7.0])[0].examples, [0]);
    }
}
