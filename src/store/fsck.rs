//! Checks the integrity of a store: the bytes of every artifact against its header and name, every record and run, and
//! that the artifacts named by manifests and records exist. Damaged files are moved to quarantine, so that the next run
//! rebuilds them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::artifact::Artifact;
use super::checkpoint;
use super::entries::{files, files_in, is_hidden, is_temporary};
use super::error::StoreError;
use super::history;
use super::links::links;
use super::open::Store;
use super::quarantine::read_twice;
use super::record::{self, Lookup};
use deaflow_base::{ArtifactId, FileDigest};

/// A file that was found damaged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Its path.
    pub path: PathBuf,
    /// Its path in quarantine.
    pub quarantined: Option<PathBuf>,
    /// What is wrong with it.
    pub reason: String,
}

/// An artifact that is needed and missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingArtifact {
    /// The artifact.
    pub digest: ArtifactId,
    /// The manifest or record that names it.
    pub needed_by: String,
}

/// The result of a check.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Number of checked artifacts.
    pub objects: u64,
    /// Their total length, bytes.
    pub bytes: u64,
    /// Number of checked records.
    pub records: u64,
    /// Number of checked checkpoint files.
    pub checkpoints: u64,
    /// Damaged artifacts, records, runs and checkpoints, now in quarantine.
    pub damaged: Vec<Damage>,
    /// Files that cannot be read, with the error of the system, or that are damaged only at the first of two readings.
    /// They are not moved.
    pub unreadable: Vec<Damage>,
    /// Missing artifacts that a manifest or a record names, including those that were moved to quarantine now.
    pub missing: Vec<MissingArtifact>,
    /// The manifests and records that name missing artifacts.
    dangling: BTreeSet<PathBuf>,
    /// Artifacts whose file differs from that in a record, but has the same content: they were rebuilt.
    pub rewritten: Vec<ArtifactId>,
    /// Files that do not belong into the store.
    pub strays: Vec<PathBuf>,
    /// Number of temporary files of other processes.
    pub unfinished: u64,
    /// Files that a repair has moved to quarantine.
    pub repaired: Vec<PathBuf>,
}

impl Report {
    /// Whether nothing is damaged or missing.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.damaged.is_empty() && self.missing.is_empty() && self.unreadable.is_empty()
    }
}

/// What later checks need of an artifact; empty if it cannot be read.
#[derive(Default)]
struct Sound {
    file: Option<FileDigest>,
    kind: Option<String>,
    parts: Vec<ArtifactId>,
}

impl Store {
    /// Checks the whole store. `progress` is called with the number of checked files and the total.
    ///
    /// # Errors
    /// If the system reports an error; damage is in the report.
    pub fn fsck(&self, progress: &dyn Fn(u64, u64)) -> Result<Report, StoreError> {
        let mut report = Report::default();
        // Lists records first: an artifact exists before its record, also during a run.
        let records = files(&self.layout.records())?;
        let objects = files(&self.layout.objects())?;
        // Lists of files leave out links that lead nowhere or in a circle; in the place of a file they are damage.
        let links = links(&self.layout);
        let with_links = |mut paths: Vec<PathBuf>, is_ours: &dyn Fn(&Path) -> bool| {
            paths.extend(links.iter().filter(|path| is_ours(path)).cloned());
            paths.sort_unstable();
            paths.dedup();
            paths
        };
        let records = with_links(records, &|path| self.layout.action_at(path).is_some());
        let objects = with_links(objects, &|path| self.layout.artifact_at(path).is_some());
        let total = (objects.len() + records.len()) as u64;
        let mut sound = BTreeMap::new();
        for (done, path) in objects.iter().enumerate() {
            progress(done as u64, total);
            self.check_object(path, &mut sound, &mut report)?;
        }
        let mut wanted = BTreeSet::new();
        for (digest, object) in &sound {
            wanted.extend(object.parts.iter().map(|part| {
                (
                    *part,
                    format!("manifest {}", digest.short()),
                    self.layout.object(digest),
                )
            }));
        }
        for (done, path) in records.iter().enumerate() {
            progress((objects.len() + done) as u64, total);
            if let Some(record) = self.check_record(path, &mut report)? {
                let known = sound.get(&record.artifact);
                let kind = known.and_then(|object| object.kind.as_ref());
                if let Some(kind) = kind.filter(|kind| **kind != record.action.kind) {
                    let short = record.artifact.short();
                    let reason = format!(
                        "its kind is `{}`, but artifact {short} has kind `{kind}`",
                        record.action.kind
                    );
                    self.quarantine_damaged(path, reason, &mut report)?;
                    continue;
                }
                if known
                    .and_then(|object| object.file)
                    .is_some_and(|file| file != record.file_digest)
                {
                    report.rewritten.push(record.artifact);
                }
                let needed_by = format!("record {} ({})", record.key.short(), record.action.kind);
                wanted.insert((record.artifact, needed_by, path.clone()));
            }
        }
        for (digest, needed_by, by) in wanted {
            if !sound.contains_key(&digest) {
                report.missing.push(MissingArtifact { digest, needed_by });
                report.dangling.insert(by);
            }
        }
        self.check_runs(&mut report)?;
        self.check_checkpoints(&mut report)?;
        self.check_strays(&mut report)?;
        progress(total, total);
        Ok(report)
    }

    /// Checks and repairs the store: also moves stray files, manifests with missing chunks and records of missing
    /// artifacts to quarantine. Intact chunks stay, so the next run builds only what is missing. The store must have
    /// been opened by [`Store::open_exclusive`].
    ///
    /// # Errors
    /// If the system reports an error.
    pub fn repair(&self, progress: &dyn Fn(u64, u64)) -> Result<Report, StoreError> {
        let mut report = self.fsck(progress)?;
        let mut open: Vec<PathBuf> = report.dangling.iter().chain(&report.strays).cloned().collect();
        let mut gone = BTreeSet::new();
        while let Some(path) = open.pop() {
            if self.quarantine(&path)?.is_some() {
                report.repaired.push(path.clone());
            }
            // The record of a moved manifest is moved too.
            gone.extend(self.layout.artifact_at(&path));
            if open.is_empty() && !gone.is_empty() {
                open = self.records_of(&std::mem::take(&mut gone))?;
            }
        }
        Ok(report)
    }

    /// Returns the files of the records of some artifacts.
    fn records_of(&self, artifacts: &BTreeSet<ArtifactId>) -> Result<Vec<PathBuf>, StoreError> {
        let mut found = Vec::new();
        self.each_record(|record| {
            if artifacts.contains(&record.artifact) {
                found.push(self.layout.record(&record.key));
            }
        })?;
        Ok(found)
    }

    fn check_object(
        &self,
        path: &Path,
        sound: &mut BTreeMap<ArtifactId, Sound>,
        report: &mut Report,
    ) -> Result<(), StoreError> {
        let Some(digest) = self.layout.artifact_at(path) else {
            report.strays.push(path.to_owned());
            return Ok(());
        };
        report.objects += 1;
        report.bytes += fs::symlink_metadata(path).map_or(0, |metadata| metadata.len());
        match read_twice(path, || self::sound(path, &digest)) {
            Ok(object) => {
                sound.insert(digest, object);
                Ok(())
            }
            Err(error) => {
                if matches!(error, StoreError::Io { .. }) {
                    sound.entry(digest).or_default();
                }
                self.report_failure(path, error, report)
            }
        }
    }

    /// Moves a damaged file to quarantine. One that the system cannot read (a disk error, a missing permission) stays.
    fn report_failure(&self, path: &Path, error: StoreError, report: &mut Report) -> Result<(), StoreError> {
        match error {
            StoreError::Io { .. } => {
                report.unreadable.push(Damage {
                    path: path.to_owned(),
                    quarantined: None,
                    reason: error.to_string(),
                });
                Ok(())
            }
            StoreError::Damaged { reason, .. } => self.quarantine_damaged(path, reason, report),
            error => self.quarantine_damaged(path, error.to_string(), report),
        }
    }

    fn check_record(&self, path: &Path, report: &mut Report) -> Result<Option<record::Record>, StoreError> {
        let Some(key) = self.layout.action_at(path) else {
            report.strays.push(path.to_owned());
            return Ok(None);
        };
        report.records += 1;
        let read = || match record::read(path, &key)? {
            Lookup::Damaged(reason) => Err(StoreError::damaged(path, reason)),
            found => Ok(found.record()),
        };
        match read_twice(path, read) {
            Ok(found) => Ok(found),
            Err(error) => self.report_failure(path, error, report).map(|()| None),
        }
    }

    fn check_runs(&self, report: &mut Report) -> Result<(), StoreError> {
        for path in self.run_files()? {
            let read = || match history::read(&path)? {
                None if path.exists() => Err(StoreError::damaged(&path, "it is not a valid file of a run")),
                _ => Ok(()),
            };
            if let Err(error) = read_twice(&path, read) {
                self.report_failure(&path, error, report)?;
            }
        }
        Ok(())
    }

    /// Finds files that do not belong into the store, and links.
    fn check_strays(&self, report: &mut Report) -> Result<(), StoreError> {
        let (unfinished, others): (Vec<PathBuf>, Vec<PathBuf>) = files_in(&self.layout.temporary())?
            .into_iter()
            .partition(|path| is_temporary(path));
        let of_others = unfinished
            .iter()
            .filter(|path| !self.session.temporary_folder.is_own(path));
        report.unfinished = of_others.count() as u64;
        // A file that has disappeared was a temporary one.
        let is_stray = |path: &PathBuf| !is_hidden(path) && fs::symlink_metadata(path).is_ok();
        report.strays.extend(others.into_iter().filter(is_stray));
        report.strays.extend(self.stray_runs()?);
        report.strays.extend(self.stray_pins()?);
        report.strays.extend(self.stray_lock_files()?);
        let mut links = links(&self.layout);
        report.strays.iter().for_each(|stray| {
            links.remove(stray);
        });
        report.strays.extend(links);
        Ok(())
    }

    fn check_checkpoints(&self, report: &mut Report) -> Result<(), StoreError> {
        let (files, strays) = self.checkpoint_files()?;
        report.strays.extend(strays);
        for path in files {
            report.checkpoints += 1;
            if let Err(error) = read_twice(&path, || checkpoint::check(&path)) {
                self.report_failure(&path, error, report)?;
            }
        }
        Ok(())
    }

    fn quarantine_damaged(&self, path: &Path, reason: String, report: &mut Report) -> Result<(), StoreError> {
        report.damaged.push(Damage {
            path: path.to_owned(),
            quarantined: self.quarantine(path)?,
            reason,
        });
        Ok(())
    }
}

fn sound(path: &Path, digest: &ArtifactId) -> Result<Sound, StoreError> {
    let (artifact, object) = Artifact::read_uncached(path, digest)?;
    Ok(Sound {
        file: Some(artifact.file_digest()?),
        kind: Some(object.kind),
        parts: object.parts,
    })
}
