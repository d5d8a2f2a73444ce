//! Fields of patterns with electrodes as they may be fabricated.

use std::ops::Deref;
use std::sync::Arc;

use crate::objective::{DRAWN, reach};
use deaflow_field::{Differentiable, PredictError, Predictor, StateFields, WithGradient};
use deaflow_pattern::{Fabricated, MaskOffsets, Membrane, Parts, Pattern, fabricated};
use deaflow_scene::Scene;
use rayon::prelude::*;

/// A model whose fields are those with each of several masks, one after the other: of all states with the first mask,
/// then of all states with the next. A pattern has fields if it has some with every mask.
pub struct WithMasks<M> {
    model: M,
    offsets: Vec<MaskOffsets>,
    groups: u8,
    membrane: Membrane,
    parts: Option<Arc<Parts>>,
}

impl<M: Sync> WithMasks<M> {
    /// Wraps a model of a scene, which predicts patterns whose cells are covered in part.
    #[must_use]
    pub fn new(model: M, offsets: Vec<MaskOffsets>, scene: &Scene) -> Self {
        Self {
            model,
            offsets,
            groups: scene.groups() as u8,
            membrane: scene.membrane(),
            parts: scene.parts(),
        }
    }

    /// Returns a pattern as it is fabricated; `None` if two groups touch, or share a cell.
    fn fabricated(&self, pattern: &Pattern, offsets: &MaskOffsets) -> Result<Option<Pattern>, PredictError> {
        if *offsets == DRAWN {
            return Ok(Some(pattern.clone()));
        }
        let none_lost = vec![false; pattern.raster().cells()];
        match fabricated(pattern, self.parts.as_deref(), self.membrane, offsets, &none_lost) {
            Ok(Fabricated::Pattern(pattern)) => Ok(Some(pattern)),
            Ok(Fabricated::ShortCircuit | Fabricated::SharedCell) => Ok(None),
            Err(error) => Err(PredictError::failed(error)),
        }
    }

    /// Applies `of_mask` to the patterns with each mask.
    fn with_each(
        &self,
        patterns: &[Pattern],
        of_mask: impl Fn(&MaskOffsets, &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError>,
    ) -> Result<Vec<Option<StateFields>>, PredictError> {
        let mut found = vec![Some(StateFields::new()); patterns.len()];
        for offsets in &self.offsets {
            let made: Vec<Option<Pattern>> = patterns
                .par_iter()
                .map(|pattern| self.fabricated(pattern, offsets))
                .collect::<Result<_, _>>()?;
            let is_made: Vec<bool> = made.iter().map(Option::is_some).collect();
            let made: Vec<Pattern> = made.into_iter().flatten().collect();
            let mut fields = of_mask(offsets, &made)?.into_iter();
            for (all, is_made) in found.iter_mut().zip(is_made) {
                let own = if is_made { fields.next().flatten() } else { None };
                match (all.as_mut(), own) {
                    (Some(all), Some(own)) => all.extend(own),
                    _ => *all = None,
                }
            }
        }
        Ok(found)
    }

    /// Returns what the electrode of a group adds to Σ derivative · share over the cells of a pattern as fabricated,
    /// for each cell: what it loses without it if it has one.
    fn of_drawn_cells(
        &self,
        pattern: &Pattern,
        offsets: &MaskOffsets,
        of_cells: &[f64],
    ) -> Result<Vec<f64>, PredictError> {
        if *offsets == DRAWN {
            return Ok(of_cells.to_vec());
        }
        let raster = pattern.raster();
        let [columns, rows] = raster.sides();
        let reach = reach(offsets, self.membrane.cell_mm()).map(|cells| cells.ceil() as usize);
        let period = reach.map(|cells| 2 * cells + 1);
        let now = shares(self.fabricated(pattern, offsets)?.as_ref(), pattern);
        // Cells at this distance do not change the share of the same cell, so many are changed at once.
        let of_some = |first: usize| -> Result<Vec<(usize, f64)>, PredictError> {
            let [x0, y0] = [first % period[0], first / period[0]];
            let is_changed = |x: usize, y: usize| x % period[0] == x0 && y % period[1] == y0;
            let changed = Pattern::from_fn(raster, |x, y| pattern.is_active(x, y) != is_changed(x, y));
            let then = shares(self.fabricated(&changed, offsets)?.as_ref(), &changed);
            let all = (y0..rows).step_by(period[1]);
            let all = all.flat_map(|y| (x0..columns).step_by(period[0]).map(move |x| (x, y)));
            let added = |(x, y): (usize, usize)| {
                let around = |at: usize, reach: usize, all: usize| at.saturating_sub(reach)..(at + reach + 1).min(all);
                let cells = around(y, reach[1], rows).flat_map(|y| around(x, reach[0], columns).map(move |x| (x, y)));
                let change: f64 = cells
                    .map(|(x, y)| y * columns + x)
                    .map(|at| of_cells[at] * (then[at] - now[at]))
                    .sum();
                let sign = if pattern.is_active(x, y) { -1.0 } else { 1.0 };
                (y * columns + x, sign * change)
            };
            Ok(all.map(added).collect())
        };
        let each = (0..period[0] * period[1]).into_par_iter().map(of_some);
        let each: Vec<Vec<(usize, f64)>> = each.collect::<Result<_, _>>()?;
        let mut found = vec![0.0; raster.cells()];
        for (at, added) in each.into_iter().flatten() {
            found[at] = added;
        }
        Ok(found)
    }
}

/// The share of each cell that is covered.
fn shares(made: Option<&Pattern>, drawn: &Pattern) -> Vec<f64> {
    let pattern = made.unwrap_or(drawn);
    match pattern.coverage() {
        Some(coverage) => coverage.shares(),
        None => pattern
            .cells()
            .iter()
            .map(|group| f64::from(u8::from(*group != 0)))
            .collect(),
    }
}

impl<M: Deref<Target: Predictor<StateFields>> + Sync> Predictor<StateFields> for WithMasks<M> {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.with_each(patterns, |_, made| self.model.predict_some(made))
    }
}

impl<M: Deref<Target: Differentiable<StateFields>> + Sync> Differentiable<StateFields> for WithMasks<M> {
    /// The derivative with respect to the activity of a drawn cell is what its electrode adds to first order, also to
    /// the shares of the cells around it.
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        let found = self.predict_some(std::slice::from_ref(pattern))?.pop().flatten();
        let Some(fields) = found else { return Ok(None) };
        let states = fields.len() / self.offsets.len();
        let slopes = slope(&fields);
        let cells = pattern.raster().cells();
        let mut sum = vec![0.0; usize::from(self.groups) * cells];
        for (offsets, slopes) in self.offsets.iter().zip(slopes.chunks(states.max(1))) {
            let Some(made) = self.fabricated(pattern, offsets)? else {
                return Ok(None);
            };
            let Some((_, gradient)) = self.model.gradient(&made, &|_| slopes.to_vec())? else {
                return Ok(None);
            };
            for (at, of_group) in gradient.chunks(cells).enumerate() {
                let electrodes = pattern.of_group(at as u8 + 1);
                let added = self.of_drawn_cells(&electrodes, offsets, of_group)?;
                let sums = sum[at * cells..].iter_mut();
                sums.zip(added).for_each(|(sum, added)| *sum += added);
            }
        }
        Ok(Some((fields, sum)))
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.with_each(patterns, |offsets, made| match self.fabricated(base, offsets)? {
            Some(base) => self.model.predict_near(&base, made),
            None => Ok(vec![None; made.len()]),
        })
    }

    /// The response to the mask as drawn: `weights` are those of the states.
    fn linear_response(&self, weights: &[StateFields]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        self.model.linear_response(weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objective::{Criterion, Goal};
    use crate::tests::TestDevice;
    use crate::{AREA_PENALTY, Aim, Displacement, Motion};
    use deaflow_field::InStates;
    use deaflow_pattern::Raster;

    fn mask(wider_mm: f64, shift_mm: [f64; 2]) -> MaskOffsets {
        MaskOffsets { wider_mm, shift_mm }
    }

    fn goal(masks: usize) -> Goal {
        let aim = Aim::new([25.0, 25.0], Motion::Along(0.0));
        let goal = Goal::new(&Displacement, &[aim], Membrane::square(50.0), None, AREA_PENALTY).unwrap();
        goal.with_masks(masks, Criterion::Worst { counts_drawn: false })
    }

    fn scattered() -> Pattern {
        Pattern::from_fn(Raster::PAPER, |x, y| (x * 7 + y * y * 3) % 11 < 5 || (x < 20 && y > 30))
    }

    #[test]
    fn a_gradient_is_what_each_drawn_cell_adds() {
        let worth = (0..2500).map(|at| f64::from((at * 37) % 101 - 40) * 1e-4).collect();
        let (device, scene, goal) = (TestDevice::linear(worth), Scene::vhb4910(), goal(2));
        for offsets in [
            mask(0.3, [0.0; 2]),
            mask(-0.3, [0.0; 2]),
            mask(0.0, [0.2, -0.4]),
            mask(1.3, [0.6, 0.0]),
        ] {
            let model = WithMasks::new(Box::new(InStates::one(&device)), vec![DRAWN, offsets], &scene);
            let pattern = scattered();
            let score = |pattern: &Pattern| goal.score(&model.predict(std::slice::from_ref(pattern)).unwrap()[0]);
            let (_, gradient) = model.gradient(&pattern, &|fields| goal.slope(fields)).unwrap().unwrap();
            let now = score(&pattern);
            for at in (0..2500).step_by(83).chain([0, 49, 2450, 2499]) {
                let flipped = Pattern::from_fn(Raster::PAPER, |x, y| pattern.is_active(x, y) != (y * 50 + x == at));
                let sign = if pattern.is_active(at % 50, at / 50) { -1.0 } else { 1.0 };
                let gain = score(&flipped) - now;
                // Shares are rounded to 1e-9.
                assert!(
                    (gain - sign * gradient[at]).abs() < 1e-10,
                    "{offsets:?} {at}: {gain} {}",
                    gradient[at]
                );
            }
        }
    }

    #[test]
    fn a_pattern_with_a_short_circuit_has_no_fields() {
        let mut device = TestDevice::linear(vec![1e-3; 2500]);
        device.loads = vec![1.0, 1.0];
        let scene = Scene::vhb4910();
        let model = WithMasks::new(
            Box::new(InStates::one(&device)),
            vec![DRAWN, mask(0.6, [0.0; 2])],
            &scene,
        );
        let near = Pattern::from_groups(Raster::PAPER, |x, _| match x {
            0..20 => 1,
            20 => 0,
            _ => 2,
        });
        let one = Pattern::from_fn(Raster::PAPER, |x, _| x < 20);
        let found = model.predict_some(&[one, near]).unwrap();
        assert!(found[0].as_ref().is_some_and(|fields| fields.len() == 2) && found[1].is_none());
    }
}
