//! Reads a pipeline from YAML, refusing what cannot run before any work is done.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::entry::{
    Entry, Registry, check_length, check_names, check_needs, read_entries, refuse_cycle_of, suggestion,
};
use super::graph;
use super::kind::{Kind, Stage, StageCheck, StageDeclaration};
use super::rounds::{self, Rounds};
use super::sweep::{self, Sweep};
use deaflow_base::{Document, InputError, Node, NodeValue, Override, folder_of};

const WHAT: &str = "the pipeline";

const KEYS: [&str; 4] = ["version", "name", "scene", "stages"];

/// Pieces of work in a pipeline: some 25 million samples. A plan holds all of them.
const MOST_PIECES: u64 = 500_000;

/// A valid pipeline.
pub struct Pipeline {
    /// Its name.
    pub name: String,
    /// Its file.
    pub path: PathBuf,
    /// Its scene, already one mapping even where the file names another file.
    pub scene: Option<Node>,
    /// Its stages in topological order.
    pub stages: Vec<StageSpec>,
    /// Those that stand for several, in the order of the file.
    pub sweeps: Vec<Sweep>,
    /// Those that are done in more than one round, in the order of the file.
    pub rounds: Vec<Rounds>,
    /// What stood on the command line in place of the file's: values in YAML by their dotted paths.
    pub overrides: BTreeMap<String, String>,
}

/// One stage of a pipeline.
pub struct StageSpec {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: &'static dyn Kind,
    /// The stages that it needs, by their places in [`Pipeline::stages`], in the order of the file.
    pub needs: Vec<usize>,
    /// The stages that it waits for and does not read, likewise.
    pub gates: Vec<usize>,
    /// Its scene, where that is not the one of all stages.
    pub scene: Option<Node>,
    /// The files that it names, relative to that of the pipeline.
    pub files: Vec<String>,
    /// What is foreseen of it.
    pub check: StageCheck,
    /// What it does.
    pub stage: Box<dyn Stage>,
}

impl StageSpec {
    /// The RECIPE number of its results.
    #[must_use]
    pub fn recipe(&self) -> u32 {
        self.kind.recipe() + self.stage.revision()
    }

    /// The stages that have to be done before this one, whether it reads them or not.
    #[must_use]
    pub fn waits_for(&self) -> Vec<usize> {
        self.needs.iter().chain(&self.gates).copied().collect()
    }
}

/// A scene in the place of a pipeline is told as such: each of its keys would be one that a pipeline does not have.
fn refuse_scene(root: &Node) -> Result<(), InputError> {
    let has = |key| root.peek(key).is_some();
    match !has("stages") && ["geometry", "material", "drive"].into_iter().any(has) {
        true => Err(root
            .error("this file is a scene, and a pipeline is wanted")
            .help("a pipeline has `stages` and names its scene: `scene: FILE.yaml`; scenes are what `solve`, `screen` and `sketch` take")),
        false => Ok(()),
    }
}

impl Pipeline {
    /// Reads a pipeline from its file, with `--set` overrides applied after the scene's file has been read.
    ///
    /// # Errors
    /// When the file or anything in it cannot be accepted, with the place.
    pub fn load(path: &Path, overrides: &[Override], registry: &Registry) -> Result<Self, InputError> {
        Self::read(Document::load(path)?, overrides, registry)
    }

    /// Reads a pipeline from a document.
    ///
    /// # Errors
    /// As [`Pipeline::load`].
    pub fn read(document: Document, overrides: &[Override], registry: &Registry) -> Result<Self, InputError> {
        let path = document.path().to_owned();
        let mut root = document.root;
        refuse_scene(&root)?;
        splice_scene(&mut root, &path)?;
        let resolved: Vec<Override> = overrides.iter().map(with_scene_file).collect::<Result<_, _>>()?;
        let late = rounds::apply(&mut root, &resolved)?;
        let name = read_frame(&root, registry)?;
        let sweeps = sweep::unroll(&mut root, registry, registry.most_stages)?;
        let rounds = rounds::unroll(&mut root, &late, registry)?;
        root.child_mut("stages")
            .into_iter()
            .for_each(|stages| stages.tell_allowed(&sweep::KEYS));
        let map = root.fields(WHAT, &KEYS)?;
        let entries = read_entries(map.required(WHAT, "stages")?, registry)?;
        let stages = read_stages(&entries, map.optional("scene"), !sweeps.is_empty())?;
        Ok(Self {
            name,
            path,
            scene: map.optional("scene").cloned(),
            stages,
            sweeps,
            rounds,
            overrides: overrides.iter().map(Override::said).collect(),
        })
    }

    /// Its file, wherever the next command is given: by this path its runs are known.
    #[must_use]
    pub fn file(&self) -> PathBuf {
        file_of(&self.path)
    }

    /// The stage of that name.
    #[must_use]
    pub fn stage(&self, name: &str) -> Option<&StageSpec> {
        self.stages.iter().find(|stage| stage.name == name)
    }

    /// The sweep of that name; none where that is the name of one stage.
    #[must_use]
    pub fn sweep(&self, name: &str) -> Option<&Sweep> {
        let mut named = self.sweeps.iter().filter(|sweep| sweep.name == name);
        named.find(|sweep| sweep.stages != [name])
    }

    /// The scene of a stage: its own, or that of all.
    #[must_use]
    pub fn scene_of<'a>(&'a self, stage: &'a StageSpec) -> Option<&'a Node> {
        stage.scene.as_ref().or(self.scene.as_ref())
    }

    /// Places of the stages to look at, in topological order: all, or `until` and what it needs. The name of a sweep means all its
    /// stages.
    ///
    /// # Errors
    /// When there is no stage of that name.
    pub fn selection(&self, until: Option<&str>) -> Result<Vec<usize>, InputError> {
        let Some(until) = until else {
            return Ok((0..self.stages.len()).collect());
        };
        let sweep = self.sweep(until);
        let wanted = |name: &String| sweep.map_or(name == until, |sweep| sweep.stages.contains(name));
        let targets: Vec<usize> = (0..self.stages.len())
            .filter(|&at| wanted(&self.stages[at].name))
            .collect();
        if targets.is_empty() {
            let names: Vec<&str> = self.stages.iter().map(|stage| stage.name.as_str()).collect();
            let message = format!("no stage `{until}` in {}", self.path.display());
            return Err(InputError::new(message).help(suggestion(until, &names)));
        }
        let needs: Vec<Vec<usize>> = self.stages.iter().map(StageSpec::waits_for).collect();
        let needs: Vec<&[usize]> = needs.iter().map(Vec::as_slice).collect();
        Ok(graph::closure(&needs, &targets))
    }
}

/// A file wherever the next command is given, by the folder that it is in: links to that are followed, since what it names is found from
/// there; a link in its own place is another pipeline.
#[must_use]
pub fn file_of(path: &Path) -> PathBuf {
    match (folder_of(path).canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => std::path::absolute(path).unwrap_or_else(|_| path.to_owned()),
    }
}

/// Puts a scene that the document at `path` gives by its file into the place of the file's name.
///
/// # Errors
/// When the file does not exist, lies outside the folder of the document (links followed), or is not a document.
pub fn splice_scene(root: &mut Node, path: &Path) -> Result<(), InputError> {
    let Some(node) = root.peek("scene") else {
        return Ok(());
    };
    if !matches!(node.value(), NodeValue::Text(_)) {
        return Ok(());
    }
    let parent = path.parent().unwrap_or(Path::new(""));
    let named = Path::new(node.text("scene")?);
    let file = parent.join(named);
    // A bare name has an empty parent, which the system does not open.
    let (Ok(within), Ok(found)) = (Path::new(".").join(parent).canonicalize(), file.canonicalize()) else {
        let message = format!("the scene's file {} does not exist", file.display());
        return Err(node.error(message).help("it is named relative to the pipeline's file"));
    };
    // Whoever runs a pipeline of somebody else's must not be made to read what lies elsewhere.
    if named.is_absolute() || !found.starts_with(&within) {
        let message = format!(
            "the scene's file {} lies outside the folder of the pipeline",
            named.display()
        );
        return Err(node
            .error(message)
            .help("put it beside the pipeline or in a folder below, without a link that leads out"));
    }
    let scene = Document::load(&file)?;
    root.replace("scene", scene.root);
    Ok(())
}

/// An override that names the file of another scene, with what stands in that file. Whoever gives the command has named it, so it may lie
/// anywhere; its name is relative to the folder at hand.
fn with_scene_file(set: &Override) -> Result<Override, InputError> {
    let NodeValue::Text(file) = set.value() else {
        return Ok(set.clone());
    };
    if set.path() != ["scene"] {
        return Ok(set.clone());
    }
    let file = Path::new(file);
    if !file.is_file() {
        let message = format!("there is no file {} with a scene", file.display());
        return Err(set
            .node()
            .error(message)
            .help("here it is named relative to the current folder"));
    }
    Ok(set.with_node(Document::load(file)?.root))
}

/// Checks all but the stages, and gives the name.
fn read_frame(root: &Node, registry: &Registry) -> Result<String, InputError> {
    let map = root.fields(WHAT, &KEYS)?;
    let version = map.required(WHAT, "version")?;
    if version.integer("version", 0, u64::MAX)? != 1 {
        return Err(version.error(format!(
            "`version` is {}: this deaflow reads version 1",
            version.found()
        )));
    }
    let name = map.required(WHAT, "name")?;
    check_length(name, name.text("name")?)?;
    if let Some(scene) = map.optional("scene").filter(|scene| sweep::axes_in(scene).is_empty()) {
        (registry.check_scene)(scene)?;
    }
    check_names(map.required(WHAT, "stages")?)?;
    Ok(name.text("name")?.to_owned())
}

fn read_stages(entries: &[Entry<'_>], scene: Option<&Node>, swept: bool) -> Result<Vec<StageSpec>, InputError> {
    let needs: Vec<Vec<usize>> = entries
        .iter()
        .map(|entry| entry.needs.iter().map(|(index, _)| *index).collect())
        .collect();
    let order = graph::order(&needs).map_err(|cycle| refuse_cycle(entries, &cycle))?;
    let mut place = vec![0; order.len()];
    for (at, &index) in order.iter().enumerate() {
        place[index] = at;
    }
    let mut stages = Vec::with_capacity(order.len());
    // In the order of the file, so that of several mistakes the first is named.
    for entry in entries {
        check_needs(entry, entries)?;
        let places = |gates: bool| {
            let wanted = entry
                .needs
                .iter()
                .filter(|(index, _)| entry.is_gate(&entries[*index]) == gates);
            wanted.map(|(index, _)| place[*index]).collect()
        };
        let own_scene = entry.node.peek(sweep::SCENE).filter(|_| swept);
        let stage = match own_scene {
            Some(scene) => entry.kind.read(&entry.node.without(sweep::SCENE), Some(scene))?,
            None => entry.kind.read(entry.node, scene)?,
        };
        stages.push(Some(StageSpec {
            name: entry.name.to_owned(),
            kind: entry.kind,
            needs: places(false),
            gates: places(true),
            scene: own_scene.cloned(),
            files: entry.kind.files(entry.node),
            check: StageCheck::default(),
            stage,
        }));
    }
    for (index, check) in check_stages(entries, scene, swept)?.into_iter().enumerate() {
        if let Some(stage) = &mut stages[index] {
            stage.check = check;
        }
    }
    let stages: Vec<StageSpec> = order.iter().filter_map(|&index| stages[index].take()).collect();
    check_pieces(&stages, &order, entries)?;
    Ok(stages)
}

/// What is foreseen of each stage, in the order of the file.
fn check_stages(entries: &[Entry<'_>], scene: Option<&Node>, swept: bool) -> Result<Vec<StageCheck>, InputError> {
    let own_scene = |entry: &Entry<'_>| entry.node.peek(sweep::SCENE).filter(|_| swept).cloned();
    let scenes: Vec<Option<Node>> = entries.iter().map(own_scene).collect();
    let nodes: Vec<Cow<'_, Node>> = entries
        .iter()
        .zip(&scenes)
        .map(|(entry, own)| match own {
            Some(_) => Cow::Owned(entry.node.without(sweep::SCENE)),
            None => Cow::Borrowed(entry.node),
        })
        .collect();
    let declaration = |index: usize| StageDeclaration {
        name: entries[index].name,
        kind: entries[index].kind.name(),
        node: &nodes[index],
        scene: scenes[index].as_ref().or(scene),
    };
    let each = entries.iter().enumerate().map(|(index, entry)| {
        let needs: Vec<StageDeclaration<'_>> = entry.needs.iter().map(|(need, _)| declaration(*need)).collect();
        entry.kind.check(&declaration(index), &needs)
    });
    each.collect()
}

/// Refuses what is too large to be planned, before anybody tries.
fn check_pieces(stages: &[StageSpec], order: &[usize], entries: &[Entry<'_>]) -> Result<(), InputError> {
    let mut pieces: Vec<u64> = Vec::with_capacity(stages.len());
    let mut total = 0u64;
    for (stage, &index) in stages.iter().zip(order) {
        let given = stage
            .needs
            .iter()
            .fold(0, |sum: u64, &need| sum.saturating_add(pieces[need]));
        let own = stage.stage.pieces(given);
        pieces.push(own);
        total = total.saturating_add(own);
        if total > MOST_PIECES {
            let message = format!("up to stage `{}` the pipeline has {total} chunks of work", stage.name);
            return Err(entries[index]
                .key
                .error(message)
                .help(format!("allowed: at most {MOST_PIECES}; lower a count")));
        }
    }
    Ok(())
}

fn refuse_cycle(entries: &[Entry<'_>], cycle: &[usize]) -> InputError {
    let (first, second) = (cycle[0], cycle[1 % cycle.len()]);
    let item = entries[first].needs.iter().find(|(index, _)| *index == second);
    let mut names: Vec<(&str, &Node)> = cycle
        .iter()
        .map(|&index| (entries[index].name, entries[index].key))
        .collect();
    names[0].1 = item.map_or(entries[first].key, |(_, node)| node);
    refuse_cycle_of(&names)
}
