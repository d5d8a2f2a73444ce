//! The dependencies of artifacts: their chunks and all inputs from which they were made.

use std::collections::{BTreeMap, BTreeSet};

use super::entries::files;
use super::error::StoreError;
use super::open::Store;
use super::record::{self, Lookup, Record};
use deaflow_base::{ActionKey, ArtifactId};

/// The part of a record that is needed here.
pub struct RecordSummary {
    /// Its key.
    pub key: ActionKey,
    /// Kind of its action.
    pub kind: String,
    /// The inputs of the action.
    inputs: Vec<ArtifactId>,
}

impl RecordSummary {
    /// Takes the needed part of a record.
    pub fn of(record: Record) -> Self {
        Self {
            key: record.key,
            kind: record.action.kind,
            inputs: record.action.inputs,
        }
    }
}

/// Records by artifact.
pub type Records = BTreeMap<ArtifactId, Vec<RecordSummary>>;

impl Store {
    /// Returns artifacts with all their dependencies, and which of them are missing (whose own dependencies are
    /// unknown).
    pub(super) fn dependencies(
        &self,
        artifacts: Vec<ArtifactId>,
        records: &Records,
    ) -> Result<(BTreeSet<ArtifactId>, Vec<ArtifactId>), StoreError> {
        let mut reached = BTreeSet::new();
        let mut missing = Vec::new();
        let mut open = artifacts;
        while let Some(digest) = open.pop() {
            if !reached.insert(digest) {
                continue;
            }
            let made = records.get(&digest).into_iter().flatten();
            open.extend(made.flat_map(|record| record.inputs.iter().copied()));
            match self.parts(&digest) {
                Ok(parts) => open.extend(parts),
                Err(StoreError::Missing { .. }) => {
                    missing.push(digest);
                    continue;
                }
                Err(error) => return Err(error),
            }
            if !records.contains_key(&digest) {
                // Its record is lost or damaged, but its provenance has the inputs too.
                let provenance = self.artifact(&digest)?.provenance()?;
                let inputs = provenance.get("inputs").map_or("", String::as_str).lines();
                open.extend(inputs.filter_map(|input| input.parse::<ArtifactId>().ok()));
            }
        }
        Ok((reached, missing))
    }

    /// Returns the valid records.
    pub(super) fn known_records(&self) -> Result<Records, StoreError> {
        let mut known = Records::new();
        self.each_record(|record| {
            known
                .entry(record.artifact)
                .or_default()
                .push(RecordSummary::of(record))
        })?;
        Ok(known)
    }

    /// Calls a function for each valid record.
    pub(super) fn each_record(&self, mut take: impl FnMut(Record)) -> Result<(), StoreError> {
        for path in files(&self.layout.records())? {
            let Some(key) = self.layout.action_at(&path) else {
                continue;
            };
            if let Lookup::Found(record, _) = record::read(&path, &key)? {
                take(*record);
            }
        }
        Ok(())
    }
}
