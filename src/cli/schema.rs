//! `deaflow schema`: the JSON Schema of pipelines or scenes, with which editors complete and check files.

use clap::{Args, ValueEnum};

use super::error::CliError;
use super::output::{Exit, Output};
use crate::orchestrator::{of_pipeline, of_scene};
use crate::stage;

/// Print the JSON Schema of pipelines or scenes, with which editors complete and check files
#[derive(Debug, Args)]
pub struct SchemaArguments {
    /// Of what
    #[arg(value_enum, default_value_t = SchemaOf::Pipeline)]
    pub of: SchemaOf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SchemaOf {
    /// Pipelines
    Pipeline,
    /// Scenes in files of their own
    Scene,
}

pub fn execute(arguments: &SchemaArguments, output: &Output) -> Result<Exit, CliError> {
    let registry = stage::registry();
    output.document(&match arguments.of {
        SchemaOf::Pipeline => of_pipeline(&registry),
        SchemaOf::Scene => of_scene(&registry),
    })?;
    Ok(Exit::Done)
}
