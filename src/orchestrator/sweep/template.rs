//! Texts with the names of axes: `"${axis}"`.

use deaflow_base::{Node, NodeValue};

/// Start of a reference to an axis, before its name.
pub const OPEN: &str = "${";

/// Returns the names of the axes in a node, in order, each once.
pub fn axes_in(node: &Node) -> Vec<String> {
    let mut names = Vec::new();
    visit(node, &mut |text| {
        for (at, _) in text.match_indices(OPEN).filter(|(at, _)| !text[..*at].ends_with('$')) {
            let name = text[at + OPEN.len()..].split('}').next().unwrap_or_default();
            if !names.iter().any(|known| known == name) {
                names.push(name.to_owned());
            }
        }
    });
    names
}

/// Returns the text in a node that names an axis.
pub fn place_of<'n>(node: &'n Node, axis: &str) -> Option<&'n Node> {
    match node.value() {
        NodeValue::Text(_) => axes_in(node).iter().any(|name| name == axis).then_some(node),
        NodeValue::List(items) => items.iter().find_map(|item| place_of(item, axis)),
        NodeValue::Map(entries) => entries.iter().find_map(|(_, value)| place_of(value, axis)),
        _ => None,
    }
}

/// Returns whether a node contains `${`, also an escaped one.
pub fn is_template(node: &Node) -> bool {
    let mut found = false;
    visit(node, &mut |_| found = true);
    found
}

fn visit(node: &Node, each: &mut dyn FnMut(&str)) {
    match node.value() {
        NodeValue::Text(text) if text.contains(OPEN) => each(text),
        NodeValue::List(items) => items.iter().for_each(|item| visit(item, each)),
        NodeValue::Map(entries) => entries.iter().for_each(|(_, value)| visit(value, each)),
        _ => {}
    }
}
