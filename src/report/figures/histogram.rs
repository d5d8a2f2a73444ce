//! How deformations are spread over the samples, before and after balancing.

use std::path::Path;

use crate::drawing::{Axis, Chart, Colour, FigureError, Series, Sheet};

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
    /// The histograms as solved, levelled, and levelled with images.
    ///
    /// # Errors
    /// When the counts do not fit the edges.
    pub fn charts(&self) -> Result<Vec<Chart>, FigureError> {
        self.validate()?;
        let bars = |name, colour, counts: &[u64]| Series::bars(name, colour, &self.edges, counts);
        let images = "with rotated and mirrored images";
        Ok(vec![
            self.chart(
                "As solved",
                &self.before,
                vec![
                    bars("solved", Colour::Sky, &self.before),
                    Series::outline(images, Colour::Vermillion, &self.edges, &self.augmented),
                ],
                &self.augmented,
            ),
            self.chart(
                "Levelled",
                &self.levelled,
                vec![bars("as drawn", Colour::Blue, &self.levelled)],
                &self.after,
            ),
            self.chart(
                "Augmented and levelled",
                &self.after,
                vec![
                    bars("images", Colour::Orange, &self.after),
                    bars("as drawn", Colour::Blue, &self.levelled),
                ],
                &self.after,
            ),
        ])
    }

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

    /// A chart of so many samples, whose axis reaches the highest of these bins and of others.
    fn chart(&self, title: &str, counts: &[u64], series: Vec<Series>, others: &[u64]) -> Chart {
        let x = Axis::linear(
            "Largest displacement [mm]",
            self.edges[0],
            self.edges[self.before.len()],
        );
        let y = Axis::counts("Samples per bin", counts.iter().chain(others));
        let title = format!("{title}: {} samples", counts.iter().sum::<u64>());
        Chart::new(title, [x, y], series)
    }
}

/// Draws the histograms side by side.
///
/// # Errors
/// When the counts do not fit the edges, or the file cannot be written.
pub fn draw_histogram(path: &Path, data: &Histogram) -> Result<(), FigureError> {
    Sheet::charts(3, &data.charts()?).write_png(path)
}
