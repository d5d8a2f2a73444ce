//! Turning effects on: with parameters, or without where the properties have them.

use serde_json::json;

use super::{Effects, names};
use crate::properties::Properties;
use deaflow_base::{Declared, InputError, Node, NodeValue, Schema};

/// Parameters of effects that stand in `properties` by themselves: the effect, and the name of the parameter there and here.
const BORROWED: [(&str, &str); 2] = [(names::INERTIA, "density"), (names::RESISTANCE, "sheet_resistance")];

/// The parameter that an effect may take from `properties`.
fn borrowed(effect: &Node) -> Option<&'static str> {
    let of = BORROWED.into_iter().find(|(name, _)| effect.is_text(name));
    of.map(|(_, parameter)| parameter)
}

/// The section `effects` with every effect that is on as a mapping of its parameters, and no other.
///
/// # Errors
/// When an effect is not one that is named, or has no parameters where it needs some.
pub fn switched_on(effects: &Node, properties: Option<&Node>) -> Result<Node, InputError> {
    let mut on = Vec::new();
    for (key, value) in effects.entries(Effects::WHAT)? {
        if key.is_text(names::INCLUSION) {
            return Err(key
                .error(format!(
                    "`{}` is not named: the `bodies` of the geometry are rigid",
                    names::INCLUSION
                ))
                .help("give `geometry.bodies`, and leave it out here"));
        }
        if value.is_text(crate::AUTO) {
            return Err(value
                .error(format!("{} is not left to the program by itself", key.found_key()))
                .help("true turns it on, and `effects: auto` leaves all of them to the program"));
        }
        let value = match (value.truth(), value.value()) {
            (Some(false), _) => continue,
            (Some(true), _) | (None, NodeValue::Null) => &value.with_value(NodeValue::Map(Vec::new())),
            _ => value,
        };
        if let Some(parameter) = borrowed(key).filter(|parameter| value.peek(parameter).is_none()) {
            let known = properties.and_then(|known| known.peek(parameter));
            let known = known.ok_or_else(|| {
                value
                    .error(format!("{} has no `{parameter}`", key.found_key()))
                    .help(format!("give it here or in `properties.{parameter}`"))
            })?;
            let mut parameters = value.clone();
            parameters.put(parameter, known.clone());
            on.push((key.clone(), parameters));
            continue;
        }
        // A property that is no effect is refused with the other unknown keys.
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

/// What may stand after the name of an effect, given what its parameters may be.
pub fn schema(name: &str, parameters: Schema) -> Schema {
    let bare = Schema::new(json!({ "type": ["boolean", "null"] })).description("Whether it is on; nothing means on.");
    let empty = Schema::new(json!({ "type": "object", "maxProperties": 0 }));
    let borrows = BORROWED.iter().any(|(effect, _)| *effect == name);
    match borrows || Properties::keys().contains(&name) {
        true => Schema::any_of([
            parameters,
            bare,
            empty.description("With the parameters that stand in `properties`."),
        ]),
        false => Schema::any_of([parameters, bare]),
    }
}
