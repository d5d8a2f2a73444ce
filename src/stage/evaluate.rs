//! `kind: evaluate` measures the errors of models on labelled patterns that they were not trained on, by family,
//! compared with estimates; and the coverage of the intervals of calibrations.
//!
//! The artifact identifies the models by their digests: renaming a stage changes no artifact, so stage names must not
//! be part of the content. Reports find the names in the run.

mod calibrated;
mod content;
mod predictors;

use super::scene::{area_revision, refused};
use super::without::Dropped;
use super::{labelled, needed, scene};
use deaflow_base::{Canonical, Declared, Fields, InputError, Node, Parameter, Schema, parameters};
use deaflow_content::Evaluation;
use deaflow_fem::Method;
use deaflow_orchestrator::{Job, Kind, Needs, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_pattern::Bits;
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object};
use deaflow_surrogate::Scorer;

use calibrated::calibrations;
use content::EvaluationRow;
use predictors::NamedPredictor;

const NO_MODEL: &str = "nothing to evaluate: add a model to `needs`, or `estimates`";

const NO_DATA: &str = "no data to evaluate on: add solved samples or a balanced dataset to `needs`";

const NO_ROWS: &str = "no rows to evaluate on: of a balanced dataset only its test rows are used, and it has none";

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
        // The last row is that of all families together.
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
        Needs::new(&["train", "solve", "import", "balance", "calibrate"], 1, 1000)
    }

    fn schema(&self) -> Vec<Fields> {
        vec![EvaluateParameters::fields()]
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        needed::one_device(stage, needs)?;
        needed::no_edges_within_cells(stage, needs)?;
        let estimates = stage
            .node
            .peek("estimates")
            .and_then(|node| node.list("estimates").ok());
        if needed::count(needs, &["train"]) == 0 && estimates.is_none_or(<[Node]>::is_empty) {
            return Err(needed::wrong_number(
                stage,
                NO_MODEL.to_owned(),
                "name a stage of kind `train`",
            ));
        }
        if needed::count(needs, &["solve", "import", "balance"]) == 0 {
            return Err(needed::wrong_number(
                stage,
                NO_DATA.to_owned(),
                "name a stage of kind solve, import or balance",
            ));
        }
        needed::unseen(stage, needs)?;
        needed::labels_from_rest(stage, needs)?;
        needed::own_calibrations(stage, needs)?;
        Ok(StageCheck::default())
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        Ok(Box::new(EvaluateStage {
            parameters: EvaluateParameters::read_with(stage, &["kind", "needs"])?,
            revision: area_revision(scene)?,
        }))
    }
}

parameters! {
    /// Measures the errors of models and estimates on labelled patterns that were not used for training.
    struct EvaluateParameters as "an evaluate stage" {
        /// Estimates to compare with the models: linear, or chord:N with N from 1 to 50.
        estimates: Estimates = Vec::new(),
    }
}

struct EvaluateStage {
    parameters: EvaluateParameters,
    revision: u32,
}

/// Methods that do not iterate to equilibrium, each once.
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

impl Stage for EvaluateStage {
    fn parameters(&self) -> Canonical {
        self.parameters.to_canonical()
    }

    fn revision(&self) -> u32 {
        self.revision
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let scene = scene::of_inputs(job.inputs)?;
        let predictors = self.predictors(job.inputs, &scene)?;
        if predictors.is_empty() {
            return Err(StageError::input(NO_MODEL));
        }
        let calibrated = calibrations(job.inputs, &predictors)?;
        let calibrations = calibrated.iter().map(|c| (c.predictor, &c.model.calibration));
        let scorer = Scorer::new(predictors.iter().map(NamedPredictor::predictor).collect(), calibrations);
        let models: Vec<_> = predictors.iter().filter_map(NamedPredictor::surrogate).collect();
        let (free, mut rows) = (scene.free_cells(), Vec::new());
        labelled::for_each_batch(job, &models, &Dropped::default(), &mut |batch| {
            job.progress.note(&format!("{} patterns", rows.len()));
            rows.extend(scored(&scorer, batch, free.as_ref())?);
            Ok(())
        })?;
        if rows.is_empty() {
            // Checks before the run have found data.
            return Err(refused(InputError::new(NO_ROWS).help(
                "balance more patterns, of which one in ten is for tests, or add solved samples of other patterns to \
                 `needs`",
            )));
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
        for &method in &self.parameters.estimates.0 {
            found.push(NamedPredictor::estimate(method, scene)?);
        }
        Ok(found)
    }
}

fn scored<'f>(
    scorer: &Scorer<'_>,
    batch: labelled::Batch,
    free: Option<&'f Bits>,
) -> Result<impl Iterator<Item = EvaluationRow> + use<'f>, StageError> {
    let scores = scorer.score(&batch.patterns, &batch.fields);
    let scores = scores.map_err(StageError::failed)?;
    let described = batch.families.into_iter().zip(batch.patterns);
    Ok(described
        .zip(scores)
        .map(move |((family, pattern), result)| EvaluationRow {
            family,
            area: pattern.area_fraction(free),
            result,
        }))
}
