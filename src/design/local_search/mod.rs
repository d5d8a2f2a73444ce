//! Local search along the gradient, from any pattern or from a design of the genetic algorithm.
//!
//! The derivative of the score with respect to the activity of every cell, for each electrode group, costs one linear
//! solve (the adjoint). First, many units are changed at once: those with the largest first-order gains, as many as a
//! simulation confirms. This is thresholding by sensitivity, as in the topology optimisation of binary designs (for
//! instance Sivapuram and Picelli, Finite Elements in Analysis and Design 139, 2018). Then units near the threshold
//! are simulated one by one, since the gain of a whole unit differs from its derivative, and are exchanged in pairs
//! until no promising pair gains.

mod exchange;
mod feasible;
mod gains;
mod problem;
mod search;
mod squares;
mod units;

pub use problem::SearchProblem;

use serde::{Deserialize, Serialize};

use deaflow_field::StateFields;
use deaflow_pattern::Pattern;

/// One step of a local search.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SearchStep {
    /// Displacement along the target directions in mm.
    pub value_mm: f64,
    /// The score; larger is better.
    pub score: f64,
    /// Area fraction.
    pub area: f64,
    /// Charge on the electrodes in nC; 0 where the model does not compute it.
    pub charge: f64,
    /// Number of simulated patterns so far.
    pub simulations: usize,
}

/// The result of a local search.
#[derive(Clone, Debug)]
pub struct LocalOptimum {
    /// The best pattern.
    pub pattern: Pattern,
    /// The fields in the states of the device.
    pub fields: StateFields,
    /// The score; larger is better.
    pub score: f64,
    /// The steps from the start to the best pattern.
    pub steps: Vec<SearchStep>,
    /// Whether no exchange gains; otherwise the maximum number of steps was reached.
    pub exhausted: bool,
}

/// Why a local search cannot start from a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
pub enum StartError {
    /// No pattern near it satisfies the target area and the constraints.
    #[error("cannot satisfy the target area and the constraints")]
    NoPattern,
    /// The pattern near it that satisfies them has no field, or violates the margins.
    #[error("has no stable solution, or violates the margins, at the target area and with the constraints")]
    NoField,
}

#[cfg(test)]
mod tests;
