//! Walks through a schema beside a document that it describes.

use std::collections::BTreeSet;

use serde_json::Value;

use super::documents::Kind;

/// A mapping of a document, and the mapping of the schema that describes it; both as JSON pointers.
pub struct Place {
    pub document: String,
    pub schema: String,
    /// The keys of all mappings that could stand there: families of one kind, models of one effect.
    pub family: BTreeSet<String>,
}

impl Place {
    pub fn value<'a>(&self, document: &'a Value) -> &'a Value {
        document.pointer(&self.document).unwrap()
    }
}

/// A value of a document, and the schema that describes it.
pub struct Leaf {
    pub document: String,
    pub schema: String,
}

/// All mappings of a document with named keys, outermost first.
pub fn mappings(root: &Value, document: &Value) -> Vec<Place> {
    let mut found = Vec::new();
    let on_mapping = &mut |place| found.push(place);
    walk(root, "", document, "", on_mapping, &mut |_| ());
    found
}

/// All values of a document.
pub fn leaves(root: &Value, document: &Value) -> Vec<Leaf> {
    let mut found = Vec::new();
    walk(root, "", document, "", &mut |_| (), &mut |leaf| found.push(leaf));
    found
}

/// The definitions that the schema of scenes has too.
pub const OF_SCENES: [&str; 2] = ["scene", "shape"];

/// Pointers to all properties of a schema, those of the scene in a pipeline's left out. Keys that stages of all kinds
/// share are told once, by the place that they refer to.
pub fn properties(root: &Value, kind: Kind) -> BTreeSet<String> {
    fn look(node: &Value, at: &str, kind: Kind, found: &mut BTreeSet<String>) {
        let Some(map) = node.as_object() else { return };
        for (key, item) in map {
            let here = format!("{at}/{key}");
            match key.as_str() {
                "properties" | "$defs" => {
                    for (name, schema) in item.as_object().unwrap() {
                        if (kind, key.as_str()) == (Kind::Pipeline, "$defs") && OF_SCENES.contains(&name.as_str()) {
                            continue;
                        }
                        if key == "properties" && is_closed(node) {
                            found.insert(shared(schema).unwrap_or_else(|| format!("{here}/{name}")));
                        }
                        look(schema, &format!("{here}/{name}"), kind, found);
                    }
                }
                "anyOf" => {
                    for (i, schema) in item.as_array().unwrap().iter().enumerate() {
                        look(schema, &format!("{here}/{i}"), kind, found);
                    }
                }
                "items" | "additionalProperties" => look(item, &here, kind, found),
                _ => {}
            }
        }
    }
    let mut found = BTreeSet::new();
    look(root, "", kind, &mut found);
    found
}

/// Whether a mapping has no other keys than those that the schema names.
fn is_closed(node: &Value) -> bool {
    node.get("additionalProperties") == Some(&Value::Bool(false))
}

/// The place of a schema that is no more than a reference.
pub fn shared(schema: &Value) -> Option<String> {
    let is_alone = schema.as_object().is_some_and(|keys| keys.len() == 1);
    let reference = schema.get("$ref").and_then(Value::as_str).filter(|_| is_alone)?;
    Some(reference.strip_prefix('#')?.to_owned())
}

/// The place of a schema in the definition of shapes, if it is a copy of what stands there: shapes are also bodies and
/// patterns, with further keys.
pub fn shared_place(root: &Value, at: &str) -> String {
    const KEYS: &str = "/properties/";
    let in_shape = at.match_indices(KEYS).find_map(|(start, _)| {
        let rest = &at[start + KEYS.len()..];
        let key = rest.split('/').next().unwrap_or(rest);
        let own = root.pointer(&format!("{}{KEYS}{key}", &at[..start]))?;
        let of_shape = root.pointer(&format!("/$defs/shape{KEYS}{key}"))?;
        (own == of_shape).then(|| format!("/$defs/shape{}", &at[start..]))
    });
    in_shape.unwrap_or_else(|| at.to_owned())
}

/// The place of a schema once its references are followed.
fn resolved(root: &Value, at: &str) -> String {
    match root.pointer(at).unwrap().get("$ref").and_then(Value::as_str) {
        Some(reference) => resolved(root, reference.strip_prefix('#').unwrap()),
        None => at.to_owned(),
    }
}

/// The alternative that describes a value, and the keys of its siblings.
fn chosen(root: &Value, at: &str, value: &Value) -> Option<(String, BTreeSet<String>)> {
    let at = resolved(root, at);
    let node = root.pointer(&at).unwrap();
    let Some(alternatives) = node.get("anyOf").and_then(Value::as_array) else {
        let keys = keys(node);
        return fits(node, value).then_some((at, keys));
    };
    let places: Vec<String> = (0..alternatives.len()).map(|i| format!("{at}/anyOf/{i}")).collect();
    let is_direct = |place: &String| {
        let node = root.pointer(place).unwrap();
        node.get("$ref").is_none() && node.get("anyOf").is_none()
    };
    let (place, (found, nested)) = places
        .iter()
        .find_map(|place| Some((place, chosen(root, place, value)?)))?;
    if !is_direct(place) {
        return Some((found, nested));
    }
    let siblings = places.iter().filter(|place| is_direct(place));
    let family = siblings.flat_map(|place| keys(root.pointer(place).unwrap())).collect();
    Some((found, family))
}

fn keys(node: &Value) -> BTreeSet<String> {
    let map = node.get("properties").and_then(Value::as_object);
    map.map(|map| map.keys().cloned().collect()).unwrap_or_default()
}

/// Whether a schema without alternatives is meant for a value: by its type, its constants and the keys that it must
/// have.
fn fits(node: &Value, value: &Value) -> bool {
    if let Some(constant) = node.get("const") {
        return constant == value;
    }
    if let Some(words) = node.get("enum").and_then(Value::as_array) {
        return words.contains(value);
    }
    let name = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    let is = |word: &Value| word == name || (word == "integer" && name == "number");
    let of_type = match &node["type"] {
        Value::Array(types) => types.iter().any(is),
        one => is(one),
    };
    let Value::Object(map) = value else {
        return of_type;
    };
    let required = node.get("required").and_then(Value::as_array).into_iter().flatten();
    // A word that tells mappings apart, or the axis that has it as a value.
    let constant = |key: &String| {
        let property = node["properties"].get(key)?;
        property.get("const").or_else(|| property.pointer("/anyOf/0/const"))
    };
    of_type
        && node
            .get("maxProperties")
            .and_then(Value::as_u64)
            .is_none_or(|most| map.len() as u64 <= most)
        && required.clone().all(|key| map.contains_key(key.as_str().unwrap()))
        && map.iter().all(|(key, item)| constant(key).is_none_or(|c| c == item))
}

fn walk(
    root: &Value,
    schema: &str,
    value: &Value,
    document: &str,
    on_mapping: &mut impl FnMut(Place),
    on_leaf: &mut impl FnMut(Leaf),
) {
    let (at, family) = chosen(root, schema, value).unwrap_or_else(|| panic!("no alternative for {document}: {value}"));
    let node = root.pointer(&at).unwrap();
    if !document.is_empty() {
        on_leaf(Leaf {
            document: document.to_owned(),
            schema: at.clone(),
        });
    }
    let mut children = Vec::new();
    match value {
        Value::Object(map) => {
            if node.get("properties").is_some() && is_closed(node) {
                on_mapping(Place {
                    document: document.to_owned(),
                    schema: at.clone(),
                    family,
                });
            }
            for (key, item) in map {
                let child = match node.pointer(&format!("/properties/{key}")) {
                    Some(_) => format!("{at}/properties/{key}"),
                    None => format!("{at}/additionalProperties"),
                };
                children.push((child, item, format!("{document}/{key}")));
            }
        }
        // Values of axes are whatever they stand for elsewhere.
        Value::Array(_) if node.get("items").is_none() => {}
        Value::Array(items) => {
            let child = |(i, item)| (format!("{at}/items"), item, format!("{document}/{i}"));
            children.extend(items.iter().enumerate().map(child));
        }
        _ => {}
    }
    for (child, item, place) in children {
        walk(root, &child, item, &place, on_mapping, on_leaf);
    }
}
