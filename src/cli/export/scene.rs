//! `deaflow export scene`: the scene of an artifact, such as a fitted one, as a file.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use crate::arguments::StoreArguments;
use crate::{CliError, Exit, Output, locate, pipeline, write};
use deaflow_base::Override;
use deaflow_content::StoredAttribute;
use deaflow_scene::{Scene, Tolerances};
use deaflow_store::Store;

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

/// The kind of stage whose scene is its result.
const FIT: &str = "fit";

/// Returns the scene and the tolerances of a stage of a pipeline that is named, or that ran last with such a stage, if
/// it is the scene of its artifact, with what the stage does not read.
fn in_pipeline(
    store: &Store,
    reference: &str,
    of_artifact: &Scene,
) -> Result<Option<(Scene, Option<Tolerances>)>, CliError> {
    let (path, stage, sets) = match locate::split(reference) {
        Some((path, stage)) => (PathBuf::from(path), stage.to_owned(), Vec::new()),
        None => {
            let named = reference.rsplit_once(':');
            let (stage, pipeline) = named.map_or((reference, None), |(pipeline, stage)| (stage, Some(pipeline)));
            let Some(run) = store.last_run_with(stage, pipeline)? else {
                return Ok(None);
            };
            let sets = run.overrides.iter().map(|(path, value)| format!("{path}={value}"));
            (PathBuf::from(&run.path), stage.to_owned(), sets.collect())
        }
    };
    let read = || {
        let sets = sets.iter().map(|set| Override::parse(set));
        let file = pipeline::load_file(&path, &sets.collect::<Result<Vec<_>, _>>()?, true)?;
        let of_sweep = file.sweep(&stage).and_then(|sweep| sweep.stages.first());
        let name = of_sweep.unwrap_or(&stage);
        let Some(scene) = file
            .stages
            .iter()
            .find(|spec| spec.name == *name)
            .and_then(|spec| file.scene_of(spec))
        else {
            return Ok(None);
        };
        Ok::<_, CliError>(Some((Scene::read(&scene)?, Tolerances::of_scene(&scene)?)))
    };
    // The file may have been changed or removed since.
    let found = read().ok().flatten();
    let is_same = |scene: &Scene| scene.without_time().differences(&of_artifact.without_time()).is_empty();
    Ok(found.filter(|(scene, _)| is_same(scene)))
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
    let (scene, tolerances) = match kind {
        // That of a fit is complete.
        FIT => (scene, tolerances),
        _ => match in_pipeline(&store, &arguments.artifact, &scene)? {
            Some((all, of_file)) => (all, tolerances.or(of_file)),
            None => {
                output.warn(
                    "the artifact has what its stage reads of the scene, perhaps without `properties`, the time course \
                     of the drive and `tolerances`; a pipeline with the same scene was not found",
                );
                (scene, tolerances)
            }
        },
    };
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
