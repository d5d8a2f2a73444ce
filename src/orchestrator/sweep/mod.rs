//! Unrolls stages that are repeated for each value of some axes, before anything else is read.
//!
//! A stage with `foreach: { voltage: [3 kV, 4 kV] }` stands for one stage per value, named `NAME@voltage=3kV`;
//! `"${voltage}"` in its values, and in the scene, is the value. Independent axes multiply, those under `zip` go in
//! step. What needs such a stage has its axes too: one stage per combination, each with the stages of the same values
//! as needs. `gather: true` ends the axes: the stage needs all of them. A stage of a kind that [`Kind::collects`]
//! always gathers, and is told which of its needs belong together.
//!
//! So each stage of a sweep is a stage like any other: cached, planned, explained, locked. Its name is in no key.
//!
//! [`Kind::collects`]: super::kind::Kind::collects

mod axes;
mod expansion;
mod matching;
mod settings;
mod substitute;
mod template;

pub use axes::FOREACH;
pub use expansion::{GATHER, SWEPT_SCENE, unroll};
pub use template::axes_in;

use serde_json::{Value, json};

use deaflow_base::{Fields, Schema};

/// The keys that any stage may have beside those of its kind: they are gone when its kind reads it.
pub const KEYS: [&str; 2] = [FOREACH, GATHER];

/// Stages that a pipeline may have unless more are asked for.
pub const MOST_STAGES: usize = 1000;

/// Stages that a pipeline may have at all.
pub const MANY_STAGES: usize = 20_000;

/// A stage that stands for several.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sweep {
    /// Its name in the file.
    pub name: String,
    /// The stages that it stands for.
    pub stages: Vec<String>,
}

impl Sweep {
    /// Returns whether it stands for other stages than a single one of its name.
    pub fn has_other_stages(&self) -> bool {
        self.stages != [self.name.as_str()]
    }
}

/// The keys of stages that stand for several.
pub fn schema(fields: Fields) -> Fields {
    KEYS.into_iter()
        .fold(fields, |fields, key| fields.optional(key, Schema::reference(key)))
}

/// What the keys of a stage that stands for several may hold, by the key.
pub fn definitions() -> [(String, Value); 2] {
    let axis = json!({ "type": "array", "minItems": 1 });
    let zip = json!({ "type": "object", "minProperties": 1, "additionalProperties": axis });
    let foreach = json!({
        "type": "object",
        "minProperties": 1,
        "properties": { "zip": { "anyOf": [zip, { "type": "array", "items": zip }] } },
        "additionalProperties": axis,
        "description": "One stage for each combination of values: lists by the names of axes, `\"${axis}\"` in the \
            stage's values; axes under `zip` go in step.",
    });
    let gather = json!({
        "anyOf": [{ "type": "boolean" }, { "type": "array", "items": { "type": "string" } }],
        "description": "The axes of its needs that end here: true for all, or their names.",
    });
    [(FOREACH.to_owned(), foreach), (GATHER.to_owned(), gather)]
}
