//! Measured waveforms: tables of many rows, whose rows need not be steps.

use std::f64::consts::TAU;

use super::*;

const SMOOTH: &str = "sine: { frequency: 125 Hz }";

/// Returns a scene whose voltage in units of 5250 V is a table of a number of rows over a time in s.
fn tabled(scene: &str, rows: u32, seconds: f64, volts: impl Fn(f64) -> f64) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let row = |at: u32| {
        let time = seconds * f64::from(at) / f64::from(rows);
        format!("{time:.12},{:.12}\n", 5250.0 * volts(time))
    };
    let text: String = (0..=rows).map(row).collect();
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
        let (found, truth) = (at(10_000, 1e-4), at(10_000, 2e-6));
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

#[test]
fn long_tables_are_not_refused_for_their_rows() {
    let text = text("", "inertia: { density: 960 kg/m3 }", "");
    let scene = tabled(&text, 200_000, 2e-3, |time| (TAU * 125.0 * time).sin());
    let solver = MembraneSolver::new(&scene, SolveOptions::on(Mesh::bilinear(1))).unwrap();
    let found = solver.history(&half(), &HistoryRequest::at(vec![2e-3])).unwrap();
    assert_eq!(found.outcome, Outcome::Converged);
}
