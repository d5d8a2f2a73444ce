//! The score of patterns to first order, in microseconds: the linear response of the membrane to a pattern is a sum over its cells.

use super::goal::Goal;
use deaflow_field::{Differentiable, Field, PredictError, StateFields, WithGradient};
use deaflow_pattern::Pattern;

/// Of more aims sums would take as long as an estimate, and what stands in them longer than a search.
const MOST_AIMS: usize = 32;

/// The score of patterns by the linear response.
pub struct RoughScore<'a> {
    goal: &'a Goal,
    /// Both components of the motion of each aim without electrodes, in mm.
    unloaded: Vec<f64>,
    /// What an electrode in a cell adds to them, `[group][y][x][component]`.
    added: Vec<f64>,
}

impl<'a> RoughScore<'a> {
    /// Of a goal in so many states of a device; `None` where there is no linear response, or too many aims.
    ///
    /// # Errors
    /// When the elements fail.
    pub fn new(
        goal: &'a Goal,
        elements: &dyn Differentiable<StateFields>,
        states: usize,
    ) -> Result<Option<Self>, PredictError> {
        if goal.aims().len() > MOST_AIMS {
            return Ok(None);
        }
        let rest = vec![Field::zero(goal.raster()); states];
        let components = goal.aims().iter().flat_map(|aim| {
            let of = |gradient| goal.slope_of(aim, &rest, gradient);
            [of([1.0, 0.0]), of([0.0, 1.0])]
        });
        let found = elements.at_rest(&components.collect::<Vec<_>>())?;
        Ok(found.map(|found| Self::of(goal, &found)))
    }

    fn of(goal: &'a Goal, components: &[WithGradient<f64>]) -> Self {
        let cells = components.first().map_or(0, |(_, gradient)| gradient.len());
        let added = |cell: usize| components.iter().map(move |(_, gradient)| gradient[cell]);
        Self {
            goal,
            unloaded: components.iter().map(|(unloaded, _)| *unloaded).collect(),
            added: (0..cells).flat_map(added).collect(),
        }
    }

    /// The score of a pattern.
    #[must_use]
    pub fn score(&self, pattern: &Pattern) -> f64 {
        let (mut sums, cells) = (self.unloaded.clone(), pattern.cells());
        let wide = sums.len();
        for (cell, &group) in cells.iter().enumerate().filter(|(_, group)| **group != 0) {
            let at = ((usize::from(group) - 1) * cells.len() + cell) * wide;
            let added = &self.added[at..at + wide];
            sums.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
        }
        self.goal.score_of(sums.as_chunks().0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AREA_PENALTY, Aim, Displacement, Distance, Motion};
    use deaflow_field::Predictor;
    use deaflow_pattern::{Membrane, Raster};

    /// Two groups in two states: an electrode of the first moves all by 1 µm along x in the first state, one of the second by 2 µm along y
    /// in the second.
    struct Additive;

    impl Additive {
        fn moved(pattern: &Pattern) -> StateFields {
            let count = |group: u8| pattern.cells().iter().filter(|cell| **cell == group).count() as f64;
            let uniform = |u: [f64; 2]| Field::from_values(Raster::PAPER, u.repeat(51 * 51)).unwrap();
            vec![uniform([1e-3 * count(1), 0.0]), uniform([0.0, 2e-3 * count(2)])]
        }
    }

    impl Predictor<StateFields> for Additive {
        fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
            Ok(patterns.iter().map(|pattern| Some(Self::moved(pattern))).collect())
        }
    }

    impl Differentiable<StateFields> for Additive {
        fn gradient(
            &self,
            _pattern: &Pattern,
            _slope: &dyn Fn(&StateFields) -> StateFields,
        ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
            Ok(None)
        }

        fn at_rest(&self, weights: &[StateFields]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
            let sum = |field: &Field, k: usize| field.values().iter().skip(k).step_by(2).sum::<f64>();
            let each = weights.iter().map(|weights| {
                let groups = [1e-3 * sum(&weights[0], 0), 2e-3 * sum(&weights[1], 1)];
                (0.0, groups.into_iter().flat_map(|of| vec![of; 2500]).collect())
            });
            Ok(Some(each.collect()))
        }
    }

    #[test]
    fn it_is_the_score_of_what_answers_linearly() {
        let aim = |state, motion| Aim {
            state,
            ..Aim::new([20.0, 30.0], motion)
        };
        let membrane = Membrane::square(50.0);
        let along = [aim(0, Motion::Along(30.0)), aim(1, Motion::Along(60.0))];
        let by = [aim(0, Motion::By(10.0, 0.4)), aim(1, Motion::To([0.1, 0.7]))];
        let pattern = Pattern::from_groups(Raster::PAPER, |x, y| ((x + 2 * y) % 3) as u8);
        for goal in [
            Goal::new(&Displacement, &along, membrane, None, AREA_PENALTY).unwrap(),
            Goal::new(&Distance, &by, membrane, None, AREA_PENALTY).unwrap(),
        ] {
            let rough = RoughScore::new(&goal, &Additive, 2).unwrap().unwrap();
            let exact = goal.score(&Additive::moved(&pattern));
            assert!((rough.score(&pattern) - exact).abs() < 1e-12 && exact.abs() > 0.1);
        }
        let many = Goal::new(&Displacement, &[aim(0, Motion::Along(0.0)); 33], membrane, None, 0.0).unwrap();
        assert!(RoughScore::new(&many, &Additive, 2).unwrap().is_none());
    }
}
