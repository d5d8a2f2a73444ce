//! `kind: train` trains a surrogate on a balanced dataset.

use super::arrays;
use crate::base::{Canonical, Decimal, Fields, InputError, Node, Schema};
use crate::dataset::Split;
use crate::fem::{LinearResponse, Order, SolveOptions};
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::scene::Scene;
use crate::store::{Artifact, Data, Dataset, Object};
use crate::surrogate::{Constants, EpochReport, Example, NetworkKind, TrainOptions, Trained, train};

/// The kind `train`.
pub struct TrainKind;

impl Kind for TrainKind {
    fn name(&self) -> &'static str {
        "train"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["balance"],
            least: 1,
            most: 100,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let defaults = TrainOptions::default();
        let network = Schema::word(&NetworkKind::ALL.map(NetworkKind::name)).says("The network.");
        let rate = Schema::number(1e-7, 1.0).says("Largest learning rate.");
        let max_weight = Schema::number(0.0, 100.0).says("Weight of the largest absolute error in the loss.");
        let auxiliary =
            Schema::number(0.0, 100.0).says("Weight of the auxiliary branch at half resolution in the loss.");
        let batch = Schema::whole(1, 4096).says("Examples per step.");
        let fields = Fields::new("Trains a surrogate on balanced datasets.")
            .required("network", network)
            .required(
                "epochs",
                Schema::whole(1, 100_000).says("Passes over the training examples."),
            )
            .optional("batch", batch.default(defaults.batch))
            .optional("learning_rate", rate.default(defaults.learning_rate))
            .optional("max_weight", max_weight.default(defaults.max_weight))
            .optional("auxiliary_weight", auxiliary.default(defaults.auxiliary_weight))
            .required("seed", super::seed());
        vec![fields]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a train stage";
        let keys = [
            "kind",
            "needs",
            "network",
            "epochs",
            "batch",
            "learning_rate",
            "max_weight",
            "auxiliary_weight",
            "seed",
        ];
        let map = stage.fields(what, &keys)?;
        let network = map.required(what, "network")?;
        let word = network.word("network", &NetworkKind::ALL.map(NetworkKind::name))?;
        let network = NetworkKind::from_name(word).ok_or_else(|| network.error(format!("unknown network {word:?}")))?;
        let defaults = TrainOptions::default();
        Ok(Box::new(TrainStage {
            network,
            epochs: map.required(what, "epochs")?.whole("epochs", 1, 100_000)? as u32,
            batch: map
                .optional("batch")
                .map_or(Ok(u64::from(defaults.batch)), |n| n.whole("batch", 1, 4096))? as u32,
            learning_rate: map.number("learning_rate", defaults.learning_rate, 1e-7, 1.0)?,
            max_weight: map.number("max_weight", defaults.max_weight, 0.0, 100.0)?,
            auxiliary_weight: map.number("auxiliary_weight", defaults.auxiliary_weight, 0.0, 100.0)?,
            seed: map.required(what, "seed")?.whole("seed", 0, i64::MAX as u64)?,
        }))
    }
}

struct TrainStage {
    network: NetworkKind,
    epochs: u32,
    batch: u32,
    learning_rate: Decimal,
    max_weight: Decimal,
    auxiliary_weight: Decimal,
    seed: u64,
}

impl Stage for TrainStage {
    fn parameters(&self) -> Canonical {
        Canonical::map([
            ("network", Canonical::from(self.network.name())),
            ("epochs", u64::from(self.epochs).into()),
            ("batch", u64::from(self.batch).into()),
            ("learning_rate", self.learning_rate.into()),
            ("max_weight", self.max_weight.into()),
            ("auxiliary_weight", self.auxiliary_weight.into()),
            ("seed", self.seed.into()),
        ])
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: u64::from(self.epochs),
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let mut examples = Vec::new();
        for input in job.inputs {
            read_examples(input, &mut examples)?;
        }
        let options = TrainOptions {
            network: self.network,
            epochs: self.epochs,
            batch: self.batch,
            learning_rate: self.learning_rate.to_f64(),
            max_weight: self.max_weight.to_f64(),
            auxiliary_weight: self.auxiliary_weight.to_f64(),
            seed: self.seed,
        };
        let on_epoch = |report: &EpochReport| {
            job.progress
                .note(&format!("validation RMSE {:.4} mm", report.validation_rmse_mm));
            job.progress.advance(1);
        };
        let constants = match self.network.has_constants() {
            true => Some(constants(&super::scene_attribute(job.inputs)?)?),
            false => None,
        };
        let trained =
            train(&examples, constants.as_ref(), &options, &on_epoch).map_err(|e| StageError::Failed(e.to_string()))?;
        Ok(describe(&trained, self.network.name()).attribute("scene", super::scene_attribute(job.inputs)?))
    }
}

/// The linear response of a scene, by one biquadratic element per cell: on finer meshes it differs by less than what
/// the network learns anyway.
fn constants(scene: &str) -> Result<Constants, StageError> {
    let scene = Scene::from_text(scene).map_err(|e| StageError::Input(format!("the scene of the dataset: {e}")))?;
    let options = SolveOptions {
        elements_per_cell: 1,
        order: Order::Biquadratic,
        ..SolveOptions::default()
    };
    let failed = |e: &dyn std::fmt::Display| StageError::Failed(format!("no linear response: {e}"));
    let response = LinearResponse::new(&scene, options).map_err(|e| failed(&e))?;
    Constants::new(&response, scene.side_mm()).map_err(StageError::Failed)
}

fn read_examples(artifact: &Artifact, examples: &mut Vec<Example>) -> Result<(), StageError> {
    let patterns = arrays::read_patterns(artifact, "patterns")?;
    let fields = arrays::read_fields(artifact, "displacement")?;
    let (families, splits) = (artifact.texts("family")?.1, artifact.texts("split")?.1);
    if [fields.len(), families.len(), splits.len()] != [patterns.len(); 3] {
        return Err(StageError::Input(format!(
            "artifact {}: its arrays differ in length",
            artifact.digest().short()
        )));
    }
    for (((pattern, field), family), split) in patterns.into_iter().zip(fields).zip(families).zip(splits) {
        let split = Split::from_name(&split).ok_or_else(|| {
            StageError::Input(format!(
                "artifact {}: unknown split {split:?}",
                artifact.digest().short()
            ))
        })?;
        examples.push(Example {
            pattern,
            field,
            family,
            split,
        });
    }
    Ok(())
}

fn describe(trained: &Trained, network: &str) -> Object {
    let curve = |units, description, value: fn(&EpochReport) -> f64| {
        arrays::reals(units, description, trained.curves.iter().map(value).collect())
    };
    let metric = |units, description, value: fn(&crate::surrogate::Metrics) -> f64| {
        arrays::reals(units, description, trained.metrics.iter().map(value).collect())
    };
    let metrics = &trained.metrics;
    let weights = Data::U8(trained.weights.clone());
    Object::default()
        .attribute("network", network)
        .with(
            "weights",
            Dataset::new(
                "1",
                "the model as the bytes of a safetensors file",
                &[trained.weights.len()],
                weights,
            ),
        )
        .with(
            "best_epoch",
            arrays::wholes(
                "1",
                "epoch whose weights are kept, from 1",
                vec![u64::from(trained.best_epoch)],
            ),
        )
        .with(
            "curves/train_loss",
            curve("1", "training loss of each epoch", |e| e.train_loss),
        )
        .with(
            "curves/validation_loss",
            curve("1", "validation loss of each epoch", |e| e.validation_loss),
        )
        .with(
            "curves/validation_rmse",
            curve("mm", "validation RMSE per component of each epoch", |e| {
                e.validation_rmse_mm
            }),
        )
        .with(
            "metrics/family",
            arrays::texts(
                "family that the metrics are over",
                metrics.iter().map(|m| m.family.as_str()),
            ),
        )
        .with(
            "metrics/split",
            arrays::texts(
                "split that the metrics are over",
                metrics.iter().map(|m| m.split.name()),
            ),
        )
        .with(
            "metrics/samples",
            arrays::wholes(
                "1",
                "samples that the metrics are over",
                metrics.iter().map(|m| m.samples).collect(),
            ),
        )
        .with(
            "metrics/rmse",
            metric("mm", "root mean square error per component", |m| m.rmse_mm),
        )
        .with("metrics/r2", metric("1", "coefficient of determination", |m| m.r2))
        .with(
            "metrics/max_error",
            metric("mm", "largest absolute error of a component", |m| m.max_error_mm),
        )
}
