//! How far samples move, family by family, and how the dataset was levelled.

use super::chart::{Chart, Mark, Series};
use super::words::counted;
use crate::report::audit::audits;
use crate::report::figures::{Axis, FamilyDeformation, Histogram};
use crate::report::gather::{Made, ReportError, Source, counts_by_bin, each, families};
use crate::report::html::Page;
use crate::store::Store;

/// Bins of a family's histogram, and the range in mm unless something moves farther: that of the source paper.
const BINS: usize = 50;
const RANGE: f64 = 2.5;

/// Colours of families, in their order.
const COLOURS: [&str; 7] = ["blue", "orange", "green", "vermillion", "purple", "sky", "grey"];

/// Adds a section where there is a dataset.
pub fn section(page: &mut Page, store: &Store, made: &[Made]) -> Result<(), ReportError> {
    let solved = each(store, made, "solve", |source| Ok((name(source), families(source)?)))?;
    let balanced = each(store, made, "balance", |source| {
        Ok((name(source), counts_by_bin(source)?))
    })?;
    let audits = audits(store, made)?;
    if solved.iter().all(|(_, families)| families.is_empty()) && balanced.is_empty() && audits.is_empty() {
        return Ok(());
    }
    page.section("Dataset");
    page.lines(&["How far the membrane moves in each sample: the largest displacement of the pattern.".to_owned()]);
    let audits: Vec<String> = audits.iter().map(|line| format!("Audit {line}.")).collect();
    page.lines(&audits);
    for (name, data) in &balanced {
        page.part(&format!("{name}: balance"));
        page.markup(&format!(
            "<div class=\"charts\">\n{}{}</div>\n",
            before(data),
            after(data)
        ));
        let empty = data.after.iter().filter(|count| **count == 0).count();
        page.note(&format!(
            "{empty} of {} bins are empty: no sample moves so far.",
            data.after.len()
        ));
    }
    let solved: Vec<String> = solved
        .iter()
        .filter(|(_, f)| !f.is_empty())
        .map(|(name, f)| by_family(name, f))
        .collect();
    if !solved.is_empty() {
        page.part("Samples by family");
        page.markup(&format!("<div class=\"charts\">\n{}</div>\n", solved.concat()));
    }
    Ok(())
}

fn name(source: &Source<'_>) -> String {
    source.stage.stage.clone()
}

fn total(counts: &[u64]) -> u64 {
    counts.iter().sum()
}

fn bars(counts: &[u64], edges: &[f64]) -> Vec<(f64, f64)> {
    let bins = counts.iter().zip(edges.windows(2)).filter(|(count, _)| **count > 0);
    bins.flat_map(|(count, edge)| [(edge[0], 0.0), (edge[1], *count as f64)])
        .collect()
}

/// The outline of a histogram, from zero to zero.
fn outline(counts: &[u64], edges: &[f64]) -> Vec<(f64, f64)> {
    let tops = counts.iter().zip(edges.windows(2));
    let tops = tops.flat_map(|(count, edge)| [(edge[0], *count as f64), (edge[1], *count as f64)]);
    tops.collect()
}

fn axes(data: &Histogram, counts: &[&[u64]]) -> [Axis; 2] {
    let most = counts.iter().copied().flatten().max().copied().unwrap_or(0);
    let (first, last) = (data.edges.first().copied(), data.edges.last().copied());
    [
        Axis::linear("Largest displacement [mm]", first.unwrap_or(0.0), last.unwrap_or(1.0)),
        Axis::counting("Samples per bin", 0.0, (1.08 * most as f64).max(1.0)),
    ]
}

fn before(data: &Histogram) -> String {
    let [x, y] = axes(data, &[&data.before, &data.augmented]);
    let chart = Chart {
        title: "Before",
        note: &format!("{} samples as solved", total(&data.before)),
        x,
        y,
        series: vec![
            Series::new("as solved", "sky", Mark::Bars, bars(&data.before, &data.edges)),
            Series::new(
                "with rotated and mirrored images",
                "vermillion",
                Mark::Line,
                outline(&data.augmented, &data.edges),
            ),
        ],
    };
    chart.figure()
}

fn after(data: &Histogram) -> String {
    let [x, y] = axes(data, &[&data.after]);
    let (all, drawn) = (total(&data.after), total(&data.levelled));
    let chart = Chart {
        title: "After",
        note: &format!("{all} samples, {} of them images", all.saturating_sub(drawn)),
        x,
        y,
        series: vec![
            Series::new("images", "orange", Mark::Bars, bars(&data.after, &data.edges)),
            Series::new("as drawn", "blue", Mark::Bars, bars(&data.levelled, &data.edges)),
        ],
    };
    chart.figure()
}

/// The samples of a solve stage, an outline for each family.
fn by_family(stage: &str, families: &[FamilyDeformation]) -> String {
    let peaks = families.iter().flat_map(|family| &family.peaks);
    let farthest = peaks.clone().fold(0.0, |a: f64, b| a.max(*b));
    let top = RANGE.max((2.0 * farthest).ceil() / 2.0);
    let edges: Vec<f64> = (0..=BINS).map(|k| top * k as f64 / BINS as f64).collect();
    let mut most = 0;
    let mut series = Vec::new();
    for (family, colour) in families.iter().zip(COLOURS.iter().cycle()) {
        let mut counts = vec![0_u64; BINS];
        for peak in &family.peaks {
            counts[((peak / top * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        most = counts.iter().fold(most, |a, b| a.max(*b));
        let mean = family.peaks.iter().sum::<f64>() / family.peaks.len().max(1) as f64;
        let name = format!("{}, mean {mean:.2} mm", family.family);
        series.push(Series::new(&name, colour, Mark::Line, outline(&counts, &edges)));
    }
    let chart = Chart {
        title: stage,
        note: &counted(peaks.count(), "sample", "samples"),
        x: Axis::linear("Largest displacement [mm]", 0.0, top),
        y: Axis::counting("Samples per bin", 0.0, (1.08 * most as f64).max(1.0)),
        series,
    };
    chart.figure()
}
