//! A local search under way.

use std::collections::{HashMap, HashSet};

use super::exchange::Exchange;
use super::gains::{Change, Gains};
use super::problem::{SearchProblem, State};
use super::squares::Squares;
use super::{LocalOptimum, SearchStep};
use deaflow_field::PredictError;
use deaflow_pattern::Pattern;

/// Gains below this are rounding of the solver: 0.25 nm on a membrane whose displacements are of the order of 1 mm.
const GAIN: f64 = 1e-7;

/// What a score that is found near another may be short of, ten times what it is: what promises as much less than a gain is simulated.
const DOUBT: f64 = 1e-6;

/// So many of those that promise most are simulated together.
const TOGETHER: usize = 8;

/// Most steps of either kind; a search takes some tens.
const STEPS: usize = 200;

/// How far a search for gains looks: units on either side of the threshold that are simulated one by one, and pairs of them
/// that are simulated together. The second is looked at where the first finds nothing.
const REACH: [(usize, usize); 2] = [(48, 64), (160, 256)];

/// How a unit may be changed, by what is known and its group now.
type Way = fn(&Gains, usize, u8) -> Option<Change>;

/// Those that are on to be off, those that are off to be on, and those that are on to be of another group.
const WAYS: [Way; 3] = [
    |gains, unit, now| gains.removal(unit).filter(|_| now != 0),
    |gains, unit, now| gains.best_electrode(unit, now).filter(|_| now == 0),
    |gains, unit, now| gains.best_electrode(unit, now).filter(|_| now != 0),
];

pub(super) struct LocalSearch<'g> {
    problem: &'g SearchProblem<'g>,
    on_step: &'g dyn Fn(&SearchStep),
    state: State,
    known: Known,
    steps: Vec<SearchStep>,
    simulations: usize,
    exhausted: bool,
}

/// What is known of a state, so that no pattern is simulated twice.
#[derive(Default)]
struct Known {
    /// What changing each unit gains to first order, once it was asked for; none where there is no gradient.
    first_order: Option<Option<Gains>>,
    /// The score with one unit of another group, by unit and group; none where there is no field.
    single: HashMap<(usize, u8), Option<f64>>,
    /// Choices of units that are no gain.
    refused: HashSet<Vec<u8>>,
}

impl<'g> LocalSearch<'g> {
    /// From a start that was simulated twice: as it was given, and made feasible. `first_order` is what changing its units gains, where that is
    /// known.
    pub(super) fn new(
        problem: &'g SearchProblem<'g>,
        on_step: &'g dyn Fn(&SearchStep),
        state: State,
        first_order: Option<Gains>,
    ) -> Self {
        let mut search = Self {
            problem,
            on_step,
            state,
            known: Known {
                first_order: first_order.map(Some),
                ..Known::default()
            },
            steps: Vec::new(),
            simulations: 2,
            exhausted: false,
        };
        search.record_step();
        search
    }

    pub(super) fn follow_gradient(&mut self) -> Result<(), PredictError> {
        for _ in 0..STEPS {
            match self.first_order()? {
                Some(gains) if self.take_best(&gains)? => {}
                _ => return Ok(()),
            }
        }
        Ok(())
    }

    pub(super) fn exchange_pairs(&mut self) -> Result<(), PredictError> {
        for _ in 0..STEPS {
            let Some(first_order) = self.first_order()? else {
                return Ok(());
            };
            let mut gained = false;
            for reach in REACH {
                gained = gained || self.exchange(&first_order, reach)?;
            }
            if !gained {
                self.exhausted = true;
                return Ok(());
            }
        }
        Ok(())
    }

    fn exchange(&mut self, first_order: &Gains, (near, pairs): (usize, usize)) -> Result<bool, PredictError> {
        let feature = self.problem.feature();
        if feature != [1; 2] {
            return self.take_squares(first_order, feature, (near, pairs));
        }
        let gains = self.gains_near(first_order, near)?;
        Ok(self.take_best(&gains)? || self.take_pair(&gains, pairs)?)
    }

    /// What changing each unit gains to first order.
    fn first_order(&mut self) -> Result<Option<Gains>, PredictError> {
        self.simulations += 1;
        if let Some(gains) = &self.known.first_order {
            return Ok(gains.clone());
        }
        let gradient = self.problem.gradient(&self.state.pattern)?;
        let gains = gradient.map(|gradient| self.problem.gains(&self.state.on, &gradient));
        self.known.first_order = Some(gains.clone());
        Ok(gains)
    }

    /// Makes 1, 2, 4, … of the most profitable exchanges, and goes on from the best of these patterns where it is a gain.
    fn take_best(&mut self, gains: &Gains) -> Result<bool, PredictError> {
        let problem = self.problem;
        let mut exchange = Exchange::new(problem.units(), &self.state.on, gains, problem.range());
        let (mut choices, mut count, mut next) = (Vec::new(), 0, 1);
        let mut more = exchange.step();
        while more {
            count += 1;
            let reached = (count == next).then(|| exchange.on.clone());
            more = exchange.step();
            if let Some(reached) = reached {
                choices.push(reached);
                next *= 2;
            } else if !more {
                choices.push(exchange.on.clone());
            }
        }
        self.take(choices)
    }

    /// What the units near the threshold gain if they alone are changed, by simulation; nothing is known of all others.
    fn gains_near(&mut self, first_order: &Gains, most: usize) -> Result<Gains, PredictError> {
        let candidates: Vec<Change> = WAYS.map(|way| self.nearest(way, first_order, most)).concat();
        let key = |change: &Change| (change.unit, change.to);
        let is_new = |change: &&Change| !self.known.single.contains_key(&key(change));
        let new: Vec<Change> = candidates.iter().filter(is_new).copied().collect();
        let changed = |change: &Change| self.problem.units().pattern(&self.changed(&[*change]));
        let patterns: Vec<Pattern> = new.iter().map(changed).collect();
        let scores = self.problem.scores_near(&self.state.pattern, &patterns)?;
        self.known.single.extend(new.iter().map(key).zip(scores));
        self.simulations += candidates.len();
        let mut gains = Gains::unknown(self.state.on.len(), self.problem.groups());
        for change in candidates {
            if let Some(score) = self.known.single[&key(&change)] {
                gains.set(change, score - self.state.score);
            }
        }
        Ok(gains)
    }

    /// The most profitable of such changes for their size.
    fn nearest(&self, way: Way, gains: &Gains, most: usize) -> Vec<Change> {
        let units = self.problem.units();
        let density = |change: &Change| gains.of(*change) / units.cells(change.unit).len() as f64;
        let mut list: Vec<Change> = (0..units.count())
            .filter_map(|unit| way(gains, unit, self.state.on[unit]))
            .collect();
        list.sort_by(|a, b| density(b).total_cmp(&density(a)).then(a.unit.cmp(&b.unit)));
        list.truncate(most);
        list
    }

    /// Simulates the pairs of units, one on and one off, that promise most, and takes the best where it is a gain.
    fn take_pair(&mut self, gains: &Gains, most: usize) -> Result<bool, PredictError> {
        let [removes, adds, _] = WAYS.map(|way| -> Vec<(f64, Vec<Change>)> {
            let known = self.state.on.iter().enumerate();
            let known = known.filter_map(|(unit, &now)| way(gains, unit, now));
            known.map(|change| (gains.of(change), vec![change])).collect()
        });
        let choices = self.pairs(&adds, &removes, most);
        self.take_promising(choices)
    }

    /// The same with squares of the least width, one turned on, one off, or both.
    fn take_squares(
        &mut self,
        gains: &Gains,
        feature: [usize; 2],
        (near, most): (usize, usize),
    ) -> Result<bool, PredictError> {
        let squares = Squares::new(self.problem.units(), feature);
        let of = |to: u8| squares.best(&self.state.on, gains, to, near);
        let none = || (0.0, Vec::new());
        let mut adds: Vec<_> = (1..=self.problem.groups() as u8).flat_map(of).collect();
        adds.sort_by(|a, b| b.0.total_cmp(&a.0));
        adds.truncate(near);
        adds.push(none());
        let mut removes = of(0);
        removes.push(none());
        let choices = self.pairs(&adds, &removes, most);
        self.take_promising(choices)
    }

    /// The pairs of units, or several of them, to turn on and off that promise most, as choices.
    fn pairs(&self, adds: &[(f64, Vec<Change>)], removes: &[(f64, Vec<Change>)], most: usize) -> Vec<Vec<u8>> {
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (a, add) in adds.iter().enumerate() {
            for (r, remove) in removes.iter().enumerate() {
                if !add.1.is_empty() || !remove.1.is_empty() {
                    pairs.push((add.0 + remove.0, a, r));
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let (low, high) = self.problem.range();
        let choices = pairs
            .into_iter()
            .map(|(_, a, r)| self.changed(&[&adds[a].1[..], &removes[r].1[..]].concat()));
        let fits = |on: &Vec<u8>| (low..=high).contains(&self.problem.units().area(on));
        choices.filter(fits).take(most).collect()
    }

    fn changed(&self, changes: &[Change]) -> Vec<u8> {
        Change::made(&self.state.on, changes)
    }

    /// Goes on from the best of some choices where it is a gain.
    fn take(&mut self, choices: Vec<Vec<u8>>) -> Result<bool, PredictError> {
        let new = self.new_ones(choices);
        let gained = self.go_on(new.clone())?;
        if !gained {
            self.known.refused.extend(new);
        }
        Ok(gained)
    }

    /// The same of choices that change few cells: all are ranked by what is found near the state, and only those are simulated from rest
    /// that may be a gain.
    fn take_promising(&mut self, choices: Vec<Vec<u8>>) -> Result<bool, PredictError> {
        let new = self.new_ones(choices);
        let least = self.state.score + GAIN - DOUBT;
        let promising = self.problem.promising(&self.state.pattern, new.clone(), least)?;
        for some in promising.chunks(TOGETHER) {
            if self.go_on(some.to_vec())? {
                return Ok(true);
            }
        }
        self.known.refused.extend(new);
        Ok(false)
    }

    /// Those of some choices that were not refused.
    fn new_ones(&mut self, choices: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
        self.simulations += choices.len();
        let is_new = |on: &Vec<u8>| !self.known.refused.contains(on);
        choices.into_iter().filter(is_new).collect()
    }

    /// Goes on from the best of some choices where it is a gain.
    fn go_on(&mut self, choices: Vec<Vec<u8>>) -> Result<bool, PredictError> {
        let Some(state) = self.problem.best_of(choices, self.state.score + GAIN)? else {
            return Ok(false);
        };
        self.state = state;
        self.known = Known::default();
        self.record_step();
        Ok(true)
    }

    fn record_step(&mut self) {
        let step = SearchStep {
            value_mm: self.problem.value_mm(&self.state.fields),
            score: self.state.score,
            area: self.state.pattern.area_fraction(),
            simulations: self.simulations,
        };
        (self.on_step)(&step);
        self.steps.push(step);
    }

    pub(super) fn finish(self) -> LocalOptimum {
        LocalOptimum {
            pattern: self.state.pattern,
            fields: self.state.fields,
            score: self.state.score,
            steps: self.steps,
            exhausted: self.exhausted,
        }
    }
}
