//! Rows of arrays that are too wide for a table: patterns and fields, to be drawn.

use std::ops::Range;

use serde_json::json;

use super::artifacts::named;
use crate::http::{Answer, Array, Refusal, Request, frame};
use crate::state::ServedState;
use deaflow_store::{Artifact, Data};

/// Rows in one answer.
const MOST_ROWS: usize = 200;

/// Arrays in one answer.
const MOST_ARRAYS: usize = 4;

/// Elements of a row: a field on the most cells.
const MOST_ELEMENTS: usize = 2 * 401 * 401;

/// Elements in one answer.
const MOST_IN_ALL: usize = 8 << 20;

/// Rows of arrays as a frame: `?paths=patterns,displacement&rows=3,5,7`.
///
/// # Errors
/// When there is no such array or row, or it holds texts.
pub fn arrays(state: &ServedState, request: &Request, digits: &str) -> Result<Answer, Refusal> {
    request.allow(&["paths", "rows"])?;
    let wanted = request
        .word("rows")
        .unwrap_or_default()
        .split(',')
        .filter(|row| !row.is_empty());
    let rows: Option<Vec<usize>> = wanted.map(|row| row.trim().parse().ok()).collect();
    let rows = rows.ok_or_else(|| Refusal::bad("`rows` are whole numbers between commas"))?;
    let paths: Vec<&str> = request
        .word("paths")
        .unwrap_or_default()
        .split(',')
        .filter(|path| !path.is_empty())
        .collect();
    if rows.len() > MOST_ROWS || paths.len() > MOST_ARRAYS {
        return Err(
            Refusal::bad(format!("{} rows of {} arrays are too many", rows.len(), paths.len()))
                .help(format!("allowed: {MOST_ROWS} rows of {MOST_ARRAYS} arrays")),
        );
    }
    let (_, artifact) = named(state, digits)?;
    let mut found = Vec::with_capacity(paths.len());
    for path in paths {
        found.push((path.to_owned(), picked(&artifact, path, &rows)?));
    }
    Ok(Answer::frame(frame(json!({ "rows": rows }), &found)))
}

fn picked(artifact: &Artifact, path: &str, rows: &[usize]) -> Result<Array, Refusal> {
    let content = artifact.content(path)?;
    let Some((&count, rest)) = content.shape.split_first() else {
        return Err(Refusal::bad(format!("{path} has no rows")));
    };
    let width = rest.iter().product::<usize>().max(1);
    if width > MOST_ELEMENTS || width * rows.len() > MOST_IN_ALL {
        return Err(Refusal::bad(format!("{path} has {width} elements in each row")).help("ask for fewer rows"));
    }
    if let Some(row) = rows.iter().find(|row| **row >= count) {
        return Err(
            Refusal::absent(format!("{path} has no row {row}")).help(format!("rows 0 to {}", count.saturating_sub(1)))
        );
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
            Data::Text(_) => return Err(Refusal::bad(format!("{path} holds texts")).help("the table of rows has them")),
        }
    }
    Ok(match numbers.is_empty() {
        true => Array::Bytes(shape, bytes),
        false => Array::Numbers(shape, numbers),
    })
}

/// Rows of an array, of a manifest from the chunks that have them.
///
/// # Errors
/// When there is no such array, or it cannot be read.
pub fn elements(artifact: &Artifact, path: &str, rows: Range<usize>) -> Result<Data, Refusal> {
    let mut found: Option<Data> = None;
    let mut before = 0;
    for chunk in artifact.chunks()? {
        let own = chunk.content(path)?.shape.first().copied().unwrap_or(0);
        let some = rows.start.max(before)..rows.end.min(before + own);
        if some.start < some.end {
            let more = own_elements(chunk, path, some.start - before..some.end - before)?;
            found = Some(match found {
                None => more,
                Some(data) => {
                    joined(data, more).ok_or_else(|| Refusal::new(409, format!("the chunks differ in {path}")))?
                }
            });
        }
        before += own;
    }
    match found {
        Some(data) => Ok(data),
        None => own_elements(artifact, path, rows),
    }
}

/// Both, one after the other, where they are of one type.
fn joined(one: Data, other: Data) -> Option<Data> {
    Some(match (one, other) {
        (Data::U8(a), Data::U8(b)) => Data::U8([a, b].concat()),
        (Data::U32(a), Data::U32(b)) => Data::U32([a, b].concat()),
        (Data::U64(a), Data::U64(b)) => Data::U64([a, b].concat()),
        (Data::F32(a), Data::F32(b)) => Data::F32([a, b].concat()),
        (Data::F64(a), Data::F64(b)) => Data::F64([a, b].concat()),
        (Data::Text(a), Data::Text(b)) => Data::Text([a, b].concat()),
        _ => return None,
    })
}

fn own_elements(artifact: &Artifact, path: &str, rows: Range<usize>) -> Result<Data, Refusal> {
    // The file may have changed since the artifact was opened; a glance unless it did.
    artifact.file_digest()?;
    Ok(artifact.rows()?.elements(path, rows)?)
}
