//! Does the work of one stage: a whole under its lock, or its missing chunks in parallel, each recorded as it finishes, so
//! that a killed run loses no more than the chunks in flight.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::event::{Event, Listener};
use super::kind::{Chunk, Job, StageError};
use super::planner::{ChunkState, manifest};
use super::provenance::{Environment, Took};
use super::reserve::{BLOCKS, Reserve};
use super::scratch::Scratch;
use super::spec::StageSpec;
use crate::base::{ActionKey, ArtifactId, Progress, Stopped};
use crate::store::{Action, Artifact, Condition, Effort, Guard, Lookup, Object, Record, Store, StoreError, Stored};

/// What building needs beside the stage.
pub struct Builder<'a> {
    /// Where artifacts go.
    pub store: &'a Store,
    /// Clock and host.
    pub environment: &'a Environment,
    /// Who is told.
    pub listener: Listener<'a>,
    /// Whether the other chunks are built although one failed: the next run has less to do then.
    pub keep_going: bool,
    /// Once it is set nothing more is begun.
    pub stop: Option<&'a AtomicBool>,
    /// Of which stage only some chunks are built, and which: from the first to the last.
    pub only: Option<(usize, (usize, usize))>,
    /// How long what another is building is waited for before it is left to that; for ever without.
    pub patience: Option<Duration>,
}

/// Where it is noted that a stage has waited for another process.
pub type Waited<'a> = &'a AtomicBool;

/// One finished piece of work.
pub struct Done {
    /// Its record.
    pub record: Record,
    /// Whether it was built here and now.
    pub built: bool,
}

/// One piece of work with its identity.
#[derive(Clone, Copy)]
struct Piece<'a> {
    spec: &'a StageSpec,
    action: &'a Action,
    key: ActionKey,
    chunk: Option<(usize, &'a Chunk)>,
}

impl Builder<'_> {
    /// Builds a stage that is one piece of work; none where it is left to another. `waits`: whether it is waited for if another builds it.
    ///
    /// # Errors
    /// When the work fails or the store refuses.
    pub fn whole(
        &self,
        spec: &StageSpec,
        action: &Action,
        key: ActionKey,
        waits: bool,
        waited: Waited<'_>,
    ) -> Result<Option<Done>, StageError> {
        let piece = Piece {
            spec,
            action,
            key,
            chunk: None,
        };
        match self.store.try_lock_action(&key)? {
            Some(guard) => self.perform(piece, &guard).map(Some),
            None if waits => self.wait_and_perform(piece, waited, self.patience_ends()),
            None => Ok(None),
        }
    }

    fn patience_ends(&self) -> Option<Instant> {
        Instant::now().checked_add(self.patience?)
    }

    /// Whether nothing more is to be begun.
    pub fn is_stopped(&self) -> bool {
        self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed))
    }

    /// Builds the chunks that are not there; gives all chunks in order, but those that are left to others.
    ///
    /// # Errors
    /// When there are none, the work of one fails (the first of those that failed), or the store refuses.
    pub fn chunks(
        &self,
        spec: &StageSpec,
        index: usize,
        chunks: &[Chunk],
        states: &[ChunkState],
        waited: Waited<'_>,
    ) -> Result<Vec<Option<Done>>, StageError> {
        if chunks.is_empty() {
            return Err(StageError::Failed(
                "its inputs hold no samples: there is nothing to do".into(),
            ));
        }
        let some = self.only.filter(|(stage, _)| *stage == index);
        let (first, last) = some.map_or((0, usize::MAX), |(_, chunks)| chunks);
        if first >= chunks.len() {
            return Err(StageError::Failed(format!(
                "there is no chunk {first}: there are {}, counted from 0",
                chunks.len()
            )));
        }
        let range = first.min(chunks.len())..last.saturating_add(1).min(chunks.len());
        let (ours, ours_states) = (&chunks[range.clone()], &states[range.clone()]);
        let mut done: Vec<Option<Done>> = ours.iter().map(|_| None).collect();
        // A chunk that another is building is put off rather than waited for: a thread of the pool that waited could hold
        // up, by work stealing, the very chunk that the other waits for. The other may only share a lock file, so as long
        // as anything gets done the rest is tried again.
        let mut reserve = Reserve::of(self.store, ours_states, BLOCKS);
        loop {
            let goes_on = self.pass(spec, (range.start, ours, ours_states), reserve.as_ref(), &mut done)?;
            // What others had asked for is tried too once all else has been.
            if !goes_on && reserve.is_none() {
                break;
            }
            reserve = None;
        }
        let end = self.patience_ends();
        let wait = |(at, done): (usize, Option<Done>)| match done {
            Some(done) => Ok(Some(done)),
            None => {
                let piece = piece(spec, (range.start + at, &ours[at]), &ours_states[at])?;
                self.wait_and_perform(piece, waited, end)
            }
        };
        let done: Vec<Option<Done>> = done.into_iter().enumerate().map(wait).collect::<Result<_, _>>()?;
        let others = |n: usize| (0..n).map(|_| None);
        let before = others(range.start);
        Ok(before.chain(done).chain(others(chunks.len() - range.end)).collect())
    }

    /// Some chunks of a stage that has none are not what anybody means.
    ///
    /// # Errors
    /// When such are asked for.
    pub fn refuse_some_of_one(&self, index: usize) -> Result<(), StageError> {
        match self.only {
            Some((stage, _)) if stage == index => {
                Err(StageError::Failed("it is one piece of work: it has no chunks".into()))
            }
            _ => Ok(()),
        }
    }

    /// Tries the chunks that are not done, in parallel. Says whether some were done and some are left.
    fn pass(
        &self,
        spec: &StageSpec,
        (first, chunks, states): (usize, &[Chunk], &[ChunkState]),
        reserve: Option<&Reserve<'_>>,
        done: &mut [Option<Done>],
    ) -> Result<bool, StageError> {
        let stop = AtomicBool::new(false);
        let left = |done: &[Option<Done>]| done.iter().filter(|done| done.is_none()).count();
        let before = left(done);
        let begin = reserve.map_or(0, Reserve::begin);
        let (head, tail) = done.split_at_mut(begin);
        let places = (begin..chunks.len()).into_par_iter().chain(0..begin);
        let attempts: Vec<Result<(), StageError>> = tail
            .par_iter_mut()
            .chain(head)
            .zip(places)
            .with_max_len(1)
            .filter(|(done, _)| done.is_none())
            .map(|(done, index)| {
                let (chunk, state) = (&chunks[index], &states[index]);
                if reserve.is_some_and(|reserve| !state.intact && !reserve.is_free(index)) {
                    return Ok(());
                }
                let attempt = self.attempt(spec, (first + index, chunk), state, &stop);
                if attempt.is_err() && !self.keep_going {
                    stop.store(true, Ordering::Relaxed);
                }
                *done = attempt?;
                Ok(())
            })
            .collect();
        attempts.into_iter().collect::<Result<(), _>>()?;
        let after = left(done);
        Ok(0 < after && after < before)
    }

    /// Puts the manifest of a chunked stage and records it.
    ///
    /// # Errors
    /// When the chunks do not fit together, or the store refuses.
    pub fn manifest(
        &self,
        spec: &StageSpec,
        action: &Action,
        key: ActionKey,
        parts: Vec<ArtifactId>,
        seconds: f64,
    ) -> Result<Record, StageError> {
        let took = Took {
            seconds,
            ..Took::default()
        };
        self.keep(spec, action, key, manifest(spec, parts), took, true)
    }

    /// A chunk that is there or can be built now; none where another is at it, or another chunk has failed.
    fn attempt(
        &self,
        spec: &StageSpec,
        chunk: (usize, &Chunk),
        state: &ChunkState,
        stop: &AtomicBool,
    ) -> Result<Option<Done>, StageError> {
        if let (Some(record), true, false) = (&state.record, state.intact, state.elsewhere) {
            let record = record.clone();
            return Ok(Some(Done { record, built: false }));
        }
        if stop.load(Ordering::Relaxed) || self.is_stopped() {
            return Ok(None);
        }
        let piece = piece(spec, chunk, state)?;
        match self.store.try_lock_action(&piece.key)? {
            Some(guard) => Ok(Some(self.perform(piece, &guard)?)),
            None => Ok(None),
        }
    }

    /// None where another is at it until the end of patience.
    fn wait_and_perform(
        &self,
        piece: Piece<'_>,
        waited: Waited<'_>,
        end: Option<Instant>,
    ) -> Result<Option<Done>, StageError> {
        if self.is_stopped() {
            return Err(Stopped.into());
        }
        let who = self.store.who_does(&piece.key);
        (self.listener)(&Event::Note {
            name: piece.spec.name.clone(),
            text: format!(
                "{} is building this; waiting for it",
                who.as_deref().unwrap_or("another process")
            ),
        });
        waited.store(true, Ordering::Relaxed);
        let over = || self.is_stopped() || end.is_some_and(|end| Instant::now() >= end);
        match self.store.lock_action(&piece.key, &over)? {
            Some(guard) => self.perform(piece, &guard).map(Some),
            None if self.is_stopped() => Err(Stopped.into()),
            None => Ok(None),
        }
    }

    /// Builds a piece of work, unless it has been built since it was looked at. The guard shows that its lock is held.
    fn perform(&self, piece: Piece<'_>, _held: &Guard) -> Result<Done, StageError> {
        if self.is_stopped() {
            return Err(Stopped.into());
        }
        if let Some(record) = self.built_meanwhile(&piece.key)? {
            return Ok(Done { record, built: false });
        }
        let inputs: Result<Vec<Artifact>, StoreError> = piece
            .action
            .inputs
            .iter()
            .map(|digest| self.store.artifact(digest))
            .collect();
        let reporter = Reporter {
            name: &piece.spec.name,
            listener: self.listener,
        };
        let measured = Mutex::default();
        let warn = |text: String| (self.listener)(&Event::Warning { text });
        let build = format!("build {}, {}", self.environment.build, self.environment.target);
        let scratch = Scratch::new(self.store, piece.key, build, &warn, self.stop);
        let start = (self.environment.clock)();
        let object = piece.spec.stage.build(&Job {
            chunk: piece.chunk.map(|(_, chunk)| chunk),
            inputs: &inputs?,
            progress: &reporter,
            measured: &measured,
            scratch: &scratch,
        })?;
        let took = Took {
            seconds: self.environment.seconds_since(start),
            measurements: measured.into_inner().unwrap_or_else(PoisonError::into_inner),
        };
        let whole = piece.chunk.is_none();
        let record = self.keep(piece.spec, piece.action, piece.key, object, took, whole)?;
        scratch.clear();
        if let Some((chunk, _)) = piece.chunk {
            let name = piece.spec.name.clone();
            (self.listener)(&Event::ChunkBuilt { name, chunk });
        }
        Ok(Done { record, built: true })
    }

    /// What has been made of an action since it was looked at. A damaged artifact is moved aside here, in case the rebuilt one has
    /// another digest and does not take its place.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn built_meanwhile(&self, key: &ActionKey) -> Result<Option<Record>, StageError> {
        let Lookup::Found(record, _) = self.store.record_now(key)? else {
            return Ok(None);
        };
        match self.store.inspect_made(&record, Effort::Thorough)? {
            Condition::Intact { .. } => Ok(Some(*record)),
            // Looked at with all effort, what is elsewhere has been brought.
            Condition::Elsewhere { .. } | Condition::Missing | Condition::OtherKind(_) => Ok(None),
            Condition::Damaged(_) => {
                self.store.quarantine_artifact(&record.artifact)?;
                Ok(None)
            }
        }
    }

    /// Puts an object and, after it, its record. Unstable samples are counted once for the whole stage.
    fn keep(
        &self,
        spec: &StageSpec,
        action: &Action,
        key: ActionKey,
        object: Object,
        took: Took,
        whole: bool,
    ) -> Result<Record, StageError> {
        let seconds = took.seconds;
        let stored = self.store.put(
            &object.of_kind(&action.kind),
            &self.environment.provenance(action, key, took),
        )?;
        let unstable = match whole {
            true => spec.stage.unstable(&self.store.artifact(&stored.digest)?)?,
            false => 0,
        };
        let record = self.record(action, key, &stored, seconds, unstable);
        self.store.put_record(&record)?;
        // Those of its chunks too.
        if whole {
            self.store.settle_records()?;
        }
        Ok(record)
    }

    fn record(&self, action: &Action, key: ActionKey, stored: &Stored, seconds: f64, unstable: u64) -> Record {
        Record {
            key,
            action: action.clone(),
            artifact: stored.digest,
            file_digest: stored.file_digest,
            size: stored.size,
            seconds,
            unstable,
            created: self.environment.now(),
            version: self.environment.version.clone(),
            target: self.environment.target.clone(),
        }
    }
}

fn piece<'a>(spec: &'a StageSpec, chunk: (usize, &'a Chunk), state: &'a ChunkState) -> Result<Piece<'a>, StageError> {
    let Some((action, key)) = &state.action else {
        return Err(StageError::Failed(format!(
            "an input of chunk {} was not built",
            chunk.0
        )));
    };
    Ok(Piece {
        spec,
        action,
        key: *key,
        chunk: Some(chunk),
    })
}

struct Reporter<'a> {
    name: &'a str,
    listener: Listener<'a>,
}

impl Progress for Reporter<'_> {
    fn advance(&self, steps: u64) {
        let name = self.name.to_owned();
        (self.listener)(&Event::Progress { name, steps });
    }

    fn resume(&self, steps: u64) {
        let name = self.name.to_owned();
        (self.listener)(&Event::Resumed { name, steps });
    }

    fn note(&self, text: &str) {
        let (name, text) = (self.name.to_owned(), text.to_owned());
        (self.listener)(&Event::Note { name, text });
    }
}
