//! The tree: values with their places.

use std::path::Path;
use std::sync::Arc;

use super::error::InputError;

/// A named text: a file, or one `--set` argument.
#[derive(Debug)]
pub struct Source {
    pub(super) name: String,
    pub(super) text: String,
}

/// What a node holds.
#[derive(Clone, Debug)]
pub enum NodeValue {
    /// Nothing.
    Null,
    /// A truth value.
    Bool(bool),
    /// A plain scalar that reads as a number, as it was written.
    Number(String),
    /// Any other scalar.
    Text(String),
    /// A sequence.
    List(Vec<Node>),
    /// A mapping in the order of the file.
    Map(Vec<(Node, Node)>),
}

/// A value with its place.
#[derive(Clone, Debug)]
pub struct Node {
    pub(super) value: NodeValue,
    pub(super) span: (usize, usize),
    pub(super) source: Arc<Source>,
    /// Keys that were read before the others and are gone, told among those that are allowed.
    pub(super) gone: &'static [&'static str],
}

impl Node {
    /// What the node holds.
    #[must_use]
    pub fn value(&self) -> &NodeValue {
        &self.value
    }

    /// A refusal of this node.
    #[must_use]
    pub fn error(&self, message: impl Into<String>) -> InputError {
        self.error_labelled(message, "here")
    }

    /// A refusal of this node with a word of one's own at the caret.
    #[must_use]
    pub fn error_labelled(&self, message: impl Into<String>, label: impl Into<String>) -> InputError {
        InputError::at(&self.source, self.span, message.into(), label.into())
    }

    /// `file:line` of this node.
    #[must_use]
    pub fn place(&self) -> String {
        let line = self.source.text[..self.span.0.min(self.source.text.len())]
            .matches('\n')
            .count()
            + 1;
        format!("{}:{line}", self.source.name)
    }

    /// The file that the node stands in, or what stands for one (a `--set` argument).
    #[must_use]
    pub fn file(&self) -> &Path {
        Path::new(&self.source.name)
    }

    /// Another value at the place of this node, for what follows from it.
    #[must_use]
    pub fn with_value(&self, value: NodeValue) -> Self {
        Self {
            value,
            span: self.span,
            source: self.source.clone(),
            gone: &[],
        }
    }

    /// The node at another place of its source.
    #[must_use]
    pub(super) fn at(self, span: (usize, usize)) -> Self {
        Self { span, ..self }
    }

    /// The node of a text that stands within another, from a byte on: its places are those of the whole.
    #[must_use]
    pub(super) fn inside(self, name: &str, whole: &str, from: usize) -> Self {
        let source = Arc::new(Source {
            name: name.to_owned(),
            text: whole.to_owned(),
        });
        self.moved(&source, from)
    }

    fn moved(self, source: &Arc<Source>, by: usize) -> Self {
        let value = match self.value {
            NodeValue::List(items) => NodeValue::List(items.into_iter().map(|item| item.moved(source, by)).collect()),
            NodeValue::Map(entries) => NodeValue::Map(
                entries
                    .into_iter()
                    .map(|(key, value)| (key.moved(source, by), value.moved(source, by)))
                    .collect(),
            ),
            plain => plain,
        };
        Self {
            value,
            span: (self.span.0 + by, self.span.1),
            source: source.clone(),
            gone: self.gone,
        }
    }

    pub(super) fn keys(&self) -> Vec<String> {
        match &self.value {
            NodeValue::Map(entries) => entries.iter().map(|(k, _)| k.describe_plain()).collect(),
            _ => Vec::new(),
        }
    }

    /// The key of the first entry that is a mapping with `key` in it: where somebody who left a step out may have meant it.
    pub(super) fn holder_of(&self, key: &str) -> Option<String> {
        let NodeValue::Map(entries) = &self.value else {
            return None;
        };
        let holder = entries.iter().find(|(_, value)| value.peek(key).is_some());
        holder.map(|(key, _)| key.describe_plain())
    }

    /// The value under `key`, to be changed.
    pub fn child_mut(&mut self, key: &str) -> Option<&mut Node> {
        match &mut self.value {
            NodeValue::Map(entries) => entries.iter_mut().find(|(k, _)| k.is_text(key)).map(|(_, v)| v),
            _ => None,
        }
    }

    /// Replaces the value under `key`, for a reference that has been resolved (a scene given by its file).
    pub fn replace(&mut self, key: &str, node: Node) {
        if let Some(child) = self.child_mut(key) {
            *child = node;
        }
    }

    /// Puts a value under `key` of a mapping, in the place of the one that is there or after all others.
    pub fn put(&mut self, key: &str, value: Node) {
        let name = value.with_value(NodeValue::Text(key.to_owned()));
        if let NodeValue::Map(entries) = &mut self.value {
            match entries.iter_mut().find(|(k, _)| k.is_text(key)) {
                Some((_, there)) => *there = value,
                None => entries.push((name, value)),
            }
        }
    }

    /// Takes `key` out of a mapping.
    pub fn take_out(&mut self, key: &str) {
        if let NodeValue::Map(entries) = &mut self.value {
            entries.retain(|(k, _)| !k.is_text(key));
        }
    }

    /// The same mapping without `key`.
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
            gone: self.gone,
            ..self.with_value(value)
        }
    }

    /// Says which keys the mappings in this one may have had beside those that are read later.
    pub fn tell_allowed(&mut self, keys: &'static [&'static str]) {
        if let NodeValue::Map(entries) = &mut self.value {
            entries.iter_mut().for_each(|(_, value)| value.gone = keys);
        }
    }

    /// Adds entries to a mapping, after those that are there.
    pub fn extend(&mut self, more: Vec<(Node, Node)>) {
        if let NodeValue::Map(entries) = &mut self.value {
            entries.extend(more);
        }
    }

    /// The value under `key` without checking the other keys.
    #[must_use]
    pub fn peek(&self, key: &str) -> Option<&Node> {
        match &self.value {
            NodeValue::Map(entries) => entries.iter().find(|(k, _)| k.is_text(key)).map(|(_, v)| v),
            _ => None,
        }
    }

    /// The truth value that it is, if it is one: `true`, or a word that YAML 1.1 reads so.
    #[must_use]
    pub fn truth(&self) -> Option<bool> {
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

    /// Whether it is this text, or a number written so.
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

    /// Whether it is a mapping without entries.
    #[must_use]
    pub fn is_empty_map(&self) -> bool {
        matches!(&self.value, NodeValue::Map(entries) if entries.is_empty())
    }

    /// A key as it is quoted in a message.
    #[must_use]
    pub fn found_key(&self) -> String {
        format!("`{}`", self.describe_plain())
    }

    /// What was found, for a message.
    #[must_use]
    pub fn found(&self) -> String {
        match &self.value {
            NodeValue::Null => "nothing".into(),
            NodeValue::Text(t) => format!("{t:?}"),
            _ => self.describe_plain(),
        }
    }

    /// The value on one line as it was written, with units as they stand there: `{ voltage: 5.25 kV }`.
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

    /// The same within a list or a mapping, where a text with brackets or commas stands in quotes (YAML 1.2, 7.3.3).
    fn written_inside(&self) -> String {
        match &self.value {
            NodeValue::Text(text) if text.contains(['{', '}', '[', ']', ',']) => {
                format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
            }
            _ => self.written(),
        }
    }

    /// The entries of a mapping, each on one line as it was written; empty where it is none.
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
