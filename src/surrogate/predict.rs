//! A trained network as a predictor.

use candle_core::{DType, Device, Tensor};
use rayon::prelude::*;

use super::encode::{patterns_to_tensor, tensor_to_fields};
use super::networks::{Network, NetworkKind};
use super::parameters::Parameters;
use super::weights::{LoadError, from_bytes};
use crate::field::{Field, PredictError, Predictor};
use crate::pattern::Pattern;

/// Patterns evaluated together by one thread. Every operation treats the patterns of a batch one by one, so the number
/// changes speed only.
pub(crate) const CHUNK: usize = 8;

/// A trained network.
pub struct Surrogate {
    kind: NetworkKind,
    network: Box<dyn Network>,
    scale_mm: f64,
    device: Device,
}

/// The device that networks run on: a GPU where the program is built for one and one is there, otherwise the CPU. Equal
/// bits for any number of threads and any company of a pattern are promised on the CPU only.
pub(crate) fn device() -> candle_core::Result<Device> {
    Device::cuda_if_available(0)
}

impl Surrogate {
    /// The network in the bytes that training gave.
    ///
    /// # Errors
    /// When the bytes are damaged, or are not a network of this program.
    pub fn load(bytes: &[u8]) -> Result<Self, LoadError> {
        let unsuitable = |e: candle_core::Error| LoadError::Unsuitable(e.to_string());
        let (header, tensors) = from_bytes(bytes)?;
        let kind = NetworkKind::from_name(&header.network)
            .ok_or_else(|| LoadError::Unsuitable(format!("it holds a network called '{}'", header.network)))?;
        if !(header.scale_mm.is_finite() && header.scale_mm > 0.0) {
            return Err(LoadError::Damaged(format!("its scale is {} mm", header.scale_mm)));
        }
        for (name, tensor) in &tensors {
            check_tensor(name, tensor)?;
        }
        let device = device().map_err(unsuitable)?;
        let mut parameters = Parameters::stored(&tensors, &device);
        let network = kind.build(&mut parameters).map_err(unsuitable)?;
        if parameters.used() != tensors.len() {
            return Err(LoadError::Unsuitable(format!(
                "{} has {} tensors, the model {}",
                kind.name(),
                parameters.used(),
                tensors.len()
            )));
        }
        Ok(Self {
            kind,
            network,
            scale_mm: header.scale_mm,
            device,
        })
    }

    /// Which network it is.
    #[must_use]
    pub fn kind(&self) -> NetworkKind {
        self.kind
    }
}

fn check_tensor(name: &str, tensor: &Tensor) -> Result<(), LoadError> {
    let damaged = |e: candle_core::Error| LoadError::Damaged(e.to_string());
    if tensor.dtype() != DType::F32 {
        return Err(LoadError::Unsuitable(format!(
            "tensor {name} is {:?}, not F32",
            tensor.dtype()
        )));
    }
    let values = tensor.flatten_all().and_then(|t| t.to_vec1::<f32>()).map_err(damaged)?;
    match values.iter().all(|v| v.is_finite()) {
        true => Ok(()),
        false => Err(LoadError::Damaged(format!(
            "tensor {name} has a value that is not finite"
        ))),
    }
}

/// The fields in mm that a network predicts, one per pattern.
pub(crate) fn evaluate(
    network: &dyn Network,
    scale_mm: f64,
    patterns: &[&Pattern],
    device: &Device,
) -> Result<Vec<Field>, PredictError> {
    let failed = |e: candle_core::Error| PredictError(e.to_string());
    let chunks = patterns.par_chunks(CHUNK).map(|chunk| {
        let input = patterns_to_tensor(chunk.iter().copied(), device).map_err(failed)?;
        let output = network.forward(&input, false).map_err(failed)?;
        let fields = tensor_to_fields(&output.displacement, scale_mm).map_err(failed)?;
        fields.map_err(|e| PredictError(e.to_string()))
    });
    let chunks: Result<Vec<_>, _> = chunks.collect();
    Ok(chunks?.concat())
}

impl Predictor for Surrogate {
    fn predict(&self, patterns: &[Pattern]) -> Result<Vec<Field>, PredictError> {
        let patterns: Vec<&Pattern> = patterns.iter().collect();
        evaluate(self.network.as_ref(), self.scale_mm, &patterns, &self.device)
    }
}

#[cfg(test)]
mod tests;
