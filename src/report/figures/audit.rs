//! Results of an audit: the distribution of the rows, and the errors of labels against finer solutions.

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};

/// A histogram.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// Edges of the bins; one more than counts.
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
        // All values may be zero, but an axis needs a length.
        let x = Axis::linear(label, ends[0], ends[1].max(ends[0] + 1e-6));
        let y = Axis::counts("Rows per bin", &self.counts);
        Chart::new(
            title,
            [x, y],
            vec![Series::bars("", Colour::Blue, &self.edges, &self.counts)],
        )
    }
}

/// The data of the figure of an audit.
#[derive(Clone, Debug, Default)]
pub struct AuditFigure {
    /// Area fraction of the electrode.
    pub area: Counts,
    /// Largest displacement, mm.
    pub displacement: Counts,
    /// Largest displacement, and error against a finer mesh, of each row that was simulated there, mm.
    pub errors: Vec<(f64, f64)>,
    /// The same with the declared error, if there is one.
    pub allowed: Vec<(f64, f64)>,
}

impl AuditFigure {
    /// Draws the two histograms and, if there are any, the errors.
    ///
    /// # Errors
    /// If the counts do not fit the edges.
    pub fn charts(&self) -> Result<Vec<Chart>, FigureError> {
        if !self.area.are_complete() || !self.displacement.are_complete() {
            return Err(FigureError::Data(
                "an audit needs ascending bin edges and one count per bin".into(),
            ));
        }
        let moving = |points: &[(f64, f64)]| -> Vec<(f64, f64)> {
            points.iter().copied().filter(|(_, error)| *error > 0.0).collect()
        };
        let (errors, allowed) = (moving(&self.errors), moving(&self.allowed));
        let mut charts = vec![
            self.area
                .chart("Electrode area", "Electrode area, share of the free membrane"),
            self.displacement.chart("Deformation", "Largest displacement [mm]"),
        ];
        if !errors.is_empty() {
            charts.push(errors_chart(errors, allowed));
        }
        Ok(charts)
    }

    /// Draws the charts on a sheet.
    ///
    /// # Errors
    /// If the counts do not fit the edges.
    pub fn sheet(&self) -> Result<Sheet, FigureError> {
        Ok(Sheet::charts(3, &self.charts()?))
    }
}

fn errors_chart(errors: Vec<(f64, f64)>, allowed: Vec<(f64, f64)>) -> Chart {
    let all = || errors.iter().chain(&allowed);
    let right = all().map(|(peak, _)| *peak).fold(0.0, f64::max);
    let x = Axis::linear("Largest displacement [mm]", 0.0, 1.05 * right);
    let y = Axis::logarithmic("Error [mm]", all().map(|(_, error)| error));
    let mut series = Vec::new();
    if !allowed.is_empty() {
        series.push(Series::new("allowed", Colour::Vermillion, Mark::Dots, allowed.clone()));
    }
    series.push(Series::new("measured", Colour::Blue, Mark::Dots, errors.clone()));
    Chart::new("Against a finer mesh", [x, y], series)
}
