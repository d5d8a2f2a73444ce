//! One stale stage being built: all that a thread of its own needs, and what it gives back.

use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

use super::build::{Builder, Done, Waited, Whole};
use super::event::{Outcome, StageReport};
use super::kind::{Plan, StageError};
use super::planner::{self, StageStatus, State};
use super::spec::StageSpec;
use super::staleness::Staleness;
use deaflow_base::ArtifactId;
use deaflow_store::Record;

/// A stage to be built.
pub struct Work {
    /// Its place in the pipeline.
    pub index: usize,
    /// When it was begun.
    pub start: SystemTime,
    /// Whether it is waited for if another process builds it: there is nothing else to do.
    pub waits: bool,
    /// What is there of it and what is not.
    pub status: StageStatus,
    /// What is said of it.
    pub report: StageReport,
}

/// A stage that has been built, or has not.
pub struct Built {
    /// What was to be done.
    pub work: Box<Work>,
    /// What came of it.
    pub made: Result<Made, StageError>,
    /// Whether it has waited for another process: the time is then not its own.
    pub waited: bool,
}

/// What building a stage has made.
pub struct Made {
    /// Its record; none where some chunks are left to others.
    pub record: Option<Record>,
    /// Its chunks, if it has any.
    pub parts: Vec<Option<ArtifactId>>,
    outcome: Outcome,
    chunks_built: u64,
    chunks_reused: u64,
    size: u64,
    size_built: u64,
    resumed: u64,
    /// Whether the size is that of all its files, and not only of those that were looked at here.
    pub is_sized: bool,
}

impl Work {
    /// Does it.
    pub fn done(self: Box<Self>, builder: &Builder<'_>, spec: &StageSpec) -> Built {
        let waited = AtomicBool::new(false);
        let made = self.build(builder, spec, &waited);
        Built {
            work: self,
            made,
            waited: waited.into_inner(),
        }
    }

    fn build(&self, builder: &Builder<'_>, spec: &StageSpec, waited: Waited<'_>) -> Result<Made, StageError> {
        let (Some((action, key)), State::Stale { chunks: states, .. }) = (&self.status.action, &self.status.state)
        else {
            return Err(StageError::failed("the stage is not ready to be built"));
        };
        let Plan::Chunks(chunks) = &self.status.work else {
            builder.refuse_some_of_one(self.index)?;
            let Some(done) = builder.whole(spec, action, *key, self.waits, waited)? else {
                return Ok(Made::of(&[], Outcome::Left, None, Vec::new()));
            };
            // Another process may have built it while this one waited.
            let outcome = if done.built { Outcome::Built } else { Outcome::Reused };
            return Ok(Made::of(&[&done], outcome, Some(done.record.clone()), Vec::new()));
        };
        let built = builder.chunks(spec, self, (key, chunks, states), waited)?;
        let there: Vec<&Done> = built.done.iter().flatten().collect();
        if let Some(whole) = built.whole {
            return Ok(Made::by_others(&there, whole));
        }
        if there.len() < chunks.len() {
            let are_some = builder.only.is_some_and(|(stage, _)| stage == self.index);
            let outcome = if are_some { Outcome::Built } else { Outcome::Left };
            return Ok(Made::of(&there, outcome, None, Vec::new()));
        }
        let parts: Vec<ArtifactId> = there.iter().map(|done| done.record.artifact).collect();
        let all = parts.iter().copied().map(Some).collect();
        let own = there.iter().filter(|done| done.built);
        // Other processes may have built all of it, and have divided it otherwise if they are of another version.
        if own.clone().next().is_none()
            && let Some(record) = builder.built_meanwhile(key)?
            && record.artifact == planner::manifest(spec, parts.clone()).digest()?
        {
            let size = record.size;
            let mut made = Made::of(&there, Outcome::Reused, Some(record), all);
            made.size += size;
            return Ok(made);
        }
        let seconds = own.map(|done| done.record.seconds).sum();
        let record = builder.manifest(spec, action, *key, parts, seconds)?;
        let size = record.size;
        let mut made = Made::of(&there, Outcome::Built, Some(record), all);
        made.size += size;
        made.size_built += size;
        Ok(made)
    }

    /// Whether its manifest was there and lacked a chunk.
    pub fn was_put_together(&self) -> bool {
        let why = match &self.status.state {
            State::Stale { why, .. } => Some(why),
            State::Fresh { .. } => None,
        };
        matches!(why, Some(Staleness::ArtifactMissing | Staleness::ArtifactDamaged))
    }
}

impl Made {
    /// Of a stage that another process has put together.
    fn by_others(done: &[&Done], whole: Whole) -> Self {
        let Whole { record, parts, sizes } = whole;
        let own = done.iter().filter(|done| done.built).count();
        let outcome = if own > 0 { Outcome::Built } else { Outcome::Reused };
        let size = record.size;
        let chunks = parts.len();
        let mut made = Self::of(done, outcome, Some(record), parts.into_iter().map(Some).collect());
        made.chunks_reused = (chunks - own) as u64;
        made.is_sized = sizes.is_some();
        made.size = size + sizes.unwrap_or(made.size);
        made
    }

    fn of(done: &[&Done], outcome: Outcome, record: Option<Record>, parts: Vec<Option<ArtifactId>>) -> Self {
        let built = || done.iter().filter(|done| done.built);
        Self {
            record,
            parts,
            outcome,
            chunks_built: built().count() as u64,
            is_sized: true,
            chunks_reused: done.iter().filter(|done| !done.built).count() as u64,
            size: done.iter().map(|done| done.record.size).sum(),
            size_built: built().map(|done| done.record.size).sum(),
            resumed: done.iter().map(|done| done.resumed).sum(),
        }
    }

    /// Puts it into the report of its stage.
    pub fn tell(&self, report: &mut StageReport) {
        report.outcome = self.outcome;
        report.chunks_built = self.chunks_built;
        report.chunks_reused = self.chunks_reused;
        report.size = self.size;
        report.size_built = self.size_built;
        report.resumed = self.resumed;
    }
}
