//! Elements of datasets, as they are in memory and as bytes between processes.

use serde::{Deserialize, Serialize};

/// What the elements of a dataset are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Element {
    /// Bytes.
    U8,
    /// 32-bit integers.
    U32,
    /// 64-bit integers.
    U64,
    /// Single precision.
    F32,
    /// Double precision.
    F64,
    /// Other numbers, and truth values.
    Number,
    /// UTF-8 texts of at most so many bytes, at a fixed width.
    Text(u64),
    /// Texts of other forms.
    OtherText,
    /// Something else; what.
    Other(String),
}

impl Element {
    /// Whether they are numbers.
    #[must_use]
    pub fn is_number(&self) -> bool {
        !matches!(self, Self::Text(_) | Self::OtherText | Self::Other(_))
    }
}

/// The elements of an array, row-major.
#[derive(Clone, Debug, PartialEq)]
pub enum Elements {
    /// Bytes; also patterns and flags.
    U8(Vec<u8>),
    /// 32-bit integers.
    U32(Vec<u32>),
    /// 64-bit integers.
    U64(Vec<u64>),
    /// Single precision.
    F32(Vec<f32>),
    /// Double precision.
    F64(Vec<f64>),
    /// UTF-8 texts; in artifacts of at most 64 bytes.
    Text(Vec<String>),
}

/// Calls a macro-like body for the vectors of numbers.
macro_rules! numbers {
    ($($variant:ident: $type:ty),*) => {
        /// The little-endian bytes of numbers and what they are; texts have none.
        pub(super) fn to_bytes(elements: &Elements) -> Option<(Element, Vec<u8>)> {
            match elements {
                $(Elements::$variant(v) => Some((
                    Element::$variant,
                    v.iter().flat_map(|x| x.to_le_bytes()).collect(),
                )),)*
                Elements::Text(_) => None,
            }
        }

        /// Numbers from their little-endian bytes; none where these are not such numbers.
        pub(super) fn from_bytes(element: &Element, bytes: &[u8]) -> Option<Elements> {
            match element {
                $(Element::$variant => {
                    let (numbers, rest) = bytes.as_chunks();
                    let numbers = numbers.iter().map(|&x| <$type>::from_le_bytes(x)).collect();
                    rest.is_empty().then_some(Elements::$variant(numbers))
                })*
                _ => None,
            }
        }

        impl Elements {
            /// How many there are.
            #[must_use]
            pub fn len(&self) -> usize {
                match self {
                    $(Self::$variant(v) => v.len(),)*
                    Self::Text(v) => v.len(),
                }
            }

            /// Whether there are none.
            #[must_use]
            pub fn is_empty(&self) -> bool {
                self.len() == 0
            }

            /// Appends elements of the same kind; `false`, and nothing appended, where they are of another.
            pub fn append(&mut self, more: Self) -> bool {
                match (self, more) {
                    $((Self::$variant(all), Self::$variant(mut more)) => all.append(&mut more),)*
                    (Self::Text(all), Self::Text(mut more)) => all.append(&mut more),
                    _ => return false,
                }
                true
            }
        }
    };
}

numbers!(U8: u8, U32: u32, U64: u64, F32: f32, F64: f64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_survive_the_conversion_to_bytes_and_invalid_bytes_are_rejected() {
        for elements in [
            Elements::U8(vec![0, 255]),
            Elements::U32(vec![7, u32::MAX]),
            Elements::U64(vec![u64::MAX]),
            Elements::F32(vec![-0.5]),
            Elements::F64(vec![f64::MIN_POSITIVE, -1e300]),
        ] {
            let (element, bytes) = to_bytes(&elements).unwrap();
            assert_eq!(from_bytes(&element, &bytes), Some(elements));
        }
        assert_eq!(from_bytes(&Element::F64, &[0; 9]), None);
        assert_eq!(from_bytes(&Element::Number, &[0; 8]), None);
    }
}
