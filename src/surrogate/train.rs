//! Training: from examples to a network.
//!
//! Descent on the loss of the source paper, the learning rate rising and then falling to zero; the epoch that is best on
//! the validation examples is kept. Everything depends on the examples, the options and the seed alone: a training that is
//! gone on with from a checkpoint ends with the same bits.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};

use super::checkpoint::{Checkpoint, History};
use super::example::Example;
use super::header::Header;
use super::loss::LossWeights;
use super::metrics::{measure, rmse_mm, weighted_rmse_mm};
use super::monitor::Monitor;
use super::networks::{Constants, Network};
use super::optimizer::Optimizer;
use super::options::TrainOptions;
use super::outcome::{Ending, EpochReport, TrainError, Trained};
use super::parameters::Drawn;
use super::schedule::learning_rate_factor;
use super::start::Start;
use super::step::{AHEAD, Batch, Problem, Shown};
use super::weights::to_bytes;
use deaflow_base::Stream;
use deaflow_dataset::{Split, SymmetryGroup};
use deaflow_pattern::{Raster, Symmetry};

/// A loss has exploded when it is so many times that of the untrained network, or of a network that answers zero.
const EXPLOSION: f64 = 10.0;

/// Trains a network on the examples of [`Split::Train`]. A network that [has constants](super::NetworkKind::has_constants)
/// needs those of the scene that the examples were simulated in. `monitor` follows it, and may keep states from which it is gone on
/// with.
///
/// The result has the same bits whatever the number of threads and however often it was interrupted.
///
/// # Errors
/// When there is no training example, an option is out of range, or the training diverges before any epoch was better than the
/// untrained network.
pub fn train(
    examples: &[Example],
    constants: Option<&Constants>,
    options: &TrainOptions,
    monitor: &dyn Monitor,
) -> Result<Trained, TrainError> {
    follow(Trainer::new(examples, constants, options)?, examples, monitor)
}

/// Trains on from a network that was trained before, given by its bytes: as [`train`] does, but from its weights and with its unit of
/// length. The learning rate rises and falls anew.
///
/// # Errors
/// As [`train`], and when the bytes are not those of the same network. "Untrained" is the network as it was given.
pub fn update(
    start: &[u8],
    examples: &[Example],
    constants: Option<&Constants>,
    options: &TrainOptions,
    monitor: &dyn Monitor,
) -> Result<Trained, TrainError> {
    let mut trainer = Trainer::new(examples, constants, options)?;
    let start = Start::read(start, options, trainer.raster)?;
    start.set(&trainer.vars)?;
    trainer.scale_mm = start.scale_mm;
    follow(trainer, examples, monitor)
}

fn follow(mut trainer: Trainer<'_>, examples: &[Example], monitor: &dyn Monitor) -> Result<Trained, TrainError> {
    let untrained = trainer.standing()?;
    if let Some(bytes) = monitor.kept() {
        match Checkpoint::from_bytes(&bytes).filter(|checkpoint| trainer.fits(checkpoint)) {
            Some(checkpoint) => {
                trainer.go_on(checkpoint)?;
                monitor.resumed(trainer.history.curves.len() as u32);
            }
            None => monitor.unusable(),
        }
    }
    let ending = trainer.run(&untrained, monitor)?;
    trainer.finish(examples, &untrained, ending)
}

/// How a network does on the examples by which epochs are judged.
struct Standing {
    /// Mean loss per example.
    loss: f64,
    rmse_mm: f64,
    /// With the examples that are shown more than once, see [`EpochReport::judged_rmse_mm`].
    judged_rmse_mm: f64,
}

/// A training under way.
struct Trainer<'a> {
    options: &'a TrainOptions,
    raster: Raster,
    /// By what examples may be turned, the identity first.
    turns: Vec<Symmetry>,
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
        let most = examples
            .iter()
            .map(|example| example.pattern.groups())
            .max()
            .unwrap_or(0);
        if most > options.loads.len() {
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
        let weights = Drawn::new(&constants, options.seed);
        let network = options.network.build(&weights.builder(), raster)?;
        let vars = weights.variables();
        Ok(Self {
            options,
            raster,
            turns: match options.symmetry {
                SymmetryGroup::D4 => options.symmetries.iter().collect(),
                SymmetryGroup::None => vec![Symmetry::IDENTITY],
            },
            validation: part(Split::Validation),
            scale_mm: network.unit_mm().unwrap_or_else(|| deviation(&training)),
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
            raster: self.raster,
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

    /// Epoch after epoch, from wherever it stands to the end.
    fn run(&mut self, untrained: &Standing, monitor: &dyn Monitor) -> Result<Ending, TrainError> {
        while (self.history.curves.len() as u32) < self.options.epochs {
            let epoch = self.history.curves.len() as u32 + 1;
            if self.is_out_of_patience(epoch) {
                return Ok(Ending::Patience);
            }
            let Some(report) = self.epoch(epoch, untrained, monitor)? else {
                return Ok(Ending::Diverged(epoch));
            };
            let better = self.history.best.is_none_or(|(rmse, _)| report.judged_rmse_mm < rmse);
            if better || self.validation.is_empty() {
                self.history.best = Some((report.judged_rmse_mm, epoch));
                self.best = self.weights()?;
            }
            monitor.epoch(&report);
            self.history.curves.push(report);
            let weights = self.weights()?;
            monitor.keep(&|| self.checkpoint(&weights).to_bytes())?;
        }
        Ok(Ending::Complete)
    }

    /// Whether the epochs before this one have gone without a better one for too long.
    fn is_out_of_patience(&self, epoch: u32) -> bool {
        let curves = &self.history.curves;
        let least = curves
            .iter()
            .min_by(|a, b| a.judged_rmse_mm.total_cmp(&b.judged_rmse_mm));
        match (least, self.options.patience) {
            (Some(least), Some(patience)) => epoch - 1 - least.epoch >= patience,
            _ => false,
        }
    }

    /// One pass over the training examples in random order; none where it diverges.
    fn epoch(
        &mut self,
        epoch: u32,
        untrained: &Standing,
        monitor: &dyn Monitor,
    ) -> Result<Option<EpochReport>, TrainError> {
        let order = self.order(epoch);
        let size = self.options.batch as usize;
        let (before, all) = (u64::from(epoch - 1), u64::from(self.options.epochs));
        let steps = order.len().div_ceil(size) as u64;
        let (mut sum, mut shown, mut learning_rate) = (0.0, 0, 0.0);
        let mut step = before * steps;
        for ahead in order.chunks(size * (AHEAD / size).max(1)) {
            let untrained = self.problem().untrained(ahead)?;
            let ahead = Batch {
                shown: ahead,
                untrained: untrained.as_deref(),
            };
            for batch in ahead.parts(size) {
                learning_rate = self.options.learning_rate * learning_rate_factor(step, all * steps);
                let (loss, gradients) = self.problem().gradient(batch)?;
                if !loss.is_finite() {
                    return Ok(None);
                }
                self.optimizer.step(gradients, learning_rate)?;
                sum += loss;
                shown += batch.shown.len();
                step += 1;
                monitor.step(epoch, shown as f64 / order.len() as f64, sum / shown as f64);
            }
        }
        let (train_loss, standing) = (sum / order.len() as f64, self.standing()?);
        // In the network's unit of length an answer of zero has a loss of about 1.
        let limit = EXPLOSION * untrained.loss.max(1.0);
        if train_loss > limit || !(standing.loss.is_finite() && standing.judged_rmse_mm.is_finite()) {
            return Ok(None);
        }
        Ok(Some(EpochReport {
            epoch,
            train_loss,
            validation_loss: standing.loss,
            validation_rmse_mm: standing.rmse_mm,
            judged_rmse_mm: standing.judged_rmse_mm,
            learning_rate,
        }))
    }

    /// The training examples in the order of an epoch, each turned as that epoch has it.
    fn order(&self, epoch: u32) -> Vec<Shown<'a>> {
        let mut order: Vec<Shown<'a>> = Vec::with_capacity(self.training.len());
        for example in &self.training {
            order.extend(self.repeated(example, epoch));
        }
        let stream = |purpose| Stream::new(self.options.seed, purpose, epoch.into());
        stream("surrogate shuffle").shuffle(&mut order);
        if self.turns.len() > 1 {
            let mut turns = stream("surrogate symmetry");
            order
                .iter_mut()
                .filter(|shown| shown.example.repeats == 1)
                .for_each(|shown| shown.symmetry = self.turns[turns.index(self.turns.len())]);
        }
        order
    }

    /// An example as often as an epoch shows it: where examples are turned, as its images one after the other.
    fn repeated(&self, example: &'a Example, epoch: u32) -> impl Iterator<Item = Shown<'a>> + use<'a> {
        let (repeats, turns) = (example.repeats, self.turns.clone());
        (0..repeats).map(move |k| Shown {
            example,
            symmetry: match repeats {
                1 => Symmetry::IDENTITY,
                _ => turns[(u64::from(epoch) * u64::from(repeats) + u64::from(k)) as usize % turns.len()],
            },
        })
    }

    /// How the weights do on the validation examples, or on the training examples where there are none.
    fn standing(&self) -> Result<Standing, TrainError> {
        if self.validation.is_empty() {
            return self.standing_on(&self.training, &[]);
        }
        let repeated = self.training.iter().filter(|example| example.repeats > 1);
        self.standing_on(&self.validation, &repeated.copied().collect::<Vec<_>>())
    }

    fn standing_on(&self, held_out: &[&Example], repeated: &[&Example]) -> Result<Standing, TrainError> {
        let assessment = self.problem().assess(held_out)?;
        let counted = repeated.iter().map(|example| example.repeats);
        let counted = self.problem().assess(repeated)?.agreements.into_iter().zip(counted);
        let once = assessment.agreements.iter().map(|agreement| (*agreement, 1));
        let rmse_mm = rmse_mm(&assessment.agreements);
        Ok(Standing {
            loss: assessment.loss / held_out.len() as f64,
            rmse_mm,
            judged_rmse_mm: match repeated {
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

    /// Whether a checkpoint has the tensors of this network and optimiser.
    fn fits(&self, checkpoint: &Checkpoint) -> bool {
        let own = self.vars.iter().map(|(_, var)| var.elem_count());
        let alike = |other: &[Vec<f32>]| own.clone().eq(other.iter().map(Vec::len));
        let means = self.optimizer.means().into_iter().map(<[f32]>::len);
        alike(&checkpoint.weights)
            && alike(&checkpoint.best)
            && means.eq(checkpoint.means.iter().map(Vec::len))
            && checkpoint.history.curves.len() as u32 <= self.options.epochs
    }

    fn go_on(&mut self, checkpoint: Checkpoint) -> Result<(), TrainError> {
        self.set_weights(&checkpoint.weights)?;
        self.optimizer.go_on(checkpoint.history.steps, checkpoint.means);
        self.best = checkpoint.best;
        self.history = checkpoint.history;
        Ok(())
    }

    /// The kept epoch with its metrics.
    fn finish(self, examples: &[Example], untrained: &Standing, ending: Ending) -> Result<Trained, TrainError> {
        let best = self.history.best.filter(|(rmse_mm, _)| match ending {
            Ending::Diverged(_) => *rmse_mm < untrained.judged_rmse_mm,
            Ending::Complete | Ending::Patience => true,
        });
        let (_, best_epoch) = match (best, ending) {
            (Some(best), _) => best,
            (None, Ending::Diverged(epoch)) => return Err(TrainError::Diverged { epoch }),
            (None, _) => return Err(TrainError::NoExamples),
        };
        self.set_weights(&self.best)?;
        let assessment = self.problem().assess(&examples.iter().collect::<Vec<_>>())?;
        Ok(Trained {
            weights: self.bytes()?,
            metrics: measure(examples, &assessment.agreements),
            curves: self.history.curves,
            best_epoch,
            ending,
        })
    }

    fn bytes(&self) -> Result<Vec<u8>, TrainError> {
        let trained = self.vars.iter();
        let trained = trained.map(|(name, var)| (name.clone(), var.as_tensor().clone()));
        let header = Header::new(
            self.options.network.name(),
            self.raster,
            &self.options.loads,
            self.scale_mm,
        );
        to_bytes(&header, &trained.collect(), &self.constants).map_err(|e| TrainError::Failed(e.to_string()))
    }
}

/// The root mean square of the displacement components in mm: the unit in which the network answers. 1 mm where nothing
/// moves.
fn deviation(examples: &[&Example]) -> f64 {
    let squares: f64 = examples.iter().map(|example| example.label.squares()).sum();
    let components: usize = examples
        .iter()
        .map(|example| 2 * example.label.raster().corners())
        .sum();
    let deviation = (squares / components as f64).sqrt();
    if deviation > 0.0 { deviation } else { 1.0 }
}

#[cfg(test)]
mod tests;
