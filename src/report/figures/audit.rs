//! What a dataset covers, and how far its labels are from finer solutions.

use std::path::Path;

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};

/// Counts by bins.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// Edges; one more than counts.
    pub edges: Vec<f64>,
    /// Rows in each bin.
    pub counts: Vec<u64>,
}

impl Counts {
    fn are_complete(&self) -> bool {
        self.edges.len() == self.counts.len() + 1 && self.edges.windows(2).all(|pair| pair[0] < pair[1])
    }

    fn chart(&self, title: &str, label: &str) -> Chart {
        let ends = [self.edges[0], self.edges[self.counts.len()]];
        // All values may be zero: an axis needs a length.
        let x = Axis::linear(label, ends[0], ends[1].max(ends[0] + 1e-6));
        let y = Axis::counts("Rows per bin", &self.counts);
        Chart::new(
            title,
            [x, y],
            vec![Series::bars("", Colour::Blue, &self.edges, &self.counts)],
        )
    }
}

/// What an audit has looked at.
#[derive(Clone, Debug, Default)]
pub struct Audited {
    /// Active part of the membrane.
    pub area: Counts,
    /// Largest displacement, mm.
    pub displacement: Counts,
    /// Largest displacement and error on a finer mesh of each row that was simulated there, mm.
    pub errors: Vec<(f64, f64)>,
    /// The error that is declared, mm, for the same rows; none where it is not.
    pub allowed: Vec<(f64, f64)>,
}

impl Audited {
    /// The two histograms and, where there are such, the errors.
    ///
    /// # Errors
    /// When the counts do not fit the edges.
    pub fn charts(&self) -> Result<Vec<Chart>, FigureError> {
        if !self.area.are_complete() || !self.displacement.are_complete() {
            return Err(FigureError::Data(
                "an audit needs rising edges and one count per bin".into(),
            ));
        }
        let moving = |points: &[(f64, f64)]| -> Vec<(f64, f64)> {
            points.iter().copied().filter(|(_, error)| *error > 0.0).collect()
        };
        let (errors, allowed) = (moving(&self.errors), moving(&self.allowed));
        let mut charts = vec![
            self.area.chart("Electrode area", "Active part of the membrane"),
            self.displacement.chart("Deformation", "Largest displacement [mm]"),
        ];
        if !errors.is_empty() {
            charts.push(against_finer(errors, allowed));
        }
        Ok(charts)
    }
}

fn against_finer(errors: Vec<(f64, f64)>, allowed: Vec<(f64, f64)>) -> Chart {
    let all = || errors.iter().chain(&allowed);
    let right = all().map(|(peak, _)| *peak).fold(0.0, f64::max);
    let x = Axis::linear("Largest displacement [mm]", 0.0, 1.05 * right);
    let y = Axis::logarithmic("Error [mm]", all().map(|(_, error)| error));
    let mut series = vec![Series::new("measured", Colour::Blue, Mark::Dots, errors.clone())];
    if !allowed.is_empty() {
        series.insert(
            0,
            Series::new("allowed", Colour::Vermillion, Mark::Dots, allowed.clone()),
        );
    }
    Chart::new("Against a finer mesh", [x, y], series)
}

/// Draws what an audit has looked at.
///
/// # Errors
/// When the counts do not fit the edges, or the file cannot be written.
pub fn draw_audit(path: &Path, data: &Audited) -> Result<(), FigureError> {
    Sheet::charts(3, &data.charts()?).write_png(path)
}
