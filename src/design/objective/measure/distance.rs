//! Distance from the target displacements.

use super::{Measure, SCALE_MM};
use crate::objective::aim::{PlacedAim, rms_error};

/// The root mean square distance from the target displacements.
pub struct Distance;

impl Measure for Distance {
    fn name(&self) -> &'static str {
        "distance"
    }

    fn needs_displacement(&self) -> bool {
        true
    }

    fn score(&self, aims: &[PlacedAim], motions: &[[f64; 2]]) -> f64 {
        -rms_error(aims, motions) / SCALE_MM
    }

    fn gradients(&self, aims: &[PlacedAim], motions: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let distance = rms_error(aims, motions);
        let gradient = |error: [f64; 2]| match distance > 0.0 {
            true => error.map(|error| -error / (distance * SCALE_MM)),
            false => [0.0; 2],
        };
        let pairs = aims.iter().zip(motions);
        pairs.map(|(aim, motion)| gradient(aim.error(*motion))).collect()
    }
}
