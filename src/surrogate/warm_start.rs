//! Warm start: training continues from the weights and the unit of length of a trained network.

use std::collections::BTreeMap;

use candle_core::{Tensor, Var};

use super::corners::Corners;
use super::options::TrainOptions;
use super::outcome::TrainError;
use super::weights::from_bytes;

/// A trained network from which training starts.
pub(crate) struct WarmStart {
    /// Unit of the network output in mm. The weights are valid for this unit only.
    pub(crate) scale_mm: f64,
    tensors: BTreeMap<String, Tensor>,
}

impl WarmStart {
    /// Reads a model file.
    ///
    /// # Errors
    /// When the bytes are not a model, or its network, cells or groups differ.
    pub(crate) fn read(bytes: &[u8], options: &TrainOptions, corners: Corners) -> Result<Self, TrainError> {
        let refuse = |why: String| Err(TrainError::WarmStart(why));
        let network = options.network.name();
        let (header, tensors) = from_bytes(bytes).map_err(|e| TrainError::WarmStart(e.to_string()))?;
        if header.network != network {
            return refuse(format!("its network is {}, not {network}", header.network));
        }
        let raster = corners.raster();
        if let Some(other) = header.raster().filter(|other| *other != raster) {
            return refuse(format!(
                "its patterns have {other} cells, those of the examples {raster}"
            ));
        }
        if header.corners(raster) != corners {
            return refuse("its device has other `sides`".to_owned());
        }
        if header.loads() != options.loads {
            return refuse(format!(
                "its group loads are {:?}, not {:?}",
                header.loads(),
                options.loads
            ));
        }
        let scale_mm = header.scale_mm;
        Ok(Self { scale_mm, tensors })
    }

    /// Copies the weights into the variables of a network.
    ///
    /// # Errors
    /// When a weight is missing or has another shape.
    pub(crate) fn set(&self, vars: &[(String, Var)]) -> Result<(), TrainError> {
        for (name, var) in vars {
            let fits = |tensor: &&Tensor| tensor.shape() == var.shape() && tensor.dtype() == var.dtype();
            let tensor = self.tensors.get(name).filter(fits);
            let wrong = || TrainError::WarmStart(format!("tensor {name} is missing or has another shape"));
            var.set(tensor.ok_or_else(wrong)?)?;
        }
        Ok(())
    }
}
