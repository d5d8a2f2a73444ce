//! One step of a training: the gradient of the loss over a batch.
//!
//! The batch is split into parts of fixed size; threads take parts, and what the parts give is added in the order of the
//! parts, so the sum has the same bits whatever the number of threads.

use std::borrow::Cow;

use candle_core::{Result, Tensor, Var};
use rayon::prelude::*;

use super::encode::{labels_to_tensor, patterns_to_tensor};
use super::example::{Example, Label};
use super::loss::{LossWeights, total_loss};
use super::metrics::Agreement;
use super::networks::{Network, Output};
use deaflow_pattern::{Pattern, Raster, Symmetry};

/// What a training step and its assessment need beside the examples.
pub(crate) struct Problem<'a> {
    /// The cells of its patterns.
    pub(crate) raster: Raster,
    /// The share of the largest load that each group of electrodes has.
    pub(crate) loads: &'a [f64],
    /// The network.
    pub(crate) network: &'a dyn Network,
    /// Its weights.
    pub(crate) vars: &'a [(String, Var)],
    /// The weights of the loss.
    pub(crate) loss: LossWeights,
    /// Length in mm of one unit of the network's output.
    pub(crate) scale_mm: f64,
}

/// An example as a network is shown it.
#[derive(Clone, Copy)]
pub(crate) struct Shown<'a> {
    /// The example.
    pub(crate) example: &'a Example,
    /// By what it is turned.
    pub(crate) symmetry: Symmetry,
}

impl<'a> Shown<'a> {
    /// As it stands in the dataset.
    pub(crate) fn upright(example: &'a Example) -> Self {
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

/// Examples of which is known at a time what is not trained of their answers: 10 MB on the paper's membrane.
pub(crate) const AHEAD: usize = 512;
/// Of which it is computed together.
const TOGETHER: usize = 64;

/// Examples that are shown, with what is not trained of the answers to them, where that is known.
#[derive(Clone, Copy)]
pub(crate) struct Batch<'a> {
    /// The examples.
    pub(crate) shown: &'a [Shown<'a>],
    /// Equally many numbers for each, one example after the other.
    pub(crate) untrained: Option<&'a [f32]>,
}

impl<'a> Batch<'a> {
    /// In parts of so many examples, of which the last may have fewer.
    pub(crate) fn parts(self, size: usize) -> Vec<Self> {
        let each = self.untrained.map_or(0, |all| all.len() / self.shown.len());
        let parts = self.shown.chunks(size).enumerate();
        let part = |(at, shown): (usize, &'a [Shown<'a>])| Self {
            shown,
            untrained: self.untrained.map(|all| &all[at * size * each..][..shown.len() * each]),
        };
        parts.map(part).collect()
    }
}

/// A loss summed over examples, and the gradient of its mean with respect to each weight, all its values in a row.
///
/// Plain numbers, because candle hands sums of large tensors to threads of its own, for which those of this room would wait one
/// after the other.
struct Gradient {
    loss: f64,
    gradients: Vec<Vec<f32>>,
}

/// How a network does on some examples.
pub(crate) struct BatchErrors {
    /// The loss summed over them.
    pub(crate) loss: f64,
    /// The agreement of each prediction.
    pub(crate) agreements: Vec<Agreement>,
}

impl Problem<'_> {
    /// What of the answers to some examples is not trained, one example after the other; none where all of it is.
    pub(crate) fn untrained(&self, shown: &[Shown<'_>]) -> Result<Option<Vec<f32>>> {
        let parts = shown.par_chunks(TOGETHER);
        let parts = parts.map(|part| self.network.untrained(&self.patterns(part)?));
        let parts: Vec<Option<Vec<f32>>> = parts.collect::<Result<_>>()?;
        Ok(parts
            .into_iter()
            .collect::<Option<Vec<Vec<f32>>>>()
            .map(|parts| parts.concat()))
    }

    /// The loss summed over a batch, and the gradient of its mean with respect to each weight, all its values in a row.
    pub(crate) fn gradient(&self, batch: Batch<'_>) -> Result<(f64, Vec<Vec<f32>>)> {
        let share = 1.0 / batch.shown.len() as f64;
        let parts = batch.parts(self.network.examples_per_part());
        let parts = parts.into_par_iter().map(|part| self.part(part, share));
        let parts: Vec<Gradient> = parts.collect::<Result<_>>()?;
        let loss = parts.iter().map(|part| part.loss).sum();
        let sum_of = |i: usize| {
            let mut sum = parts[0].gradients[i].clone();
            for part in &parts[1..] {
                sum.iter_mut().zip(&part.gradients[i]).for_each(|(sum, g)| *sum += g);
            }
            sum
        };
        let gradients = (0..self.vars.len()).into_par_iter().map(sum_of).collect();
        Ok((loss, gradients))
    }

    fn part(&self, part: Batch<'_>, share: f64) -> Result<Gradient> {
        let (_, loss) = self.answer(part)?;
        let mut store = (&loss * share)?.backward()?;
        let gradient = |(_, var): &(String, Var)| match store.remove(var) {
            Some(gradient) => gradient.flatten_all()?.to_vec1::<f32>(),
            None => Ok(vec![0.0; var.elem_count()]),
        };
        Ok(Gradient {
            loss: f64::from(loss.to_scalar::<f32>()?),
            gradients: self.vars.iter().map(gradient).collect::<Result<_>>()?,
        })
    }

    /// The patterns of examples as a network sees them.
    fn patterns(&self, shown: &[Shown<'_>]) -> Result<Tensor> {
        let patterns: Vec<Cow<'_, Pattern>> = shown.iter().map(|shown| shown.pattern()).collect();
        patterns_to_tensor(self.raster, self.loads, patterns.iter().map(AsRef::as_ref))
    }

    /// What the network answers, and the loss summed over the examples.
    fn answer(&self, part: Batch<'_>) -> Result<(Output, Tensor)> {
        let patterns = self.patterns(part.shown)?;
        let labels: Vec<Label> = part.shown.iter().map(|shown| shown.label()).collect();
        let labels = labels_to_tensor(self.raster, &labels, self.scale_mm)?;
        let output = self.network.forward_for_training(&patterns, part.untrained)?;
        let loss = total_loss(&output, &labels, self.loss)?;
        Ok((output, loss))
    }

    /// The loss and the agreement of each example, without gradients.
    pub(crate) fn assess(&self, examples: &[&Example]) -> Result<BatchErrors> {
        let size = self.network.examples_per_part();
        let assess = |part: Batch<'_>| {
            let (output, loss) = self.answer(part)?;
            let predicted = output.displacement.flatten_all()?.to_vec1::<f32>()?;
            let predicted = predicted.chunks_exact(predicted.len() / part.shown.len());
            let pairs = part.shown.iter().zip(predicted);
            Ok(BatchErrors {
                loss: f64::from(loss.to_scalar::<f32>()?),
                agreements: pairs
                    .map(|(shown, predicted)| Agreement::of(&shown.example.label, predicted, self.scale_mm))
                    .collect(),
            })
        };
        let shown: Vec<Shown<'_>> = examples.iter().map(|example| Shown::upright(example)).collect();
        let mut parts: Vec<BatchErrors> = Vec::new();
        for shown in shown.chunks(AHEAD.next_multiple_of(size)) {
            let untrained = self.untrained(shown)?;
            let batch = Batch {
                shown,
                untrained: untrained.as_deref(),
            };
            let assessed = batch.parts(size).into_par_iter().map(assess);
            parts.extend(assessed.collect::<Result<Vec<BatchErrors>>>()?);
        }
        Ok(BatchErrors {
            loss: parts.iter().map(|part| part.loss).sum(),
            agreements: parts.into_iter().flat_map(|part| part.agreements).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NetworkKind;
    use crate::parameters::Drawn;
    use crate::testing::examples;
    use deaflow_dataset::Split;

    #[test]
    fn the_gradient_is_that_of_the_mean_loss() {
        let constants = std::collections::BTreeMap::new();
        let weights = Drawn::new(&constants, 1);
        let network = NetworkKind::Qin2024.build(&weights.builder(), Raster::PAPER).unwrap();
        let vars = weights.variables();
        let loss = LossWeights {
            maximum: 0.1,
            auxiliary: 0.2,
        };
        let problem = Problem {
            raster: Raster::PAPER,
            loads: &[1.0],
            network: network.as_ref(),
            vars: &vars,
            loss,
            scale_mm: 0.4,
        };
        // Five examples: a full part and a part of one.
        let examples = examples(5, Split::Train);
        let plain: Vec<&Example> = examples.iter().collect();
        let batch: Vec<Shown<'_>> = plain.iter().map(|example| Shown::upright(example)).collect();
        let (sum, gradients) = problem
            .gradient(Batch {
                shown: &batch,
                untrained: None,
            })
            .unwrap();
        let loss = || problem.assess(&plain).unwrap().loss;
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
    fn a_turned_example_is_shown_with_its_field_turned_alike() {
        let example = &examples(1, Split::Train)[0];
        for symmetry in Symmetry::ALL {
            let (shown, image) = (Shown { example, symmetry }, example.transformed(symmetry));
            assert_eq!((&*shown.pattern(), &shown.label()), (&image.pattern, &image.label));
        }
    }
}
