//! Histograms of the largest displacements, one for each family of samples.

use crate::drawing::{Axis, Chart, Colour, EMPTY, FigureError, Series, Sheet, extent};

/// Bins of the common range.
const BINS: usize = 100;

/// The smallest range in mm, that of the source paper.
const RANGE: f64 = 2.5;

/// Width and height of a histogram on a sheet of its own.
const SIZE: [f64; 2] = [716.0, 190.0];

/// The largest displacements of the samples of one family.
#[derive(Clone, Debug)]
pub struct FamilyDeformation {
    /// The family.
    pub family: String,
    /// Largest displacement magnitude of each sample in mm.
    pub peaks: Vec<f64>,
}

impl FamilyDeformation {
    /// Describes number, range and mean.
    fn numbers(&self) -> String {
        let (low, high) = extent(&self.peaks, EMPTY);
        let mean = self.peaks.iter().sum::<f64>() / self.peaks.len() as f64;
        let samples = if self.peaks.len() == 1 { "sample" } else { "samples" };
        format!(
            "{} {samples}, {low:.2} to {high:.2} mm, mean {mean:.2} mm",
            self.peaks.len()
        )
    }

    fn counts(&self, top: f64) -> Vec<u64> {
        let mut counts = vec![0; BINS];
        for peak in &self.peaks {
            counts[((peak / top * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        counts
    }
}

/// Draws one histogram per family, over the same range.
///
/// # Errors
/// If there is no family, one has no sample, or a displacement is negative or not finite.
pub fn deformation_charts(families: &[FamilyDeformation]) -> Result<Vec<Chart>, FigureError> {
    let peaks = || families.iter().flat_map(|family| &family.peaks);
    if families.is_empty() || families.iter().any(|family| family.peaks.is_empty()) {
        return Err(FigureError::Data("a family has no sample".into()));
    }
    if peaks().any(|peak| !(peak.is_finite() && *peak >= 0.0)) {
        return Err(FigureError::Data("a displacement is negative or not finite".into()));
    }
    // Half millimetres, so that the axis ends at a round number.
    let (_, farthest) = extent(peaks(), (0.0, 0.0));
    let top = RANGE.max((2.0 * farthest).ceil() / 2.0);
    let edges: Vec<f64> = (0..=BINS).map(|bin| top * bin as f64 / BINS as f64).collect();
    let chart = |family: &FamilyDeformation| {
        let counts = family.counts(top);
        let x = Axis::linear("Largest displacement [mm]", 0.0, top);
        let y = Axis::counts("Samples per bin", &counts);
        let bars = Series::bars("", Colour::Sky, &edges, &counts);
        Chart::new(format!("Histogram of {}", family.family), [x, y], vec![bars]).with_note(family.numbers())
    };
    Ok(families.iter().map(chart).collect())
}

/// Draws the histograms one below the other.
///
/// # Errors
/// As `deformation_charts`.
pub fn deformation_sheet(families: &[FamilyDeformation]) -> Result<Sheet, FigureError> {
    let charts = deformation_charts(families)?.into_iter();
    let charts: Vec<Chart> = charts.map(|chart| chart.with_size(SIZE)).collect();
    Ok(Sheet::charts(1, &charts))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_title_has_number_range_and_mean() {
        let family = FamilyDeformation {
            family: "bezier".into(),
            peaks: vec![1.5, 2.0, 1.75, 1.951],
        };
        let chart = &deformation_charts(&[family]).unwrap()[0];
        let title = format!("{}: {}", chart.title, chart.note);
        assert_eq!(title, "Histogram of bezier: 4 samples, 1.50 to 2.00 mm, mean 1.80 mm");
    }

    #[test]
    fn every_sample_is_in_a_bin() {
        let family = FamilyDeformation {
            family: "x".into(),
            peaks: vec![0.0, 0.01, 1.26, 2.5],
        };
        let counts = family.counts(2.5);
        assert_eq!((counts[0], counts[50], counts[99]), (2, 1, 1));
        assert_eq!(counts.iter().sum::<u64>(), 4);
    }
}
