//! Picks the cheapest evaluator that is accurate enough, by what each says of some patterns of the search.
//!
//! Times differ from run to run, so none is measured here: candidates stand in the order of their cost as `deaflow accuracy`
//! measured it. Errors are reproducible, and so is the choice.

use super::Cause;
use deaflow_field::{Evaluator, Field, InStates, PredictError, Predictor, StateFields};
use deaflow_pattern::Pattern;

/// Patterns of the first generation on which evaluators are compared.
pub(super) const PATTERNS: usize = 32;

/// An evaluator, or what keeps it from being used.
pub struct Candidate {
    /// Its settings on one line, as in an accuracy stage.
    pub settings: String,
    /// The evaluator in each state of the device, or why it cannot be used.
    pub evaluator: Result<InStates<Box<dyn Evaluator>>, Cause>,
}

/// What an evaluator said of the patterns.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// Its settings.
    pub settings: String,
    /// Root mean square error of a component in mm, over the patterns of which it and the reference have a field; 0 where
    /// there are none.
    pub rmse_mm: f64,
    /// How many these are.
    pub known: u64,
    /// Patterns of which one has a field and the other has none.
    pub disagree: u64,
    /// The largest error of the displacement along the wanted directions, as a share of it, on patterns similar to designs; 0
    /// where there are none.
    pub design_error: f64,
}

/// Patterns similar to designs, with their displacements along the wanted directions.
pub struct References<'a> {
    /// The patterns.
    pub patterns: &'a [Pattern],
    /// Their displacements in mm by finite elements.
    pub values_mm: &'a [f64],
    /// The displacement of fields.
    pub value_mm: &'a dyn Fn(&[Field]) -> f64,
}

/// The error on patterns similar to designs that an evaluator may have.
const DESIGN_ERROR: f64 = 0.003;

impl Probe {
    fn suffices(&self, accuracy_mm: f64) -> bool {
        self.known > 0 && self.disagree == 0 && self.rmse_mm <= accuracy_mm && self.design_error <= DESIGN_ERROR
    }
}

impl References<'_> {
    /// The largest error of an evaluator; more than any where it has no field.
    fn error_of(&self, evaluator: &Candidate) -> Result<f64, PredictError> {
        let Ok(predictor) = &evaluator.evaluator else {
            return Ok(1.0);
        };
        let fields = predictor.predict_some(self.patterns)?;
        let error = |(fields, reference): (Option<StateFields>, &f64)| match fields {
            Some(fields) => ((self.value_mm)(&fields) - reference).abs() / reference.abs().max(SMALL_MM),
            None => 1.0,
        };
        Ok(fields.into_iter().zip(self.values_mm).map(error).fold(0.0, f64::max))
    }
}

/// Shares of less than this displacement in mm say nothing.
const SMALL_MM: f64 = 0.05;

/// The first candidate whose error on the patterns is at most `accuracy_mm`, that agrees with the last on which of them have a
/// field, and that errs little on patterns similar to designs; the last itself if there is none. With what each said.
///
/// # Errors
/// When one fails as a whole.
pub fn cheapest_evaluator(
    mut candidates: Vec<Candidate>,
    patterns: &[Pattern],
    designs: &References<'_>,
    accuracy_mm: f64,
) -> Result<(Candidate, Vec<Probe>), PredictError> {
    let fields = |evaluator: &Candidate| match &evaluator.evaluator {
        Ok(predictor) => predictor.predict_some(patterns),
        Err(_) => Ok(vec![None; patterns.len()]),
    };
    let found: Vec<Vec<Option<StateFields>>> = candidates.iter().map(fields).collect::<Result<_, _>>()?;
    let reference = found.last().map_or(&[][..], Vec::as_slice);
    let pairs = candidates.iter().zip(&found);
    let mut probes: Vec<Probe> = pairs
        .map(|(candidate, found)| compared(&candidate.settings, found, reference))
        .collect();
    for (probe, candidate) in probes.iter_mut().zip(&candidates) {
        probe.design_error = designs.error_of(candidate)?;
    }
    let place = probes.iter().position(|probe| probe.suffices(accuracy_mm));
    let place = place.unwrap_or(candidates.len().saturating_sub(1));
    Ok((candidates.swap_remove(place), probes))
}

fn compared(settings: &str, found: &[Option<StateFields>], reference: &[Option<StateFields>]) -> Probe {
    let pairs = || found.iter().zip(reference);
    let both = || pairs().filter_map(|(found, reference)| Some((found.as_ref()?, reference.as_ref()?)));
    let of_states = both().flat_map(|(found, reference)| found.iter().zip(reference));
    let errors: Vec<f64> = of_states
        .map(|(found, reference)| found.rms_difference(reference))
        .collect();
    let squares = errors.iter().fold(0.0, |sum, error| sum + error * error);
    Probe {
        settings: settings.to_owned(),
        rmse_mm: (squares / errors.len().max(1) as f64).sqrt(),
        known: both().count() as u64,
        disagree: pairs().filter(|(a, b)| a.is_some() != b.is_some()).count() as u64,
        design_error: 0.0,
    }
}
