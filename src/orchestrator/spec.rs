//! Reads and validates a pipeline in YAML.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::declaration::{Declarations, Declared};
use super::entry::{
    Entry, Registry, check_length, check_names, check_needs, read_entries, refuse_cycle_of, suggestion,
};
use super::graph;
use super::kind::{Input, Kind, Plan, Stage, StageCheck};
use super::rounds::{self, Rounds};
use super::scene_from::{self, SceneFrom};
use super::sweep::{self, Sweep};
use deaflow_base::{Document, InputError, Node, NodeValue, Override, folder_of};

const WHAT: &str = "the pipeline";

/// The key of the scene, and what it is called.
const SCENE: &str = "scene";

const KEYS: [&str; 4] = ["version", "name", "scene", "stages"];

/// The start of keys at the top of a pipeline that are skipped: they hold anchors that other places share.
const EXTENSION: &str = "x-";

/// The keys of stages that read a scene which are gone when their kinds read them.
const KEYS_WITH_SCENE: [&str; 3] = [sweep::KEYS[0], sweep::KEYS[1], scene_from::SCENE];

/// Maximum number of chunks in a pipeline (about 25 million samples), because a plan holds all of them in memory.
const MOST_PIECES: u64 = 500_000;

/// A valid pipeline.
pub struct Pipeline {
    /// Its name.
    pub name: String,
    /// Its file.
    pub path: PathBuf,
    /// Its scene, loaded if the pipeline names a file.
    pub scene: Option<Node>,
    /// Its stages in topological order.
    pub stages: Vec<StageSpec>,
    /// The sweeps, in the order of the file.
    pub sweeps: Vec<Sweep>,
    /// The stages with more than one round, in the order of the file.
    pub rounds: Vec<Rounds>,
    /// Overrides from the command line: values in YAML by dotted path.
    pub overrides: BTreeMap<String, String>,
    /// How numbers without a unit were read; `None` if all have one.
    pub bare_numbers: Option<String>,
}

/// One stage of a pipeline.
pub struct StageSpec {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: &'static dyn Kind,
    /// The stages that it needs, as indices in [`Pipeline::stages`], in the order of the file.
    pub needs: Vec<usize>,
    /// The stages that it only waits for, likewise, with that of [`StageSpec::scene_from`].
    pub gates: Vec<usize>,
    /// Its own scene, if it differs from that of the pipeline.
    pub scene: Option<Node>,
    /// The parameters that it has from the scene, see [`Kind::scene_parameters`].
    pub from_scene: Vec<String>,
    /// The files that it names, relative to the file of the pipeline.
    pub files: Vec<String>,
    /// The result of checking it before a run.
    pub check: StageCheck,
    /// The stage that makes its scene, if another one does.
    pub scene_from: Option<SceneFrom>,
    /// The validated stage, with the scene of the pipeline.
    stage: Arc<dyn Stage>,
}

impl StageSpec {
    /// Returns the RECIPE number of its results.
    #[must_use]
    pub fn recipe(&self) -> u32 {
        self.kind.recipe() + self.stage().revision()
    }

    /// Returns the stage. As long as the scene that another stage makes is not known, it has that of the pipeline.
    #[must_use]
    pub fn stage(&self) -> Arc<dyn Stage> {
        let with_scene = self.scene_from.as_ref().and_then(SceneFrom::stage);
        with_scene.unwrap_or_else(|| self.stage.clone())
    }

    /// Returns the index of the stage that makes its scene, if that scene is not known or not valid. Its key is not
    /// known then.
    #[must_use]
    pub fn unknown_scene(&self) -> Option<usize> {
        let from = self.scene_from.as_ref()?;
        from.stage().is_none().then_some(from.index)
    }

    /// Returns the stages whose artifacts it depends on: those that it needs, and that of its scene.
    pub fn reads(&self) -> impl Iterator<Item = usize> + '_ {
        let scene = self.scene_from.as_ref().map(|from| from.index);
        self.needs.iter().copied().chain(scene)
    }

    /// Returns the stages that have to be built before this one.
    #[must_use]
    pub fn waits_for(&self) -> Vec<usize> {
        self.needs.iter().chain(&self.gates).copied().collect()
    }
}

/// Refuses a scene in place of a pipeline, instead of reporting unknown keys.
fn refuse_scene(root: &Node) -> Result<(), InputError> {
    let has = |key| root.peek(key).is_some();
    match !has("stages") && ["geometry", "material", "drive"].into_iter().any(has) {
        true => Err(root
            .error("this file is a scene, not a pipeline")
            .help("a pipeline has `stages` and `scene: FILE.yaml`; `solve`, `screen` and `sketch` take scenes")),
        false => Ok(()),
    }
}

impl Pipeline {
    /// Reads a pipeline from its file, and applies `--set` overrides after loading the scene.
    ///
    /// # Errors
    /// If the file or anything in it is not valid, with the position.
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
        root.remove_starting_with(EXTENSION);
        refuse_scene(&root)?;
        let resolved: Vec<Override> = overrides.iter().map(with_scene_file).collect::<Result<_, _>>()?;
        let others = splice_scene(&mut root, &path, resolved, registry.complete_scene)?;
        let late = rounds::apply(&mut root, &others)?;
        let name = read_frame(&root, registry)?;
        let sweeps = sweep::unroll(&mut root, registry, registry.most_stages)?;
        complete_scenes_of_stages(&mut root, registry)?;
        let rounds = rounds::unroll(&mut root, &late, registry)?;
        if let Some(stages) = root.child_mut("stages") {
            stages.set_removed_keys(|stage| match registry.reads_scene(stage) {
                true => &KEYS_WITH_SCENE,
                false => &sweep::KEYS,
            });
        }
        let map = root.fields(WHAT, &KEYS)?;
        let entries = read_entries(map.required(WHAT, "stages")?, registry)?;
        let stages = read_stages(&entries, map.optional("scene"), !sweeps.is_empty())?;
        Ok(Self {
            bare_numbers: root.bare_numbers(),
            name,
            path,
            scene: map.optional("scene").cloned(),
            stages,
            sweeps,
            rounds,
            overrides: overrides.iter().map(Override::path_and_text).collect(),
        })
    }

    /// Returns the absolute path of its file, by which the history finds its runs.
    #[must_use]
    pub fn file(&self) -> PathBuf {
        file_of(&self.path)
    }

    /// Returns the stage of that name.
    #[must_use]
    pub fn stage(&self, name: &str) -> Option<&StageSpec> {
        self.stages.iter().find(|stage| stage.name == name)
    }

    /// Returns the sweep of that name, unless that is the name of a single stage.
    #[must_use]
    pub fn sweep(&self, name: &str) -> Option<&Sweep> {
        let mut named = self.sweeps.iter().filter(|sweep| sweep.name == name);
        named.find(|sweep| sweep.has_other_stages())
    }

    /// Returns the scene of a stage: its own, or that of the pipeline.
    #[must_use]
    pub fn scene_of<'a>(&'a self, stage: &'a StageSpec) -> Option<Cow<'a, Node>> {
        let made = stage.scene_from.as_ref().and_then(SceneFrom::scene);
        let other = || stage.scene.as_ref().or(self.scene.as_ref());
        made.map(Cow::Owned).or_else(|| other().map(Cow::Borrowed))
    }

    /// Returns the indices of the selected stages in topological order: all, or `until` and what it needs. The name of
    /// a sweep selects all its stages.
    ///
    /// # Errors
    /// If there is no stage of that name.
    pub fn selection(&self, until: Option<&str>) -> Result<Vec<usize>, InputError> {
        let Some(until) = until else {
            return Ok((0..self.stages.len()).collect());
        };
        let sweep = self.sweep(until);
        let is_target = |name: &String| sweep.map_or(name == until, |sweep| sweep.stages.contains(name));
        let targets: Vec<usize> = (0..self.stages.len())
            .filter(|&at| is_target(&self.stages[at].name))
            .collect();
        if targets.is_empty() {
            let stages = self.stages.iter().map(|stage| stage.name.as_str());
            let sweeps = self.sweeps.iter().filter(|sweep| sweep.has_other_stages());
            let names: Vec<&str> = sweeps.map(|sweep| sweep.name.as_str()).chain(stages).collect();
            let message = format!("no stage `{until}` in {}", self.path.display());
            return Err(InputError::new(message).help(suggestion(until, &names)));
        }
        let needs: Vec<Vec<usize>> = self.stages.iter().map(StageSpec::waits_for).collect();
        let needs: Vec<&[usize]> = needs.iter().map(Vec::as_slice).collect();
        Ok(graph::closure(&needs, &targets))
    }
}

/// Returns the absolute path of a file. Links in the path of its folder are resolved, but a link at the file itself is
/// not: it is another pipeline.
#[must_use]
pub fn file_of(path: &Path) -> PathBuf {
    match (folder_of(path).canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => std::path::absolute(path).unwrap_or_else(|_| path.to_owned()),
    }
}

/// Loads the scene of the document at `path`, which is a pipeline that may name a file, or a scene: overrides that
/// replace the scene or name a file in it are applied first, then `complete` replaces its files by their content.
/// Returns the other overrides.
///
/// # Errors
/// If a file does not exist, is outside the folder of the document that names it (after resolving links), or is not
/// valid.
pub fn splice_scene(
    root: &mut Node,
    path: &Path,
    overrides: Vec<Override>,
    complete: fn(&mut Node) -> Result<(), InputError>,
) -> Result<Vec<Override>, InputError> {
    let scene = root
        .peek(SCENE)
        .filter(|node| matches!(node.value(), NodeValue::Text(_)));
    if let Some(node) = scene {
        let parent = path.parent().unwrap_or(Path::new(""));
        let scene = Document::beside(node, parent, SCENE, "pipeline")?;
        root.replace(SCENE, scene.root);
    }
    let (first, others): (Vec<_>, Vec<_>) = overrides.into_iter().partition(names_file);
    first.iter().try_for_each(|set| set.apply(root))?;
    let is_pipeline = [SCENE, "stages"].into_iter().any(|key| root.peek(key).is_some());
    match root.child_mut(SCENE) {
        Some(scene) => complete(scene)?,
        None if !is_pipeline => complete(root)?,
        None => {}
    }
    Ok(others)
}

/// Whether an override replaces the scene, or names the file of its material.
fn names_file(set: &Override) -> bool {
    let steps: Vec<&str> = set.path().iter().map(String::as_str).collect();
    match steps.as_slice() {
        ["scene"] | ["scene", "material", "from"] | ["material", "from"] => true,
        ["scene", "material"] | ["material"] => set.node().peek("from").is_some(),
        _ => false,
    }
}

/// Completes the scenes that sweeps have given to stages.
fn complete_scenes_of_stages(root: &mut Node, registry: &Registry) -> Result<(), InputError> {
    let Some(stages) = root.child_mut("stages") else {
        return Ok(());
    };
    for name in stages.keys() {
        if let Some(scene) = stages
            .child_mut(&name)
            .and_then(|stage| stage.child_mut(sweep::SWEPT_SCENE))
        {
            (registry.complete_scene)(scene)?;
        }
    }
    Ok(())
}

/// Replaces the name of a scene file in an override by the scene. The user has named the file, so it may be anywhere;
/// its path is relative to the current folder.
///
/// # Errors
/// If there is no such file, or it is not a document.
pub fn with_scene_file(set: &Override) -> Result<Override, InputError> {
    let NodeValue::Text(file) = set.value() else {
        return Ok(set.clone());
    };
    if set.path() != ["scene"] {
        return Ok(set.clone());
    }
    let file = Path::new(file);
    if !file.is_file() {
        let message = format!("the scene file {} does not exist", file.display());
        return Err(set
            .node()
            .error(message)
            .help("in --set its path is relative to the current folder"));
    }
    Ok(set.with_node(Document::load(file)?.root))
}

/// Checks everything except the stages, and returns the name.
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
    let needs: Vec<Vec<usize>> = entries.iter().map(Entry::waits_for).collect();
    let order = graph::order(&needs).map_err(|cycle| refuse_cycle(entries, &cycle))?;
    let mut place = vec![0; order.len()];
    for (at, &index) in order.iter().enumerate() {
        place[index] = at;
    }
    let mut stages = Vec::with_capacity(order.len());
    // In the order of the file, so that the first of several errors is reported.
    for entry in entries {
        check_needs(entry, entries)?;
        let places = |gates: bool| {
            let listed = entry.listed().iter();
            let selected = listed.filter(|(index, _)| entry.is_gate(&entries[*index]) == gates);
            let without = entry.without().iter().filter(|_| !gates);
            let scene = entry.scene.iter().filter(|_| gates);
            let places = selected.chain(without).chain(scene);
            places.map(|(index, _)| place[*index]).collect()
        };
        let own_scene = entry.node.peek(sweep::SWEPT_SCENE).filter(|_| swept);
        let node = without_scene(entry, swept);
        let read = entry.kind.read(&node, own_scene.or(scene));
        let stage = match (own_scene, scene) {
            (None, Some(scene)) if !entry.kind.reads_scene() => read.map_err(|error| drawn_once(error, scene)),
            _ => read,
        }?;
        stages.push(Some(StageSpec {
            name: entry.name.to_owned(),
            kind: entry.kind,
            needs: places(false),
            gates: places(true),
            scene: own_scene.cloned(),
            from_scene: entry.kind.scene_parameters(&node),
            files: entry.kind.files(entry.node),
            check: StageCheck::default(),
            scene_from: entry
                .scene
                .map(|(index, _)| SceneFrom::new(place[index], node.into_owned())),
            stage: Arc::from(stage),
        }));
    }
    for (index, check) in check_stages(entries, scene, swept)?.into_iter().enumerate() {
        if let Some(stage) = &mut stages[index] {
            stage.check = check;
            stage.check.warnings.extend(stage.stage().notes());
        }
    }
    let stages: Vec<StageSpec> = order.iter().filter_map(|&index| stages[index].take()).collect();
    check_pieces(&stages, &order, entries)?;
    check_samples(&stages, &order, entries)?;
    Ok(stages)
}

/// Adds to an error what can be swept, if an axis of the scene stands where patterns need a value.
fn drawn_once(error: InputError, scene: &Node) -> InputError {
    let mut axes = sweep::axes_in(scene).into_iter();
    match axes.any(|axis| error.to_string().contains(&format!("${{{axis}}}"))) {
        true => error.help(
            "patterns are drawn once for all values of an axis, so sides, cells, frame and bodies cannot be swept with \
             a `sample` or `patterns` stage: `run --set` builds one value after the other",
        ),
        false => error,
    }
}

/// Checks each stage, in the order of the file.
fn check_stages(entries: &[Entry<'_>], scene: Option<&Node>, swept: bool) -> Result<Vec<StageCheck>, InputError> {
    let stages = Declarations::new(entries.iter().map(|entry| declared(entry, scene, swept)).collect());
    let each = entries.iter().zip(stages.iter());
    each.map(|(entry, stage)| {
        let check = entry.kind.check(&stage, &stage.needs().collect::<Vec<_>>())?;
        // What the scene of the pipeline lets expect says nothing about one that is made later.
        let mut check = match entry.scene {
            Some(_) => StageCheck::default(),
            None => check,
        };
        check.warnings.extend(other_scenes(entry, entries));
        Ok(check)
    })
    .collect()
}

/// Warns of stages with another scene than a stage that they need, as a verification of designs in a scene that another
/// stage makes.
fn other_scenes(entry: &Entry<'_>, entries: &[Entry<'_>]) -> Vec<String> {
    let maker = |entry: &Entry<'_>| entry.scene.map(|(index, _)| index);
    let named = |entry: &Entry<'_>| match maker(entry) {
        Some(index) => format!("that of `{}`", entries[index].name),
        None => "that of the pipeline".to_owned(),
    };
    let needs = entry.listed().iter().map(|(index, _)| &entries[*index]);
    let reads_another = |other: &&Entry<'_>| {
        let is_simulated = other.kind.reads_scene() && !other.kind.makes_scene();
        entry.kind.reads_scene() && is_simulated && maker(other) != maker(entry)
    };
    let warn = |other: &Entry<'_>| {
        let (name, own, its) = (entry.name, named(entry), named(other));
        format!(
            "{name}: its scene is {own}, but the scene of `{}`, which it needs, is {its}",
            other.name
        )
    };
    needs.filter(reads_another).map(warn).collect()
}

/// Returns the mapping of a stage as its kind reads it: without the scene of a sweep, and without the name of a stage
/// that makes its scene.
fn without_scene<'a>(entry: &Entry<'a>, swept: bool) -> Cow<'a, Node> {
    let is_own = swept && entry.node.peek(sweep::SWEPT_SCENE).is_some();
    match (is_own, entry.scene.is_some()) {
        (false, false) => Cow::Borrowed(entry.node),
        (true, false) => Cow::Owned(entry.node.without(sweep::SWEPT_SCENE)),
        (false, true) => Cow::Owned(entry.node.without(scene_from::SCENE)),
        (true, true) => {
            let node = entry.node.without(sweep::SWEPT_SCENE);
            Cow::Owned(node.without(scene_from::SCENE))
        }
    }
}

/// Returns a stage for checks, without the scene that a sweep adds to its mapping.
fn declared<'a>(entry: &'a Entry<'a>, scene: Option<&'a Node>, swept: bool) -> Declared<'a> {
    let own = entry.node.peek(sweep::SWEPT_SCENE).filter(|_| swept);
    Declared {
        name: entry.name,
        kind: entry.kind.name(),
        node: without_scene(entry, swept),
        scene: own.or(scene),
        scene_from: entry.scene.map(|(_, node)| node),
        needs: entry.needs.iter().map(|(need, _)| *need).collect(),
    }
}

/// Refuses a pipeline that is too large to be planned.
fn check_pieces(stages: &[StageSpec], order: &[usize], entries: &[Entry<'_>]) -> Result<(), InputError> {
    let mut pieces: Vec<u64> = Vec::with_capacity(stages.len());
    let mut total = 0u64;
    for (stage, &index) in stages.iter().zip(order) {
        let given = stage
            .needs
            .iter()
            .fold(0, |sum: u64, &need| sum.saturating_add(pieces[need]));
        let own = stage.stage().pieces(given);
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

/// Lets stages check the numbers of samples of their inputs.
fn check_samples(stages: &[StageSpec], order: &[usize], entries: &[Entry<'_>]) -> Result<(), InputError> {
    if !stages.iter().any(|spec| spec.stage().checks_samples()) {
        return Ok(());
    }
    let mut planned: Vec<Input> = Vec::with_capacity(stages.len());
    for (spec, &index) in stages.iter().zip(order) {
        let inputs: Vec<Input> = spec.needs.iter().map(|&need| planned[need].clone()).collect();
        let samples = |(need, input): (&usize, &Input)| {
            let count = input.parts.iter().map(|(_, samples)| samples).sum();
            (stages[*need].kind.name(), count)
        };
        let counted: Vec<(&'static str, u64)> = spec.needs.iter().zip(&inputs).map(samples).collect();
        if let Err(why) = spec.stage().check_samples(&counted) {
            let entry = &entries[index];
            return Err(entry.node.peek("needs").unwrap_or(entry.key).error(why));
        }
        let parts = match spec.stage().plan(&inputs) {
            Plan::Whole { .. } => vec![(None, 1)],
            Plan::Chunks(chunks) => chunks.iter().map(|chunk| (None, chunk.samples)).collect(),
        };
        planned.push(Input { digest: None, parts });
    }
    Ok(())
}

fn refuse_cycle(entries: &[Entry<'_>], cycle: &[usize]) -> InputError {
    let (first, second) = (cycle[0], cycle[1 % cycle.len()]);
    let item = entries[first]
        .needs
        .iter()
        .chain(&entries[first].scene)
        .find(|(index, _)| *index == second);
    let mut names: Vec<(&str, &Node)> = cycle
        .iter()
        .map(|&index| (entries[index].name, entries[index].key))
        .collect();
    names[0].1 = item.map_or(entries[first].key, |(_, node)| node);
    refuse_cycle_of(&names)
}
