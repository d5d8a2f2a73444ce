//! `deaflow export`: writes what was made in the formats of other programs; one file for each thing that can be exported.

mod design;
mod model;

use super::arguments::{ExportArguments, Exported};
use super::error::CliError;
use super::output::{Exit, Output};

pub fn execute(arguments: &ExportArguments, output: &Output) -> Result<Exit, CliError> {
    match &arguments.what {
        Exported::Design(arguments) => design::execute(arguments, output),
        Exported::Model(arguments) => model::execute(arguments, output),
    }
}
