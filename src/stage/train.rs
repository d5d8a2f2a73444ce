//! `kind: train` trains a surrogate on balanced datasets, on solved samples as they are, and on verified designs; from nothing, or from
//! the weights of a training that it needs.

mod content;
mod examples;
mod follow;

use super::results::named;
use super::{model, needs};
use follow::Follow;

use deaflow_base::{Canonical, Decimal, Declared, Fields, InputError, Node, NodeValue, Seed, parameters};
use deaflow_content::{ALL_FAMILIES, SOLVED, Training};
use deaflow_dataset::SymmetryGroup;
use deaflow_fem::LinearResponse;
use deaflow_field::Mesh;
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object};
use deaflow_surrogate::{
    Constants, NetworkKind, OptimizerKind, Record, TrainError, TrainOptions, annotated, train, update,
};

/// What it needs: labelled patterns, and a training to begin with.
const KINDS: [&str; 5] = needs::joined(needs::joined::<1, 2, 3>(["balance"], SOLVED), ["verify", "train"]);

/// The kind `train`.
pub struct TrainKind;

/// What a training from given weights has of the epochs of one from nothing: a quarter.
const EPOCHS_OF_UPDATE: u64 = 4;

impl Kind for TrainKind {
    fn name(&self) -> &'static str {
        "train"
    }

    fn recipe(&self) -> u32 {
        4
    }

    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &["network"]
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Training::open(artifact)?;
        let [best] = view.best_epoch().read()?;
        let metrics = view.metrics();
        let (families, splits, rmse) = (
            metrics.family().read()?,
            metrics.split().read()?,
            metrics.rmse().read()?,
        );
        let of_all = families
            .iter()
            .zip(splits)
            .zip(rmse)
            .filter(|((family, _), _)| *family == ALL_FAMILIES);
        let errors = of_all.map(|((_, split), rmse)| (format!("rmse.{split}"), rmse));
        Ok(errors.chain(named([("best_epoch", best as f64)])).collect())
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &KINDS,
            least: 1,
            most: 100,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        vec![TrainParameters::fields()]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let mut parameters = TrainParameters::read_with(stage, &["kind", "needs"])?;
        let usual = TrainOptions::of(parameters.network).learning_rate;
        parameters.learning_rate = parameters.learning_rate.or(Decimal::from_f64(usual));
        Ok(Box::new(TrainStage { parameters }))
    }

    fn feedback_overrides(&self, stage: &Node) -> Result<Vec<(&'static str, NodeValue)>, InputError> {
        let Some(epochs) = stage.peek("epochs") else {
            return Ok(Vec::new());
        };
        let epochs = epochs.integer("epochs", 1, 100_000)?.div_ceil(EPOCHS_OF_UPDATE);
        Ok(vec![("epochs", NodeValue::Number(epochs.to_string()))])
    }
}

parameters! {
    /// Trains a surrogate on balanced datasets, solved samples and verified designs.
    struct TrainParameters as "a train stage" {
        /// The network.
        network: NetworkKind,
        /// Passes over the training examples.
        epochs: u32 [1..=100_000],
        /// Epochs without a smaller validation error that end the training.
        patience: Option<u32> [1..=100_000],
        /// Examples per step.
        batch: u32 [1..=4096] = TrainOptions::default().batch,
        /// How weights follow gradients; muon leaves all but kernels of convolutions to adamw.
        optimizer: OptimizerKind = TrainOptions::default().optimizer,
        /// Largest learning rate; 0.002 unless given, and 0.01 for physics. With rates far beyond what can work the training diverges and says so.
        learning_rate: Option<Decimal> [1e-7..=100.0],
        /// Pull of the weights towards zero, per unit of learning rate.
        weight_decay: Decimal [0.0..=1.0] = TrainOptions::default().weight_decay,
        /// Length to which longer gradients are shortened.
        gradient_norm: Option<Decimal> [1e-6..=1e6],
        /// By what each example is turned, anew in every epoch.
        symmetry: SymmetryGroup = SymmetryGroup::None,
        /// Weight of the largest absolute error in the loss.
        max_weight: Decimal [0.0..=100.0] = TrainOptions::default().max_weight,
        /// Weight of the auxiliary branch at half resolution in the loss.
        auxiliary_weight: Decimal [0.0..=100.0] = TrainOptions::default().auxiliary_weight,
        /// How often an epoch shows each verified design: by default each of its images once. They are few beside thousands of patterns
        /// that are drawn, and where designs are nothing else is known.
        verified_weight: u32 [1..=1000] = 8,
        /// Names the random numbers.
        seed: Seed,
    }
}

struct TrainStage {
    parameters: TrainParameters,
}

impl TrainParameters {
    fn options(&self, scene: &Scene) -> TrainOptions {
        let usual = TrainOptions::of(self.network);
        TrainOptions {
            network: self.network,
            epochs: self.epochs,
            patience: self.patience,
            batch: self.batch,
            optimizer: self.optimizer,
            learning_rate: self.learning_rate.map_or(usual.learning_rate, Decimal::to_f64),
            weight_decay: self.weight_decay.to_f64(),
            gradient_norm: self.gradient_norm.map(Decimal::to_f64),
            symmetry: self.symmetry,
            symmetries: scene.symmetries(),
            loads: scene.group_loads(),
            max_weight: self.max_weight.to_f64(),
            auxiliary_weight: self.auxiliary_weight.to_f64(),
            seed: self.seed.0,
        }
    }
}

impl Stage for TrainStage {
    fn parameters(&self) -> Canonical {
        self.parameters.to_canonical()
    }

    fn repeats_inputs(&self) -> bool {
        true
    }

    /// Gradients of the others are summed in another order than they were.
    fn revision(&self) -> u32 {
        u32::from(self.parameters.network != NetworkKind::Physics)
    }

    fn unit(&self) -> &'static str {
        "epochs"
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: u64::from(self.parameters.epochs),
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let scene = super::scene_of_inputs(job.inputs)?;
        let start = start(job.inputs)?;
        let found = examples::read(job.inputs, &scene, self.parameters.verified_weight)?;
        let constants = match self.parameters.network.has_constants() {
            true => Some(constants(&scene)?),
            false => None,
        };
        let (constants, options, follow) = (constants.as_ref(), self.parameters.options(&scene), Follow::new(job));
        let trained = match &start {
            Some(weights) => update(weights, &found.examples, constants, &options, &follow),
            None => train(&found.examples, constants, &options, &follow),
        };
        let mut trained = trained.map_err(|error| match error {
            TrainError::Stopped(stopped) => stopped.into(),
            error => StageError::failed(error),
        })?;
        let inputs = job.inputs.iter().map(|input| input.digest().to_string()).collect();
        let annotated = annotated(
            &trained.weights,
            &scene.to_text(),
            Record::of(&trained, self.parameters.seed.0, inputs),
        );
        trained.weights = annotated.map_err(StageError::failed)?;
        Ok(content::training(trained, &found, self.parameters.network, scene).object())
    }
}

/// The weights of the training to begin with, if there is one.
fn start(inputs: &[Artifact]) -> Result<Option<Vec<u8>>, StageError> {
    let mut start = None;
    for input in inputs {
        if model::is_in(input) && start.replace(model::weights(input)?).is_some() {
            let message = "a training begins with one other at most, and two are among its inputs";
            return Err(StageError::input(message));
        }
    }
    Ok(start)
}

/// The linear response of a scene, by one biquadratic element per cell: on finer meshes it differs by less than what
/// the network learns anyway.
fn constants(scene: &Scene) -> Result<Constants, StageError> {
    let failed = |e: &dyn std::fmt::Display| StageError::failed(format!("no linear response: {e}"));
    let response = LinearResponse::new(scene, Mesh::biquadratic(1)).map_err(|e| failed(&e))?;
    Constants::new(&response, scene).map_err(StageError::failed)
}
