//! The actions from which an artifact originates, from records and provenance.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use super::artifact::Artifact;
use super::error::StoreError;
use super::open::Store;
use super::record::{Lookup, Record};
use deaflow_base::ArtifactId;

/// An action and the artifact that it made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ancestor {
    /// The artifact.
    pub artifact: ArtifactId,
    /// Its inputs.
    pub inputs: Vec<ArtifactId>,
    /// Kind, recipe, parameters, inputs, when, where and how long, by the names of `/provenance`; of an artifact that
    /// is not in the store nothing.
    pub entries: BTreeMap<String, String>,
}

impl Ancestor {
    /// Returns one of its entries; empty if unknown.
    #[must_use]
    pub fn entry(&self, name: &str) -> &str {
        self.entries.get(name).map_or("", String::as_str)
    }

    /// Returns a name of kind and digest.
    #[must_use]
    pub fn name(&self) -> String {
        match self.entry("kind") {
            "" => format!("unknown-{}", self.artifact.short()),
            kind => format!("{}-{}", kind.replace([' ', '/'], "_"), self.artifact.short()),
        }
    }
}

impl Store {
    /// The action that made an artifact, then those that made what it was made from, back to the samples: each before
    /// its inputs. What is not in the store is among them, with nothing known of it.
    ///
    /// # Errors
    /// If one of the artifacts is damaged, or the system reports an error.
    pub fn ancestry(&self, artifact: &Artifact) -> Result<Vec<Ancestor>, StoreError> {
        let mut found = BTreeMap::new();
        let mut open = vec![artifact.digest()];
        while let Some(digest) = open.pop() {
            if let Entry::Vacant(free) = found.entry(digest) {
                let ancestor = self.ancestor(digest)?;
                open.extend(&ancestor.inputs);
                free.insert(ancestor);
            }
        }
        let order = inputs_last(artifact.digest(), &found);
        Ok(order.into_iter().filter_map(|digest| found.remove(&digest)).collect())
    }

    fn ancestor(&self, digest: ArtifactId) -> Result<Ancestor, StoreError> {
        let mut entries = match self.artifact(&digest) {
            Ok(artifact) => artifact.provenance()?,
            Err(StoreError::Missing { .. }) => BTreeMap::new(),
            Err(error) => return Err(error),
        };
        let key = entries.get("action").and_then(|key| key.parse().ok());
        if let Some(key) = key
            && let Lookup::Found(record, _) = self.record(&key)?
            && record.artifact == digest
        {
            entries.extend(entries_of(&record));
        }
        let inputs = entries.get("inputs").map_or("", String::as_str).lines();
        Ok(Ancestor {
            artifact: digest,
            inputs: inputs.filter_map(|input| input.parse().ok()).collect(),
            entries,
        })
    }
}

/// Returns the entries of a record. Its key confirms them, unlike those in a file.
fn entries_of(record: &Record) -> [(String, String); 5] {
    let inputs: Vec<String> = record.action.inputs.iter().map(ArtifactId::to_string).collect();
    [
        ("kind", record.action.kind.clone()),
        ("recipe", record.action.recipe.to_string()),
        ("parameters", record.action.parameters.to_string()),
        ("inputs", inputs.join("\n")),
        ("unstable", record.unstable.to_string()),
    ]
    .map(|(name, value)| (name.to_owned(), value))
}

/// Returns the artifacts in topological order by depth-first search, without recursion because a pipeline may be long.
fn inputs_last(first: ArtifactId, found: &BTreeMap<ArtifactId, Ancestor>) -> Vec<ArtifactId> {
    let mut done = BTreeSet::new();
    let mut order = Vec::new();
    let mut open = vec![(first, false)];
    while let Some((digest, left)) = open.pop() {
        if left {
            order.push(digest);
        } else if done.insert(digest) {
            open.push((digest, true));
            let inputs = found.get(&digest).into_iter().flat_map(|ancestor| &ancestor.inputs);
            open.extend(inputs.map(|input| (*input, false)));
        }
    }
    order.reverse();
    order
}
