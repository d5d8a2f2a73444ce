//! The next generation: selection, crossover, mutation and filter.

use rayon::prelude::*;

use super::history::{History, Individual};
use super::search::Search;
use crate::genome::Genome;
use crate::operators::{cross, exchange_groups, invert, smooth};
use deaflow_base::Stream;

impl Search<'_> {
    /// The genomes of the next generation.
    pub fn next_generation(&self, history: &History) -> Vec<Genome> {
        let (size, population) = (self.options.population, &history.population);
        let mut stream = Stream::new(self.options.seed, "generation", history.reports.len() as u64);
        let elites = population[..self.options.elites()].iter();
        let mut next: Vec<Genome> = elites.map(|individual| individual.genome.clone()).collect();
        let mut children = Vec::with_capacity(size - next.len() + 1);
        while next.len() + children.len() < size {
            let (mut a, mut b) = (parent(population, &mut stream), parent(population, &mut stream));
            if stream.chance(self.options.crossover) {
                cross(&mut a, &mut b, &mut stream);
            }
            for mut child in [a, b] {
                if stream.chance(self.options.mutation) {
                    invert(&mut child, &mut stream);
                }
                // A search with one group draws no random numbers here.
                if self.groups() > 1 && stream.chance(self.options.mutation) {
                    exchange_groups(&mut child, self.groups(), &mut stream);
                }
                children.push(child);
            }
        }
        let finished = |child: Genome| smooth(&child, self.groups()).within(&self.allowed);
        next.par_extend(children.into_par_iter().map(finished));
        next.truncate(size);
        next
    }
}

/// The better of two random individuals of a sorted population.
fn parent(population: &[Individual], stream: &mut Stream) -> Genome {
    let rank = stream.index(population.len()).min(stream.index(population.len()));
    population[rank].genome.clone()
}
