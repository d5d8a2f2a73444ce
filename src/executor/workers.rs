//! The heartbeats of workers: a note of each in the store, rewritten every few seconds.

use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use deaflow_base::{Background, Pauses};
use deaflow_store::{Board, Owner, Store, StoreError};

/// The topic of the notes.
const TOPIC: &str = "workers";

/// Time between two heartbeats.
const INTERVAL: Duration = Duration::from_secs(15);

/// A worker without a heartbeat for this time is not counted.
pub const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(90);

/// The number of notes that a worker checks for removal when it starts.
const MAX_CHECKED: usize = 20;

/// A note is removed after this time.
const EXPIRY: Duration = Duration::from_secs(24 * 3600);

/// The content of a heartbeat.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Worker {
    /// Its process.
    pub owner: Owner,
    /// The name of the pipeline that it builds.
    pub pipeline: String,
    /// The array that it belongs to, if any.
    pub array: Option<String>,
    /// Number of heartbeats so far.
    pub beats: u64,
}

/// A worker with the age of its heartbeat.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seen {
    /// The worker.
    pub worker: Worker,
    /// Time since its last heartbeat.
    pub silent: Duration,
}

/// The heartbeat of this process; it ends when this is dropped.
pub struct Heartbeat {
    board: Board,
    name: String,
    beats: Option<Background>,
}

impl Heartbeat {
    /// Starts the heartbeat of this process, a worker on a pipeline. A note that cannot be written is written again by
    /// the next heartbeat.
    #[must_use]
    pub fn start(store: &Store, pipeline: &str, array: Option<&str>) -> Self {
        let board = store.board(TOPIC);
        let now = store.now();
        // If there are many notes, other workers have checked the rest.
        for name in board.names("").unwrap_or_default().into_iter().take(MAX_CHECKED) {
            // A note of another version cannot be read; it expires.
            let worker: Option<Worker> = board.read(&name).unwrap_or_default();
            let is_gone = worker.is_some_and(|worker| worker.owner.is_gone());
            if is_gone || board.age(&name, now).is_some_and(|age| age > EXPIRY) {
                let _ = board.remove(&name);
            }
        }
        let mut worker = Worker {
            owner: Owner::this(),
            pipeline: pipeline.to_owned(),
            array: array.map(str::to_owned),
            beats: 0,
        };
        // Containers may share host names and process numbers.
        let began = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default();
        let name = format!("{}-{}-{:x}", worker.owner.host, worker.owner.pid, began.as_nanos());
        let _ = board.write(&name, &worker);
        let note = (board.clone(), name.clone());
        let beat = move |pauses: &Pauses| {
            let (board, name) = note;
            while pauses.wait(INTERVAL) {
                worker.beats += 1;
                // If it fails, the next heartbeat follows soon.
                let _ = board.write(&name, &worker);
            }
        };
        let beats = Background::start("sign", beat).ok();
        Self { board, name, beats }
    }

    /// Removes the note, for a process that will exit without dropping this.
    pub fn remove(&self) {
        // If it fails, the note expires.
        let _ = self.board.remove(&self.name);
    }
}

impl Drop for Heartbeat {
    fn drop(&mut self) {
        drop(self.beats.take());
        self.remove();
    }
}

/// Returns the workers that are not known to have ended, ordered by name.
///
/// # Errors
/// If the notes cannot be listed.
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
    fn a_worker_is_listed_while_it_runs() {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path()).unwrap();
        assert_eq!(workers(&store).unwrap(), []);
        let one = Heartbeat::start(&store, "quickstart", Some("deaflow-1"));
        let two = Heartbeat::start(&store, "quickstart", None);
        let seen = workers(&store).unwrap();
        assert_eq!(seen.len(), 2);
        let arrays: Vec<Option<&str>> = seen.iter().map(|seen| seen.worker.array.as_deref()).collect();
        assert!(arrays.contains(&Some("deaflow-1")) && arrays.contains(&None));
        assert!(
            seen.iter()
                .all(|seen| seen.silent < HEARTBEAT_TIMEOUT && seen.worker.owner.pid == std::process::id())
        );
        drop(one);
        assert_eq!(workers(&store).unwrap().len(), 1);
        drop(two);
        assert_eq!(workers(&store).unwrap(), []);
    }
}
