//! `deaflow gc`: removes artifacts that neither a recent run nor a pin needs.

use std::time::Duration;

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{StoreArguments, age, size};
use super::progress::DelayedBar;
use super::table::Cell;
use super::text::Text;
use super::tone::Tone;
use super::{CliError, Exit, Output, locate, table};
use deaflow_orchestrator::Environment;
use deaflow_report::{FigureFile, figures_of, remove_figures};
use deaflow_store::{AGE, AGE_OF_NEED, GcArtifact, GcCount, GcGroup, GcPlan, Retention, Store};

/// Remove artifacts that no recent run, pin or lock file needs
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow gc -n", "deaflow gc --keep-runs 3 --grace 0", "deaflow gc --free 20GB"))]
pub struct GcArguments {
    #[command(flatten)]
    pub store: StoreArguments,
    /// Print what would be removed for each stage, its size, and what protects the rest; remove nothing
    #[arg(short = 'n', long)]
    pub dry_run: bool,
    /// Keep the artifacts that the last N complete runs of each pipeline, and later ones, made and needed
    #[arg(long, value_name = "N", default_value_t = 10, allow_negative_numbers = true)]
    pub keep_runs: usize,
    /// Keep what was written less than this long ago: hours, or a time as in "90 min" or 7days
    #[arg(long, value_name = "TIME", default_value = "24", value_parser = age, allow_negative_numbers = true)]
    pub grace: Duration,
    /// Also remove the artifacts of older runs, oldest first, until this much is freed, as in 20GB. The last run of
    /// each pipeline whose file exists stays
    #[arg(long, value_name = "SIZE", value_parser = size)]
    pub free: Option<u64>,
}

pub fn execute(arguments: &GcArguments, output: &Output) -> Result<Exit, CliError> {
    let folder = arguments.store.folder();
    // A dry run does not need exclusive access.
    let store = locate::of_folder(match arguments.dry_run {
        true => Store::open_existing(&folder),
        false => Store::open_exclusive(&folder),
    })?;
    let retention = Retention {
        runs: arguments.keep_runs,
        grace: arguments.grace,
        free: arguments.free,
    };
    let plan = store.plan_gc(&retention, store.now())?;
    let quarantined = store.totals()?.quarantined;
    let mut figures = figures_of(&store, &plan.removed.iter().map(|artifact| artifact.digest).collect());
    for file in &plan.last_runs {
        output.warn(format_args!(
            "{} artifacts of the last run of {}: keep them with --keep-runs 1 or `deaflow pin`",
            if arguments.dry_run {
                "this would remove"
            } else {
                "this removes"
            },
            file.display()
        ));
    }
    if !arguments.dry_run {
        let bar = DelayedBar::new("gc", "artifacts");
        let at = Environment::system().now();
        let listed = store.remove(&plan, &at, &|done, total| bar.set(done, total));
        let (removed, drawn) = remove_figures(figures);
        figures = removed;
        bar.clear();
        if let Some(why) = listed? {
            output.warn(format_args!(
                "other commands will not say that `gc` removed these artifacts: {why}"
            ));
        }
        if let Err(why) = drawn {
            output.warn(format_args!("some figures of removed artifacts remain: {why}"));
        }
    }
    output.result(
        || {
            let mut document = document(&plan, &figures, arguments.dry_run);
            document["store"] = json!(store.root());
            document["quarantined"] = json!(quarantined);
            document
        },
        || {
            let mut text = text(&plan, &figures, arguments.dry_run);
            if quarantined > 0 {
                text.line(format!(
                    "{} in {} stay: damaged, or with missing inputs; they are not used and can be deleted",
                    table::counted(quarantined, "files"),
                    store.root().join("quarantine").display()
                ));
            }
            text.line(locate::named(&store));
            text
        },
    )?;
    let Some(wanted) = arguments.free.filter(|wanted| plan.bytes_freed() < *wanted) else {
        return Ok(Exit::Done);
    };
    let [freed, wanted] = [plan.bytes_freed(), wanted].map(table::bytes);
    let verb = if arguments.dry_run { "would free" } else { "freed" };
    let error = CliError::failure(format!("{verb} only {freed} of {wanted}"))
        .help("pins, lock files, the last run of each pipeline and --grace protect the rest: see `deaflow gc -n`");
    output.report(&error);
    Ok(error.exit())
}

fn document(plan: &GcPlan, figures: &[FigureFile], dry_run: bool) -> Value {
    let count = |count: GcCount| json!({ "artifacts": count.artifacts, "bytes": count.bytes });
    let group = |group: &GcGroup| {
        json!({
            "pipeline": group.stage.as_ref().map(|name| &name.pipeline),
            "stage": group.stage.as_ref().map(|name| &name.stage),
            "kind": group.kind,
            "removed": count(group.removed),
            "kept": count(group.kept),
            "held_by": group.held_by,
        })
    };
    let artifact = |artifact: &GcArtifact| {
        json!({
            "digest": artifact.digest.to_string(),
            "size": artifact.size,
            "kind": artifact.kind,
            "pipeline": artifact.stage.as_ref().map(|name| &name.pipeline),
            "stage": artifact.stage.as_ref().map(|name| &name.stage),
            "held_by": artifact.held_by,
        })
    };
    json!({
        "dry_run": dry_run,
        "stages": plan.by_stage().iter().map(group).collect::<Vec<_>>(),
        "kept": plan.kept.iter().map(artifact).collect::<Vec<_>>(),
        "removed": plan.removed.iter().map(artifact).collect::<Vec<_>>(),
        "records_removed": plan.records,
        "checkpoints_removed": plan.checkpoints.len(),
        "last_runs_removed": plan.last_runs,
        "figures_removed": figures.iter().map(|figure| &figure.path).collect::<Vec<_>>(),
        "bytes_kept": plan.bytes_kept(),
        "bytes_removed": plan.bytes_removed(),
    })
}

fn text(plan: &GcPlan, figures: &[FigureFile], dry_run: bool) -> Text {
    let mut text = Text::new();
    if dry_run {
        let header = ["stage", "kind", "removed", "size", "kept", "size", "protected by"];
        let mut rows = table::table(&header, &["removed", "size", "kept"])
            .flowing(&["protected by"])
            .dispensable(&["kind"]);
        for group in plan.by_stage() {
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
        table::counted(plan.removed.len() as u64, "artifacts"),
        table::bytes(plan.bytes_removed()),
        table::counted(plan.records, "records"),
        table::counted(plan.kept.len() as u64, "artifacts"),
        table::bytes(plan.bytes_kept()),
    ));
    if plan.removed.is_empty()
        && let Some(advice) = advice(plan)
    {
        text.line(advice);
    }
    if !plan.checkpoints.is_empty() {
        text.line(format!(
            "{verb} the checkpoints of {} ({})",
            table::counted(plan.checkpoints.len() as u64, "unfinished actions"),
            table::bytes(plan.checkpoint_bytes())
        ));
    }
    if !figures.is_empty() {
        let size = figures.iter().map(|figure| figure.bytes).sum();
        text.line(format!(
            "{verb} {} ({})",
            table::counted(figures.len() as u64, "figures"),
            table::bytes(size)
        ));
    }
    text
}

/// Suggests options with which something would be removed; none if everything is pinned or locked.
fn advice(plan: &GcPlan) -> Option<String> {
    let of_age = |artifact: &&GcArtifact| {
        artifact
            .held_by
            .iter()
            .any(|holder| holder == AGE || holder == AGE_OF_NEED)
    };
    let young = plan.kept.iter().filter(of_age).map(|artifact| artifact.size);
    if let n @ 1.. = young.clone().count() {
        let artifacts = table::counted(n as u64, "artifacts");
        return Some(format!(
            "{artifacts} ({}) protected by age only: remove with --grace 0",
            table::bytes(young.sum())
        ));
    }
    let of_runs = plan.kept.iter().filter(|artifact| artifact.by_runs_alone).count();
    (of_runs > 0).then(|| {
        let artifacts = table::counted(of_runs as u64, "artifacts");
        format!(
            "{artifacts} protected by runs only: remove with a smaller --keep-runs, and --grace 0 for those of today"
        )
    })
}

/// Formats a number of artifacts and their size.
fn cells(count: GcCount) -> Vec<String> {
    match count.artifacts {
        0 => vec!["-".to_owned(), "-".to_owned()],
        n => vec![n.to_string(), table::bytes(count.bytes)],
    }
}

/// Names the first reason for keeping an artifact, and the number of the others.
fn holders(held_by: &[String]) -> String {
    match held_by {
        [] => "nothing".to_owned(),
        [one] => one.clone(),
        [first, more @ ..] => format!("{first}, and {} more", more.len()),
    }
}
