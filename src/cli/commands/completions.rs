//! `deaflow completions`: completion scripts for shells.

use clap::Args;
use clap_complete::{Shell, generate};

use super::{PROGRAM, command_line};
use crate::{CliError, Exit, Output};

/// Generate shell completions
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
