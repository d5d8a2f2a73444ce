//! How far a pipeline has come, for who watches others build it.

use std::collections::BTreeSet;

use super::execute::RunError;
use super::kind::Plan;
use super::planner::{Planner, StageStatus, State};
use super::spec::Pipeline;
use deaflow_store::Store;

/// How a stage readiness.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StageProgress {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: &'static str,
    /// Whether it is there, or could be built.
    pub readiness: Readiness,
    /// Pieces of work: its chunks, or 1.
    pub pieces: u64,
    /// How many of them are there.
    pub done: u64,
}

/// Whether a stage is there, or could be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Readiness {
    /// It is there.
    Built,
    /// All that it needs is there.
    Ready,
    /// It needs what is not there.
    Waiting,
}

impl StageProgress {
    /// Pieces that could be built now.
    #[must_use]
    pub fn ready(&self) -> u64 {
        match self.readiness {
            // A stage whose chunks are all there has yet to be put together.
            Readiness::Ready => (self.pieces - self.done).max(1),
            Readiness::Built | Readiness::Waiting => 0,
        }
    }
}

/// How each stage readiness, in topological order. `until` names the last stage.
///
/// # Errors
/// When there is no such stage, or the store cannot be read.
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
            State::Fresh { .. } => (Readiness::Built, pieces),
            State::Stale { chunks, .. } => {
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
