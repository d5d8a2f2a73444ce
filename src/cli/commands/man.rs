//! `deaflow man`: a manual page for each command.

use std::path::{Path, PathBuf};

use clap::{Args, Command};
use clap_mangen::Man;
use serde_json::json;

use super::command_line;
use crate::examples::HEADING;
use crate::{CliError, Exit, Output, write};

/// Write a manual page for each command
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow man ~/.local/share/man/man1"))]
pub struct ManArguments {
    /// The folder for deaflow.1, deaflow-run.1 and the others; it is created if missing
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}

pub fn execute(arguments: &ManArguments, output: &Output) -> Result<Exit, CliError> {
    write::folder(&arguments.folder)?;
    // The pages replace `deaflow help COMMAND`.
    let mut command = command_line().disable_help_subcommand(true);
    command.build();
    let mut files = Vec::new();
    write_pages(&command, &arguments.folder, &mut files)?;
    output.result(
        || json!({ "files": files }),
        || format!("{}: {} manual pages", arguments.folder.display(), files.len()),
    )
}

fn write_pages(command: &Command, folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), CliError> {
    let page = Man::new(with_examples_alone(command.clone()));
    let file = folder.join(page.get_filename());
    let mut text = Vec::new();
    page.render(&mut text)
        .map_err(|error| CliError::failure(format!("cannot format {}: {error}", file.display())))?;
    let text = String::from_utf8_lossy(&text).replace("\n.SH EXTRA\n", "\n.SH EXAMPLES\n");
    write::file(&file, text.as_bytes())?;
    files.push(file);
    for command in command.get_subcommands() {
        write_pages(command, folder, files)?;
    }
    Ok(())
}

/// Removes the heading of the examples: on a page they are a section.
fn with_examples_alone(command: Command) -> Command {
    let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    match text.strip_prefix(HEADING) {
        Some(lines) => command.after_help(lines.trim_start_matches('\n').to_owned()),
        None => command,
    }
}
