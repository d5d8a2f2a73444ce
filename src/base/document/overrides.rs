//! `--set`: values from the command line, checked like those of the file.

use super::error::{InputError, nearest, suggestion};
use super::node::{Node, NodeValue};

/// What is replaced as a whole by a path of one step.
const WHOLE: [&str; 1] = ["scene"];

/// A path of more bytes than a person reads is not shown under a refusal: its value is.
const LONGEST: usize = 500;

/// One `--set path.to.field=VALUE`.
#[derive(Clone, Debug)]
pub struct Override {
    path: Vec<String>,
    /// The steps of the path as they stand in the argument, where a caret points that is about one.
    keys: Vec<Node>,
    value: Node,
    /// The value as it was said, in YAML.
    text: String,
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

    /// The same within a scene that stands by itself, where a path of one step names a part of it: `effects=auto`.
    ///
    /// # Errors
    /// As [`Override::parse`].
    pub fn of_scene(text: &str) -> Result<Self, InputError> {
        let form = "write it as --set drive.voltage=\"5 kV\", --set effects=auto or --set effects.PART.param=VALUE";
        Self::read(text, (1, form))
    }

    /// The value of an option that stands for a path: errors name the option, as it was written.
    ///
    /// # Errors
    /// When the value is not YAML, or none.
    pub fn of_option(option: &str, path: &str, text: &str) -> Result<Self, InputError> {
        let value = Node::parse(option, text.to_owned())?;
        if matches!(value.value(), NodeValue::Null) {
            return Err(value.error(format!("{option} has no value")));
        }
        let path: Vec<String> = path.split('.').map(str::to_owned).collect();
        let key = |step: &String| value.with_value(NodeValue::Text(step.clone()));
        Ok(Self {
            keys: path.iter().map(key).collect(),
            text: text.trim().to_owned(),
            value,
            path,
        })
    }

    /// Reads a path of so many steps at least.
    fn read(text: &str, (least, form): (usize, &str)) -> Result<Self, InputError> {
        let Some((path, value)) = text.split_once('=') else {
            return Err(InputError::new(format!("--set {text}: '=' is missing")).help(form));
        };
        let path: Vec<String> = path.split('.').map(|step| step.trim().to_owned()).collect();
        let is_whole = matches!(path.as_slice(), [one] if WHOLE.contains(&one.as_str()));
        if path.iter().any(String::is_empty) || (path.len() < least && !is_whole) {
            return Err(InputError::new(format!("--set {text}: the path is incomplete")).help(form));
        }
        let name = format!("--set {}", path.join("."));
        let before = text.len() - value.len();
        let said = value.trim().to_owned();
        if said.is_empty() {
            return Err(InputError::new(format!("--set {text}: no value after '='"))
                .help("`null` removes the key of the file; `\"\"` is an empty text"));
        }
        let value = Node::parse(&name, value.to_owned())?;
        let value = match before <= LONGEST {
            true => value.inside(&name, text, before),
            false => value,
        };
        let mut from = 0;
        let mut key = |step: &String| {
            if before > LONGEST {
                return value.with_value(NodeValue::Text(step.clone()));
            }
            let start = from + text[from..].find(step.as_str()).unwrap_or_default();
            from = start + step.len();
            value.with_value(NodeValue::Text(step.clone())).at((start, step.len()))
        };
        let keys = path.iter().map(&mut key).collect();
        Ok(Self {
            keys,
            value,
            path,
            text: said,
        })
    }

    /// The dotted path, and the value as it was said.
    #[must_use]
    pub fn said(&self) -> (String, String) {
        (self.path.join("."), self.text.clone())
    }

    /// The value.
    #[must_use]
    pub fn value(&self) -> &NodeValue {
        self.value.value()
    }

    /// The value with its place.
    #[must_use]
    pub fn node(&self) -> &Node {
        &self.value
    }

    /// The same field with another value, for a reference that has been resolved.
    #[must_use]
    pub fn with_node(&self, value: Node) -> Self {
        Self { value, ..self.clone() }
    }

    /// The path of the field.
    #[must_use]
    pub fn path(&self) -> &[String] {
        &self.path
    }

    /// Puts the value into the tree, or takes out what is there where the value is `null`. Every step but the last must exist; within a stage, or a part of the scene, one that does not, and is no
    /// misspelling of one that does, is taken for a mapping of which nothing is written yet. Whoever reads it knows whether it is one.
    ///
    /// # Errors
    /// When a step does not exist or is not a mapping, or there is nothing to take out.
    pub fn apply(&self, root: &mut Node) -> Result<(), InputError> {
        let mut at = root;
        let (last, steps) = self.path.split_last().expect("a path has at least one step");
        for (depth, step) in steps.iter().enumerate() {
            let (known, holder) = (at.keys(), at.holder_of(step));
            if depth >= DEEP && holder.is_none() && at.child_mut(step).is_none() && !is_near(step, &known) {
                at.put(step, self.keys[depth].with_value(NodeValue::Map(Vec::new())));
            }
            let Some(child) = at.child_mut(step) else {
                let place = self.path[..depth].join(".");
                let place = match place.as_str() {
                    "" if known.iter().any(|key| key == "stages") => "the pipeline".to_owned(),
                    "" => "the scene".to_owned(),
                    place => format!("`{place}`"),
                };
                return Err(self.keys[depth]
                    .error(format!("--set {}: no `{step}` in {place}", self.path.join(".")))
                    .help(match holder {
                        Some(holder) => did_you_mean(&self.path, depth, &holder),
                        None => suggestion(step, &known.iter().map(String::as_str).collect::<Vec<_>>()),
                    }));
            };
            at = child;
        }
        let NodeValue::Map(entries) = &mut at.value else {
            return Err(self.value.error(format!(
                "--set {}: `{}` is not a mapping",
                self.path.join("."),
                steps.join(".")
            )));
        };
        if matches!(self.value.value(), NodeValue::Null) {
            let before = entries.len();
            entries.retain(|(key, _)| !key.is_text(last));
            if entries.len() == before {
                let known: Vec<String> = entries.iter().map(|(key, _)| key.describe_plain()).collect();
                let known: Vec<&str> = known.iter().map(String::as_str).collect();
                return Err(self.keys[steps.len()]
                    .error(format!(
                        "--set {}: there is no `{last}` to be taken out",
                        self.path.join(".")
                    ))
                    .help(suggestion(last, &known)));
            }
            return Ok(());
        }
        match entries.iter_mut().find(|(key, _)| key.is_text(last)) {
            Some((_, value)) => *value = self.value.clone(),
            None => entries.push((self.keys[steps.len()].clone(), self.value.clone())),
        }
        Ok(())
    }
}

/// From so many steps on a path leads into a stage, or a part of the scene.
const DEEP: usize = 2;

/// Whether a word is likely to be one of those that are known.
fn is_near(step: &str, known: &[String]) -> bool {
    nearest(step, &known.iter().map(String::as_str).collect::<Vec<_>>()).is_some()
}

/// Advice on a path that lacks a step.
fn did_you_mean(path: &[String], depth: usize, missing: &str) -> String {
    let (before, after) = path.split_at(depth);
    let meant: Vec<&str> = before
        .iter()
        .map(String::as_str)
        .chain([missing])
        .chain(after.iter().map(String::as_str))
        .collect();
    format!("did you mean `{}`?", meant.join("."))
}
