//! A strip as an RC line: known results, orders of convergence, energy balances, and comparison with statics.

use super::*;
use crate::operator::metrics;
use crate::time::{History, HistoryRequest};
use crate::{MembraneSolver, SetupError, SolveOptions, Solver, SolverParameters};
use deaflow_field::{Mesh, Simulator};
use deaflow_pattern::{Pattern, Raster};

/// A fully active strip of 50 mm with a number of elements and its lead at the left; the unit of time is R c ℓ².
struct Strip {
    conductor: Conductor,
    circuit: Circuit,
    unit: f64,
}

impl Strip {
    fn new(elements: usize) -> Self {
        let scene = scene(&format!(
            "geometry: {{ size: [50 mm, 1 mm], thickness: 1 mm, prestretch: 3, cells: [{elements}, 1] }}, \
             drive: {{ voltage: 1 V }}, {RESISTANCE}"
        ));
        let grid = crate::grid::Grid::uniform(Mesh::bilinear(1), &crate::sheet::Sheet::of(&scene));
        let pattern = Pattern::from_fn(Raster::new(elements, 1).unwrap(), |_, _| true);
        let activity = Activity::new(&grid, &pattern);
        let conductor = Conductor::of(&scene, &activity).unwrap();
        let of_area = scene.permittivity() / (1e-3 * scene.prestretched_thickness_mm());
        let area = (1e-3 * grid.unit_mm()).powi(2);
        let metric = metrics(&activity, &vec![0.0; grid.layout().vector_len()]);
        let circuit = conductor.circuit(&metric, |_| of_area * area);
        let unit = 100e3 * of_area * 0.05_f64.powi(2);
        Self {
            conductor,
            circuit,
            unit,
        }
    }

    /// The potential at the far end after each of a number of steps, with the voltage of the lead as a function of
    /// time, all in units of time.
    fn far_end(&self, length: f64, steps: usize, volts: impl Fn(f64) -> f64) -> Vec<f64> {
        let far = self.circuit.capacitance.len() - 1;
        let mut charge = vec![0.0; far + 1];
        (0..steps)
            .map(|step| {
                let at = |share: f64| volts(length * (step as f64 + share));
                let volts = [at(FIRST_STAGE), at(1.0)];
                let found = self
                    .conductor
                    .step(length * self.unit, &charge, [&self.circuit; 2], volts);
                let potential = found.unwrap();
                charge = pairs(&potential, &self.circuit.capacitance)
                    .map(|(v, c)| v * c)
                    .collect();
                potential[far]
            })
            .collect()
    }
}

const RESISTANCE: &str = "leads: [left], effects: { electrode_resistance: { sheet_resistance: 50 kOhm } }";
const SQUARE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }";

fn scene(text: &str) -> Scene {
    let rest = "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }";
    Scene::from_text(&format!("{{ {rest}, {text} }}")).unwrap()
}

/// The letter E, open to the right.
fn comb() -> Pattern {
    let rows: [&[u8]; 10] = [
        b"########..",
        b"########..",
        b"##........",
        b"##........",
        b"######....",
        b"######....",
        b"##........",
        b"##........",
        b"##########",
        b"##########",
    ];
    Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| rows[y][x] == b'#')
}

fn history(scene: &Scene, pattern: &Pattern, mesh: Mesh, request: &HistoryRequest) -> History {
    let solver = MembraneSolver::new(scene, SolveOptions { mesh, tolerance: 1e-11 }).unwrap();
    solver.history(pattern, request).unwrap()
}

/// Extrapolates three values, each refined by 2, whose error has terms of second and fourth order.
fn limit([coarse, fine, finest]: [f64; 3]) -> f64 {
    let [first, second] = [fine + (fine - coarse) / 3.0, finest + (finest - fine) / 3.0];
    second + (second - first) / 15.0
}

#[test]
fn a_strip_charges_as_an_rc_line() {
    for (time, known) in [(0.503180566422, 1.0 - (-1.0_f64).exp()), (1.964307570716, 0.99)] {
        let at = |elements: usize, steps: usize| {
            let far = Strip::new(elements).far_end(time / steps as f64, steps, |_| 1.0);
            *far.last().unwrap()
        };
        // The error decreases with the square of the step, and of the element.
        let in_time = [50, 100, 200, 400].map(|steps| at(20, steps));
        let changes = [0, 1, 2].map(|k| in_time[k + 1] - in_time[k]);
        for pair in changes.windows(2) {
            assert!((pair[0] / pair[1] - 4.0).abs() < 0.4, "{changes:?}");
        }
        let found = [10, 20, 40].map(|elements| limit([100, 200, 400].map(|steps| at(elements, steps))));
        let errors = found.map(|found| found - known);
        assert!((errors[0] / errors[1] - 4.0).abs() < 0.2, "{errors:?}");
        assert!((errors[1] / errors[2] - 4.0).abs() < 0.1, "{errors:?}");
        let error = limit(found) - known;
        assert!(error.abs() < 2e-7, "{error:e}");
    }
}

#[test]
fn the_far_end_of_a_strip_follows_a_sine_with_less_amplitude_and_later() {
    let amplitude_and_phase = |elements: usize, steps: usize| {
        let length = std::f64::consts::TAU / steps as f64;
        // The initial state has decayed by e^(−31).
        let far = Strip::new(elements).far_end(length, 3 * steps, f64::sin);
        let last = far[2 * steps..].iter().enumerate();
        let [sine, cosine] = last.fold([0.0; 2], |[sine, cosine], (at, value)| {
            let (s, c) = (length * (at + 1) as f64).sin_cos();
            [sine + value * s, cosine + value * c]
        });
        let half = 0.5 * steps as f64;
        [sine.hypot(cosine) / half, cosine.atan2(sine)]
    };
    let found = [10, 20, 40].map(|elements| [100, 200, 400].map(|steps| amplitude_and_phase(elements, steps)));
    for (k, known) in [0.925662634538, -0.479737056237].into_iter().enumerate() {
        let error = limit(found.map(|of| limit(of.map(|both| both[k])))) - known;
        assert!(error.abs() < 1e-7, "{k}: {error:e}");
    }
}

#[test]
fn a_membrane_that_hardly_moves_charges_as_a_line() {
    let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 100 V }}, {RESISTANCE}"));
    let all = Pattern::from_fn(Raster::new(10, 10).unwrap(), |_, _| true);
    let unit = 100e3 * scene.permittivity() / (1e-3 * scene.prestretched_thickness_mm()) * 0.05_f64.powi(2);
    let times = [0.1, 0.5, 1.0, 6.0].map(|time| time * unit);
    let found = history(&scene, &all, Mesh::bilinear(2), &HistoryRequest::at(times.to_vec()));
    let capacitance = unit / 100e3;
    for (instant, time) in found.asked().zip([0.1, 0.5, 1.0, 6.0]) {
        let mean: f64 = (0..40)
            .map(|n| ((f64::from(n) + 0.5) * std::f64::consts::PI).powi(2))
            .map(|rate| 2.0 / rate * (-rate * time).exp())
            .sum();
        let wanted = 100.0 * (1.0 - mean);
        assert!(
            (instant.voltage / wanted - 1.0).abs() < 4e-3,
            "{time}: {} {wanted}",
            instant.voltage
        );
        assert!((instant.charge / (capacitance * instant.voltage) - 1.0).abs() < 1e-4);
        assert!(instant.largest < 1e-2);
    }
    // Half of the energy of the source is dissipated, for any resistance.
    let (last, whole) = (found.instants.last().unwrap(), capacitance * 1e4);
    assert!((last.supplied / whole - 1.0).abs() < 1e-4, "{} {whole}", last.supplied);
    assert!((last.electric / whole - 0.5).abs() < 1e-4 && (last.dissipated / whole - 0.5).abs() < 1e-4);
    let open = last.stored + last.electric + last.dissipated - last.supplied;
    assert!(open.abs() < 1e-6 * whole, "{open:e}");
}

#[test]
fn what_has_charged_is_the_equilibrium_and_no_resistance_is_none() {
    for mesh in [Mesh::bilinear(1), Mesh::biquadratic(1)] {
        let scene_of = |effects: &str| {
            scene(&format!(
                "{SQUARE}, drive: {{ voltage: 5 kV }}, leads: [left], {effects}"
            ))
        };
        let plain = scene_of("effects: {}");
        let solver = MembraneSolver::new(&plain, SolveOptions { mesh, tolerance: 1e-11 }).unwrap();
        let still = solver.simulate(&[comb()]).remove(0).field.unwrap();
        let wired = scene_of("effects: { electrode_resistance: { sheet_resistance: 50 kOhm } }");
        let found = history(&wired, &comb(), mesh, &HistoryRequest::at(vec![0.0, 1e-4, 0.1]));
        assert!(found.fields[0].max_magnitude() < 1e-12);
        assert!(found.fields[1].max_difference(&still) > 1e-2 * still.max_magnitude());
        let off = found.fields[2].max_difference(&still);
        assert!(off < 1e-8, "{off:e}");
        let base = history(&plain, &comb(), mesh, &HistoryRequest::at(vec![0.0, 0.1]));
        let none = scene_of("effects: { electrode_resistance: { sheet_resistance: 0 Ohm } }");
        assert_eq!(history(&none, &comb(), mesh, &HistoryRequest::at(vec![0.0, 0.1])), base);
        let last = |history: &History| history.instants.last().unwrap().clone();
        let (slow, at_once) = (last(&found), last(&base));
        assert!((slow.charge / at_once.charge - 1.0).abs() < 1e-8 && (slow.voltage / 5e3 - 1.0).abs() < 1e-8);
    }
}

#[test]
fn errors_in_time_fall_with_the_square_of_the_step_and_energies_balance() {
    let scene = scene(&format!(
        "{SQUARE}, drive: {{ voltage: 5 kV, waveform: {{ ramp: {{ time: 0.1 ms }} }} }}, leads: [left], effects: {{ \
         electrode_resistance: {{ sheet_resistance: 50 kOhm }}, viscoelasticity: {{ branches: [{{ modulus: 45 kPa, \
         time: 0.1 ms }}] }} }}"
    ));
    let at = |accuracy_mm: f64| {
        let request = HistoryRequest {
            accuracy_mm: Some(accuracy_mm),
            ..HistoryRequest::at(vec![5e-5, 1e-4, 3e-4])
        };
        history(&scene, &comb(), Mesh::bilinear(1), &request)
    };
    let truth = at(1e-7);
    for accuracy in [1e-3, 1e-4] {
        let found = at(accuracy);
        let (error, said) = (found.difference(&truth), found.time_error_mm.unwrap());
        assert!(said <= accuracy, "{said:e}");
        assert!(
            error <= 1.5 * said + 2e-7 && said <= 3.0 * error + 2e-7,
            "{accuracy}: {error:e} {said:e}"
        );
        let last = found.instants.last().unwrap();
        let open = last.stored + last.electric + last.dissipated - last.supplied;
        assert!(
            open.abs() < 30.0 * accuracy * last.supplied,
            "{open:e} of {:e}",
            last.supplied
        );
        let least = -1e-9 * last.supplied;
        let is_lost = |pair: &[crate::time::Instant]| pair[1].dissipated - pair[0].dissipated >= least;
        assert!(found.instants.windows(2).all(is_lost));
    }
}

#[test]
fn cells_may_be_leads_and_corners_conduct_nothing() {
    let scene = scene(&format!(
        "{SQUARE}, drive: {{ voltage: 5 kV }}, leads: {{ cells: [[0, 0]] }}, effects: {{ \
         electrode_resistance: {{ sheet_resistance: 50 kOhm }} }}"
    ));
    // Two squares that touch at a corner: the other one stays bare.
    let squares = Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| {
        (x < 4) == (y < 4) && x < 8 && y < 8
    });
    let solver = MembraneSolver::new(
        &scene,
        SolveOptions {
            mesh: Mesh::bilinear(1),
            tolerance: 1e-9,
        },
    )
    .unwrap();
    let found = solver.history(&squares, &HistoryRequest::at(vec![0.1])).unwrap();
    let alone = Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| x < 4 && y < 4);
    let one = solver.history(&alone, &HistoryRequest::at(vec![0.1])).unwrap();
    assert!(found.fields[0].max_difference(&one.fields[0]) < 1e-6 * one.fields[0].max_magnitude());
    // A request for it is refused.
    let solver = Solver::new(&scene, &SolverParameters::new(crate::Method::Newton, Mesh::bilinear(1))).unwrap();
    let refused = solver.simulate(&[alone, squares]).err();
    let island = SetupError::Island {
        pattern: 1,
        cells: 16,
        y: 4,
        x: 4,
    };
    assert_eq!(refused, Some(island));
}

#[test]
fn a_patterned_membrane_is_that_of_an_independent_program() {
    // The same elements with a biquadratic potential, by backward Euler extrapolated from four step lengths: while it
    // charges they differ by the potential between the corners of elements.
    let scene = scene(&format!("{SQUARE}, drive: {{ voltage: 4 kV }}, {RESISTANCE}"));
    let found = history(
        &scene,
        &comb(),
        Mesh::biquadratic(2),
        &HistoryRequest::at(vec![2e-5, 1e-4, 4e-4]),
    );
    let known = [(0.63635233, 1.5e-3), (0.78432624, 1e-3), (0.77622355, 1.5e-3)];
    for (field, (known, error)) in found.fields.iter().zip(known) {
        let most = field.max_magnitude();
        assert!((most / known - 1.0).abs() < error, "{most} {known}");
    }
}
