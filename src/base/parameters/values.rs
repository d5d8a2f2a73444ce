//! Plain values as parameters: booleans, integers, numbers, options, pairs and lists.

use std::ops::RangeInclusive;

use super::Parameter;
use crate::canonical::Canonical;
use crate::document::{InputError, Map, Node};
use crate::quantity::{Decimal, Dimension};
use crate::schema::{Fields, Schema};

impl Parameter for bool {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        node.bool(key)
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::from(*self))
    }

    fn schema((): &()) -> Schema {
        Schema::bool()
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

macro_rules! integers {
    ($($type:ty),+) => {$(
        impl Parameter for $type {
            type Limits = RangeInclusive<u64>;
            type Literal = Self;

            fn read(node: &Node, key: &str, limits: &RangeInclusive<u64>) -> Result<Self, InputError> {
                // If the declared limit is beyond the type, a larger value is an error and not truncated.
                let high = (*limits.end()).min(Self::MAX as u64);
                Ok(node.integer(key, *limits.start(), high)? as Self)
            }

            fn canonical(&self) -> Option<Canonical> {
                Some(Canonical::from(*self as u64))
            }

            fn schema(limits: &RangeInclusive<u64>) -> Schema {
                Schema::integer(*limits.start(), *limits.end())
            }

            fn literal(literal: Self) -> Self {
                literal
            }
        }
    )+};
}

integers!(u32, u64, usize);

/// Returns whether limits are those of a fraction, which can be given in percent.
fn are_fractions(limits: &RangeInclusive<f64>) -> bool {
    *limits.start() >= 0.0 && *limits.end() <= 1.0
}

/// A pure number. A fraction can be given in percent: `25 %` is 0.25.
impl Parameter for Decimal {
    type Limits = RangeInclusive<f64>;
    type Literal = f64;

    fn read(node: &Node, key: &str, limits: &RangeInclusive<f64>) -> Result<Self, InputError> {
        if let Some(fraction) = node.percentage().filter(|_| are_fractions(limits)) {
            let (low, high) = (100.0 * limits.start(), 100.0 * limits.end());
            return match limits.contains(&fraction.to_f64()) {
                true => Ok(fraction),
                false => Err(node
                    .error(format!("`{key}` is out of range: found {}", node.found()))
                    .help(format!("allowed: {low} % to {high} %"))),
            };
        }
        Ok(node
            .quantity_in(key, Dimension::Number, *limits.start(), *limits.end())?
            .base())
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::from(*self))
    }

    fn schema(limits: &RangeInclusive<f64>) -> Schema {
        let number = Schema::number(*limits.start(), *limits.end());
        match are_fractions(limits) {
            true => Schema::any_of([number, Schema::percentage()]),
            false => number,
        }
    }

    fn literal(literal: f64) -> Self {
        Self::from_f64(literal).expect("a declared default is a finite number")
    }
}

/// An optional value.
impl<T: Parameter> Parameter for Option<T> {
    type Limits = T::Limits;
    type Literal = T::Literal;

    fn read(node: &Node, key: &str, limits: &T::Limits) -> Result<Self, InputError> {
        T::read(node, key, limits).map(Some)
    }

    fn canonical(&self) -> Option<Canonical> {
        self.as_ref().and_then(T::canonical)
    }

    fn schema(limits: &T::Limits) -> Schema {
        T::schema(limits)
    }

    fn literal(literal: T::Literal) -> Self {
        Some(T::literal(literal))
    }

    fn absent() -> Option<Self> {
        Some(None)
    }
}

/// Two values, such as a point or a range.
impl<T: Parameter> Parameter for [T; 2] {
    type Limits = T::Limits;
    type Literal = [T::Literal; 2];

    fn read(node: &Node, key: &str, limits: &T::Limits) -> Result<Self, InputError> {
        let example = || format!("for example {}", Self::example());
        match node.list(key).map_err(|error| error.help(example()))? {
            [first, second] => Ok([T::read(first, key, limits)?, T::read(second, key, limits)?]),
            items => Err(node
                .error(format!("`{key}` must have two values, found {}", items.len()))
                .help(example())),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::List(self.iter().filter_map(T::canonical).collect()))
    }

    fn schema(limits: &T::Limits) -> Schema {
        Schema::list(T::schema(limits), 2, 2)
    }

    fn literal(literal: [T::Literal; 2]) -> Self {
        literal.map(T::literal)
    }

    fn example() -> String {
        format!("[{0}, {0}]", T::example())
    }
}

/// A list of values.
impl<T: Parameter> Parameter for Vec<T> {
    /// The limits of an item, and of the number of items.
    type Limits = (T::Limits, RangeInclusive<usize>);
    type Literal = Self;

    fn read(node: &Node, key: &str, (limits, count): &Self::Limits) -> Result<Self, InputError> {
        let items = node.list(key)?;
        if !count.contains(&items.len()) {
            let allowed = match (*count.start(), *count.end()) {
                (fewest, usize::MAX) => format!("{fewest} or more"),
                (fewest, most) => format!("{fewest} to {most}"),
            };
            let found = match items.len() {
                0 => "is empty".to_owned(),
                1 => "has 1 item".to_owned(),
                many => format!("has {many} items"),
            };
            return Err(node
                .error(format!("`{key}` {found}"))
                .help(format!("allowed: {allowed}")));
        }
        items.iter().map(|item| T::read(item, key, limits)).collect()
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::List(self.iter().filter_map(T::canonical).collect()))
    }

    fn schema((limits, count): &Self::Limits) -> Schema {
        Schema::list(T::schema(limits), *count.start(), *count.end())
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Map<'_> {
    /// Returns the value of a key, its default, or the value of its type for an absent key.
    ///
    /// # Errors
    /// When it is missing, or as for [`Parameter::read`].
    pub fn read<T: Parameter>(
        &self,
        what: &str,
        key: &str,
        limits: &T::Limits,
        default: Option<T>,
    ) -> Result<T, InputError> {
        match (self.optional(key), default.or_else(T::absent)) {
            (Some(node), _) => T::read(node, key, limits),
            (None, Some(value)) => Ok(value),
            (None, None) => T::read(self.required(what, key)?, key, limits),
        }
    }

    /// Checks that no key belongs to another variant than the one that `word` names.
    ///
    /// # Errors
    /// When there is such a key; the error names its variant.
    pub fn refuse_keys_of_others(
        &self,
        tag: &str,
        word: &str,
        words: &[&str],
        keys: &dyn Fn(&str) -> Vec<&'static str>,
        others: &[&str],
    ) -> Result<(), InputError> {
        let own = keys(word);
        for (key, _) in self.entries() {
            let is = |name: &&str| key.is_text(name);
            if own.iter().any(is) || key.is_text(tag) {
                continue;
            }
            let owners: Vec<String> = words
                .iter()
                .filter(|other| keys(other).iter().any(is))
                .map(|other| format!("`{tag}: {other}`"))
                .collect();
            if !owners.is_empty() {
                return Err(key
                    .error_labelled(
                        format!(
                            "unknown key {} with `{tag}: {word}`: it belongs to {}",
                            key.quoted(),
                            owners.join(", ")
                        ),
                        "not allowed here",
                    )
                    .help(format!("allowed: {}", [&own[..], others].concat().join(", "))));
            }
        }
        Ok(())
    }
}

impl Fields {
    /// Adds a key with its documentation, limits and default.
    #[must_use]
    pub fn declare<T: Parameter>(self, key: &str, doc: &str, limits: &T::Limits, default: Option<T>) -> Self {
        let schema = T::schema(limits).description(doc.trim());
        match default {
            Some(value) => match value.canonical() {
                Some(canonical) => self.optional(key, schema.default(canonical.to_json())),
                None => self.optional(key, schema),
            },
            None if T::absent().is_some() => self.optional(key, schema),
            None => self.required(key, schema),
        }
    }
}
