//! `kind: calibrate` makes prediction intervals for a model from labelled patterns that it never saw.

mod content;

use std::collections::BTreeSet;

use super::results::named;
use super::{labelled, model, needs};
use content::Origin;
use deaflow_base::{Canonical, Declared, Digest, Fields, InputError, Node, Seed, parameters};
use deaflow_content::SOLVED;

use deaflow_field::Predictor;
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use deaflow_store::{Artifact, Object};
use deaflow_surrogate::{Calibration, CalibrationError, Observed, Surrogate};

pub use content::{CalibratedFamily, CalibratedModel, read};

/// What it needs: a model and labelled patterns.
const KINDS: [&str; 4] = needs::joined(needs::joined::<1, 2, 3>(["train"], SOLVED), ["balance"]);

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
        Needs {
            kinds: &KINDS,
            least: 2,
            most: 1000,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        vec![CalibrateStage::fields()]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        Ok(Box::new(CalibrateStage::read_with(stage, &["kind", "needs"])?))
    }
}

parameters! {
    /// Makes prediction intervals for a model from labelled patterns that it never saw.
    struct CalibrateStage as "a calibrate stage" {
        /// Names the random numbers.
        seed: Seed,
    }
}

impl Stage for CalibrateStage {
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
        let (artifact, surrogate) = the_model(job.inputs)?;
        let trained = model::families(artifact)?;
        let (mut observed, mut families) = (Vec::new(), Vec::new());
        for input in job.inputs {
            if labelled::is_labelled(input) {
                labelled::check_unseen(input, &[&surrogate])?;
                labelled::for_each(input, job.progress, &mut |batch| {
                    let predicted = surrogate.predict(&batch.patterns);
                    let predicted = predicted.map_err(StageError::failed)?;
                    for (at, field) in predicted.iter().enumerate() {
                        let familiar = trained.contains(&batch.families[at]);
                        observed.push(Observed::new(&batch.patterns[at], field, &batch.fields[at], familiar));
                    }
                    families.extend(batch.families);
                    Ok(())
                })?;
            }
            job.progress.advance(1);
        }
        let calibration = Calibration::fit(observed, self.seed.0).map_err(|e| refused(e, &trained))?;
        let origin = Origin {
            families: &families,
            trained: &trained,
            model: artifact.digest().to_string(),
            weights: Digest::of(&model::weights(artifact)?).to_string(),
            network: surrogate.kind().name(),
            scene,
        };
        Ok(content::content(&calibration, origin).object())
    }
}

fn refused(error: CalibrationError, trained: &BTreeSet<String>) -> StageError {
    let families: Vec<&str> = trained.iter().map(String::as_str).collect();
    match error {
        CalibrationError::FewFamiliar(_) => StageError::input(format!("{error}; these are: {}", families.join(", "))),
        other => StageError::input(other),
    }
}

/// The one model among the inputs.
fn the_model(inputs: &[Artifact]) -> Result<(&Artifact, Surrogate), StageError> {
    let mut found = Vec::new();
    for input in inputs {
        if model::is_in(input) {
            found.push(input);
        }
    }
    let [artifact] = &found[..] else {
        return Err(StageError::input(format!(
            "a calibrate stage needs one model, and `needs` names {}",
            found.len()
        )));
    };
    Ok((*artifact, model::of_artifact(artifact)?))
}
