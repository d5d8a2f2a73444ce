//! How far the samples of each family move: the raw histograms that a dataset is made from.

use std::path::Path;

use plotters::prelude::*;

use super::axes::{Axis, panel};
use super::canvas::{FigureError, draw, palette};

/// Bins over the common range.
const BINS: usize = 100;

/// The range in mm unless something moves farther: that of the source paper.
const RANGE: f64 = 2.5;

/// The largest displacements of the samples of one family.
#[derive(Clone, Debug)]
pub struct FamilyDeformation {
    /// The family.
    pub family: String,
    /// Largest displacement magnitude of each sample in mm.
    pub peaks: Vec<f64>,
}

impl FamilyDeformation {
    /// Family, number, range and mean.
    fn title(&self) -> String {
        let (low, high) = self
            .peaks
            .iter()
            .fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), p| (l.min(*p), h.max(*p)));
        let mean = self.peaks.iter().sum::<f64>() / self.peaks.len() as f64;
        let samples = if self.peaks.len() == 1 { "sample" } else { "samples" };
        format!(
            "{}: {} {samples}, {low:.2} to {high:.2} mm, mean {mean:.2} mm",
            self.family,
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

/// Draws one histogram per family, one below the other, over the same range.
///
/// # Errors
/// When there is no family, one has no sample or a displacement that is no length, or the file cannot be written.
pub fn draw_deformation(path: &Path, families: &[FamilyDeformation]) -> Result<(), FigureError> {
    let peaks = || families.iter().flat_map(|family| &family.peaks);
    if families.is_empty() || families.iter().any(|family| family.peaks.is_empty()) {
        return Err(FigureError::Data("a family has no sample".into()));
    }
    if peaks().any(|peak| !(peak.is_finite() && *peak >= 0.0)) {
        return Err(FigureError::Data("a displacement is not a length".into()));
    }
    // Half millimetres above the farthest, so that the axis ends at a round number.
    let farthest = peaks().fold(0.0, |a: f64, b| a.max(*b));
    let top = RANGE.max((2.0 * farthest).ceil() / 2.0);
    draw(path, (1200, 400 * families.len() as u32), |sheet| {
        for (area, family) in sheet.split_evenly((families.len(), 1)).iter().zip(families) {
            let counts = family.counts(top);
            let most = counts.iter().max().copied().unwrap_or(0);
            let x = Axis::linear("Largest displacement [mm]", 0.0, top);
            let y = Axis::counting("Samples per bin", 0.0, (1.08 * most as f64).max(1.0));
            let mut panel = panel(area, &family.title(), &[], &x, &y)?;
            let edge = |bin: usize| top * bin as f64 / BINS as f64;
            let bars = counts.iter().enumerate().filter(|(_, count)| **count > 0);
            panel.draw_series(bars.map(|(bin, count)| {
                Rectangle::new(
                    [(edge(bin), 0.0), (edge(bin + 1), *count as f64)],
                    palette::SKY.filled(),
                )
            }))?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_title_says_number_range_and_mean() {
        let family = FamilyDeformation {
            family: "bezier".into(),
            peaks: vec![1.5, 2.0, 1.75, 1.951],
        };
        assert_eq!(family.title(), "bezier: 4 samples, 1.50 to 2.00 mm, mean 1.80 mm");
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
