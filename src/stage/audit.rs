//! `kind: audit` audits the dataset of a solve, import or balance stage; `deaflow audit` also audits files from elsewhere.
//!
//! What follows a stage that needs an audit waits for it, and with `fail_on: error` does not run where the audit has found
//! errors. The audit itself is no input of what follows: a surrogate is none the other for having been audited.

mod again;
mod content;
mod contradictions;
mod held;
mod lineage;
mod source;

use std::path::Path;
use std::time::Instant;

use contradictions::{other_effects, other_scene};
use held::held;
use source::Source;

use super::direct::{DirectError, read_scene};
use super::needs;
use super::results::named;
use deaflow_base::{
    Canonical, Declared as _, Fields, InputError, Length, Node, NodeValue, Parameter, Progress, Quantity, Schema, Seed,
    open_regular, parameters, words,
};
use deaflow_content::{Audit, FROM_FILE, SOLVED, StoredAttribute};
use deaflow_dataset::audit::{AuditError, Dataset, Families, Options, Report, RowSource, audit};
use deaflow_fem::{SceneSimulators, SetupError};
use deaflow_field::SimulatorError;
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use deaflow_pattern::Pattern;
use deaflow_sample as sample;
use deaflow_scene::Scene;
use deaflow_store::{Artifact, Object, StoreError};

pub use again::{Again, again};
pub use content::objection;
pub use deaflow_dataset::audit::{Finding, Severity, Summary, sort};
pub use lineage::{Lineage, trace};

/// Random rows that are simulated on a finer mesh unless said otherwise.
pub const SAMPLES: u64 = 32;

/// Steps of a progress bar: the number of rows is not known beforehand.
const STEPS: u64 = 100;

/// Labels are the same when they are solved again but for the tolerance of the solver, which stops at a residual; this is
/// how much larger, at the most, the error of the displacement is. Elsewhere last bits differ too: by that, 300 images of patterns
/// had estimates that differed from the images of their estimates by 5e-7 of the largest displacement at the most.
const PER_RESIDUAL: f64 = 10.0;
const SAME: f64 = 1e-5;

/// The accuracy that is taken for meant where nothing says anything, as a part of the membrane's side: 0.02 mm of 50 mm.
const USUAL_ACCURACY: f64 = 4e-4;

/// What is taken for rounding where nothing is declared, as a part of the side: 1e-4 mm of 50 mm.
const ROUNDING: f64 = 2e-6;

/// The kinds of stages that hold a dataset.
pub const AUDITED: [&str; 3] = needs::joined(SOLVED, ["balance"]);

/// More rows than this have no dataset.
const MAX_SAMPLES: u64 = 100_000_000;

/// The kind `audit`.
pub struct AuditKind;

impl Kind for AuditKind {
    fn name(&self) -> &'static str {
        "audit"
    }

    fn recipe(&self) -> u32 {
        5
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Audit::open(artifact)?;
        let findings = view.findings().read()?.value::<Vec<Finding>>();
        let findings = findings.map_err(StageError::input)?;
        let count = |severity| findings.iter().filter(|finding| finding.severity == severity).count() as f64;
        Ok(named([
            ("rows", view.max_displacement().rows()? as f64),
            ("errors", count(Severity::Error)),
            ("warnings", count(Severity::Warning)),
        ]))
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &AUDITED,
            least: 1,
            most: 1,
        }
    }

    fn gates(&self) -> bool {
        true
    }

    fn schema(&self) -> Vec<Fields> {
        vec![AuditParameters::fields()]
    }

    fn read(&self, stage: &Node, _scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let parameters = AuditParameters::read_with(stage, &["kind", "needs"])?;
        Ok(Box::new(AuditStage { parameters }))
    }
}

parameters! {
    /// Audits a dataset: values, symmetries, leaks between splits, and its labels by simulation.
    struct AuditParameters as "an audit stage" {
        /// Random rows that are simulated on a finer mesh, or all.
        samples: Count = Count::Some(SAMPLES),
        /// Names the random numbers.
        seed: Seed = 0,
        /// The error that labels may have, where it is not known.
        accuracy: Option<Length> [1e-9..=1e3],
        /// Whether findings that are errors stop what needs this stage.
        fail_on: FailOn = FailOn::Error,
    }
}

words! {
    /// What stops the stages that need an audit.
    enum FailOn {
        /// Findings that are errors.
        Error = "error",
        /// Nothing.
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
                .help("allowed: a whole number, or all")),
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

/// What is asked of an audit.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// Random rows to simulate on a finer mesh; `None` for all.
    pub samples: Option<u64>,
    /// Names the random choice.
    pub seed: u64,
    /// The error that labels may have.
    pub accuracy: Option<Quantity>,
}

struct AuditStage {
    parameters: AuditParameters,
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
    /// Whether the pipeline goes on is no part of what is found.
    fn parameters(&self) -> Canonical {
        let mut entries = Vec::new();
        self.parameters.entries(&mut entries);
        entries.retain(|(key, _)| *key != "fail_on");
        Canonical::map(entries)
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
        let wrong = |why: String| StageError::in_artifact(artifact, why);
        let scene: Option<Scene> = StoredAttribute::new(artifact, "scene").read()?;
        let scene = scene.ok_or_else(|| wrong("it does not say which scene it was made with".to_owned()))?;
        let mut source = Source::of_artifact(artifact, scene.membrane().raster)?;
        // Samples are drawn with repeats, which balancing leaves out. Nothing is known of how others were chosen.
        let is_drawn = source.level.is_none() && source.solver.is_some();
        let start = Instant::now();
        source
            .findings
            .extend(other_effects(&source, &scene).map_err(StageError::failed)?);
        let terms = Terms {
            trust: Trust::Pipeline,
            repeats_are_usual: is_drawn,
        };
        let report =
            carry_out(&source, &scene, &self.parameters.request(), terms, job.progress).map_err(StageError::failed)?;
        job.measure("audit", start.elapsed().as_secs_f64());
        let audit = content::content(report, scene).map_err(StageError::failed)?;
        Ok(audit.object())
    }

    fn blocking_reads_artifact(&self) -> bool {
        self.parameters.fail_on != FailOn::Never
    }

    fn blocks(&self, open: &dyn Fn() -> Result<Artifact, StoreError>) -> Result<Option<String>, StageError> {
        if !self.blocking_reads_artifact() {
            return Ok(None);
        }
        let artifact = open()?;
        let findings = Audit::open(&artifact)?.findings().read()?.value::<Vec<Finding>>();
        let unreadable = |e| StageError::failed(format!("not an audit: {e}"));
        Ok(objection(&findings.map_err(unreadable)?))
    }
}

/// Audits a file in the layout of `deaflow solve`, simulating in the scene of a file; gives what the artifact of an audit
/// stage would say.
///
/// # Errors
/// When one of the files cannot be read, or a simulator not be set up.
pub fn audit_file(file: &Path, scene: &Path, request: &Request, progress: &dyn Progress) -> Result<Audit, DirectError> {
    let scene = read_scene(scene)?;
    let unreadable = |e: StoreError| {
        let help = "the arrays must be in the file itself; or give the stage: deaflow audit PIPELINE.yaml:STAGE";
        InputError::new(e.to_string()).help(help)
    };
    // A pipe would keep who opens it waiting, and a device may have no end.
    open_regular(file).map_err(|e| InputError::new(format!("cannot read {}: {e}", file.display())))?;
    let mut source = Source::of_file(file, scene.membrane().raster).map_err(unreadable)?;
    let failed = |e: SetupError| DirectError::Failed(e.to_string());
    source.findings.extend(other_scene(&source, &scene).map_err(failed)?);
    source.findings.extend(other_effects(&source, &scene).map_err(failed)?);
    let terms = Terms {
        trust: Trust::Nothing,
        repeats_are_usual: false,
    };
    let report =
        carry_out(&source, &scene, request, terms, progress).map_err(|e| DirectError::Failed(e.to_string()))?;
    content::content(report, scene).map_err(|e| DirectError::Failed(e.to_string()))
}

/// Rows of a dataset, to be looked at one by one.
pub struct SourceRows {
    source: Source,
    /// The scene of the audit.
    pub scene: Scene,
}

impl SourceRows {
    /// Cells and displacements of a row; `None` where they are not numbers.
    #[must_use]
    pub fn row(&self, index: usize) -> Option<(Vec<u8>, Vec<f64>)> {
        let batch = self.source.read(index..index + 1).ok()?;
        let cells = batch.cells.iter().map(|&cell| cell as u8).collect();
        // A field that is no field cannot be drawn.
        let numbers = !batch.displacement.is_empty() && batch.displacement.iter().all(|u| u.is_finite());
        numbers.then_some((cells, batch.displacement))
    }
}

/// The rows of a file or an artifact that has been audited, with the scene of its audit.
///
/// # Errors
/// When they cannot be read.
pub fn rows(dataset: Audited<'_>, audit: &Audit) -> Result<SourceRows, StoreError> {
    let raster = audit.scene.membrane().raster;
    let source = match dataset {
        Audited::File(path) => Source::of_file(path, raster),
        Audited::Artifact(artifact) => Source::of_artifact(artifact, raster),
    };
    Ok(SourceRows {
        scene: audit.scene.clone(),
        source: source?,
    })
}

/// What has been audited.
#[derive(Clone, Copy)]
pub enum Audited<'a> {
    /// A file from elsewhere.
    File(&'a Path),
    /// The artifact of a stage.
    Artifact(&'a Artifact),
}

/// Whose word the declarations of a dataset are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trust {
    /// That of the pipeline in which it is audited.
    Pipeline,
    /// Its own.
    Nothing,
}

/// On what terms a dataset is audited.
#[derive(Clone, Copy, Debug)]
struct Terms {
    trust: Trust,
    repeats_are_usual: bool,
}

/// The families that there are. Any pattern may come from a file, and on another device than the source paper's it is not known what a
/// family draws.
struct KnownFamilies {
    is_paper: bool,
}

impl Families for KnownFamilies {
    fn admits(&self, family: &str, pattern: &Pattern) -> Option<bool> {
        match family {
            FROM_FILE => Some(true),
            drawn => sample::admits(drawn, pattern).map(|fits| fits || !self.is_paper),
        }
    }
}

fn carry_out(
    source: &Source,
    scene: &Scene,
    request: &Request,
    terms: Terms,
    progress: &dyn Progress,
) -> Result<Report, AuditError> {
    if !source.is_readable() {
        return Ok(Report {
            findings: source.findings.clone(),
            ..Report::default()
        });
    }
    let (held, loose) = held(source, scene, request, terms.trust);
    let simulators = SceneSimulators::new(scene, held.method, held.residual).map_err(SimulatorError::new)?;
    let simulators = match &source.solver {
        Some(solver) => simulators.through(solver),
        None => simulators,
    };
    let device = super::device_of(scene);
    let dataset = Dataset {
        device: &device,
        len: source.len(),
        rows: source,
        columns: source.columns.clone(),
        declared: source.declared,
        origins: source.origins.as_deref(),
        bins: source.bins,
        families: &KnownFamilies {
            is_paper: super::is_of_paper(&scene.outline()),
        },
    };
    let options = Options {
        samples: request
            .samples
            .map(|samples| usize::try_from(samples).unwrap_or(usize::MAX)),
        seed: request.seed,
        accuracy: held.accuracy,
        usual_accuracy: USUAL_ACCURACY * scene.side_mm(),
        tolerance: held.tolerance,
        most_declared: held.most_declared,
        rounding: ROUNDING * scene.side_mm(),
        level: source.level.clone(),
        repeats_are_usual: terms.repeats_are_usual,
    };
    let shown = std::cell::Cell::new((0_usize, 0_u64));
    let advance = |rows: usize| {
        let (done, told) = (shown.get().0 + rows, shown.get().1);
        let now = STEPS * done as u64 / dataset.len.max(1) as u64;
        progress.advance(now - told);
        shown.set((done, now));
    };
    let mut report = audit(&dataset, &simulators, &options, &advance)?;
    report.findings.extend(loose);
    report.findings.extend(source.findings.iter().cloned());
    sort(&mut report.findings);
    Ok(report)
}
