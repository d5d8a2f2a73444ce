//! A trained network as a method to measure.

use std::path::Path;
use std::sync::Arc;

use deaflow_base::{Canonical, Digest, InputError, Node, read_bounded};
use deaflow_field::Evaluator;
use deaflow_surrogate::{LoadError, Surrogate};

/// The largest file that is read as a model.
const MAX_BYTES: u64 = 4 << 30;

/// A trained network.
pub struct Network {
    surrogate: Arc<Surrogate>,
    digest: Digest,
    /// Whether another network of the same name is also measured.
    ambiguous: bool,
}

impl Network {
    /// Reads the bytes of a safetensors file.
    ///
    /// # Errors
    /// When they are not a model.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, LoadError> {
        Ok(Self {
            surrogate: Arc::new(Surrogate::load(bytes)?),
            digest: Digest::of(bytes),
            ambiguous: false,
        })
    }

    /// Reads the file that a node names.
    ///
    /// # Errors
    /// When it cannot be read, or is not a model.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let path = node.text("model")?;
        let bytes = read_bounded(Path::new(path), MAX_BYTES)
            .map_err(|e| node.error(format!("cannot read {path} as a model: {e}")))?;
        Self::from_bytes(&bytes).map_err(|e| node.error(format!("cannot use {path}: {e}")))
    }

    /// Adds the digests to the settings of networks with equal names.
    pub(super) fn distinguish(networks: &mut [Self]) {
        let names: Vec<&str> = networks.iter().map(|network| network.surrogate.kind().name()).collect();
        let is_ambiguous = |name| names.iter().filter(|other| **other == name).count() > 1;
        let ambiguous: Vec<bool> = names.iter().map(|name| is_ambiguous(*name)).collect();
        for (network, ambiguous) in networks.iter_mut().zip(ambiguous) {
            network.ambiguous = ambiguous;
        }
    }

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
