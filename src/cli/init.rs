//! `deaflow init`: writes a small pipeline to start with.

use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::{CliError, Exit, Output, write};
use deaflow_base::is_plain_name;
use deaflow_orchestrator::{pipeline_schema, scene_schema};
use deaflow_stage as stage;
use deaflow_store::Store;

/// The pipeline, with [`NAME`] in place of its name.
const PIPELINE: &str = include_str!("init/pipeline.yaml");

/// Its scene.
const SCENE: &str = include_str!("init/scene.yaml");

/// The line of the pipeline with its name.
const NAME: &str = "name: \"demo\"";

/// The patterns of `.gitignore`: artifacts can be built again.
const IGNORED: &str = "/store/\n";

/// The largest length of the name of a pipeline.
const MAX_NAME: usize = 200;

/// Write a small, commented pipeline to start with
#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow init demo", "deaflow run demo/pipeline.yaml"))]
pub struct InitArguments {
    /// The folder; it is created if missing [default: the current folder]
    #[arg(value_name = "NAME")]
    pub folder: Option<PathBuf>,
}

pub fn execute(arguments: &InitArguments, output: &Output) -> Result<Exit, CliError> {
    let here = Path::new("");
    let folder = arguments.folder.as_deref().unwrap_or(here);
    if folder.is_file() {
        let name = folder
            .parent()
            .filter(|parent| !parent.as_os_str().is_empty())
            .unwrap_or(Path::new("NAME"));
        return Err(
            CliError::bad_input(format!("{} is a file, not a folder", folder.display()))
                .help(format!("deaflow init {}", name.display())),
        );
    }
    // The folder itself may not exist yet.
    let there = folder.ancestors().find(|folder| folder.is_dir()).unwrap_or(here);
    write::outside(&there.join("pipeline.yaml"))?;
    let files: Vec<(PathBuf, String)> = files(folder)
        .into_iter()
        .map(|(name, text)| (folder.join(name), text))
        .collect();
    // Checked before the first is written.
    if let Some((taken, _)) = files.iter().find(|(file, _)| file.symlink_metadata().is_ok()) {
        return Err(exists_error(taken));
    }
    let (store, schema) = (folder.join("store"), folder.join("schema"));
    Store::check_folder(&store)?;
    let new = [folder, &schema, &store].map(|folder| folder.symlink_metadata().is_err());
    write::folder(&schema)?;
    // With a store, commands find it from all folders of the project.
    let mut created = Vec::new();
    let mut written = files
        .iter()
        .try_for_each(|(file, text)| create(file, text, &mut created));
    if written.is_ok() {
        written = Store::open(&store).map(drop).map_err(CliError::from);
    }
    if let Err(error) = written {
        // The next attempt must not find a part of a project. What cannot be removed stays.
        created.iter().for_each(|file| drop(fs::remove_file(file)));
        let [is_new, is_new_schema, is_new_store] = new;
        if is_new_store {
            let _ = fs::remove_dir_all(&store);
        }
        for (folder, is_new) in [(schema.as_path(), is_new_schema), (folder, is_new)] {
            // A folder with other files stays.
            if is_new {
                let _ = fs::remove_dir(folder);
            }
        }
        return Err(error);
    }
    let paths: Vec<&Path> = files.iter().map(|(file, _)| file.as_path()).collect();
    let next = next(folder);
    output.result(
        || json!({ "files": paths, "store": store, "next": next }),
        || {
            let files = paths.iter().copied().chain([store.as_path()]);
            let files: String = files.map(|path| format!("wrote {}\n", path.display())).collect();
            let next: String = next.iter().map(|command| format!("  {command}\n")).collect();
            format!("{files}\nnext:\n{next}")
        },
    )
}

/// Returns the names and contents of the files.
fn files(folder: &Path) -> Vec<(&'static str, String)> {
    let registry = stage::registry();
    vec![
        (
            "pipeline.yaml",
            PIPELINE.replacen(NAME, &format!("name: {:?}", name(folder)), 1),
        ),
        ("scene.yaml", SCENE.to_owned()),
        ("schema/pipeline.json", schema(&pipeline_schema(&registry))),
        ("schema/scene.json", schema(&scene_schema(&registry))),
        (".gitignore", IGNORED.to_owned()),
    ]
}

/// Formats a schema as `deaflow schema` does.
fn schema(schema: &Value) -> String {
    format!("{schema:#}\n")
}

/// Returns the name of the pipeline: that of its folder, if it is a valid name.
fn name(folder: &Path) -> String {
    let path = Path::new(".").join(folder).canonicalize();
    let path = path.unwrap_or_else(|_| folder.to_owned());
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    match is_plain_name(name, MAX_NAME) {
        true => name.to_owned(),
        false => "demo".to_owned(),
    }
}

/// Writes a new file. `created` receives it once it exists.
fn create<'a>(path: &'a Path, text: &str, created: &mut Vec<&'a Path>) -> Result<(), CliError> {
    let made = OpenOptions::new().write(true).create_new(true).open(path);
    let written = made.and_then(|mut file| {
        created.push(path);
        file.write_all(text.as_bytes())
    });
    written.map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => exists_error(path),
        _ => CliError::failure(format!("cannot write {}: {error}", path.display())),
    })
}

fn exists_error(path: &Path) -> CliError {
    CliError::bad_input(format!("{} already exists", path.display())).help("name another folder: deaflow init NAME")
}

/// Suggests the next commands.
fn next(folder: &Path) -> Vec<String> {
    let pipeline = folder.join("pipeline.yaml").to_string_lossy().into_owned();
    let pipeline = shlex::try_quote(&pipeline).map_or_else(|_| pipeline.clone(), |quoted| quoted.into_owned());
    vec![
        format!("deaflow plan {pipeline}"),
        format!("deaflow run {pipeline}"),
        format!("deaflow report {pipeline} -o report"),
    ]
}
