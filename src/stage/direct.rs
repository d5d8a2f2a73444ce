//! Reads scenes and patterns that a command or a request names, outside a pipeline.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use deaflow_base::{Document, InputError, Node, Override};
use deaflow_content::named_patterns;
use deaflow_dataset::import::{ImportError, ImportFile, Rows};
use deaflow_orchestrator::{axes_in, splice_scene, with_scene_file};
use deaflow_pattern::{DrawingOptions, Pattern, PatternForm};
use deaflow_scene::{Scene, Tolerances, scene_files};

/// Why a direct simulation or prediction failed.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum DirectError {
    /// The scene or a pattern cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Input(#[from] InputError),
    /// The numerical work failed.
    #[error("{0}")]
    Failed(String),
}

/// The patterns of some arguments.
#[derive(Debug, Default)]
pub struct NamedPatterns {
    /// The patterns, in order.
    pub patterns: Vec<Pattern>,
    /// Their names: the argument, followed by the index if it has several patterns, `mine.npy[3]`.
    pub names: Vec<String>,
    /// What the readers did that a user should know, after the argument.
    pub notes: Vec<String>,
    /// The patterns with the shapes that were drawn, where cells stand for them.
    pub drawings: Vec<Pattern>,
}

/// Reads all patterns that the arguments name.
///
/// # Errors
/// If one cannot be read.
pub fn patterns(
    arguments: &[String],
    form: PatternForm,
    drawings: &DrawingOptions,
) -> Result<NamedPatterns, InputError> {
    let mut all = NamedPatterns::default();
    for argument in arguments {
        let found = named_patterns(argument, form, drawings)?;
        match found.patterns.len() {
            1 => all.names.push(argument.clone()),
            n => all.names.extend((0..n).map(|k| format!("{argument}[{k}]"))),
        }
        let drawn = |pattern: &Pattern| match &found.shapes {
            Some(shapes) => pattern.clone().with_electrodes(Some(shapes.clone())),
            None => pattern.clone(),
        };
        all.drawings.extend(found.patterns.iter().map(drawn));
        all.patterns.extend(found.patterns);
        all.notes
            .extend(found.notes.iter().map(|note| format!("{argument}: {note}")));
    }
    Ok(all)
}

/// Patterns with their fields, from a file of labels.
#[derive(Debug)]
pub struct Labels {
    /// The rows.
    pub rows: Rows,
    /// What the reader did that a user should know.
    pub notes: Vec<String>,
}

/// Reads a file of labels, as an `import` stage does; `None` if it has no fields.
///
/// # Errors
/// If it cannot be read, or a row is not a pattern with a field of the device.
pub fn labels(argument: &str, scene: &Scene) -> Result<Option<Labels>, InputError> {
    let device = Arc::new(crate::scene::device_of(scene));
    let refused = |why: ImportError| InputError::new(format!("{argument}: {why}")).help(why.help(&device));
    let file = match ImportFile::open(Path::new(argument), &device) {
        Err(why) if why.has_no_fields() => return Ok(None),
        file => file.map_err(refused)?,
    };
    Ok(Some(Labels {
        rows: file.rows(0..file.len()).map_err(refused)?,
        notes: file.notes(),
    }))
}

/// Lists the files of a scene or a pipeline: itself, the scene that it names, masks, drawings, tables of voltages and
/// materials. Files that cannot be read are skipped; reading the scene reports them.
#[must_use]
pub fn files_read(path: &Path) -> Vec<String> {
    let sibling = |file: &Path, name: String| file.with_file_name(name);
    let named = |file: &Path| -> Option<(Vec<PathBuf>, Option<PathBuf>)> {
        let root = Document::load(file).ok()?.root;
        let files = scene_files(&root).into_iter().map(|name| sibling(file, name)).collect();
        let scene = root.peek("scene").and_then(|scene| scene.text("scene").ok());
        Some((files, scene.map(|name| sibling(file, name.to_owned()))))
    };
    let mut files = vec![path.to_path_buf()];
    let (own, scene) = named(path).unwrap_or_default();
    files.extend(own);
    if let Some(scene) = scene {
        files.extend(named(&scene).unwrap_or_default().0);
        files.push(scene);
    }
    files
        .into_iter()
        .map(|file| file.to_string_lossy().into_owned())
        .collect()
}

/// Reads the scene in a file, which is a scene or a pipeline.
///
/// # Errors
/// If it cannot be read.
pub fn read_scene(path: &Path) -> Result<Scene, InputError> {
    Ok(read_scene_with(path, Changes::default())?.scene)
}

/// A scene from a file.
#[derive(Clone, Debug)]
pub struct ReadScene {
    /// The scene.
    pub scene: Scene,
    /// What differs from one device to the next.
    pub tolerances: Option<Tolerances>,
    /// How numbers without a unit were read; `None` if all have one.
    pub bare_numbers: Option<String>,
}

impl ReadScene {
    /// Returns what a user should know: how numbers without a unit were read, and what was ignored in drawings.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        self.bare_numbers
            .iter()
            .cloned()
            .chain(self.scene.geometry.notes())
            .collect()
    }
}

/// Whether a file has a scene, or cannot be read.
#[must_use]
pub fn names_scene(path: &Path) -> bool {
    let found = Document::load(path);
    found.map_or(true, |found| {
        found.root.peek("scene").is_some() || found.root.peek("stages").is_none()
    })
}

/// Returns the axes of the sweep that completes the scene in a file; none if it is complete, or cannot be read.
#[must_use]
pub fn axes_of_scene(path: &Path) -> Vec<String> {
    let axes = || {
        let mut root = Document::load(path).ok()?.root;
        splice_scene(&mut root, path, Vec::new(), crate::scene::complete).ok()?;
        Some(axes_in(root.peek("scene").unwrap_or(&root)))
    };
    axes().unwrap_or_default()
}

/// The values of a scene that a command overrides: those of `--set`, as in `drive.voltage=5 kV`, where the path may
/// start with `scene.` as in a pipeline; then that of `--voltage`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Changes<'a> {
    /// The values of `--set`.
    pub sets: &'a [String],
    /// The value of `--voltage`.
    pub voltage: Option<&'a str>,
}

impl<'a> Changes<'a> {
    /// Returns the overrides as text, as in `drive.voltage=5 kV`.
    pub fn to_texts(self) -> impl Iterator<Item = String> + 'a {
        let voltage = self.voltage.map(|voltage| format!("drive.voltage={voltage}"));
        self.sets.iter().cloned().chain(voltage)
    }
}

/// Whether an override of a pipeline changes its scene.
#[must_use]
pub fn is_of_scene(set: &str) -> bool {
    set.trim_start().starts_with("scene.") || replaces_scene(set)
}

/// Whether an override of a pipeline names the file of its scene.
fn replaces_scene(set: &str) -> bool {
    set.split_once('=').is_some_and(|(path, _)| path.trim() == "scene")
}

/// Reads the scene in a file and overrides values.
///
/// # Errors
/// If it cannot be read, or a value is invalid.
pub fn read_scene_with(path: &Path, changes: Changes<'_>) -> Result<ReadScene, InputError> {
    let mut root = Document::load(path)?.root;
    let is_pipeline = root.peek("scene").is_some();
    let set = |set: &String| {
        let given = set.trim_start();
        let own = given.strip_prefix("scene.").unwrap_or(given);
        match is_pipeline {
            true if replaces_scene(given) => with_scene_file(&Override::parse(given)?),
            true => Override::parse(&format!("scene.{own}")),
            false => Override::of_scene(own),
        }
    };
    let sets = changes.sets.iter().map(set).collect::<Result<_, _>>()?;
    let others = splice_scene(&mut root, path, sets, crate::scene::complete)?;
    others.iter().try_for_each(|set| set.apply(&mut root))?;
    if let Some(voltage) = changes.voltage {
        let is_voltage = |set: &&String| {
            let path = set.split_once('=').map_or("", |(path, _)| path.trim());
            path.strip_prefix("scene.").unwrap_or(path) == "drive.voltage"
        };
        if let Some(set) = changes.sets.iter().find(is_voltage) {
            return Err(InputError::new("the voltage is given twice")
                .help(format!("remove --voltage {voltage:?} or --set {set:?}")));
        }
        let path = if is_pipeline {
            "scene.drive.voltage"
        } else {
            "drive.voltage"
        };
        let voltage = Override::of_option("--voltage", path, voltage)?;
        let scene = root.peek("scene").unwrap_or(&root);
        if let Some(first) = scene.peek("states").and_then(|states| states.keys().into_iter().next()) {
            return Err(voltage
                .node()
                .error("--voltage cannot be used: the voltages of this scene are those of its `states`")
                .help(format!(
                    "set those of a state, as in --set states.{first}.voltages=\"[4 kV, 0 V]\""
                )));
        }
        voltage.apply(&mut root)?;
    }
    if root.peek("stages").is_some() && root.peek("scene").is_none() {
        return Err(root
            .error("this pipeline has no scene; give a scene file or a pipeline with a scene")
            .help("name the file of the scene"));
    }
    let node = root.peek("scene").unwrap_or(&root);
    check_has_no_axis(node)?;
    let scene = crate::scene::read(node)?;
    Ok(ReadScene {
        scene,
        tolerances: Tolerances::of_scene(node)?,
        bare_numbers: node.bare_numbers(),
    })
}

/// Refuses a scene with an axis of a sweep: it is a scene for each value.
fn check_has_no_axis(scene: &Node) -> Result<(), InputError> {
    let axes = axes_in(scene);
    let Some(first) = axes.first() else {
        return Ok(());
    };
    let names = axes.iter().map(|axis| format!("`${{{axis}}}`")).collect::<Vec<_>>();
    Err(scene
        .error(format!(
            "the scene is not complete: the sweep of the pipeline sets {}",
            names.join(", ")
        ))
        .help(format!(
            "give the field with `${{{first}}}` one value by --set, or name a scene without axes"
        )))
}

/// Reads a scene from text in YAML or JSON. It must not name files, because there is no folder that they are relative
/// to.
///
/// # Errors
/// If it is not a valid scene, cannot be simulated, or names files.
pub fn scene_of_text(text: &str) -> Result<Scene, InputError> {
    let root = Document::from_text(Path::new("scene"), text)?.root;
    if let Some(file) = scene_files(&root).first() {
        return Err(root
            .error(format!("the scene names the file {file:?}"))
            .help("a scene given as text must not name files"));
    }
    crate::scene::read(&root)
}
