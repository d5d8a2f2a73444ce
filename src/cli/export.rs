//! `deaflow export`: writes what was made in the formats of other programs; one file for each thing that can be exported.

mod artifact;
mod design;
mod membrane;
mod model;
mod research_object;

use clap::{Args, Subcommand};

use super::error::CliError;
use super::output::{Exit, Output};

/// Write what was made in the formats of other programs
#[derive(Debug, Args)]
pub struct ExportArguments {
    #[command(subcommand)]
    pub what: Exported,
}

#[derive(Debug, Subcommand)]
pub enum Exported {
    /// An artifact as one HDF5 file that needs no store
    Artifact(artifact::ExportArtifactArguments),
    /// A pipeline with all that it made as a research object (Workflow Run RO-Crate)
    Crate(research_object::ExportCrateArguments),
    /// A design as a mask (svg, dxf, gerber, png, csv) or a deformed membrane (vtkhdf)
    Design(design::ExportDesignArguments),
    /// A trained model as a safetensors or an ONNX file
    Model(model::ExportModelArguments),
}

pub fn execute(arguments: &ExportArguments, output: &Output) -> Result<Exit, CliError> {
    match &arguments.what {
        Exported::Artifact(arguments) => artifact::execute(arguments, output),
        Exported::Crate(arguments) => research_object::execute(arguments, output),
        Exported::Design(arguments) => design::execute(arguments, output),
        Exported::Model(arguments) => model::execute(arguments, output),
    }
}
