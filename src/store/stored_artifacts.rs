//! What a store has to give away: artifacts with the records that name them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use super::dependencies::{RecordSummary, Records};
use super::error::StoreError;
use super::header::Header;
use super::inspect::{Condition, Effort};
use super::open::Store;
use super::record::Record;
use deaflow_base::{ArtifactId, FileDigest};

/// An artifact that is here.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredArtifact {
    /// Which.
    pub artifact: ArtifactId,
    /// Its chunks, if it is a manifest.
    pub parts: Vec<ArtifactId>,
    /// What says that an action made it; nothing, of a chunk whose record is lost.
    pub records: Vec<Record>,
}

impl Store {
    /// The artifacts that are here and that a record or a manifest names, chunks before manifests; or of these those that some artifacts
    /// need, themselves included.
    ///
    /// # Errors
    /// When one of `roots` is missing, or the system refuses.
    pub fn stored_artifacts(&self, roots: Option<&[ArtifactId]>) -> Result<Vec<StoredArtifact>, StoreError> {
        let mut records: BTreeMap<ArtifactId, Vec<Record>> = BTreeMap::new();
        self.each_record(|record| records.entry(record.artifact).or_default().push(record))?;
        let wanted: BTreeSet<ArtifactId> = match roots {
            None => records.keys().copied().collect(),
            Some(roots) => {
                let (reached, missing) = self.dependencies(roots.to_vec(), &known(&records))?;
                // What something was made from may be elsewhere.
                if let Some(missing) = missing.iter().find(|missing| roots.contains(missing)) {
                    let path = self.layout.object(missing);
                    return Err(StoreError::Missing { digest: *missing, path });
                }
                reached
            }
        };
        let mut chunks: BTreeSet<ArtifactId> = BTreeSet::new();
        let mut held: BTreeMap<ArtifactId, Vec<ArtifactId>> = BTreeMap::new();
        for artifact in wanted {
            // What has been collected is not here, though its record is.
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

    /// The file of an artifact, every byte of which has been compared with its header: where, its digest and its length.
    ///
    /// # Errors
    /// When it is missing or damaged.
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
