//! `deaflow gc`: removes artifacts that no run and no pin needs.

use std::time::Duration;

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{StoreArguments, number};
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::table::Cell;
use super::text::Text;
use super::tone::Tone;
use super::{locate, table};
use crate::store::{Collection, Judged, Retention, Store};

/// Remove artifacts that neither the last runs nor a pin nor a lock file need
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow gc -n", "deaflow gc --keep-runs 3 --grace 0"))]
pub struct GcArguments {
    #[command(flatten)]
    pub store: StoreArguments,
    /// Say what would go, how large it is and what holds the rest; remove nothing
    #[arg(short = 'n', long)]
    pub dry_run: bool,
    /// Keep what the last N runs made and needed
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub keep_runs: usize,
    /// Keep what was written less than so many hours ago
    #[arg(long, value_name = "HOURS", default_value_t = 24.0, value_parser = number(0.0..=1e6, "0 to 1e6 hours"))]
    pub grace: f64,
}

pub fn execute(arguments: &GcArguments, output: &Output) -> Result<Exit, CliError> {
    let store = locate::of_folder(Store::open_alone(&arguments.store.folder()))?;
    let retention = Retention {
        runs: arguments.keep_runs,
        grace: Duration::from_secs_f64(3600.0 * arguments.grace),
    };
    let collection = store.judge(&retention, store.now())?;
    if !arguments.dry_run {
        let bar = Bar::new("gc", "artifacts", 0);
        store.remove(&collection, &|done, total| bar.set(done, total))?;
        bar.finish("removed");
    }
    if output.is_json() {
        output.document(&document(&collection, arguments.dry_run))?;
    } else {
        output.text(text(&collection, arguments.dry_run))?;
    }
    Ok(Exit::Done)
}

fn document(collection: &Collection, dry_run: bool) -> Value {
    let judged = |judged: &Judged| {
        json!({
            "digest": judged.digest.to_string(),
            "size": judged.size,
            "kind": judged.kind,
            "held_by": judged.held_by,
        })
    };
    json!({
        "dry_run": dry_run,
        "kept": collection.kept.iter().map(judged).collect::<Vec<_>>(),
        "removed": collection.removed.iter().map(judged).collect::<Vec<_>>(),
        "records_removed": collection.records,
        "checkpoints_removed": collection.checkpoints.len(),
        "bytes_kept": collection.bytes_kept(),
        "bytes_removed": collection.bytes_removed(),
    })
}

fn text(collection: &Collection, dry_run: bool) -> Text {
    let mut text = Text::new();
    if dry_run {
        let header = ["artifact", "kind", "size", "held by"];
        let mut rows = table::table(&header, &["size"]).flowing(&["held by"]);
        for judged in collection.removed.iter().chain(&collection.kept) {
            let tone = match judged.held_by.is_empty() {
                true => Tone::Caution,
                false => Tone::Plain,
            };
            rows.add_row([
                Cell::from(judged.digest.short()),
                Cell::from(&judged.kind),
                Cell::from(table::bytes(judged.size)),
                Cell::toned(&holders(&judged.held_by), tone),
            ]);
        }
        text.table(rows).line("");
    }
    let verb = if dry_run { "would remove" } else { "removed" };
    text.line(format!(
        "{verb} {} artifacts ({}) and {} records; {} artifacts ({}) stay",
        collection.removed.len(),
        table::bytes(collection.bytes_removed()),
        collection.records,
        collection.kept.len(),
        table::bytes(collection.bytes_kept()),
    ));
    if !collection.checkpoints.is_empty() {
        text.line(format!(
            "{verb} what {} unfinished actions had come to ({})",
            collection.checkpoints.len(),
            table::bytes(collection.checkpoint_bytes())
        ));
    }
    text
}

/// The first holder, and how many more there are.
fn holders(held_by: &[String]) -> String {
    match held_by {
        [] => "nothing: goes".to_owned(),
        [one] => one.clone(),
        [first, more @ ..] => format!("{first}, and {} more", more.len()),
    }
}
