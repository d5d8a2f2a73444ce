//! Errors of the content of an artifact.

use deaflow_base::{ArtifactId, InputError};
use deaflow_field::FieldError;
use deaflow_pattern::PatternError;
use deaflow_store::StoreError;

/// An error of the content of an artifact.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Two arrays along one axis have different lengths.
    #[error("arrays differ in length: `{path}` has {found} along `{axis}`, `{other}` has {expected}")]
    Length {
        /// The array.
        path: String,
        /// The shared axis.
        axis: String,
        /// Its length.
        found: usize,
        /// The array that it is compared with.
        other: String,
        /// The length of the other array.
        expected: usize,
    },
    /// An array does not have the declared axes.
    #[error("`{path}` has shape {found:?}, expected {expected}")]
    Shape {
        /// The array.
        path: String,
        /// Its shape.
        found: Vec<usize>,
        /// The declared shape, as in `(sample, y, x)`.
        expected: String,
    },
    /// An attribute is missing.
    #[error("attribute `{name}` is missing")]
    NoAttribute {
        /// The attribute.
        name: &'static str,
    },
    /// An attribute is invalid.
    #[error("cannot read attribute `{name}`: {source}")]
    Attribute {
        /// The attribute.
        name: &'static str,
        /// The reason.
        source: AttributeError,
    },
    /// An element of an array is invalid.
    #[error("`{path}`: {source}")]
    Element {
        /// The array.
        path: String,
        /// The reason.
        source: ElementError,
    },
    /// The arrays of simulations do not fit the patterns.
    #[error("arrays differ in length: the arrays of simulations need one row for each pattern with a field")]
    Simulated,
}

impl Fault {
    /// Returns the error of the store for the artifact that has this fault.
    #[must_use]
    pub fn of(self, digest: ArtifactId) -> StoreError {
        let source = self.into();
        StoreError::Content { digest, source }
    }
}

/// An error of an attribute.
#[derive(Debug, thiserror::Error)]
pub enum AttributeError {
    /// Invalid YAML.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Invalid JSON.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// An invalid number.
    #[error(transparent)]
    Number(#[from] std::num::ParseFloatError),
}

/// An error of an element.
#[derive(Debug, thiserror::Error)]
pub enum ElementError {
    /// The numbers are not a pattern.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// The numbers are not a field.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// The word is unknown.
    #[error("unknown value {0:?}")]
    Word(String),
    /// The arrays are not the shapes of electrodes.
    #[error("`electrodes` are not shapes of electrode groups: {0}")]
    Electrodes(&'static str),
    /// The arrays are not the shares of cells that electrodes cover.
    #[error("`covered` are not the shares of cells that electrodes cover: {0}")]
    Covered(String),
}
