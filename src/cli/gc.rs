//! `deaflow gc`: removes artifacts that no run and no pin needs.

use std::time::Duration;

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{StoreArguments, number};
use super::progress::DelayedBar;
use super::table::Cell;
use super::text::Text;
use super::tone::Tone;
use super::{CliError, Exit, Output, locate, table};
use deaflow_orchestrator::Environment;
use deaflow_report::{FigureFile, figures_of, remove_figures};
use deaflow_store::{AGE, AGE_OF_NEED, GcArtifact, GcCount, GcGroup, GcPlan, Retention, Store};

/// Remove artifacts that neither the last runs nor a pin nor a lock file need
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow gc -n", "deaflow gc --keep-runs 3 --grace 0"))]
pub struct GcArguments {
    #[command(flatten)]
    pub store: StoreArguments,
    /// Say of each stage what would go, how large it is and what holds the rest; remove nothing
    #[arg(short = 'n', long)]
    pub dry_run: bool,
    /// Keep what the last N runs made and needed
    #[arg(long, value_name = "N", default_value_t = 10, allow_negative_numbers = true)]
    pub keep_runs: usize,
    /// Keep what was written less than so many hours ago
    #[arg(long, value_name = "HOURS", default_value_t = 24.0, value_parser = number(0.0..=1e6, "0 to 1e6 hours"))]
    pub grace: f64,
}

pub fn execute(arguments: &GcArguments, output: &Output) -> Result<Exit, CliError> {
    let folder = arguments.store.folder();
    // To look needs no store to itself.
    let store = locate::of_folder(match arguments.dry_run {
        true => Store::open_existing(&folder),
        false => Store::open_exclusive(&folder),
    })?;
    let retention = Retention {
        runs: arguments.keep_runs,
        grace: Duration::from_secs_f64(3600.0 * arguments.grace),
    };
    let collection = store.plan_gc(&retention, store.now())?;
    let figures = figures_of(&store, &collection.removed.iter().map(|judged| judged.digest).collect());
    if !arguments.dry_run {
        let bar = DelayedBar::new("gc", "artifacts");
        let at = Environment::system().now();
        store.remove(&collection, &at, &|done, total| bar.set(done, total))?;
        remove_figures(&figures)?;
        bar.clear();
    }
    if output.is_json() {
        output.document(&document(&collection, &figures, arguments.dry_run))?;
    } else {
        output.text(text(&collection, &figures, arguments.dry_run))?;
    }
    Ok(Exit::Done)
}

fn document(collection: &GcPlan, figures: &[FigureFile], dry_run: bool) -> Value {
    let tally = |tally: GcCount| json!({ "artifacts": tally.artifacts, "bytes": tally.bytes });
    let group = |group: &GcGroup| {
        json!({
            "pipeline": group.stage.as_ref().map(|name| &name.pipeline),
            "stage": group.stage.as_ref().map(|name| &name.stage),
            "kind": group.kind,
            "removed": tally(group.removed),
            "kept": tally(group.kept),
            "held_by": group.held_by,
        })
    };
    let judged = |judged: &GcArtifact| {
        json!({
            "digest": judged.digest.to_string(),
            "size": judged.size,
            "kind": judged.kind,
            "pipeline": judged.stage.as_ref().map(|name| &name.pipeline),
            "stage": judged.stage.as_ref().map(|name| &name.stage),
            "held_by": judged.held_by,
        })
    };
    json!({
        "dry_run": dry_run,
        "stages": collection.by_stage().iter().map(group).collect::<Vec<_>>(),
        "kept": collection.kept.iter().map(judged).collect::<Vec<_>>(),
        "removed": collection.removed.iter().map(judged).collect::<Vec<_>>(),
        "records_removed": collection.records,
        "checkpoints_removed": collection.checkpoints.len(),
        "figures_removed": figures.iter().map(|figure| &figure.path).collect::<Vec<_>>(),
        "bytes_kept": collection.bytes_kept(),
        "bytes_removed": collection.bytes_removed(),
    })
}

fn text(collection: &GcPlan, figures: &[FigureFile], dry_run: bool) -> Text {
    let mut text = Text::new();
    if dry_run {
        let header = ["stage", "kind", "goes", "size", "stays", "size", "held by"];
        let mut rows = table::table(&header, &["goes", "size", "stays"])
            .flowing(&["held by"])
            .dispensable(&["kind"]);
        for group in collection.by_stage() {
            let stage = group.stage.as_ref();
            let name = stage.map_or_else(|| "-".to_owned(), |name| format!("{}:{}", name.pipeline, name.stage));
            let held_by: Vec<String> = group.held_by.iter().cloned().collect();
            let tone = match group.removed.artifacts {
                0 => Tone::Plain,
                _ => Tone::Caution,
            };
            let [removed, kept] = [group.removed, group.kept].map(cells);
            let mut row = vec![Cell::from(name), Cell::from(&group.kind)];
            row.extend(removed.iter().map(|words| Cell::toned(words, tone)));
            row.extend(kept.iter().map(Cell::from));
            row.push(Cell::from(holders(&held_by)));
            rows.add_row(row);
        }
        text.table(rows).line("");
    }
    let verb = if dry_run { "would remove" } else { "removed" };
    text.line(format!(
        "{verb} {} ({}) and {}; kept: {} ({})",
        table::counted(collection.removed.len() as u64, "artifacts"),
        table::bytes(collection.bytes_removed()),
        table::counted(collection.records, "records"),
        table::counted(collection.kept.len() as u64, "artifacts"),
        table::bytes(collection.bytes_kept()),
    ));
    if collection.removed.is_empty()
        && let Some(advice) = advice(collection)
    {
        text.line(advice);
    }
    if !collection.checkpoints.is_empty() {
        text.line(format!(
            "{verb} what {} had come to ({})",
            table::counted(collection.checkpoints.len() as u64, "unfinished actions"),
            table::bytes(collection.checkpoint_bytes())
        ));
    }
    if !figures.is_empty() {
        let size = figures.iter().map(|figure| figure.bytes).sum();
        text.line(format!(
            "{verb} {} of them ({})",
            table::counted(figures.len() as u64, "figures"),
            table::bytes(size)
        ));
    }
    text
}

/// What would have a collection that removes nothing remove something; none where nothing would but to unpin.
fn advice(collection: &GcPlan) -> Option<String> {
    let of_age = |judged: &&GcArtifact| {
        judged
            .held_by
            .iter()
            .any(|holder| holder == AGE || holder == AGE_OF_NEED)
    };
    let young = collection.kept.iter().filter(of_age).map(|judged| judged.size);
    if let n @ 1.. = young.clone().count() {
        let artifacts = table::counted(n as u64, "artifacts");
        return Some(format!(
            "{artifacts} ({}) are held by their age alone: --grace 0 would remove them",
            table::bytes(young.sum())
        ));
    }
    let of_runs = collection.kept.iter().filter(|judged| judged.by_runs_alone).count();
    (of_runs > 0).then(|| {
        let artifacts = table::counted(of_runs as u64, "artifacts");
        format!(
            "{artifacts} are held by runs alone: a smaller --keep-runs holds fewer, with --grace 0 those of today too"
        )
    })
}

/// How many, and their size; nothing where there are none.
fn cells(tally: GcCount) -> Vec<String> {
    match tally.artifacts {
        0 => vec!["-".to_owned(), "-".to_owned()],
        n => vec![n.to_string(), table::bytes(tally.bytes)],
    }
}

/// The first holder, and how many more there are.
fn holders(held_by: &[String]) -> String {
    match held_by {
        [] => "nothing".to_owned(),
        [one] => one.clone(),
        [first, more @ ..] => format!("{first}, and {} more", more.len()),
    }
}
