//! Reads a pipeline from YAML, refusing what cannot run before any work is done.

use std::path::{Path, PathBuf};

use super::graph;
use super::kind::{Kind, Stage};
use super::rounds::{self, Rounds};
use crate::base::{Document, InputError, Node, NodeValue, Override, Schema, nearest};

const WHAT: &str = "the pipeline";

const KEYS: [&str; 4] = ["version", "name", "scene", "stages"];

/// Characters in the name of a pipeline or stage.
const LONGEST_NAME: usize = 200;

/// Pieces of work in a pipeline: some 25 million samples. A plan holds all of them.
const MOST_PIECES: u64 = 500_000;

/// What a pipeline may be made of.
pub struct Registry {
    /// The kinds of stages.
    pub kinds: Vec<&'static dyn Kind>,
    /// Checks a scene, so that a wrong one is refused even where no stage uses it.
    pub check_scene: fn(&Node) -> Result<(), InputError>,
    /// What a scene may look like.
    pub scene_schema: fn() -> Schema,
}

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
    /// Those that are done in more than one round, in the order of the file.
    pub rounds: Vec<Rounds>,
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
    /// What it does.
    pub stage: Box<dyn Stage>,
}

/// A stage whose name, kind and needs have been read.
pub(super) struct Entry<'a> {
    pub(super) name: &'a str,
    pub(super) key: &'a Node,
    pub(super) node: &'a Node,
    pub(super) kind: &'static dyn Kind,
    pub(super) needs: Vec<(usize, &'a Node)>,
}

impl StageSpec {
    /// The stages that have to be done before this one, whether it reads them or not.
    #[must_use]
    pub fn waits_for(&self) -> Vec<usize> {
        self.needs.iter().chain(&self.gates).copied().collect()
    }
}

impl Entry<'_> {
    /// Whether a stage that it needs is one that it only waits for.
    fn is_gate(&self, other: &Entry<'_>) -> bool {
        other.kind.gates() && !self.kind.needs().kinds.contains(&other.kind.name())
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
        splice_scene(&mut root, &path)?;
        let late = rounds::apply(&mut root, overrides)?;
        let name = read_frame(&root, registry)?;
        let rounds = rounds::unroll(&mut root, &late, registry)?;
        let map = root.fields(WHAT, &KEYS)?;
        let entries = read_entries(map.required(WHAT, "stages")?, registry)?;
        let stages = read_stages(&entries, map.optional("scene"))?;
        Ok(Self {
            name,
            path,
            scene: map.optional("scene").cloned(),
            stages,
            rounds,
        })
    }

    /// The stage of that name.
    #[must_use]
    pub fn stage(&self, name: &str) -> Option<&StageSpec> {
        self.stages.iter().find(|stage| stage.name == name)
    }

    /// Places of the stages to look at, in topological order: all, or `until` and what it needs.
    ///
    /// # Errors
    /// When there is no stage of that name.
    pub fn selection(&self, until: Option<&str>) -> Result<Vec<usize>, InputError> {
        let Some(until) = until else {
            return Ok((0..self.stages.len()).collect());
        };
        let Some(target) = self.stages.iter().position(|stage| stage.name == until) else {
            let names: Vec<&str> = self.stages.iter().map(|stage| stage.name.as_str()).collect();
            let message = format!("no stage `{until}` in {}", self.path.display());
            return Err(InputError::new(message).help(suggestion(until, &names)));
        };
        let needs: Vec<Vec<usize>> = self.stages.iter().map(StageSpec::waits_for).collect();
        let needs: Vec<&[usize]> = needs.iter().map(Vec::as_slice).collect();
        Ok(graph::closure(&needs, target))
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

pub(super) fn read_entries<'a>(stages: &'a Node, registry: &Registry) -> Result<Vec<Entry<'a>>, InputError> {
    let entries = stages.entries("stages")?;
    if entries.is_empty() {
        return Err(stages.error("a pipeline has at least one stage"));
    }
    let mut names = Vec::new();
    for (key, _) in entries {
        let name = key.text("a stage's name")?;
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if name.is_empty() || !name.chars().all(plain) {
            let message = format!("a stage cannot be named {name:?}");
            return Err(key.error(message).help("allowed: letters, digits, '_' and '-'"));
        }
        check_length(key, name)?;
        names.push(name);
    }
    let kinds: Vec<&'static str> = registry.kinds.iter().map(|kind| kind.name()).collect();
    let mut out = Vec::new();
    for ((key, node), name) in entries.iter().zip(&names) {
        node.entries(&format!("stages.{name}"))?;
        let Some(kind) = node.peek("kind") else {
            let message = format!("`kind` is missing in stage `{name}`");
            let allowed = format!("allowed: {}", kinds.join(", "));
            return Err(key.error_labelled(message, "no `kind` in it").help(allowed));
        };
        let word = kind.word("kind", &kinds)?;
        let Some(kind) = registry.kinds.iter().find(|kind| kind.name() == word) else {
            return Err(kind.error(format!("no kind `{word}`")));
        };
        let needs = read_needs(node, &names)?;
        out.push(Entry {
            name,
            key,
            node,
            kind: *kind,
            needs,
        });
    }
    Ok(out)
}

/// Checks all but the stages, and gives the name.
fn read_frame(root: &Node, registry: &Registry) -> Result<String, InputError> {
    let map = root.fields(WHAT, &KEYS)?;
    let version = map.required(WHAT, "version")?;
    if version.whole("version", 0, u64::MAX)? != 1 {
        return Err(version.error(format!(
            "`version` is {}: this deaflow reads version 1",
            version.found()
        )));
    }
    let name = map.required(WHAT, "name")?;
    check_length(name, name.text("name")?)?;
    if let Some(scene) = map.optional("scene") {
        (registry.check_scene)(scene)?;
    }
    map.required(WHAT, "stages")?;
    Ok(name.text("name")?.to_owned())
}

fn check_length(node: &Node, name: &str) -> Result<(), InputError> {
    match name.chars().count() {
        length if length > LONGEST_NAME => Err(node
            .error(format!("a name of {length} characters"))
            .help(format!("allowed: at most {LONGEST_NAME}"))),
        _ => Ok(()),
    }
}

fn read_needs<'a>(node: &'a Node, names: &[&str]) -> Result<Vec<(usize, &'a Node)>, InputError> {
    let mut out: Vec<(usize, &Node)> = Vec::new();
    let Some(needs) = node.peek("needs") else {
        return Ok(out);
    };
    for item in needs.list("needs")? {
        let name = item.text("needs")?;
        let Some(index) = names.iter().position(|other| *other == name) else {
            let message = format!("no stage is named `{name}`");
            return Err(item.error(message).help(suggestion(name, names)));
        };
        if out.iter().any(|(other, _)| *other == index) {
            return Err(item.error(format!("`{name}` is needed twice")));
        }
        out.push((index, item));
    }
    Ok(out)
}

fn read_stages(entries: &[Entry<'_>], scene: Option<&Node>) -> Result<Vec<StageSpec>, InputError> {
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
        stages.push(Some(StageSpec {
            name: entry.name.to_owned(),
            kind: entry.kind,
            needs: places(false),
            gates: places(true),
            stage: entry.kind.read(entry.node, scene)?,
        }));
    }
    let stages: Vec<StageSpec> = order.iter().filter_map(|&index| stages[index].take()).collect();
    check_pieces(&stages, &order, entries)?;
    Ok(stages)
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
    let mut message = format!("the stages need each other in a circle: `{}`", entries[first].name);
    for &index in cycle[1..].iter().chain(&cycle[..1]) {
        message += &format!(" needs `{}`", entries[index].name);
    }
    let item = entries[first].needs.iter().find(|(index, _)| *index == second);
    item.map_or(entries[first].key, |(_, node)| node).error(message)
}

fn check_needs(entry: &Entry<'_>, entries: &[Entry<'_>]) -> Result<(), InputError> {
    let (name, kind, needs) = (entry.name, entry.kind.name(), entry.kind.needs());
    let article = if kind.starts_with(['a', 'e', 'i', 'o', 'u']) {
        "an"
    } else {
        "a"
    };
    let fitting = || {
        let names = entries.iter().filter(|other| needs.kinds.contains(&other.kind.name()));
        match names.map(|other| other.name).collect::<Vec<_>>() {
            none if none.is_empty() => "no stage of this pipeline fits".to_owned(),
            names => format!("stages that fit: {}", names.join(", ")),
        }
    };
    for (index, node) in &entry.needs {
        let found = entries[*index].kind.name();
        if !needs.kinds.contains(&found) && !entry.is_gate(&entries[*index]) {
            let message = match needs.kinds {
                [] => format!("{article} `{kind}` stage needs nothing"),
                kinds => format!(
                    "{article} `{kind}` stage needs {}, and `{}` is {found}",
                    kinds.join(" or "),
                    entries[*index].name
                ),
            };
            return Err(node.error(message).help(fitting()));
        }
    }
    let count = entry
        .needs
        .iter()
        .filter(|(index, _)| !entry.is_gate(&entries[*index]))
        .count();
    if (needs.least..=needs.most).contains(&count) {
        return Ok(());
    }
    let wanted = match (needs.least, needs.most) {
        (least, most) if least == most => format!("{least}"),
        (least, usize::MAX) => format!("at least {least}"),
        (least, most) => format!("{least} to {most}"),
    };
    let message = format!(
        "stage `{name}` needs {wanted} of kind {}, found {count}",
        needs.kinds.join(" or ")
    );
    let node = entry.node.peek("needs").unwrap_or(entry.key);
    Err(node.error(message).help(fitting()))
}

fn suggestion(word: &str, allowed: &[&str]) -> String {
    let list = allowed.join(", ");
    match nearest(word, allowed) {
        Some(near) => format!("did you mean `{near}`? there are: {list}"),
        None => format!("there are: {list}"),
    }
}
