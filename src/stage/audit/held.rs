//! What a dataset says of its own exactness, and what it is held to. A file must not loosen its own check: only who audits may
//! allow more than is usual.

use super::source::Source;
use super::{PER_RESIDUAL, Request, SAME, Trust, USUAL_ACCURACY};
use deaflow_dataset::audit::{Finding, Severity};
use deaflow_fem::Method;
use deaflow_scene::Scene;

/// The residual to which fields are solved where nothing is said.
const USUAL_TOLERANCE: f64 = 1e-8;

/// The residual whose error, at the most, is what labels may differ by.
const LOOSEST: f64 = SAME / PER_RESIDUAL;

/// What the labels of a dataset are held to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// How labels are solved again.
    pub method: Method,
    /// To which relative residual.
    pub residual: f64,
    /// How far they may differ then, relative to the largest displacement.
    pub tolerance: f64,
    /// The error that all rows may have, mm.
    pub accuracy: Option<f64>,
    /// The error that a row may declare for itself, mm.
    pub most_declared: Option<f64>,
}

/// What a dataset is held to, and what it declares beyond that.
pub fn held(source: &Source, scene: &Scene, request: &Request, trust: Trust) -> (Held, Vec<Finding>) {
    let solver = source.solver.as_ref();
    let declared = solver.map_or(USUAL_TOLERANCE, |solver| solver.tolerance());
    let usual = USUAL_ACCURACY * scene.side_mm();
    let residual = match trust {
        Trust::Pipeline => declared,
        Trust::Nothing if declared > LOOSEST => USUAL_TOLERANCE,
        Trust::Nothing => declared,
    };
    let asked = request.accuracy.map(|accuracy| accuracy.value());
    let said = solver
        .and_then(|solver| solver.accuracy())
        .map(|accuracy| accuracy.value());
    let held = Held {
        method: solver.map_or(Method::Newton, |solver| solver.method()),
        residual,
        tolerance: (PER_RESIDUAL * residual).max(SAME),
        accuracy: asked.or_else(|| {
            said.map(|said| match trust {
                Trust::Pipeline => said,
                Trust::Nothing => said.min(usual),
            })
        }),
        most_declared: (trust == Trust::Nothing).then_some(usual),
    };
    let tolerance = (declared > LOOSEST).then(|| loose_tolerance(declared, trust));
    let accuracy = asked
        .is_none()
        .then(|| loose_accuracy(source, said, usual, trust))
        .flatten();
    (held, [tolerance, accuracy].into_iter().flatten().collect())
}

fn loose_tolerance(declared: f64, trust: Trust) -> Finding {
    let held = match trust {
        Trust::Pipeline => "labels are solved again as loosely".to_owned(),
        Trust::Nothing => format!("labels are held to {USUAL_TOLERANCE:e}"),
    };
    let message = format!(
        "labels are declared to be solved to a relative residual of {declared:e}, which leaves them an error above the {SAME:e} that \
         is usual; {held}"
    );
    Finding::whole("declared", Severity::Warning, message)
}

fn loose_accuracy(source: &Source, said: Option<f64>, usual: f64, trust: Trust) -> Option<Finding> {
    let held = match trust {
        Trust::Pipeline => "",
        Trust::Nothing => "; labels are held to that unless --accuracy says otherwise",
    };
    let errors = source.columns.error.iter().flatten().enumerate();
    // What is no length is no error either.
    let loose = errors.filter(|(_, error)| !(0.0..=usual).contains(*error));
    let rows: Vec<usize> = loose.map(|(row, _)| row).collect();
    if !rows.is_empty() {
        let message = format!("`discretisation_error` is no length, or more than the usual {usual} mm{held}");
        return Some(Finding::rows("declared", Severity::Warning, &rows, message));
    }
    let said = said.filter(|said| *said > usual)?;
    let message = format!("an accuracy of {said} mm is declared, more than the usual {usual} mm{held}");
    Some(Finding::whole("declared", Severity::Warning, message))
}
