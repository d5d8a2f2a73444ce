//! Measures of motions against their aims: one per file, listed in [`MEASURES`].

mod displacement;
mod distance;
mod qin2024;

use std::fmt;

pub use displacement::Displacement;
pub use distance::Distance;
pub use qin2024::Qin2024;

use super::aim::PlacedAim;

/// The displacement in mm that has score 1: the upper end of the paper's deformation space.
pub const SCALE_MM: f64 = 2.5;

/// Every measure.
pub const MEASURES: [&dyn Measure; 3] = [&Displacement, &Distance, &Qin2024];

/// A measure of the motions of points and bodies.
pub trait Measure: Sync {
    /// The value of the key `measure`.
    fn name(&self) -> &'static str;

    /// Whether each point needs a target displacement; otherwise a direction is enough.
    fn needs_displacement(&self) -> bool {
        false
    }

    /// Whether rotations of bodies and areas of regions can be measured.
    fn supports_scalars(&self) -> bool {
        true
    }

    /// The score of the motions of the aims in mm; larger is better. For lengths, 2.5 mm has score 1.
    fn score(&self, aims: &[PlacedAim], motions: &[[f64; 2]]) -> f64;

    /// The derivative of the score with respect to the motion of each aim, per mm, without the weight of the aim.
    fn gradients(&self, aims: &[PlacedAim], motions: &[[f64; 2]]) -> Vec<[f64; 2]>;
}

impl PartialEq for dyn Measure {
    fn eq(&self, other: &Self) -> bool {
        self.name() == other.name()
    }
}

impl Eq for dyn Measure {}

impl fmt::Debug for dyn Measure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
