//! Displacement along the target directions.

use super::{Measure, SCALE_MM};
use crate::objective::aim::{PlacedAim, mean_along};

/// The mean displacement along the target directions.
pub struct Displacement;

impl Measure for Displacement {
    fn name(&self) -> &'static str {
        "displacement"
    }

    fn score(&self, aims: &[PlacedAim], motions: &[[f64; 2]]) -> f64 {
        mean_along(aims, motions) / SCALE_MM
    }

    fn gradients(&self, aims: &[PlacedAim], _motions: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let gradient = |direction: [f64; 2]| direction.map(|d| d / SCALE_MM);
        aims.iter().map(|aim| gradient(aim.direction)).collect()
    }
}
