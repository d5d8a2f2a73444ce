//! Builds the missing chunks of a stage in parallel. Each is recorded as it finishes, so that a killed run loses only
//! the chunks in progress.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::build::{Builder, BuiltPiece, Piece};
use super::kind::{Chunk, StageError};
use super::planner::{ChunkState, MANY, manifest, size_of, uses_record_index};
use super::provenance::Timing;
use super::reserve::{BLOCKS, Reserve};
use super::spec::StageSpec;
use deaflow_base::{ActionKey, ArtifactId, concurrently};
use deaflow_store::{Action, Effort, Guard, Lookup, Record, RecordIndex, StoreError};

/// Shortest and longest pause before checking again what another process does.
const PAUSES: (Duration, Duration) = (Duration::from_millis(5), Duration::from_secs(5));

/// A stage with its chunks.
#[derive(Clone, Copy)]
pub struct ChunkedStage<'a> {
    /// Index of the stage in the pipeline.
    pub index: usize,
    /// The stage.
    pub spec: &'a StageSpec,
    /// The key of its action.
    pub key: &'a ActionKey,
    /// All its chunks.
    pub chunks: &'a [Chunk],
    /// Their states.
    pub states: &'a [ChunkState],
    /// Whether its manifest existed but was incomplete.
    pub had_manifest: bool,
}

/// The chunks of a stage after building.
pub struct ChunkResults {
    /// Each chunk in order; `None` if another process builds it or has built it.
    pub pieces: Vec<Option<BuiltPiece>>,
    /// The stage, if another process has assembled it.
    pub assembled: Option<AssembledStage>,
    /// While this is held, other processes leave it to this one to assemble the stage.
    _assembly_lock: Option<Guard>,
}

/// A stage that another process has assembled from its chunks.
pub struct AssembledStage {
    /// Its record.
    pub record: Record,
    /// Its chunks.
    pub parts: Vec<ArtifactId>,
    /// Length of the files of the chunks, bytes; `None` if there are too many to check each.
    pub chunk_bytes: Option<u64>,
}

/// Which process assembles a stage.
enum Assembly {
    /// This one; others wait while the guard is held.
    Ours(Option<Guard>),
    /// Another one has done it.
    Done(Box<AssembledStage>),
    /// Another one is doing it, and this one does not wait any longer.
    Others,
}

/// The chunks of a stage that this process has to build.
#[derive(Clone, Copy)]
struct ChunkRange<'a> {
    spec: &'a StageSpec,
    /// Index of the first in the stage.
    first: usize,
    chunks: &'a [Chunk],
    states: &'a [ChunkState],
    /// Whether there are so many chunks that the index of records is used.
    uses_record_index: bool,
}

impl<'a> ChunkRange<'a> {
    fn piece(self, at: usize) -> Result<Piece<'a>, StageError> {
        let index = self.first + at;
        let Some((action, key)) = &self.states[at].action else {
            return Err(StageError::failed(format!("an input of chunk {index} was not built")));
        };
        Ok(Piece {
            spec: self.spec,
            action,
            key: *key,
            chunk: Some((index, &self.chunks[at])),
        })
    }
}

impl Builder<'_> {
    /// Builds the chunks that are missing.
    ///
    /// # Errors
    /// If there are no chunks, the work on one fails (the first that failed), or the store reports an error.
    pub fn build_chunks(&self, stage: ChunkedStage<'_>, waited: &AtomicBool) -> Result<ChunkResults, StageError> {
        let ChunkedStage {
            spec, chunks, states, ..
        } = stage;
        let range = self.selected_chunks(stage)?;
        let ours = ChunkRange {
            spec,
            first: range.start,
            chunks: &chunks[range.clone()],
            states: &states[range.clone()],
            uses_record_index: uses_record_index(self.store, chunks.len()),
        };
        let mut pieces: Vec<Option<BuiltPiece>> = ours.chunks.iter().map(|_| None).collect();
        // A chunk that another process is building is postponed, not waited for: a waiting thread of the pool could
        // block, by work stealing, the very chunk that the other process waits for. The other may only share a lock
        // file, so the rest is tried again as long as there is progress.
        let mut reserve = Reserve::of(self.store, ours.states, BLOCKS);
        let mut recorded = None;
        loop {
            let continues = self.pass(ours, reserve.as_ref(), recorded.as_ref(), &mut pieces)?;
            // After everything else, also the blocks that others have reserved are tried.
            if !continues && reserve.is_none() {
                break;
            }
            reserve = None;
            recorded = self.record_index(ours)?;
        }
        let is_complete = pieces.iter().all(Option::is_some);
        if !is_complete {
            self.check_stopped()?;
        }
        let assembly = match is_complete || self.chunk_limits(stage.index).is_some() {
            true => Assembly::Ours(None),
            false => self.begin_assembly(stage, waited)?,
        };
        let (assembled, assembly_lock) = match assembly {
            Assembly::Ours(guard) => {
                self.build_rest(ours, &mut pieces, waited)?;
                (None, guard)
            }
            Assembly::Done(assembled) => (Some(*assembled), None),
            Assembly::Others => (None, None),
        };
        let others = |n: usize| (0..n).map(|_| None);
        let (before, after) = (others(range.start), others(chunks.len() - range.end));
        Ok(ChunkResults {
            pieces: before.chain(pieces).chain(after).collect(),
            assembled,
            _assembly_lock: assembly_lock,
        })
    }

    /// Returns the first and last chunk of a stage that are to be built, if not all.
    fn chunk_limits(&self, index: usize) -> Option<(usize, usize)> {
        self.only.filter(|(stage, _)| *stage == index).map(|(_, limits)| limits)
    }

    fn selected_chunks(&self, stage: ChunkedStage<'_>) -> Result<Range<usize>, StageError> {
        let count = stage.chunks.len();
        if count == 0 {
            return Err(StageError::failed(
                "its inputs contain no samples, so there is nothing to do",
            ));
        }
        let (first, last) = self.chunk_limits(stage.index).unwrap_or((0, usize::MAX));
        if first >= count {
            let message = format!("there is no chunk {first}: the stage has {count}, counted from 0");
            return Err(StageError::failed(message));
        }
        Ok(first..last.saturating_add(1).min(count))
    }

    /// Refuses a selection of chunks for a stage that has none.
    ///
    /// # Errors
    /// If chunks of this stage are selected.
    pub fn refuse_chunk_selection(&self, index: usize) -> Result<(), StageError> {
        match self.chunk_limits(index) {
            Some(_) => Err(StageError::failed("it is one piece of work without chunks")),
            None => Ok(()),
        }
    }

    /// Returns the index of records, if there are so many chunks that it saves time.
    fn record_index(&self, ours: ChunkRange<'_>) -> Result<Option<RecordIndex>, StoreError> {
        ours.uses_record_index.then(|| self.store.record_index()).transpose()
    }

    /// Decides which process assembles a stage. If processes use claims, one does, and the others need not check all
    /// chunks: a thousand processes that read a million records each would block the file system.
    fn begin_assembly(&self, stage: ChunkedStage<'_>, waited: &AtomicBool) -> Result<Assembly, StageError> {
        if self.store.process_name().is_none() {
            return Ok(Assembly::Ours(None));
        }
        let name = format!("whole-{}", stage.key);
        let (start, deadline) = (Instant::now(), self.deadline());
        // A manifest that is written from now on is checked completely. An earlier one lacks a chunk.
        let mut may_be_done = !stage.had_manifest;
        loop {
            self.check_stopped()?;
            let guard = self.store.try_reserve(&name)?;
            let is_over = deadline.is_some_and(|deadline| Instant::now() >= deadline);
            if may_be_done && (guard.is_some() || is_over) && self.store.record_now(stage.key)?.record().is_some() {
                drop(guard);
                if let Some(assembled) = self.find_assembled(stage)? {
                    return Ok(Assembly::Done(Box::new(assembled)));
                }
                may_be_done = false;
                continue;
            }
            if guard.is_some() {
                return Ok(Assembly::Ours(guard));
            }
            if !waited.swap(true, Ordering::Relaxed) {
                self.note(
                    stage.spec,
                    "waiting for another process, which is assembling this".to_owned(),
                );
            }
            if is_over {
                return Ok(Assembly::Others);
            }
            // A tenth of the time that has passed, so that many processes that wait long do not ask often.
            std::thread::sleep((start.elapsed() / 10).clamp(PAUSES.0, PAUSES.1));
        }
    }

    /// Returns the stage that another process has assembled; `None` if a chunk of it is missing.
    fn find_assembled(&self, stage: ChunkedStage<'_>) -> Result<Option<AssembledStage>, StageError> {
        let Some(record) = self.built_meanwhile(stage.key)? else {
            return Ok(None);
        };
        let parts = self.store.parts(&record.artifact)?;
        if parts.len() != stage.chunks.len() {
            return Ok(None);
        }
        let mut chunk_bytes = None;
        if parts.len() < MANY {
            let sum: Result<Option<u64>, StageError> = parts.par_iter().map(|part| self.intact_size(part)).sum();
            chunk_bytes = sum?;
            if chunk_bytes.is_none() {
                return Ok(None);
            }
        }
        Ok(Some(AssembledStage {
            record,
            parts,
            chunk_bytes,
        }))
    }

    /// Returns the length of the file of a chunk, bytes; `None` if it is not intact.
    fn intact_size(&self, part: &ArtifactId) -> Result<Option<u64>, StageError> {
        self.check_stopped()?;
        Ok(size_of(&self.store.inspect(part, Effort::Quick)?).ok())
    }

    /// Finds the chunks that others have built, waits for those that they are building, and builds the rest.
    fn build_rest(
        &self,
        ours: ChunkRange<'_>,
        pieces: &mut [Option<BuiltPiece>],
        waited: &AtomicBool,
    ) -> Result<(), StageError> {
        let missing = |pieces: &[Option<BuiltPiece>]| -> Vec<usize> {
            (0..pieces.len()).filter(|at| pieces[*at].is_none()).collect()
        };
        let open = missing(pieces);
        if open.is_empty() {
            return Ok(());
        }
        if let Some(recorded) = self.record_index(ours)? {
            // On threads of their own: those of the pool may be busy with another stage, while other processes wait.
            let find = |at: &usize| {
                let found = self.find_recorded(&ours.states[*at], &recorded)?;
                Ok::<_, StageError>(found.map(|piece| (*at, piece)))
            };
            for (at, piece) in concurrently(&open, find)? {
                pieces[at] = Some(piece);
            }
            // With an empty index, because a record without its artifact does not count.
            while self.pass(ours, None, Some(&RecordIndex::default()), pieces)? {}
        }
        let deadline = self.deadline();
        for at in missing(pieces) {
            pieces[at] = self.wait_and_build(ours.piece(at)?, waited, deadline)?;
        }
        Ok(())
    }

    /// Returns a chunk that has been recorded, if its file exists.
    fn find_recorded(&self, state: &ChunkState, recorded: &RecordIndex) -> Result<Option<BuiltPiece>, StageError> {
        self.check_stopped()?;
        let Some((_, key)) = state.action.as_ref().filter(|_| state.is_in(recorded)) else {
            return Ok(None);
        };
        let Lookup::Found(record, _) = self.store.record(key)? else {
            return Ok(None);
        };
        Ok(self
            .store
            .has_artifact_of(&record)
            .then(|| BuiltPiece::existing(*record)))
    }

    /// Tries to build the chunks that are neither done nor recorded, in parallel. Returns whether some were done and
    /// some are left.
    fn pass(
        &self,
        ours: ChunkRange<'_>,
        reserve: Option<&Reserve<'_>>,
        recorded: Option<&RecordIndex>,
        pieces: &mut [Option<BuiltPiece>],
    ) -> Result<bool, StageError> {
        let left = |pieces: &[Option<BuiltPiece>]| pieces.iter().filter(|piece| piece.is_none()).count();
        let before = left(pieces);
        if before == 0 {
            return Ok(false);
        }
        let failed = AtomicBool::new(false);
        let begin = reserve.map_or(0, Reserve::begin);
        let (head, tail) = pieces.split_at_mut(begin);
        let indices = (begin..ours.chunks.len()).into_par_iter().chain(0..begin);
        let attempts: Vec<Result<(), StageError>> = tail
            .par_iter_mut()
            .chain(head)
            .zip(indices)
            .with_max_len(1)
            .filter(|(piece, _)| piece.is_none())
            .map(|(piece, at)| {
                let state = &ours.states[at];
                let is_known = state.intact && state.record.is_some();
                let is_recorded = recorded.map_or_else(|| state.is_listed(), |recorded| state.is_in(recorded));
                let is_of_others = || reserve.is_some_and(|reserve| !reserve.is_free(at));
                if !is_known && (is_recorded || is_of_others()) {
                    return Ok(());
                }
                let attempt = self.attempt(ours, at, &failed);
                if attempt.is_err() && !self.keep_going {
                    failed.store(true, Ordering::Relaxed);
                }
                *piece = attempt?;
                Ok(())
            })
            .collect();
        attempts.into_iter().collect::<Result<(), _>>()?;
        let after = left(pieces);
        Ok(0 < after && after < before)
    }

    /// Returns a chunk that exists or can be built now; `None` if another process is building it, or another chunk has
    /// failed.
    fn attempt(&self, ours: ChunkRange<'_>, at: usize, failed: &AtomicBool) -> Result<Option<BuiltPiece>, StageError> {
        let state = &ours.states[at];
        if let (Some(record), true, false) = (&state.record, state.intact, state.elsewhere) {
            return Ok(Some(BuiltPiece::existing(record.clone())));
        }
        if failed.load(Ordering::Relaxed) || self.is_stopped() {
            return Ok(None);
        }
        let piece = ours.piece(at)?;
        match self.store.try_lock_action(&piece.key)? {
            Some(guard) => Ok(Some(self.build_piece(piece, &guard)?)),
            None => Ok(None),
        }
    }

    /// Writes the manifest of a chunked stage and its record.
    ///
    /// # Errors
    /// If the chunks cannot be concatenated, or the store reports an error.
    pub fn build_manifest(
        &self,
        stage: ChunkedStage<'_>,
        action: &Action,
        parts: Vec<ArtifactId>,
        seconds: f64,
    ) -> Result<Record, StageError> {
        let timing = Timing {
            seconds,
            ..Timing::default()
        };
        let piece = Piece {
            spec: stage.spec,
            action,
            key: *stage.key,
            chunk: None,
        };
        self.store_result(piece, manifest(stage.spec, parts), timing)
    }
}
