//! `deaflow fsck`: checks every byte of a store.

use std::path::Path;

use clap::Args;
use serde_json::json;

use super::arguments::StoreArguments;
use super::progress::DelayedBar;
use super::{CliError, Exit, Output, locate, table};
use deaflow_store::{Report, Store};

/// Check every byte of a store
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow fsck", "deaflow fsck --repair"))]
pub struct FsckArguments {
    #[command(flatten)]
    pub store: StoreArguments,
    /// Repair the store: also remove records of missing artifacts, incomplete manifests, and foreign files
    #[arg(long)]
    pub repair: bool,
}

pub fn execute(arguments: &FsckArguments, output: &Output) -> Result<Exit, CliError> {
    let folder = arguments.store.folder();
    let (marker, store) = match arguments.repair {
        true => (
            locate::of_folder(Store::repair_marker(&folder))?,
            locate::of_folder(Store::open_exclusive(&folder))?,
        ),
        false => (None, locate::existing_store(&folder)?),
    };
    let bar = DelayedBar::new("fsck", "files");
    let progress = |done, total| bar.set(done, total);
    let mut report = match arguments.repair {
        true => store.repair(&progress)?,
        false => store.fsck(&progress)?,
    };
    report.damaged.splice(..0, marker);
    bar.clear();
    output.result(
        || {
            let mut document = document(&report);
            document["store"] = json!(store.root());
            document
        },
        || format!("{}\n{}", locate::named(&store), text(&report, arguments.repair)),
    )?;
    let is_sound = arguments.repair || (report.damaged.is_empty() && report.missing.is_empty());
    Ok(match () {
        () if !is_sound => Exit::Damaged,
        () if !report.unreadable.is_empty() => Exit::Failure,
        () => Exit::Done,
    })
}

fn document(report: &Report) -> serde_json::Value {
    let damaged = report.damaged.iter().map(
        |d| json!({ "path": shown(&d.path), "reason": d.reason, "quarantined": d.quarantined.as_deref().map(shown) }),
    );
    let unreadable = report
        .unreadable
        .iter()
        .map(|d| json!({ "path": shown(&d.path), "reason": d.reason }));
    let missing = report
        .missing
        .iter()
        .map(|m| json!({ "digest": m.digest.to_string(), "wanted_by": m.needed_by }));
    json!({
        "sound": report.is_sound(),
        "objects": report.objects,
        "bytes": report.bytes,
        "records": report.records,
        "checkpoints": report.checkpoints,
        "unreadable": unreadable.collect::<Vec<_>>(),
        "damaged": damaged.collect::<Vec<_>>(),
        "missing": missing.collect::<Vec<_>>(),
        "rewritten": report.rewritten.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "strays": report.strays.iter().map(|path| shown(path)).collect::<Vec<_>>(),
        "unfinished": report.unfinished,
        "repaired": report.repaired.iter().map(|path| shown(path)).collect::<Vec<_>>(),
    })
}

/// Formats a path, even if it is not valid UTF-8.
fn shown(path: &Path) -> String {
    path.display().to_string()
}

fn text(report: &Report, repaired: bool) -> String {
    let mut lines = vec![format!(
        "{} ({}), {}",
        table::counted(report.objects, "artifacts"),
        table::bytes(report.bytes),
        table::counted(report.records, "records")
    )];
    for damage in &report.damaged {
        let aside = damage.quarantined.as_ref();
        let aside = aside.map_or(String::new(), |path| format!("; moved to {}", path.display()));
        lines.push(format!("damaged: {}: {}{aside}", damage.path.display(), damage.reason));
    }
    for file in &report.unreadable {
        lines.push(format!("unreadable: {}", file.reason));
    }
    for absence in &report.missing {
        lines.push(format!(
            "missing: artifact {}, needed by {}",
            absence.digest.short(),
            absence.needed_by
        ));
    }
    for digest in &report.rewritten {
        lines.push(format!(
            "rewritten after its record: artifact {} (its content is correct)",
            digest.short()
        ));
    }
    for stray in &report.strays {
        lines.push(format!("foreign file: {}", stray.display()));
    }
    if report.unfinished > 0 {
        lines.push(format!(
            "{} incomplete files: being written, or left by a dead process",
            report.unfinished
        ));
    }
    for path in &report.repaired {
        lines.push(format!("moved aside: {}", path.display()));
    }
    lines.push(if report.is_sound() {
        "the store is sound".to_owned()
    } else if !report.unreadable.is_empty() {
        "unreadable files were not checked".to_owned()
    } else if repaired {
        "repaired; build missing artifacts again with `deaflow run` and the same `--set`. Files in `quarantine/` are \
         not used and can be deleted"
            .to_owned()
    } else {
        "the store is damaged: repair it with `deaflow fsck --repair`, then build missing artifacts again with \
         `deaflow run` and the same `--set` (see `deaflow log`)"
            .to_owned()
    });
    lines.join("\n")
}
