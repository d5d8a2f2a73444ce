//! `deaflow export crate`: a pipeline with all its results, as a research object that others can check and run again.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

use clap::Args;
use serde_json::json;

use crate::arguments::{SetArguments, StoreArguments};
use crate::progress::Bar;
use crate::{CliError, Exit, Output, locate, pipeline, table, write};
use deaflow_base::{
    ArtifactId, Document, Node, NodeValue, TemporaryOutput, folder_of, is_dangling_link, kind_of, read_bounded,
    software,
};
use deaflow_orchestrator::{BuiltStage, BuiltStages, Pipeline, built_stages};
use deaflow_report::{CrateFile, CrateStage, METADATA, ResearchObject, figure_files, file_name, set_options};
use deaflow_scene::{material_file, scene_files};
use deaflow_store::{LockFile, Store, write_standalone};

/// The largest file of a pipeline or a scene, bytes.
const MAX_BYTES: u64 = 4 << 20;

#[derive(Debug, Args)]
#[command(after_help = examples!("deaflow export crate pipeline.yaml -o published --license CC-BY-4.0"))]
pub struct ExportCrateArguments {
    /// The pipeline, a YAML file; all its stages must be built
    pub pipeline: PathBuf,
    /// The folder to create; an existing one must be empty
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// The licence of the data: a URL, such as spdx.org/licenses/CC-BY-4.0, or text
    #[arg(long, value_name = "TEXT", default_value = "not stated")]
    pub license: String,
    #[command(flatten)]
    pub store: StoreArguments,
    #[command(flatten)]
    pub set: SetArguments,
}

pub fn execute(arguments: &ExportCrateArguments, output: &Output) -> Result<Exit, CliError> {
    let pipeline = pipeline::load_with(&arguments.pipeline, &arguments.set)?;
    write::outside(&arguments.output)?;
    let folder = empty_folder(&arguments.output)?;
    write::check_hdf5(&folder)?;
    let store = locate::existing_store(&arguments.store.folder_of(&arguments.pipeline))?;
    let built = built_stages(&pipeline, &store)?;
    if !built.missing.is_empty() {
        let path = pipeline.path.display();
        let sets = set_options(&pipeline.overrides);
        return Err(CliError::bad_input(format!("not built: {}", built.missing.join(", ")))
            .help(format!("build them first: deaflow run {path}{sets}")));
    }
    // Written to a temporary folder first: the crate appears complete or not at all.
    let temporary = TemporaryOutput::inside(folder_of(&folder)).map_err(failed(&folder))?;
    let mut writer = CrateWriter {
        root: temporary.path(),
        bar: Bar::new("export", "chunks", chunks(&built, &store)?),
        files: Vec::new(),
    };
    let object = write_all(arguments, &pipeline, &built, &store, &mut writer)?;
    writer.bar.clear();
    let bytes = writer.files.iter().map(|file| file.size).sum();
    fs::rename(temporary.path(), &folder).map_err(failed(&folder))?;
    let stage = |stage: &CrateStage| json!({ "name": stage.name, "digest": stage.digest, "file": stage.file });
    let document = || {
        json!({
            "folder": arguments.output,
            "pipeline": object.name,
            "files": object.files.iter().map(|file| &file.path).collect::<Vec<_>>(),
            "bytes": bytes,
            "stages": object.stages.iter().map(stage).collect::<Vec<_>>(),
        })
    };
    output.result(document, || {
        format!(
            "{}: a research object of {}, {} ({})",
            arguments.output.display(),
            table::counted(object.stages.len() as u64, "stages"),
            table::counted(object.files.len() as u64 + 1, "files"),
            table::bytes(bytes)
        )
    })
}

/// Returns the folder of the crate, with links resolved.
fn empty_folder(path: &Path) -> Result<PathBuf, CliError> {
    let refuse = |found: &str| {
        CliError::bad_input(format!("{} is {found}", path.display())).help("name a new or an empty folder with -o")
    };
    if is_dangling_link(path) {
        return Err(refuse("a broken link"));
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

/// Counts the chunks of all artifacts, each once.
fn chunks(built: &BuiltStages, store: &Store) -> Result<u64, CliError> {
    let artifacts: BTreeSet<ArtifactId> = built.stages.iter().map(|stage| stage.record.artifact).collect();
    let of = |id: &ArtifactId| Ok(store.artifact(id)?.parts().len().max(1) as u64);
    artifacts.iter().map(of).sum()
}

fn failed(path: &Path) -> impl Fn(std::io::Error) -> CliError + '_ {
    |error| CliError::failure(format!("cannot write {}: {error}", path.display()))
}

/// Writes the files of a crate.
struct CrateWriter<'a> {
    root: &'a Path,
    /// The progress in chunks of artifacts.
    bar: Bar,
    files: Vec<CrateFile>,
}

impl CrateWriter<'_> {
    /// Returns the path of a file in the crate, whose folder is created.
    fn target(&self, path: &str) -> Result<PathBuf, CliError> {
        let target = self.root.join(path);
        fs::create_dir_all(folder_of(&target)).map_err(failed(&target))?;
        Ok(target)
    }

    /// Adds a written file to the list.
    fn add(&mut self, path: &str, description: String, format: &'static str) -> Result<(), CliError> {
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
        let target = self.target(path)?;
        let mut file = fs::File::create_new(&target).map_err(failed(&target))?;
        std::io::Write::write_all(&mut file, bytes).map_err(failed(&target))?;
        file.sync_data().map_err(failed(&target))?;
        self.add(path, description.to_owned(), format)
    }
}

fn write_all(
    arguments: &ExportCrateArguments,
    pipeline: &Pipeline,
    built: &BuiltStages,
    store: &Store,
    writer: &mut CrateWriter<'_>,
) -> Result<ResearchObject, CliError> {
    let (workflow, sources) = write_sources(pipeline, built, writer)?;
    let stages: Result<Vec<CrateStage>, CliError> = built
        .stages
        .iter()
        .map(|stage| write_stage(stage, pipeline, store, writer))
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
    writer.put(
        "README.md",
        object.readme().as_bytes(),
        "What is in this folder",
        "text/markdown",
    )?;
    object.files = writer.files.clone();
    let metadata = serde_json::to_string_pretty(&object.metadata()).map_err(|e| CliError::failure(e.to_string()))?;
    let target = writer.target(METADATA)?;
    fs::write(&target, metadata + "\n").map_err(failed(&target))?;
    Ok(object)
}

/// Writes the pipeline, the files that it reads, and the lock file; returns the path of the pipeline and of the files.
fn write_sources(
    pipeline: &Pipeline,
    built: &BuiltStages,
    writer: &mut CrateWriter<'_>,
) -> Result<(String, Vec<String>), CliError> {
    const YAML: &str = "application/yaml";
    let read = |path: &Path| {
        let bytes = read_bounded(path, MAX_BYTES);
        bytes.map_err(|error| CliError::failure(format!("cannot read {}: {error}", path.display())))
    };
    let name = pipeline
        .path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let workflow = format!("workflow/{name}");
    writer.put(&workflow, &read(&pipeline.path)?, "The pipeline", YAML)?;
    let mut sources = Vec::new();
    if let Some(scene) = scene_file(pipeline)? {
        let path = format!("workflow/{scene}");
        writer.put(
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
        let target = writer.target(&path)?;
        fs::copy(&source, &target).map_err(failed(&source))?;
        writer.add(
            &path,
            format!("File {} that stages read", number + 1),
            media_type(&file),
        )?;
        sources.push(path);
    }
    let lock = built.lock_file(&pipeline.name).text();
    let beside = LockFile::path_for(Path::new(&workflow)).to_string_lossy().into_owned();
    writer.put(
        &beside,
        lock.as_bytes(),
        "Keys and digests of all stages; `deaflow run --locked` compares a rerun with them",
        YAML,
    )?;
    Ok((workflow, sources))
}

/// Returns the files that stages and the scene read: paths below the folder of the pipeline.
fn named_files(pipeline: &Pipeline) -> Result<BTreeSet<String>, CliError> {
    let mut files: Vec<String> = pipeline.stages.iter().flat_map(|stage| stage.files.clone()).collect();
    files.extend(scene_files(&Document::load(&pipeline.path)?.root));
    if let Some(scene) = scene_file(pipeline)? {
        let document = Document::load(&folder_of(&pipeline.path).join(&scene))?;
        let beside = |file: String| Path::new(&scene).with_file_name(file).to_string_lossy().into_owned();
        files.extend(scene_files(&document.root).into_iter().map(beside));
    }
    // The name of a material with an axis of a sweep stands for several files, which the scenes of the stages have read.
    if let Some(named) = pipeline.scene.as_ref().and_then(material_file) {
        let named = named.text("from")?;
        files.retain(|file| !file.ends_with(named));
        let scenes = pipeline.stages.iter().filter_map(|stage| stage.scene.as_ref());
        let materials = scenes.filter_map(|scene| scene.peek("material").map(Node::file));
        let folder = folder_of(&pipeline.path);
        let below_folder = materials.map(|file| file.strip_prefix(folder).unwrap_or(file));
        files.extend(below_folder.map(|file| file.to_string_lossy().into_owned()));
    }
    files.iter().map(|file| below("the file", file)).collect()
}

fn media_type(file: &str) -> &'static str {
    match Path::new(file).extension().and_then(|extension| extension.to_str()) {
        Some("csv") => "text/csv",
        Some("png") => "image/png",
        Some("jpg" | "jpeg") => "image/jpeg",
        Some("tif" | "tiff") => "image/tiff",
        Some("bmp") => "image/bmp",
        Some("dxf") => "image/vnd.dxf",
        Some("svg") => "image/svg+xml",
        Some("h5" | "hdf5") => "application/x-hdf5",
        Some("npz") => "application/zip",
        _ => "application/octet-stream",
    }
}

/// Returns the file of the scene, if the pipeline names one: a path below its own folder.
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

/// Normalizes a path, which must be below the folder of the pipeline.
fn below(what: &str, named: &str) -> Result<String, CliError> {
    let steps: Vec<Component<'_>> = Path::new(named)
        .components()
        .filter(|step| *step != Component::CurDir)
        .collect();
    if steps.iter().any(|step| !matches!(step, Component::Normal(_))) {
        return Err(
            CliError::bad_input(format!("{what} {named} is not below the folder of the pipeline"))
                .help("use a relative path without `..`: the crate has the same folders"),
        );
    }
    let steps: Vec<_> = steps.iter().map(|step| step.as_os_str().to_string_lossy()).collect();
    Ok(steps.join("/"))
}

fn write_stage(
    stage: &BuiltStage,
    pipeline: &Pipeline,
    store: &Store,
    writer: &mut CrateWriter<'_>,
) -> Result<CrateStage, CliError> {
    let artifact = store.artifact(&stage.record.artifact)?;
    let ancestry = store.ancestry(&artifact)?;
    let digest = stage.record.artifact.to_string();
    let path = format!("artifacts/{}-{digest:.12}.h5", file_name(&stage.name));
    if !writer.files.iter().any(|file| file.path == path) {
        write_standalone(&writer.target(&path)?, &artifact, &ancestry, &software(), &writer.bar)?;
        writer.add(
            &path,
            format!("Result of the stage {} of kind {}", stage.name, stage.kind),
            "application/x-hdf5",
        )?;
    }
    let mut figures = Vec::new();
    for figure in figure_files(store, &pipeline.file(), &pipeline.name, &stage.name, &digest) {
        let name = figure.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let path = format!("figures/{name}");
        fs::copy(&figure, writer.target(&path)?).map_err(failed(&figure))?;
        writer.add(&path, format!("Figure of the stage {}", stage.name), "image/png")?;
        figures.push(path);
    }
    let own = artifact.provenance()?;
    let provenance = |name: &str| own.get(name).cloned().unwrap_or_default();
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
        host: provenance("host"),
        program: [stage.record.version.clone(), provenance("build")],
        figures,
    })
}

/// Returns when work began that ended at a time and took this long; the end if that is not known.
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
        for (name, found) in [
            ("full", "not empty"),
            ("file", "a regular file"),
            ("dangling", "broken link"),
            ("none/new", "no folder"),
        ] {
            let error = empty_folder(&at(name)).unwrap_err();
            assert!(error.message().contains(found), "{name}: {}", error.message());
        }
    }
}
