//! The genetic algorithm NSGA-II for several objectives (Deb, Pratap, Agarwal and Meyarivan, IEEE Transactions on
//! Evolutionary Computation 6(2), 2002): parents and children are ranked together by non-dominated sorting, then by
//! their distance from others, and the best become the next generation.
//!
//! Patterns that violate constraints rank behind all that satisfy them, those without a field and those that are not
//! feasible last. The first generation has given genomes beside random ones. No genome is twice in a generation.

use std::cmp::Ordering;
use std::collections::HashSet;

use rayon::prelude::*;

use super::breed::Breeding;
use super::nsga2_checkpoint::Stored;
use super::options::EvolveOptions;
use super::result::{FrontReport, Observer};
use super::search::{Batches, pattern_of, verdicts};
use super::{EvolveError, first_generation, loaded};
use crate::constraint::Constraints;
use crate::genome::{Genome, Units};
use deaflow_base::Stream;
use deaflow_field::{Feasibility, PredictError, Predictor, StateFields};
use deaflow_pattern::Pattern;

/// The objectives of a front, and how patterns are judged.
#[derive(Clone, Copy)]
pub struct FrontProblem<'a> {
    /// Predicts the fields of patterns in the states of the device.
    pub predictor: &'a dyn Predictor<StateFields>,
    /// The values of the objectives, which should be large.
    pub values: &'a (dyn Fn(&Pattern, &StateFields) -> Vec<f64> + Sync),
    /// The constraints on patterns.
    pub constraints: &'a Constraints,
    /// Checks the margins of patterns of the front.
    pub feasibility: Option<&'a dyn Feasibility>,
    /// Genomes of the first generation; the others are random.
    pub first: &'a [Genome],
}

/// A pattern of a front.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontMember {
    /// The pattern, repaired if there are constraints.
    pub pattern: Pattern,
    /// The values of the objectives.
    pub values: Vec<f64>,
}

/// The front of a generation.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontGeneration {
    /// The number of patterns that were judged so far.
    pub evaluations: usize,
    /// The values of the objectives of each pattern of the front.
    pub front: Vec<Vec<f64>>,
}

/// A finished search of a front.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontEvolution {
    /// The patterns of which no other one is better in all objectives.
    pub front: Vec<FrontMember>,
    /// The generations, including the first one.
    pub history: Vec<FrontGeneration>,
}

/// A genome with what decides its rank.
pub(super) struct Member {
    pub genome: Genome,
    pattern: Pattern,
    /// The values of the objectives; `None` without a field.
    values: Option<Vec<f64>>,
    /// The share of the membrane that violates constraints; negative if none is violated.
    violated: f64,
    /// Whether it is feasible; `None` if not checked.
    pub feasible: Option<bool>,
    /// The rank in the non-dominated sorting, 0 for the front.
    rank: usize,
    /// The crowding distance.
    distance: f64,
}

impl Member {
    /// Whether it has a field and satisfies the constraints and, as far as checked, the margins.
    fn is_valid(&self) -> bool {
        self.values.is_some() && self.violated < 0.0 && self.feasible != Some(false)
    }
}

/// Whether values are at least as good as others in all objectives, and better in one.
pub(super) fn dominates(values: &[f64], others: &[f64]) -> bool {
    let pairs = || values.iter().zip(others);
    pairs().all(|(value, other)| value >= other) && pairs().any(|(value, other)| value > other)
}

/// The sorted population and the generations so far.
type Course = (Vec<Member>, Vec<FrontGeneration>);

/// A running search.
struct FrontSearch<'a> {
    problem: &'a FrontProblem<'a>,
    options: &'a EvolveOptions,
    /// The units of the membrane.
    units: Units,
    batches: Batches,
}

/// Searches the front of several objectives. The observer receives a report and a checkpoint after every generation. A
/// search resumed from a checkpoint gives the same result to the last bit.
///
/// # Errors
/// If the options are out of range, the predictor fails, or no pattern of the first generation has a field or is
/// feasible.
pub fn evolve_front(
    problem: &FrontProblem<'_>,
    options: &EvolveOptions,
    observer: &dyn Observer,
) -> Result<FrontEvolution, EvolveError> {
    options.validate()?;
    let mut search = FrontSearch {
        problem,
        options,
        units: Units::of(problem.constraints.allowed()),
        batches: Batches::default(),
    };
    let (mut population, mut history) = match search.resumed(observer)? {
        Some(resumed) => resumed,
        None => {
            let population = search.first(observer)?;
            let mut history = Vec::new();
            search.record(&population, (&mut history, population.len()), observer)?;
            (population, history)
        }
    };
    while history.len() <= options.generations {
        let children = search.children(&population, history.len() as u64);
        let judged = children.len();
        let children = search.judged(children, observer)?;
        population.extend(children);
        search.rank(&mut population)?;
        population.truncate(options.population);
        search.record(&population, (&mut history, judged), observer)?;
    }
    let front = population
        .into_iter()
        .filter(|member| member.rank == 0 && member.is_valid());
    let member = |member: Member| {
        Some(FrontMember {
            pattern: member.pattern,
            values: member.values?,
        })
    };
    Ok(FrontEvolution {
        front: front.filter_map(member).collect(),
        history,
    })
}

impl FrontSearch<'_> {
    /// The first generation.
    fn first(&mut self, observer: &dyn Observer) -> Result<Vec<Member>, EvolveError> {
        let given = self
            .problem
            .first
            .iter()
            .map(|genome| self.units.restricted(genome.clone()));
        let random = first_generation(
            None,
            self.problem.constraints,
            self.options.seed,
            self.options.population,
        );
        let mut genomes = distinct(given.chain(random), &[]);
        genomes.truncate(self.options.population);
        let mut population = self.judged(genomes, observer)?;
        self.rank(&mut population)?;
        if population.iter().all(|member| member.values.is_none()) {
            return Err(EvolveError::NoField);
        }
        let has_field = |member: &&Member| member.values.is_some();
        match population
            .iter()
            .filter(has_field)
            .all(|member| member.feasible == Some(false))
        {
            true => Err(EvolveError::NotFeasible),
            false => Ok(population),
        }
    }

    /// New genomes from a sorted population.
    fn children(&self, population: &[Member], generation: u64) -> Vec<Genome> {
        // The stream name determines the random numbers, and so the designs.
        let mut stream = Stream::new(self.options.seed, "generation of a front", generation);
        let breeding = Breeding {
            crossover: self.options.crossover,
            mutation: self.options.mutation,
            groups: self.problem.constraints.groups(),
            units: &self.units,
        };
        let parents: Vec<&Genome> = population.iter().map(|member| &member.genome).collect();
        let children = breeding.children(&parents, self.options.population, &mut stream);
        distinct(children.into_iter(), &parents)
    }

    /// Judges genomes.
    fn judged(&mut self, genomes: Vec<Genome>, observer: &dyn Observer) -> Result<Vec<Member>, PredictError> {
        let constraints = self.problem.constraints;
        let patterns: Vec<Pattern> = genomes
            .par_iter()
            .map(|genome| pattern_of(genome, constraints).0)
            .collect();
        let all = patterns.len().max(1) as f64;
        let on_batch = |count: usize| observer.judged(count as f64 / all);
        let fields = self.batches.predict(self.problem.predictor, &patterns, &on_batch)?;
        let member = |((genome, pattern), fields): ((Genome, Pattern), Option<StateFields>)| Member {
            values: fields.map(|fields| (self.problem.values)(&pattern, &fields)),
            violated: match constraints.allow_any_pattern() || constraints.satisfied_by(&pattern) {
                true => -1.0,
                false => constraints.violations(&pattern).share(),
            },
            feasible: None,
            rank: 0,
            distance: 0.0,
            genome,
            pattern,
        };
        let rows: Vec<_> = genomes.into_iter().zip(patterns).zip(fields).collect();
        Ok(rows.into_par_iter().map(member).collect())
    }

    /// Ranks and sorts a population. The margins of the front are checked; a pattern that does not keep them ranks
    /// last.
    fn rank(&self, population: &mut [Member]) -> Result<(), PredictError> {
        loop {
            sort(population);
            let Some(feasibility) = self.problem.feasibility else {
                return Ok(());
            };
            let unchecked = |member: &Member| member.rank == 0 && member.is_valid() && member.feasible.is_none();
            let found = population.iter_mut().filter(|member| unchecked(member));
            let mut found: Vec<&mut Member> = found.collect();
            let patterns: Vec<Pattern> = found.iter().map(|member| member.pattern.clone()).collect();
            if patterns.is_empty() {
                return Ok(());
            }
            let verdicts = verdicts(feasibility, &patterns)?;
            let members = found.iter_mut().zip(&verdicts);
            members.for_each(|(member, feasible)| member.feasible = Some(*feasible));
            if verdicts.iter().all(|feasible| *feasible) {
                return Ok(());
            }
        }
    }

    /// Adds a generation with a number of judged patterns to the history, reports it and stores a checkpoint.
    fn record(
        &self,
        population: &[Member],
        (history, judged): (&mut Vec<FrontGeneration>, usize),
        observer: &dyn Observer,
    ) -> Result<(), EvolveError> {
        let front = population.iter().filter(|member| member.rank == 0 && member.is_valid());
        let front: Vec<Vec<f64>> = front.filter_map(|member| member.values.clone()).collect();
        observer.front(&FrontReport {
            generation: history.len(),
            designs: front.len(),
            best: front.iter().map(|values| values[0]).fold(f64::NEG_INFINITY, f64::max),
        });
        let before = history.last().map_or(0, |last| last.evaluations);
        let evaluations = before + judged;
        history.push(FrontGeneration { evaluations, front });
        let stored = || Stored::of(population, history).to_bytes(self.options, self.problem.constraints.groups());
        Ok(observer.save_checkpoint(&stored)?)
    }

    /// The population and the history of the last checkpoint, if there is one.
    fn resumed(&mut self, observer: &dyn Observer) -> Result<Option<Course>, EvolveError> {
        let groups = self.problem.constraints.groups();
        let stored = loaded(observer, |bytes| Stored::from_bytes(bytes, self.options, groups));
        let Some(stored) = stored else {
            return Ok(None);
        };
        let (genomes, feasible): (Vec<Genome>, Vec<Option<bool>>) = stored.population.into_iter().unzip();
        let mut population = self.judged(genomes, observer)?;
        let members = population.iter_mut().zip(feasible);
        members.for_each(|(member, feasible)| member.feasible = feasible);
        // The order is that among parents and children, of which the rest is lost.
        set_ranks(&mut population);
        observer.resumed(stored.history.len() - 1);
        Ok(Some((population, stored.history)))
    }
}

/// The genomes that are not among others, each once, in their order.
fn distinct(genomes: impl Iterator<Item = Genome>, others: &[&Genome]) -> Vec<Genome> {
    let mut known: HashSet<Genome> = others.iter().map(|genome| (*genome).clone()).collect();
    genomes.filter(|genome| known.insert(genome.clone())).collect()
}

/// Sorts members by rank, then by distance from others in the front of their rank, then by genome.
fn sort(members: &mut [Member]) {
    set_ranks(members);
    let last = members.iter().map(|member| member.rank).max().unwrap_or(0);
    for rank in 0..=last {
        let mut front: Vec<&mut Member> = members.iter_mut().filter(|member| member.rank == rank).collect();
        set_distances(&mut front);
    }
    members.sort_by(|a, b| {
        let by_rank = a.rank.cmp(&b.rank).then(b.distance.total_cmp(&a.distance));
        by_rank.then_with(|| a.genome.cmp(&b.genome))
    });
}

/// Sets the ranks: the fronts of valid members, then the others by the share of violated constraints, then those
/// without a field or not feasible.
fn set_ranks(members: &mut [Member]) {
    let valid: Vec<usize> = (0..members.len()).filter(|&at| members[at].is_valid()).collect();
    let values = |at: usize| members[at].values.as_deref().unwrap_or_default();
    // The number of members that dominate each one, and those that it dominates.
    let dominated = |&at: &usize| -> Vec<usize> {
        let others = (0..valid.len()).filter(|&other| dominates(values(at), values(valid[other])));
        others.collect()
    };
    let below: Vec<Vec<usize>> = valid.par_iter().map(dominated).collect();
    let mut above = vec![0_usize; valid.len()];
    below.iter().flatten().for_each(|&other| above[other] += 1);
    let mut front: Vec<usize> = (0..valid.len()).filter(|&at| above[at] == 0).collect();
    let mut rank = 0;
    while !front.is_empty() {
        let mut next = Vec::new();
        for at in front {
            members[valid[at]].rank = rank;
            for &other in &below[at] {
                above[other] -= 1;
                if above[other] == 0 {
                    next.push(other);
                }
            }
        }
        front = next;
        rank += 1;
    }
    let is_usable = |member: &Member| member.values.is_some() && member.feasible != Some(false);
    let mut violating: Vec<&mut Member> = members
        .iter_mut()
        .filter(|member| !member.is_valid() && is_usable(member))
        .collect();
    violating.sort_by(|a, b| a.violated.total_cmp(&b.violated));
    for member in violating {
        member.rank = rank;
        rank += 1;
    }
    let unusable = members.iter_mut().filter(|member| !is_usable(member));
    unusable.for_each(|member| member.rank = rank);
}

/// Sets the crowding distances of a front: for each objective the difference between both neighbours, as a share of
/// the range; infinite at the ends.
fn set_distances(front: &mut [&mut Member]) {
    front.iter_mut().for_each(|member| member.distance = 0.0);
    let objectives = front
        .first()
        .and_then(|member| member.values.as_ref())
        .map_or(0, Vec::len);
    if front.iter().any(|member| member.values.is_none()) {
        return;
    }
    let of = |member: &Member, objective: usize| member.values.as_ref().map_or(0.0, |values| values[objective]);
    for objective in 0..objectives {
        let by_value = |a: &&mut Member, b: &&mut Member| -> Ordering {
            let by_value = of(a, objective).total_cmp(&of(b, objective));
            by_value.then_with(|| a.genome.cmp(&b.genome))
        };
        front.sort_by(by_value);
        let last = front.len() - 1;
        let range = of(front[last], objective) - of(front[0], objective);
        for end in [0, last] {
            front[end].distance = f64::INFINITY;
        }
        if range > 0.0 {
            for at in 1..last {
                let between = of(front[at + 1], objective) - of(front[at - 1], objective);
                front[at].distance += between / range;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;
    use crate::front::hypervolume_of;
    use crate::tests::TestDevice;
    use deaflow_base::Stopped;
    use deaflow_field::{Field, InStates};
    use deaflow_pattern::Membrane;

    fn member(values: &[f64], violated: f64, feasible: Option<bool>, at: usize) -> Member {
        Member {
            genome: Genome::from_fn(|x, _| x < at),
            pattern: Pattern::from_fn(deaflow_pattern::Raster::PAPER, |_, _| false),
            values: (!values.is_empty()).then(|| values.to_vec()),
            violated,
            feasible,
            rank: 0,
            distance: 0.0,
        }
    }

    #[test]
    fn members_are_sorted_by_front_then_distance_and_invalid_ones_come_last() {
        let valid = |values: &[f64], at| member(values, -1.0, None, at);
        let mut members = vec![
            member(&[], -1.0, None, 0),
            member(&[9.0, 9.0], -1.0, Some(false), 1),
            member(&[9.0, 9.0], 0.3, None, 2),
            member(&[0.0, 0.0], 0.1, None, 3),
            valid(&[1.0, 1.0], 4),
            valid(&[4.0, 0.0], 5),
            valid(&[0.0, 4.0], 6),
            valid(&[2.0, 2.5], 7),
            valid(&[2.1, 2.4], 8),
            valid(&[2.0, 2.0], 9),
        ];
        sort(&mut members);
        let order: Vec<(usize, usize)> = members
            .iter()
            .map(|member| {
                let on = member.genome.genes()[..20].iter().filter(|gene| **gene != 0).count();
                (on, member.rank)
            })
            .collect();
        // Ends first, then the two in the middle: (2.1, 2.4) has the larger gap.
        assert_eq!(order[..2].iter().map(|(_, rank)| *rank).collect::<Vec<_>>(), [0, 0]);
        let expected = [(7, 0), (8, 0), (9, 1), (4, 2), (3, 3), (2, 4)];
        let middle: HashSet<(usize, usize)> = order[2..4].iter().copied().collect();
        assert_eq!(middle, expected[..2].iter().copied().collect());
        assert_eq!(order[4..8], expected[2..]);
        assert!(order[8..].iter().all(|(_, rank)| *rank == 5), "{order:?}");
        assert!(members[0].distance.is_infinite() && members[1].distance.is_infinite());
        // Each gap as a share of the range of 4.
        let seventh = members
            .iter()
            .find(|member| member.values == Some(vec![2.0, 2.5]))
            .unwrap();
        assert!(
            (seventh.distance - (2.1 / 4.0 + 1.6 / 4.0)).abs() < 1e-12,
            "{}",
            seventh.distance
        );
    }

    #[test]
    fn values_dominate_others_if_none_is_worse_and_one_is_better() {
        assert!(dominates(&[1.0, 2.0], &[1.0, 1.0]) && !dominates(&[1.0, 1.0], &[1.0, 1.0]));
        assert!(!dominates(&[2.0, 0.0], &[1.0, 1.0]) && !dominates(&[1.0, 1.0], &[1.0, 2.0]));
    }

    /// Each cell of a quarter of the membrane is worth something to one of two objectives; the third is the area.
    fn values(pattern: &Pattern, _: &StateFields) -> Vec<f64> {
        let count = |from: usize| {
            let cells = (0..50).flat_map(|y| (0..50).map(move |x| (x, y)));
            let own = cells.filter(|(x, _)| (from..from + 25).contains(x));
            own.filter(|&(x, y)| pattern.is_active(x, y)).count() as f64 / 2500.0
        };
        vec![count(0), count(25), -(pattern.active_cells() as f64) / 2500.0]
    }

    fn options() -> EvolveOptions {
        EvolveOptions {
            population: 40,
            generations: 12,
            crossover: 0.7,
            mutation: 0.3,
            seed: 3,
            ..EvolveOptions::PAPER
        }
    }

    #[derive(Default)]
    struct Course {
        from: Option<Vec<u8>>,
        stored: RefCell<Vec<Vec<u8>>>,
        reports: RefCell<Vec<FrontReport>>,
        resumed: RefCell<Vec<usize>>,
        rejected: RefCell<usize>,
    }

    impl Observer for Course {
        fn generation(&self, _: &crate::GenerationReport) {}

        fn front(&self, report: &FrontReport) {
            self.reports.borrow_mut().push(*report);
        }

        fn load_checkpoint(&self) -> Option<Vec<u8>> {
            self.from.clone()
        }

        fn save_checkpoint(&self, checkpoint: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
            self.stored.borrow_mut().push(checkpoint().unwrap());
            Ok(())
        }

        fn resumed(&self, generation: usize) {
            self.resumed.borrow_mut().push(generation);
        }

        fn checkpoint_rejected(&self, _: &super::super::CheckpointError) {
            *self.rejected.borrow_mut() += 1;
        }
    }

    struct KeepsACorner;

    impl Feasibility for KeepsACorner {
        fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
            Ok(patterns.iter().map(|pattern| !pattern.is_active(0, 0)).collect())
        }
    }

    fn searched(course: &Course, options: &EvolveOptions, with_margins: bool) -> FrontEvolution {
        let device = TestDevice::linear(vec![1e-6; 2500]);
        let predictor = InStates::one(&device);
        let constraints = Constraints::none(Membrane::square(50.0));
        let seeds = [Genome::from_fn(|x, _| x < 10), Genome::from_fn(|x, _| x >= 10)];
        let problem = FrontProblem {
            predictor: &predictor,
            values: &values,
            constraints: &constraints,
            feasibility: with_margins.then_some(&KeepsACorner as &dyn Feasibility),
            first: &seeds,
        };
        evolve_front(&problem, options, course).unwrap()
    }

    #[test]
    fn the_front_grows_and_none_of_it_is_dominated() {
        let course = Course::default();
        let found = searched(&course, &options(), false);
        assert_eq!(found.history.len(), 13);
        assert_eq!(course.reports.borrow().len(), 13);
        let front: Vec<Vec<f64>> = found.front.iter().map(|member| member.values.clone()).collect();
        assert_eq!(found.history[12].front, front);
        for one in &front {
            assert!(!front.iter().any(|other| dominates(other, one)), "{one:?}");
        }
        let volume = |front: &[Vec<f64>]| hypervolume_of(front, &[0.0, 0.0, -1.0]);
        let first = volume(&found.history[0].front);
        assert!(volume(&front) > first && first > 0.0, "{first} {}", volume(&front));
        // The given genomes are the ends of the front.
        assert!(front.iter().any(|values| values[0] == 0.5));
        assert!(front.iter().any(|values| values[1] == 0.5));
        let counts: Vec<usize> = found.history.iter().map(|one| one.evaluations).collect();
        assert!(
            counts[0] == 40
                && counts
                    .windows(2)
                    .all(|pair| pair[0] < pair[1] && pair[1] <= pair[0] + 40)
        );
        for member in &found.front {
            assert_eq!(
                values(&member.pattern, &vec![Field::zero(member.pattern.raster())]),
                member.values
            );
        }
    }

    #[test]
    fn margins_are_kept_by_the_whole_front() {
        let found = searched(&Course::default(), &options(), true);
        assert!(!found.front.is_empty());
        assert!(found.front.iter().all(|member| !member.pattern.is_active(0, 0)));
    }

    #[test]
    fn a_resumed_search_gives_the_same_result() {
        for with_margins in [false, true] {
            let whole = Course::default();
            let expected = searched(&whole, &options(), with_margins);
            for at in [0, 5, 11] {
                let course = Course {
                    from: Some(whole.stored.borrow()[at].clone()),
                    ..Course::default()
                };
                assert!(
                    searched(&course, &options(), with_margins) == expected,
                    "{at} {with_margins}"
                );
                assert_eq!(*course.resumed.borrow(), [at]);
                assert_eq!(*course.rejected.borrow(), 0);
            }
        }
        let whole = Course::default();
        let expected = searched(&whole, &options(), false);
        let stored = whole.stored.borrow()[5].clone();
        let damaged = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut bytes = stored.clone();
            change(&mut bytes);
            bytes
        };
        for from in [
            damaged(&|bytes| bytes[20] ^= 1),
            damaged(&|bytes| bytes.truncate(40)),
            damaged(&Vec::clear),
        ] {
            let course = Course {
                from: Some(from),
                ..Course::default()
            };
            assert!(searched(&course, &options(), false) == expected);
            assert_eq!(*course.rejected.borrow(), 1);
        }
        // Of a search with other options.
        let course = Course {
            from: Some(stored),
            ..Course::default()
        };
        let other = EvolveOptions { seed: 4, ..options() };
        assert!(searched(&course, &other, false) != expected);
        assert_eq!(*course.rejected.borrow(), 1);
    }
}
