//! Labelled patterns for judging a model: solved or imported samples, or the test rows of a balanced set, a batch at a time, since the
//! fields of all together may be larger than memory.

use deaflow_base::Progress;
use deaflow_content::{Labelled, SOLVED, files};
use deaflow_dataset::Split;
use deaflow_field::{Field, Outcome};
use deaflow_orchestrator::StageError;
use deaflow_pattern::Pattern;
use deaflow_store::Artifact;
use deaflow_surrogate::Surrogate;

/// Patterns at a time on each thread, as many as a network takes at once.
const BATCH: usize = 64;

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
    is_balanced(artifact) || SOLVED.contains(&artifact.kind())
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
    Err(StageError::input(format!(
        "the samples {} are those that a model was trained on; draw others, with another seed",
        artifact.digest().short()
    )))
}

/// Calls a function with all labelled patterns that no model was trained on, in order; how many there were. `progress` is told which
/// part is done.
///
/// # Errors
/// When arrays are missing, differ in length or hold what they must not, or the function fails.
pub fn for_each(
    artifact: &Artifact,
    progress: &dyn Progress,
    each: &mut dyn FnMut(Batch) -> Result<(), StageError>,
) -> Result<usize, StageError> {
    let chunks = files(artifact)?;
    let one = |(done, chunk): (usize, &Artifact)| {
        let part = |of_chunk: f64| progress.part((done as f64 + of_chunk) / chunks.len() as f64);
        of_chunk(chunk, &part, each)
    };
    chunks.iter().enumerate().map(one).sum()
}

fn of_chunk(
    chunk: &Artifact,
    part: &dyn Fn(f64),
    each: &mut dyn FnMut(Batch) -> Result<(), StageError>,
) -> Result<usize, StageError> {
    let wrong = |why: &str| StageError::in_artifact(chunk, why);
    let labelled = Labelled::open(chunk)?.ok_or_else(|| wrong("it holds no labelled patterns"))?;
    let (patterns, families) = (labelled.patterns()?, labelled.families()?.unwrap_or_default());
    let rows = match &labelled {
        Labelled::Balanced(view) => {
            let splits = view.split().read()?.into_iter().enumerate();
            let test = splits.filter(|(_, split)| split == Split::Test.name());
            test.map(|(row, _)| row).collect()
        }
        Labelled::Solved(view) => {
            let estimated = Outcome::Estimated.name();
            if view.outcome().read()?.iter().any(|outcome| outcome == estimated) {
                return Err(wrong("its fields are estimates, and no model can be judged by them"));
            }
            (0..patterns.len()).collect()
        }
        Labelled::Verified(_) => Vec::new(),
    };
    let values = labelled.displacement(0..patterns.len())?;
    let batch = BATCH * rayon::current_num_threads();
    let batches = rows.len().div_ceil(batch);
    for (done, rows) in rows.chunks(batch).enumerate() {
        part(done as f64 / batches as f64);
        let field = |&row: &usize| {
            let raster = patterns[row].raster();
            let count = 2 * raster.corners();
            Field::from_values(raster, values[row * count..][..count].to_vec())
        };
        each(Batch {
            patterns: rows.iter().map(|&row| patterns[row].clone()).collect(),
            fields: rows
                .iter()
                .map(field)
                .collect::<Result<_, _>>()
                .map_err(|e| wrong(&e.to_string()))?,
            families: rows.iter().map(|&row| families[row].clone()).collect(),
        })?;
    }
    Ok(rows.len())
}
