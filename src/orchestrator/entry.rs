//! The stages of a pipeline as they stand in the file: name, kind and needs, before their own keys are read.

use std::collections::{HashMap, HashSet};

use super::kind::Kind;
use deaflow_base::{InputError, Node, Schema, is_plain_name, nearest};

/// Characters in the name of a pipeline or stage.
const LONGEST_NAME: usize = 200;

/// What a pipeline may be made of.
pub struct Registry {
    /// The kinds of stages.
    pub kinds: Vec<&'static dyn Kind>,
    /// Checks a scene, so that a wrong one is refused even where no stage uses it.
    pub check_scene: fn(&Node) -> Result<(), InputError>,
    /// What a scene may look like.
    pub scene_schema: fn() -> Schema,
    /// Stages that a pipeline with sweeps may have.
    pub most_stages: usize,
}

/// A stage whose name, kind and needs have been read.
pub struct Entry<'a> {
    /// Its name.
    pub name: &'a str,
    /// Where that stands.
    pub key: &'a Node,
    /// Its mapping.
    pub node: &'a Node,
    /// Its kind.
    pub kind: &'static dyn Kind,
    /// The stages that it needs, by their places in the file.
    pub needs: Vec<(usize, &'a Node)>,
}

impl Entry<'_> {
    /// Whether a stage that it needs is one that it only waits for.
    pub fn is_gate(&self, other: &Entry<'_>) -> bool {
        other.kind.gates() && !self.needs_kind_of(other) && !self.optional_needs(other)
    }

    /// Whether a stage is one of those of which it needs so many.
    fn needs_kind_of(&self, other: &Entry<'_>) -> bool {
        self.kind.needs().kinds.contains(&other.kind.name())
    }

    /// Whether a stage is one that it reads beside these.
    fn optional_needs(&self, other: &Entry<'_>) -> bool {
        self.kind.optional_needs().contains(&other.kind.name())
    }
}

/// The stages by name, in the order of the file.
///
/// # Errors
/// When a name, a kind or a need cannot be accepted, with the place.
pub fn read_entries<'a>(stages: &'a Node, registry: &Registry) -> Result<Vec<Entry<'a>>, InputError> {
    let entries = stages.entries("stages")?;
    if entries.is_empty() {
        return Err(stages.error("a pipeline has at least one stage"));
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
            return Err(key.error_labelled(message, "no `kind` in it").help(allowed));
        };
        let word = kind.word("kind", &kinds)?;
        let Some(kind) = registry.kinds.iter().find(|kind| kind.name() == word) else {
            return Err(kind.error(format!("no kind `{word}`")));
        };
        let needs = read_needs(node, &names, &places)?;
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

/// Refuses names that a stage cannot have in a file.
///
/// # Errors
/// With the place.
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

/// Refuses needs that the kind of a stage does not allow.
///
/// # Errors
/// With the place and the stages that fit.
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
            none if none.is_empty() => "no stage of this pipeline fits".to_owned(),
            names => format!("stages that fit: {}", names.join(", ")),
        }
    };
    for (index, node) in &entry.needs {
        let found = entries[*index].kind.name();
        let other = &entries[*index];
        if !entry.needs_kind_of(other) && !entry.optional_needs(other) && !entry.is_gate(other) {
            let message = match needs.kinds {
                [] => format!("{article} `{kind}` stage needs nothing"),
                kinds => format!(
                    "{article} `{kind}` stage needs {}, and `{}` is {found}",
                    kinds.join(" or "),
                    other.name
                ),
            };
            return Err(node.error(message).help(fitting()));
        }
    }
    let counted = |(index, _): &&(usize, &Node)| entry.needs_kind_of(&entries[*index]);
    let count = entry.needs.iter().filter(counted).count();
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
    let beside = entry
        .needs
        .iter()
        .find(|(index, _)| entry.optional_needs(&entries[*index]));
    let advice = match beside {
        None => fitting(),
        Some((index, _)) => format!(
            "`{}` ({}) is taken beside them and not alone; {}",
            entries[*index].name,
            entries[*index].kind.name(),
            fitting()
        ),
    };
    Err(node.error(message).help(advice))
}

fn read_needs<'a>(
    node: &'a Node,
    names: &[&str],
    places: &HashMap<&str, usize>,
) -> Result<Vec<(usize, &'a Node)>, InputError> {
    let mut out: Vec<(usize, &Node)> = Vec::new();
    let mut seen = HashSet::new();
    let Some(needs) = node.peek("needs") else {
        return Ok(out);
    };
    for item in needs.list("needs")? {
        let name = item.text("needs")?;
        let Some(&index) = places.get(name) else {
            let message = format!("no stage is named `{name}`");
            return Err(item.error(message).help(suggestion(name, names)));
        };
        if !seen.insert(index) {
            return Err(item.error(format!("`{name}` is needed twice")));
        }
        out.push((index, item));
    }
    Ok(out)
}

/// A refusal of stages that need each other in a circle, each the next and the last the first.
pub fn refuse_cycle_of(cycle: &[(&str, &Node)]) -> InputError {
    let mut message = "the stages need each other in a circle:".to_owned();
    let Some(((first, place), others)) = cycle.split_first() else {
        return InputError::new(message);
    };
    message += &format!(" `{first}`");
    for (name, _) in others {
        message += &format!(" needs `{name}`");
    }
    place.error(message + &format!(" needs `{first}`"))
}

/// Refuses a name that is too long.
///
/// # Errors
/// With the place.
pub fn check_length(node: &Node, name: &str) -> Result<(), InputError> {
    match name.chars().count() {
        length if length > LONGEST_NAME => Err(node
            .error(format!("a name of {length} characters"))
            .help(format!("allowed: at most {LONGEST_NAME}"))),
        _ => Ok(()),
    }
}

/// Names that are listed in advice.
const LISTED: usize = 30;

/// What to write instead of a name that is not there.
pub fn suggestion(word: &str, allowed: &[&str]) -> String {
    let mut list = allowed.iter().take(LISTED).copied().collect::<Vec<_>>().join(", ");
    if allowed.len() > LISTED {
        list += &format!(", and {} more", allowed.len() - LISTED);
    }
    match nearest(word, allowed) {
        Some(near) => format!("did you mean `{near}`? there are: {list}"),
        None => format!("there are: {list}"),
    }
}
