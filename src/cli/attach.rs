//! `deaflow attach`: follows or cancels the workers that `run --executor` has submitted.

use clap::Args;

use super::arguments::{PipelineArguments, VerbosityArguments};
use super::cluster::{ClusterBuild, Stay};
use super::local_build::{Build, LockMode};
use super::pipeline::load;
use super::upstream::StoreAccess;
use super::{CliError, Exit, Output};
use deaflow_store::{Command, Store};

/// Follow the workers that `run --executor` has submitted, then print the results
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow attach pipeline.yaml", "deaflow attach pipeline.yaml --cancel"))]
pub struct AttachArguments {
    #[command(flatten)]
    of: PipelineArguments,
    /// Cancel all workers instead
    #[arg(long)]
    cancel: bool,
    /// For a submitter in the background: cancelled workers are not submitted again
    #[arg(long, hide = true)]
    go_on: bool,
    #[command(flatten)]
    verbosity: VerbosityArguments,
}

pub fn execute(arguments: &AttachArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = load(&arguments.of)?;
    let access = StoreAccess::open(
        Store::open_existing(&arguments.of.store_folder())?,
        &arguments.of,
        output,
    )?;
    let workers = ClusterBuild {
        pipeline: &pipeline,
        of: &arguments.of,
        store: access.store(),
        mode: arguments.verbosity.progress.mode(),
    };
    let ledger = workers.ledger()?.ok_or_else(|| {
        let path = arguments.of.pipeline.display();
        CliError::bad_input(format!("no workers have been submitted for {path}"))
            .help("submit with `deaflow run --executor`; --until and --set must be the same here")
    })?;
    if arguments.cancel {
        return workers.cancel(&ledger.options, output);
    }
    let keep_going = ledger.options.keep_going;
    let stay = if arguments.go_on {
        Stay::ForOther
    } else {
        Stay::UntilBuilt
    };
    if let Some(exit) = workers.submit(ledger.options, stay, output)? {
        return Ok(exit);
    }
    let build = Build {
        pipeline: &pipeline,
        of: &arguments.of,
        command: Command::Run,
        keep_going,
        lock: LockMode::Ignore,
        verbosity: arguments.verbosity,
    };
    build.execute(output)
}
