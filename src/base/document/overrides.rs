//! `--set`: values from the command line, checked like those of a file.

use std::borrow::Cow;

use super::error::{InputError, nearest, suggested, suggestion};
use super::node::{Node, NodeValue};

/// The key that a path of one step can replace.
const SCENE: &str = "scene";

/// The key by which a path can name an item of a list.
const NAME: &str = "name";

/// What messages call the keys that a mapping of the file has.
const IN_FILE: &str = "in the file";

/// Errors quote only the value if the path has more bytes.
const MAX_QUOTED_PATH: usize = 500;

/// One `--set path.to.field=VALUE`.
#[derive(Clone, Debug)]
pub struct Override {
    /// What messages call it: `--set path.to.field`, or its option.
    name: String,
    path: Vec<String>,
    /// The steps of the path with their positions in the argument.
    keys: Vec<Node>,
    value: Node,
    /// The value as given, in YAML.
    text: String,
    /// From this depth on, the path is within a stage or the scene, and missing steps are created.
    created_from: usize,
}

impl Override {
    /// Reads `path.to.field=VALUE`, the value in YAML.
    ///
    /// # Errors
    /// When there is no `=`, an empty step in the path, or the value is not YAML.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        let form = "write it as --set stages.NAME.param=VALUE, --set scene.drive.voltage=\"5 kV\" or --set scene=FILE";
        Self::read(text, (2, form))
    }

    /// Reads an override of a scene without a pipeline, in which a path can have a single step: `effects=auto`.
    ///
    /// # Errors
    /// As for [`Override::parse`].
    pub fn of_scene(text: &str) -> Result<Self, InputError> {
        let form = "write it as --set drive.voltage=\"5 kV\", --set effects=auto or --set effects.PART.param=VALUE";
        Self::read(text, (1, form))
    }

    /// Reads `path.to.field=VALUE, VALUE`: the value is the list of these. Errors quote them as given, without
    /// brackets.
    ///
    /// # Errors
    /// As for [`Override::parse`].
    pub fn of_values(text: &str) -> Result<Self, InputError> {
        let Some((path, values)) = text.split_once('=') else {
            return Self::parse(text);
        };
        let read = Self::parse(&format!("{}=[{values}]", path.trim()))?;
        let before = path.len() + 1;
        if before > MAX_QUOTED_PATH {
            return Ok(read);
        }
        // Positions are those within the brackets.
        let list = Node::parse(&read.name, format!("[{values}]"))?.inside(&read.name, text, before - 1);
        let mut from = 0;
        let keys = read.path.iter().map(|step| {
            let start = from + text[from..].find(step.as_str()).unwrap_or_default();
            from = start + step.len();
            list.with_value(NodeValue::Text(step.clone())).at((start, step.len()))
        });
        Ok(Self {
            keys: keys.collect(),
            value: list.clone().at((before, values.len())),
            text: values.trim().to_owned(),
            ..read
        })
    }

    /// Creates the override of an option that stands for a path; errors name the option.
    ///
    /// # Errors
    /// When the value is not YAML, or is missing.
    pub fn of_option(option: &str, path: &str, text: &str) -> Result<Self, InputError> {
        let value = Node::parse(option, text.to_owned())?;
        if matches!(value.value(), NodeValue::Null) {
            return Err(value.error(format!("{option} has no value")));
        }
        let path: Vec<String> = path.split('.').map(str::to_owned).collect();
        let key = |step: &String| value.with_value(NodeValue::Text(step.clone()));
        Ok(Self {
            name: option.to_owned(),
            keys: path.iter().map(key).collect(),
            text: text.trim().to_owned(),
            created_from: created_from(&path, 2),
            value,
            path,
        })
    }

    /// Reads an override with at least `least` steps; `help` shows how to write one.
    fn read(text: &str, (least, help): (usize, &str)) -> Result<Self, InputError> {
        let Some((path, value)) = text.split_once('=') else {
            return Err(InputError::new(format!("--set {text}: '=' is missing")).help(help));
        };
        let path: Vec<String> = path.split('.').map(|step| step.trim().to_owned()).collect();
        let name = format!("--set {}", path.join("."));
        if path.iter().any(String::is_empty) {
            return Err(InputError::new(format!("--set {text}: a step of the path is empty")).help(help));
        }
        if path.len() < least && path != [SCENE] {
            let why = "only values of stages and of the scene can be overridden";
            return Err(InputError::new(format!("{name}: {why}")).help(help));
        }
        let before = text.len() - value.len();
        let given = value.trim().to_owned();
        if given.is_empty() {
            return Err(InputError::new(format!("--set {text}: no value after '='"))
                .help("`null` removes the key of the file; `\"\"` is an empty text"));
        }
        let value = Node::parse(&name, value.to_owned())?;
        let value = match before <= MAX_QUOTED_PATH {
            true => value.inside(&name, text, before),
            false => value,
        };
        let mut from = 0;
        let mut key = |step: &String| {
            if before > MAX_QUOTED_PATH {
                return value.with_value(NodeValue::Text(step.clone()));
            }
            let start = from + text[from..].find(step.as_str()).unwrap_or_default();
            from = start + step.len();
            value.with_value(NodeValue::Text(step.clone())).at((start, step.len()))
        };
        let keys = path.iter().map(&mut key).collect();
        Ok(Self {
            name,
            created_from: created_from(&path, least),
            keys,
            value,
            path,
            text: given,
        })
    }

    /// Returns the dotted path, and the value as given.
    #[must_use]
    pub fn path_and_text(&self) -> (String, String) {
        (self.path.join("."), self.text.clone())
    }

    /// The value.
    #[must_use]
    pub fn value(&self) -> &NodeValue {
        self.value.value()
    }

    /// The value with its position.
    #[must_use]
    pub fn node(&self) -> &Node {
        &self.value
    }

    /// Returns the override with another value.
    #[must_use]
    pub fn with_node(&self, value: Node) -> Self {
        Self { value, ..self.clone() }
    }

    /// Returns the override with messages that quote another one of the same path.
    #[must_use]
    pub fn quoting(self, other: &Self) -> Self {
        Self {
            keys: other.keys.clone(),
            value: other.value.with_value(self.value.value),
            ..self
        }
    }

    /// The path of the field.
    #[must_use]
    pub fn path(&self) -> &[String] {
        &self.path
    }

    /// Sets the value in the tree; `null` removes the key. Every step except the last must exist. Within a stage or the
    /// scene, a missing step is created as a mapping unless it looks like a misspelt key of another part; the reader of
    /// the mapping checks it. In a list a step is the number of an item, from 0, or its `name`.
    ///
    /// # Errors
    /// When a step does not exist or is neither a mapping nor a list, or there is nothing to remove.
    pub fn apply(&self, root: &mut Node) -> Result<(), InputError> {
        let mut at = root;
        let (last, steps) = self.path.split_last().expect("a path has at least one step");
        for (depth, step) in steps.iter().enumerate() {
            let step = self.in_list(at, depth, step)?;
            let step = step.as_ref();
            let (known, parent) = (at.keys(), at.parent_of(step));
            let is_missing = parent.is_none() && at.child_mut(step).is_none();
            if depth >= self.created_from && is_missing && !is_near_part(step, at) {
                at.put(step, self.keys[depth].with_value(NodeValue::Map(Vec::new())));
            }
            let items = items_of(at);
            at = at.child_mut(step).ok_or_else(|| match items {
                Some(items) => self.missing_item(depth, items),
                None => self.missing_step(depth, &known, parent.as_deref()),
            })?;
        }
        let known = at.keys();
        if let Some(items) = items_of(at) {
            let last = self.in_list(at, steps.len(), last)?;
            let item = at
                .child_mut(&last)
                .ok_or_else(|| self.missing_item(steps.len(), items))?;
            return match self.value.value() {
                NodeValue::Null => Err(self
                    .value
                    .error(format!("{}: an item of a list cannot be removed", self.name))
                    .help("write the whole list")),
                _ => {
                    *item = self.value.clone();
                    Ok(())
                }
            };
        }
        let NodeValue::Map(entries) = &mut at.value else {
            let message = format!("{}: `{}` is not a mapping", self.name, steps.join("."));
            return Err(self.value.error(message));
        };
        let position = entries.iter().position(|(key, _)| key.is_text(last));
        match (position, self.value.value()) {
            (Some(position), NodeValue::Null) => drop(entries.remove(position)),
            (None, NodeValue::Null) => {
                let message = format!("{}: there is no `{last}` to remove", self.name);
                return Err(self.keys[steps.len()]
                    .error(message)
                    .help(suggested(last, (IN_FILE, &as_strs(&known)))));
            }
            (Some(position), _) => entries[position].1 = self.value.clone(),
            (None, _) => entries.push((self.keys[steps.len()].clone(), self.value.clone())),
        }
        Ok(())
    }

    /// Returns a step with the number of an item of a list in place of its name. Numbers and other steps stay.
    fn in_list<'s>(&self, at: &Node, depth: usize, step: &'s str) -> Result<Cow<'s, str>, InputError> {
        let NodeValue::List(items) = at.value() else {
            return Ok(Cow::Borrowed(step));
        };
        let name = |item: &'_ Node| match item.peek(NAME)?.value() {
            NodeValue::Text(name) => Some(name.clone()),
            _ => None,
        };
        let names: Vec<Option<String>> = items.iter().map(name).collect();
        let known: Vec<&str> = names.iter().flatten().map(String::as_str).collect();
        if known.is_empty() || step.parse::<usize>().is_ok() {
            return Ok(Cow::Borrowed(step));
        }
        let named: Vec<String> = (0..names.len())
            .filter(|&at| names[at].as_deref() == Some(step))
            .map(|at| at.to_string())
            .collect();
        let list = self.path[..depth].join(".");
        let (message, help) = match &named[..] {
            [one] => return Ok(Cow::Owned(one.clone())),
            [] => (
                format!("{}: no item of `{list}` is named `{step}`", self.name),
                suggested(step, ("names", &known)),
            ),
            several => (
                format!("{}: {} items of `{list}` are named `{step}`", self.name, several.len()),
                format!("names: {}; use a number: {}", known.join(", "), several.join(" or ")),
            ),
        };
        Err(self.keys[depth].error(message).help(help))
    }

    /// Creates the error for a step that is not an item of a list.
    fn missing_item(&self, depth: usize, items: usize) -> InputError {
        let (list, step) = (self.path[..depth].join("."), &self.path[depth]);
        let allowed = match items {
            0 => "the list is empty".to_owned(),
            1 => "allowed: 0".to_owned(),
            _ => format!("allowed: 0 to {}", items - 1),
        };
        self.keys[depth]
            .error(format!("{}: `{list}` has no item `{step}`", self.name))
            .help(allowed)
    }

    /// Creates the error for a missing step; `parent` is a key whose mapping has the step.
    fn missing_step(&self, depth: usize, known: &[String], parent: Option<&str>) -> InputError {
        let step = &self.path[depth];
        let place = match self.path[..depth].join(".").as_str() {
            "" if known.iter().any(|key| key == "stages") => "the pipeline".to_owned(),
            "" => "the scene".to_owned(),
            place => format!("`{place}`"),
        };
        let help = match parent {
            Some(parent) => did_you_mean(&self.path, depth, parent),
            // More parts are allowed than those that the file has.
            None if depth >= self.created_from => suggested(step, (IN_FILE, &as_strs(known))),
            None => suggestion(step, &as_strs(known)),
        };
        let message = format!("{}: no `{step}` in {place}", self.name);
        self.keys[depth].error(message).help(help)
    }
}

/// Returns the depth from which a path is within a stage or the scene. Paths of a scene without a pipeline may have a
/// single step: `least` is 1.
fn created_from(path: &[String], least: usize) -> usize {
    match path.first() {
        _ if least < 2 => 0,
        Some(first) if first == SCENE => 1,
        _ => 2,
    }
}

/// Returns the number of items of a list; `None` for other values.
fn items_of(node: &Node) -> Option<usize> {
    match node.value() {
        NodeValue::List(items) => Some(items.len()),
        _ => None,
    }
}

/// Returns whether a step looks like the misspelt key of a mapping or a list, into which a path can lead: `sides` of a
/// geometry is not `side`, a length.
fn is_near_part(step: &str, node: &Node) -> bool {
    let NodeValue::Map(entries) = node.value() else {
        return false;
    };
    let is_part = |value: &Node| matches!(value.value(), NodeValue::Map(_) | NodeValue::List(_));
    let parts = entries.iter().filter(|(_, value)| is_part(value));
    let keys: Vec<String> = parts.map(|(key, _)| key.describe_plain()).collect();
    nearest(step, &as_strs(&keys)).is_some()
}

fn as_strs(words: &[String]) -> Vec<&str> {
    words.iter().map(String::as_str).collect()
}

/// Suggests the path with a missing step.
fn did_you_mean(path: &[String], depth: usize, missing: &str) -> String {
    let (before, after) = path.split_at(depth);
    let suggested: Vec<&str> = before
        .iter()
        .map(String::as_str)
        .chain([missing])
        .chain(after.iter().map(String::as_str))
        .collect();
    format!("did you mean `{}`?", suggested.join("."))
}
