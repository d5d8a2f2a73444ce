//! The digest that identifies artifacts, actions and orbits by their content: BLAKE3, 256 bits, lower-case hexadecimal.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A 256-bit BLAKE3 digest.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Digest([u8; 32]);

/// A text that is not a digest.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a digest must be 64 hexadecimal digits, found {found:?}")]
pub struct ParseDigestError {
    found: String,
}

impl Digest {
    /// Computes the digest of bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The raw 32 bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// Creates a digest from its 32 bytes.
    #[must_use]
    pub fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The number of digits in tables and messages.
    pub const SHORT: usize = 12;

    /// Returns the first [`Digest::SHORT`] hexadecimal digits, for tables and messages.
    #[must_use]
    pub fn short(&self) -> String {
        self.to_string()[..Self::SHORT].to_owned()
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Digest({})", self.short())
    }
}

impl FromStr for Digest {
    type Err = ParseDigestError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        blake3::Hash::from_hex(text)
            .map(|hash| Self(*hash.as_bytes()))
            .map_err(|_| ParseDigestError { found: text.to_owned() })
    }
}

/// Digests a sequence of byte strings; the length before each makes the sequence unambiguous.
#[derive(Default)]
pub struct DigestWriter(blake3::Hasher);

impl DigestWriter {
    /// Creates an empty writer.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds one byte string.
    pub fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.number_of_bytes(bytes.len());
        self.0.update(bytes);
        self
    }

    /// Adds one byte string of this length in pieces, so that a large array need not be in memory at once.
    pub fn pieces<P: AsRef<[u8]>>(&mut self, length: usize, pieces: impl IntoIterator<Item = P>) -> &mut Self {
        self.number_of_bytes(length);
        let mut added = 0;
        for piece in pieces {
            added += piece.as_ref().len();
            self.0.update(piece.as_ref());
        }
        debug_assert_eq!(added, length, "the pieces have the given length");
        self
    }

    fn number_of_bytes(&mut self, length: usize) {
        self.0.update(&(length as u64).to_le_bytes());
    }

    /// Adds one text.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.bytes(text.as_bytes())
    }

    /// Adds one integer.
    pub fn number(&mut self, number: u64) -> &mut Self {
        self.bytes(&number.to_le_bytes())
    }

    /// Returns the digest of everything added so far.
    #[must_use]
    pub fn finish(&self) -> Digest {
        Digest(*self.0.finalize().as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_have_the_digest_of_their_concatenation() {
        let whole = DigestWriter::new().bytes(b"in pieces").text("after").finish();
        let pieces = [&b"in "[..], b"", b"pieces"];
        assert_eq!(DigestWriter::new().pieces(9, pieces).text("after").finish(), whole);
    }

    #[test]
    fn text_form_round_trips_and_is_the_published_blake3_value() {
        // Test vector of the BLAKE3 reference for the empty input.
        let empty = Digest::of(b"");
        assert_eq!(
            empty.to_string(),
            "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262"
        );
        assert_eq!(empty.to_string().parse::<Digest>().unwrap(), empty);
        assert!("xyz".parse::<Digest>().is_err());
    }

    #[test]
    fn boundaries_between_parts_matter() {
        let one = DigestWriter::new().text("ab").text("c").finish();
        let two = DigestWriter::new().text("a").text("bc").finish();
        assert_ne!(one, two);
    }
}
