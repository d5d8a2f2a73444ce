//! What is evaluated: a trained model, or an estimate that is to be beaten.

use std::collections::BTreeSet;

use crate::model;
use deaflow_fem::{Method, Solver, SolverParameters};
use deaflow_field::{Mesh, Predictor};
use deaflow_orchestrator::StageError;
use deaflow_scene::Scene;
use deaflow_store::Artifact;
use deaflow_surrogate::Surrogate;

/// A predictor with what it is called.
pub struct NamedPredictor {
    name: String,
    families: BTreeSet<String>,
    digest: String,
    answers: Answers,
}

enum Answers {
    Model(Box<Surrogate>),
    Estimate(Box<Solver>),
}

impl NamedPredictor {
    /// The model in an artifact; none where the artifact is something else.
    ///
    /// # Errors
    /// When it is damaged.
    pub fn model(artifact: &Artifact) -> Result<Option<Self>, StageError> {
        if !model::is_in(artifact) {
            return Ok(None);
        }
        let surrogate = model::of_artifact(artifact)?;
        Ok(Some(Self {
            name: surrogate.kind().name().to_owned(),
            families: model::families(artifact)?,
            digest: artifact.digest().to_string(),
            answers: Answers::Model(Box::new(surrogate)),
        }))
    }

    /// An estimate in a scene, with one bilinear element per cell: the cheapest, and what a network has to beat.
    ///
    /// # Errors
    /// When there is none in this scene.
    pub fn estimate(method: Method, scene: &Scene) -> Result<Self, StageError> {
        let parameters = SolverParameters::new(method, Mesh::bilinear(1));
        let solver = parameters.build(scene).map_err(StageError::failed)?;
        Ok(Self {
            name: method.to_string(),
            families: BTreeSet::new(),
            digest: String::new(),
            answers: Answers::Estimate(Box::new(solver)),
        })
    }

    /// The network of a model.
    pub fn surrogate(&self) -> Option<&Surrogate> {
        match &self.answers {
            Answers::Model(surrogate) => Some(surrogate),
            Answers::Estimate(_) => None,
        }
    }

    /// The network or the method.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether it learned from a family.
    pub fn learned_from(&self, family: &str) -> bool {
        self.families.contains(family)
    }

    /// The digest of the artifact of a model; empty for an estimate.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// What says what the field of a pattern is.
    pub fn predictor(&self) -> &dyn Predictor {
        match &self.answers {
            Answers::Model(surrogate) => surrogate.as_ref(),
            Answers::Estimate(solver) => solver.as_ref(),
        }
    }
}
