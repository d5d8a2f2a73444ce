//! Measured curves, and the errors of curves that cannot be fitted.

use crate::deformation::Test;
use thiserror::Error;

/// What is known about the noise of a curve; it sets the weights.
#[derive(Clone, Debug, PartialEq)]
pub enum Sigma {
    /// The standard deviation of each point in Pa.
    Stated(Vec<f64>),
    /// The standard deviation as a fraction of the measured stress.
    StatedFraction(f64),
    /// Unknown, in proportion to the measured stress: the residual is (model − data)/|data|.
    UnstatedRelative,
    /// Unknown, the same for all points: the residual is model − data in Pa.
    UnstatedAbsolute,
}

/// A measured curve. Rows at stretch 1 hold for every law and are not counted as points.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// The name of the curve, such as its file.
    pub name: String,
    /// How the specimen was stretched.
    pub test: Test,
    /// The stretches.
    pub stretch: Vec<f64>,
    /// The nominal stresses in Pa.
    pub stress_pa: Vec<f64>,
    /// The noise.
    pub sigma: Sigma,
}

/// Why a law cannot be fitted to curves.
#[derive(Clone, Debug, PartialEq, Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum FitError {
    #[error("curve `{curve}` has {} {}, but {} {}", first.0, first.1, second.0, second.1)]
    Lengths {
        curve: String,
        first: (usize, &'static str),
        second: (usize, &'static str),
    },
    #[error("curve `{curve}`, row {row}: the {column} is not a finite number")]
    NotFinite {
        curve: String,
        row: usize,
        column: &'static str,
    },
    #[error("curve `{curve}`, row {row}: the stretch {stretch} is not positive")]
    Stretch { curve: String, row: usize, stretch: f64 },
    #[error("curve `{curve}`, row {row}: the standard deviation {sigma} Pa is not positive")]
    Sigma { curve: String, row: usize, sigma: f64 },
    #[error("curve `{curve}`, row {row}: a stress of zero has no relative error; state its standard deviation in Pa")]
    ZeroStress { curve: String, row: usize },
    #[error("curve `{curve}` has another kind of standard deviation than `{first}`: state both, or neither in one way")]
    MixedSigma { curve: String, first: String },
    #[error("the curves `{curve}` and `{first}` name different laws")]
    MixedElastomers { curve: String, first: String },
    #[error("curve `{curve}`, row {row}: the time is not a number from 0 on")]
    Time { curve: String, row: usize },
    #[error("all stretches are 1: the curves say nothing about a law")]
    NotStretched,
    #[error("{points} points cannot determine {parameters} parameters of the law `{law}`")]
    TooFewPoints {
        points: usize,
        parameters: usize,
        law: &'static str,
    },
    #[error("the stresses have the wrong sign: they must be positive where the stretch is above 1")]
    WrongSign,
    #[error("the law `{law}` has no parameter `{name}`")]
    UnknownParameter { law: &'static str, name: String },
    #[error("the bounds {lower} and {upper} of `{name}` are not in order, or not positive where they must be")]
    Bounds { name: String, lower: f64, upper: f64 },
    #[error("the law `{law}` has no value within the bounds at the stretches of the curves")]
    NoStart { law: &'static str },
    #[error("the law `{law}` has no terms")]
    NoTerms { law: &'static str },
    #[error("`{set}`, row {row}: the {column} {value} is not positive")]
    NotPositive {
        set: String,
        row: usize,
        column: &'static str,
        value: f64,
    },
    #[error("`{set}`: the {what} {value} is not a positive number")]
    Setting {
        set: String,
        what: &'static str,
        value: f64,
    },
    #[error("`{set}`, row {row}: a {column} of zero has no relative error; state its standard deviation")]
    ZeroValue {
        set: String,
        row: usize,
        column: &'static str,
    },
    #[error("`{set}`, row {row} of the history: the times must not fall, and all numbers must be finite")]
    History { set: String, row: usize },
    #[error("`{set}`: the history is empty")]
    NoHistory { set: String },
    #[error("`{set}`, row {row}: the time is before the first one of the history")]
    BeforeHistory { set: String, row: usize },
    #[error("`{set}`: a sheet under voltage is equibiaxial or in pure shear, not uniaxial")]
    UniaxialVoltage { set: String },
    #[error("`{set}` has no points")]
    NoPoints { set: String },
    #[error("`{set}`: the images must all state a standard deviation, or none of them")]
    MixedImages { set: String },
    #[error("`{set}` and `{first}` cannot be fitted together unless both state the standard deviations of their data")]
    MixedSets { set: String, first: String },
    #[error("`{set}` needs the parameter `{name}`: let it be free, or give its value")]
    MissingParameter { set: String, name: String },
    #[error("no data depend on the parameter `{name}`")]
    UnusedParameter { name: String },
    #[error("the parameter `{name}` is given twice")]
    RepeatedParameter { name: String },
    #[error("the start {start} of `{name}` is not within its bounds {lower} and {upper}")]
    Start {
        name: String,
        start: f64,
        lower: f64,
        upper: f64,
    },
    #[error("{found} starting values were given for {expected} parameters")]
    StartCount { found: usize, expected: usize },
    #[error("{numbers} numbers cannot determine {parameters} parameters")]
    TooFewNumbers { numbers: usize, parameters: usize },
    #[error("nothing to fit: there are no {what}")]
    Nothing { what: &'static str },
    #[error("`{set}` has no state at the starting values: start elsewhere, or check the bounds")]
    NoState { set: String },
    #[error("the simulation of `{set}` failed: {message}")]
    Simulation { set: String, message: String },
    #[error("the simulation of `{set}` returned {found} {what}, not {expected}")]
    SimulationCount {
        set: String,
        what: &'static str,
        found: usize,
        expected: usize,
    },
}

/// Returns the scale of each residual, (model − data)/scale, of a set of data.
///
/// # Errors
/// When there is another number of standard deviations, or one is not positive.
pub(crate) fn scales(set: &str, column: &'static str, data: &[f64], sigma: &Sigma) -> Result<Vec<f64>, FitError> {
    if let Sigma::Stated(sigma) = sigma
        && sigma.len() != data.len()
    {
        return Err(FitError::Lengths {
            curve: set.to_owned(),
            first: (data.len(), "rows"),
            second: (sigma.len(), "standard deviations"),
        });
    }
    let scale = |(at, value): (usize, &f64)| {
        let (set, row) = (set.to_owned(), at + 1);
        let scale = match sigma {
            Sigma::Stated(sigma) => sigma[at],
            Sigma::StatedFraction(fraction) => fraction * value.abs(),
            Sigma::UnstatedRelative => value.abs(),
            Sigma::UnstatedAbsolute => 1.0,
        };
        if !value.is_finite() {
            return Err(FitError::NotFinite {
                curve: set,
                row,
                column,
            });
        }
        if *value == 0.0 && matches!(sigma, Sigma::StatedFraction(_) | Sigma::UnstatedRelative) {
            return Err(FitError::ZeroValue { set, row, column });
        }
        if !(scale.is_finite() && scale > 0.0) {
            let (column, value) = ("standard deviation", scale);
            return Err(FitError::NotPositive {
                set,
                row,
                column,
                value,
            });
        }
        Ok(scale)
    };
    data.iter().enumerate().map(scale).collect()
}

/// A row of a curve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    /// The index of the curve.
    pub curve: usize,
    pub test: Test,
    pub stretch: f64,
    pub stress: f64,
    /// The residual is (model − stress)/scale.
    pub scale: f64,
}

impl Row {
    /// Returns whether the row says something about a law.
    pub fn counts(&self) -> bool {
        self.stretch != 1.0
    }
}

/// The rows of all curves.
#[derive(Clone, Debug)]
pub(crate) struct Points {
    pub rows: Vec<Row>,
    /// Whether the standard deviations are stated.
    pub stated: bool,
}

impl Points {
    /// Checks curves and gathers their rows.
    ///
    /// # Errors
    /// When a curve is not valid, or the curves do not fit together.
    pub fn new(curves: &[Curve]) -> Result<Self, FitError> {
        let mut rows = Vec::new();
        for (index, curve) in curves.iter().enumerate() {
            let first = &curves[0];
            if noise_kind(&curve.sigma) != noise_kind(&first.sigma) {
                return Err(FitError::MixedSigma {
                    curve: curve.name.clone(),
                    first: first.name.clone(),
                });
            }
            check_lengths(curve)?;
            for row in 0..curve.stretch.len() {
                rows.push(checked_row(curve, index, row)?);
            }
        }
        if !rows.iter().any(Row::counts) {
            return Err(FitError::NotStretched);
        }
        let stated = curves.first().is_some_and(|curve| noise_kind(&curve.sigma) == 0);
        Ok(Self { rows, stated })
    }

    /// Returns the rows that say something about a law.
    pub fn counted(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.counts())
    }

    /// Returns the rows of some tests.
    pub fn of(&self, belongs: impl Fn(Test) -> bool) -> Self {
        Self {
            rows: self.rows.iter().copied().filter(|row| belongs(row.test)).collect(),
            stated: self.stated,
        }
    }
}

/// Curves whose kinds differ cannot be fitted together: their residuals have different units.
pub(crate) fn noise_kind(sigma: &Sigma) -> usize {
    match sigma {
        Sigma::Stated(_) | Sigma::StatedFraction(_) => 0,
        Sigma::UnstatedRelative => 1,
        Sigma::UnstatedAbsolute => 2,
    }
}

fn check_lengths(curve: &Curve) -> Result<(), FitError> {
    let first = (curve.stretch.len(), "stretches");
    let mut columns = vec![(curve.stress_pa.len(), "stresses")];
    if let Sigma::Stated(sigma) = &curve.sigma {
        columns.push((sigma.len(), "standard deviations"));
    }
    match columns.into_iter().find(|(length, _)| *length != first.0) {
        Some(second) => Err(FitError::Lengths {
            curve: curve.name.clone(),
            first,
            second,
        }),
        None => Ok(()),
    }
}

fn checked_row(curve: &Curve, index: usize, at: usize) -> Result<Row, FitError> {
    let (stretch, stress) = (curve.stretch[at], curve.stress_pa[at]);
    let (name, row) = (|| curve.name.clone(), at + 1);
    let scale = match &curve.sigma {
        Sigma::Stated(sigma) => sigma[at],
        Sigma::StatedFraction(fraction) => fraction * stress.abs(),
        Sigma::UnstatedRelative => stress.abs(),
        Sigma::UnstatedAbsolute => 1.0,
    };
    let columns = [("stretch", stretch), ("stress", stress), ("standard deviation", scale)];
    if let Some((column, _)) = columns.into_iter().find(|(_, value)| !value.is_finite()) {
        return Err(FitError::NotFinite {
            curve: name(),
            row,
            column,
        });
    }
    if stretch <= 0.0 {
        return Err(FitError::Stretch {
            curve: name(),
            row,
            stretch,
        });
    }
    let relative = matches!(curve.sigma, Sigma::StatedFraction(_) | Sigma::UnstatedRelative);
    match (scale > 0.0, relative && stress == 0.0) {
        (false, true) if stretch != 1.0 => Err(FitError::ZeroStress { curve: name(), row }),
        (false, false) => Err(FitError::Sigma {
            curve: name(),
            row,
            sigma: scale,
        }),
        _ => Ok(Row {
            curve: index,
            test: curve.test,
            stretch,
            stress,
            scale,
        }),
    }
}
