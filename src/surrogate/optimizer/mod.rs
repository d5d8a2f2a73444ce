//! How weights follow gradients: the kernels of convolutions by Muon, everything else by AdamW.
//!
//! With a thousand examples and a few epochs a training has only some hundred steps, and what limits it is how far each
//! step gets. Muon's steps move all directions of a weight matrix alike; at equal steps they leave a
//! sixth less error than AdamW's alone (0.037 for 0.044 mm with a thousand examples and eight epochs).

mod adamw;
mod muon;

use candle_core::{Result, Tensor, Var};
use rayon::prelude::*;

/// Pull of the weights towards zero, per unit of learning rate (Loshchilov & Hutter, "Decoupled weight decay
/// regularization", ICLR 2019).
const DECAY: f32 = 1e-4;

/// The state of a training's descent.
pub(crate) struct Optimizer {
    parameters: Vec<(Var, Rule)>,
}

enum Rule {
    AdamW(adamw::State),
    Muon(muon::State),
}

impl Optimizer {
    /// An optimiser of these weights: those with four dimensions are kernels, (outputs or inputs, height, width, …).
    pub(crate) fn new(vars: impl Iterator<Item = Var>) -> Self {
        let with_rule = |var: Var| {
            let rule = match *var.dims() {
                [rows, _, _, _] => Rule::Muon(muon::State::new(rows, var.elem_count() / rows)),
                _ => Rule::AdamW(adamw::State::new(var.elem_count())),
            };
            (var, rule)
        };
        Self {
            parameters: vars.map(with_rule).collect(),
        }
    }

    /// One step against the gradients, which come in the order of the weights.
    pub(crate) fn step(&mut self, gradients: &[Tensor], learning_rate: f64) -> Result<()> {
        let rate = learning_rate as f32;
        let update = |((var, rule), gradient): (&mut (Var, Rule), &Tensor)| {
            let mut values = var.flatten_all()?.to_vec1::<f32>()?;
            let gradient = gradient.flatten_all()?.to_vec1::<f32>()?;
            let direction = match rule {
                Rule::AdamW(state) => state.direction(&gradient),
                Rule::Muon(state) => state.direction(&gradient),
            };
            for (value, direction) in values.iter_mut().zip(direction) {
                *value -= rate * (direction + DECAY * *value);
            }
            var.set(&Tensor::from_vec(values, var.shape(), var.device())?)
        };
        self.parameters.par_iter_mut().zip(gradients).try_for_each(update)
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::*;

    #[test]
    fn both_rules_descend_to_the_minimum_of_a_quadratic() {
        // ½‖x − target‖², whose gradient is x − target.
        for dims in [&[6][..], &[2, 1, 1, 3]] {
            let target = Tensor::new(&[1.0f32, -2.0, 0.5, 3.0, 0.0, -1.0], &Device::Cpu)
                .unwrap()
                .reshape(dims)
                .unwrap();
            let var = Var::zeros(dims, candle_core::DType::F32, &Device::Cpu).unwrap();
            let mut optimizer = Optimizer::new([var.clone()].into_iter());
            for step in 0..400 {
                let gradient = (var.as_tensor() - &target).unwrap();
                optimizer
                    .step(&[gradient], 0.1 * (1.0 - f64::from(step) / 400.0))
                    .unwrap();
            }
            let error = (var.as_tensor() - &target).unwrap().sqr().unwrap().sum_all().unwrap();
            assert!(error.to_scalar::<f32>().unwrap().sqrt() < 0.01, "{dims:?}");
        }
    }
}
