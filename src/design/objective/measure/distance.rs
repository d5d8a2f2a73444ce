//! Distance from the wanted displacements.

use super::{Goal, Measure, SCALE_MM};

/// The root mean square distance from the wanted displacements.
pub struct Distance;

impl Measure for Distance {
    fn name(&self) -> &'static str {
        "distance"
    }

    fn needs_displacement(&self) -> bool {
        true
    }

    fn score(&self, goal: &Goal, motions: &[[f64; 2]]) -> f64 {
        -goal.distance(motions) / SCALE_MM
    }

    fn gradients(&self, goal: &Goal, motions: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let distance = goal.distance(motions);
        let gradient = |off: [f64; 2]| match distance > 0.0 {
            true => off.map(|off| -off / (distance * SCALE_MM)),
            false => [0.0; 2],
        };
        let pairs = goal.aims().iter().zip(motions);
        pairs.map(|(aim, motion)| gradient(aim.off(*motion))).collect()
    }
}
