//! Tables of stages, and formats of numbers.

pub use super::columns::{Cell, Table, table};
pub use deaflow_report::{bytes, number, seconds};

use super::text::Text;
use super::tone::Tone;
use deaflow_orchestrator::{Estimate, Outcome, Price, PriceTotal, StageReport};

/// The explanation of the column `share`.
const SHARES: &str =
    "share: part of the time of the run, which stages that run in parallel divide; estimates are of this share";

/// Formats the stages of a finished run, with estimates if there were any.
pub fn of_run(stages: &[StageReport]) -> Text {
    let mut text = Text::of(table_of_run(stages));
    if is_shared(stages) {
        text.toned(Tone::Dim, SHARES);
    }
    text
}

/// Whether stages may have run in parallel.
fn is_shared(stages: &[StageReport]) -> bool {
    stages.iter().filter(|stage| stage.part.is_some()).count() > 1
}

fn table_of_run(stages: &[StageReport]) -> Table {
    let mut header = vec![
        "stage", "kind", "outcome", "chunks", "time", "share", "estimate", "digest", "size",
    ];
    let is_estimated = stages.iter().any(|stage| stage.price.is_some());
    if !is_estimated {
        header.retain(|title| *title != "estimate");
    }
    let shared = is_shared(stages);
    if !shared {
        header.retain(|title| *title != "share");
    }
    let mut table = table(&header, &["time", "share", "estimate", "size"]).dispensable(&["kind", "digest", "chunks"]);
    for lines in lines(stages) {
        let mut row: Vec<Cell> = vec![
            name(lines).into(),
            Cell::from(&lines[0].kind),
            outcomes(lines),
            chunks(lines, "built", "reused").into(),
            seconds(lines.iter().map(|stage| stage.seconds).sum()).into(),
        ];
        if shared {
            let parts = lines.iter().map(|stage| stage.part.unwrap_or(stage.seconds));
            row.push(seconds(parts.sum()).into());
        }
        if is_estimated {
            let price = PriceTotal::of(lines.iter().map(|stage| stage.price)).price;
            row.push(price.map_or_else(String::new, |price| time(&price.seconds)).into());
        }
        let digest = match lines {
            [stage] => stage.digest.map(|digest| digest.short()),
            _ => None,
        };
        row.push(digest.unwrap_or_else(|| "-".to_owned()).into());
        row.push(match lines.iter().map(|stage| stage.size).sum() {
            0 => "-".into(),
            size => bytes(size).into(),
        });
        table.add_row(row);
    }
    table
}

/// Formats the stages of a plan.
pub fn of_plan(stages: &[StageReport]) -> Table {
    let header = ["stage", "kind", "outcome", "chunks", "time", "disk", "why"];
    let mut table = table(&header, &["time", "disk"])
        .flowing(&["why"])
        .dispensable(&["kind", "disk", "chunks"]);
    for lines in lines(stages) {
        let total = PriceTotal::of(lines.iter().filter(|stage| is_stale(stage)).map(|stage| stage.price));
        let (time, disk) = match &total.price {
            Some(price) => (time(&price.seconds), bytes(price.bytes.likely as u64)),
            None if lines.iter().any(is_stale) => {
                let unmeasured = lines.iter().find_map(|stage| stage.unmeasured.clone());
                (unmeasured.unwrap_or_else(|| "?".to_owned()), "?".to_owned())
            }
            None => (String::new(), String::new()),
        };
        let mut reasons: Vec<&str> = Vec::new();
        for reason in lines.iter().flat_map(|stage| &stage.reasons) {
            if !reasons.contains(&reason.as_str()) && reasons.len() < MAX_REASONS {
                reasons.push(reason);
            }
        }
        table.add_row([
            Cell::from(name(lines)),
            Cell::from(&lines[0].kind),
            outcomes(lines),
            Cell::from(chunks(lines, "to build", "built")),
            Cell::from(time),
            Cell::from(disk),
            Cell::from(reasons.join("\n")),
        ]);
    }
    table
}

fn is_stale(stage: &StageReport) -> bool {
    stage.outcome == Outcome::Stale
}

/// Up to this many stages of a sweep have a line each; more are combined in one.
const MAX_LINES: usize = 12;

/// The most reasons that are listed for a line.
const MAX_REASONS: usize = 10;

/// Groups the stages by lines: one each, but those of a large sweep together.
fn lines(stages: &[StageReport]) -> Vec<&[StageReport]> {
    let sweep = |stage: &StageReport| stage.name.split_once('@').map(|(sweep, _)| sweep.to_owned());
    let together = stages.chunk_by(|a, b| sweep(a).is_some() && sweep(a) == sweep(b));
    let combine = |stages: &'_ [StageReport]| stages.len() > MAX_LINES;
    together
        .flat_map(|stages| stages.chunks(if combine(stages) { stages.len() } else { 1 }))
        .collect()
}

fn name(lines: &[StageReport]) -> String {
    let sweep = lines[0].name.split_once('@').map_or("", |(sweep, _)| sweep);
    match lines {
        [stage] => stage.name.clone(),
        _ => format!("{sweep}@… ({})", lines.len()),
    }
}

/// Formats the outcomes of the stages of a line, in the colour of the most severe one.
fn outcomes(lines: &[StageReport]) -> Cell {
    let mut counts: Vec<(Outcome, usize)> = Vec::new();
    for stage in lines {
        match counts.iter_mut().find(|(known, _)| *known == stage.outcome) {
            Some((_, count)) => *count += 1,
            None => counts.push((stage.outcome, 1)),
        }
    }
    match counts[..] {
        [(Outcome::Skipped, _)] if lines[0].missing.is_none() => Cell::toned("not started", Tone::of(Outcome::Skipped)),
        [(Outcome::Skipped, _)] => {
            let missing = lines[0].missing.as_deref().unwrap_or_default();
            Cell::toned(&format!("skipped (needs {missing})"), Tone::of(Outcome::Skipped))
        }
        [(one, _)] => Cell::toned(outcome(one), Tone::of(one)),
        _ => {
            let tones: Vec<Tone> = counts.iter().map(|(of, _)| Tone::of(*of)).collect();
            let gravest = [Tone::Bad, Tone::Caution, Tone::Good]
                .into_iter()
                .find(|tone| tones.contains(tone));
            let counts = counts.iter().map(|(of, count)| format!("{count} {}", outcome(*of)));
            let counts = counts.collect::<Vec<_>>().join(", ");
            Cell::toned(&counts, gravest.unwrap_or_default())
        }
    }
}

/// Formats an estimated time with its range.
pub fn time(estimate: &Estimate) -> String {
    format!(
        "{} ({} to {})",
        seconds(estimate.likely),
        seconds(estimate.low),
        seconds(estimate.high)
    )
}

/// Formats the estimated cost of stale stages, and the number of those without an estimate.
pub fn price(price: Option<&Price>, unpriced: usize) -> String {
    let known = price.map(|price| {
        let disk = bytes(price.bytes.likely as u64);
        format!("about {}, {disk}", time(&price.seconds))
    });
    match (known, unpriced) {
        (Some(known), 0) => known,
        (Some(known), n) => format!("{known}, and {n} without an estimate"),
        (None, _) => "no estimate: costs of these stages are not recorded".to_owned(),
    }
}

/// Returns the name of an outcome, as in JSON.
pub fn outcome(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Built => "built",
        Outcome::Reused => "reused",
        Outcome::Failed => "failed",
        Outcome::Stopped => "stopped",
        Outcome::Left => "left to others",
        Outcome::Skipped => "skipped",
        Outcome::Stale => "stale",
    }
}

fn chunks(lines: &[StageReport], built: &str, reused: &str) -> String {
    let sum = |of: fn(&StageReport) -> u64| lines.iter().map(of).sum::<u64>();
    match (sum(|stage| stage.chunks_built), sum(|stage| stage.chunks_reused)) {
        (0, 0) => "-".into(),
        (n, 0) => format!("{n} {built}"),
        (0, n) => format!("{n} {reused}"),
        (n, m) => format!("{n} {built}, {m} {reused}"),
    }
}

/// Formats a number with a noun, given in the plural: `1 step`, `2 searches`.
pub fn counted(n: u64, many: &str) -> String {
    let one = match many.strip_suffix("ches") {
        Some(stem) => format!("{stem}ch"),
        None => many.strip_suffix('s').unwrap_or(many).to_owned(),
    };
    if n == 1 {
        format!("1 {one}")
    } else {
        format!("{n} {many}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tone::Screen;

    #[test]
    fn of_stages_that_were_built_at_once_both_clocks_are_told() {
        let stage = |name: &str, seconds: f64, part: Option<f64>| StageReport {
            chunks_built: 1,
            seconds,
            part,
            ..StageReport::new(name, "solve", Outcome::Built)
        };
        let shown = of_run(&[stage("a", 4.0, Some(2.0)), stage("b", 6.0, Some(4.0))]).show(Screen::default());
        for expected in ["time", "part", "4.00 s", "2.00 s", "6.00 s", SHARES] {
            assert!(shown.contains(expected), "{expected}: {shown}");
        }
        let alone = of_run(&[stage("a", 4.0, None), stage("b", 6.0, None)]).show(Screen::default());
        assert!(!alone.contains("part"), "{alone}");
    }

    #[test]
    fn one_is_not_many() {
        assert_eq!(
            [
                counted(1, "steps"),
                counted(1, "searches"),
                counted(2, "epochs"),
                counted(0, "masks")
            ],
            ["1 step", "1 search", "2 epochs", "0 masks"]
        );
    }
}
