//! What can be wrong with the content of an artifact.

use deaflow_base::{ArtifactId, InputError};
use deaflow_field::FieldError;
use deaflow_pattern::PatternError;
use deaflow_store::StoreError;

/// What is wrong with an artifact.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Two arrays along one axis have different lengths.
    #[error("arrays differ in length: `{path}` has {found} along `{axis}`, `{other}` has {wanted}")]
    Length {
        /// The array that differs.
        path: String,
        /// The shared axis.
        axis: String,
        /// The length of the array.
        found: usize,
        /// The array that it is compared with.
        other: String,
        /// The length of that.
        wanted: usize,
    },
    /// An array does not have the axes that are declared.
    #[error("`{path}` has shape {found:?}, expected {wanted}")]
    Shape {
        /// Which array.
        path: String,
        /// The shape that it has.
        found: Vec<usize>,
        /// The shape that it should have, as in `(sample, y, x)`.
        wanted: String,
    },
    /// An attribute is missing.
    #[error("attribute `{name}` is missing")]
    NoAttribute {
        /// Which.
        name: &'static str,
    },
    /// An attribute cannot be read.
    #[error("cannot read attribute `{name}`: {source}")]
    Attribute {
        /// Which.
        name: &'static str,
        /// Why not.
        source: AttributeError,
    },
    /// An array holds something that is not what it should hold.
    #[error("`{path}`: {source}")]
    Element {
        /// Which array.
        path: String,
        /// What is wrong.
        source: ElementError,
    },
    /// What was simulated does not belong to the patterns.
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

/// An attribute that is not what it should be.
#[derive(Debug, thiserror::Error)]
pub enum AttributeError {
    /// A text in YAML that cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A text in JSON that cannot be read.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}

/// An element that is not what it should be.
#[derive(Debug, thiserror::Error)]
pub enum ElementError {
    /// Numbers that are no pattern.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// Numbers that are no field.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// A word without a meaning here.
    #[error("unknown value {0:?}")]
    Word(String),
}
