//! Membranes with sides that are not held: creep from the released state, and motion with bars.

use std::f64::consts::{PI, TAU};

use super::bodies::{by_steps, open_balance, solver, within};
use super::*;
use deaflow_field::Predictor;

/// ε of the elastomer of these scenes in F/m.
const PERMITTIVITY: f64 = 4.7 * 8.854_187_812_8e-12;

/// The voltage in V at which a thickness of 1 mm has κ.
fn volts(kappa: f64) -> f64 {
    (kappa * 45e3 / PERMITTIVITY).sqrt() * 1e-3
}

fn all(scene: &Scene) -> Pattern {
    Pattern::from_fn(scene.membrane().raster, |_, _| true)
}

/// The equations of a uniform state under a force along x, with a branch of modulus μ and relaxation time 1.
struct Uniform {
    kappa: f64,
    force: f64,
    is_finite: bool,
}

impl Uniform {
    /// The stretches in equilibrium with A, near others.
    fn stretches(&self, [xx, yy, normal]: [f64; 3], [mut x, mut y]: [f64; 2]) -> [f64; 2] {
        for _ in 0..60 {
            let unbalanced = |x: f64, y: f64| {
                let squeezed = (1.0 + normal) / (x * y).powi(3);
                let pulled = self.kappa * x * y;
                let load = [self.force, 0.0];
                [
                    x * (1.0 + xx) - y * (squeezed + pulled) - load[0],
                    y * (1.0 + yy) - x * (squeezed + pulled) - load[1],
                ]
            };
            let [f, g] = unbalanced(x, y);
            let step = 1e-6;
            let ([fx, gx], [fy, gy]) = (unbalanced(x + step, y), unbalanced(x, y + step));
            let [a, b, c, d] = [fx - f, fy - f, gx - g, gy - g].map(|change| change / step);
            let size = a * d - b * c;
            (x, y) = (x - (d * f - b * g) / size, y - (a * g - c * f) / size);
        }
        [x, y]
    }

    /// The rate of A at stretches.
    fn rate(&self, state: [f64; 3], [x, y]: [f64; 2]) -> [f64; 3] {
        let metric = [x.powi(-2), y.powi(-2), (x * y).powi(2)];
        match self.is_finite {
            false => [0, 1, 2].map(|k| metric[k] - state[k]),
            // Ȧ = −A Ḃ A with B = A⁻¹ and Ḃ = C − m B.
            true => {
                let m = (0..3).map(|k| state[k] / metric[k]).sum::<f64>() / 3.0;
                [0, 1, 2].map(|k| m * state[k] - state[k] * state[k] / metric[k])
            }
        }
    }

    /// The stretches at times, from rest without voltage, by Runge and Kutta's method.
    fn at(&self, times: &[f64]) -> Vec<[f64; 2]> {
        let still = Self { kappa: 0.0, ..*self };
        let [x, y] = still.stretches([0.0; 3], [1.4, 0.8]);
        let mut state = [x.powi(-2), y.powi(-2), (x * y).powi(2)];
        let (mut now, mut near) = (0.0, [x, y]);
        let mut found = Vec::new();
        for &time in times {
            let steps = ((time - now) * 200.0_f64).ceil();
            for _ in 0..steps as usize {
                let h = (time - now) / steps;
                let moved = |rate: [f64; 3], by: f64| [0, 1, 2].map(|k| state[k] + by * rate[k]);
                let rate = |state| self.rate(state, self.stretches(state, near));
                let first = rate(state);
                let second = rate(moved(first, 0.5 * h));
                let third = rate(moved(second, 0.5 * h));
                let last = rate(moved(third, h));
                state = moved(
                    [0, 1, 2].map(|k| first[k] + 2.0 * (second[k] + third[k]) + last[k]),
                    h / 6.0,
                );
                near = self.stretches(state, near);
            }
            now = time;
            found.push(self.stretches(state, near));
        }
        found
    }
}

/// A uniform sheet under 0.9 N along x, s = 1, with the size of an undeformed sheet of 30 × 20 mm.
fn under_force(stretch: f64, law: &str, drive: &str) -> Scene {
    let [x, y] = [30.0, 20.0].map(|size| size * stretch);
    scene(&format!(
        "geometry: {{ size: [{x} mm, {y} mm], thickness: 1 mm, prestretch: {stretch}, cells: [3, 2], sides: {{ left: \
         roller, bottom: roller, right: {{ load: [0.9 N, 0 N] }}, top: free }} }}, drive: {{ {drive} }}, {}",
        of_law(law, "{ modulus: 45 kPa, time: 1 s }")
    ))
}

#[test]
fn branches_relax_in_the_released_state_and_creep_from_there() {
    let times = [0.0, 1.0, 10.0];
    let drive = format!("voltage: {} V", volts(0.1));
    for law in LAWS {
        let exact = Uniform {
            kappa: 0.1,
            force: 1.0,
            is_finite: law == "finite",
        };
        let exact = exact.at(&times);
        if law == "linear" {
            for (found, known) in exact.iter().zip([1.4834203576, 1.4906043297, 1.5027636311]) {
                assert!((found[0] - known).abs() < 1e-9, "{found:?} {known}");
            }
        }
        for stretch in [1.0, 1.5, 2.5] {
            let scene = under_force(stretch, law, &drive);
            for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
                let request = HistoryRequest {
                    accuracy_mm: Some(1e-6),
                    ..HistoryRequest::at(times.to_vec())
                };
                let options = SolveOptions { mesh, tolerance: 1e-12 };
                let solver = MembraneSolver::new(&scene, options).unwrap();
                let found = solver.history(&all(&scene), &request).unwrap();
                assert!(found.outcome.is_converged(), "{}", found.outcome);
                let error_mm = found.time_error_mm.unwrap();
                for (field, known) in found.fields.iter().zip(&exact) {
                    let [x, y] = field.at_corner(3, 2);
                    let reached = [stretch + x / 30.0, stretch + y / 20.0];
                    let off = [0, 1].map(|k| (reached[k] - known[k]).abs() * [30.0, 20.0][k]);
                    assert!(
                        off[0].max(off[1]) < error_mm + 1e-7 && error_mm < 2e-6,
                        "{law} {stretch} {mesh}: {reached:?} {known:?} {error_mm:e}"
                    );
                }
                // Displacements from rest do not contain the release.
                let rest = found.rest.as_ref().unwrap().at_corner(3, 2);
                assert!((stretch + rest[0] / 30.0 - 1.465_571_231_877).abs() < 1e-9, "{rest:?}");
                assert!(found.strokes()[0].max_magnitude() < 2.0);
                let last = found.asked().last().unwrap();
                assert!((last.largest - found.strokes()[2].max_magnitude()).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn a_membrane_stays_in_its_released_state_without_voltage() {
    for law in LAWS {
        let found = within(
            &under_force(2.0, law, "voltage: 0 V"),
            &all(&under_force(2.0, law, "voltage: 0 V")),
            vec![0.0, 5.0],
            1e-6,
        );
        assert!(found.strokes().iter().all(|moved| moved.max_magnitude() < 1e-8));
    }
}

/// A strip that is held on the left, with free long sides and this bar on the right.
fn strip(prestretch: [f64; 2], bar: &str, drive: &str, more: &str) -> Scene {
    let [x, y] = [20.0 * prestretch[0], 20.0 * prestretch[1]];
    scene(&format!(
        "geometry: {{ size: [{x} mm, {y} mm], thickness: 1 mm, prestretch: [{}, {}], cells: [6, 6], sides: {{ right: \
         {{ bar: {{ {bar} }} }}, top: free, bottom: free }} }}, drive: {{ {drive} }}, {more}",
        prestretch[0], prestretch[1]
    ))
}

/// Electrodes on the lower half of the middle of a strip, so that its bar turns.
fn low(scene: &Scene) -> Pattern {
    Pattern::from_fn(scene.membrane().raster, |x, y| (1..5).contains(&x) && y < 3)
}

const CREEPING: &str = "viscoelasticity: { branches: [{ modulus: 30 kPa, time: 0.2 s }] }";
const HEAVY: &str = "properties: { density: 960 }";

#[test]
fn the_prestretch_is_only_where_displacements_count_from_in_time_too() {
    for (bar, drive, more, end, bound) in [
        (
            "load: [0.2 N, 0.01 N], at: 2 mm",
            "voltage: 5 kV",
            format!("effects: {{ {CREEPING} }}"),
            1.0,
            2e-6,
        ),
        (
            "load: [0.2 N, 0.01 N], at: 2 mm, mass: 1 g",
            "voltage: 5 kV, waveform: { ramp: { time: 5 ms } }",
            format!("{HEAVY}, effects: {{ inertia: {{}} }}"),
            1e-2,
            2e-5,
        ),
    ] {
        let mut known: Option<[f64; 2]> = None;
        for stretch in [1.0, 2.0, 3.3] {
            let scene = strip([stretch, 1.0], bar, drive, &more);
            let found = within(&scene, &low(&scene), vec![0.3 * end, end], 0.2 * bound);
            assert!(found.outcome.is_converged(), "{stretch}: {}", found.outcome);
            let at = found.asked().last().unwrap().bars.as_ref().unwrap()[0];
            let place = [20.0 * stretch + at.translation[0], at.translation[1]];
            let first = *known.get_or_insert(place);
            let apart = (place[0] - first[0]).hypot(place[1] - first[1]);
            println!("{stretch}: {place:?} {apart:.1e} {:.1e}", found.time_error_mm.unwrap());
            assert!(apart < bound, "{stretch}: {place:?} {first:?}");
        }
    }
}

#[test]
fn creep_of_a_strip_ends_at_its_equilibrium_with_its_energies_in_balance() {
    let drive = "voltage: 5 kV, waveform: { ramp: { time: 0.3 s } }";
    let bar = "load: [0.2 N, 0.02 N], at: 2 mm, spring: 10 N/m";
    for law in LAWS {
        let creeping = CREEPING.replace("{ branches", &format!("{{ law: {law}, branches"));
        let scene = strip([2.0, 1.5], bar, drive, &format!("effects: {{ {creeping} }}"));
        let found = within(&scene, &low(&scene), vec![0.1, 0.3, 20.0], 1e-5);
        assert!(found.outcome.is_converged());
        let open = open_balance(&found);
        assert!(open < 1e-3, "{law}: {open:e}");
        let dissipated = found
            .instants
            .windows(2)
            .map(|pair| pair[1].dissipated - pair[0].dissipated);
        assert!(dissipated.fold(0.0, f64::min) > -1e-6 * found.instants.last().unwrap().supplied.abs());
        let solver = solver(&scene);
        let still = solver.solve(&low(&scene));
        let apart = solver.field(&still).max_difference(found.fields.last().unwrap());
        assert!(apart < 1e-4, "{law}: {apart:e}");
        let bars = solver.simulation(&low(&scene), &still).observation.bars.unwrap()[0];
        let last = found.asked().last().unwrap().bars.as_ref().unwrap()[0];
        assert!((bars.translation[0] - last.translation[0]).abs() < 1e-4);
        assert!((bars.rotation - last.rotation).abs() < 1e-3 && bars.rotation.abs() > 1e-3);
    }
}

#[test]
fn three_equilibria_stand_for_the_creep_of_a_strip() {
    let scene = strip(
        [2.0, 1.5],
        "load: [0.2 N, 0 N]",
        "voltage: 5 kV",
        &format!("effects: {{ {CREEPING} }}"),
    );
    let times = vec![0.0, 0.05, 0.3, 1.0, 100.0];
    let found = within(&scene, &low(&scene), times.clone(), 1e-6);
    let strokes = found.strokes();
    let largest = strokes[4].max_magnitude();
    let parameters = crate::SolverParameters::new(crate::Method::Newton, Mesh::bilinear(1));
    for (time, known) in times.iter().zip(&strokes) {
        let rule = ThreeSolves::new(&scene, *time).unwrap();
        let evaluator = rule.evaluator(&scene, &parameters).unwrap();
        let stroke = evaluator.predict(&[low(&scene)]).unwrap().remove(0);
        let error = stroke.max_difference(known) / largest;
        println!("{time} s: {error:.1e}");
        let bound = if [0.0, 100.0].contains(time) { 1e-4 } else { 1e-2 };
        assert!(error < bound, "{time} s: {error:e}");
    }
}

#[test]
fn strips_keep_their_energy_and_move_to_second_order() {
    let drive = "voltage: 5 kV, waveform: { ramp: { time: 5 ms } }";
    for (bar, more) in [
        ("load: [0.2 N, 0.02 N], at: 2 mm, spring: 10 N/m", ""),
        ("load: [0.2 N, 0.02 N], at: 2 mm, spring: 10 N/m, mass: 2 g", ""),
        (
            "load: [0.2 N, 0.02 N], at: 2 mm, mass: 2 g",
            ", viscoelasticity: { branches: [{ modulus: 20 kPa, time: 3 ms }] }",
        ),
        ("displacement: [-2 mm, 1 mm], moves: [turn], mass: 1 g", ""),
    ] {
        let scene = strip(
            [2.0, 1.5],
            bar,
            drive,
            &format!("{HEAVY}, effects: {{ inertia: {{}}{more} }}"),
        );
        let found = by_steps(&[1e-2, 1e-3, 1e-4, 1e-5, 5e-7], |accuracy| {
            within(&scene, &low(&scene), vec![5e-3, 1.2e-2], accuracy)
        });
        for found in &found {
            assert!(found.outcome.is_converged(), "{bar}: {}", found.outcome);
            let open = open_balance(found);
            println!("{bar} {more}: {open:.1e}");
            assert!(open < 1e-8, "{bar} {more}: {open:e}");
        }
        // With x(n) = x + e/n², two passes predict the third: they are not extrapolated.
        let ends = found.each_ref().map(|found| {
            let at = found.asked().last().unwrap().bars.as_ref().unwrap()[0];
            let steps = found.instants.len() as f64;
            (
                [at.translation[0], at.translation[1], at.rotation],
                (steps - 1.0).powi(-2),
            )
        });
        let [(first, a), (second, b), (third, c)] = ends;
        for k in 0..3 {
            let slope = (first[k] - second[k]) / (a - b);
            let error = second[k] + slope * (c - b) - third[k];
            assert!(
                error.abs() < 0.1 * (slope * a).abs() + 1e-7,
                "{bar} {more} {k}: {error:e}"
            );
        }
    }
}

#[test]
fn membranes_with_free_sides_keep_their_energy() {
    let stiff = "strain_stiffening: { model: yeoh, c2: -1 kPa, c3: 0.05 kPa }";
    for (sides, law) in [
        ("right: free, top: free, bottom: free", ""),
        ("right: free, top: free, bottom: free", stiff),
        (
            "left: roller, bottom: roller, right: { load: [0.3 N, 0.02 N] }, top: free",
            "",
        ),
        ("right: roller, top: { load: [0.02 N, 0.2 N] }", ""),
    ] {
        let scene = scene(&format!(
            "geometry: {{ size: [30 mm, 20 mm], thickness: 1 mm, prestretch: [1.6, 1.3], cells: [6, 4], sides: {{ \
             {sides} }} }}, drive: {{ voltage: 6 kV, waveform: {{ ramp: {{ time: 4 ms }} }} }}, {HEAVY}, effects: {{ \
             inertia: {{}}, {law} }}"
        ));
        let pattern = Pattern::from_fn(scene.membrane().raster, |x, y| x + 2 * y > 4);
        let found = within(&scene, &pattern, vec![8e-3], 1e-3);
        assert!(found.outcome.is_converged(), "{sides}: {}", found.outcome);
        let open = open_balance(&found);
        assert!(open < 1e-8, "{sides}: {open:e}");
        assert!(found.instants.iter().any(|now| now.kinetic > 1e-9));
    }
}

/// A strip of hardly any mass under 0.9 N in pure shear, with 20 g on its bar.
fn weighted(force: &str, drive: &str) -> Scene {
    scene(&format!(
        "geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 1.5, cells: [4, 2], sides: {{ right: {{ bar: \
         {{ load: [{force}, 0 N], moves: [x], mass: 20 g }} }}, top: roller, bottom: roller }} }}, drive: {{ {drive} \
         }}, properties: {{ density: 1 }}, effects: {{ inertia: {{}} }}"
    ))
}

#[test]
fn a_heavy_bar_swings_as_a_mass_on_the_static_stiffness_of_its_strip() {
    let place = |drive: &str, force_n: f64| {
        let scene = weighted(&format!("{force_n} N"), drive);
        let solver = solver(&scene);
        let solution = solver.solve(&all(&scene));
        solver.simulation(&all(&scene), &solution).observation.bars.unwrap()[0].translation[0]
    };
    let (force, change) = (0.9, 1e-3);
    let natural = |drive: &str| {
        let [less, more] = [-change, change].map(|change| place(drive, force + change));
        (2.0 * change / (1e-3 * (more - less)) / 20e-3).sqrt() / TAU
    };
    let known = natural("voltage: 2 kV");
    let scene = weighted("0.9 N", "voltage: 2 kV");
    let found = solver(&scene).vibration(&all(&scene), 1, false).unwrap().frequencies[0];
    // A third of the mass of the strip, 0.36 mg, moves with it.
    assert!((found / known - 1.0).abs() < 1e-5, "{found} {known}");
    // A small voltage at once: the bar swings to twice its stroke and back.
    let drive = "voltage: 400 V";
    let known = natural(drive);
    let times: Vec<f64> = (0..=8).map(|k| 0.25 * f64::from(k) / known).collect();
    let sudden = weighted("0.9 N", drive);
    let moved = within(&sudden, &all(&sudden), times, 1e-6);
    assert!(moved.outcome.is_converged(), "{}", moved.outcome);
    let rest = moved.rest.as_ref().unwrap().at_corner(4, 1)[0];
    let solver = solver(&sudden);
    let stroke = solver.field(&solver.solve(&all(&sudden))).at_corner(4, 1)[0] - rest;
    assert!(stroke > 1e-3);
    for (k, now) in moved.asked().enumerate() {
        let at = now.bars.as_ref().unwrap()[0].translation[0] - rest;
        let expected = stroke * (1.0 - (0.5 * PI * k as f64).cos());
        assert!((at - expected).abs() < 5e-3 * stroke, "{k}: {at} {expected}");
    }
    assert!(open_balance(&moved) < 1e-8);
}

#[test]
fn a_bar_turns_with_the_moment_of_inertia_of_a_uniform_bar() {
    // The moment that turns it by a small angle, over that angle.
    let bar = |load: &str| {
        scene(&format!(
            "geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 1.5, cells: [8, 4], sides: {{ right: {{ \
             bar: {{ {load} moves: [turn], mass: 20 g }} }}, top: free, bottom: free }} }}, drive: {{ voltage: 0 V }}, \
             properties: {{ density: 1 }}, effects: {{ inertia: {{}} }}"
        ))
    };
    let angle = |arm_mm: f64| {
        let scene = bar(&format!("load: [0.001 N, 0 N], at: {arm_mm} mm,"));
        let solver = solver(&scene);
        let solution = solver.solve(&all(&scene));
        solver.simulation(&all(&scene), &solution).observation.bars.unwrap()[0]
            .rotation
            .to_radians()
    };
    let stiffness = -2.0 * 0.001 * 5e-3 / (angle(5.0) - angle(-5.0));
    let moment = 20e-3 * 20e-3_f64.powi(2) / 12.0;
    let known = (stiffness / moment).sqrt() / TAU;
    let scene = bar("");
    let found = solver(&scene).vibration(&all(&scene), 1, false).unwrap().frequencies[0];
    assert!((found / known - 1.0).abs() < 1e-4, "{found} {known}");
}

#[test]
fn a_mass_changes_no_equilibrium() {
    let of = |mass: &str| {
        let bar = format!("load: [0.2 N, 0.02 N], at: 2 mm{mass}");
        let scene = strip([2.0, 1.5], &bar, "voltage: 5 kV", &format!("{HEAVY}, effects: {{}}"));
        let solver = solver(&scene);
        solver.solve(&low(&scene)).displacement
    };
    assert_eq!(of(""), of(", mass: 100 g"));
}

#[test]
fn responses_have_the_mass_of_bars() {
    let drive = "voltage: 20 V, waveform: { sine: { frequency: 1 Hz, bias: 4 kV } }";
    let bar = "load: [0.2 N, 0.01 N], at: 3 mm, mass: 3 g";
    let scene = strip(
        [2.0, 1.5],
        bar,
        drive,
        &format!("{HEAVY}, effects: {{ inertia: {{}} }}"),
    );
    let biased = at_bias(&scene);
    let natural = solver(&biased).vibration(&low(&biased), 1, false).unwrap().frequencies[0];
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-11,
    };
    let responses = FrequencySolver::new(&biased, options, WorkLimit::default()).unwrap();
    let near = responses.respond(
        &low(&biased),
        &[1e-6 * natural, natural * (1.0 - 1e-6), natural * (1.0 + 1e-6)],
    );
    let size = |at: &AtFrequency| match at {
        AtFrequency::Response { real, .. } => real.max_magnitude(),
        other => panic!("{other:?}"),
    };
    let still = size(&near.each[0]);
    assert!(
        size(&near.each[1]) > 1e4 * still && size(&near.each[2]) > 1e4 * still,
        "{natural}"
    );
}

#[test]
fn what_does_not_creep_or_move_with_such_sides_is_refused() {
    let scene = under_force(2.0, "linear", "voltage: 1 kV, rest: 10 s");
    let said = refusal(&scene).unwrap().to_string();
    assert!(said.contains("`rest` in the drive"), "{said}");
    let scene = under_force(2.0, "linear", "voltage: 1 kV");
    assert_eq!(refusal(&scene), None);
    let said = StepEstimates::check(&scene).unwrap_err().to_string();
    assert!(said.contains("not all `sides` are held"), "{said}");
    // What pushes the strip over ends before the drive starts.
    let pushed = strip(
        [1.0, 1.0],
        "load: [-3 N, 0 N]",
        "voltage: 1 kV",
        &format!("{HEAVY}, effects: {{ inertia: {{}} }}"),
    );
    let found = within(&pushed, &low(&pushed), vec![1e-3], 1e-3);
    assert!(
        !found.outcome.is_converged() && found.fields.is_empty() && found.rest.is_none(),
        "{}",
        found.outcome
    );
}

#[test]
fn modes_of_heavy_bars_are_those_of_one_bar_on_a_light_strip() {
    // Frequencies of a bar that moves in all ways fall as the root of its mass, and do not depend on the number of
    // modes.
    let strip = |grams: f64| {
        Scene::from_text(&format!(
            "geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 2, cells: [10, 5], sides: {{ right: {{ bar: \
             {{ load: [0.3 N, 0 N], mass: {grams} g }} }}, top: free, bottom: free }} }}\nmaterial: {{ model: \
             neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}\ndrive: {{ voltage: 4 kV }}\neffects: {{ \
             inertia: {{ density: 960 kg/m3 }} }}"
        ))
        .unwrap()
    };
    let found = |grams: f64, count: usize| {
        let scene = strip(grams);
        let vibration = solver(&scene).vibration(&all(&scene), count, false).unwrap();
        assert_eq!(vibration.frequencies.len(), count, "{grams} g");
        assert!(
            vibration.frequencies.is_sorted(),
            "{grams} g: {:?}",
            vibration.frequencies
        );
        vibration.frequencies
    };
    let known = found(3e4, 3);
    for grams in [30.0, 500.0, 1e3] {
        for count in 1..5 {
            let frequencies = found(grams, count);
            for (own, heavy) in frequencies.iter().zip(&known) {
                let ratio = own * (grams / 3e4).sqrt() / heavy;
                // The strip of 0.2 g adds up to a third of its mass.
                assert!(
                    (ratio - 1.0).abs() < 0.1 / grams + 1e-4,
                    "{grams} g, {count}: {frequencies:?} {known:?}"
                );
            }
        }
    }
}

#[test]
fn a_free_sheet_creeps_as_a_quarter_on_rollers() {
    for law in LAWS {
        let device = |size: [f64; 2], cells: [usize; 2], sides: &str| {
            let ([x, y], [columns, rows]) = (size, cells);
            scene(&format!(
                "geometry: {{ size: [{x} mm, {y} mm], thickness: 1 mm, prestretch: [2, 1.5], cells: [{columns}, \
                 {rows}], sides: {{ {sides}, right: free, top: free }} }}, drive: {{ voltage: 12 kV }}, {}",
                of_law(law, "{ modulus: 45 kPa, time: 1 s }")
            ))
        };
        let whole = device([24.0, 16.0], [6, 4], "left: free, bottom: free");
        let quarter = device([12.0, 8.0], [3, 2], "left: roller, bottom: roller");
        let found = within(
            &whole,
            &Pattern::from_fn(whole.membrane().raster, |x, y| {
                (1..5).contains(&x) && (1..3).contains(&y)
            }),
            vec![0.0, 1.0, 20.0],
            1e-5,
        );
        let known = within(
            &quarter,
            &Pattern::from_fn(quarter.membrane().raster, |x, y| x < 2 && y < 1),
            vec![0.0, 1.0, 20.0],
            1e-5,
        );
        assert!(found.fields[2].max_difference(&found.fields[0]) > 0.01);
        for (field, known) in found.fields.iter().zip(&known.fields) {
            for (x, y) in (0..=3).flat_map(|x| (0..=2).map(move |y| (x, y))) {
                let ([a, b], [p, q]) = (field.at_corner(3 + x, 2 + y), known.at_corner(x, y));
                assert!((a - p).hypot(b - q) < 2e-5, "{law} {x} {y}: {a} {p} {b} {q}");
            }
        }
    }
}

#[test]
fn motions_of_floating_sheets_are_refused() {
    let text = "geometry: { size: [24 mm, 16 mm], thickness: 1 mm, prestretch: 2, cells: [6, 4], sides: { left: free, \
                right: free, top: free, bottom: roller } }, drive: { voltage: 5 kV }";
    let scene = scene(&format!(
        "{text}, properties: {{ density: 960 }}, effects: {{ inertia: {{}} }}"
    ));
    let why = "nothing holds the membrane along x, which is not simulated with";
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let pattern = all(&scene);
    let refused = solver.history(&pattern, &HistoryRequest::at(vec![1e-3])).unwrap_err();
    assert!(refused.to_string().starts_with(&format!("{why} inertia")), "{refused}");
    let refused = solver.vibration(&pattern, 2, false).unwrap_err();
    assert!(
        refused.to_string().starts_with(&format!("{why} natural frequencies")),
        "{refused}"
    );
    let options = SolveOptions::on(Mesh::bilinear(1));
    let refused = FrequencySolver::new(&scene, options, WorkLimit::default())
        .err()
        .unwrap();
    assert!(
        refused.to_string().starts_with(&format!("{why} frequency responses")),
        "{refused}"
    );
}
