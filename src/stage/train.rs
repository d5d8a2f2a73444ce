//! `kind: train` trains a surrogate on balanced datasets, solved samples and verified designs, from random weights or
//! from those of another train stage.

mod content;
mod examples;
mod follow;

use super::results::named;
use super::without::{self, Dropped, Without};
use super::{model, needed, scene};
use deaflow_base::{
    ArtifactId, Canonical, Decimal, Declared, Fields, InputError, Node, NodeValue, Parameter, Seed, parameters,
};
use deaflow_content::{ALL_FAMILIES, Training};
use deaflow_dataset::SymmetryGroup;
use deaflow_fem::LinearResponse;
use deaflow_field::Mesh;
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object};
use deaflow_surrogate::{
    Constants, Corners, NetworkKind, OptimizerKind, TrainError, TrainOptions, TrainingRecord, annotated, train, update,
};
use follow::Follow;

/// The kind `train`.
pub struct TrainKind;

/// The kinds of stages that a training needs.
const KIND_OF_NEEDS: [&str; 5] = ["balance", "solve", "import", "verify", "train"];

const TWO_STARTS: &str = "a training can start from only one other training; `needs` names two";

/// A training from given weights has this fraction, a quarter, of the epochs of one from random weights.
const UPDATE_DIVISOR: u64 = 4;

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
        Needs::new(&KIND_OF_NEEDS, 1, 100)
    }

    fn without(&self) -> &'static [&'static str] {
        without::LISTING
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        without::check(stage, needs)?;
        needed::one_device(stage, needs)?;
        needed::no_edges_within_cells(stage, needs)?;
        needed::labels_from_rest(stage, needs)?;
        needed::no_designs_without_networks(stage, needs)?;
        if needed::count(needs, &["train"]) > 1 {
            return Err(needed::wrong_number(
                stage,
                TWO_STARTS.to_owned(),
                "name one stage of kind `train`",
            ));
        }
        check_start(stage, needs)?;
        check_size(stage, needs)?;
        if needed::count(needs, &["train"]) == needed::count(needs, &KIND_OF_NEEDS) {
            let message = "the training has no labels: `needs` names another training only".to_owned();
            return Err(needed::wrong_number(
                stage,
                message,
                "add a stage of kind balance, solve, import or verify",
            ));
        }
        Ok(StageCheck::default())
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
        let epochs = epochs.integer("epochs", 1, 100_000)?.div_ceil(UPDATE_DIVISOR);
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
        /// The optimizer; muon updates the kernels of convolutions, and adamw all other weights.
        optimizer: OptimizerKind = TrainOptions::default().optimizer,
        /// Largest learning rate; by default 0.002, and 0.01 for physics. If it is far too large, the training diverges
        /// and is reported as such.
        learning_rate: Option<Decimal> [1e-7..=100.0],
        /// Weight decay per unit of learning rate.
        weight_decay: Decimal [0.0..=1.0] = TrainOptions::default().weight_decay,
        /// Largest norm of gradients; larger ones are clipped to it.
        gradient_norm: Option<Decimal> [1e-6..=1e6],
        /// The symmetries by which each example is randomly transformed in every epoch.
        symmetry: SymmetryGroup = SymmetryGroup::None,
        /// Weight of the largest absolute error in the loss.
        max_weight: Decimal [0.0..=100.0] = TrainOptions::default().max_weight,
        /// Weight of the auxiliary branch at half resolution in the loss.
        auxiliary_weight: Decimal [0.0..=100.0] = TrainOptions::default().auxiliary_weight,
        /// How often an epoch repeats each verified design; the default is once per image. Designs are few compared
        /// with the samples, and samples do not cover their region.
        verified_weight: u32 [1..=1000] = 8,
        /// Seed of the random numbers.
        seed: Seed,
        /// Audits whose rows with errors are dropped, and files with marked rows (FILE.txt, saved by the page).
        without: Option<Without>,
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
            sides: Corners::of(scene).held(),
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

    /// The order in which gradients of the other networks are summed has changed.
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

    fn check_inputs(
        &self,
        inputs: &[(&'static str, Option<ArtifactId>)],
        open: &dyn Fn(&ArtifactId) -> Option<Artifact>,
    ) -> Result<(), InputError> {
        let without = self.parameters.without.as_ref();
        without.map_or(Ok(()), |without| without.check_inputs(inputs, open))
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let scene = scene::of_inputs(job.inputs)?;
        let start = start(job.inputs)?;
        let dropped = Dropped::of(job.inputs, self.parameters.without.as_ref())?;
        let found = examples::read(job.inputs, &scene, self.parameters.verified_weight, &dropped)?;
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
            TrainingRecord::of(&trained, self.parameters.seed.0, inputs),
        );
        trained.weights = annotated.map_err(StageError::failed)?;
        Ok(content::training(trained, &found, &dropped, self.parameters.network, scene).object())
    }
}

/// Refuses a start from a network of another kind.
fn check_start(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let network = |stage: &StageDeclaration<'_>| Some(stage.node.peek("network")?.text("network").ok()?.to_owned());
    let start = needs.iter().find(|need| need.kind == "train");
    match start.and_then(|start| Some((start.name, network(start)?, network(stage)?))) {
        Some((name, other, own)) if other != own => Err(needed::named(stage, name)
            .error(format!(
                "the training of a network `{own}` cannot start from `{name}`, a network `{other}`"
            ))
            .help(format!("use `network: {other}`, or remove `{name}` from `needs`"))),
        _ => Ok(()),
    }
}

/// Refuses a network that is too large for the scene of its labels.
fn check_size(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let (Some(node), Some(scene)) = (stage.node.peek("network"), needed::scene_of(needs)) else {
        return Ok(());
    };
    let network = NetworkKind::read(node, "network", &())?;
    network.check(&scene).map_err(|why| node.error(why))
}

/// Returns the weights of the training to start from, if any.
fn start(inputs: &[Artifact]) -> Result<Option<Vec<u8>>, StageError> {
    let mut start = None;
    for input in inputs {
        if model::is_in(input) && start.replace(model::weights(input)?).is_some() {
            return Err(StageError::input(TWO_STARTS));
        }
    }
    Ok(start)
}

/// Computes the linear response of a scene with one biquadratic element per cell. Finer meshes change it by less than
/// the network corrects.
fn constants(scene: &Scene) -> Result<Constants, StageError> {
    let failed = |e: &dyn std::fmt::Display| StageError::failed(format!("no linear response: {e}"));
    let response = LinearResponse::new(scene, Mesh::biquadratic(1)).map_err(|e| failed(&e))?;
    Constants::new(&response, scene).map_err(StageError::failed)
}
