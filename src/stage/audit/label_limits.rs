//! The limits that an audit sets for the labels of a dataset, given what the dataset declares of its accuracy. A file
//! from elsewhere must not loosen its own check: only the user may allow a larger error than usual.

use super::source::Source;
use deaflow_dataset::audit::{Finding, Severity};
use deaflow_fem::Method;
use deaflow_scene::Scene;

/// The relative residual to which fields are solved if nothing is declared.
const USUAL_TOLERANCE: f64 = 1e-8;

/// A label that is solved again differs by the tolerance of the solver, which stops at a residual; the relative error
/// of the displacement is at most this many times larger.
const PER_RESIDUAL: f64 = 10.0;

/// The smallest relative difference that counts. Last bits differ between solutions: estimates of 300 images of
/// patterns differed from the images of their estimates by at most 5e-7 of the largest displacement.
const SAME: f64 = 1e-5;

/// The largest residual whose error stays below [`SAME`].
const LOOSEST: f64 = SAME / PER_RESIDUAL;

/// The assumed accuracy if nothing is declared, as a fraction of the membrane's side: 0.02 mm of 50 mm.
pub const USUAL_ACCURACY: f64 = 4e-4;

/// Whether the declarations of a dataset are trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trust {
    /// It was made by the pipeline in which it is audited: yes.
    Pipeline,
    /// It comes from elsewhere: no.
    Nothing,
}

/// The limits for the labels of a dataset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LabelLimits {
    /// The method that solves labels again.
    pub method: Method,
    /// Its relative residual.
    pub residual: f64,
    /// The allowed difference, relative to the largest displacement.
    pub tolerance: f64,
    /// The allowed error of all rows, mm.
    pub accuracy: Option<f64>,
    /// The largest error that a row may declare, mm.
    pub most_declared: Option<f64>,
}

/// Returns the limits for the labels of a dataset, with findings if it declares larger errors than usual. `allowed_mm`
/// is the accuracy in mm that the user allows.
pub fn label_limits(
    source: &Source,
    scene: &Scene,
    allowed_mm: Option<f64>,
    trust: Trust,
) -> (LabelLimits, Vec<Finding>) {
    let solver = source.solver.as_ref();
    let declared = solver.map_or(USUAL_TOLERANCE, |solver| solver.tolerance());
    let usual = USUAL_ACCURACY * scene.side_mm();
    let residual = match trust {
        Trust::Nothing if declared > LOOSEST => USUAL_TOLERANCE,
        _ => declared,
    };
    let declared_mm = solver
        .and_then(|solver| solver.accuracy())
        .map(|accuracy| accuracy.value());
    let limits = LabelLimits {
        method: solver.map_or(Method::Newton, |solver| solver.method()),
        residual,
        tolerance: (PER_RESIDUAL * residual).max(SAME),
        accuracy: allowed_mm.or_else(|| {
            declared_mm.map(|declared_mm| match trust {
                Trust::Pipeline => declared_mm,
                Trust::Nothing => declared_mm.min(usual),
            })
        }),
        most_declared: (trust == Trust::Nothing).then_some(usual),
    };
    let tolerance = (declared > LOOSEST).then(|| loose_tolerance(declared, trust));
    let accuracy = allowed_mm
        .is_none()
        .then(|| loose_accuracy(source, declared_mm, usual, trust))
        .flatten();
    (limits, [tolerance, accuracy].into_iter().flatten().collect())
}

fn loose_tolerance(declared: f64, trust: Trust) -> Finding {
    let held = match trust {
        Trust::Pipeline => "labels are solved again as loosely".to_owned(),
        Trust::Nothing => format!("labels are held to {USUAL_TOLERANCE:e}"),
    };
    let message = format!(
        "labels are declared to be solved to a relative residual of {declared:e}, which leaves them an error above the \
         {SAME:e} that is usual; {held}"
    );
    Finding::whole("declared", Severity::Warning, message)
}

fn loose_accuracy(source: &Source, declared_mm: Option<f64>, usual: f64, trust: Trust) -> Option<Finding> {
    let held = match trust {
        Trust::Pipeline => "",
        Trust::Nothing => "; labels are held to that unless --accuracy says otherwise",
    };
    let errors = source.columns.error.iter().flatten().enumerate();
    // NaN and negative numbers are not errors either.
    let loose = errors.filter(|(_, error)| !(0.0..=usual).contains(*error));
    let rows: Vec<usize> = loose.map(|(row, _)| row).collect();
    if !rows.is_empty() {
        let message = format!("`discretisation_error` is no length, or more than the usual {usual} mm{held}");
        return Some(Finding::rows("declared", Severity::Warning, &rows, message));
    }
    let declared_mm = declared_mm.filter(|declared_mm| *declared_mm > usual)?;
    let message = format!("an accuracy of {declared_mm} mm is declared, more than the usual {usual} mm{held}");
    Some(Finding::whole("declared", Severity::Warning, message))
}
