//! What a pipeline may look like, as a JSON Schema: the frame around the kinds of stages and the scene.

use serde_json::{Map, Value, json};

use super::entry::Registry;
use super::kind::Kind;
use super::rounds;
use super::scene_from;
use super::sweep;
use deaflow_base::{Fields, Schema};

const DIALECT: &str = "https://json-schema.org/draft/2020-12/schema";

/// The JSON Schema of pipelines.
#[must_use]
pub fn pipeline_schema(registry: &Registry) -> Value {
    let scene_or_file = Schema::any_of([
        Schema::new(json!({ "type": "string", "description": "A file, relative to the pipeline." })),
        Schema::reference("scene"),
    ]);
    let stages = json!({
        "type": "object",
        "description": "The stages by name, in any order. Names are of letters, digits, '_' and '-'.",
        "minProperties": 1,
        "propertyNames": { "pattern": "^[A-Za-z0-9_-]+$" },
        "additionalProperties": Value::from(Schema::any_of(registry.kinds.iter().map(|kind| Schema::reference(kind.name())))),
    });
    let pipeline = Fields::new("A pipeline of deaflow: stages that need each other, and the scene that they share.")
        .required(
            "version",
            Schema::new(json!({ "const": 1 })).description("The version of this format."),
        )
        .required("name", Schema::text().description("The name of the pipeline."))
        .optional(
            "scene",
            scene_or_file.description("The scene of all stages: a file, or the mapping itself."),
        )
        .required("stages", Schema::new(stages));
    let mut scene = (registry.scene_schema)();
    let mut definitions = scene.take_definitions();
    let gated = registry.kinds.iter().any(|kind| kind.gates());
    definitions.insert("scene".to_owned(), scene.into());
    for kind in &registry.kinds {
        definitions.insert(kind.name().to_owned(), of_kind(*kind, gated, registry).into());
    }
    definitions.values_mut().for_each(allow_axes);
    definitions.insert("axis".to_owned(), axis());
    definitions.extend(sweep::definitions());
    let mut root = titled("deaflow pipeline", pipeline.into());
    root["patternProperties"] = json!({ "^x-": {
        "description": "Skipped: holds anchors (`&name`) that other places share (`*name`, `<<: *name`).",
    } });
    root["$defs"] = Value::Object(definitions);
    root
}

/// The JSON Schema of scenes in files of their own.
#[must_use]
pub fn scene_schema(registry: &Registry) -> Value {
    let mut scene = (registry.scene_schema)();
    let mut definitions = scene.take_definitions();
    let mut root = titled("deaflow scene", scene);
    allow_axes(&mut root);
    definitions.values_mut().for_each(allow_axes);
    definitions.insert("axis".to_owned(), axis());
    root["$defs"] = Value::Object(definitions);
    root
}

/// The value of an axis, which may stand in place of any value.
fn axis() -> Value {
    json!({
        "type": "string",
        "pattern": "\\$\\{[A-Za-z0-9_-]+\\}",
        "description": "The value that an axis of the stage has: \"${axis}\".",
    })
}

/// Allows `"${axis}"` in place of each value, and items of lists that stand for several.
fn allow_axes(schema: &mut Value) {
    let Value::Object(keys) = schema else { return };
    if let Some(Value::Object(properties)) = keys.get_mut("properties") {
        let values = properties.iter_mut().filter(|(key, _)| !PLAIN.contains(&key.as_str()));
        values.for_each(|(_, value)| or_axis(value, None));
    }
    for key in ["allOf", "anyOf", "oneOf", "prefixItems"] {
        if let Some(Value::Array(schemas)) = keys.get_mut(key) {
            schemas.iter_mut().for_each(allow_axes);
        }
    }
    for key in ["then", "else"] {
        keys.get_mut(key).into_iter().for_each(allow_axes);
    }
    if let Some(items @ Value::Object(_)) = keys.get_mut("items") {
        or_axis(items, Some(json!({ "type": "object", "required": [sweep::FOREACH] })));
    }
}

/// Keys that say what the others may be.
const PLAIN: [&str; 3] = ["kind", sweep::FOREACH, sweep::GATHER];

/// A value, or that of an axis, or another form of it.
fn or_axis(schema: &mut Value, other: Option<Value>) {
    allow_axes(schema);
    let mut keys = Map::new();
    if let Value::Object(own) = schema {
        for word in ["description", "default"] {
            keys.extend(own.remove(word).map(|value| (word.to_owned(), value)));
        }
    }
    let forms = [Some(schema.take()), Some(json!({ "$ref": "#/$defs/axis" })), other];
    keys.insert("anyOf".to_owned(), forms.into_iter().flatten().collect());
    *schema = Value::Object(keys);
}

fn titled(title: &str, schema: Schema) -> Value {
    let mut root = Value::from(schema);
    root["$schema"] = json!(DIALECT);
    root["title"] = json!(title);
    root
}

/// `gated`: any stage that needs others may also wait for some that it does not read.
fn of_kind(kind: &dyn Kind, gated: bool, registry: &Registry) -> Schema {
    let needs = kind.needs();
    let most = if gated || !kind.optional_needs().is_empty() {
        usize::MAX
    } else {
        needs.most
    };
    let with_frame = |fields: Fields| {
        let fields = sweep::schema(rounds::schema(kind, fields, registry));
        let fields = match kind.reads_scene() {
            true => scene_from::schema(fields),
            false => fields,
        };
        let fields = fields.required("kind", Schema::word(&[kind.name()]).description("What the stage does."));
        let list = || {
            let beside = match kind.optional_needs() {
                [] => String::new(),
                kinds => format!(" Beside them also of kind {}.", kinds.join(" or ")),
            };
            let meaning = format!("Stages of kind {}.{beside}", needs.kinds.join(" or "));
            let list = Schema::list(Schema::text(), needs.least, most);
            list.distinct().description(&meaning)
        };
        Schema::from(match (needs.most, needs.least) {
            (0, _) => fields,
            (_, 0) => fields.optional("needs", list()),
            _ => fields.required("needs", list()),
        })
    };
    Schema::any_of(kind.schema().into_iter().map(with_frame))
}
