//! Columns of the table of an evaluation: the errors of each predictor, and the set that each pattern is from.

use crate::artifact_data::inputs_of;
use crate::http::ApiError;
use deaflow_content::{ArtifactKind, SOLVED};
use deaflow_dataset::Split;
use deaflow_report::{RowColumn, Rows, pick};
use deaflow_store::{Artifact, Content, Data, Store, StoreError};

/// Predictors that get columns.
const MAX_PREDICTORS: usize = 16;

/// Returns a column for each predictor of each array `[predictor][row]`: `pattern/rms.0_mm` is that of the first
/// predictor.
///
/// # Errors
/// If an array cannot be read.
pub fn by_predictor(artifact: &Artifact, rows: &Rows) -> Result<Vec<RowColumn>, ApiError> {
    let contents = artifact.contents()?;
    let has_predictors = |content: &&Content| {
        matches!(content.axes.as_slice(), [first, second] if *first != rows.axis && *second == rows.axis)
            && content.shape[1] == rows.len()
            && content.shape[0] <= MAX_PREDICTORS
    };
    let mut found = Vec::new();
    for content in contents.iter().filter(has_predictors) {
        // A text array with the name of the first axis holds the names of the predictors.
        let has_names = contents
            .iter()
            .any(|other| other.path == content.axes[0] && other.shape == content.shape[..1]);
        let names = match has_names {
            true => match artifact.read(&content.axes[0])?.data {
                Data::Text(names) => names,
                _ => Vec::new(),
            },
            false => Vec::new(),
        };
        let elements = artifact.read(&content.path)?.data;
        let unit = match content.units.as_str() {
            "" | "1" => String::new(),
            unit => format!("_{unit}"),
        };
        for at in 0..content.shape[0] {
            let of = names.get(at).map_or_else(String::new, |name| format!(" Of {name}."));
            found.push(RowColumn {
                name: format!("{}.{at}{unit}", content.path),
                description: format!("{}{of}", content.description),
                values: pick(&elements, at * rows.len()..(at + 1) * rows.len()),
            });
        }
    }
    Ok(found)
}

/// Returns the set of each pattern of an evaluation and its row in that set; no columns if they are not known.
///
/// # Errors
/// If a set is damaged.
pub fn source_rows(store: &Store, artifact: &Artifact, rows: &Rows) -> Result<Vec<RowColumn>, ApiError> {
    let families = rows.columns.iter().find(|column| column.name == "pattern/family");
    let Some(families) = families.filter(|_| ArtifactKind::Evaluate.is_of(artifact)) else {
        return Ok(Vec::new());
    };
    let (mut sets, mut set_rows, mut known) = (Vec::new(), Vec::new(), Vec::new());
    for digest in inputs_of(artifact)? {
        let input = match store.artifact(&digest) {
            Ok(input) => input,
            Err(StoreError::Missing { .. }) => return Ok(Vec::new()),
            Err(error) => return Err(error.into()),
        };
        let is_balanced = ArtifactKind::Balance.is_of(&input);
        if !is_balanced && !SOLVED.contains(&input.kind()) {
            continue;
        }
        let own = texts(&input, "family")?;
        let splits = if is_balanced {
            texts(&input, "split")?
        } else {
            Vec::new()
        };
        // An evaluation uses only the test rows of a balanced set.
        let used = own
            .into_iter()
            .enumerate()
            .filter(|(row, _)| !is_balanced || splits.get(*row).is_some_and(|split| split == Split::Test.name()));
        for (row, family) in used {
            sets.push(digest.short().to_string());
            set_rows.push(row as u64);
            known.push(family);
        }
    }
    // The rows are in the order of the sets: equal families confirm that these are the sets.
    if Data::Text(known) != families.values {
        return Ok(Vec::new());
    }
    let column = |name: &str, description: &str, values| RowColumn {
        name: name.to_owned(),
        description: description.to_owned(),
        values,
    };
    Ok(vec![
        column("set", "The set that the pattern is from.", Data::Text(sets)),
        column("set_row", "Its row in that set.", Data::U64(set_rows)),
    ])
}

fn texts(artifact: &Artifact, path: &str) -> Result<Vec<String>, ApiError> {
    match artifact.read(path)?.data {
        Data::Text(texts) => Ok(texts),
        _ => Ok(Vec::new()),
    }
}
