//! `kind: calibrate` computes prediction intervals of a model from labelled patterns that it was not trained on.

mod content;
mod enough;

use std::collections::BTreeSet;

use super::results::named;
use super::without::{self, Dropped, Without};
use super::{labelled, model, needed, scene};
use content::Origin;
use deaflow_base::{ArtifactId, Canonical, Declared, Digest, Fields, InputError, Node, Seed, parameters};
use deaflow_field::Predictor;
use deaflow_orchestrator::{Job, Kind, Needs, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_store::{Artifact, Object};
use deaflow_surrogate::{Calibration, CalibrationError, CalibrationSample, MIN_PATTERNS, Surrogate};

pub use content::{CalibratedFamily, CalibratedModel, read};

/// The kind `calibrate`.
pub struct CalibrateKind;

impl Kind for CalibrateKind {
    fn name(&self) -> &'static str {
        "calibrate"
    }

    fn recipe(&self) -> u32 {
        3
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = deaflow_content::Calibration::open(artifact)?;
        let [threshold] = view.novelty().threshold().read()?;
        let samples: u64 = view.samples().read()?.iter().sum();
        Ok(named([("samples", samples as f64), ("novelty_threshold", threshold)]))
    }

    fn needs(&self) -> Needs {
        Needs::new(&["train", "solve", "import", "balance"], 2, 1000)
    }

    fn without(&self) -> &'static [&'static str] {
        without::LISTING
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        without::check(stage, needs)?;
        needed::one_device(stage, needs)?;
        needed::no_edges_within_cells(stage, needs)?;
        let models = needed::count(needs, &["train"]);
        if models != 1 {
            return Err(needed::wrong_number(
                stage,
                one_model(models),
                "name one stage of kind `train`",
            ));
        }
        if needed::count(needs, &LABELS) == 0 {
            let message = "a calibration needs labels, and `needs` names none".to_owned();
            return Err(needed::wrong_number(
                stage,
                message,
                "add a stage of kind solve, import or balance",
            ));
        }
        needed::unseen(stage, needs)?;
        needed::labels_from_rest(stage, needs)?;
        Ok(StageCheck {
            warnings: enough::check(stage, needs)?,
            ..StageCheck::default()
        })
    }

    fn schema(&self) -> Vec<Fields> {
        vec![CalibrateStage::fields()]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        Ok(Box::new(CalibrateStage::read_with(stage, &["kind", "needs"])?))
    }
}

parameters! {
    /// Computes prediction intervals of a model from labelled patterns that it was not trained on.
    struct CalibrateStage as "a calibrate stage" {
        /// Seed of the random numbers.
        seed: Seed,
        /// Audits whose rows with errors are dropped, and files with marked rows (FILE.txt, saved by the page).
        without: Option<Without>,
    }
}

/// The kinds of stages with labels.
const LABELS: [&str; 3] = ["solve", "import", "balance"];

impl Stage for CalibrateStage {
    fn checks_samples(&self) -> bool {
        true
    }

    /// The number of test rows of a balanced set is not known before it is built.
    fn check_samples(&self, inputs: &[(&'static str, u64)]) -> Result<(), String> {
        let labels = inputs.iter().filter(|(kind, _)| LABELS.contains(kind));
        let mut count = 0;
        for (kind, samples) in labels {
            if *kind == "balance" {
                return Ok(());
            }
            count += samples;
        }
        match usize::try_from(count) {
            Ok(count) if count < MIN_PATTERNS => Err(CalibrationError::Few(count).to_string()),
            _ => Ok(()),
        }
    }

    fn parameters(&self) -> Canonical {
        self.to_canonical()
    }

    fn check_inputs(
        &self,
        inputs: &[(&'static str, Option<ArtifactId>)],
        open: &dyn Fn(&ArtifactId) -> Option<Artifact>,
    ) -> Result<(), InputError> {
        let without = self.without.as_ref();
        without.map_or(Ok(()), |without| without.check_inputs(inputs, open))
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let scene = scene::of_inputs(job.inputs)?;
        let (artifact, surrogate) = the_model(job.inputs)?;
        let trained = model::families(artifact)?;
        let dropped = Dropped::of(job.inputs, self.without.as_ref())?;
        let (mut samples, mut families) = (Vec::new(), Vec::new());
        labelled::for_each_batch(job, &[&surrogate], &dropped, &mut |batch| {
            let predicted = surrogate.predict(&batch.patterns);
            let predicted = predicted.map_err(StageError::failed)?;
            for (at, field) in predicted.iter().enumerate() {
                let familiar = trained.contains(&batch.families[at]);
                let (pattern, simulated) = (&batch.patterns[at], &batch.fields[at]);
                samples.push(CalibrationSample::new(pattern, field, simulated, familiar));
            }
            families.extend(batch.families);
            Ok(())
        })?;
        let calibration = Calibration::fit(samples, self.seed.0).map_err(|e| too_few(e, &trained))?;
        let origin = Origin {
            families: &families,
            trained: &trained,
            model: artifact.digest().to_string(),
            weights: Digest::of(&model::weights(artifact)?).to_string(),
            network: surrogate.kind().name(),
            dropped: &dropped,
            scene,
        };
        Ok(content::content(&calibration, origin).object())
    }
}

fn too_few(error: CalibrationError, trained: &BTreeSet<String>) -> StageError {
    let families: Vec<&str> = trained.iter().map(String::as_str).collect();
    match error {
        CalibrationError::FewFamiliar(_) => StageError::input(format!("{error}; these are: {}", families.join(", "))),
        other => StageError::input(other),
    }
}

fn one_model(found: usize) -> String {
    format!("a calibrate stage needs exactly one model; `needs` names {found}")
}

/// Returns the one model among the inputs.
fn the_model(inputs: &[Artifact]) -> Result<(&Artifact, Surrogate), StageError> {
    let found: Vec<&Artifact> = inputs.iter().filter(|input| model::is_in(input)).collect();
    let [artifact] = found[..] else {
        return Err(StageError::input(one_model(found.len())));
    };
    Ok((artifact, model::of_artifact(artifact)?))
}
