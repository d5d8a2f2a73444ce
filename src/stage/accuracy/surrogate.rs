//! A trained network as a method to be measured.

use super::contender::{Contender, Ready};
use crate::base::{Canonical, Digest, InputError, Node, read_bounded};
use crate::fem::SolverParameters;
use crate::field::{Field, Predictor};
use crate::orchestrator::StageError;
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::stage::model;
use crate::store::Artifact;
use crate::surrogate::{LoadError, Surrogate};
use std::path::Path;
use std::sync::Arc;

/// A network is asked for many patterns at once where it serves: so many.
pub const BATCH: usize = 1000;

/// How settings of networks begin.
pub const NETWORK: &str = "network: ";

/// A model is some hundred megabytes at most; more is another kind of file.
const MAX_BYTES: u64 = 4 << 30;

/// The network.
pub struct Network {
    surrogate: Arc<Surrogate>,
    digest: Digest,
    /// Whether another of the same name is measured too.
    ambiguous: bool,
}

impl Network {
    /// From the bytes of a safetensors file.
    ///
    /// # Errors
    /// When they are no model.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadError> {
        Ok(Self {
            surrogate: Arc::new(Surrogate::load(bytes)?),
            digest: Digest::of(bytes),
            ambiguous: false,
        })
    }

    /// From the artifact of a train stage.
    ///
    /// # Errors
    /// When it holds no model.
    pub fn of_artifact(artifact: &Artifact) -> Result<Self, StageError> {
        let wrong = |e: LoadError| StageError::Input(format!("artifact {}: {e}", artifact.digest().short()));
        Self::from_bytes(&model::weights(artifact)?).map_err(wrong)
    }

    /// From the file that a node names.
    ///
    /// # Errors
    /// When it cannot be read, or is no model.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let path = node.text("model")?;
        let bytes = read_bounded(Path::new(path), MAX_BYTES)
            .map_err(|e| node.error(format!("cannot read {path} as a model: {e}")))?;
        Self::from_bytes(&bytes).map_err(|e| node.error(format!("cannot use {path}: {e}")))
    }
}

/// Names networks so that no two are called the same: by their digests too where they must be.
pub fn named(mut networks: Vec<Network>) -> Vec<Box<dyn Contender>> {
    let names: Vec<&str> = networks.iter().map(|network| network.surrogate.kind().name()).collect();
    let ambiguous: Vec<bool> = names
        .iter()
        .map(|name| names.iter().filter(|other| other == &name).count() > 1)
        .collect();
    networks
        .iter_mut()
        .zip(ambiguous)
        .for_each(|(network, ambiguous)| network.ambiguous = ambiguous);
    let boxed = networks
        .into_iter()
        .map(|network| Box::new(network) as Box<dyn Contender>);
    boxed.collect()
}

impl Contender for Network {
    fn settings(&self) -> String {
        let name = self.surrogate.kind().name();
        if self.ambiguous {
            format!("{NETWORK}{name}, model: {}", self.digest.short())
        } else {
            format!("{NETWORK}{name}")
        }
    }

    fn canonical(&self) -> Canonical {
        Canonical::map([("model", self.digest.to_string().as_str().into())])
    }

    fn promise_mm(&self) -> Option<f64> {
        None
    }

    fn finds_equilibria(&self) -> bool {
        false
    }

    fn is_coarser_than(&self, _reference: &SolverParameters) -> bool {
        true
    }

    fn check_scene(&self, scene: &Scene) -> Result<(), String> {
        model::check_scene(&self.surrogate, scene)
    }

    fn batch(&self) -> Option<usize> {
        Some(BATCH)
    }

    fn prepare(&self, scene: &Scene) -> Result<Box<dyn Ready>, String> {
        self.check_scene(scene)?;
        Ok(Box::new(Loaded(Arc::clone(&self.surrogate))))
    }
}

struct Loaded(Arc<Surrogate>);

impl Ready for Loaded {
    fn fields(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, String> {
        let fields = self.0.predict(patterns).map_err(|e| e.to_string())?;
        Ok(fields.into_iter().map(Some).collect())
    }
}
