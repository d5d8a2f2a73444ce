//! Viscoelasticity and inertia: known results, orders of convergence, energy balances, and difficult cases. Values are
//! those of the design of time, each computed in two independent ways.

mod bodies;
mod charges;
mod coverage;
mod measured;
mod published;
mod sides;

use super::coefficients::Coefficients;
use super::*;
use crate::tests::square_of_ten;
use crate::{MembraneSolver, SolveOptions, WorkLimit};
use deaflow_field::{Field, Mesh, Outcome, Simulator};
use deaflow_pattern::{Pattern, Raster};
use deaflow_scene::Scene;

/// A sheet of one point without prestretch, with the stretch λ along both sides.
struct Sheet {
    /// κ.
    kappa: f64,
    /// Dead load.
    load: f64,
    /// G/μ.
    modulus: f64,
    /// State of the branch: A and A₃₃.
    branch: [f64; 2],
    stretch: f64,
}

impl Sheet {
    /// A sheet relaxed at a stretch.
    fn relaxed(stretch: f64, kappa: f64, load: f64) -> Self {
        Self {
            kappa,
            load,
            modulus: 2.0,
            branch: [stretch.powi(-2), stretch.powi(4)],
            stretch,
        }
    }

    /// Returns the equilibrium stretch with the branch at Ã and Ã₃₃.
    fn equilibrium(&self, [a, normal]: [f64; 2]) -> f64 {
        let g = self.modulus;
        let mut l = self.stretch;
        for _ in 0..100 {
            let force = l * (1.0 + g * a) - (1.0 + g * normal) * l.powi(-5) - self.kappa * l.powi(3) - self.load;
            let slope = 1.0 + g * a + 5.0 * (1.0 + g * normal) * l.powi(-6) - 3.0 * self.kappa * l * l;
            l -= force / slope;
        }
        l
    }

    fn step(&mut self, Coefficients { kept, before, now }: Coefficients) {
        let followed = |l: f64| [l.powi(-2), l.powi(4)];
        let old = followed(self.stretch);
        let known = [0, 1].map(|k| kept * self.branch[k] + before * old[k]);
        // The part of the branch that depends on the end of the step is a pressure.
        self.stretch = self.equilibrium(known);
        let new = followed(self.stretch);
        self.branch = [0, 1].map(|k| known[k] + now * new[k]);
    }

    /// Returns the states at these times in units of τ, with a number of steps between each two.
    fn through(mut self, times: &[f64], steps: u32) -> Vec<f64> {
        self.stretch = self.equilibrium(self.branch);
        let mut reached = vec![self.stretch];
        for pair in times.windows(2) {
            for _ in 0..steps {
                self.step(Coefficients::new((pair[1] - pair[0]) / f64::from(steps)));
            }
            reached.push(self.stretch);
        }
        reached
    }
}

const TIMES: [f64; 6] = [0.0, 0.1, 1.0, 3.0, 10.0, 60.0];

#[test]
fn free_sheets_creep_as_they_should() {
    let dead = 3.0 - 3.0_f64.powi(-5);
    let cases = [
        (
            (1.0, 0.4, 0.0),
            [
                1.025499454882,
                1.027442511865,
                1.043116203578,
                1.068843346589,
                1.108814262577,
                1.124720102189,
            ],
        ),
        (
            (3.0, 0.014, dead),
            [
                3.219087704508,
                3.235054526028,
                3.357290923013,
                3.529003997629,
                3.696388708893,
                3.715236119237,
            ],
        ),
    ];
    for ((stretch, kappa, load), known) in cases {
        // Two runs of second order are extrapolated to fourth order.
        let [coarse, fine] = [2000, 4000].map(|steps| Sheet::relaxed(stretch, kappa, load).through(&TIMES, steps));
        for ((coarse, fine), known) in coarse.iter().zip(&fine).zip(known) {
            let found = fine + (fine - coarse) / 3.0;
            assert!((found - known).abs() < 2e-11, "{found} {known}");
        }
    }
}

#[test]
fn ten_steps_have_the_values_of_their_methods() {
    let trapezoid = Sheet::relaxed(1.0, 0.4, 0.0).through(&[0.0, 1.0], 10);
    assert!((trapezoid[1] - 1.043114099346).abs() < 1e-12, "{}", trapezoid[1]);
    let mut euler = Sheet::relaxed(1.0, 0.4, 0.0);
    euler.stretch = euler.equilibrium(euler.branch);
    for _ in 0..10 {
        euler.step(Coefficients {
            kept: 1.0 / 1.1,
            before: 0.0,
            now: 0.1 / 1.1,
        });
    }
    assert!((euler.stretch - 1.042947693681).abs() < 1e-12, "{}", euler.stretch);
}

#[test]
fn a_free_sheet_pulls_in_after_the_known_time() {
    // The stretch diverges like (t* − t)^(−½): steps to given values of λ would not need this.
    let mut sheet = Sheet::relaxed(1.0, 0.6, 0.0);
    sheet.stretch = sheet.equilibrium(sheet.branch);
    let (mut time, mut step) = (0.0, 1e-3);
    while step > 1e-9 {
        let before = (sheet.stretch, sheet.branch);
        sheet.step(Coefficients::new(step));
        let Sheet {
            kappa,
            modulus,
            branch: [a, normal],
            stretch: l,
            ..
        } = sheet;
        let slope = 1.0 + modulus * a + 5.0 * (1.0 + modulus * normal) * l.powi(-6) - 3.0 * kappa * l * l;
        if slope > 0.0 && l.is_finite() && (l - before.0) < 5e-4 {
            time += step;
        } else {
            (sheet.stretch, sheet.branch) = before;
            step *= 0.5;
        }
    }
    assert!((time - 9.8214016436).abs() < 1e-4, "{time}");
    // It converges like the root of the remaining time.
    assert!((sheet.stretch - 1.6002786673).abs() < 4e-3, "{}", sheet.stretch);
}

fn scene(text: &str) -> Scene {
    Scene::from_text(&format!("{{ {MATERIAL}, {text} }}")).unwrap()
}

const MATERIAL: &str = "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }";
const SQUARE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }";
const ONE: &str = "effects: { viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 s }] } }";
const LAWS: [&str; 2] = ["linear", "finite"];

/// Branches of a law.
fn of_law(law: &str, branches: &str) -> String {
    format!("effects: {{ viscoelasticity: {{ law: {law}, branches: [{branches}] }} }}")
}

/// The branch of [`ONE`].
fn one(law: &str) -> String {
    of_law(law, "{ modulus: 45 kPa, time: 1 s }")
}

/// A pattern without symmetry.
fn odd(raster: Raster) -> Pattern {
    Pattern::from_fn(raster, |x, y| (x * x + 3 * y + x * y) % 7 < 3 || (x > 5 && y < 4))
}

fn ten() -> Raster {
    Raster::new(10, 10).unwrap()
}

fn history(scene: &Scene, pattern: &Pattern, mesh: Mesh, times: &[f64]) -> History {
    let request = HistoryRequest::at(times.to_vec());
    let solver = MembraneSolver::new(scene, SolveOptions { mesh, tolerance: 1e-11 }).unwrap();
    solver.history(pattern, &request).unwrap()
}

#[test]
fn a_long_strip_creeps_as_it_should() {
    let pattern = Pattern::from_fn(Raster::new(4, 32).unwrap(), |x, _| x < 2);
    let cases = [
        (
            "linear",
            &[(0.0, 2.136_424_524), (1.0, 2.658_487_333), (60.0, 3.223_187_347)][..],
        ),
        ("finite", &[(0.0, 2.136_424_524), (1.0, 2.662_271_47)]),
    ];
    for (law, known) in cases {
        let scene = scene(&format!(
            "geometry: {{ size: [50 mm, 400 mm], thickness: 1 mm, prestretch: 3, cells: [4, 32] }}, drive: {{ voltage: \
             5250 V }}, {}",
            one(law)
        ));
        let times: Vec<f64> = known.iter().map(|(time, _)| *time).collect();
        let found = history(&scene, &pattern, Mesh::bilinear(2), &times);
        assert_eq!(found.fields.len(), known.len(), "{law}");
        for (field, (time, known)) in found.fields.iter().zip(known) {
            let [along, _] = field.at_corner(2, 16);
            assert!((along / known - 1.0).abs() < 3e-5, "{law}, {time} s: {along} {known}");
        }
        let error = found.time_error_mm.unwrap();
        assert!(error < 1e-4, "{error}");
    }
}

#[test]
fn a_relaxed_membrane_is_the_static_one_and_branches_without_modulus_are_none() {
    let fields = |effects: &str, times: &[f64]| {
        let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 5 kV }}, {effects}"));
        let found = history(&scene, &odd(ten()), Mesh::bilinear(1), times);
        found.fields
    };
    let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 5 kV }}, effects: {{}}"));
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-11,
    };
    let still = MembraneSolver::new(&scene, options)
        .unwrap()
        .simulate(&[odd(ten())])
        .remove(0)
        .field
        .unwrap();
    for field in fields("effects: {}", &[0.0, 2.0]) {
        assert!(field.max_difference(&still) < 1e-10);
    }
    for law in LAWS {
        let late = fields(&one(law), &[1e4]);
        let difference = late[0].max_difference(&still);
        assert!(difference < 1e-7, "{law}: {difference}");
        for field in fields(&of_law(law, "{ modulus: 0 Pa, time: 1 s }"), &[0.0, 1.0]) {
            assert!(field.max_difference(&still) < 1e-10);
        }
        // Twelve decades of relaxation times: short ones have relaxed, long ones are springs.
        let many: Vec<String> = (-6..=6)
            .map(|k| format!("{{ modulus: 3 kPa, time: 1e{k} s }}"))
            .collect();
        let decades = fields(&of_law(law, &many.join(", ")), &[0.0, 1e-3, 1.0, 1e3, 1e9]);
        let sizes: Vec<f64> = decades.iter().map(Field::max_magnitude).collect();
        assert!(
            sizes.windows(2).all(|pair| pair[1] > 1.02 * pair[0]),
            "{law}: {sizes:?}"
        );
        assert!(decades[4].max_difference(&still) < 2e-4 * sizes[4]);
    }
}

#[test]
fn errors_in_time_fall_with_the_square_of_the_step_and_are_estimated() {
    for law in LAWS {
        let scene = scene(&format!(
            "{SQUARE}, drive: {{ voltage: 5 kV, waveform: {{ ramp: {{ time: 0.7 s }} }} }}, {}",
            one(law)
        ));
        let solver = MembraneSolver::new(
            &scene,
            SolveOptions {
                mesh: Mesh::bilinear(1),
                tolerance: 1e-11,
            },
        )
        .unwrap();
        let at = |accuracy_mm: f64| {
            let request = HistoryRequest {
                times: vec![0.3, 0.7, 2.0],
                accuracy_mm: Some(accuracy_mm),
                ..HistoryRequest::at(Vec::new())
            };
            solver.history(&odd(ten()), &request).unwrap()
        };
        let truth = at(1e-8);
        for accuracy in [1e-3, 1e-4, 1e-5] {
            let found = at(accuracy);
            let error = found.difference(&truth);
            assert!(found.time_error_mm.unwrap() <= accuracy);
            assert!(
                error <= 1.5 * found.time_error_mm.unwrap() + 2e-8
                    && found.time_error_mm.unwrap() <= 3.0 * error + 2e-8,
                "{law}, {accuracy}: {error:e} {:e}",
                found.time_error_mm.unwrap()
            );
            let last = found.instants.last().unwrap();
            let open = last.stored + last.electric + last.dissipated - last.supplied;
            assert!(
                open.abs() < 30.0 * accuracy * last.supplied,
                "{law}: {open:e} of {:e}",
                last.supplied
            );
            assert!(
                found
                    .instants
                    .windows(2)
                    .all(|pair| pair[1].dissipated >= pair[0].dissipated - 1e-12 * last.supplied),
                "{law}"
            );
        }
    }
}

#[test]
fn passes_are_extrapolated_where_the_solution_is_smooth() {
    // A jump in between, and electrodes that charge slowly: times with separate instants in each pass, and states found
    // by iteration.
    let drives = [
        "waveform: { table: voltages.csv }",
        "voltage: 5 kV, source: { resistance: 1 GOhm }",
    ];
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("voltages.csv"),
        "t_s,voltage_V\n0,5000\n0.5,5000\n0.5,3000\n",
    )
    .unwrap();
    for drive in drives {
        let file = folder.path().join("scene.yaml");
        std::fs::write(
            &file,
            format!("{{ {MATERIAL}, {SQUARE}, drive: {{ {drive} }}, {} }}", one("linear")),
        )
        .unwrap();
        let scene = Scene::load(&file).unwrap();
        let options = SolveOptions {
            mesh: Mesh::bilinear(1),
            tolerance: 1e-11,
        };
        let solver = MembraneSolver::new(&scene, options).unwrap();
        let at = |accuracy_mm: f64| {
            let request = HistoryRequest {
                accuracy_mm: Some(accuracy_mm),
                ..HistoryRequest::at(vec![0.0, 0.2, 0.5, 1.0])
            };
            solver.history(&odd(ten()), &request).unwrap()
        };
        let (found, truth) = (at(1e-5), at(3e-8));
        assert!(
            found.difference(&truth) <= 1e-5,
            "{drive}: {:e}",
            found.difference(&truth)
        );
        // For three or four passes.
        assert!(found.steps < 300, "{drive}: {}", found.steps);
        assert_eq!(found.watched, truth.watched);
        for (instant, field) in found.asked().zip(&found.fields) {
            assert_eq!(instant.largest, field.max_magnitude());
        }
        for (one, other) in found.asked().zip(truth.asked()) {
            assert!((one.watched - other.watched).abs() < 1e-5);
            assert!(
                (one.charge - other.charge).abs() < 2e-5 * truth.instants.last().unwrap().charge,
                "{drive}"
            );
            let open = one.stored + one.electric + one.dissipated - one.supplied;
            assert!(
                open.abs() < 1e-4 * truth.instants.last().unwrap().supplied,
                "{drive}: {open:e}"
            );
        }
        // At all instants, including those between two of the coarser pass.
        let peak = found.instants.iter().map(|now| now.charge).fold(0.0, f64::max);
        for pair in found.instants.windows(2) {
            assert!(
                pair[1].time > pair[0].time || pair[1].voltage != pair[0].voltage,
                "{drive}"
            );
            let step = (pair[1].charge - pair[0].charge).abs();
            assert!(step < 0.5 * peak, "{drive}: {step:e}");
        }
    }
}

#[test]
fn prestretch_that_has_not_relaxed_makes_a_membrane_stiffer() {
    for law in LAWS {
        let size = |rest: &str| {
            let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 5 kV{rest} }}, {}", one(law)));
            let found = history(&scene, &odd(ten()), Mesh::bilinear(1), &[0.0, 50.0]);
            found.fields.iter().map(Field::max_magnitude).collect::<Vec<_>>()
        };
        let (relaxed, fresh, late) = (size(""), size(", rest: 0 s"), size(", rest: 1 min"));
        // At the start G λp² acts in addition to μ λp²: twice the final stiffness, to which a relaxed branch adds a
        // ninth.
        assert!(
            fresh[0] < 0.75 * relaxed[0] && (fresh[1] / relaxed[1] - 1.0).abs() < 1e-6,
            "{law}: {fresh:?} {relaxed:?}"
        );
        assert!((late[0] / relaxed[0] - 1.0).abs() < 1e-9);
    }
}

#[test]
fn pull_in_is_delayed_and_bracketed() {
    let half = Pattern::from_fn(ten(), |x, _| x < 5);
    for law in LAWS {
        let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 7.6 kV }}, {}", one(law)));
        let found = history(&scene, &half, Mesh::bilinear(1), &[0.0, 0.5, 100.0]);
        let Outcome::DelayedPullIn {
            last_stable,
            first_unstable,
        } = found.outcome
        else {
            panic!("{law}: {}", found.outcome);
        };
        assert!(
            last_stable > 0.5 && first_unstable < 100.0,
            "{law}: {last_stable} {first_unstable}"
        );
        assert!(
            first_unstable - last_stable < 1e-3 * first_unstable,
            "{law}: {last_stable} {first_unstable}"
        );
        assert_eq!(found.asked().count(), 2, "there is nothing after it");
    }
    let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 7.6 kV }}, {ONE}"));
    // A load that is unstable at the start does not depend on time.
    let at_once = history(&scene.at_voltage(12e3), &half, Mesh::bilinear(1), &[0.0, 1.0]);
    assert!(
        matches!(at_once.outcome, Outcome::PullIn { .. } | Outcome::NotElliptic { .. }),
        "{}",
        at_once.outcome
    );
    assert_eq!(at_once.asked().count(), 0);
}

#[test]
fn a_voltage_that_jumps_down_lets_the_membrane_creep_back() {
    let scene = scene(&format!(
        "{SQUARE}, drive: {{ waveform: {{ table: [[0 s, 5 kV], [1 s, 5 kV], [1 s, 0 V], [9 s, 0 V]] }} }}, {ONE}"
    ));
    assert_eq!(scene.voltage_v(), 5e3);
    let found = history(&scene, &odd(ten()), Mesh::bilinear(1), &[0.0, 0.999, 1.0, 60.0]);
    let sizes: Vec<f64> = found.fields.iter().map(Field::max_magnitude).collect();
    // Part of the strain is that of the branch, and remains for a while.
    assert!(
        sizes[1] > sizes[0] && sizes[2] > 0.05 * sizes[1] && sizes[2] < 0.5 * sizes[1],
        "{sizes:?}"
    );
    assert!(sizes[3] < 1e-6 * sizes[1]);
}

#[test]
fn the_lowest_modes_are_those_of_the_square() {
    let still = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }, drive: { voltage: 0 V }, \
                 properties: { density: 960 }";
    let bare = Pattern::from_fn(Raster::PAPER, |_, _| false);
    let solver = MembraneSolver::new(&scene(still), SolveOptions::on(Mesh::bilinear(1))).unwrap();
    for (lumped, first, third) in [(false, 290.8201495, 459.5889078), (true, 290.6288603, 458.8335354)] {
        let found = solver.vibration(&bare, 3, lumped).unwrap();
        let [a, b, c] = found.frequencies[..] else {
            panic!("three were asked for");
        };
        for (found, known) in [(a, first), (b, first), (c, third)] {
            assert!((found / known - 1.0).abs() < 2e-9, "{found} {known}");
        }
        assert!(
            found
                .modes
                .iter()
                .all(|mode| (mode.max_magnitude() - 1.0).abs() < 1e-12)
        );
    }
    let fine = MembraneSolver::new(&scene(still), SolveOptions::on(Mesh::biquadratic(1))).unwrap();
    let found = fine.vibration(&bare, 2, false).unwrap();
    assert!(
        found
            .frequencies
            .iter()
            .all(|hertz| (hertz / 290.7723166 - 1.0).abs() < 1e-7),
        "{:?}",
        found.frequencies
    );
}

const MOVING: &str = "properties: { density: 960 }, effects: { inertia: {} }";

#[test]
fn motion_keeps_its_energy_and_is_of_second_order() {
    let scene = scene(&format!(
        "{SQUARE}, drive: {{ voltage: 4 kV, waveform: {{ ramp: {{ time: 5 ms }} }} }}, {MOVING}"
    ));
    let solver = MembraneSolver::new(
        &scene,
        SolveOptions {
            mesh: Mesh::bilinear(1),
            tolerance: 1e-11,
        },
    )
    .unwrap();
    let at = |accuracy_mm: f64| {
        let request = HistoryRequest {
            times: vec![0.0, 2e-3, 5e-3, 10e-3],
            accuracy_mm: Some(accuracy_mm),
            ..HistoryRequest::at(Vec::new())
        };
        solver.history(&odd(ten()), &request).unwrap()
    };
    let truth = at(1e-6);
    for accuracy in [1e-3, 1e-4] {
        let found = at(accuracy);
        let error = found.difference(&truth);
        assert!(
            error <= found.time_error_mm.unwrap() + 2e-7 && found.time_error_mm.unwrap() <= accuracy,
            "{error:e} {:e}",
            found.time_error_mm.unwrap()
        );
        let largest = found.instants.iter().map(|instant| instant.kinetic).fold(0.0, f64::max);
        assert!(largest > 0.0);
        for instant in &found.instants {
            let open = instant.stored + instant.electric + instant.kinetic + instant.dissipated - instant.supplied;
            assert!(
                open.abs() < 1e-8 * (instant.supplied.abs() + largest),
                "{}: {open:e}",
                instant.time
            );
        }
    }
}

#[test]
fn errors_of_a_motion_are_told_however_many_times_are_asked_for() {
    let scene = scene(&format!(
        "{SQUARE}, drive: {{ voltage: 4 kV, waveform: {{ ramp: {{ time: 5 ms }} }} }}, {MOVING}"
    ));
    let times = |count: u32| {
        (0..=count)
            .map(|k| 6e-3 * f64::from(k) / f64::from(count))
            .collect::<Vec<_>>()
    };
    let [few, many] = [2, 120].map(|count| history(&scene, &odd(ten()), Mesh::bilinear(1), &times(count)));
    let [error, other] = [&few, &many].map(|found| found.time_error_mm.unwrap());
    let apart = few.fields[2].max_difference(&many.fields[120]);
    assert!(error > 0.0 && other > 0.0, "{error:e} {other:e}");
    assert!(apart <= error + other, "{apart:e} {error:e} {other:e}");
    let fast = scene_at_kilohertz();
    let solver = MembraneSolver::new(&fast, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let request = HistoryRequest::at(vec![3600.0]);
    let refused = solver.history(&odd(ten()), &request).unwrap_err();
    assert!(refused.to_string().contains("Request a shorter time"), "{refused}");
}

fn scene_at_kilohertz() -> Scene {
    scene(&format!(
        "{SQUARE}, drive: {{ voltage: 4 kV, waveform: {{ sine: {{ frequency: 1 kHz }} }} }}, {ONE}"
    ))
}

#[test]
fn a_history_ends_where_its_work_is_done() {
    let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 5 kV }}, {ONE}"));
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let request = HistoryRequest::at(vec![0.0, 1.0, 10.0]);
    let short = HistoryRequest {
        limit: WorkLimit::of_seconds(0.02),
        ..request
    };
    let found = solver.history(&odd(ten()), &short).unwrap();
    assert_eq!(found.outcome, Outcome::WorkLimit);
    assert_eq!(found.time_error_mm, None);
}

#[test]
fn a_motion_that_ends_at_its_work_limit_has_what_its_passes_reached() {
    let scene = scene(&format!(
        "{SQUARE}, drive: {{ voltage: 4 kV, waveform: {{ ramp: {{ time: 5 ms }} }} }}, \
         properties: {{ density: 960 }}, effects: {{ inertia: {{}} }}"
    ));
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let times = vec![1e-3, 5e-3, 0.02];
    let whole = solver.history(&odd(ten()), &HistoryRequest::at(times.clone())).unwrap();
    assert_eq!((whole.outcome, whole.fields.len()), (Outcome::Converged, 3));
    // Less work ends the second pass, or the first one.
    let mut reached = Vec::new();
    for seconds in [1.0, 0.5, 0.2] {
        let request = HistoryRequest {
            limit: WorkLimit::of_seconds(seconds),
            ..HistoryRequest::at(times.clone())
        };
        let found = solver.history(&odd(ten()), &request).unwrap();
        if found.outcome == Outcome::WorkLimit {
            assert_eq!(found.time_error_mm, None);
            assert_eq!(found.fields.len(), found.kept.len());
            // The steps of the pass, not those of one that had no work left.
            assert!(found.instants.len() > 2, "{}", found.instants.len());
            reached.push(found.fields.len());
        }
    }
    assert!(reached.len() >= 2 && reached.is_sorted_by(|a, b| a >= b), "{reached:?}");
    assert!(reached[0] >= 1, "{reached:?}");
}

#[test]
fn viscous_motion_comes_to_rest_with_its_energy_in_balance() {
    for law in LAWS {
        let scene = scene(&format!(
            "{SQUARE}, drive: {{ voltage: 4 kV, waveform: {{ ramp: {{ time: 5 ms }} }} }}, \
             properties: {{ density: 960 }}, effects: {{ inertia: {{}}, viscoelasticity: {{ law: {law}, \
             branches: [{{ modulus: 45 kPa, time: 1 ms }}] }} }}"
        ));
        let request = HistoryRequest {
            times: vec![0.06],
            accuracy_mm: Some(1e-2),
            ..HistoryRequest::at(Vec::new())
        };
        let solver = MembraneSolver::new(
            &scene,
            SolveOptions {
                mesh: Mesh::bilinear(1),
                tolerance: 1e-11,
            },
        )
        .unwrap();
        let found = solver.history(&odd(ten()), &request).unwrap();
        let still = solver.simulate(&[odd(ten())]).remove(0).field.unwrap();
        let last = found.instants.last().unwrap();
        let field = found.fields.last().unwrap();
        assert!(field.max_difference(&still) < 1e-3 * still.max_magnitude());
        for pair in found.instants.windows(2) {
            assert!(pair[1].dissipated >= pair[0].dissipated - 1e-12 * last.supplied);
            let open = pair[1].stored + pair[1].electric + pair[1].kinetic + pair[1].dissipated - pair[1].supplied;
            assert!(
                open.abs() < 1e-8 * last.supplied,
                "{law}: {open:e} of {:e}",
                last.supplied
            );
        }
    }
}

#[test]
fn too_much_voltage_at_once_is_a_dynamic_pull_in() {
    let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 9 kV }}, {MOVING}"));
    let half = Pattern::from_fn(ten(), |x, _| x < 5);
    let request = HistoryRequest {
        times: vec![0.0, 1.0],
        accuracy_mm: Some(0.1),
        ..HistoryRequest::at(Vec::new())
    };
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let found = solver.history(&half, &request).unwrap();
    assert!(
        matches!(found.outcome, Outcome::DelayedPullIn { .. }),
        "{}",
        found.outcome
    );
    assert_eq!(found.asked().count(), 1);
}

#[test]
fn a_source_charges_a_membrane_that_cannot_move_as_a_capacitor() {
    // The whole membrane is active: nothing moves, and V(t) = V(1 − e^(−t/RC)) with C = ελp²A/H.
    let with = |source: &str| {
        scene(&format!(
            "{SQUARE}, drive: {{ voltage: 4 kV, source: {{ {source} }} }}, {ONE}"
        ))
    };
    let all = Pattern::from_fn(ten(), |_, _| true);
    let slow = with("resistance: 1 GOhm");
    let capacitance = slow.permittivity() * (50e-3_f64).powi(2) / (1e-3 * slow.prestretched_thickness_mm());
    let rc = 1e9 * capacitance;
    let times = [0.5 * rc, rc, 4.0 * rc];
    let found = history(&slow, &all, Mesh::bilinear(1), &times);
    for (instant, time) in found.asked().zip(times) {
        let exact = 4e3 * (1.0 - (-time / rc).exp());
        assert!(
            (instant.voltage / exact - 1.0).abs() < 1e-8,
            "{} {exact}",
            instant.voltage
        );
        let open = instant.stored + instant.electric + instant.dissipated - instant.supplied;
        assert!(
            open.abs() < 1e-8 * instant.supplied,
            "{open:e} of {:e}",
            instant.supplied
        );
    }
    // A limited current charges evenly; with no current the membrane does not move.
    let limited = history(&with("current_limit: 1 nA"), &all, Mesh::bilinear(1), &[1.0]);
    let volts = limited.asked().next().unwrap().voltage;
    assert!((volts / (1e-9 / capacitance) - 1.0).abs() < 1e-8, "{volts}");
    let never = history(
        &with("resistance: 1e18 Ohm"),
        &odd(ten()),
        Mesh::bilinear(1),
        &[0.0, 1.0],
    );
    assert!(never.outcome.is_converged() && never.fields[1].max_magnitude() < 1e-9);
}

#[test]
fn a_membrane_behind_a_source_comes_to_the_equilibrium_at_its_voltage() {
    let free = scene(&format!("{SQUARE}, drive: {{ voltage: 5 kV }}, {ONE}"));
    let fed = scene(&format!(
        "{SQUARE}, drive: {{ voltage: 5 kV, source: {{ resistance: 1 GOhm }} }}, {ONE}"
    ));
    let times = [0.1, 1.0, 200.0];
    let [at_once, late] = [&free, &fed].map(|scene| history(scene, &odd(ten()), Mesh::bilinear(1), &times));
    assert!(late.fields[0].max_magnitude() < 0.9 * at_once.fields[0].max_magnitude());
    assert!(late.fields[2].max_difference(&at_once.fields[2]) < 1e-5 * at_once.fields[2].max_magnitude());
    let last = late.instants.last().unwrap();
    let open = last.stored + last.electric + last.dissipated - last.supplied;
    assert!(open.abs() < 1e-3 * last.supplied, "{open:e} of {:e}", last.supplied);
    assert!(last.dissipated > 0.0);
    // A source without resistance has no effect.
    let none = scene(&format!(
        "{SQUARE}, drive: {{ voltage: 5 kV, source: {{ resistance: 0 Ohm }} }}, {ONE}"
    ));
    assert_eq!(
        history(&none, &odd(ten()), Mesh::bilinear(1), &times).fields,
        at_once.fields
    );
}

#[test]
fn electrodes_that_are_cut_off_keep_their_charge_while_the_membrane_creeps() {
    for (charge, law) in [
        ("total: 0.6 uC", "linear"),
        ("total: 0.6 uC", "finite"),
        ("immobile: 0.6 uC", "linear"),
        ("immobile: 0.6 uC", "finite"),
    ] {
        let effects = format!(
            "viscoelasticity: {{ law: {law}, branches: [{{ modulus: 60 kPa, time: 1 s }}, \
             {{ modulus: 30 kPa, time: 10 s }}] }}"
        );
        let scene = square_of_ten(&format!("charge: {{ {charge} }}"), &effects, "");
        let pattern = Pattern::from_fn(ten(), |x, y| (x * 7 + y * 3) % 5 < 2);
        let mesh = Mesh::bilinear(1);
        let options = HistoryOptions {
            mesh: Some(mesh),
            tolerance: 1e-10,
        };
        let request = HistoryRequest::at(vec![0.0, 1.0, 10.0, 1e5]);
        let history = HistorySolver::new(&scene, &options, request).unwrap();
        let history = history.follow(&pattern).unwrap().history;
        assert_eq!(history.outcome, Outcome::Converged);
        let still = |gamma: f64| {
            let options = SolveOptions { mesh, tolerance: 1e-10 };
            let solver = MembraneSolver::with_unrelaxed(&scene, gamma, options).unwrap();
            solver.simulate(std::slice::from_ref(&pattern)).remove(0).field.unwrap()
        };
        // At the start branches have no time to relax, and at the end they are relaxed.
        let all = 90e3 / (45e3 * 9.0);
        let size = history.fields[3].max_magnitude();
        for (at, gamma) in [(0, all), (3, 0.0)] {
            let difference = history.fields[at].max_difference(&still(gamma));
            // The finite law has the same start and end of creep as the linear law.
            assert!(difference < 2e-6 * size, "{charge} {law}: {difference:e}");
        }
        let sizes: Vec<f64> = history.fields.iter().map(Field::max_magnitude).collect();
        assert!(sizes.windows(2).all(|pair| pair[0] < pair[1]), "{sizes:?}");
        let (first, last) = (&history.instants[0], history.instants.last().unwrap());
        assert!(first.voltage > 1.001 * last.voltage && last.voltage > 0.0);
        for now in &history.instants {
            assert!((now.charge / 0.6e-6 - 1.0).abs() < 1e-8, "{charge}: {:e}", now.charge);
            assert!((0.5 * now.charge * now.voltage / now.electric - 1.0).abs() < 1e-12);
            let balance = now.stored + now.electric + now.dissipated - now.supplied;
            assert!(
                balance.abs() < 1e-4 * now.supplied,
                "{charge} {law} {}: {balance:e}",
                now.time
            );
            assert!((now.supplied / first.supplied - 1.0).abs() < 1e-8);
        }
    }
}

#[test]
fn a_charge_is_held_on_what_cannot_bear_its_voltage() {
    // Past the fold the voltage of a conducting electrode falls while its charge rises; with sprayed charge the
    // membrane is always stable.
    let scene = |charge: &str| {
        let effects = "viscoelasticity: { branches: [{ modulus: 20 kPa, time: 1 s }] }";
        square_of_ten(&format!("charge: {{ {charge} }}"), effects, "")
    };
    let pattern = Pattern::from_fn(ten(), |x, _| x < 5);
    let ends = ["total: 14 uC", "immobile: 14 uC"].map(|charge| {
        let options = HistoryOptions {
            mesh: Some(Mesh::bilinear(1)),
            tolerance: 1e-9,
        };
        let request = HistoryRequest::at(vec![0.0, 100.0]);
        let history = HistorySolver::new(&scene(charge), &options, request).unwrap();
        history.follow(&pattern).unwrap().history
    });
    assert!(
        matches!(
            ends[0].outcome,
            Outcome::DelayedPullIn { .. } | Outcome::PullIn { .. } | Outcome::NotElliptic { .. }
        ),
        "{:?}",
        ends[0].outcome
    );
    assert_eq!(ends[1].outcome, Outcome::Converged);
    // Without electrodes there is no charge.
    for charge in ["total: 2 uC", "immobile: 2 uC"] {
        let solver = MembraneSolver::new(&scene(charge), SolveOptions::default()).unwrap();
        let bare = Pattern::from_fn(ten(), |_, _| false);
        let history = solver.history(&bare, &HistoryRequest::at(vec![0.0, 3.0])).unwrap();
        assert_eq!(history.outcome, Outcome::Converged);
        assert_eq!(history.fields[1], Field::zero(ten()));
        assert!(
            history
                .instants
                .iter()
                .all(|now| now.charge == 0.0 && now.electric == 0.0)
        );
    }
}

fn follow(scene: &Scene, pattern: &Pattern, times: Vec<f64>) -> History {
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-8,
    };
    let solver = MembraneSolver::new(scene, options).unwrap();
    solver.history(pattern, &HistoryRequest::at(times)).unwrap()
}

#[test]
fn a_motion_from_rest_is_the_same_under_laws_that_change_nothing() {
    // The mean force of a short step is a small difference, free of rounding of energies.
    let drive = "voltage: 3 kV, waveform: { ramp: { time: 0.02 s } }";
    let inertia = "inertia: { density: 960 kg/m3 }";
    let half = Pattern::from_fn(ten(), |x, _| x < 5);
    let plain = follow(&square_of_ten(drive, inertia, ""), &half, vec![0.02]);
    assert_eq!(plain.outcome, Outcome::Converged);
    for effect in [
        "stretch_dependent_permittivity: { exponent: 0 }",
        "strain_stiffening: { model: gent, jm: 1e12 }",
    ] {
        let found = follow(
            &square_of_ten(drive, &format!("{inertia}, {effect}"), ""),
            &half,
            vec![0.02],
        );
        assert_eq!(found.outcome, Outcome::Converged, "{effect}");
        let difference = found.fields[0].max_difference(&plain.fields[0]);
        assert!(
            difference < 1e-6 * plain.fields[0].max_magnitude(),
            "{effect}: {difference:e}"
        );
    }
    let gent = format!("{inertia}, strain_stiffening: {{ model: gent, jm: 60 }}");
    let stiff = follow(&square_of_ten(drive, &gent, ""), &half, vec![0.02]);
    assert_eq!(stiff.outcome, Outcome::Converged);
    let last = stiff.instants.last().unwrap();
    let balance = last.stored + last.electric + last.kinetic + last.dissipated - last.supplied;
    assert!(balance.abs() < 1e-8 * last.supplied, "{balance:e}");
}

#[test]
fn electrodes_over_all_of_a_membrane_charge_without_moving_it_in_the_end() {
    let resistance = "electrode_resistance: { sheet_resistance: 1 MOhm }";
    let full = Pattern::from_fn(ten(), |_, _| true);
    for volts in ["10 V", "3 kV"] {
        let scene = square_of_ten(&format!("voltage: {volts}"), resistance, ", leads: [left]");
        let history = follow(&scene, &full, vec![0.001, 0.05, 1.0]);
        assert_eq!(history.outcome, Outcome::Converged, "{volts}");
        assert!(history.fields[2].max_magnitude() < 1e-9);
        let last = history.instants.last().unwrap();
        assert!((last.voltage / scene.voltage_v() - 1.0).abs() < 1e-9);
    }
}

#[test]
fn loads_and_springs_of_bodies_are_in_the_balance_of_energies() {
    let scene = |body: &str| {
        Scene::from_text(&format!(
            "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10, \
             bodies: [{{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]]{body} }}] }}, material: {{ model: neo-hookean, \
             shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: 3 kV }}, \
             effects: {{ viscoelasticity: {{ branches: [{{ modulus: 45 kPa, time: 1 s }}] }} }} }}"
        ))
        .unwrap()
    };
    let half = Pattern::from_fn(ten(), |x, y| x < 5 && !((4..6).contains(&x) && (4..6).contains(&y)));
    for body in [
        "",
        ", load: [0.01 N, 0 N]",
        ", spring: 100 N/m",
        ", load: [0.02 N, -0.01 N], spring: 30 N/m",
    ] {
        let history = follow(&scene(body), &half, vec![0.0, 1.0, 100.0]);
        for now in history.asked() {
            let balance = now.stored + now.electric + now.dissipated - now.supplied;
            assert!(
                balance.abs() < 1e-6 * now.supplied.abs(),
                "{body} {}: {balance:e}",
                now.time
            );
        }
    }
}

#[test]
fn charges_are_in_proportion_to_voltages_however_low() {
    let scene = square_of_ten("voltage: 3 kV, source: { resistance: 1000 GOhm }", "", "");
    let half = Pattern::from_fn(ten(), |x, _| x < 5);
    let history = follow(&scene, &half, vec![1e-6, 1e-3, 1.0]);
    let ratios: Vec<f64> = history.asked().map(|now| now.charge / now.voltage).collect();
    assert!(
        ratios.iter().all(|ratio| (ratio / ratios[0] - 1.0).abs() < 1e-6),
        "{ratios:?}"
    );
}
