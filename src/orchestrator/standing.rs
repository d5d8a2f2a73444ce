//! How far a pipeline has come, for who watches others build it.

use std::collections::BTreeSet;

use super::execute::RunError;
use super::kind::Plan;
use super::planner::{Planner, StageStatus, State};
use super::spec::Pipeline;
use deaflow_store::Store;

/// How a stage stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Standing {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: &'static str,
    /// Whether it is there, or could be built.
    pub stands: Stands,
    /// Pieces of work: its chunks, or 1.
    pub pieces: u64,
    /// How many of them are there.
    pub done: u64,
}

/// Whether a stage is there, or could be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stands {
    /// It is there.
    There,
    /// All that it needs is there.
    Ready,
    /// It needs what is not there.
    Waits,
}

impl Standing {
    /// Pieces that could be built now.
    #[must_use]
    pub fn ready(&self) -> u64 {
        match self.stands {
            // A stage whose chunks are all there has yet to be put together.
            Stands::Ready => (self.pieces - self.done).max(1),
            Stands::There | Stands::Waits => 0,
        }
    }
}

/// How each stage stands, in topological order. `until` names the last stage.
///
/// # Errors
/// When there is no such stage, or the store cannot be read.
pub fn standings(pipeline: &Pipeline, store: &Store, until: Option<&str>) -> Result<Vec<Standing>, RunError> {
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
        let (stands, done) = match &status.state {
            State::Fresh { .. } => (Stands::There, pieces),
            State::Stale { chunks, .. } => {
                let waits = spec.waits_for().iter().any(|need| stale.contains(need));
                let done = chunks.iter().filter(|chunk| chunk.intact).count() as u64;
                (if waits { Stands::Waits } else { Stands::Ready }, done)
            }
        };
        Standing {
            name: spec.name.clone(),
            kind: spec.kind.name(),
            stands,
            pieces,
            done,
        }
    };
    Ok(selection.iter().zip(&statuses).map(standing).collect())
}
