//! Local search along the gradient: how good a pattern can be, and the refinement of what the genetic algorithm found.
//!
//! The derivative of the score with respect to the activity of every cell, for each group of electrodes, costs one more linear solve (the adjoint). It is
//! used in two ways. First many units are turned on, off or to another group at once, those that gain most to first order, as many as a simulation
//! confirms: thresholding by sensitivity, as in the topology optimisation of binary designs (for instance Sivapuram and
//! Picelli, Finite Elements in Analysis and Design 139, 2018). Then units near the threshold are simulated one by one, since
//! flipping a whole unit gains another amount than its derivative says, and are exchanged in pairs until none of the most
//! promising pairs gains.

mod exchange;
mod gains;
mod problem;
mod search;
mod squares;
mod units;

pub use problem::{SearchProblem, Unsuited};

use deaflow_field::StateFields;
use deaflow_pattern::Pattern;

/// One step of a local search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchStep {
    /// Displacement along the wanted directions in mm.
    pub value_mm: f64,
    /// The score, larger is better.
    pub score: f64,
    /// Area fraction.
    pub area: f64,
    /// Patterns that were simulated up to here.
    pub simulations: usize,
}

/// Where a local search ended.
#[derive(Clone, Debug)]
pub struct LocalOptimum {
    /// The best pattern.
    pub pattern: Pattern,
    /// Its fields in the states of the device.
    pub fields: StateFields,
    /// Its score, larger is better.
    pub score: f64,
    /// From the start to the best.
    pub steps: Vec<SearchStep>,
    /// Whether it ended because no exchange gains; otherwise it was stopped.
    pub exhausted: bool,
}

#[cfg(test)]
mod tests;
