//! The values that the axes of a stage have.

use std::rc::Rc;

use deaflow_base::{Node, NodeValue};

/// A value of an axis.
#[derive(Debug)]
pub struct AxisValue {
    /// As it stands in names of stages, and by which values are the same.
    pub text: String,
    /// As it stands in the file.
    pub node: Node,
}

/// An axis with its value.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Name of the axis.
    pub axis: Rc<str>,
    /// Its value.
    pub value: Rc<AxisValue>,
    /// Whether names of stages carry it.
    pub shown: bool,
}

impl Setting {
    /// Whether the value is one word.
    pub fn is_word(&self) -> bool {
        !matches!(self.value.node.value(), NodeValue::List(_) | NodeValue::Map(_))
    }
}

/// Axes with their values; no axis is there twice.
pub type Settings = Vec<Setting>;

/// The value that an axis has.
pub fn value_of<'a>(settings: &'a [Setting], axis: &str) -> Option<&'a Rc<AxisValue>> {
    let setting = settings.iter().find(|setting| *setting.axis == *axis);
    setting.map(|setting| &setting.value)
}

/// Both together, of the second those axes that the first does not have.
pub fn joined(first: &[Setting], second: &[Setting]) -> Settings {
    let more = second.iter().filter(|setting| value_of(first, &setting.axis).is_none());
    first.iter().chain(more).cloned().collect()
}

/// By which the same settings are known: axes and values in their order.
pub fn key(settings: &[Setting]) -> String {
    let words = settings.iter().map(|s| format!("{}={}", s.axis, s.value.text));
    words.collect::<Vec<_>>().join("\n")
}

/// Name of the stage with these settings.
pub fn name(stage: &str, settings: &[Setting]) -> String {
    let shown = settings.iter().filter(|setting| setting.shown);
    let words = shown.map(|setting| format!("{}={}", setting.axis, word(&setting.value.text)));
    match words.collect::<Vec<_>>().join(",") {
        none if none.is_empty() => stage.to_owned(),
        words => format!("{stage}@{words}"),
    }
}

/// A value in a name: what would mean something in a path, a list or a shell is an underscore.
fn word(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "._+-".contains(c);
    text.chars().map(|c| if plain(c) { c } else { '_' }).collect()
}

/// A value in one line without spaces, the same for values that are written alike.
pub fn text_of(node: &Node) -> String {
    let of = |nodes: &[Node]| nodes.iter().map(text_of).collect::<Vec<_>>().join("+");
    match node.value() {
        NodeValue::Null => "none".to_owned(),
        NodeValue::Bool(value) => value.to_string(),
        NodeValue::Number(text) | NodeValue::Text(text) => text.split_whitespace().collect(),
        NodeValue::List(items) => of(items),
        NodeValue::Map(entries) => {
            let entries = entries
                .iter()
                .map(|(key, value)| format!("{}:{}", text_of(key), text_of(value)));
            entries.collect::<Vec<_>>().join("+")
        }
    }
}
