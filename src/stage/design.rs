//! `kind: design` searches patterns that move points where they should go: by the genetic algorithm, judged by a network, an
//! estimate or Newton's method, whichever is the cheapest that is accurate enough unless one is named, and finished along the
//! gradient where that is asked for; or along the gradient alone, for how good a design can be.

mod content;
mod evaluator;
mod options;
mod physics;
mod probe;
mod search;
mod target;

use std::sync::OnceLock;

use serde_json::json;

use super::screening::Screened;
use super::solver::explained;
use crate::base::{Canonical, Fields, InputError, Node};
use crate::orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::scene::Scene;
use crate::store::Object;

use evaluator::Wanted;
use options::{Method, Options};
use physics::Physics;
use target::Target;

/// The kind `design`.
pub struct DesignKind;

const KEYS: [&str; 6] = ["kind", "needs", "case", "targets", "objective", "area"];

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
        let fields = Fields::new("Searches patterns that move points where they should go.").optional(
            "case",
            crate::base::Schema::matching("^[^\\n]{1,60}$").says("A label for tables."),
        );
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
        Ok(Box::new(DesignStage {
            case: map.optional("case").map_or(Ok(String::new()), read_case)?,
            targets: target::read(what, &map, scene.geometry.side.value(), options.penalty.to_f64())?,
            options,
            scene,
            ready: OnceLock::new(),
        }))
    }
}

/// A label on one line.
fn read_case(node: &Node) -> Result<String, InputError> {
    let label = node.text("case")?;
    match label.chars().count() {
        1..=60 if !label.contains('\n') => Ok(label.to_owned()),
        _ => Err(node
            .error("`case` is no label")
            .help("allowed: 1 to 60 characters on one line")),
    }
}

struct DesignStage {
    case: String,
    targets: Vec<Target>,
    options: Options,
    scene: Scene,
    /// Set up by the first target for all of them.
    ready: OnceLock<Physics>,
}

impl DesignStage {
    /// Everything but the targets.
    fn common(&self) -> Canonical {
        let case = Canonical::from(self.case.as_str());
        self.options
            .canonical([("case", case), ("scene", self.scene.canonical())])
    }

    fn chunk(&self, target: &Target) -> Canonical {
        Canonical::map([("stage", self.common()), ("target", target.canonical())])
    }

    /// Finite elements for climbs.
    fn physics(&self) -> Result<&Physics, StageError> {
        if let Some(ready) = self.ready.get() {
            return Ok(ready);
        }
        let screened = Screened::new(&self.scene).and_then(|screened| Physics::new(&screened.scene));
        let physics = screened.map_err(|e| StageError::Failed(explained(&e)))?;
        Ok(self.ready.get_or_init(|| physics))
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
