//! Gradient-based search: how good a pattern can be, and the finish of what the genetic algorithm found.
//!
//! The derivative of the merit with respect to the activity of every cell costs one more linear solve (the adjoint). A climb
//! follows it in two ways. First many units are turned over at once, those that gain most to first order, as many as a
//! simulation confirms: thresholding by sensitivity, as in the topology optimisation of binary designs (for instance Sivapuram
//! and Picelli, Finite Elements in Analysis and Design 139, 2018). Then units near the threshold are simulated one by one, since
//! a unit that is turned over wholly gains another amount than its derivative says, and are exchanged in pairs until no exchange
//! of any two of them gains.

mod exchange;
mod units;

use exchange::Exchange;
use units::Units;

use super::objective::Goal;
use crate::field::{Differentiable, Field, PredictError};
use crate::pattern::{CELLS, Pattern};

/// Gains below this are rounding of the solver: 0.25 nm on a membrane whose displacements are of the order of 1 mm.
const GAIN: f64 = 1e-7;

/// Most steps of either kind; a climb takes some tens.
const STEPS: usize = 200;

/// Units on either side of the threshold that are simulated one by one.
const NEAR: usize = 48;

/// Pairs of them that are simulated before it is said that none gains.
const PAIRS: usize = 64;

/// Where to climb.
pub struct Ground<'a> {
    physics: &'a dyn Differentiable,
    goal: &'a Goal,
    units: Units,
    /// Least and most active cells.
    range: (usize, usize),
}

/// One step of a climb.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Displacement along the wanted directions in mm.
    pub value_mm: f64,
    /// The merit, larger is better.
    pub merit: f64,
    /// Area fraction.
    pub area: f64,
    /// Patterns that were simulated up to here.
    pub simulations: usize,
}

/// Where a climb led.
#[derive(Clone, Debug)]
pub struct Climb {
    /// The best pattern.
    pub pattern: Pattern,
    /// Its field.
    pub field: Field,
    /// Its merit, larger is better.
    pub merit: f64,
    /// From the start to the best.
    pub steps: Vec<Step>,
    /// Whether it ended because no exchange gains; else it was stopped.
    pub exhausted: bool,
}

struct State {
    on: Vec<bool>,
    pattern: Pattern,
    field: Field,
    merit: f64,
}

impl<'a> Ground<'a> {
    /// The ground of a goal, on side × side units (20 or 50), at an area fraction from `area.0` to `area.1`.
    #[must_use]
    pub fn new(physics: &'a dyn Differentiable, goal: &'a Goal, side: usize, area: (f64, f64)) -> Self {
        let all = (CELLS * CELLS) as f64;
        // A fraction that is a whole number of cells but for rounding means that number.
        let least = (area.0 * all - 1e-9).ceil().clamp(0.0, all);
        let most = (area.1 * all + 1e-9).floor().clamp(0.0, all);
        Self {
            physics,
            goal,
            units: Units::new(side, &[true; CELLS * CELLS]),
            range: (least as usize, most as usize),
        }
    }

    /// Follows the gradient from a pattern until no number of turned-over units gains; `None` where the pattern, brought into
    /// the range of the area, has no field.
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

    fn begin<'g>(&'g self, start: &Pattern, on_step: &'g dyn Fn(&Step)) -> Result<Option<Path<'g>>, PredictError> {
        let on = self.units.of(start);
        let pattern = self.units.pattern(&on);
        let gains = match self.physics.gradient(&pattern, &|field| self.goal.slope(field))? {
            Some((_, gradient)) => self.gains(&on, &gradient),
            // Where nothing is known any unit is as good as another.
            None => vec![0.0; on.len()],
        };
        let mut fitted = Exchange::new(&self.units, &on, &gains, self.range);
        if !fitted.fit() {
            return Ok(None);
        }
        let state = self.best_of(vec![fitted.on])?;
        Ok(state.map(|state| {
            let mut path = Path {
                ground: self,
                on_step,
                state,
                steps: Vec::new(),
                simulations: 2,
                exhausted: false,
            };
            path.tell();
            path
        }))
    }

    /// What turning each unit over gains to first order.
    fn gains(&self, on: &[bool], gradient: &[f64]) -> Vec<f64> {
        let sums = self.units.sums(gradient).into_iter().zip(on);
        sums.map(|(sum, &on)| if on { -sum } else { sum }).collect()
    }

    /// The best of some choices of units, the first of equals; `None` where none has a field.
    fn best_of(&self, choices: Vec<Vec<bool>>) -> Result<Option<State>, PredictError> {
        let patterns: Vec<Pattern> = choices.iter().map(|on| self.units.pattern(on)).collect();
        let fields = self.physics.predict_some(&patterns)?;
        let mut best: Option<State> = None;
        for ((on, pattern), field) in choices.into_iter().zip(patterns).zip(fields) {
            let Some(field) = field else { continue };
            let merit = self.goal.merit(&field);
            if best.as_ref().is_none_or(|best| merit > best.merit) {
                best = Some(State {
                    on,
                    pattern,
                    field,
                    merit,
                });
            }
        }
        Ok(best)
    }
}

/// A climb under way.
struct Path<'g> {
    ground: &'g Ground<'g>,
    on_step: &'g dyn Fn(&Step),
    state: State,
    steps: Vec<Step>,
    simulations: usize,
    exhausted: bool,
}

impl Path<'_> {
    fn follow_gradient(&mut self) -> Result<(), PredictError> {
        let ground = self.ground;
        for _ in 0..STEPS {
            let slope = |field: &Field| ground.goal.slope(field);
            let Some((_, gradient)) = ground.physics.gradient(&self.state.pattern, &slope)? else {
                return Ok(());
            };
            self.simulations += 1;
            if !self.take_best(&ground.gains(&self.state.on, &gradient))? {
                return Ok(());
            }
        }
        Ok(())
    }

    fn exchange_pairs(&mut self) -> Result<(), PredictError> {
        let ground = self.ground;
        for _ in 0..STEPS {
            let slope = |field: &Field| ground.goal.slope(field);
            let Some((_, gradient)) = ground.physics.gradient(&self.state.pattern, &slope)? else {
                return Ok(());
            };
            self.simulations += 1;
            let gains = self.gains_near(&ground.gains(&self.state.on, &gradient))?;
            if !self.take_best(&gains)? && !self.take_pair(&gains)? {
                self.exhausted = true;
                return Ok(());
            }
        }
        Ok(())
    }

    /// Makes 1, 2, 4, … of the most profitable exchanges, and goes on from the best of these patterns where it is a gain.
    fn take_best(&mut self, gains: &[f64]) -> Result<bool, PredictError> {
        let mut exchange = Exchange::new(&self.ground.units, &self.state.on, gains, self.ground.range);
        let (mut choices, mut count, mut next) = (Vec::new(), 0, 1);
        let mut more = exchange.step();
        while more {
            count += 1;
            more = exchange.step();
            if count == next || !more {
                choices.push(exchange.on.clone());
                next *= 2;
            }
        }
        self.take(choices)
    }

    /// What the units near the threshold gain if they alone are turned over, by simulation; NaN for all others.
    fn gains_near(&mut self, first_order: &[f64]) -> Result<Vec<f64>, PredictError> {
        let ground = self.ground;
        let density = |unit: usize| first_order[unit] / ground.units.cells(unit).len() as f64;
        let near = |state: bool| {
            let mut list: Vec<usize> = (0..ground.units.count())
                .filter(|&unit| self.state.on[unit] == state)
                .collect();
            list.sort_by(|&a, &b| density(b).total_cmp(&density(a)).then(a.cmp(&b)));
            list.truncate(NEAR);
            list
        };
        let units: Vec<usize> = near(true).into_iter().chain(near(false)).collect();
        let turned = |&unit: &usize| {
            let mut on = self.state.on.clone();
            on[unit] = !on[unit];
            ground.units.pattern(&on)
        };
        let patterns: Vec<Pattern> = units.iter().map(turned).collect();
        let fields = ground.physics.predict_some(&patterns)?;
        self.simulations += patterns.len();
        let mut gains = vec![f64::NAN; ground.units.count()];
        for (unit, field) in units.into_iter().zip(fields) {
            if let Some(field) = field {
                gains[unit] = ground.goal.merit(&field) - self.state.merit;
            }
        }
        Ok(gains)
    }

    /// Simulates the pairs of units, one on and one off, that promise most, and takes the best where it is a gain.
    fn take_pair(&mut self, gains: &[f64]) -> Result<bool, PredictError> {
        let units = &self.ground.units;
        let on = &self.state.on;
        let known = |state: bool| -> Vec<usize> {
            let list = (0..units.count()).filter(|&unit| on[unit] == state && !gains[unit].is_nan());
            list.collect()
        };
        let area = units.area(&self.state.on);
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for &remove in &known(true) {
            for &add in &known(false) {
                let after = area + units.cells(add).len() - units.cells(remove).len();
                if (self.ground.range.0..=self.ground.range.1).contains(&after) {
                    pairs.push((gains[add] + gains[remove], add, remove));
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let turned = |&(_, add, remove): &(f64, usize, usize)| {
            let mut on = self.state.on.clone();
            (on[add], on[remove]) = (true, false);
            on
        };
        let choices = pairs.iter().take(PAIRS).map(turned).collect();
        self.take(choices)
    }

    /// Goes on from the best of some choices where it is a gain.
    fn take(&mut self, choices: Vec<Vec<bool>>) -> Result<bool, PredictError> {
        self.simulations += choices.len();
        match self.ground.best_of(choices)? {
            Some(state) if state.merit > self.state.merit + GAIN => {
                self.state = state;
                self.tell();
                Ok(true)
            }
            _ => Ok(false),
        }
    }

    fn tell(&mut self) {
        let step = Step {
            value_mm: self.ground.goal.value_mm(&self.state.field),
            merit: self.state.merit,
            area: self.state.pattern.area_fraction(),
            simulations: self.simulations,
        };
        (self.on_step)(&step);
        self.steps.push(step);
    }

    fn finish(self) -> Climb {
        Climb {
            pattern: self.state.pattern,
            field: self.state.field,
            merit: self.state.merit,
            steps: self.steps,
            exhausted: self.exhausted,
        }
    }
}

#[cfg(test)]
mod tests;
