//! Surrogates: trained networks that predict displacement fields.

use candle_core::{DType, Tensor};
use rayon::prelude::*;

use super::encode::{patterns_to_tensor, tensor_to_fields};
use super::header::{Header, TrainingRecord};
use super::networks::{Network, NetworkKind};
use super::onnx::to_onnx;
use super::parameters::StoredWeights;
use super::weights::{LoadError, from_bytes};
use deaflow_field::{Evaluator, Field, PredictError, Predictor};
use deaflow_pattern::{Pattern, PatternForm};

/// Patterns per batch when a surrogate evaluates many patterns.
const BATCH: usize = 1000;

/// A trained network.
pub struct Surrogate {
    kind: NetworkKind,
    form: PatternForm,
    network: Box<dyn Network>,
    header: Header,
}

impl Surrogate {
    /// Loads a model file.
    ///
    /// # Errors
    /// When the bytes are damaged or not a supported model.
    pub fn load(bytes: &[u8]) -> Result<Self, LoadError> {
        let unsuitable = |e: candle_core::Error| LoadError::Unsuitable(e.to_string());
        let (header, tensors) = from_bytes(bytes)?;
        let kind = NetworkKind::from_name(&header.network)
            .ok_or_else(|| LoadError::Unsuitable(format!("unknown network '{}'", header.network)))?;
        for (name, tensor) in &tensors {
            check_tensor(name, tensor)?;
        }
        let form = header.form();
        let form = form.ok_or_else(|| LoadError::Unsuitable("unknown form of patterns".to_owned()))?;
        let weights = StoredWeights::new(&tensors);
        let network = kind
            .build(&weights.builder(), header.corners(form.raster))
            .map_err(unsuitable)?;
        if let Some(name) = weights.unused() {
            let why = format!("network {} has no tensor {name}", kind.name());
            return Err(LoadError::Unsuitable(why));
        }
        Ok(Self {
            kind,
            form,
            network,
            header,
        })
    }

    /// Returns the scene of its training data in the text form of artifacts, if the file names it.
    #[must_use]
    pub fn scene(&self) -> Option<&str> {
        self.header.scene.as_deref()
    }

    /// Returns the header of its file as JSON: network, input, output, scale, scene, training, tensors.
    ///
    /// # Errors
    /// When the header cannot be encoded; a header that was read always can.
    pub fn header(&self) -> Result<String, PredictError> {
        serde_json::to_string(&self.header).map_err(PredictError::failed)
    }

    /// Exports the network as an ONNX file that maps patterns (n, rows, columns) in u8 to displacements
    /// (n, rows + 1, columns + 1, 2) in mm, f32.
    ///
    /// # Errors
    /// When its tensors cannot be read.
    pub fn to_onnx(&self) -> Result<Vec<u8>, PredictError> {
        let header = self.header()?;
        to_onnx(self.network.as_ref(), self.form.raster, &self.header, &header).map_err(PredictError::failed)
    }

    /// Returns the record of its training, if the file has one.
    #[must_use]
    pub fn training(&self) -> Option<&TrainingRecord> {
        self.header.training.as_ref()
    }

    /// Returns the form of its patterns.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        self.form
    }

    /// Returns the kind of the network.
    #[must_use]
    pub fn kind(&self) -> NetworkKind {
        self.kind
    }
}

fn check_tensor(name: &str, tensor: &Tensor) -> Result<(), LoadError> {
    let damaged = |e: candle_core::Error| LoadError::Damaged(e.to_string());
    let dtype = tensor.dtype();
    if dtype != DType::F32 {
        return Err(LoadError::Unsuitable(format!("tensor {name} is {dtype:?}, not F32")));
    }
    let values = tensor.flatten_all().and_then(|t| t.to_vec1::<f32>()).map_err(damaged)?;
    match values.iter().all(|v| v.is_finite()) {
        true => Ok(()),
        false => Err(LoadError::Damaged(format!("tensor {name} contains NaN or infinity"))),
    }
}

/// Predicts the field of each pattern in mm; from rest if not all sides are held.
fn evaluate(
    network: &dyn Network,
    PatternForm { raster, groups, .. }: PatternForm,
    header: &Header,
    patterns: &[&Pattern],
) -> Result<Vec<Field>, PredictError> {
    if let Some(other) = patterns.iter().find(|pattern| pattern.raster() != raster) {
        let why = format!("the network needs patterns of {raster} cells, found {}", other.raster());
        return Err(PredictError::failed(why));
    }
    if let Some(pattern) = patterns.iter().find(|pattern| pattern.groups() > groups) {
        let group = pattern.groups();
        let why = format!("a pattern uses electrode group {group}, but the network supports groups 1 to {groups}");
        return Err(PredictError::failed(why));
    }
    let failed = |e: candle_core::Error| PredictError::failed(e);
    let corners = header.corners(raster);
    let chunks = patterns.par_chunks(network.patterns_per_thread()).map(|chunk| {
        let input = patterns_to_tensor(raster, header.loads(), chunk.iter().copied()).map_err(failed)?;
        let displacement = network.forward(&input).map_err(failed)?;
        let fields = tensor_to_fields(corners, &displacement, header.scale_mm).map_err(failed)?;
        fields.map_err(PredictError::failed)
    });
    let chunks: Result<Vec<_>, _> = chunks.collect();
    Ok(chunks?.into_iter().flatten().collect())
}

impl Predictor for Surrogate {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        Ok(self.predict(patterns)?.into_iter().map(Some).collect())
    }

    fn predict(&self, patterns: &[Pattern]) -> Result<Vec<Field>, PredictError> {
        let patterns: Vec<&Pattern> = patterns.iter().collect();
        evaluate(self.network.as_ref(), self.form, &self.header, &patterns)
    }
}

impl Evaluator for Surrogate {
    fn settings(&self) -> String {
        format!("network: {}", self.kind.name())
    }

    fn batch(&self) -> Option<usize> {
        Some(BATCH)
    }
}

#[cfg(test)]
mod tests;
