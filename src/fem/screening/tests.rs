//! Scenes whose answers a mechanician would know.

use super::*;
use crate::base::{Decimal, Declared, Density, ElectricField, Frequency, Length, Parameter, Resistance, Stress, Time};
use crate::scene::effects::names;
use crate::scene::laws::Gent;
use crate::scene::{
    Branch, Breakdown, ConstantStrength, Electrode, PermittivityDecay, PermittivityReference, Stiffening,
};

fn decimal(text: &str) -> Decimal {
    text.parse().unwrap()
}

fn row(scene: &Scene, name: &str) -> Row {
    let screening = screen_by_references(scene).unwrap();
    screening.rows.into_iter().find(|row| row.effect == name).unwrap()
}

fn gent(jm: &str) -> Stiffening {
    Stiffening::Gent(Gent { jm: decimal(jm) })
}

#[test]
fn numbers_of_the_scene_are_the_closed_forms() {
    let mut scene = Scene::vhb4910();
    scene.properties.strain_stiffening = Some(gent("125"));
    scene.properties.electrode_stiffness = Some(Electrode {
        shear_modulus: Stress::literal("0.5 MPa"),
        thickness: Length::literal("3 um"),
    });
    scene.properties.stretch_dependent_permittivity = Some(PermittivityDecay {
        exponent: decimal("0.1"),
        reference: PermittivityReference::Undeformed,
    });
    scene.drive.frequency = Some(Frequency::literal("100 Hz"));
    scene.properties.density = Some(Density::literal("960"));
    scene.properties.sheet_resistance = Some(Resistance::literal("50 kOhm"));
    scene.properties.viscoelasticity = Some(vec![
        Branch {
            modulus: Stress::literal("30 kPa"),
            time: Time::literal("0.01 s"),
        },
        // Far slower than the drive: frozen into the prestretch.
        Branch {
            modulus: Stress::literal("30 kPa"),
            time: Time::literal("500 s"),
        },
    ]);
    let screening = screen_by_references(&scene).unwrap();
    // I₁ − 3 = 2·9 + 1/81 − 3; χ = 0.5e6 · 3e-3 / 45e3; 1 − 0.95 · 3^(−0.2); h/cell = (1/9)/1;
    // 4 · 30e3 / (45e3 · 9); f₁ = 216.506 Hz · √(45/25); 2π 100 · 50e3 · ε 9/1e-3 · 0.05².
    let permittivity = 4.7 * 8.854_187_812_8e-12;
    let expected = [
        (names::STIFFENING, (15.0 + 1.0 / 81.0) / 125.0),
        (names::ELECTRODE, 1.0 / 30.0),
        (names::PERMITTIVITY, 1.0 - 0.95 * 3.0_f64.powf(-0.2)),
        (names::FRINGE, 1.0 / 9.0),
        (names::VISCOELASTICITY, 0.296_296_296_296),
        (names::INERTIA, 100.0 / (216.506_350_946 * 1.8_f64.sqrt())),
        (
            names::RESISTANCE,
            2.0 * std::f64::consts::PI * 100.0 * 50e3 * permittivity * 9e3 * 0.0025,
        ),
    ];
    for (name, number) in expected {
        let row = screening.rows.iter().find(|row| row.effect == name).unwrap();
        assert!(
            (row.assessment.number.unwrap() / number - 1.0).abs() < 1e-9,
            "{row:?} {number}"
        );
        assert_eq!(
            row.assessment.verdict == Verdict::CalledFor,
            number > row.assessment.threshold,
            "{row:?}"
        );
    }
}

#[test]
fn what_is_not_known_is_not_screened_and_what_does_not_arise_is_not_called_for() {
    let screening = screen_by_references(&Scene::vhb4910()).unwrap();
    let verdict = |name: &str| {
        screening
            .rows
            .iter()
            .find(|row| row.effect == name)
            .unwrap()
            .assessment
            .verdict
    };
    for name in [names::STIFFENING, names::ELECTRODE, names::PERMITTIVITY] {
        assert_eq!(verdict(name), Verdict::Unknown);
    }
    for name in [
        names::VISCOELASTICITY,
        names::INERTIA,
        names::RESISTANCE,
        names::CHARGE,
        names::INCLUSION,
    ] {
        assert_eq!(verdict(name), Verdict::NotCalledFor);
    }
    assert_eq!(screening.rows.len(), Effects::keys().len() + names::PLANNED.len());
}

#[test]
fn wrinkling_is_called_for_where_the_prestretch_cannot_hold_the_membrane_taut() {
    assert_eq!(
        row(&Scene::vhb4910(), names::WRINKLING).assessment.verdict,
        Verdict::NotCalledFor
    );
    // Without prestretch anything that expands presses on something.
    let slack = Scene::with_values(50.0, 1.0, 1.0, 45e3, 4.7, 500.0);
    assert_eq!(row(&slack, names::WRINKLING).assessment.verdict, Verdict::CalledFor);
    // At rest it is free of stress, and not compressed.
    let rest = row(&slack.at_voltage(0.0), names::WRINKLING);
    assert_eq!(
        (rest.assessment.verdict, rest.assessment.number.unwrap().abs() < 1e-12),
        (Verdict::NotCalledFor, true)
    );
}

#[test]
fn the_distance_to_pull_in_grows_with_the_voltage_squared() {
    // The single cell is lost first, at 4.489 kV at 25 kPa on eight elements per cell; two meshes tell to 1.2 %.
    let soft = |voltage| Scene::with_values(50.0, 1.0, 3.0, 25e3, 4.7, voltage);
    let [low, high] = [2e3, 4e3].map(|v| row(&soft(v), names::STABILITY).assessment.number.unwrap());
    assert!((high / low - 4.0).abs() < 1e-9);
    let limit = 2e3 / low.sqrt();
    assert!((limit / 4.489e3 - 1.0).abs() < 1.2e-2, "{limit}");
    // Far from it the number is not searched for.
    let far = row(&soft(1e3), names::STABILITY);
    assert_eq!(
        (far.assessment.number, far.assessment.verdict),
        (None, Verdict::NotCalledFor)
    );
    assert_eq!(
        row(&soft(3e3), names::STABILITY).assessment.verdict,
        Verdict::NotCalledFor
    );
    assert_eq!(row(&soft(4e3), names::STABILITY).assessment.verdict, Verdict::CalledFor);
}

#[test]
fn breakdown_compares_the_true_field() {
    // A fully active membrane at rest: E = V λp²/H = 47.25 MV/m; no pattern lies far above it.
    let mut scene = Scene::vhb4910();
    scene.properties.dielectric_breakdown = Some(Breakdown::Constant(ConstantStrength {
        field: ElectricField::literal("47.25 MV/m"),
    }));
    let number = row(&scene, names::BREAKDOWN).assessment.number.unwrap();
    assert!((1.0..1.6).contains(&number), "{number}");
}

#[test]
fn auto_turns_on_what_is_called_for_and_known() {
    let mut scene = Scene::vhb4910();
    scene.auto = true;
    scene.properties.strain_stiffening = Some(gent("125"));
    scene.properties.electrode_stiffness = Some(Electrode {
        shear_modulus: Stress::literal("1 kPa"),
        thickness: Length::literal("1 um"),
    });
    let screening = screen_by_references(&scene).unwrap();
    let effects = &screening.scene.effects;
    assert_eq!(effects.strain_stiffening, Some(gent("125")));
    assert_eq!(effects.electrode_stiffness, None);
    assert!(effects.fringe_field.is_some() && effects.wrinkling.is_none() && !screening.scene.auto);
    assert_eq!(screening.warnings(), Vec::<String>::new());
    assert_eq!(resolve(&scene).unwrap(), screening.scene);
}

#[test]
fn auto_leaves_a_fringe_alone_that_is_wider_than_theory_bears() {
    let mut scene = Scene::with_values(50.0, 10.0, 1.5, 45e3, 4.7, 100.0);
    scene.auto = true;
    let screening = screen_by_references(&scene).unwrap();
    assert!(screening.scene.effects.fringe_field.is_none());
    assert!(screening.warnings()[0].starts_with("fringe field is neglected"));
}

#[test]
fn an_effect_that_is_called_for_and_off_is_a_warning_with_its_number() {
    let warnings = screen_by_references(&Scene::vhb4910()).unwrap().warnings();
    let expected =
        "fringe field is neglected and lets electrodes act 24.5 µm beyond their edges (h/cell = 0.111 > 0.05)";
    assert_eq!(warnings[0], expected);
}
