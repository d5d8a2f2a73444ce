//! What a local search optimises: the score of a pattern, and which patterns are feasible.

use super::exchange::Exchange;
use super::gains::{Change, Gains};
use super::search::LocalSearch;
use super::squares::Squares;
use super::units::Units;
use super::{LocalOptimum, SearchStep};
use crate::{Constraints, Goal};
use deaflow_base::Stream;
use deaflow_field::{Differentiable, Feasibility, Field, PredictError, StateFields};
use deaflow_pattern::{Layers, Pattern};

/// How often the area before a repair is tried anew so that the area after it is as wanted.
const TRIALS: usize = 24;

/// How many squares are tried before it is said that none brings the area nearer to its range.
const SQUARES: usize = 256;

/// Cells by which a perturbed pattern differs beyond the distance.
const SPARE: usize = 8;

/// The score to be raised, and what patterns must keep to.
pub struct SearchProblem<'a> {
    physics: &'a dyn Differentiable<StateFields>,
    goal: &'a Goal,
    units: Units,
    /// Whether units are cells.
    of_cells: bool,
    /// Least and most active cells.
    range: (usize, usize),
    constraints: &'a Constraints,
    feasibility: Option<&'a dyn Feasibility>,
    /// Patterns to differ from, with their images.
    others: Vec<Vec<Layers>>,
    distance: f64,
}

/// Why a search cannot start from a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsuited {
    /// No pattern is found near it that can be made.
    #[error("cannot be brought to the wanted area and the constraints")]
    Shape,
    /// There is one, and it cannot be run.
    #[error("has no stable field, or not the margins, once it is brought to the wanted area and the constraints")]
    Field,
}

/// What came of a pattern, where a search could start from it.
type Started<T> = Result<T, Unsuited>;

/// A pattern that a search has reached.
pub(super) struct State {
    /// The group of each unit, 0 where it is off.
    pub(super) on: Vec<u8>,
    pub(super) pattern: Pattern,
    pub(super) fields: StateFields,
    pub(super) score: f64,
}

impl<'a> SearchProblem<'a> {
    /// For a goal, on columns and rows of units or on cells, at an area fraction from `area.0` to `area.1`.
    #[must_use]
    pub fn new(
        physics: &'a dyn Differentiable<StateFields>,
        goal: &'a Goal,
        units: [usize; 2],
        area: (f64, f64),
        constraints: &'a Constraints,
    ) -> Self {
        let raster = constraints.membrane().raster;
        let all = raster.cells() as f64;
        // A fraction that is a whole number of cells but for rounding means that number.
        let least = (area.0 * all - 1e-9).ceil().clamp(0.0, all);
        let most = (area.1 * all + 1e-9).floor().clamp(0.0, all);
        Self {
            physics,
            goal,
            units: Units::new(units, raster, constraints.allowed()),
            of_cells: units == raster.sides(),
            range: (least as usize, most as usize),
            constraints,
            feasibility: None,
            others: Vec::new(),
            distance: 0.0,
        }
    }

    /// Where only feasible patterns count.
    #[must_use]
    pub fn with_feasibility(self, feasibility: Option<&'a dyn Feasibility>) -> Self {
        Self { feasibility, ..self }
    }

    /// The same problem, in which patterns differ from others by at least a share of the cells, whichever way they are turned.
    #[must_use]
    pub fn distant_from(self, others: &[Pattern], distance: f64) -> Self {
        let others = others
            .iter()
            .map(|other| self.constraints.equivalence().images(&self.constraints.layers(other)))
            .collect();
        Self {
            others,
            distance,
            ..self
        }
    }

    /// Follows the gradient from a pattern until changing any number of units gains nothing, where it can be made feasible and has a field
    /// then.
    ///
    /// # Errors
    /// When the physics cannot be evaluated.
    pub fn follow_gradient(
        &self,
        start: &Pattern,
        on_step: &dyn Fn(&SearchStep),
    ) -> Result<Started<LocalOptimum>, PredictError> {
        self.search(start, on_step, LocalSearch::follow_gradient)
    }

    /// The same, and then exchanges of pairs until none gains.
    ///
    /// # Errors
    /// When the physics cannot be evaluated.
    pub fn refine(
        &self,
        start: &Pattern,
        on_step: &dyn Fn(&SearchStep),
    ) -> Result<Started<LocalOptimum>, PredictError> {
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
    ) -> Result<Started<LocalOptimum>, PredictError> {
        match self.begin(start, on_step)? {
            Ok(mut search) => {
                run(&mut search)?;
                Ok(Ok(search.finish()))
            }
            Err(unsuited) => Ok(Err(unsuited)),
        }
    }

    /// A pattern that differs from another by a little more than the wanted distance: of half of its units, drawn at random,
    /// those are changed that cost least. Several of them share about half of the changed units, so that they differ among
    /// themselves as much as from the first, at half the cost of changing others each. `None` where there are too few units.
    ///
    /// # Errors
    /// When the physics cannot be evaluated.
    pub fn perturb(&self, from: &Pattern, stream: &mut Stream) -> Result<Option<Pattern>, PredictError> {
        let on = self.units.of(from);
        let Some(gradient) = self.gradient(from)? else {
            return Ok(None);
        };
        let gains = self.gains(&on, &gradient).masked(|_| stream.chance(0.5));
        let mut exchange = Exchange::new(&self.units, &on, &gains, self.range);
        let layers = self.alike(from);
        while layers.differing(&self.layers(&exchange.on)) < self.least_difference() + SPARE {
            if !exchange.step_anyway() {
                return Ok(None);
            }
        }
        Ok(Some(self.units.pattern(&exchange.on)))
    }

    fn begin<'g>(
        &'g self,
        start: &Pattern,
        on_step: &'g dyn Fn(&SearchStep),
    ) -> Result<Started<LocalSearch<'g>>, PredictError> {
        let given = self.units.of(&self.best_grouped(start)?);
        let gradient = self.gradient(&self.units.pattern(&given))?;
        let first_order = gradient.map(|gradient| self.gains(&given, &gradient));
        // Where nothing is known any unit is as good as another.
        let unknown = || Gains::uniform(&given, self.groups(), 0.0);
        let Some(on) = self.make_feasible(&given, &first_order.clone().unwrap_or_else(unknown)) else {
            return Ok(Err(Unsuited::Shape));
        };
        let state = self.best_of(vec![on], f64::NEG_INFINITY)?.ok_or(Unsuited::Field);
        Ok(state.map(|state| {
            let known = first_order.filter(|_| state.on == given);
            LocalSearch::new(self, on_step, state, known)
        }))
    }

    /// The pattern with its electrodes in other groups where that is better: two groups are exchanged as long as it gains. Unit by unit a
    /// search does not get there where groups keep a distance, or where all electrodes are in a group that does nothing.
    fn best_grouped(&self, start: &Pattern) -> Result<Pattern, PredictError> {
        let groups = self.groups() as u8;
        let mut best = start.clone();
        for _ in 1..groups {
            let pairs = (1..groups).flat_map(|a| (a + 1..=groups).map(move |b| [a, b]));
            let exchanged = pairs.map(|pair| best.with_groups_exchanged(pair));
            let patterns: Vec<Pattern> = std::iter::once(best.clone()).chain(exchanged).collect();
            let scores = self.scores(&patterns)?;
            // The first of equals is the pattern itself.
            let known = scores.iter().zip(0..).filter_map(|(score, at)| Some(((*score)?, at)));
            match known.reduce(|best, one| if one.0 > best.0 { one } else { best }) {
                Some((_, at)) if at > 0 => best = patterns[at].clone(),
                _ => break,
            }
        }
        Ok(best)
    }

    /// Changes the units that make a pattern feasible at the least loss: its area in range, the constraints kept, and far enough
    /// from the others.
    fn make_feasible(&self, on: &[u8], gains: &Gains) -> Option<Vec<u8>> {
        let fitted = |range: (usize, usize)| {
            let mut fitted = Exchange::new(&self.units, on, gains, range);
            fitted.fit().then_some(fitted.on)
        };
        if self.constraints.is_free() {
            return self.enforce_distance(fitted(self.range)?, gains);
        }
        // Repairs change the area: what goes in is searched by bisection so that what comes out is as wanted.
        let (mut low, mut high) = (0, self.units.size());
        let mut aim = self.range;
        let mut nearest: Option<(usize, Vec<u8>)> = None;
        for _ in 0..TRIALS {
            let repaired = fitted(aim).and_then(|on| self.repaired(&on));
            let area = repaired.as_ref().map_or(0, |on| self.units.area(on));
            if area < self.range.0 {
                low = aim.0;
            } else {
                high = aim.1;
            }
            if let Some(on) = repaired {
                let off = self.cells_off(area);
                if nearest.as_ref().is_none_or(|(least, _)| off < *least) {
                    nearest = Some((off, on));
                }
                if off == 0 {
                    break;
                }
            }
            let middle = usize::midpoint(low, high);
            if (middle, middle) == aim {
                break;
            }
            aim = (middle, middle);
        }
        let near = self.resized(nearest?.1, on, gains)?;
        self.enforce_distance(near, gains)
    }

    /// By how many cells an area is out of its range.
    fn cells_off(&self, area: usize) -> usize {
        self.range.0.saturating_sub(area) + area.saturating_sub(self.range.1)
    }

    /// Adds or takes away squares of the least width, where it gains most or costs least, until the area is in its range; `None` where no
    /// square brings it nearer. The gains are those of changing the units of `before`.
    fn resized(&self, mut on: Vec<u8>, before: &[u8], gains: &Gains) -> Option<Vec<u8>> {
        let squares = Squares::new(&self.units, self.feature());
        loop {
            let area = self.units.area(&on);
            let off = self.cells_off(area);
            if off == 0 {
                return Some(on);
            }
            let gains = gains.after(before, &on);
            let groups = if area < self.range.0 {
                1..=self.groups() as u8
            } else {
                0..=0
            };
            let mut choices: Vec<(f64, Vec<Change>)> = groups
                .flat_map(|to| squares.best(&on, &gains, to, usize::MAX))
                .collect();
            let density = |choice: &(f64, Vec<Change>)| choice.0 / choice.1.len() as f64;
            choices.sort_by(|a, b| density(b).total_cmp(&density(a)));
            let changed = |(_, changes): &(f64, Vec<Change>)| {
                let on = self.repaired(&Change::made(&on, changes))?;
                (self.cells_off(self.units.area(&on)) < off).then_some(on)
            };
            on = choices.iter().take(SQUARES).find_map(changed)?;
        }
    }

    /// Changes units where it costs least until the pattern is as far from the others as it must be.
    fn enforce_distance(&self, mut on: Vec<u8>, gains: &Gains) -> Option<Vec<u8>> {
        for _ in 0..TRIALS {
            let layers = self.layers(&on);
            if self.is_distant(&layers) {
                return Some(on);
            }
            // Only units that agree with the nearest image of each other pattern, so that no step away from one is a step
            // towards another.
            let images: Vec<&Layers> = self
                .others
                .iter()
                .filter_map(|other| other.iter().min_by_key(|image| layers.differing(image)))
                .collect();
            let columns = self.units.raster().columns();
            let first = |group: u8| self.constraints.equivalence().first(group);
            let agrees = |unit: usize, image: &Layers| {
                let group = |cell: usize| image.group(cell % columns, cell / columns);
                self.units.group_of(unit, group) == first(on[unit])
            };
            let masked = gains.masked(|unit| images.iter().all(|image| agrees(unit, image)));
            let mut exchange = Exchange::new(&self.units, &on, &masked, self.range);
            let near = |on: &[u8]| {
                let layers = self.layers(on);
                images
                    .iter()
                    .any(|image| layers.differing(image) < self.least_difference())
            };
            while near(&exchange.on) {
                if !exchange.step_anyway() {
                    return None;
                }
            }
            on = match self.constraints.is_free() {
                true => exchange.on,
                false => self.repaired(&exchange.on)?,
            };
        }
        None
    }

    /// A choice of units as the electrodes of each group, those with equal voltages in one.
    fn layers(&self, on: &[u8]) -> Layers {
        self.alike(&self.units.pattern(on))
    }

    fn alike(&self, pattern: &Pattern) -> Layers {
        let layers = self.constraints.layers(pattern);
        self.constraints.equivalence().merged(&layers).into_owned()
    }

    fn is_distant(&self, layers: &Layers) -> bool {
        self.others
            .iter()
            .all(|other| layers.distance_to(other) >= self.distance)
    }

    fn least_difference(&self) -> usize {
        (self.distance * self.constraints.membrane().raster.cells() as f64 - 1e-9).ceil() as usize
    }

    /// The nearest pattern that keeps the constraints.
    fn repaired(&self, on: &[u8]) -> Option<Vec<u8>> {
        let pattern = self.units.pattern(on);
        if self.constraints.hold(&pattern) {
            return Some(on.to_vec());
        }
        let repaired = self.units.of(&self.constraints.repaired(&pattern)?);
        // Coarser units may not have what was repaired.
        let holds = self.of_cells || self.constraints.hold(&self.units.pattern(&repaired));
        holds.then_some(repaired)
    }

    /// A choice of units as a pattern may have it: repaired where it must be; `None` where it may not be.
    fn allowed(&self, on: Vec<u8>) -> Option<(Vec<u8>, Pattern)> {
        let on = match self.constraints.is_free() {
            true => on,
            false => self.repaired(&on)?,
        };
        let pattern = self.units.pattern(&on);
        let layers = self.alike(&pattern);
        let fits = (self.range.0..=self.range.1).contains(&layers.count()) && self.is_distant(&layers);
        fits.then_some((on, pattern))
    }

    /// Those of some choices that a pattern may have, with their patterns.
    fn allowed_of(&self, choices: Vec<Vec<u8>>) -> (Vec<Vec<u8>>, Vec<Pattern>) {
        choices.into_iter().filter_map(|on| self.allowed(on)).unzip()
    }

    /// What changing each unit gains to first order.
    pub(super) fn gains(&self, on: &[u8], gradient: &[f64]) -> Gains {
        let cells = self.units.raster().cells();
        let worth: Vec<Vec<f64>> = gradient
            .chunks_exact(cells)
            .map(|of_group| self.units.sums(of_group))
            .collect();
        Gains::first_order(on, &worth)
    }

    /// How many groups of electrodes there are.
    pub(super) fn groups(&self) -> usize {
        self.constraints.groups()
    }

    pub(super) fn gradient(&self, pattern: &Pattern) -> Result<Option<Vec<f64>>, PredictError> {
        let found = self.physics.gradient(pattern, &|fields| self.goal.slope(fields))?;
        Ok(found.map(|(_, gradient)| gradient))
    }

    /// The score of each pattern, where it has a field.
    pub(super) fn scores(&self, patterns: &[Pattern]) -> Result<Vec<Option<f64>>, PredictError> {
        Ok(self.scored(self.physics.predict_some(patterns)?))
    }

    fn scored(&self, fields: Vec<Option<StateFields>>) -> Vec<Option<f64>> {
        let score = |fields: Option<StateFields>| fields.map(|fields| self.goal.score(&fields));
        fields.into_iter().map(score).collect()
    }

    /// The score of each pattern where it has a field, good enough to rank patterns that differ little from one.
    pub(super) fn scores_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<f64>>, PredictError> {
        Ok(self.scored(self.physics.predict_near(base, patterns)?))
    }

    /// Those of some choices of units that may be and whose score is above `least` as far as [`SearchProblem::scores_near`] knows, the best
    /// first.
    pub(super) fn promising(
        &self,
        base: &Pattern,
        choices: Vec<Vec<u8>>,
        least: f64,
    ) -> Result<Vec<Vec<u8>>, PredictError> {
        let (chosen, patterns) = self.allowed_of(choices);
        let scores = self.scores_near(base, &patterns)?;
        let known = chosen.into_iter().zip(scores);
        let mut known: Vec<(Vec<u8>, f64)> = known.filter_map(|(on, score)| Some((on, score?))).collect();
        known.retain(|(_, score)| *score > least);
        known.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok(known.into_iter().map(|(on, _)| on).collect())
    }

    pub(super) fn value_mm(&self, fields: &[Field]) -> f64 {
        self.goal.value_mm(fields)
    }

    pub(super) fn units(&self) -> &Units {
        &self.units
    }

    pub(super) fn range(&self) -> (usize, usize) {
        self.range
    }

    /// Columns and rows of the smallest square that may be changed alone.
    pub(super) fn feature(&self) -> [usize; 2] {
        if self.of_cells {
            self.constraints.feature_cells()
        } else {
            [1; 2]
        }
    }

    /// The best of some choices of units that may be and whose score is above `least`, the first of equals.
    pub(super) fn best_of(&self, choices: Vec<Vec<u8>>, least: f64) -> Result<Option<State>, PredictError> {
        let (chosen, patterns) = self.allowed_of(choices);
        let fields = self.physics.predict_some(&patterns)?;
        let mut states: Vec<State> = Vec::new();
        for ((on, pattern), fields) in chosen.into_iter().zip(patterns).zip(fields) {
            let Some(fields) = fields else { continue };
            let score = self.goal.score(&fields);
            if score > least {
                states.push(State {
                    on,
                    pattern,
                    fields,
                    score,
                });
            }
        }
        states.sort_by(|a, b| b.score.total_cmp(&a.score));
        for state in states {
            if self.is_feasible(&state.pattern)? {
                return Ok(Some(state));
            }
        }
        Ok(None)
    }

    fn is_feasible(&self, pattern: &Pattern) -> Result<bool, PredictError> {
        let Some(feasibility) = self.feasibility else {
            return Ok(true);
        };
        let verdicts = feasibility.feasible(std::slice::from_ref(pattern))?;
        Ok(verdicts.first().copied().unwrap_or(false))
    }
}
