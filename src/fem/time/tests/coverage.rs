//! Stated errors of motions, against a Runge–Kutta integration of the same elements.

use std::f64::consts::TAU;

use super::*;
use crate::effects::WithMaterial;
use crate::mass::Mass;
use crate::material::Material;
use crate::operator::{Activity, Operator};
use crate::time::modes::wave_speed;
use deaflow_linalg::{Mat, inverse_definite};
use deaflow_scene::Side;

/// Integrates M ü = −F(u, V²) by the classical method of fourth order, with the consistent mass inverted.
struct RungeKutta<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    times: &'a [f64],
    /// Step in units of the time in which a wave passes an element.
    step: f64,
}

impl WithMaterial for RungeKutta<'_> {
    type Output = Vec<Field>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Vec<Field> {
        let Self {
            solver,
            activity,
            times,
            step,
        } = self;
        let (scene, grid) = (&solver.scene, activity.grid());
        let len = grid.layout().vector_len();
        let per_second = wave_speed(scene).unwrap() / (1e-3 * grid.unit_mm());
        let mass = Mass::new(grid, false);
        // The mass of a line of elements of side 1, of which that of the membrane is a product.
        let count = grid.elements()[0] - 1;
        let line = |row: usize, at: usize| match row.abs_diff(at) {
            0 => 2.0 / 3.0,
            1 => 1.0 / 6.0,
            _ => 0.0,
        };
        let inverse = inverse_definite(&Mat::from_fn(count, count, line)).unwrap();
        let layout = grid.layout();
        let divided = |force: &[f64]| {
            let (mut half, mut found) = (vec![0.0; len], vec![0.0; len]);
            for c in 0..2 {
                for (x, y) in (0..count).flat_map(|y| (0..count).map(move |x| (x, y))) {
                    let along = (0..count).map(|k| inverse[(x, k)] * force[layout.index(c, k + 1, y + 1)]);
                    half[layout.index(c, x + 1, y + 1)] = along.sum();
                }
                for (x, y) in (0..count).flat_map(|y| (0..count).map(move |x| (x, y))) {
                    let across = (0..count).map(|k| inverse[(y, k)] * half[layout.index(c, x + 1, k + 1)]);
                    found[layout.index(c, x + 1, y + 1)] = across.sum();
                }
            }
            found
        };
        let mut check: Vec<f64> = (0..len).map(|at| (at as f64).sin()).collect();
        layout.clear_frame(&mut check);
        let mut image = vec![0.0; len];
        mass.apply(&divided(&check), &mut image);
        assert!(image.iter().zip(&check).all(|(a, b)| (a - b).abs() < 1e-12));
        let waveform = scene.waveform();
        let full = scene.voltage_v();
        let acceleration = |u: &[f64], time: f64| {
            let share = (waveform.voltage(full, time, Side::After) / full).powi(2);
            let law = material(share);
            let mut force = vec![0.0; len];
            Operator::new(&law, activity).residual(u, &mut force);
            force.iter_mut().for_each(|force| *force = -*force);
            divided(&force)
        };
        let moved = |u: &[f64], by: f64, v: &[f64]| -> Vec<f64> { u.iter().zip(v).map(|(u, v)| u + by * v).collect() };
        let (mut u, mut v, mut now) = (vec![0.0; len], vec![0.0; len], 0.0);
        let mut fields = Vec::new();
        // Steps end at kinks.
        let end = times[times.len() - 1];
        let mut stops: Vec<f64> = waveform.knots(end).iter().map(|knot| knot.time).collect();
        stops.extend(times);
        stops.sort_by(f64::total_cmp);
        for stop in stops {
            let count = ((stop - now) * per_second / step).ceil().max(1.0);
            let seconds = (stop - now) / count;
            let h = seconds * per_second;
            for _ in 0..count as usize {
                if seconds <= 0.0 {
                    break;
                }
                let k1 = acceleration(&u, now);
                let (u2, v2) = (moved(&u, 0.5 * h, &v), moved(&v, 0.5 * h, &k1));
                let k2 = acceleration(&u2, now + 0.5 * seconds);
                let (u3, v3) = (moved(&u, 0.5 * h, &v2), moved(&v, 0.5 * h, &k2));
                let k3 = acceleration(&u3, now + 0.5 * seconds);
                let (u4, v4) = (moved(&u, h, &v3), moved(&v, h, &k3));
                let k4 = acceleration(&u4, now + seconds);
                for at in 0..len {
                    u[at] += h / 6.0 * (v[at] + 2.0 * (v2[at] + v3[at]) + v4[at]);
                }
                for at in 0..len {
                    v[at] += h / 6.0 * (k1[at] + 2.0 * (k2[at] + k3[at]) + k4[at]);
                }
                now += seconds;
            }
            now = stop;
            if u.iter().any(|u| !u.is_finite()) {
                return fields;
            }
            while fields.len() < times.len() && times[fields.len()] <= now {
                fields.push(grid.sample(&u));
            }
        }
        fields
    }
}

/// Returns the fields at some times, with an error far below those of histories; fewer if the membrane is lost.
fn reference(solver: &MembraneSolver, pattern: &Pattern, times: &[f64]) -> Vec<Field> {
    let activity = solver.model.activity(&solver.grid, pattern);
    solver.model.with(RungeKutta {
        solver,
        activity: &activity,
        times,
        step: 0.02,
    })
}

/// Reproducible numbers from 0 to 1.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// Returns the scene, pattern and end of a random device with a smooth drive.
fn device(seed: u64) -> (Scene, Pattern, f64) {
    let mut random = Numbers(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    (0..9).for_each(|_| {
        random.next();
    });
    let cells = random.between(4.0, 9.99) as u32;
    let (stretch, modulus, density) = (
        random.between(1.8, 3.5),
        random.between(20e3, 120e3),
        random.between(900.0, 1100.0),
    );
    // κλ² of the scene between a tenth and half of that at which a uniform membrane becomes unstable.
    let load = random.between(0.1, 0.5);
    let volts = 1e-3 * (load * modulus / (4.7 * 8.854e-12)).sqrt() / stretch;
    let period = 2.0 * 0.05 / (stretch * (modulus / density).sqrt());
    let change = period * random.between(0.3, 1.5);
    let end = change * random.between(0.6, 2.5);
    let waveform = match random.between(0.0, 3.0) as u32 {
        0 | 1 => format!("ramp: {{ time: {change} s }}"),
        _ => format!("sine: {{ frequency: {} Hz }}", 1.0 / (TAU * change)),
    };
    let share = random.between(0.3, 0.7);
    let side = cells as usize;
    let active: Vec<bool> = (0..side * side).map(|_| random.next() < share).collect();
    let pattern = Pattern::from_fn(Raster::new(side, side).unwrap(), |x, y| active[y * side + x]);
    let scene = Scene::from_text(&format!(
        "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: {stretch}, cells: {cells} }}, material: {{ model: \
         neo-hookean, shear_modulus: {modulus} Pa, relative_permittivity: 4.7 }}, drive: {{ voltage: {volts} V, \
         waveform: {{ {waveform} }} }}, effects: {{ inertia: {{ density: {density} kg/m3 }} }} }}"
    ))
    .unwrap();
    (scene, pattern, end)
}

fn solver_of(scene: &Scene) -> MembraneSolver {
    let mesh = Mesh::bilinear(1);
    MembraneSolver::new(scene, SolveOptions { mesh, tolerance: 1e-11 }).unwrap()
}

#[test]
fn stated_errors_of_motions_cover_the_true_ones_of_random_devices() {
    let (mut count, mut seed) = (0, 0);
    let mut beyond: [Vec<(u64, f64)>; 3] = Default::default();
    while count < 40 {
        seed += 1;
        let (scene, pattern, end) = device(seed);
        let solver = solver_of(&scene);
        let times: Vec<f64> = (1..=6).map(|k| f64::from(k) / 6.0 * end).collect();
        let truth = reference(&solver, &pattern, &times);
        // Devices that a fast drive makes unstable have no error.
        if truth.len() < times.len() {
            continue;
        }
        let asked = |times: &[f64], accuracy_mm: Option<f64>| {
            let request = HistoryRequest {
                accuracy_mm,
                ..HistoryRequest::at(times.to_vec())
            };
            solver.history(&pattern, &request).unwrap()
        };
        // The last two with the fewest passes.
        let [alone, several, loose, all] = [
            asked(&times[5..], None),
            asked(&times, None),
            asked(&times[5..], Some(10.0)),
            asked(&times, Some(10.0)),
        ];
        if [&alone, &several, &loose, &all]
            .iter()
            .any(|found| found.outcome != Outcome::Converged)
        {
            continue;
        }
        count += 1;
        let [said, of_all] = [&loose, &all].map(|found| found.time_error_mm.unwrap());
        assert!(
            said >= 0.8 * of_all,
            "{seed}: {said:e} for the end, {of_all:e} for all times"
        );
        let off = |found: &History| {
            let truth = &truth[truth.len() - found.fields.len()..];
            let each = found
                .fields
                .iter()
                .zip(truth)
                .map(|(field, truth)| field.max_difference(truth));
            each.fold(0.0, f64::max) / found.time_error_mm.unwrap()
        };
        let ratios = [&alone, &several, &loose].map(off);
        for (beyond, ratio) in beyond.iter_mut().zip(ratios) {
            beyond.extend((ratio > 1.0).then_some((seed, ratio)));
        }
    }
    assert!(beyond.iter().all(|beyond| beyond.len() <= 2), "{beyond:?}");
}

#[test]
fn the_stated_error_of_a_ramp_is_not_that_of_a_moment_without_one() {
    // At the end of this drive the motion turns around, where an error of the phase does not show.
    const ROWS: [[u8; 7]; 7] = [
        [0, 0, 1, 1, 1, 0, 1],
        [0, 1, 0, 0, 0, 0, 1],
        [1, 1, 0, 0, 1, 1, 0],
        [0, 1, 1, 1, 0, 0, 0],
        [1, 0, 1, 0, 1, 0, 0],
        [1, 0, 0, 0, 1, 1, 1],
        [1, 1, 1, 0, 1, 1, 0],
    ];
    let scene = Scene::from_text(
        "{ geometry: { side: 50 mm, thickness: 1 mm, prestretch: 2.21, cells: 7 }, material: { model: neo-hookean, \
         shear_modulus: 94903 Pa, relative_permittivity: 4.7 }, drive: { voltage: 7833 V, waveform: { ramp: { time: \
         0.00331725169794212 s } } }, effects: { inertia: { density: 953 kg/m3 } } }",
    )
    .unwrap();
    let pattern = Pattern::from_fn(Raster::new(7, 7).unwrap(), |x, y| ROWS[y][x] == 1);
    let (solver, end) = (solver_of(&scene), [0.004_738_930_997_060_172]);
    let truth = reference(&solver, &pattern, &end);
    let found = solver.history(&pattern, &HistoryRequest::at(end.to_vec())).unwrap();
    let (off, said) = (found.fields[0].max_difference(&truth[0]), found.time_error_mm.unwrap());
    assert!(
        off <= said && said <= 5e-5 * truth[0].max_magnitude(),
        "{off:e} {said:e}"
    );
}
