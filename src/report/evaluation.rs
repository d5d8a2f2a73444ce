//! Results of evaluate stages: errors of models and estimates by family, and the coverage of intervals.

use std::fmt;

use serde::Serialize;

use super::artifacts::ArtifactReader;
use super::error::ReportError;
use super::format::r_squared;
use deaflow_base::two_digits;
use deaflow_content as content;
use deaflow_content::CoverageView;

/// The nominal coverage of intervals.
const NOMINAL: f64 = 0.95;

/// The result of an evaluate stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Name of the stage.
    pub stage: String,
    /// Families of the patterns; the last one stands for all.
    pub families: Vec<String>,
    /// Models and estimates.
    pub predictors: Vec<PredictorScores>,
    /// Coverage of the intervals of models.
    pub calibrations: Vec<Coverage>,
}

/// Errors of a model or an estimate; lists have an entry for each family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PredictorScores {
    /// The stage that trained the model, or the method of an estimate.
    pub name: String,
    /// Digest of the model; empty for an estimate.
    pub digest: String,
    /// Whether the family was in its training set.
    pub trained: Vec<bool>,
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
    /// The 95 % quantile of the largest error of a pattern, in mm.
    pub quantile95_mm: Vec<f64>,
    /// The errors by area fraction.
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

/// Coverage of the intervals of a calibration; lists have an entry for each family.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Name of its stage.
    pub name: String,
    /// Fraction of patterns whose whole field lies in its band.
    pub field: Vec<f64>,
    /// Median radius of the band in mm.
    pub radius_mm: Vec<f64>,
    /// Fraction of patterns that are flagged as out of distribution.
    pub unlike: Vec<f64>,
    /// Patterns of the calibration.
    pub calibrated: Vec<u64>,
    /// Patterns that are not flagged.
    pub unflagged: Vec<u64>,
    /// Fraction of these whose whole field lies in its band; 0 if there are none.
    pub unflagged_field: Vec<f64>,
    /// Coverage for each objective.
    pub objectives: Vec<ObjectiveCoverage>,
}

/// Coverage of the interval of an objective.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ObjectiveCoverage {
    /// Point and direction.
    pub objective: String,
    /// Fraction of patterns whose value lies in its interval.
    pub covered: Vec<f64>,
    /// Median half-width of the interval in mm.
    pub half_width_mm: Vec<f64>,
}

impl Evaluation {
    /// Describes the most accurate predictor on the patterns of all families; `None` without patterns.
    #[must_use]
    pub fn result(&self) -> Option<String> {
        let known = self
            .predictors
            .iter()
            .filter_map(|p| Some((p, *p.rmse_mm.last()?, *p.samples.last()?)));
        let (best, rmse, samples) = known
            .filter(|(_, _, samples)| *samples > 0)
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        let of = match self.predictors.len() {
            1 => String::new(),
            n => format!(" is the most accurate of {n}:"),
        };
        Some(format!(
            "{}: {}{of} RMSE {rmse:.4} mm of a component on {samples} patterns",
            self.stage, best.name
        ))
    }
}

/// Returns the name of an artifact: the stage of this run that built it, or its network and digest.
fn name_of(source: &ArtifactReader<'_>, name: &str, digest: &str) -> String {
    let maker = source.run.iter().find(|made| made.digest.to_string() == digest);
    match maker {
        Some(made) => made.stage.clone(),
        None if digest.is_empty() => name.to_owned(),
        None => format!("{name} {digest:.8}"),
    }
}

/// Returns row `k` of a table with `n` rows.
fn row<T: Clone>(values: &[T], k: usize, n: usize) -> Vec<T> {
    let width = values.len() / n;
    values[k * width..][..width].to_vec()
}

/// Reads the result of an evaluate stage.
///
/// # Errors
/// If the artifact does not have the content of its kind.
pub fn read(source: &ArtifactReader<'_>) -> Result<Evaluation, ReportError> {
    let view = source.of(content::Evaluation::open(source.artifact))?;
    let (names, digests) = (
        source.of(view.predictors().read())?,
        source.of(view.predictor_digests().read())?,
    );
    let centres = source.of(view.area_centre().read())?;
    let trained = source.of(view.trained().read())?;
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
    let predictor = |k: usize| PredictorScores {
        name: name_of(source, &names[k], &digests[k]),
        digest: digests[k].clone(),
        trained: row(&trained, k, n).iter().map(|learned| *learned == 1).collect(),
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

fn coverage(source: &ArtifactReader<'_>, view: &CoverageView<'_>) -> Result<Vec<Coverage>, ReportError> {
    if !source.of(view.is_there())? {
        return Ok(Vec::new());
    }
    let digests = source.of(view.calibrations().read())?;
    let objectives = source.of(view.objectives().read())?;
    let (field, radius) = (source.of(view.field().read())?, source.of(view.radius().read())?);
    let unlike = source.of(view.out_of_distribution().read())?;
    let calibrated = source.of(view.calibrated().read())?;
    let (unflagged, unflagged_field) = (
        source.of(view.unflagged().read())?,
        source.of(view.unflagged_field().read())?,
    );
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
        name: name_of(source, "calibration", &digests[k]),
        field: row(&field, k, n),
        radius_mm: row(&radius, k, n),
        unlike: row(&unlike, k, n),
        calibrated: row(&calibrated, k, n),
        unflagged: row(&unflagged, k, n),
        unflagged_field: row(&unflagged_field, k, n),
        objectives: objectives
            .iter()
            .enumerate()
            .map(|named| of_objective(k, named))
            .collect(),
    };
    Ok((0..n).map(of_one).collect())
}

impl Evaluation {
    /// Returns the names of the families with a property, without that of all together.
    fn named(&self, holds: impl Fn(usize) -> bool) -> String {
        let single = 0..self.families.len().saturating_sub(1);
        let named: Vec<&str> = single
            .filter(|&k| holds(k))
            .map(|k| self.families[k].as_str())
            .collect();
        named.join(", ")
    }

    /// Describes the families that a model was and was not trained on, and its worst error outside of its training.
    #[must_use]
    pub fn scope(&self, predictor: &PredictorScores) -> Option<String> {
        if predictor.digest.is_empty() {
            return None;
        }
        let (own, others) = (
            self.named(|k| predictor.trained[k]),
            self.named(|k| !predictor.trained[k]),
        );
        Some(match (own.as_str(), others.as_str()) {
            (own, "") => format!("{} was trained on all of these families: {own}", predictor.name),
            ("", others) => format!("{} was trained on none of these families: {others}", predictor.name),
            (own, others) => {
                let worst = self.worst(predictor).map_or_else(String::new, |(family, ratio)| {
                    format!(": its error on {family} is {ratio:.1} times that on its own families")
                });
                format!("{} was trained on {own}; not on {others}{worst}", predictor.name)
            }
        })
    }

    /// Returns the family with the largest error outside of the training, and the ratio to the error on the training
    /// families.
    fn worst(&self, predictor: &PredictorScores) -> Option<(&str, f64)> {
        let single = 0..self.families.len().saturating_sub(1);
        let (own, others): (Vec<usize>, Vec<usize>) = single
            .filter(|&k| predictor.samples[k] > 0)
            .partition(|&k| predictor.trained[k]);
        let squares: f64 = own.iter().map(|&k| predictor.rmse_mm[k].powi(2)).sum();
        let usual = (squares / own.len().max(1) as f64).sqrt();
        let error = |k: &usize| predictor.rmse_mm[*k];
        let worst = others.into_iter().max_by(|a, b| error(a).total_cmp(&error(b)))?;
        (usual > 0.0).then(|| (self.families[worst].as_str(), error(&worst) / usual))
    }

    /// Describes the patterns of a calibration, and where its intervals cover less than they should.
    #[must_use]
    pub fn validity(&self, coverage: &Coverage) -> [String; 2] {
        let samples = |k: usize| self.predictors.first().map_or(0, |p| p.samples[k]);
        let (own, others) = (
            self.named(|k| coverage.calibrated[k] > 0),
            self.named(|k| coverage.calibrated[k] == 0),
        );
        let basis = match others.as_str() {
            "" => format!("calibrated on all of these families: {own}"),
            others => format!("calibrated on {own}; not on {others}"),
        };
        let short = (0..self.families.len() - 1).filter(|&k| is_too_low(coverage.field[k], samples(k)));
        let short: Vec<String> = short
            .map(|k| {
                format!(
                    "{} ({} covered, {} flagged)",
                    self.families[k],
                    percent(coverage.field[k]),
                    percent(coverage.unlike[k])
                )
            })
            .collect();
        let verdict = match &short[..] {
            [] => "the coverage of each family agrees with 95 %".to_owned(),
            some => format!("the coverage is below 95 % for: {}", some.join(", ")),
        };
        [basis, verdict]
    }

    /// Warns of families whose patterns lie outside of their bands too often, although they are not flagged.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let of_one = |coverage: &Coverage| {
            let families = 0..self.families.len().saturating_sub(1);
            let short = families.filter(|&k| is_too_low(coverage.unflagged_field[k], coverage.unflagged[k]));
            let warning = |k: usize| {
                let name = &coverage.name;
                let (count, family) = (coverage.unflagged[k], &self.families[k]);
                let covered = percent(coverage.unflagged_field[k]);
                format!(
                    "intervals of {name}: only {covered} of {count} patterns of {family} that are not flagged lie in \
                     their band, instead of 95 %"
                )
            };
            short.map(warning).collect::<Vec<_>>()
        };
        self.calibrations.iter().flat_map(of_one).collect()
    }

    fn line(&self, f: &mut fmt::Formatter<'_>, width: usize, name: &str, cells: &[String]) -> fmt::Result {
        write!(f, "  {name:<width$}")?;
        cells.iter().try_for_each(|cell| write!(f, "  {cell:>10}"))?;
        writeln!(f)
    }

    /// Writes the rows of errors.
    fn errors(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        for predictor in &self.predictors {
            let mut cells: Vec<String> = predictor.rmse_mm.iter().map(|rmse| two_digits(*rmse)).collect();
            for (cell, samples) in cells.iter_mut().zip(&predictor.samples) {
                if *samples == 0 {
                    *cell = "none".to_owned();
                }
            }
            let last = self.families.len().saturating_sub(1);
            cells.push(r_squared(predictor.max_displacement_r2[last]));
            cells.push(two_digits(predictor.max_error_mm[last]));
            self.line(f, width, &predictor.name, &cells)?;
        }
        let samples = self.predictors.first().map_or(&[][..], |p| &p.samples);
        let samples: Vec<String> = samples.iter().map(ToString::to_string).collect();
        self.line(f, width, "patterns", &samples)?;
        let scopes = self.predictors.iter().filter_map(|predictor| self.scope(predictor));
        scopes.into_iter().try_for_each(|scope| writeln!(f, "  {scope}"))
    }

    /// Writes the rows of a calibration.
    fn coverage(&self, f: &mut fmt::Formatter<'_>, width: usize, coverage: &Coverage) -> fmt::Result {
        let percents = |values: &[f64]| values.iter().map(|value| percent(*value)).collect::<Vec<_>>();
        writeln!(f, "  {}: intervals of 95 %", coverage.name)?;
        self.line(f, width, "whole field", &percents(&coverage.field))?;
        let radius: Vec<String> = coverage.radius_mm.iter().map(|r| two_digits(*r)).collect();
        self.line(f, width, "radius mm", &radius)?;
        self.line(f, width, "points", &percents(&coverage.points()))?;
        self.line(f, width, "flagged", &percents(&coverage.unlike))?;
        self.line(f, width, "unflagged", &coverage.unflagged_covered())?;
        self.validity(coverage)
            .iter()
            .try_for_each(|line| writeln!(f, "  {line}"))
    }
}

impl Coverage {
    /// Returns the coverage of each family, the mean over the objectives.
    #[must_use]
    pub fn points(&self) -> Vec<f64> {
        let n = self.objectives.len().max(1) as f64;
        let mean = |k: usize| self.objectives.iter().map(|o| o.covered[k]).sum::<f64>() / n;
        (0..self.field.len()).map(mean).collect()
    }

    /// Returns the coverage of patterns that are not flagged, as text.
    #[must_use]
    pub fn unflagged_covered(&self) -> Vec<String> {
        let pairs = self.unflagged_field.iter().zip(&self.unflagged);
        pairs
            .map(|(covered, n)| match n {
                0 => "none".to_owned(),
                _ => percent(*covered),
            })
            .collect()
    }
}

/// Whether a coverage is below the nominal one by more than two standard deviations of the count.
fn is_too_low(covered: f64, patterns: u64) -> bool {
    let deviation = (NOMINAL * (1.0 - NOMINAL) / patterns.max(1) as f64).sqrt();
    patterns > 0 && covered < NOMINAL - 2.0 * deviation
}

fn percent(fraction: f64) -> String {
    format!("{:.1} %", 100.0 * fraction)
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
        self.errors(f, width)?;
        let calibrations = self.calibrations.iter();
        calibrations
            .into_iter()
            .try_for_each(|coverage| self.coverage(f, width, coverage))?;
        write!(
            f,
            "  max: largest displacement of each pattern; max error: largest of a component, mm"
        )?;
        match self.calibrations.is_empty() {
            true => Ok(()),
            false => write!(
                f,
                "\n  unflagged: whole fields covered among the patterns that are not flagged as out of distribution; \
                 errors and coverage hold only for these families"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three hundred patterns of each of two families; the model was trained on the first one.
    fn evaluation() -> Evaluation {
        let three = || vec![0.0; 3];
        Evaluation {
            stage: "judged".into(),
            families: ["bezier", "dithers", "all"].map(str::to_owned).into(),
            predictors: vec![PredictorScores {
                name: "surrogate".into(),
                digest: "0123".into(),
                trained: vec![true, false, false],
                samples: vec![300, 300, 600],
                rmse_mm: vec![0.001, 0.0046, 0.0033],
                r2: three(),
                max_displacement_r2: three(),
                max_error_mm: three(),
                max_displacement_error_mm: three(),
                quantile95_mm: three(),
                by_area: Vec::new(),
            }],
            calibrations: vec![Coverage {
                name: "intervals".into(),
                field: vec![0.93, 0.59, 0.76],
                radius_mm: three(),
                unlike: vec![0.01, 0.9, 0.45],
                calibrated: vec![500, 0, 500],
                unflagged: vec![297, 30, 327],
                unflagged_field: vec![0.93, 0.6, 0.9],
                objectives: Vec::new(),
            }],
        }
    }

    #[test]
    fn errors_and_coverage_outside_of_the_training_are_reported() {
        let found = evaluation();
        assert_eq!(
            found.scope(&found.predictors[0]).as_deref(),
            Some(
                "surrogate was trained on bezier; not on dithers: its error on dithers is 4.6 times that on its own \
                 families"
            )
        );
        let [basis, verdict] = found.validity(&found.calibrations[0]);
        assert_eq!(basis, "calibrated on bezier; not on dithers");
        // 93 % of 300 is within two deviations, 2.5 %, of 95 %.
        assert!(
            verdict.contains("dithers (59.0 % covered, 90.0 % flagged)"),
            "{verdict}"
        );
        let warnings = found.warnings();
        assert_eq!(warnings.len(), 1);
        assert!(
            warnings[0].contains("only 60.0 % of 30 patterns of dithers"),
            "{warnings:?}"
        );
    }

    #[test]
    fn covered_or_flagged_patterns_cause_no_warning() {
        let mut found = evaluation();
        found.calibrations[0].field = vec![0.94, 0.96, 0.95];
        (
            found.calibrations[0].unflagged[1],
            found.calibrations[0].unflagged_field[1],
        ) = (0, 0.0);
        assert!(found.warnings().is_empty());
        let [_, verdict] = found.validity(&found.calibrations[0]);
        assert!(verdict.contains("agrees with 95 %"), "{verdict}");
        found.predictors[0].digest.clear();
        assert_eq!(found.scope(&found.predictors[0]), None, "an estimate is not trained");
    }
}
