//! Design requirements that need a simulation.

use super::simulate::PredictError;
use deaflow_pattern::Pattern;

/// Checks requirements that need a simulation, such as margins from pull-in and breakdown.
pub trait Feasibility: Sync {
    /// Returns whether each pattern is feasible, in order. A result does not depend on the other patterns or on the
    /// number of threads.
    ///
    /// # Errors
    /// When the simulation cannot be run.
    fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError>;
}
