//! `deaflow export scene`: the scene of an artifact, such as a fitted one, as a file.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::arguments::StoreArguments;
use crate::{CliError, Exit, Output, locate, write};
use deaflow_content::StoredAttribute;
use deaflow_scene::{Scene, Tolerances};

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow export scene fitted -o fitted.yaml"))]
pub struct ExportSceneArguments {
    /// A stage of the last run that has a scene, PIPELINE.yaml:STAGE, or a digest or its first digits, at least 4
    #[arg(value_name = "STAGE-OR-DIGEST")]
    pub artifact: String,
    /// The output; an existing file is replaced
    #[arg(short, long, value_name = "FILE.yaml")]
    pub output: PathBuf,
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &ExportSceneArguments, output: &Output) -> Result<Exit, CliError> {
    write::check_output(&arguments.output, std::slice::from_ref(&arguments.artifact))?;
    let store = locate::existing_store(&arguments.store.folder_of_any([&arguments.artifact]))?;
    let artifact = locate::artifact(&store, &arguments.artifact)?;
    let (digest, kind) = (artifact.digest(), artifact.kind());
    let scene: Option<Scene> = StoredAttribute::new(&artifact, "scene").read()?;
    let scene = scene.ok_or_else(|| {
        CliError::bad_input(format!("artifact {} of kind `{kind}` has no scene", digest.short()))
            .help("name a stage of kind fit, compare, solve, import, train, design or verify")
    })?;
    let tolerances: Option<Tolerances> = StoredAttribute::new(&artifact, "tolerances").read()?;
    let text = format!(
        "# The scene of artifact {} ({kind}).\n{}",
        digest.short(),
        scene.to_yaml_with(tolerances.as_ref())
    );
    write::file(&arguments.output, text.as_bytes())?;
    let document = || {
        json!({
            "file": arguments.output,
            "artifact": digest.to_string(),
            "scene": scene.to_text_with(tolerances.as_ref()),
        })
    };
    output.result(document, || {
        format!("{}: scene of artifact {}", arguments.output.display(), digest.short())
    })
}
