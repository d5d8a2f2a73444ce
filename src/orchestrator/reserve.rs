//! Blocks of chunks that a process reserves, so that a thousand processes do not try the same chunks.
//!
//! A reservation is only a hint: each chunk is still claimed on its own, and reserved chunks are tried after all
//! others.

use std::sync::OnceLock;

use super::planner::ChunkState;
use deaflow_base::Digest;
use deaflow_store::{Guard, LockingMethod, Store};

/// Maximum number of blocks of a stage. A stage with fewer than twice as many chunks has none.
#[cfg(not(test))]
pub const BLOCKS: usize = 10_000;
#[cfg(test)]
pub const BLOCKS: usize = 8;

/// The blocks of a stage.
pub struct Reserve<'a> {
    store: &'a Store,
    /// A name for each; `None` if the key of its first chunk is unknown.
    names: Vec<Option<String>>,
    /// The results of reserving each; reservations are held until this is dropped.
    asked: Vec<OnceLock<Option<Guard>>>,
    length: usize,
}

impl<'a> Reserve<'a> {
    /// Divides chunks into at most `most` blocks; returns `None` if there are few chunks, or processes use file locks,
    /// which are cheap to try.
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

    /// Returns the chunk with which this process begins; it differs between processes.
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

    /// Whether a chunk is in a block that no other process has reserved.
    pub fn is_free(&self, chunk: usize) -> bool {
        let block = chunk / self.length;
        let (Some(Some(name)), Some(asked)) = (self.names.get(block), self.asked.get(block)) else {
            return true;
        };
        // An error of the store occurs again for the chunk itself and is reported then.
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
