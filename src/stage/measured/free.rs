//! The free parameters of a scene: its numbers by their keys.

use deaflow_base::{Decimal, Dimension, InputError, Node, NodeValue, Quantity, listed, nearest};
use deaflow_fit::FreeParameter;

/// The parameter that is added to all voltages, which no scene has.
pub const VOLTAGE_OFFSET: &str = "voltage_offset";
/// The bounds of a parameter without given ones, as a factor of its value.
const RANGE: f64 = 1e3;
/// The bounds of the voltage offset in V.
const MOST_OFFSET: f64 = 1e3;

/// A free parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct FreeKey {
    /// The path of the key in the scene, or [`VOLTAGE_OFFSET`].
    pub path: String,
    /// Its name in the fit: that of laws and sheets, else the path.
    pub name: String,
    /// Its dimension.
    pub dimension: Dimension,
    /// The value of the scene in the base unit.
    pub start: f64,
    /// The smallest and the largest value in the base unit.
    pub bounds: [f64; 2],
}

impl FreeKey {
    /// Finds the parameter that is written as `KEY` or `KEY=LOW..HIGH`: a key with a number, by its path or the end of
    /// it. A step that is a number names an item of a list, from 0.
    ///
    /// # Errors
    /// When there is none or there are several, or the bounds are not valid.
    pub fn find(root: &Node, text: &str) -> Result<Self, InputError> {
        let (wanted, bounds) = match text.split_once('=') {
            Some((key, bounds)) => (key.trim(), Some(bounds)),
            None => (text.trim(), None),
        };
        let refused =
            |why: String, help: String| Err(InputError::new(format!("free parameter `{text}`: {why}")).help(help));
        let mut key = match wanted == VOLTAGE_OFFSET {
            true => Self {
                path: VOLTAGE_OFFSET.to_owned(),
                name: VOLTAGE_OFFSET.to_owned(),
                dimension: Dimension::Voltage,
                start: 0.0,
                bounds: [-MOST_OFFSET, MOST_OFFSET],
            },
            false => {
                let numbers = numbers(root, "");
                let is_wanted = |(path, ..): &&(String, Dimension, f64)| {
                    path == wanted || path.strip_suffix(wanted).is_some_and(|start| start.ends_with('.'))
                };
                let found: Vec<_> = numbers.iter().filter(is_wanted).collect();
                let named = |found: &[&(String, Dimension, f64)]| -> Vec<String> {
                    found.iter().map(|(path, ..)| path.clone()).collect()
                };
                let (path, dimension, start) = match found[..] {
                    [only] => only.clone(),
                    [] if has_list(root, wanted) => {
                        let help = format!("name one number of it, counted from 0, as in {wanted}.0");
                        return refused("it is a list in the scene".to_owned(), help);
                    }
                    [] => {
                        // An outline has hundreds of numbers.
                        let is_listed = |path: &&(String, Dimension, f64)| !path.0.split('.').any(is_number_of_item);
                        let mut all: Vec<String> = named(&numbers.iter().filter(is_listed).collect::<Vec<_>>());
                        all.push(VOLTAGE_OFFSET.to_owned());
                        let ends: Vec<&str> = all.iter().filter_map(|path| path.rsplit('.').next()).collect();
                        let near =
                            nearest(wanted, &ends).map_or_else(String::new, |near| format!("did you mean `{near}`? "));
                        return refused(
                            "the scene has no such number".to_owned(),
                            format!(
                                "{near}allowed: {}, and numbers in lists, as in prestretch.0",
                                listed(&all)
                            ),
                        );
                    }
                    _ => {
                        let help = format!("name one: {}", listed(&named(&found)));
                        return refused("it names several numbers of the scene".to_owned(), help);
                    }
                };
                let name = name_of(&path);
                let size = if start == 0.0 { 1.0 } else { start.abs() };
                let bounds = if start > 0.0 {
                    [start / RANGE, start * RANGE]
                } else {
                    [-RANGE * size, RANGE * size]
                };
                Self {
                    path,
                    name,
                    dimension,
                    start,
                    bounds,
                }
            }
        };
        if let Some(bounds) = bounds {
            let form = "write the bounds as in shear_modulus=\"1 kPa..1 MPa\"";
            let Some((low, high)) = bounds.split_once("..") else {
                return refused("the bounds have no `..`".to_owned(), form.to_owned());
            };
            let number = |text: &str| Quantity::parse(text, key.dimension).map(|found| found.value());
            match (number(low), number(high)) {
                (Ok(low), Ok(high)) if low < high => key.bounds = [low, high],
                (Ok(_), Ok(_)) => return refused("the bounds are not in order".to_owned(), form.to_owned()),
                (Err(error), _) | (_, Err(error)) => return refused(error.to_string(), form.to_owned()),
            }
            key.start = key.start.clamp(key.bounds[0], key.bounds[1]);
        }
        Ok(key)
    }

    /// Returns whether the parameter is positive, so that its logarithm is fitted.
    #[must_use]
    pub fn is_positive(&self) -> bool {
        self.bounds[0] > 0.0
    }

    /// Returns the parameter as the fit takes it.
    #[must_use]
    pub fn parameter(&self) -> FreeParameter {
        let [low, high] = self.bounds;
        match self.is_positive() {
            true => FreeParameter::positive(&self.name, self.start, low, high),
            false if self.path == VOLTAGE_OFFSET => {
                FreeParameter::signed(&self.name, self.start, low, high, MOST_OFFSET)
            }
            false => {
                let unit = if self.start == 0.0 { 1.0 } else { self.start.abs() };
                FreeParameter::signed(&self.name, self.start, low, high, unit)
            }
        }
    }

    /// Writes a value as scenes do.
    #[must_use]
    pub fn written(&self, value: f64) -> String {
        let number = Decimal::from_f64(value).map_or_else(|| value.to_string(), |number| number.to_string());
        format!("{number} {}", self.dimension.base_unit()).trim_end().to_owned()
    }
}

fn is_number_of_item(step: &str) -> bool {
    step.parse::<usize>().is_ok()
}

/// Returns the name of a parameter: as laws, branches and sheets know it, else its path.
fn name_of(path: &str) -> String {
    let branch = path
        .strip_prefix("effects.viscoelasticity.branches.")
        .and_then(|rest| rest.split_once('.'));
    if let Some((number, quantity)) = branch
        && let Ok(number) = number.parse::<usize>()
    {
        return format!("branch_{quantity}_{}", number + 1);
    }
    let short = ["material.", "effects.strain_stiffening."];
    let known = short.into_iter().find_map(|start| path.strip_prefix(start));
    known.unwrap_or(path).to_owned()
}

/// Returns whether a key of the scene has a list.
fn has_list(node: &Node, wanted: &str) -> bool {
    let last = wanted.rsplit('.').next().unwrap_or(wanted);
    match node.value() {
        NodeValue::Map(entries) => entries.iter().any(|(key, value)| {
            let is_own = key.is_text(last) && matches!(value.value(), NodeValue::List(_));
            is_own || has_list(value, wanted)
        }),
        NodeValue::List(items) => items.iter().any(|item| has_list(item, wanted)),
        _ => false,
    }
}

/// Returns the paths of all keys of a mapping that have a number, and of numbers in lists, with the dimension and the
/// value in the base unit. Properties that the simulation does not use are left out.
fn numbers(node: &Node, path: &str) -> Vec<(String, Dimension, f64)> {
    match node.value() {
        NodeValue::Map(entries) => {
            let named = entries
                .iter()
                .filter_map(|(key, value)| Some((key.text("key").ok()?.to_owned(), value)));
            let below = |(key, value): (String, &Node)| match (path, key.as_str()) {
                ("", "properties" | "states" | "leads") | ("geometry", "cells") => Vec::new(),
                ("", key) => numbers(value, key),
                (path, key) => numbers(value, &format!("{path}.{key}")),
            };
            named.flat_map(below).collect()
        }
        NodeValue::List(items) => {
            let item = |(at, item): (usize, &Node)| numbers(item, &format!("{path}.{at}"));
            items.iter().enumerate().flat_map(item).collect()
        }
        _ => number(node)
            .map(|(dimension, value)| vec![(path.to_owned(), dimension, value)])
            .unwrap_or_default(),
    }
}

/// Reads a number with or without a unit.
fn number(node: &Node) -> Option<(Dimension, f64)> {
    let (NodeValue::Number(text) | NodeValue::Text(text)) = node.value() else {
        return None;
    };
    Dimension::ALL.into_iter().find_map(|dimension| {
        let found = Quantity::parse(text, dimension).ok()?;
        (!found.is_bare_in(text)).then(|| (dimension, found.value()))
    })
}
