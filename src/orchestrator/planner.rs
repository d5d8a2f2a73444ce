//! Determines the status of stages and chunks: which exist, which have to be built, and why.
//!
//! Plans and runs both use this, so that a run does what its plan shows. The digests of artifacts that are not built
//! yet are unknown, except if a record has one: building the action again makes the same artifact, so a lost artifact
//! does not make all later stages stale.

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

/// Minimum number of files for each thread: for fewer, waking another thread takes longer.
const FILES_PER_THREAD: usize = 64;

/// From this number of chunks on, the index of records is used instead of looking up each record.
#[cfg(not(test))]
pub const MANY: usize = 10_000;
#[cfg(test)]
pub const MANY: usize = 20;

/// The status of a stage.
pub struct StageStatus {
    /// Its action and key; unknown until all inputs are built.
    pub action: Option<(Action, ActionKey)>,
    /// How its work is divided.
    pub work: Plan,
    /// Whether its artifact exists.
    pub state: StageState,
}

/// Whether the artifact of a stage exists.
pub enum StageState {
    /// It exists.
    Fresh {
        /// Its record.
        record: Box<Record>,
        /// Its chunks, if it is a manifest.
        parts: Vec<ArtifactId>,
        /// Length of all its files, bytes.
        size: u64,
    },
    /// It has to be built.
    Stale {
        /// The reason.
        why: Staleness,
        /// The chunks, if the stage is chunked.
        chunks: Vec<ChunkState>,
        /// The artifact that building will make, if known.
        expected: Option<ArtifactId>,
    },
}

/// Whether a chunk exists.
pub struct ChunkState {
    /// Its action and key; unknown until all inputs are built.
    pub action: Option<(Action, ActionKey)>,
    /// Its record, if it has been built before; `None` also if only the name of the record is known.
    pub record: Option<Record>,
    /// Whether the artifact of the record exists and is intact, here or upstream. If only the name of the record is
    /// known, this is assumed until the stage is assembled.
    pub intact: bool,
    /// Whether it is in the upstream store only, and has to be downloaded.
    pub elsewhere: bool,
}

/// Determines the statuses of the stages of a pipeline in a store.
pub struct Planner<'a> {
    pipeline: &'a Pipeline,
    store: &'a Store,
    runs: Mutex<PastRuns>,
    /// When artifacts were removed by garbage collections; read on first use.
    removed: OnceLock<BTreeMap<ArtifactId, String>>,
    /// Whether for very many chunks only the names of their records are checked.
    only_record_names: bool,
}

/// The past runs of a pipeline, read as far back as needed.
#[derive(Default)]
struct PastRuns {
    /// `None` before the first use.
    unread: Option<RunsOf<std::iter::Take<Runs>>>,
    read: Vec<Arc<Run>>,
}

/// Number of runs of the pipeline with which a stage is compared.
const COMPARED_WITH: usize = 30;

/// Number of runs of the store that are searched for those of the pipeline.
const SEARCHED_RUNS: usize = 1000;

impl StageStatus {
    /// Returns the stage as an input of later stages.
    #[must_use]
    pub fn as_input(&self) -> Input {
        match &self.state {
            StageState::Fresh { record, parts, .. } => {
                let parts: Vec<Option<ArtifactId>> = parts.iter().copied().map(Some).collect();
                as_input(&self.work, Some(record.artifact), &parts)
            }
            StageState::Stale { chunks, expected, .. } => {
                let parts: Vec<Option<ArtifactId>> = chunks.iter().map(ChunkState::artifact).collect();
                as_input(&self.work, *expected, &parts)
            }
        }
    }

    /// Returns its artifact, if known.
    #[must_use]
    pub fn artifact(&self) -> Option<ArtifactId> {
        match &self.state {
            StageState::Fresh { record, .. } => Some(record.artifact),
            StageState::Stale { expected, .. } => *expected,
        }
    }

    /// Whether the stage has to be built.
    #[must_use]
    pub fn is_stale(&self) -> bool {
        matches!(self.state, StageState::Stale { .. })
    }
}

impl ChunkState {
    /// Whether only the name of its record is known.
    pub fn is_listed(&self) -> bool {
        self.intact && self.record.is_none()
    }

    /// Whether the index has its record.
    pub fn is_in(&self, recorded: &RecordIndex) -> bool {
        self.action.as_ref().is_some_and(|(_, key)| recorded.contains(key))
    }

    /// Creates the state of a chunk from the index, without opening its record.
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

    /// Returns the artifact of the chunk, also if it has to be built again.
    fn artifact(&self) -> Option<ArtifactId> {
        self.record.as_ref().map(|record| record.artifact)
    }
}

/// Returns a stage as an input of later stages.
pub fn as_input(work: &Plan, digest: Option<ArtifactId>, parts: &[Option<ArtifactId>]) -> Input {
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
    /// Creates a planner.
    pub fn new(pipeline: &'a Pipeline, store: &'a Store) -> Self {
        Self {
            pipeline,
            store,
            runs: Mutex::default(),
            removed: OnceLock::new(),
            only_record_names: false,
        }
    }

    /// Creates a planner for a process that builds in parallel to many others: for a stage with very many chunks it
    /// opens no record, so the artifact of a partly built stage is not known in advance.
    pub fn beside_others(pipeline: &'a Pipeline, store: &'a Store) -> Self {
        Self {
            only_record_names: store.process_name().is_some(),
            ..Self::new(pipeline, store)
        }
    }

    /// Returns the statuses of stages, given by their indices in topological order.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn statuses(&self, selection: &[usize]) -> Result<Vec<StageStatus>, StoreError> {
        let mut inputs: BTreeMap<usize, Input> = BTreeMap::new();
        let mut out = Vec::with_capacity(selection.len());
        for &index in selection {
            let status = self.status(index, &inputs, Effort::Quick)?;
            inputs.insert(index, status.as_input());
            out.push(status);
        }
        self.store.save_index();
        Ok(out)
    }

    /// Returns the status of one stage, given what is known of those that it waits for.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn status(
        &self,
        index: usize,
        known: &BTreeMap<usize, Input>,
        effort: Effort,
    ) -> Result<StageStatus, StoreError> {
        let spec = &self.pipeline.stages[index];
        self.read_scene(spec, known);
        let stage = spec.stage();
        let inputs: Vec<Input> = spec.needs.iter().filter_map(|need| known.get(need).cloned()).collect();
        let digests: Vec<Option<ArtifactId>> = inputs.iter().map(|input| input.digest).collect();
        let parameters = stage.parameters();
        let action = match spec.unknown_scene() {
            None => keyed(Action::of_stage(spec.kind.name(), spec.recipe(), &parameters, &digests))?,
            Some(_) => None,
        };
        let work = stage.plan(&inputs);
        let effort = match stage.blocking_reads_artifact() {
            true => Effort::Thorough,
            false => effort,
        };
        let (why, expected) = match self.made(action.as_ref(), effort)? {
            Some((record, condition)) => match self.examine(&record, &condition, &work, effort)? {
                Ok((parts, size)) => {
                    let state = StageState::Fresh { record, parts, size };
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
        let state = StageState::Stale { why, chunks, expected };
        Ok(StageStatus { action, work, state })
    }

    /// Reads the scene of a stage, if another stage makes it.
    fn read_scene(&self, spec: &StageSpec, known: &BTreeMap<usize, Input>) {
        let Some(from) = &spec.scene_from else { return };
        let maker = &self.pipeline.stages[from.index];
        let artifact = known.get(&from.index).and_then(|input| input.digest);
        match artifact.filter(|artifact| self.store.has(artifact) || self.store.has_upstream()) {
            Some(artifact) => from.read(spec.kind, maker.kind, &artifact, &|| self.store.artifact(&artifact)),
            None => from.forget(),
        }
    }

    /// Returns the record of an action and the condition of its artifact; `None` also if that is of another kind.
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

    /// Returns the chunks and the total size of an intact artifact, or why it is not intact.
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
            // Another version divided the work differently under the same RECIPE.
            return Ok(Err(Staleness::ArtifactDamaged));
        }
        let looked = parts.par_iter().with_min_len(FILES_PER_THREAD);
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

    /// Returns all reasons why a stage without a record is stale, compared with the most similar of the last runs;
    /// never empty.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn reasons(
        &self,
        spec: &StageSpec,
        parameters: &Canonical,
        digests: &[Option<ArtifactId>],
    ) -> Result<Vec<Staleness>, StoreError> {
        if let Some(maker) = spec.unknown_scene() {
            let which = self.pipeline.stages[maker].name.clone();
            return Ok(vec![Staleness::InputChanged { which }]);
        }
        let names = spec.needs.iter().map(|&need| self.pipeline.stages[need].name.as_str());
        let inputs: Vec<(&str, Option<ArtifactId>)> = names.zip(digests.iter().copied()).collect();
        let current = Current {
            recipe: spec.recipe(),
            kind: spec.kind,
            from_scene: &spec.from_scene,
            files: &spec.files,
            parameters,
            inputs: &inputs,
        };
        let Some((run, stage)) = self.last_run_of(spec)? else {
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
            // Of equally similar runs, the latest is used.
            if !is_known || since.len() < nearest.len() {
                (nearest, is_known) = (since, true);
            }
        }
        Ok(nearest)
    }

    /// Returns the last runs of the pipeline with which a stage is compared, newest first.
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

    /// Returns when a garbage collection removed the artifact of a stage in an earlier run, if the stage would make the
    /// same again.
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

    /// Returns the artifact that an action made in an earlier run and a garbage collection has removed with its record,
    /// and when. The action makes the same again, whatever parameters the last run had.
    fn collected(&self, action: Option<&(Action, ActionKey)>) -> Result<Option<(String, ArtifactId)>, StoreError> {
        let Some((_, key)) = action.filter(|_| !self.removed().is_empty()) else {
            return Ok(None);
        };
        let found = self.last_run_with(key)?;
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

    /// Returns the last run that had the stage.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn last_run_of(&self, spec: &StageSpec) -> Result<Option<(Arc<Run>, RunStage)>, StoreError> {
        self.read_runs(|run| run.stage(&spec.name).cloned())
    }

    /// Returns the last run that did an action or reused its artifact.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn last_run_with(&self, key: &ActionKey) -> Result<Option<(Arc<Run>, RunStage)>, StoreError> {
        self.read_runs(|run| run.stages.iter().find(|stage| stage.key == *key).cloned())
    }

    /// Reads runs of the pipeline, newest first, up to the first for which `found` returns a value.
    fn read_runs<T>(&self, mut found: impl FnMut(&Run) -> Option<T>) -> Result<Option<(Arc<Run>, T)>, StoreError> {
        let mut with_stage = |run: &Arc<Run>| Some((run.clone(), found(run)?));
        // Runs are pushed one by one, so the list is valid even after a panic.
        let mut runs = self.runs.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = runs.read.iter().find_map(&mut with_stage) {
            return Ok(Some(found));
        }
        let file = self.pipeline.file();
        let PastRuns { unread, read } = &mut *runs;
        let unread = match unread {
            Some(unread) => unread,
            None => {
                let runs = self.store.runs()?.take(SEARCHED_RUNS);
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

    /// Returns the state of each chunk of a stale stage.
    fn chunks(&self, spec: &StageSpec, work: &Plan, effort: Effort) -> Result<Vec<ChunkState>, StoreError> {
        let Plan::Chunks(chunks) = work else {
            return Ok(Vec::new());
        };
        let (kind, recipe) = (spec.kind.name(), spec.recipe());
        let chunks = chunks.par_iter().with_min_len(FILES_PER_THREAD);
        let is_known = spec.unknown_scene().is_none();
        let keyed = |chunk: &Chunk| match is_known {
            true => keyed(Action::of_chunk(kind, recipe, &chunk.parameters, &chunk.inputs)),
            false => Ok(None),
        };
        let actions: Vec<Option<(Action, ActionKey)>> = chunks.map(keyed).collect::<Result<_, _>>()?;
        let listed = self.listed(&actions)?;
        let states = actions.into_par_iter().with_min_len(FILES_PER_THREAD);
        states
            .map(|action| {
                let Some(listed) = &listed else {
                    return self.chunk(action, effort);
                };
                let state = ChunkState::listed(action, listed);
                match state.is_listed() && !self.only_record_names {
                    true => self.chunk(state.action, effort),
                    false => Ok(state),
                }
            })
            .collect()
    }

    /// Returns the index of records, if a stage has very many chunks.
    fn listed(&self, actions: &[Option<(Action, ActionKey)>]) -> Result<Option<RecordIndex>, StoreError> {
        let is_worth_it = uses_record_index(self.store, actions.len()) && actions.iter().any(Option::is_some);
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

/// Whether the index of records is used for a stage with this number of chunks.
pub fn uses_record_index(store: &Store, chunks: usize) -> bool {
    chunks >= MANY && !store.has_upstream()
}

/// Returns the length of an intact file in bytes, or why it is not intact.
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

/// Returns the manifest of a stage whose chunks have all been built before, but not under this key.
fn expected_manifest(spec: &StageSpec, chunks: &[ChunkState]) -> Result<Option<ArtifactId>, StoreError> {
    let parts: Option<Vec<ArtifactId>> = chunks.iter().map(ChunkState::artifact).collect();
    match parts {
        Some(parts) if !parts.is_empty() => Ok(Some(manifest(spec, parts).digest()?)),
        _ => Ok(None),
    }
}

/// Creates the artifact of a chunked stage.
pub fn manifest(spec: &StageSpec, parts: Vec<ArtifactId>) -> Object {
    let attributes = spec.stage().attributes().into_iter().collect();
    Object::manifest(attributes, parts).of_kind(spec.kind.name())
}
