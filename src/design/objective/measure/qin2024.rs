//! The literal equation 6 of the source paper (Qin et al., doi 10.1089/soro.2024.0063).

use super::Measure;
use crate::objective::aim::{PlacedAim, weighted_mean};

/// The agreement of the directions, without sign and magnitude.
pub struct Qin2024;

impl Measure for Qin2024 {
    fn name(&self) -> &'static str {
        "qin2024"
    }

    fn supports_scalars(&self) -> bool {
        false
    }

    fn score(&self, aims: &[PlacedAim], motions: &[[f64; 2]]) -> f64 {
        weighted_mean(aims, motions, |aim, u| {
            let length = u[0].hypot(u[1]);
            if length > 0.0 { aim.along(u).abs() / length } else { 0.0 }
        })
    }

    fn gradients(&self, aims: &[PlacedAim], motions: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let pairs = aims.iter().zip(motions);
        pairs.map(|(aim, motion)| gradient(aim, *motion)).collect()
    }
}

fn gradient(aim: &PlacedAim, u: [f64; 2]) -> [f64; 2] {
    let length = u[0].hypot(u[1]);
    if length == 0.0 {
        return [0.0; 2];
    }
    let along = aim.along(u);
    std::array::from_fn(|k| along.signum() * (aim.direction[k] / length - along * u[k] / (length * length * length)))
}
