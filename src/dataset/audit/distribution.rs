//! The distribution of rows over areas and displacements, and the check of a balanced dataset.

use serde::{Deserialize, Serialize};

use super::finding::{Finding, Severity};
use crate::{BinIndex, Bins};

/// A histogram with equal bins.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Distribution {
    /// Edges of the bins, one more than counts.
    pub edges: Vec<f64>,
    /// Rows in each bin.
    pub counts: Vec<u64>,
    /// Number of empty bins between the first and the last bin with rows.
    pub gaps: usize,
}

impl Distribution {
    /// Counts values in `count` bins from 0 to `high`. Larger values are ignored.
    #[must_use]
    pub fn of(values: impl Iterator<Item = f64>, high: f64, count: usize) -> Self {
        // The upper edge belongs to no bin, but the last bin must contain the largest value.
        let Ok(bins) = Bins::new(0.0, high.max(f64::MIN_POSITIVE).next_up(), count) else {
            return Self::default();
        };
        let mut counts = vec![0; count];
        for value in values {
            if let BinIndex::Bin(bin) = bins.index_of(value) {
                counts[bin] += 1;
            }
        }
        let has_rows = |count: &u64| *count > 0;
        let (first, last) = (counts.iter().position(has_rows), counts.iter().rposition(has_rows));
        let within = first.zip(last).map_or(&[][..], |(first, last)| &counts[first..=last]);
        Self {
            edges: (0..=count).map(|bin| bins.edge(bin)).collect(),
            gaps: within.iter().filter(|count| **count == 0).count(),
            counts,
        }
    }
}

/// The histograms that a balanced dataset declares.
#[derive(Clone, Debug, PartialEq)]
pub struct DeclaredBalance {
    /// Edges of the bins of the largest displacement, mm.
    pub edges: Vec<f64>,
    /// Rows available for each bin.
    pub available: Vec<u64>,
    /// Rows in each bin.
    pub counts: Vec<u64>,
    /// The level.
    pub level: f64,
}

impl DeclaredBalance {
    /// Returns the findings about the balance, given the largest displacements of the rows in mm.
    #[must_use]
    pub fn findings(&self, peaks: &[f64]) -> Vec<Finding> {
        let bins = self.counts.len();
        let error = |message: String| Finding::whole("balance", Severity::Error, message);
        if bins == 0 || self.edges.len() != bins + 1 || self.available.len() != bins {
            return vec![error(
                "the histograms of the balanced dataset differ in length".to_owned(),
            )];
        }
        let Ok(division) = Bins::new(self.edges[0], self.edges[bins], bins) else {
            return vec![error("the bins have no range".to_owned())];
        };
        let mut counts = vec![0_u64; bins];
        let mut outside = Vec::new();
        for (row, &peak) in peaks.iter().enumerate() {
            match division.index_of(peak) {
                BinIndex::Bin(bin) => counts[bin] += 1,
                BinIndex::Below | BinIndex::Above => outside.push(row),
            }
        }
        let mut findings = Vec::new();
        if !outside.is_empty() {
            let message = "the largest displacement lies outside the bins";
            findings.push(Finding::rows("balance", Severity::Error, &outside, message));
        }
        let moved: u64 = counts.iter().zip(&self.counts).map(|(a, b)| a.abs_diff(*b)).sum();
        // Another machine may have counted a row at an edge in the neighbouring bin.
        if moved > 2 {
            let rows = moved.div_ceil(2);
            findings.push(error(format!(
                "{rows} rows are not in the bins that they are counted in"
            )));
        }
        let uneven = |&bin: &usize| {
            let wanted = (self.available[bin] as f64).min(self.level);
            (counts[bin] as f64 - wanted).abs() > 1.0 + f64::from(u8::from(moved > 0))
        };
        let uneven: Vec<usize> = (0..bins).filter(uneven).collect();
        if !uneven.is_empty() {
            let message = format!(
                "{} of {bins} bins hold neither the level of {:.1} rows nor all that they could give: the dataset \
                 is not level",
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
    fn the_largest_value_is_in_the_last_bin_and_gaps_are_inside() {
        let found = Distribution::of([0.1, 0.9, 2.0].into_iter(), 2.0, 4);
        assert_eq!((found.counts, found.gaps), (vec![1, 1, 0, 1], 1));
        assert_eq!(Distribution::of(std::iter::empty(), 0.0, 3).gaps, 0);
    }

    #[test]
    fn a_balanced_dataset_has_no_finding_and_one_with_missing_rows_has() {
        let level = DeclaredBalance {
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
