//! GcPlan: removes artifacts that nothing needs any more.
//!
//! What a root reaches is kept: the artifact, its chunks, and everything that it was made from, back to the seeds. Roots are
//! the last runs, the pins and the lock files of pipelines. What is younger than the grace age is kept too, whatever reaches
//! it: somebody may be about to need it. Nobody else may have the store open meanwhile.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use super::checkpoint::{self, Checkpoints};
use super::dependencies::Records;
use super::entries::files;
use super::error::StoreError;
use super::history;
use super::open::Store;
use deaflow_base::{ArtifactId, readable_time};

/// What holds what is younger than the grace age.
pub const AGE: &str = "its age";

/// What holds what that needs.
pub const AGE_OF_NEED: &str = "the age of what needs it";

/// How many of the last runs say which stages had artifacts.
const NAMED_BY: usize = 1000;

/// What to keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Retention {
    /// How many of the last runs are roots, those that made the same counted once.
    pub runs: usize,
    /// What was written less than this ago stays.
    pub grace: Duration,
}

/// One artifact, as a collection sees it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GcArtifact {
    /// The artifact.
    pub digest: ArtifactId,
    /// Length of its file in bytes.
    pub size: u64,
    /// Kind of the stage that made it, where a record says so.
    pub kind: String,
    /// The stage that made it in the last run that had it, or of which it is a chunk; none where no run is remembered that had it.
    pub stage: Option<StageName>,
    /// What holds it: roots, or its age; empty where it goes.
    pub held_by: Vec<String>,
    /// Whether runs alone hold it.
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

/// The artifacts of one stage, or of one kind where it is not known which stage had them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GcGroup {
    /// The stage.
    pub stage: Option<StageName>,
    /// Its kind.
    pub kind: String,
    /// What of it goes.
    pub removed: GcCount,
    /// What of it stays.
    pub kept: GcCount,
    /// What holds that which stays.
    pub held_by: BTreeSet<String>,
}

/// So many artifacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GcCount {
    /// How many.
    pub artifacts: u64,
    /// Their bytes.
    pub bytes: u64,
}

impl GcCount {
    fn add(&mut self, judged: &GcArtifact) {
        self.artifacts += 1;
        self.bytes += judged.size;
    }
}

/// What a collection found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GcPlan {
    /// Artifacts that stay.
    pub kept: Vec<GcArtifact>,
    /// Artifacts that go.
    pub removed: Vec<GcArtifact>,
    /// How many records go with them.
    pub records: u64,
    /// What unfinished actions had come to, and nobody has gone on with for longer than the grace age: it goes.
    pub checkpoints: Vec<Checkpoints>,
}

impl GcPlan {
    /// Bytes of the artifacts that stay.
    #[must_use]
    pub fn bytes_kept(&self) -> u64 {
        self.kept.iter().map(|judged| judged.size).sum()
    }

    /// Bytes of the artifacts that go.
    #[must_use]
    pub fn bytes_removed(&self) -> u64 {
        self.removed.iter().map(|judged| judged.size).sum()
    }

    /// What stays and what goes by stages, in the order of pipelines and stages; what no run had comes last, by its kind.
    #[must_use]
    pub fn by_stage(&self) -> Vec<GcGroup> {
        let mut groups: BTreeMap<(bool, Option<StageName>, String), GcGroup> = BTreeMap::new();
        for judged in self.removed.iter().chain(&self.kept) {
            // A chunk belongs to its stage.
            let kind = judged.kind.strip_suffix(" chunk").unwrap_or(&judged.kind).to_owned();
            let key = (judged.stage.is_none(), judged.stage.clone(), kind.clone());
            let group = groups.entry(key).or_insert_with(|| GcGroup {
                stage: judged.stage.clone(),
                kind,
                removed: GcCount::default(),
                kept: GcCount::default(),
                held_by: BTreeSet::new(),
            });
            match judged.held_by.is_empty() {
                true => group.removed.add(judged),
                false => group.kept.add(judged),
            }
            group.held_by.extend(judged.held_by.iter().cloned());
        }
        groups.into_values().collect()
    }

    /// Bytes of the checkpoints that go.
    #[must_use]
    pub fn checkpoint_bytes(&self) -> u64 {
        self.checkpoints.iter().map(|checkpoints| checkpoints.size).sum()
    }
}

/// Something that holds artifacts.
struct Root {
    name: String,
    artifacts: Vec<ArtifactId>,
    kind: RootKind,
}

/// How a root holds artifacts.
#[derive(Clone, Copy, PartialEq, Eq)]
enum RootKind {
    /// As long as it is among the last: it may name what an earlier collection took.
    Run,
    /// For good: all that it needs must be known.
    Pin,
    /// For good, it alone with its chunks.
    Result,
    /// For good, but it may name what was never built in this store.
    LockFile,
}

impl Store {
    /// Says what stays and what goes. The store must have been opened by [`Store::open_exclusive`] for the answer to hold.
    ///
    /// # Errors
    /// When the system refuses, or something that a root reaches is damaged: what it needs is then not known.
    pub fn plan_gc(&self, retention: &Retention, now: SystemTime) -> Result<GcPlan, StoreError> {
        let records = self.known_records()?;
        let mut holders: BTreeMap<ArtifactId, BTreeSet<String>> = BTreeMap::new();
        let mut by_others: BTreeSet<ArtifactId> = BTreeSet::new();
        let stages = self.stages_of_artifacts()?;
        for mut root in self.roots(retention)? {
            if root.kind == RootKind::LockFile {
                let built = |digest: &ArtifactId| records.contains_key(digest) || self.layout.object(digest).exists();
                root.artifacts.retain(built);
            }
            let (reached, missing) = match root.kind {
                RootKind::Result => self.with_parts(root.artifacts)?,
                _ => self.dependencies(root.artifacts, &records)?,
            };
            if let Some(missing) = missing.first().filter(|_| root.kind != RootKind::Run) {
                return Err(StoreError::Unreachable {
                    root: root.name,
                    missing: *missing,
                });
            }
            for digest in reached {
                if root.kind != RootKind::Run {
                    by_others.insert(digest);
                }
                holders.entry(digest).or_default().insert(root.name.clone());
            }
        }
        let mut collection = GcPlan::default();
        for path in files(&self.layout.objects())? {
            let Some(digest) = self.layout.artifact_at(&path) else {
                continue;
            };
            let metadata = fs::symlink_metadata(&path).map_err(StoreError::io("read", &path))?;
            let mut held_by: Vec<String> = holders.remove(&digest).unwrap_or_default().into_iter().collect();
            let by_runs_alone = !held_by.is_empty() && !by_others.contains(&digest);
            if held_by.is_empty() && is_young(&metadata, retention.grace, now) {
                held_by.push(AGE.to_owned());
            }
            let kind = records.get(&digest).and_then(|made| made.first());
            let judged = GcArtifact {
                digest,
                size: metadata.len(),
                kind: kind.map_or_else(String::new, |record| record.kind.clone()),
                stage: stages.get(&digest).cloned(),
                held_by,
                by_runs_alone,
            };
            if judged.held_by.is_empty() {
                collection.removed.push(judged);
            } else {
                collection.kept.push(judged);
            }
        }
        // What stays by its age alone may be a manifest: its chunks stay with it.
        self.keep_reached_by_young(&mut collection, &records)?;
        let gone: BTreeSet<ArtifactId> = collection.removed.iter().map(|judged| judged.digest).collect();
        collection.records = gone
            .iter()
            .filter_map(|digest| records.get(digest))
            .map(|made| made.len() as u64)
            .sum();
        collection.checkpoints = self.checkpoints()?;
        let old = |checkpoints: &Checkpoints| !checkpoints.is_young(retention.grace, now);
        collection.checkpoints.retain(old);
        Ok(collection)
    }

    /// The stages that made artifacts and their chunks, by the last runs.
    fn stages_of_artifacts(&self) -> Result<BTreeMap<ArtifactId, StageName>, StoreError> {
        let mut stages = BTreeMap::new();
        for run in self.runs()?.take(NAMED_BY) {
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
            // Of what is gone or damaged nothing is known; whether that matters is said elsewhere.
            for part in self.parts(digest).unwrap_or_default() {
                chunks.entry(part).or_insert_with(|| name.clone());
            }
        }
        chunks.extend(stages);
        Ok(chunks)
    }

    /// Artifacts with their chunks, and which of these are missing.
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

    /// Removes what a collection says, records first: a record never promises what is not there. It is remembered that it went `at` a time
    /// in UTC, RFC 3339. `progress` is told how many artifacts of how many are gone.
    ///
    /// # Errors
    /// When the system refuses; what is gone by then stays gone, and a further collection goes on.
    pub fn remove(&self, collection: &GcPlan, at: &str, progress: &dyn Fn(u64, u64)) -> Result<(), StoreError> {
        self.remember_removed(collection, at)?;
        let gone: BTreeSet<ArtifactId> = collection.removed.iter().map(|judged| judged.digest).collect();
        let records = self.known_records()?;
        for record in gone.iter().filter_map(|digest| records.get(digest)).flatten() {
            delete(&self.layout.record(&record.key))?;
        }
        let total = gone.len() as u64;
        // Manifests before their chunks: one without the other must not look like damage if this ends half-way.
        let manifests = gone
            .iter()
            .filter(|digest| self.parts(digest).is_ok_and(|parts| !parts.is_empty()));
        let manifests: BTreeSet<ArtifactId> = manifests.copied().collect();
        let order = manifests.iter().chain(gone.difference(&manifests));
        for (done, digest) in order.enumerate() {
            progress(done as u64, total);
            delete(&self.layout.object(digest))?;
            self.verified.forget(digest);
        }
        for checkpoints in &collection.checkpoints {
            checkpoint::remove(&checkpoints.path)?;
        }
        self.save_index();
        progress(total, total);
        Ok(())
    }

    /// The roots by name, with the artifacts that they hold.
    fn roots(&self, retention: &Retention) -> Result<Vec<Root>, StoreError> {
        let (mut runs, mut counted, mut audits) = (Vec::new(), 0, 0);
        for path in &self.run_files()? {
            if counted == retention.runs {
                break;
            }
            let Some(run) = history::read(path)? else {
                let reason = "nobody knows what this run needs; `deaflow fsck` moves its file aside";
                return Err(StoreError::damaged(path, reason));
            };
            // An audit adds one stage to what a run has made: it does not take the place of one.
            let is_audit = run.command == history::Command::Audit;
            if is_audit && audits == retention.runs {
                continue;
            }
            let artifacts: Vec<ArtifactId> = run.stages.iter().map(|stage| stage.artifact).collect();
            // Runs that take turns count once each.
            if runs.iter().any(|root: &Root| root.artifacts == artifacts) {
                continue;
            }
            *if is_audit { &mut audits } else { &mut counted } += 1;
            runs.push(Root {
                name: format!("run of {} at {}", run.pipeline, readable_time(&run.created)),
                artifacts,
                kind: RootKind::Run,
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
            }
        });
        let lock_files = self.lock_files()?.into_iter().map(|(path, lock)| {
            let artifacts = lock.stages.values().map(|stage| stage.artifact).collect();
            Root {
                name: format!("lock file {}", path.display()),
                artifacts,
                kind: RootKind::LockFile,
            }
        });
        Ok(runs.into_iter().chain(pins).chain(lock_files).collect())
    }

    fn keep_reached_by_young(&self, collection: &mut GcPlan, records: &Records) -> Result<(), StoreError> {
        let young = collection.kept.iter().filter(|judged| judged.held_by == [AGE]);
        let (reached, _) = self.dependencies(young.map(|judged| judged.digest).collect(), records)?;
        let (mut saved, gone): (Vec<GcArtifact>, Vec<GcArtifact>) = std::mem::take(&mut collection.removed)
            .into_iter()
            .partition(|judged| reached.contains(&judged.digest));
        for judged in &mut saved {
            judged.held_by.push(AGE_OF_NEED.to_owned());
        }
        collection.kept.append(&mut saved);
        collection.removed = gone;
        Ok(())
    }
}

/// Whether a file was written less than `grace` ago. One from the future is young: the clock has been set back.
fn is_young(metadata: &fs::Metadata, grace: Duration, now: SystemTime) -> bool {
    let age = metadata
        .modified()
        .ok()
        .and_then(|modified| now.duration_since(modified).ok());
    age.is_none_or(|age| age < grace)
}

fn delete(path: &Path) -> Result<(), StoreError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(StoreError::io("remove", path)(error)),
        _ => Ok(()),
    }
}
