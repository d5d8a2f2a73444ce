//! Declared parameters. One declaration contains name, type with unit, limits, default and documentation; reader, JSON
//! Schema, canonical value, `--set`, lock files and the tables in docs/reference.md follow from it.
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
//! The limits are in brackets, both included, in the base unit: `[low..=high]` for integers, numbers and quantities and
//! for pairs and options of them, and `[(limits of an item, fewest..=most)]` for lists. The default follows `=` as a
//! literal: `0.5`, `"0.003 mm"`, a word. A key without a default is required, unless its type is an `Option`. The
//! struct can be followed, in this order, by `include { name: Type }`, which adds the keys of another mapping;
//! `rules(path)`, a function that adds rules for several keys to the [`Fields`]; and `check(path)`, a function that
//! checks several keys together; and `shared("name")` if the schema is a definition of the document, which can contain
//! itself.
//!
//! [`variants!`](crate::variants) declares a mapping whose parameters depend on the word of a key,
//! [`words!`](crate::words) an enum of words. A type with its own syntax implements [`Parameter`].

mod macros;
mod quantities;
#[cfg(test)]
mod tests;
mod values;

pub use quantities::{
    Angle, Charge, Current, Density, ElectricField, Force, Frequency, Length, Mass, Resistance, Seed, SpringRate,
    Stress, Time, Voltage, Volume,
};

use super::canonical::Canonical;
use super::document::{InputError, Map, Node};
use super::schema::{Fields, Schema};

/// A value in a document.
pub trait Parameter: Sized {
    /// The limits of a value; `()` if there are none.
    type Limits;

    /// The type of a default in a declaration.
    type Literal;

    /// Reads the value of a key.
    ///
    /// # Errors
    /// When the value is invalid or outside the limits.
    fn read(node: &Node, key: &str, limits: &Self::Limits) -> Result<Self, InputError>;

    /// Returns the canonical value; `None` if the value is absent and has no default.
    fn canonical(&self) -> Option<Canonical>;

    /// Returns the schema of [`Parameter::read`].
    fn schema(limits: &Self::Limits) -> Schema;

    /// Converts a default in a declaration.
    fn literal(literal: Self::Literal) -> Self;

    /// Returns an example for help texts.
    #[must_use]
    fn example() -> String {
        "1".to_owned()
    }

    /// Returns the value of an absent key; `None` if the key is required.
    #[must_use]
    fn absent() -> Option<Self> {
        None
    }
}

/// A mapping that [`parameters!`](crate::parameters!) declares.
pub trait Declared: Sized {
    /// The name in messages: "a balance stage".
    const WHAT: &'static str;

    /// The keys.
    #[must_use]
    fn keys() -> Vec<&'static str>;

    /// Adds the keys to those of a mapping, for the schema and the reference.
    #[must_use]
    fn add_to(fields: Fields) -> Fields;

    /// Returns the mapping, for the schema and the reference.
    #[must_use]
    fn fields() -> Fields;

    /// Reads the values of a mapping whose keys have been checked.
    ///
    /// # Errors
    /// When a value is missing, malformed or outside its limits, or values contradict each other.
    fn read_map(map: &Map<'_>) -> Result<Self, InputError>;

    /// Adds the canonical value of each key.
    fn entries(&self, out: &mut Vec<(&'static str, Canonical)>);

    /// Reads a mapping that can also have the keys `others`, which are ignored.
    ///
    /// # Errors
    /// When it is not a mapping, has another key, or as for [`Declared::read_map`].
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
