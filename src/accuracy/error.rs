//! Why accuracy cannot be measured.

use deaflow_fem::{Method, SetupError};
use deaflow_field::PredictError;
use deaflow_surrogate::SceneError;

/// Why accuracy cannot be measured.
#[derive(Debug, thiserror::Error)]
pub enum AccuracyError {
    /// A reference by a method that finds no equilibria.
    #[error("a reference is solved by Newton's method, and this one by `{0}`")]
    ReferenceMethod(Method),
    /// A reference on a mesh than which none is coarser.
    #[error("one bilinear element per cell is the coarsest mesh, and no reference")]
    CoarsestReference,
    /// A method in time beside a reference that is an equilibrium.
    #[error(
        "it finds the state at a time, and the reference is an equilibrium: give the reference `history`, as in {{ at: [10 s] }}"
    )]
    NoTime,
    /// A method whose error the reference cannot tell.
    #[error("{{ {settings} }} is not coarser than the reference {{ {reference} }}: its error cannot be told")]
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
    /// Names the method that an error is about.
    pub(super) fn of(self, settings: String) -> Self {
        Self::Candidate {
            settings,
            why: Box::new(self),
        }
    }
}
