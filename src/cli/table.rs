//! Tables and the way numbers are written for people.

pub use crate::report::{bytes, seconds};
use comfy_table::{CellAlignment, Table, TableComponent, presets::UTF8_HORIZONTAL_ONLY};

use crate::orchestrator::{Estimate, Outcome, Price, StageReport};

/// An empty table with a header; the columns named in `numbers` are flush right.
pub fn table(header: &[&str], numbers: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_preset(UTF8_HORIZONTAL_ONLY).set_header(header);
    // Between rows a line is one too many.
    table
        .remove_style(TableComponent::HorizontalLines)
        .remove_style(TableComponent::MiddleIntersections);
    for (column, title) in table.column_iter_mut().zip(header) {
        if numbers.contains(title) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// The stages of a finished run; what was built with what was foretold beside it, where anything was.
pub fn of_run(stages: &[StageReport]) -> String {
    let mut header = vec![
        "stage", "kind", "outcome", "chunks", "time", "foretold", "digest", "size",
    ];
    let foretold = stages.iter().any(|stage| stage.price.is_some());
    if !foretold {
        header.retain(|title| *title != "foretold");
    }
    let mut table = table(&header, &["time", "foretold", "size"]);
    for stage in stages {
        let mut row = vec![
            stage.name.clone(),
            stage.kind.clone(),
            outcome(stage.outcome).to_owned(),
            chunks(stage, "built", "reused"),
            seconds(stage.seconds),
        ];
        if foretold {
            row.push(stage.price.map_or_else(String::new, |price| time(&price.seconds)));
        }
        row.push(stage.digest.map_or_else(|| "-".to_owned(), |digest| digest.short()));
        row.push(match stage.size {
            0 => "-".to_owned(),
            size => bytes(size),
        });
        table.add_row(row);
    }
    table.trim_fmt()
}

/// The stages of a plan.
pub fn of_plan(stages: &[StageReport]) -> String {
    let header = ["stage", "kind", "outcome", "chunks", "time", "disk", "why"];
    let mut table = table(&header, &["time", "disk"]);
    for stage in stages {
        let (time, disk) = match (&stage.price, stage.outcome) {
            (Some(price), _) => (time(&price.seconds), bytes(price.bytes.likely as u64)),
            (None, Outcome::Stale) => ("?".to_owned(), "?".to_owned()),
            (None, _) => (String::new(), String::new()),
        };
        table.add_row([
            stage.name.clone(),
            stage.kind.clone(),
            outcome(stage.outcome).to_owned(),
            chunks(stage, "to build", "there"),
            time,
            disk,
            stage.reasons.join("\n"),
        ]);
    }
    table.trim_fmt()
}

/// A number with as many digits as people compare: whole ones in full, others with five.
pub fn number(value: f64) -> String {
    let whole = value.fract() == 0.0 && value.abs() < 1e15;
    let decimals = match value.abs() {
        _ if whole => 0,
        size if size >= 1e-4 => (4.0 - size.log10().floor()).clamp(0.0, 8.0) as usize,
        _ => return format!("{value:.4e}"),
    };
    format!("{value:.decimals$}")
}

/// A foretold duration with its range.
pub fn time(estimate: &Estimate) -> String {
    format!(
        "{} ({} to {})",
        seconds(estimate.likely),
        seconds(estimate.low),
        seconds(estimate.high)
    )
}

/// What stale stages will take together, and how many of them nothing is known of.
pub fn price(price: Option<&Price>, unpriced: usize) -> String {
    let known = price.map(|price| {
        let disk = bytes(price.bytes.likely as u64);
        format!("about {}, {disk}", time(&price.seconds))
    });
    match (known, unpriced) {
        (Some(known), 0) => known,
        (Some(known), n) => format!("{known}, and {n} of which no cost is recorded"),
        (None, _) => "no costs of such stages are recorded".to_owned(),
    }
}

/// The word for an outcome, as in JSON.
pub fn outcome(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Built => "built",
        Outcome::Reused => "reused",
        Outcome::Failed => "failed",
        Outcome::Skipped => "skipped",
        Outcome::Stale => "stale",
    }
}

fn chunks(stage: &StageReport, built: &str, reused: &str) -> String {
    match (stage.chunks_built, stage.chunks_reused) {
        (0, 0) => "-".into(),
        (n, 0) => format!("{n} {built}"),
        (0, n) => format!("{n} {reused}"),
        (n, m) => format!("{n} {built}, {m} {reused}"),
    }
}
