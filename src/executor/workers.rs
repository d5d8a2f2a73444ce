//! Workers as they show themselves to others in a store: one note each, written again every few seconds.

use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use deaflow_base::{Background, Pauses};
use deaflow_store::{Board, Owner, Store, StoreError};

/// The topic.
const TOPIC: &str = "workers";

/// Between two signs of life.
const BEAT: Duration = Duration::from_secs(15);

/// A worker that is silent for so long is not counted any more.
pub const SILENT: Duration = Duration::from_secs(90);

/// So many notes a worker looks at when it begins.
const MANY: usize = 20;

/// What is silent for so long is forgotten.
const FORGOTTEN: Duration = Duration::from_secs(24 * 3600);

/// What a worker says of itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Worker {
    /// Its process.
    pub owner: Owner,
    /// What it builds: the name of a pipeline.
    pub pipeline: String,
    /// The array that it was started in, if it was started in one.
    pub array: Option<String>,
    /// How often it has shown itself.
    pub beats: u64,
}

/// A worker as another sees it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seen {
    /// What it says of itself.
    pub worker: Worker,
    /// How long ago it said so.
    pub silent: Duration,
}

/// The note of this process, as long as this is held.
pub struct Sign {
    board: Board,
    name: String,
    beats: Option<Background>,
}

impl Sign {
    /// Shows this process, a worker on a pipeline.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn show(store: &Store, pipeline: &str, array: Option<&str>) -> Result<Self, StoreError> {
        let board = store.board(TOPIC);
        let now = store.now();
        // Where there are many, others have done so.
        for name in board.names("")?.into_iter().take(MANY) {
            // Of another version it is not known; it grows old.
            let worker: Option<Worker> = board.read(&name).unwrap_or_default();
            let is_gone = worker.is_some_and(|worker| worker.owner.is_gone());
            if is_gone || board.age(&name, now).is_some_and(|age| age > FORGOTTEN) {
                board.remove(&name)?;
            }
        }
        let mut worker = Worker {
            owner: Owner::this(),
            pipeline: pipeline.to_owned(),
            array: array.map(str::to_owned),
            beats: 0,
        };
        // Processes in containers may have one number on machines of one name.
        let began = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        let name = format!("{}-{}-{:x}", worker.owner.host, worker.owner.pid, began.as_nanos());
        board.write(&name, &worker)?;
        let shown = (board.clone(), name.clone());
        let beat = move |pauses: &Pauses| {
            let (board, name) = shown;
            while pauses.wait(BEAT) {
                worker.beats += 1;
                // A sign that cannot be given is given next time.
                let _ = board.write(&name, &worker);
            }
        };
        let beats = Background::start("sign", beat).ok();
        Ok(Self { board, name, beats })
    }

    /// Removes the note: for a process that is about to end without dropping this.
    pub fn remove(&self) {
        // Another process forgets it.
        let _ = self.board.remove(&self.name);
    }
}

impl Drop for Sign {
    fn drop(&mut self) {
        drop(self.beats.take());
        self.remove();
    }
}

/// The workers that have shown themselves and are not known to have ended, in the order of their names.
///
/// # Errors
/// When the system refuses.
pub fn workers(store: &Store) -> Result<Vec<Seen>, StoreError> {
    let (board, now) = (store.board(TOPIC), store.now());
    let seen = |name: &String| {
        let worker: Worker = board.read(name).ok()??;
        let silent = board.age(name, now)?;
        (!worker.owner.is_gone()).then_some(Seen { worker, silent })
    };
    Ok(board.names("")?.iter().filter_map(seen).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_worker_is_seen_while_it_works() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert_eq!(workers(&store).unwrap(), []);
        let one = Sign::show(&store, "quickstart", Some("deaflow-1")).unwrap();
        let two = Sign::show(&store, "quickstart", None).unwrap();
        let seen = workers(&store).unwrap();
        assert_eq!(seen.len(), 2);
        let arrays: Vec<Option<&str>> = seen.iter().map(|seen| seen.worker.array.as_deref()).collect();
        assert!(arrays.contains(&Some("deaflow-1")) && arrays.contains(&None));
        assert!(
            seen.iter()
                .all(|seen| seen.silent < SILENT && seen.worker.owner.pid == std::process::id())
        );
        drop(one);
        assert_eq!(workers(&store).unwrap().len(), 1);
        drop(two);
        assert_eq!(workers(&store).unwrap(), []);
    }
}
