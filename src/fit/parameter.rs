//! The parameters that a joint fit varies.

use crate::curve::FitError;
use crate::solution::{Coordinate, Scale};

/// How a parameter is searched, and in which unit it is judged whether data determine it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterScale {
    /// By its logarithm: a positive parameter. Its standard error is that of the logarithm.
    Logarithm,
    /// As it is.
    Linear {
        /// The change that counts as much as a relative change by 1 of a positive parameter.
        unit: f64,
    },
}

/// A parameter that is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeParameter {
    /// The name by which sets of data share it.
    pub name: String,
    /// How it is searched.
    pub scale: ParameterScale,
    /// Where the search starts.
    pub start: f64,
    /// The smallest value.
    pub lower: f64,
    /// The largest value.
    pub upper: f64,
}

impl FreeParameter {
    /// Creates a positive parameter between bounds.
    #[must_use]
    pub fn positive(name: impl Into<String>, start: f64, lower: f64, upper: f64) -> Self {
        Self {
            name: name.into(),
            scale: ParameterScale::Logarithm,
            start,
            lower,
            upper,
        }
    }

    /// Creates a parameter of any sign between bounds.
    #[must_use]
    pub fn signed(name: impl Into<String>, start: f64, lower: f64, upper: f64, unit: f64) -> Self {
        Self {
            name: name.into(),
            scale: ParameterScale::Linear { unit },
            start,
            lower,
            upper,
        }
    }

    /// Returns the parameter as the search sees it.
    ///
    /// # Errors
    /// When the bounds are not in order or not positive where they must be, or a start is not between them.
    pub(crate) fn coordinate(&self, starts: impl IntoIterator<Item = f64>) -> Result<Coordinate, FitError> {
        let name = || self.name.clone();
        let (lower, upper) = (self.lower, self.upper);
        let (scale, least) = match self.scale {
            ParameterScale::Logarithm => (Scale::Logarithm, 0.0),
            ParameterScale::Linear { unit } if unit.is_finite() && unit > 0.0 => {
                (Scale::Linear { unit }, f64::NEG_INFINITY)
            }
            ParameterScale::Linear { unit } => {
                let (set, what, value) = (name(), "unit", unit);
                return Err(FitError::Setting { set, what, value });
            }
        };
        if !(lower < upper && lower > least && upper.is_finite()) {
            return Err(FitError::Bounds {
                name: name(),
                lower,
                upper,
            });
        }
        match starts.into_iter().find(|start| !(lower..=upper).contains(start)) {
            Some(start) => Err(FitError::Start {
                name: name(),
                start,
                lower,
                upper,
            }),
            None => Ok(Coordinate {
                name: name(),
                scale,
                limits: (lower, upper),
            }),
        }
    }
}
