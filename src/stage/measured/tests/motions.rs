//! Displacements of a point over time, and frequency responses.

use std::fmt::Write as _;

use crate::measured::curve::Noise;
use crate::measured::{Device, MeasuredFile, MeasuredSet, SceneFit, VOLTAGE_OFFSET, compare_all, fit_scene, read_sets};
use deaflow_base::InputError;
use deaflow_content::Quantities;
use deaflow_fem::{AtFrequency, FrequencySolver, HistoryRequest, MembraneSolver, SolveOptions, WorkLimit};
use deaflow_field::{Field, Mesh};
use deaflow_fit::Verdict;
use deaflow_pattern::{Pattern, Raster};
use deaflow_scene::Scene;

const CELLS: usize = 8;
/// The number of the corner in the middle of the right half, and its place in mm.
const CORNER: [usize; 2] = [5, 4];
const POINT: &str = "[31.25 mm, 25 mm]";

fn scene(density: f64, modulus: f64, time: f64) -> Scene {
    Scene::from_text(&format!(
        "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: {CELLS} }}
material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}
drive: {{ voltage: 4 kV }}
effects: {{ inertia: {{ density: {density} kg/m3 }}, viscoelasticity: {{ branches: [ {{ modulus: {modulus} kPa, time: {time} s }} ] }} }}
"
    ))
    .unwrap()
}

/// The same scene without inertia.
fn creeping(modulus: f64, time: f64) -> Scene {
    let text = scene(960.0, modulus, time).to_yaml();
    Scene::from_text(&text.replace("inertia: {density: 960 kg/m3}, ", "")).unwrap()
}

fn options() -> SolveOptions {
    SolveOptions {
        mesh: Mesh::bilinear(1),
        tolerance: 1e-11,
    }
}

fn half() -> Pattern {
    Pattern::from_fn(Raster::new(CELLS, CELLS).unwrap(), |x, _| x < CELLS / 2)
}

fn sets(scene: &Scene, text: &str, entry: &str, free: &[&str]) -> Result<(Device, Vec<MeasuredSet>), InputError> {
    let folder = tempfile::tempdir().unwrap();
    let row = "1,1,1,1,0,0,0,0\n";
    std::fs::write(folder.path().join("half.csv"), row.repeat(CELLS)).unwrap();
    std::fs::write(folder.path().join("m.csv"), text).unwrap();
    let list = folder.path().join("list.yaml");
    let rest = format!("pattern: half.csv, point: {POINT}, direction: 0 deg");
    std::fs::write(&list, format!("files: [ {{ file: m.csv, {rest}, {entry} }} ]")).unwrap();
    let free: Vec<String> = free.iter().map(|key| (*key).to_owned()).collect();
    let device = Device::new(scene, &free, options())?;
    let sets = read_sets(&MeasuredFile::load(&list)?, &device, scene, Noise::Relative)?;
    Ok((device, sets))
}

fn fitted(scene: &Scene, text: &str, entry: &str, free: &[&str]) -> Result<SceneFit, InputError> {
    let (device, sets) = sets(scene, text, entry, free)?;
    fit_scene(&device, &sets, false)
}

fn assert_values(found: &SceneFit, known: &[f64], within: f64) {
    for (parameter, known) in found.fit.estimate.parameters.iter().zip(known) {
        assert!((parameter.value / known - 1.0).abs() < within, "{parameter:?}");
    }
    assert_eq!(found.fit.verdict, Verdict::Determined);
}

fn x_of(field: &Field) -> f64 {
    field.at_corner(CORNER[0], CORNER[1])[0]
}

/// Amplitudes at 50 V and phases, across the first resonance.
fn response(scene: &Scene, with_phases: bool) -> String {
    let frequencies: Vec<f64> = (0..12).map(|k| 2.0 * 1.6_f64.powi(k)).collect();
    let solver = FrequencySolver::new(scene, options(), WorkLimit::of_history(None)).unwrap();
    let found = solver.respond(&half(), &frequencies);
    let header = if with_phases { ",phase_rad" } else { "" };
    let mut text = format!("frequency_Hz,amplitude_um{header}\n");
    for (frequency, at) in frequencies.iter().zip(&found.each) {
        let AtFrequency::Response { real, imaginary } = at else {
            panic!("{frequency}: {}", at.name())
        };
        let (real, imaginary) = (x_of(real), x_of(imaginary));
        write!(text, "{frequency},{}", 50.0 * 1e3 * real.hypot(imaginary)).unwrap();
        match with_phases {
            true => writeln!(text, ",{}", imaginary.atan2(real)).unwrap(),
            false => text.push('\n'),
        }
    }
    text
}

#[test]
fn a_frequency_response_gives_density_and_branch() {
    let (truth, start) = (scene(960.0, 20.0, 0.02), scene(1200.0, 30.0, 0.03));
    let entry = "test: frequency-response, alternating: 50 V, sigma: 2 %";
    let free = ["density", "branches.0.modulus", "branches.0.time"];
    for with_phases in [true, false] {
        let text = response(&truth, with_phases);
        let found = fitted(&start, &text, entry, &free).unwrap();
        assert_values(&found, &[960.0, 20e3, 0.02], 1e-4);
        let (device, sets) = sets(&truth, &text, entry, &[]).unwrap();
        let (compared, _) = compare_all(&device, &sets, &[], false).unwrap();
        assert_eq!(compared.len(), 1 + usize::from(with_phases));
        for one in &compared {
            let largest = one.agreement.largest.0.abs();
            let (size, expected) = match one.values.quantities() {
                Quantities::FrequencyPhase => (180.0, "m.csv, phase"),
                _ => (1e-3, "m.csv"),
            };
            assert!(largest < 1e-6 * size && one.name == expected, "{}: {largest}", one.name);
            assert!(one.agreement.chi2_per_dof.is_some_and(|chi2| chi2 < 1e-6));
        }
    }
}

fn motion(scene: &Scene, times: &[f64], voltages: &[f64]) -> String {
    let request = HistoryRequest::at(times.to_vec());
    let solver = MembraneSolver::new(scene, options()).unwrap();
    let found = solver.history(&half(), &request).unwrap();
    let rows = times.iter().zip(voltages).zip(&found.fields);
    let rows = rows.map(|((time, voltage), field)| format!("{time},{},{}\n", 1e-3 * voltage, 1e3 * x_of(field)));
    format!("time_s,voltage_kV,displacement_um\n{}", rows.collect::<String>())
}

#[test]
fn a_motion_along_a_measured_voltage_gives_branch_and_voltage_offset() {
    let times: Vec<f64> = (0..16).map(f64::from).collect();
    // A ramp, a hold, and a fall to half.
    let voltages: Vec<f64> = times
        .iter()
        .map(|t| if *t < 9.0 { 4e3 * (t / 4.0).min(1.0) } else { 2e3 })
        .collect();
    let rows: Vec<[f64; 2]> = times
        .iter()
        .zip(&voltages)
        .map(|(time, voltage)| [*time, *voltage])
        .collect();
    let driven = |scene: &Scene| scene.with_table(deaflow_scene::Waveform::of_table(&rows).unwrap());
    let text = motion(&driven(&creeping(40.0, 3.0)), &times, &voltages);
    let start = creeping(60.0, 2.0);
    let entry = "test: time-displacement, sigma: 1 um";
    let free = ["branches.0.modulus", "branches.0.time"];
    let found = fitted(&start, &text, entry, &free).unwrap();
    assert_values(&found, &[40e3, 3.0], 2e-3);
    let shown = text
        .lines()
        .enumerate()
        .map(|(at, line)| match line.split(',').collect::<Vec<_>>()[..] {
            [time, voltage, u] if at > 0 => format!("{time},{},{u}\n", voltage.parse::<f64>().unwrap() + 0.1),
            _ => format!("{line}\n"),
        });
    let found = fitted(
        &creeping(40.0, 3.0),
        &shown.collect::<String>(),
        entry,
        &[VOLTAGE_OFFSET],
    )
    .unwrap();
    let offset = &found.fit.estimate.parameters[0];
    assert!((offset.value + 100.0).abs() < 1.0, "{offset:?}");
}

#[test]
fn a_motion_under_the_waveform_of_the_scene_is_compared_up_to_pull_in() {
    let times = [0.0, 1.0, 5.0, 20.0];
    let truth = creeping(40.0, 3.0);
    let text = motion(&truth, &times, &[0.0; 4])
        .replace(",voltage_kV", "")
        .replace(",0,", ",");
    let (device, set) = sets(&truth, &text, "test: time-displacement", &[]).unwrap();
    let (compared, _) = compare_all(&device, &set, &[], false).unwrap();
    assert!(compared[0].agreement.rms < 1e-9, "{:?}", compared[0].agreement);
    assert_eq!(compared[0].values.quantities(), Quantities::TimeDisplacement);
    // Creep leads to pull-in.
    let (device, set) = sets(&truth, &text, "test: time-displacement, voltage: 7.8 kV", &[]).unwrap();
    let (compared, _) = compare_all(&device, &set, &[], false).unwrap();
    assert_eq!(compared[0].without_equilibrium, [4]);
}

#[test]
fn motions_that_cannot_be_used_are_refused() {
    let scene = scene(960.0, 20.0, 0.02);
    let refused = |text: &str, entry: &str| {
        let error = sets(&scene, text, entry, &[]).err().unwrap();
        format!("{error} {error:?}")
    };
    let history = "test: time-displacement";
    let response = "test: frequency-response, alternating: 50 V";
    for (text, entry, part) in [
        ("time_s,displacement_mm\n-1,0\n", history, "row 1: the time is negative"),
        (
            "time_s,displacement_mm\n1,0\n1,1\n",
            history,
            "row 2: the time is not after",
        ),
        ("time_s,u\n1,0\n", history, "there is no column `displacement_mm`"),
        (
            "time_s,displacement_mm\n1,0\n",
            "test: time-displacement, alternating: 50 V",
            "`alternating` does not belong",
        ),
        (
            "time_s,voltage_kV,displacement_mm\n1,1,0\n",
            "test: time-displacement, voltage: 1 kV",
            "remove one",
        ),
        (
            "frequency_Hz,amplitude_um\n0,1\n",
            response,
            "the frequency is not positive",
        ),
        (
            "frequency_Hz,amplitude_um\n1,-1\n",
            response,
            "the amplitude is not positive",
        ),
        ("frequency_Hz,amplitude\n1,1\n", response, "has no unit"),
        (
            "frequency_Hz,amplitude_um\n1,1\n",
            "test: frequency-response",
            "alternating",
        ),
        (
            "frequency_Hz,amplitude_um\n1,1\n",
            "test: frequency-response, alternating: 50 V, sigma: 2 kPa",
            "a share or a length",
        ),
    ] {
        let found = refused(text, entry);
        assert!(found.contains(part), "{entry}: {found}");
    }
}
