//! The networks, one per file, and how they are chosen.

mod qin2024;

use candle_core::{Result, Tensor};

use super::parameters::Parameters;

/// Which network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NetworkKind {
    /// The convolutional network of Qin et al. (Soft Robotics 2024, doi 10.1089/soro.2024.0063).
    Qin2024,
}

impl NetworkKind {
    /// All networks.
    pub const ALL: [Self; 1] = [Self::Qin2024];

    /// The word that stands in pipelines and files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Qin2024 => "qin2024",
        }
    }

    /// The network that a word names.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Builds the network on the given weights.
    pub(crate) fn build(self, parameters: &mut Parameters) -> Result<Box<dyn Network>> {
        match self {
            Self::Qin2024 => Ok(Box::new(qin2024::Qin2024::new(parameters)?)),
        }
    }
}

/// What a network says about a batch of n patterns, in units of the deviation of the training fields.
pub(crate) struct Output {
    /// Displacement at the 49 × 49 inner corners, (n, 49, 49, 2).
    pub(crate) displacement: Tensor,
    /// The x displacement at every second inner corner, (n, 25, 25, 1): an auxiliary answer that only training asks for.
    pub(crate) half_resolution: Option<Tensor>,
}

/// A network from patterns (n, 50, 50, 1), −½ or ½ per cell, to displacements.
pub(crate) trait Network: Send + Sync {
    /// The displacement, with the auxiliary answer where `auxiliary` is set.
    fn forward(&self, patterns: &Tensor, auxiliary: bool) -> Result<Output>;
}
