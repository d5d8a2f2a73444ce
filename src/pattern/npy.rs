//! NumPy's array file, format versions 1 to 3 (numpy.lib.format, NEP 1).
//!
//! The header is read here because its text is a Python expression in a file that is not trusted: general parsers recurse
//! on nested brackets and multiply the extents unchecked. A plain array needs three keys only.

use std::path::Path;

use half::f16;

use super::raster::{CELLS, Pattern};
use super::read::{MOST, Refusal, bytes, count, patterns};

/// Eight-byte elements in the largest stack, and a header.
const MAX_BYTES: u64 = MOST * 2500 * 8 + (1 << 16);

const TYPES: &str = "allowed: booleans, integers (1 to 8 bytes), floats (2, 4 or 8 bytes)";

struct Header<'a> {
    descr: &'a str,
    fortran: bool,
    shape: Vec<u64>,
}

#[derive(Clone, Copy)]
struct Element {
    kind: char,
    size: usize,
    big_endian: bool,
}

pub(super) fn read(path: &Path) -> Result<Vec<Pattern>, Refusal> {
    let bytes = bytes(path, MAX_BYTES)?;
    let (header, data) = split(&bytes)?;
    let header = parse(header)?;
    let element = Element::parse(header.descr)?;
    let n = count(&header.shape)?;
    let cells = CELLS * CELLS;
    let expected = n * cells * element.size;
    if data.len() != expected {
        return Err(Refusal::new(format!(
            "the header promises {expected} bytes of data, the file holds {}",
            data.len()
        ))
        .help("the file is cut off or damaged; write it again"));
    }
    let stored: Vec<f64> = data.chunks_exact(element.size).map(|e| element.value(e)).collect();
    if !header.fortran {
        return patterns(&stored);
    }
    // In Fortran order the first index runs fastest: element (i, y, x) stands at i + n·(y + 50·x).
    let at = |k: usize| k / cells + n * (k % cells / CELLS + CELLS * (k % CELLS));
    patterns(&(0..stored.len()).map(|k| stored[at(k)]).collect::<Vec<_>>())
}

/// Header text and data.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), Refusal> {
    let Some(rest) = bytes.strip_prefix(b"\x93NUMPY") else {
        return Err(Refusal::new("not a NumPy file: it does not begin with \\x93NUMPY"));
    };
    let short = || Refusal::new("the file ends inside its header").help("the file is cut off; write it again");
    let (length, rest) = match rest {
        [1, 0, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
        [2 | 3, 0, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest),
        [1..=3, 0, ..] | [] | [_] => return Err(short()),
        [major, minor, ..] => return Err(Refusal::new(format!("NumPy file version {major}.{minor} is not known"))),
    };
    let (header, data) = rest.split_at_checked(length).ok_or_else(short)?;
    let text = std::str::from_utf8(header).map_err(|_| Refusal::new("the header is not text"))?;
    Ok((text, data))
}

fn parse(header: &str) -> Result<Header<'_>, Refusal> {
    let field = |key: &str| {
        let (_, rest) = header.split_once(&format!("'{key}':"))?;
        Some(rest.trim_start())
    };
    let missing =
        |key: &str| Refusal::new(format!("the header has no readable `{key}`")).help("write it with numpy.save");
    let descr = field("descr").ok_or_else(|| missing("descr"))?;
    if descr.starts_with('[') {
        return Err(Refusal::new("a structured array").help(TYPES));
    }
    let descr = descr.strip_prefix('\'').and_then(|d| d.split_once('\''));
    let order = field("fortran_order").ok_or_else(|| missing("fortran_order"))?;
    let fortran = match (order.starts_with("True"), order.starts_with("False")) {
        (true, _) => true,
        (_, true) => false,
        _ => return Err(missing("fortran_order")),
    };
    let shape = field("shape")
        .and_then(|s| s.strip_prefix('('))
        .and_then(|s| s.split_once(')'))
        .and_then(|(extents, _)| extents_of(extents))
        .ok_or_else(|| missing("shape"))?;
    Ok(Header {
        descr: descr.ok_or_else(|| missing("descr"))?.0,
        fortran,
        shape,
    })
}

fn extents_of(text: &str) -> Option<Vec<u64>> {
    let items = text.split(',').map(str::trim).filter(|t| !t.is_empty());
    items.map(|t| t.parse().ok()).collect()
}

impl Element {
    fn parse(descr: &str) -> Result<Self, Refusal> {
        let refused = || Refusal::new(format!("elements of type {descr:?}")).help(TYPES);
        let mut letters = descr.chars();
        let (order, kind) = (letters.next().ok_or_else(refused)?, letters.next().ok_or_else(refused)?);
        let size = letters.as_str().parse().map_err(|_| refused())?;
        let known = match kind {
            'b' => size == 1,
            'i' | 'u' => matches!(size, 1 | 2 | 4 | 8),
            'f' => matches!(size, 2 | 4 | 8),
            _ => false,
        };
        if !known || !matches!(order, '<' | '>' | '|' | '=') {
            return Err(refused());
        }
        Ok(Self {
            kind,
            size,
            big_endian: order == '>',
        })
    }

    /// The value of one element. Rounding to a double turns no other number into 0 or 1.
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
        let value = |bits: u16| Element::parse("<f2").unwrap().value(&bits.to_le_bytes());
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
        let value = |descr: &str, bytes: &[u8]| Element::parse(descr).unwrap().value(bytes);
        assert_eq!(value("<i2", &[0xff, 0xff]), -1.0);
        assert_eq!(value(">i2", &[0, 1]), 1.0);
        assert_eq!(value("<u2", &[0xff, 0xff]), 65535.0);
        assert_eq!(value(">f8", &1f64.to_be_bytes()), 1.0);
        assert_eq!(value("|b1", &[1]), 1.0);
        for refused in ["<f16", "|O", "<U1", "<c8", "", "<", "é", "<i3", "<M8[s]", "|b2"] {
            assert!(Element::parse(refused).is_err(), "{refused}");
        }
    }
}
