//! The encoding of action keys and records: bincode with fixed-width little-endian integers, so that it does not depend
//! on the size of a value or on the machine.

use serde::{Serialize, de::DeserializeOwned};

/// A value that cannot be encoded, or bytes that do not encode a value of the type.
#[derive(Debug, thiserror::Error)]
pub enum EncodingError {
    /// The value cannot be represented.
    #[error("cannot encode: {0}")]
    Encode(#[from] bincode::error::EncodeError),
    /// The bytes do not encode a value of the type.
    #[error("cannot decode: {0}")]
    Decode(#[from] bincode::error::DecodeError),
    /// Bytes remain after the value.
    #[error("{0} unexpected bytes after the encoded value")]
    Trailing(usize),
}

/// Records are small; a length field above this is damaged.
const LIMIT: usize = 16 << 20;

fn config() -> impl bincode::config::Config {
    bincode::config::standard()
        .with_fixed_int_encoding()
        .with_little_endian()
        .with_limit::<LIMIT>()
}

/// Encodes a value.
///
/// # Errors
/// When the value cannot be serialised, or is larger than 16 MiB.
pub fn encode<T: Serialize>(value: &T) -> Result<Vec<u8>, EncodingError> {
    Ok(bincode::serde::encode_to_vec(value, config())?)
}

/// Decodes a value from all of `bytes`.
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
