//! Why devices cannot be simulated.

use deaflow_fem::SetupError;
use deaflow_pattern::CoverageError;

/// Tolerances that do not fit a scene or a pattern.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ToleranceError {
    /// Nothing varies.
    #[error("no device differs from another: add `tolerances: {{ thickness: 3 %, mask: 0.15 mm }}` to the scene")]
    None,
    /// A setting of the scene.
    #[error("`{tolerance}` of `tolerances` is not simulated with {with}")]
    Setting {
        /// The tolerance.
        tolerance: &'static str,
        /// The setting.
        with: &'static str,
    },
    /// A pattern that is not made of whole cells.
    #[error("`{tolerance}` of `tolerances` needs patterns of whole cells: import drawings with --edges cells")]
    Cells {
        /// The tolerance.
        tolerance: &'static str,
    },
    /// Shares of cells that no pattern has.
    #[error("{0}, as a device is made")]
    Coverage(#[from] CoverageError),
    /// A device that cannot be simulated.
    #[error(transparent)]
    Setup(#[from] SetupError),
}
