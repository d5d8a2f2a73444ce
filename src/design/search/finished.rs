//! The finished local searches of a gradient search, which its checkpoints hold. A resumed search gives the same result
//! to the last bit.

use std::cell::{Cell, RefCell};

use serde::{Deserialize, Serialize};

use super::{SearchError, SearchProgress};
use crate::evolve::CheckpointError;
use crate::local_search::{LocalOptimum, SearchStep, StartError};
use deaflow_base::{decode, encode};
use deaflow_pattern::{Pattern, PatternForm};

/// Where a local search has ended.
#[derive(Clone, Debug)]
pub(super) struct Followed {
    pub pattern: Pattern,
    pub score: f64,
    pub steps: Vec<SearchStep>,
}

/// A local search that has ended, or could not start.
pub(super) type Ended = Result<Followed, StartError>;

impl From<LocalOptimum> for Followed {
    fn from(optimum: LocalOptimum) -> Self {
        Self {
            pattern: optimum.pattern,
            score: optimum.score,
            steps: optimum.steps,
        }
    }
}

/// The finished local searches, in their order.
pub(super) struct Finished<'a> {
    progress: &'a dyn SearchProgress,
    ended: RefCell<Vec<Ended>>,
    /// How many of them were asked for.
    asked: Cell<usize>,
}

impl<'a> Finished<'a> {
    /// Those of the last checkpoint, with patterns of a form; none without a checkpoint that can be used.
    pub fn resumed(progress: &'a dyn SearchProgress, form: PatternForm) -> Self {
        let read = |bytes: Vec<u8>| from_bytes(&bytes, form).inspect_err(|error| progress.checkpoint_rejected(error));
        let ended = progress.load_checkpoint().and_then(|bytes| read(bytes).ok());
        let ended = ended.unwrap_or_default();
        if !ended.is_empty() {
            progress.searched_before(ended.len());
        }
        Self {
            progress,
            ended: RefCell::new(ended),
            asked: Cell::new(0),
        }
    }

    /// The next local search: a finished one, or else that of `search`, after which a checkpoint is stored.
    ///
    /// # Errors
    /// If the search fails or is to stop.
    pub fn or_else(&self, search: impl FnOnce() -> Result<Ended, SearchError>) -> Result<Ended, SearchError> {
        let at = self.asked.replace(self.asked.get() + 1);
        if let Some(ended) = self.ended.borrow().get(at) {
            return Ok(ended.clone());
        }
        let ended = search()?;
        self.ended.borrow_mut().push(ended.clone());
        self.progress.searched();
        self.progress.save_checkpoint(&|| to_bytes(&self.ended.borrow()))?;
        Ok(ended)
    }
}

/// A local search that has ended, as it is stored.
#[derive(Serialize, Deserialize)]
struct Stored {
    cells: Vec<u8>,
    score: f64,
    steps: Vec<SearchStep>,
}

/// `None` if a pattern is more than its cells.
fn to_bytes(ended: &[Ended]) -> Option<Vec<u8>> {
    let stored = |ended: &Ended| {
        let followed = match ended {
            Ok(followed) => followed,
            Err(why) => return Some(Err(*why)),
        };
        let is_of_cells = followed.pattern.electrodes().is_none() && followed.pattern.coverage().is_none();
        is_of_cells.then(|| {
            Ok(Stored {
                cells: followed.pattern.cells().to_vec(),
                score: followed.score,
                steps: followed.steps.clone(),
            })
        })
    };
    let stored: Vec<Result<Stored, StartError>> = ended.iter().map(stored).collect::<Option<_>>()?;
    encode(&stored).ok()
}

fn from_bytes(bytes: &[u8], form: PatternForm) -> Result<Vec<Ended>, CheckpointError> {
    let stored: Vec<Result<Stored, StartError>> = decode(bytes).map_err(|_| CheckpointError::Damaged)?;
    let followed = |stored: Stored| {
        Ok(Followed {
            pattern: Pattern::of_form(form, &stored.cells).map_err(|_| CheckpointError::Damaged)?,
            score: stored.score,
            steps: stored.steps,
        })
    };
    let ended = stored.into_iter().map(|stored| match stored {
        Ok(stored) => followed(stored).map(Ok),
        Err(why) => Ok(Err(why)),
    });
    ended.collect()
}

#[cfg(test)]
mod tests;
