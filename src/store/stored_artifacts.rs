//! The artifacts of a store with their records, for upload.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use super::dependencies::{RecordSummary, Records};
use super::error::StoreError;
use super::header::Header;
use super::inspect::{Condition, Effort};
use super::open::Store;
use super::record::Record;
use deaflow_base::{ArtifactId, FileDigest};

/// An artifact of this store.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredArtifact {
    /// Its digest.
    pub artifact: ArtifactId,
    /// Its chunks, if it is a manifest.
    pub parts: Vec<ArtifactId>,
    /// Its records; empty for a chunk whose record is lost.
    pub records: Vec<Record>,
}

impl Store {
    /// Returns the artifacts of this store with a record or a manifest, chunks before manifests. If `roots` are given,
    /// only these and their dependencies.
    ///
    /// # Errors
    /// If one of `roots` is missing, or the system reports an error.
    pub fn stored_artifacts(&self, roots: Option<&[ArtifactId]>) -> Result<Vec<StoredArtifact>, StoreError> {
        let mut records: BTreeMap<ArtifactId, Vec<Record>> = BTreeMap::new();
        self.each_record(|record| records.entry(record.artifact).or_default().push(record))?;
        let selected: BTreeSet<ArtifactId> = match roots {
            None => records.keys().copied().collect(),
            Some(roots) => {
                let (reached, missing) = self.dependencies(roots.to_vec(), &known(&records))?;
                // Inputs may be in another store only.
                if let Some(missing) = missing.iter().find(|missing| roots.contains(missing)) {
                    let path = self.layout.object(missing);
                    return Err(StoreError::Missing { digest: *missing, path });
                }
                reached
            }
        };
        let mut chunks: BTreeSet<ArtifactId> = BTreeSet::new();
        let mut held: BTreeMap<ArtifactId, Vec<ArtifactId>> = BTreeMap::new();
        for artifact in selected {
            // It may have been removed while its record remains.
            if matches!(self.inspect(&artifact, Effort::Quick)?, Condition::Missing) {
                continue;
            }
            let parts = match self.parts(&artifact) {
                Ok(parts) => parts,
                Err(error) if error.is_damage() => Vec::new(),
                Err(error) => return Err(error),
            };
            chunks.extend(parts.iter().copied());
            held.insert(artifact, parts);
        }
        for chunk in chunks {
            held.entry(chunk).or_default();
        }
        let mut held: Vec<StoredArtifact> = held
            .into_iter()
            .map(|(artifact, parts)| StoredArtifact {
                records: records.remove(&artifact).unwrap_or_default(),
                artifact,
                parts,
            })
            .collect();
        held.sort_by_key(|held| !held.parts.is_empty());
        Ok(held)
    }

    /// Verifies the file of an artifact, and returns its path, digest and length.
    ///
    /// # Errors
    /// If it is missing or damaged.
    pub fn file_of(&self, artifact: &ArtifactId) -> Result<(PathBuf, FileDigest, u64), StoreError> {
        let path = self.layout.object(artifact);
        let Header { file, size, .. } = self.verified.verify(&path, artifact)?;
        Ok((path, file, size))
    }
}

fn known(records: &BTreeMap<ArtifactId, Vec<Record>>) -> Records {
    let known = |of: &Vec<Record>| of.iter().cloned().map(RecordSummary::of).collect();
    records.iter().map(|(artifact, of)| (*artifact, known(of))).collect()
}
