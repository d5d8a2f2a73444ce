//! `kind: design` searches patterns that move points where they should go: by the genetic algorithm, judged by a network, an
//! estimate or Newton's method, whichever is the cheapest that is accurate enough unless one is named, and finished along the
//! gradient where that is asked for; or along the gradient alone, for how good a design can be.

mod content;
mod evaluator;
mod margins;
mod options;
mod physics;
mod probe;
mod search;
mod shortage;
mod target;

use std::sync::OnceLock;

use serde_json::json;

use super::constraints::WantedConstraints;
use super::screening::Screened;
use super::solver::explained;
use crate::base::{Canonical, Fields, InputError, Node, NodeValue, Schema};
use crate::fem::SetupError;
use crate::orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::scene::Scene;
use crate::store::Object;

use evaluator::Wanted;
use margins::Margins;
use options::{Method, Options};
use physics::Physics;
use target::Target;

/// The kind `design`.
pub struct DesignKind;

const KEYS: [&str; 7] = ["kind", "needs", "case", "targets", "objective", "area", "constraints"];

impl Kind for DesignKind {
    fn name(&self) -> &'static str {
        "design"
    }

    fn recipe(&self) -> u32 {
        3
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["train"],
            least: 0,
            most: 1,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let fields = Fields::new("Searches patterns that move points where they should go.")
            .optional("case", Schema::matching("^[^\\n]{1,60}$").says("A label for tables."));
        let fields = fields.optional("constraints", WantedConstraints::schema());
        let fields = Options::schema(target::schema(fields)).rule(json!({
            "if": { "required": ["evaluator"], "properties": { "evaluator": { "const": "surrogate" } } },
            "then": { "required": ["needs"] },
        }));
        vec![fields]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a design stage";
        let map = stage.fields(what, &[&KEYS[..], &Options::KEYS[..]].concat())?;
        let scene = super::scene_of(stage, scene)?;
        let options = Options::read(what, &map)?;
        let network = map.optional("needs");
        if options.evaluator == Wanted::Surrogate && network.is_none() {
            return Err(stage
                .error("`evaluator: surrogate` judges by a network, and the stage needs none")
                .help("add `needs: [STAGE]` with a stage of kind `train`, or take another evaluator"));
        }
        if let Some(node) = network.filter(|_| options.method == Method::Adjoint) {
            return Err(node
                .error("`method: adjoint` uses finite elements alone, and the stage needs a network")
                .help("leave `needs` out"));
        }
        let side = scene.geometry.side.value();
        let constraints = map.optional("constraints");
        let constraints = constraints.map(|node| read_constraints(node, &scene)).transpose()?;
        let targets = target::read(what, &map, side, options.penalty.to_f64())?;
        let constraints = constraints.unwrap_or_else(WantedConstraints::none);
        for target in &targets {
            if let Some(area) = target.area.fraction() {
                let node = map.optional("area").or(map.optional("constraints")).unwrap_or(stage);
                constraints.check_area(node, area, options.tolerance.to_f64())?;
            }
        }
        Ok(Box::new(DesignStage {
            case: map.optional("case").map_or(Ok(String::new()), read_case)?,
            targets,
            constraints,
            options,
            scene,
            ready: OnceLock::new(),
        }))
    }
}

/// Constraints on patterns of a scene, whose breakdown strength must be known where a margin from it is asked for.
fn read_constraints(node: &Node, scene: &Scene) -> Result<WantedConstraints, InputError> {
    let constraints = WantedConstraints::read(node, scene.geometry.side.value())?;
    let margin = constraints.constraints().limits().breakdown_margin;
    if margin.is_some() && margins::strength(scene).is_none() {
        let at = node.peek("breakdown_margin").unwrap_or(node);
        return Err(at
            .error("a margin from breakdown is asked for, and the scene does not know at which field the elastomer breaks down")
            .help("add `dielectric_breakdown` to the scene's `properties`"));
    }
    Ok(constraints)
}

/// A label on one line.
fn read_case(node: &Node) -> Result<String, InputError> {
    let label = node.text("case")?;
    // Text in artifacts is as short as that in bytes.
    match label.len() {
        1..=60 if !label.contains('\n') && matches!(node.value(), NodeValue::Text(_)) => Ok(label.to_owned()),
        _ => Err(node
            .error("`case` is no label")
            .help("allowed: 1 to 60 letters on one line; a number in quotes")),
    }
}

struct DesignStage {
    case: String,
    targets: Vec<Target>,
    constraints: WantedConstraints,
    options: Options,
    scene: Scene,
    /// Set up by the first target for all of them.
    ready: OnceLock<Ready>,
}

/// Finite elements: for climbs, and for margins where they are asked for.
struct Ready {
    physics: Physics,
    margins: Option<Margins>,
}

impl DesignStage {
    /// Everything but the targets.
    fn common(&self) -> Canonical {
        let case = Canonical::from(self.case.as_str());
        let constraints = self.constraints.canonical();
        self.options.canonical([
            ("case", case),
            ("constraints", constraints),
            ("scene", self.scene.canonical()),
        ])
    }

    fn chunk(&self, target: &Target) -> Canonical {
        Canonical::map([("stage", self.common()), ("target", target.canonical())])
    }

    fn ready(&self) -> Result<&Ready, StageError> {
        if let Some(ready) = self.ready.get() {
            return Ok(ready);
        }
        let ready = || -> Result<Ready, SetupError> {
            let screened = Screened::new(&self.scene)?;
            Ok(Ready {
                physics: Physics::new(&screened.scene)?,
                margins: Margins::new(&screened.scene, self.constraints.constraints())?,
            })
        };
        let ready = ready().map_err(|e| StageError::Failed(explained(&e)))?;
        Ok(self.ready.get_or_init(|| ready))
    }
}

impl Stage for DesignStage {
    fn parameters(&self) -> Canonical {
        let targets = Canonical::List(self.targets.iter().map(Target::canonical).collect());
        Canonical::map([("stage", self.common()), ("targets", targets)])
    }

    fn weight(&self) -> f64 {
        self.options.weight()
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        let chunk = |target: &Target| Chunk {
            parameters: self.chunk(target),
            inputs: inputs.iter().map(|input| input.digest).collect(),
            samples: self.options.steps(),
        };
        Plan::Chunks(self.targets.iter().map(chunk).collect())
    }

    fn pieces(&self, _inputs: u64) -> u64 {
        self.targets.len() as u64
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let wanted = job.chunk.map(|chunk| &chunk.parameters);
        let target = self.targets.iter().find(|target| Some(&self.chunk(target)) == wanted);
        let target = target.ok_or_else(|| StageError::Failed("a chunk of a design stage has one target".to_owned()))?;
        search::search(self, target, job)
    }

    fn attributes(&self) -> Vec<(String, String)> {
        vec![
            ("scene".to_owned(), self.scene.to_text()),
            ("method".to_owned(), self.options.method.name().to_owned()),
        ]
    }
}
