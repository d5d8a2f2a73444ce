//! Gradient and loss of a batch.
//!
//! A batch is split into parts of fixed size. Threads process parts, and the results are added in the order of the
//! parts, so the sums have the same bits for any number of threads.

use std::borrow::Cow;

use candle_core::{Result, Tensor, Var};
use rayon::prelude::*;

use super::corners::Corners;
use super::encode::{labels_to_tensor, patterns_to_tensor};
use super::example::{Example, Label};
use super::loss::{LossWeights, total_loss};
use super::metrics::ErrorSums;
use super::networks::{Network, Output};
use deaflow_pattern::{Pattern, Symmetry};

/// The network and the loss of a training.
pub(crate) struct Problem<'a> {
    /// The corners of the labels.
    pub(crate) corners: Corners,
    /// Load of each electrode group relative to the largest.
    pub(crate) loads: &'a [f64],
    /// The network.
    pub(crate) network: &'a dyn Network,
    /// Its weights.
    pub(crate) vars: &'a [(String, Var)],
    /// Weights of the loss terms.
    pub(crate) loss: LossWeights,
    /// Unit of the network output in mm.
    pub(crate) scale_mm: f64,
}

/// An example transformed by a symmetry.
#[derive(Clone, Copy)]
pub(crate) struct Augmented<'a> {
    /// The example.
    pub(crate) example: &'a Example,
    /// The symmetry.
    pub(crate) symmetry: Symmetry,
}

impl<'a> Augmented<'a> {
    /// The example itself.
    pub(crate) fn identity(example: &'a Example) -> Self {
        Self {
            example,
            symmetry: Symmetry::IDENTITY,
        }
    }

    fn pattern(self) -> Cow<'a, Pattern> {
        match self.symmetry {
            Symmetry::IDENTITY => Cow::Borrowed(&self.example.pattern),
            g => Cow::Owned(self.example.pattern.transformed(g)),
        }
    }

    fn label(self) -> Label {
        self.example.label.transformed(self.symmetry)
    }
}

/// Examples whose frozen output is held at a time: 10 MB on the paper's membrane.
pub(crate) const FROZEN_EXAMPLES: usize = 512;
/// Examples whose frozen output is computed together.
const FROZEN_CHUNK: usize = 64;

/// Examples with the frozen part of their output, where it is known.
#[derive(Clone, Copy)]
pub(crate) struct Batch<'a> {
    /// The examples.
    pub(crate) examples: &'a [Augmented<'a>],
    /// The same number of values for each example.
    pub(crate) frozen: Option<&'a [f32]>,
}

impl<'a> Batch<'a> {
    /// Splits the batch into parts of `size` examples; the last part may be smaller.
    pub(crate) fn parts(self, size: usize) -> Vec<Self> {
        let each = self.frozen.map_or(0, |all| all.len() / self.examples.len());
        let part = |(at, examples): (usize, &'a [Augmented<'a>])| Self {
            examples,
            frozen: self.frozen.map(|all| &all[at * size * each..][..examples.len() * each]),
        };
        self.examples.chunks(size).enumerate().map(part).collect()
    }
}

/// A loss summed over examples, and the gradient of the mean loss with respect to each weight as a flat vector.
///
/// The gradients are plain vectors, because candle adds large tensors on threads of its own, for which these threads
/// would have to wait.
type LossGradient = (f64, Vec<Vec<f32>>);

/// Loss and errors on some examples.
pub(crate) struct BatchErrors {
    /// The loss summed over the examples.
    pub(crate) loss: f64,
    /// Errors of each prediction.
    pub(crate) sums: Vec<ErrorSums>,
}

impl Problem<'_> {
    /// Computes the frozen output of each example; `None` when the network has none.
    pub(crate) fn frozen(&self, examples: &[Augmented<'_>]) -> Result<Option<Vec<f32>>> {
        let chunks = examples.par_chunks(FROZEN_CHUNK);
        let chunks = chunks.map(|chunk| self.network.frozen(&self.patterns(chunk)?));
        let chunks: Vec<Option<Vec<f32>>> = chunks.collect::<Result<_>>()?;
        Ok(chunks
            .into_iter()
            .collect::<Option<Vec<_>>>()
            .map(|chunks| chunks.concat()))
    }

    /// Computes the loss and the gradient of a batch.
    pub(crate) fn gradient(&self, batch: Batch<'_>) -> Result<LossGradient> {
        let share = 1.0 / batch.examples.len() as f64;
        let parts = batch.parts(self.network.examples_per_part());
        let parts = parts.into_par_iter().map(|part| self.part(part, share));
        let parts: Vec<LossGradient> = parts.collect::<Result<_>>()?;
        let loss = parts.iter().map(|(loss, _)| loss).sum();
        let sum_of = |i: usize| {
            let mut sum = parts[0].1[i].clone();
            for (_, gradients) in &parts[1..] {
                sum.iter_mut().zip(&gradients[i]).for_each(|(sum, g)| *sum += g);
            }
            sum
        };
        Ok((loss, (0..self.vars.len()).into_par_iter().map(sum_of).collect()))
    }

    fn part(&self, part: Batch<'_>, share: f64) -> Result<LossGradient> {
        let (_, loss) = self.evaluate(part)?;
        let mut store = (&loss * share)?.backward()?;
        let gradient = |(_, var): &(String, Var)| match store.remove(var) {
            Some(gradient) => gradient.flatten_all()?.to_vec1::<f32>(),
            None => Ok(vec![0.0; var.elem_count()]),
        };
        let gradients = self.vars.iter().map(gradient).collect::<Result<_>>()?;
        Ok((f64::from(loss.to_scalar::<f32>()?), gradients))
    }

    /// Encodes the patterns of examples as network input.
    fn patterns(&self, examples: &[Augmented<'_>]) -> Result<Tensor> {
        let patterns: Vec<Cow<'_, Pattern>> = examples.iter().map(|example| example.pattern()).collect();
        patterns_to_tensor(self.corners.raster(), self.loads, patterns.iter().map(AsRef::as_ref))
    }

    /// Computes the network output and the loss summed over the examples.
    fn evaluate(&self, part: Batch<'_>) -> Result<(Output, Tensor)> {
        let patterns = self.patterns(part.examples)?;
        let labels: Vec<Label> = part.examples.iter().map(|example| example.label()).collect();
        let labels = labels_to_tensor(self.corners, &labels, self.scale_mm)?;
        let output = self.network.forward_for_training(&patterns, part.frozen)?;
        let loss = total_loss(&output, &labels, self.loss)?;
        Ok((output, loss))
    }

    /// Computes the loss and the errors of examples, without gradients.
    pub(crate) fn errors(&self, examples: &[&Example]) -> Result<BatchErrors> {
        let size = self.network.examples_per_part();
        let errors = |part: Batch<'_>| {
            let (output, loss) = self.evaluate(part)?;
            let predicted = output.displacement.flatten_all()?.to_vec1::<f32>()?;
            let predicted = predicted.chunks_exact(predicted.len() / part.examples.len());
            let pairs = part.examples.iter().zip(predicted);
            let sums = pairs.map(|(one, predicted)| ErrorSums::of(&one.example.label, predicted, self.scale_mm));
            Ok(BatchErrors {
                loss: f64::from(loss.to_scalar::<f32>()?),
                sums: sums.collect(),
            })
        };
        let examples: Vec<Augmented<'_>> = examples.iter().map(|example| Augmented::identity(example)).collect();
        let mut parts: Vec<BatchErrors> = Vec::new();
        for examples in examples.chunks(FROZEN_EXAMPLES.next_multiple_of(size)) {
            let frozen = self.frozen(examples)?;
            let frozen = frozen.as_deref();
            let of_parts = Batch { examples, frozen }.parts(size).into_par_iter().map(errors);
            parts.extend(of_parts.collect::<Result<Vec<BatchErrors>>>()?);
        }
        Ok(BatchErrors {
            loss: parts.iter().map(|part| part.loss).sum(),
            sums: parts.into_iter().flat_map(|part| part.sums).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NetworkKind;
    use crate::parameters::RandomWeights;
    use crate::testing::examples;
    use deaflow_dataset::Split;
    use deaflow_pattern::Raster;

    #[test]
    fn the_gradient_is_that_of_the_mean_loss() {
        let constants = std::collections::BTreeMap::new();
        let weights = RandomWeights::new(&constants, 1);
        let network = NetworkKind::Qin2024
            .build(&weights.builder(), Corners::inner(Raster::PAPER))
            .unwrap();
        let vars = weights.variables();
        let loss = LossWeights {
            maximum: 0.1,
            auxiliary: 0.2,
        };
        let problem = Problem {
            corners: Corners::inner(Raster::PAPER),
            loads: &[1.0],
            network: network.as_ref(),
            vars: &vars,
            loss,
            scale_mm: 0.4,
        };
        // Five examples: a full part and a part of one.
        let examples = examples(5, Split::Train);
        let plain: Vec<&Example> = examples.iter().collect();
        let batch: Vec<Augmented<'_>> = plain.iter().map(|example| Augmented::identity(example)).collect();
        let batch = Batch {
            examples: &batch,
            frozen: None,
        };
        let (sum, gradients) = problem.gradient(batch).unwrap();
        let loss = || problem.errors(&plain).unwrap().loss;
        assert!((sum / loss() - 1.0).abs() < 1e-6);
        // Along the gradient of each weight the mean loss changes by the square of its length.
        for ((name, var), gradient) in vars.iter().zip(&gradients) {
            let square: f32 = gradient.iter().map(|g| g * g).sum();
            let gradient = Tensor::from_slice(gradient, var.shape(), var.device()).unwrap();
            let (start, step) = (var.copy().unwrap(), 1e-4 / f64::from(square));
            let at = |sign: f64| {
                var.set(&(&start + (&gradient * (sign * step)).unwrap()).unwrap())
                    .unwrap();
                loss() / 5.0
            };
            let slope = (at(1.0) - at(-1.0)) / (2.0 * step);
            var.set(&start).unwrap();
            assert!(
                (slope / f64::from(square) - 1.0).abs() < 0.02,
                "{name}: {slope} {square}"
            );
        }
    }

    #[test]
    fn pattern_and_field_of_an_example_are_transformed_alike() {
        let example = &examples(1, Split::Train)[0];
        for symmetry in Symmetry::ALL {
            let augmented = Augmented { example, symmetry };
            assert_eq!(*augmented.pattern(), example.pattern.transformed(symmetry));
            assert_eq!(augmented.label(), example.label.transformed(symmetry));
        }
    }
}
