//! What can go wrong with a figure.

use deaflow_base::OutputError;

/// A figure that could not be made.
#[derive(Debug, thiserror::Error)]
pub enum FigureError {
    /// The numbers do not make a figure.
    #[error("no figure can be drawn: {0}")]
    Data(String),
    /// The drawing cannot be turned into pixels.
    #[error("the figure could not be drawn: {0}")]
    Draw(String),
    /// The file could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}
