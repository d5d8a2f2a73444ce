//! How deformations are spread over the samples, before and after balancing.

use std::path::Path;

use plotters::prelude::*;

use super::axes::{Axis, Panel, panel};
use super::canvas::{FigureError, draw, palette, px};

/// Counts of samples by their largest displacement.
#[derive(Clone, Debug)]
pub struct Histogram {
    /// Bin edges in mm; one more than bins.
    pub edges: Vec<f64>,
    /// Samples as solved.
    pub before: Vec<u64>,
    /// With the images, by rotation and mirror, that sparse bins are given.
    pub augmented: Vec<u64>,
    /// After levelling, without images: samples as they were drawn.
    pub levelled: Vec<u64>,
    /// After levelling, with images: what the surrogate is trained on.
    pub after: Vec<u64>,
}

impl Histogram {
    fn validate(&self) -> Result<(), FigureError> {
        let bins = self.before.len();
        let counts = [&self.augmented, &self.levelled, &self.after];
        let matching = self.edges.len() == bins + 1 && counts.iter().all(|counts| counts.len() == bins);
        let rising = self.edges.windows(2).all(|pair| pair[0] < pair[1]);
        if bins > 0 && matching && rising {
            return Ok(());
        }
        Err(FigureError::Data(
            "a histogram needs rising edges and one count per bin".into(),
        ))
    }

    fn axes(&self, counts: &[&[u64]]) -> (Axis, Axis) {
        let most = counts.iter().copied().flatten().max().copied().unwrap_or(0);
        let x = Axis::linear(
            "Largest displacement [mm]",
            self.edges[0],
            self.edges[self.before.len()],
        );
        (x, Axis::counting("Samples per bin", 0.0, (1.08 * most as f64).max(1.0)))
    }

    fn bars(&self, panel: &mut Panel<'_>, counts: &[u64], colour: RGBColor) -> Result<(), FigureError> {
        let bars = counts.iter().zip(self.edges.windows(2));
        let bars = bars.filter(|(count, _)| **count > 0);
        panel.draw_series(
            bars.map(|(count, edge)| Rectangle::new([(edge[0], 0.0), (edge[1], *count as f64)], colour.filled())),
        )?;
        Ok(())
    }

    fn outline(&self, counts: &[u64]) -> Vec<(f64, f64)> {
        let tops = counts.iter().zip(self.edges.windows(2));
        tops.flat_map(|(count, edge)| [(edge[0], *count as f64), (edge[1], *count as f64)])
            .collect()
    }
}

/// Draws the histograms as solved, levelled, and levelled with images, side by side.
///
/// # Errors
/// When the counts do not fit the edges, or the file cannot be written.
pub fn draw_histogram(path: &Path, data: &Histogram) -> Result<(), FigureError> {
    data.validate()?;
    let total = |counts: &[u64]| counts.iter().sum::<u64>();
    draw(path, (1800, 620), |sheet| {
        let thirds = sheet.split_evenly((1, 3));
        let (x, y) = data.axes(&[&data.before, &data.augmented]);
        let title = format!("As solved: {} samples", total(&data.before));
        let images = palette::VERMILLION;
        let entries = [("solved", palette::SKY), ("with rotated and mirrored images", images)];
        let mut left = panel(&thirds[0], &title, &entries, &x, &y)?;
        data.bars(&mut left, &data.before, palette::SKY)?;
        left.draw_series(LineSeries::new(
            data.outline(&data.augmented),
            images.stroke_width(px(2)),
        ))?;

        let (x, y) = data.axes(&[&data.after]);
        let title = format!("Levelled: {} samples", total(&data.levelled));
        let entries = [("as drawn", palette::BLUE)];
        let mut middle = panel(&thirds[1], &title, &entries, &x, &y)?;
        data.bars(&mut middle, &data.levelled, palette::BLUE)?;

        let title = format!("Augmented and levelled: {} samples", total(&data.after));
        let entries = [("as drawn", palette::BLUE), ("images", palette::ORANGE)];
        let mut right = panel(&thirds[2], &title, &entries, &x, &y)?;
        data.bars(&mut right, &data.after, palette::ORANGE)?;
        data.bars(&mut right, &data.levelled, palette::BLUE)
    })
}
