//! `kind: audit` audits the dataset of a solve, import or balance stage; `deaflow audit` also audits files from
//! elsewhere.
//!
//! Stages that list an audit in `needs` wait for it, and with `fail_on: error` they do not run if it has found errors.
//! The audit is not an input of these stages: their artifacts are the same without it.

mod content;
mod contradictions;
mod label_limits;
mod lineage;
mod resimulator;
mod rows;
mod run;
mod shapes;
mod source;

use std::time::Instant;

use super::needed;
use super::results::named;
use super::scene::area_revision;
use contradictions::other_effects;
use deaflow_base::{
    Canonical, Declared as _, Fields, InputError, Length, Node, NodeValue, Parameter, Schema, Seed, parameters, words,
};
use deaflow_content::{Audit, StoredAttribute};
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object, StoreError};
use label_limits::Trust;
use run::{STEPS, run};
use source::Source;

pub use content::{findings, objection};
pub use deaflow_dataset::audit::{Finding, Severity, Summary, sort};
pub use lineage::{Lineage, trace};
pub use resimulator::Resimulator;
pub use rows::{Audited, SourceRows, rows};
pub use run::{Request, audit_file};

/// The default number of random rows that are simulated on a finer mesh.
pub const SAMPLES: u64 = 32;

/// The largest number of random rows.
const MAX_SAMPLES: u64 = 100_000_000;

/// The kinds of stages that hold a dataset.
pub const AUDITED: [&str; 3] = ["solve", "import", "balance"];

/// The kind `audit`.
pub struct AuditKind;

impl Kind for AuditKind {
    fn name(&self) -> &'static str {
        "audit"
    }

    fn recipe(&self) -> u32 {
        6
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let findings = content::findings(artifact)?;
        let count = |severity| findings.iter().filter(|finding| finding.severity == severity).count() as f64;
        Ok(named([
            ("rows", Audit::open(artifact)?.max_displacement().rows()? as f64),
            ("errors", count(Severity::Error)),
            ("warnings", count(Severity::Warning)),
        ]))
    }

    fn needs(&self) -> Needs {
        Needs::new(&AUDITED, 1, 1)
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        needed::no_edges_within_cells(stage, needs)?;
        Ok(StageCheck::default())
    }

    fn gates(&self) -> bool {
        true
    }

    fn schema(&self) -> Vec<Fields> {
        vec![AuditParameters::fields()]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let parameters = AuditParameters::read_with(stage, &["kind", "needs"])?;
        Ok(Box::new(AuditStage {
            parameters,
            revision: area_revision(scene)?,
        }))
    }
}

parameters! {
    /// Audits a dataset: values, symmetries, leaks between splits, and its labels by simulation.
    struct AuditParameters as "an audit stage" {
        /// Random rows that are simulated on a finer mesh, or all.
        samples: Count = Count::Some(SAMPLES),
        /// Seed of the random numbers.
        seed: Seed = 0,
        /// The allowed error of labels, if the dataset does not declare it.
        accuracy: Option<Length> [1e-9..=1e3],
        /// Whether findings that are errors stop the stages that need this one.
        fail_on: FailOn = FailOn::Error,
    }
}

words! {
    /// Which findings stop the stages that need an audit.
    enum FailOn {
        /// Findings that are errors.
        Error = "error",
        /// None.
        Never = "never",
    }
}

/// A number of rows, or all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Count {
    Some(u64),
    All,
}

impl Parameter for Count {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match node.value() {
            NodeValue::Text(text) if text == "all" => Ok(Self::All),
            NodeValue::Number(_) => node.integer(key, 0, MAX_SAMPLES).map(Self::Some),
            _ => Err(node
                .error(format!("`{key}` cannot be {}", node.found()))
                .help("allowed: an integer, or all")),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(match self {
            Self::Some(count) => Canonical::from(*count),
            Self::All => Canonical::from("all"),
        })
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Schema::integer(0, MAX_SAMPLES), Schema::word(&["all"])])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

struct AuditStage {
    parameters: AuditParameters,
    revision: u32,
}

impl AuditParameters {
    fn request(&self) -> Request {
        Request {
            samples: match self.samples {
                Count::Some(count) => Some(count),
                Count::All => None,
            },
            seed: self.seed.0,
            accuracy: self.accuracy.as_deref().copied(),
        }
    }
}

impl Stage for AuditStage {
    /// `fail_on` does not change the findings.
    fn parameters(&self) -> Canonical {
        let mut entries = Vec::new();
        self.parameters.entries(&mut entries);
        entries.retain(|(key, _)| *key != "fail_on");
        Canonical::map(entries)
    }

    fn revision(&self) -> u32 {
        self.revision
    }

    fn unit(&self) -> &'static str {
        "percent"
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole { steps: STEPS }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let [artifact] = job.inputs else {
            return Err(StageError::failed("an audit stage audits one dataset"));
        };
        let scene: Option<Scene> = StoredAttribute::new(artifact, "scene").read()?;
        let scene = scene.ok_or_else(|| StageError::in_artifact(artifact, "it does not name its scene"))?;
        let mut source = Source::of_artifact(artifact, scene.membrane().raster)?;
        let start = Instant::now();
        let failed = StageError::failed;
        source.findings.extend(other_effects(&source, &scene).map_err(failed)?);
        let report = run(
            &source,
            &scene,
            &self.parameters.request(),
            Trust::Pipeline,
            job.progress,
        );
        let report = report.map_err(StageError::failed)?;
        job.measure("audit", start.elapsed().as_secs_f64());
        let audit = content::content(report, Some(artifact.digest().to_string()), scene).map_err(StageError::failed)?;
        Ok(audit.object())
    }

    fn blocking_reads_artifact(&self) -> bool {
        self.parameters.fail_on != FailOn::Never
    }

    fn blocks(&self, open: &dyn Fn() -> Result<Artifact, StoreError>) -> Result<Option<String>, StageError> {
        if !self.blocking_reads_artifact() {
            return Ok(None);
        }
        Ok(objection(&content::findings(&open()?)?))
    }
}
