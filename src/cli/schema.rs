//! `deaflow schema`: the JSON Schema of pipelines or scenes, with which editors complete and check files.

use super::arguments::{SchemaArguments, SchemaOf};
use super::error::CliError;
use super::output::{Exit, Output};
use crate::orchestrator::{of_pipeline, of_scene};
use crate::stage;

pub fn execute(arguments: &SchemaArguments, output: &Output) -> Result<Exit, CliError> {
    let registry = stage::registry();
    output.document(&match arguments.of {
        SchemaOf::Pipeline => of_pipeline(&registry),
        SchemaOf::Scene => of_scene(&registry),
    })?;
    Ok(Exit::Done)
}
