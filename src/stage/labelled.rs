//! Labelled patterns to judge models with: solved or imported samples, or the test rows of a balanced set. They are
//! read in batches, because the fields of all together may exceed the memory.

use super::without::Dropped;
use deaflow_content::{ArtifactKind, Labelled, files};
use deaflow_dataset::Split;
use deaflow_field::{Field, OutcomeKind};
use deaflow_orchestrator::{Job, StageError};
use deaflow_pattern::Pattern;
use deaflow_store::Artifact;
use deaflow_surrogate::Surrogate;

/// Patterns per thread and batch: as many as a network takes at once.
const BATCH: usize = 64;

/// Patterns with their simulated fields and their families.
pub struct Batch {
    /// The patterns.
    pub patterns: Vec<Pattern>,
    /// Their fields.
    pub fields: Vec<Field>,
    /// Their families.
    pub families: Vec<String>,
}

/// Calls a function with the labelled patterns of all inputs that are not dropped, in order, and reports progress: a
/// step per input.
///
/// # Errors
/// If a model was trained on one of the inputs, arrays are missing or invalid, or the function fails.
pub fn for_each_batch(
    job: &Job<'_>,
    models: &[&Surrogate],
    dropped: &Dropped,
    each: &mut dyn FnMut(Batch) -> Result<(), StageError>,
) -> Result<(), StageError> {
    for (index, input) in job.inputs.iter().enumerate() {
        let kind = ArtifactKind::of(input);
        if matches!(
            kind,
            Some(ArtifactKind::Solve | ArtifactKind::Import | ArtifactKind::Balance)
        ) {
            check_unseen(input, models)?;
            let chunks = files(input)?;
            let mut first = 0;
            for (done, chunk) in chunks.iter().enumerate() {
                let part = |of_chunk: f64| job.progress.part((done as f64 + of_chunk) / chunks.len() as f64);
                let keeps = |row: usize| !dropped.has(index, first + row);
                first += read_chunk(chunk, &keeps, &part, each)?;
            }
        }
        job.progress.advance(1);
    }
    Ok(())
}

/// Refuses samples that a model was trained on: its error on these does not predict its error on others. Of a balanced
/// set only the test rows are read, which no training uses.
fn check_unseen(artifact: &Artifact, models: &[&Surrogate]) -> Result<(), StageError> {
    let digest = artifact.digest().to_string();
    let mut records = models.iter().filter_map(|model| model.training());
    if ArtifactKind::Balance.is_of(artifact) || records.all(|record| !record.inputs.contains(&digest)) {
        return Ok(());
    }
    Err(StageError::input(format!(
        "a model was trained on the samples {}; draw others with another seed",
        artifact.digest().short()
    )))
}

/// Reads the rows of a chunk that are kept; returns the number of all its rows.
fn read_chunk(
    chunk: &Artifact,
    keeps: &dyn Fn(usize) -> bool,
    part: &dyn Fn(f64),
    each: &mut dyn FnMut(Batch) -> Result<(), StageError>,
) -> Result<usize, StageError> {
    let wrong = |why: &str| StageError::in_artifact(chunk, why);
    let labelled = Labelled::open(chunk)?.ok_or_else(|| wrong("it has no labelled patterns"))?;
    let (patterns, families) = (labelled.patterns()?, labelled.families()?.unwrap_or_default());
    let mut rows: Vec<usize> = match &labelled {
        Labelled::Balanced(view) => {
            let splits = view.split().read()?.into_iter().enumerate();
            let test = splits.filter(|(_, split)| split == Split::Test.name());
            test.map(|(row, _)| row).collect()
        }
        Labelled::Solved(view) => {
            if view.outcome().read()?.contains(&OutcomeKind::Estimated) {
                return Err(wrong("its fields are estimates, which cannot be used to judge a model"));
            }
            (0..patterns.len()).collect()
        }
        Labelled::Verified(_) => Vec::new(),
    };
    rows.retain(|row| keeps(*row));
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
        let fields: Result<_, _> = rows.iter().map(field).collect();
        each(Batch {
            patterns: rows.iter().map(|&row| patterns[row].clone()).collect(),
            fields: fields.map_err(|e| wrong(&e.to_string()))?,
            families: rows.iter().map(|&row| families[row].clone()).collect(),
        })?;
    }
    Ok(patterns.len())
}
