//! Progress of the stages of a pipeline that other processes build.

use std::collections::BTreeSet;

use super::kind::Plan;
use super::planner::{Planner, StageState, StageStatus};
use super::run_error::RunError;
use super::spec::Pipeline;
use deaflow_store::Store;

/// Progress of a stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StageProgress {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: &'static str,
    /// Whether it is built, or could be built now.
    pub readiness: Readiness,
    /// Number of pieces of work: its chunks, or 1.
    pub pieces: u64,
    /// Number of pieces that are built.
    pub done: u64,
}

/// Whether a stage is built, or could be built now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Readiness {
    /// It is built.
    Built,
    /// All its needs are built.
    Ready,
    /// A stage that it needs is not built.
    Waiting,
}

impl StageProgress {
    /// Returns the number of pieces that could be built now.
    #[must_use]
    pub fn ready(&self) -> u64 {
        match self.readiness {
            // A stage with all its chunks still has to be assembled.
            Readiness::Ready => (self.pieces - self.done).max(1),
            Readiness::Built | Readiness::Waiting => 0,
        }
    }
}

/// Returns the progress of each stage, in topological order. `until` names the last stage.
///
/// # Errors
/// If there is no such stage, or the store cannot be read.
pub fn stage_progress(pipeline: &Pipeline, store: &Store, until: Option<&str>) -> Result<Vec<StageProgress>, RunError> {
    let selection = pipeline.selection(until)?;
    let statuses = Planner::beside_others(pipeline, store).statuses(&selection)?;
    let stale = selection.iter().zip(&statuses).filter(|(_, status)| status.is_stale());
    let stale: BTreeSet<usize> = stale.map(|(&index, _)| index).collect();
    let standing = |(&index, status): (&usize, &StageStatus)| {
        let spec = &pipeline.stages[index];
        let pieces = match &status.work {
            Plan::Whole { .. } => 1,
            Plan::Chunks(chunks) => chunks.len() as u64,
        };
        let (readiness, done) = match &status.state {
            StageState::Fresh { .. } => (Readiness::Built, pieces),
            StageState::Stale { chunks, .. } => {
                let waits = spec.waits_for().iter().any(|need| stale.contains(need));
                let done = chunks.iter().filter(|chunk| chunk.intact).count() as u64;
                (if waits { Readiness::Waiting } else { Readiness::Ready }, done)
            }
        };
        StageProgress {
            name: spec.name.clone(),
            kind: spec.kind.name(),
            readiness,
            pieces,
            done,
        }
    };
    Ok(selection.iter().zip(&statuses).map(standing).collect())
}
