//! Checkpoints: the state of a genetic search as bytes. A resumed search gives the same result to the last bit.
//!
//! Each generation has its own random stream, so no generator state is stored.

use serde::{Deserialize, Serialize};

use super::options::EvolveOptions;
use crate::genome::Genome;
use deaflow_base::{Digest, decode, encode};

/// The version of the layout.
const VERSION: u32 = 2;

/// Bytes of a genome and its evaluation: genes, three numbers and a status byte.
const fn row_bytes(groups: usize) -> usize {
    Genome::bytes(groups) + 3 * 8 + 1
}

/// Why a checkpoint cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// The content is truncated, changed, or not a checkpoint.
    #[error("not a valid checkpoint")]
    Damaged,
    /// Written by another version.
    #[error("the checkpoint has layout {found}, this program reads layout {read}")]
    Version {
        /// The layout of the checkpoint.
        found: u32,
        /// The layout that the program reads.
        read: u32,
    },
    /// The search had other options.
    #[error("the checkpoint belongs to a search with other options")]
    Options,
}

/// The state of a search after a generation.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Checkpoint {
    /// All evaluated genomes, sorted by genome.
    pub known: Vec<(Genome, Evaluation)>,
    /// The last generation in its order, as indices into `known`.
    pub population: Vec<u64>,
    /// The generations so far.
    pub history: Vec<StoredGeneration>,
    /// The generation of the last gain.
    pub last_gain: u64,
}

/// The evaluation of a genome.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evaluation {
    /// Infinite if the pattern has no field or is not feasible; from the rough score if it was not judged.
    pub fitness: f64,
    pub value_mm: f64,
    pub area: f64,
    /// Whether the evaluator has judged it.
    pub judged: bool,
    /// Whether it is feasible; `None` if not checked.
    pub feasible: Option<bool>,
}

/// The report of a generation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct StoredGeneration {
    /// The best genome, as an index into `known`.
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

/// The digest of the options on which the search depends. The number of generations is not one of them: a search with
/// more generations continues the same search.
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

impl Checkpoint {
    /// Encodes the version, the length of the header, the header, the evaluations, and the digest of all these. `None`
    /// if the header cannot be encoded, as for a population of a million.
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
        Some(sealed(bytes))
    }

    /// Inverse of [`Checkpoint::to_bytes`].
    ///
    /// # Errors
    /// If the bytes are not a valid checkpoint of a search with these options.
    pub(super) fn from_bytes(bytes: &[u8], options: &EvolveOptions, groups: usize) -> Result<Self, CheckpointError> {
        let content = opened(bytes)?;
        let (version, rest) = content.split_first_chunk::<4>().ok_or(CheckpointError::Damaged)?;
        let found = u32::from_le_bytes(*version);
        if found != VERSION {
            return Err(CheckpointError::Version { found, read: VERSION });
        }
        let (header, rows) = parts(rest).ok_or(CheckpointError::Damaged)?;
        if header.options != digest(options) || header.history.len() > options.generations + 1 {
            return Err(CheckpointError::Options);
        }
        let checkpoint = Self {
            known: known(rows, groups).ok_or(CheckpointError::Damaged)?,
            population: header.population,
            history: header.history,
            last_gain: header.last_gain,
        };
        let is_valid = header.known == checkpoint.known.len() as u64 && checkpoint.is_valid(options);
        is_valid.then_some(checkpoint).ok_or(CheckpointError::Damaged)
    }

    /// Whether all indices are in range, and there is at least one generation.
    fn is_valid(&self, options: &EvolveOptions) -> bool {
        let steps = self.history.iter().map(|step| &step.genome);
        let within = |&index: &u64| index < self.known.len() as u64;
        !self.history.is_empty()
            && self.last_gain < self.history.len() as u64
            && self.population.len() == options.population
            && self.population.iter().chain(steps).all(within)
            && self.known.windows(2).all(|pair| pair[0].0 < pair[1].0)
    }
}

/// The content of a checkpoint with its digest at the end.
pub(super) fn sealed(mut content: Vec<u8>) -> Vec<u8> {
    let digest = Digest::of(&content);
    content.extend(digest.as_bytes());
    content
}

/// Inverse of [`sealed`].
///
/// # Errors
/// If the content has another digest.
pub(super) fn opened(bytes: &[u8]) -> Result<&[u8], CheckpointError> {
    let (content, digest) = bytes.split_last_chunk::<32>().ok_or(CheckpointError::Damaged)?;
    let is_whole = Digest::of(content) == Digest::from_bytes(*digest);
    is_whole.then_some(content).ok_or(CheckpointError::Damaged)
}

fn parts(bytes: &[u8]) -> Option<(Header, &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<8>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let (header, rows) = rest.split_at_checked(length)?;
    Some((decode(header).ok()?, rows))
}

fn known(bytes: &[u8], groups: usize) -> Option<Vec<(Genome, Evaluation)>> {
    let rows = bytes.chunks_exact(row_bytes(groups));
    rows.remainder().is_empty().then_some(())?;
    let row = |row: &[u8]| {
        let (genome, rest) = row.split_at_checked(Genome::bytes(groups))?;
        let (numbers, status) = rest.as_chunks::<8>();
        let [fitness, value_mm, area] = [0, 1, 2].map(|at| f64::from_le_bytes(numbers[at]));
        let (judged, feasible) = match status {
            [0] => (true, None),
            [1] => (true, Some(false)),
            [2] => (true, Some(true)),
            [3] => (false, None),
            _ => return None,
        };
        let evaluation = Evaluation {
            fitness,
            value_mm,
            area,
            judged,
            feasible,
        };
        let genome = Genome::from_bytes(genome, groups)?;
        (!fitness.is_nan()).then_some((genome, evaluation))
    };
    rows.map(row).collect()
}
