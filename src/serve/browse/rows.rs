//! The rows of artifacts: filtered, sorted, counted and paged by the server.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::artifacts::find_artifact;
use super::filter::{column, matching, number_at, unknown_texts};
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_store::Data;

/// Rows in one response.
const MAX_ROWS: usize = 1000;

/// Bins of a histogram.
const MAX_BINS: usize = 200;

/// Different texts that are counted.
const MAX_TEXTS: usize = 50;

/// Returns rows of an artifact: `?filter=`, `?sort=COLUMN` or `-COLUMN`, `?limit=`, `?offset=`, `?along=AXIS`;
/// `?histogram=COLUMN` with `?bins=` counts the matching ones.
///
/// # Errors
/// If the artifact has no rows, or the query is invalid.
pub fn rows(state: &ServerState, request: &Request, digest: &str) -> Result<Response, ApiError> {
    request.allow(&["filter", "sort", "limit", "offset", "along", "histogram", "bins"])?;
    let (limit, offset) = (
        request.integer("limit", 50, MAX_ROWS)?,
        request.integer("offset", 0, usize::MAX)?,
    );
    let bins = request.integer("bins", 40, MAX_BINS)?.max(1);
    let (store, artifact) = find_artifact(state, digest)?;
    let table = state.tables.table(&store, &artifact, request.nonempty("along"))?;
    let filter = request.parameter("filter").unwrap_or_default();
    let mut matched = matching(&table.columns, table.len(), filter)?;
    let unknown: Vec<Value> = unknown_texts(&table.columns, filter)?
        .into_iter()
        .map(|unknown| json!({ "column": unknown.column, "value": unknown.value, "known": unknown.known }))
        .collect();
    if let Some(order) = request.nonempty("sort") {
        let name = order.strip_prefix('-').unwrap_or(order);
        sort(&column(&table.columns, name)?.values, &mut matched);
        if order.starts_with('-') {
            matched.reverse();
        }
    }
    let page = matched.iter().skip(offset).take(limit);
    let row = |&row: &usize| {
        table
            .columns
            .iter()
            .map(|column| value(&column.values, row))
            .collect::<Value>()
    };
    let columns = table.columns.iter().map(|column| {
        json!({
            "name": column.name,
            "is_text": matches!(column.values, Data::Text(_)),
            "description": column.description,
        })
    });
    let histogram = request
        .nonempty("histogram")
        .map(|name| column(&table.columns, name))
        .transpose()?;
    Ok(json!({
        "axis": table.axis,
        "total": table.len(),
        "matched": matched.len(),
        "unknown": unknown,
        "columns": columns.collect::<Vec<_>>(),
        "numbers": page.clone().collect::<Vec<_>>(),
        "rows": page.map(row).collect::<Vec<_>>(),
        "left_out": table.left_out,
        "histogram": histogram.map(|column| counts(&column.values, &matched, bins)),
    })
    .into())
}

/// Returns a value for JSON; NaN is null.
fn value(data: &Data, row: usize) -> Value {
    match data {
        Data::U8(v) => json!(v[row]),
        Data::U32(v) => json!(v[row]),
        Data::U64(v) => json!(v[row]),
        Data::F32(v) => json!(v[row]),
        Data::F64(v) => json!(v[row]),
        Data::Text(v) => json!(v[row]),
    }
}

/// Sorts rows by value; rows of equal value stay in their order.
fn sort(data: &Data, rows: &mut [usize]) {
    match data {
        Data::Text(texts) => rows.sort_by(|&a, &b| texts[a].cmp(&texts[b])),
        numbers => rows.sort_by(|&a, &b| number_at(numbers, a).total_cmp(&number_at(numbers, b))),
    }
}

/// Returns the histogram of numbers, or the frequency of each text, the most frequent first.
fn counts(data: &Data, rows: &[usize], bins: usize) -> Value {
    if let Data::Text(texts) = data {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        rows.iter()
            .for_each(|&row| *counts.entry(&texts[row]).or_default() += 1);
        let mut counts: Vec<(&str, usize)> = counts.into_iter().collect();
        counts.sort_by_key(|(_, count)| usize::MAX - count);
        counts.truncate(MAX_TEXTS);
        return json!({ "texts": counts });
    }
    let finite: Vec<f64> = rows
        .iter()
        .map(|&row| number_at(data, row))
        .filter(|value| value.is_finite())
        .collect();
    let (low, high) = finite
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &value| {
            (low.min(value), high.max(value))
        });
    if finite.is_empty() {
        return json!({ "edges": [], "counts": [] });
    }
    let width = if high > low { (high - low) / bins as f64 } else { 1.0 };
    let mut counts = vec![0_usize; bins];
    for value in &finite {
        counts[(((value - low) / width) as usize).min(bins - 1)] += 1;
    }
    let edges: Vec<f64> = (0..=bins).map(|at| low + width * at as f64).collect();
    json!({ "edges": edges, "counts": counts })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_in_a_bin_and_every_text_is_counted() {
        let data = Data::F64(vec![0.0, 1.0, 2.0, 4.0, f64::NAN]);
        let found = counts(&data, &[0, 1, 2, 3, 4], 4);
        assert_eq!(
            found,
            json!({ "edges": [0.0, 1.0, 2.0, 3.0, 4.0], "counts": [1, 1, 1, 1] })
        );
        assert_eq!(counts(&data, &[1, 1], 2)["counts"], json!([2, 0]));
        assert_eq!(counts(&data, &[4], 2), json!({ "edges": [], "counts": [] }));
        let texts = Data::Text(["b", "a", "b"].map(str::to_owned).into());
        assert_eq!(counts(&texts, &[0, 1, 2], 4), json!({ "texts": [["b", 2], ["a", 1]] }));
    }

    #[test]
    fn rows_are_sorted_by_value_with_nan_last() {
        let mut rows = [0, 1, 2, 3];
        sort(&Data::F64(vec![2.0, f64::NAN, 1.0, 2.0]), &mut rows);
        assert_eq!(rows, [2, 0, 3, 1]);
    }
}
