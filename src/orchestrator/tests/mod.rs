//! Toy kinds and a toy laboratory: what ran, and what did not, is read from the events.

mod caching;
mod concurrency;
mod elsewhere;
mod keeping;
mod recovery;
mod refusals;
mod rounds;
mod sweeps;

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use tempfile::TempDir;

use super::*;
use deaflow_base::{ActionKey, ArtifactId, Canonical, Document, Fields, InputError, Node, Override, Schema};
use deaflow_store::{Artifact, Data, Dataset, Object, Store};

/// Samples in a chunk of the toy kinds.
const CHUNK: u64 = 10;

/// `count` numbers, chunked: number i is (i + `offset`). A chunk can be told to fail.
pub(super) struct Count {
    pub(super) fails: AtomicU64,
    pub(super) recipe: u32,
}

struct CountStage {
    count: u64,
    offset: u64,
    fails: &'static AtomicU64,
}

impl Kind for &'static Count {
    fn name(&self) -> &'static str {
        "count"
    }

    fn recipe(&self) -> u32 {
        self.recipe
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &[],
            least: 0,
            most: 0,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        vec![
            Fields::new("A toy.")
                .required("count", Schema::integer(1, 1000))
                .optional("offset", Schema::integer(0, 1000)),
        ]
    }

    fn read(&self, stage: &Node, _: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields("a `count` stage", &["kind", "needs", "count", "offset"])?;
        let offset = map
            .optional("offset")
            .map_or(Ok(0), |node| node.integer("offset", 0, 1000))?;
        Ok(Box::new(CountStage {
            count: map.required("a `count` stage", "count")?.integer("count", 1, 100_000)?,
            offset,
            fails: &self.fails,
        }))
    }
}

impl Stage for CountStage {
    fn parameters(&self) -> Canonical {
        Canonical::map([("count", self.count.into()), ("offset", self.offset.into())])
    }

    fn plan(&self, _: &[Input]) -> Plan {
        let chunks = (0..self.count.div_ceil(CHUNK)).map(|i| {
            let samples = CHUNK.min(self.count - i * CHUNK);
            let first = (i * CHUNK).into();
            let parameters = [
                ("first", first),
                ("samples", samples.into()),
                ("offset", self.offset.into()),
            ];
            Chunk {
                parameters: Canonical::map(parameters),
                inputs: Vec::new(),
                samples,
            }
        });
        Plan::Chunks(chunks.collect())
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let chunk = job.chunk.expect("the plan has chunks");
        let Canonical::Map(parameters) = &chunk.parameters else {
            panic!("a map was planned");
        };
        let first: u64 = parameters["first"].to_string().parse().unwrap();
        if self.fails.load(Ordering::SeqCst) == first / CHUNK {
            return Err(StageError::failed(format!("chunk {} was told to fail", first / CHUNK)));
        }
        job.progress.advance(chunk.samples);
        Ok(numbers(
            (first..first + chunk.samples).map(|i| i + self.offset).collect(),
        ))
    }

    fn unstable(&self, artifact: &Artifact) -> Result<u64, StageError> {
        Ok(artifact.u64s("numbers")?.1.iter().filter(|n| **n % 7 == 0).count() as u64)
    }
}

fn numbers(values: Vec<u64>) -> Object {
    Object::default().with(
        "numbers",
        Dataset::new("1", "Numbers", &[values.len()], Data::U64(values)),
    )
}

/// Each number of its inputs divided by `by`, in the chunks of the inputs.
struct Divide;

struct DivideStage(u64);

impl Kind for Divide {
    fn name(&self) -> &'static str {
        "divide"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["count", "divide"],
            least: 1,
            most: usize::MAX,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        vec![Fields::new("A toy.").required("by", Schema::integer(1, 100))]
    }

    fn read(&self, stage: &Node, _: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields("a `divide` stage", &["kind", "needs", "by"])?;
        Ok(Box::new(DivideStage(
            map.required("a `divide` stage", "by")?.integer("by", 1, 100)?,
        )))
    }
}

impl Stage for DivideStage {
    fn parameters(&self) -> Canonical {
        Canonical::map([("by", self.0.into())])
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        let parts = inputs.iter().flat_map(|input| &input.parts);
        let chunks = parts.map(|(digest, samples)| Chunk {
            parameters: self.parameters(),
            inputs: vec![*digest],
            samples: *samples,
        });
        Plan::Chunks(chunks.collect())
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let (_, values) = job.inputs[0].u64s("numbers")?;
        Ok(numbers(values.into_iter().map(|n| n / self.0).collect()))
    }

    fn attributes(&self) -> Vec<(String, String)> {
        vec![("by".into(), self.0.to_string())]
    }
}

/// The sum over all inputs, padded with bytes that make its file as large as one likes.
struct Sum;

struct SumStage {
    power: u64,
    padding: u64,
}

impl Kind for Sum {
    fn name(&self) -> &'static str {
        "sum"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["count", "divide", "sum"],
            least: 1,
            most: 2,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        vec![Fields::new("A toy.")]
    }

    fn read(&self, stage: &Node, _: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields("a `sum` stage", &["kind", "needs", "power", "padding"])?;
        let optional =
            |key: &str, default, most| map.optional(key).map_or(Ok(default), |node| node.integer(key, 0, most));
        Ok(Box::new(SumStage {
            power: optional("power", 1, 5)?,
            padding: optional("padding", 0, 1 << 30)?,
        }))
    }
}

impl Stage for SumStage {
    fn parameters(&self) -> Canonical {
        Canonical::map([("power", self.power.into()), ("padding", self.padding.into())])
    }

    fn plan(&self, _: &[Input]) -> Plan {
        Plan::Whole { steps: 1 }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let mut sum = 0;
        for input in job.inputs {
            sum += input
                .u64s("numbers")?
                .1
                .iter()
                .map(|n| n.pow(self.power as u32))
                .sum::<u64>();
        }
        let padding = vec![7; self.padding as usize];
        Ok(numbers(vec![sum]).with(
            "padding",
            Dataset::new("", "Padding", &[padding.len()], Data::U8(padding)),
        ))
    }
}

fn check_scene(scene: &Node) -> Result<(), InputError> {
    let scene = scene.fields("the scene", &["drive"])?;
    let drive = scene.required("the scene", "drive")?.fields("`drive`", &["voltage"])?;
    drive
        .required("`drive`", "voltage")?
        .integer("voltage", 0, 9000)
        .map(|_| ())
}

const PIPELINE: &str = "
version: 1
name: toy
scene: { drive: { voltage: 5 } }
stages:
  small: { kind: count, count: 35 }
  large: { kind: count, count: 20, offset: 100 }
  halved: { kind: divide, needs: [small, large], by: 2 }
  total: { kind: sum, needs: [halved] }
";

/// A store in a temporary folder, and kinds of its own.
struct Laboratory {
    folder: TempDir,
    count: &'static Count,
    registry: Registry,
}

impl Laboratory {
    fn new() -> Self {
        Self::with_recipe(tempfile::tempdir().unwrap(), 1)
    }

    /// One whose store is shared by claims.
    fn by_claims() -> Self {
        let lab = Self::new();
        std::fs::create_dir(lab.store().root().join("locks/processes")).unwrap();
        lab
    }

    fn with_recipe(folder: TempDir, recipe: u32) -> Self {
        // Kinds live as long as the program; so must those of a test.
        let count: &'static Count = Box::leak(Box::new(Count {
            fails: AtomicU64::new(u64::MAX),
            recipe,
        }));
        let kinds: Vec<&'static dyn Kind> = vec![Box::leak(Box::new(count)), &Divide, &Sum];
        Self {
            folder,
            count,
            registry: Registry {
                kinds,
                complete_scene: |_| Ok(()),
                check_scene,
                scene_schema: Schema::text,
                most_stages: MOST_STAGES,
            },
        }
    }

    fn store(&self) -> Store {
        Store::open(&self.folder.path().join("store")).unwrap()
    }

    fn pipeline(&self, text: &str, sets: &[&str]) -> Pipeline {
        let document = Document::from_text(Path::new("toy.yaml"), text).unwrap();
        let sets: Vec<Override> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
        Pipeline::read(document, &sets, &self.registry).unwrap()
    }

    /// Runs, and says what ran: one line an event, the chunks of a stage in order.
    fn run_text(&self, text: &str, sets: &[&str]) -> (RunOutcome, Vec<String>) {
        let (outcome, log) = self.run_with(text, sets, &RunOptions::default());
        (outcome.unwrap(), log)
    }

    fn run_with(
        &self,
        text: &str,
        sets: &[&str],
        options: &RunOptions<'_>,
    ) -> (Result<RunOutcome, RunError>, Vec<String>) {
        let log = Mutex::new(Vec::new());
        let listener = |event: &Event| log.lock().unwrap().extend(line(event));
        let pipeline = self.pipeline(text, sets);
        let outcome = run(&pipeline, &self.store(), options, &environment(), &listener);
        let mut log = log.into_inner().unwrap();
        sort_chunks(&mut log);
        (outcome, log)
    }

    fn run(&self, sets: &[&str]) -> Vec<String> {
        let (outcome, log) = self.run_text(PIPELINE, sets);
        assert!(outcome.failures.is_empty(), "{:?}", outcome.failures);
        log
    }

    /// Stage by stage "name outcome built+reused: why".
    fn plan(&self, sets: &[&str]) -> Vec<String> {
        self.reports(sets).iter().map(summary).collect()
    }

    fn reports(&self, sets: &[&str]) -> Vec<StageReport> {
        plan(&self.pipeline(PIPELINE, sets), &self.store(), None, &environment()).unwrap()
    }

    fn digests(&self, sets: &[&str]) -> Vec<Option<ArtifactId>> {
        let (outcome, _) = self.run_text(PIPELINE, sets);
        outcome.stages.iter().map(|stage| stage.digest).collect()
    }

    fn record_file(&self, key: &ActionKey) -> PathBuf {
        let name = key.to_string();
        self.store().root().join("records").join(&name[..2]).join(name)
    }

    fn object(&self, digest: &ArtifactId) -> PathBuf {
        self.store().artifact(digest).unwrap().path().to_owned()
    }
}

fn environment() -> Environment {
    Environment {
        host: "laboratory".into(),
        version: "0".into(),
        build: "none".into(),
        target: "none".into(),
        clock,
    }
}

/// Ticks by a millisecond at each reading, so that runs have an order.
fn clock() -> SystemTime {
    static TICKS: AtomicU64 = AtomicU64::new(0);
    UNIX_EPOCH + Duration::from_millis(TICKS.fetch_add(1, Ordering::SeqCst))
}

fn line(event: &Event) -> Option<String> {
    match event {
        Event::StageReused(stage) => Some(format!("reused {}", stage.name)),
        Event::StageStarted { name, steps, why, .. } => Some(format!("start {name} ({steps}): {why}")),
        Event::ChunkBuilt { name, chunk } => Some(format!("chunk {name} {chunk}")),
        Event::StageFinished(stage) => Some(format!("built {}", summary(stage))),
        Event::StageFailed(stage) => Some(format!("failed {}", stage.name)),
        Event::StageSkipped(stage) => Some(format!("skipped {}", summary(stage))),
        Event::Warning { text } => Some(format!("warning {text}")),
        Event::RunStarted { .. }
        | Event::Progress { .. }
        | Event::Part { .. }
        | Event::Resumed { .. }
        | Event::Note { .. } => None,
    }
}

fn summary(stage: &StageReport) -> String {
    let why = stage.why.as_ref().map_or_else(String::new, |why| format!(": {why}"));
    let outcome = format!("{:?}", stage.outcome).to_lowercase();
    format!(
        "{} {outcome} {}+{}{why}",
        stage.name, stage.chunks_built, stage.chunks_reused
    )
}

/// Chunks finish in any order; all else has one.
fn sort_chunks(log: &mut [String]) {
    log.chunk_by_mut(|a, b| a.starts_with("chunk") && b.starts_with("chunk"))
        .for_each(<[String]>::sort);
}
