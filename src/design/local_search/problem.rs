//! The problem of a local search: the score of patterns, and which patterns are allowed.

use super::gains::Gains;
use super::units::Units;
use crate::constraint::Constraints;
use crate::objective::Goal;
use deaflow_field::{Differentiable, Feasibility, Field, PredictError, StateFields};
use deaflow_pattern::{Layers, Pattern};

/// The score that is maximised, and the conditions on patterns.
pub struct SearchProblem<'a> {
    model: &'a dyn Differentiable<StateFields>,
    goal: &'a Goal,
    pub(super) units: Units,
    /// Whether units are single cells.
    units_are_cells: bool,
    /// Minimum and maximum number of active cells.
    pub(super) range: (usize, usize),
    pub(super) constraints: &'a Constraints,
    feasibility: Option<&'a dyn Feasibility>,
    /// All symmetric images of each pattern from which a minimum distance is kept.
    pub(super) others: Vec<Vec<Layers>>,
    distance: f64,
}

/// An evaluated pattern.
pub(super) struct SearchState {
    /// The group of each unit, 0 if it is off.
    pub(super) on: Vec<u8>,
    pub(super) pattern: Pattern,
    pub(super) fields: StateFields,
    pub(super) score: f64,
}

impl<'a> SearchProblem<'a> {
    /// A problem on columns and rows of units, or on cells, for area fractions from `area.0` to `area.1`.
    #[must_use]
    pub fn new(
        model: &'a dyn Differentiable<StateFields>,
        goal: &'a Goal,
        units: [usize; 2],
        area: (f64, f64),
        constraints: &'a Constraints,
    ) -> Self {
        let raster = constraints.membrane().raster;
        let [least, most] = constraints.cells_of_areas(area);
        Self {
            model,
            goal,
            units: Units::new(units, constraints.allowed()).with_always(constraints.kept_in().as_ref()),
            units_are_cells: units == raster.sides(),
            range: (least, most),
            constraints,
            feasibility: None,
            others: Vec::new(),
            distance: 0.0,
        }
    }

    /// The problem with only feasible patterns accepted.
    #[must_use]
    pub fn with_feasibility(self, feasibility: Option<&'a dyn Feasibility>) -> Self {
        Self { feasibility, ..self }
    }

    /// The problem with a minimum distance from other patterns: the share of cells in which patterns differ, over all
    /// symmetries of the device.
    #[must_use]
    pub fn distant_from(self, others: &[Pattern], distance: f64) -> Self {
        let layers = others.iter().map(|other| self.constraints.layers(other));
        let others = layers.map(|layers| self.constraints.equivalence().images(&layers));
        Self {
            others: others.collect(),
            distance,
            ..self
        }
    }

    /// The electrodes of each group; groups with equal voltages are merged.
    pub(super) fn merged_layers(&self, pattern: &Pattern) -> Layers {
        let layers = self.constraints.layers(pattern);
        self.constraints.equivalence().merged(&layers).into_owned()
    }

    pub(super) fn is_distant(&self, layers: &Layers) -> bool {
        self.others
            .iter()
            .all(|other| layers.distance_to(other) >= self.distance)
    }

    /// The minimum distance in cells.
    pub(super) fn min_difference(&self) -> usize {
        (self.distance * self.constraints.membrane().raster.cells() as f64 - 1e-9).ceil() as usize
    }

    /// A valid choice of units near the given one.
    pub(super) fn repaired(&self, on: &[u8]) -> Option<Vec<u8>> {
        let pattern = self.units.pattern(on);
        if self.constraints.satisfied_by(&pattern) {
            return Some(on.to_vec());
        }
        let repaired = self.units.of(&self.constraints.repaired(&pattern)?);
        // Rounding to coarser units may undo the repair.
        let is_valid = self.units_are_cells || self.constraints.satisfied_by(&self.units.pattern(&repaired));
        is_valid.then_some(repaired)
    }

    /// A choice of units, repaired if there are constraints; `None` if its area or its distance from others is not
    /// allowed.
    fn allowed(&self, on: Vec<u8>) -> Option<(Vec<u8>, Pattern)> {
        let on = match self.constraints.allow_any_pattern() {
            true => on,
            false => self.repaired(&on)?,
        };
        let pattern = self.units.pattern(&on);
        let layers = self.merged_layers(&pattern);
        let is_allowed = (self.range.0..=self.range.1).contains(&layers.count()) && self.is_distant(&layers);
        is_allowed.then_some((on, pattern))
    }

    fn allowed_choices(&self, choices: Vec<Vec<u8>>) -> (Vec<Vec<u8>>, Vec<Pattern>) {
        choices.into_iter().filter_map(|on| self.allowed(on)).unzip()
    }

    /// The first-order gain of changing each unit.
    pub(super) fn first_order_gains(&self, on: &[u8], gradient: &[f64]) -> Gains {
        let groups = gradient.chunks_exact(self.units.raster().cells());
        let values: Vec<Vec<f64>> = groups.map(|of_cells| self.units.sums(of_cells)).collect();
        Gains::first_order(on, &values)
    }

    pub(super) fn groups(&self) -> usize {
        self.constraints.groups()
    }

    /// The derivative of the score with respect to the activity of each cell; `None` if the pattern has no field.
    pub(super) fn gradient(&self, pattern: &Pattern) -> Result<Option<Vec<f64>>, PredictError> {
        let found = self.model.gradient(pattern, &|fields| self.goal.slope(fields))?;
        Ok(found.map(|(_, gradient)| gradient))
    }

    /// The score of each pattern that has a field.
    pub(super) fn scores(&self, patterns: &[Pattern]) -> Result<Vec<Option<f64>>, PredictError> {
        Ok(self.scored(self.model.predict_some(patterns)?))
    }

    /// Approximate scores to rank patterns that differ little from a pattern with a field.
    pub(super) fn scores_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<f64>>, PredictError> {
        Ok(self.scored(self.model.predict_near(base, patterns)?))
    }

    fn scored(&self, fields: Vec<Option<StateFields>>) -> Vec<Option<f64>> {
        let score = |fields: Option<StateFields>| fields.map(|fields| self.goal.score(&fields));
        fields.into_iter().map(score).collect()
    }

    /// The allowed choices with an [approximate score](Self::scores_near) above `least`, the best first.
    pub(super) fn promising(
        &self,
        base: &Pattern,
        choices: Vec<Vec<u8>>,
        least: f64,
    ) -> Result<Vec<Vec<u8>>, PredictError> {
        let (chosen, patterns) = self.allowed_choices(choices);
        let scored = chosen.into_iter().zip(self.scores_near(base, &patterns)?);
        let mut scored: Vec<(Vec<u8>, f64)> = scored.filter_map(|(on, score)| Some((on, score?))).collect();
        scored.retain(|(_, score)| *score > least);
        scored.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok(scored.into_iter().map(|(on, _)| on).collect())
    }

    pub(super) fn value_mm(&self, fields: &[Field]) -> f64 {
        self.goal.value_mm(fields)
    }

    /// Columns and rows of the smallest square that can be changed alone.
    pub(super) fn feature(&self) -> [usize; 2] {
        match self.units_are_cells {
            true => self.constraints.feature_cells(),
            false => [1; 2],
        }
    }

    /// The best of the allowed, feasible choices with a score above `least`; the first of equal ones.
    pub(super) fn best_of(&self, choices: Vec<Vec<u8>>, least: f64) -> Result<Option<SearchState>, PredictError> {
        let (chosen, patterns) = self.allowed_choices(choices);
        let fields = self.model.predict_some(&patterns)?;
        let mut states: Vec<SearchState> = Vec::new();
        for ((on, pattern), fields) in chosen.into_iter().zip(patterns).zip(fields) {
            let Some(fields) = fields else { continue };
            let score = self.goal.score(&fields);
            if score > least {
                states.push(SearchState {
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
