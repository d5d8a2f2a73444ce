//! `kind: accuracy` says what accuracy costs: the error of each method against a reference, and its time.
//!
//! The reference is an ordinary solve stage, which this one needs: it is as dear as all else together, and stays when
//! the list of methods changes. Errors are content. Times differ from run to run, so they are measurements, which stand in
//! the provenance.

mod bound;
mod clock;
mod compare;
mod contender;
mod content;
mod elements;
mod families;
mod reference;
mod surrogate;

use std::collections::BTreeSet;

use super::model;
use crate::base::{Canonical, Fields, InputError, Node};
use crate::content::Solutions;
use crate::field::Field;
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::store::{Artifact, Object};

pub use compare::{FamilyError, Measured, PatternError, Reckoned};
pub use contender::{Contender, read_with_models, usual as usual_methods};
pub use content::{content, measurement, measurements};
pub use families::{Families, drawn, given};
pub use reference::Reference;
pub use surrogate::{Network, named};

/// The reference, and models to be measured.
const MOST_NEEDS: usize = 20;

/// The kind `accuracy`.
pub struct AccuracyKind;

impl Kind for AccuracyKind {
    fn name(&self) -> &'static str {
        "accuracy"
    }

    fn recipe(&self) -> u32 {
        2
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["solve", "train"],
            least: 1,
            most: MOST_NEEDS,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let fields = Fields::new("Says what accuracy costs: the error of methods against a reference, and their time.");
        vec![fields.optional("methods", contender::schema())]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields("an accuracy stage", &["kind", "needs", "methods"])?;
        let contenders = map.optional("methods").map(contender::read).transpose()?;
        Ok(Box::new(AccuracyStage {
            contenders: contenders.unwrap_or_else(contender::usual),
        }))
    }
}

struct AccuracyStage {
    contenders: Vec<Box<dyn Contender>>,
}

impl Stage for AccuracyStage {
    fn parameters(&self) -> Canonical {
        let methods = self.contenders.iter().map(|contender| contender.canonical());
        Canonical::map([("methods", methods.collect::<Canonical>())])
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        let models = inputs.len().saturating_sub(1);
        Plan::Whole {
            steps: (self.contenders.len() + models) as u64,
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let (mut references, mut networks) = (Vec::new(), Vec::new());
        for input in job.inputs {
            if model::is_in(input) {
                networks.push(Network::of_artifact(input)?);
            } else {
                references.push(input);
            }
        }
        let [reference] = references[..] else {
            let found = references.len();
            let why = format!("an accuracy stage needs one solve stage as its reference, and this one has {found}");
            return Err(StageError::Input(why));
        };
        let reckoned = reckoned(reference)?;
        let networks = named(networks);
        let contenders: Vec<&dyn Contender> = self.contenders.iter().chain(&networks).map(AsRef::as_ref).collect();
        let measured = reckoned.measure(&contenders, job.progress);
        let measured = measured.map_err(StageError::Failed)?;
        for (name, seconds) in measurements(&reckoned, &measured) {
            job.measure(name, seconds);
        }
        Ok(content(&reckoned, &measured).object())
    }
}

/// The samples of a solve stage, stable or not, with what was found.
fn reckoned(solved: &Artifact) -> Result<Reckoned, StageError> {
    let wrong = |why: String| StageError::Input(format!("artifact {}: {why}", solved.digest().short()));
    let view = Solutions::open(solved)?;
    let scene = view.scene().read()?;
    let reference = Reference::from_text(&view.solver().read()?).map_err(wrong)?;
    let (rows, unstable) = (view.rows(), view.unstable().rows());
    let mut patterns = rows.patterns().read()?;
    patterns.extend(unstable.patterns().read()?);
    let mut names = rows.family().read()?;
    names.extend(unstable.family().read()?);
    let mut fields: Vec<Option<Field>> = view.displacement().read()?.into_iter().map(Some).collect();
    fields.resize(patterns.len(), None);
    let errors = match reference.settings().accuracy() {
        Some(_) => {
            let mut errors = view.meshes().discretisation_error().read()?;
            errors.resize(patterns.len(), 0.0);
            errors
        }
        None => reference
            .errors(&scene, &patterns, &fields)
            .map_err(StageError::Failed)?,
    };
    let families: BTreeSet<String> = names.iter().cloned().collect();
    let families: Vec<String> = families.into_iter().collect();
    let place = |name: &String| families.binary_search(name).unwrap_or_default();
    Ok(Reckoned {
        scene,
        family: names.iter().map(place).collect(),
        families,
        patterns,
        reference,
        fields,
        errors,
    })
}
