//! Histograms of the largest displacements, before and after balancing.

use crate::drawing::{Axis, Chart, Colour, FigureError, Series, Sheet};

/// Numbers of samples by their largest displacement.
#[derive(Clone, Debug)]
pub struct Histogram {
    /// Bin edges in mm; one more than bins.
    pub edges: Vec<f64>,
    /// Samples as solved.
    pub before: Vec<u64>,
    /// With the rotated and mirrored images that sparse bins get.
    pub augmented: Vec<u64>,
    /// After levelling, only samples as drawn.
    pub levelled: Vec<u64>,
    /// After levelling, with images: the training set of the surrogate.
    pub after: Vec<u64>,
}

impl Histogram {
    /// Draws the histograms as solved, levelled, and levelled with images.
    ///
    /// # Errors
    /// If the counts do not fit the edges.
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
            "a histogram needs ascending bin edges and one count per bin".into(),
        ))
    }

    /// Draws a chart whose vertical axis contains its own counts and those of others.
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

    /// Draws the histograms side by side.
    ///
    /// # Errors
    /// If the counts do not fit the edges.
    pub fn sheet(&self) -> Result<Sheet, FigureError> {
        Ok(Sheet::charts(3, &self.charts()?))
    }
}
