//! The networks, one per file, and how they are chosen.

mod physics;
mod qin2024;
mod response;

use candle_core::{Result, Tensor};

use super::onnx::{Graph, Value};
use super::parameters::Parameters;

pub use response::Constants;

/// Which network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NetworkKind {
    /// The convolutional network of Qin et al. (Soft Robotics 2024, doi 10.1089/soro.2024.0063).
    Qin2024,
    /// The linear response of the membrane, corrected by learned local laws.
    Physics,
}

impl NetworkKind {
    /// All networks.
    pub const ALL: [Self; 2] = [Self::Qin2024, Self::Physics];

    /// The word that stands in pipelines and files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Qin2024 => "qin2024",
            Self::Physics => "physics",
        }
    }

    /// The network that a word names.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Whether it starts from [`Constants`] of the scene.
    #[must_use]
    pub fn has_constants(self) -> bool {
        self == Self::Physics
    }

    /// Builds the network on the given weights.
    pub(crate) fn build(self, parameters: &mut Parameters) -> Result<Box<dyn Network>> {
        match self {
            Self::Qin2024 => Ok(Box::new(qin2024::Qin2024::new(parameters)?)),
            Self::Physics => Ok(Box::new(physics::Physics::new(parameters)?)),
        }
    }
}

/// What a network says about a batch of n patterns, in a unit that stands beside its weights.
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

    /// The displacement without a gradient, (n, 49, 49, 2): that of [`Network::forward`] but for rounding.
    fn predict(&self, patterns: &Tensor) -> Result<Tensor> {
        Ok(self.forward(patterns, false)?.displacement)
    }

    /// How many patterns one thread best predicts together. Every pattern is treated as if it were alone, so the number
    /// changes speed only.
    fn together(&self) -> usize {
        8
    }

    /// Length in mm of one unit of the displacement, where the network says it; else it is the deviation of the fields that it
    /// learns from.
    fn unit_mm(&self) -> Option<f64> {
        None
    }

    /// Draws the same as operations of ONNX, without the auxiliary answer: from patterns to displacements.
    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value>;
}
