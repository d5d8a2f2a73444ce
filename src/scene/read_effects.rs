//! Reads the effects and the properties of a scene.

use super::effects::{
    BreakdownLaw, Effects, Electrode, PermittivityDecay, PermittivityReference, Stiffening,
    names::{self, AVAILABLE, PLANNED},
};
use super::properties::{Branch, Properties};
use crate::base::{Decimal, Dimension, InputError, Map, Node, NodeValue, Quantity};

/// What `effects` asks for.
pub enum Request {
    /// What screening calls for.
    Auto,
    /// These.
    Named(Effects),
}

const PROPERTIES: [&str; 7] = [
    names::STIFFENING,
    names::ELECTRODE,
    names::PERMITTIVITY,
    names::BREAKDOWN,
    names::VISCOELASTICITY,
    "density",
    "sheet_resistance",
];

/// Reads the section `effects`; what an effect needs and does not say is taken from the properties.
pub fn read_effects(node: Option<&Node>, known: &Properties, modulus: f64) -> Result<Request, InputError> {
    let Some(node) = node else {
        return Ok(Request::Named(Effects::default()));
    };
    if let NodeValue::Text(text) = node.value() {
        return match text.as_str() {
            "auto" => Ok(Request::Auto),
            _ => Err(node
                .error(format!("`effects` must be a mapping or auto, found {}", node.found()))
                .help("allowed: auto, {}, or a mapping of effects")),
        };
    }
    let what = "`effects`";
    refuse_planned(node, what)?;
    let map = node.fields(what, &AVAILABLE)?;
    Ok(Request::Named(Effects {
        strain_stiffening: with_parameters(&map, names::STIFFENING, &known.strain_stiffening, |node| {
            read_stiffening(node, modulus)
        })?,
        electrode_stiffness: with_parameters(&map, names::ELECTRODE, &known.electrode_stiffness, read_electrode)?,
        stretch_dependent_permittivity: with_parameters(
            &map,
            names::PERMITTIVITY,
            &known.stretch_dependent_permittivity,
            read_permittivity,
        )?,
        fringe_field: plain(&map, names::FRINGE)?,
        wrinkling: plain(&map, names::WRINKLING)?,
        dielectric_breakdown: with_parameters(&map, names::BREAKDOWN, &known.dielectric_breakdown, read_breakdown)?,
        electromechanical_stability: plain(&map, names::STABILITY)?,
    }))
}

/// Reads the section `properties`.
pub fn read_properties(node: Option<&Node>, modulus: f64) -> Result<Properties, InputError> {
    let Some(node) = node else {
        return Ok(Properties::default());
    };
    let map = node.fields("`properties`", &PROPERTIES)?;
    let quantity = |key: &str, dimension, low, high| {
        let node = map.optional(key);
        node.map(|node| node.quantity_in(key, dimension, low, high)).transpose()
    };
    let stiffening = |node| read_stiffening(node, modulus);
    Ok(Properties {
        strain_stiffening: map.optional(names::STIFFENING).map(stiffening).transpose()?,
        electrode_stiffness: map.optional(names::ELECTRODE).map(read_electrode).transpose()?,
        stretch_dependent_permittivity: map.optional(names::PERMITTIVITY).map(read_permittivity).transpose()?,
        dielectric_breakdown: map.optional(names::BREAKDOWN).map(read_breakdown).transpose()?,
        viscoelasticity: map
            .optional(names::VISCOELASTICITY)
            .map_or(Ok(Vec::new()), read_branches)?,
        density: quantity("density", Dimension::Density, 1.0, 1e5)?,
        sheet_resistance: quantity("sheet_resistance", Dimension::Resistance, 0.0, 1e15)?,
    })
}

/// An effect that is known but cannot be simulated is not a spelling mistake.
fn refuse_planned(node: &Node, what: &str) -> Result<(), InputError> {
    for (key, _) in node.entries(what)? {
        if let Some(name) = PLANNED.into_iter().find(|name| key.is_text(name)) {
            return Err(key
                .error(format!("the effect `{name}` is not available yet"))
                .help(format!("available: {}", AVAILABLE.join(", "))));
        }
    }
    Ok(())
}

/// An effect without parameters: `{}`, `true`, or nothing after the colon; `false` leaves it off.
fn plain(map: &Map<'_>, name: &str) -> Result<bool, InputError> {
    match map.optional(name) {
        None => Ok(false),
        Some(node) => match node.value() {
            NodeValue::Null => Ok(true),
            NodeValue::Bool(on) => Ok(*on),
            _ => node
                .fields(&format!("`{name}`, which takes no parameters,"), &[])
                .map(|_| true),
        },
    }
}

/// An effect with parameters: its own, or with `{}`, `true` or nothing those of the properties.
fn with_parameters<T: Clone>(
    map: &Map<'_>,
    name: &str,
    known: &Option<T>,
    read: impl Fn(&Node) -> Result<T, InputError>,
) -> Result<Option<T>, InputError> {
    let Some(node) = map.optional(name) else {
        return Ok(None);
    };
    match node.value() {
        NodeValue::Bool(false) => return Ok(None),
        NodeValue::Null | NodeValue::Bool(true) => {}
        NodeValue::Map(entries) if entries.is_empty() => {}
        _ => return read(node).map(Some),
    }
    match known {
        Some(known) => Ok(Some(known.clone())),
        None => Err(node
            .error(format!("`{name}` has no parameters"))
            .help(format!("give them here or in `properties.{name}`"))),
    }
}

fn read_stiffening(node: &Node, modulus: f64) -> Result<Stiffening, InputError> {
    let what = "`strain_stiffening`";
    let map = node.fields(what, &["model", "jm", "c2", "c3", "terms", "locking_stretch"])?;
    let model = map
        .required(what, "model")?
        .word("model", &["gent", "yeoh", "ogden", "arruda-boyce"])?;
    let own: &[&str] = match model {
        "gent" => &["model", "jm"],
        "yeoh" => &["model", "c2", "c3"],
        "ogden" => &["model", "terms"],
        _ => &["model", "locking_stretch"],
    };
    let what = format!("a {model} model");
    let map = node.fields(&what, own)?;
    match model {
        "gent" => Ok(Stiffening::Gent {
            jm: number(&map, &what, "jm", 1e-3, 1e12)?,
        }),
        "yeoh" => {
            let stress = |key| map.required(&what, key)?.quantity_in(key, Dimension::Stress, -1e9, 1e9);
            Ok(Stiffening::Yeoh {
                c2: stress("c2")?,
                c3: stress("c3")?,
            })
        }
        "ogden" => read_ogden(map.required(&what, "terms")?, modulus),
        _ => Ok(Stiffening::ArrudaBoyce {
            locking_stretch: number(&map, &what, "locking_stretch", 1.0, 1e6)?,
        }),
    }
}

fn read_ogden(node: &Node, modulus: f64) -> Result<Stiffening, InputError> {
    let items = node.list("terms")?;
    if !(1..=3).contains(&items.len()) {
        return Err(node.error(format!("`terms` has {} terms: one to three are allowed", items.len())));
    }
    let term = |node: &Node| -> Result<(Quantity, Quantity), InputError> {
        let map = node.fields("a term", &["mu", "alpha"])?;
        let alpha = map.required("a term", "alpha")?;
        let exponent = alpha.quantity_in("alpha", Dimension::Number, -15.0, 15.0)?;
        if exponent.value().abs() < 1e-3 {
            return Err(alpha.error("`alpha` is zero or nearly so: the term would be singular"));
        }
        let mu = map
            .required("a term", "mu")?
            .quantity_in("mu", Dimension::Stress, -1e9, 1e9)?;
        Ok((mu, exponent))
    };
    let terms = items.iter().map(term).collect::<Result<Vec<_>, _>>()?;
    let small_strain: f64 = terms.iter().map(|(mu, alpha)| 0.5 * mu.value() * alpha.value()).sum();
    if (small_strain / modulus - 1.0).abs() > 1e-2 {
        return Err(node
            .error(format!(
                "the terms have the small-strain shear modulus ½ Σ mu alpha = {small_strain:.6} Pa, but `shear_modulus` is {modulus} Pa"
            ))
            .help("the two must agree to 1 %"));
    }
    Ok(Stiffening::Ogden { terms })
}

fn read_electrode(node: &Node) -> Result<Electrode, InputError> {
    let what = "`electrode_stiffness`";
    let map = node.fields(what, &["shear_modulus", "thickness"])?;
    Ok(Electrode {
        shear_modulus: map.required(what, "shear_modulus")?.quantity_in(
            "shear_modulus",
            Dimension::Stress,
            0.0,
            1e12,
        )?,
        thickness: map
            .required(what, "thickness")?
            .quantity_in("thickness", Dimension::Length, 0.0, 1e3)?,
    })
}

fn read_permittivity(node: &Node) -> Result<PermittivityDecay, InputError> {
    let what = "`stretch_dependent_permittivity`";
    let map = node.fields(what, &["exponent", "reference"])?;
    let references = [PermittivityReference::Prestretched, PermittivityReference::Undeformed];
    let reference = match map.optional("reference") {
        Some(node) => {
            let word = node.word("reference", &references.map(PermittivityReference::name))?;
            references.into_iter().find(|r| r.name() == word)
        }
        None => None,
    };
    Ok(PermittivityDecay {
        exponent: number(&map, what, "exponent", -0.5, 0.9)?,
        reference: reference.unwrap_or(PermittivityReference::Prestretched),
    })
}

fn read_breakdown(node: &Node) -> Result<BreakdownLaw, InputError> {
    let what = "`dielectric_breakdown`";
    let map = node.fields(what, &["law", "field"])?;
    let field = map.optional("field");
    match map.required(what, "law")?.word("law", &["huang", "constant"])? {
        "huang" => match field {
            Some(node) => Err(node.error("`field` belongs to `law: constant`; Huang's law computes the field")),
            None => Ok(BreakdownLaw::Huang),
        },
        _ => {
            let field = map.required(what, "field")?;
            Ok(BreakdownLaw::Constant(field.quantity_in(
                "field",
                Dimension::Field,
                1.0,
                1e12,
            )?))
        }
    }
}

fn read_branches(node: &Node) -> Result<Vec<Branch>, InputError> {
    let branch = |node: &Node| {
        let map = node.fields("a branch", &["modulus", "time"])?;
        Ok(Branch {
            modulus: map
                .required("a branch", "modulus")?
                .quantity_in("modulus", Dimension::Stress, 0.0, 1e12)?,
            time: map
                .required("a branch", "time")?
                .quantity_in("time", Dimension::Time, 1e-12, 1e12)?,
        })
    };
    node.list(names::VISCOELASTICITY)?.iter().map(branch).collect()
}

fn number(map: &Map<'_>, what: &str, key: &str, low: f64, high: f64) -> Result<Decimal, InputError> {
    let node = map.required(what, key)?;
    Ok(node.quantity_in(key, Dimension::Number, low, high)?.base())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Document;
    use crate::scene::Scene;
    use std::path::Path;

    fn read(effects: &str, properties: &str) -> Result<Scene, InputError> {
        let text = format!(
            "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }}\n\
             material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}\n\
             drive: {{ voltage: 5 kV }}\neffects: {effects}\nproperties: {properties}\n"
        );
        Scene::read(&Document::from_text(Path::new("s.yaml"), &text)?.root)
    }

    fn refusal(effects: &str, properties: &str) -> String {
        let error = read(effects, properties).unwrap_err();
        format!(
            "{error} {:?}",
            miette::Diagnostic::help(&error).map(|help| help.to_string())
        )
    }

    #[test]
    fn every_effect_is_read_with_its_parameters() {
        let scene = read(
            "{ strain_stiffening: { model: yeoh, c2: -1 kPa, c3: 20 Pa }, electrode_stiffness: { shear_modulus: 1 MPa, \
             thickness: 5 um }, stretch_dependent_permittivity: { exponent: 0.1, reference: undeformed }, fringe_field: {}, \
             wrinkling: true, dielectric_breakdown: { law: huang }, electromechanical_stability: }",
            "{}",
        );
        let effects = scene.unwrap().effects;
        let Some(Stiffening::Yeoh { c2, c3 }) = effects.strain_stiffening else {
            panic!("a Yeoh model");
        };
        assert_eq!((c2.value(), c3.value()), (-1e3, 20.0));
        assert_eq!(effects.electrode_stiffness.unwrap().thickness.value(), 0.005);
        let permittivity = effects.stretch_dependent_permittivity.unwrap();
        assert_eq!(permittivity.reference, PermittivityReference::Undeformed);
        assert!(effects.fringe_field && effects.wrinkling && effects.electromechanical_stability);
        assert_eq!(effects.dielectric_breakdown, Some(BreakdownLaw::Huang));
        assert!(read("{}", "{}").unwrap().effects.is_empty());
        assert!(read("{ wrinkling: false }", "{}").unwrap().effects.is_empty());
        assert!(read("auto", "{}").unwrap().auto);
    }

    #[test]
    fn parameters_may_stand_with_the_properties() {
        let gent = "{ strain_stiffening: { model: gent, jm: 125 } }";
        let named = read("{ strain_stiffening: {} }", gent).unwrap();
        assert_eq!(named.effects, read(gent, "{}").unwrap().effects);
        assert!(read("{}", gent).unwrap().effects.is_empty());
    }

    #[test]
    fn refusals_say_what_is_allowed() {
        for (effects, properties, said) in [
            ("{ inertia: {} }", "{}", "the effect `inertia` is not available yet"),
            ("{ viscoelasticity: {} }", "{}", "available: strain_stiffening"),
            ("{ wrinkle: {} }", "{}", "did you mean `wrinkling`"),
            ("{ wrinkling: { w: 1 } }", "{}", "takes no parameters"),
            ("{ strain_stiffening: {} }", "{}", "properties.strain_stiffening"),
            ("{ strain_stiffening: { model: gent } }", "{}", "`jm` is missing"),
            ("{ strain_stiffening: { model: gent, jm: 0 } }", "{}", "out of range"),
            (
                "{ strain_stiffening: { model: gent, jm: 9, c2: 1 } }",
                "{}",
                "unknown key `c2`",
            ),
            (
                "{ strain_stiffening: { model: ogden, terms: [ { mu: 45 kPa, alpha: 3 } ] } }",
                "{}",
                "67500",
            ),
            (
                "{ strain_stiffening: { model: ogden, terms: [] } }",
                "{}",
                "one to three",
            ),
            (
                "{ dielectric_breakdown: { law: constant } }",
                "{}",
                "`field` is missing",
            ),
            (
                "{ dielectric_breakdown: { law: huang, field: 1 } }",
                "{}",
                "belongs to `law: constant`",
            ),
            ("all", "{}", "allowed: auto"),
            ("{}", "{ density: 1 kPa }", "density"),
            ("{}", "{ colour: red }", "unknown key `colour`"),
        ] {
            let refusal = refusal(effects, properties);
            assert!(refusal.contains(said), "{effects} {properties}: {refusal}");
        }
    }
}
