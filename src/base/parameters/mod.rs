//! A parameter is declared once: name, type with unit, range, default and sentence stand in one place, and reader, JSON Schema, canonical
//! value, `--set`, lock files and the tables in docs/reference.md follow from it.
//!
//! [`parameters!`](crate::parameters!) declares a mapping:
//!
//! ```text
//! parameters! {
//!     /// Turns solved samples into a flat, augmented and split training set.
//!     pub struct Balance as "a balance stage" {
//!         /// Bins of the histogram of the largest displacement.
//!         pub bins: u64 [1..=100_000],
//!         /// Both ends of the histogram, such as [0 mm, 2.5 mm].
//!         pub range: [Length; 2] [0.0..=1e4],
//!         /// Images that fill scarce bins.
//!         pub symmetry: SymmetryGroup = SymmetryGroup::D4,
//!         /// Epochs without a smaller validation error that end the training.
//!         pub patience: Option<u32> [1..=100_000],
//!     }
//! }
//! ```
//!
//! In brackets stand the limits of the type, both included, in the base unit: `[low..=high]` of integers, numbers and quantities, of pairs
//! and options of them, and `[(limits of an item, fewest..=most)]` of lists. After `=` stands the default, as a literal: `0.5`,
//! `"0.003 mm"`, a word. A key without a default must be given, unless its type is an `Option`. After the struct may follow, in this
//! order, `include { name: Type }`, whose keys stand beside its own; `rules(path)`, a function that adds to the [`Fields`] what no single
//! key can say; and `check(path)`, a function that refuses what keys mean together.
//!
//! [`variants!`](crate::variants) declares a mapping with a key that says which parameters there are, [`words!`](crate::words)
//! an enum of words. A type with a syntax of its own implements [`Parameter`].

mod macros;
mod quantities;
#[cfg(test)]
mod tests;
mod values;

pub use quantities::{
    Angle, Charge, Current, Density, ElectricField, Force, Frequency, Length, Resistance, Seed, SpringRate, Stress,
    Time, Voltage,
};

use super::canonical::Canonical;
use super::document::{InputError, Map, Node};
use super::schema::{Fields, Schema};

/// A value as it stands in a document.
pub trait Parameter: Sized {
    /// What bounds a value beside its type; `()` where nothing does.
    type Limits;

    /// A default as it is written in a declaration.
    type Literal;

    /// Reads the value of a key.
    ///
    /// # Errors
    /// When it is no such value, or beyond the limits.
    fn read(node: &Node, key: &str, limits: &Self::Limits) -> Result<Self, InputError>;

    /// The canonical value; `None` where nothing was given and nothing stands in its place.
    fn canonical(&self) -> Option<Canonical>;

    /// What [`Parameter::read`] accepts.
    fn schema(limits: &Self::Limits) -> Schema;

    /// The value that a literal in a declaration stands for.
    fn literal(literal: Self::Literal) -> Self;

    /// A value, for advice.
    #[must_use]
    fn example() -> String {
        "1".to_owned()
    }

    /// The value where the key is absent; `None` where it must be given.
    #[must_use]
    fn absent() -> Option<Self> {
        None
    }
}

/// A mapping that [`parameters!`](crate::parameters!) declares.
pub trait Declared: Sized {
    /// What it is, in messages: "a balance stage".
    const WHAT: &'static str;

    /// Its keys.
    #[must_use]
    fn keys() -> Vec<&'static str>;

    /// Adds its keys to those of a mapping, for the schema and the reference.
    #[must_use]
    fn add_to(fields: Fields) -> Fields;

    /// The mapping by itself, for the schema and the reference.
    #[must_use]
    fn fields() -> Fields;

    /// Reads the values of a mapping whose keys have been checked.
    ///
    /// # Errors
    /// When a value is missing, malformed or beyond its limits, or values contradict each other.
    fn read_map(map: &Map<'_>) -> Result<Self, InputError>;

    /// Adds the canonical value of each key.
    fn entries(&self, out: &mut Vec<(&'static str, Canonical)>);

    /// Reads a mapping that may have some keys beside its own, which are left alone.
    ///
    /// # Errors
    /// When it is no mapping, has a key of another name, or as [`Declared::read_map`].
    fn read_with(node: &Node, others: &[&str]) -> Result<Self, InputError> {
        let keys: Vec<&str> = Self::keys().into_iter().chain(others.iter().copied()).collect();
        Self::read_map(&node.fields(Self::WHAT, &keys)?)
    }

    /// The canonical value.
    fn to_canonical(&self) -> Canonical {
        let mut entries = Vec::new();
        self.entries(&mut entries);
        Canonical::map(entries)
    }
}
