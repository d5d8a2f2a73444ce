//! Networks as bytes: safetensors, with what is needed to rebuild the network in its metadata.

use std::collections::{BTreeMap, HashMap};

use candle_core::{Device, Tensor};
use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};

/// The one key of the metadata. One only: the format keeps its metadata in no fixed order, and equal networks must be
/// equal bytes.
const KEY: &str = "deaflow";

/// What stands beside the weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Header {
    /// Name of the network.
    pub(crate) network: String,
    /// Length in mm of one unit of the network's output.
    pub(crate) scale_mm: f64,
}

/// Bytes that are not a network.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// Not safetensors, or cut short.
    #[error("the model is damaged: {0}")]
    Damaged(String),
    /// Readable, but not written by this program, or for another network.
    #[error("the model does not fit: {0}")]
    Unsuitable(String),
}

/// The bytes of a network.
pub(crate) fn to_bytes(header: &Header, tensors: &BTreeMap<String, Tensor>) -> Result<Vec<u8>, String> {
    let text = serde_json::to_string(header).map_err(|e| e.to_string())?;
    let metadata = HashMap::from([(KEY.to_owned(), text)]);
    safetensors::serialize(tensors, Some(metadata)).map_err(|e| e.to_string())
}

/// The header and the tensors of a network.
pub(crate) fn from_bytes(bytes: &[u8]) -> Result<(Header, BTreeMap<String, Tensor>), LoadError> {
    let damaged = |e: &dyn std::fmt::Display| LoadError::Damaged(e.to_string());
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| damaged(&e))?;
    let text = metadata.metadata().as_ref().and_then(|map| map.get(KEY));
    let text = text.ok_or_else(|| LoadError::Unsuitable("it was not trained by deaflow".into()))?;
    let header = serde_json::from_str(text).map_err(|e| damaged(&e))?;
    let tensors = candle_core::safetensors::load_buffer(bytes, &Device::Cpu).map_err(|e| damaged(&e))?;
    Ok((header, tensors.into_iter().collect()))
}
