//! The comparison of laws: by information criteria, and by tests that a fit has not seen.

use crate::curve::{Curve, FitError, Points};
use crate::deformation::Test;
use crate::fit::{Fit, LawModel, Options, fit, residual};
use crate::law::LawKind;
use std::collections::BTreeSet;

/// A law in a comparison.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The law.
    pub kind: LawKind,
    /// The fit to all curves.
    pub fit: Result<Fit, FitError>,
    /// The root mean square of the residuals at each test after a fit to the other tests; `None` if that fit is not
    /// possible, or has no value there. Empty if there is one test only.
    pub left_out: Vec<(Test, Option<f64>)>,
}

impl Candidate {
    /// Returns Akaike's criterion; infinite where the law could not be fitted.
    #[must_use]
    pub fn aicc(&self) -> f64 {
        self.fit
            .as_ref()
            .map_or(f64::INFINITY, |fit| fit.estimate.information.aicc)
    }
}

/// Fits several laws to the same curves, and returns them in the order of Akaike's criterion, the best first.
///
/// Errors at tests that were left out may give another order; then the curves do not decide.
///
/// # Errors
/// When a curve is not valid.
pub fn compare(curves: &[Curve], kinds: &[LawKind], options: &Options) -> Result<Vec<Candidate>, FitError> {
    let points = Points::new(curves)?;
    let tests: BTreeSet<Test> = points.counted().map(|row| row.test).collect();
    let left_out = |kind: LawKind| -> Vec<(Test, Option<f64>)> {
        let tests = tests.iter().filter(|_| tests.len() > 1);
        tests
            .map(|&test| (test, error_at(test, &points, kind, options)))
            .collect()
    };
    let candidate = |&kind: &LawKind| Candidate {
        kind,
        fit: fit(curves, kind, options),
        left_out: left_out(kind),
    };
    let mut candidates: Vec<Candidate> = kinds.iter().map(candidate).collect();
    candidates.sort_by(|a, b| a.aicc().total_cmp(&b.aicc()));
    Ok(candidates)
}

/// Returns the root mean square of the residuals at a test after a fit to the others.
fn error_at(test: Test, points: &Points, kind: LawKind, options: &Options) -> Option<f64> {
    let [others, left_out] = [points.of(|of| of != test), points.of(|of| of == test)];
    let model = LawModel::new(&others, kind, options).ok()?;
    let law = model.law(&model.solve().ok()?).ok()?;
    let residuals: Option<Vec<f64>> = left_out.counted().map(|row| residual(&law, row)).collect();
    let residuals = residuals?;
    let sum: f64 = residuals.iter().map(|r| r * r).sum();
    Some((sum / residuals.len() as f64).sqrt())
}
