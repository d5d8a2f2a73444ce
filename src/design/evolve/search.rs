//! Generation after generation.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::history::{History, Individual};
use super::niche::{Niches, order};
use super::options::EvolveOptions;
use super::result::{GenerationReport, Watch, Winner};
use super::state::{Known, State, StoredGeneration};
use super::{Setting, allowed_units};
use crate::genome::Genome;
use crate::operators::{cross, exchange_groups, invert, smooth};
use deaflow_base::Stream;
use deaflow_field::{PredictError, StateFields};
use deaflow_pattern::{Layers, Pattern};

/// What it costs in F not to keep the constraints, however little: as much as 2.5 mm.
const VIOLATION: f64 = 1.0;

/// What it costs in F for each share of the membrane that does not keep them.
const VIOLATED_SHARE: f64 = 10.0;

/// Patterns that are judged between two reports at least: what takes seconds for each is followed then. A network takes as many at once on
/// each thread, so that multiples of them are parted alike.
const BATCH: usize = 64;

/// Twice as many are judged next where they took less, half as many where they took ten times as long.
const SOON: Duration = Duration::from_millis(100);

/// What is known of a genome, and its pattern.
struct Entry {
    known: Known,
    /// F by the rough score; NaN where there is none.
    rough: f64,
    layers: Layers,
}

/// A search with all that it has judged.
pub(super) struct Search<'a> {
    setting: &'a Setting<'a>,
    options: &'a EvolveOptions,
    /// The units that may be on.
    allowed: Genome,
    known: HashMap<Genome, Entry>,
    /// How many patterns are judged between two reports.
    batch: usize,
}

impl<'a> Search<'a> {
    pub fn new(setting: &'a Setting<'a>, options: &'a EvolveOptions) -> Self {
        Self {
            setting,
            options,
            allowed: allowed_units(setting.constraints),
            known: HashMap::new(),
            batch: BATCH * rayon::current_num_threads().next_power_of_two(),
        }
    }

    /// How many groups of electrodes there are.
    pub fn groups(&self) -> usize {
        self.setting.constraints.groups()
    }

    /// How many patterns were judged.
    pub fn evaluations(&self) -> usize {
        self.known.values().filter(|entry| entry.known.judged).count()
    }

    /// The next generation of a sorted one.
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
                // One group draws no random numbers here.
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

    /// The individuals of these genomes in their order. Those that go on unchanged were judged, and so were as many more as are to be.
    pub fn evaluated(&mut self, genomes: Vec<Genome>, watch: &dyn Watch) -> Result<Vec<Individual>, PredictError> {
        self.meet(&genomes);
        let mut population: Vec<Individual> = genomes.into_iter().map(|genome| self.individual(genome)).collect();
        let (best, mut next) = match self.setting.rough {
            Some(_) => (self.options.judged_count(), Vec::new()),
            None => (population.len(), unjudged(&population)),
        };
        let mut judged = 0;
        loop {
            if !next.is_empty() {
                self.judge(&next, (judged, best), watch)?;
                judged += next.len();
            }
            self.refresh(&mut population);
            self.sort(&mut population);
            next = unjudged(&population[..best]);
            if next.is_empty() && !self.check_feasibility(&population)? {
                return Ok(population);
            }
        }
    }

    /// Ranks roughly what was not met before.
    fn meet(&mut self, genomes: &[Genome]) {
        let unknown = distinct(genomes.iter().filter(|genome| !self.known.contains_key(*genome)));
        let entries: Vec<Entry> = unknown.par_iter().map(|genome| self.entry(genome)).collect();
        self.known.extend(unknown.into_iter().zip(entries));
    }

    fn entry(&self, genome: &Genome) -> Entry {
        let (pattern, layers) = self.pattern(genome);
        let score = self.setting.rough.map(|rough| rough.score(&pattern));
        let rough = score.map_or(f64::NAN, |score| self.fitness(&pattern, score));
        Entry {
            known: Known {
                fitness: rough,
                value_mm: 0.0,
                area: pattern.area_fraction(),
                judged: false,
                feasible: None,
            },
            rough,
            layers,
        }
    }

    /// Asks the evaluator of these genomes. Before them so many of their generation were judged, of so many in all or more.
    fn judge(
        &mut self,
        genomes: &[Genome],
        (before, all): (usize, usize),
        watch: &dyn Watch,
    ) -> Result<(), PredictError> {
        let patterns: Vec<Pattern> = genomes
            .iter()
            .map(|genome| self.known[genome].layers.pattern())
            .collect();
        let all = all.max(before + genomes.len()) as f64;
        let judged = |of_these: usize| watch.judged((before + of_these) as f64 / all);
        let found = self.predicted(&patterns, &judged)?;
        for (genome, known) in genomes.iter().zip(found) {
            if let Some(entry) = self.known.get_mut(genome) {
                entry.known = known;
            }
        }
        Ok(())
    }

    /// Takes over what is known by now. Rough F are off alike in a generation, and are shifted by what those that were judged are off.
    fn refresh(&self, population: &mut [Individual]) {
        let entries = population.iter().map(|individual| &self.known[&individual.genome]);
        let judged = entries.filter(|entry| entry.known.judged);
        let off = judged.map(|entry| entry.known.fitness - entry.rough);
        let off: Vec<f64> = off.filter(|off| off.is_finite()).collect();
        let shift = off.iter().sum::<f64>() / off.len().max(1) as f64;
        for individual in population {
            individual.known = self.known[&individual.genome].known;
            if !individual.known.judged {
                individual.known.fitness += shift;
            }
        }
    }

    fn individual(&self, genome: Genome) -> Individual {
        Individual {
            known: self.known[&genome].known,
            genome,
        }
    }

    /// The pattern of a genome, mended where constraints ask for it; what cannot be mended is left without the cells that
    /// are not allowed.
    fn pattern(&self, genome: &Genome) -> (Pattern, Layers) {
        let constraints = self.setting.constraints;
        let pattern = genome.pattern(constraints.membrane().raster);
        let layers = constraints.layers(&pattern);
        if constraints.is_free() {
            return (pattern, layers);
        }
        let mended = constraints.repaired_layers(&layers);
        let layers = mended.unwrap_or_else(|| constraints.layers(&constraints.masked(&pattern)));
        (layers.pattern(), layers)
    }

    /// What is known of patterns once they are predicted; `watch` hears how many were.
    fn predicted(&mut self, patterns: &[Pattern], watch: &dyn Fn(usize)) -> Result<Vec<Known>, PredictError> {
        let mut fields = Vec::with_capacity(patterns.len());
        let mut judged = 0;
        while judged < patterns.len() {
            let begun = Instant::now();
            let some = &patterns[judged..patterns.len().min(judged + self.batch)];
            fields.extend(self.setting.predictor.predict_some(some)?);
            judged += some.len();
            if judged < patterns.len() {
                self.batch = paced(self.batch, begun.elapsed());
                watch(judged);
            }
        }
        check_count(fields.len(), "fields", patterns.len())?;
        let known = |(pattern, fields): (&Pattern, &Option<StateFields>)| Known {
            fitness: fields.as_ref().map_or(f64::INFINITY, |fields| {
                self.fitness(pattern, self.setting.goal.score(fields))
            }),
            value_mm: fields.as_ref().map_or(0.0, |fields| self.setting.goal.value_mm(fields)),
            area: pattern.area_fraction(),
            judged: true,
            feasible: None,
        };
        Ok(patterns.iter().zip(&fields).map(known).collect())
    }

    fn fitness(&self, pattern: &Pattern, score: f64) -> f64 {
        let fitness = self.setting.goal.fitness_of(pattern, score);
        let constraints = self.setting.constraints;
        if constraints.is_free() || constraints.hold(pattern) {
            return fitness;
        }
        fitness + VIOLATION + VIOLATED_SHARE * constraints.violations(pattern).share()
    }

    /// Sorts by fitness, then genome; then into niches where several designs are wanted. What has no field comes last.
    fn sort(&self, population: &mut Vec<Individual>) {
        population.sort_by(|a, b| {
            let by_fitness = a.known.fitness.total_cmp(&b.known.fitness);
            by_fitness.then_with(|| a.genome.cmp(&b.genome))
        });
        if self.options.designs == 1 {
            return;
        }
        let finite = population.partition_point(|individual| individual.known.fitness.is_finite());
        let layers: Vec<Layers> = population[..finite]
            .iter()
            .map(|individual| self.known[&individual.genome].layers.clone())
            .collect();
        let mut places = vec![0; population.len()];
        let equivalence = self.setting.constraints.equivalence();
        let order = order(&layers, self.options.designs, self.options.distance, equivalence);
        for (place, index) in order.into_iter().chain(finite..population.len()).enumerate() {
            places[index] = place;
        }
        let mut placed: Vec<(usize, Individual)> = places.into_iter().zip(population.drain(..)).collect();
        placed.sort_unstable_by_key(|(place, _)| *place);
        population.extend(placed.into_iter().map(|(_, individual)| individual));
    }

    /// Asks whether those of the best are feasible of which it is not known; whether one of them is not.
    fn check_feasibility(&mut self, population: &[Individual]) -> Result<bool, PredictError> {
        let best = population[..self.options.elites()].iter();
        let unasked = best.filter(|i| i.known.fitness.is_finite() && i.known.feasible.is_none());
        let genomes = distinct(unasked.map(|individual| &individual.genome));
        let mut refused = false;
        for (genome, feasible) in genomes.iter().zip(self.feasible(&genomes)?) {
            if let Some(entry) = self.known.get_mut(genome) {
                entry.known = entry.known.with_verdict(feasible);
            }
            refused |= !feasible;
        }
        Ok(refused)
    }

    fn feasible(&self, genomes: &[Genome]) -> Result<Vec<bool>, PredictError> {
        let Some(feasibility) = self.setting.feasibility else {
            return Ok(Vec::new());
        };
        if genomes.is_empty() {
            return Ok(Vec::new());
        }
        let patterns: Vec<Pattern> = genomes
            .iter()
            .map(|genome| self.known[genome].layers.pattern())
            .collect();
        let verdicts = feasibility.feasible(&patterns)?;
        check_count(verdicts.len(), "verdicts", patterns.len())?;
        Ok(verdicts)
    }

    /// The best of all, then the best of all that were judged which differ enough from those before, keep the constraints and
    /// are feasible.
    pub fn winners(&mut self, history: &History) -> Result<Vec<Winner>, PredictError> {
        let best = &history.population[0].genome;
        let mut winners = vec![self.winner(best)];
        if self.options.designs == 1 {
            return Ok(winners);
        }
        let equivalence = self.setting.constraints.equivalence();
        let mut niches = Niches::new(self.options.designs, self.options.distance, equivalence);
        niches.add(&self.known[best].layers);
        let judged = self
            .known
            .iter()
            .filter(|(_, entry)| entry.known.judged && entry.known.fitness.is_finite());
        let mut sorted: Vec<(f64, Genome)> = judged.map(|(g, entry)| (entry.known.fitness, g.clone())).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        for (_, genome) in sorted {
            if niches.are_full() {
                break;
            }
            let Entry { known, layers, .. } = &self.known[&genome];
            if !niches.are_far_from(layers) || !self.setting.constraints.hold_layers(layers) {
                continue;
            }
            let asked = known.feasible;
            let feasible = match asked {
                Some(verdict) => verdict,
                None => self.feasible(std::slice::from_ref(&genome))?.first().is_none_or(|&v| v),
            };
            if feasible {
                niches.add(&self.known[&genome].layers);
                winners.push(self.winner(&genome));
            }
        }
        Ok(winners)
    }

    fn winner(&self, genome: &Genome) -> Winner {
        let Entry { known, layers, .. } = &self.known[genome];
        let pattern = layers.pattern();
        Winner {
            genome: genome.clone(),
            fitness: known.fitness,
            value_mm: known.value_mm,
            area: known.area,
            violations: self.setting.constraints.violations(&pattern),
            pattern,
        }
    }

    /// The state after a generation as bytes.
    pub fn state(&self, history: &History) -> Option<Vec<u8>> {
        let mut known: Vec<(Genome, Known)> = self.known.iter().map(|(g, entry)| (g.clone(), entry.known)).collect();
        known.sort_unstable_by(|a, b| a.0.cmp(&b.0));
        let place = |genome: &Genome| {
            known
                .binary_search_by(|(other, _)| other.cmp(genome))
                .ok()
                .map(|at| at as u64)
        };
        let step = |report: &GenerationReport| {
            Some(StoredGeneration {
                genome: place(&report.genome)?,
                best: report.best,
                mean: report.mean,
                value_mm: report.value_mm,
                area: report.area,
            })
        };
        let state = State {
            population: history
                .population
                .iter()
                .map(|i| place(&i.genome))
                .collect::<Option<_>>()?,
            history: history.reports.iter().map(step).collect::<Option<_>>()?,
            last_gain: history.last_gain as u64,
            known,
        };
        state.to_bytes(self.options, self.groups())
    }

    /// What a state had come to.
    pub fn restored(&mut self, state: State) -> History {
        let genome = |place: u64| state.known[place as usize].0.clone();
        let individual = |&place: &u64| Individual {
            genome: genome(place),
            known: state.known[place as usize].1,
        };
        let report = |(generation, step): (usize, &StoredGeneration)| GenerationReport {
            generation,
            genome: genome(step.genome),
            best: step.best,
            mean: step.mean,
            value_mm: step.value_mm,
            area: step.area,
        };
        let history = History {
            population: state.population.iter().map(individual).collect(),
            reports: state.history.iter().enumerate().map(report).collect(),
            last_gain: state.last_gain as usize,
        };
        let entry = |(genome, known)| {
            let entry = self.entry(&genome);
            (genome, Entry { known, ..entry })
        };
        self.known = state.known.into_par_iter().map(entry).collect();
        history
    }
}

impl Known {
    /// With the verdict on it: what is not feasible is worse than any other.
    fn with_verdict(self, feasible: bool) -> Self {
        Self {
            fitness: if feasible { self.fitness } else { f64::INFINITY },
            feasible: Some(feasible),
            ..self
        }
    }
}

/// How many patterns to judge next, after so many took so long.
fn paced(batch: usize, took: Duration) -> usize {
    if took < SOON {
        2 * batch
    } else if took > 10 * SOON {
        BATCH.max(batch / 2)
    } else {
        batch
    }
}

/// The genomes of those individuals that were not judged.
fn unjudged(individuals: &[Individual]) -> Vec<Genome> {
    let unjudged = individuals.iter().filter(|individual| !individual.known.judged);
    distinct(unjudged.map(|individual| &individual.genome))
}

/// Genomes each once, sorted.
fn distinct<'g>(genomes: impl Iterator<Item = &'g Genome>) -> Vec<Genome> {
    let mut genomes: Vec<Genome> = genomes.cloned().collect();
    genomes.sort_unstable();
    genomes.dedup();
    genomes
}

fn check_count(found: usize, what: &str, patterns: usize) -> Result<(), PredictError> {
    match found == patterns {
        true => Ok(()),
        false => Err(PredictError::failed(format!("{found} {what} for {patterns} patterns"))),
    }
}

/// The better of two random individuals of a sorted population.
fn parent(population: &[Individual], stream: &mut Stream) -> Genome {
    let rank = stream.index(population.len()).min(stream.index(population.len()));
    population[rank].genome.clone()
}
