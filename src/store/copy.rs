//! Copies artifacts with their dependencies to another store, where runs reuse them.
//!
//! Artifacts come before manifests that lay them end to end, and both before the records that promise them, so that the
//! other store is sound at any moment.

use std::collections::BTreeSet;

use super::dependencies::Records;
use super::error::StoreError;
use super::header::Header;
use super::inspect::{Condition, Effort};
use super::open::Store;
use super::record::Lookup;
use deaflow_base::{ActionKey, ArtifactId};

/// The result of copying.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CopySummary {
    /// Artifacts that were copied.
    pub artifacts: u64,
    /// Bytes of their files.
    pub bytes: u64,
    /// Records that were copied.
    pub records: u64,
    /// Artifacts that existed already.
    pub artifacts_there: u64,
    /// Records that existed already.
    pub records_there: u64,
    /// Artifacts without a valid record, which no run can reuse.
    pub without_record: Vec<ArtifactId>,
}

impl Store {
    /// Copies an artifact, its chunks and all that it was made from into another store, then their records. What is
    /// there already stays as it is. `progress` is told how many artifacts of how many are done.
    ///
    /// # Errors
    /// If something that is needed is missing or damaged, or the system reports an error. The other store is sound even
    /// then, and a further copy goes on.
    pub fn copy_to(
        &self,
        target: &Self,
        artifact: ArtifactId,
        progress: &dyn Fn(u64, u64),
    ) -> Result<CopySummary, StoreError> {
        let known = self.known_records()?;
        let (reached, missing) = self.dependencies(vec![artifact], &known)?;
        if let Some(missing) = missing.first() {
            let path = self.layout.object(missing);
            return Err(StoreError::Missing { digest: *missing, path });
        }
        let mut copied = CopySummary::default();
        let total = reached.len() as u64;
        for (done, digest) in self.manifests_last(&reached)?.iter().enumerate() {
            progress(done as u64, total);
            self.copy_artifact(target, digest, &mut copied)?;
        }
        progress(total, total);
        for digest in &reached {
            self.copy_records(target, digest, &known, &mut copied)?;
        }
        target.settle_records()?;
        target.save_index();
        Ok(copied)
    }

    /// Sorts manifests last, so that an interrupted copy leaves no manifest without chunks.
    fn manifests_last(&self, reached: &BTreeSet<ArtifactId>) -> Result<Vec<ArtifactId>, StoreError> {
        let (mut plain, mut manifests) = (Vec::new(), Vec::new());
        for digest in reached {
            match self.parts(digest)?.is_empty() {
                true => plain.push(*digest),
                false => manifests.push(*digest),
            }
        }
        plain.append(&mut manifests);
        Ok(plain)
    }

    fn copy_artifact(&self, target: &Self, digest: &ArtifactId, copied: &mut CopySummary) -> Result<(), StoreError> {
        if let Condition::Intact { .. } = target.inspect(digest, Effort::Quick)? {
            copied.artifacts_there += 1;
            return Ok(());
        }
        let source = self.layout.object(digest);
        let temporary = target.temporary_file()?;
        let header = Header::copy(&source, &temporary)?;
        if header.content != *digest {
            return Err(StoreError::damaged(
                &source,
                format!("it contains artifact {}", header.content.short()),
            ));
        }
        target.publish(&temporary, header)?;
        copied.artifacts += 1;
        copied.bytes += header.size;
        Ok(())
    }

    /// Copies the records of an artifact.
    fn copy_records(
        &self,
        target: &Self,
        digest: &ArtifactId,
        known: &Records,
        copied: &mut CopySummary,
    ) -> Result<(), StoreError> {
        let keys: Vec<ActionKey> = known
            .get(digest)
            .into_iter()
            .flatten()
            .map(|record| record.key)
            .collect();
        if keys.is_empty() {
            copied.without_record.push(*digest);
        }
        for key in keys {
            if let Lookup::Found(..) = target.record(&key)? {
                copied.records_there += 1;
            } else if let Lookup::Found(record, _) = self.record(&key)? {
                match self.origin_of(&record) {
                    Some(origin) => target.put_record_of(&record, &origin)?,
                    None => target.put_record(&record)?,
                }
                copied.records += 1;
            }
        }
        Ok(())
    }
}
