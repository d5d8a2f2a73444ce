//! Puts the values of axes in place of `"${axis}"`.

use super::axes::{FOREACH, combinations, declared, unused};
use super::settings::{Setting, joined, value_of};
use super::template::{OPEN, axes_in};
use crate::entry::suggestion;
use deaflow_base::{InputError, Node, NodeValue};

/// Items that a list may be expanded to.
const MOST_ITEMS: usize = 10_000;

/// Puts values in place of axes, as long as what comes out together is of a size that a person means.
pub struct Substitution {
    left: usize,
}

/// Values that a pipeline may have once its sweeps are unrolled.
const MOST_VALUES: usize = 5_000_000;

impl Default for Substitution {
    fn default() -> Self {
        Self { left: MOST_VALUES }
    }
}

impl Substitution {
    /// The node with values in place of axes. A key or an item whose value is an axis at `null` is left out; an item of
    /// a list with `foreach` stands for one item per combination.
    ///
    /// # Errors
    /// If it asks for an axis that is not there, or the axes of an item cannot be read.
    pub fn of(&mut self, node: &Node, settings: &[Setting]) -> Result<Node, InputError> {
        self.count(node, 1)?;
        Ok(match node.value() {
            NodeValue::Text(text) if text.contains(OPEN) => {
                let new = of_text(node, text, settings)?;
                self.count(node, size(&new))?;
                new
            }
            NodeValue::List(items) => {
                let mut list = Vec::with_capacity(items.len());
                for item in items {
                    self.of_item(item, settings, &mut list)?;
                }
                node.with_value(NodeValue::List(list))
            }
            NodeValue::Map(entries) => {
                let mut map = Vec::with_capacity(entries.len());
                for (key, value) in entries {
                    let new = self.of(value, settings)?;
                    if !is_left_out(value, &new) {
                        map.push((key.clone(), new));
                    }
                }
                node.with_value(NodeValue::Map(map))
            }
            _ => node.clone(),
        })
    }

    fn of_item(&mut self, item: &Node, settings: &[Setting], list: &mut Vec<Node>) -> Result<(), InputError> {
        if item.peek(FOREACH).is_none() {
            let new = self.of(item, settings)?;
            if !is_left_out(item, &new) {
                list.push(new);
            }
            return Ok(());
        }
        let plain = item.without(FOREACH);
        let used = axes_in(&plain);
        for (place, axes) in declared(item)? {
            if !axes.iter().any(|axis| used.iter().any(|name| **name == **axis)) {
                return Err(unused(&place, &axes, "this item"));
            }
        }
        for own in combinations(item, MOST_ITEMS)? {
            list.push(self.of(&plain, &joined(&own, settings))?);
        }
        Ok(())
    }

    fn count(&mut self, node: &Node, values: usize) -> Result<(), InputError> {
        match self.left.checked_sub(values) {
            Some(left) => self.left = left,
            None => return Err(node.error(format!("the sweeps make more than {MOST_VALUES} values"))),
        }
        Ok(())
    }
}

fn is_left_out(before: &Node, after: &Node) -> bool {
    matches!(after.value(), NodeValue::Null) && matches!(before.value(), NodeValue::Text(_))
}

/// How many values a node holds.
fn size(node: &Node) -> usize {
    match node.value() {
        NodeValue::List(items) => 1 + items.iter().map(size).sum::<usize>(),
        NodeValue::Map(entries) => 1 + entries.iter().map(|(_, value)| size(value)).sum::<usize>(),
        _ => 1,
    }
}

/// A text that is `${axis}` alone is the value as it stands in the list; one with other words around it is a text.
/// `$${` is `${`.
fn of_text(node: &Node, text: &str, settings: &[Setting]) -> Result<Node, InputError> {
    let alone = text.strip_prefix(OPEN).and_then(|rest| rest.strip_suffix('}'));
    if let Some(axis) = alone.filter(|axis| !axis.contains(['$', '}'])) {
        return Ok(value(node, axis, settings)?.clone());
    }
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(OPEN) {
        if rest[..at].ends_with('$') {
            out += &rest[..at];
            out += "{";
            rest = &rest[at + OPEN.len()..];
            continue;
        }
        let Some((axis, after)) = rest[at + OPEN.len()..].split_once('}') else {
            return Err(node
                .error("`${` without `}`")
                .help("write \"${axis}\", or $${ for the letters themselves"));
        };
        out += &rest[..at];
        out += value(node, axis, settings)?.text(axis)?;
        rest = after;
    }
    out += rest;
    let is_number = out.parse::<f64>().is_ok_and(f64::is_finite);
    Ok(node.with_value(if is_number {
        NodeValue::Number(out)
    } else {
        NodeValue::Text(out)
    }))
}

fn value<'a>(node: &Node, axis: &str, settings: &'a [Setting]) -> Result<&'a Node, InputError> {
    if let Some(value) = value_of(settings, axis) {
        return Ok(&value.node);
    }
    let names: Vec<&str> = settings.iter().map(|setting| &*setting.axis).collect();
    Err(no_axis(node, axis, &names, "here"))
}

/// A refusal of the name of an axis that is none of some names; `place` says where there may be no axes at all.
pub fn no_axis(node: &Node, axis: &str, names: &[&str], place: &str) -> InputError {
    let help = match names.is_empty() {
        true => format!(
            "there are no axes {place}: add foreach: {{ {axis}: [ … ] }}, or write $${{ for the letters themselves"
        ),
        false => suggestion(axis, names),
    };
    node.error(format!("no axis is named `{axis}`")).help(help)
}
