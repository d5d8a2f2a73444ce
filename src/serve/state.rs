//! The state of a server: its pipelines and scenes, its store, and its caches.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use serde_json::{Value, json};

use super::cache::{
    CriticalVoltage, LruCache, ModelErrors, SimulationSetup, SolverCache, StoreTotals, TableCache, VoltageLimits, lock,
};
use super::examples::examples;
use super::http::ApiError;
use super::jobs::Runner;
use super::left_out::{LeftOut, check_in_plane};
use deaflow_base::{ArtifactId, InputError};
use deaflow_orchestrator::{Pipeline, file_of};
use deaflow_pattern::{DrawingOptions, Pattern};
use deaflow_scene::Scene;
use deaflow_stage as stage;
use deaflow_stage::direct;
use deaflow_store::{Artifact, Store};
use deaflow_surrogate::Surrogate;

/// The view that the page opens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StartView {
    /// The pipelines.
    #[default]
    Overview,
    /// The sketchpad.
    Sketch,
}

/// Options of a server.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The pipelines; by default those of past runs.
    pub pipelines: Vec<PathBuf>,
    /// The folder of the store, which may not exist yet.
    pub store: PathBuf,
    /// Whether the page may start runs.
    pub allow_run: bool,
    /// The file of the scene of the sketchpad.
    pub scene: Option<PathBuf>,
    /// The first pattern of the sketchpad, as an argument of `deaflow solve`.
    pub pattern: Option<String>,
}

/// A scene with its name on the page.
#[derive(Clone, Debug)]
pub struct NamedScene {
    /// The name.
    pub name: String,
    /// The scene.
    pub scene: Scene,
    /// The file of the scene or of its pipeline; `None` for the built-in scene.
    pub file: Option<PathBuf>,
    /// What a user should know of it, such as how numbers without a unit were read.
    pub notes: Option<String>,
}

/// The scenes of a server, as they are now.
#[derive(Default)]
pub struct ReadScenes {
    /// The scenes of the sketchpad, the default one first.
    pub scenes: Vec<NamedScene>,
    /// The files whose scenes it does not show.
    pub left_out: Vec<LeftOut>,
    /// The files whose scenes cannot be used, with their errors. Pipelines without a scene are in none of the lists.
    pub invalid: Vec<(PathBuf, ApiError)>,
}

/// The state of a server.
pub struct ServerState {
    store_folder: PathBuf,
    pipelines: Vec<PathBuf>,
    allow_run: bool,
    own_scene: Option<NamedScene>,
    first_pattern: Vec<Vec<u8>>,
    /// What its reader did that a user should know.
    pattern_notes: Vec<String>,
    notes: Vec<String>,
    store: Mutex<Option<Arc<Store>>>,
    scenes: Mutex<Vec<NamedScene>>,
    /// The scenes of the gallery of the sketchpad, which have other names.
    examples: Vec<NamedScene>,
    /// Solvers.
    pub solvers: SolverCache,
    /// Critical voltages of drawn patterns, which are asked for at many voltages.
    pub critical_voltages: LruCache<(SimulationSetup, Pattern), Option<CriticalVoltage>>,
    /// What else limits their voltages.
    pub voltage_limits: LruCache<(SimulationSetup, Pattern), VoltageLimits>,
    /// Open artifacts: opening one with many chunks opens all of them.
    pub opened: LruCache<ArtifactId, Artifact>,
    /// Trained networks.
    pub networks: LruCache<ArtifactId, Surrogate>,
    /// Errors of networks on the rows of a part of their datasets.
    pub model_errors: LruCache<(ArtifactId, &'static str), ModelErrors>,
    /// Tables of artifacts.
    pub tables: TableCache,
    /// Totals of the store.
    pub totals: StoreTotals,
    /// The run that the page started.
    pub runner: Runner,
}

impl ServerState {
    /// Reads the pipelines, the scene and the pattern of the options.
    ///
    /// # Errors
    /// If one of them cannot be used. Pipelines that break later, or that past runs name, are shown with their errors.
    pub fn new(options: Options) -> Result<Self, InputError> {
        let mut notes = Vec::new();
        let mut add = |path: &Path, bare: Option<&String>| {
            notes.extend(bare.map(|note| format!("{}: {note}", path.display())));
        };
        for path in &options.pipelines {
            let pipeline = Pipeline::load(path, &[], &stage::registry())?;
            add(path, pipeline.bare_numbers.as_ref());
        }
        let own_scene = options
            .scene
            .as_deref()
            .map(|path| named_scene(path).map_err(|error| LeftOut::incomplete(path).map_or(error, LeftOut::error)));
        let own_scene = own_scene.transpose()?;
        if let (Some(path), Some(own)) = (&options.scene, &own_scene) {
            check_in_plane(&own.scene, &path.display().to_string())?;
            add(path, own.notes.as_ref());
        }
        let (first_pattern, pattern_notes) = match (&options.pattern, &own_scene) {
            (Some(pattern), Some(own)) => first_pattern(pattern, &own.scene)?,
            _ => Default::default(),
        };
        notes.extend(pattern_notes.iter().cloned());
        let example = |(name, scene)| NamedScene {
            name,
            scene,
            file: None,
            notes: None,
        };
        let examples = examples()?.into_iter().map(example).collect();
        let state = Self {
            store_folder: options.store,
            pipelines: options.pipelines.iter().map(|path| file_of(path)).collect(),
            allow_run: options.allow_run,
            own_scene,
            first_pattern,
            pattern_notes,
            notes,
            store: Mutex::default(),
            scenes: Mutex::default(),
            examples,
            solvers: SolverCache::default(),
            critical_voltages: LruCache::new(MAX_CRITICAL_VOLTAGES),
            voltage_limits: LruCache::new(MAX_CRITICAL_VOLTAGES),
            opened: LruCache::new(MAX_OPENED),
            networks: LruCache::new(MAX_NETWORKS),
            model_errors: LruCache::new(MAX_NETWORKS),
            tables: TableCache::default(),
            totals: StoreTotals::default(),
            runner: Runner::default(),
        };
        state.read_scenes();
        Ok(state)
    }

    /// Says how numbers without a unit in the files of the options were read, and how the pattern was.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Whether the page may start runs.
    #[must_use]
    pub fn may_run(&self) -> bool {
        self.allow_run
    }

    /// Returns the folder of the store.
    #[must_use]
    pub fn store_folder(&self) -> &Path {
        &self.store_folder
    }

    /// Returns the store; `None` if there is none yet.
    ///
    /// # Errors
    /// If its folder holds something else, or cannot be read.
    pub fn store(&self) -> Result<Option<Arc<Store>>, ApiError> {
        let mut held = lock(&self.store);
        if held.is_none() && Store::is_at(&self.store_folder) {
            // A page that stays open must not block `gc`.
            let store = match self.allow_run {
                true => Store::open_existing(&self.store_folder)?,
                false => Store::open_unlocked(&self.store_folder)?,
            };
            *held = Some(Arc::new(store.guarded()));
        }
        Ok(held.clone())
    }

    /// Returns the store.
    ///
    /// # Errors
    /// If there is none.
    pub fn existing_store(&self) -> Result<Arc<Store>, ApiError> {
        let none = || {
            ApiError::not_found(format!("there is no artifact store at {}", self.store_folder.display()))
                .help("run a pipeline to create it")
        };
        self.store()?.ok_or_else(none)
    }

    /// Removes the entry of this process from the store.
    pub fn leave(&self) {
        if let Some(store) = lock(&self.store).as_ref() {
            store.leave();
        }
    }

    /// Returns the files of the pipelines: those of the options, or those of past runs, the latest first.
    ///
    /// # Errors
    /// If the store cannot be read.
    pub fn pipelines(&self) -> Result<Vec<PathBuf>, ApiError> {
        let mut paths = self.pipelines.clone();
        let Some(store) = self.store()?.filter(|_| paths.is_empty()) else {
            return Ok(paths);
        };
        for run in store.runs()?.take(MAX_RUNS) {
            let path = PathBuf::from(run?.path);
            if !paths.contains(&path) && path.is_file() {
                paths.push(path);
            }
            if paths.len() == MAX_PIPELINES {
                break;
            }
        }
        Ok(paths)
    }

    /// Reads all scenes again.
    pub fn read_scenes(&self) -> ReadScenes {
        let mut read = ReadScenes::default();
        read.scenes.extend(self.own_scene.clone());
        let pipelines = self.pipelines().unwrap_or_default();
        for path in &pipelines {
            match named_scene(path) {
                Ok(named) => match LeftOut::in_space(path, &named.scene) {
                    Some(left_out) => read.left_out.push(left_out),
                    None => read.scenes.push(named),
                },
                Err(error) => match LeftOut::incomplete(path) {
                    Some(left_out) => read.left_out.push(left_out),
                    None if direct::names_scene(path) => read.invalid.push((path.clone(), error.into())),
                    None => {}
                },
            }
        }
        let found = &mut read.scenes;
        if found.is_empty() {
            // The scene of a pipeline may be broken, and this one must not be mistaken for it.
            let name = match pipelines.is_empty() {
                true => "vhb4910".to_owned(),
                false => "vhb4910 (built in)".to_owned(),
            };
            found.push(NamedScene {
                name,
                scene: Scene::vhb4910(),
                file: None,
                notes: None,
            });
        }
        let mut seen: Vec<String> = Vec::new();
        for named in found {
            let same = seen.iter().filter(|other| **other == named.name).count();
            seen.push(named.name.clone());
            if same > 0 {
                named.name = format!("{} ({})", named.name, same + 1);
            }
        }
        lock(&self.scenes).clone_from(&read.scenes);
        read
    }

    /// Returns the scene with a name; the first one if no name is given.
    #[must_use]
    pub fn scene(&self, name: Option<&str>) -> Option<Scene> {
        self.named_scene(name).map(|named| named.scene)
    }

    /// Returns the scene with a name and its file; the first one if no name is given.
    #[must_use]
    pub fn named_scene(&self, name: Option<&str>) -> Option<NamedScene> {
        let scenes = lock(&self.scenes);
        let mut all = scenes.iter().chain(&self.examples);
        let found = match name {
            Some(name) => all.find(|named| named.name == name),
            None => all.next(),
        };
        found.cloned()
    }

    /// Returns the scenes of the gallery of the sketchpad.
    #[must_use]
    pub fn examples(&self) -> &[NamedScene] {
        &self.examples
    }

    /// Returns what the page needs at its start.
    #[must_use]
    pub fn start_document(&self) -> Value {
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "store": self.store_folder,
            "folder": std::env::current_dir().ok(),
            "allow_run": self.allow_run,
            "pattern": self.first_pattern,
            "pattern_notes": self.pattern_notes,
        })
    }
}

/// Reads the first pattern of an argument row by row, and what its reader did that a user should know.
fn first_pattern(argument: &str, scene: &Scene) -> Result<(Vec<Vec<u8>>, Vec<String>), InputError> {
    let form = scene.form();
    let found = direct::patterns(&[argument.to_owned()], form, &DrawingOptions::default())?;
    let columns = form.raster.columns();
    let rows = |pattern: &Pattern| pattern.cells().chunks(columns).map(<[u8]>::to_vec).collect();
    let others = match found.patterns.len() {
        0 | 1 => None,
        count => Some(format!(
            "{argument}: the file has {count} patterns; the first one is opened"
        )),
    };
    let notes = found.notes.into_iter().chain(others).collect();
    Ok((found.patterns.first().map(rows).unwrap_or_default(), notes))
}

/// Critical voltages that are kept.
const MAX_CRITICAL_VOLTAGES: usize = 32;

/// Artifacts that stay open.
const MAX_OPENED: usize = 8;

/// Networks that are kept.
const MAX_NETWORKS: usize = 4;

/// Runs that are searched for pipelines.
const MAX_RUNS: usize = 500;

/// Pipelines of past runs that are shown.
const MAX_PIPELINES: usize = 50;

/// Reads a scene, which is named after its file.
fn named_scene(path: &Path) -> Result<NamedScene, InputError> {
    let name = path
        .file_stem()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let read = direct::read_scene_with(path, direct::Changes::default())?;
    let notes = read.notes();
    Ok(NamedScene {
        name,
        scene: read.scene,
        file: Some(path.to_owned()),
        notes: (!notes.is_empty()).then(|| notes.join("; ")),
    })
}
