//! Faulty documents, made from good ones, and the messages of the reader.

use std::collections::BTreeSet;

use deaflow::base::InputError;
use miette::Diagnostic;
use serde_json::{Value, json};

use super::documents::Kind;
use super::walk::{self, Place};

/// A changed document, which may still be good.
pub struct Fault {
    pub kind: Kind,
    /// The document, in a pipeline with the changed stage alone: what the schema says of a stage does not depend on
    /// others.
    pub local: Value,
    pub what: String,
    /// The message of the reader, unless it accepts.
    pub refusal: Option<String>,
    /// Whether it is in the values of an axis, which the schema cannot check: the fields that use the axis can.
    pub is_axis: bool,
}

fn help(error: &InputError) -> String {
    error.help().map(|help| help.to_string()).unwrap_or_default()
}

/// The allowed keys, which are listed at the end of the help.
fn allowed(error: &InputError) -> BTreeSet<String> {
    let help = help(error);
    if help == "this value has no parts" {
        return BTreeSet::new();
    }
    let (_, list) = help.rsplit_once(": ").unwrap_or_else(|| panic!("{error}: {help}"));
    list.split(", ").map(str::to_owned).collect()
}

fn with_key(document: &Value, place: &str, key: &str, value: Value) -> Value {
    let mut changed = document.clone();
    changed.pointer_mut(place).unwrap()[key] = value;
    changed
}

/// Provokes the reader at a mapping: the keys that it then allows must be those of the schema. A reader that first
/// looks at the keys of all families must then refuse those of the others with the keys of this one.
pub fn keys_agree(kind: Kind, schema: &Value, document: &Value, place: &Place) {
    let own: BTreeSet<String> = keys(schema, &place.schema);
    let refusal = |key: &str| {
        let changed = with_key(document, &place.document, key, Value::Null);
        let error = kind
            .read(&changed)
            .expect_err(&format!("{}/{key} was accepted", place.document));
        let said = error.to_string();
        (said.contains(&format!("`{key}`")).then(|| allowed(&error)), said)
    };
    let (found, said) = refusal("zzz");
    let found = found.unwrap_or_else(|| panic!("{}: {said}", place.document));
    if found == own {
        return;
    }
    assert_eq!(found, place.family, "{} {}", place.document, place.schema);
    for foreign in place.family.difference(&own) {
        let (found, said) = refusal(foreign);
        assert_eq!(found.as_ref(), Some(&own), "{}/{foreign}: {said}", place.document);
    }
}

fn keys(schema: &Value, at: &str) -> BTreeSet<String> {
    schema.pointer(at).unwrap()["properties"]
        .as_object()
        .unwrap()
        .keys()
        .cloned()
        .collect()
}

/// Adds all faults of a document at places of the schema that were not seen before.
pub fn collect(kind: Kind, document: &Value, seen: &mut BTreeSet<String>, faults: &mut Vec<Fault>) {
    let schema = kind.schema();
    let mut add = |changed: Value, place: &str| {
        faults.push(Fault {
            kind,
            local: local(&changed, place),
            what: format!("{place}: {}", changed.pointer(place).unwrap_or(&json!("(left out)"))),
            refusal: kind
                .read(&needed(&changed, place))
                .err()
                .map(|e| format!("{e} {}", help(&e))),
            is_axis: place.contains("/foreach/"),
        });
    };
    for place in walk::mappings(&schema, document) {
        let shared = walk::shared_place(&schema, &place.schema);
        for key in keys(&schema, &place.schema) {
            if seen.insert(format!("{shared} without {key}")) {
                let mut changed = document.clone();
                let map = changed.pointer_mut(&place.document).unwrap().as_object_mut().unwrap();
                if map.remove(&key).is_some() {
                    add(changed, &format!("{}/{key}", place.document));
                }
            }
        }
        if seen.insert(format!("{shared} with")) {
            add(
                with_key(document, &place.document, "zzz", Value::Null),
                &format!("{}/zzz", place.document),
            );
        }
    }
    for leaf in walk::leaves(&schema, document) {
        let shared = walk::shared_place(&schema, &leaf.schema);
        if is_of_scenes(kind, &shared) || !seen.insert(shared) {
            continue;
        }
        let was = document.pointer(&leaf.document).unwrap();
        for value in replacements(schema.pointer(&leaf.schema).unwrap(), was) {
            let mut changed = document.clone();
            *changed.pointer_mut(&leaf.document).unwrap() = value;
            add(changed, &leaf.document);
        }
    }
}

/// Whether a place of a pipeline's schema is one that the schema of scenes has too.
fn is_of_scenes(kind: Kind, place: &str) -> bool {
    let mut names = walk::OF_SCENES.iter();
    kind == Kind::Pipeline && names.any(|name| place.starts_with(&format!("/$defs/{name}")))
}

/// The document with the stage at a place and what that needs, itself or by other stages: to read all of it for each
/// fault takes long.
fn needed(document: &Value, place: &str) -> Value {
    let mut document = document.clone();
    let stage = place.strip_prefix("/stages/").and_then(|rest| rest.split('/').next());
    let (Some(stage), Some(Value::Object(stages))) = (stage, document.get_mut("stages")) else {
        return document;
    };
    let (mut kept, mut open) = (BTreeSet::new(), vec![stage.to_owned()]);
    while let Some(name) = open.pop() {
        let stage = stages.get(&name);
        let needs = ["needs", "without"].map(|key| stage.and_then(|stage| stage.get(key)?.as_array()));
        let needs = needs.into_iter().flatten().flatten().filter_map(Value::as_str);
        open.extend(needs.filter(|need| !kept.contains(*need)).map(str::to_owned));
        kept.insert(name);
    }
    stages.retain(|name, _| kept.contains(name));
    document
}

/// The document with no other stage than the one at a place.
fn local(document: &Value, place: &str) -> Value {
    let mut document = document.clone();
    let stage = place.strip_prefix("/stages/").and_then(|rest| rest.split('/').next());
    if let (Some(stage), Some(Value::Object(stages))) = (stage, document.get_mut("stages")) {
        stages.retain(|name, _| name == stage);
    }
    document
}

/// Values of all types, words and units, at and beyond the bounds.
fn replacements(node: &Value, was: &Value) -> Vec<Value> {
    let mut values = vec![
        json!(null),
        json!(true),
        json!(false),
        json!([]),
        json!({}),
        json!({ "zzz": 1 }),
        json!("zzz"),
    ];
    values.extend([
        json!(""),
        json!("1 zzz"),
        json!("1 mm"),
        json!("5.2e3V"),
        json!(" 0.5 "),
        json!("1e"),
        json!("1 mm mm"),
    ]);
    values.extend([json!(0), json!(1), json!(2.5), json!(-1), json!(1e99)]);
    for (bound, outward) in [("minimum", -1.0), ("maximum", 1.0)] {
        match &node[bound] {
            Value::Number(n) if n.is_u64() => {
                let n = n.as_u64().unwrap();
                if n < i64::MAX as u64 {
                    values.extend([json!(n), json!(n as i64 + outward as i64)]);
                }
            }
            Value::Number(n) => {
                let n = n.as_f64().unwrap();
                values.extend([json!(n), json!(n + outward * (n.abs() * 1e-6).max(1e-12))]);
            }
            _ => {}
        }
    }
    if let Value::Array(items) = was {
        let one_less = items[..items.len().saturating_sub(1)].to_vec();
        let one_more = [items.clone(), vec![json!("another")]].concat();
        let repeated = [items.clone(), items[..1].to_vec()].concat();
        values.extend([one_less, one_more, repeated].map(Value::Array));
    }
    values
}
