//! The networks, one per file.

mod constants;
mod fold;
mod names;
mod open;
mod orientations;
mod physics;
mod qin2024;
mod response;

use candle_core::{Module, Result, Tensor, bail};
use candle_nn::VarBuilder;

use super::corners::Corners;
use super::onnx::Export;
use deaflow_base::words;
use deaflow_pattern::Raster;
use deaflow_scene::Scene;

pub use constants::{Constants, ConstantsError};

words! {
    /// Network.
    pub enum NetworkKind {
        /// The convolutional network of Qin et al. (Soft Robotics 2024, doi 10.1089/soro.2024.0063).
        Qin2024 = "qin2024",
        /// The linear response of the membrane with corrections by learned local laws.
        Physics = "physics",
    }
}

impl NetworkKind {
    /// Returns whether the network needs [`Constants`] of the scene.
    #[must_use]
    pub fn has_constants(self) -> bool {
        self == Self::Physics
    }

    /// Checks that there can be such a network of a scene, as far as that is known without solving it.
    ///
    /// # Errors
    /// When nothing moves in the scene, or it has too many cells: the reason.
    pub fn check(self, scene: &Scene) -> std::result::Result<(), String> {
        let corners = Corners::of(scene);
        match (self, corners.held()) {
            (Self::Qin2024, _) => {
                let raster = raster_of(corners).map_err(|e| e.to_string())?;
                qin2024::Qin2024::check(raster).map_err(|e| e.to_string())
            }
            (Self::Physics, Some(_)) => Err(NO_RESPONSE.to_owned()),
            (Self::Physics, None) => Constants::check(scene).map_err(|e| e.to_string()),
        }
    }

    /// Builds the network for the device with these corners from the given weights.
    ///
    /// # Errors
    /// When the weights belong to another network, or the cells or sides are not supported.
    pub(crate) fn build(self, weights: &VarBuilder<'_>, corners: Corners) -> Result<Box<dyn Network>> {
        let raster = raster_of(corners)?;
        Ok(match (self, corners.held()) {
            (Self::Qin2024, None) => Box::new(qin2024::Qin2024::new(weights, raster)?),
            (Self::Qin2024, Some(_)) => Box::new(open::Open::new(qin2024::Qin2024::new(weights, raster)?, corners)?),
            (Self::Physics, None) => Box::new(physics::Physics::new(weights, raster)?),
            (Self::Physics, Some(_)) => bail!("{NO_RESPONSE}"),
        })
    }
}

/// Why there is no network `physics` of a device.
const NO_RESPONSE: &str = "network physics has the linear response of a membrane whose `sides` are all held; use \
                           network qin2024";

/// Returns the cells of a network.
fn raster_of(corners: Corners) -> Result<Raster> {
    match corners.of_network() {
        Some(raster) => Ok(raster),
        None => bail!("a network of {} cells has too many; use fewer cells", corners.raster()),
    }
}

/// Output of a network for a batch of n patterns in training, in the network's unit of length.
pub(crate) struct Output {
    /// Displacement at the corners that move, (n, rows − 1, columns − 1, 2) if all sides are held.
    pub(crate) displacement: Tensor,
    /// Auxiliary output: the x displacement at every second inner corner.
    pub(crate) half_resolution: Option<Tensor>,
}

/// A network: a module from patterns (n, rows, columns, 1), ±½ per cell, to displacements (n, rows − 1, columns − 1,
/// 2), or (n, rows + 1, columns + 1, 2) if not all sides are held.
pub(crate) trait Network: Module + Export + Send + Sync {
    /// Computes the frozen part of the output, which training does not change: the same number of values for each
    /// pattern. `None` when the network has none. Many patterns together take less time.
    fn frozen(&self, patterns: &Tensor) -> Result<Option<Vec<f32>>> {
        let _ = patterns;
        Ok(None)
    }

    /// Computes the output with the auxiliary output, if the network has one. `frozen` is [`Network::frozen`] of the
    /// patterns, where it is known.
    fn forward_for_training(&self, patterns: &Tensor, frozen: Option<&[f32]>) -> Result<Output> {
        let _ = frozen;
        Ok(Output {
            displacement: self.forward(patterns)?,
            half_resolution: None,
        })
    }

    /// Number of patterns that a thread predicts together. It changes the speed only, not the result.
    fn patterns_per_thread(&self) -> usize {
        8
    }

    /// Number of examples per part of a gradient. It groups sums, so it changes the last bits. Larger parts take less
    /// time, because each part adds a gradient of all weights, but occupy fewer threads.
    fn examples_per_part(&self) -> usize {
        2
    }

    /// Unit of the displacement in mm, if the network defines it. Otherwise it is the root mean square of the training
    /// fields.
    fn unit_mm(&self) -> Option<f64> {
        None
    }
}
