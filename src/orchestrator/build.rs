//! Does the work of one stage: a whole under its lock, or its missing chunks in parallel, each recorded as it finishes, so
//! that a killed run loses no more than the chunks in flight.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::event::{Event, Listener};
use super::kind::{Chunk, Job, StageError};
use super::planner::{ChunkState, MANY, are_listed, manifest, size_of};
use super::provenance::{Environment, Took};
use super::reserve::{BLOCKS, Reserve};
use super::scratch::Scratch;
use super::spec::StageSpec;
use super::work::Work;
use deaflow_base::{ActionKey, ArtifactId, Progress, Stopped, side_by_side};
use deaflow_store::{
    Action, Artifact, Condition, Effort, Guard, Lookup, Object, Record, RecordIndex, Store, StoreError, Stored,
};

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

/// Between two looks at what another process does.
const SHORTEST: Duration = Duration::from_millis(5);
const LONGEST: Duration = Duration::from_secs(5);

/// Where it is noted that a stage has waited for another process.
pub type Waited<'a> = &'a AtomicBool;

/// One finished piece of work.
pub struct Done {
    /// Its record.
    pub record: Record,
    /// Whether it was built here and now.
    pub built: bool,
    /// Steps that an earlier run had done, which this one went on with.
    pub resumed: u64,
}

impl Done {
    /// Work that had been done.
    fn there(record: Record) -> Self {
        Self {
            record,
            built: false,
            resumed: 0,
        }
    }
}

/// What has become of a stage's chunks.
pub struct Chunks {
    /// Each in order; none where it is left to others, or was built by them.
    pub done: Vec<Option<Done>>,
    /// The stage, where another process has put it together.
    pub whole: Option<Whole>,
    /// While it is held, others leave it to this process to put the stage together.
    _turn: Option<Guard>,
}

/// A stage that another process has put together.
pub struct Whole {
    /// Its record.
    pub record: Record,
    /// Its chunks.
    pub parts: Vec<ArtifactId>,
    /// Length of their files, bytes; none where there are too many to look at each.
    pub sizes: Option<u64>,
}

/// Whose it is to put a stage together.
enum Turn {
    /// This process; others wait while the guard is held.
    Ours(Option<Guard>),
    /// Another has done it.
    Done(Box<Whole>),
    /// Another is at it, and is not waited for any longer.
    Others,
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

    /// Builds the chunks that are not there.
    ///
    /// # Errors
    /// When there are none, the work of one fails (the first of those that failed), or the store refuses.
    pub fn chunks(
        &self,
        spec: &StageSpec,
        work: &Work,
        (key, chunks, states): (&ActionKey, &[Chunk], &[ChunkState]),
        waited: Waited<'_>,
    ) -> Result<Chunks, StageError> {
        if chunks.is_empty() {
            return Err(StageError::failed("its inputs hold no samples: there is nothing to do"));
        }
        let some = self.only.filter(|(stage, _)| *stage == work.index);
        let (first, last) = some.map_or((0, usize::MAX), |(_, chunks)| chunks);
        if first >= chunks.len() {
            return Err(StageError::failed(format!(
                "there is no chunk {first}: there are {}, counted from 0",
                chunks.len()
            )));
        }
        let range = first.min(chunks.len())..last.saturating_add(1).min(chunks.len());
        let ours = Ours {
            spec,
            first: range.start,
            chunks: &chunks[range.clone()],
            states: &states[range.clone()],
            are_listed: are_listed(self.store, chunks.len()),
        };
        let mut done: Vec<Option<Done>> = ours.chunks.iter().map(|_| None).collect();
        // A chunk that another is building is put off rather than waited for: a thread of the pool that waited could hold
        // up, by work stealing, the very chunk that the other waits for. The other may only share a lock file, so as long
        // as anything gets done the rest is tried again.
        let mut reserve = Reserve::of(self.store, ours.states, BLOCKS);
        let mut listed = None;
        loop {
            let goes_on = self.pass(ours, reserve.as_ref(), listed.as_ref(), &mut done)?;
            // What others had asked for is tried too once all else has been.
            if !goes_on && reserve.is_none() {
                break;
            }
            reserve = None;
            listed = self.listed(ours)?;
        }
        let is_complete = done.iter().all(Option::is_some);
        if !is_complete && self.is_stopped() {
            return Err(Stopped.into());
        }
        let turn = match is_complete || some.is_some() {
            true => Turn::Ours(None),
            false => self.turn(spec, key, (work.was_put_together(), chunks.len()), waited)?,
        };
        let (whole, turn) = match turn {
            Turn::Ours(guard) => {
                self.rest(ours, &mut done, waited)?;
                (None, guard)
            }
            Turn::Done(whole) => (Some(*whole), None),
            Turn::Others => (None, None),
        };
        let others = |n: usize| (0..n).map(|_| None);
        let (before, after) = (others(range.start), others(chunks.len() - range.end));
        Ok(Chunks {
            done: before.chain(done).chain(after).collect(),
            whole,
            _turn: turn,
        })
    }

    /// The records there, where so many chunks are worth it.
    fn listed(&self, ours: Ours<'_>) -> Result<Option<RecordIndex>, StoreError> {
        ours.are_listed.then(|| self.store.record_index()).transpose()
    }

    /// Whether this process puts a stage together. Where processes share a store by claims one does, and the others need not look at
    /// what has been built: a thousand that read a million records each would keep the file system from all else.
    fn turn(
        &self,
        spec: &StageSpec,
        key: &ActionKey,
        (was_there, chunks): (bool, usize),
        waited: Waited<'_>,
    ) -> Result<Turn, StageError> {
        if self.store.process_name().is_none() {
            return Ok(Turn::Ours(None));
        }
        let name = format!("whole-{key}");
        let (start, end) = (Instant::now(), self.patience_ends());
        // What is put together from now on is looked at in every part. What was there lacks one.
        let mut may_be_done = !was_there;
        loop {
            if self.is_stopped() {
                return Err(Stopped.into());
            }
            let guard = self.store.try_reserve(&name)?;
            let is_over = end.is_some_and(|end| Instant::now() >= end);
            if may_be_done && (guard.is_some() || is_over) && self.store.record_now(key)?.record().is_some() {
                drop(guard);
                if let Some(whole) = self.put_together(key, chunks)? {
                    return Ok(Turn::Done(Box::new(whole)));
                }
                may_be_done = false;
                continue;
            }
            if guard.is_some() {
                return Ok(Turn::Ours(guard));
            }
            if !waited.swap(true, Ordering::Relaxed) {
                (self.listener)(&Event::Note {
                    name: spec.name.clone(),
                    text: "another process puts this together; waiting for it".to_owned(),
                });
            }
            if is_over {
                return Ok(Turn::Others);
            }
            // A tenth of what has been waited already, so that many who wait long do not ask often.
            std::thread::sleep((start.elapsed() / 10).clamp(SHORTEST, LONGEST));
        }
    }

    /// A stage that another process has put together of so many chunks; none where one of them is not there.
    fn put_together(&self, key: &ActionKey, chunks: usize) -> Result<Option<Whole>, StageError> {
        let Some(record) = self.built_meanwhile(key)? else {
            return Ok(None);
        };
        let parts = self.store.parts(&record.artifact)?;
        if parts.len() != chunks {
            return Ok(None);
        }
        let sizes = match chunks < MANY {
            true => {
                let sizes: Result<Option<u64>, StageError> = parts.par_iter().map(|part| self.size(part)).sum();
                let Some(sizes) = sizes? else { return Ok(None) };
                Some(sizes)
            }
            false => None,
        };
        Ok(Some(Whole { record, parts, sizes }))
    }

    /// Length of the file of a chunk, bytes; none where it is not whole.
    fn size(&self, part: &ArtifactId) -> Result<Option<u64>, StageError> {
        if self.is_stopped() {
            return Err(Stopped.into());
        }
        Ok(size_of(&self.store.inspect(part, Effort::Quick)?).ok())
    }

    /// Finds what others have built, waits for what they are building, and builds what they have left.
    fn rest(&self, ours: Ours<'_>, done: &mut [Option<Done>], waited: Waited<'_>) -> Result<(), StageError> {
        let open = |done: &[Option<Done>]| -> Vec<usize> { (0..done.len()).filter(|at| done[*at].is_none()).collect() };
        let left = open(done);
        if left.is_empty() {
            return Ok(());
        }
        if let Some(listed) = self.listed(ours)? {
            // On threads of their own: those of the pool may be at another stage, and others wait meanwhile.
            let find =
                |at: &usize| Ok::<_, StageError>(self.found(&ours.states[*at], &listed)?.map(|done| (*at, done)));
            for (at, found) in side_by_side(&left, find)? {
                done[at] = Some(found);
            }
            // A record that names nothing is none.
            while self.pass(ours, None, Some(&RecordIndex::default()), done)? {}
        }
        let end = self.patience_ends();
        for at in open(done) {
            let piece = piece(ours.spec, (ours.first + at, &ours.chunks[at]), &ours.states[at])?;
            done[at] = self.wait_and_perform(piece, waited, end)?;
        }
        Ok(())
    }

    /// A chunk that has been recorded, if its file is there.
    fn found(&self, state: &ChunkState, listed: &RecordIndex) -> Result<Option<Done>, StageError> {
        if self.is_stopped() {
            return Err(Stopped.into());
        }
        let Some((_, key)) = state.action.as_ref().filter(|_| state.is_in(listed)) else {
            return Ok(None);
        };
        let Lookup::Found(record, _) = self.store.record(key)? else {
            return Ok(None);
        };
        Ok(self.store.has_artifact_of(&record).then(|| Done::there(*record)))
    }

    /// Some chunks of a stage that has none are not what anybody means.
    ///
    /// # Errors
    /// When such are asked for.
    pub fn refuse_some_of_one(&self, index: usize) -> Result<(), StageError> {
        match self.only {
            Some((stage, _)) if stage == index => Err(StageError::failed("it is one piece of work: it has no chunks")),
            _ => Ok(()),
        }
    }

    /// Tries the chunks that are not done and not listed, in parallel. Says whether some were done and some are left.
    fn pass(
        &self,
        ours: Ours<'_>,
        reserve: Option<&Reserve<'_>>,
        listed: Option<&RecordIndex>,
        done: &mut [Option<Done>],
    ) -> Result<bool, StageError> {
        let Ours {
            spec,
            first,
            chunks,
            states,
            ..
        } = ours;
        let stop = AtomicBool::new(false);
        let left = |done: &[Option<Done>]| done.iter().filter(|done| done.is_none()).count();
        let before = left(done);
        if before == 0 {
            return Ok(false);
        }
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
                let is_known = state.intact && state.record.is_some();
                let is_listed = listed.map_or_else(|| state.is_listed(), |listed| state.is_in(listed));
                let is_of_others = || reserve.is_some_and(|reserve| !reserve.is_free(index));
                if !is_known && (is_listed || is_of_others()) {
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
            return Ok(Some(Done::there(record)));
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
        let who = self.store.action_owner(&piece.key);
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
            return Ok(Done::there(record));
        }
        let inputs: Result<Vec<Artifact>, StoreError> = piece
            .action
            .inputs
            .iter()
            .map(|digest| self.store.artifact(digest))
            .collect();
        let (steps, resumed) = (AtomicU64::new(0), AtomicU64::new(0));
        let reporter = Reporter {
            name: &piece.spec.name,
            unit: piece.spec.stage.unit(),
            listener: self.listener,
            steps: &steps,
            resumed: &resumed,
        };
        let measured = Mutex::default();
        let warn = |text: String| (self.listener)(&Event::Warning { text });
        let of = (piece.spec.name.as_str(), piece.spec.stage.unit());
        let key = (piece.key, self.environment.build_of_checkpoints());
        let scratch = Scratch::new(self.store, key, of, &steps, &warn, self.stop);
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
        Ok(Done {
            record,
            built: true,
            resumed: resumed.into_inner(),
        })
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

/// The chunks of a stage that this process is to see to.
#[derive(Clone, Copy)]
struct Ours<'a> {
    spec: &'a StageSpec,
    /// Place of the first in the stage.
    first: usize,
    chunks: &'a [Chunk],
    states: &'a [ChunkState],
    /// Whether the stage has so many that names of records are looked at.
    are_listed: bool,
}

fn piece<'a>(spec: &'a StageSpec, chunk: (usize, &'a Chunk), state: &'a ChunkState) -> Result<Piece<'a>, StageError> {
    let Some((action, key)) = &state.action else {
        return Err(StageError::failed(format!(
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
