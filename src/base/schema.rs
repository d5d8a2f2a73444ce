//! JSON Schemas (draft 2020-12) of documents, for editors.
//!
//! Each constructor describes what the reader of [`Node`](super::Node) with the same name accepts. A schema covers
//! structure: keys, words, units and ranges. It cannot express that needs must not form a cycle, or that an Ogden model
//! must match the shear modulus. For a quantity with a unit it checks number and unit, for a bare number also the
//! range.

use serde_json::{Map, Value, json};

use super::quantity::Dimension;

/// The key of the definitions of a document.
const DEFINITIONS: &str = "$defs";

/// The schema of one value.
#[derive(Clone, Debug, PartialEq)]
pub struct Schema(Map<String, Value>);

/// The schema of a mapping: its allowed keys, and which of them are required.
#[derive(Clone, Debug, PartialEq)]
pub struct Fields {
    description: String,
    properties: Vec<(String, Schema)>,
    required: Vec<String>,
    rules: Vec<Value>,
}

impl Schema {
    /// Creates a schema from JSON.
    ///
    /// # Panics
    /// When the value is not an object.
    #[must_use]
    pub fn new(schema: Value) -> Self {
        match schema {
            Value::Object(map) => Self(map),
            other => panic!("a schema must be an object, not {other}"),
        }
    }

    /// A text or a number.
    #[must_use]
    pub fn text() -> Self {
        Self::new(json!({ "type": ["string", "number"] }))
    }

    /// A text that matches a regular expression.
    #[must_use]
    pub fn matching(pattern: &str) -> Self {
        Self::new(json!({ "type": "string", "pattern": pattern }))
    }

    /// One of several words.
    #[must_use]
    pub fn word(words: &[&str]) -> Self {
        match words {
            [only] => Self::new(json!({ "const": only })),
            words => Self::new(json!({ "enum": words })),
        }
    }

    /// A boolean.
    #[must_use]
    pub fn bool() -> Self {
        Self::new(json!({ "type": "boolean" }))
    }

    /// An integer within bounds, both included.
    #[must_use]
    pub fn integer(low: u64, high: u64) -> Self {
        Self::new(json!({ "type": "integer", "minimum": low, "maximum": high }))
    }

    /// A quantity within bounds in the base unit, both included: text with a unit, or a bare number.
    #[must_use]
    pub fn quantity(dimension: Dimension, low: f64, high: f64) -> Self {
        let units = dimension.symbols();
        let number = r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?";
        let (unit, allowed) = match units.first() {
            None => (
                String::new(),
                format!("A number from {} to {}.", plain(low), plain(high)),
            ),
            Some(base) => (
                format!(r"\s*({})?", units.join("|")),
                format!(
                    "From {} to {} {base}, in {}; a bare number is in {base}.",
                    plain(low),
                    plain(high),
                    units.join(", ")
                ),
            ),
        };
        Self::new(json!({
            "type": ["number", "string"],
            "minimum": low,
            "maximum": high,
            "pattern": format!(r"^\s*{number}{unit}\s*$"),
            "description": allowed,
        }))
    }

    /// A pure number within bounds, both included.
    #[must_use]
    pub fn number(low: f64, high: f64) -> Self {
        Self::quantity(Dimension::Number, low, high)
    }

    /// A fraction in percent.
    #[must_use]
    pub fn percentage() -> Self {
        let percentage = Self::matching(r"^\s*\+?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?\s*%\s*$");
        percentage.description("The same in percent: from 0 % to 100 %.")
    }

    /// A list of at least `least` and at most `most` items.
    #[must_use]
    pub fn list(item: Self, least: usize, most: usize) -> Self {
        let mut list = json!({ "type": "array", "items": item.0, "minItems": least });
        if most < usize::MAX {
            list["maxItems"] = json!(most);
        }
        Self::new(list)
    }

    /// A list without repetitions.
    #[must_use]
    pub fn distinct(mut self) -> Self {
        self.0.insert("uniqueItems".to_owned(), json!(true));
        self
    }

    /// One of several schemas; a single schema is returned itself.
    #[must_use]
    pub fn any_of(alternatives: impl IntoIterator<Item = Self>) -> Self {
        let mut alternatives: Vec<Self> = alternatives.into_iter().collect();
        if alternatives.len() == 1 {
            return alternatives.remove(0);
        }
        let alternatives: Vec<Value> = alternatives.into_iter().map(Value::from).collect();
        Self::new(json!({ "anyOf": alternatives }))
    }

    /// A reference to a definition of the document.
    #[must_use]
    pub fn reference(name: &str) -> Self {
        Self::new(json!({ "$ref": format!("#/$defs/{name}") }))
    }

    /// Adds a definition, which schemas can refer to: also itself.
    #[must_use]
    pub fn define(mut self, name: &str, schema: Self) -> Self {
        if let Value::Object(definitions) = self.0.entry(DEFINITIONS).or_insert_with(|| json!({})) {
            definitions.insert(name.to_owned(), schema.into());
        }
        self
    }

    /// Removes the definitions, which belong at the root of a document.
    pub fn take_definitions(&mut self) -> Map<String, Value> {
        match self.0.remove(DEFINITIONS) {
            Some(Value::Object(definitions)) => definitions,
            _ => Map::new(),
        }
    }

    /// Adds the meaning of the value before the description of what is allowed.
    #[must_use]
    pub fn description(mut self, meaning: &str) -> Self {
        let text = match self.0.get("description").and_then(Value::as_str) {
            Some(allowed) if allowed.starts_with(meaning) => allowed.to_owned(),
            Some(allowed) if !meaning.starts_with(allowed.trim_end_matches('.')) => format!("{meaning} {allowed}"),
            _ => meaning.to_owned(),
        };
        self.0.insert("description".to_owned(), Value::String(text));
        self
    }

    /// Adds the default.
    #[must_use]
    pub fn default(mut self, value: impl Into<Value>) -> Self {
        self.0.insert("default".to_owned(), value.into());
        self
    }
}

/// Formats a number for people.
fn plain(value: f64) -> String {
    if value == 0.0 || (1e-4..1e6).contains(&value.abs()) {
        format!("{value}")
    } else {
        format!("{value:e}")
    }
}

impl From<Schema> for Value {
    fn from(schema: Schema) -> Self {
        Self::Object(schema.0)
    }
}

impl Fields {
    /// Creates a mapping without keys.
    #[must_use]
    pub fn new(description: &str) -> Self {
        Self {
            description: description.to_owned(),
            properties: Vec::new(),
            required: Vec::new(),
            rules: Vec::new(),
        }
    }

    /// Adds a required key.
    #[must_use]
    pub fn required(mut self, key: &str, schema: Schema) -> Self {
        self.required.push(key.to_owned());
        self.optional(key, schema)
    }

    /// Adds an optional key.
    #[must_use]
    pub fn optional(mut self, key: &str, schema: Schema) -> Self {
        self.properties.push((key.to_owned(), schema));
        self
    }

    /// Replaces the schema of each key.
    #[must_use]
    pub fn map_schemas(mut self, with: impl Fn(&str, Schema) -> Schema) -> Self {
        let changed = self.properties.into_iter().map(|(key, schema)| {
            let schema = with(&key, schema);
            (key, schema)
        });
        self.properties = changed.collect();
        self
    }

    /// Adds the key `tag` with the constant `word`, which distinguishes this mapping from others.
    #[must_use]
    pub fn tagged(mut self, tag: &str, word: &str) -> Self {
        let schema = Schema::word(&[word]).description(&self.description);
        self.required.insert(0, tag.to_owned());
        self.properties.insert(0, (tag.to_owned(), schema));
        self
    }

    /// The keys, in the order of their addition.
    pub fn keys(&self) -> impl Iterator<Item = &str> {
        self.properties.iter().map(|(key, _)| key.as_str())
    }

    /// Removes a key.
    #[must_use]
    pub fn without(mut self, key: &str) -> Self {
        self.properties.retain(|(other, _)| other != key);
        self.required.retain(|other| other != key);
        self
    }

    /// Makes all keys optional and removes the rules.
    #[must_use]
    pub fn all_optional(self, description: &str) -> Self {
        Self {
            properties: self.properties,
            ..Self::new(description)
        }
    }

    /// Forbids two keys together.
    #[must_use]
    pub fn mutually_exclusive(self, one: &str, other: &str) -> Self {
        self.rule(json!({ "not": { "required": [one, other] } }))
    }

    /// Requires exactly one of some keys.
    #[must_use]
    pub fn exactly_one(self, keys: &[&str]) -> Self {
        self.rule(json!({ "oneOf": each_required(keys) }))
    }

    /// Requires at least one of some keys.
    #[must_use]
    pub fn at_least_one(self, keys: &[&str]) -> Self {
        self.rule(json!({ "anyOf": each_required(keys) }))
    }

    /// Adds a schema that must also hold.
    #[must_use]
    pub fn rule(mut self, schema: Value) -> Self {
        self.rules.push(schema);
        self
    }
}

fn each_required(keys: &[&str]) -> Vec<Value> {
    keys.iter().map(|key| json!({ "required": [key] })).collect()
}

impl From<Fields> for Schema {
    fn from(fields: Fields) -> Self {
        let properties: Map<String, Value> = fields.properties.into_iter().map(|(k, s)| (k, s.into())).collect();
        let mut schema = json!({
            "type": "object",
            "description": fields.description,
            "properties": properties,
            "additionalProperties": false,
        });
        if !fields.required.is_empty() {
            schema["required"] = json!(fields.required);
        }
        if !fields.rules.is_empty() {
            schema["allOf"] = json!(fields.rules);
        }
        Self::new(schema)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantity_has_the_units_of_its_dimension() {
        let schema = Value::from(Schema::quantity(Dimension::Voltage, 0.0, 1e6).description("How much."));
        let pattern = r"^\s*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?\s*(V|kV|MV|mV)?\s*$";
        assert_eq!(schema["pattern"], pattern);
        let said = "How much. From 0 to 1e6 V, in V, kV, MV, mV; a bare number is in V.";
        assert_eq!(schema["description"], said);
        assert_eq!(
            Value::from(Schema::number(0.0, 1.0))["description"],
            "A number from 0 to 1."
        );
    }

    #[test]
    fn a_mapping_allows_its_keys_and_no_others() {
        let fields = Fields::new("Two keys.")
            .required("a", Schema::integer(1, 2))
            .optional("b", Schema::word(&["x"]).default("x"))
            .mutually_exclusive("a", "b");
        let expected = json!({
            "type": "object",
            "description": "Two keys.",
            "properties": {
                "a": { "type": "integer", "minimum": 1, "maximum": 2 },
                "b": { "const": "x", "default": "x" },
            },
            "required": ["a"],
            "additionalProperties": false,
            "allOf": [{ "not": { "required": ["a", "b"] } }],
        });
        assert_eq!(Value::from(Schema::from(fields)), expected);
    }
}
