//! Displacement against voltage, from rest past the loss of stability.

use std::path::Path;

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};

/// The path of one pattern. The curves have one value per point, from rest on.
#[derive(Clone, Debug)]
pub struct Branch {
    /// Its name.
    pub name: String,
    /// Voltage in V.
    pub voltage: Vec<f64>,
    /// Displacement of one point of the membrane, in mm.
    pub displacement: Vec<f64>,
    /// Whether a membrane can be found in that state.
    pub stable: Vec<bool>,
    /// What ends the stable part that begins at rest.
    pub limit: Option<Limit>,
}

/// Where a stable part ends.
#[derive(Clone, Debug)]
pub struct Limit {
    /// What happens there.
    pub name: String,
    /// Voltage in V.
    pub voltage: f64,
    /// How far the truth may lie on either side, in V, where that is known.
    pub error: Option<f64>,
    /// Displacement in mm.
    pub displacement: f64,
}

impl Limit {
    /// The voltage in kV, with its error.
    fn kilovolts(&self) -> String {
        let error = self.error.map(|error| format!(" ± {:.3}", 1e-3 * error));
        format!("{:.3}{} kV", 1e-3 * self.voltage, error.unwrap_or_default())
    }
}

/// Width and height of the chart.
const SIZE: [f64; 2] = [708.0, 410.0];

/// Names of more branches would fill the chart.
const NAMED: usize = 7;

/// Displacement against voltage, solid where stable and dashed where not, with the limits marked.
///
/// # Errors
/// When there are no branches or their data are incomplete.
pub fn paths_chart(branches: &[Branch]) -> Result<Chart, FigureError> {
    let incomplete = |b: &Branch| {
        let n = b.voltage.len();
        let numbers = b.voltage.iter().chain(&b.displacement);
        n == 0 || [b.displacement.len(), b.stable.len()] != [n; 2] || numbers.into_iter().any(|v| !v.is_finite())
    };
    if branches.is_empty() || branches.iter().any(incomplete) {
        return Err(FigureError::Data(
            "a path needs finite values at each of its points".into(),
        ));
    }
    let kilovolts: Vec<f64> = branches.iter().flat_map(|b| &b.voltage).map(|v| 1e-3 * v).collect();
    let millimetres = branches.iter().flat_map(|b| &b.displacement);
    let axes = [
        Axis::above("Voltage [kV]", &kilovolts),
        Axis::above("Displacement of the point that moves most [mm]", millimetres),
    ];
    let title = match branches {
        [one] => one
            .limit
            .as_ref()
            .map_or("Load path without a limit".to_owned(), |limit| {
                format!("Load path: {} at {}", limit.name, limit.kilovolts())
            }),
        _ => "Load paths: stable solid, unstable dashed".to_owned(),
    };
    let named = (2..=NAMED).contains(&branches.len());
    let mut series = Vec::new();
    for (branch, colour) in branches.iter().zip(Colour::ALL.into_iter().cycle()) {
        let name = if named { branch.name.as_str() } else { "" };
        series.extend(branch.curve(name, colour));
        series.extend(branch.mark(colour, branches.len() == 1));
    }
    Ok(Chart::new(title, axes, series).with_size(SIZE))
}

impl Branch {
    /// Runs of stable and of unstable points; the first carries the name.
    fn curve(&self, name: &str, colour: Colour) -> Vec<Series> {
        let point = |k: usize| (1e-3 * self.voltage[k], self.displacement[k]);
        let n = self.stable.len();
        let mut runs = Vec::new();
        let mut first = 0;
        while first < n {
            let stable = self.stable[first];
            let same = self.stable[first..].iter().take_while(|s| **s == stable).count();
            // A run begins where the last one ends, so that no gap shows.
            let points = (first.saturating_sub(1)..first + same).map(point).collect();
            let mark = if stable { Mark::Line } else { Mark::Dashed };
            runs.push(Series::new(if first == 0 { name } else { "" }, colour, mark, points));
            first += same;
        }
        runs
    }

    /// The limit with its error, and with its name where there is room.
    fn mark(&self, colour: Colour, named: bool) -> Vec<Series> {
        let Some(limit) = &self.limit else {
            return Vec::new();
        };
        let at = vec![(1e-3 * limit.voltage, limit.displacement)];
        let mut marks = vec![Series::new("", colour, Mark::Dots, at.clone())];
        if let Some(error) = limit.error {
            let ends = [limit.voltage - error, limit.voltage + error];
            let bar = ends.map(|voltage| (1e-3 * voltage, limit.displacement)).to_vec();
            marks.push(Series::new("", colour, Mark::Line, bar));
        }
        if named {
            // The curve ends where this mesh loses stability, the mark stands where it is lost without an error of the mesh.
            let name = match limit.error {
                Some(_) => format!("{} by two meshes", limit.name),
                None => limit.name.clone(),
            };
            marks.push(Series::new("", colour, Mark::Labelled, at).with_words(vec![name]));
        }
        marks
    }
}

/// Draws the paths.
///
/// # Errors
/// When there are no branches or their data are incomplete, or the file cannot be written.
pub fn draw_paths(path: &Path, branches: &[Branch]) -> Result<(), FigureError> {
    Sheet::charts(1, &[paths_chart(branches)?]).write_png(path)
}
