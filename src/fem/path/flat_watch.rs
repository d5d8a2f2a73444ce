//! Where the flat membrane begins to wrinkle or buckle out of its plane along a path.

use super::trace::PathState;

/// Halvings of the step in which the flat membrane loses its stability.
const HALVINGS: u32 = 12;

/// Where the flat membrane begins to be unstable out of its plane: a share of what changes, and the state before it.
#[derive(Clone, Copy)]
pub(super) struct FlatLimit {
    pub share: f64,
    pub state: usize,
}

/// Follows the stability of states out of the plane.
#[derive(Default)]
pub(super) struct FlatWatch {
    /// Number of states.
    states: usize,
    /// The last state, and its share, while all were stable.
    stable: Option<(Vec<f64>, f64)>,
    limit: Option<FlatLimit>,
    /// Whether the stable part of the path has ended.
    is_over: bool,
}

impl FlatWatch {
    /// Returns where the flat membrane begins to be unstable on the stable part of the path, if it does.
    pub fn limit(&self) -> Option<FlatLimit> {
        self.limit
    }

    /// Adds a state; `unstable` counts the motions in which a state at a share is unstable.
    pub fn add(&mut self, state: &PathState, unstable: impl Fn(&[f64], f64) -> usize) -> usize {
        let count = unstable(&state.u, state.share);
        self.is_over |= !state.stable;
        if !self.is_over && self.limit.is_none() {
            if count > 0 {
                self.limit = Some(FlatLimit {
                    share: self.between(state, &unstable),
                    state: self.states.saturating_sub(1),
                });
            } else {
                self.stable = Some((state.u.clone(), state.share));
            }
        }
        self.states += 1;
        count
    }

    /// Returns the share between the last stable state and this one, by halving the straight line between them.
    fn between(&self, state: &PathState, unstable: impl Fn(&[f64], f64) -> usize) -> f64 {
        let Some((before, first)) = &self.stable else {
            return state.share;
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let u: Vec<f64> = before.iter().zip(&state.u).map(|(a, b)| a + middle * (b - a)).collect();
            match unstable(&u, first + middle * (state.share - first)) {
                0 => low = middle,
                _ => high = middle,
            }
        }
        first + 0.5 * (low + high) * (state.share - first)
    }
}
