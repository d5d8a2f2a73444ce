//! Training of networks.
//!
//! Training minimises the loss of the source paper with a learning rate that rises and then falls to zero, and keeps
//! the epoch with the smallest validation error. The result depends on the examples, the options and the seed only: a
//! training that resumes from a checkpoint gives the same bits.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};

use super::checkpoint::{Checkpoint, History};
use super::corners::Corners;
use super::example::Example;
use super::header::Header;
use super::loss::LossWeights;
use super::metrics::{measure, rmse_mm, weighted_rmse_mm};
use super::monitor::Monitor;
use super::networks::{Constants, Network};
use super::optimizer::Optimizer;
use super::options::TrainOptions;
use super::outcome::{Ending, EpochReport, TrainError, Trained};
use super::parameters::RandomWeights;
use super::schedule::learning_rate_factor;
use super::step::{Augmented, Batch, FROZEN_EXAMPLES, Problem};
use super::warm_start::WarmStart;
use super::weights::to_bytes;
use deaflow_base::Stream;
use deaflow_dataset::{Split, SymmetryGroup};
use deaflow_pattern::Symmetry;

/// The loss has exploded when it exceeds that of the untrained network, or of the prediction zero, by this factor.
const EXPLOSION: f64 = 10.0;

/// Trains a network on the examples of [`Split::Train`]. A network that [has
/// constants](super::NetworkKind::has_constants) needs those of the scene of the examples. `monitor` receives the
/// progress and may store checkpoints, from which an interrupted training resumes.
///
/// The result has the same bits for any number of threads and interruptions.
///
/// # Errors
/// When there are no training examples, an option is out of range, or the training diverges before any epoch improves
/// on the untrained network.
pub fn train(
    examples: &[Example],
    constants: Option<&Constants>,
    options: &TrainOptions,
    monitor: &dyn Monitor,
) -> Result<Trained, TrainError> {
    run(Trainer::new(examples, constants, options)?, examples, monitor)
}

/// Continues the training of a trained network, a model file, with its weights and its unit of length. The learning
/// rate rises and falls again.
///
/// # Errors
/// As [`train`], where "untrained" is the given network; and when the model does not match the options and examples.
pub fn update(
    model: &[u8],
    examples: &[Example],
    constants: Option<&Constants>,
    options: &TrainOptions,
    monitor: &dyn Monitor,
) -> Result<Trained, TrainError> {
    let mut trainer = Trainer::new(examples, constants, options)?;
    let start = WarmStart::read(model, options, trainer.corners)?;
    start.set(&trainer.vars)?;
    trainer.scale_mm = start.scale_mm;
    run(trainer, examples, monitor)
}

fn run(mut trainer: Trainer<'_>, examples: &[Example], monitor: &dyn Monitor) -> Result<Trained, TrainError> {
    let initial = trainer.validation_errors()?;
    if let Some(bytes) = monitor.checkpoint() {
        match Checkpoint::from_bytes(&bytes).filter(|checkpoint| trainer.fits(checkpoint)) {
            Some(checkpoint) => {
                trainer.resume(checkpoint)?;
                monitor.resumed(trainer.history.curves.len() as u32);
            }
            None => monitor.unusable_checkpoint(),
        }
    }
    let ending = trainer.epochs(&initial, monitor)?;
    trainer.finish(examples, &initial, ending)
}

/// Errors on the validation examples.
struct ValidationErrors {
    /// Mean loss per example.
    loss: f64,
    rmse_mm: f64,
    /// See [`EpochReport::selection_rmse_mm`].
    selection_rmse_mm: f64,
}

/// A training in progress.
struct Trainer<'a> {
    options: &'a TrainOptions,
    corners: Corners,
    /// Symmetries of the data augmentation, the identity first.
    symmetries: Vec<Symmetry>,
    training: Vec<&'a Example>,
    validation: Vec<&'a Example>,
    scale_mm: f64,
    network: Box<dyn Network>,
    vars: Vec<(String, Var)>,
    constants: BTreeMap<String, Tensor>,
    optimizer: Optimizer,
    history: History,
    /// Weights of the best epoch.
    best: Vec<Vec<f32>>,
}

impl<'a> Trainer<'a> {
    fn new(
        examples: &'a [Example],
        constants: Option<&Constants>,
        options: &'a TrainOptions,
    ) -> Result<Self, TrainError> {
        options.check()?;
        let part = |split| examples.iter().filter(|e| e.split == split).collect::<Vec<_>>();
        let training = part(Split::Train);
        let Some(first) = training.first() else {
            return Err(TrainError::NoExamples);
        };
        let raster = first.pattern.raster();
        if let Some(other) = examples.iter().find(|example| example.pattern.raster() != raster) {
            return Err(TrainError::Rasters([raster, other.pattern.raster()]));
        }
        let groups = examples.iter().map(|example| example.pattern.groups()).max();
        if let Some(most) = groups.filter(|most| *most > options.loads.len()) {
            return Err(TrainError::Groups([options.loads.len(), most]));
        }
        let constants = match (options.network.has_constants(), constants) {
            (false, _) => BTreeMap::new(),
            (true, Some(constants)) => constants.tensors.clone(),
            (true, None) => {
                let network = options.network.name();
                return Err(TrainError::NoConstants { network });
            }
        };
        let weights = RandomWeights::new(&constants, options.seed);
        let corners = options
            .sides
            .map_or(Corners::inner(raster), |held| Corners::all(raster, held));
        let network = options.network.build(&weights.builder(), corners)?;
        let vars = weights.variables();
        Ok(Self {
            options,
            corners,
            symmetries: match options.symmetry {
                SymmetryGroup::D4 => options.symmetries.iter().collect(),
                SymmetryGroup::None => vec![Symmetry::IDENTITY],
            },
            validation: part(Split::Validation),
            scale_mm: network.unit_mm().unwrap_or_else(|| rms_displacement(&training)),
            training,
            network,
            optimizer: Optimizer::new(options, vars.iter().map(|(_, var)| var.clone())),
            vars,
            constants,
            history: History::default(),
            best: Vec::new(),
        })
    }

    fn problem(&self) -> Problem<'_> {
        Problem {
            corners: self.corners,
            loads: &self.options.loads,
            network: self.network.as_ref(),
            vars: &self.vars,
            loss: LossWeights {
                maximum: self.options.max_weight,
                auxiliary: self.options.auxiliary_weight,
            },
            scale_mm: self.scale_mm,
        }
    }

    /// Runs the remaining epochs.
    fn epochs(&mut self, initial: &ValidationErrors, monitor: &dyn Monitor) -> Result<Ending, TrainError> {
        while (self.history.curves.len() as u32) < self.options.epochs {
            let epoch = self.history.curves.len() as u32 + 1;
            if self.is_out_of_patience(epoch) {
                return Ok(Ending::Patience);
            }
            let Some(report) = self.epoch(epoch, initial, monitor)? else {
                return Ok(Ending::Diverged(epoch));
            };
            let error = report.selection_rmse_mm;
            let is_better = self.history.best.is_none_or(|(least, _)| error < least);
            if is_better || self.validation.is_empty() {
                self.history.best = Some((error, epoch));
                self.best = self.weights()?;
            }
            monitor.epoch(&report);
            self.history.curves.push(report);
            let weights = self.weights()?;
            monitor.store_checkpoint(&|| self.checkpoint(&weights).to_bytes())?;
        }
        Ok(Ending::Complete)
    }

    /// Returns whether the best epoch is too many epochs before this one.
    fn is_out_of_patience(&self, epoch: u32) -> bool {
        let curves = self.history.curves.iter();
        let best = curves.min_by(|a, b| a.selection_rmse_mm.total_cmp(&b.selection_rmse_mm));
        match (best, self.options.patience) {
            (Some(best), Some(patience)) => epoch - 1 - best.epoch >= patience,
            _ => false,
        }
    }

    /// Makes one pass over the training examples in random order; `None` when the loss diverges.
    fn epoch(
        &mut self,
        epoch: u32,
        initial: &ValidationErrors,
        monitor: &dyn Monitor,
    ) -> Result<Option<EpochReport>, TrainError> {
        let order = self.order(epoch);
        let size = self.options.batch as usize;
        let (before, all) = (u64::from(epoch - 1), u64::from(self.options.epochs));
        let steps = order.len().div_ceil(size) as u64;
        let (mut sum, mut finished, mut learning_rate) = (0.0, 0, 0.0);
        let mut step = before * steps;
        for examples in order.chunks(size * (FROZEN_EXAMPLES / size).max(1)) {
            let frozen = self.problem().frozen(examples)?;
            let frozen = frozen.as_deref();
            for batch in (Batch { examples, frozen }).parts(size) {
                learning_rate = self.options.learning_rate * learning_rate_factor(step, all * steps);
                let (loss, gradients) = self.problem().gradient(batch)?;
                if !loss.is_finite() {
                    return Ok(None);
                }
                self.optimizer.step(gradients, learning_rate)?;
                sum += loss;
                finished += batch.examples.len();
                step += 1;
                monitor.step(epoch, finished as f64 / order.len() as f64, sum / finished as f64);
            }
        }
        let (train_loss, errors) = (sum / order.len() as f64, self.validation_errors()?);
        // In the network's unit of length the prediction zero has a loss of about 1.
        let limit = EXPLOSION * initial.loss.max(1.0);
        if train_loss > limit || !(errors.loss.is_finite() && errors.selection_rmse_mm.is_finite()) {
            return Ok(None);
        }
        Ok(Some(EpochReport {
            epoch,
            train_loss,
            validation_loss: errors.loss,
            validation_rmse_mm: errors.rmse_mm,
            selection_rmse_mm: errors.selection_rmse_mm,
            learning_rate,
        }))
    }

    /// Returns the training examples in the order of an epoch, transformed by its symmetries.
    fn order(&self, epoch: u32) -> Vec<Augmented<'a>> {
        let repeats = self.training.iter().flat_map(|example| self.repeats(example, epoch));
        let mut order: Vec<Augmented<'a>> = repeats.collect();
        let stream = |purpose| Stream::new(self.options.seed, purpose, epoch.into());
        stream("surrogate shuffle").shuffle(&mut order);
        if self.symmetries.len() > 1 {
            let mut stream = stream("surrogate symmetry");
            for augmented in order.iter_mut().filter(|augmented| augmented.example.repeats == 1) {
                augmented.symmetry = self.symmetries[stream.index(self.symmetries.len())];
            }
        }
        order
    }

    /// Returns an example as many times as an epoch uses it. A repeated example takes the symmetries in turn.
    fn repeats(&self, example: &'a Example, epoch: u32) -> impl Iterator<Item = Augmented<'a>> {
        let repeats = example.repeats;
        (0..repeats).map(move |k| Augmented {
            example,
            symmetry: match repeats {
                1 => Symmetry::IDENTITY,
                _ => {
                    let number = u64::from(epoch) * u64::from(repeats) + u64::from(k);
                    self.symmetries[number as usize % self.symmetries.len()]
                }
            },
        })
    }

    /// Computes the errors on the validation examples, or on the training examples where there are none.
    fn validation_errors(&self) -> Result<ValidationErrors, TrainError> {
        if self.validation.is_empty() {
            return self.errors_on(&self.training, &[]);
        }
        let repeated = self.training.iter().filter(|example| example.repeats > 1);
        self.errors_on(&self.validation, &repeated.copied().collect::<Vec<_>>())
    }

    fn errors_on(&self, held_out: &[&Example], repeated: &[&Example]) -> Result<ValidationErrors, TrainError> {
        let errors = self.problem().errors(held_out)?;
        let counts = repeated.iter().map(|example| example.repeats);
        let counted = self.problem().errors(repeated)?.sums.into_iter().zip(counts);
        let once = errors.sums.iter().map(|sums| (*sums, 1));
        let rmse_mm = rmse_mm(&errors.sums);
        Ok(ValidationErrors {
            loss: errors.loss / held_out.len() as f64,
            rmse_mm,
            selection_rmse_mm: match repeated {
                [] => rmse_mm,
                _ => weighted_rmse_mm(once.chain(counted)),
            },
        })
    }

    fn weights(&self) -> Result<Vec<Vec<f32>>, TrainError> {
        let values = |(_, var): &(String, Var)| Ok(var.flatten_all()?.to_vec1()?);
        self.vars.iter().map(values).collect()
    }

    fn set_weights(&self, weights: &[Vec<f32>]) -> Result<(), TrainError> {
        let set = |((_, var), values): (&(String, Var), &Vec<f32>)| {
            Ok(var.set(&Tensor::from_slice(values, var.shape(), &Device::Cpu)?)?)
        };
        self.vars.iter().zip(weights).try_for_each(set)
    }

    fn checkpoint(&self, weights: &[Vec<f32>]) -> Checkpoint {
        Checkpoint {
            history: History {
                steps: self.optimizer.steps(),
                ..self.history.clone()
            },
            weights: weights.to_vec(),
            best: self.best.clone(),
            means: self.optimizer.means().into_iter().map(<[f32]>::to_vec).collect(),
        }
    }

    /// Returns whether a checkpoint has the tensors of this network and optimiser.
    fn fits(&self, checkpoint: &Checkpoint) -> bool {
        let lengths = self.vars.iter().map(|(_, var)| var.elem_count());
        let fits = |other: &[Vec<f32>]| lengths.clone().eq(other.iter().map(Vec::len));
        let means = self.optimizer.means().into_iter().map(<[f32]>::len);
        fits(&checkpoint.weights)
            && fits(&checkpoint.best)
            && means.eq(checkpoint.means.iter().map(Vec::len))
            && checkpoint.history.curves.len() as u32 <= self.options.epochs
    }

    fn resume(&mut self, checkpoint: Checkpoint) -> Result<(), TrainError> {
        self.set_weights(&checkpoint.weights)?;
        self.optimizer.resume(checkpoint.history.steps, checkpoint.means);
        self.best = checkpoint.best;
        self.history = checkpoint.history;
        Ok(())
    }

    /// Returns the network of the best epoch with its metrics.
    fn finish(self, examples: &[Example], initial: &ValidationErrors, ending: Ending) -> Result<Trained, TrainError> {
        let best = self.history.best.filter(|(rmse_mm, _)| match ending {
            Ending::Diverged(_) => *rmse_mm < initial.selection_rmse_mm,
            Ending::Complete | Ending::Patience => true,
        });
        let (_, best_epoch) = match (best, ending) {
            (Some(best), _) => best,
            (None, Ending::Diverged(epoch)) => return Err(TrainError::Diverged { epoch }),
            (None, _) => return Err(TrainError::NoExamples),
        };
        self.set_weights(&self.best)?;
        let errors = self.problem().errors(&examples.iter().collect::<Vec<_>>())?;
        Ok(Trained {
            weights: self.bytes()?,
            metrics: measure(examples, &errors.sums),
            curves: self.history.curves,
            best_epoch,
            ending,
        })
    }

    fn bytes(&self) -> Result<Vec<u8>, TrainError> {
        let tensor = |(name, var): &(String, Var)| (name.clone(), var.as_tensor().clone());
        let trained = self.vars.iter().map(tensor).collect();
        let network = self.options.network.name();
        let header = Header::new(network, self.corners, &self.options.loads, self.scale_mm);
        to_bytes(&header, &trained, &self.constants).map_err(|e| TrainError::Failed(e.to_string()))
    }
}

/// Returns the root mean square of the displacement components in mm, the unit of the network output; 1 mm where
/// nothing moves.
fn rms_displacement(examples: &[&Example]) -> f64 {
    let squares: f64 = examples.iter().map(|example| example.label.squares()).sum();
    let components = examples.iter().map(|example| 2 * example.label.raster().corners());
    let rms = (squares / components.sum::<usize>() as f64).sqrt();
    if rms > 0.0 { rms } else { 1.0 }
}

#[cfg(test)]
mod tests;
