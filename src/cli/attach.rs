//! `deaflow attach`: goes on with what has been submitted for a pipeline, shows how far it is, or cancels it.

use clap::Args;

use super::arguments::{PROGRESS, PipelineArguments};
use super::cluster::{ClusterArguments, How, Work};
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};
use super::run::{self, ProgressForm, RunArguments, load};
use deaflow_store::{Command, Store};

/// Go on with what `run --executor` has submitted, and show how far it is
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow attach pipeline.yaml", "deaflow attach pipeline.yaml --cancel"))]
pub struct AttachArguments {
    #[command(flatten)]
    of: PipelineArguments,
    /// End all its workers instead
    #[arg(long)]
    cancel: bool,
    /// For another submitter: what has been cancelled stays so
    #[arg(long, hide = true)]
    go_on: bool,
    /// Print all that was found, and a table of the stages
    #[arg(short, long, help_heading = PROGRESS)]
    verbose: bool,
    /// Say nothing but warnings and errors
    #[arg(short, long, conflicts_with = "verbose", help_heading = PROGRESS)]
    quiet: bool,
    /// How progress is shown on stderr [default: a bar on a terminal, or else plain lines]
    #[arg(long, value_enum, value_name = "HOW", conflicts_with = "quiet", help_heading = PROGRESS)]
    progress: Option<ProgressForm>,
}

pub fn execute(arguments: &AttachArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = load(&arguments.of)?;
    let reading = arguments
        .of
        .read(Store::open_existing(&arguments.of.store_folder())?, output)?;
    let work = Work {
        pipeline: &pipeline,
        of: &arguments.of,
        store: reading.store(),
        shown: ProgressForm::shown(arguments.progress, arguments.quiet),
    };
    let ledger = work.ledger()?.ok_or_else(|| {
        CliError::bad_input(format!(
            "nothing has been submitted for {}",
            arguments.of.pipeline.display()
        ))
        .help("`deaflow run --executor` submits; --until and --set have to be those of that")
    })?;
    if arguments.cancel {
        return work.cancel(&ledger.recipe, output);
    }
    let keep_going = ledger.recipe.keep_going;
    let how = if arguments.go_on { How::GoOn } else { How::Stay };
    if let Some(exit) = work.submit(ledger.recipe, how, output)? {
        return Ok(exit);
    }
    let run = RunArguments {
        of: arguments.of.clone(),
        dry_run: false,
        keep_going,
        lock: false,
        locked: false,
        verbose: arguments.verbose,
        quiet: arguments.quiet,
        progress: arguments.progress,
        cluster: ClusterArguments::default(),
    };
    Ok(run::of_pipeline(&pipeline, &run, Command::Run, output, &|_, _| Ok(()))?.0)
}
