//! The table of commands. A new command is a file with its arguments and `execute`, and one line here.

use clap::{Parser, Subcommand};

use super::error::CliError;
use super::output::{Exit, Output};
use super::{
    accuracy, attach, audit, copy, dag, diff, doctor, explain, export, fsck, gc, log, pin, plan, predict, pull, push,
    remote, report, run, schema, screen, show, solve, status, sweep, unpin, worker,
};

/// The version, and which build of it: two builds of other sources are told apart.
const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (build ", env!("DEAFLOW_BUILD_SHORT"), ")");

/// Designs dielectric-elastomer actuators, reproducibly: sample, solve, balance, train, design, verify.
#[derive(Debug, Parser)]
#[command(version = VERSION, about, propagate_version = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print one JSON document on stdout; progress goes to stderr either way
    #[arg(long, global = true)]
    pub json: bool,
    /// Threads to use [default: one per core]; results do not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
}

/// Declares the commands in the order of `deaflow --help`; the first sentence of each is the comment on its arguments.
macro_rules! commands {
    ($($command:ident => $file:ident::$arguments:ident,)*) => {
        #[derive(Debug, Subcommand)]
        enum Command {
            $($command($file::$arguments),)*
        }

        impl Cli {
            /// Runs the command that is named.
            pub fn execute(&self, output: &Output) -> Result<Exit, CliError> {
                match &self.command {
                    $(Command::$command(arguments) => $file::execute(arguments, output),)*
                }
            }
        }
    };
}

commands! {
    Run => run::RunArguments,
    Attach => attach::AttachArguments,
    Worker => worker::WorkerArguments,
    Sweep => sweep::SweepArguments,
    Plan => plan::PlanArguments,
    Status => status::StatusArguments,
    Log => log::LogArguments,
    Diff => diff::DiffArguments,
    Explain => explain::ExplainArguments,
    Dag => dag::DagArguments,
    Schema => schema::SchemaArguments,
    Show => show::ShowArguments,
    Fsck => fsck::FsckArguments,
    Gc => gc::GcArguments,
    Doctor => doctor::DoctorArguments,
    Pin => pin::PinArguments,
    Unpin => unpin::UnpinArguments,
    Copy => copy::CopyArguments,
    Remote => remote::RemoteCommand,
    Push => push::PushArguments,
    Pull => pull::PullArguments,
    Screen => screen::ScreenArguments,
    Solve => solve::SolveArguments,
    Predict => predict::PredictArguments,
    Export => export::ExportArguments,
    Report => report::ReportArguments,
    Accuracy => accuracy::AccuracyArguments,
    Audit => audit::AuditArguments,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_declaration_holds_together() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_command_says_what_it_does() {
        for command in Cli::command().get_subcommands() {
            assert!(command.get_about().is_some(), "{}", command.get_name());
        }
    }
}
