//! Adam with decoupled weight decay (Kingma & Ba, ICLR 2015, algorithm 1; the decay is applied by the caller).
//!
//! candle-nn's `AdamW`, the reference in tests, does not expose its running means, which checkpoints need, and takes
//! thirteen passes over memory instead of one.

/// Decay of the mean of the gradients.
const BETA1: f32 = 0.9;
/// Decay of the mean of the squared gradients. The usual 0.999 needs more than the few hundred steps of a training.
const BETA2: f32 = 0.99;
/// Keeps the step finite for zero gradients.
const EPSILON: f32 = 1e-8;

/// The running means of one tensor.
pub(super) struct AdamWState {
    first: Vec<f32>,
    second: Vec<f32>,
}

impl AdamWState {
    /// Creates the state before the first step.
    pub(super) fn new(count: usize) -> Self {
        Self {
            first: vec![0.0; count],
            second: vec![0.0; count],
        }
    }

    /// Returns the means of the gradients and of their squares.
    pub(super) fn means(&self) -> [&[f32]; 2] {
        [&self.first, &self.second]
    }

    /// Restores the means.
    pub(super) fn resume(&mut self, [first, second]: [Vec<f32>; 2]) {
        (self.first, self.second) = (first, second);
    }

    /// Returns the descent direction of a step (from 1), of size about 1 per weight.
    pub(super) fn direction(&mut self, gradient: &[f32], step: u32) -> Vec<f32> {
        let power = i32::try_from(step).unwrap_or(i32::MAX);
        let (unbias1, unbias2) = (1.0 - BETA1.powi(power), 1.0 - BETA2.powi(power));
        let means = self.first.iter_mut().zip(&mut self.second);
        let direction = means.zip(gradient).map(|((m, v), g)| {
            *m = BETA1 * *m + (1.0 - BETA1) * g;
            *v = BETA2 * *v + (1.0 - BETA2) * g * g;
            (*m / unbias1) / ((*v / unbias2).sqrt() + EPSILON)
        });
        direction.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_steps_by_hand() {
        let mut state = AdamWState::new(2);
        let close = |found: Vec<f32>, expected: [f64; 2]| {
            let near = |(a, b): (&f32, &f64)| (f64::from(*a) - b).abs() < 2e-5;
            assert!(found.iter().zip(&expected).all(near), "{found:?} {expected:?}");
        };
        // The first direction is the sign of the gradient.
        close(state.direction(&[3.0, -1e-2], 1), [1.0, -1.0]);
        // Then with gradient 0: m = 0.9·0.1 g, v = 0.99·0.01 g², unbiased by 1 − 0.9² and 1 − 0.99².
        let second = (0.9 * 0.1 / 0.19) / (0.99f64 * 0.01 / 0.0199).sqrt();
        close(state.direction(&[0.0, 0.0], 2), [second, -second]);
    }
}
