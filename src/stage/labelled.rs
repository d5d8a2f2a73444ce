//! Labelled patterns for judging a model: solved samples, or the test rows of a balanced set, a batch at a time, since the
//! fields of all together may be larger than memory.

use super::arrays;
use crate::dataset::Split;
use crate::field::{CORNERS, Field, Outcome};
use crate::orchestrator::StageError;
use crate::pattern::Pattern;
use crate::store::Artifact;
use crate::surrogate::Surrogate;

/// Patterns at a time.
const BATCH: usize = 64;

const VALUES: usize = CORNERS * CORNERS * 2;

/// Patterns with their simulated fields and the families that they were drawn from.
pub struct Batch {
    /// The patterns.
    pub patterns: Vec<Pattern>,
    /// Their fields.
    pub fields: Vec<Field>,
    /// Their families.
    pub families: Vec<String>,
}

/// Whether an artifact has labelled patterns.
pub fn is_labelled(artifact: &Artifact) -> bool {
    is_balanced(artifact) || artifact.kind() == "solve"
}

fn is_balanced(artifact: &Artifact) -> bool {
    artifact.kind() == "balance"
}

/// Refuses samples that a model was trained on: what it says of them says nothing of others. Of balanced sets the rows are
/// looked at that were kept for tests.
///
/// # Errors
/// When the samples are solved ones among the inputs of a training.
pub fn check_unseen(artifact: &Artifact, models: &[&Surrogate]) -> Result<(), StageError> {
    let digest = artifact.digest().to_string();
    let records = models.iter().filter_map(|model| model.training());
    if records.into_iter().all(|record| !record.inputs.contains(&digest)) || is_balanced(artifact) {
        return Ok(());
    }
    Err(StageError::Input(format!(
        "the samples {} are those that a model was trained on; draw others, with another seed",
        artifact.digest().short()
    )))
}

/// Calls a function with all labelled patterns that no model was trained on, in order; how many there were.
///
/// # Errors
/// When arrays are missing, differ in length or hold what they must not, or the function fails.
pub fn for_each(
    artifact: &Artifact,
    each: &mut dyn FnMut(Batch) -> Result<(), StageError>,
) -> Result<usize, StageError> {
    let chunks = match artifact.is_manifest() {
        true => artifact.chunks()?,
        false => std::slice::from_ref(artifact),
    };
    chunks.iter().map(|chunk| of_chunk(chunk, each)).sum()
}

fn of_chunk(chunk: &Artifact, each: &mut dyn FnMut(Batch) -> Result<(), StageError>) -> Result<usize, StageError> {
    let wrong = |why: String| StageError::Input(format!("artifact {}: {why}", chunk.digest().short()));
    let patterns = arrays::read_patterns(chunk, "patterns")?;
    let families = chunk.texts("family")?.1;
    let (shape, values) = chunk.f64s("displacement")?;
    if families.len() != patterns.len() || shape != [patterns.len(), CORNERS, CORNERS, 2] {
        return Err(wrong("its arrays differ in length".to_owned()));
    }
    let rows = chosen(chunk, patterns.len())?;
    for rows in rows.chunks(BATCH) {
        let field = |&row: &usize| Field::from_values(values[row * VALUES..][..VALUES].to_vec());
        each(Batch {
            patterns: rows.iter().map(|&row| patterns[row].clone()).collect(),
            fields: rows
                .iter()
                .map(field)
                .collect::<Result<_, _>>()
                .map_err(|e| wrong(e.to_string()))?,
            families: rows.iter().map(|&row| families[row].clone()).collect(),
        })?;
    }
    Ok(rows.len())
}

/// The rows that a model is judged by: all that were solved, or those that are kept for tests.
fn chosen(chunk: &Artifact, count: usize) -> Result<Vec<usize>, StageError> {
    let wrong = |why: &str| StageError::Input(format!("artifact {}: {why}", chunk.digest().short()));
    if is_balanced(chunk) {
        let splits = chunk.texts("split")?.1;
        let test = |row: &usize| splits.get(*row).is_some_and(|split| split == Split::Test.name());
        return Ok((0..count).filter(test).collect());
    }
    let estimated = chunk.texts("outcome")?.1.iter().any(|o| o == Outcome::Estimated.name());
    if estimated {
        return Err(wrong("its fields are estimates, and no model can be judged by them"));
    }
    Ok((0..count).collect())
}
