//! `deaflow run`: builds the stale stages of a pipeline and reports the results.

use clap::Args;

use super::arguments::{PipelineArguments, VerbosityArguments};
use super::cluster::{self, ClusterArguments};
use super::local_build::{Build, LockMode};
use super::{CliError, Exit, Output, pipeline, plan};
use deaflow_store::Command;

/// Build the stale stages of a pipeline and print the results
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow run pipeline.yaml",
    "deaflow run pipeline.yaml --until solved --set stages.solved.order=1",
    "deaflow run pipeline.yaml -n",
))]
pub struct RunArguments {
    #[command(flatten)]
    of: PipelineArguments,
    /// Print what would be built, as `plan` does; build nothing
    #[arg(short = 'n', long, conflicts_with_all = ["lock", "locked"])]
    dry_run: bool,
    /// After a failure, build all stages that do not need the failed one
    #[arg(short, long)]
    keep_going: bool,
    /// Write a lock file next to the pipeline, with the digest of everything that was built or reused
    #[arg(long, conflicts_with_all = ["until", "sets", "locked"])]
    lock: bool,
    /// Fail if the pipeline or a result differs from the lock file; differences are found before building where
    /// possible
    #[arg(long)]
    locked: bool,
    #[command(flatten)]
    verbosity: VerbosityArguments,
    #[command(flatten)]
    cluster: ClusterArguments,
}

pub fn execute(arguments: &RunArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = pipeline::load(&arguments.of)?;
    if arguments.dry_run {
        return plan::print(&pipeline, &arguments.of, output);
    }
    let build = Build {
        pipeline: &pipeline,
        of: &arguments.of,
        command: Command::Run,
        keep_going: arguments.keep_going,
        lock: match (arguments.lock, arguments.locked) {
            (true, _) => LockMode::Write,
            (_, true) => LockMode::Check,
            _ => LockMode::Ignore,
        },
        verbosity: arguments.verbosity,
    };
    match cluster::build(&build, &arguments.cluster, output)? {
        Some(exit) => Ok(exit),
        None => build.execute(output),
    }
}
