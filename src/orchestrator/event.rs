//! Events of a run, and the reports on stages of runs and plans.

use serde::{Serialize, Serializer};

use super::price::Price;
use super::staleness::Staleness;
use deaflow_base::ArtifactId;

/// The outcome of a stage in a run or a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// It was built.
    Built,
    /// Its artifact existed already.
    Reused,
    /// It could not be built.
    Failed,
    /// It was stopped; its checkpoint is kept.
    Stopped,
    /// Other processes are building the rest of it.
    Left,
    /// It was not started, because a stage that it needs was not built.
    Skipped,
    /// In a plan: it would be built.
    Stale,
}

/// The report on a stage of a run or a plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageReport {
    /// Its name in the pipeline.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// Its outcome.
    pub outcome: Outcome,
    /// Number of chunks that were or would be built; 1 or 0 for a stage without chunks.
    pub chunks_built: u64,
    /// Number of chunks that existed already; 1 or 0 for a stage without chunks.
    pub chunks_reused: u64,
    /// Its artifact, if known.
    #[serde(serialize_with = "hexadecimal")]
    pub digest: Option<ArtifactId>,
    /// From its start in this run to its end, s.
    pub seconds: f64,
    /// Its share of the time of the run, s, if stages are built in parallel: the time is divided equally among the
    /// stages that are running. The shares add up to the time of the run, and a price estimates a share.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<f64>,
    /// Length of all its files, bytes; 0 if they are not built yet.
    pub size: u64,
    /// Length of those that this run wrote, bytes.
    pub size_built: u64,
    /// Steps of an earlier run that were resumed.
    #[serde(skip_serializing_if = "is_zero")]
    pub resumed: u64,
    /// For a skipped stage, the stage that failed, or one that it needs and that was not built.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing: Option<String>,
    /// Estimated cost; `None` if no similar stage has been built in this store, or nothing is to be built.
    pub price: Option<Price>,
    /// Why a stale stage has no price, such as `never measured for network qin2024`.
    pub unmeasured: Option<String>,
    /// Why it was stale or failed: the first reason.
    pub why: Option<String>,
    /// All reasons why it is stale.
    pub reasons: Vec<String>,
    /// Why it was stale.
    #[serde(skip)]
    pub staleness: Option<Staleness>,
}

impl StageReport {
    /// Creates a report with only an outcome.
    #[must_use]
    pub fn new(name: &str, kind: &str, outcome: Outcome) -> Self {
        Self {
            name: name.to_owned(),
            kind: kind.to_owned(),
            outcome,
            chunks_built: 0,
            chunks_reused: 0,
            digest: None,
            seconds: 0.0,
            part: None,
            size: 0,
            size_built: 0,
            resumed: 0,
            missing: None,
            price: None,
            unmeasured: None,
            why: None,
            reasons: Vec::new(),
            staleness: None,
        }
    }
}

fn is_zero(number: &u64) -> bool {
    *number == 0
}

fn hexadecimal<S: Serializer>(digest: &Option<ArtifactId>, serializer: S) -> Result<S::Ok, S::Error> {
    match digest {
        Some(digest) => serializer.collect_str(digest),
        None => serializer.serialize_none(),
    }
}

/// An event of a run. Terminal output, JSON output and tests all use these events. Events of the chunks of a stage may
/// come from several threads.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event {
    /// A run starts.
    RunStarted {
        /// Name of the pipeline.
        pipeline: String,
        /// Number of stages that it checks.
        stages: usize,
        /// Number of stale stages.
        stale: usize,
        /// Estimated cost of building these, as far as known.
        price: Option<Price>,
        /// Number of stale stages without a price.
        unpriced: usize,
    },
    /// The artifact of a stage exists already.
    StageReused(StageReport),
    /// A stage is being built.
    StageStarted {
        /// Its name.
        name: String,
        /// Its kind.
        kind: String,
        /// Number of steps: samples in the chunks to build, or the steps of a stage in one piece.
        steps: u64,
        /// Unit of the steps: "patterns", "epochs".
        unit: &'static str,
        /// Why it is stale.
        #[serde(serialize_with = "as_text")]
        why: Staleness,
        /// All reasons why it is stale.
        reasons: Vec<String>,
        /// Estimated cost.
        price: Option<Price>,
    },
    /// Steps of a stage are done.
    Progress {
        /// Name of the stage.
        name: String,
        /// Number of further steps.
        steps: u64,
    },
    /// A part of the current step of a stage is done.
    Part {
        /// Name of the stage.
        name: String,
        /// The part, between 0 and 1.
        done: f64,
    },
    /// Steps of a stage are resumed from an earlier run that was killed.
    Resumed {
        /// Name of the stage.
        name: String,
        /// Number of steps.
        steps: u64,
        /// Unit of the steps: "patterns", "epochs".
        unit: &'static str,
    },
    /// A short text to show with the progress.
    Note {
        /// Name of the stage.
        name: String,
        /// The text.
        text: String,
    },
    /// A chunk is built and recorded, so it will not be lost.
    ChunkBuilt {
        /// Name of the stage.
        name: String,
        /// Its index in the stage, from 0.
        chunk: usize,
    },
    /// A stage has been built.
    StageFinished(StageReport),
    /// A stage could not be built; the run ends, unless it keeps going.
    StageFailed(StageReport),
    /// A stage was not started, because one that it needs was not built.
    StageSkipped(StageReport),
    /// A warning for the user.
    Warning {
        /// The text.
        text: String,
    },
}

fn as_text<S: Serializer>(why: &Staleness, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(why)
}

/// Receives events, from several threads.
pub type Listener<'a> = &'a (dyn Fn(&Event) + Sync);
