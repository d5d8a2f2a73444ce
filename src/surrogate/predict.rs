//! A trained network as a predictor.

use candle_core::{DType, Tensor};
use rayon::prelude::*;

use super::encode::{patterns_to_tensor, tensor_to_fields};
use super::header::{Header, Record};
use super::networks::{Network, NetworkKind};
use super::onnx::to_onnx;
use super::parameters::Stored;
use super::weights::{LoadError, from_bytes};
use deaflow_field::{Evaluator, Field, PredictError, Predictor};
use deaflow_pattern::{Pattern, PatternForm};

/// Patterns that a network is asked for at once where it serves.
const BATCH: usize = 1000;

/// A trained network.
pub struct Surrogate {
    kind: NetworkKind,
    form: PatternForm,
    network: Box<dyn Network>,
    header: Header,
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
        for (name, tensor) in &tensors {
            check_tensor(name, tensor)?;
        }
        let form = || LoadError::Unsuitable("it takes patterns in another form".to_owned());
        let form = header.form().ok_or_else(form)?;
        let weights = Stored::new(&tensors);
        let network = kind.build(&weights.builder(), form.raster).map_err(unsuitable)?;
        if let Some(name) = weights.unused() {
            let why = format!("its network {} has no tensor {name}", kind.name());
            return Err(LoadError::Unsuitable(why));
        }
        Ok(Self {
            kind,
            form,
            network,
            header,
        })
    }

    /// The scene that its training data was simulated in, as artifacts carry it; none where the file does not say.
    #[must_use]
    pub fn scene(&self) -> Option<&str> {
        self.header.scene.as_deref()
    }

    /// What its file says about it, as JSON: network, input, output, scale, scene, training, tensors.
    ///
    /// # Errors
    /// When it cannot be written as text, which a header that was read always can.
    pub fn header(&self) -> Result<String, PredictError> {
        serde_json::to_string(&self.header).map_err(PredictError::failed)
    }

    /// The network as an ONNX file: patterns (n, rows, columns) in u8 to displacements (n, rows + 1, columns + 1, 2) in mm, f32.
    ///
    /// # Errors
    /// When its tensors cannot be read.
    pub fn to_onnx(&self) -> Result<Vec<u8>, PredictError> {
        let header = self.header()?;
        to_onnx(self.network.as_ref(), self.form.raster, &self.header, &header).map_err(PredictError::failed)
    }

    /// How it was trained; none where the file does not say.
    #[must_use]
    pub fn training(&self) -> Option<&Record> {
        self.header.training.as_ref()
    }

    /// What the patterns are that it knows.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        self.form
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
fn evaluate(
    network: &dyn Network,
    PatternForm { raster, groups }: PatternForm,
    header: &Header,
    patterns: &[&Pattern],
) -> Result<Vec<Field>, PredictError> {
    if let Some(other) = patterns.iter().find(|pattern| pattern.raster() != raster) {
        let why = format!(
            "the network is for {raster} cells, and a pattern has {}",
            other.raster()
        );
        return Err(PredictError::failed(why));
    }
    if let Some(pattern) = patterns.iter().find(|pattern| pattern.groups() > groups) {
        let why = format!(
            "a pattern has electrodes of group {}, and groups that the network knows number {groups}",
            pattern.groups()
        );
        return Err(PredictError::failed(why));
    }
    let failed = |e: candle_core::Error| PredictError::failed(e);
    let chunks = patterns.par_chunks(network.patterns_per_thread()).map(|chunk| {
        let input = patterns_to_tensor(raster, header.loads(), chunk.iter().copied()).map_err(failed)?;
        let displacement = network.forward(&input).map_err(failed)?;
        let fields = tensor_to_fields(raster, &displacement, header.scale_mm).map_err(failed)?;
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
