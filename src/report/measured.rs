//! Measured beside simulated numbers, as fits and comparisons store them: in words and as figures.

use serde::Serialize;

use super::artifacts::ArtifactReader;
use super::drawing::{Chart, Sheet};
use super::error::ReportError;
use super::figures::{FittedCurve, MeasuredFigure, measured_charts, measured_sheet};
use deaflow_base::{four_significant, with_minus};
use deaflow_content::{
    ComparedFiles, ComparedFilesView, ComparedRows, ComparedRowsView, MeasuredQuantity, Measurements, Quantities,
};
use deaflow_scene::Scene;

/// Returns what is compared by its name in artifacts; a field for unknown ones.
fn quantities(name: &str) -> Quantities {
    Quantities::from_name(name).unwrap_or(Quantities::Field)
}

/// How well a simulation agrees with a file.
#[derive(Clone, Debug, Serialize)]
pub struct FileAgreement {
    /// The name of the file.
    pub file: String,
    /// What is compared with what.
    pub quantities: String,
    /// Compared points.
    pub points: u64,
    /// Rows at which the simulation has no stable equilibrium.
    pub without_equilibrium: u64,
    /// Root mean square of the difference, in base units.
    pub rms: f64,
    /// The largest difference, and its row.
    pub largest: f64,
    /// The row of it in the file from 1.
    pub largest_row: u64,
    /// The share of the variance that the simulation explains; `None` if all measured numbers are equal.
    pub r_squared: Option<f64>,
    /// χ² per degree of freedom, if standard deviations are stated.
    pub chi2_per_dof: Option<f64>,
}

impl FileAgreement {
    /// Reads the agreement with each file.
    ///
    /// # Errors
    /// If the artifact cannot be read.
    pub fn read(source: &ArtifactReader<'_>, files: &ComparedFilesView<'_>) -> Result<Vec<Self>, ReportError> {
        let files = source.of(files.read())?;
        let of = |(at, file): (usize, &String)| Self {
            file: file.clone(),
            quantities: files.quantities[at].clone(),
            points: files.points[at],
            without_equilibrium: files.without_equilibrium[at],
            rms: files.rms[at],
            largest: files.largest[at],
            largest_row: files.largest_row[at],
            r_squared: (files.has_r_squared[at] == 1).then_some(files.r_squared[at]),
            chi2_per_dof: (files.has_chi2[at] == 1).then_some(files.chi2_per_dof[at]),
        };
        Ok(files.name.0.iter().enumerate().map(of).collect())
    }

    /// Writes a number of the file with its unit.
    #[must_use]
    pub fn with_unit(&self, value: f64) -> String {
        quantities(&self.quantities).measured().dimension.with_unit(value)
    }

    /// Describes the agreement on one line.
    #[must_use]
    pub fn line(&self) -> String {
        let chi2 = self
            .chi2_per_dof
            .map_or_else(String::new, |chi2| format!(", χ²/dof {}", four_significant(chi2)));
        let explained = |r: f64| format!(", R² {}", with_minus(&format!("{r:.4}")));
        let explained = self.r_squared.map_or_else(String::new, explained);
        let points = if self.points == 1 { "point" } else { "points" };
        let lost = match self.without_equilibrium {
            0 => String::new(),
            rows => format!(", no stable equilibrium at {rows} more"),
        };
        format!(
            "{}: RMS {} over {} {points}{lost}{explained}{chi2}",
            self.file,
            self.with_unit(self.rms),
            self.points,
        )
    }
}

/// Returns the figure of each file.
#[must_use]
pub fn figures_of_files(files: &ComparedFiles, rows: &ComparedRows, scene: &Scene) -> Vec<MeasuredFigure> {
    let figure = |(file, name): (usize, &String)| {
        let own: Vec<usize> = (0..rows.file.len())
            .filter(|row| rows.file[*row] == file as u64)
            .collect();
        let quantities = quantities(&files.quantities[file]);
        if quantities == Quantities::Field {
            let difference = |row: usize| rows.measured[row] - rows.simulated[row];
            let pairs = own.chunks_exact(2);
            return MeasuredFigure::Map {
                name: name.clone(),
                size_mm: scene.membrane().size_mm,
                points_mm: pairs.clone().map(|pair| rows.position[pair[0]]).collect(),
                note: "distance of measured and simulated displacement",
                lengths_mm: pairs
                    .map(|pair| difference(pair[0]).hypot(difference(pair[1])))
                    .collect(),
            };
        }
        let (against, measured) = (quantities.against(), quantities.measured());
        let points = |numbers: &[f64]| {
            let mut points: Vec<(f64, f64)> = own
                .iter()
                .map(|&row| (against.displayed(rows.at[row]), measured.displayed(numbers[row])))
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            points
        };
        MeasuredFigure::Curve {
            labels: [against, measured].map(MeasuredQuantity::label),
            logarithmic: [against, measured].map(MeasuredQuantity::spans_decades),
            curve: FittedCurve {
                name: name.clone(),
                measured: points(&rows.measured),
                fitted: points(&rows.simulated),
            },
        }
    };
    files.name.0.iter().enumerate().map(figure).collect()
}

/// Returns the figure of each file of measurements, without simulated numbers.
#[must_use]
pub fn figures_of_measurements(measured: &Measurements) -> Vec<MeasuredFigure> {
    let (files, rows) = (&measured.files, &measured.rows);
    let figures = |(file, name): (usize, &String)| -> Vec<MeasuredFigure> {
        let own: Vec<usize> = (0..rows.file.len())
            .filter(|row| rows.file[*row] == file as u64)
            .collect();
        let has_times = own.iter().any(|&row| rows.time[row] != 0.0);
        let quantities = Quantities::of_test(&files.test[file], has_times);
        if quantities == Quantities::Field {
            let points_mm: Vec<[f64; 2]> = own.iter().map(|&row| rows.position[row]).collect();
            let side = |axis: usize| points_mm.iter().map(|at| at[axis]).fold(0.0, f64::max);
            return vec![MeasuredFigure::Map {
                name: name.clone(),
                size_mm: [side(0), side(1)],
                lengths_mm: own
                    .iter()
                    .map(|&row| rows.displacement[row][0].hypot(rows.displacement[row][1]))
                    .collect(),
                points_mm,
                note: "measured displacement",
            }];
        }
        let is_known = |quantities: &Quantities| match quantities {
            Quantities::FrequencyPhase => own
                .iter()
                .any(|&row| rows.numbers(Quantities::FrequencyPhase, row).1 != 0.0),
            _ => true,
        };
        let all = match quantities {
            Quantities::FrequencyAmplitude => vec![quantities, Quantities::FrequencyPhase],
            one => vec![one],
        };
        let curve = |quantities: Quantities| {
            let (against, measured) = (quantities.against(), quantities.measured());
            let point = |&row: &usize| {
                let (at, number) = rows.numbers(quantities, row);
                (against.displayed(at), measured.displayed(number))
            };
            MeasuredFigure::Curve {
                labels: [against, measured].map(MeasuredQuantity::label),
                logarithmic: [against, measured].map(MeasuredQuantity::spans_decades),
                curve: FittedCurve {
                    name: name.clone(),
                    measured: own.iter().map(point).collect(),
                    fitted: Vec::new(),
                },
            }
        };
        all.into_iter().filter(is_known).map(curve).collect()
    };
    files.name.0.iter().enumerate().flat_map(figures).collect()
}

/// Reads the figures of an artifact.
fn figures(
    source: &ArtifactReader<'_>,
    files: &ComparedFilesView<'_>,
    rows: &ComparedRowsView<'_>,
    scene: &Scene,
) -> Result<Vec<MeasuredFigure>, ReportError> {
    let (files, rows) = (source.of(files.read())?, source.of(rows.read())?);
    Ok(figures_of_files(&files, &rows, scene))
}

/// Draws an artifact on one sheet.
///
/// # Errors
/// If it cannot be read or drawn.
pub fn sheet(
    source: &ArtifactReader<'_>,
    files: &ComparedFilesView<'_>,
    rows: &ComparedRowsView<'_>,
    scene: &Scene,
) -> Result<Option<Sheet>, ReportError> {
    let figures = figures(source, files, rows, scene)?;
    source.drawn(measured_sheet(&figures)).map(Some)
}

/// Draws the charts of an artifact.
///
/// # Errors
/// If it cannot be read or drawn.
pub fn charts(
    source: &ArtifactReader<'_>,
    files: &ComparedFilesView<'_>,
    rows: &ComparedRowsView<'_>,
    scene: &Scene,
) -> Result<Vec<Chart>, ReportError> {
    let figures = figures(source, files, rows, scene)?;
    source.drawn(measured_charts(&figures))
}
