//! What the evaluations of a run found: models beside estimates, family by family, and how often intervals cover.

use std::fmt;

use serde::Serialize;

use super::artifacts::Source;
use super::error::ReportError;
use super::format::two_digits;
use crate::content::{self, CoverageView};

/// The result of an evaluate stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Name of the stage.
    pub stage: String,
    /// Families of the patterns; the last is all of them together.
    pub families: Vec<String>,
    /// Models and estimates.
    pub predictors: Vec<Predicted>,
    /// Intervals of models.
    pub calibrations: Vec<Coverage>,
}

/// A model or an estimate; lists have an entry for each family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Predicted {
    /// Name of the stage that made the model, or the method of an estimate.
    pub name: String,
    /// Digest of the model; empty for an estimate.
    pub digest: String,
    /// Patterns with a prediction.
    pub samples: Vec<u64>,
    /// Root mean square error of a component in mm.
    pub rmse_mm: Vec<f64>,
    /// Coefficient of determination of the components.
    pub r2: Vec<f64>,
    /// Coefficient of determination of the largest displacement.
    pub max_displacement_r2: Vec<f64>,
    /// Largest absolute error of a component in mm.
    pub max_error_mm: Vec<f64>,
    /// Largest magnitude of a displacement's error in mm.
    pub max_displacement_error_mm: Vec<f64>,
    /// What the largest error of a pattern stays below on 95 % of them, in mm.
    pub quantile95_mm: Vec<f64>,
    /// The same patterns by area fraction.
    pub by_area: Vec<AreaError>,
}

/// Errors at an area fraction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AreaError {
    /// Middle of the bin.
    pub area: f64,
    /// Patterns in it.
    pub samples: u64,
    /// Root mean square error of a component in mm.
    pub rmse_mm: f64,
    /// Largest absolute error of a component in mm.
    pub max_error_mm: f64,
}

/// How often the intervals of a calibration cover; lists have an entry for each family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Name of the stage that made it.
    pub name: String,
    /// Share of patterns whose whole field lies in its band.
    pub field: Vec<f64>,
    /// Median radius of the band in mm.
    pub radius_mm: Vec<f64>,
    /// Share of patterns that are flagged as unlike the training.
    pub unlike: Vec<f64>,
    /// Objectives, each with the share of patterns whose value lies in its interval.
    pub objectives: Vec<ObjectiveCoverage>,
}

/// How often the interval of an objective covers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectiveCoverage {
    /// Point and direction.
    pub objective: String,
    /// Share of patterns whose value lies in its interval.
    pub covered: Vec<f64>,
    /// Median half-width of the interval in mm.
    pub half_width_mm: Vec<f64>,
}

/// What an artifact is called: the name of the stage of this run that made it, or its network and digest.
fn called(source: &Source<'_>, name: &str, digest: &str) -> String {
    let maker = source.run.iter().find(|made| made.digest.to_string() == digest);
    match maker {
        Some(made) => made.stage.clone(),
        None if digest.is_empty() => name.to_owned(),
        None => format!("{name} {digest:.8}"),
    }
}

/// The row of a table that belongs to one of several: `k` of `n`.
fn row<T: Clone>(values: &[T], k: usize, n: usize) -> Vec<T> {
    let width = values.len() / n;
    values[k * width..][..width].to_vec()
}

/// The result of an evaluate stage.
///
/// # Errors
/// When the artifact does not hold what its kind promises.
pub fn read(source: &Source<'_>) -> Result<Evaluation, ReportError> {
    let view = source.of(content::Evaluation::open(source.artifact))?;
    let (names, digests) = (
        source.of(view.predictors().read())?,
        source.of(view.predictor_digests().read())?,
    );
    let centres = source.of(view.area_centre().read())?;
    let (score, area) = (source.of(view.score().read())?, view.area());
    let area_samples = source.of(area.samples().read())?;
    let (area_rmse, area_max) = (source.of(area.rmse().read())?, source.of(area.max_error().read())?);
    let by_area = |k: usize| {
        let bin = |(b, &area): (usize, &f64)| AreaError {
            area,
            samples: area_samples[k * centres.len() + b],
            rmse_mm: area_rmse[k * centres.len() + b],
            max_error_mm: area_max[k * centres.len() + b],
        };
        centres.iter().enumerate().map(bin).collect()
    };
    let n = names.len();
    let predictor = |k: usize| Predicted {
        name: called(source, &names[k], &digests[k]),
        digest: digests[k].clone(),
        samples: row(&score.samples, k, n),
        rmse_mm: row(&score.rmse, k, n),
        r2: row(&score.r2, k, n),
        max_displacement_r2: row(&score.max_displacement_r2, k, n),
        max_error_mm: row(&score.max_error, k, n),
        max_displacement_error_mm: row(&score.max_displacement_error, k, n),
        quantile95_mm: row(&score.quantile95, k, n),
        by_area: by_area(k),
    };
    Ok(Evaluation {
        stage: source.stage.stage.clone(),
        predictors: (0..n).map(predictor).collect(),
        calibrations: coverage(source, &view.coverage())?,
        families: source.of(view.families().read())?,
    })
}

fn coverage(source: &Source<'_>, view: &CoverageView<'_>) -> Result<Vec<Coverage>, ReportError> {
    if !source.of(view.is_there())? {
        return Ok(Vec::new());
    }
    let digests = source.of(view.calibrations().read())?;
    let objectives = source.of(view.objectives().read())?;
    let (field, radius) = (source.of(view.field().read())?, source.of(view.radius().read())?);
    let unlike = source.of(view.out_of_distribution().read())?;
    let (objective, half_width) = (
        source.of(view.objective().read())?,
        source.of(view.objective_half_width().read())?,
    );
    let n = digests.len();
    let of_objective = |k: usize, (o, name): (usize, &String)| ObjectiveCoverage {
        objective: name.clone(),
        covered: row(&objective, o * n + k, objectives.len() * n),
        half_width_mm: row(&half_width, o * n + k, objectives.len() * n),
    };
    let of_one = |k: usize| Coverage {
        name: called(source, "calibration", &digests[k]),
        field: row(&field, k, n),
        radius_mm: row(&radius, k, n),
        unlike: row(&unlike, k, n),
        objectives: objectives
            .iter()
            .enumerate()
            .map(|named| of_objective(k, named))
            .collect(),
    };
    Ok((0..n).map(of_one).collect())
}

impl Evaluation {
    fn line(&self, f: &mut fmt::Formatter<'_>, width: usize, name: &str, cells: &[String]) -> fmt::Result {
        write!(f, "  {name:<width$}")?;
        cells.iter().try_for_each(|cell| write!(f, "  {cell:>10}"))?;
        writeln!(f)
    }
}

impl fmt::Display for Evaluation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.predictors.iter().map(|p| &p.name);
        let names = names.chain(self.calibrations.iter().map(|c| &c.name));
        let width = names.map(|name| name.chars().count()).max().unwrap_or(0).max(12);
        writeln!(
            f,
            "{}: root mean square error of a component in mm, by family",
            self.stage
        )?;
        let extra = ["R² of max", "max error"].map(str::to_owned);
        self.line(f, width, "", &[&self.families[..], &extra].concat())?;
        for predictor in &self.predictors {
            let mut cells: Vec<String> = predictor.rmse_mm.iter().map(|rmse| two_digits(*rmse)).collect();
            for (cell, samples) in cells.iter_mut().zip(&predictor.samples) {
                if *samples == 0 {
                    *cell = "none".to_owned();
                }
            }
            let last = self.families.len().saturating_sub(1);
            cells.push(format!("{:.5}", predictor.max_displacement_r2[last]));
            cells.push(two_digits(predictor.max_error_mm[last]));
            self.line(f, width, &predictor.name, &cells)?;
        }
        let samples = self.predictors.first().map_or(&[][..], |p| &p.samples);
        self.line(
            f,
            width,
            "patterns",
            &samples.iter().map(ToString::to_string).collect::<Vec<_>>(),
        )?;
        for coverage in &self.calibrations {
            let percent = |shares: &[f64]| shares.iter().map(|s| format!("{:.1} %", 100.0 * s)).collect::<Vec<_>>();
            writeln!(f, "  {}: intervals of 95 %", coverage.name)?;
            self.line(f, width, "whole field", &percent(&coverage.field))?;
            self.line(
                f,
                width,
                "radius mm",
                &coverage.radius_mm.iter().map(|r| two_digits(*r)).collect::<Vec<_>>(),
            )?;
            let points: Vec<f64> = (0..self.families.len())
                .map(|k| {
                    coverage.objectives.iter().map(|o| o.covered[k]).sum::<f64>() / coverage.objectives.len() as f64
                })
                .collect();
            self.line(f, width, "points", &percent(&points))?;
            self.line(f, width, "flagged", &percent(&coverage.unlike))?;
        }
        write!(
            f,
            "  max: largest displacement of each pattern; max error: largest of a component, mm"
        )
    }
}
