//! The tree: values with their positions.

use std::path::Path;
use std::sync::Arc;

use super::error::InputError;
use super::source::Source;

/// The most numbers without a unit that a warning lists.
const MAX_BARE: usize = 4;

/// The value of a node.
#[derive(Clone, Debug)]
pub enum NodeValue {
    /// No value.
    Null,
    /// A boolean.
    Bool(bool),
    /// A plain scalar that is a number, as written.
    Number(String),
    /// Any other scalar.
    Text(String),
    /// A sequence.
    List(Vec<Node>),
    /// A mapping in the order of the file.
    Map(Vec<(Node, Node)>),
}

/// A value with its position.
#[derive(Clone, Debug)]
pub struct Node {
    pub(super) value: NodeValue,
    pub(super) span: (usize, usize),
    pub(super) source: Arc<Source>,
    /// Keys that were read and removed earlier; error messages list them as allowed.
    pub(super) removed_keys: &'static [&'static str],
}

impl Node {
    /// The value.
    #[must_use]
    pub fn value(&self) -> &NodeValue {
        &self.value
    }

    /// Creates an error at this node.
    #[must_use]
    pub fn error(&self, message: impl Into<String>) -> InputError {
        self.error_labelled(message, "here")
    }

    /// Creates an error at this node with a label at the caret.
    #[must_use]
    pub fn error_labelled(&self, message: impl Into<String>, label: impl Into<String>) -> InputError {
        InputError::at(&self.source, self.span, message.into(), label.into())
    }

    /// Gives an error without a position that of this node.
    #[must_use]
    pub fn place(&self, error: InputError) -> InputError {
        if error.span.is_some() {
            return error;
        }
        let mut placed = self.error(error.message);
        placed.help = error.help;
        placed
    }

    /// Returns `file:line` of this node.
    #[must_use]
    pub fn position(&self) -> String {
        let before = &self.source.text[..self.span.0.min(self.source.text.len())];
        format!("{}:{}", self.source.name, before.matches('\n').count() + 1)
    }

    /// The file of the node, or the name of its `--set` argument.
    #[must_use]
    pub fn file(&self) -> &Path {
        Path::new(&self.source.name)
    }

    /// Says how numbers without a unit in this tree were read, as in `drive.voltage: 5.25 as 5.25 V`, each once, with
    /// their paths; `None` if there are none. Zero needs no unit.
    #[must_use]
    pub fn bare_numbers(&self) -> Option<String> {
        let mut found: Vec<(&Self, String)> = Vec::new();
        self.add_bare(&mut Vec::new(), &mut found);
        let shown = found.iter().take(MAX_BARE).map(|(_, text)| text.as_str());
        let shown: Vec<&str> = shown.collect();
        let more = match found.len().saturating_sub(MAX_BARE) {
            0 => String::new(),
            more => format!(", and {more} more"),
        };
        (!shown.is_empty()).then(|| {
            format!(
                "numbers without a unit were read in base units: {}{more}",
                shown.join(", ")
            )
        })
    }

    fn add_bare<'a>(&'a self, path: &mut Vec<String>, found: &mut Vec<(&'a Self, String)>) {
        match &self.value {
            NodeValue::Map(entries) => {
                for (key, value) in entries {
                    path.push(key.describe_plain());
                    value.add_bare(path, found);
                    path.pop();
                }
            }
            NodeValue::List(items) => items.iter().for_each(|item| item.add_bare(path, found)),
            NodeValue::Number(text) | NodeValue::Text(text) => {
                let is_same = |other: &Self| Arc::ptr_eq(&other.source, &self.source) && other.span == self.span;
                if let Some(read) = self.source.bare_at(self.span)
                    && !found.iter().any(|(other, _)| is_same(other))
                {
                    found.push((self, format!("{}: {text} as {read}", path.join("."))));
                }
            }
            NodeValue::Null | NodeValue::Bool(_) => {}
        }
    }

    /// Creates a node with another value at this position.
    #[must_use]
    pub fn with_value(&self, value: NodeValue) -> Self {
        Self {
            value,
            span: self.span,
            source: self.source.clone(),
            removed_keys: &[],
        }
    }

    /// Moves the node to another position of its source.
    #[must_use]
    pub(super) fn at(self, span: (usize, usize)) -> Self {
        Self { span, ..self }
    }

    /// Changes the source to a text that contains the current one from byte `from` on.
    #[must_use]
    pub(super) fn inside(self, name: &str, whole: &str, from: usize) -> Self {
        let source = Arc::new(Source::new(name.to_owned(), whole.to_owned()));
        self.shifted(&source, from)
    }

    fn shifted(self, source: &Arc<Source>, by: usize) -> Self {
        let value = match self.value {
            NodeValue::List(items) => NodeValue::List(items.into_iter().map(|item| item.shifted(source, by)).collect()),
            NodeValue::Map(entries) => NodeValue::Map(
                entries
                    .into_iter()
                    .map(|(key, value)| (key.shifted(source, by), value.shifted(source, by)))
                    .collect(),
            ),
            plain => plain,
        };
        Self {
            value,
            span: (self.span.0 + by, self.span.1),
            source: source.clone(),
            removed_keys: self.removed_keys,
        }
    }

    /// Returns the keys of a mapping, in order; none of other values.
    #[must_use]
    pub fn keys(&self) -> Vec<String> {
        match &self.value {
            NodeValue::Map(entries) => entries.iter().map(|(k, _)| k.describe_plain()).collect(),
            _ => Vec::new(),
        }
    }

    /// Returns the key of the first entry that is a mapping with `key`, to suggest a missing step of a path.
    pub(super) fn parent_of(&self, key: &str) -> Option<String> {
        let NodeValue::Map(entries) = &self.value else {
            return None;
        };
        let parent = entries.iter().find(|(_, value)| value.peek(key).is_some());
        parent.map(|(key, _)| key.describe_plain())
    }

    /// Returns the value of `key`, or the item of a list whose number from 0 it is, mutable.
    pub fn child_mut(&mut self, key: &str) -> Option<&mut Node> {
        match &mut self.value {
            NodeValue::Map(entries) => entries.iter_mut().find(|(k, _)| k.is_text(key)).map(|(_, v)| v),
            NodeValue::List(items) => items.get_mut(key.parse::<usize>().ok()?),
            _ => None,
        }
    }

    /// Replaces the value of `key` if it exists.
    pub fn replace(&mut self, key: &str, node: Node) {
        if let Some(child) = self.child_mut(key) {
            *child = node;
        }
    }

    /// Sets the value of `key` in a mapping; a new key is added at the end.
    pub fn put(&mut self, key: &str, value: Node) {
        let name = value.with_value(NodeValue::Text(key.to_owned()));
        if let NodeValue::Map(entries) = &mut self.value {
            match entries.iter_mut().find(|(k, _)| k.is_text(key)) {
                Some((_, existing)) => *existing = value,
                None => entries.push((name, value)),
            }
        }
    }

    /// Removes `key` from a mapping.
    pub fn remove(&mut self, key: &str) {
        if let NodeValue::Map(entries) = &mut self.value {
            entries.retain(|(k, _)| !k.is_text(key));
        }
    }

    /// Removes the keys that start with `prefix` from a mapping.
    pub fn remove_starting_with(&mut self, prefix: &str) {
        if let NodeValue::Map(entries) = &mut self.value {
            entries.retain(|(key, _)| !matches!(&key.value, NodeValue::Text(name) if name.starts_with(prefix)));
        }
    }

    /// Returns the mapping without `key`.
    #[must_use]
    pub fn without(&self, key: &str) -> Self {
        let value = match &self.value {
            NodeValue::Map(entries) => {
                let others = entries.iter().filter(|(k, _)| !k.is_text(key));
                NodeValue::Map(others.cloned().collect())
            }
            other => other.clone(),
        };
        Self {
            removed_keys: self.removed_keys,
            ..self.with_value(value)
        }
    }

    /// Lists keys as allowed in error messages of the mappings in this one, although they were read and removed
    /// earlier.
    pub fn set_removed_keys(&mut self, keys_of: impl Fn(&Self) -> &'static [&'static str]) {
        if let NodeValue::Map(entries) = &mut self.value {
            entries
                .iter_mut()
                .for_each(|(_, value)| value.removed_keys = keys_of(value));
        }
    }

    /// Adds entries at the end of a mapping.
    pub fn extend(&mut self, more: Vec<(Node, Node)>) {
        if let NodeValue::Map(entries) = &mut self.value {
            entries.extend(more);
        }
    }

    /// Returns the value of `key` without checking the other keys.
    #[must_use]
    pub fn peek(&self, key: &str) -> Option<&Node> {
        match &self.value {
            NodeValue::Map(entries) => entries.iter().find(|(k, _)| k.is_text(key)).map(|(_, v)| v),
            _ => None,
        }
    }

    /// Returns the boolean if the value is one, also in the words of YAML 1.1.
    #[must_use]
    pub fn as_bool(&self) -> Option<bool> {
        match &self.value {
            NodeValue::Bool(value) => Some(*value),
            NodeValue::Text(word) => match word.as_str() {
                "on" | "On" | "ON" | "yes" | "Yes" | "YES" => Some(true),
                "off" | "Off" | "OFF" | "no" | "No" | "NO" => Some(false),
                _ => None,
            },
            _ => None,
        }
    }

    /// Returns whether the value is this text, or a number written like this.
    #[must_use]
    pub fn is_text(&self, text: &str) -> bool {
        matches!(&self.value, NodeValue::Text(t) | NodeValue::Number(t) if t == text)
    }

    pub(super) fn describe_plain(&self) -> String {
        match &self.value {
            NodeValue::Null => "null".into(),
            NodeValue::Bool(b) => b.to_string(),
            NodeValue::Number(t) | NodeValue::Text(t) => t.clone(),
            NodeValue::List(_) => "a list".into(),
            NodeValue::Map(_) => "a mapping".into(),
        }
    }

    /// Returns whether the value is an empty mapping.
    #[must_use]
    pub fn is_empty_map(&self) -> bool {
        matches!(&self.value, NodeValue::Map(entries) if entries.is_empty())
    }

    /// Returns the value in backticks, for messages about keys.
    #[must_use]
    pub fn quoted(&self) -> String {
        format!("`{}`", self.describe_plain())
    }

    /// Describes the value in a message.
    #[must_use]
    pub fn found(&self) -> String {
        match &self.value {
            NodeValue::Null => "nothing".into(),
            NodeValue::Text(t) => format!("{t:?}"),
            _ => self.describe_plain(),
        }
    }

    /// Returns the value on one line, with the units of the document: `{ voltage: 5.25 kV }`.
    #[must_use]
    pub fn written(&self) -> String {
        let joined = |parts: Vec<String>| parts.join(", ");
        match &self.value {
            NodeValue::List(items) => format!("[{}]", joined(items.iter().map(Self::written_inside).collect())),
            NodeValue::Map(entries) if entries.is_empty() => "{}".to_owned(),
            NodeValue::Map(entries) => format!("{{ {} }}", joined(written_entries(entries))),
            _ => self.describe_plain(),
        }
    }

    /// Does the same within a list or a mapping, where a text with brackets or commas needs quotes (YAML 1.2, 7.3.3).
    fn written_inside(&self) -> String {
        match &self.value {
            NodeValue::Text(text) if text.contains(['{', '}', '[', ']', ',']) => {
                format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
            }
            _ => self.written(),
        }
    }

    /// Returns the entries of a mapping, each on one line; none for other values.
    #[must_use]
    pub fn written_entries(&self) -> Vec<String> {
        match &self.value {
            NodeValue::Map(entries) => written_entries(entries),
            _ => Vec::new(),
        }
    }
}

fn written_entries(entries: &[(Node, Node)]) -> Vec<String> {
    let entry = |(key, value): &(Node, Node)| format!("{}: {}", key.describe_plain(), value.written_inside());
    entries.iter().map(entry).collect()
}
