//! Networks as bytes: safetensors, with what is needed to use the network in its metadata.
//!
//! The metadata has one key only: the format keeps its metadata in no fixed order, and equal networks must be equal bytes.
//! Its text is a JSON object that begins with a digest: the BLAKE3 of the text after the digest's comma and of all tensors, each
//! with its name, type and shape. A file that was changed anywhere, tensors that were exchanged included, is found out.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use candle_core::{Device, Tensor};
use safetensors::SafeTensors;
use safetensors::tensor::TensorView;
use serde_json::Value;

use super::header::{Header, Record, VERSION};
use super::metrics::ALL;
use super::outcome::Trained;
use deaflow_base::{Digest, DigestWriter};
use deaflow_dataset::Split;

/// The one key of the metadata.
pub(crate) const KEY: &str = "deaflow";

/// Bytes that are not a network.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// Not safetensors, or changed since it was written.
    #[error("the model is damaged: {0}")]
    Damaged(String),
    /// Readable, but not written by this program, or for another network.
    #[error("the model does not fit: {0}")]
    Unsuitable(String),
}

/// A network that cannot be written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WriteError {
    /// A tensor of two kinds.
    #[error("tensor {0} is both trained and constant")]
    Ambiguous(String),
    /// The header.
    #[error(transparent)]
    Header(#[from] serde_json::Error),
    /// The tensors.
    #[error(transparent)]
    Tensors(#[from] safetensors::SafeTensorError),
}

/// The bytes of a network: its trained tensors, and those that are part of the network and were not trained.
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

/// The header and the tensors of a network.
pub(crate) fn from_bytes(bytes: &[u8]) -> Result<(Header, BTreeMap<String, Tensor>), LoadError> {
    let damaged = |e: &dyn std::fmt::Display| LoadError::Damaged(e.to_string());
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| damaged(&e))?;
    let text = metadata.metadata().as_ref().and_then(|map| map.get(KEY));
    let text = text.ok_or_else(|| LoadError::Unsuitable("it was not written by deaflow".into()))?;
    let written = SafeTensors::deserialize(bytes).map_err(|e| damaged(&e))?;
    let header = read_header(text, written.tensors())?;
    let tensors = candle_core::safetensors::load_buffer(bytes, &Device::Cpu).map_err(|e| damaged(&e))?;
    let tensors: BTreeMap<String, Tensor> = tensors.into_iter().collect();
    check_names(&header, &tensors)?;
    Ok((header, tensors))
}

/// The same model with the scene and the record of its training in its header.
///
/// # Errors
/// When the bytes are no model.
pub fn annotated(bytes: &[u8], scene: &str, record: Record) -> Result<Vec<u8>, LoadError> {
    let (mut header, tensors) = from_bytes(bytes)?;
    header.scene = Some(scene.to_owned());
    header.training = Some(record);
    let (trained, constant) = tensors
        .into_iter()
        .partition(|(name, _)| header.tensors.trained.contains(name));
    to_bytes(&header, &trained, &constant).map_err(|e| LoadError::Damaged(e.to_string()))
}

impl Record {
    /// The record of a training under a seed, on datasets of these digests.
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

/// The digest of a model: of its description and its tensors in the order of their names, wherever they stand in the file.
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

/// How the text of a header begins.
fn opening(digest: &Digest) -> String {
    format!("{{\"digest\":\"{digest}\",")
}

fn read_header(text: &str, tensors: Vec<(String, TensorView<'_>)>) -> Result<Header, LoadError> {
    let mut value: Value = serde_json::from_str(text).map_err(|e| LoadError::Damaged(e.to_string()))?;
    match value.get("format_version").and_then(Value::as_u64) {
        Some(VERSION) => {}
        Some(other) => {
            return Err(LoadError::Unsuitable(format!(
                "its format has version {other}, and this deaflow reads version {VERSION}"
            )));
        }
        None => {
            return Err(LoadError::Unsuitable(
                "it does not say the version of its format: it comes from an older deaflow and has to be trained again"
                    .into(),
            ));
        }
    }
    let stated = value.as_object_mut().and_then(|map| map.remove("digest"));
    let stated: Option<Digest> = stated
        .as_ref()
        .and_then(Value::as_str)
        .and_then(|text| text.parse().ok());
    let body = stated.and_then(|stated| Some((stated, text.strip_prefix(&opening(&stated))?)));
    match body {
        Some((stated, body)) if digest(body, tensors) == stated => {}
        _ => return Err(LoadError::Damaged("its content is not what its digest says".into())),
    }
    let header: Header = serde_json::from_value(value).map_err(|e| LoadError::Unsuitable(e.to_string()))?;
    match header.objection() {
        Some(objection) => Err(LoadError::Unsuitable(objection)),
        None => Ok(header),
    }
}

/// Whether the tensors are those that the header names, each once.
fn check_names(header: &Header, tensors: &BTreeMap<String, Tensor>) -> Result<(), LoadError> {
    let listed = || header.tensors.trained.iter().chain(&header.tensors.constant);
    if let Some(missing) = listed().find(|name| !tensors.contains_key(*name)) {
        return Err(LoadError::Damaged(format!("tensor {missing} is missing")));
    }
    let known: BTreeSet<&String> = listed().collect();
    match tensors.keys().find(|name| !known.contains(name)) {
        Some(extra) => Err(LoadError::Damaged(format!("its header does not name tensor {extra}"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod fuzz;
#[cfg(test)]
mod tests;
