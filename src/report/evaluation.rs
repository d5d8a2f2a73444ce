//! What the evaluations of a run found: models beside estimates, family by family, and how often intervals cover.

use std::fmt;

use serde::Serialize;

use super::gather::{Made, ReportError, Source, each};
use crate::store::Store;

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

/// The results of all evaluate stages of a run.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn evaluations(store: &Store, made: &[Made]) -> Result<Vec<Evaluation>, ReportError> {
    each(store, made, "evaluate", read)
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

/// Rows of a table of `width` columns.
fn rows<T: Clone>(
    source: &Source<'_>,
    values: Vec<T>,
    [height, width]: [usize; 2],
) -> Result<Vec<Vec<T>>, ReportError> {
    if values.len() != height * width || width == 0 {
        return Err(source.wrong("its arrays differ in length"));
    }
    Ok(values.chunks_exact(width).map(<[T]>::to_vec).collect())
}

pub(super) fn read(source: &Source<'_>) -> Result<Evaluation, ReportError> {
    let texts = |path: &str| -> Result<Vec<String>, ReportError> { Ok(source.artifact.texts(path)?.1) };
    let (names, digests, families) = (texts("predictors")?, texts("predictor_digests")?, texts("families")?);
    if names.len() != digests.len() {
        return Err(source.wrong("its arrays differ in length"));
    }
    let centres = source.reals("area/centre")?;
    let shape = [names.len(), families.len()];
    let bins = [names.len(), centres.len()];
    let table = |name: &str| rows(source, source.reals(name)?, shape);
    let samples = rows(source, source.counts("score/samples")?, shape)?;
    let area_samples = rows(source, source.counts("area/samples")?, bins)?;
    let area_rmse = rows(source, source.reals("area/rmse")?, bins)?;
    let area_max = rows(source, source.reals("area/max_error")?, bins)?;
    let (rmse, r2, max_r2) = (
        table("score/rmse")?,
        table("score/r2")?,
        table("score/max_displacement_r2")?,
    );
    let (max_error, quantile) = (table("score/max_error")?, table("score/quantile95")?);
    let max_displacement_error = table("score/max_displacement_error")?;
    let by_area = |k: usize| {
        let bin = |b: usize| AreaError {
            area: centres[b],
            samples: area_samples[k][b],
            rmse_mm: area_rmse[k][b],
            max_error_mm: area_max[k][b],
        };
        (0..centres.len()).map(bin).collect()
    };
    let predictor = |k: usize| Predicted {
        name: called(source, &names[k], &digests[k]),
        digest: digests[k].clone(),
        samples: samples[k].clone(),
        rmse_mm: rmse[k].clone(),
        r2: r2[k].clone(),
        max_displacement_r2: max_r2[k].clone(),
        max_error_mm: max_error[k].clone(),
        max_displacement_error_mm: max_displacement_error[k].clone(),
        quantile95_mm: quantile[k].clone(),
        by_area: by_area(k),
    };
    Ok(Evaluation {
        stage: source.stage.stage.clone(),
        predictors: (0..names.len()).map(predictor).collect(),
        calibrations: coverage(source, families.len())?,
        families,
    })
}

fn coverage(source: &Source<'_>, families: usize) -> Result<Vec<Coverage>, ReportError> {
    let contents = source.artifact.contents()?;
    if contents.iter().all(|content| content.path != "coverage/calibrations") {
        return Ok(Vec::new());
    }
    let digests = source.artifact.texts("coverage/calibrations")?.1;
    let objectives = source.artifact.texts("coverage/objectives")?.1;
    let shape = [digests.len(), families];
    let table = |name: &str| rows(source, source.reals(name)?, shape);
    let cube = |name: &str| {
        rows(
            source,
            source.reals(name)?,
            [objectives.len() * digests.len(), families],
        )
    };
    let (field, radius, unlike) = (
        table("coverage/field")?,
        table("coverage/radius")?,
        table("coverage/unlike")?,
    );
    let (objective, half_width) = (cube("coverage/objective")?, cube("coverage/objective_half_width")?);
    let of_one = |k: usize| Coverage {
        name: called(source, "calibration", &digests[k]),
        field: field[k].clone(),
        radius_mm: radius[k].clone(),
        unlike: unlike[k].clone(),
        objectives: objectives
            .iter()
            .enumerate()
            .map(|(o, name)| ObjectiveCoverage {
                objective: name.clone(),
                covered: objective[o * digests.len() + k].clone(),
                half_width_mm: half_width[o * digests.len() + k].clone(),
            })
            .collect(),
    };
    Ok((0..digests.len()).map(of_one).collect())
}

/// Two significant digits, at most five decimals.
pub(super) fn short(value: f64) -> String {
    let digits = if value > 0.0 {
        (1.0 - value.log10().floor()).clamp(0.0, 5.0)
    } else {
        1.0
    };
    format!("{value:.*}", digits as usize)
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
            let mut cells: Vec<String> = predictor.rmse_mm.iter().map(|rmse| short(*rmse)).collect();
            for (cell, samples) in cells.iter_mut().zip(&predictor.samples) {
                if *samples == 0 {
                    *cell = "none".to_owned();
                }
            }
            let last = self.families.len().saturating_sub(1);
            cells.push(format!("{:.5}", predictor.max_displacement_r2[last]));
            cells.push(short(predictor.max_error_mm[last]));
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
                &coverage.radius_mm.iter().map(|r| short(*r)).collect::<Vec<_>>(),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_two_digits() {
        for (value, text) in [
            (0.0, "0.0"),
            (0.00321, "0.0032"),
            (0.0567, "0.057"),
            (1.234, "1.2"),
            (23.4, "23"),
            (2e-7, "0.00000"),
        ] {
            assert_eq!(short(value), text);
        }
    }
}
