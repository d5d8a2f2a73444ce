//! What a server knows: its pipelines and scenes, its store, and what it keeps in memory.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use serde_json::{Value, json};

use super::held::{Benches, Critical, Kept, Runner, Setting, StoreTotals, Tables, lock};
use super::http::Refusal;
use super::look::Judgement;
use deaflow_base::{ArtifactId, InputError};
use deaflow_orchestrator::{Pipeline, file_of};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_stage as stage;
use deaflow_stage::direct;
use deaflow_store::{Artifact, Store};
use deaflow_surrogate::Surrogate;

/// Where the page opens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// At the pipelines.
    #[default]
    Overview,
    /// At the sketchpad.
    Sketch,
}

/// What is served.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The pipelines; where there are none, those of past runs.
    pub pipelines: Vec<PathBuf>,
    /// The folder of the store, which need not be there yet.
    pub store: PathBuf,
    /// Whether pipelines may be run.
    pub allow_run: bool,
    /// The scene of the sketchpad, by its file.
    pub scene: Option<PathBuf>,
    /// What the sketchpad begins with, as an argument of `deaflow solve`.
    pub pattern: Option<String>,
}

/// A scene by its name on the page.
#[derive(Clone, Debug)]
pub struct NamedScene {
    /// The name.
    pub name: String,
    /// The scene.
    pub scene: Scene,
    /// The file that it stands in: its own, or that of a pipeline; none of the scene that is always there.
    pub file: Option<PathBuf>,
}

/// What a server knows.
pub struct ServedState {
    store_folder: PathBuf,
    named: Vec<PathBuf>,
    allow_run: bool,
    own_scene: Option<NamedScene>,
    first: Vec<Vec<u8>>,
    store: Mutex<Option<Arc<Store>>>,
    scenes: Mutex<Vec<NamedScene>>,
    /// Solvers that are ready.
    pub benches: Benches,
    /// Where drawn patterns lose stability: that of a pattern is asked for at many voltages.
    pub limits: Kept<(Setting, Pattern), Option<Critical>>,
    /// Artifacts that were looked at last: one of many chunks has opened all of them.
    pub opened: Kept<ArtifactId, Artifact>,
    /// Trained networks that were asked last.
    pub networks: Kept<ArtifactId, Surrogate>,
    /// What they say of the rows of a part of their sets, by its name.
    pub judgements: Kept<(ArtifactId, &'static str), Judgement>,
    /// Tables of artifacts.
    pub tables: Tables,
    /// What is in the store.
    pub totals: StoreTotals,
    /// The run that was begun here.
    pub runner: Runner,
}

impl ServedState {
    /// Reads what was named.
    ///
    /// # Errors
    /// When the scene, the pattern or one of the pipelines cannot be used. Pipelines that are broken later, or that past runs name, are
    /// shown with their problems.
    pub fn new(options: Options) -> Result<Self, InputError> {
        for path in &options.pipelines {
            Pipeline::load(path, &[], &stage::registry())?;
        }
        let own_scene = options.scene.as_deref().map(named_scene).transpose()?;
        let first = match (&options.pattern, &own_scene) {
            (Some(pattern), Some(own)) => {
                let found = direct::patterns(std::slice::from_ref(pattern), own.scene.form())?;
                let columns = own.scene.form().raster.columns();
                let rows = found
                    .first()
                    .map(|one| one.cells().chunks(columns).map(<[u8]>::to_vec).collect());
                rows.unwrap_or_default()
            }
            _ => Vec::new(),
        };
        let state = Self {
            store_folder: options.store,
            named: options.pipelines.iter().map(|path| file_of(path)).collect(),
            allow_run: options.allow_run,
            own_scene,
            first,
            store: Mutex::default(),
            scenes: Mutex::default(),
            benches: Benches::default(),
            limits: Kept::new(MOST_LIMITS),
            opened: Kept::new(MOST_OPENED),
            networks: Kept::new(MOST_NETWORKS),
            judgements: Kept::new(MOST_NETWORKS),
            tables: Tables::default(),
            totals: StoreTotals::default(),
            runner: Runner::default(),
        };
        state.read_scenes();
        Ok(state)
    }

    /// Whether pipelines may be run.
    #[must_use]
    pub fn may_run(&self) -> bool {
        self.allow_run
    }

    /// The folder of the store.
    #[must_use]
    pub fn store_folder(&self) -> &Path {
        &self.store_folder
    }

    /// The store; none where there is none yet.
    ///
    /// # Errors
    /// When something else is in its place, or it cannot be read.
    pub fn store(&self) -> Result<Option<Arc<Store>>, Refusal> {
        let mut held = lock(&self.store);
        if held.is_none() && Store::is_at(&self.store_folder) {
            // A page that is left open must not keep `gc` from its work.
            let store = match self.allow_run {
                true => Store::open_existing(&self.store_folder)?,
                false => Store::open_unlocked(&self.store_folder)?,
            };
            *held = Some(Arc::new(store.guarded()));
        }
        Ok(held.clone())
    }

    /// The store, for what cannot be answered without.
    ///
    /// # Errors
    /// When there is none.
    pub fn existing_store(&self) -> Result<Arc<Store>, Refusal> {
        let none = || {
            Refusal::absent(format!("there is no artifact store at {}", self.store_folder.display()))
                .help("`deaflow run` makes one")
        };
        self.store()?.ok_or_else(none)
    }

    /// Gives up the signs that this process is at the store.
    pub fn leave(&self) {
        if let Some(store) = lock(&self.store).as_ref() {
            store.leave();
        }
    }

    /// The files of the pipelines: those that were named, or those of past runs, the latest first.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub fn pipelines(&self) -> Result<Vec<PathBuf>, Refusal> {
        let mut paths = self.named.clone();
        let Some(store) = self.store()?.filter(|_| paths.is_empty()) else {
            return Ok(paths);
        };
        for run in store.runs()?.take(MOST_RUNS) {
            let path = PathBuf::from(run?.path);
            if !paths.contains(&path) && path.is_file() {
                paths.push(path);
            }
            if paths.len() == MOST_PIPELINES {
                break;
            }
        }
        Ok(paths)
    }

    /// The scenes that can be named, read anew.
    pub fn read_scenes(&self) -> Vec<NamedScene> {
        let mut found: Vec<NamedScene> = self.own_scene.clone().into_iter().collect();
        let pipelines = self.pipelines().unwrap_or_default();
        // Those with one that has problems are told of by `refused_scenes`.
        found.extend(pipelines.iter().filter_map(|path| named_scene(path).ok()));
        if found.is_empty() {
            // That of a pipeline may be broken, and is not to be taken for this one.
            let name = match pipelines.is_empty() {
                true => "vhb4910".to_owned(),
                false => "vhb4910 (built in)".to_owned(),
            };
            found.push(NamedScene {
                name,
                scene: Scene::vhb4910(),
                file: None,
            });
        }
        let mut seen: Vec<String> = Vec::new();
        for named in &mut found {
            let alike = seen.iter().filter(|other| **other == named.name).count();
            seen.push(named.name.clone());
            if alike > 0 {
                named.name = format!("{} ({})", named.name, alike + 1);
            }
        }
        lock(&self.scenes).clone_from(&found);
        found
    }

    /// Pipelines whose scenes cannot be drawn on, with what is wrong with them; those that have none are left out.
    #[must_use]
    pub fn refused_scenes(&self) -> Vec<(PathBuf, Refusal)> {
        let all = self.pipelines().unwrap_or_default().into_iter();
        all.filter_map(|path| match direct::read_scene(&path) {
            Err(error) if direct::names_scene(&path) => Some((path, error.into())),
            _ => None,
        })
        .collect()
    }

    /// A scene by its name; the first where none is named.
    #[must_use]
    pub fn scene(&self, name: Option<&str>) -> Option<Scene> {
        self.named_scene(name).map(|named| named.scene)
    }

    /// A scene by its name, with the file that it stands in; the first where none is named.
    #[must_use]
    pub fn named_scene(&self, name: Option<&str>) -> Option<NamedScene> {
        let scenes = lock(&self.scenes);
        let mut all = scenes.iter();
        let found = match name {
            Some(name) => all.find(|named| named.name == name),
            None => all.next(),
        };
        found.cloned()
    }

    /// What the page begins with.
    #[must_use]
    pub fn beginning(&self) -> Value {
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "store": self.store_folder,
            "folder": std::env::current_dir().ok(),
            "allow_run": self.allow_run,
            "pattern": self.first,
        })
    }
}

/// Patterns whose limits are kept.
const MOST_LIMITS: usize = 32;

/// Artifacts that are kept open.
const MOST_OPENED: usize = 8;

/// Networks that are kept.
const MOST_NETWORKS: usize = 4;

/// Runs that are looked through for pipelines.
const MOST_RUNS: usize = 500;

/// Pipelines of past runs that are shown.
const MOST_PIPELINES: usize = 50;

/// A scene, named after its file.
fn named_scene(path: &Path) -> Result<NamedScene, InputError> {
    let name = path
        .file_stem()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    Ok(NamedScene {
        name,
        scene: direct::read_scene(path)?,
        file: Some(path.to_owned()),
    })
}
