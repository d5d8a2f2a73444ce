//! Errors of a calibration.

/// Why a calibration cannot be fitted or read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CalibrationError {
    /// Too few patterns.
    #[error("a calibration needs {MIN_PATTERNS} patterns that were not used in training, found {0}")]
    Few(usize),
    /// Too few patterns of the training families.
    #[error("a calibration needs {MIN_PATTERNS} patterns of the training families, found {0}")]
    FewFamiliar(usize),
    /// A feature of a pattern is not a number.
    #[error("the calibration has no solution: a feature of a pattern is not a number")]
    Singular,
    /// The arrays are inconsistent.
    #[error("the arrays of the calibration are inconsistent: {0}")]
    Parts(&'static str),
}

/// Smallest number of patterns of a calibration. Of the second half, one pattern may lie outside its interval.
pub const MIN_PATTERNS: usize = 80;
