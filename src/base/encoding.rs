//! The one place that speaks bincode: the bytes of action keys and of records.
//!
//! Fixed-width little-endian integers, so that the encoding of a value never depends on its size or on the machine.

use serde::{Serialize, de::DeserializeOwned};

/// A value that could not be encoded or bytes that are not an encoding of the wanted type.
#[derive(Debug, thiserror::Error)]
pub enum EncodingError {
    /// The value cannot be represented.
    #[error("cannot encode: {0}")]
    Encode(#[from] bincode::error::EncodeError),
    /// The bytes are not such a value.
    #[error("cannot decode: {0}")]
    Decode(#[from] bincode::error::DecodeError),
    /// Bytes remain after the value.
    #[error("{0} unexpected bytes after the encoded value")]
    Trailing(usize),
}

/// Records are small; a length field that claims more than this is damage, not data.
const LIMIT: usize = 16 << 20;

fn config() -> impl bincode::config::Config {
    bincode::config::standard()
        .with_fixed_int_encoding()
        .with_little_endian()
        .with_limit::<LIMIT>()
}

/// The canonical bytes of a value.
///
/// # Errors
/// When the value's `Serialize` refuses, or it is larger than 16 MiB.
pub fn encode<T: Serialize>(value: &T) -> Result<Vec<u8>, EncodingError> {
    Ok(bincode::serde::encode_to_vec(value, config())?)
}

/// The value that `bytes` encode, all of them.
///
/// # Errors
/// When the bytes are not exactly one encoded value of type `T`.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, EncodingError> {
    let (value, read) = bincode::serde::decode_from_slice(bytes, config())?;
    if read == bytes.len() {
        Ok(value)
    } else {
        Err(EncodingError::Trailing(bytes.len() - read))
    }
}
