//! How to search.

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvolveOptions {
    /// Individuals in a generation.
    pub population: usize,
    /// Generations bred after the first, random one.
    pub generations: usize,
    /// Share of the best that goes on unchanged; at least one individual does.
    pub elite: f64,
    /// Share of a generation that is judged, where a rough score ranks all: the best, 50 at least. The others are ranked by it alone.
    pub judged: f64,
    /// Probability that two parents exchange genes.
    pub crossover: f64,
    /// Probability that a child is mutated.
    pub mutation: f64,
    /// Ends the search after this many generations without gain.
    pub stagnation: Option<usize>,
    /// Different designs that are searched at once.
    pub designs: usize,
    /// The least share of cells in which two of these differ, whichever way they are turned.
    pub distance: f64,
    /// Names the random choices.
    pub seed: u64,
}

impl Default for EvolveOptions {
    fn default() -> Self {
        Self::PAPER
    }
}

/// Options that describe no search.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum OptionsError {
    /// Too few to choose among.
    #[error("a population has at least 2 individuals, found {0}")]
    Population(usize),
    /// Not a share or probability.
    #[error("{name} lies between 0 and 1, found {found}")]
    Share {
        /// Which option.
        name: &'static str,
        /// What was found.
        found: f64,
    },
    /// A search that would end before it begins.
    #[error("stagnation is at least 1 generation")]
    Stagnation,
    /// Nothing to search.
    #[error("designs is at least 1")]
    Designs,
}

/// Of 60 individuals a quarter found 4 % less in ten generations than all do; a quarter of 200 is no loss.
const LEAST_JUDGED: usize = 50;

impl EvolveOptions {
    /// The paper's: 1000 individuals, 60 generations, 2 % elite, crossover 0.7, mutation 0.3, all judged; one design.
    pub const PAPER: Self = Self {
        population: 1000,
        generations: 60,
        elite: 0.02,
        judged: 1.0,
        crossover: 0.7,
        mutation: 0.3,
        stagnation: None,
        designs: 1,
        distance: 0.05,
        seed: 0,
    };

    pub(super) fn validate(&self) -> Result<(), OptionsError> {
        if self.population < 2 {
            return Err(OptionsError::Population(self.population));
        }
        let shares = [
            ("elite", self.elite),
            ("judged", self.judged),
            ("crossover", self.crossover),
            ("mutation", self.mutation),
            ("distance", self.distance),
        ];
        if let Some((name, found)) = shares.into_iter().find(|(_, share)| !(0.0..=1.0).contains(share)) {
            return Err(OptionsError::Share { name, found });
        }
        if self.stagnation == Some(0) {
            return Err(OptionsError::Stagnation);
        }
        match self.designs {
            0 => Err(OptionsError::Designs),
            _ => Ok(()),
        }
    }

    /// How many go on unchanged: each design that is searched, but never all, or nothing would change.
    pub(super) fn elites(&self) -> usize {
        let wanted = (self.elite * self.population as f64).round() as usize;
        wanted.max(self.designs).clamp(1, self.population - 1)
    }

    /// How many are judged: all that go on unchanged, and of few not so few that a search finds less.
    pub(super) fn judged_count(&self) -> usize {
        let wanted = (self.judged * self.population as f64).ceil() as usize;
        wanted.max(self.elites()).max(LEAST_JUDGED).min(self.population)
    }
}
