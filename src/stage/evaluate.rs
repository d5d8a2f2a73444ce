//! `kind: evaluate` measures models on labelled patterns that they never saw, family by family, beside the estimates that a
//! model has to beat; and how often the intervals of calibrations cover.
//!
//! The models are known by their digests: a stage that is renamed keeps its artifact, so names have no place in another's
//! content. Reports find the names in the run.

mod content;
mod contestant;
mod covered;

use rayon::prelude::*;

use super::{calibrate, labelled};
use crate::base::{Canonical, Declared, Fields, InputError, Node, Parameter, Schema, parameters};
use crate::fem::Method;
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::scene::Scene;
use crate::store::{Artifact, Object};
use crate::surrogate::PatternScore;

use contestant::Contestant;
use covered::{Calibrated, Covered};

/// The kind `evaluate`.
pub struct EvaluateKind;

impl Kind for EvaluateKind {
    fn name(&self) -> &'static str {
        "evaluate"
    }

    fn recipe(&self) -> u32 {
        2
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["train", "solve", "balance", "calibrate"],
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
            let method = Method::read(node)?;
            if method == Method::Newton {
                return Err(node
                    .error("`newton` is no estimate")
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
struct Row {
    family: String,
    area: f64,
    /// By contestant; none where an estimate leads nowhere.
    scores: Vec<Option<PatternScore>>,
    /// By calibration.
    covered: Vec<Covered>,
}

impl Stage for EvaluateStage {
    fn parameters(&self) -> Canonical {
        self.to_canonical()
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: inputs.len() as u64,
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let scene = super::scene_of_inputs(job.inputs)?;
        let contestants = self.contestants(job.inputs, &scene)?;
        if contestants.is_empty() {
            return Err(StageError::Input(
                "there is nothing to evaluate: `needs` names no model, and there are no `estimates`".to_owned(),
            ));
        }
        let calibrated = calibrations(job.inputs, &contestants)?;
        let bands = covered::bands(&calibrated);
        let models: Vec<_> = contestants.iter().filter_map(Contestant::surrogate).collect();
        let mut rows = Vec::new();
        for input in job.inputs {
            if labelled::is_labelled(input) {
                labelled::check_unseen(input, &models)?;
                labelled::for_each(input, &mut |batch| {
                    job.progress.note(&format!("{} patterns", rows.len()));
                    rows.extend(judged(&contestants, &calibrated, &bands, &batch)?);
                    Ok(())
                })?;
            }
            job.progress.advance(1);
        }
        if rows.is_empty() {
            return Err(StageError::Input(
                "there is nothing to evaluate on: `needs` names no solved samples and no test rows".to_owned(),
            ));
        }
        Ok(content::evaluation(&contestants, &calibrated, &rows, scene).object())
    }
}

impl EvaluateStage {
    fn contestants(&self, inputs: &[Artifact], scene: &Scene) -> Result<Vec<Contestant>, StageError> {
        let mut found = Vec::new();
        for input in inputs {
            if let Some(model) = Contestant::model(input)? {
                found.push(model);
            }
        }
        for &method in &self.estimates.0 {
            found.push(Contestant::estimate(method, scene)?);
        }
        Ok(found)
    }
}

/// The calibrations among the inputs, each with the place of its model.
fn calibrations(inputs: &[Artifact], contestants: &[Contestant]) -> Result<Vec<Calibrated>, StageError> {
    let mut found = Vec::new();
    for input in inputs {
        let Some((model, calibration)) = calibrate::read(input)? else {
            continue;
        };
        let place = contestants.iter().position(|contestant| contestant.digest() == model);
        found.push(Calibrated {
            digest: input.digest().to_string(),
            calibration,
            contestant: place.ok_or_else(|| {
                StageError::Input(format!(
                    "the calibration {} is of the model {:.12}, which is not among the models here",
                    input.digest().short(),
                    model
                ))
            })?,
        });
    }
    Ok(found)
}

fn judged(
    contestants: &[Contestant],
    calibrated: &[Calibrated],
    bands: &covered::Bands<'_>,
    batch: &labelled::Batch,
) -> Result<Vec<Row>, StageError> {
    let predicted: Vec<_> = contestants
        .iter()
        .map(|contestant| contestant.predict(&batch.patterns))
        .collect::<Result<_, _>>()?;
    let row = |at: usize| {
        let (pattern, simulated) = (&batch.patterns[at], &batch.fields[at]);
        let score = |fields: &Vec<Option<_>>| fields[at].as_ref().map(|field| PatternScore::of(field, simulated));
        let covered = calibrated.iter().zip(bands).filter_map(|(calibrated, bands)| {
            let field = predicted[calibrated.contestant][at].as_ref()?;
            Some(Covered::of(calibrated, bands, pattern, field, simulated))
        });
        Row {
            family: batch.families[at].clone(),
            area: pattern.area_fraction(),
            scores: predicted.iter().map(score).collect(),
            covered: covered.collect(),
        }
    };
    Ok((0..batch.patterns.len()).into_par_iter().map(row).collect())
}
