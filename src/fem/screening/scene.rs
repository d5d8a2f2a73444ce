//! Numbers that follow from the scene alone.

use std::f64::consts::{PI, SQRT_2};

use super::{Row, Verdict, known, length, open};
use crate::pattern::CELLS;
use crate::scene::effects::names;
use crate::scene::laws::AtRest;
use crate::scene::{Effects, On, PermittivityDecay, PermittivityReference, Scene};

/// Relative change of stiffness or force that is worth an effect.
const SMALL: f64 = 0.02;
/// The density of elastomers in kg/m³, near enough for a frequency where none is given.
const USUAL_DENSITY: f64 = 1000.0;

/// The rows of all effects that do not need a solution.
pub fn rows(scene: &Scene) -> Vec<Row> {
    vec![
        stiffening(scene),
        electrode(scene),
        permittivity(scene),
        fringe(scene),
        viscoelasticity(scene),
        inertia(scene),
        resistance(scene),
        does_not_arise(names::CHARGE, "the drive is a voltage"),
        does_not_arise(names::INCLUSION, "the scene has no rigid part"),
    ]
}

/// The effects among the rows that are called for, with the parameters that the scene knows.
pub fn called_for(scene: &Scene, rows: &[Row]) -> Effects {
    let wanted = |name: &str| {
        rows.iter()
            .any(|row| row.effect == name && row.verdict == Verdict::CalledFor)
    };
    let known = &scene.properties;
    Effects {
        strain_stiffening: known.strain_stiffening.clone().filter(|_| wanted(names::STIFFENING)),
        electrode_stiffness: known.electrode_stiffness.clone().filter(|_| wanted(names::ELECTRODE)),
        stretch_dependent_permittivity: known
            .stretch_dependent_permittivity
            .clone()
            .filter(|_| wanted(names::PERMITTIVITY)),
        fringe_field: (wanted(names::FRINGE) && fringe_shift(scene) <= 0.5 * cell(scene)).then_some(On {}),
        ..Effects::default()
    }
}

fn does_not_arise(effect: &'static str, why: &str) -> Row {
    open(effect, "–", Verdict::NotCalledFor, 0.0, why.to_owned())
}

fn stiffening(scene: &Scene) -> Row {
    const THRESHOLD: f64 = 0.05;
    let effect = names::STIFFENING;
    let at = AtRest {
        prestretch: scene.prestretch(),
        shear_modulus_pa: scene.shear_modulus_pa(),
    };
    let law = scene.effects.strain_stiffening.as_ref();
    let Some(law) = law.or(scene.properties.strain_stiffening.as_ref()) else {
        let change = format!("no data: matters if Jm < {:.0}", at.invariant() / THRESHOLD);
        return open(effect, "(I1 − 3)/Jm", Verdict::Unknown, THRESHOLD, change);
    };
    let significance = law.law().significance(&at);
    let change = format!(
        "changes the stress of the prestretched membrane by {:+.0} %",
        100.0 * significance.stress_change
    );
    known(
        effect,
        significance.quantity.to_owned(),
        significance.number,
        THRESHOLD,
        change,
    )
}

fn electrode(scene: &Scene) -> Row {
    let (effect, quantity) = (names::ELECTRODE, "μe He/(μ H)");
    let layer = scene.effects.electrode_stiffness.as_ref();
    let membrane = scene.shear_modulus_pa() * scene.thickness_mm();
    match layer.or(scene.properties.electrode_stiffness.as_ref()) {
        None => {
            // Pa·mm are mN/m.
            let change = format!("no data: matters if μe He > {:.3} N/m", 1e-3 * SMALL * membrane);
            open(effect, quantity, Verdict::Unknown, SMALL, change)
        }
        Some(layer) => {
            let ratio = layer.shear_modulus.value() * layer.thickness.value() / membrane;
            let change = format!("makes the active membrane {:.1} % stiffer", 100.0 * ratio);
            known(effect, quantity.to_owned(), ratio, SMALL, change)
        }
    }
}

fn permittivity(scene: &Scene) -> Row {
    let effect = names::PERMITTIVITY;
    let decay = scene.effects.stretch_dependent_permittivity.as_ref();
    match decay.or(scene.properties.stretch_dependent_permittivity.as_ref()) {
        None => {
            let change = format!("no data: matters if s > {}", 2.0 * SMALL);
            open(effect, "s/2", Verdict::Unknown, SMALL, change)
        }
        Some(decay) => {
            let factor = force_factor(decay, scene.prestretch());
            let quantity = match decay.reference {
                PermittivityReference::Prestretched => "s/2",
                PermittivityReference::Undeformed => "|1 − (1 − s/2) λp^(−2s)|",
            };
            let change = format!("changes the electric stress by {:+.1} %", 100.0 * (factor - 1.0));
            known(effect, quantity.to_owned(), (factor - 1.0).abs(), SMALL, change)
        }
    }
}

/// The electric stress at rest, over that at a constant permittivity.
fn force_factor(decay: &PermittivityDecay, prestretch: f64) -> f64 {
    let s = decay.exponent.to_f64();
    let measured = match decay.reference {
        PermittivityReference::Prestretched => 1.0,
        PermittivityReference::Undeformed => prestretch.powf(-2.0 * s),
    };
    (1.0 - 0.5 * s) * measured
}

/// Thickness of the prestretched membrane, mm.
fn thickness(scene: &Scene) -> f64 {
    scene.thickness_mm() / scene.prestretch().powi(2)
}

/// Side of a cell, mm.
fn cell(scene: &Scene) -> f64 {
    scene.side_mm() / CELLS as f64
}

/// How far the field bulges out at an edge, mm.
fn fringe_shift(scene: &Scene) -> f64 {
    std::f64::consts::LN_2 / PI * thickness(scene)
}

fn fringe(scene: &Scene) -> Row {
    let (shift, cell) = (fringe_shift(scene), cell(scene));
    let change = if shift > 0.5 * cell {
        "is beyond membrane theory: the membrane is thicker than cells are wide".to_owned()
    } else {
        format!("lets electrodes act {} beyond their edges", length(shift))
    };
    known(
        names::FRINGE,
        "h/cell".to_owned(),
        thickness(scene) / cell,
        0.05,
        change,
    )
}

/// The time over which the drive changes, s.
fn time(scene: &Scene) -> Option<f64> {
    let drive = &scene.drive;
    let duration = drive.duration.as_ref().map(|t| t.value());
    duration.or_else(|| drive.frequency.as_ref().map(|f| 1.0 / (2.0 * PI * f.value())))
}

/// The frequency of the drive in Hz, or that of which its duration is the time.
fn frequency(scene: &Scene) -> Option<f64> {
    let drive = &scene.drive;
    let frequency = drive.frequency.as_ref().map(|f| f.value());
    frequency.or_else(|| drive.duration.as_ref().map(|t| 1.0 / (2.0 * PI * t.value())))
}

fn viscoelasticity(scene: &Scene) -> Row {
    let (effect, quantity) = (names::VISCOELASTICITY, "4G/(μ λp²), t/τ in 0.01 … 100");
    let Some(time) = time(scene) else {
        return open(
            effect,
            quantity,
            Verdict::NotCalledFor,
            SMALL,
            "the drive has no time".to_owned(),
        );
    };
    let branches = scene.properties.viscoelasticity.as_deref().unwrap_or_default();
    if branches.is_empty() {
        return open(effect, quantity, Verdict::Unknown, SMALL, "no data".to_owned());
    }
    let stiffness = scene.shear_modulus_pa() * scene.prestretch().powi(2);
    let active = branches
        .iter()
        .filter(|branch| (0.01..=100.0).contains(&(time / branch.time.value())));
    let sum = |modulus: f64| 4.0 * modulus / stiffness;
    let number: f64 = active.map(|branch| sum(branch.modulus.value())).sum();
    let frozen: f64 = branches
        .iter()
        .filter(|branch| time / branch.time.value() < 0.01)
        .map(|branch| branch.modulus.value())
        .sum();
    let mut change = "lets the displacement creep over the time of the drive".to_owned();
    if frozen > 0.0 {
        change = format!(
            "has branches of {:.0} % of μ that are too slow to relax: is `shear_modulus` that of the drive?",
            100.0 * frozen / scene.shear_modulus_pa()
        );
    } else if number == 0.0 {
        change = "has relaxed in all branches".to_owned();
    }
    known(effect, quantity.to_owned(), number + 0.0, SMALL, change)
}

fn inertia(scene: &Scene) -> Row {
    const THRESHOLD: f64 = 0.1;
    let effect = names::INERTIA;
    let Some(frequency) = frequency(scene) else {
        return open(
            effect,
            "f/f1",
            Verdict::NotCalledFor,
            THRESHOLD,
            "the drive is static".to_owned(),
        );
    };
    let density = scene.properties.density.as_ref().map_or(USUAL_DENSITY, |d| d.value());
    // f₁₁ = (λp/2L) √(μ/ρ) √2, in the limit of large prestretch.
    let speed = (scene.shear_modulus_pa() / density).sqrt();
    let first = scene.prestretch() / (2e-3 * scene.side_mm()) * speed * SQRT_2;
    let change = format!("grows towards the first mode, at {first:.0} Hz");
    known(effect, "f/f1".to_owned(), frequency / first, THRESHOLD, change)
}

fn resistance(scene: &Scene) -> Row {
    let effect = names::RESISTANCE;
    let Some(frequency) = frequency(scene) else {
        return open(
            effect,
            "2πf R c L²",
            Verdict::NotCalledFor,
            0.1,
            "the drive is static".to_owned(),
        );
    };
    match &scene.properties.sheet_resistance {
        None => {
            let change = "delays the voltage by a time that needs `sheet_resistance`: judged by 1 kHz".to_owned();
            known(effect, "f/(1 kHz)".to_owned(), frequency / 1e3, 1.0, change)
        }
        Some(resistance) => {
            let capacitance = scene.permittivity() / (1e-3 * thickness(scene));
            let time = resistance.value() * capacitance * (1e-3 * scene.side_mm()).powi(2);
            let change = format!("delays the voltage at the far end by {time:.1e} s");
            known(
                effect,
                "2πf R c L²".to_owned(),
                2.0 * PI * frequency * time,
                0.1,
                change,
            )
        }
    }
}
