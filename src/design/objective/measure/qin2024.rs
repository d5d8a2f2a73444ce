//! The source paper's equation 6 to the letter (Qin et al., doi 10.1089/soro.2024.0063).

use super::{Goal, Measure};
use crate::objective::aim::PlacedAim;
use deaflow_field::Field;

/// How well the directions agree, regardless of sign and magnitude.
pub struct Qin2024;

impl Measure for Qin2024 {
    fn name(&self) -> &'static str {
        "qin2024"
    }

    fn takes_rotations(&self) -> bool {
        false
    }

    fn score(&self, goal: &Goal, fields: &[Field]) -> f64 {
        goal.mean(|aim| {
            let [x, y] = aim.motion(fields);
            let length = x.hypot(y);
            if length > 0.0 {
                aim.along(fields).abs() / length
            } else {
                0.0
            }
        })
    }

    fn gradients(&self, goal: &Goal, fields: &[Field]) -> Vec<[f64; 2]> {
        goal.aims().iter().map(|aim| gradient(aim, fields)).collect()
    }
}

fn gradient(aim: &PlacedAim, fields: &[Field]) -> [f64; 2] {
    let u = aim.motion(fields);
    let length = u[0].hypot(u[1]);
    if length == 0.0 {
        return [0.0; 2];
    }
    let along = aim.along(fields);
    std::array::from_fn(|k| along.signum() * (aim.direction[k] / length - along * u[k] / (length * length * length)))
}
