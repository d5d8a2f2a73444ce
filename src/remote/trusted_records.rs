//! The records of a remote that are used: those of trusted signers, as far as these agree.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use super::key::PublicKey;
use super::pack::{PackError, Statement};
use deaflow_base::{ActionKey, ArtifactId};
use deaflow_store::{Record, UpstreamArtifact};

/// The result of an action according to one signer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SignedResult {
    /// The signer.
    pub signer: PublicKey,
    /// The artifact that the action made.
    pub artifact: ArtifactId,
}

/// An action for which trusted signers recorded different results. None of them is used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Disagreement {
    /// The action.
    pub key: ActionKey,
    /// Kind of the action.
    pub kind: String,
    /// The results, at least two.
    pub results: Vec<SignedResult>,
}

/// Files of records that are not used.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct IgnoredRecords {
    /// Number of files per key that is not trusted.
    pub untrusted: BTreeMap<PublicKey, u64>,
    /// Names of invalid files, with the reason.
    pub rejected: Vec<(String, PackError)>,
}

impl IgnoredRecords {
    /// Returns the files of trusted signers that are damaged, not those with other names or of other versions.
    pub fn damaged(&self) -> impl Iterator<Item = &(String, PackError)> {
        self.rejected
            .iter()
            .filter(|(_, why)| !matches!(why, PackError::BadName | PackError::OtherVersion))
    }
}

/// The statements of trusted signers.
#[derive(Default)]
pub struct TrustedRecords {
    statements: HashMap<ActionKey, (PublicKey, Statement)>,
    disputed: BTreeMap<ActionKey, Disagreement>,
    by_artifact: HashMap<ArtifactId, Vec<ActionKey>>,
    artifacts: HashMap<ArtifactId, UpstreamArtifact>,
    signed: HashSet<(PublicKey, ActionKey, ArtifactId)>,
}

impl TrustedRecords {
    /// Adds a statement of a trusted signer.
    pub fn add(&mut self, signer: PublicKey, statement: Statement) {
        let (key, artifact) = (statement.record.key, statement.record.artifact);
        self.add_artifacts(&statement);
        self.signed.insert((signer, key, artifact));
        let result = SignedResult { signer, artifact };
        if let Some(dispute) = self.disputed.get_mut(&key) {
            if !dispute.results.contains(&result) {
                dispute.results.push(result);
            }
            return;
        }
        match self.statements.get(&key) {
            Some((other, known)) if known.record.artifact != artifact => {
                let other_result = SignedResult {
                    signer: *other,
                    artifact: known.record.artifact,
                };
                let dispute = Disagreement {
                    key,
                    kind: known.record.action.kind.clone(),
                    results: vec![other_result, result],
                };
                self.disputed.insert(key, dispute);
                self.statements.remove(&key);
            }
            Some(_) => {}
            None => {
                self.by_artifact.entry(artifact).or_default().push(key);
                self.statements.insert(key, (signer, statement));
            }
        }
    }

    /// Adds the artifacts that a statement names, even if the statement is disputed: their digests verify their
    /// content.
    fn add_artifacts(&mut self, statement: &Statement) {
        let unknown = || UpstreamArtifact {
            size: 0,
            parts: Some(Vec::new()),
        };
        for part in statement.parts.iter().flatten() {
            self.artifacts.entry(*part).or_insert_with(unknown);
        }
        let artifact = self.artifacts.entry(statement.record.artifact).or_insert_with(unknown);
        artifact.size = statement.record.size;
        artifact.parts.clone_from(&statement.parts);
    }

    /// Returns the record of an action, unless it is disputed.
    pub fn record(&self, key: &ActionKey) -> Option<&Record> {
        self.statements.get(key).map(|(_, statement)| &statement.record)
    }

    /// Returns the undisputed records of an artifact, with their signers.
    pub fn records_of(&self, artifact: &ArtifactId) -> impl Iterator<Item = (PublicKey, &Record)> {
        let keys = self.by_artifact.get(artifact).into_iter().flatten();
        let statements = keys.filter_map(|key| self.statements.get(key));
        statements.map(|(signer, statement)| (*signer, &statement.record))
    }

    /// Returns whether trusted signers recorded different results of an action.
    pub fn is_disputed(&self, key: &ActionKey) -> bool {
        self.disputed.contains_key(key)
    }

    /// Returns whether a signer has recorded this result of an action.
    pub fn has_signed(&self, signer: &PublicKey, key: &ActionKey, artifact: &ArtifactId) -> bool {
        self.signed.contains(&(*signer, *key, *artifact))
    }

    /// Returns size and chunks of an artifact of the remote.
    pub fn artifact(&self, artifact: &ArtifactId) -> Option<&UpstreamArtifact> {
        self.artifacts.get(artifact)
    }

    /// Returns the artifacts that undisputed records name, those without chunks first.
    pub fn artifacts(&self) -> Vec<ArtifactId> {
        let all: BTreeSet<ArtifactId> = self.records().map(|record| record.artifact).collect();
        let is_plain = |artifact: &ArtifactId| {
            let parts = self.artifact(artifact).and_then(|artifact| artifact.parts.as_ref());
            parts.is_some_and(Vec::is_empty)
        };
        let (mut plain, mut manifests): (Vec<ArtifactId>, Vec<ArtifactId>) = all.into_iter().partition(is_plain);
        plain.append(&mut manifests);
        plain
    }

    /// Returns the undisputed records.
    pub fn records(&self) -> impl Iterator<Item = &Record> {
        self.statements.values().map(|(_, statement)| &statement.record)
    }

    /// Returns the signer of the undisputed record of an action.
    pub fn signer(&self, key: &ActionKey) -> Option<PublicKey> {
        self.statements.get(key).map(|(signer, _)| *signer)
    }

    /// Returns the disputed actions, in the order of their keys.
    pub fn disagreements(&self) -> impl Iterator<Item = &Disagreement> {
        self.disputed.values()
    }
}
