//! NumPy array files, format versions 1 to 3 (numpy.lib.format, NEP 1): header and elements.
//!
//! The header is a Python expression in an untrusted file. General parsers recurse on nested brackets and multiply the
//! extents unchecked, so this reader only looks for the three keys of a plain array.

use std::io::{ErrorKind, Read};

use half::f16;

/// The longest header that is read, in bytes; that of a plain array has 128.
const LONGEST: u32 = 1 << 16;

/// The allowed types of elements.
const TYPES: &str = "allowed: booleans, integers (1 to 8 bytes), floats (2, 4 or 8 bytes)";

/// The header of an array file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NpyHeader {
    /// The type of the elements.
    pub element: NpyElement,
    /// Whether the first index runs fastest.
    pub fortran: bool,
    /// Extents, slowest first.
    pub shape: Vec<u64>,
    /// The number of bytes before the first element.
    pub bytes: u64,
}

/// The type of the elements of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NpyElement {
    kind: char,
    size: usize,
    big_endian: bool,
}

/// Why a file is not an array of numbers.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// It does not begin as a NumPy file.
    #[error("not a NumPy file: it does not begin with \\x93NUMPY")]
    Magic,
    /// It ends too early.
    #[error("the file ends inside its header")]
    Short,
    /// Its format version is unknown.
    #[error("unknown NumPy file version {0}.{1}")]
    Version(u8, u8),
    /// Its header is too long.
    #[error("the header is too long: {0} bytes")]
    Long(u32),
    /// Its header is not text.
    #[error("the header is not text")]
    NotText,
    /// Its elements have several parts.
    #[error("structured arrays are not supported")]
    Structured,
    /// A key of the header is missing or invalid.
    #[error("cannot read `{0}` in the header")]
    Key(&'static str),
    /// The elements are not numbers.
    #[error("elements of type {0:?} are not supported")]
    Element(String),
    /// The system reported an error.
    #[error("{0}")]
    Io(std::io::Error),
}

impl NpyError {
    /// Returns advice, if there is any.
    #[must_use]
    pub fn help(&self) -> Option<&'static str> {
        match self {
            Self::Short => Some("the file is truncated; write it again"),
            Self::Structured | Self::Element(_) => Some(TYPES),
            Self::Key(_) => Some("write it with numpy.save"),
            Self::Magic | Self::Version(..) | Self::Long(_) | Self::NotText | Self::Io(_) => None,
        }
    }
}

impl From<std::io::Error> for NpyError {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            ErrorKind::UnexpectedEof => Self::Short,
            _ => Self::Io(error),
        }
    }
}

impl NpyHeader {
    /// Reads a header; the elements follow it.
    ///
    /// # Errors
    /// When the header is invalid, or the elements are not numbers.
    pub fn read(from: &mut impl Read) -> Result<Self, NpyError> {
        let mut magic = Vec::new();
        from.by_ref().take(6).read_to_end(&mut magic)?;
        if magic != b"\x93NUMPY" {
            return Err(NpyError::Magic);
        }
        let [major, minor] = read_bytes(from)?;
        let length = match (major, minor) {
            (1, 0) => u32::from(u16::from_le_bytes(read_bytes(from)?)),
            (2 | 3, 0) => u32::from_le_bytes(read_bytes(from)?),
            _ => return Err(NpyError::Version(major, minor)),
        };
        if length > LONGEST {
            return Err(NpyError::Long(length));
        }
        let mut text = vec![0; length as usize];
        from.read_exact(&mut text)?;
        let before = if major == 1 { 10 } else { 12 };
        let text = std::str::from_utf8(&text).map_err(|_| NpyError::NotText)?;
        parse(text, before + u64::from(length))
    }

    /// Returns the number of elements; `None` if it overflows.
    #[must_use]
    pub fn count(&self) -> Option<u64> {
        self.shape.iter().try_fold(1_u64, |count, &n| count.checked_mul(n))
    }

    /// Returns the number of bytes of the elements; `None` if it overflows.
    #[must_use]
    pub fn data_bytes(&self) -> Option<u64> {
        self.count()?.checked_mul(self.element.size as u64)
    }
}

fn read_bytes<const N: usize>(from: &mut impl Read) -> Result<[u8; N], NpyError> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn parse(header: &str, bytes: u64) -> Result<NpyHeader, NpyError> {
    let field = |key: &'static str| {
        let (_, rest) = header.split_once(&format!("'{key}':")).ok_or(NpyError::Key(key))?;
        Ok::<_, NpyError>(rest.trim_start())
    };
    let descr = field("descr")?;
    if descr.starts_with('[') {
        return Err(NpyError::Structured);
    }
    let descr = descr.strip_prefix('\'').and_then(|d| d.split_once('\''));
    let order = field("fortran_order")?;
    let fortran = match (order.starts_with("True"), order.starts_with("False")) {
        (true, _) => true,
        (_, true) => false,
        _ => return Err(NpyError::Key("fortran_order")),
    };
    let shape = field("shape")?
        .strip_prefix('(')
        .and_then(|s| s.split_once(')'))
        .and_then(|(extents, _)| extents_of(extents))
        .ok_or(NpyError::Key("shape"))?;
    Ok(NpyHeader {
        element: NpyElement::parse(descr.ok_or(NpyError::Key("descr"))?.0)?,
        fortran,
        shape,
        bytes,
    })
}

fn extents_of(text: &str) -> Option<Vec<u64>> {
    let items = text.split(',').map(str::trim).filter(|t| !t.is_empty());
    items.map(|t| t.parse().ok()).collect()
}

impl NpyElement {
    fn parse(descr: &str) -> Result<Self, NpyError> {
        let invalid = || NpyError::Element(descr.to_owned());
        let mut letters = descr.chars();
        let (order, kind) = (letters.next().ok_or_else(invalid)?, letters.next().ok_or_else(invalid)?);
        let size = letters.as_str().parse().map_err(|_| invalid())?;
        let is_known = match kind {
            'b' => size == 1,
            'i' | 'u' => matches!(size, 1 | 2 | 4 | 8),
            'f' => matches!(size, 2 | 4 | 8),
            _ => false,
        };
        if !is_known || !matches!(order, '<' | '>' | '|' | '=') {
            return Err(invalid());
        }
        Ok(Self {
            kind,
            size,
            big_endian: order == '>',
        })
    }

    /// The number of bytes of one element.
    #[must_use]
    pub fn size(self) -> usize {
        self.size
    }

    /// Returns the values of elements as doubles. Rounding to a double maps no other number to 0 or 1.
    #[must_use]
    pub fn values(self, bytes: &[u8]) -> Vec<f64> {
        bytes.chunks_exact(self.size).map(|bytes| self.value(bytes)).collect()
    }

    fn value(self, bytes: &[u8]) -> f64 {
        let mut little = [0; 8];
        little[..self.size].copy_from_slice(bytes);
        if self.big_endian {
            little[..self.size].reverse();
        }
        let bits = u64::from_le_bytes(little);
        match (self.kind, self.size) {
            ('f', 2) => f16::from_bits(bits as u16).to_f64(),
            ('f', 4) => f64::from(f32::from_bits(bits as u32)),
            ('f', _) => f64::from_bits(bits),
            ('i', size) => {
                let unused = 64 - 8 * size as u32;
                ((bits << unused) as i64 >> unused) as f64
            }
            _ => bits as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_precision_values_are_those_of_the_standard() {
        // IEEE 754-2008, binary16: 1, −2, largest finite, smallest subnormal.
        let value = |bits: u16| NpyElement::parse("<f2").unwrap().value(&bits.to_le_bytes());
        for (bits, expected) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (1, 2f64.powi(-24)),
            (0, 0.0),
        ] {
            assert_eq!(value(bits), expected);
        }
        assert!(value(0x7e00).is_nan());
    }

    #[test]
    fn integers_keep_their_sign_and_byte_order() {
        let value = |descr: &str, bytes: &[u8]| NpyElement::parse(descr).unwrap().value(bytes);
        assert_eq!(value("<i2", &[0xff, 0xff]), -1.0);
        assert_eq!(value(">i2", &[0, 1]), 1.0);
        assert_eq!(value("<u2", &[0xff, 0xff]), 65535.0);
        assert_eq!(value(">f8", &1f64.to_be_bytes()), 1.0);
        assert_eq!(value("|b1", &[1]), 1.0);
        for refused in ["<f16", "|O", "<U1", "<c8", "", "<", "é", "<i3", "<M8[s]", "|b2"] {
            assert!(NpyElement::parse(refused).is_err(), "{refused}");
        }
    }

    #[test]
    fn a_header_has_the_position_and_number_of_elements() {
        let text = "{'descr': '<f4', 'fortran_order': True, 'shape': (3, 2), }\n";
        let old = [
            b"\x93NUMPY\x01\x00",
            &(text.len() as u16).to_le_bytes()[..],
            text.as_bytes(),
        ]
        .concat();
        let new = [
            b"\x93NUMPY\x03\x00",
            &(text.len() as u32).to_le_bytes()[..],
            text.as_bytes(),
        ]
        .concat();
        for file in [old, new] {
            let header = NpyHeader::read(&mut &file[..]).unwrap();
            assert_eq!((header.fortran, header.shape.clone()), (true, vec![3, 2]));
            assert_eq!((header.bytes, header.data_bytes()), (file.len() as u64, Some(24)));
            assert!(matches!(NpyHeader::read(&mut &file[..20]), Err(NpyError::Short)));
        }
        let vast = NpyHeader {
            shape: vec![1 << 40, 1 << 40],
            ..NpyHeader::read(&mut &[b"\x93NUMPY\x01\x00", &[text.len() as u8, 0][..], text.as_bytes()].concat()[..])
                .unwrap()
        };
        assert_eq!(vast.data_bytes(), None);
        let long = b"\x93NUMPY\x02\x00\xff\xff\xff\xff";
        assert!(matches!(NpyHeader::read(&mut &long[..]), Err(NpyError::Long(u32::MAX))));
    }
}
