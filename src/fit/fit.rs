//! The fit of one law to curves.

use crate::curve::{Curve, FitError, Points, Row};
use crate::deformation::Test;
use crate::law::{Law, LawKind};
use crate::solution::{Coordinate, Estimate, Model, Parameter, Profiles, Solution, check_points};
use crate::stability::Stability;
use crate::starts::{coordinates, neo_hookean_modulus, starts};
use crate::warning::{Warning, warnings};
use std::fmt;

/// Residuals beyond this many standard deviations are outliers: one of 16,000 normal deviates.
const OUTLIER: f64 = 4.0;
/// A law reduces to another one if their stresses differ by less than this at all points.
const SAME_STRESS: f64 = 1e-6;

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
    /// The data bound these parameters on one side at most.
    Open(Vec<String>),
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
            Self::Open(names) => write!(f, "the data bound {} on one side at most", names.join(", ")),
        }
    }
}

/// A fitted law.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The law with its values.
    pub law: Law,
    /// The parameters in the order of [`LawKind::parameters`]; Ogden's terms with rising exponents.
    pub estimate: Estimate,
    /// The residuals.
    pub residuals: Vec<CurveResiduals>,
    /// Points far from the law.
    pub outliers: Vec<Outlier>,
    /// The stability of the law.
    pub stability: Stability,
    /// What in the data should be looked at.
    pub warnings: Vec<Warning>,
    /// The result in one word.
    pub verdict: Verdict,
}

/// Fits a law to curves.
///
/// # Errors
/// When a curve is not valid, the bounds are not, or the curves cannot determine the law.
pub fn fit(curves: &[Curve], kind: LawKind, options: &Options) -> Result<Fit, FitError> {
    let points = Points::new(curves)?;
    let model = LawModel::new(&points, kind, options)?;
    let solution = model.solve()?;
    let law = model.law(&solution)?;
    let estimate = solution.estimate(options.profiles);
    let stability = stability(&law, &points, options);
    let residuals = residuals_of_curves(&law, &points, curves);
    let verdict = match (stability.unstable_at, reduced(&law, &points)) {
        (Some((first, second)), _) => Verdict::Unstable(first, second),
        (None, Some(kind)) => Verdict::ReducesTo(kind),
        (None, None) => Verdict::of(&estimate),
    };
    Ok(Fit {
        law,
        outliers: outliers(&residuals, solution.spread()),
        residuals,
        stability,
        warnings: warnings(curves, kind, options, &estimate),
        estimate,
        verdict,
    })
}

impl Verdict {
    /// Returns the verdict on parameters of a stable model.
    pub(crate) fn of(estimate: &Estimate) -> Self {
        let undetermined = estimate.directions.iter().filter(|direction| !direction.determined);
        let undetermined: Vec<String> = undetermined.map(|direction| direction.name.clone()).collect();
        let is_open = |p: &&Parameter| {
            let least = if p.logarithmic { 0.0 } else { f64::NEG_INFINITY };
            p.profile
                .is_some_and(|(low, high)| low <= least || high == f64::INFINITY)
        };
        let open: Vec<String> = estimate
            .parameters
            .iter()
            .filter(is_open)
            .map(|p| p.name.clone())
            .collect();
        match (estimate.converged, undetermined.is_empty(), open.is_empty()) {
            (false, ..) => Self::NotConverged,
            (true, false, _) => Self::NotDetermined(undetermined),
            (true, true, false) => Self::Open(open),
            (true, true, true) => Self::Determined,
        }
    }
}

/// A law and the points to which it is fitted.
pub(crate) struct LawModel<'a> {
    points: &'a Points,
    kind: LawKind,
    modulus: f64,
    coordinates: Vec<Coordinate>,
}

impl<'a> LawModel<'a> {
    /// Prepares a search.
    ///
    /// # Errors
    /// When there are too few points, or the bounds are not valid.
    pub fn new(points: &'a Points, kind: LawKind, options: &Options) -> Result<Self, FitError> {
        let names = kind.parameters();
        if names.is_empty() {
            return Err(FitError::NoTerms { law: kind.name() });
        }
        check_points(points.counted().count(), names.len(), kind.name())?;
        let modulus = neo_hookean_modulus(points)?;
        Ok(Self {
            coordinates: coordinates(kind.name(), names, modulus, options)?,
            points,
            kind,
            modulus,
        })
    }

    /// Searches from all starts.
    ///
    /// # Errors
    /// When no start has a value.
    pub fn solve(&self) -> Result<Solution<'_>, FitError> {
        let starts = starts(self.kind, self.points, self.modulus, &self.coordinates);
        Solution::new(self, &starts).ok_or(self.no_start())
    }

    /// Returns the law with the values of a solution.
    ///
    /// # Errors
    /// When the solution is that of another law.
    pub fn law(&self, solution: &Solution<'_>) -> Result<Law, FitError> {
        self.kind.with(&solution.values()).ok_or(self.no_start())
    }

    fn no_start(&self) -> FitError {
        FitError::NoStart { law: self.kind.name() }
    }
}

impl Model for LawModel<'_> {
    fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }

    fn residuals(&self, values: &[f64]) -> Option<Vec<(f64, Vec<f64>)>> {
        let law = self.kind.with(values)?;
        let row = |row: &Row| {
            let (stress, gradient) = law.stress_and_gradient(row.test, row.stretch)?;
            let gradient = gradient.into_iter().map(|slope| slope / row.scale).collect();
            Some(((stress - row.stress) / row.scale, gradient))
        };
        self.points.counted().map(row).collect()
    }

    fn data(&self) -> f64 {
        self.points.counted().map(|row| (row.stress / row.scale).powi(2)).sum()
    }

    fn stated(&self) -> bool {
        self.points.stated
    }

    fn pairs_from(&self) -> Option<usize> {
        matches!(self.kind, LawKind::Ogden(_)).then_some(0)
    }
}

fn stability(law: &Law, points: &Points, options: &Options) -> Stability {
    let reached: Vec<(Test, f64)> = points.counted().map(|row| (row.test, row.stretch)).collect();
    let largest = reached.iter().map(|(_, stretch)| *stretch).fold(1.0, f64::max);
    Stability::new(
        law,
        &reached,
        options.largest_stretch.map_or(largest, |l| l.max(largest)),
    )
}

/// Returns the law with fewer parameters that has the same stresses at all points.
fn reduced(law: &Law, points: &Points) -> Option<LawKind> {
    let same = |row: &Row, other: &Law| -> Option<bool> {
        let stress = law.nominal_stress(row.test, row.stretch)?;
        let difference = stress - other.nominal_stress(row.test, row.stretch)?;
        Some(difference.abs() <= SAME_STRESS * stress.abs())
    };
    let fewer = law.reduced().into_iter();
    let mut equal = fewer.filter(|other| points.counted().all(|row| same(row, other) == Some(true)));
    equal.next().map(|law| law.kind())
}

/// Returns the residual of a law at a row; `None` if it has no value there.
pub(crate) fn residual(law: &Law, row: &Row) -> Option<f64> {
    if !row.counts() {
        return Some(0.0);
    }
    Some((law.nominal_stress(row.test, row.stretch)? - row.stress) / row.scale)
}

fn residuals_of_curves(law: &Law, points: &Points, curves: &[Curve]) -> Vec<CurveResiduals> {
    let of_curve = |(index, curve): (usize, &Curve)| {
        let rows = points.rows.iter().filter(|row| row.curve == index);
        CurveResiduals {
            name: curve.name.clone(),
            residuals: rows.map(|row| residual(law, row).unwrap_or(f64::NAN)).collect(),
        }
    };
    curves.iter().enumerate().map(of_curve).collect()
}

/// Returns the points whose residuals are far beyond the standard deviation of all.
pub(crate) fn outliers(curves: &[CurveResiduals], spread: f64) -> Vec<Outlier> {
    let rows = |curve: &CurveResiduals| -> Vec<Outlier> {
        let far = curve
            .residuals
            .iter()
            .enumerate()
            .filter(|(_, r)| r.abs() > OUTLIER * spread);
        let outlier = |(row, r): (usize, &f64)| Outlier {
            curve: curve.name.clone(),
            row: row + 1,
            deviations: r / spread,
        };
        far.map(outlier).collect()
    };
    curves.iter().flat_map(rows).collect()
}
