//! The steps of a local search.

use std::collections::{HashMap, HashSet};

use super::exchange::Exchange;
use super::gains::{Change, Gains};
use super::problem::{SearchProblem, SearchState};
use super::squares::Squares;
use super::{LocalOptimum, SearchStep, StartError};
use deaflow_field::{Field, PredictError};
use deaflow_pattern::Pattern;

/// Smaller gains are rounding errors of the solver: 0.25 nm for displacements of about 1 mm.
const MIN_GAIN: f64 = 1e-7;

/// Ten times the error of approximate scores: patterns with an approximate gain of at least `MIN_GAIN` − `SCORE_ERROR`
/// are simulated.
const SCORE_ERROR: f64 = 1e-6;

/// Number of the most promising patterns that are simulated at once.
const BATCH: usize = 8;

/// Maximum number of steps of either kind; searches need some tens.
const MAX_STEPS: usize = 200;

/// Sizes of the neighbourhoods: units of each kind that are simulated one by one, and pairs of them that are simulated
/// together. The second neighbourhood is used if the first has no gain.
const NEIGHBOURHOODS: [(usize, usize); 2] = [(48, 64), (160, 256)];

/// The best change of one kind for a unit, given the gains and the group of the unit.
type ChangeKind = fn(&Gains, usize, u8) -> Option<Change>;

/// Turn a unit off, turn it on, and move it to another group.
const CHANGE_KINDS: [ChangeKind; 3] = [
    |gains, unit, now| gains.removal(unit).filter(|_| now != 0),
    |gains, unit, now| gains.best_electrode(unit, now).filter(|_| now == 0),
    |gains, unit, now| gains.best_electrode(unit, now).filter(|_| now != 0),
];

/// A running local search.
struct LocalSearch<'g> {
    problem: &'g SearchProblem<'g>,
    on_step: &'g dyn Fn(&SearchStep),
    state: SearchState,
    cache: StateCache,
    steps: Vec<SearchStep>,
    simulations: usize,
    exhausted: bool,
}

/// Results for the present state, so that no pattern is simulated twice.
#[derive(Default)]
struct StateCache {
    /// First-order gains once computed; `Some(None)` if there is no gradient.
    first_order: Option<Option<Gains>>,
    /// The score after changing one unit, by unit and new group; `None` if there is no field.
    single: HashMap<(usize, u8), Option<f64>>,
    /// Choices of units without a gain.
    rejected: HashSet<Vec<u8>>,
}

impl SearchProblem<'_> {
    /// Makes a pattern feasible and follows the gradient until no change of units gains.
    ///
    /// # Errors
    /// If the model cannot be evaluated.
    pub fn follow_gradient(
        &self,
        start: &Pattern,
        on_step: &dyn Fn(&SearchStep),
    ) -> Result<Result<LocalOptimum, StartError>, PredictError> {
        self.search(start, on_step, LocalSearch::follow_gradient)
    }

    /// Follows the gradient, then exchanges pairs of units until no exchange gains.
    ///
    /// # Errors
    /// If the model cannot be evaluated.
    pub fn refine(
        &self,
        start: &Pattern,
        on_step: &dyn Fn(&SearchStep),
    ) -> Result<Result<LocalOptimum, StartError>, PredictError> {
        self.search(start, on_step, |search| {
            search.follow_gradient()?;
            search.exchange_pairs()
        })
    }

    fn search<'g>(
        &'g self,
        start: &Pattern,
        on_step: &'g dyn Fn(&SearchStep),
        run: impl FnOnce(&mut LocalSearch<'g>) -> Result<(), PredictError>,
    ) -> Result<Result<LocalOptimum, StartError>, PredictError> {
        match self.begin(start, on_step)? {
            Ok(mut search) => {
                run(&mut search)?;
                Ok(Ok(search.finish()))
            }
            Err(error) => Ok(Err(error)),
        }
    }

    /// Makes the start feasible and evaluates it.
    fn begin<'g>(
        &'g self,
        start: &Pattern,
        on_step: &'g dyn Fn(&SearchStep),
    ) -> Result<Result<LocalSearch<'g>, StartError>, PredictError> {
        let given = self.units.of(&self.best_grouped(start)?);
        let gradient = self.gradient(&self.units.pattern(&given))?;
        let first_order = gradient.map(|gradient| self.first_order_gains(&given, &gradient));
        // Without a gradient all units are equal.
        let uniform = || Gains::uniform(&given, self.groups(), 0.0);
        let Some(on) = self.make_feasible(&given, &first_order.clone().unwrap_or_else(uniform)) else {
            return Ok(Err(StartError::NoPattern));
        };
        let state = self.best_of(vec![on], f64::NEG_INFINITY)?.ok_or(StartError::NoField);
        Ok(state.map(|state| {
            let known = first_order.filter(|_| state.on == given);
            LocalSearch::new(self, on_step, state, known)
        }))
    }

    /// Exchanges two groups as long as this gains. A search by single units cannot do this if there is a gap between
    /// groups, or if all electrodes are in a group without effect.
    fn best_grouped(&self, start: &Pattern) -> Result<Pattern, PredictError> {
        let groups = self.groups() as u8;
        let mut best = start.clone();
        for _ in 1..groups {
            let pairs = (1..groups).flat_map(|a| (a + 1..=groups).map(move |b| [a, b]));
            let exchanged = pairs.map(|pair| best.with_groups_exchanged(pair));
            let patterns: Vec<Pattern> = std::iter::once(best.clone()).chain(exchanged).collect();
            let scores = self.scores(&patterns)?;
            // For equal scores the pattern itself is kept.
            let known = scores.iter().zip(0..).filter_map(|(score, at)| Some(((*score)?, at)));
            match known.reduce(|best, one| if one.0 > best.0 { one } else { best }) {
                Some((_, at)) if at > 0 => best = patterns[at].clone(),
                _ => break,
            }
        }
        Ok(best)
    }
}

impl<'g> LocalSearch<'g> {
    /// A search from a start that was simulated twice: as given, and made feasible. `first_order` are its gains if
    /// known.
    fn new(
        problem: &'g SearchProblem<'g>,
        on_step: &'g dyn Fn(&SearchStep),
        state: SearchState,
        first_order: Option<Gains>,
    ) -> Self {
        let mut search = Self {
            problem,
            on_step,
            state,
            cache: StateCache {
                first_order: first_order.map(Some),
                ..StateCache::default()
            },
            steps: Vec::new(),
            simulations: 2,
            exhausted: false,
        };
        search.record_step();
        search
    }

    fn follow_gradient(&mut self) -> Result<(), PredictError> {
        for _ in 0..MAX_STEPS {
            match self.first_order()? {
                Some(gains) if self.take_best(&gains)? => {}
                _ => return Ok(()),
            }
        }
        Ok(())
    }

    fn exchange_pairs(&mut self) -> Result<(), PredictError> {
        for _ in 0..MAX_STEPS {
            let Some(first_order) = self.first_order()? else {
                return Ok(());
            };
            let mut gained = false;
            for sizes in NEIGHBOURHOODS {
                gained = gained || self.exchange(&first_order, sizes)?;
            }
            if !gained {
                self.exhausted = true;
                return Ok(());
            }
        }
        Ok(())
    }

    /// Exchanges units or squares in a neighbourhood. Returns whether there was a gain.
    fn exchange(&mut self, first_order: &Gains, (near, pairs): (usize, usize)) -> Result<bool, PredictError> {
        let feature = self.problem.feature();
        if feature != [1; 2] {
            return self.take_squares(first_order, feature, (near, pairs));
        }
        let gains = self.gains_near(first_order, near)?;
        Ok(self.take_best(&gains)? || self.take_pair(&gains, pairs)?)
    }

    /// The first-order gains of the present state.
    fn first_order(&mut self) -> Result<Option<Gains>, PredictError> {
        self.simulations += 1;
        if let Some(gains) = &self.cache.first_order {
            return Ok(gains.clone());
        }
        let gradient = self.problem.gradient(&self.state.pattern)?;
        let gains = gradient.map(|gradient| self.problem.first_order_gains(&self.state.on, &gradient));
        self.cache.first_order = Some(gains.clone());
        Ok(gains)
    }

    /// Makes 1, 2, 4, … of the best exchanges, and accepts the best of these patterns if it gains.
    fn take_best(&mut self, gains: &Gains) -> Result<bool, PredictError> {
        let problem = self.problem;
        let mut exchange = Exchange::new(&problem.units, &self.state.on, gains, problem.range);
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

    /// The simulated gains of changing single units, for the `count` best first-order gains of each kind.
    fn gains_near(&mut self, first_order: &Gains, count: usize) -> Result<Gains, PredictError> {
        let candidates: Vec<Change> = CHANGE_KINDS.map(|kind| self.nearest(kind, first_order, count)).concat();
        let key = |change: &Change| (change.unit, change.to);
        let is_new = |change: &&Change| !self.cache.single.contains_key(&key(change));
        let new: Vec<Change> = candidates.iter().filter(is_new).copied().collect();
        let changed = |change: &Change| self.problem.units.pattern(&self.changed(&[*change]));
        let patterns: Vec<Pattern> = new.iter().map(changed).collect();
        let scores = self.problem.scores_near(&self.state.pattern, &patterns)?;
        self.cache.single.extend(new.iter().map(key).zip(scores));
        self.simulations += candidates.len();
        let mut gains = Gains::unknown(self.state.on.len(), self.problem.groups());
        for change in candidates {
            if let Some(score) = self.cache.single[&key(&change)] {
                gains.set(change, score - self.state.score);
            }
        }
        Ok(gains)
    }

    /// The changes of one kind with the largest gains per cell.
    fn nearest(&self, kind: ChangeKind, gains: &Gains, count: usize) -> Vec<Change> {
        let units = &self.problem.units;
        let density = |change: &Change| gains.of(*change) / units.cells(change.unit).len() as f64;
        let mut list: Vec<Change> = (0..units.count())
            .filter_map(|unit| kind(gains, unit, self.state.on[unit]))
            .collect();
        list.sort_by(|a, b| density(b).total_cmp(&density(a)).then(a.unit.cmp(&b.unit)));
        list.truncate(count);
        list
    }

    /// Simulates the most promising pairs of units, one turned on and one off, and accepts the best if it gains.
    fn take_pair(&mut self, gains: &Gains, most: usize) -> Result<bool, PredictError> {
        let [removes, adds, _] = CHANGE_KINDS.map(|kind| -> Vec<(f64, Vec<Change>)> {
            let changes = self.state.on.iter().enumerate();
            let changes = changes.filter_map(|(unit, &now)| kind(gains, unit, now));
            changes.map(|change| (gains.of(change), vec![change])).collect()
        });
        let choices = self.pairs(&adds, &removes, most);
        self.take_promising(choices)
    }

    /// The same with squares of the minimum width: one turned on, one off, or both.
    fn take_squares(
        &mut self,
        gains: &Gains,
        feature: [usize; 2],
        (near, most): (usize, usize),
    ) -> Result<bool, PredictError> {
        let squares = Squares::new(&self.problem.units, feature);
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

    /// The choices with the best sums of gains of one addition and one removal.
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
        let (low, high) = self.problem.range;
        let choices = pairs
            .into_iter()
            .map(|(_, a, r)| self.changed(&[&adds[a].1[..], &removes[r].1[..]].concat()));
        let fits = |on: &Vec<u8>| (low..=high).contains(&self.problem.units.area(on));
        choices.filter(fits).take(most).collect()
    }

    fn changed(&self, changes: &[Change]) -> Vec<u8> {
        Change::apply(&self.state.on, changes)
    }

    /// Accepts the best choice if it gains.
    fn take(&mut self, choices: Vec<Vec<u8>>) -> Result<bool, PredictError> {
        let new = self.without_rejected(choices);
        let gained = self.accept_best(new.clone())?;
        if !gained {
            self.cache.rejected.extend(new);
        }
        Ok(gained)
    }

    /// The same for choices that change few cells: all are ranked by approximate scores, and only those that may gain
    /// are simulated from rest.
    fn take_promising(&mut self, choices: Vec<Vec<u8>>) -> Result<bool, PredictError> {
        let new = self.without_rejected(choices);
        let least = self.state.score + MIN_GAIN - SCORE_ERROR;
        let promising = self.problem.promising(&self.state.pattern, new.clone(), least)?;
        for batch in promising.chunks(BATCH) {
            if self.accept_best(batch.to_vec())? {
                return Ok(true);
            }
        }
        self.cache.rejected.extend(new);
        Ok(false)
    }

    /// The choices that were not rejected before.
    fn without_rejected(&mut self, choices: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
        self.simulations += choices.len();
        let is_new = |on: &Vec<u8>| !self.cache.rejected.contains(on);
        choices.into_iter().filter(is_new).collect()
    }

    /// Accepts the best choice if it gains.
    fn accept_best(&mut self, choices: Vec<Vec<u8>>) -> Result<bool, PredictError> {
        let Some(state) = self.problem.best_of(choices, self.state.score + MIN_GAIN)? else {
            return Ok(false);
        };
        self.state = state;
        self.cache = StateCache::default();
        self.record_step();
        Ok(true)
    }

    fn record_step(&mut self) {
        let step = SearchStep {
            value_mm: self.problem.value_mm(&self.state.fields),
            score: self.state.score,
            area: self.problem.constraints.area_fraction(&self.state.pattern),
            charge: self.state.fields.iter().map(Field::charge).sum(),
            simulations: self.simulations,
        };
        (self.on_step)(&step);
        self.steps.push(step);
    }

    fn finish(self) -> LocalOptimum {
        LocalOptimum {
            pattern: self.state.pattern,
            fields: self.state.fields,
            score: self.state.score,
            steps: self.steps,
            exhausted: self.exhausted,
        }
    }
}
