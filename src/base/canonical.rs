//! Canonical values, from which action keys are computed.
//!
//! Two descriptions with the same meaning have one canonical value: maps are sorted, −0 is 0, NaN is impossible, and
//! quantities are exact decimals in the base unit of their dimension, so "5.25 kV" and "5250 V" are equal.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::quantity::{Decimal, Quantity};

/// A value with one encoding per meaning.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Canonical {
    /// An absent optional value.
    Null,
    /// A boolean.
    Bool(bool),
    /// An exact decimal number with the symbol of its base unit ("" for a pure number).
    Number(Decimal, String),
    /// A text.
    Text(String),
    /// An ordered list.
    List(#[serde(deserialize_with = "depth::nested")] Vec<Canonical>),
    /// A map sorted by key.
    Map(#[serde(deserialize_with = "depth::nested")] BTreeMap<String, Canonical>),
}

/// Limits the depth of values in files, since reading them recurses.
mod depth {
    use std::cell::Cell;

    use serde::de::{Deserialize, Deserializer, Error};

    /// The largest depth; parameters of stages are never as deep.
    const MOST: u32 = 64;

    thread_local! {
        /// The number of lists and maps around the value that this thread reads.
        static INSIDE: Cell<u32> = const { Cell::new(0) };
    }

    /// Reads the items of a list or map.
    ///
    /// # Errors
    /// When they are nested too deeply, or as for `T`.
    pub fn nested<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<T, D::Error> {
        let depth = INSIDE.get();
        if depth >= MOST {
            return Err(D::Error::custom(format_args!(
                "lists and maps are nested more than {MOST} deep"
            )));
        }
        INSIDE.set(depth + 1);
        let value = T::deserialize(deserializer);
        INSIDE.set(depth);
        value
    }
}

impl Canonical {
    /// Creates a map from its entries.
    #[must_use]
    pub fn map<K: Into<String>>(entries: impl IntoIterator<Item = (K, Canonical)>) -> Self {
        Self::Map(entries.into_iter().map(|(k, v)| (k.into(), v)).collect())
    }

    /// Returns the value in JSON: pure numbers as numbers, quantities as texts with their unit.
    #[must_use]
    pub fn to_json(&self) -> Value {
        match self {
            Self::Null => Value::Null,
            Self::Bool(value) => json!(value),
            Self::Number(number, unit) if unit.is_empty() => {
                number.to_u64().map_or_else(|| json!(number.to_f64()), |n| json!(n))
            }
            Self::Number(..) => json!(self.to_string()),
            Self::Text(text) => json!(text),
            Self::List(items) => items.iter().map(Self::to_json).collect(),
            Self::Map(map) => map.iter().map(|(key, value)| (key.clone(), value.to_json())).collect(),
        }
    }

    /// Returns every leaf with its dotted path, in order. A list is a leaf.
    #[must_use]
    pub fn leaves(&self) -> Vec<(String, &Canonical)> {
        let mut out = Vec::new();
        self.collect_leaves(String::new(), &mut out);
        out
    }

    fn collect_leaves<'a>(&'a self, path: String, out: &mut Vec<(String, &'a Canonical)>) {
        let join = |key: &str| {
            if path.is_empty() {
                key.to_owned()
            } else {
                format!("{path}.{key}")
            }
        };
        match self {
            Self::Map(map) if !map.is_empty() => {
                for (key, value) in map {
                    value.collect_leaves(join(key), out);
                }
            }
            leaf => out.push((path, leaf)),
        }
    }
}

impl fmt::Display for Canonical {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => f.write_str("none"),
            Self::Bool(value) => write!(f, "{value}"),
            Self::Number(number, unit) if unit.is_empty() => write!(f, "{number}"),
            Self::Number(number, unit) => write!(f, "{number} {unit}"),
            Self::Text(text) => f.write_str(text),
            Self::List(items) => {
                f.write_str("[")?;
                for (i, item) in items.iter().enumerate() {
                    write!(f, "{}{item}", if i == 0 { "" } else { ", " })?;
                }
                f.write_str("]")
            }
            Self::Map(map) => {
                f.write_str("{")?;
                for (i, (key, value)) in map.iter().enumerate() {
                    write!(f, "{}{key}: {value}", if i == 0 { "" } else { ", " })?;
                }
                f.write_str("}")
            }
        }
    }
}

impl From<bool> for Canonical {
    fn from(value: bool) -> Self {
        Self::Bool(value)
    }
}

impl From<&str> for Canonical {
    fn from(value: &str) -> Self {
        Self::Text(value.to_owned())
    }
}

impl From<u64> for Canonical {
    fn from(value: u64) -> Self {
        Self::Number(Decimal::from(value), String::new())
    }
}

impl From<usize> for Canonical {
    fn from(value: usize) -> Self {
        Self::from(value as u64)
    }
}

impl From<Decimal> for Canonical {
    fn from(value: Decimal) -> Self {
        Self::Number(value, String::new())
    }
}

impl From<&Quantity> for Canonical {
    fn from(value: &Quantity) -> Self {
        Self::Number(value.base(), value.dimension().base_unit().to_owned())
    }
}

impl<T: Into<Canonical>> FromIterator<T> for Canonical {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> Self {
        Self::List(items.into_iter().map(Into::into).collect())
    }
}
