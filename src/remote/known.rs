//! What is known of a remote: the statements of those who are trusted, and what there is of others.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};

use super::key::PublicKey;
use super::pack::Statement;
use deaflow_base::{ActionKey, ArtifactId};
use deaflow_store::{Record, UpstreamArtifact};

/// Who says what of an action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Said {
    /// Who.
    pub signer: PublicKey,
    /// What it made.
    pub artifact: ArtifactId,
}

/// Trusted signers who say different things of one action: none of them is believed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Disagreement {
    /// The action.
    pub key: ActionKey,
    /// Its kind.
    pub kind: String,
    /// Who says what, at least two things.
    pub said: Vec<Said>,
}

/// Files of records that do not count.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Foreign {
    /// How many are of keys that are not trusted, by key.
    pub untrusted: BTreeMap<PublicKey, u64>,
    /// Those that are not what their name and its signature say, and why.
    pub rejected: Vec<(String, &'static str)>,
}

/// The statements that count.
#[derive(Default)]
pub struct Known {
    statements: HashMap<ActionKey, (PublicKey, Statement)>,
    disputed: BTreeMap<ActionKey, Disagreement>,
    by_artifact: HashMap<ArtifactId, Vec<ActionKey>>,
    promised: HashMap<ArtifactId, UpstreamArtifact>,
    said: HashSet<(PublicKey, ActionKey, ArtifactId)>,
}

impl Known {
    /// Adds what a trusted signer says.
    pub fn add(&mut self, signer: PublicKey, statement: Statement) {
        let (key, artifact) = (statement.record.key, statement.record.artifact);
        self.find_artifact(&statement);
        self.said.insert((signer, key, artifact));
        let said = |signer, artifact| Said { signer, artifact };
        if let Some(dispute) = self.disputed.get_mut(&key) {
            let said = said(signer, artifact);
            if !dispute.said.contains(&said) {
                dispute.said.push(said);
            }
            return;
        }
        match self.statements.get(&key) {
            Some((other, known)) if known.record.artifact != artifact => {
                let dispute = Disagreement {
                    key,
                    kind: known.record.action.kind.clone(),
                    said: vec![said(*other, known.record.artifact), said(signer, artifact)],
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

    /// Whoever says what made it: content is what it is.
    fn find_artifact(&mut self, statement: &Statement) {
        let unsaid = || UpstreamArtifact {
            size: 0,
            parts: Some(Vec::new()),
        };
        for part in statement.parts.iter().flatten() {
            self.promised.entry(*part).or_insert_with(unsaid);
        }
        let promise = self.promised.entry(statement.record.artifact).or_insert_with(unsaid);
        promise.size = statement.record.size;
        promise.parts.clone_from(&statement.parts);
    }

    /// What the action made, if all who speak of it say the same.
    pub fn record(&self, key: &ActionKey) -> Option<&Record> {
        self.statements.get(key).map(|(_, statement)| &statement.record)
    }

    /// The undisputed records that name an artifact.
    pub fn records_of(&self, artifact: &ArtifactId) -> impl Iterator<Item = (PublicKey, &Record)> {
        let keys = self.by_artifact.get(artifact).into_iter().flatten();
        let said = keys.filter_map(|key| self.statements.get(key));
        said.map(|(signer, statement)| (*signer, &statement.record))
    }

    /// Whether those who speak of an action say different things.
    pub fn is_disputed(&self, key: &ActionKey) -> bool {
        self.disputed.contains_key(key)
    }

    /// Whether a signer has said this of an action.
    pub fn has_said(&self, signer: &PublicKey, key: &ActionKey, artifact: &ArtifactId) -> bool {
        self.said.contains(&(*signer, *key, *artifact))
    }

    /// What the remote has of an artifact.
    pub fn promised(&self, artifact: &ArtifactId) -> Option<&UpstreamArtifact> {
        self.promised.get(artifact)
    }

    /// The artifacts that undisputed records name, those without chunks first.
    pub fn artifacts(&self) -> Vec<ArtifactId> {
        let all: BTreeSet<ArtifactId> = self.records().map(|record| record.artifact).collect();
        let is_plain = |artifact: &ArtifactId| {
            let parts = self.promised(artifact).and_then(|promise| promise.parts.as_ref());
            parts.is_some_and(Vec::is_empty)
        };
        let (mut plain, mut manifests): (Vec<ArtifactId>, Vec<ArtifactId>) = all.into_iter().partition(is_plain);
        plain.append(&mut manifests);
        plain
    }

    /// The undisputed records.
    pub fn records(&self) -> impl Iterator<Item = &Record> {
        self.statements.values().map(|(_, statement)| &statement.record)
    }

    /// Who says so of an action.
    pub fn signer(&self, key: &ActionKey) -> Option<PublicKey> {
        self.statements.get(key).map(|(signer, _)| *signer)
    }

    /// What trusted signers disagree on, in the order of keys.
    pub fn disagreements(&self) -> impl Iterator<Item = &Disagreement> {
        self.disputed.values()
    }
}
