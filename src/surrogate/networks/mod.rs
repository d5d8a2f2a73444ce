//! The networks, one per file, and how they are chosen.

mod constants;
mod fold;
mod names;
mod orientations;
mod physics;
mod qin2024;
mod response;

use candle_core::{Module, Result, Tensor};
use candle_nn::VarBuilder;

use super::onnx::Export;
use deaflow_base::words;
use deaflow_pattern::Raster;

pub use constants::{Constants, ConstantsError};

words! {
    /// Which network.
    pub enum NetworkKind {
        /// The convolutional network of Qin et al. (Soft Robotics 2024, doi 10.1089/soro.2024.0063).
        Qin2024 = "qin2024",
        /// The linear response of the membrane, corrected by learned local laws.
        Physics = "physics",
    }
}

impl NetworkKind {
    /// Whether it starts from [`Constants`] of the scene.
    #[must_use]
    pub fn has_constants(self) -> bool {
        self == Self::Physics
    }

    /// Builds the network for patterns of these cells on the given weights.
    ///
    /// # Errors
    /// When the weights are those of another network, or there is none for such patterns.
    pub(crate) fn build(self, weights: &VarBuilder<'_>, raster: Raster) -> Result<Box<dyn Network>> {
        match self {
            Self::Qin2024 => Ok(Box::new(qin2024::Qin2024::new(weights, raster)?)),
            Self::Physics => Ok(Box::new(physics::Physics::new(weights, raster)?)),
        }
    }
}

/// What a network says about a batch of n patterns in training, in a unit that stands beside its weights.
pub(crate) struct Output {
    /// Displacement at the inner corners, (n, rows − 1, columns − 1, 2).
    pub(crate) displacement: Tensor,
    /// The x displacement at every second inner corner: an auxiliary answer.
    pub(crate) half_resolution: Option<Tensor>,
}

/// A network: a module from patterns (n, rows, columns, 1), −½ or ½ per cell, to displacements (n, rows − 1, columns − 1, 2).
pub(crate) trait Network: Module + Export + Send + Sync {
    /// What of the answers to patterns does not change while the network is trained, one pattern after the other; none where all of it does.
    /// Of many patterns together it takes less time.
    fn untrained(&self, patterns: &Tensor) -> Result<Option<Vec<f32>>> {
        let _ = patterns;
        Ok(None)
    }

    /// The displacement with the auxiliary answer, where the network has one; with [`Network::untrained`] of these patterns, where that is known.
    fn forward_for_training(&self, patterns: &Tensor, untrained: Option<&[f32]>) -> Result<Output> {
        let _ = untrained;
        Ok(Output {
            displacement: self.forward(patterns)?,
            half_resolution: None,
        })
    }

    /// How many patterns one thread best predicts together. Every pattern is treated as if it were alone, so the number
    /// changes speed only.
    fn patterns_per_thread(&self) -> usize {
        8
    }

    /// How many examples one thread takes the gradient of together. Sums are grouped by it, so it changes the last bits. More of them
    /// take less time, since each part has a gradient by every weight to be added, and keep fewer threads busy.
    fn examples_per_part(&self) -> usize {
        2
    }

    /// Length in mm of one unit of the displacement, where the network says it; else it is the deviation of the fields that it
    /// learns from.
    fn unit_mm(&self) -> Option<f64> {
        None
    }
}
