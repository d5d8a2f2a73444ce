//! Model files: safetensors with a header in the metadata.
//!
//! The metadata has a single key, because safetensors does not fix the order of keys and equal networks must give
//! equal bytes. Its value is a JSON object that begins with a digest: the BLAKE3 of the text after the digest and of
//! all tensors with their names, types and shapes. The digest detects every change of a file, exchanged tensors
//! included.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use candle_core::{Device, Tensor};
use safetensors::SafeTensors;
use safetensors::tensor::TensorView;
use serde_json::Value;

use super::header::{Header, TrainingRecord, VERSION};
use super::metrics::ALL;
use super::outcome::Trained;
use deaflow_base::{Digest, DigestWriter};
use deaflow_dataset::Split;

/// The key of the metadata.
pub(crate) const KEY: &str = "deaflow";

/// Why a model file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// Not safetensors, or changed after it was written.
    #[error("the model is damaged: {0}")]
    Damaged(String),
    /// Not written by deaflow, or of an unknown version, network or form.
    #[error("the model is not supported: {0}")]
    Unsuitable(String),
}

/// Why a network cannot be written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WriteError {
    /// A tensor is both trained and constant.
    #[error("tensor {0} is both trained and constant")]
    Ambiguous(String),
    /// The header cannot be encoded.
    #[error(transparent)]
    Header(#[from] serde_json::Error),
    /// The tensors cannot be encoded.
    #[error(transparent)]
    Tensors(#[from] safetensors::SafeTensorError),
}

/// Encodes a network from its trained and its constant tensors.
pub(crate) fn to_bytes(
    header: &Header,
    trained: &BTreeMap<String, Tensor>,
    constant: &BTreeMap<String, Tensor>,
) -> Result<Vec<u8>, WriteError> {
    let mut header = header.clone();
    header.tensors.trained = trained.keys().cloned().collect();
    header.tensors.constant = constant.keys().cloned().collect();
    if let Some(name) = header.tensors.trained.intersection(&header.tensors.constant).next() {
        return Err(WriteError::Ambiguous(name.clone()));
    }
    let tensors: BTreeMap<&String, Tensor> = trained.iter().chain(constant).map(|(n, t)| (n, t.clone())).collect();
    let text = serde_json::to_string(&header)?;
    let body = text.strip_prefix('{').unwrap_or(&text);
    let bare = safetensors::serialize(&tensors, None)?;
    let written = SafeTensors::deserialize(&bare)?;
    let text = format!("{}{body}", opening(&digest(body, written.tensors())));
    let metadata = HashMap::from([(KEY.to_owned(), text)]);
    Ok(safetensors::serialize(&tensors, Some(metadata))?)
}

/// Decodes the header and the tensors of a network.
pub(crate) fn from_bytes(bytes: &[u8]) -> Result<(Header, BTreeMap<String, Tensor>), LoadError> {
    let damaged = |e: &dyn std::fmt::Display| LoadError::Damaged(e.to_string());
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| damaged(&e))?;
    let text = metadata.metadata().as_ref().and_then(|map| map.get(KEY));
    let text = text.ok_or_else(|| LoadError::Unsuitable("not written by deaflow".into()))?;
    let written = SafeTensors::deserialize(bytes).map_err(|e| damaged(&e))?;
    let header = read_header(text, written.tensors())?;
    let tensors = candle_core::safetensors::load_buffer(bytes, &Device::Cpu).map_err(|e| damaged(&e))?;
    let tensors: BTreeMap<String, Tensor> = tensors.into_iter().collect();
    check_names(&header, &tensors)?;
    Ok((header, tensors))
}

/// Adds the scene and the record of the training to the header of a model.
///
/// # Errors
/// When the bytes are not a model.
pub fn annotated(bytes: &[u8], scene: &str, record: TrainingRecord) -> Result<Vec<u8>, LoadError> {
    let (mut header, tensors) = from_bytes(bytes)?;
    header.scene = Some(scene.to_owned());
    header.training = Some(record);
    let (trained, constant) = tensors
        .into_iter()
        .partition(|(name, _)| header.tensors.trained.contains(name));
    to_bytes(&header, &trained, &constant).map_err(|e| LoadError::Damaged(e.to_string()))
}

impl TrainingRecord {
    /// Creates the record of a training from its result, its seed and the digests of its datasets.
    #[must_use]
    pub fn of(trained: &Trained, seed: u64, inputs: Vec<String>) -> Self {
        let mut examples: BTreeMap<String, BTreeMap<String, u64>> = BTreeMap::new();
        for group in trained.metrics.iter().filter(|group| group.family != ALL) {
            let families = examples.entry(group.split.name().to_owned()).or_default();
            families.insert(group.family.clone(), group.samples);
        }
        let best = trained.curves.iter().find(|report| report.epoch == trained.best_epoch);
        let rmse = best.map(|report| report.validation_rmse_mm);
        let validated = examples.contains_key(Split::Validation.name());
        Self {
            examples,
            epochs: trained.curves.len() as u32,
            best_epoch: trained.best_epoch,
            validation_rmse_mm: rmse.filter(|rmse| validated && rmse.is_finite()),
            seed,
            inputs,
        }
    }
}

/// Returns the digest of a model: of its header and of its tensors in the order of their names.
fn digest(body: &str, mut tensors: Vec<(String, TensorView<'_>)>) -> Digest {
    tensors.sort_by(|(a, _), (b, _)| a.cmp(b));
    let mut writer = DigestWriter::new();
    writer.text(body).number(tensors.len() as u64);
    for (name, tensor) in &tensors {
        writer.text(name).text(&tensor.dtype().to_string());
        writer.number(tensor.shape().len() as u64);
        for &extent in tensor.shape() {
            writer.number(extent as u64);
        }
        writer.bytes(tensor.data());
    }
    writer.finish()
}

/// Returns the start of the text of a header.
fn opening(digest: &Digest) -> String {
    format!("{{\"digest\":\"{digest}\",")
}

fn read_header(text: &str, tensors: Vec<(String, TensorView<'_>)>) -> Result<Header, LoadError> {
    let mut value: Value = serde_json::from_str(text).map_err(|e| LoadError::Damaged(e.to_string()))?;
    let version = value.get("format_version").and_then(Value::as_u64);
    if version != Some(VERSION) {
        return Err(LoadError::Unsuitable(match version {
            Some(other) => format!("its format is version {other}, but this deaflow reads version {VERSION}"),
            None => "no format version: an older deaflow wrote it; train the model again".into(),
        }));
    }
    let stated = value.as_object_mut().and_then(|map| map.remove("digest"));
    let stated: Option<Digest> = stated.and_then(|stated| stated.as_str()?.parse().ok());
    let body = stated.and_then(|stated| Some((stated, text.strip_prefix(&opening(&stated))?)));
    match body {
        Some((stated, body)) if digest(body, tensors) == stated => {}
        _ => return Err(LoadError::Damaged("its digest does not match its content".into())),
    }
    let header: Header = serde_json::from_value(value).map_err(|e| LoadError::Unsuitable(e.to_string()))?;
    match header.objection() {
        Some(objection) => Err(LoadError::Unsuitable(objection)),
        None => Ok(header),
    }
}

/// Checks that the tensors are those that the header names.
fn check_names(header: &Header, tensors: &BTreeMap<String, Tensor>) -> Result<(), LoadError> {
    let listed = || header.tensors.trained.iter().chain(&header.tensors.constant);
    if let Some(missing) = listed().find(|name| !tensors.contains_key(*name)) {
        return Err(LoadError::Damaged(format!("tensor {missing} is missing")));
    }
    let known: BTreeSet<&String> = listed().collect();
    match tensors.keys().find(|name| !known.contains(name)) {
        Some(extra) => Err(LoadError::Damaged(format!("tensor {extra} is not in its header"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod tests;
