//! Predictions of screening against solutions on sixteen times as many elements, for random scenes and patterns.

use std::fmt::Write;

use super::*;
use crate::effects::Effect;
use crate::screening::Displacement;
use deaflow_base::Stream;
use deaflow_field::Simulator;
use deaflow_scene::laws::{ArrudaBoyce, MooneyRivlin};

/// The effects and laws of the random scenes.
const DRAWN: [(&str, &str); 9] = [
    (names::STIFFENING, "gent"),
    (names::STIFFENING, "yeoh"),
    (names::STIFFENING, "ogden"),
    (names::STIFFENING, "arruda-boyce"),
    (names::STIFFENING, "mooney-rivlin"),
    (names::ELECTRODE, ""),
    (names::PERMITTIVITY, ""),
    (names::FRINGE, ""),
    (names::WRINKLING, ""),
];
/// The reference mesh.
const FINE: Mesh = Mesh::biquadratic(4);

/// Rounds to five digits.
fn number(value: f64) -> Decimal {
    format!("{value:.4e}").parse().unwrap()
}

fn pattern(stream: &mut Stream) -> (&'static str, Pattern) {
    let (cx, cy, r) = (
        stream.range(15.0, 35.0),
        stream.range(15.0, 35.0),
        stream.range(4.0, 14.0),
    );
    let distance = move |x: usize, y: usize| (x as f64 + 0.5 - cx).hypot(y as f64 + 0.5 - cy);
    let (width, level) = (2 + stream.index(12), stream.range(0.2, 0.8));
    let bits: Vec<bool> = (0..2500).map(|_| stream.chance(level)).collect();
    match stream.index(7) {
        0 => ("half", Pattern::from_fn(Raster::PAPER, |x, _| (x as f64) < cx)),
        1 => ("disc", Pattern::from_fn(Raster::PAPER, |x, y| distance(x, y) < r)),
        2 => (
            "ring",
            Pattern::from_fn(Raster::PAPER, |x, y| (0.6 * r..r).contains(&distance(x, y))),
        ),
        3 => ("stripes", Pattern::from_fn(Raster::PAPER, |x, _| (x / width) % 2 == 0)),
        4 => (
            "blocks",
            Pattern::from_fn(Raster::PAPER, |x, y| (x / width + y / width) % 2 == 0),
        ),
        5 => ("dither", Pattern::from_fn(Raster::PAPER, |x, y| bits[50 * y + x])),
        _ => (
            "one cell",
            Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (cx as usize, cy as usize)),
        ),
    }
}

fn stiffening(law: &str, scene: &Scene, stream: &mut Stream) -> Stiffening {
    let prestretch = scene.mean_prestretch();
    let invariant = 2.0 * prestretch.powi(2) + prestretch.powi(-4) - 3.0;
    let modulus = scene.shear_modulus_pa();
    match law {
        "gent" => Stiffening::Gent(Gent {
            jm: number((invariant + 0.3) * stream.range(1.4, 60.0)),
        }),
        "yeoh" => yeoh(
            (modulus / (invariant + 0.5) * stream.range(-0.2, 0.3)).round(),
            (modulus / (invariant + 0.5).powi(2) * stream.range(0.0, 0.2)).round(),
        ),
        "ogden" => {
            let share = stream.range(0.2, 0.9);
            let [one, other] = [stream.range(1.2, 5.0), stream.range(0.6, 1.9)].map(number);
            let mu = |share: f64, alpha: Decimal| Stress::from_f64(2.0 * modulus * share / alpha.to_f64()).unwrap();
            Stiffening::Ogden(Ogden {
                terms: [(share, one), (1.0 - share, other)]
                    .map(|(share, alpha)| OgdenTerm {
                        mu: mu(share, alpha),
                        alpha,
                    })
                    .to_vec(),
            })
        }
        "arruda-boyce" => Stiffening::ArrudaBoyce(ArrudaBoyce {
            locking_stretch: number(((invariant + 3.0) / 3.0).sqrt() * stream.range(1.15, 5.0)),
        }),
        _ => Stiffening::MooneyRivlin(MooneyRivlin {
            c2: Stress::from_f64((modulus * stream.range(-0.01, 0.1)).round()).unwrap(),
        }),
    }
}

/// A scene without effects but with the data of one.
fn scene(effect: &str, law: &str, stream: &mut Stream) -> Scene {
    let low = effect == names::WRINKLING;
    let prestretch = if low {
        stream.range(1.02, 1.3)
    } else {
        stream.range(1.1, 4.0)
    };
    let prestretch = number(prestretch).to_f64();
    let side = number(stream.range(20.0, 100.0)).to_f64();
    // The fringe reaches 0.2206 of the thickness of the prestretched membrane.
    let thickness = match effect == names::FRINGE {
        true => side / 50.0 * prestretch.powi(2) * stream.range(0.02, 1.5),
        false => stream.range(0.05, 1.0),
    };
    let thickness = number(thickness).to_f64();
    let modulus = number(stream.range(20e3, 600e3)).to_f64();
    // Up to just below the loss of stability of a uniform active membrane; patterns lose it earlier.
    let field = stream.range(0.1, 0.6) * (prestretch.powi(-2) + 3.0 * prestretch.powi(-8)).sqrt();
    let permittivity = 4.7;
    let voltage = 1e-3 * thickness * field * (modulus / (permittivity * 8.854_187_812_8e-12)).sqrt();
    let voltage = number(voltage).to_f64();
    let mut scene = Scene::with_values(side, thickness, prestretch, modulus, permittivity, voltage);
    scene.properties.strain_stiffening = (effect == names::STIFFENING).then(|| stiffening(law, &scene, stream));
    scene.properties.electrode_stiffness = Some(Electrode {
        shear_modulus: Stress::literal("1 MPa"),
        thickness: Length::from_f64(1e-6 * modulus * thickness * 10f64.powf(stream.range(-3.0, 0.0))).unwrap(),
    });
    scene.properties.stretch_dependent_permittivity = Some(PermittivityDecay {
        exponent: number(stream.range(0.01, 0.4)),
        reference: match stream.chance(0.5) {
            true => PermittivityReference::Prestretched,
            false => PermittivityReference::Undeformed,
        },
    });
    scene
}

/// Returns the influence of an effect on the fine mesh; `None` if a solution is unstable.
fn actual(effect: &dyn Effect, scene: &Scene, pattern: &Pattern) -> Option<Displacement> {
    let mut effects = Effects::default();
    effect.turn_on(&mut effects, scene);
    let [without, with] = [scene.clone(), scene.with_effects(effects)].map(|scene| {
        let solver = MembraneSolver::new(&scene, SolveOptions::on(FINE)).unwrap();
        solver.simulate(std::slice::from_ref(pattern)).remove(0).field
    });
    Some(Displacement::between(&without?, &with?, scene.voltage_v()))
}

/// Returns whether both differences agree within a factor of 1.5 or half a per cent of displacement.
fn agree(predicted: f64, actual: f64) -> bool {
    let ratio = predicted / actual.max(1e-12);
    (predicted - actual).abs() <= 0.005 || (1.0 / 1.5..=1.5).contains(&ratio)
}

struct Drawn {
    pattern: &'static str,
    predicted: Displacement,
    actual: Displacement,
}

/// Draws scenes until `count` of them are stable on both meshes.
fn draw(effect_name: &str, law: &str, count: usize) -> Vec<Drawn> {
    let effect = *EFFECTS.iter().find(|effect| effect.name() == effect_name).unwrap();
    let mut found = Vec::new();
    for index in 0.. {
        let mut stream = Stream::new(5, &format!("screening {effect_name} {law}"), index);
        let scene = scene(effect_name, law, &mut stream);
        let (name, pattern) = pattern(&mut stream);
        let trial = TestPattern {
            find_critical_voltage: false,
            ..TestPattern::new(name, pattern.clone())
        };
        let screening = screen_for(&[effect], &scene, &[trial]).unwrap();
        let comparison = screening.rows[0].comparisons.first();
        let predicted = comparison.and_then(|one| one.displacement);
        let Some(predicted) = predicted.filter(|p| p.voltage == scene.voltage_v()) else {
            continue;
        };
        // Most scenes without wrinkles are skipped.
        if effect_name == names::WRINKLING && predicted.difference == 0.0 && index % 4 > 0 {
            continue;
        }
        if let Some(actual) = actual(effect, &scene, &pattern) {
            found.push(Drawn {
                pattern: name,
                predicted,
                actual,
            });
        }
        if found.len() == count {
            return found;
        }
    }
    found
}

fn report(count: usize) -> (String, usize) {
    let mut text = String::from(
        "| effect | law | pattern | predicted max \\|Δu\\| % | actual | predicted change of max \\|u\\| % | actual \
         |\n|---|---|---|---|---|---|---|\n",
    );
    let mut failed = 0;
    for (effect, law) in DRAWN {
        let drawn = draw(effect, law, count);
        let missed = |d: &&Drawn| {
            !agree(d.predicted.difference, d.actual.difference)
                || !agree(d.predicted.change.abs(), d.actual.change.abs())
        };
        for d in &drawn {
            let values = [
                d.predicted.difference,
                d.actual.difference,
                d.predicted.change,
                d.actual.change,
            ]
            .map(|share| format!("{:.2}", 100.0 * share));
            let mark = if missed(&d) { " ✗" } else { "" };
            writeln!(
                text,
                "| {effect} | {law} | {}{mark} | {} |",
                d.pattern,
                values.join(" | ")
            )
            .unwrap();
        }
        failed += drawn.iter().filter(missed).count();
    }
    (text, failed)
}

#[test]
fn predictions_agree_with_a_fine_mesh() {
    let (text, failed) = report(3);
    assert_eq!(failed, 0, "\n{text}");
}

/// `cargo test --lib -- --ignored --nocapture predictions_agree_in_thirty_scenes` prints the data of docs/effects.md.
#[test]
#[ignore = "takes minutes"]
fn predictions_agree_in_thirty_scenes_of_each_effect() {
    let (text, failed) = report(30);
    println!("{text}");
    assert_eq!(failed, 0, "\n{text}");
}
