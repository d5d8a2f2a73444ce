//! Checkpoints of the search of a front: the population and the history as bytes. The patterns are judged again, so
//! that a resumed search gives the same result.

use serde::{Deserialize, Serialize};

use super::checkpoint::{CheckpointError, opened, sealed};
use super::nsga2::{FrontGeneration, Member};
use super::options::EvolveOptions;
use crate::genome::Genome;
use deaflow_base::{Digest, decode, encode};

/// The version of the layout.
const VERSION: u32 = 1;

/// The state of a search after a generation.
pub(super) struct Stored {
    /// The genomes in their order, and whether each is feasible.
    pub population: Vec<(Genome, Option<bool>)>,
    /// The generations so far; at least one.
    pub history: Vec<FrontGeneration>,
}

#[derive(Serialize, Deserialize)]
struct Content {
    version: u32,
    options: Digest,
    genomes: Vec<Vec<u8>>,
    feasible: Vec<Option<bool>>,
    evaluations: Vec<u64>,
    fronts: Vec<Vec<Vec<f64>>>,
}

/// The digest of the options on which the search depends, without the number of generations.
fn digest(options: &EvolveOptions) -> Digest {
    let shares = [options.crossover, options.mutation];
    let shares = shares.iter().flat_map(|share| share.to_bits().to_le_bytes());
    let numbers = [options.population as u64, options.seed];
    let bytes: Vec<u8> = shares
        .chain(numbers.iter().flat_map(|number| number.to_le_bytes()))
        .collect();
    Digest::of(&bytes)
}

impl Stored {
    /// The state of a population and the generations so far.
    pub fn of(population: &[Member], history: &[FrontGeneration]) -> Self {
        let genomes = population.iter().map(|member| (member.genome.clone(), member.feasible));
        Self {
            population: genomes.collect(),
            history: history.to_vec(),
        }
    }

    /// Encodes the content and its digest; `None` if that is not possible.
    pub fn to_bytes(&self, options: &EvolveOptions, groups: usize) -> Option<Vec<u8>> {
        let content = Content {
            version: VERSION,
            options: digest(options),
            genomes: self
                .population
                .iter()
                .map(|(genome, _)| genome.to_bytes(groups))
                .collect(),
            feasible: self.population.iter().map(|(_, feasible)| *feasible).collect(),
            evaluations: self.history.iter().map(|one| one.evaluations as u64).collect(),
            fronts: self.history.iter().map(|one| one.front.clone()).collect(),
        };
        encode(&content).ok().map(sealed)
    }

    /// Inverse of [`Stored::to_bytes`].
    ///
    /// # Errors
    /// If the bytes are not a valid checkpoint of a search with these options.
    pub fn from_bytes(bytes: &[u8], options: &EvolveOptions, groups: usize) -> Result<Self, CheckpointError> {
        let content: Content = decode(opened(bytes)?).map_err(|_| CheckpointError::Damaged)?;
        if content.version != VERSION {
            let (found, read) = (content.version, VERSION);
            return Err(CheckpointError::Version { found, read });
        }
        if content.options != digest(options) || content.fronts.len() > options.generations + 1 {
            return Err(CheckpointError::Options);
        }
        let genomes = content.genomes.iter().map(|bytes| Genome::from_bytes(bytes, groups));
        let genomes: Option<Vec<Genome>> = genomes.collect();
        let genomes = genomes.ok_or(CheckpointError::Damaged)?;
        let is_valid = !genomes.is_empty()
            && genomes.len() == content.feasible.len()
            && !content.fronts.is_empty()
            && content.fronts.len() == content.evaluations.len();
        let generations = content.evaluations.into_iter().zip(content.fronts);
        let generation = |(evaluations, front): (u64, Vec<Vec<f64>>)| FrontGeneration {
            evaluations: evaluations as usize,
            front,
        };
        let stored = Self {
            population: genomes.into_iter().zip(content.feasible).collect(),
            history: generations.map(generation).collect(),
        };
        is_valid.then_some(stored).ok_or(CheckpointError::Damaged)
    }
}
