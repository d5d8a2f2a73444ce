use std::path::Path;

use super::*;
use crate::laws::Yeoh;
use deaflow_base::{Document, InputError};

#[test]
fn kappa_of_the_default_scene_is_the_published_value() {
    // 4.7 · 8.8541878128e-12 · (5250 / 1e-3)² / 45000
    assert!((Scene::vhb4910().kappa() - 0.025_489).abs() < 1e-6);
}

#[test]
fn a_scene_survives_its_own_text() {
    let scene = Scene::vhb4910().at_voltage(4999.5);
    assert_eq!(Scene::from_text(&scene.to_text()).unwrap(), scene);
    let rich = "{ geometry: { side: 50, thickness: 1, prestretch: 3, cells: 50 }, material: { model: neo-hookean, \
                shear_modulus: 45 kPa, relative_permittivity: 4.7 }, drive: { voltage: 5 kV, frequency: 2 Hz }, \
                effects: { strain_stiffening: { model: ogden, terms: [ { mu: 45 kPa, alpha: 2 } ] }, wrinkling: {}, \
                dielectric_breakdown: { law: constant, field: 90 MV/m } }, properties: { density: 960, \
                electrode_stiffness: { shear_modulus: 1 MPa, thickness: 2 um }, \
                viscoelasticity: [ { modulus: 20 kPa, time: 30 s } ] } }";
    let scene = Scene::from_text(rich).unwrap();
    assert_eq!(Scene::from_text(&scene.to_text()).unwrap(), scene);
    assert_eq!(
        Scene::from_text(&scene.to_text()).unwrap().canonical(),
        scene.canonical()
    );
}

#[test]
fn equal_geometries_have_one_canonical_form() {
    let of = |geometry: &str| {
        Scene::from_text(&format!(
            "{{ geometry: {geometry}, material: {{ model: neo-hookean, shear_modulus: 45 kPa, \
             relative_permittivity: 4.7 }}, drive: {{ voltage: 5.25 kV }} }}"
        ))
    };
    let square = of("{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }").unwrap();
    assert_eq!(square, Scene::vhb4910());
    for other in [
        "{ size: [50 mm, 5 cm], thickness: 1 mm, prestretch: 3, cells: 50 }",
        "{ side: 50 mm, thickness: 1 mm, prestretch: [3, 3.0], cells: [50, 50] }",
    ] {
        let other = of(other).unwrap();
        assert_eq!((other.canonical(), &other), (square.canonical(), &square));
    }
    let device = of("{ size: [60 mm, 30 mm], thickness: 1 mm, prestretch: [3, 4], cells: [120, 40] }").unwrap();
    assert_eq!(Scene::from_text(&device.to_text()).unwrap(), device);
    let membrane = device.membrane();
    assert_eq!((membrane.raster.sides(), membrane.size_mm), ([120, 40], [60.0, 30.0]));
    assert_eq!((membrane.cell_mm(), device.prestretch()), ([0.5, 0.75], [3.0, 4.0]));
    assert!((device.mean_prestretch() - 12f64.sqrt()).abs() < 1e-15);
    for (wrong, says) in [
        ("{ thickness: 1 mm, prestretch: 3, cells: 50 }", "side"),
        (
            "{ side: 5 mm, size: [5 mm, 5 mm], thickness: 1 mm, prestretch: 3, cells: 50 }",
            "cannot be given together",
        ),
        (
            "{ side: 5 mm, thickness: 1 mm, prestretch: [3], cells: 50 }",
            "two values",
        ),
        (
            "{ side: 5 mm, thickness: 1 mm, prestretch: [3, 11], cells: 50 }",
            "prestretch",
        ),
        ("{ side: 5 mm, thickness: 1 mm, prestretch: 3, cells: 0 }", "cells"),
        (
            "{ side: 5 mm, thickness: 1 mm, prestretch: 3, cells: [50, 401] }",
            "cells",
        ),
    ] {
        let refused = of(wrong).unwrap_err().to_string();
        assert!(refused.contains(says), "{wrong}: {refused}");
    }
}

#[test]
fn bodies_with_three_numbers_move_in_space() {
    let with = |body: &str, rest: &str| {
        Scene::from_text(&format!(
            "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50, bodies: [{{ disc: {{ centre: [25 \
             mm, 25 mm], radius: 5 mm }}{body} }}] }}, material: {{ model: neo-hookean, shear_modulus: 45 kPa, \
             relative_permittivity: 4.7 }}, drive: {{ voltage: 5.25 kV }}{rest} }}"
        ))
    };
    let of = |body: &str| with(body, "").unwrap();
    for (body, load, lift, springs, is_in_space) in [
        ("", [0.0; 2], 0.0, [0.0; 3], false),
        (", load: [1 N, 2 N], spring: 3 N/m", [1.0, 2.0], 0.0, [3.0; 3], false),
        (", spring: [3 N/m, 4 N/m]", [0.0; 2], 0.0, [3.0, 4.0, 0.0], false),
        (", load: [1 N, 2 N, 0 N]", [1.0, 2.0], 0.0, [0.0; 3], true),
        (", load: [0 N, 2 N, -3 N]", [0.0, 2.0], -3.0, [0.0; 3], true),
        (
            ", spring: [0 N/m, 0 N/m, 40 N/m]",
            [0.0; 2],
            0.0,
            [0.0, 0.0, 40.0],
            true,
        ),
    ] {
        let scene = of(body);
        assert_eq!(Scene::from_text(&scene.to_text()).unwrap(), scene);
        let one = &scene.geometry.bodies.as_ref().unwrap()[0];
        assert_eq!(
            (one.load_n(), one.lift_n(), one.springs_n_per_m()),
            (load, lift, springs)
        );
        assert_eq!(scene.is_in_space(), is_in_space, "{body}");
        let flat = scene.in_plane();
        assert!(!flat.is_in_space() && (flat == scene) != is_in_space);
        assert_eq!(flat.geometry.bodies.unwrap()[0].load_n(), load);
    }
    // What is written by default is the same scene.
    assert_eq!(of(", tilt: false").canonical(), of("").canonical());
    assert!(with("", ", loads: { pressure: 1 Pa }").unwrap().is_in_space());
    for (body, says) in [
        (", load: [1 N]", "two or three values"),
        (", load: [1 N, 1 N, 1 N, 1 N]", "two or three values"),
        (", spring: [1 N/m, -1 N/m]", "out of range"),
        (", tilt: true", "tilt"),
    ] {
        let refused = with(body, "").unwrap_err().to_string();
        assert!(refused.contains(says), "{body}: {refused}");
    }
}

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
         thickness: 5 um }, stretch_dependent_permittivity: { exponent: 0.1, reference: undeformed }, \
         fringe_field: {}, wrinkling: true, dielectric_breakdown: { law: huang }, electromechanical_stability: }",
        "{}",
    );
    let effects = scene.unwrap().effects;
    let Some(Stiffening::Yeoh(Yeoh { c2, c3 })) = effects.strain_stiffening else {
        panic!("a Yeoh model");
    };
    assert_eq!((c2.value(), c3.value()), (-1e3, 20.0));
    assert_eq!(effects.electrode_stiffness.unwrap().thickness.value(), 0.005);
    let permittivity = effects.stretch_dependent_permittivity.unwrap();
    assert_eq!(permittivity.reference, PermittivityReference::Undeformed);
    assert!(
        effects.fringe_field.is_some() && effects.wrinkling.is_some() && effects.electromechanical_stability.is_some()
    );
    assert_eq!(effects.dielectric_breakdown, Some(Breakdown::Huang(HuangStrength {})));
    assert!(read("{}", "{}").unwrap().effects.is_empty());
    assert!(read("{ wrinkling: false }", "{}").unwrap().effects.is_empty());
    assert!(read("auto", "{}").unwrap().auto);
}

#[test]
fn an_effect_takes_its_parameters_from_the_properties() {
    let gent = "{ strain_stiffening: { model: gent, jm: 125 } }";
    let named = read("{ strain_stiffening: {} }", gent).unwrap();
    assert_eq!(named.effects, read(gent, "{}").unwrap().effects);
    assert!(read("{}", gent).unwrap().effects.is_empty());
}

#[test]
fn errors_list_what_is_allowed() {
    for (effects, properties, said) in [
        (
            "{ electrode_resistance: {} }",
            "{}",
            "`electrode_resistance` has no `sheet_resistance`",
        ),
        (
            "{ electrode_resistance: {} }",
            "{ sheet_resistance: 50 kOhm }",
            "`electrode_resistance` needs `leads`",
        ),
        (
            "{ rigid_inclusion: {} }",
            "{}",
            "the `bodies` of the geometry are rigid",
        ),
        ("{ charge_control: {} }", "{}", "the drive is a voltage"),
        ("{ inertia: {} }", "{}", "`inertia` has no `density`"),
        ("{ inertia: { mass: 1 } }", "{ density: 960 }", "unknown key `mass`"),
        (
            "{ viscoelasticity: {} }",
            "{}",
            "give them here or in `properties.viscoelasticity`",
        ),
        ("{ viscoelasticity: { branches: [] } }", "{}", "`branches` is empty"),
        (
            "{ viscoelasticity: { law: quadratic, branches: [{ modulus: 1 Pa, time: 1 s }] } }",
            "{}",
            "allowed: linear, finite",
        ),
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
            "allowed: 1 to 3",
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

#[test]
fn equal_voltages_and_states_have_one_canonical_form() {
    let of = |drives: &str| {
        Scene::from_text(&format!(
            "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }}, material: {{ \
             model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, {drives} }}"
        ))
    };
    assert_eq!(of("drive: { voltages: [5.25 kV] }").unwrap(), Scene::vhb4910());
    let two = of("drive: { voltages: [3 kV, 6 kV], duration: 1 s }").unwrap();
    assert_eq!(Scene::from_text(&two.to_text()).unwrap(), two);
    assert_eq!((two.groups(), two.voltage_v(), two.strongest_group()), (2, 6e3, 2));
    assert_eq!(two.group_loads(), [0.25, 1.0]);
    assert_eq!(two.at_voltage(4e3).drive.voltages.in_volts(), [2e3, 4e3]);
    let none = of("drive: { voltages: [0 V, 0 V] }").unwrap();
    assert_eq!(none.at_voltage(4e3).drive.voltages.in_volts(), [4e3, 4e3]);
    assert_eq!(none.group_loads(), [1.0, 1.0]);
    let states = "states: { push: { voltages: [5 kV, 0 V] }, pull: { voltages: [1 kV, 4 kV] } }";
    let several = of(states).unwrap();
    assert_eq!(Scene::from_text(&several.to_text()).unwrap(), several);
    let yaml = several.to_yaml();
    assert!(!yaml.contains("drive"), "{yaml}");
    assert_eq!(Scene::from_text(&yaml).unwrap(), several);
    // A drive that is not that of the first state stays.
    let own = of(&format!("drive: {{ voltages: [5 kV, 0 V] }}, {states}")).unwrap();
    assert_eq!(Scene::from_text(&own.to_yaml()).unwrap(), own);
    let names: Vec<String> = several
        .in_states()
        .into_iter()
        .map(|(name, _)| name.to_owned())
        .collect();
    assert_eq!(names, ["pull", "push"]);
    assert_eq!(several.in_states()[0].1.drive.voltages.in_volts(), [1e3, 4e3]);
    assert_eq!(several.at_largest_voltages().drive.voltages.in_volts(), [5e3, 4e3]);
    // Without a drive the first by name is the drive, in whatever order they stand there.
    let turned = "states: { pull: { voltages: [1 kV, 4 kV] }, push: { voltages: [5 kV, 0 V] } }";
    assert_eq!(several, of(turned).unwrap());
    assert_eq!(
        several,
        of(&format!("drive: {{ voltages: [1 kV, 4 kV] }}, {states}")).unwrap()
    );
    assert_ne!(
        several,
        of(&format!("drive: {{ voltages: [5 kV, 0 V] }}, {states}")).unwrap()
    );
    for (wrong, says) in [
        ("drive: {}", "voltage"),
        ("drive: { voltage: 5 kV, voltages: [5 kV, 3 kV] }", "has 2"),
        ("drive: { voltages: [] }", "voltages"),
        ("drive: { voltages: [5 kV, -1 V] }", "voltages"),
        ("drive: { voltage: 5 kV }, states: {}", "has 0 states"),
        ("states: {}", "no state"),
        (
            "drive: { voltage: 5 kV }, states: { a: { voltages: [1 kV, 2 kV] } }",
            "state `a` has voltages of 2",
        ),
        (
            "drive: { voltage: 5 kV }, states: { a b: { voltage: 1 kV } }",
            "not a valid name of a state",
        ),
        ("drive: { voltage: 5 kV }, states: { a: { volt: 1 kV } }", "volt"),
    ] {
        let error = of(wrong).unwrap_err();
        assert!(format!("{error:?} {error}").contains(says), "{wrong}: {error:?}");
    }
}

fn with_opening(shape: &str) -> Result<Scene, InputError> {
    Scene::from_text(&format!(
        "{{ geometry: {{ side: 20 mm, thickness: 1 mm, prestretch: 3, cells: 40, frame: {{ opening: {shape} }} }}, \
         material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, \
         drive: {{ voltage: 5 kV }} }}"
    ))
}

#[test]
fn shapes_have_their_areas_and_survive_their_text() {
    let pi = std::f64::consts::PI;
    for (shape, exact) in [
        (
            "{ ellipse: { centre: [10 mm, 10 mm], semiaxes: [8 mm, 4 mm], angle: 30 deg } }",
            32.0 * pi,
        ),
        ("{ ring: { centre: [10 mm, 1 cm], radii: [3 mm, 9 mm] } }", 72.0 * pi),
        ("{ ring: { centre: [10 mm, 1 cm], radii: [8 mm, 10 mm] } }", 36.0 * pi),
        (
            "{ rectangle: { corners: [[4 mm, 7 mm], [16 mm, 13 mm]], angle: -20 deg } }",
            72.0,
        ),
        (
            "{ rectangle: { corners: [[4 mm, 7 mm], [16 mm, 13 mm]], angle: 45 deg, corner: 3 mm } }",
            36.0 + 9.0 * pi,
        ),
        (
            "{ path: { from: [5 mm, 7 mm], to: [{ line: [15 mm, 7 mm] }, { arc: [[18 mm, 10 mm], [15 mm, 13 mm]] }, \
             { line: [5 mm, 13 mm] }, { arc: [[2 mm, 10 mm], [5 mm, 7 mm]] }] } }",
            60.0 + 9.0 * pi,
        ),
        (
            "{ path: { from: [3 mm, 4 mm], to: [{ cubic: [[6 mm, 16 mm], [12 mm, 16 mm], [15 mm, 4 mm]] }] } }",
            75.6,
        ),
        (
            "{ union: [{ disc: { centre: [6 mm, 10 mm], radius: 4 mm } }, { rectangle: [[11 mm, 6 mm], [15 mm, 14 mm]] }] }",
            16.0 * pi + 32.0,
        ),
        (
            "{ intersect: [{ disc: { centre: [10 mm, 10 mm], radius: 8 mm } }, { rectangle: [[0 mm, 0 mm], [20 mm, 10 mm]] }] }",
            32.0 * pi,
        ),
        (
            "{ disc: { centre: [10 mm, 10 mm], radius: 8 mm }, without: [{ union: [{ rectangle: [[9 mm, 0 mm], [11 mm, 10 mm]] }, \
             { disc: { centre: [10 mm, 10 mm], radius: 2 mm } }] }] }",
            64.0 * pi - 2.0 * pi - 16.0,
        ),
    ] {
        let scene = with_opening(shape).unwrap();
        let area = scene.geometry.parts().unwrap().free_cells().count() as f64 * 0.25;
        assert!((area / exact - 1.0).abs() < 0.025, "{shape}: {area} {exact}");
        assert_eq!(Scene::from_text(&scene.to_text()).unwrap(), scene, "{shape}");
    }
}

#[test]
fn equal_shapes_have_one_canonical_form() {
    let plain = with_opening("{ rectangle: [[4 mm, 7 mm], [16 mm, 13 mm]] }").unwrap();
    let other = "{ rectangle: { corners: [[4 mm, 7 mm], [1.6 cm, 13 mm]], angle: 0 deg, corner: 0 mm } }";
    assert_eq!(with_opening(other).unwrap().canonical(), plain.canonical());
}

#[test]
fn wrong_shapes_are_refused_at_their_place() {
    for (shape, says) in [
        (
            "{ ring: { centre: [10 mm, 10 mm], radii: [5 mm, 5 mm] } }",
            "the inner radius 5 mm is not smaller",
        ),
        (
            "{ rectangle: { corners: [[4 mm, 7 mm], [16 mm, 13 mm]], corner: 3.5 mm } }",
            "more than half of the shorter side",
        ),
        (
            "{ path: { from: [5 mm, 5 mm], to: [{ arc: [[6 mm, 6 mm], [9 mm, 9 mm]] }] } }",
            "lie on a line",
        ),
        (
            "{ path: { from: [5 mm, 5 mm], to: [{ line: [6 mm, 6 mm], arc: [[6 mm, 6 mm], [9 mm, 3 mm]] }] } }",
            "must have one of `line`, `arc` and `cubic`",
        ),
        (
            "{ without: [{ disc: { centre: [10 mm, 10 mm], radius: 2 mm } }] }",
            "a shape must have one of",
        ),
        (
            "{ disc: { centre: [10 mm, 10 mm], radius: 2 mm }, ellipse: { centre: [10 mm, 10 mm], semiaxes: [2 mm, 3 mm] } }",
            "a shape must have one of",
        ),
        ("{ union: [] }", "`union` is empty"),
        ("{ union: [{ disk: 3 }] }", "disk"),
        (
            "{ union: [{ mask: { columns: 2, rows: 1, runs: [1, 1] } }] }",
            "the mask has 2 × 1 cells, but the membrane has 40 × 40",
        ),
    ] {
        let error = with_opening(shape).unwrap_err().to_string();
        assert!(error.contains(says), "{shape}: {error}");
    }
}
