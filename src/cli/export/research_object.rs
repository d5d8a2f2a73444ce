//! `deaflow export crate`: a pipeline with all that it made, as a research object that others can check and run again.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

use clap::Args;
use serde_json::json;

use crate::arguments::{SetArguments, StoreArguments};
use crate::error::CliError;
use crate::examples::examples;
use crate::output::{Exit, Output};
use crate::progress::Bar;
use crate::{locate, run, table, write};
use deaflow_base::{ArtifactId, Document, NodeValue, folder_of, kind_of, leads_nowhere_at, read_bounded, software};
use deaflow_orchestrator::{BuiltStage, BuiltStages, Pipeline, built_stages};
use deaflow_report::{CrateFile, CrateStage, METADATA, ResearchObject, figure_files, file_name};
use deaflow_scene::scene_files;
use deaflow_store::{LockFile, Store, write_standalone};

/// The longest file of a pipeline or a scene, bytes, as they are read.
const LONGEST: u64 = 4 << 20;

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow export crate pipeline.yaml -o published --license CC-BY-4.0"))]
pub struct ExportCrateArguments {
    /// The pipeline, a YAML file; all of its stages must be built
    pub pipeline: PathBuf,
    /// The folder to make; an empty one may be there
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// The licence of the data: an address, such as spdx.org/licenses/CC-BY-4.0, or words
    #[arg(long, value_name = "TEXT", default_value = "not stated")]
    pub license: String,
    #[command(flatten)]
    pub store: StoreArguments,
    #[command(flatten)]
    pub set: SetArguments,
}

pub fn execute(arguments: &ExportCrateArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = run::load_with(&arguments.pipeline, &arguments.set)?;
    write::outside(&arguments.output)?;
    let folder = empty_folder(&arguments.output)?;
    let store = locate::existing_store(&arguments.store.folder_of(&arguments.pipeline))?;
    let built = built_stages(&pipeline, &store)?;
    if !built.missing.is_empty() {
        let path = pipeline.path.display();
        let sets = pipeline
            .overrides
            .iter()
            .map(|(path, value)| format!(" --set {path}={value:?}"));
        let sets: String = sets.collect();
        return Err(CliError::bad_input(format!("not built: {}", built.missing.join(", ")))
            .help(format!("build the rest first: deaflow run {path}{sets}")));
    }
    // All of it appears at once: what is made aside goes where anything fails.
    let aside = aside_of(&folder)?;
    let mut writing = Writing {
        root: aside.path(),
        bar: Bar::new("export", "chunks", chunks(&built, &store)?),
        files: Vec::new(),
    };
    let object = write_all(arguments, &pipeline, &built, &store, &mut writing)?;
    writing.bar.clear();
    let bytes = writing.files.iter().map(|file| file.size).sum();
    fs::rename(aside.path(), &folder).map_err(failed(&folder))?;
    if output.is_json() {
        output.document(&json!({
            "folder": arguments.output,
            "pipeline": object.name,
            "files": object.files.iter().map(|file| &file.path).collect::<Vec<_>>(),
            "bytes": bytes,
            "stages": object.stages.iter().map(|stage| json!({ "name": stage.name, "digest": stage.digest, "file": stage.file }))
                .collect::<Vec<_>>(),
        }))?;
    } else {
        let (files, stages) = (object.files.len() + 1, object.stages.len());
        output.text(format!(
            "{}: a research object of {stages} stages, {files} files ({})",
            arguments.output.display(),
            table::bytes(bytes)
        ))?;
    }
    Ok(Exit::Done)
}

/// Where the crate will be, links followed.
fn empty_folder(path: &Path) -> Result<PathBuf, CliError> {
    let refuse = |found: &str| {
        CliError::bad_input(format!("{} is {found}", path.display())).help("-o names a new or an empty folder")
    };
    if leads_nowhere_at(path) {
        return Err(refuse("a link that leads nowhere"));
    }
    let Ok(metadata) = fs::metadata(path) else {
        return match folder_of(path).is_dir() {
            true => Ok(path.to_owned()),
            false => Err(CliError::bad_input(format!(
                "there is no folder {}",
                folder_of(path).display()
            ))),
        };
    };
    if !metadata.is_dir() {
        return Err(refuse(kind_of(&metadata)));
    }
    if fs::read_dir(path).map_err(failed(path))?.next().is_some() {
        return Err(refuse("a folder that is not empty"));
    }
    fs::canonicalize(path).map_err(failed(path))
}

/// Chunks of all artifacts, each counted once.
fn chunks(built: &BuiltStages, store: &Store) -> Result<u64, CliError> {
    let artifacts: BTreeSet<ArtifactId> = built.stages.iter().map(|stage| stage.record.artifact).collect();
    let of = |id: &ArtifactId| Ok(store.artifact(id)?.parts().len().max(1) as u64);
    artifacts.iter().map(of).sum()
}

/// A folder in the same file system. Who may read it is for the user's mask to say.
fn aside_of(folder: &Path) -> Result<tempfile::TempDir, CliError> {
    use std::os::unix::fs::PermissionsExt;
    let mut builder = tempfile::Builder::new();
    let builder = builder.permissions(fs::Permissions::from_mode(0o777));
    builder.tempdir_in(folder_of(folder)).map_err(failed(folder))
}

fn failed(path: &Path) -> impl Fn(std::io::Error) -> CliError + '_ {
    |error| CliError::failure(format!("cannot write {}: {error}", path.display()))
}

/// The files of a crate, as they are written.
struct Writing<'a> {
    root: &'a Path,
    /// Chunks of artifacts.
    bar: Bar,
    files: Vec<CrateFile>,
}

impl Writing<'_> {
    /// Where a file goes, in a folder that is made; `path` has names only.
    fn place(&self, path: &str) -> Result<PathBuf, CliError> {
        let target = self.root.join(path);
        fs::create_dir_all(folder_of(&target)).map_err(failed(&target))?;
        Ok(target)
    }

    /// Takes note of a file that stands there.
    fn note(&mut self, path: &str, description: String, format: &'static str) -> Result<(), CliError> {
        let target = self.root.join(path);
        let size = fs::metadata(&target).map_err(failed(&target))?.len();
        self.files.push(CrateFile {
            path: path.to_owned(),
            description,
            format,
            size,
        });
        Ok(())
    }

    fn put(&mut self, path: &str, bytes: &[u8], description: &str, format: &'static str) -> Result<(), CliError> {
        let target = self.place(path)?;
        let mut file = fs::File::create_new(&target).map_err(failed(&target))?;
        std::io::Write::write_all(&mut file, bytes).map_err(failed(&target))?;
        file.sync_data().map_err(failed(&target))?;
        self.note(path, description.to_owned(), format)
    }
}

fn write_all(
    arguments: &ExportCrateArguments,
    pipeline: &Pipeline,
    built: &BuiltStages,
    store: &Store,
    writing: &mut Writing<'_>,
) -> Result<ResearchObject, CliError> {
    let (workflow, sources) = write_sources(pipeline, built, writing)?;
    let stages: Result<Vec<CrateStage>, CliError> = built
        .stages
        .iter()
        .map(|stage| write_stage(stage, pipeline, store, writing))
        .collect();
    let mut object = ResearchObject {
        name: pipeline.name.clone(),
        license: arguments.license.clone(),
        workflow,
        sources,
        overrides: pipeline.overrides.clone(),
        stages: stages?,
        files: Vec::new(),
    };
    writing.put(
        "README.md",
        object.readme().as_bytes(),
        "What is in this folder",
        "text/markdown",
    )?;
    object.files = writing.files.clone();
    let metadata = serde_json::to_string_pretty(&object.metadata()).map_err(|e| CliError::failure(e.to_string()))?;
    let target = writing.place(METADATA)?;
    fs::write(&target, metadata + "\n").map_err(failed(&target))?;
    Ok(object)
}

/// The pipeline, the scene that it names, and the lock file; gives the paths of the first and of the others that are read.
fn write_sources(
    pipeline: &Pipeline,
    built: &BuiltStages,
    writing: &mut Writing<'_>,
) -> Result<(String, Vec<String>), CliError> {
    const YAML: &str = "application/yaml";
    let read = |path: &Path| {
        let bytes = read_bounded(path, LONGEST);
        bytes.map_err(|error| CliError::failure(format!("cannot read {}: {error}", path.display())))
    };
    let name = pipeline
        .path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let workflow = format!("workflow/{name}");
    writing.put(&workflow, &read(&pipeline.path)?, "The pipeline", YAML)?;
    let mut sources = Vec::new();
    if let Some(scene) = scene_file(pipeline)? {
        let path = format!("workflow/{scene}");
        writing.put(
            &path,
            &read(&folder_of(&pipeline.path).join(&scene))?,
            "The scene of the pipeline",
            YAML,
        )?;
        sources.push(path);
    }
    for (number, file) in named_files(pipeline)?.into_iter().enumerate() {
        let path = format!("workflow/{file}");
        let source = folder_of(&pipeline.path).join(&file);
        let target = writing.place(&path)?;
        fs::copy(&source, &target).map_err(failed(&source))?;
        writing.note(
            &path,
            format!("File {} that stages read", number + 1),
            media_type(&file),
        )?;
        sources.push(path);
    }
    let lock = built.lock_file(&pipeline.name).text();
    let beside = LockFile::path_for(Path::new(&workflow)).to_string_lossy().into_owned();
    writing.put(
        &beside,
        lock.as_bytes(),
        "Keys and digests of all stages, to which `deaflow run --locked` holds a rerun",
        YAML,
    )?;
    Ok((workflow, sources))
}

/// The files that stages and the scene read, each once: paths below the folder of the pipeline.
fn named_files(pipeline: &Pipeline) -> Result<BTreeSet<String>, CliError> {
    let mut files: Vec<String> = pipeline.stages.iter().flat_map(|stage| stage.files.clone()).collect();
    files.extend(scene_files(&Document::load(&pipeline.path)?.root));
    if let Some(scene) = scene_file(pipeline)? {
        let document = Document::load(&folder_of(&pipeline.path).join(&scene))?;
        let beside = |file: String| Path::new(&scene).with_file_name(file).to_string_lossy().into_owned();
        files.extend(scene_files(&document.root).into_iter().map(beside));
    }
    files.iter().map(|file| below("the file", file)).collect()
}

fn media_type(file: &str) -> &'static str {
    match Path::new(file).extension().and_then(|extension| extension.to_str()) {
        Some("csv") => "text/csv",
        Some("png") => "image/png",
        Some("h5" | "hdf5") => "application/x-hdf5",
        Some("npz") => "application/zip",
        _ => "application/octet-stream",
    }
}

/// The file of the scene, where the pipeline names one: a path below its own folder.
fn scene_file(pipeline: &Pipeline) -> Result<Option<String>, CliError> {
    let document = Document::load(&pipeline.path)?;
    let Some(node) = document
        .root
        .peek("scene")
        .filter(|node| matches!(node.value(), NodeValue::Text(_)))
    else {
        return Ok(None);
    };
    below("the scene's file", node.text("scene")?).map(Some)
}

/// A path by folders and a name alone.
fn below(what: &str, named: &str) -> Result<String, CliError> {
    let steps: Vec<Component<'_>> = Path::new(named)
        .components()
        .filter(|step| *step != Component::CurDir)
        .collect();
    if steps.iter().any(|step| !matches!(step, Component::Normal(_))) {
        return Err(
            CliError::bad_input(format!("{what} {named} is not named by folders and a name alone"))
                .help("name it without `..`: a crate holds it in the same place"),
        );
    }
    let steps: Vec<_> = steps.iter().map(|step| step.as_os_str().to_string_lossy()).collect();
    Ok(steps.join("/"))
}

fn write_stage(
    stage: &BuiltStage,
    pipeline: &Pipeline,
    store: &Store,
    writing: &mut Writing<'_>,
) -> Result<CrateStage, CliError> {
    let artifact = store.artifact(&stage.record.artifact)?;
    let ancestry = store.ancestry(&artifact)?;
    let digest = stage.record.artifact.to_string();
    let path = format!("artifacts/{}-{digest:.12}.h5", file_name(&stage.name));
    if !writing.files.iter().any(|file| file.path == path) {
        write_standalone(&writing.place(&path)?, &artifact, &ancestry, &software(), &writing.bar)?;
        writing.note(
            &path,
            format!("What the stage {} of kind {} made", stage.name, stage.kind),
            "application/x-hdf5",
        )?;
    }
    let mut figures = Vec::new();
    for figure in figure_files(store, &pipeline.file(), &pipeline.name, &stage.name, &digest) {
        let name = figure.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let path = format!("figures/{name}");
        fs::copy(&figure, writing.place(&path)?).map_err(failed(&figure))?;
        writing.note(&path, format!("Figure of the stage {}", stage.name), "image/png")?;
        figures.push(path);
    }
    let own = artifact.provenance()?;
    let told = |name: &str| own.get(name).cloned().unwrap_or_default();
    Ok(CrateStage {
        name: stage.name.clone(),
        kind: stage.kind.to_owned(),
        needs: stage.needs.clone(),
        file: path,
        digest,
        key: stage.record.key.to_string(),
        parameters: stage.record.action.parameters.to_string(),
        times: [
            began(&stage.record.created, stage.record.seconds),
            stage.record.created.clone(),
        ],
        host: told("host"),
        program: [stage.record.version.clone(), told("build")],
        figures,
    })
}

/// When work began that ended at a time and took so many seconds; the end where that cannot be said.
fn began(ended: &str, seconds: f64) -> String {
    let begin = || {
        let ended = humantime::parse_rfc3339(ended).ok()?;
        let took = std::time::Duration::try_from_secs_f64(seconds).ok()?;
        Some(humantime::format_rfc3339_millis(ended.checked_sub(took)?).to_string())
    };
    begin().unwrap_or_else(|| ended.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_began_before_it_ended() {
        assert_eq!(began("2026-01-01T00:00:01.500Z", 1.25), "2026-01-01T00:00:00.250Z");
        assert_eq!(began("2026-01-01T00:00:01.500Z", f64::NAN), "2026-01-01T00:00:01.500Z");
        assert_eq!(began("noon", 1.0), "noon");
    }

    #[test]
    fn only_new_and_empty_folders_are_filled() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("empty")).unwrap();
        fs::create_dir(at("full")).unwrap();
        fs::write(at("full/note"), "").unwrap();
        fs::write(at("file"), "").unwrap();
        std::os::unix::fs::symlink("nothing", at("dangling")).unwrap();
        assert_eq!(empty_folder(&at("new")).unwrap(), at("new"));
        assert!(empty_folder(&at("empty")).is_ok());
        for (name, said) in [
            ("full", "not empty"),
            ("file", "a regular file"),
            ("dangling", "leads nowhere"),
            ("none/new", "no folder"),
        ] {
            let error = empty_folder(&at(name)).unwrap_err();
            assert!(error.message().contains(said), "{name}: {}", error.message());
        }
    }
}
