//! The score of a pattern from the linear response, in microseconds: the response is a sum over the active cells.

use super::goal::Goal;
use deaflow_field::{Differentiable, PredictError, StateFields, WithGradient};
use deaflow_pattern::Pattern;

/// With more aims, a sum takes as long as an estimate by finite elements, and its setup longer than a search.
const MAX_AIMS: usize = 32;

/// The score of patterns from the linear response.
pub struct RoughScore<'a> {
    goal: &'a Goal,
    /// Both components of the motion of each aim without electrodes in mm.
    unloaded: Vec<f64>,
    /// The contribution of an electrode in a cell to these, `[group][y][x][component]`.
    added: Vec<f64>,
}

impl<'a> RoughScore<'a> {
    /// For a goal and a number of states of the device; `None` if there is no linear response, or there are too many
    /// aims.
    ///
    /// # Errors
    /// If the finite elements fail.
    pub fn new(
        goal: &'a Goal,
        elements: &dyn Differentiable<StateFields>,
        states: usize,
    ) -> Result<Option<Self>, PredictError> {
        if goal.aims().len() > MAX_AIMS {
            return Ok(None);
        }
        let rest = goal.at_rest(states);
        let components = goal.aims().iter().flat_map(|aim| {
            let of = |gradient| goal.slope_of(aim, &rest, gradient);
            [of([1.0, 0.0]), of([0.0, 1.0])]
        });
        let found = elements.linear_response(&components.collect::<Vec<_>>())?;
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
    use crate::tests::TestDevice;
    use crate::{AREA_PENALTY, Aim, Displacement, Distance, Motion};
    use deaflow_field::{InStates, Predictor};
    use deaflow_pattern::{Membrane, Raster};

    /// Two groups in two states: an electrode of group 1 moves all points by 1 µm along x in state 1, one of group 2
    /// by 2 µm along y in state 2.
    fn states() -> [TestDevice; 2] {
        let state = |loads: [f64; 2], moves_along_y| TestDevice {
            loads: loads.to_vec(),
            moves_along_y,
            ..TestDevice::linear(vec![1.0; 2500])
        };
        [state([1e-3, 0.0], false), state([0.0, 2e-3], true)]
    }

    #[test]
    fn it_is_the_exact_score_of_a_linear_device() {
        let aim = |state, motion| Aim {
            state,
            ..Aim::new([20.0, 30.0], motion)
        };
        let membrane = Membrane::square(50.0);
        let along = [aim(0, Motion::Along(30.0)), aim(1, Motion::Along(60.0))];
        let by = [aim(0, Motion::By(10.0, 0.4)), aim(1, Motion::To([0.1, 0.7]))];
        let pattern = Pattern::from_groups(Raster::PAPER, |x, y| ((x + 2 * y) % 3) as u8);
        let [push, pull] = states();
        let device = InStates::new(vec![&push, &pull]);
        let fields = device.predict(std::slice::from_ref(&pattern)).unwrap().swap_remove(0);
        for goal in [
            Goal::new(&Displacement, &along, membrane, None, AREA_PENALTY).unwrap(),
            Goal::new(&Distance, &by, membrane, None, AREA_PENALTY).unwrap(),
        ] {
            let rough = RoughScore::new(&goal, &device, 2).unwrap().unwrap();
            let exact = goal.score(&fields);
            assert!((rough.score(&pattern) - exact).abs() < 1e-12 && exact.abs() > 0.1);
        }
        let many = Goal::new(
            &Displacement,
            &vec![aim(0, Motion::Along(0.0)); 33],
            membrane,
            None,
            0.0,
        )
        .unwrap();
        assert!(RoughScore::new(&many, &device, 2).unwrap().is_none());
    }
}
