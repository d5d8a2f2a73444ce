//! Errors of accuracy measurements.

use deaflow_fem::{Method, SetupError};
use deaflow_field::PredictError;
use deaflow_surrogate::SceneError;

/// Why accuracy cannot be measured.
#[derive(Debug, thiserror::Error)]
pub enum AccuracyError {
    /// A reference by a method that does not find equilibria.
    #[error("a reference needs Newton's method; found `{0}`")]
    ReferenceMethod(Method),
    /// A reference on the coarsest mesh.
    #[error("one bilinear element per cell is too coarse to be a reference")]
    CoarsestReference,
    /// A method in time with a reference that is an equilibrium.
    #[error(
        "the method computes the state at a time, but the reference is an equilibrium: add `history` to the reference, \
         as in {{ at: [10 s] }}"
    )]
    NoTime,
    /// A method that is not coarser than the reference.
    #[error("cannot measure the error of {{ {settings} }}: it is not coarser than the reference {{ {reference} }}")]
    NotCoarser {
        /// The method.
        settings: String,
        /// The reference.
        reference: String,
    },
    /// A method that cannot be used.
    #[error("{{ {settings} }}: {why}")]
    Candidate {
        /// The method.
        settings: String,
        /// Why.
        why: Box<AccuracyError>,
    },
    /// A solver that cannot be set up.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// A network for another scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Fields that cannot be predicted.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// A thread that cannot be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] rayon::ThreadPoolBuildError),
}

impl AccuracyError {
    /// Adds the settings of the method to an error.
    pub(super) fn of(self, settings: String) -> Self {
        Self::Candidate {
            settings,
            why: Box::new(self),
        }
    }
}
