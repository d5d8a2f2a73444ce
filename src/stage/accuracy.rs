//! `kind: accuracy` measures the error of each method against a reference, and its time.
//!
//! The reference is a solve stage in `needs`: it costs as much as everything else together and is reused when the list
//! of methods changes. Errors are content. Times differ between runs, so they are measurements in the provenance.

mod content;

use std::collections::BTreeSet;

use super::results::most;
use super::{model, needed, scene, solve};
use deaflow_accuracy::{Benchmark, Candidate, Network, Reference};
use deaflow_base::{Canonical, Fields, InputError, Node};
use deaflow_content::{Accuracy, Packed, Solutions};
use deaflow_fem::geometry_revision;
use deaflow_field::Field;
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object};

pub use content::content;

/// The largest number of needs: the reference and models.
const MOST_NEEDS: usize = 20;

/// The kind `accuracy`.
pub struct AccuracyKind;

impl Kind for AccuracyKind {
    fn name(&self) -> &'static str {
        "accuracy"
    }

    fn recipe(&self) -> u32 {
        3
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Accuracy::open(artifact)?;
        let (methods, families) = (view.methods().read()?, view.families().rows()?);
        let largest = view.error().max().read()?;
        let of = |(row, name): (usize, &String)| {
            (
                format!("max_error.{name}"),
                most(&largest[row * families..(row + 1) * families]),
            )
        };
        Ok(methods.iter().enumerate().map(of).collect())
    }

    fn needs(&self) -> Needs {
        Needs::new(&["solve", "train"], 1, MOST_NEEDS)
    }

    fn schema(&self) -> Vec<Fields> {
        let fields = Fields::new("Measures the error of methods against a reference, and their time.");
        vec![fields.optional("methods", Candidate::schema())]
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        let map = stage.node.fields("an accuracy stage", &["kind", "needs", "methods"])?;
        needed::no_edges_within_cells(stage, needs)?;
        let node = map.optional("needs").unwrap_or(stage.node);
        let references: Vec<&StageDeclaration<'_>> = needs.iter().filter(|need| need.kind == "solve").collect();
        let [reference] = references[..] else {
            return Err(node.error(one_reference(references.len())));
        };
        let named = node.list("needs")?.iter().find(|item| item.is_text(reference.name));
        let named = named.unwrap_or(node);
        let parameters = solve::solver_of(reference.node)?;
        let checked = Reference::new(parameters).map_err(|why| named.error(why.to_string()))?;
        let methods = map.optional("methods");
        let scene = stage.scene.map(scene::read).transpose()?;
        let candidates = candidates_of(methods, scene.as_ref())?;
        if let Some(scene) = &scene {
            let time = checked.settings().time();
            let checked = candidates.iter().try_for_each(|method| match method {
                Candidate::Elements(_) => method.check_scene(scene, None),
                Candidate::InTime(..) if !scene.auto && time.is_some() => method.check_scene(scene, time),
                Candidate::InTime(..) | Candidate::Network(_) => Ok(()),
            });
            checked.map_err(|why| methods.unwrap_or(named).error(why.to_string()))?;
        }
        checked
            .check(&candidates)
            .map_err(|why| methods.unwrap_or(named).error(why.to_string()))?;
        needed::one_state(stage, needs)?;
        Ok(StageCheck {
            warnings: checked.warning(&candidates).into_iter().collect(),
            ..StageCheck::default()
        })
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields("an accuracy stage", &["kind", "needs", "methods"])?;
        let scene = scene.map(scene::read).transpose()?;
        Ok(Box::new(AccuracyStage {
            candidates: candidates_of(map.optional("methods"), scene.as_ref())?,
            revision: scene.as_ref().map_or(0, |scene| {
                // Errors are those of displacements from rest.
                geometry_revision(scene) + u32::from(scene.geometry.sides.is_some())
            }),
        }))
    }
}

/// Reads the methods; by default all that the scene allows.
fn candidates_of(methods: Option<&Node>, scene: Option<&Scene>) -> Result<Vec<Candidate>, InputError> {
    match methods {
        Some(methods) => Candidate::read(methods),
        None => Ok(scene.map_or_else(Candidate::usual, |scene| Candidate::usual_in(scene, None))),
    }
}

struct AccuracyStage {
    candidates: Vec<Candidate>,
    revision: u32,
}

impl Stage for AccuracyStage {
    fn parameters(&self) -> Canonical {
        let methods = self.candidates.iter().map(Candidate::canonical);
        Canonical::map([("methods", methods.collect::<Canonical>())])
    }

    fn revision(&self) -> u32 {
        self.revision
    }

    fn repeats_inputs(&self) -> bool {
        true
    }

    fn unit(&self) -> &'static str {
        "methods"
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        let models = inputs.len().saturating_sub(1);
        Plan::Whole {
            steps: (self.candidates.len() + models) as u64,
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let (mut references, mut networks) = (Vec::new(), Vec::new());
        for input in job.inputs {
            if model::is_in(input) {
                let wrong = |e| StageError::in_artifact(input, e);
                networks.push(Network::from_bytes(&model::weights(input)?).map_err(wrong)?);
            } else {
                references.push(input);
            }
        }
        let [reference] = references[..] else {
            return Err(StageError::input(one_reference(references.len())));
        };
        let failed = StageError::failed;
        let benchmark = benchmark(reference)?;
        let networks = Candidate::networks(networks);
        let candidates: Vec<&Candidate> = self.candidates.iter().chain(&networks).collect();
        let measured = benchmark.measure(&candidates, job.progress).map_err(failed)?;
        for (name, seconds) in benchmark.measurements(&measured) {
            job.measure(name, seconds);
        }
        Ok(content(&benchmark, &measured).object())
    }
}

fn one_reference(found: usize) -> String {
    format!("an accuracy stage needs exactly one solve stage as its reference; `needs` names {found}")
}

/// Reads the samples of a solve stage, stable or not, with their fields.
fn benchmark(solved: &Artifact) -> Result<Benchmark, StageError> {
    let wrong = |e: InputError| StageError::in_artifact(solved, e);
    let view = Solutions::open(solved)?;
    let scene = view.scene().read()?;
    let solver = view.solver().read()?.unwrap_or_default();
    let reference = Reference::from_text(&solver).map_err(wrong)?;
    let (rows, unstable) = (view.rows(), view.unstable().rows());
    let mut patterns = rows.patterns().read()?;
    patterns.extend(unstable.patterns().read()?);
    let mut names = rows.family().read()?;
    names.extend(unstable.family().read()?);
    let mut fields: Vec<Option<Field>> = view.displacement().read()?.into_iter().map(Some).collect();
    // Methods predict displacements from rest.
    if let Some(Packed(rest)) = view.observations().rest().read()? {
        let numbers = 2 * scene.membrane().raster.corners();
        for (field, rest) in fields.iter_mut().flatten().zip(rest.chunks_exact(numbers)) {
            let rest = Field::from_values(field.raster(), rest.to_vec()).map_err(StageError::failed)?;
            *field = field.plus(-1.0, &rest);
        }
    }
    fields.resize(patterns.len(), None);
    let errors = match reference.settings().accuracy() {
        Some(_) => {
            let mut errors = view.meshes().discretisation_error().read()?;
            errors.resize(patterns.len(), 0.0);
            errors
        }
        None => reference
            .errors(&scene, &patterns, &fields)
            .map_err(StageError::failed)?,
    };
    let geometry = reference
        .geometry_errors(&scene, &patterns, &[])
        .map_err(StageError::failed)?;
    let families: BTreeSet<String> = names.iter().cloned().collect();
    let families: Vec<String> = families.into_iter().collect();
    let index = |name: &String| families.binary_search(name).unwrap_or_default();
    Ok(Benchmark {
        scene,
        family: names.iter().map(index).collect(),
        families,
        patterns,
        reference,
        fields,
        errors,
        geometry,
    })
}
