//! Reads name, kind and needs of the stages of a pipeline, before their other keys.

use std::collections::{HashMap, HashSet};

use super::kind::Kind;
use super::scene_from;
use super::without::{WITHOUT, names_stage};
use deaflow_base::{InputError, Node, Schema, is_plain_name, nearest};

/// Maximum length of the name of a pipeline or stage.
const LONGEST_NAME: usize = 200;

/// The available kinds of stages, and the scene format.
pub struct Registry {
    /// The kinds of stages.
    pub kinds: Vec<&'static dyn Kind>,
    /// Replaces the files that a scene names by their content.
    pub complete_scene: fn(&mut Node) -> Result<(), InputError>,
    /// Checks a scene, also if no stage uses it.
    pub check_scene: fn(&Node) -> Result<(), InputError>,
    /// Returns the schema of scenes.
    pub scene_schema: fn() -> Schema,
    /// Maximum number of stages of a pipeline with sweeps.
    pub most_stages: usize,
}

impl Registry {
    /// Returns the kind of a stage, if it is known.
    #[must_use]
    pub fn kind_of(&self, stage: &Node) -> Option<&'static dyn Kind> {
        let word = stage.peek("kind")?.text("kind").ok()?;
        self.kinds.iter().copied().find(|kind| kind.name() == word)
    }

    /// Whether the kind of a stage reads a scene.
    #[must_use]
    pub fn reads_scene(&self, stage: &Node) -> bool {
        self.kind_of(stage).is_some_and(Kind::reads_scene)
    }
}

/// A stage whose name, kind and needs have been read.
pub struct Entry<'a> {
    /// Its name.
    pub name: &'a str,
    /// The node of its name.
    pub key: &'a Node,
    /// Its mapping.
    pub node: &'a Node,
    /// Its kind.
    pub kind: &'static dyn Kind,
    /// The stages that it needs, as indices in the file: those of `needs`, then those of `without`.
    pub needs: Vec<(usize, &'a Node)>,
    /// How many of them `needs` lists.
    pub listed: usize,
    /// The stage that makes its scene, if it is not that of the pipeline.
    pub scene: Option<(usize, &'a Node)>,
}

impl<'a> Entry<'a> {
    /// The stages that `needs` lists.
    pub fn listed(&self) -> &[(usize, &'a Node)] {
        &self.needs[..self.listed]
    }

    /// The stages that `without` names.
    pub fn without(&self) -> &[(usize, &'a Node)] {
        &self.needs[self.listed..]
    }

    /// The stages that have to be built before it, as indices in the file.
    pub fn waits_for(&self) -> Vec<usize> {
        self.needs.iter().chain(&self.scene).map(|(index, _)| *index).collect()
    }

    /// Whether it only waits for a stage that `needs` lists.
    pub fn is_gate(&self, other: &Entry<'_>) -> bool {
        other.kind.gates() && !self.needs_kind_of(other) && !self.optional_needs(other)
    }

    /// Whether a stage is of a kind whose number is checked.
    fn needs_kind_of(&self, other: &Entry<'_>) -> bool {
        self.kind.needs().kinds.contains(&other.kind.name())
    }

    /// Whether a stage is of an optional kind.
    fn optional_needs(&self, other: &Entry<'_>) -> bool {
        self.kind.optional_needs().contains(&other.kind.name())
    }
}

/// Reads the stages, in the order of the file.
///
/// # Errors
/// If a name, a kind or a need is not valid, with the position.
pub fn read_entries<'a>(stages: &'a Node, registry: &Registry) -> Result<Vec<Entry<'a>>, InputError> {
    let entries = stages.entries("stages")?;
    if entries.is_empty() {
        return Err(stages.error("the pipeline has no stages"));
    }
    let mut names = Vec::with_capacity(entries.len());
    for (key, _) in entries {
        let name = key.text("a stage's name")?;
        check_length(key, name)?;
        names.push(name);
    }
    let places: HashMap<&str, usize> = names.iter().enumerate().map(|(place, name)| (*name, place)).collect();
    let kinds: Vec<&'static str> = registry.kinds.iter().map(|kind| kind.name()).collect();
    let mut out = Vec::new();
    for ((key, node), name) in entries.iter().zip(&names) {
        node.entries(&format!("stages.{name}"))?;
        let Some(kind) = node.peek("kind") else {
            let message = format!("`kind` is missing in stage `{name}`");
            let allowed = format!("allowed: {}", kinds.join(", "));
            return Err(key.error_labelled(message, "has no `kind`").help(allowed));
        };
        let word = kind.word("kind", &kinds)?;
        let Some(kind) = registry.kinds.iter().find(|kind| kind.name() == word) else {
            return Err(kind.error(format!("unknown kind `{word}`")));
        };
        let (needs, listed) = read_needs(node, *kind, &names, &places)?;
        let scene = read_scene_from(node, *kind, &names, &places)?;
        out.push(Entry {
            name,
            key,
            node,
            kind: *kind,
            needs,
            listed,
            scene,
        });
    }
    Ok(out)
}

/// Checks the names of stages.
///
/// # Errors
/// If a name is not valid, with the position.
pub fn check_names(stages: &Node) -> Result<(), InputError> {
    for (key, _) in stages.entries("stages")? {
        let name = key.text("a stage's name")?;
        if !is_plain_name(name, usize::MAX) {
            let message = format!("a stage cannot be named {name:?}");
            return Err(key.error(message).help("allowed: letters, digits, '_' and '-'"));
        }
        check_length(key, name)?;
    }
    Ok(())
}

/// Checks the needs of a stage against its kind.
///
/// # Errors
/// If they are not allowed, with the position and the stages that are.
pub fn check_needs(entry: &Entry<'_>, entries: &[Entry<'_>]) -> Result<(), InputError> {
    let (name, kind, needs) = (entry.name, entry.kind.name(), entry.kind.needs());
    let article = if kind.starts_with(['a', 'e', 'i', 'o', 'u']) {
        "an"
    } else {
        "a"
    };
    let fitting = || {
        let names = entries.iter().filter(|other| needs.kinds.contains(&other.kind.name()));
        match names.map(|other| other.name).collect::<Vec<_>>() {
            none if none.is_empty() => "no stage of this pipeline is allowed here".to_owned(),
            names => format!("allowed: {}", names.join(", ")),
        }
    };
    if let Some((index, node)) = entry.scene
        && !entries[index].kind.makes_scene()
    {
        let other = &entries[index];
        let message = format!(
            "`{}` is of kind {}, which makes no scene",
            other.name,
            other.kind.name()
        );
        let makers = entries.iter().filter(|other| other.kind.makes_scene());
        return Err(node
            .error(message)
            .help(match makers.map(|other| other.name).collect::<Vec<_>>() {
                none if none.is_empty() => "no stage of this pipeline makes a scene, as a fit does".to_owned(),
                names => format!("allowed: {}", names.join(", ")),
            }));
    }
    let allowed = entry.kind.without();
    for (index, node) in entry.without() {
        let other = &entries[*index];
        if !allowed.contains(&other.kind.name()) {
            let message = format!(
                "`{WITHOUT}` names stages of kind {}, but `{}` is of kind {}",
                allowed.join(" or "),
                other.name,
                other.kind.name()
            );
            let names = entries.iter().filter(|other| allowed.contains(&other.kind.name()));
            let names: Vec<&str> = names.map(|other| other.name).collect();
            return Err(node.error(message).help(match names.is_empty() {
                true => format!("this pipeline has no stage of kind {}", allowed.join(" or ")),
                false => format!("allowed: {}", names.join(", ")),
            }));
        }
    }
    for (index, node) in entry.listed() {
        let found = entries[*index].kind.name();
        let other = &entries[*index];
        if !entry.needs_kind_of(other) && !entry.optional_needs(other) && !entry.is_gate(other) {
            let message = match needs.kinds {
                [] => format!("{article} `{kind}` stage has no `needs`"),
                kinds => format!(
                    "{article} `{kind}` stage needs {}, but `{}` is of kind {found}",
                    kinds.join(" or "),
                    other.name
                ),
            };
            return Err(node.error(message).help(fitting()));
        }
    }
    let counted = |(index, _): &&(usize, &Node)| entry.needs_kind_of(&entries[*index]);
    let count = entry.listed().iter().filter(counted).count();
    if (needs.least..=needs.most).contains(&count) {
        return Ok(());
    }
    let expected = match (needs.least, needs.most) {
        (least, most) if least == most => format!("{least}"),
        (least, usize::MAX) => format!("at least {least}"),
        (least, most) => format!("{least} to {most}"),
    };
    let message = format!(
        "stage `{name}` needs {expected} {} of kind {}, found {count}",
        if expected == "1" { "stage" } else { "stages" },
        needs.kinds.join(" or ")
    );
    if let Some(key) = misspelt_needs(entry) {
        return Err(key
            .error_labelled(
                format!("unknown key `{}` in {article} `{kind}` stage", key.written()),
                "not allowed here",
            )
            .help("did you mean `needs`?"));
    }
    let node = entry.node.peek("needs").unwrap_or(entry.key);
    let optional = entry
        .listed()
        .iter()
        .find(|(index, _)| entry.optional_needs(&entries[*index]));
    let advice = match optional {
        None => fitting(),
        Some((index, _)) => format!(
            "`{}` ({}) is only allowed in addition to them; {}",
            entries[*index].name,
            entries[*index].kind.name(),
            fitting()
        ),
    };
    Err(node.error(message).help(advice))
}

/// Returns the key of a stage without `needs` that may be meant for it: one that is not of its kind and is similar.
fn misspelt_needs<'a>(entry: &Entry<'a>) -> Option<&'a Node> {
    let fields = entry.kind.schema();
    let is_known = |name: &str| fields.iter().any(|fields| fields.keys().any(|known| known == name));
    let is_absent = entry.node.peek("needs").is_none();
    misspelt(entry.node, "needs", is_known).filter(|_| is_absent)
}

/// Returns the first key of a mapping that is similar to one that is meant, and is not known.
pub fn misspelt<'n>(node: &'n Node, meant: &str, is_known: impl Fn(&str) -> bool) -> Option<&'n Node> {
    let keys = node.entries("a stage").ok()?.iter().map(|(key, _)| key);
    keys.into_iter().find(|key| {
        let name = key.written();
        name != meant && !is_known(&name) && nearest(&name, &[meant]).is_some()
    })
}

/// Stages, as indices in the file, and where they are named.
type NamedStages<'a> = Vec<(usize, &'a Node)>;

/// Returns the stages that a stage needs, and how many of them `needs` lists.
fn read_needs<'a>(
    node: &'a Node,
    kind: &dyn Kind,
    names: &[&str],
    places: &HashMap<&str, usize>,
) -> Result<(NamedStages<'a>, usize), InputError> {
    let mut out = NamedStages::new();
    let mut seen = HashSet::new();
    let mut add = |key: &str, item: &'a Node| {
        let index = stage_named(item, key, names, places)?;
        if !seen.insert(index) {
            return Err(item
                .error(format!("`{}` is listed twice", names[index]))
                .help("name it once, in `needs` or in another key"));
        }
        out.push((index, item));
        Ok(())
    };
    let mut listed = 0;
    if let Some(needs) = node.peek("needs") {
        let needs = needs.list("needs")?;
        needs.iter().try_for_each(|item| add("needs", item))?;
        listed = needs.len();
    }
    if let Some(without) = node.peek(WITHOUT).filter(|_| !kind.without().is_empty()) {
        for item in without.list(WITHOUT)? {
            if names_stage(item.text(WITHOUT)?) {
                add(WITHOUT, item)?;
            }
        }
    }
    Ok((out, listed))
}

/// Returns the index of the stage that a node names.
fn stage_named(item: &Node, key: &str, names: &[&str], places: &HashMap<&str, usize>) -> Result<usize, InputError> {
    let name = item.text(key)?;
    places.get(name).copied().ok_or_else(|| {
        let message = format!("no stage is named `{name}`");
        item.error(message).help(suggestion(name, names))
    })
}

/// Returns the stage that makes the scene of a stage, if its kind reads one.
fn read_scene_from<'a>(
    node: &'a Node,
    kind: &dyn Kind,
    names: &[&str],
    places: &HashMap<&str, usize>,
) -> Result<Option<(usize, &'a Node)>, InputError> {
    if !kind.reads_scene() {
        return Ok(None);
    }
    let Some(from) = scene_from::named(node)? else {
        return Ok(None);
    };
    Ok(Some((stage_named(from, scene_from::FROM, names, places)?, from)))
}

/// Returns the error for stages that need each other in a cycle, each the next and the last the first.
pub fn refuse_cycle_of(cycle: &[(&str, &Node)]) -> InputError {
    let mut message = "the stages need each other in a cycle:".to_owned();
    let Some(((first, place), others)) = cycle.split_first() else {
        return InputError::new(message);
    };
    message += &format!(" `{first}`");
    for (name, _) in others {
        message += &format!(" needs `{name}`");
    }
    place.error(message + &format!(" needs `{first}`"))
}

/// Checks the length of a name.
///
/// # Errors
/// If it is too long, with the position.
pub fn check_length(node: &Node, name: &str) -> Result<(), InputError> {
    match name.chars().count() {
        length if length > LONGEST_NAME => Err(node
            .error(format!("the name has {length} characters"))
            .help(format!("allowed: at most {LONGEST_NAME}"))),
        _ => Ok(()),
    }
}

/// Maximum number of names in a suggestion.
const LISTED: usize = 30;

/// Returns a suggestion for an unknown name.
pub fn suggestion(word: &str, allowed: &[&str]) -> String {
    let mut list = allowed.iter().take(LISTED).copied().collect::<Vec<_>>().join(", ");
    if allowed.len() > LISTED {
        list += &format!(", and {} more", allowed.len() - LISTED);
    }
    match nearest(word, allowed) {
        Some(near) => format!("did you mean `{near}`? available: {list}"),
        None => format!("available: {list}"),
    }
}
