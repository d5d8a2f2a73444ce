//! Training: from examples to a network.
//!
//! Descent on the loss of the source paper, the learning rate rising and then falling to zero; the epoch that is best on
//! the validation examples is kept. Everything depends on the examples, the options and the seed alone.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};

use super::example::Example;
use super::loss::LossWeights;
use super::metrics::{Metrics, measure};
use super::networks::{Constants, Network};
use super::optimizer::Optimizer;
use super::options::TrainOptions;
use super::parameters::Parameters;
use super::predict::{device, evaluate};
use super::schedule::learning_rate_factor;
use super::step::Problem;
use super::weights::{Header, to_bytes};
use crate::base::Stream;
use crate::dataset::Split;
use crate::field::{Field, PredictError};

/// What an epoch came to.
#[derive(Clone, Debug, PartialEq)]
pub struct EpochReport {
    /// Number of the epoch, from 1.
    pub epoch: u32,
    /// Mean loss per example over the epoch, while the weights were changing.
    pub train_loss: f64,
    /// Mean loss per validation example after the epoch; per training example where there is no validation example.
    pub validation_loss: f64,
    /// Root mean square error in mm, over both components at all corners, of the same examples after the epoch.
    pub validation_rmse_mm: f64,
    /// Learning rate of the last step.
    pub learning_rate: f64,
}

/// A trained network with the record of its training.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The network as safetensors; [`super::Surrogate::load`] reads it.
    pub weights: Vec<u8>,
    /// One report per epoch.
    pub curves: Vec<EpochReport>,
    /// Metrics of the kept epoch: for each part of the dataset "all", then the families by name; groups without examples
    /// are left out.
    pub metrics: Vec<Metrics>,
    /// The epoch that was kept: the best on the validation examples, or the last where there are none.
    pub best_epoch: u32,
}

/// A training that could not be done.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// Nothing to learn from.
    #[error("there are no training examples")]
    NoExamples,
    /// An option out of its range.
    #[error("{name} is {value}; it must be {allowed}")]
    Option {
        /// Which option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// A network that starts from what is known of the scene was not told it.
    #[error("the network {network} needs the linear response of the scene")]
    NoConstants {
        /// The network.
        network: &'static str,
    },
    /// The loss is no longer a number.
    #[error("the training diverged in epoch {epoch}; a smaller learning rate may help")]
    Diverged {
        /// The epoch.
        epoch: u32,
    },
    /// What the numerical library reported.
    #[error("the training failed: {0}")]
    Failed(String),
}

impl From<candle_core::Error> for TrainError {
    fn from(error: candle_core::Error) -> Self {
        Self::Failed(error.to_string())
    }
}

impl From<PredictError> for TrainError {
    fn from(error: PredictError) -> Self {
        Self::Failed(error.0)
    }
}

/// Trains a network on the examples of [`Split::Train`], calling `on_epoch` after each epoch. A network that
/// [has constants](super::NetworkKind::has_constants) needs those of the scene that the examples were simulated in.
///
/// The result has the same bits whatever the number of threads.
///
/// # Errors
/// When there is no training example, an option is out of range, or the training diverges.
pub fn train(
    examples: &[Example],
    constants: Option<&Constants>,
    options: &TrainOptions,
    on_epoch: &dyn Fn(&EpochReport),
) -> Result<Trained, TrainError> {
    options.check()?;
    let mut trainer = Trainer::new(examples, constants, options)?;
    let mut curves: Vec<EpochReport> = Vec::new();
    let mut best: Option<(f64, u32, Vec<Tensor>)> = None;
    for epoch in 1..=options.epochs {
        let report = trainer.epoch(epoch)?;
        on_epoch(&report);
        let measured = !trainer.validation.is_empty();
        if best
            .as_ref()
            .is_none_or(|(rmse, ..)| !measured || report.validation_rmse_mm < *rmse)
        {
            best = Some((report.validation_rmse_mm, epoch, trainer.snapshot()?));
        }
        curves.push(report);
    }
    let (_, best_epoch, weights) = best.ok_or(TrainError::NoExamples)?;
    trainer.restore(&weights)?;
    Ok(Trained {
        weights: trainer.bytes()?,
        curves,
        metrics: measure(examples, &trainer.predict(&examples.iter().collect::<Vec<_>>())?),
        best_epoch,
    })
}

/// A training under way.
struct Trainer<'a> {
    options: &'a TrainOptions,
    training: Vec<&'a Example>,
    validation: Vec<&'a Example>,
    scale_mm: f64,
    device: Device,
    network: Box<dyn Network>,
    vars: Vec<(String, Var)>,
    constants: BTreeMap<String, Tensor>,
    optimizer: Optimizer,
}

impl<'a> Trainer<'a> {
    fn new(
        examples: &'a [Example],
        constants: Option<&Constants>,
        options: &'a TrainOptions,
    ) -> Result<Self, TrainError> {
        let part = |split| examples.iter().filter(|e| e.split == split).collect::<Vec<_>>();
        let training = part(Split::Train);
        if training.is_empty() {
            return Err(TrainError::NoExamples);
        }
        let device = device()?;
        let constants = match (options.network.has_constants(), constants) {
            (false, _) => BTreeMap::new(),
            (true, Some(constants)) => constants.tensors.clone(),
            (true, None) => {
                let network = options.network.name();
                return Err(TrainError::NoConstants { network });
            }
        };
        let mut parameters = Parameters::drawn(constants.clone(), options.seed, &device);
        let network = options.network.build(&mut parameters)?;
        let vars = parameters.into_drawn();
        Ok(Self {
            options,
            validation: part(Split::Validation),
            scale_mm: network.unit_mm().unwrap_or_else(|| deviation(&training)),
            constants,
            training,
            device,
            network,
            optimizer: Optimizer::new(vars.iter().map(|(_, var)| var.clone())),
            vars,
        })
    }

    fn problem(&self) -> Problem<'_> {
        Problem {
            network: self.network.as_ref(),
            vars: &self.vars,
            loss: LossWeights {
                maximum: self.options.max_weight,
                auxiliary: self.options.auxiliary_weight,
            },
            scale_mm: self.scale_mm,
            device: &self.device,
        }
    }

    /// One pass over the training examples in random order.
    fn epoch(&mut self, epoch: u32) -> Result<EpochReport, TrainError> {
        let mut order = self.training.clone();
        Stream::new(self.options.seed, "surrogate shuffle", epoch.into()).shuffle(&mut order);
        let batches: Vec<_> = order.chunks(self.options.batch as usize).collect();
        let (before, all) = (u64::from(epoch - 1), u64::from(self.options.epochs));
        let steps = batches.len() as u64;
        let (mut sum, mut learning_rate) = (0.0, 0.0);
        for (step, batch) in (before * steps..).zip(batches) {
            learning_rate = self.options.learning_rate * learning_rate_factor(step, all * steps);
            let (loss, gradients) = self.problem().gradient(batch)?;
            self.optimizer.step(&gradients, learning_rate)?;
            sum += loss;
        }
        let held_out = if self.validation.is_empty() {
            &self.training
        } else {
            &self.validation
        };
        let validation_loss = self.problem().loss(held_out)? / held_out.len() as f64;
        if !(f64::is_finite(sum) && validation_loss.is_finite()) {
            return Err(TrainError::Diverged { epoch });
        }
        Ok(EpochReport {
            epoch,
            train_loss: sum / order.len() as f64,
            validation_loss,
            validation_rmse_mm: self.rmse(held_out)?,
            learning_rate,
        })
    }

    fn predict(&self, examples: &[&Example]) -> Result<Vec<Field>, TrainError> {
        let patterns: Vec<_> = examples.iter().map(|e| &e.pattern).collect();
        Ok(evaluate(self.network.as_ref(), self.scale_mm, &patterns, &self.device)?)
    }

    fn rmse(&self, examples: &[&Example]) -> Result<f64, TrainError> {
        let predicted = self.predict(examples)?;
        let errors = examples
            .iter()
            .zip(&predicted)
            .map(|(e, p)| e.field.rms_difference(p).powi(2));
        Ok((errors.sum::<f64>() / examples.len() as f64).sqrt())
    }

    fn snapshot(&self) -> Result<Vec<Tensor>, TrainError> {
        self.vars.iter().map(|(_, var)| Ok(var.copy()?)).collect()
    }

    fn restore(&self, weights: &[Tensor]) -> Result<(), TrainError> {
        self.vars
            .iter()
            .zip(weights)
            .try_for_each(|((_, var), value)| Ok(var.set(value)?))
    }

    fn bytes(&self) -> Result<Vec<u8>, TrainError> {
        let trained = self.vars.iter();
        let trained = trained.map(|(name, var)| (name.clone(), var.as_tensor().clone()));
        let tensors = trained.chain(self.constants.clone()).collect();
        let header = Header {
            network: self.options.network.name().to_owned(),
            scale_mm: self.scale_mm,
        };
        to_bytes(&header, &tensors).map_err(TrainError::Failed)
    }
}

/// The root mean square of the displacement components in mm: the unit in which the network answers. 1 mm where nothing
/// moves.
fn deviation(examples: &[&Example]) -> f64 {
    let still = Field::zero();
    let squares = examples.iter().map(|e| e.field.rms_difference(&still).powi(2));
    let deviation = (squares.sum::<f64>() / examples.len() as f64).sqrt();
    if deviation > 0.0 { deviation } else { 1.0 }
}

#[cfg(test)]
mod tests;
