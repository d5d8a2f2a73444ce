//! Blocks of chunks that a process asks others to pass over, so that a thousand of them do not try each other's chunks one by one.
//!
//! It is a wish and no right: each chunk is claimed all the same, and what was passed over is tried once everything else has been.

use std::sync::OnceLock;

use super::planner::ChunkState;
use deaflow_base::Digest;
use deaflow_store::{Guard, LockingMethod, Store};

/// Blocks of a stage at most. A stage of fewer than twice as many chunks has none: there each is tried.
#[cfg(not(test))]
pub const BLOCKS: usize = 10_000;
#[cfg(test)]
pub const BLOCKS: usize = 8;

/// The blocks of a stage.
pub struct Reserve<'a> {
    store: &'a Store,
    /// A name for each, none where its first chunk has none yet.
    names: Vec<Option<String>>,
    /// What came of asking for each; they are kept until this is dropped.
    asked: Vec<OnceLock<Option<Guard>>>,
    length: usize,
}

impl<'a> Reserve<'a> {
    /// The blocks of these chunks, of which there are at most so many; none where there are few, or locks keep processes apart: to try one of
    /// those costs nothing.
    pub fn of(store: &'a Store, chunks: &[ChunkState], most: usize) -> Option<Self> {
        let length = chunks.len() / most.max(1);
        if length < 2 || store.locking().method == LockingMethod::Locks {
            return None;
        }
        let name = |block: &[ChunkState]| {
            let first = block.first()?.action.as_ref()?;
            Some(format!("block-{}", first.1))
        };
        let names: Vec<Option<String>> = chunks.chunks(length).map(name).collect();
        Some(Self {
            store,
            asked: names.iter().map(|_| OnceLock::new()).collect(),
            names,
            length,
        })
    }

    /// The chunk at which this process begins: another begins elsewhere.
    pub fn begin(&self) -> usize {
        let process = self.store.process_name().unwrap_or_default();
        let digest = Digest::of(process.as_bytes());
        let number = digest
            .as_bytes()
            .iter()
            .take(4)
            .fold(0, |n, byte| (n << 8) | usize::from(*byte));
        number % self.names.len() * self.length
    }

    /// Whether a chunk is in a block that nobody else has asked for.
    pub fn is_free(&self, chunk: usize) -> bool {
        let block = chunk / self.length;
        let (Some(Some(name)), Some(asked)) = (self.names.get(block), self.asked.get(block)) else {
            return true;
        };
        // What the store refuses here it refuses with the chunk too, which tells of it.
        let ask = || self.store.try_reserve(name).ok().flatten();
        asked.get_or_init(ask).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::{ActionKey, Canonical};
    use deaflow_store::Action;

    fn chunks(count: u64) -> Vec<ChunkState> {
        let chunk = |number: u64| {
            let parameters = Canonical::map([("number", number.into())]);
            let action = Action::of_stage("toy", 1, &parameters, &[]).unwrap();
            let key: ActionKey = action.key().unwrap();
            ChunkState {
                action: Some((action, key)),
                record: None,
                intact: false,
                elsewhere: false,
            }
        };
        (0..count).map(chunk).collect()
    }

    #[test]
    fn what_one_has_asked_for_another_passes_over_until_it_is_given_back() {
        let folder = tempfile::tempdir().unwrap();
        let chunks = chunks(95);
        let store = Store::open(folder.path()).unwrap();
        assert!(Reserve::of(&store, &chunks, 10).is_none(), "locks cost nothing");
        drop(store);
        std::fs::create_dir(folder.path().join("locks/processes")).unwrap();
        let stores = [(); 2].map(|()| Store::open(folder.path()).unwrap());
        assert!(Reserve::of(&stores[0], &chunks, 48).is_none(), "there are few chunks");
        let [one, two] = [0, 1].map(|at| Reserve::of(&stores[at], &chunks, 10).unwrap());
        assert!(one.begin() % 9 == 0 && one.begin() < 95 && one.begin() == one.begin());
        assert!((0..45).all(|chunk| one.is_free(chunk)));
        assert!((0..45).all(|chunk| !two.is_free(chunk)));
        assert!((45..95).all(|chunk| two.is_free(chunk) && !one.is_free(chunk)));
        drop(one);
        assert!(!two.is_free(0), "it has asked already");
        let again = Reserve::of(&stores[1], &chunks, 10).unwrap();
        assert!((0..45).all(|chunk| again.is_free(chunk)));
        assert_eq!(stores[0].totals().unwrap().in_flight, 0, "no action is in flight");
    }
}
