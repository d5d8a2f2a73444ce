//! Checks everything: every byte of every artifact against its header, its content against its name, every record and run
//! against itself, every manifest and record against what it names. Damaged files are quarantined, so that the next run
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
use super::record::{self, Lookup};
use deaflow_base::{ArtifactId, FileDigest};

/// A file that was found damaged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Where it stood.
    pub path: PathBuf,
    /// Where it is now.
    pub quarantined: Option<PathBuf>,
    /// How it showed.
    pub reason: String,
}

/// An artifact that something names and that is not there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingArtifact {
    /// The artifact.
    pub digest: ArtifactId,
    /// The manifest or record that names it.
    pub needed_by: String,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// How many artifacts were checked.
    pub objects: u64,
    /// How many bytes they have.
    pub bytes: u64,
    /// How many records were checked.
    pub records: u64,
    /// How many files of unfinished actions were checked.
    pub checkpoints: u64,
    /// Damaged artifacts, records, runs and checkpoints, now in quarantine.
    pub damaged: Vec<Damage>,
    /// Files that the system does not let anybody read, and why: nothing is known of them, and they stay where they are.
    pub unreadable: Vec<Damage>,
    /// Artifacts that a manifest or a record names and that are not there (those quarantined just now among them).
    pub missing: Vec<MissingArtifact>,
    /// The manifests and records that name them.
    dangling: BTreeSet<PathBuf>,
    /// Artifacts whose file is not the one that a record saw, though the content is right: rebuilt since.
    pub rewritten: Vec<ArtifactId>,
    /// Files that do not belong where they are.
    pub strays: Vec<PathBuf>,
    /// Files being written by processes at work, or left by dead ones while others work.
    pub unfinished: u64,
    /// What a repair has removed or moved aside, so that nothing promises what is not there.
    pub repaired: Vec<PathBuf>,
}

impl Report {
    /// Whether nothing is damaged or missing.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.damaged.is_empty() && self.missing.is_empty() && self.unreadable.is_empty()
    }
}

/// A sound artifact, as later checks need it; of one that cannot be read nothing is known.
#[derive(Default)]
struct Sound {
    file: Option<FileDigest>,
    kind: Option<String>,
    parts: Vec<ArtifactId>,
}

impl Store {
    /// Checks the whole store. `progress` is told how many files of how many are done.
    ///
    /// # Errors
    /// When the system refuses; damage is in the report.
    pub fn fsck(&self, progress: &dyn Fn(u64, u64)) -> Result<Report, StoreError> {
        let mut report = Report::default();
        // Records first: an artifact is there before its record is, also while a run goes on.
        let records = files(&self.layout.records())?;
        let objects = files(&self.layout.objects())?;
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
                        "it says that `{}` made artifact {short}, which is of kind `{kind}`",
                        record.action.kind
                    );
                    self.condemn(path, reason, &mut report)?;
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

    /// Checks the whole store and makes it sound: damaged files are quarantined as always, and so are strays, manifests that
    /// lack chunks, and records of what is missing. No sound chunk is touched; the next run builds what is gone, and no more.
    /// The store must have been opened by [`Store::open_exclusive`].
    ///
    /// # Errors
    /// When the system refuses.
    pub fn repair(&self, progress: &dyn Fn(u64, u64)) -> Result<Report, StoreError> {
        let mut report = self.fsck(progress)?;
        let mut open: Vec<PathBuf> = report.dangling.iter().chain(&report.strays).cloned().collect();
        let mut gone = BTreeSet::new();
        while let Some(path) = open.pop() {
            if self.quarantine(&path)?.is_some() {
                report.repaired.push(path.clone());
            }
            // A manifest that goes leaves a record behind that promises it.
            gone.extend(self.layout.artifact_at(&path));
            if open.is_empty() && !gone.is_empty() {
                open = self.records_of(&std::mem::take(&mut gone))?;
            }
        }
        Ok(report)
    }

    /// Files of the records that name one of some artifacts.
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
        report.bytes += fs::symlink_metadata(path).map_err(StoreError::io("read", path))?.len();
        match self::sound(path, &digest) {
            Ok(object) => {
                sound.insert(digest, object);
            }
            // Not damage, as far as anybody can tell: a disk that refuses, a file that somebody has locked.
            Err(error @ StoreError::Io { .. }) => {
                report.unreadable.push(Damage {
                    path: path.to_owned(),
                    quarantined: None,
                    reason: error.to_string(),
                });
                sound.entry(digest).or_default();
            }
            Err(StoreError::Damaged { reason, .. }) => self.condemn(path, reason, report)?,
            Err(error) => self.condemn(path, error.to_string(), report)?,
        }
        Ok(())
    }

    fn check_record(&self, path: &Path, report: &mut Report) -> Result<Option<record::Record>, StoreError> {
        let Some(key) = self.layout.action_at(path) else {
            report.strays.push(path.to_owned());
            return Ok(None);
        };
        report.records += 1;
        match record::read(path, &key)? {
            Lookup::Found(record, _) => return Ok(Some(*record)),
            Lookup::Damaged(reason) => self.condemn(path, reason.into(), report)?,
            Lookup::Absent => {}
        }
        Ok(None)
    }

    fn check_runs(&self, report: &mut Report) -> Result<(), StoreError> {
        for path in self.run_files()? {
            if history::read(&path)?.is_none() && path.exists() {
                self.condemn(&path, "it is not the file of a run".into(), report)?;
            }
        }
        Ok(())
    }

    /// What was left where others leave nothing, and links, which are none of ours wherever they are.
    fn check_strays(&self, report: &mut Report) -> Result<(), StoreError> {
        let (unfinished, others): (Vec<PathBuf>, Vec<PathBuf>) = files_in(&self.layout.temporary())?
            .into_iter()
            .partition(|path| is_temporary(path));
        let of_others = unfinished
            .iter()
            .filter(|path| !self.session.temporary_folder.is_own(path));
        report.unfinished = of_others.count() as u64;
        // What has gone meanwhile was being written.
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
            match checkpoint::check(&path) {
                Ok(()) => {}
                Err(StoreError::Damaged { reason, .. }) => self.condemn(&path, reason, report)?,
                Err(error) => report.unreadable.push(Damage {
                    path,
                    quarantined: None,
                    reason: error.to_string(),
                }),
            }
        }
        Ok(())
    }

    fn condemn(&self, path: &Path, reason: String, report: &mut Report) -> Result<(), StoreError> {
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
