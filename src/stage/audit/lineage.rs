//! Traces an artifact back to the sample stages and their seeds, or to files.

use std::collections::BTreeMap;

use deaflow_base::{ActionKey, ArtifactId};
use deaflow_content::ArtifactKind;
use deaflow_dataset::audit::{Finding, Severity};
use deaflow_store::{Artifact, Lookup, Store, StoreError};

/// Opens the inputs of an artifact, which its provenance names, in its store.
///
/// # Errors
/// If the artifact itself cannot be read.
pub fn inputs(artifact: &Artifact) -> Result<Vec<Result<Artifact, StoreError>>, StoreError> {
    let provenance = artifact.provenance()?;
    let names = provenance.get("inputs").map_or("", String::as_str).lines();
    // Words that are not digests are skipped.
    let inputs = names.filter_map(|name| name.parse::<ArtifactId>().ok());
    Ok(inputs.map(|digest| artifact.sibling(&digest)).collect())
}

/// The ancestors of an artifact.
#[derive(Debug, Default)]
pub struct Lineage {
    /// Number of artifacts, including chunks.
    pub artifacts: usize,
    /// Seeds by the digest of their samples.
    pub seeds: BTreeMap<ArtifactId, String>,
    /// Whether any of the data was read from files.
    pub from_files: bool,
    /// The problems found.
    pub findings: Vec<Finding>,
}

/// Traces an artifact back through the records of its store.
///
/// # Errors
/// If the store cannot be read. Missing or damaged artifacts are findings, not errors.
pub fn trace(store: &Store, artifact: &Artifact) -> Result<Lineage, StoreError> {
    let mut lineage = Lineage::default();
    let mut open = vec![artifact.digest()];
    let mut seen = std::collections::BTreeSet::new();
    while let Some(digest) = open.pop() {
        if !seen.insert(digest) {
            continue;
        }
        lineage.artifacts += 1;
        let ancestor = match store.artifact(&digest) {
            Ok(ancestor) => ancestor,
            Err(error) if error.is_damage() => {
                let message = format!("an artifact that it was made from is missing or damaged: {error}");
                lineage
                    .findings
                    .push(Finding::whole("provenance", Severity::Error, message));
                continue;
            }
            Err(error) => return Err(error),
        };
        open.extend(ancestor.parts());
        open.extend(step(store, &ancestor, &mut lineage)?);
    }
    if lineage.seeds.is_empty() && !lineage.from_files {
        let message =
            "it goes back to no seed and no file: no stage that draws or reads is among what it was made from";
        lineage
            .findings
            .push(Finding::whole("provenance", Severity::Error, message));
    }
    Ok(lineage)
}

/// Returns the inputs of one artifact according to its record.
fn step(store: &Store, artifact: &Artifact, lineage: &mut Lineage) -> Result<Vec<ArtifactId>, StoreError> {
    let provenance = artifact.provenance()?;
    let text = |name: &str| provenance.get(name).map_or("", String::as_str);
    let short = artifact.digest().short();
    let mut wrong = |why: String| {
        let message = format!("artifact {short}: {why}");
        lineage
            .findings
            .push(Finding::whole("provenance", Severity::Error, message));
    };
    let Ok(key) = text("action").parse::<ActionKey>() else {
        wrong("no action made it".to_owned());
        return Ok(Vec::new());
    };
    let Lookup::Found(record, _) = store.record(&key)? else {
        wrong("the record of the action that made it is missing or damaged".to_owned());
        return Ok(Vec::new());
    };
    if record.artifact != artifact.digest() {
        wrong(format!(
            "its record says that the action made {}",
            record.artifact.short()
        ));
    }
    let kind = ArtifactKind::of(artifact);
    lineage.from_files |= matches!(kind, Some(ArtifactKind::Patterns | ArtifactKind::Import));
    if kind == Some(ArtifactKind::Sample) {
        let leaves = record.action.parameters.leaves();
        let seed = leaves
            .iter()
            .find(|(path, _)| path == "seed" || path.ends_with(".seed"));
        match seed {
            Some((_, seed)) => {
                lineage.seeds.insert(artifact.digest(), seed.to_string());
            }
            None => wrong("samples without a seed".to_owned()),
        }
    }
    Ok(record.action.inputs)
}
