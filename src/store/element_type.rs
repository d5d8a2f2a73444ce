//! The element types of datasets.

use deaflow_hdf::Elements as Data;
use serde::{Deserialize, Serialize};

/// The element types of datasets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum ElementType {
    /// Bytes.
    U8,
    /// 32-bit unsigned integers.
    U32,
    /// 64-bit unsigned integers.
    U64,
    /// Single precision.
    F32,
    /// Double precision.
    F64,
    /// Texts of at most 64 bytes.
    Text,
}

impl ElementType {
    /// Returns the type of elements.
    #[must_use]
    pub fn of(data: &Data) -> Self {
        match data {
            Data::U8(_) => Self::U8,
            Data::U32(_) => Self::U32,
            Data::U64(_) => Self::U64,
            Data::F32(_) => Self::F32,
            Data::F64(_) => Self::F64,
            Data::Text(_) => Self::Text,
        }
    }

    /// Returns the name in digests and listings.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U32 => "u32",
            Self::U64 => "u64",
            Self::F32 => "f32",
            Self::F64 => "f64",
            Self::Text => "text",
        }
    }
}
