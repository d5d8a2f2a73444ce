//! `deaflow export`: writes results in the formats of other programs; one file per kind of result.

use super::{CliError, Exit, Output};
mod artifact;
mod design;
mod membrane;
mod model;
mod research_object;
mod scene;

use std::path::Path;

use clap::{Args, Subcommand, ValueEnum};

/// Export results in the formats of other programs
#[derive(Debug, Args)]
pub struct ExportArguments {
    #[command(subcommand)]
    pub what: Exported,
}

#[derive(Debug, Subcommand)]
pub enum Exported {
    /// Export an artifact as a standalone HDF5 file
    Artifact(artifact::ExportArtifactArguments),
    /// Export a pipeline with all its results as a research object (Workflow Run RO-Crate)
    Crate(research_object::ExportCrateArguments),
    /// Export a design as a mask (svg, dxf, gerber, png, csv) or a deformed membrane
    Design(Box<design::ExportDesignArguments>),
    /// Export a trained model as a safetensors or ONNX file
    Model(model::ExportModelArguments),
    /// Export the scene of an artifact, such as a fitted one
    Scene(scene::ExportSceneArguments),
}

pub fn execute(arguments: &ExportArguments, output: &Output) -> Result<Exit, CliError> {
    match &arguments.what {
        Exported::Artifact(arguments) => artifact::execute(arguments, output),
        Exported::Crate(arguments) => research_object::execute(arguments, output),
        Exported::Design(arguments) => design::execute(arguments, output),
        Exported::Model(arguments) => model::execute(arguments, output),
        Exported::Scene(arguments) => scene::execute(arguments, output),
    }
}

/// Returns the requested format, or that of the extension of the output; `formats` lists their extensions.
///
/// # Errors
/// When the two contradict each other, or there is neither.
fn format_of<F: Copy + PartialEq + ValueEnum>(
    requested: Option<F>,
    output: &Path,
    formats: &[(F, &[&str])],
) -> Result<F, CliError> {
    let name = |format: F| {
        format
            .to_possible_value()
            .map_or_else(String::new, |value| value.get_name().to_owned())
    };
    let extension = output.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let known = formats.iter().find(|(_, extensions)| extensions.contains(&extension));
    match (requested, known) {
        (Some(format), Some((other, _))) if format != *other => Err(CliError::bad_input(format!(
            "--format {} contradicts the extension .{extension}",
            name(format)
        ))),
        (Some(format), _) => Ok(format),
        (None, Some((format, _))) => Ok(*format),
        (None, None) => {
            let names: Vec<String> = formats.iter().map(|(format, _)| name(*format)).collect();
            Err(CliError::bad_input(match extension {
                "" => "no format given".to_owned(),
                other => format!("unknown format .{other}"),
            })
            .help(format!(
                "use --format, or a file with the extension of one of: {}",
                names.join(", ")
            )))
        }
    }
}
