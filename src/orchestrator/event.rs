//! What a run tells while it goes on, and what it and a plan say of each stage.

use serde::{Serialize, Serializer};

use super::price::Price;
use super::staleness::Staleness;
use deaflow_base::ArtifactId;

/// What became of a stage, or would.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// It was built.
    Built,
    /// Its artifact was there.
    Reused,
    /// It could not be built.
    Failed,
    /// It was asked to stop, and what it had come to is kept.
    Stopped,
    /// What is left of it others are building.
    Left,
    /// It was not begun, because a stage that it needs was not built.
    Skipped,
    /// In a plan: it would be built.
    Stale,
}

/// One stage of a run or a plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageReport {
    /// Its name in the pipeline.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// What became of it.
    pub outcome: Outcome,
    /// How many chunks were built, or would be; 1 or 0 where the stage is not chunked.
    pub chunks_built: u64,
    /// How many chunks were there; 1 or 0 where the stage is not chunked.
    pub chunks_reused: u64,
    /// Its artifact, where it is known.
    #[serde(serialize_with = "hexadecimal")]
    pub digest: Option<ArtifactId>,
    /// From its beginning in this run to its end, s.
    pub seconds: f64,
    /// Its part of the time of the run, s, where others may have been built beside it: of what went by while it was at work, divided by the stages
    /// that were. Parts add up to the time of the run, and a price foretells a part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<f64>,
    /// Length of its files together, bytes; 0 where they have yet to be built.
    pub size: u64,
    /// Of these, what this run wrote, bytes.
    pub size_built: u64,
    /// Steps that an earlier run had done before it was stopped, and that this one went on from.
    #[serde(skip_serializing_if = "is_none")]
    pub resumed: u64,
    /// Of a skipped stage the one that was not built: that which failed, or else one that it needs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing: Option<String>,
    /// What building was foretold to take; none where nothing like it has been built in this store, or nothing is to be built.
    pub price: Option<Price>,
    /// Why there is no price, as in `never measured for network qin2024`; none where there is one, or nothing is to be built.
    pub unmeasured: Option<String>,
    /// Why it was stale, or failed, in words: the first reason.
    pub why: Option<String>,
    /// Everything that makes it stale, in words.
    pub reasons: Vec<String>,
    /// Why it was stale.
    #[serde(skip)]
    pub staleness: Option<Staleness>,
}

impl StageReport {
    /// Of a stage of which nothing is known but how it ended.
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

/// A number is written where there is something to count.
fn is_none(number: &u64) -> bool {
    *number == 0
}

fn hexadecimal<S: Serializer>(digest: &Option<ArtifactId>, serializer: S) -> Result<S::Ok, S::Error> {
    match digest {
        Some(digest) => serializer.collect_str(digest),
        None => serializer.serialize_none(),
    }
}

/// One thing that happened: all that a run has to say goes through here, so that a terminal, a program that reads JSON and a
/// test see the same. Events of one stage's chunks may come from several threads.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Event {
    /// A run begins.
    RunStarted {
        /// Name of the pipeline.
        pipeline: String,
        /// How many stages it looks at.
        stages: usize,
        /// How many of them are stale.
        stale: usize,
        /// What building these was foretold to take, as far as something can be foretold.
        price: Option<Price>,
        /// How many of them have no price.
        unpriced: usize,
    },
    /// A stage's artifact is there.
    StageReused(StageReport),
    /// A stage is being built.
    StageStarted {
        /// Its name.
        name: String,
        /// Its kind.
        kind: String,
        /// Length of its progress bar: samples in the chunks to build, or the stage's own measure.
        steps: u64,
        /// What its steps are: "patterns", "epochs".
        unit: &'static str,
        /// Why it is stale.
        #[serde(serialize_with = "words")]
        why: Staleness,
        /// Everything that makes it stale, in words.
        reasons: Vec<String>,
        /// What building it was foretold to take.
        price: Option<Price>,
    },
    /// Part of a stage's steps are done.
    Progress {
        /// Name of the stage.
        name: String,
        /// How many more steps are done.
        steps: u64,
    },
    /// Of the step of a stage that is under way a part is done.
    Part {
        /// Name of the stage.
        name: String,
        /// Which part, between 0 and 1.
        done: f64,
    },
    /// Part of a stage's steps were done by an earlier run that was killed.
    Resumed {
        /// Name of the stage.
        name: String,
        /// How many.
        steps: u64,
        /// What its steps are: "patterns", "epochs".
        unit: &'static str,
    },
    /// A short text to show beside the progress.
    Note {
        /// Name of the stage.
        name: String,
        /// The text.
        text: String,
    },
    /// A chunk is built and recorded: it will not be lost.
    ChunkBuilt {
        /// Name of the stage.
        name: String,
        /// Its place among the stage's chunks, from 0.
        chunk: usize,
    },
    /// A stage has been built.
    StageFinished(StageReport),
    /// A stage could not be built; the run ends, unless it is to keep going.
    StageFailed(StageReport),
    /// A stage was not begun, because one that it needs was not built.
    StageSkipped(StageReport),
    /// Something that whoever runs this should know, and that is no failure.
    Warning {
        /// What.
        text: String,
    },
}

fn words<S: Serializer>(why: &Staleness, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(why)
}

/// Who is told. Called from several threads.
pub type Listener<'a> = &'a (dyn Fn(&Event) + Sync);
