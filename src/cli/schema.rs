//! `deaflow schema`: the JSON Schema of pipelines or scenes, for completion and checks in editors; and the arrays of
//! artifacts.

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::{CliError, Exit, Output};
use deaflow_content::{ContentOfKind, Declared, catalogue};
use deaflow_orchestrator::{pipeline_schema, scene_schema};
use deaflow_stage as stage;

/// Print the JSON Schema of pipelines or scenes, or the arrays of artifacts
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow schema > schema/pipeline.json", "deaflow schema scene > schema/scene.json"))]
pub struct SchemaArguments {
    /// What to describe
    #[arg(value_enum, default_value_t = SchemaOf::Pipeline)]
    pub of: SchemaOf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum SchemaOf {
    /// Pipelines
    Pipeline,
    /// Scenes in separate files
    Scene,
    /// Arrays and attributes of artifacts
    Artifacts,
}

pub fn execute(arguments: &SchemaArguments, output: &Output) -> Result<Exit, CliError> {
    let registry = stage::registry();
    output.document(&match arguments.of {
        SchemaOf::Pipeline => pipeline_schema(&registry),
        SchemaOf::Scene => scene_schema(&registry),
        SchemaOf::Artifacts => catalogue().iter().map(of_kind).collect(),
    })?;
    Ok(Exit::Done)
}

fn of_kind(kind: &ContentOfKind) -> Value {
    let attribute = |(name, description): &(&str, &str)| json!({ "name": name, "description": description });
    json!({
        "kind": kind.name,
        "arrays": kind.arrays.iter().map(of_array).collect::<Vec<_>>(),
        "attributes": kind.attributes.iter().map(attribute).collect::<Vec<_>>(),
    })
}

/// Describes an array. Extents are those of the last axes; the others differ between artifacts.
fn of_array(array: &Declared) -> Value {
    json!({
        "path": array.path,
        "type": array.element.name(),
        "units": array.units,
        "axes": array.axes,
        "extents": array.extents,
        "description": array.description,
        "optional": array.optional,
    })
}
