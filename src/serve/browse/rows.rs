//! The rows of artifacts: filtered, sorted, counted and paged here, so that a page is sent what it shows and no more.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::artifacts::named;
use super::filter::{column, matching, number, unknown};
use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_store::Data;

/// Rows in one answer.
const MOST: usize = 1000;

/// Bins of a histogram.
const MOST_BINS: usize = 200;

/// Different texts that are counted.
const MOST_TEXTS: usize = 50;

/// Rows of an artifact: `?filter=`, `?sort=COLUMN` or `-COLUMN`, `?limit=`, `?offset=`, `?along=AXIS`; `?histogram=COLUMN` with `?bins=`
/// counts those that match.
///
/// # Errors
/// When the artifact has no rows, or the query is not understood.
pub fn rows(state: &ServedState, request: &Request, digits: &str) -> Result<Answer, Refusal> {
    request.allow(&["filter", "sort", "limit", "offset", "along", "histogram", "bins"])?;
    let (limit, offset) = (
        request.number("limit", 50, MOST)?,
        request.number("offset", 0, usize::MAX)?,
    );
    let bins = request.number("bins", 40, MOST_BINS)?.max(1);
    let (store, artifact) = named(state, digits)?;
    let table = state
        .tables
        .of(&store, &artifact, request.word("along").filter(|axis| !axis.is_empty()))?;
    let mut matched = matching(&table.columns, table.len(), request.word("filter").unwrap_or_default())?;
    let unknown: Vec<Value> = unknown(&table.columns, request.word("filter").unwrap_or_default())?
        .into_iter()
        .map(|unknown| json!({ "column": unknown.column, "value": unknown.value, "known": unknown.known }))
        .collect();
    if let Some(order) = request.word("sort").filter(|order| !order.is_empty()) {
        let name = order.strip_prefix('-').unwrap_or(order);
        sort(&column(&table.columns, name)?.values, &mut matched);
        if order.starts_with('-') {
            matched.reverse();
        }
    }
    let shown = matched.iter().skip(offset).take(limit);
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
    let histogram = request.word("histogram").filter(|name| !name.is_empty());
    let histogram =
        histogram.map(|name| Ok::<_, Refusal>(counted(&column(&table.columns, name)?.values, &matched, bins)));
    Ok(json!({
        "axis": table.axis,
        "total": table.len(),
        "matched": matched.len(),
        "unknown": unknown,
        "columns": columns.collect::<Vec<_>>(),
        "numbers": shown.clone().collect::<Vec<_>>(),
        "rows": shown.map(row).collect::<Vec<_>>(),
        "left_out": table.left_out,
        "histogram": histogram.transpose()?,
    })
    .into())
}

/// A value as JSON has it; what is no number is null.
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

/// Rows of equal value stay in their order.
fn sort(data: &Data, rows: &mut [usize]) {
    match data {
        Data::Text(texts) => rows.sort_by(|&a, &b| texts[a].cmp(&texts[b])),
        numbers => rows.sort_by(|&a, &b| number(numbers, a).total_cmp(&number(numbers, b))),
    }
}

/// Of numbers a histogram, of texts how often each comes, the most frequent first.
fn counted(data: &Data, rows: &[usize], bins: usize) -> Value {
    if let Data::Text(texts) = data {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        rows.iter()
            .for_each(|&row| *counts.entry(&texts[row]).or_default() += 1);
        let mut counts: Vec<(&str, usize)> = counts.into_iter().collect();
        counts.sort_by_key(|(_, count)| usize::MAX - count);
        counts.truncate(MOST_TEXTS);
        return json!({ "texts": counts });
    }
    let finite: Vec<f64> = rows
        .iter()
        .map(|&row| number(data, row))
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
        let found = counted(&data, &[0, 1, 2, 3, 4], 4);
        assert_eq!(
            found,
            json!({ "edges": [0.0, 1.0, 2.0, 3.0, 4.0], "counts": [1, 1, 1, 1] })
        );
        assert_eq!(counted(&data, &[1, 1], 2)["counts"], json!([2, 0]));
        assert_eq!(counted(&data, &[4], 2), json!({ "edges": [], "counts": [] }));
        let texts = Data::Text(["b", "a", "b"].map(str::to_owned).into());
        assert_eq!(counted(&texts, &[0, 1, 2], 4), json!({ "texts": [["b", 2], ["a", 1]] }));
    }

    #[test]
    fn rows_are_sorted_by_value_with_what_is_no_number_last() {
        let mut rows = [0, 1, 2, 3];
        sort(&Data::F64(vec![2.0, f64::NAN, 1.0, 2.0]), &mut rows);
        assert_eq!(rows, [2, 0, 3, 1]);
    }
}
