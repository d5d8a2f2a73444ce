//! How motions are measured against a goal: one measure per file, all of them in [`MEASURES`].

mod displacement;
mod distance;
mod qin2024;

use std::fmt;

pub use displacement::Displacement;
pub use distance::Distance;
pub use qin2024::Qin2024;

use super::goal::Goal;

/// The displacement in mm that counts as 1: the top of the paper's deformation space.
const SCALE_MM: f64 = 2.5;

/// Every measure.
pub const MEASURES: [&dyn Measure; 3] = [&Displacement, &Distance, &Qin2024];

/// A measure of how well the motions of points and bodies meet a goal.
pub trait Measure: Sync {
    /// The word after `measure:`.
    fn name(&self) -> &'static str;

    /// Whether each point needs a wanted displacement; a direction is enough otherwise.
    fn needs_displacement(&self) -> bool {
        false
    }

    /// Whether it measures the rotation of a body.
    fn takes_rotations(&self) -> bool {
        true
    }

    /// How good motions of the aims in mm are; larger is better. 1 is worth 2.5 mm of displacement, where a length is measured.
    fn score(&self, goal: &Goal, motions: &[[f64; 2]]) -> f64;

    /// For each aim of the goal the derivative of the score with respect to its motion, per mm, without its weight.
    fn gradients(&self, goal: &Goal, motions: &[[f64; 2]]) -> Vec<[f64; 2]>;
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
