//! One step of a training: the gradient of the loss over a batch.
//!
//! The batch is split into parts of fixed size; threads take parts, and what the parts give is added in the order of the
//! parts, so the sum has the same bits whatever the number of threads.

use candle_core::{Device, Result, Tensor, Var};
use rayon::prelude::*;

use super::encode::{fields_to_tensor, patterns_to_tensor};
use super::example::Example;
use super::loss::{LossWeights, total_loss};
use super::networks::Network;

/// Examples whose gradients are computed together by one thread. It is part of the result: sums are grouped by it.
const PART: usize = 4;

/// What a training step and its assessment need beside the examples.
pub(crate) struct Problem<'a> {
    /// The network.
    pub(crate) network: &'a dyn Network,
    /// Its weights.
    pub(crate) vars: &'a [(String, Var)],
    /// The weights of the loss.
    pub(crate) loss: LossWeights,
    /// Length in mm of one unit of the network's output.
    pub(crate) scale_mm: f64,
    /// Where the network runs.
    pub(crate) device: &'a Device,
}

/// A loss summed over examples, and the gradient of its mean.
struct Gradient {
    loss: f64,
    gradients: Vec<Tensor>,
}

impl Problem<'_> {
    /// The loss summed over a batch, and the gradient of its mean with respect to each weight.
    pub(crate) fn gradient(&self, batch: &[&Example]) -> Result<(f64, Vec<Tensor>)> {
        let share = 1.0 / batch.len() as f64;
        let parts = batch.par_chunks(PART).map(|part| self.part(part, share));
        let parts: Vec<Gradient> = parts.collect::<Result<_>>()?;
        let loss = parts.iter().map(|part| part.loss).sum();
        let sum_of = |i: usize| {
            let mut sum = parts[0].gradients[i].clone();
            for part in &parts[1..] {
                sum = (sum + &part.gradients[i])?;
            }
            Ok(sum)
        };
        let gradients: Result<_> = (0..self.vars.len()).into_par_iter().map(sum_of).collect();
        Ok((loss, gradients?))
    }

    fn part(&self, part: &[&Example], share: f64) -> Result<Gradient> {
        let loss = self.loss_of(part)?;
        let mut store = (&loss * share)?.backward()?;
        let gradient = |(_, var): &(String, Var)| match store.remove(var) {
            Some(gradient) => Ok(gradient),
            None => var.zeros_like(),
        };
        Ok(Gradient {
            loss: f64::from(loss.to_scalar::<f32>()?),
            gradients: self.vars.iter().map(gradient).collect::<Result<_>>()?,
        })
    }

    fn loss_of(&self, part: &[&Example]) -> Result<Tensor> {
        let patterns = patterns_to_tensor(part.iter().map(|e| &e.pattern), self.device)?;
        let fields = fields_to_tensor(part.iter().map(|e| &e.field), self.scale_mm, self.device)?;
        total_loss(&self.network.forward(&patterns, true)?, &fields, self.loss)
    }

    /// The loss summed over examples, without its gradient.
    pub(crate) fn loss(&self, examples: &[&Example]) -> Result<f64> {
        let parts = examples
            .par_chunks(PART)
            .map(|part| Ok(f64::from(self.loss_of(part)?.to_scalar::<f32>()?)));
        let parts: Vec<f64> = parts.collect::<Result<_>>()?;
        Ok(parts.iter().sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Split;
    use crate::surrogate::NetworkKind;
    use crate::surrogate::parameters::Parameters;
    use crate::surrogate::testing::examples;

    #[test]
    fn the_gradient_is_that_of_the_mean_loss() {
        let device = Device::Cpu;
        let mut parameters = Parameters::drawn(std::collections::BTreeMap::new(), 1, &device);
        let network = NetworkKind::Qin2024.build(&mut parameters).unwrap();
        let vars = parameters.into_drawn();
        let loss = LossWeights {
            maximum: 0.1,
            auxiliary: 0.2,
        };
        let problem = Problem {
            network: network.as_ref(),
            vars: &vars,
            loss,
            scale_mm: 0.4,
            device: &device,
        };
        // Five examples: a full part and a part of one.
        let examples = examples(5, Split::Train);
        let batch: Vec<&Example> = examples.iter().collect();
        let (sum, gradients) = problem.gradient(&batch).unwrap();
        assert!((sum / problem.loss(&batch).unwrap() - 1.0).abs() < 1e-6);
        // Along the gradient of each weight the mean loss changes by the square of its length.
        for ((name, var), gradient) in vars.iter().zip(&gradients) {
            let square = gradient.sqr().unwrap().sum_all().unwrap().to_scalar::<f32>().unwrap();
            let (start, step) = (var.copy().unwrap(), 1e-4 / f64::from(square));
            let at = |sign: f64| {
                var.set(&(&start + (gradient * (sign * step)).unwrap()).unwrap())
                    .unwrap();
                problem.loss(&batch).unwrap() / 5.0
            };
            let slope = (at(1.0) - at(-1.0)) / (2.0 * step);
            var.set(&start).unwrap();
            assert!(
                (slope / f64::from(square) - 1.0).abs() < 0.02,
                "{name}: {slope} {square}"
            );
        }
    }
}
