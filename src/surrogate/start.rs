//! Where a training begins that goes on from a trained network: its weights and its unit of length.

use std::collections::BTreeMap;

use candle_core::{Tensor, Var};

use super::options::TrainOptions;
use super::outcome::TrainError;
use super::weights::from_bytes;
use deaflow_pattern::Raster;

/// A trained network to begin with.
pub(crate) struct Start {
    /// Length in mm of one unit of the network's output: the weights are good in no other.
    pub(crate) scale_mm: f64,
    tensors: BTreeMap<String, Tensor>,
}

impl Start {
    /// From the bytes that an earlier training gave.
    ///
    /// # Errors
    /// When they are no model, or that of another network, of other cells or groups.
    pub(crate) fn read(bytes: &[u8], options: &TrainOptions, raster: Raster) -> Result<Self, TrainError> {
        let network = options.network;
        let (header, tensors) = from_bytes(bytes).map_err(|e| TrainError::Start(e.to_string()))?;
        if header.network != network.name() {
            let message = format!("it is a network {}, not {}", header.network, network.name());
            return Err(TrainError::Start(message));
        }
        if let Some(other) = header.raster().filter(|other| *other != raster) {
            let message = format!("it is for {other} cells, and the examples have {raster}");
            return Err(TrainError::Start(message));
        }
        if header.loads() != options.loads {
            let message = format!(
                "its groups have the loads {:?}, not {:?}",
                header.loads(),
                options.loads
            );
            return Err(TrainError::Start(message));
        }
        Ok(Self {
            scale_mm: header.scale_mm,
            tensors,
        })
    }

    /// Sets the weights that are trained.
    ///
    /// # Errors
    /// When one is missing or of another shape.
    pub(crate) fn set(&self, vars: &[(String, Var)]) -> Result<(), TrainError> {
        for (name, var) in vars {
            let fits = |tensor: &&Tensor| tensor.shape() == var.shape() && tensor.dtype() == var.dtype();
            let tensor = self.tensors.get(name).filter(fits);
            let tensor = tensor.ok_or_else(|| TrainError::Start(format!("its tensor {name} does not fit")))?;
            var.set(tensor)?;
        }
        Ok(())
    }
}
