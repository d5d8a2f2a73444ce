//! The fit of one law to curves.

use crate::curve::{Curve, FitError, Points, Row};
use crate::deformation::Test;
use crate::law::{Law, LawKind};
use crate::least_squares::{Bounds, Evaluation, Minimum, minimise};
use crate::profile::profile;
use crate::stability::Stability;
use crate::starts::{Coordinate, bounds, coordinates, linear_modulus, starts};
use crate::statistics::{Direction, Information, NORMAL_95, Uncertainty, student_t};
use deaflow_linalg::Mat;
use std::fmt;

/// A standard error above this, relative to the parameter, needs the profile of the likelihood.
const WIDE: f64 = 0.1;
/// Residuals beyond this many standard deviations are outliers: one of 16,000 normal deviates.
const OUTLIER: f64 = 4.0;
/// A law reduces to another one if their stresses differ by less than this at all points.
const SAME_STRESS: f64 = 1e-6;

/// Which parameters get a profile of the likelihood.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Profiles {
    /// None.
    Never,
    /// Those that are not determined, or whose standard error is above a tenth.
    #[default]
    Wide,
    /// All that are not at a bound.
    All,
}

/// The settings of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Bounds in place of those of scenes: the name of a parameter, its smallest and its largest value. `g` and `alpha`
    /// mean those of all of Ogden's terms.
    pub bounds: Vec<(String, f64, f64)>,
    /// Which parameters get a profile.
    pub profiles: Profiles,
    /// The stretch up to which a falling stress matters, if it is larger than those of the curves.
    pub largest_stretch: Option<f64>,
}

/// A fitted parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// The name in scenes.
    pub name: String,
    /// The value; moduli in Pa.
    pub value: f64,
    /// Whether the standard error is that of the logarithm, as of all positive parameters.
    pub logarithmic: bool,
    /// The standard error; `None` if the data do not determine the parameter, or it is at a bound.
    pub standard_error: Option<f64>,
    /// The interval of 95 % from the standard error.
    pub interval: Option<(f64, f64)>,
    /// The interval of 95 % from the profile of the likelihood; infinite where it is open.
    pub profile: Option<(f64, f64)>,
    /// Whether the parameter is at a bound.
    pub at_bound: bool,
}

/// The residuals of a curve in the order of its rows.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveResiduals {
    /// The name of the curve.
    pub name: String,
    /// (model − data)/σ where σ is stated, else (model − data)/|data| or model − data in Pa; zero at stretch 1.
    pub residuals: Vec<f64>,
}

/// A point far from the fitted law.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// The name of the curve.
    pub curve: String,
    /// The row, counted from 1.
    pub row: usize,
    /// The residual in standard deviations, stated ones or that of all residuals.
    pub deviations: f64,
}

/// What the fit says about the law.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// All parameters are determined, and the law is stable.
    Determined,
    /// Drucker's condition fails within the measured deformations, first at λ₁ and λ₂.
    Unstable(f64, f64),
    /// A parameter has run away, and has no influence: the law is another one with fewer parameters.
    ReducesTo(LawKind),
    /// The search did not end within its steps.
    NotConverged,
    /// The data do not determine these combinations of parameters.
    NotDetermined(Vec<String>),
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Determined => write!(f, "determined"),
            Self::Unstable(first, second) => write!(f, "unstable at the stretches {first:.3} and {second:.3}"),
            Self::ReducesTo(LawKind::Ogden(terms)) => write!(f, "reduces to ogden with terms: {terms}"),
            Self::ReducesTo(kind) => write!(f, "reduces to {}", kind.name()),
            Self::NotConverged => write!(f, "the search did not converge"),
            Self::NotDetermined(names) => write!(f, "the data do not determine {}", names.join(", ")),
        }
    }
}

/// A fitted law.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The law with its values.
    pub law: Law,
    /// The parameters in the order of [`LawKind::parameters`]; Ogden's terms with rising exponents.
    pub parameters: Vec<Parameter>,
    /// The covariance of the parameters, of the logarithms where they are logarithmic.
    pub covariance: Mat<f64>,
    /// Whether the standard deviations of the data are stated: then the sum of squares is χ².
    pub stated: bool,
    /// χ², or the sum of the squares of the residuals.
    pub sum_of_squares: f64,
    /// The number of points, without those at stretch 1.
    pub points: usize,
    /// Points less parameters.
    pub degrees_of_freedom: usize,
    /// The information criteria.
    pub information: Information,
    /// The residuals.
    pub residuals: Vec<CurveResiduals>,
    /// Points far from the law.
    pub outliers: Vec<Outlier>,
    /// The steps of the search that found the minimum.
    pub iterations: usize,
    /// How many searches were made, and how many found the minimum.
    pub searches: (usize, usize),
    /// Combinations of parameters, the least determined first.
    pub directions: Vec<Direction>,
    /// The stability of the law.
    pub stability: Stability,
    /// The result in one word.
    pub verdict: Verdict,
}

/// Fits a law to curves.
///
/// # Errors
/// When a curve is not valid, the bounds are not, or the curves cannot determine the law.
pub fn fit(curves: &[Curve], kind: LawKind, options: &Options) -> Result<Fit, FitError> {
    let points = Points::new(curves)?;
    let search = Search::new(&points, kind, options)?;
    Ok(search.summary(curves, options))
}

/// The search for the parameters of a law, and its end.
pub(crate) struct Search<'a> {
    points: &'a Points,
    kind: LawKind,
    coordinates: Vec<Coordinate>,
    bounds: Bounds,
    best: Minimum,
    searches: (usize, usize),
    pub law: Law,
}

impl<'a> Search<'a> {
    /// Searches from all starts.
    ///
    /// # Errors
    /// When there are too few points, the bounds are not valid, or no start has a value.
    pub fn new(points: &'a Points, kind: LawKind, options: &Options) -> Result<Self, FitError> {
        let (count, parameters) = (points.counted().count(), kind.parameters().len());
        let law = kind.name();
        if parameters == 0 {
            return Err(FitError::NoTerms { law });
        }
        if count < parameters {
            let points = count;
            return Err(FitError::TooFewPoints {
                points,
                parameters,
                law,
            });
        }
        let unit = Law::NeoHookean { shear_modulus: 1.0 };
        let modulus = linear_modulus(&unit, points).map(|(modulus, _)| modulus);
        let modulus = modulus.filter(|modulus| *modulus > 0.0).ok_or(FitError::WrongSign)?;
        let coordinates = coordinates(kind, modulus, options)?;
        let bounds = bounds(&coordinates);
        let residuals = |q: &[f64]| evaluate(points, kind, &coordinates, q);
        let minima: Vec<Minimum> = starts(kind, points, modulus, &coordinates)
            .into_iter()
            .filter_map(|start| {
                let start: Vec<f64> = coordinates
                    .iter()
                    .zip(start)
                    .map(|(c, value)| c.coordinate(value))
                    .collect();
                minimise(&residuals, &start, &bounds)
            })
            .collect();
        let least = minima
            .iter()
            .min_by(|a, b| a.sum_of_squares.total_cmp(&b.sum_of_squares));
        let mut best = least.cloned().ok_or(FitError::NoStart { law })?;
        let agrees = |m: &&Minimum| m.sum_of_squares <= best.sum_of_squares * (1.0 + 1e-6);
        let searches = (minima.len(), minima.iter().filter(agrees).count());
        if let LawKind::Ogden(_) = kind {
            best.point = by_exponent(&best.point);
            best.evaluation = residuals(&best.point).ok_or(FitError::NoStart { law })?;
        }
        let law = law_at(kind, &coordinates, &best.point).ok_or(FitError::NoStart { law })?;
        Ok(Self {
            points,
            kind,
            coordinates,
            bounds,
            best,
            searches,
            law,
        })
    }

    fn summary(self, curves: &[Curve], options: &Options) -> Fit {
        let degrees_of_freedom = self.best.evaluation.residual.len() - self.best.point.len();
        let spread = if self.points.stated {
            1.0
        } else {
            (self.best.sum_of_squares / degrees_of_freedom as f64).sqrt()
        };
        let units = self.units();
        let uncertainty = self.uncertainty(spread, &units);
        let (residuals, outliers) = residuals_of_curves(&self.law, self.points, curves, spread);
        let count = self.best.evaluation.residual.len();
        let stability = self.stability(options);
        Fit {
            parameters: self.parameters(&uncertainty, &units, spread, degrees_of_freedom, options.profiles),
            verdict: self.verdict(&uncertainty, &stability),
            stated: self.points.stated,
            sum_of_squares: self.best.sum_of_squares,
            points: count,
            degrees_of_freedom,
            information: Information::new(
                self.points.stated,
                self.best.sum_of_squares,
                count,
                self.best.point.len(),
            ),
            residuals,
            outliers,
            iterations: self.best.iterations,
            searches: self.searches,
            stability,
            law: self.law,
            covariance: uncertainty.covariance,
            directions: uncertainty.directions,
        }
    }

    /// Returns the coordinates that are not at a bound.
    fn free(&self) -> Vec<usize> {
        let inside =
            |&i: &usize| self.best.point[i] > self.bounds.lower[i] && self.best.point[i] < self.bounds.upper[i];
        (0..self.coordinates.len()).filter(inside).collect()
    }

    /// Returns the changes of the coordinates that are relative changes of the parameters. A modulus of any sign has no
    /// logarithm: its unit changes the stresses by as much as they are.
    fn units(&self) -> Vec<f64> {
        let evaluation = &self.best.evaluation;
        let stresses = self
            .points
            .counted()
            .map(|row| (row.stress / row.scale).powi(2))
            .sum::<f64>();
        let unit = |(i, coordinate): (usize, &Coordinate)| {
            let column = (0..evaluation.residual.len()).map(|row| evaluation.jacobian[(row, i)].powi(2));
            if coordinate.logarithmic || coordinate.exponent {
                1.0
            } else {
                (stresses / column.sum::<f64>()).sqrt()
            }
        };
        self.coordinates.iter().enumerate().map(unit).collect()
    }

    fn uncertainty(&self, spread: f64, units: &[f64]) -> Uncertainty {
        let name = |(c, unit): (&Coordinate, &f64)| {
            if c.logarithmic {
                c.name.clone()
            } else if c.exponent {
                format!("exp({})", c.name)
            } else {
                format!("exp({}/{unit:.3e} Pa)", c.name)
            }
        };
        let names: Vec<String> = self.coordinates.iter().zip(units).map(name).collect();
        let known = spread.is_finite() && spread > 0.0;
        let uncertainty = known.then(|| Uncertainty::new(&self.best.evaluation, spread, &names, units, &self.free()));
        let count = units.len();
        uncertainty.flatten().unwrap_or_else(|| Uncertainty {
            standard_errors: vec![None; count],
            covariance: Mat::zeros(count, count),
            directions: Vec::new(),
        })
    }

    fn parameters(
        &self,
        uncertainty: &Uncertainty,
        units: &[f64],
        spread: f64,
        degrees_of_freedom: usize,
        profiles: Profiles,
    ) -> Vec<Parameter> {
        let quantile = if self.points.stated {
            NORMAL_95
        } else {
            student_t(0.95, degrees_of_freedom)
        };
        let free = self.free();
        let residuals = |q: &[f64]| evaluate(self.points, self.kind, &self.coordinates, q);
        let increase = (quantile * spread).powi(2);
        let parameter = |(i, coordinate): (usize, &Coordinate)| {
            let at = self.best.point[i];
            let standard_error = uncertainty.standard_errors[i];
            let range = |(low, high): (f64, f64)| (coordinate.value(low), coordinate.value(high));
            let wide = standard_error.is_none_or(|error| error > WIDE * units[i]);
            let wanted = match profiles {
                Profiles::Never => false,
                Profiles::Wide => wide,
                Profiles::All => true,
            };
            let step = quantile * standard_error.unwrap_or(WIDE * units[i]).min(units[i]);
            Parameter {
                name: coordinate.name.clone(),
                value: coordinate.value(at),
                logarithmic: coordinate.logarithmic,
                standard_error,
                interval: standard_error.map(|error| range((at - quantile * error, at + quantile * error))),
                profile: (wanted && free.contains(&i) && increase.is_finite() && increase > 0.0)
                    .then(|| range(profile(&residuals, &self.bounds, &self.best, i, increase, step))),
                at_bound: !free.contains(&i),
            }
        };
        self.coordinates.iter().enumerate().map(parameter).collect()
    }

    fn stability(&self, options: &Options) -> Stability {
        let reached: Vec<(Test, f64)> = self.points.counted().map(|row| (row.test, row.stretch)).collect();
        let largest = reached.iter().map(|(_, stretch)| *stretch).fold(1.0, f64::max);
        Stability::new(
            &self.law,
            &reached,
            options.largest_stretch.map_or(largest, |l| l.max(largest)),
        )
    }

    fn verdict(&self, uncertainty: &Uncertainty, stability: &Stability) -> Verdict {
        let undetermined: Vec<String> = uncertainty
            .directions
            .iter()
            .filter(|direction| !direction.determined)
            .map(|direction| direction.name.clone())
            .collect();
        if let Some((first, second)) = stability.unstable_at {
            Verdict::Unstable(first, second)
        } else if let Some(kind) = self.reduced() {
            Verdict::ReducesTo(kind)
        } else if !self.best.converged {
            Verdict::NotConverged
        } else if !undetermined.is_empty() {
            Verdict::NotDetermined(undetermined)
        } else {
            Verdict::Determined
        }
    }

    /// Returns the law with fewer parameters that has the same stresses at all points.
    fn reduced(&self) -> Option<LawKind> {
        let same = |row: &Row, other: &Law| -> Option<bool> {
            let stress = self.law.nominal_stress(row.test, row.stretch)?;
            let difference = stress - other.nominal_stress(row.test, row.stretch)?;
            Some(difference.abs() <= SAME_STRESS * stress.abs())
        };
        let reduced = self.law.reduced().into_iter();
        let mut equal = reduced.filter(|other| self.points.counted().all(|row| same(row, other) == Some(true)));
        equal.next().map(|law| law.kind())
    }
}

fn law_at(kind: LawKind, coordinates: &[Coordinate], q: &[f64]) -> Option<Law> {
    let values: Vec<f64> = coordinates.iter().zip(q).map(|(c, q)| c.value(*q)).collect();
    kind.with(&values)
}

/// Returns the residuals of all points with their derivatives; `None` if the law has no value at one of them.
fn evaluate(points: &Points, kind: LawKind, coordinates: &[Coordinate], q: &[f64]) -> Option<Evaluation> {
    let law = law_at(kind, coordinates, q)?;
    let mut residual = Vec::new();
    let mut gradients = Vec::new();
    for row in points.counted() {
        let (stress, gradient) = law.stress_and_gradient(row.test, row.stretch)?;
        residual.push((stress - row.stress) / row.scale);
        gradients.push((gradient, row.scale));
    }
    let factors: Vec<f64> = coordinates
        .iter()
        .zip(q)
        .map(|(c, q)| if c.logarithmic { c.value(*q) } else { 1.0 })
        .collect();
    let jacobian = Mat::from_fn(residual.len(), q.len(), |row, i| {
        let (gradient, scale) = &gradients[row];
        gradient[i] * factors[i] / scale
    });
    Some(Evaluation { residual, jacobian })
}

/// Returns pairs of a modulus and an exponent in the order of exponents.
fn by_exponent(point: &[f64]) -> Vec<f64> {
    let mut pairs: Vec<&[f64]> = point.chunks_exact(2).collect();
    pairs.sort_by(|a, b| a[1].total_cmp(&b[1]));
    pairs.concat()
}

/// Returns the residual of a law at a row; `None` if it has no value there.
pub(crate) fn residual(law: &Law, row: &Row) -> Option<f64> {
    if !row.counts() {
        return Some(0.0);
    }
    Some((law.nominal_stress(row.test, row.stretch)? - row.stress) / row.scale)
}

fn residuals_of_curves(
    law: &Law,
    points: &Points,
    curves: &[Curve],
    spread: f64,
) -> (Vec<CurveResiduals>, Vec<Outlier>) {
    let mut outliers = Vec::new();
    let of_curve = |(index, curve): (usize, &Curve)| {
        let rows = points.rows.iter().filter(|row| row.curve == index);
        let residuals: Vec<f64> = rows.map(|row| residual(law, row).unwrap_or(f64::NAN)).collect();
        for (row, r) in residuals.iter().enumerate() {
            if r.abs() > OUTLIER * spread {
                outliers.push(Outlier {
                    curve: curve.name.clone(),
                    row: row + 1,
                    deviations: r / spread,
                });
            }
        }
        CurveResiduals {
            name: curve.name.clone(),
            residuals,
        }
    };
    (curves.iter().enumerate().map(of_curve).collect(), outliers)
}
