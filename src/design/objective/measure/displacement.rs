//! Displacement along the wanted directions.

use super::{Goal, Measure, SCALE_MM};

/// The mean displacement along the wanted directions.
pub struct Displacement;

impl Measure for Displacement {
    fn name(&self) -> &'static str {
        "displacement"
    }

    fn score(&self, goal: &Goal, motions: &[[f64; 2]]) -> f64 {
        goal.value_of(motions) / SCALE_MM
    }

    fn gradients(&self, goal: &Goal, _motions: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let gradient = |direction: [f64; 2]| direction.map(|d| d / SCALE_MM);
        goal.aims().iter().map(|aim| gradient(aim.direction)).collect()
    }
}
