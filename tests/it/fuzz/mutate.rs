//! Changes valid inputs as random bytes determine, so that a coverage-guided fuzzer can control the changes.

use std::fs;
use std::path::PathBuf;

/// The largest number of changes of one input.
const MOST_CHANGES: u8 = 6;

/// The longest piece that is removed or repeated, in bytes.
const LONGEST_PIECE: usize = 200;

/// Valid inputs of one format, inputs that found a bug, and the tokens of the format.
pub struct Seeds {
    /// The inputs.
    pub inputs: Vec<Vec<u8>>,
    /// The number of valid inputs, which come first; the others found a bug.
    pub valid: usize,
    tokens: &'static [&'static str],
}

impl Seeds {
    /// Combines valid inputs with those in a corpus.
    pub fn new(corpus: &str, valid: impl IntoIterator<Item = Vec<u8>>, tokens: &'static [&'static str]) -> Self {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
            .join("tests/it/fuzz/corpus")
            .join(corpus);
        let mut found: Vec<PathBuf> = fs::read_dir(folder)
            .map(|entries| entries.map(|entry| entry.unwrap().path()).collect())
            .unwrap_or_default();
        found.sort();
        let found = found.iter().map(|path| fs::read(path).unwrap());
        let valid: Vec<Vec<u8>> = valid.into_iter().collect();
        Self {
            valid: valid.len(),
            inputs: valid.into_iter().chain(found).collect(),
            tokens,
        }
    }

    /// Returns one of the inputs with changes, as a function of `entropy`.
    pub fn mutated(&self, entropy: &[u8]) -> Vec<u8> {
        let mut choices = Choices(entropy);
        let mut bytes = self.inputs[choices.below(self.inputs.len())].clone();
        for _ in 0..=choices.byte() % MOST_CHANGES {
            self.change(&mut bytes, &mut choices);
        }
        bytes
    }

    fn change(&self, bytes: &mut Vec<u8>, choices: &mut Choices<'_>) {
        let at = choices.below(bytes.len() + 1);
        let end = (at + 1 + choices.below(LONGEST_PIECE)).min(bytes.len());
        match choices.byte() % 9 {
            0 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = choices.byte();
                }
            }
            1 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << (choices.byte() % 8);
                }
            }
            2 | 3 if !self.tokens.is_empty() => {
                let token = self.tokens[choices.below(self.tokens.len())];
                bytes.splice(at..at, token.bytes());
            }
            4 => {
                bytes.drain(at..end.max(at));
            }
            5 => {
                let piece = bytes[at..end.max(at)].to_vec();
                let to = choices.below(bytes.len() + 1);
                bytes.splice(to..to, piece);
            }
            6 => bytes.truncate(at),
            7 => {
                // Numbers near limits, as eight bytes or as text.
                let number = [0, 1, 127, 255, 65_535, u64::from(u32::MAX), i64::MAX as u64, u64::MAX][choices.below(8)];
                let number = match choices.byte() % 2 {
                    0 => number.to_le_bytes().to_vec(),
                    _ => number.to_string().into_bytes(),
                };
                let end = (at + number.len()).min(bytes.len());
                bytes.splice(at..end, number);
            }
            _ => {
                let other = &self.inputs[choices.below(self.inputs.len())];
                let from = choices.below(other.len() + 1);
                let piece = &other[from..(from + choices.below(LONGEST_PIECE)).min(other.len())];
                bytes.splice(at..end.max(at), piece.iter().copied());
            }
        }
    }
}

/// Makes choices from random bytes, and from zeros after their end.
struct Choices<'a>(&'a [u8]);

impl Choices<'_> {
    fn byte(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
        self.0 = rest;
        *first
    }

    /// Returns a number below `n`, which must not be 0.
    fn below(&mut self, n: usize) -> usize {
        let bytes = [self.byte(), self.byte(), self.byte()];
        (usize::from(bytes[0]) | usize::from(bytes[1]) << 8 | usize::from(bytes[2]) << 16) % n
    }
}

#[test]
fn inputs_are_changed_as_the_bytes_say() {
    let seeds = Seeds::new("none", [b"one: 1\n".to_vec(), b"two: 2\n".to_vec()], &["[", "]"]);
    assert_eq!(seeds.mutated(&[]), seeds.mutated(&[]));
    let all: std::collections::BTreeSet<Vec<u8>> = (0..=255)
        .map(|byte: u8| seeds.mutated(&[byte, 7, byte, byte, 3, 0, 1, byte, 0, 0, byte, byte, 5, 1, 1]))
        .collect();
    assert!(all.len() > 50, "{}", all.len());
}
