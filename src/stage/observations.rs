//! What effects say beside the displacement, as datasets: one for each effect that is on, none for those that are off.

use super::arrays;
use crate::field::Observation;
use crate::scene::Effects;
use crate::store::{Dataset, Object};

/// The datasets for some samples; `None` where a sample has no solution, which becomes NaN.
pub fn datasets(effects: &Effects, observations: &[Option<&Observation>]) -> Vec<(&'static str, Dataset)> {
    let reals = |value: &dyn Fn(&Observation) -> Option<f64>| -> Vec<f64> {
        let value = |o: &Option<&Observation>| o.and_then(value).unwrap_or(f64::NAN);
        observations.iter().map(value).collect()
    };
    let mut found = Vec::new();
    if effects.dielectric_breakdown.is_some() {
        let note = "largest true field over the breakdown field, E/E_B; the membrane fails at 1";
        found.push((
            "breakdown_ratio",
            arrays::reals("1", note, reals(&|o| o.breakdown_ratio)),
        ));
    }
    found
}

/// An object with the datasets of some samples.
pub fn add(object: Object, effects: &Effects, observations: &[Option<&Observation>]) -> Object {
    let datasets = datasets(effects, observations).into_iter();
    datasets.fold(object, |object, (path, dataset)| object.with(path, dataset))
}
