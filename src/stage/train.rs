//! `kind: train` trains a surrogate on balanced datasets, on solved samples as they are, and on verified designs; from nothing, or from
//! the weights of a training that it needs.

mod content;
mod examples;
mod follow;

use super::model;
use follow::Follow;

use crate::base::{Canonical, Decimal, Fields, InputError, Map, Node, NodeValue, Schema};
use crate::dataset::SymmetryGroup;
use crate::fem::LinearResponse;
use crate::field::Mesh;
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::scene::Scene;
use crate::store::{Artifact, Object};
use crate::surrogate::{Constants, NetworkKind, OptimizerKind, Record, TrainOptions, annotated, train, update};

/// The kind `train`.
pub struct TrainKind;

const SYMMETRIES: [&str; 2] = ["none", "d4"];

const KEYS: [&str; 15] = [
    "kind",
    "needs",
    "network",
    "epochs",
    "patience",
    "batch",
    "optimizer",
    "learning_rate",
    "weight_decay",
    "gradient_norm",
    "symmetry",
    "max_weight",
    "auxiliary_weight",
    "verified_weight",
    "seed",
];

/// How often an epoch shows a verified design unless said otherwise: each of its images once. They are few beside thousands of patterns
/// that are drawn, and where designs are nothing else is known.
const VERIFIED_WEIGHT: u32 = 8;

/// What a training from given weights has of the epochs of one from nothing: a quarter.
const EPOCHS_OF_UPDATE: u64 = 4;

/// Bounds of the learning rate. Rates far beyond what can work are allowed: the training says that it diverged.
const RATES: [f64; 2] = [1e-7, 100.0];

impl Kind for TrainKind {
    fn name(&self) -> &'static str {
        "train"
    }

    fn recipe(&self) -> u32 {
        3
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["balance", "solve", "verify", "train"],
            least: 1,
            most: 100,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let defaults = TrainOptions::default();
        let network = Schema::word(&NetworkKind::ALL.map(NetworkKind::name)).says("The network.");
        let epochs = Schema::whole(1, 100_000).says("Passes over the training examples.");
        let patience =
            Schema::whole(1, 100_000).says("Epochs without a smaller validation error that end the training.");
        let batch = Schema::whole(1, 4096).says("Examples per step.");
        let optimizer = Schema::word(&OptimizerKind::ALL.map(OptimizerKind::name))
            .says("How weights follow gradients; muon leaves all but kernels of convolutions to adamw.");
        let rate =
            Schema::number(RATES[0], RATES[1]).says("Largest learning rate; 0.002 unless given, and 0.01 for physics.");
        let decay = Schema::number(0.0, 1.0).says("Pull of the weights towards zero, per unit of learning rate.");
        let norm = Schema::number(1e-6, 1e6).says("Length to which longer gradients are shortened.");
        let symmetry = Schema::word(&SYMMETRIES).says("By what each example is turned, anew in every epoch.");
        let max_weight = Schema::number(0.0, 100.0).says("Weight of the largest absolute error in the loss.");
        let auxiliary =
            Schema::number(0.0, 100.0).says("Weight of the auxiliary branch at half resolution in the loss.");
        let verified = Schema::whole(1, 1000).says("How often an epoch shows each verified design.");
        let fields = Fields::new("Trains a surrogate on balanced datasets, solved samples and verified designs.")
            .required("network", network)
            .required("epochs", epochs)
            .optional("patience", patience)
            .optional("batch", batch.default(defaults.batch))
            .optional("optimizer", optimizer.default(defaults.optimizer.name()))
            .optional("learning_rate", rate)
            .optional("weight_decay", decay.default(defaults.weight_decay))
            .optional("gradient_norm", norm)
            .optional("symmetry", symmetry.default(SYMMETRIES[0]))
            .optional("max_weight", max_weight.default(defaults.max_weight))
            .optional("auxiliary_weight", auxiliary.default(defaults.auxiliary_weight))
            .optional("verified_weight", verified.default(VERIFIED_WEIGHT))
            .required("seed", super::seed());
        vec![fields]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a train stage";
        let map = stage.fields(what, &KEYS)?;
        let network = map.required(what, "network")?;
        let word = network.word("network", &NetworkKind::ALL.map(NetworkKind::name))?;
        let network = NetworkKind::from_name(word).ok_or_else(|| network.error(format!("unknown network {word:?}")))?;
        let defaults = TrainOptions::of(network);
        Ok(Box::new(TrainStage {
            network,
            epochs: map.required(what, "epochs")?.whole("epochs", 1, 100_000)? as u32,
            patience: whole(&map, "patience", 100_000)?,
            batch: whole(&map, "batch", 4096)?.unwrap_or(defaults.batch),
            optimizer: read_optimizer(&map)?.unwrap_or(defaults.optimizer),
            learning_rate: map.number("learning_rate", defaults.learning_rate, RATES[0], RATES[1])?,
            weight_decay: map.number("weight_decay", defaults.weight_decay, 0.0, 1.0)?,
            gradient_norm: match map.optional("gradient_norm") {
                Some(_) => Some(map.number("gradient_norm", 1.0, 1e-6, 1e6)?),
                None => None,
            },
            symmetry: map
                .optional("symmetry")
                .map_or(Ok(SYMMETRIES[0]), |n| n.word("symmetry", &SYMMETRIES))?,
            max_weight: map.number("max_weight", defaults.max_weight, 0.0, 100.0)?,
            auxiliary_weight: map.number("auxiliary_weight", defaults.auxiliary_weight, 0.0, 100.0)?,
            verified_weight: whole(&map, "verified_weight", 1000)?.unwrap_or(VERIFIED_WEIGHT),
            seed: map.required(what, "seed")?.whole("seed", 0, i64::MAX as u64)?,
        }))
    }

    fn relearns(&self, stage: &Node) -> Result<Vec<(&'static str, NodeValue)>, InputError> {
        let Some(epochs) = stage.peek("epochs") else {
            return Ok(Vec::new());
        };
        let epochs = epochs.whole("epochs", 1, 100_000)?.div_ceil(EPOCHS_OF_UPDATE);
        Ok(vec![("epochs", NodeValue::Number(epochs.to_string()))])
    }
}

/// A whole number from 1, if it is there.
fn whole(map: &Map<'_>, key: &str, high: u64) -> Result<Option<u32>, InputError> {
    let read = |node: &Node| Ok(node.whole(key, 1, high)? as u32);
    map.optional(key).map(read).transpose()
}

fn read_optimizer(map: &Map<'_>) -> Result<Option<OptimizerKind>, InputError> {
    let Some(node) = map.optional("optimizer") else {
        return Ok(None);
    };
    let word = node.word("optimizer", &OptimizerKind::ALL.map(OptimizerKind::name))?;
    Ok(OptimizerKind::from_name(word))
}

struct TrainStage {
    network: NetworkKind,
    epochs: u32,
    patience: Option<u32>,
    batch: u32,
    optimizer: OptimizerKind,
    learning_rate: Decimal,
    weight_decay: Decimal,
    gradient_norm: Option<Decimal>,
    symmetry: &'static str,
    max_weight: Decimal,
    auxiliary_weight: Decimal,
    verified_weight: u32,
    seed: u64,
}

impl TrainStage {
    fn options(&self) -> TrainOptions {
        TrainOptions {
            network: self.network,
            epochs: self.epochs,
            patience: self.patience,
            batch: self.batch,
            optimizer: self.optimizer,
            learning_rate: self.learning_rate.to_f64(),
            weight_decay: self.weight_decay.to_f64(),
            gradient_norm: self.gradient_norm.map(Decimal::to_f64),
            symmetry: if self.symmetry == "d4" {
                SymmetryGroup::D4
            } else {
                SymmetryGroup::None
            },
            max_weight: self.max_weight.to_f64(),
            auxiliary_weight: self.auxiliary_weight.to_f64(),
            seed: self.seed,
        }
    }
}

impl Stage for TrainStage {
    fn parameters(&self) -> Canonical {
        let optional = [
            self.patience.map(|n| ("patience", u64::from(n).into())),
            self.gradient_norm.map(|norm| ("gradient_norm", norm.into())),
            // Trainings without verified designs have the keys that they always had.
            (self.verified_weight != VERIFIED_WEIGHT)
                .then(|| ("verified_weight", u64::from(self.verified_weight).into())),
        ];
        let required = [
            ("network", Canonical::from(self.network.name())),
            ("epochs", u64::from(self.epochs).into()),
            ("batch", u64::from(self.batch).into()),
            ("optimizer", self.optimizer.name().into()),
            ("learning_rate", self.learning_rate.into()),
            ("weight_decay", self.weight_decay.into()),
            ("symmetry", self.symmetry.into()),
            ("max_weight", self.max_weight.into()),
            ("auxiliary_weight", self.auxiliary_weight.into()),
            ("seed", self.seed.into()),
        ];
        Canonical::map(required.into_iter().chain(optional.into_iter().flatten()))
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: u64::from(self.epochs),
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let scene = super::scene_of_inputs(job.inputs)?;
        let start = start(job.inputs)?;
        let found = examples::read(job.inputs, scene.side_mm(), self.verified_weight)?;
        let constants = match self.network.has_constants() {
            true => Some(constants(&scene)?),
            false => None,
        };
        let (constants, options, follow) = (constants.as_ref(), self.options(), Follow::new(job));
        let trained = match &start {
            Some(weights) => update(weights, &found.examples, constants, &options, &follow),
            None => train(&found.examples, constants, &options, &follow),
        };
        let mut trained = trained.map_err(|e| StageError::Failed(e.to_string()))?;
        let inputs = job.inputs.iter().map(|input| input.digest().to_string()).collect();
        let annotated = annotated(
            &trained.weights,
            &scene.to_text(),
            Record::of(&trained, self.seed, inputs),
        );
        trained.weights = annotated.map_err(|e| StageError::Failed(e.to_string()))?;
        Ok(content::training(trained, &found, self.network, scene).object())
    }
}

/// The weights of the training to begin with, if there is one.
fn start(inputs: &[Artifact]) -> Result<Option<Vec<u8>>, StageError> {
    let mut start = None;
    for input in inputs {
        if model::is_in(input) && start.replace(model::weights(input)?).is_some() {
            let message = "a training begins with one other at most, and two are among its inputs";
            return Err(StageError::Input(message.to_owned()));
        }
    }
    Ok(start)
}

/// The linear response of a scene, by one biquadratic element per cell: on finer meshes it differs by less than what
/// the network learns anyway.
fn constants(scene: &Scene) -> Result<Constants, StageError> {
    let failed = |e: &dyn std::fmt::Display| StageError::Failed(format!("no linear response: {e}"));
    let response = LinearResponse::new(scene, Mesh::biquadratic(1)).map_err(|e| failed(&e))?;
    Constants::new(&response, scene.side_mm()).map_err(|e| StageError::Failed(e.to_string()))
}
