//! Typed readers of nodes; each error names the field, what was found and what is allowed.

use std::fmt;

use super::error::{InputError, suggestion};
use super::node::{Node, NodeValue};
use crate::quantity::{Decimal, Dimension, Quantity, QuantityError};

/// A mapping whose keys have been checked.
pub struct Map<'a> {
    node: &'a Node,
    entries: &'a [(Node, Node)],
}

impl Node {
    fn wrong_type(&self, field: &str, expected: impl fmt::Display) -> InputError {
        // Only keys get backticks.
        let field = match field.contains(['`', ' ']) {
            true => field.to_owned(),
            false => format!("`{field}`"),
        };
        self.error(format!("{field} must be {expected}, found {}", self.found()))
    }

    /// Returns the node as a mapping with the allowed keys only.
    ///
    /// # Errors
    /// When it is not a mapping, or has another key; the error suggests the most similar allowed key.
    pub fn fields(&self, what: &str, allowed: &[&str]) -> Result<Map<'_>, InputError> {
        let entries = self.entries(what)?;
        for (key, _) in entries {
            let name = key.describe_plain();
            if !allowed.contains(&name.as_str()) {
                return Err(key
                    .error_labelled(format!("unknown key `{name}` in {what}"), "not allowed here")
                    .help(suggestion(&name, &[allowed, self.removed_keys].concat())));
            }
        }
        Ok(Map { node: self, entries })
    }

    /// Checks that a mapping has no keys that belong into the mapping `under`.
    ///
    /// # Errors
    /// When it has such a key that is not allowed here.
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
                    .error_labelled(format!("unknown key `{name}` in {what}"), "not allowed here")
                    .help(format!(
                        "it belongs under `{under}`: `{under}: {{ {name}: … }}`, or `{under}.{name}` in a path of --set"
                    )));
            }
        }
        Ok(())
    }

    /// Returns the entries of a mapping with any keys.
    ///
    /// # Errors
    /// When it is not a mapping.
    pub fn entries(&self, what: &str) -> Result<&[(Node, Node)], InputError> {
        match &self.value {
            NodeValue::Map(entries) => Ok(entries),
            _ => Err(self.wrong_type(what, "a mapping")),
        }
    }

    /// Returns the node as a list.
    ///
    /// # Errors
    /// When it is not a list.
    pub fn list(&self, field: &str) -> Result<&[Node], InputError> {
        match &self.value {
            NodeValue::List(items) => Ok(items),
            NodeValue::Text(item) | NodeValue::Number(item) => Err(self
                .wrong_type(field, "a list")
                .help(format!("a list of one item is written [{item}]"))),
            NodeValue::Map(entries) => Err(match entries.first() {
                // A path of --set to an item of a list that is not there.
                Some((key, _)) if key.describe_plain().parse::<usize>().is_ok() => self.error(format!(
                    "`{field}` must be a list, found item {} alone: write the whole list",
                    key.describe_plain()
                )),
                _ => self.wrong_type(field, "a list"),
            }),
            _ => Err(self.wrong_type(field, "a list")),
        }
    }

    /// Returns the node as a text, which can also be a number.
    ///
    /// # Errors
    /// When it is neither.
    pub fn text(&self, field: &str) -> Result<&str, InputError> {
        match &self.value {
            NodeValue::Text(t) | NodeValue::Number(t) => Ok(t),
            _ => Err(self.wrong_type(field, "a text")),
        }
    }

    /// Returns the node as one of several words.
    ///
    /// # Errors
    /// When it is another word; the error suggests the most similar one.
    pub fn word<'w>(&self, field: &str, allowed: &[&'w str]) -> Result<&'w str, InputError> {
        let text = self.text(field)?;
        allowed.iter().find(|w| **w == text).copied().ok_or_else(|| {
            self.error(format!("`{field}` cannot be {text:?}"))
                .help(suggestion(text, allowed))
        })
    }

    /// Returns the node as a boolean.
    ///
    /// # Errors
    /// When it is not a boolean.
    pub fn bool(&self, field: &str) -> Result<bool, InputError> {
        self.as_bool().ok_or_else(|| self.wrong_type(field, "true or false"))
    }

    /// Returns the node as an integer within bounds, both included.
    ///
    /// # Errors
    /// When it is not an integer, or outside the bounds.
    pub fn integer(&self, field: &str, low: u64, high: u64) -> Result<u64, InputError> {
        let range = if high >= i64::MAX as u64 {
            format!("an integer from {low}")
        } else {
            format!("an integer from {low} to {high}")
        };
        let NodeValue::Number(text) = &self.value else {
            return Err(self.wrong_type(field, range));
        };
        // An integer of many digits must not be rounded.
        let exact = text.parse().ok().or_else(|| Decimal::exact(text)?.to_u64());
        exact
            .filter(|n| (low..=high).contains(n))
            .ok_or_else(|| self.wrong_type(field, range))
    }

    /// Returns the node as a quantity: a number with a unit, or in the base unit of the dimension.
    ///
    /// # Errors
    /// When the number or the unit is invalid.
    pub fn quantity(&self, field: &str, dimension: Dimension) -> Result<Quantity, InputError> {
        let (NodeValue::Number(text) | NodeValue::Text(text)) = &self.value else {
            return Err(self.wrong_type(field, dimension.with_article()));
        };
        let read = Quantity::parse(text, dimension).map_err(|error| {
            let refused = self.error(format!("`{field}`: {error}"));
            // The message for an unknown unit already lists the known ones.
            match (error, dimension.symbols().join(", ")) {
                (QuantityError::NotANumber(_), units) if !units.is_empty() => {
                    refused.help(format!("allowed: a number with a unit: {units}"))
                }
                _ => refused,
            }
        })?;
        self.note_unit(text, read);
        Ok(read)
    }

    /// Notes a quantity that was given without a unit; zero needs none.
    fn note_unit(&self, text: &str, read: Quantity) {
        if read.is_bare_in(text) {
            self.source.note_bare(self.span, read);
        }
    }

    /// Returns the fraction for a text such as `25 %`; `None` for other values.
    #[must_use]
    pub fn percentage(&self) -> Option<Decimal> {
        let NodeValue::Text(text) = self.value() else {
            return None;
        };
        let number: Decimal = text.trim().strip_suffix('%')?.trim().parse().ok()?;
        Some(number.scaled(-2))
    }

    /// Returns the node as a quantity within bounds in the base unit, both included.
    ///
    /// # Errors
    /// When it is not a quantity, or outside the bounds.
    pub fn quantity_in(&self, field: &str, dimension: Dimension, low: f64, high: f64) -> Result<Quantity, InputError> {
        let found = match &self.value {
            NodeValue::Number(text) | NodeValue::Text(text) => match Quantity::parse(text, dimension) {
                Ok(quantity) if (low..=high).contains(&quantity.value()) => {
                    self.note_unit(text, quantity);
                    return Ok(quantity);
                }
                Ok(quantity) => quantity.to_string(),
                Err(QuantityError::OutOfRange(text)) => text,
                Err(_) => return self.quantity(field, dimension),
            },
            _ => return self.quantity(field, dimension),
        };
        let unit = match dimension.base_unit() {
            "" => String::new(),
            unit => format!(" {unit}"),
        };
        Err(self
            .error(format!("`{field}` is out of range: found {found}"))
            .help(format!("allowed: {low}{unit} to {high}{unit}")))
    }
}

impl<'a> Map<'a> {
    /// The keys and values in the order of the document.
    #[must_use]
    pub fn entries(&self) -> &'a [(Node, Node)] {
        self.entries
    }

    /// Creates an error at the mapping.
    #[must_use]
    pub fn error(&self, message: impl Into<String>) -> InputError {
        self.node.error(message)
    }

    /// Returns the value of a required key.
    ///
    /// # Errors
    /// When it is missing.
    pub fn required(&self, what: &str, key: &str) -> Result<&'a Node, InputError> {
        self.optional(key).ok_or_else(|| {
            self.node
                .error_labelled(format!("`{key}` is missing in {what}"), format!("no `{key}` here"))
        })
    }

    /// Returns the value of a key, if it exists.
    #[must_use]
    pub fn optional(&self, key: &str) -> Option<&'a Node> {
        self.entries.iter().find(|(k, _)| k.is_text(key)).map(|(_, v)| v)
    }

    /// Returns the value of a key as a pure number within bounds, both included, or the default if the key is missing.
    ///
    /// # Errors
    /// When it is not a number, or outside the bounds.
    pub fn number(&self, key: &str, default: f64, low: f64, high: f64) -> Result<Decimal, InputError> {
        match self.optional(key) {
            Some(node) => Ok(node.quantity_in(key, Dimension::Number, low, high)?.base()),
            None => Decimal::from_f64(default)
                .ok_or_else(|| InputError::new(format!("the default of `{key}` is {default}, which is not a number"))),
        }
    }
}
