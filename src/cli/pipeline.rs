//! Reads pipelines and lock files, and opens stores, for the commands that name a pipeline.

use std::path::Path;

use tempfile::TempDir;

use super::arguments::{PipelineArguments, SetArguments};
use super::{CliError, Output};
use deaflow_base::{Document, Override};
use deaflow_orchestrator::{MANY_STAGES, Pipeline};
use deaflow_scene::Scene;
use deaflow_stage as stage;
use deaflow_stage::direct::ReadScene;
use deaflow_store::{LockFile, Store};

/// Reads a pipeline and checks that it has the stage of `--until`, before a store is opened.
///
/// # Errors
/// When an argument or the pipeline is invalid.
pub fn load(arguments: &PipelineArguments) -> Result<Pipeline, CliError> {
    let pipeline = load_with(&arguments.pipeline, &arguments.set)?;
    pipeline.selection(arguments.until.as_deref())?;
    Ok(pipeline)
}

/// Reads a pipeline with the overrides of the command line.
///
/// # Errors
/// As [`load`].
pub fn load_with(path: &Path, set: &SetArguments) -> Result<Pipeline, CliError> {
    load_file(path, &set.overrides()?, set.many)
}

/// Reads a pipeline with overrides; `many` allows more stages than usual.
///
/// # Errors
/// As [`load`].
pub fn load_file(path: &Path, overrides: &[Override], many: bool) -> Result<Pipeline, CliError> {
    let mut registry = stage::registry();
    if many {
        registry.most_stages = MANY_STAGES;
    }
    Ok(Pipeline::load(path, overrides, &registry)?)
}

/// Reads a pipeline without overrides, for a command that only looks at it.
///
/// # Errors
/// As [`load`].
pub fn load_plain(path: &Path) -> Result<Pipeline, CliError> {
    load_file(path, &[], true)
}

/// Returns the name of a pipeline, by which its runs are found after its file was moved; empty if it cannot be read.
pub fn name_in(path: &Path) -> String {
    load_plain(path).map_or_else(|_| String::new(), |pipeline| pipeline.name)
}

/// Reads the scene in a file, and prints how numbers without a unit in it are read.
///
/// # Errors
/// When it cannot be read.
pub fn read_scene(path: &Path, output: &Output) -> Result<Scene, CliError> {
    read_scene_with(path, &[], output)
}

/// Like [`read_scene`], with the overrides of the command line.
///
/// # Errors
/// As [`read_scene`], and when an override is invalid.
pub fn read_scene_with(path: &Path, sets: &[String], output: &Output) -> Result<Scene, CliError> {
    let read = stage::direct::read_scene_with(path, stage::direct::Changes { sets, voltage: None })?;
    warn_of_scene(&read, output);
    Ok(read.scene)
}

/// Prints how numbers without a unit in a scene were read, and what was ignored in its drawings.
pub fn warn_of_scene(read: &ReadScene, output: &Output) {
    read.bare_numbers.iter().for_each(|note| output.warn_of_units(note));
    read.scene.geometry.notes().iter().for_each(|note| output.warn(note));
}

/// Prints how numbers without a unit in the value of an option were read, after it was read.
pub fn warn_of_units(document: &Document, output: &Output) {
    note_on_units(document)
        .into_iter()
        .for_each(|note| output.warn_of_units(note));
}

/// Returns how numbers without a unit in the value of an option were read, after it was read; `None` if all have one.
pub fn note_on_units(document: &Document) -> Option<String> {
    let note = document.root.bare_numbers()?;
    Some(format!("{}: {note}", document.root.file().display()))
}

/// Reads a lock file.
///
/// # Errors
/// When there is none, or it is invalid.
pub fn read_lock(path: &Path) -> Result<LockFile, CliError> {
    if !path.exists() {
        return Err(CliError::bad_input(format!("there is no lock file {}", path.display()))
            .help("write it with `deaflow run --lock`"));
    }
    Ok(LockFile::read(path)?)
}

/// Opens a store for a command that writes nothing to it. If there is none, opens an empty store in a temporary folder,
/// which is
/// deleted when it is dropped.
///
/// # Errors
/// When the store cannot be opened.
pub fn store_to_read(folder: &Path) -> Result<(Option<TempDir>, Store), CliError> {
    let scratch = (!folder.exists()).then(tempfile::tempdir).transpose();
    let scratch = scratch.map_err(|e| CliError::failure(format!("cannot make a temporary folder: {e}")))?;
    let store = Store::open(scratch.as_ref().map_or(folder, |s| s.path()))?;
    Ok((scratch, store))
}
