//! Builds one piece of work: a whole stage or one chunk, under the lock of its action, and records the result.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::event::{Event, Listener};
use super::kind::{Chunk, Job, StageError};
use super::provenance::{Environment, Timing};
use super::scratch::Scratch;
use super::spec::StageSpec;
use deaflow_base::{ActionKey, Progress, Stopped};
use deaflow_store::{Action, Artifact, Condition, Effort, Guard, Lookup, Object, Record, Store, StoreError};

/// What building needs besides the stage.
pub struct Builder<'a> {
    /// Where artifacts are written.
    pub store: &'a Store,
    /// Clock and host.
    pub environment: &'a Environment,
    /// Receives events.
    pub listener: Listener<'a>,
    /// Whether the other chunks are still built after one has failed, so that the next run has less to do.
    pub keep_going: bool,
    /// Once this is set, nothing more is started.
    pub stop: Option<&'a AtomicBool>,
    /// A stage of which only some chunks are built: its index, and the first and last chunk.
    pub only: Option<(usize, (usize, usize))>,
    /// How long to wait for a piece that another process is building; forever if `None`.
    pub patience: Option<Duration>,
}

/// A finished piece of work.
pub struct BuiltPiece {
    /// Its record.
    pub record: Record,
    /// Whether it was built here and now.
    pub is_new: bool,
    /// Steps of it that an earlier run had done.
    pub resumed: u64,
}

impl BuiltPiece {
    /// A piece that existed already.
    pub fn existing(record: Record) -> Self {
        Self {
            record,
            is_new: false,
            resumed: 0,
        }
    }
}

/// A piece of work with its identity.
#[derive(Clone, Copy)]
pub struct Piece<'a> {
    /// The stage.
    pub spec: &'a StageSpec,
    /// Its action, or that of the chunk.
    pub action: &'a Action,
    /// The key of the action.
    pub key: ActionKey,
    /// Index and chunk; `None` for a whole stage.
    pub chunk: Option<(usize, &'a Chunk)>,
}

impl Builder<'_> {
    /// Builds a stage that is one piece of work; returns `None` if it is left to another process. `waits`: whether to
    /// wait for a process that is building it.
    ///
    /// # Errors
    /// If the work fails or the store reports an error.
    pub fn build_whole(
        &self,
        piece: Piece<'_>,
        waits: bool,
        waited: &AtomicBool,
    ) -> Result<Option<BuiltPiece>, StageError> {
        match self.store.try_lock_action(&piece.key)? {
            Some(guard) => self.build_piece(piece, &guard).map(Some),
            None if waits => self.wait_and_build(piece, waited, self.deadline()),
            None => Ok(None),
        }
    }

    /// Returns the time until which other processes are waited for.
    pub fn deadline(&self) -> Option<Instant> {
        Instant::now().checked_add(self.patience?)
    }

    /// Whether nothing more may be started.
    pub fn is_stopped(&self) -> bool {
        self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed))
    }

    /// Fails if the run has been stopped.
    ///
    /// # Errors
    /// If it has.
    pub fn check_stopped(&self) -> Result<(), Stopped> {
        if self.is_stopped() { Err(Stopped) } else { Ok(()) }
    }

    /// Sends a note on a stage to the listener.
    pub fn note(&self, spec: &StageSpec, text: String) {
        let name = spec.name.clone();
        (self.listener)(&Event::Note { name, text });
    }

    /// Waits for the lock of a piece and builds it, unless another process has built it; `None` after the deadline.
    ///
    /// # Errors
    /// As [`Builder::build_whole`].
    pub fn wait_and_build(
        &self,
        piece: Piece<'_>,
        waited: &AtomicBool,
        deadline: Option<Instant>,
    ) -> Result<Option<BuiltPiece>, StageError> {
        self.check_stopped()?;
        let owner = self.store.action_owner(&piece.key);
        let owner = owner.as_deref().unwrap_or("another process");
        self.note(piece.spec, format!("waiting for {owner}, which is building this"));
        waited.store(true, Ordering::Relaxed);
        let is_over = || self.is_stopped() || deadline.is_some_and(|deadline| Instant::now() >= deadline);
        match self.store.lock_action(&piece.key, &is_over)? {
            Some(guard) => self.build_piece(piece, &guard).map(Some),
            None => {
                self.check_stopped()?;
                Ok(None)
            }
        }
    }

    /// Builds a piece of work, unless another process has built it meanwhile. The guard shows that its lock is held.
    ///
    /// # Errors
    /// As [`Builder::build_whole`].
    pub fn build_piece(&self, piece: Piece<'_>, _lock: &Guard) -> Result<BuiltPiece, StageError> {
        self.check_stopped()?;
        if let Some(record) = self.built_meanwhile(&piece.key)? {
            return Ok(BuiltPiece::existing(record));
        }
        let inputs = piece.action.inputs.iter().map(|digest| self.store.artifact(digest));
        let inputs: Vec<Artifact> = inputs.collect::<Result<_, StoreError>>()?;
        let (steps, resumed) = (AtomicU64::new(0), AtomicU64::new(0));
        let (name, unit) = (piece.spec.name.as_str(), piece.spec.stage().unit());
        let reporter = Reporter {
            name,
            unit,
            listener: self.listener,
            steps: &steps,
            resumed: &resumed,
        };
        let measured = Mutex::default();
        let warn = |text: String| (self.listener)(&Event::Warning { text });
        let key = (piece.key, self.environment.build_of_checkpoints());
        let scratch = Scratch::new(self.store, key, (name, unit), &steps, &warn, self.stop);
        let start = (self.environment.clock)();
        let object = piece.spec.stage().build(&Job {
            chunk: piece.chunk.map(|(_, chunk)| chunk),
            inputs: &inputs,
            progress: &reporter,
            measured: &measured,
            scratch: &scratch,
        })?;
        let timing = Timing {
            seconds: self.environment.seconds_since(start),
            measurements: measured.into_inner().unwrap_or_else(PoisonError::into_inner),
        };
        let record = self.store_result(piece, object, timing)?;
        scratch.clear();
        if let Some((chunk, _)) = piece.chunk {
            let name = piece.spec.name.clone();
            (self.listener)(&Event::ChunkBuilt { name, chunk });
        }
        Ok(BuiltPiece {
            record,
            is_new: true,
            resumed: resumed.into_inner(),
        })
    }

    /// Returns the record of an action that another process has built meanwhile. A damaged artifact is moved to
    /// quarantine, in case the rebuilt one has another digest and does not replace it.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn built_meanwhile(&self, key: &ActionKey) -> Result<Option<Record>, StageError> {
        let Lookup::Found(record, _) = self.store.record_now(key)? else {
            return Ok(None);
        };
        match self.store.inspect_made(&record, Effort::Thorough)? {
            Condition::Intact { .. } => Ok(Some(*record)),
            // A thorough inspection has downloaded what is elsewhere.
            Condition::Elsewhere { .. } | Condition::Missing | Condition::OtherKind(_) => Ok(None),
            Condition::Damaged(_) => {
                self.store.quarantine_artifact(&record.artifact)?;
                Ok(None)
            }
        }
    }

    /// Writes an object and then its record. Unstable samples are counted once, for the whole stage.
    ///
    /// # Errors
    /// If the object is not a valid artifact, or the store reports an error.
    pub fn store_result(&self, piece: Piece<'_>, object: Object, timing: Timing) -> Result<Record, StageError> {
        let Piece { spec, action, key, .. } = piece;
        let is_whole = piece.chunk.is_none();
        let seconds = timing.seconds;
        let provenance = self.environment.provenance(action, key, timing);
        let stored = self.store.put(&object.of_kind(&action.kind), &provenance)?;
        let record = Record {
            key,
            action: action.clone(),
            artifact: stored.digest,
            file_digest: stored.file_digest,
            size: stored.size,
            seconds,
            unstable: match is_whole {
                true => spec.stage().unstable(&self.store.artifact(&stored.digest)?)?,
                false => 0,
            },
            created: self.environment.now(),
            version: self.environment.version.clone(),
            target: self.environment.target.clone(),
        };
        self.store.put_record(&record)?;
        if is_whole {
            // Also settles the records of its chunks.
            self.store.settle_records()?;
        }
        Ok(record)
    }
}

/// Sends the progress of a piece of work to the listener.
struct Reporter<'a> {
    name: &'a str,
    unit: &'static str,
    listener: Listener<'a>,
    /// Steps that are done.
    steps: &'a AtomicU64,
    /// Those of them that an earlier run has done.
    resumed: &'a AtomicU64,
}

impl Progress for Reporter<'_> {
    fn advance(&self, steps: u64) {
        self.steps.fetch_add(steps, Ordering::Relaxed);
        let name = self.name.to_owned();
        (self.listener)(&Event::Progress { name, steps });
    }

    fn part(&self, done: f64) {
        let name = self.name.to_owned();
        (self.listener)(&Event::Part { name, done });
    }

    fn resume(&self, steps: u64) {
        self.steps.fetch_add(steps, Ordering::Relaxed);
        self.resumed.fetch_add(steps, Ordering::Relaxed);
        let name = self.name.to_owned();
        let unit = self.unit;
        (self.listener)(&Event::Resumed { name, steps, unit });
    }

    fn note(&self, text: &str) {
        let (name, text) = (self.name.to_owned(), text.to_owned());
        (self.listener)(&Event::Note { name, text });
    }
}
