//! Garbage collection: removes artifacts that nothing needs any more.
//!
//! It keeps the artifacts of all roots with their chunks and all inputs from which they were made. Roots are the last
//! runs of each pipeline, the pins and the lock files of pipelines. Artifacts younger than the grace age are kept too.
//! If more space is needed, the oldest of these runs give way. No other process may have the store open meanwhile.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use super::checkpoint::{self, Checkpoints};
use super::dependencies::Records;
use super::entries::{files, remove_file};
use super::error::StoreError;
use super::history;
use super::open::Store;
use deaflow_base::{ArtifactId, readable_time};

/// Why artifacts younger than the grace age are kept.
pub const AGE: &str = "its age";

/// Why their dependencies are kept.
pub const AGE_OF_NEED: &str = "the age of what needs it";

/// Number of runs that are searched for the stages of artifacts.
const SEARCHED_RUNS: usize = 1000;

/// Which artifacts to keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Retention {
    /// Number of the last runs of each pipeline that are roots; runs with the same artifacts count once.
    pub runs: usize,
    /// Artifacts younger than this are kept.
    pub grace: Duration,
    /// Number of bytes to free: the oldest of those runs are no roots until that much is removed. The last run of each
    /// pipeline whose file exists stays a root.
    pub free: Option<u64>,
}

/// An artifact in the plan of a garbage collection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GcArtifact {
    /// The artifact.
    pub digest: ArtifactId,
    /// Length of its file in bytes.
    pub size: u64,
    /// Kind of the action that made it, if it has a record.
    pub kind: String,
    /// The stage to which it or its manifest belongs in the last run that had it, if any.
    pub stage: Option<StageName>,
    /// Why it is kept: roots, or its age; empty if it is removed.
    pub held_by: Vec<String>,
    /// Whether only runs keep it.
    pub by_runs_alone: bool,
}

/// A stage in the history of runs.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StageName {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Name of the stage.
    pub stage: String,
}

/// The artifacts of one stage, or of one kind if the stage is unknown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GcGroup {
    /// The stage.
    pub stage: Option<StageName>,
    /// Its kind.
    pub kind: String,
    /// Artifacts to remove.
    pub removed: GcCount,
    /// Artifacts to keep.
    pub kept: GcCount,
    /// Why they are kept.
    pub held_by: BTreeSet<String>,
}

/// Number and size of artifacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GcCount {
    /// Number of artifacts.
    pub artifacts: u64,
    /// Their total length, bytes.
    pub bytes: u64,
}

impl GcCount {
    fn add(&mut self, artifact: &GcArtifact) {
        self.artifacts += 1;
        self.bytes += artifact.size;
    }
}

/// The plan of a garbage collection.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GcPlan {
    /// Artifacts to keep.
    pub kept: Vec<GcArtifact>,
    /// Artifacts to remove.
    pub removed: Vec<GcArtifact>,
    /// Number of records to remove with them.
    pub records: u64,
    /// Checkpoints older than the grace age, to remove.
    pub checkpoints: Vec<Checkpoints>,
    /// Files of pipelines that exist, artifacts of whose last run are to be removed.
    pub last_runs: Vec<PathBuf>,
}

impl GcPlan {
    /// Returns the total length of the artifacts to keep, bytes.
    #[must_use]
    pub fn bytes_kept(&self) -> u64 {
        self.kept.iter().map(|artifact| artifact.size).sum()
    }

    /// Returns the total length of the artifacts to remove, bytes.
    #[must_use]
    pub fn bytes_removed(&self) -> u64 {
        self.removed.iter().map(|artifact| artifact.size).sum()
    }

    /// Returns the length of everything to remove, bytes.
    #[must_use]
    pub fn bytes_freed(&self) -> u64 {
        self.bytes_removed().saturating_add(self.checkpoint_bytes())
    }

    /// Groups the artifacts by pipeline and stage; those of unknown stages come last, by kind.
    #[must_use]
    pub fn by_stage(&self) -> Vec<GcGroup> {
        let mut groups: BTreeMap<(bool, Option<StageName>, String), GcGroup> = BTreeMap::new();
        for artifact in self.removed.iter().chain(&self.kept) {
            // A chunk belongs to its stage.
            let kind = artifact
                .kind
                .strip_suffix(" chunk")
                .unwrap_or(&artifact.kind)
                .to_owned();
            let key = (artifact.stage.is_none(), artifact.stage.clone(), kind.clone());
            let group = groups.entry(key).or_insert_with(|| GcGroup {
                stage: artifact.stage.clone(),
                kind,
                removed: GcCount::default(),
                kept: GcCount::default(),
                held_by: BTreeSet::new(),
            });
            match artifact.held_by.is_empty() {
                true => group.removed.add(artifact),
                false => group.kept.add(artifact),
            }
            group.held_by.extend(artifact.held_by.iter().cloned());
        }
        groups.into_values().collect()
    }

    /// Returns the total length of the checkpoints to remove, bytes.
    #[must_use]
    pub fn checkpoint_bytes(&self) -> u64 {
        self.checkpoints.iter().map(|checkpoints| checkpoints.size).sum()
    }
}

/// A root, whose artifacts are kept.
struct Root {
    name: String,
    artifacts: Vec<ArtifactId>,
    kind: RootKind,
    /// Whether it is given up if more space is needed.
    is_optional: bool,
}

/// The kind of a root.
#[derive(Clone, Copy, PartialEq, Eq)]
enum RootKind {
    /// A run. An earlier garbage collection may have removed its artifacts.
    Run,
    /// A pin. All its dependencies must exist.
    Pin,
    /// A pin of an artifact and its chunks only.
    Result,
    /// A lock file. It may name artifacts that were never built in this store.
    LockFile,
}

/// A root with everything that it needs.
struct Holder {
    name: String,
    needs: BTreeSet<ArtifactId>,
    is_run: bool,
}

/// The runs that are counted together: those of a command on a file, or on files of the same name that no longer exist.
type RunGroup = (history::Command, Option<PathBuf>, String);

/// The file of a pipeline and the artifacts of its last run.
type LastRun = (PathBuf, Vec<ArtifactId>);

/// What a plan is made of, whichever runs are roots.
struct GcState {
    records: Records,
    /// All artifacts, without holders.
    artifacts: Vec<GcArtifact>,
    /// Those of them that are younger than the grace age.
    young: BTreeSet<ArtifactId>,
    checkpoints: Vec<Checkpoints>,
    /// The last runs of pipelines whose files exist.
    last_runs: Vec<LastRun>,
}

impl Store {
    /// Determines which artifacts to keep and which to remove. The plan is only reliable with exclusive access
    /// ([`Store::open_exclusive`]).
    ///
    /// # Errors
    /// If the system reports an error, or a dependency of a root is damaged, so that its own dependencies are unknown.
    pub fn plan_gc(&self, retention: &Retention, now: SystemTime) -> Result<GcPlan, StoreError> {
        let records = self.known_records()?;
        let (roots, last_runs) = self.roots(retention)?;
        let (mut needed, mut optional) = (Vec::new(), Vec::new());
        for root in roots {
            let holders = if root.is_optional { &mut optional } else { &mut needed };
            holders.push(self.holder(root, &records)?);
        }
        let state = self.gc_state(records, last_runs, retention.grace, now)?;
        // The runs come newest first: the oldest are given up first.
        let plan = |runs: usize| self.plan_of(&state, needed.iter().chain(&optional[..runs]));
        let all = plan(optional.len())?;
        let Some(wanted) = retention.free.filter(|free| all.bytes_freed() < *free) else {
            return Ok(all);
        };
        // The largest number of runs without which that much is freed, by bisection.
        let (mut low, mut high) = (0, optional.len());
        let mut found = plan(low)?;
        while low + 1 < high {
            let middle = low.midpoint(high);
            let tried = plan(middle)?;
            match tried.bytes_freed() >= wanted {
                true => (low, found) = (middle, tried),
                false => high = middle,
            }
        }
        Ok(found)
    }

    /// Returns what a root needs.
    fn holder(&self, mut root: Root, records: &Records) -> Result<Holder, StoreError> {
        if root.kind == RootKind::LockFile {
            let built = |digest: &ArtifactId| records.contains_key(digest) || self.layout.object(digest).exists();
            root.artifacts.retain(built);
        }
        let (needs, missing) = match root.kind {
            RootKind::Result => self.with_parts(root.artifacts)?,
            _ => self.dependencies(root.artifacts, records)?,
        };
        match missing.first().filter(|_| root.kind != RootKind::Run) {
            Some(missing) => Err(StoreError::Unreachable {
                root: root.name,
                missing: *missing,
            }),
            None => Ok(Holder {
                name: root.name,
                needs,
                is_run: root.kind == RootKind::Run,
            }),
        }
    }

    /// Lists all artifacts and checkpoints.
    fn gc_state(
        &self,
        records: Records,
        last_runs: Vec<LastRun>,
        grace: Duration,
        now: SystemTime,
    ) -> Result<GcState, StoreError> {
        let stages = self.stages_of_artifacts()?;
        let (mut artifacts, mut young) = (Vec::new(), BTreeSet::new());
        for path in files(&self.layout.objects())? {
            let Some(digest) = self.layout.artifact_at(&path) else {
                continue;
            };
            let metadata = fs::symlink_metadata(&path).map_err(StoreError::io("read", &path))?;
            if is_young(&metadata, grace, now) {
                young.insert(digest);
            }
            let kind = records.get(&digest).and_then(|made| made.first());
            artifacts.push(GcArtifact {
                digest,
                size: metadata.len(),
                kind: kind.map_or_else(String::new, |record| record.kind.clone()),
                stage: stages.get(&digest).cloned(),
                held_by: Vec::new(),
                by_runs_alone: false,
            });
        }
        let mut checkpoints = self.checkpoints()?;
        checkpoints.retain(|checkpoints| !checkpoints.is_young(grace, now));
        Ok(GcState {
            records,
            artifacts,
            young,
            checkpoints,
            last_runs,
        })
    }

    /// Returns the plan that keeps what these roots need.
    fn plan_of<'a>(&self, state: &GcState, holders: impl Iterator<Item = &'a Holder>) -> Result<GcPlan, StoreError> {
        let mut names: BTreeMap<ArtifactId, BTreeSet<&str>> = BTreeMap::new();
        let mut by_others: BTreeSet<ArtifactId> = BTreeSet::new();
        for holder in holders {
            for digest in &holder.needs {
                names.entry(*digest).or_default().insert(&holder.name);
            }
            if !holder.is_run {
                by_others.extend(&holder.needs);
            }
        }
        let mut collection = GcPlan {
            checkpoints: state.checkpoints.clone(),
            ..GcPlan::default()
        };
        for artifact in &state.artifacts {
            let digest = artifact.digest;
            let mut artifact = artifact.clone();
            let held_by = names.remove(&digest).unwrap_or_default();
            artifact.held_by = held_by.into_iter().map(str::to_owned).collect();
            artifact.by_runs_alone = !artifact.held_by.is_empty() && !by_others.contains(&digest);
            if artifact.held_by.is_empty() && state.young.contains(&digest) {
                artifact.held_by.push(AGE.to_owned());
            }
            match artifact.held_by.is_empty() {
                true => collection.removed.push(artifact),
                false => collection.kept.push(artifact),
            }
        }
        // A young artifact may be a manifest, whose chunks are kept with it.
        self.keep_dependencies_of_young(&mut collection, &state.records)?;
        let gone: BTreeSet<ArtifactId> = collection.removed.iter().map(|artifact| artifact.digest).collect();
        collection.records = gone
            .iter()
            .filter_map(|digest| state.records.get(digest))
            .map(|made| made.len() as u64)
            .sum();
        let loses = |artifacts: &[ArtifactId]| artifacts.iter().any(|digest| gone.contains(digest));
        let lost = state.last_runs.iter().filter(|(_, artifacts)| loses(artifacts));
        collection.last_runs = lost.map(|(file, _)| file.clone()).collect();
        Ok(collection)
    }

    /// Returns the stages of artifacts and their chunks in the last runs.
    fn stages_of_artifacts(&self) -> Result<BTreeMap<ArtifactId, StageName>, StoreError> {
        let mut stages = BTreeMap::new();
        for run in self.runs()?.take(SEARCHED_RUNS) {
            let run = run?;
            for stage in run.stages {
                let name = StageName {
                    pipeline: run.pipeline.clone(),
                    stage: stage.name,
                };
                stages.entry(stage.artifact).or_insert(name);
            }
        }
        let mut chunks = BTreeMap::new();
        for (digest, name) in &stages {
            // Missing and damaged manifests are ignored here.
            for part in self.parts(digest).unwrap_or_default() {
                chunks.entry(part).or_insert_with(|| name.clone());
            }
        }
        chunks.extend(stages);
        Ok(chunks)
    }

    /// Returns artifacts with their chunks, and which of these are missing.
    fn with_parts(&self, artifacts: Vec<ArtifactId>) -> Result<(BTreeSet<ArtifactId>, Vec<ArtifactId>), StoreError> {
        let (mut all, mut missing) = (BTreeSet::new(), Vec::new());
        for digest in artifacts {
            all.insert(digest);
            match self.parts(&digest) {
                Ok(parts) => {
                    let is_gone = |part: &&ArtifactId| !self.layout.object(part).exists();
                    missing.extend(parts.iter().filter(is_gone));
                    all.extend(parts);
                }
                Err(StoreError::Missing { .. }) => missing.push(digest),
                Err(error) => return Err(error),
            }
        }
        Ok((all, missing))
    }

    /// Removes the artifacts of a plan, records first, so that no record refers to a missing artifact. The time `at`
    /// (UTC, RFC 3339) is written into the list of removed artifacts; returns why that list could not be written (disk
    /// full), which does not stop the removal. `progress` is called with the number of removed artifacts and the total.
    ///
    /// # Errors
    /// If a file cannot be removed; the others are removed. A further garbage collection removes the rest.
    pub fn remove(
        &self,
        collection: &GcPlan,
        at: &str,
        progress: &dyn Fn(u64, u64),
    ) -> Result<Option<StoreError>, StoreError> {
        // Before the removal, so that the list is complete if this process is killed.
        let listed = self.remember_removed(collection, at);
        let mut gone: BTreeSet<ArtifactId> = collection.removed.iter().map(|artifact| artifact.digest).collect();
        let records = self.known_records()?;
        let mut failures = Vec::new();
        let of_removed: Vec<_> = gone.iter().filter_map(|digest| records.get_key_value(digest)).collect();
        for (digest, made) in of_removed {
            for record in made {
                if let Err(error) = remove_file(&self.layout.record(&record.key)) {
                    failures.push(error);
                    // The artifact of a record that stays must stay.
                    gone.remove(digest);
                }
            }
        }
        let total = gone.len() as u64;
        // Manifests before their chunks, so that an interruption does not look like damage.
        let manifests = gone
            .iter()
            .filter(|digest| self.parts(digest).is_ok_and(|parts| !parts.is_empty()));
        let manifests: BTreeSet<ArtifactId> = manifests.copied().collect();
        let order = manifests.iter().chain(gone.difference(&manifests));
        for (done, digest) in order.enumerate() {
            progress(done as u64, total);
            failures.extend(remove_file(&self.layout.object(digest)).err());
            self.verified.forget(digest);
        }
        for checkpoints in &collection.checkpoints {
            failures.extend(checkpoint::remove(&checkpoints.path).err());
        }
        self.save_index();
        progress(total, total);
        if let Some(error) = failures.into_iter().next() {
            return Err(error);
        }
        // On a full disk there may be space for the list now.
        let listed = listed.or_else(|_| self.remember_removed(collection, at));
        Ok(listed.err())
    }

    /// Returns the roots, runs newest first, and the artifacts of the last run of each pipeline whose file exists.
    fn roots(&self, retention: &Retention) -> Result<(Vec<Root>, Vec<LastRun>), StoreError> {
        let (mut runs, mut last_runs) = (Vec::new(), Vec::new());
        let mut counts: BTreeMap<RunGroup, BTreeSet<Vec<ArtifactId>>> = BTreeMap::new();
        let mut existing = BTreeMap::new();
        for path in &self.run_files()? {
            let Some(run) = history::read(path)? else {
                let reason = "the artifacts of this run are unknown; `deaflow fsck` moves its file to quarantine";
                return Err(StoreError::damaged(path, reason));
            };
            let file = existing.entry((run.path.clone(), run.place.clone()));
            let file = file.or_insert_with(|| self.pipeline_file(&run)).clone();
            let name = if file.is_some() {
                String::new()
            } else {
                run.pipeline.clone()
            };
            // Audits and sweeps build other stages than runs, so they are counted separately.
            let group = counts.entry((run.command, file.clone(), name)).or_default();
            let artifacts: Vec<ArtifactId> = run.stages.iter().map(|stage| stage.artifact).collect();
            let mut is_last = false;
            if let Some(file) = file.filter(|_| run.command == history::Command::Run && group.is_empty()) {
                let is_newest = !last_runs.iter().any(|(known, _)| *known == file);
                is_last = is_newest || run.is_complete();
                last_runs.extend(is_newest.then(|| (file, artifacts.clone())));
            }
            if group.len() == retention.runs || group.contains(&artifacts) {
                continue;
            }
            // Runs with the same artifacts count once. One that failed or was stopped is kept and not counted: it lacks
            // what complete ones have made.
            if run.is_complete() {
                group.insert(artifacts.clone());
            }
            runs.push(Root {
                name: format!("run of {} at {}", run.pipeline, readable_time(&run.created)),
                artifacts,
                kind: RootKind::Run,
                is_optional: !is_last,
            });
        }
        let pins = self.pins()?;
        let pins = pins.iter().map(|pin| {
            let label = if pin.label.is_empty() {
                String::new()
            } else {
                format!(" ({})", pin.label)
            };
            Root {
                name: format!("pin{label}"),
                artifacts: vec![pin.digest],
                kind: if pin.result_only {
                    RootKind::Result
                } else {
                    RootKind::Pin
                },
                is_optional: false,
            }
        });
        let lock_files = self.lock_files()?.into_iter().map(|(path, lock)| {
            let artifacts = lock.stages.values().map(|stage| stage.artifact).collect();
            Root {
                name: format!("lock file {}", path.display()),
                artifacts,
                kind: RootKind::LockFile,
                is_optional: false,
            }
        });
        Ok((runs.into_iter().chain(pins).chain(lock_files).collect(), last_runs))
    }

    /// Returns the file of the pipeline of a run, at its path or at the same place relative to the store, if it exists.
    fn pipeline_file(&self, run: &history::Run) -> Option<PathBuf> {
        let relative = (!run.place.is_empty()).then(|| self.root().join(&run.place));
        let mut paths = [PathBuf::from(&run.path)].into_iter().chain(relative);
        paths.find_map(|path| fs::canonicalize(path).ok().filter(|path| path.is_file()))
    }

    fn keep_dependencies_of_young(&self, collection: &mut GcPlan, records: &Records) -> Result<(), StoreError> {
        let young = collection.kept.iter().filter(|artifact| artifact.held_by == [AGE]);
        let (reached, _) = self.dependencies(young.map(|artifact| artifact.digest).collect(), records)?;
        let (mut saved, gone): (Vec<GcArtifact>, Vec<GcArtifact>) = std::mem::take(&mut collection.removed)
            .into_iter()
            .partition(|artifact| reached.contains(&artifact.digest));
        for artifact in &mut saved {
            artifact.held_by.push(AGE_OF_NEED.to_owned());
        }
        collection.kept.append(&mut saved);
        collection.removed = gone;
        Ok(())
    }
}

/// Whether a file is younger than `grace`. A time in the future also counts as young: the clock has been set back.
fn is_young(metadata: &fs::Metadata, grace: Duration, now: SystemTime) -> bool {
    let age = metadata
        .modified()
        .ok()
        .and_then(|modified| now.duration_since(modified).ok());
    age.is_none_or(|age| age < grace)
}
