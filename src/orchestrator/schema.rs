//! What a pipeline may look like, as a JSON Schema: the frame around the kinds of stages and the scene.

use serde_json::{Map, Value, json};

use super::entry::Registry;
use super::kind::Kind;
use super::rounds;
use crate::base::{Fields, Schema};

const DIALECT: &str = "https://json-schema.org/draft/2020-12/schema";

/// The JSON Schema of pipelines.
#[must_use]
pub fn of_pipeline(registry: &Registry) -> Value {
    let reference = |name: &str| Schema::new(json!({ "$ref": format!("#/$defs/{name}") }));
    let scene = Schema::any_of([
        Schema::new(json!({ "type": "string", "description": "A file, relative to the pipeline." })),
        reference("scene"),
    ]);
    let stages = json!({
        "type": "object",
        "description": "The stages by name, in any order. Names are of letters, digits, '_' and '-'.",
        "minProperties": 1,
        "propertyNames": { "pattern": "^[A-Za-z0-9_-]+$" },
        "additionalProperties": Value::from(Schema::any_of(registry.kinds.iter().map(|kind| reference(kind.name())))),
    });
    let pipeline = Fields::new("A pipeline of deaflow: stages that need each other, and the scene that they share.")
        .required(
            "version",
            Schema::new(json!({ "const": 1 })).description("The version of this format."),
        )
        .required("name", Schema::text().description("The name of the pipeline."))
        .optional(
            "scene",
            scene.description("The scene of all stages: a file, or the mapping itself."),
        )
        .required("stages", Schema::new(stages));
    let mut definitions = Map::new();
    let gated = registry.kinds.iter().any(|kind| kind.gates());
    definitions.insert("scene".to_owned(), (registry.scene_schema)().into());
    for kind in &registry.kinds {
        definitions.insert(kind.name().to_owned(), of_kind(*kind, gated, registry).into());
    }
    let mut root = titled("deaflow pipeline", pipeline.into());
    root["$defs"] = Value::Object(definitions);
    root
}

/// The JSON Schema of scenes in files of their own.
#[must_use]
pub fn of_scene(registry: &Registry) -> Value {
    titled("deaflow scene", (registry.scene_schema)())
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
    let most = if gated || !kind.may_need().is_empty() {
        usize::MAX
    } else {
        needs.most
    };
    let with_frame = |fields: Fields| {
        let fields = rounds::schema(kind, fields, registry);
        let fields = fields.required("kind", Schema::word(&[kind.name()]).description("What the stage does."));
        let list = || {
            let beside = match kind.may_need() {
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
