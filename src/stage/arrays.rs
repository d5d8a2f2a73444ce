//! Patterns, fields and texts as datasets, and back: the vocabulary that the artifacts of all stages share.

use std::path::Path;

use crate::base::InputError;
use crate::field::{CORNERS, Field};
use crate::orchestrator::StageError;
use crate::pattern::{self, CELLS, Pattern, split_h5};
use crate::store::{Artifact, Data, Dataset};

/// Patterns as a (n, 50, 50) dataset.
pub fn patterns(description: &str, patterns: &[Pattern]) -> Dataset {
    let cells = patterns.iter().flat_map(|p| p.cells().iter().copied()).collect();
    Dataset::new("1", description, &[patterns.len(), CELLS, CELLS], Data::U8(cells))
}

/// Fields as a (n, 51, 51, 2) dataset in mm.
pub fn fields<'a>(description: &str, fields: impl ExactSizeIterator<Item = &'a Field>) -> Dataset {
    let count = fields.len();
    let values = fields.flat_map(|f| f.values().iter().copied()).collect();
    Dataset::new("mm", description, &[count, CORNERS, CORNERS, 2], Data::F64(values))
}

/// Texts as a (n) dataset.
pub fn texts<'a>(description: &str, texts: impl IntoIterator<Item = &'a str>) -> Dataset {
    let texts: Vec<String> = texts.into_iter().map(str::to_owned).collect();
    Dataset::new("", description, &[texts.len()], Data::Text(texts))
}

/// Real numbers as a (n) dataset.
pub fn reals(units: &str, description: &str, values: Vec<f64>) -> Dataset {
    Dataset::new(units, description, &[values.len()], Data::F64(values))
}

/// Whole numbers as a (n) dataset.
pub fn wholes(units: &str, description: &str, values: Vec<u64>) -> Dataset {
    Dataset::new(units, description, &[values.len()], Data::U64(values))
}

/// Reads a (n, 50, 50) or (50, 50) dataset of patterns.
///
/// # Errors
/// When it is missing, has another shape, or holds something other than 0 and 1.
pub fn read_patterns(artifact: &Artifact, path: &str) -> Result<Vec<Pattern>, StageError> {
    let (shape, cells) = artifact.u8s(path)?;
    if shape.last_chunk() != Some(&[CELLS, CELLS]) {
        return Err(shape_error(artifact, path, &shape, "(n, 50, 50)"));
    }
    let read = |cells| Pattern::from_cells(cells).map_err(|e| content_error(artifact, path, e));
    cells.chunks_exact(CELLS * CELLS).map(read).collect()
}

/// Reads the patterns that an argument names: a file of patterns, or a dataset of an artifact, of a manifest too. Artifacts are
/// read by their seals and not by what HDF5 shows of them: a manifest shows zeros where its chunks are missing.
///
/// # Errors
/// When the file cannot be read, is damaged, or holds no patterns there.
pub fn named_patterns(argument: &str) -> Result<Vec<Pattern>, InputError> {
    let named = split_h5(argument).map(|(file, dataset)| (Path::new(file), dataset));
    let Some((path, dataset)) = named.filter(|(path, _)| Artifact::is_at(path)) else {
        return pattern::read_patterns(argument);
    };
    let refused = |why: String| InputError::new(format!("{argument}: {why}"));
    let artifact = Artifact::open(path).map_err(|e| refused(e.to_string()))?;
    read_patterns(&artifact, dataset.trim_start_matches('/')).map_err(|e| refused(e.to_string()))
}

/// Reads a (n, 51, 51, 2) or (51, 51, 2) dataset of fields in mm.
///
/// # Errors
/// When it is missing, has another shape, or holds something that is not a number.
pub fn read_fields(artifact: &Artifact, path: &str) -> Result<Vec<Field>, StageError> {
    let (shape, values) = artifact.f64s(path)?;
    if shape.last_chunk() != Some(&[CORNERS, CORNERS, 2]) {
        return Err(shape_error(artifact, path, &shape, "(n, 51, 51, 2)"));
    }
    let read = |v: &[f64]| Field::from_values(v.to_vec()).map_err(|e| content_error(artifact, path, e));
    values.chunks_exact(CORNERS * CORNERS * 2).map(read).collect()
}

fn shape_error(artifact: &Artifact, path: &str, found: &[usize], wanted: &str) -> StageError {
    StageError::Input(format!(
        "artifact {}: `{path}` has shape {found:?}, wanted {wanted}",
        artifact.digest().short()
    ))
}

fn content_error(artifact: &Artifact, path: &str, error: impl std::fmt::Display) -> StageError {
    StageError::Input(format!("artifact {}: `{path}`: {error}", artifact.digest().short()))
}
