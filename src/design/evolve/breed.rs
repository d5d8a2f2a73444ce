//! The next generation: selection, crossover, mutation and filter.

use rayon::prelude::*;

use super::history::History;
use super::search::Search;
use crate::genome::{Genome, Units};
use crate::operators::{cross, exchange_groups, invert, smooth};
use deaflow_base::Stream;

impl Search<'_> {
    /// The genomes of the next generation.
    pub fn next_generation(&self, history: &History) -> Vec<Genome> {
        let population = &history.population;
        let mut stream = Stream::new(self.options.seed, "generation", history.reports.len() as u64);
        let elites = population[..self.options.elites()].iter();
        let mut next: Vec<Genome> = elites.map(|individual| individual.genome.clone()).collect();
        let breeding = Breeding {
            crossover: self.options.crossover,
            mutation: self.options.mutation,
            groups: self.groups(),
            units: &self.units,
        };
        let parents: Vec<&Genome> = population.iter().map(|individual| &individual.genome).collect();
        next.extend(breeding.children(&parents, self.options.population - next.len(), &mut stream));
        next
    }
}

/// How children are made.
pub(super) struct Breeding<'a> {
    /// Probability of a crossover.
    pub crossover: f64,
    /// Probability of a mutation.
    pub mutation: f64,
    /// The number of electrode groups.
    pub groups: usize,
    /// The units of the membrane.
    pub units: &'a Units,
}

impl Breeding<'_> {
    /// A number of children of parents, which are sorted, the best first.
    pub fn children(&self, parents: &[&Genome], count: usize, stream: &mut Stream) -> Vec<Genome> {
        let mut children = Vec::with_capacity(count + 1);
        while children.len() < count {
            let (mut a, mut b) = (parent(parents, stream), parent(parents, stream));
            if stream.chance(self.crossover) {
                cross(&mut a, &mut b, stream);
            }
            for mut child in [a, b] {
                if stream.chance(self.mutation) {
                    invert(&mut child, stream);
                }
                // A search with one group draws no random numbers here.
                if self.groups > 1 && stream.chance(self.mutation) {
                    exchange_groups(&mut child, self.groups, stream);
                }
                children.push(child);
            }
        }
        children.truncate(count);
        let finished = |child: Genome| {
            let child = self.units.unified(child);
            self.units.restricted(smooth(&child, self.groups))
        };
        children.into_par_iter().map(finished).collect()
    }
}

/// The better of two random individuals.
fn parent(sorted: &[&Genome], stream: &mut Stream) -> Genome {
    let rank = stream.index(sorted.len()).min(stream.index(sorted.len()));
    sorted[rank].clone()
}
