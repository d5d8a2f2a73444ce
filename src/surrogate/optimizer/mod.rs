//! Optimisers: AdamW for all weights, or Muon for convolution kernels and AdamW for all other weights.
//!
//! With a thousand examples and a few epochs, a training has only some hundred steps, so the progress per step limits
//! it. Muon's steps change all directions of a weight matrix equally. With the same number of steps the error of the
//! paper's network is a sixth smaller than with AdamW alone (0.037 instead of 0.044 mm, a thousand examples, eight
//! epochs).

mod adamw;
mod muon;

use candle_core::{Result, Tensor, Var};
use rayon::prelude::*;

use super::options::{OptimizerKind, TrainOptions};

/// An optimiser and its state.
pub(crate) struct Optimizer {
    parameters: Vec<(Var, Rule)>,
    decay: f32,
    gradient_norm: Option<f64>,
    steps: u32,
}

enum Rule {
    AdamW(adamw::AdamWState),
    Muon(muon::MuonState),
}

impl Optimizer {
    /// Creates an optimiser of weights. Weights with four dimensions are kernels, (outputs or inputs, height, width,
    /// …).
    pub(crate) fn new(options: &TrainOptions, vars: impl Iterator<Item = Var>) -> Self {
        let with_rule = |var: Var| {
            let rule = match (options.optimizer, var.dims()) {
                (OptimizerKind::Muon, &[rows, _, _, _]) => {
                    Rule::Muon(muon::MuonState::new(rows, var.elem_count() / rows))
                }
                _ => Rule::AdamW(adamw::AdamWState::new(var.elem_count())),
            };
            (var, rule)
        };
        Self {
            parameters: vars.map(with_rule).collect(),
            decay: options.weight_decay as f32,
            gradient_norm: options.gradient_norm,
            steps: 0,
        }
    }

    /// Takes one step. The gradients have the order of the weights.
    pub(crate) fn step(&mut self, gradients: Vec<Vec<f32>>, learning_rate: f64) -> Result<()> {
        let shrink = self.gradient_norm.map_or(1.0, |most| shrink(&gradients, most));
        self.steps += 1;
        let (rate, decay, steps) = (learning_rate as f32, self.decay, self.steps);
        let update = |((var, rule), mut gradient): (&mut (Var, Rule), Vec<f32>)| {
            if shrink < 1.0 {
                gradient.iter_mut().for_each(|g| *g *= shrink);
            }
            let mut values = var.flatten_all()?.to_vec1::<f32>()?;
            let direction = match rule {
                Rule::AdamW(state) => state.direction(&gradient, steps),
                Rule::Muon(state) => state.direction(&gradient),
            };
            for (value, direction) in values.iter_mut().zip(direction) {
                *value -= rate * (direction + decay * *value);
            }
            var.set(&Tensor::from_vec(values, var.shape(), var.device())?)
        };
        self.parameters.par_iter_mut().zip(gradients).try_for_each(update)
    }

    /// Returns the number of steps taken.
    pub(crate) fn steps(&self) -> u32 {
        self.steps
    }

    /// Returns the running means, in the order of the weights.
    pub(crate) fn means(&self) -> Vec<&[f32]> {
        let means = self.parameters.iter().flat_map(|(_, rule)| match rule {
            Rule::AdamW(state) => state.means().to_vec(),
            Rule::Muon(state) => vec![state.momentum()],
        });
        means.collect()
    }

    /// Restores the state: the number of steps and the means in the order and lengths of [`Optimizer::means`].
    pub(crate) fn resume(&mut self, steps: u32, means: impl IntoIterator<Item = Vec<f32>>) {
        self.steps = steps;
        let mut means = means.into_iter();
        for (_, rule) in &mut self.parameters {
            match rule {
                Rule::AdamW(state) => state.resume([means.next(), means.next()].map(Option::unwrap_or_default)),
                Rule::Muon(state) => state.resume(means.next().unwrap_or_default()),
            }
        }
    }
}

/// Returns the factor that reduces the norm of all gradients to `most`; 1 for smaller norms.
fn shrink(gradients: &[Vec<f32>], most: f64) -> f32 {
    let square = |g: &Vec<f32>| g.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>();
    // One thread adds each sum, and the sums are added in order: the same bits for any number of threads.
    let squares: Vec<f64> = gradients.par_iter().map(square).collect();
    (most / squares.iter().sum::<f64>().sqrt()).min(1.0) as f32
}

#[cfg(test)]
mod tests {
    use candle_core::{DType, Device};

    use super::*;

    fn optimizer(options: TrainOptions, var: &Var) -> Optimizer {
        Optimizer::new(&options, [var.clone()].into_iter())
    }

    #[test]
    fn both_rules_descend_to_the_minimum_of_a_quadratic() {
        // ½‖x − target‖², whose gradient is x − target.
        for kind in OptimizerKind::ALL {
            let dims = [2, 1, 1, 3];
            let target = Tensor::new(&[1.0f32, -2.0, 0.5, 3.0, 0.0, -1.0], &Device::Cpu)
                .unwrap()
                .reshape(&dims)
                .unwrap();
            let var = Var::zeros(&dims, DType::F32, &Device::Cpu).unwrap();
            let options = TrainOptions {
                optimizer: kind,
                ..TrainOptions::default()
            };
            let mut optimizer = optimizer(options, &var);
            assert_eq!(optimizer.means().len(), if kind == OptimizerKind::Muon { 1 } else { 2 });
            for step in 0..400 {
                let gradient = (var.as_tensor() - &target).unwrap();
                let gradient = gradient.flatten_all().unwrap().to_vec1().unwrap();
                optimizer
                    .step(vec![gradient], 0.1 * (1.0 - f64::from(step) / 400.0))
                    .unwrap();
            }
            let error = (var.as_tensor() - &target).unwrap().sqr().unwrap().sum_all().unwrap();
            assert!(error.to_scalar::<f32>().unwrap().sqrt() < 0.01, "{kind:?}");
        }
    }

    #[test]
    fn adamw_equals_candle() {
        let options = TrainOptions {
            optimizer: OptimizerKind::AdamW,
            weight_decay: 0.1,
            ..TrainOptions::default()
        };
        let start = Tensor::new(&[1.0f32, -2.0, 0.5], &Device::Cpu).unwrap();
        let [own, other] = [(); 2].map(|()| Var::from_tensor(&start).unwrap());
        let mut ours = optimizer(options, &own);
        let parameters = candle_nn::ParamsAdamW {
            lr: 0.05,
            beta1: 0.9,
            beta2: 0.99,
            eps: 1e-8,
            weight_decay: 0.1,
        };
        let mut candle: candle_nn::AdamW = candle_nn::Optimizer::new(vec![other.clone()], parameters).unwrap();
        for step in 0..20u8 {
            // The gradient of ½ c x², c growing from step to step.
            let c = f64::from(step) + 1.0;
            let gradient = (own.as_tensor() * c).unwrap().to_vec1().unwrap();
            ours.step(vec![gradient], 0.05).unwrap();
            let loss = (other.sqr().unwrap().sum_all().unwrap() * (0.5 * c)).unwrap();
            candle_nn::Optimizer::backward_step(&mut candle, &loss).unwrap();
        }
        let [found, expected] = [own, other].map(|var| var.to_vec1::<f32>().unwrap());
        let near = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-5;
        assert!(found.iter().zip(&expected).all(near), "{found:?} {expected:?}");
    }

    #[test]
    fn gradients_are_clipped_by_their_total_norm() {
        // The norm of 3, 4 and 12 is 13.
        let gradients = [vec![3.0, 4.0], vec![12.0]];
        assert_eq!(shrink(&gradients, 6.5), 0.5);
        assert_eq!(shrink(&gradients, 13.0), 1.0);
        assert_eq!(shrink(&[vec![0.0]], 1.0), 1.0);
        // AdamW's first mean shows the clipped gradient.
        let var = Var::zeros(2, DType::F32, &Device::Cpu).unwrap();
        let options = TrainOptions {
            gradient_norm: Some(1.0),
            ..TrainOptions::default()
        };
        let mut optimizer = optimizer(options, &var);
        optimizer.step(vec![vec![3.0, 4.0]], 0.1).unwrap();
        let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
        assert!(near(optimizer.means()[0][0], 0.06) && near(optimizer.means()[0][1], 0.08));
    }

    #[test]
    fn weights_decay_by_rate_times_decay_without_gradient() {
        let var = Var::new(&[2.0f32, -4.0], &Device::Cpu).unwrap();
        let options = TrainOptions {
            weight_decay: 0.5,
            ..TrainOptions::default()
        };
        optimizer(options, &var).step(vec![vec![0.0; 2]], 0.1).unwrap();
        let found = var.to_vec1::<f32>().unwrap();
        assert!(
            found.iter().zip([1.9, -3.8]).all(|(a, b)| (a - b).abs() < 1e-6),
            "{found:?}"
        );
    }
}
