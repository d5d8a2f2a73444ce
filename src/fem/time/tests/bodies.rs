//! Rigid bodies with inertia: energy balance, order of convergence, symmetries, and comparison with natural frequencies
//! and responses.

use std::f64::consts::TAU;

use super::*;
use crate::energy::NeoHookean;
use crate::mass::Mass;
use crate::material::AnyMaterial;
use crate::operator::{Activity, Operator};
use crate::time::modes::lowest;
use deaflow_field::Motion;
use deaflow_pattern::Symmetry;

/// A bar in the middle, with electrodes on either side that turn it, and a pull.
fn bar(pull: &str) -> String {
    format!(
        "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10, bodies: [{{ rectangle: [[10 mm, 20 mm], \
         [40 mm, 30 mm]]{pull} }}] }}"
    )
}

/// Electrodes that turn the bar.
fn turning() -> Pattern {
    Pattern::from_fn(ten(), |x, y| (x < 5 && y < 4) || (x >= 5 && y >= 6) || (x < 2 && y < 6))
}

/// On one bilinear element per cell.
pub fn solver(scene: &Scene) -> MembraneSolver {
    let mesh = Mesh::bilinear(1);
    MembraneSolver::new(scene, SolveOptions { mesh, tolerance: 1e-11 }).unwrap()
}

/// A history with no more than an error in time.
pub fn within(scene: &Scene, pattern: &Pattern, times: Vec<f64>, accuracy_mm: f64) -> History {
    let request = HistoryRequest {
        accuracy_mm: Some(accuracy_mm),
        ..HistoryRequest::at(times)
    };
    solver(scene).history(pattern, &request).unwrap()
}

/// Largest error of the energy balance, relative to the supplied or kinetic energy.
pub fn open_balance(found: &History) -> f64 {
    let size = found.instants.iter().map(|now| now.supplied.abs() + now.kinetic);
    let size = size.fold(0.0, f64::max);
    let open = found
        .instants
        .iter()
        .map(|now| now.stored + now.electric + now.kinetic + now.dissipated - now.supplied);
    open.fold(0.0, |largest: f64, open| largest.max(open.abs())) / size
}

/// The coarsest, a finer and the finest of histories for several accuracies in mm, each with a more accurate reference.
pub fn by_steps(accuracies: &[f64], within: impl Fn(f64) -> History) -> [History; 3] {
    let mut found: Vec<History> = accuracies.iter().copied().map(within).collect();
    let finest = found.pop().unwrap();
    for found in &found {
        let (error, said) = (found.difference(&finest), found.time_error_mm.unwrap());
        assert!(error <= said + 1e-6, "{error:e} {said:e}");
    }
    let coarsest = found.remove(0);
    let [fewest, most] = [&coarsest, &finest].map(|found| found.instants.len());
    let middle = found
        .into_iter()
        .find(|found| (fewest + 1..most).contains(&found.instants.len()));
    let Some(middle) = middle else {
        panic!("no steps between the longest, {fewest} in all, and the shortest, {most}");
    };
    [coarsest, middle, finest]
}

fn body(now: &Instant) -> Motion {
    now.bodies.as_ref().unwrap()[0]
}

#[test]
fn bodies_that_turn_keep_their_energy_and_move_to_second_order() {
    let branch = "viscoelasticity: { branches: [{ modulus: 20 kPa, time: 3 ms }] }";
    let ramp = "waveform: { ramp: { time: 5 ms } }";
    for (pull, more) in [
        ("", ""),
        (", load: [2 mN, -1 mN], spring: 1 N/m", ""),
        (", load: [2 mN, -1 mN], spring: 1 N/m", branch),
    ] {
        let scene = scene(&format!(
            "{}, drive: {{ voltage: 5 kV, {ramp} }}, properties: {{ density: 960 }}, effects: {{ inertia: {{}}, {more} \
             }}",
            bar(pull)
        ));
        let times = vec![4e-3, 8e-3];
        let found = by_steps(&[1e-2, 1e-3, 1e-4, 1e-5, 5e-7], |accuracy| {
            within(&scene, &turning(), times.clone(), accuracy)
        });
        for found in &found {
            assert!(found.outcome.is_converged(), "{pull} {more}: {}", found.outcome);
            let open = open_balance(found);
            assert!(open < 1e-8, "{pull} {more}: {open:e}");
            assert!(
                found
                    .instants
                    .windows(2)
                    .all(|pair| pair[1].dissipated >= pair[0].dissipated - 1e-12 * pair[1].supplied)
            );
        }
        let turned = found[2].instants.iter().map(|now| body(now).rotation.abs());
        assert!(turned.fold(0.0, f64::max) > 1.0);
        // The last passes are not extrapolated: any two of them give their error.
        let [coarse, fine] = [&found[0], &found[2]].map(|found| {
            let at = body(found.asked().last().unwrap());
            (
                [at.translation[0], at.translation[1], at.rotation],
                found.instants.len() as f64,
            )
        });
        let middle = &found[1];
        let at = body(middle.asked().last().unwrap());
        let at = [at.translation[0], at.translation[1], at.rotation];
        let steps = middle.instants.len() as f64;
        // With x(n) = x + e/n², two of them predict the third.
        let [a, b, c] = [coarse.1, steps, fine.1].map(|count| (count - 1.0).powi(-2));
        let [errors, steps] = [0, 1].map(|which| {
            [0, 1, 2].map(|k| {
                let slope = (coarse.0[k] - at[k]) / (a - b);
                [at[k] + slope * (c - b) - fine.0[k], slope * a][which]
            })
        });
        let size = |[x, y, _]: [f64; 3]| x.hypot(y);
        assert!(size(errors) < 0.1 * size(steps) + 1e-9, "{errors:?} {steps:?}");
        assert!(errors[2].abs() < 0.1 * steps[2].abs() + 1e-9, "{errors:?} {steps:?}");
    }
}

#[test]
fn a_body_swings_at_the_natural_frequencies_of_its_membrane() {
    let still = format!(
        "{}, drive: {{ voltage: 0 V }}",
        bar(", load: [0.2 mN, 0.1 mN], spring: 3 N/m")
    );
    let moving = scene(&format!("{still}, {MOVING}"));
    let bare = Pattern::from_fn(ten(), |_, _| false);
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-8,
    };
    let solver = MembraneSolver::new(&moving, options).unwrap();
    let natural = solver.vibration(&bare, 4, false).unwrap().frequencies;
    let times: Vec<f64> = (0..24).map(|k| 0.11 * f64::from(k) / natural[0]).collect();
    let found = within(&moving, &bare, times.clone(), 1e-6);
    assert!(found.outcome.is_converged());
    let still = solver.solve(&bare).displacement;
    let mass = Mass::new(&solver.grid, false);
    let law = AnyMaterial::from(NeoHookean::new(3.0, 0.0));
    let activity = Activity::new(&solver.grid, &bare);
    let operator = Operator::new(&law, &activity);
    let modes = lowest(&operator, &solver.laplacian, &mass, &vec![0.0; still.len()], 4);
    let along = |mode: &[f64], u: &[f64]| {
        let mut heavy = vec![0.0; u.len()];
        mass.apply(u, &mut heavy);
        mode.iter().zip(&heavy).map(|(a, b)| a * b).sum::<f64>()
    };
    let layout = solver.grid.layout();
    let mut moved = 0;
    for ((_, mode), hertz) in modes.iter().zip(&natural) {
        // A load applied at once gives A(1 − cos ωt) along each mode, with the amplitude A of the equilibrium.
        let rest = along(mode, &still);
        if rest.abs() < 0.05 * along(&still, &still).sqrt() {
            continue;
        }
        moved += 1;
        for (field, time) in found.fields.iter().zip(&times) {
            let mut u = vec![0.0; still.len()];
            for (x, y) in (0..=10).flat_map(|y| (0..=10).map(move |x| (x, y))) {
                for (c, value) in field.at_corner(x, y).into_iter().enumerate() {
                    u[layout.index(c, x, y)] = value / solver.grid.unit_mm();
                }
            }
            let known = rest * (1.0 - (TAU * hertz * time).cos());
            let error = (along(mode, &u) - known).abs() / rest.abs();
            assert!(error < 2e-3, "{hertz} Hz, {time} s: {error:e}");
        }
    }
    assert!(moved >= 2, "{moved}");
}

#[test]
fn transposed_devices_move_as_transposed_and_symmetric_bodies_do_not_turn() {
    let scenes = [
        (
            "[50 mm, 30 mm]",
            "[4, 3]",
            "[10, 6]",
            "[[10 mm, 5 mm], [30 mm, 15 mm]], load: [1 mN, 2 mN]",
        ),
        (
            "[30 mm, 50 mm]",
            "[3, 4]",
            "[6, 10]",
            "[[5 mm, 10 mm], [15 mm, 30 mm]], load: [2 mN, 1 mN]",
        ),
    ]
    .map(|(size, prestretch, cells, rectangle)| {
        scene(&format!(
            "geometry: {{ size: {size}, thickness: 1 mm, prestretch: {prestretch}, cells: {cells}, \
             bodies: [{{ rectangle: {rectangle} }}] }}, drive: {{ voltage: 4 kV, \
             waveform: {{ ramp: {{ time: 5 ms }} }} }}, {MOVING}"
        ))
    });
    let wide = Pattern::from_fn(Raster::new(10, 6).unwrap(), |x, y| (x * x + 3 * y + x * y) % 7 < 3);
    let transpose = Symmetry::ALL
        .into_iter()
        .find(|g| g.matrix() == [[0, 1], [1, 0]])
        .unwrap();
    let patterns = [wide.clone(), wide.transformed(transpose)];
    let [wide, high] = [0, 1].map(|k| within(&scenes[k], &patterns[k], vec![3e-3, 7e-3], 1e-4));
    assert_eq!(wide.instants.len(), high.instants.len());
    for (a, b) in wide.fields.iter().zip(&high.fields) {
        assert!(a.max_magnitude() > 0.05);
        let apart = b.max_difference(&a.transformed(transpose));
        assert!(apart < 1e-8 * a.max_magnitude(), "{apart:e}");
    }
    let (a, b) = (body(wide.instants.last().unwrap()), body(high.instants.last().unwrap()));
    assert!(
        a.rotation.abs() > 1e-2 && (a.rotation + b.rotation).abs() < 1e-8,
        "{a:?} {b:?}"
    );
    let mirrored = scene(&format!(
        "{}, drive: {{ voltage: 4 kV, waveform: {{ ramp: {{ time: 5 ms }} }} }}, {MOVING}",
        bar(", load: [5 mN, 0 N]")
    ));
    let half = Pattern::from_fn(ten(), |x, _| x < 2);
    let found = within(&mirrored, &half, vec![7e-3], 1e-4);
    for now in &found.instants {
        let Motion { translation, rotation } = body(now);
        assert!(rotation.abs() < 1e-9 && translation[1].abs() < 1e-9, "{rotation:e}");
    }
    assert!(body(found.instants.last().unwrap()).translation[0].abs() > 0.05);
}

#[test]
fn bodies_come_to_rest_at_their_equilibrium() {
    for law in LAWS {
        let scene = scene(&format!(
            "{}, drive: {{ voltage: 4.5 kV, waveform: {{ ramp: {{ time: 5 ms }} }} }}, \
             properties: {{ density: 960 }}, effects: {{ inertia: {{}}, viscoelasticity: {{ law: {law}, \
             branches: [{{ modulus: 45 kPa, time: 1 ms }}] }} }}",
            bar(", load: [5 mN, 2 mN], spring: 1 N/m")
        ));
        let found = within(&scene, &turning(), vec![0.1], 1e-2);
        assert!(found.outcome.is_converged(), "{law}: {}", found.outcome);
        let still = solver(&scene).simulate(&[turning()]).remove(0).field.unwrap();
        let size = still.max_magnitude();
        let apart = found.fields[0].max_difference(&still);
        assert!(apart < 1e-3 * size, "{law}: {apart:e} of {size}");
        let open = open_balance(&found);
        assert!(open < 1e-8, "{law}: {open:e}");
    }
}

#[test]
fn bodies_answer_a_small_sine_as_their_history_does_and_resonate_at_natural_frequencies() {
    let (bias, amplitude, hertz) = (4500.0, 20.0, 250.0);
    let branches = "viscoelasticity: { branches: [{ modulus: 300 kPa, time: 1 ms }] }";
    let sine = format!("voltage: {amplitude} V, waveform: {{ sine: {{ frequency: {hertz} Hz, bias: {bias} V }} }}");
    let with = |effects: &str| {
        scene(&format!(
            "{}, drive: {{ {sine} }}, properties: {{ density: 960 }}, effects: {{ inertia: {{}}, {effects} }}",
            bar(", load: [5 mN, 2 mN], spring: 1 N/m")
        ))
    };
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-12,
    };
    let damped = with(branches);
    let samples = 8_u32;
    let period = 1.0 / hertz;
    let times = (0..samples)
        .map(|k| period * (16.0 + f64::from(k) / f64::from(samples)))
        .collect();
    let history = within(&damped, &turning(), times, 1e-5);
    assert!(history.outcome.is_converged(), "{}", history.outcome);
    let frequency = |scene: &Scene, hertz: &[f64]| {
        let solver = FrequencySolver::new(&at_bias(scene), options, WorkLimit::default()).unwrap();
        solver.respond(&turning(), hertz)
    };
    let found = frequency(&damped, &[hertz]);
    let AtFrequency::Response { real, imaginary } = &found.each[0] else {
        panic!("{}", found.each[0].name());
    };
    let size = real.max_magnitude().max(imaginary.max_magnitude());
    for (x, y) in [(2, 4), (8, 6), found.watched.into()] {
        for c in 0..2 {
            let mut sums = [0.0; 2];
            for (k, field) in history.fields.iter().enumerate() {
                let phase = TAU * k as f64 / f64::from(samples);
                let value = 2.0 / f64::from(samples) / amplitude * field.at_corner(x, y)[c];
                sums = [sums[0] + value * phase.sin(), sums[1] + value * phase.cos()];
            }
            let error = (sums[0] - real.at_corner(x, y)[c]).hypot(sums[1] - imaginary.at_corner(x, y)[c]);
            assert!(error < 2e-3 * size, "{x} {y} {c}: {error:e} of {size:e}");
        }
    }
    let free = with("");
    let solver = MembraneSolver::new(&at_bias(&free), options).unwrap();
    let natural = solver.vibration(&turning(), 3, false).unwrap().frequencies;
    let found = frequency(
        &free,
        &[natural[0], natural[0] * (1.0 - 1e-4), natural[0] * (1.0 + 1e-4)],
    );
    assert_eq!(found.each[0], AtFrequency::Resonance);
    let motion: Vec<f64> = found
        .watched_motion()
        .into_iter()
        .skip(1)
        .map(|motion| motion.unwrap()[0])
        .collect();
    assert!((motion[0] / motion[1] - 1.0).abs() < 2e-2, "{motion:?}");
}
