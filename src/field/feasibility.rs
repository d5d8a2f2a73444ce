//! What a design must satisfy that cannot be told from its pattern.

use super::simulate::PredictError;
use deaflow_pattern::Pattern;

/// Says which patterns keep requirements that take a simulation to check, such as margins from pull-in and breakdown.
pub trait Feasibility: Sync {
    /// One verdict per pattern, in order. A verdict does not depend on the other patterns or on the number of threads.
    ///
    /// # Errors
    /// When the simulation cannot be run.
    fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError>;
}
