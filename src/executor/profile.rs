//! The profile of a cluster, `cluster.yaml`: the resources of each stage. It is not part of action keys, because
//! results do not depend on it.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use deaflow_base::{CpuLevel, Document, InputError, Map, Node};
use deaflow_orchestrator::{Pipeline, StageSpec};

/// The engine that starts workers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineKind {
    /// `sbatch`, `squeue`, `scancel`.
    Slurm,
    /// A command of the user.
    Command,
}

/// The resources of the workers of a stage.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Resources {
    /// Largest number of workers at a time.
    pub workers: u32,
    /// Threads of each worker.
    pub threads: u32,
    /// Memory of each worker, MiB; by default that of the engine.
    pub memory: Option<u64>,
    /// Time limit of a worker; by default that of the engine.
    pub time: Option<Duration>,
    /// The partition in which they are queued.
    pub partition: Option<String>,
    /// GPUs of each worker.
    pub gpus: u32,
    /// Whether the engine restarts a worker whose node has failed.
    pub requeue: bool,
    /// How often in succession workers that built nothing are restarted.
    pub retries: u32,
}

/// A table of resources; missing values come from the next table.
#[derive(Clone, Debug, Default)]
struct Table {
    workers: Option<u32>,
    threads: Option<u32>,
    memory: Option<u64>,
    time: Option<Duration>,
    partition: Option<String>,
    gpus: Option<u32>,
    requeue: Option<bool>,
    retries: Option<u32>,
}

/// Options for Slurm.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlurmOptions {
    /// `--account`.
    pub account: Option<String>,
    /// Further arguments of `sbatch`.
    pub extra: Vec<String>,
}

/// The profile of a cluster.
#[derive(Clone, Debug)]
pub struct Profile {
    /// The engine, if given.
    pub engine: Option<EngineKind>,
    /// The instruction set that all workers must support.
    pub cpu: CpuLevel,
    /// Options for Slurm.
    pub slurm: SlurmOptions,
    /// The command that submits workers to another engine.
    pub submit: Option<String>,
    /// The command that cancels them.
    pub cancel: Option<String>,
    /// Shell commands before each worker.
    pub environment: Vec<String>,
    defaults: Table,
    kinds: BTreeMap<String, Table>,
    stages: BTreeMap<String, Table>,
}

const KEYS: [&str; 9] = [
    "version",
    "executor",
    "cpu",
    "defaults",
    "kinds",
    "stages",
    "slurm",
    "command",
    "environment",
];

const RESOURCES: [&str; 8] = [
    "workers",
    "threads",
    "memory",
    "time",
    "partition",
    "gpus",
    "requeue",
    "retries",
];

/// Units of memory, in MiB.
const UNITS: [(&str, f64); 6] = [
    ("MB", 1e6 / 1_048_576.0),
    ("GB", 1e9 / 1_048_576.0),
    ("TB", 1e12 / 1_048_576.0),
    ("MiB", 1.0),
    ("GiB", 1024.0),
    ("TiB", 1_048_576.0),
];

/// The largest memory of a worker, MiB.
const MAX_MEMORY: f64 = 1_073_741_824.0;

/// The largest time limit of a worker.
const MAX_TIME: Duration = Duration::from_secs(366 * 24 * 3600);

impl Resources {
    /// Returns the time limit in minutes, rounded up.
    #[must_use]
    pub fn minutes(&self) -> Option<u64> {
        self.time.map(|time| time.as_secs().div_ceil(60))
    }
}

impl Default for Profile {
    fn default() -> Self {
        Self {
            engine: None,
            cpu: CpuLevel::V3,
            slurm: SlurmOptions::default(),
            submit: None,
            cancel: None,
            environment: Vec::new(),
            defaults: Table::default(),
            kinds: BTreeMap::new(),
            stages: BTreeMap::new(),
        }
    }
}

impl Profile {
    /// Reads a profile for a pipeline from the text of its file. `kinds` are the known kinds of stages.
    ///
    /// # Errors
    /// If a key or value is invalid, or a kind or stage is unknown.
    pub fn read(path: &Path, text: &str, pipeline: &Pipeline, kinds: &[&str]) -> Result<Self, InputError> {
        const WHAT: &str = "the profile";
        let document = Document::from_text(path, text)?;
        let map = document.root.fields(WHAT, &KEYS)?;
        map.required(WHAT, "version")?.integer("version", 1, 1)?;
        let command = map.optional("command");
        let command = command
            .map(|node| node.fields("`command`", &["submit", "cancel"]))
            .transpose()?;
        let slurm = map.optional("slurm");
        let slurm = slurm
            .map(|node| node.fields("`slurm`", &["account", "extra"]))
            .transpose()?;
        let stages: Vec<&str> = pipeline.stages.iter().map(|stage| stage.name.as_str()).collect();
        let sweeps = pipeline.sweeps.iter().map(|sweep| sweep.name.as_str());
        let stages: Vec<&str> = stages.into_iter().chain(sweeps).collect();
        let cpu = map
            .optional("cpu")
            .map(|node| node.word("cpu", &CpuLevel::NAMES))
            .transpose()?;
        Ok(Self {
            engine: map.optional("executor").map(engine).transpose()?,
            cpu: cpu.and_then(CpuLevel::from_name).unwrap_or(CpuLevel::V3),
            slurm: SlurmOptions {
                account: slurm.as_ref().map_or(Ok(None), |map| text_of(map, "account"))?,
                extra: slurm.as_ref().map_or(Ok(Vec::new()), |map| texts_of(map, "extra"))?,
            },
            submit: command.as_ref().map_or(Ok(None), |map| text_of(map, "submit"))?,
            cancel: command.as_ref().map_or(Ok(None), |map| text_of(map, "cancel"))?,
            environment: texts_of(&map, "environment")?,
            defaults: map
                .optional("defaults")
                .map_or(Ok(Table::default()), |node| table(node, "`defaults`"))?,
            kinds: tables(&map, "kinds", kinds)?,
            stages: tables(&map, "stages", &stages)?,
        })
    }

    /// Returns the resources of a stage: each value is that of the stage, or else of its sweep, its kind or the
    /// defaults.
    #[must_use]
    pub fn resources(&self, pipeline: &Pipeline, stage: &StageSpec) -> Resources {
        let sweep = pipeline.sweeps.iter().find(|sweep| sweep.stages.contains(&stage.name));
        let tables = [
            self.stages.get(&stage.name),
            sweep.and_then(|sweep| self.stages.get(&sweep.name)),
            self.kinds.get(stage.kind.name()),
            Some(&self.defaults),
        ];
        let mut all = Table::default();
        for table in tables.into_iter().flatten().cloned() {
            all = Table {
                workers: all.workers.or(table.workers),
                threads: all.threads.or(table.threads),
                memory: all.memory.or(table.memory),
                time: all.time.or(table.time),
                partition: all.partition.or(table.partition),
                gpus: all.gpus.or(table.gpus),
                requeue: all.requeue.or(table.requeue),
                retries: all.retries.or(table.retries),
            };
        }
        Resources {
            workers: all.workers.unwrap_or(1),
            threads: all.threads.unwrap_or(1),
            memory: all.memory,
            time: all.time,
            partition: all.partition,
            gpus: all.gpus.unwrap_or(0),
            requeue: all.requeue.unwrap_or(true),
            retries: all.retries.unwrap_or(3),
        }
    }
}

fn engine(node: &Node) -> Result<EngineKind, InputError> {
    Ok(match node.word("executor", &["slurm", "command"])? {
        "slurm" => EngineKind::Slurm,
        _ => EngineKind::Command,
    })
}

fn text_of(map: &Map<'_>, key: &str) -> Result<Option<String>, InputError> {
    map.optional(key).map(|node| line(node, key)).transpose()
}

fn texts_of(map: &Map<'_>, key: &str) -> Result<Vec<String>, InputError> {
    let Some(node) = map.optional(key) else {
        return Ok(Vec::new());
    };
    node.list(key)?.iter().map(|node| line(node, key)).collect()
}

/// Reads a text of one line.
fn line(node: &Node, key: &str) -> Result<String, InputError> {
    let text = node.text(key)?;
    match text.trim().is_empty() || text.contains(['\n', '\r', '\0']) {
        true => Err(node.error(format!("`{key}` must be one line of text"))),
        false => Ok(text.to_owned()),
    }
}

fn tables(map: &Map<'_>, key: &'static str, known: &[&str]) -> Result<BTreeMap<String, Table>, InputError> {
    let Some(node) = map.optional(key) else {
        return Ok(BTreeMap::new());
    };
    let checked = node.fields(&format!("`{key}`"), known)?;
    let read = |(name, node): &(Node, Node)| {
        let name = name.text(key)?.to_owned();
        let table = table(node, &format!("`{key}.{name}`"))?;
        Ok((name, table))
    };
    checked.entries().iter().map(read).collect()
}

fn table(node: &Node, what: &str) -> Result<Table, InputError> {
    let map = node.fields(what, &RESOURCES)?;
    let count = |key: &str, low, high| {
        let node = map.optional(key);
        let number = node.map(|node| node.integer(key, low, high)).transpose()?;
        Ok(number.and_then(|number| u32::try_from(number).ok()))
    };
    Ok(Table {
        workers: count("workers", 1, 100_000)?,
        threads: count("threads", 1, 1024)?,
        memory: map.optional("memory").map(memory).transpose()?,
        time: map.optional("time").map(time).transpose()?,
        partition: text_of(&map, "partition")?,
        gpus: count("gpus", 0, 64)?,
        requeue: map.optional("requeue").map(|node| node.bool("requeue")).transpose()?,
        retries: count("retries", 0, 1000)?,
    })
}

/// A size in MiB, rounded up.
fn memory(node: &Node) -> Result<u64, InputError> {
    let text = node.text("memory")?;
    let at = text
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(text.len());
    let (number, unit) = (text[..at].parse::<f64>().ok(), text[at..].trim());
    let factor = UNITS.iter().find(|(name, _)| *name == unit).map(|(_, factor)| factor);
    let size = number.zip(factor).map(|(number, factor)| (number * factor).ceil());
    match size {
        // Exact within the bounds.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        Some(size) if (1.0..=MAX_MEMORY).contains(&size) => Ok(size as u64),
        _ => Err(node
            .error(format!("`memory` must be a size such as 8 GB, found {}", node.found()))
            .help("allowed: a number with MB, GB, TB, MiB, GiB or TiB, 1 MiB to 1024 TiB")),
    }
}

fn time(node: &Node) -> Result<Duration, InputError> {
    match humantime::parse_duration(node.text("time")?) {
        Ok(time) if (Duration::from_secs(60)..=MAX_TIME).contains(&time) => Ok(time),
        _ => Err(node
            .error(format!("`time` must be a time such as 2 h, found {}", node.found()))
            .help("allowed: 1min to 366days, as in 90min, 2h 30min")),
    }
}
