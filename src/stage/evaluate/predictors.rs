//! The predictors of an evaluation: trained models, and estimates to compare them with.

use std::collections::BTreeSet;

use crate::model;
use deaflow_fem::{Method, Solver, SolverParameters};
use deaflow_field::{Mesh, Predictor};
use deaflow_orchestrator::StageError;
use deaflow_scene::Scene;
use deaflow_store::Artifact;
use deaflow_surrogate::Surrogate;

/// A predictor with its name.
pub struct NamedPredictor {
    name: String,
    families: BTreeSet<String>,
    digest: String,
    predictor: ModelOrEstimate,
}

enum ModelOrEstimate {
    Model(Box<Surrogate>),
    Estimate(Box<Solver>),
}

impl NamedPredictor {
    /// Loads the model in an artifact; `None` if the artifact has no model.
    ///
    /// # Errors
    /// If it is damaged.
    pub fn model(artifact: &Artifact) -> Result<Option<Self>, StageError> {
        if !model::is_in(artifact) {
            return Ok(None);
        }
        let surrogate = model::of_artifact(artifact)?;
        Ok(Some(Self {
            name: surrogate.kind().name().to_owned(),
            families: model::families(artifact)?,
            digest: artifact.digest().to_string(),
            predictor: ModelOrEstimate::Model(Box::new(surrogate)),
        }))
    }

    /// Sets up an estimate in a scene with one bilinear element per cell, the cheapest: a network should be more
    /// accurate.
    ///
    /// # Errors
    /// If the method cannot estimate in this scene.
    pub fn estimate(method: Method, scene: &Scene) -> Result<Self, StageError> {
        let parameters = SolverParameters::new(method, Mesh::bilinear(1));
        let solver = parameters.build(scene).map_err(StageError::failed)?;
        Ok(Self {
            name: method.to_string(),
            families: BTreeSet::new(),
            digest: String::new(),
            predictor: ModelOrEstimate::Estimate(Box::new(solver)),
        })
    }

    /// Returns the network of a model.
    pub fn surrogate(&self) -> Option<&Surrogate> {
        match &self.predictor {
            ModelOrEstimate::Model(surrogate) => Some(surrogate),
            ModelOrEstimate::Estimate(_) => None,
        }
    }

    /// Returns the name of the network or the method.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether it was trained on a family.
    pub fn is_trained_on(&self, family: &str) -> bool {
        self.families.contains(family)
    }

    /// Returns the digest of the artifact of a model; empty for an estimate.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// Returns the network or the solver.
    pub fn predictor(&self) -> &dyn Predictor {
        match &self.predictor {
            ModelOrEstimate::Model(surrogate) => surrogate.as_ref(),
            ModelOrEstimate::Estimate(solver) => solver.as_ref(),
        }
    }
}
