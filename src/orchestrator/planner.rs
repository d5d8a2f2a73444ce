//! Finds out what each stage and each chunk would take: which are there, which are not, and why.
//!
//! A plan and a run both stand on this, so that a plan cannot promise what a run would not do. Digests of what has yet to
//! be built are unknown; but where a record says what an action made, building it again makes the same, so that a lost
//! artifact does not make everything after it stale.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use rayon::prelude::*;

use super::kind::{Chunk, Input, Plan};
use super::spec::{Pipeline, StageSpec};
use super::staleness::{Current, Staleness};
use deaflow_base::{ActionKey, ArtifactId, Canonical};
use deaflow_store::{
    Action, Condition, Effort, Lookup, Object, Record, RecordIndex, Run, RunStage, Runs, RunsOf, Store, StoreError,
};

/// Files that one thread looks at sooner than another could be woken.
const FEW: usize = 64;

/// From so many chunks on a stage's records are listed, and not each asked for.
#[cfg(not(test))]
pub const MANY: usize = 10_000;
#[cfg(test)]
pub const MANY: usize = 20;

/// How a stage stands and what it would take.
pub struct StageStatus {
    /// Its action and key; unknown while an input has yet to be built.
    pub action: Option<(Action, ActionKey)>,
    /// How its work divides.
    pub work: Plan,
    /// Whether its artifact is there.
    pub state: State,
}

/// Whether a stage's artifact is there.
pub enum State {
    /// It is.
    Fresh {
        /// The record that says so.
        record: Box<Record>,
        /// Its chunks, if it is a manifest.
        parts: Vec<ArtifactId>,
        /// Length of all its files, bytes.
        size: u64,
    },
    /// It has to be built.
    Stale {
        /// Why.
        why: Staleness,
        /// The chunks, if the stage is chunked.
        chunks: Vec<ChunkState>,
        /// What building will make, where that is known.
        expected: Option<ArtifactId>,
    },
}

/// Whether a chunk is there.
pub struct ChunkState {
    /// Its action and key; unknown while an input has yet to be built.
    pub action: Option<(Action, ActionKey)>,
    /// Its record, if it has been built before; none either where only the name of the record was seen.
    pub record: Option<Record>,
    /// Whether what the record names is there and whole, here or elsewhere; where only its name was seen, that is believed until the stage
    /// is put together.
    pub intact: bool,
    /// Whether it is elsewhere, and has yet to be brought.
    pub elsewhere: bool,
}

/// Looks at the stages of one pipeline in one store.
pub struct Planner<'a> {
    pipeline: &'a Pipeline,
    store: &'a Store,
    runs: Mutex<PastRuns>,
    /// When collections removed what, where somebody has asked.
    removed: OnceLock<BTreeMap<ArtifactId, String>>,
    /// Whether of very many chunks only the names of their records are looked at.
    by_names: bool,
}

/// The past runs of a pipeline, read as far back as somebody asked.
#[derive(Default)]
struct PastRuns {
    /// None before anybody asked.
    unread: Option<RunsOf<std::iter::Take<Runs>>>,
    read: Vec<Arc<Run>>,
}

/// How many of the last runs of a pipeline a stage is compared with.
const COMPARED_WITH: usize = 30;

/// How many of the last runs of a store are looked through for those of a pipeline.
const LOOKED_THROUGH: usize = 1000;

impl StageStatus {
    /// What later stages can know of this one.
    #[must_use]
    pub fn as_input(&self) -> Input {
        match &self.state {
            State::Fresh { record, parts, .. } => {
                let parts: Vec<Option<ArtifactId>> = parts.iter().copied().map(Some).collect();
                known(&self.work, Some(record.artifact), &parts)
            }
            State::Stale { chunks, expected, .. } => {
                let parts: Vec<Option<ArtifactId>> = chunks.iter().map(ChunkState::artifact).collect();
                known(&self.work, *expected, &parts)
            }
        }
    }

    /// Its artifact, where that is known.
    #[must_use]
    pub fn artifact(&self) -> Option<ArtifactId> {
        match &self.state {
            State::Fresh { record, .. } => Some(record.artifact),
            State::Stale { expected, .. } => *expected,
        }
    }

    /// Whether the stage has to be built.
    #[must_use]
    pub fn is_stale(&self) -> bool {
        matches!(self.state, State::Stale { .. })
    }
}

impl ChunkState {
    /// Whether there is a record that has not been opened.
    pub fn is_listed(&self) -> bool {
        self.intact && self.record.is_none()
    }

    /// Whether it is among what has been recorded.
    pub fn is_in(&self, recorded: &RecordIndex) -> bool {
        self.action.as_ref().is_some_and(|(_, key)| recorded.contains(key))
    }

    /// A chunk of whose record only the name is looked at.
    fn listed(action: Option<(Action, ActionKey)>, recorded: &RecordIndex) -> Self {
        let unseen = Self {
            action,
            record: None,
            intact: false,
            elsewhere: false,
        };
        Self {
            intact: unseen.is_in(recorded),
            ..unseen
        }
    }

    /// What the chunk is, or will be once it has been built again.
    fn artifact(&self) -> Option<ArtifactId> {
        self.record.as_ref().map(|record| record.artifact)
    }
}

/// What is known of a stage whose work divides so.
pub fn known(work: &Plan, digest: Option<ArtifactId>, parts: &[Option<ArtifactId>]) -> Input {
    let parts = match work {
        Plan::Whole { .. } => vec![(digest, 1)],
        Plan::Chunks(chunks) => parts
            .iter()
            .copied()
            .zip(chunks.iter().map(|chunk| chunk.samples))
            .collect(),
    };
    Input { digest, parts }
}

impl<'a> Planner<'a> {
    /// A planner that looks past runs up where it needs them.
    pub fn new(pipeline: &'a Pipeline, store: &'a Store) -> Self {
        Self {
            pipeline,
            store,
            runs: Mutex::default(),
            removed: OnceLock::new(),
            by_names: false,
        }
    }

    /// One for a process that builds beside many others: of a stage of very many chunks it opens no record, so that what comes of a stage
    /// that is built in part is not known beforehand.
    pub fn beside_others(pipeline: &'a Pipeline, store: &'a Store) -> Self {
        Self {
            by_names: store.process_name().is_some(),
            ..Self::new(pipeline, store)
        }
    }

    /// The status of stages, given by their places in topological order.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn statuses(&self, selection: &[usize]) -> Result<Vec<StageStatus>, StoreError> {
        let mut inputs: BTreeMap<usize, Input> = BTreeMap::new();
        let mut out = Vec::with_capacity(selection.len());
        let effort = Effort::Quick;
        for &index in selection {
            let needs = &self.pipeline.stages[index].needs;
            let given: Vec<Input> = needs.iter().filter_map(|need| inputs.get(need).cloned()).collect();
            let status = self.status(index, &given, effort)?;
            inputs.insert(index, status.as_input());
            out.push(status);
        }
        self.store.save_index();
        Ok(out)
    }

    /// The status of one stage, given what is known of the stages that it needs.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn status(&self, index: usize, inputs: &[Input], effort: Effort) -> Result<StageStatus, StoreError> {
        let spec = &self.pipeline.stages[index];
        let digests: Vec<Option<ArtifactId>> = inputs.iter().map(|input| input.digest).collect();
        let parameters = spec.stage.parameters();
        let action = keyed(Action::of_stage(spec.kind.name(), spec.recipe(), &parameters, &digests))?;
        let work = spec.stage.plan(inputs);
        let effort = match spec.stage.blocking_reads_artifact() {
            true => Effort::Thorough,
            false => effort,
        };
        let (why, expected) = match self.made(action.as_ref(), effort)? {
            Some((record, condition)) => match self.examine(&record, &condition, &work, effort)? {
                Ok((parts, size)) => {
                    let state = State::Fresh { record, parts, size };
                    return Ok(StageStatus { action, work, state });
                }
                Err(why) => (why, Some(record.artifact)),
            },
            None => match self.collected(action.as_ref())? {
                Some((at, artifact)) => (Staleness::Removed { at }, Some(artifact)),
                None => (self.explain(spec, &parameters, &digests)?, None),
            },
        };
        let chunks = self.chunks(spec, &work, effort)?;
        let expected = match expected {
            None => expected_manifest(spec, &chunks)?,
            some => some,
        };
        let state = State::Stale { why, chunks, expected };
        Ok(StageStatus { action, work, state })
    }

    /// The record of an action, and the condition of what it made. A record that names an artifact of another kind is none.
    fn made(
        &self,
        action: Option<&(Action, ActionKey)>,
        effort: Effort,
    ) -> Result<Option<(Box<Record>, Condition)>, StoreError> {
        let Some((_, key)) = action else { return Ok(None) };
        let Lookup::Found(record, _) = self.store.record(key)? else {
            return Ok(None);
        };
        let condition = self.store.inspect_made(&record, effort)?;
        let is_of_its_kind = !matches!(condition, Condition::OtherKind(_));
        Ok(is_of_its_kind.then_some((record, condition)))
    }

    /// The chunks and the total size of an intact artifact, or why it is not.
    fn examine(
        &self,
        record: &Record,
        condition: &Condition,
        work: &Plan,
        effort: Effort,
    ) -> Result<Result<(Vec<ArtifactId>, u64), Staleness>, StoreError> {
        let size = match size_of(condition) {
            Ok(size) => size,
            Err(why) => return Ok(Err(why)),
        };
        let Plan::Chunks(chunks) = work else {
            return Ok(Ok((Vec::new(), size)));
        };
        let parts = self.store.parts(&record.artifact)?;
        if parts.len() != chunks.len() {
            // Made by a program that divided the work otherwise under the same RECIPE: of no use to this one.
            return Ok(Err(Staleness::ArtifactDamaged));
        }
        let looked = parts.par_iter().with_min_len(FEW);
        let looked: Vec<Result<u64, Staleness>> = looked
            .map(|part| Ok(size_of(&self.store.inspect(part, effort)?)))
            .collect::<Result<_, StoreError>>()?;
        let sizes: Result<u64, Staleness> = looked.into_iter().sum();
        Ok(sizes.map(|sizes| (parts, size + sizes)))
    }

    fn explain(
        &self,
        spec: &StageSpec,
        parameters: &Canonical,
        digests: &[Option<ArtifactId>],
    ) -> Result<Staleness, StoreError> {
        Ok(self.reasons(spec, parameters, digests)?.remove(0))
    }

    /// All that makes a stage without a record stale, in comparison with that of the last runs which is nearest to it; never empty.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn reasons(
        &self,
        spec: &StageSpec,
        parameters: &Canonical,
        digests: &[Option<ArtifactId>],
    ) -> Result<Vec<Staleness>, StoreError> {
        let names = spec.needs.iter().map(|&need| self.pipeline.stages[need].name.as_str());
        let inputs: Vec<(&str, Option<ArtifactId>)> = names.zip(digests.iter().copied()).collect();
        let current = Current {
            recipe: spec.recipe(),
            parameters,
            inputs: &inputs,
        };
        let Some((run, stage)) = self.remembered(spec)? else {
            return Ok(Staleness::all_since(&current, None, None));
        };
        let previous = self.store.record(&stage.key)?.record();
        if previous.is_none()
            && let Some(at) = self.removal(spec, parameters, digests, &stage)?
        {
            return Ok(vec![Staleness::Removed { at }]);
        }
        let mut nearest = Staleness::all_since(&current, previous.as_ref(), Some(&run));
        let (mut is_known, mut seen) = (previous.is_some(), BTreeSet::from([stage.key]));
        for run in self.last_runs()? {
            let Some(stage) = run.stage(&spec.name).filter(|stage| seen.insert(stage.key)) else {
                continue;
            };
            let Some(record) = self.store.record(&stage.key)?.record() else {
                continue;
            };
            let since = Staleness::all_since(&current, Some(&record), Some(&run));
            // Of those that are as near the latest counts.
            if !is_known || since.len() < nearest.len() {
                (nearest, is_known) = (since, true);
            }
        }
        Ok(nearest)
    }

    /// The last runs of the pipeline that a stage is compared with, newest first.
    fn last_runs(&self) -> Result<Vec<Arc<Run>>, StoreError> {
        let mut left = COMPARED_WITH;
        let is_beyond = |_: &Run| {
            left = left.saturating_sub(1);
            (left == 0).then_some(())
        };
        self.read_runs(is_beyond)?;
        let runs = self.runs.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(runs.read.iter().take(COMPARED_WITH).cloned().collect())
    }

    /// When a collection removed what a stage made in an earlier run, if it would make the same now, as far as that is known.
    fn removal(
        &self,
        spec: &StageSpec,
        parameters: &Canonical,
        digests: &[Option<ArtifactId>],
        stage: &RunStage,
    ) -> Result<Option<String>, StoreError> {
        let action = Action::of_stage(spec.kind.name(), spec.recipe(), parameters, digests);
        if keyed(action)?.is_some_and(|(_, key)| key != stage.key) || self.store.has(&stage.artifact) {
            return Ok(None);
        }
        Ok(self.removed().get(&stage.artifact).cloned())
    }

    /// What an action made in an earlier run and a collection has removed since with its record, and when. To do the same again makes the
    /// same, whatever other parameters the last run had.
    fn collected(&self, action: Option<&(Action, ActionKey)>) -> Result<Option<(String, ArtifactId)>, StoreError> {
        let Some((_, key)) = action.filter(|_| !self.removed().is_empty()) else {
            return Ok(None);
        };
        let found = self.remembered_by(key)?;
        let Some((_, stage)) = found.filter(|(_, stage)| !self.store.has(&stage.artifact)) else {
            return Ok(None);
        };
        let at = self.removed().get(&stage.artifact).cloned();
        Ok(at.map(|at| (at, stage.artifact)))
    }

    fn removed(&self) -> &BTreeMap<ArtifactId, String> {
        self.removed.get_or_init(|| {
            let removed = self.store.removed().into_iter();
            removed.map(|removed| (removed.digest, removed.at)).collect()
        })
    }

    /// The last run that had the stage.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn remembered(&self, spec: &StageSpec) -> Result<Option<(Arc<Run>, RunStage)>, StoreError> {
        self.run_with(|run| run.stage(&spec.name).cloned())
    }

    /// The last run in which an action was done, or its artifact reused.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn remembered_by(&self, key: &ActionKey) -> Result<Option<(Arc<Run>, RunStage)>, StoreError> {
        self.run_with(|run| run.stages.iter().find(|stage| stage.key == *key).cloned())
    }

    /// The last run of the pipeline that has a stage of some sort.
    fn run_with(&self, stage: impl Fn(&Run) -> Option<RunStage>) -> Result<Option<(Arc<Run>, RunStage)>, StoreError> {
        self.read_runs(stage)
    }

    /// Reads runs of the pipeline, newest first, as far as one in which something is found.
    fn read_runs<T>(&self, mut found: impl FnMut(&Run) -> Option<T>) -> Result<Option<(Arc<Run>, T)>, StoreError> {
        let mut with_stage = |run: &Arc<Run>| Some((run.clone(), found(run)?));
        // A run is pushed in one step: a panic elsewhere leaves a list that is right.
        let mut runs = self.runs.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = runs.read.iter().find_map(&mut with_stage) {
            return Ok(Some(found));
        }
        let file = self.pipeline.file();
        let PastRuns { unread, read } = &mut *runs;
        let unread = match unread {
            Some(unread) => unread,
            None => {
                let runs = self.store.runs()?.take(LOOKED_THROUGH);
                unread.insert(self.store.runs_of(runs, &file, &self.pipeline.name))
            }
        };
        while let Some(run) = unread.next().transpose()? {
            let run = Arc::new(run);
            read.push(run.clone());
            if let Some(found) = with_stage(&run) {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    /// Looks at each chunk of a stale stage. Those that are there go into its manifest by what is known of them.
    fn chunks(&self, spec: &StageSpec, work: &Plan, effort: Effort) -> Result<Vec<ChunkState>, StoreError> {
        let Plan::Chunks(chunks) = work else {
            return Ok(Vec::new());
        };
        let (kind, recipe) = (spec.kind.name(), spec.recipe());
        let chunks = chunks.par_iter().with_min_len(FEW);
        let keyed = |chunk: &Chunk| keyed(Action::of_chunk(kind, recipe, &chunk.parameters, &chunk.inputs));
        let actions: Vec<Option<(Action, ActionKey)>> = chunks.map(keyed).collect::<Result<_, _>>()?;
        let listed = self.listed(&actions)?;
        let states = actions.into_par_iter().with_min_len(FEW);
        states
            .map(|action| {
                let Some(listed) = &listed else {
                    return self.chunk(action, effort);
                };
                let state = ChunkState::listed(action, listed);
                match state.is_listed() && !self.by_names {
                    true => self.chunk(state.action, effort),
                    false => Ok(state),
                }
            })
            .collect()
    }

    /// The records in the store, where a stage has very many chunks.
    fn listed(&self, actions: &[Option<(Action, ActionKey)>]) -> Result<Option<RecordIndex>, StoreError> {
        let is_worth_it = are_listed(self.store, actions.len()) && actions.iter().any(Option::is_some);
        is_worth_it.then(|| self.store.record_index()).transpose()
    }

    fn chunk(&self, action: Option<(Action, ActionKey)>, effort: Effort) -> Result<ChunkState, StoreError> {
        let made = self.made(action.as_ref(), effort)?;
        Ok(ChunkState {
            action,
            intact: matches!(made, Some((_, Condition::Intact { .. } | Condition::Elsewhere { .. }))),
            elsewhere: matches!(made, Some((_, Condition::Elsewhere { .. }))),
            record: made.map(|(record, _)| *record),
        })
    }
}

/// Whether names of records are looked at where a stage has so many chunks.
pub fn are_listed(store: &Store, chunks: usize) -> bool {
    chunks >= MANY && !store.has_upstream()
}

/// Length of an intact file in bytes, or why there is none.
pub fn size_of(condition: &Condition) -> Result<u64, Staleness> {
    match (condition, Staleness::of_artifact(condition)) {
        (_, Some(why)) => Err(why),
        (Condition::Intact { size } | Condition::Elsewhere { size }, None) => Ok(*size),
        (_, None) => Ok(0),
    }
}

fn keyed(action: Option<Action>) -> Result<Option<(Action, ActionKey)>, StoreError> {
    action
        .map(|action| {
            let key = action.key()?;
            Ok((action, key))
        })
        .transpose()
}

/// The manifest of chunks that have all been built before, though not under this key.
fn expected_manifest(spec: &StageSpec, chunks: &[ChunkState]) -> Result<Option<ArtifactId>, StoreError> {
    let parts: Option<Vec<ArtifactId>> = chunks.iter().map(ChunkState::artifact).collect();
    match parts {
        Some(parts) if !parts.is_empty() => Ok(Some(manifest(spec, parts).digest()?)),
        _ => Ok(None),
    }
}

/// The artifact of a chunked stage.
pub fn manifest(spec: &StageSpec, parts: Vec<ArtifactId>) -> Object {
    let attributes = spec.stage.attributes().into_iter().collect();
    Object::manifest(attributes, parts).of_kind(spec.kind.name())
}
