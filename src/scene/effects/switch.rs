//! Switches effects on, with their parameters or with those of the properties.

use serde_json::json;

use super::properties::Properties;
use super::{AUTO, Effects, names};
use deaflow_base::{Declared, InputError, Node, NodeValue, Schema};

/// Effects with a single parameter that is also a key of `properties`.
const SHARED: [(&str, &str); 2] = [(names::INERTIA, "density"), (names::RESISTANCE, "sheet_resistance")];

/// Returns the parameter that an effect can take from `properties`.
fn shared_parameter(effect: &Node) -> Option<&'static str> {
    let found = SHARED.into_iter().find(|(name, _)| effect.is_text(name));
    found.map(|(_, parameter)| parameter)
}

/// Returns the section `effects` with a mapping of parameters for each effect that is on, and no others.
///
/// # Errors
/// When an effect must not be named, or lacks parameters.
pub fn switched_on(effects: &Node, properties: Option<&Node>) -> Result<Node, InputError> {
    let mut on = Vec::new();
    for (key, value) in effects.entries(Effects::WHAT)? {
        if key.is_text(names::INCLUSION) {
            return Err(key
                .error(format!(
                    "`{}` must not be named: the `bodies` of the geometry are rigid",
                    names::INCLUSION
                ))
                .help("give `geometry.bodies` and remove this key"));
        }
        if value.is_text(AUTO) {
            return Err(value
                .error(format!("{} cannot be auto", key.quoted()))
                .help("true switches it on; `effects: auto` lets screening choose all effects"));
        }
        let value = match (value.as_bool(), value.value()) {
            (Some(false), _) => continue,
            (Some(true), _) | (None, NodeValue::Null) => &value.with_value(NodeValue::Map(Vec::new())),
            _ => value,
        };
        if let Some(parameter) = shared_parameter(key).filter(|parameter| value.peek(parameter).is_none()) {
            let known = properties.and_then(|known| known.peek(parameter));
            let known = known.ok_or_else(|| {
                value
                    .error(format!("{} has no `{parameter}`", key.quoted()))
                    .help(format!("give it here or in `properties.{parameter}`"))
            })?;
            let mut parameters = value.clone();
            parameters.put(parameter, known.clone());
            on.push((key.clone(), parameters));
            continue;
        }
        // A property that is not an effect is rejected later, as an unknown key.
        let parametric = Properties::keys()
            .into_iter()
            .find(|name| Effects::keys().contains(name) && key.is_text(name));
        let parameters = match parametric.filter(|_| value.is_empty_map()) {
            Some(name) => properties.and_then(|known| known.peek(name)).ok_or_else(|| {
                value
                    .error(format!("`{name}` has no parameters"))
                    .help(format!("give them here or in `properties.{name}`"))
            })?,
            None => value,
        };
        on.push((key.clone(), parameters.clone()));
    }
    Ok(effects.with_value(NodeValue::Map(on)))
}

/// Returns the schema of an effect from that of its parameters.
pub fn schema(name: &str, parameters: Schema) -> Schema {
    let bare = Schema::new(json!({ "type": ["boolean", "null"] })).description("Whether it is on; no value means on.");
    let empty = Schema::new(json!({ "type": "object", "maxProperties": 0 }));
    let is_shared = SHARED.iter().any(|(effect, _)| *effect == name);
    match is_shared || Properties::keys().contains(&name) {
        true => Schema::any_of([
            parameters,
            bare,
            empty.description("On, with the parameters in `properties`."),
        ]),
        false => Schema::any_of([parameters, bare]),
    }
}
