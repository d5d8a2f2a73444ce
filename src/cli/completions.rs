//! `deaflow completions`: what a shell needs to complete commands and options.

use clap::Args;
use clap_complete::{Shell, generate};

use super::commands::{PROGRAM, command_line};
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};

/// Print what a shell needs to complete commands and options
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow completions bash > ~/.local/share/bash-completion/completions/deaflow",
    "deaflow completions fish > ~/.config/fish/completions/deaflow.fish",
))]
pub struct CompletionsArguments {
    /// The shell
    #[arg(value_enum)]
    pub shell: Shell,
}

pub fn execute(arguments: &CompletionsArguments, output: &Output) -> Result<Exit, CliError> {
    let mut script = Vec::new();
    generate(arguments.shell, &mut command_line(), PROGRAM, &mut script);
    output.plain(&String::from_utf8_lossy(&script))?;
    Ok(Exit::Done)
}
