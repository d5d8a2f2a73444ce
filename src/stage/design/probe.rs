//! Picks the cheapest evaluator that is accurate enough, by what each says of some patterns of the search.
//!
//! Times differ from run to run, so none is measured here: candidates stand in the order of their cost as `deaflow accuracy`
//! measured it. Errors are reproducible, and so is the choice.

use super::evaluator::Evaluator;
use crate::field::{Field, PredictError};
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::stage::method::Method;
use crate::surrogate::{NetworkKind, Surrogate};

/// Patterns that are looked at.
pub const PATTERNS: usize = 32;

/// Elements along a side of a cell for Newton's method, against which errors are told.
const REFERENCE: u64 = 2;

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
    /// The largest error of the displacement along the wanted directions, as a share of it, on patterns like designs; 0 where
    /// there are none.
    pub design_error: f64,
}

/// Patterns like those that the search will come to, with their displacements along the wanted directions.
pub struct Designs<'a> {
    /// The patterns.
    pub patterns: &'a [Pattern],
    /// Their displacements in mm by finite elements.
    pub values_mm: &'a [f64],
    /// The displacement of a field.
    pub value_mm: &'a dyn Fn(&Field) -> f64,
}

/// The error on patterns like designs that an evaluator may have.
const DESIGN_ERROR: f64 = 0.003;

impl Probe {
    fn suffices(&self, accuracy_mm: f64) -> bool {
        self.known > 0 && self.disagree == 0 && self.rmse_mm <= accuracy_mm && self.design_error <= DESIGN_ERROR
    }
}

impl Designs<'_> {
    /// The largest error of an evaluator; more than any where it has no field.
    fn error_of(&self, evaluator: &Evaluator) -> Result<f64, PredictError> {
        let Ok(predictor) = &evaluator.predictor else {
            return Ok(1.0);
        };
        let fields = predictor.predict_some(self.patterns)?;
        let error = |(field, reference): (Option<Field>, &f64)| match field {
            Some(field) => ((self.value_mm)(&field) - reference).abs() / reference.abs().max(SMALL_MM),
            None => 1.0,
        };
        Ok(fields.into_iter().zip(self.values_mm).map(error).fold(0.0, f64::max))
    }
}

/// Shares of less than this displacement in mm say nothing.
const SMALL_MM: f64 = 0.05;

/// Every evaluator in the order of cost. The last is the reference.
pub fn candidates(scene: &Scene, surrogate: Option<Surrogate>) -> Vec<Evaluator> {
    let elements = |method| Evaluator::elements(scene, method, 1);
    let mut all = vec![
        elements(Method::Linear),
        elements(Method::Chord(1)),
        elements(Method::Chord(2)),
        elements(Method::Newton),
    ];
    if let Some(surrogate) = surrogate {
        let place = match surrogate.kind() {
            NetworkKind::Physics => 2,
            NetworkKind::Qin2024 => all.len(),
        };
        all.insert(place, Evaluator::network(surrogate));
    }
    all.push(Evaluator::elements(scene, Method::Newton, REFERENCE));
    all
}

/// The first candidate whose error on the patterns is at most `accuracy_mm`, that agrees with the last on which of them have a
/// field, and that errs little on patterns like designs; the last itself if there is none. With what each said.
///
/// # Errors
/// When one fails as a whole.
pub fn cheapest(
    mut candidates: Vec<Evaluator>,
    patterns: &[Pattern],
    designs: &Designs<'_>,
    accuracy_mm: f64,
) -> Result<(Evaluator, Vec<Probe>), PredictError> {
    let fields = |evaluator: &Evaluator| match &evaluator.predictor {
        Ok(predictor) => predictor.predict_some(patterns),
        Err(_) => Ok(vec![None; patterns.len()]),
    };
    let found: Vec<Vec<Option<Field>>> = candidates.iter().map(fields).collect::<Result<_, _>>()?;
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

fn compared(settings: &str, found: &[Option<Field>], reference: &[Option<Field>]) -> Probe {
    let pairs = || found.iter().zip(reference);
    let both = pairs().filter_map(|(found, reference)| Some(found.as_ref()?.rms_difference(reference.as_ref()?)));
    let errors: Vec<f64> = both.collect();
    let squares = errors.iter().fold(0.0, |sum, error| sum + error * error);
    Probe {
        settings: settings.to_owned(),
        rmse_mm: (squares / errors.len().max(1) as f64).sqrt(),
        known: errors.len() as u64,
        disagree: pairs().filter(|(a, b)| a.is_some() != b.is_some()).count() as u64,
        design_error: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::first_generation;

    fn chosen(volts: f64, accuracy_mm: f64) -> (String, Vec<Probe>) {
        let scene = Scene::vhb4910().at_voltage(volts);
        let patterns: Vec<Pattern> = first_generation(Some(0.5), &crate::design::Constraints::default(), 1, 8)
            .iter()
            .map(|genome| genome.pattern())
            .collect();
        let none = Designs {
            patterns: &[],
            values_mm: &[],
            value_mm: &|_| 0.0,
        };
        let (evaluator, probes) = cheapest(candidates(&scene, None), &patterns, &none, accuracy_mm).unwrap();
        (evaluator.settings, probes)
    }

    #[test]
    fn the_cheapest_that_is_accurate_enough_is_taken() {
        let (_, probes) = chosen(5250.0, 1.0);
        let errors: Vec<f64> = probes.iter().map(|probe| probe.rmse_mm).collect();
        assert!(errors[0] > 2.0 * errors[1] && errors[1] > errors[2], "{errors:?}");
        assert_eq!(errors[4], 0.0, "the reference itself");
        for (accuracy, place) in [(1.0, 0), (0.5 * (errors[0] + errors[1]), 1), (1e-9, 4)] {
            assert_eq!(chosen(5250.0, accuracy).0, probes[place].settings, "{accuracy}");
        }
    }

    #[test]
    fn evaluators_that_are_blind_to_instability_are_not_taken() {
        let (settings, probes) = chosen(6800.0, 10.0);
        assert!(probes[0].disagree > 0, "{probes:?}");
        assert!(settings.starts_with("method: newton"), "{settings}");
    }

    #[test]
    fn an_evaluator_that_errs_where_designs_are_is_not_taken() {
        let scene = Scene::vhb4910();
        let patterns = [Pattern::from_fn(|x, y| (x * 7 + y * 3) % 5 < 2)];
        let half = [Pattern::from_fn(|x, _| x < 25)];
        let right = |field: &Field| field.at([25.0, 25.0])[0];
        let chosen = |values_mm: &[f64]| {
            let designs = Designs {
                patterns: &half,
                values_mm,
                value_mm: &right,
            };
            cheapest(candidates(&scene, None), &patterns, &designs, 1.0).unwrap()
        };
        // H7: the half plane moves the centre by 2.119 mm; the linear response misses by several per cent.
        let (evaluator, probes) = chosen(&[2.119]);
        assert!(probes[0].design_error > 0.01 && probes[0].rmse_mm < 1.0, "{probes:?}");
        assert!(!evaluator.settings.contains("linear"), "{}", evaluator.settings);
        // Nothing is as wrong as that: the last is taken.
        assert!(chosen(&[20.0]).0.settings.contains("elements_per_cell: 2"));
    }
}
