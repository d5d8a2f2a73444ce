//! Rows of arrays that are too wide for a table: patterns and fields, for drawings.

use serde_json::json;

use super::artifacts::find_artifact;
use crate::artifact_data::elements;
use crate::http::{ApiError, Array, Request, Response, frame};
use crate::state::ServerState;
use deaflow_store::{Artifact, Data};

/// Rows in one response.
const MAX_ROWS: usize = 200;

/// Arrays in one response.
const MAX_ARRAYS: usize = 4;

/// Elements of a row: the field of the largest raster.
const MAX_ROW_ELEMENTS: usize = 2 * 401 * 401;

/// Elements in one response.
const MAX_ELEMENTS: usize = 8 << 20;

/// Returns rows of arrays as a frame: `?paths=patterns,displacement&rows=3,5,7`.
///
/// # Errors
/// If an array or a row does not exist, or an array holds texts.
pub fn arrays(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&["paths", "rows"])?;
    let list = |name: &str| -> Vec<&str> {
        let words = request.parameter(name).unwrap_or_default().split(',');
        words.filter(|word| !word.is_empty()).collect()
    };
    let (rows, paths) = (list("rows"), list("paths"));
    let rows: Option<Vec<usize>> = rows.into_iter().map(|row| row.trim().parse().ok()).collect();
    let rows = rows.ok_or_else(|| ApiError::bad_request("`rows` must be integers separated by commas"))?;
    if rows.len() > MAX_ROWS || paths.len() > MAX_ARRAYS {
        let message = format!("too many: {} rows of {} arrays", rows.len(), paths.len());
        let help = format!("allowed: {MAX_ROWS} rows of {MAX_ARRAYS} arrays");
        return Err(ApiError::bad_request(message).help(help));
    }
    let (_, artifact) = find_artifact(state, digest)?;
    let mut found = Vec::with_capacity(paths.len());
    for path in paths {
        found.push((path.to_owned(), read_rows(&artifact, path, &rows)?));
    }
    Ok(Response::frame(frame(json!({ "rows": rows }), &found)))
}

fn read_rows(artifact: &Artifact, path: &str, rows: &[usize]) -> Result<Array, ApiError> {
    let content = artifact.content(path)?;
    let Some((&count, rest)) = content.shape.split_first() else {
        return Err(ApiError::bad_request(format!("{path} has no rows")));
    };
    let width = rest.iter().product::<usize>().max(1);
    if width > MAX_ROW_ELEMENTS || width * rows.len() > MAX_ELEMENTS {
        return Err(
            ApiError::bad_request(format!("{path} has {width} elements in each row")).help("ask for fewer rows"),
        );
    }
    if let Some(row) = rows.iter().find(|row| **row >= count) {
        let help = format!("allowed: rows 0 to {}", count.saturating_sub(1));
        return Err(ApiError::not_found(format!("{path} has no row {row}")).help(help));
    }
    let shape: Vec<usize> = std::iter::once(rows.len()).chain(rest.iter().copied()).collect();
    let (mut bytes, mut numbers) = (Vec::new(), Vec::new());
    for &row in rows {
        match elements(artifact, path, row..row + 1)? {
            Data::U8(v) => bytes.extend(v),
            Data::U32(v) => numbers.extend(v.into_iter().map(|v| v as f32)),
            Data::U64(v) => numbers.extend(v.into_iter().map(|v| v as f32)),
            Data::F32(v) => numbers.extend(v),
            Data::F64(v) => numbers.extend(v.into_iter().map(|v| v as f32)),
            Data::Text(_) => {
                return Err(ApiError::bad_request(format!("{path} holds texts")).help("use .../rows for texts"));
            }
        }
    }
    Ok(match numbers.is_empty() {
        true => Array::Bytes(shape, bytes),
        false => Array::Numbers(shape, numbers),
    })
}
