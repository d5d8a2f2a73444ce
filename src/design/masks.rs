//! Fields of patterns with electrodes as they may be fabricated.

use std::ops::Deref;
use std::sync::Arc;

use crate::objective::{DRAWN, Masks, reach};
use deaflow_field::{Differentiable, Evaluator, Field, PredictError, Predictor, WithGradient};
use deaflow_pattern::{Fabricated, MaskOffsets, Membrane, Parts, Pattern, fabricated};
use deaflow_scene::Scene;
use rayon::prelude::*;

/// A model of a scene whose fields are those of patterns with a mask. A pattern has none if two groups touch with it.
pub struct Masked<M> {
    model: M,
    offsets: MaskOffsets,
    groups: usize,
    membrane: Membrane,
    parts: Option<Arc<Parts>>,
}

impl Masks {
    /// Returns the models of all states of a scene with each mask, one mask after the other. The models predict
    /// patterns whose cells are covered in part.
    #[must_use]
    pub fn over<M: Clone>(&self, states: &[M], scene: &Scene) -> Vec<Box<Masked<M>>> {
        let parts = scene.parts();
        let with = |offsets: MaskOffsets, model: &M| Masked {
            model: model.clone(),
            offsets,
            groups: scene.groups(),
            membrane: scene.membrane(),
            parts: parts.clone(),
        };
        let with = &with;
        let each = self.offsets.iter();
        each.flat_map(|offsets| states.iter().map(move |model| Box::new(with(*offsets, model))))
            .collect()
    }
}

impl<M> Masked<M> {
    /// Returns a pattern as it is fabricated; `None` if two groups touch, or share a cell.
    fn fabricated(&self, pattern: &Pattern) -> Result<Option<Pattern>, PredictError> {
        if self.offsets == DRAWN {
            return Ok(Some(pattern.clone()));
        }
        let none_lost = vec![false; pattern.raster().cells()];
        match fabricated(pattern, self.parts.as_deref(), self.membrane, &self.offsets, &none_lost) {
            Ok(Fabricated::Pattern(pattern)) => Ok(Some(pattern)),
            Ok(Fabricated::ShortCircuit | Fabricated::SharedCell) => Ok(None),
            Err(error) => Err(PredictError::failed(error)),
        }
    }
}

impl<M: Sync> Masked<M> {
    /// Predicts the patterns as they are fabricated.
    fn predicted(
        &self,
        patterns: &[Pattern],
        predict: impl Fn(&[Pattern]) -> Result<Vec<Option<Field>>, PredictError>,
    ) -> Result<Vec<Option<Field>>, PredictError> {
        let made: Vec<Option<Pattern>> = patterns
            .par_iter()
            .map(|pattern| self.fabricated(pattern))
            .collect::<Result<_, _>>()?;
        let is_made: Vec<bool> = made.iter().map(Option::is_some).collect();
        let made: Vec<Pattern> = made.into_iter().flatten().collect();
        let mut fields = predict(&made)?.into_iter();
        let field = |is_made| if is_made { fields.next().flatten() } else { None };
        Ok(is_made.into_iter().map(field).collect())
    }

    /// Returns what the electrode of a group adds to Σ derivative · share over the cells of a pattern as fabricated,
    /// for each cell: what it loses without it if it has one.
    fn of_drawn_cells(&self, pattern: &Pattern, of_cells: &[f64]) -> Result<Vec<f64>, PredictError> {
        if self.offsets == DRAWN {
            return Ok(of_cells.to_vec());
        }
        let raster = pattern.raster();
        let [columns, rows] = raster.sides();
        let reach = reach(&self.offsets, self.membrane.cell_mm()).map(|cells| cells.ceil() as usize);
        let period = reach.map(|cells| 2 * cells + 1);
        let now = shares(self.fabricated(pattern)?.as_ref(), pattern);
        // Cells at this distance do not change the share of the same cell, so many are changed at once.
        let of_some = |first: usize| -> Result<Vec<(usize, f64)>, PredictError> {
            let [x0, y0] = [first % period[0], first / period[0]];
            let is_changed = |x: usize, y: usize| x % period[0] == x0 && y % period[1] == y0;
            let changed = Pattern::from_fn(raster, |x, y| pattern.is_active(x, y) != is_changed(x, y));
            let then = shares(self.fabricated(&changed)?.as_ref(), &changed);
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

impl<M: Deref<Target: Predictor> + Sync> Predictor for Masked<M> {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        self.predicted(patterns, |made| self.model.predict_some(made))
    }
}

impl<M: Deref<Target: Evaluator> + Sync + Send> Evaluator for Masked<M> {
    fn settings(&self) -> String {
        self.model.settings()
    }
}

impl<M: Deref<Target: Differentiable> + Sync> Differentiable for Masked<M> {
    /// The derivative with respect to the activity of a drawn cell is what its electrode adds to first order, also to
    /// the shares of the cells around it.
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&Field) -> Field,
    ) -> Result<Option<WithGradient>, PredictError> {
        let Some(made) = self.fabricated(pattern)? else {
            return Ok(None);
        };
        let Some((field, gradient)) = self.model.gradient(&made, slope)? else {
            return Ok(None);
        };
        let groups = (1..).zip(gradient.chunks(pattern.raster().cells()));
        let added = groups.map(|(group, of_group)| self.of_drawn_cells(&pattern.of_group(group), of_group));
        let added: Vec<Vec<f64>> = added.collect::<Result<_, _>>()?;
        Ok(Some((field, added.concat())))
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        match self.fabricated(base)? {
            Some(base) => self.predicted(patterns, |made| self.model.predict_near(&base, made)),
            None => Ok(vec![None; patterns.len()]),
        }
    }

    /// There is one for the mask as drawn, whose motions a goal ranks; others count 0.
    fn linear_response(&self, weights: &[Field]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        if self.offsets == DRAWN {
            return self.model.linear_response(weights);
        }
        let cells = self.groups * self.membrane.raster.cells();
        Ok(Some(vec![(0.0, vec![0.0; cells]); weights.len()]))
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

    fn masks(offsets: MaskOffsets) -> Masks {
        Masks {
            offsets: vec![DRAWN, offsets],
            criterion: Criterion::Worst { counts_drawn: false },
        }
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
            let model = InStates::new(masks(offsets).over(&[&device], &scene));
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
        let model = InStates::new(masks(mask(0.6, [0.0; 2])).over(&[&device], &scene));
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
