//! A search under way as bytes: all that it needs to be gone on with as if it had never stopped.
//!
//! Every generation draws from a random stream of its own, so no generator has a state to keep.

use serde::{Deserialize, Serialize};

use super::options::EvolveOptions;
use crate::genome::Genome;
use deaflow_base::{Digest, decode, encode};

/// Raised when the layout changes.
const VERSION: u32 = 2;

/// Bytes of what is known of a genome of so many groups: its genes, three numbers, and how far it was judged.
const fn row_bytes(groups: usize) -> usize {
    Genome::bytes(groups) + 3 * 8 + 1
}

/// Why bytes are not the state of a search.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    /// Cut short, changed, or something else altogether.
    #[error("it is not the state of a search")]
    Damaged,
    /// Written by another version.
    #[error("it is the state of a search in layout {found}, and this program reads layout {VERSION}")]
    Version {
        /// The layout that was found.
        found: u32,
    },
    /// The state of a search with other options.
    #[error("it is the state of a search with other options")]
    Options,
}

/// A search after a generation.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct State {
    /// What is known of every genome that was met, sorted by genome.
    pub known: Vec<(Genome, Known)>,
    /// The last generation in its order, by place among the known.
    pub population: Vec<u64>,
    /// The generations so far.
    pub history: Vec<StoredGeneration>,
    /// The generation of the last gain.
    pub last_gain: u64,
}

/// What is known of a genome; its fitness is infinite where it has no field or is not feasible, and rough where it was not judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Known {
    pub fitness: f64,
    pub value_mm: f64,
    pub area: f64,
    /// Whether the evaluator was asked.
    pub judged: bool,
    /// Whether it is feasible, where that was asked.
    pub feasible: Option<bool>,
}

/// A generation as it was reported.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct StoredGeneration {
    /// The best genome, by place among the known.
    pub genome: u64,
    pub best: f64,
    pub mean: f64,
    pub value_mm: f64,
    pub area: f64,
}

#[derive(Serialize, Deserialize)]
struct Header {
    options: Digest,
    known: u64,
    population: Vec<u64>,
    history: Vec<StoredGeneration>,
    last_gain: u64,
}

/// The digest of the options that decide how one generation follows from another. More generations continue the same search.
fn digest(options: &EvolveOptions) -> Digest {
    let EvolveOptions {
        elite,
        judged,
        crossover,
        mutation,
        distance,
        ..
    } = *options;
    let shares = [elite, judged, crossover, mutation, distance];
    let mut bytes: Vec<u8> = shares.iter().flat_map(|share| share.to_bits().to_le_bytes()).collect();
    for number in [options.population as u64, options.designs as u64, options.seed] {
        bytes.extend(number.to_le_bytes());
    }
    Digest::of(&bytes)
}

impl State {
    /// As bytes: the version, the length of a header, the header, what is known, and the digest of all that. None where the
    /// header cannot be encoded, which takes a population of a million.
    pub(super) fn to_bytes(&self, options: &EvolveOptions, groups: usize) -> Option<Vec<u8>> {
        let header = Header {
            options: digest(options),
            known: self.known.len() as u64,
            population: self.population.clone(),
            history: self.history.clone(),
            last_gain: self.last_gain,
        };
        let header = encode(&header).ok()?;
        let mut bytes = Vec::with_capacity(header.len() + self.known.len() * row_bytes(groups) + 64);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend((header.len() as u64).to_le_bytes());
        bytes.extend(header);
        for (genome, known) in &self.known {
            bytes.extend(genome.to_bytes(groups));
            for number in [known.fitness, known.value_mm, known.area] {
                bytes.extend(number.to_le_bytes());
            }
            bytes.push(match (known.judged, known.feasible) {
                (true, None) => 0,
                (true, Some(false)) => 1,
                (true, Some(true)) => 2,
                (false, _) => 3,
            });
        }
        let digest = Digest::of(&bytes);
        bytes.extend(digest.as_bytes());
        Some(bytes)
    }

    /// From bytes.
    ///
    /// # Errors
    /// When they are something else, or the state of another search.
    pub(super) fn from_bytes(bytes: &[u8], options: &EvolveOptions, groups: usize) -> Result<Self, StateError> {
        let (content, sum) = bytes.split_last_chunk::<32>().ok_or(StateError::Damaged)?;
        let (version, rest) = content.split_first_chunk::<4>().ok_or(StateError::Damaged)?;
        if Digest::of(content) != Digest::from_bytes(*sum) {
            return Err(StateError::Damaged);
        }
        let found = u32::from_le_bytes(*version);
        if found != VERSION {
            return Err(StateError::Version { found });
        }
        let (header, rows) = parts(rest).ok_or(StateError::Damaged)?;
        if header.options != digest(options) || header.history.len() > options.generations + 1 {
            return Err(StateError::Options);
        }
        let state = Self {
            known: known(rows, groups).ok_or(StateError::Damaged)?,
            population: header.population,
            history: header.history,
            last_gain: header.last_gain,
        };
        let sound = header.known == state.known.len() as u64 && state.is_sound(options);
        sound.then_some(state).ok_or(StateError::Damaged)
    }

    /// Whether all places are those of something known, and there is at least one generation.
    fn is_sound(&self, options: &EvolveOptions) -> bool {
        let steps = self.history.iter().map(|step| &step.genome);
        let within = |&place: &u64| place < self.known.len() as u64;
        !self.history.is_empty()
            && self.last_gain < self.history.len() as u64
            && self.population.len() == options.population
            && self.population.iter().chain(steps).all(within)
            && self.known.windows(2).all(|pair| pair[0].0 < pair[1].0)
    }
}

fn parts(bytes: &[u8]) -> Option<(Header, &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<8>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let (header, rows) = rest.split_at_checked(length)?;
    Some((decode(header).ok()?, rows))
}

fn known(bytes: &[u8], groups: usize) -> Option<Vec<(Genome, Known)>> {
    let rows = bytes.chunks_exact(row_bytes(groups));
    rows.remainder().is_empty().then_some(())?;
    let row = |row: &[u8]| {
        let (genome, rest) = row.split_at_checked(Genome::bytes(groups))?;
        let (numbers, verdict) = rest.as_chunks::<8>();
        let [fitness, value_mm, area] = [0, 1, 2].map(|at| f64::from_le_bytes(numbers[at]));
        let (judged, feasible) = match verdict {
            [0] => (true, None),
            [1] => (true, Some(false)),
            [2] => (true, Some(true)),
            [3] => (false, None),
            _ => return None,
        };
        let known = Known {
            fitness,
            value_mm,
            area,
            judged,
            feasible,
        };
        let genome = Genome::from_bytes(genome, groups)?;
        (!fitness.is_nan()).then_some((genome, known))
    };
    rows.map(row).collect()
}
