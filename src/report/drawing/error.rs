//! Errors of figures.

use deaflow_base::OutputError;

/// A figure could not be drawn or written.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The data is incomplete or not finite.
    #[error("cannot draw the figure: {0}")]
    Data(String),
    /// The SVG cannot be rasterised.
    #[error("cannot rasterise the figure: {0}")]
    Draw(String),
    /// The file could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}
