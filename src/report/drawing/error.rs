//! What can go wrong with a figure.

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
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
}
