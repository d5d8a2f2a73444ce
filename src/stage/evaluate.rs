//! `kind: evaluate` measures models on labelled patterns that they never saw, family by family, beside the estimates that a
//! model has to beat; and how often the intervals of calibrations cover.
//!
//! The models are known by their digests: a stage that is renamed keeps its artifact, so names have no place in another's
//! content. Reports find the names in the run.

mod content;
mod predictors;

use super::calibrate::{self, CalibratedModel};
use super::{labelled, needs};
use deaflow_base::{Canonical, Declared, Fields, InputError, Node, Parameter, Schema, parameters};
use deaflow_content::{Evaluation, SOLVED};
use deaflow_fem::Method;
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object};
use deaflow_surrogate::{Judge, Judged};

use predictors::NamedPredictor;

/// What it needs: models, labelled patterns and calibrations.
const KINDS: [&str; 5] = needs::joined(needs::joined::<1, 2, 3>(["train"], SOLVED), ["balance", "calibrate"]);

/// The kind `evaluate`.
pub struct EvaluateKind;

impl Kind for EvaluateKind {
    fn name(&self) -> &'static str {
        "evaluate"
    }

    fn recipe(&self) -> u32 {
        3
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Evaluation::open(artifact)?;
        let (predictors, families, score) = (view.predictors().read()?, view.families().rows()?, view.score());
        let (samples, rmse, largest) = (score.samples().read()?, score.rmse().read()?, score.max_error().read()?);
        // The last of the families is all of them.
        let of = |numbers: &[f64], row: usize| numbers[(row + 1) * families - 1];
        let known = (0..predictors.len()).filter(|row| samples[(row + 1) * families - 1] > 0);
        let both = known.flat_map(|row| {
            let name = &predictors[row];
            [
                (format!("rmse.{name}"), of(&rmse, row)),
                (format!("max_error.{name}"), of(&largest, row)),
            ]
        });
        Ok(both.collect())
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &KINDS,
            least: 1,
            most: 1000,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        vec![EvaluateStage::fields()]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        Ok(Box::new(EvaluateStage::read_with(stage, &["kind", "needs"])?))
    }
}

parameters! {
    /// Measures models, and estimates, on labelled patterns that they never saw.
    struct EvaluateStage as "an evaluate stage" {
        /// Estimates that stand beside the models: linear, or chord:N with N from 1 to 50.
        estimates: Estimates = Vec::new(),
    }
}

/// Methods that look for no equilibrium, each once.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Estimates(Vec<Method>);

impl Parameter for Estimates {
    type Limits = ();
    type Literal = Vec<Method>;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let mut estimates = Vec::new();
        for node in node.list(key)? {
            let method = Method::read(node, "method", &())?;
            if method == Method::Newton {
                return Err(node
                    .error("`newton` is not an estimate")
                    .help("allowed: linear, chord:N with N from 1 to 50"));
            }
            if estimates.contains(&method) {
                return Err(node.error(format!("`{key}` names {method} twice")));
            }
            estimates.push(method);
        }
        Ok(Self(estimates))
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(
            self.0
                .iter()
                .map(|method| Canonical::from(method.to_string().as_str()))
                .collect(),
        )
    }

    fn schema((): &()) -> Schema {
        let methods = Schema::any_of([
            Schema::word(&["linear"]),
            Schema::matching("^chord:\\+?0*([1-9]|[1-4][0-9]|50)$"),
        ]);
        Schema::list(methods, 0, usize::MAX).distinct()
    }

    fn literal(literal: Vec<Method>) -> Self {
        Self(literal)
    }
}

/// One labelled pattern and what was said of it.
struct EvaluationRow {
    family: String,
    area: f64,
    judged: Judged,
}

/// A calibration with the place of its model among the predictors.
struct Calibrated {
    digest: String,
    model: CalibratedModel,
    predictor: usize,
}

impl Stage for EvaluateStage {
    fn parameters(&self) -> Canonical {
        self.to_canonical()
    }

    fn unit(&self) -> &'static str {
        "inputs"
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: inputs.len() as u64,
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let scene = super::scene_of_inputs(job.inputs)?;
        let predictors = self.predictors(job.inputs, &scene)?;
        if predictors.is_empty() {
            return Err(StageError::input(
                "nothing to evaluate: add a model to `needs`, or `estimates`",
            ));
        }
        let calibrated = calibrations(job.inputs, &predictors)?;
        let calibrations = calibrated.iter().map(|c| (c.predictor, &c.model.calibration));
        let judge = Judge::new(predictors.iter().map(NamedPredictor::predictor).collect(), calibrations);
        let models: Vec<_> = predictors.iter().filter_map(NamedPredictor::surrogate).collect();
        let mut rows = Vec::new();
        for input in job.inputs {
            if labelled::is_labelled(input) {
                labelled::check_unseen(input, &models)?;
                labelled::for_each(input, job.progress, &mut |batch| {
                    job.progress.note(&format!("{} patterns", rows.len()));
                    rows.extend(judged(&judge, batch)?);
                    Ok(())
                })?;
            }
            job.progress.advance(1);
        }
        if rows.is_empty() {
            return Err(StageError::input(
                "no data to evaluate on: add solved samples or a balanced dataset to `needs`",
            ));
        }
        Ok(content::evaluation(&predictors, &calibrated, &rows, scene).object())
    }
}

impl EvaluateStage {
    fn predictors(&self, inputs: &[Artifact], scene: &Scene) -> Result<Vec<NamedPredictor>, StageError> {
        let mut found = Vec::new();
        for input in inputs {
            if let Some(model) = NamedPredictor::model(input)? {
                found.push(model);
            }
        }
        for &method in &self.estimates.0 {
            found.push(NamedPredictor::estimate(method, scene)?);
        }
        Ok(found)
    }
}

/// The calibrations among the inputs, each with the place of its model.
fn calibrations(inputs: &[Artifact], predictors: &[NamedPredictor]) -> Result<Vec<Calibrated>, StageError> {
    let mut found = Vec::new();
    for input in inputs {
        let Some(model) = calibrate::read(input)? else {
            continue;
        };
        let place = predictors
            .iter()
            .position(|predictor| predictor.digest() == model.model);
        found.push(Calibrated {
            digest: input.digest().to_string(),
            predictor: place.ok_or_else(|| {
                StageError::input(format!(
                    "calibration {} belongs to model {:.12}, which is not among the models of this stage",
                    input.digest().short(),
                    model.model
                ))
            })?,
            model,
        });
    }
    Ok(found)
}

fn judged(judge: &Judge<'_>, batch: labelled::Batch) -> Result<impl Iterator<Item = EvaluationRow>, StageError> {
    let judged = judge.judge(&batch.patterns, &batch.fields);
    let judged = judged.map_err(StageError::failed)?;
    let described = batch.families.into_iter().zip(batch.patterns);
    Ok(described.zip(judged).map(|((family, pattern), judged)| EvaluationRow {
        family,
        area: pattern.area_fraction(),
        judged,
    }))
}
