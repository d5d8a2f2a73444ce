//! Where a climb may go: what a pattern is worth, and which patterns there are.

use super::exchange::Exchange;
use super::path::Path;
use super::units::Units;
use super::{Climb, Step};
use crate::base::Stream;
use crate::design::{Admission, Constraints, Goal};
use crate::field::{Differentiable, Field, PredictError};
use crate::pattern::{Bits, CELLS, Pattern};

/// How often the area before a repair is tried anew so that the area after it is as wanted.
const TRIALS: usize = 24;

/// Cells that a spread pattern differs by beyond the distance.
const SPARE: usize = 8;

/// What a climb is for, and what its patterns must keep to.
pub struct Terrain<'a> {
    physics: &'a dyn Differentiable,
    goal: &'a Goal,
    units: Units,
    /// Whether units are cells.
    of_cells: bool,
    /// Least and most active cells.
    range: (usize, usize),
    constraints: &'a Constraints,
    admission: Option<&'a dyn Admission>,
    /// Patterns to differ from, with their images.
    others: Vec<[Bits; 8]>,
    distance: f64,
}

/// A pattern that a climb is at.
pub(super) struct State {
    pub(super) on: Vec<bool>,
    pub(super) pattern: Pattern,
    pub(super) field: Field,
    pub(super) merit: f64,
}

impl<'a> Terrain<'a> {
    /// For a goal, on side × side units (20 or 50), at an area fraction from `area.0` to `area.1`.
    #[must_use]
    pub fn new(
        physics: &'a dyn Differentiable,
        goal: &'a Goal,
        side: usize,
        area: (f64, f64),
        constraints: &'a Constraints,
    ) -> Self {
        let all = (CELLS * CELLS) as f64;
        // A fraction that is a whole number of cells but for rounding means that number.
        let least = (area.0 * all - 1e-9).ceil().clamp(0.0, all);
        let most = (area.1 * all + 1e-9).floor().clamp(0.0, all);
        Self {
            physics,
            goal,
            units: Units::new(side, constraints.allowed()),
            of_cells: side == CELLS,
            range: (least as usize, most as usize),
            constraints,
            admission: None,
            others: Vec::new(),
            distance: 0.0,
        }
    }

    /// Where only admissible patterns count.
    #[must_use]
    pub fn admitting(self, admission: Option<&'a dyn Admission>) -> Self {
        Self { admission, ..self }
    }

    /// Where patterns differ from others by at least a share of the cells, whichever way they are turned.
    #[must_use]
    pub fn apart_from(self, others: &[Pattern], distance: f64) -> Self {
        let others = others.iter().map(|other| Bits::of(other).images()).collect();
        Self {
            others,
            distance,
            ..self
        }
    }

    /// Follows the gradient from a pattern until no number of turned-over units gains; `None` where the pattern, brought to
    /// where it may be, has no field, or cannot be brought there.
    ///
    /// # Errors
    /// When the physics cannot be evaluated.
    pub fn ascend(&self, start: &Pattern, on_step: &dyn Fn(&Step)) -> Result<Option<Climb>, PredictError> {
        let Some(mut path) = self.begin(start, on_step)? else {
            return Ok(None);
        };
        path.follow_gradient()?;
        Ok(Some(path.finish()))
    }

    /// The same, and then exchanges of pairs until none gains.
    ///
    /// # Errors
    /// When the physics cannot be evaluated.
    pub fn climb(&self, start: &Pattern, on_step: &dyn Fn(&Step)) -> Result<Option<Climb>, PredictError> {
        let Some(mut path) = self.begin(start, on_step)? else {
            return Ok(None);
        };
        path.follow_gradient()?;
        path.exchange_pairs()?;
        Ok(Some(path.finish()))
    }

    /// A pattern that differs from another by a little more than the wanted distance: of half of its units, drawn at random, those
    /// are turned over that cost least. Several of them share about half of what they turn over, so that they differ among
    /// themselves as much as from the first at half the cost of turning over others each. `None` where that leads nowhere.
    ///
    /// # Errors
    /// When the physics cannot be evaluated.
    pub fn spread(&self, from: &Pattern, stream: &mut Stream) -> Result<Option<Pattern>, PredictError> {
        let on = self.units.of(from);
        let Some(gradient) = self.gradient(from)? else {
            return Ok(None);
        };
        let drawn = |gain: f64| if stream.chance(0.5) { gain } else { f64::NAN };
        let gains: Vec<f64> = self.gains(&on, &gradient).into_iter().map(drawn).collect();
        let mut exchange = Exchange::new(&self.units, &on, &gains, self.range);
        let bits = Bits::of(from);
        while bits.differing(&Bits::of(&self.units.pattern(&exchange.on))) < self.cells_apart() + SPARE {
            if !exchange.step_anyway() {
                return Ok(None);
            }
        }
        Ok(Some(self.units.pattern(&exchange.on)))
    }

    fn begin<'g>(&'g self, start: &Pattern, on_step: &'g dyn Fn(&Step)) -> Result<Option<Path<'g>>, PredictError> {
        let on = self.units.of(start);
        let gains = match self.gradient(&self.units.pattern(&on))? {
            Some(gradient) => self.gains(&on, &gradient),
            // Where nothing is known any unit is as good as another.
            None => vec![0.0; on.len()],
        };
        let Some(on) = self.brought(&on, &gains) else {
            return Ok(None);
        };
        let state = self.best_of(vec![on], f64::NEG_INFINITY)?;
        Ok(state.map(|state| Path::new(self, on_step, state)))
    }

    /// The units turned over that bring a pattern to where it may be at the least loss: into the range of the area, away from
    /// others, and to where the constraints hold.
    fn brought(&self, on: &[bool], gains: &[f64]) -> Option<Vec<bool>> {
        let fitted = |range: (usize, usize)| {
            let mut fitted = Exchange::new(&self.units, on, gains, range);
            fitted.fit().then_some(fitted.on)
        };
        if self.constraints.is_free() {
            return self.moved_away(fitted(self.range)?, gains);
        }
        // Repairs change the area: what goes in is searched by bisection so that what comes out is as wanted.
        let (mut low, mut high) = (0, CELLS * CELLS);
        let mut aim = self.range;
        for _ in 0..TRIALS {
            let repaired = fitted(aim).and_then(|on| self.repaired(&on));
            let area = repaired.as_ref().map_or(0, |on| self.units.area(on));
            match repaired {
                Some(on) if (self.range.0..=self.range.1).contains(&area) => return self.moved_away(on, gains),
                _ if area < self.range.0 => low = aim.0,
                _ => high = aim.1,
            }
            let middle = usize::midpoint(low, high);
            if (middle, middle) == aim {
                break;
            }
            aim = (middle, middle);
        }
        None
    }

    /// Turned over where it costs least until it is as far from the others as it must be.
    fn moved_away(&self, mut on: Vec<bool>, gains: &[f64]) -> Option<Vec<bool>> {
        for _ in 0..TRIALS {
            let bits = Bits::of(&self.units.pattern(&on));
            if self.is_apart(&bits) {
                return Some(on);
            }
            // Only what agrees with the nearest image of each other pattern: so no step away from one is one towards another.
            let images: Vec<&Bits> = self
                .others
                .iter()
                .filter_map(|other| other.iter().min_by_key(|image| bits.differing(image)))
                .collect();
            let agrees = |unit: usize, image: &Bits| {
                let cells = self.units.cells(unit);
                let active = cells
                    .iter()
                    .filter(|&&cell| image.has(cell % CELLS, cell / CELLS))
                    .count();
                (2 * active > cells.len()) == on[unit]
            };
            let masked = |(unit, gain): (usize, &f64)| match images.iter().all(|image| agrees(unit, image)) {
                true => *gain,
                false => f64::NAN,
            };
            let masked: Vec<f64> = gains.iter().enumerate().map(masked).collect();
            let mut exchange = Exchange::new(&self.units, &on, &masked, self.range);
            let near = |on: &[bool]| {
                let bits = Bits::of(&self.units.pattern(on));
                images.iter().any(|image| bits.differing(image) < self.cells_apart())
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

    fn is_apart(&self, bits: &Bits) -> bool {
        self.others.iter().all(|other| bits.distance_to(other) >= self.distance)
    }

    fn cells_apart(&self) -> usize {
        (self.distance * (CELLS * CELLS) as f64 - 1e-9).ceil() as usize
    }

    /// The nearest pattern that keeps the constraints.
    fn repaired(&self, on: &[bool]) -> Option<Vec<bool>> {
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
    fn allowed(&self, on: Vec<bool>) -> Option<(Vec<bool>, Pattern)> {
        let on = match self.constraints.is_free() {
            true => on,
            false => self.repaired(&on)?,
        };
        let pattern = self.units.pattern(&on);
        let bits = Bits::of(&pattern);
        let fits = (self.range.0..=self.range.1).contains(&bits.count()) && self.is_apart(&bits);
        fits.then_some((on, pattern))
    }

    /// What turning each unit over gains to first order.
    pub(super) fn gains(&self, on: &[bool], gradient: &[f64]) -> Vec<f64> {
        let sums = self.units.sums(gradient).into_iter().zip(on);
        sums.map(|(sum, &on)| if on { -sum } else { sum }).collect()
    }

    pub(super) fn gradient(&self, pattern: &Pattern) -> Result<Option<Vec<f64>>, PredictError> {
        let found = self.physics.gradient(pattern, &|field| self.goal.slope(field))?;
        Ok(found.map(|(_, gradient)| gradient))
    }

    /// The merit of each pattern, where it has a field.
    pub(super) fn merits(&self, patterns: &[Pattern]) -> Result<Vec<Option<f64>>, PredictError> {
        let fields = self.physics.predict_some(patterns)?.into_iter();
        Ok(fields.map(|field| field.map(|field| self.goal.merit(&field))).collect())
    }

    pub(super) fn value_mm(&self, field: &Field) -> f64 {
        self.goal.value_mm(field)
    }

    pub(super) fn units(&self) -> &Units {
        &self.units
    }

    pub(super) fn range(&self) -> (usize, usize) {
        self.range
    }

    /// Side in cells of the smallest square that may be turned over alone.
    pub(super) fn feature(&self) -> usize {
        if self.of_cells {
            self.constraints.feature_cells()
        } else {
            1
        }
    }

    /// The best of some choices of units that may be and whose merit is above `least`, the first of equals.
    pub(super) fn best_of(&self, choices: Vec<Vec<bool>>, least: f64) -> Result<Option<State>, PredictError> {
        let (chosen, patterns): (Vec<Vec<bool>>, Vec<Pattern>) =
            choices.into_iter().filter_map(|on| self.allowed(on)).unzip();
        let fields = self.physics.predict_some(&patterns)?;
        let mut states: Vec<State> = Vec::new();
        for ((on, pattern), field) in chosen.into_iter().zip(patterns).zip(fields) {
            let Some(field) = field else { continue };
            let merit = self.goal.merit(&field);
            if merit > least {
                states.push(State {
                    on,
                    pattern,
                    field,
                    merit,
                });
            }
        }
        states.sort_by(|a, b| b.merit.total_cmp(&a.merit));
        for state in states {
            if self.admits(&state.pattern)? {
                return Ok(Some(state));
            }
        }
        Ok(None)
    }

    fn admits(&self, pattern: &Pattern) -> Result<bool, PredictError> {
        let Some(admission) = self.admission else {
            return Ok(true);
        };
        let verdicts = admission.admissible(std::slice::from_ref(pattern))?;
        Ok(verdicts.first().copied().unwrap_or(false))
    }
}
