//! Gradient-based search: how good a pattern can be, and the finish of what the genetic algorithm found.
//!
//! The derivative of the merit with respect to the activity of every cell costs one more linear solve (the adjoint). A climb
//! follows it in two ways. First many units are turned over at once, those that gain most to first order, as many as a
//! simulation confirms: thresholding by sensitivity, as in the topology optimisation of binary designs (for instance Sivapuram
//! and Picelli, Finite Elements in Analysis and Design 139, 2018). Then units near the threshold are simulated one by one, since
//! a unit that is turned over wholly gains another amount than its derivative says, and are exchanged in pairs until none of the
//! most promising pairs gains.

mod exchange;
mod moves;
mod path;
mod terrain;
mod units;

pub use terrain::Terrain;

use crate::field::Field;
use crate::pattern::Pattern;

/// One step of a climb.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Displacement along the wanted directions in mm.
    pub value_mm: f64,
    /// The merit, larger is better.
    pub merit: f64,
    /// Area fraction.
    pub area: f64,
    /// Patterns that were simulated up to here.
    pub simulations: usize,
}

/// Where a climb led.
#[derive(Clone, Debug)]
pub struct Climb {
    /// The best pattern.
    pub pattern: Pattern,
    /// Its field.
    pub field: Field,
    /// Its merit, larger is better.
    pub merit: f64,
    /// From the start to the best.
    pub steps: Vec<Step>,
    /// Whether it ended because no exchange gains; else it was stopped.
    pub exhausted: bool,
}

#[cfg(test)]
mod tests;
