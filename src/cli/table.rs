//! Tables and the way numbers are written for people.

use comfy_table::{CellAlignment, Table, TableComponent, presets::UTF8_HORIZONTAL_ONLY};

use crate::orchestrator::{Outcome, StageReport};

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

/// The stages of a finished run.
pub fn of_run(stages: &[StageReport]) -> String {
    let header = ["stage", "kind", "outcome", "chunks", "time", "digest", "size"];
    let mut table = table(&header, &["time", "size"]);
    for stage in stages {
        table.add_row([
            stage.name.clone(),
            stage.kind.clone(),
            outcome(stage.outcome).to_owned(),
            chunks(stage, "built", "reused"),
            seconds(stage.seconds),
            stage.digest.map_or_else(|| "-".to_owned(), |digest| digest.short()),
            if stage.size == 0 {
                "-".to_owned()
            } else {
                bytes(stage.size)
            },
        ]);
    }
    table.trim_fmt()
}

/// The stages of a plan.
pub fn of_plan(stages: &[StageReport]) -> String {
    let mut table = table(&["stage", "kind", "outcome", "chunks", "why"], &[]);
    for stage in stages {
        table.add_row([
            stage.name.clone(),
            stage.kind.clone(),
            outcome(stage.outcome).to_owned(),
            chunks(stage, "to build", "there"),
            stage.why.clone().unwrap_or_default(),
        ]);
    }
    table.trim_fmt()
}

/// The word for an outcome, as in JSON.
pub fn outcome(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Built => "built",
        Outcome::Reused => "reused",
        Outcome::Failed => "failed",
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

/// A duration.
pub fn seconds(seconds: f64) -> String {
    match seconds {
        s if s < 0.0095 => format!("{:.0} ms", 1e3 * s),
        s if s < 9.95 => format!("{s:.2} s"),
        s if s < 59.95 => format!("{s:.1} s"),
        s => format!("{} min {:02.0} s", (s.round() / 60.0).floor(), s.round() % 60.0),
    }
}

/// A file size.
pub fn bytes(bytes: u64) -> String {
    let units = [("GB", 1e9), ("MB", 1e6), ("kB", 1e3)];
    let bytes = bytes as f64;
    match units.iter().find(|(_, size)| bytes >= 0.9995 * size) {
        Some((unit, size)) => format!("{:.1} {unit}", bytes / size),
        None => format!("{bytes} B"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_and_sizes_are_written_for_people() {
        for (value, text) in [
            (0.0, "0 ms"),
            (0.0094, "9 ms"),
            (0.01, "0.01 s"),
            (3.456, "3.46 s"),
            (59.94, "59.9 s"),
            (59.97, "1 min 00 s"),
            (125.2, "2 min 05 s"),
        ] {
            assert_eq!(seconds(value), text);
        }
        for (value, text) in [
            (0, "0 B"),
            (999, "999 B"),
            (1_500, "1.5 kB"),
            (999_990, "1.0 MB"),
            (2_340_000_000, "2.3 GB"),
        ] {
            assert_eq!(bytes(value), text);
        }
    }
}
