//! Typed readers of nodes; each refusal names the field, what was found and what is allowed.

use std::fmt;

use super::error::{InputError, suggestion};
use super::node::{Node, NodeValue};
use crate::quantity::{Decimal, Dimension, Quantity, QuantityError};

/// A mapping whose keys have been checked against those that are allowed.
pub struct Map<'a> {
    node: &'a Node,
    entries: &'a [(Node, Node)],
}

impl Node {
    fn wanted(&self, field: &str, wanted: impl fmt::Display) -> InputError {
        // What is not a key is said as it is.
        let field = match field.contains(['`', ' ']) {
            true => field.to_owned(),
            false => format!("`{field}`"),
        };
        self.error(format!("{field} must be {wanted}, found {}", self.found()))
    }

    /// The node as a mapping with no other than the allowed keys.
    ///
    /// # Errors
    /// When it is no mapping, or has a key that is not allowed; the nearest allowed spelling is named.
    pub fn fields(&self, what: &str, allowed: &[&str]) -> Result<Map<'_>, InputError> {
        let entries = self.entries(what)?;
        for (key, _) in entries {
            let name = key.describe_plain();
            if !allowed.contains(&name.as_str()) {
                return Err(key
                    .error_labelled(format!("unknown key `{name}` in {what}"), "not known here")
                    .help(suggestion(&name, &[allowed, self.gone].concat())));
            }
        }
        Ok(Map { node: self, entries })
    }

    /// Refuses keys of a mapping that belong into the one under the key `under`, and says so.
    ///
    /// # Errors
    /// When there is one that is not allowed here.
    pub fn refuse_misplaced(
        &self,
        (what, allowed): (&str, &[&str]),
        under: &str,
        theirs: &[&str],
    ) -> Result<(), InputError> {
        for (key, _) in self.entries(what)? {
            let name = key.describe_plain();
            if theirs.contains(&name.as_str()) && !allowed.contains(&name.as_str()) {
                return Err(key
                    .error_labelled(format!("unknown key `{name}` in {what}"), "not known here")
                    .help(format!(
                        "it belongs under `{under}`: `{under}: {{ {name}: … }}`, or `{under}.{name}` in a path of --set"
                    )));
            }
        }
        Ok(())
    }

    /// The entries of a mapping whose keys are free.
    ///
    /// # Errors
    /// When it is no mapping.
    pub fn entries(&self, what: &str) -> Result<&[(Node, Node)], InputError> {
        match &self.value {
            NodeValue::Map(entries) => Ok(entries),
            _ => Err(self.wanted(what, "a mapping")),
        }
    }

    /// The node as a list.
    ///
    /// # Errors
    /// When it is none.
    pub fn list(&self, field: &str) -> Result<&[Node], InputError> {
        match &self.value {
            NodeValue::List(items) => Ok(items),
            _ => Err(self.wanted(field, "a list")),
        }
    }

    /// The node as a text; a number is its own text.
    ///
    /// # Errors
    /// When it is neither.
    pub fn text(&self, field: &str) -> Result<&str, InputError> {
        match &self.value {
            NodeValue::Text(t) | NodeValue::Number(t) => Ok(t),
            _ => Err(self.wanted(field, "a text")),
        }
    }

    /// The node as one of some words.
    ///
    /// # Errors
    /// When it is another; the nearest is named.
    pub fn word<'w>(&self, field: &str, allowed: &[&'w str]) -> Result<&'w str, InputError> {
        let text = self.text(field)?;
        allowed.iter().find(|w| **w == text).copied().ok_or_else(|| {
            self.error(format!("`{field}` cannot be {text:?}"))
                .help(suggestion(text, allowed))
        })
    }

    /// The node as a truth value.
    ///
    /// # Errors
    /// When it is none.
    pub fn bool(&self, field: &str) -> Result<bool, InputError> {
        self.truth().ok_or_else(|| self.wanted(field, "true or false"))
    }

    /// The node as a whole number within bounds, both included.
    ///
    /// # Errors
    /// When it is none, or outside.
    pub fn integer(&self, field: &str, low: u64, high: u64) -> Result<u64, InputError> {
        let range = if high >= i64::MAX as u64 {
            format!("a whole number from {low}")
        } else {
            format!("a whole number from {low} to {high}")
        };
        let NodeValue::Number(text) = &self.value else {
            return Err(self.wanted(field, range));
        };
        text.parse::<Decimal>()
            .ok()
            .and_then(Decimal::to_u64)
            .filter(|n| (low..=high).contains(n))
            .ok_or_else(|| self.wanted(field, range))
    }

    /// The node as a quantity: text with a unit, or a bare number in the base unit of the dimension.
    ///
    /// # Errors
    /// When the number or the unit is not understood.
    pub fn quantity(&self, field: &str, dimension: Dimension) -> Result<Quantity, InputError> {
        let (NodeValue::Number(text) | NodeValue::Text(text)) = &self.value else {
            return Err(self.wanted(field, dimension.with_article()));
        };
        Quantity::parse(text, dimension).map_err(|error| {
            let refused = self.error(format!("`{field}`: {error}"));
            // That of an unknown unit names those that are known.
            match (error, dimension.symbols().join(", ")) {
                (QuantityError::NotANumber(_), units) if !units.is_empty() => {
                    refused.help(format!("allowed: a number with a unit: {units}"))
                }
                _ => refused,
            }
        })
    }

    /// The share of a whole that a text such as `25 %` stands for; `None` of all else.
    #[must_use]
    pub fn percentage(&self) -> Option<Decimal> {
        let NodeValue::Text(text) = self.value() else {
            return None;
        };
        let number: Decimal = text.trim().strip_suffix('%')?.trim().parse().ok()?;
        Some(number.scaled(-2))
    }

    /// The node as a quantity within bounds given in the base unit, both included.
    ///
    /// # Errors
    /// When it is none, or outside.
    pub fn quantity_in(&self, field: &str, dimension: Dimension, low: f64, high: f64) -> Result<Quantity, InputError> {
        let quantity = self.quantity(field, dimension)?;
        if (low..=high).contains(&quantity.value()) {
            return Ok(quantity);
        }
        let unit = dimension.base_unit();
        let unit = if unit.is_empty() {
            String::new()
        } else {
            format!(" {unit}")
        };
        Err(self
            .error(format!("`{field}` is out of range: found {quantity}"))
            .help(format!("allowed: {low}{unit} to {high}{unit}")))
    }
}

impl<'a> Map<'a> {
    /// Keys and values, in the order of the document.
    #[must_use]
    pub fn entries(&self) -> &'a [(Node, Node)] {
        self.entries
    }

    /// A refusal of the mapping as a whole.
    #[must_use]
    pub fn error(&self, message: impl Into<String>) -> InputError {
        self.node.error(message)
    }

    /// The value of a key that must be there.
    ///
    /// # Errors
    /// When it is missing.
    pub fn required(&self, what: &str, key: &str) -> Result<&'a Node, InputError> {
        self.optional(key).ok_or_else(|| {
            self.node
                .error_labelled(format!("`{key}` is missing in {what}"), format!("no `{key}` here"))
        })
    }

    /// The value of a key, if it is there.
    #[must_use]
    pub fn optional(&self, key: &str) -> Option<&'a Node> {
        self.entries.iter().find(|(k, _)| k.is_text(key)).map(|(_, v)| v)
    }

    /// The value of a key as a pure number within bounds, both included, or the default where it is not there.
    ///
    /// # Errors
    /// When it is none, or outside.
    pub fn number(&self, key: &str, default: f64, low: f64, high: f64) -> Result<Decimal, InputError> {
        match self.optional(key) {
            Some(node) => Ok(node.quantity_in(key, Dimension::Number, low, high)?.base()),
            None => Decimal::from_f64(default)
                .ok_or_else(|| InputError::new(format!("the default of `{key}` is {default}, which is not a number"))),
        }
    }
}
