//! Measured waveforms: tables of many rows, whose rows need not be steps.

use std::cell::Cell;
use std::f64::consts::TAU;

use super::*;
use crate::effects::WithMaterial;
use crate::mass::Mass;
use crate::material::Material;
use crate::operator::Activity;
use crate::precondition::Laplacian;
use crate::time::leads::Conductor;
use crate::time::modes::wave_speed;
use crate::time::motion::Motion;
use crate::time::pass::{Pass, PassEnd, Steps};
use crate::time::supply::Supply;
use crate::time::transient::{TransientProblem, knots};

const SMOOTH: &str = "sine: { frequency: 125 Hz }";

/// Returns a scene whose voltage in units of 5250 V is a table of a number of rows over a time in s.
fn tabled(scene: &str, rows: u32, seconds: f64, volts: impl Fn(f64) -> f64) -> Scene {
    let time = |at: u32| seconds * f64::from(at) / f64::from(rows);
    of_rows(scene, (0..=rows).map(time).map(|time| [time, volts(time)]))
}

/// Returns a scene with rows of times in s and voltages in units of 5250 V.
fn of_rows(scene: &str, rows: impl Iterator<Item = [f64; 2]>) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let row = |[time, volts]: [f64; 2]| format!("{time:.12},{:.12}\n", 5250.0 * volts);
    let text: String = rows.map(row).collect();
    std::fs::write(folder.path().join("table.csv"), format!("t_s,voltage_V\n{text}")).unwrap();
    let file = folder.path().join("scene.yaml");
    std::fs::write(&file, scene.replace("WAVEFORM", "table: table.csv")).unwrap();
    Scene::load(&file).unwrap()
}

/// A scene whose waveform is to be filled in, and whose time scale is in s.
fn text(source: &str, effects: &str, more: &str) -> String {
    format!(
        "{{ {MATERIAL}, {SQUARE}, drive: {{ voltage: 5250 V, waveform: {{ WAVEFORM }}{source} }}, effects: {{ {effects} \
         }}{more} }}"
    )
}

/// Scenes with the time scale of their drive.
fn scenes() -> [(&'static str, String, f64); 6] {
    let branch = "viscoelasticity: { branches: [{ modulus: 45 kPa, time: TAU }] }";
    let creep = |tau: &str| branch.replace("TAU", tau);
    let inertia = "inertia: { density: 960 kg/m3 }";
    [
        ("creep", text("", &creep("1 s"), ""), 1.0),
        (
            "finite creep",
            text("", &creep("1 s").replace("{ branches", "{ law: finite, branches"), ""),
            1.0,
        ),
        (
            "source",
            text(", source: { resistance: 50 MOhm }", &creep("1 s"), ""),
            1.0,
        ),
        (
            "leads",
            text(
                "",
                "electrode_resistance: { sheet_resistance: 20 MOhm }",
                ", leads: [left, right, top, bottom]",
            ),
            1.0,
        ),
        ("inertia", text("", inertia, ""), 2e-3),
        (
            "inertia behind a source",
            text(", source: { resistance: 100 kOhm }", inertia, ""),
            2e-3,
        ),
    ]
}

fn half() -> Pattern {
    Pattern::from_fn(ten(), |x, _| x < 5)
}

#[test]
fn a_smooth_drive_costs_the_same_whether_it_is_a_formula_or_a_table() {
    for (name, text, scale) in scenes() {
        let frequency = 0.25 / scale;
        let smooth = text.replace("WAVEFORM", &format!("sine: {{ frequency: {frequency} Hz }}"));
        let smooth = Scene::from_text(&smooth).unwrap();
        let times = [0.5 * scale, scale];
        let formula = history(&smooth, &half(), Mesh::bilinear(1), &times);
        let size = formula.fields[1].max_magnitude();
        for rows in [400, 10_000] {
            let scene = tabled(&text, rows, scale, |time| (TAU * frequency * time).sin());
            let table = history(&scene, &half(), Mesh::bilinear(1), &times);
            assert_eq!(table.outcome, Outcome::Converged, "{name} {rows}");
            assert!(
                table.steps <= 2 * formula.steps && table.newton_steps <= 2 * formula.newton_steps,
                "{name} {rows}: {} {} steps, {} {} iterations",
                table.steps,
                formula.steps,
                table.newton_steps,
                formula.newton_steps
            );
            // Chords of the sine are lower by an eighth of the square of their angle.
            let chord = 0.25 * (TAU * 0.25 / f64::from(rows)).powi(2) * size;
            let allowed = table.time_error_mm.unwrap() + formula.time_error_mm.unwrap() + 2.0 * chord;
            let off = table.difference(&formula);
            assert!(
                off <= allowed && off < 1e-4 * size,
                "{name} {rows}: {off:e} {allowed:e} of {size:e}"
            );
        }
    }
}

#[test]
fn the_motion_of_a_measured_waveform_is_that_of_its_smooth_drive() {
    // 401 rows of a quarter of a sine over 2 ms; the centre of the membrane at its end, from the smooth drive.
    let geometry = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }";
    let text = text("", "inertia: { density: 960 kg/m3 }", "").replace(SQUARE, geometry);
    let scene = tabled(&text, 400, 2e-3, |time| (TAU * 125.0 * time).sin());
    let half = Pattern::from_fn(Raster::PAPER, |x, _| x < 25);
    let found = history(&scene, &half, Mesh::bilinear(1), &[2e-3]);
    let [along, _] = found.fields[0].at_corner(25, 25);
    assert!((along - 2.36369).abs() < 4e-5, "{along}");
    let smooth = Scene::from_text(&text.replace("WAVEFORM", SMOOTH)).unwrap();
    let formula = history(&smooth, &half, Mesh::bilinear(1), &[2e-3]);
    assert!(found.steps <= 2 * formula.steps, "{} {}", found.steps, formula.steps);
    // The chords of the sine are lower by 1.3e-6 in the mean.
    let allowed = found.time_error_mm.unwrap() + formula.time_error_mm.unwrap() + 2e-5;
    assert!(found.difference(&formula) <= allowed);
}

#[test]
fn steps_do_not_pass_over_a_pulse_of_many_rows() {
    // A smooth pulse of a hundredth of the time, long after the start.
    let pulse = |time: f64| match (time - 0.7) / 0.01 {
        place if (0.0..=1.0).contains(&place) => (0.5 * TAU * place).sin().powi(2),
        _ => 0.0,
    };
    for (name, text, scale) in scenes() {
        let at = |rows: u32, accuracy_mm: f64| {
            let scene = tabled(&text, rows, scale, |time| pulse(time / scale));
            let solver = MembraneSolver::new(
                &scene,
                SolveOptions {
                    mesh: Mesh::bilinear(1),
                    tolerance: 1e-11,
                },
            );
            let request = HistoryRequest {
                accuracy_mm: Some(accuracy_mm),
                ..HistoryRequest::at(vec![0.705 * scale, 0.72 * scale, scale])
            };
            solver.unwrap().history(&half(), &request).unwrap()
        };
        let (found, truth) = (at(10_000, 1e-4), at(10_000, 1e-5));
        let size = truth.fields[0].max_magnitude().max(truth.fields[1].max_magnitude());
        assert!(size > 1e-4, "{name}: {size}");
        let off = found.difference(&truth);
        let allowed = found.time_error_mm.unwrap() + truth.time_error_mm.unwrap();
        assert!(off <= 1.5 * allowed + 1e-6, "{name}: {off:e} {allowed:e} of {size:e}");
    }
}

#[test]
fn corners_between_many_rows_and_noise_are_within_the_error() {
    // A triangle, and a ramp with noise of a thousandth that an oscilloscope adds.
    let triangle = |time: f64| 1.0 - (2.0 * time - 1.0).abs();
    let noisy = |time: f64| {
        let row = (1e4 * time).round();
        (time + 1e-3 * (2.3 * row * row).sin()) * 0.9
    };
    let shapes: [(&str, &dyn Fn(f64) -> f64); 2] = [("triangle", &triangle), ("noise", &noisy)];
    for (name, text, scale) in scenes() {
        for (shape, volts) in shapes {
            let scene = tabled(&text, 10_000, scale, |time| volts(time / scale));
            let at = |accuracy_mm: f64| {
                let solver = MembraneSolver::new(
                    &scene,
                    SolveOptions {
                        mesh: Mesh::bilinear(1),
                        tolerance: 1e-11,
                    },
                );
                let request = HistoryRequest {
                    accuracy_mm: Some(accuracy_mm),
                    ..HistoryRequest::at(vec![0.4 * scale, scale])
                };
                solver.unwrap().history(&half(), &request).unwrap()
            };
            let (found, truth) = (at(1e-3), at(2e-5));
            let off = found.difference(&truth);
            let allowed = found.time_error_mm.unwrap() + truth.time_error_mm.unwrap();
            assert!(off <= 1.5 * allowed, "{name} {shape}: {off:e} {allowed:e}");
            assert!(found.steps < 6000, "{name} {shape}: {}", found.steps);
        }
    }
}

/// Noise of an oscilloscope: reproducible numbers of normal distribution.
fn noise(row: f64) -> f64 {
    let mut state = (row as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut next = || {
        state = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        state = (state ^ (state >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        state ^= state >> 31;
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..12).map(|_| next()).sum::<f64>() - 6.0
}

/// A pass whose steps are the rows of a table, without averages.
struct RowByRow<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    rows: u32,
    times: &'a [f64],
}

impl WithMaterial for RowByRow<'_> {
    type Output = Pass;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Pass {
        let Self {
            solver,
            activity,
            rows,
            times,
        } = self;
        let scene = &solver.scene;
        let waveform = scene.waveform();
        let end = times[times.len() - 1];
        let row = end / f64::from(rows);
        let transient = TransientProblem {
            problem: solver.problem(activity, material),
            scene,
            // Sources and leads have two steps in a row.
            knots: knots(&waveform, end, f64::INFINITY),
            kink: f64::INFINITY,
            noisy: false,
            waveform,
            supply: Supply::of(scene),
            conductor: Conductor::of(scene, activity),
            times,
            limit: Cell::new(WorkLimit::of_seconds(1e6)),
            watched: Cell::default(),
            held: None,
            estimate: None,
            measures: false,
        };
        if scene.effects.inertia.is_some() {
            let speed = wave_speed(scene).unwrap();
            let per_second = speed / (1e-3 * solver.grid.unit_mm());
            return Motion {
                transient: &transient,
                mass: &Mass::new(&solver.grid, false),
                per_second,
                laplacian: &Laplacian::with_mass(&solver.grid, 4.0 / (row * per_second).powi(2)).unwrap(),
                step: row,
                parts: 1,
            }
            .pass();
        }
        let parts = if transient.is_fed_slowly() { 2 } else { 1 };
        let steps: Vec<f64> = (1..=parts * rows)
            .map(|at| row * f64::from(at) / f64::from(parts))
            .collect();
        transient.pass(Steps::At(&steps), &mut solver.workspace().near())
    }
}

/// The fields of a table without averages, with its rows as steps.
fn row_by_row(scene: &Scene, rows: u32, times: &[f64]) -> Vec<Field> {
    let options = SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-11,
    };
    let solver = MembraneSolver::new(scene, options).unwrap();
    let activity = solver.model.activity(&solver.grid, &half());
    let pass = solver.model.with(RowByRow {
        solver: &solver,
        activity: &activity,
        rows,
        times,
    });
    assert_eq!(pass.end, PassEnd::Done);
    pass.fields
}

/// Returns what is said about a history, and whether its error in time is small and covers the differences from fields.
fn compared(found: &History, truth: &[Field]) -> (String, bool) {
    let size = truth.iter().map(Field::max_magnitude).fold(0.0, f64::max);
    let error = found.time_error_mm.unwrap_or(f64::NAN);
    let pairs = found.fields.iter().zip(truth);
    let off = pairs.map(|(a, b)| a.max_difference(b)).fold(0.0, f64::max);
    let said = format!(
        "{:?}, {} steps, off by {off:.1e} mm, stated {error:.1e} mm of {size:.3} mm",
        found.outcome, found.steps
    );
    let has_all = found.outcome == Outcome::Converged && found.fields.len() == truth.len();
    (said, has_all && off <= error && error <= 1e-3 * size)
}

#[test]
fn noise_of_an_oscilloscope_takes_at_most_ten_times_the_steps_of_the_smooth_drive_within_the_stated_error() {
    let creep = "viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 ms }] }";
    let both = "viscoelasticity: { branches: [{ modulus: 20 kPa, time: 0.05 s }, { modulus: 20 kPa, time: 1 s }] }";
    let more = [
        ("fast and slow branches", text("", both, ""), 1.0),
        (
            "inertia and creep",
            text("", &format!("inertia: {{ density: 960 kg/m3 }}, {creep}"), ""),
            2e-3,
        ),
    ];
    let mut failed = Vec::new();
    for (name, text, scale) in scenes().into_iter().chain(more) {
        let frequency = 0.25 / scale;
        let smooth = text.replace("WAVEFORM", &format!("sine: {{ frequency: {frequency} Hz }}"));
        let times = [0.5 * scale, scale];
        let smooth = history(&Scene::from_text(&smooth).unwrap(), &half(), Mesh::bilinear(1), &times);
        for (rows, size) in [(2000, 1e-3), (2000, 0.01), (10_000, 0.01)] {
            // Leads with larger noise take more steps, and the branches of both laws respond alike.
            if ["leads", "finite creep"].contains(&name) && size > 2e-3 {
                continue;
            }
            let row_of = |time: f64| (f64::from(rows) * time).round();
            let scene = tabled(&text, rows, scale, |time| {
                let time = time / scale;
                (0.25 * TAU * time).sin() + size * noise(row_of(time))
            });
            let found = history(&scene, &half(), Mesh::bilinear(1), &times);
            let is_cheap = found.steps <= 10 * smooth.steps;
            let (said, covers) = match rows {
                2000 => compared(&found, &row_by_row(&scene, rows, &times)),
                _ => (format!("{} steps", found.steps), found.outcome == Outcome::Converged),
            };
            let said = format!(
                "{name}, {rows} rows, noise {size}: {said}, {} without noise",
                smooth.steps
            );
            eprintln!("{said}");
            if !(is_cheap && covers) {
                failed.push(said);
            }
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn jumps_and_pulses_in_noise_are_within_the_stated_error() {
    let (rows, size) = (2000, 2e-3);
    let noisy = |at: u32, volts: f64| volts + size * noise(f64::from(at));
    let place = |at: u32| f64::from(at) / f64::from(rows);
    let ramp = |at: u32| [place(at), noisy(at, 0.4 + place(at))];
    // The voltage falls by half in no time.
    let falls = |at: u32| [place(at), noisy(at, 0.45)];
    let jump = (0..=rows / 2).map(ramp).chain((rows / 2..=rows).map(falls));
    // The voltage rises by half for a hundredth of the time.
    let pulse = (0..=rows).map(|at| {
        let share = (place(at) - 0.7) / 0.01;
        let more = if (0.0..=1.0).contains(&share) {
            0.3 * (0.5 * TAU * share).sin().powi(2)
        } else {
            0.0
        };
        [place(at), noisy(at, 0.6 + more)]
    });
    let drives = [jump.collect::<Vec<_>>(), pulse.collect()];
    let times = [0.4, 0.5, 0.55, 0.705, 0.72, 1.0];
    for (name, text, _) in scenes().into_iter().filter(|(_, _, scale)| *scale == 1.0) {
        for (drive, rows_of) in ["jump", "pulse"].into_iter().zip(&drives) {
            let scene = of_rows(&text, rows_of.iter().copied());
            let found = history(&scene, &half(), Mesh::bilinear(1), &times);
            let (said, covers) = compared(&found, &row_by_row(&scene, rows, &times));
            eprintln!("{name}, {drive}: {said}");
            assert!(covers, "{name}, {drive}: {said}");
        }
    }
}

#[test]
fn a_drive_with_noise_that_ends_at_its_work_limit_has_what_its_furthest_pass_reached() {
    let (_, text, _) = scenes().into_iter().next().unwrap();
    let scene = tabled(&text, 2000, 1.0, |time| {
        (0.25 * TAU * time).sin() + 0.01 * noise((2000.0 * time).round())
    });
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let times = vec![0.25, 0.5, 0.75, 1.0];
    let reached = |seconds: f64| {
        let request = HistoryRequest {
            limit: WorkLimit::of_seconds(seconds),
            ..HistoryRequest::at(times.clone())
        };
        let found = solver.history(&half(), &request).unwrap();
        (found.outcome, found.fields.len())
    };
    // The limit ends the first pass, then the one with the steps of the first, then later ones.
    let found: Vec<(Outcome, usize)> = (0..40).map(|at| reached(0.01 * 1.2_f64.powi(at))).collect();
    let counts: Vec<usize> = found.iter().map(|(_, count)| *count).collect();
    assert!(counts.is_sorted(), "{found:?}");
    assert_eq!((counts[0], found[39].0), (0, Outcome::Converged), "{found:?}");
    assert!(found.contains(&(Outcome::WorkLimit, 4)), "{found:?}");
}

#[test]
fn long_tables_are_not_refused_for_their_rows() {
    let text = text("", "inertia: { density: 960 kg/m3 }", "");
    let scene = tabled(&text, 200_000, 2e-3, |time| (TAU * 125.0 * time).sin());
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let found = solver.history(&half(), &HistoryRequest::at(vec![2e-3])).unwrap();
    assert_eq!(found.outcome, Outcome::Converged);
}
