//! Builds one stale stage: what a thread needs for that, and what it returns.

use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

use super::build::{Builder, BuiltPiece, Piece};
use super::build_chunks::{AssembledStage, ChunkedStage};
use super::event::{Outcome, StageReport};
use super::kind::{Plan, StageError};
use super::planner::{self, StageState, StageStatus};
use super::scene_from::SceneFrom;
use super::spec::StageSpec;
use super::staleness::Staleness;
use deaflow_base::ArtifactId;
use deaflow_store::Record;

/// A stage to build.
pub struct StageWork {
    /// Its index in the pipeline.
    pub index: usize,
    /// When it was started.
    pub start: SystemTime,
    /// Whether to wait for another process that is building it, because there is nothing else to do.
    pub waits: bool,
    /// Which parts of it exist.
    pub status: StageStatus,
    /// Its report so far.
    pub report: StageReport,
}

/// A stage that has been built, or has failed.
pub struct FinishedWork {
    /// What was to be built.
    pub work: Box<StageWork>,
    /// The result.
    pub result: Result<StageResult, StageError>,
    /// Whether it waited for another process, so that its duration says nothing about its cost.
    pub waited: bool,
}

/// The result of building a stage.
pub struct StageResult {
    /// Its record; `None` if some chunks are left to other processes.
    pub record: Option<Record>,
    /// Its chunks, if any.
    pub parts: Vec<Option<ArtifactId>>,
    outcome: Outcome,
    chunks_built: u64,
    chunks_reused: u64,
    size: u64,
    size_built: u64,
    resumed: u64,
    /// Whether `size` covers all files of the stage, not only those that this process has checked.
    pub is_size_complete: bool,
}

impl StageWork {
    /// Builds the stage.
    pub fn run(self: Box<Self>, builder: &Builder<'_>, spec: &StageSpec) -> FinishedWork {
        let waited = AtomicBool::new(false);
        let result = self.build(builder, spec, &waited);
        FinishedWork {
            work: self,
            result,
            waited: waited.into_inner(),
        }
    }

    fn build(&self, builder: &Builder<'_>, spec: &StageSpec, waited: &AtomicBool) -> Result<StageResult, StageError> {
        let (
            Some((action, key)),
            StageState::Stale {
                chunks: states, why, ..
            },
        ) = (&self.status.action, &self.status.state)
        else {
            let refusal = spec.scene_from.as_ref().and_then(SceneFrom::refusal);
            return Err(refusal.unwrap_or_else(|| StageError::failed("the stage is not ready to be built")));
        };
        let Plan::Chunks(chunks) = &self.status.work else {
            builder.refuse_chunk_selection(self.index)?;
            let piece = Piece {
                spec,
                action,
                key: *key,
                chunk: None,
            };
            let Some(built) = builder.build_whole(piece, self.waits, waited)? else {
                return Ok(StageResult::new(&[], Outcome::Left, None, Vec::new()));
            };
            // Another process may have built it while this one waited.
            let outcome = if built.is_new { Outcome::Built } else { Outcome::Reused };
            return Ok(StageResult::new(
                &[&built],
                outcome,
                Some(built.record.clone()),
                Vec::new(),
            ));
        };
        let stage = ChunkedStage {
            index: self.index,
            spec,
            key,
            chunks,
            states,
            had_manifest: matches!(why, Staleness::ArtifactMissing | Staleness::ArtifactDamaged),
        };
        let built = builder.build_chunks(stage, waited)?;
        let pieces: Vec<&BuiltPiece> = built.pieces.iter().flatten().collect();
        if let Some(assembled) = built.assembled {
            return Ok(StageResult::of_assembled(&pieces, assembled));
        }
        if pieces.len() < chunks.len() {
            let has_selection = builder.only.is_some_and(|(stage, _)| stage == self.index);
            let outcome = if has_selection { Outcome::Built } else { Outcome::Left };
            return Ok(StageResult::new(&pieces, outcome, None, Vec::new()));
        }
        let parts: Vec<ArtifactId> = pieces.iter().map(|piece| piece.record.artifact).collect();
        let all = parts.iter().copied().map(Some).collect();
        let new = pieces.iter().filter(|piece| piece.is_new);
        // Other processes may have built everything; if they have another version, they may have divided it
        // differently.
        if new.clone().next().is_none()
            && let Some(record) = builder.built_meanwhile(key)?
            && record.artifact == planner::manifest(spec, parts.clone()).digest()?
        {
            let size = record.size;
            let mut result = StageResult::new(&pieces, Outcome::Reused, Some(record), all);
            result.size += size;
            return Ok(result);
        }
        let seconds = new.map(|piece| piece.record.seconds).sum();
        let record = builder.build_manifest(stage, action, parts, seconds)?;
        let size = record.size;
        let mut result = StageResult::new(&pieces, Outcome::Built, Some(record), all);
        result.size += size;
        result.size_built += size;
        Ok(result)
    }
}

impl StageResult {
    /// Returns the result for a stage that another process has assembled.
    fn of_assembled(pieces: &[&BuiltPiece], assembled: AssembledStage) -> Self {
        let AssembledStage {
            record,
            parts,
            chunk_bytes,
        } = assembled;
        let new = pieces.iter().filter(|piece| piece.is_new).count();
        let outcome = if new > 0 { Outcome::Built } else { Outcome::Reused };
        let size = record.size;
        let chunks = parts.len();
        let mut result = Self::new(pieces, outcome, Some(record), parts.into_iter().map(Some).collect());
        result.chunks_reused = (chunks - new) as u64;
        result.is_size_complete = chunk_bytes.is_some();
        result.size = size + chunk_bytes.unwrap_or(result.size);
        result
    }

    fn new(pieces: &[&BuiltPiece], outcome: Outcome, record: Option<Record>, parts: Vec<Option<ArtifactId>>) -> Self {
        let new = || pieces.iter().filter(|piece| piece.is_new);
        let chunks_built = new().count() as u64;
        Self {
            record,
            parts,
            outcome,
            chunks_built,
            chunks_reused: pieces.len() as u64 - chunks_built,
            size: pieces.iter().map(|piece| piece.record.size).sum(),
            size_built: new().map(|piece| piece.record.size).sum(),
            resumed: pieces.iter().map(|piece| piece.resumed).sum(),
            is_size_complete: true,
        }
    }

    /// Copies the result into the report of its stage.
    pub fn write_to(&self, report: &mut StageReport) {
        report.outcome = self.outcome;
        report.chunks_built = self.chunks_built;
        report.chunks_reused = self.chunks_reused;
        report.size = self.size;
        report.size_built = self.size_built;
        report.resumed = self.resumed;
    }
}
