//! A trained network as a method to be measured.

use std::path::Path;
use std::sync::Arc;

use super::candidate::Candidate;
use deaflow_base::{Canonical, Digest, InputError, Node, read_bounded};
use deaflow_field::Evaluator;
use deaflow_surrogate::{LoadError, Surrogate};

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

    /// Networks as candidates of which no two are called the same: by their digests too where they must be.
    #[must_use]
    pub fn named(networks: Vec<Self>) -> Vec<Candidate> {
        let names: Vec<&str> = networks.iter().map(|network| network.surrogate.kind().name()).collect();
        let ambiguous: Vec<bool> = names
            .iter()
            .map(|name| names.iter().filter(|other| other == &name).count() > 1)
            .collect();
        let named = |(network, ambiguous)| Candidate::Network(Self { ambiguous, ..network });
        networks.into_iter().zip(ambiguous).map(named).collect()
    }

    /// The network itself.
    pub(super) fn surrogate(&self) -> &Arc<Surrogate> {
        &self.surrogate
    }

    pub(super) fn settings(&self) -> String {
        let settings = self.surrogate.settings();
        if self.ambiguous {
            format!("{settings}, model: {}", self.digest.short())
        } else {
            settings
        }
    }

    pub(super) fn canonical(&self) -> Canonical {
        Canonical::map([("model", self.digest.to_string().as_str().into())])
    }
}
