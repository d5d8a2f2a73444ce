//! Distance from the wanted displacements.

use super::{Goal, Measure, SCALE_MM};
use deaflow_field::Field;

/// The root mean square distance from the wanted displacements.
pub struct Distance;

impl Measure for Distance {
    fn name(&self) -> &'static str {
        "distance"
    }

    fn needs_displacement(&self) -> bool {
        true
    }

    fn score(&self, goal: &Goal, fields: &[Field]) -> f64 {
        -goal.distance(fields) / SCALE_MM
    }

    fn gradients(&self, goal: &Goal, fields: &[Field]) -> Vec<[f64; 2]> {
        let distance = goal.distance(fields);
        let gradient = |off: [f64; 2]| match distance > 0.0 {
            true => off.map(|off| -off / (distance * SCALE_MM)),
            false => [0.0; 2],
        };
        goal.aims().iter().map(|aim| gradient(aim.off(fields))).collect()
    }
}
