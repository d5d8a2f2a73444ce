//! Masks by area, samples by their moments, and yields of known designs.

use deaflow_base::{Document, Stream, Time};
use deaflow_fem::{MembraneSolver, SolveOptions, WorkLimit};
use deaflow_field::{Field, Mesh};
use deaflow_pattern::{Fabricated, MaskOffsets, Membrane, Pattern, Raster, fabricated};
use deaflow_scene::{Scene, Tolerances};
use std::path::Path;

use crate::sampling::deviations;
use crate::statistics::Yield;
use crate::study::{Device, Failure, Study};
use crate::{Source, ToleranceError};

const LOST: [bool; 2500] = [false; 2500];

fn membrane() -> Membrane {
    Scene::vhb4910().membrane()
}

fn half() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, _| x < 25)
}

fn shares_of(pattern: &Pattern, wider_mm: f64, shift_mm: [f64; 2]) -> Option<Vec<f64>> {
    match fabricated(pattern, None, membrane(), &MaskOffsets { wider_mm, shift_mm }, &LOST).unwrap() {
        Fabricated::Pattern(pattern) => Some(match pattern.coverage() {
            Some(coverage) => coverage.shares(),
            None => pattern.cells().iter().map(|&cell| f64::from(cell)).collect(),
        }),
        Fabricated::ShortCircuit | Fabricated::SharedCell => None,
    }
}

fn tolerances(text: &str) -> Tolerances {
    let text = format!(
        "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }}, material: {{ model: neo-hookean, \
         shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: 5250 V }}, tolerances: {text} }}"
    );
    let document = Document::from_text(Path::new("scene"), &text).unwrap();
    assert_eq!(Scene::read(&document.root).unwrap(), Scene::vhb4910());
    Tolerances::of_scene(&document.root).unwrap().unwrap()
}

fn study(scene: Scene, text: &str) -> Study {
    let options = SolveOptions::on(Mesh::bilinear(1));
    Study::new(vec![scene], tolerances(text), options, WorkLimit::default(), 1).unwrap()
}

fn unstable(found: &Yield) -> usize {
    found.failed_by(Failure::Unstable)
}

/// The displacement of the centre to the right.
fn yield_of(study: &Study, pattern: &Pattern, samples: u32, wanted: f64) -> Yield {
    let devices = study
        .devices(pattern, 0..samples, |fields| fields[0].at([25.0, 25.0])[0], || {})
        .unwrap();
    Yield::of(&devices, &study.varying(), Some(wanted))
}

#[test]
fn straight_edges_move_by_the_offset() {
    let column = |shares: &[f64], x: usize| shares[25 * 50 + x];
    for wider in [0.3, -0.3, 1.4, -1.4, 0.0] {
        let shares = shares_of(&half(), wider, [0.0; 2]).unwrap();
        let covered: f64 = (0..50).map(|x| column(&shares, x)).sum();
        assert!((covered - 25.0 - wider).abs() < 1e-9, "{wider}: {covered}");
    }
    // The upper electrode lies to the right: the overlap loses nothing on the left, where both continue, and nothing on
    // the right, where the lower one ends. To the left it loses at its right edge.
    for (shift, lost) in [
        ([0.4, 0.0], 0.0),
        ([-0.4, 0.0], 0.4),
        ([0.0, 0.7], 0.0),
        ([-1.6, 0.3], 1.6),
    ] {
        let shares = shares_of(&half(), 0.0, shift).unwrap();
        let covered: f64 = (0..50).map(|x| column(&shares, x)).sum();
        assert!((covered - 25.0 + lost).abs() < 1e-9, "{shift:?}: {covered}");
    }
}

/// A raster of many points, each of which asks whether both electrodes are there.
#[test]
fn shares_are_areas_of_the_overlap() {
    const FINE: usize = 40;
    let mut stream = Stream::new(3, "test", 0);
    let pattern = Pattern::from_fn(Raster::PAPER, |_, _| false);
    let cells: Vec<bool> = (0..2500).map(|_| stream.chance(0.5)).collect();
    let pattern = Pattern::from_fn(pattern.raster(), |x, y| cells[y * 50 + x]);
    let active = |x: f64, y: f64| pattern.is_active((x.floor() as usize).min(49), (y.floor() as usize).min(49));
    for (wider, shift) in [
        (0.25, [0.125, -0.3]),
        (-0.25, [0.2, 0.1]),
        (0.0, [-0.55, 0.45]),
        (0.45, [0.05, 1.1]),
    ] {
        let shares = shares_of(&pattern, wider, shift).unwrap();
        let reach = f64::abs(wider);
        // The corners and the middle of the square reach all cells below it, as it is smaller than a cell.
        let layer = |x: f64, y: f64| {
            let places = [-reach, 0.0, reach].map(|dx| [-reach, 0.0, reach].map(|dy| active(x + dx, y + dy)));
            let mut all = places.into_iter().flatten();
            if wider >= 0.0 {
                all.any(|is| is)
            } else {
                all.all(|is| is)
            }
        };
        for cell in [[10, 10], [25, 31], [40, 7], [12, 44]] {
            let points = (0..FINE * FINE).map(|at| {
                let [x, y] = [at % FINE, at / FINE].map(|at| (at as f64 + 0.5) / FINE as f64);
                (cell[0] as f64 + x, cell[1] as f64 + y)
            });
            let both = points.filter(|(x, y)| layer(*x, *y) && layer(x - shift[0], y - shift[1]));
            let known = both.count() as f64 / (FINE * FINE) as f64;
            let found = shares[cell[1] * 50 + cell[0]];
            assert!(
                (found - known).abs() < 0.05,
                "{wider} {shift:?} {cell:?}: {found} {known}"
            );
        }
    }
}

#[test]
fn groups_that_touch_are_a_short_circuit() {
    let gap = Pattern::from_groups(Raster::PAPER, |x, _| {
        [1, 0, 2][usize::from(x > 24) + usize::from(x > 26)]
    });
    assert!(shares_of(&gap, 0.95, [0.0; 2]).is_some());
    assert!(shares_of(&gap, -2.0, [0.0; 2]).is_some());
    assert_eq!(shares_of(&gap, 1.05, [0.0; 2]), None);
    let near = Pattern::from_groups(Raster::PAPER, |x, _| {
        [1, 0, 2][usize::from(x > 24) + usize::from(x > 25)]
    });
    let offsets = MaskOffsets {
        wider_mm: 0.45,
        shift_mm: [0.0; 2],
    };
    let shared = fabricated(&near, None, membrane(), &offsets, &LOST).unwrap();
    assert_eq!(shared, Fabricated::SharedCell);
    // Where electrodes touch elsewhere, that is worse.
    let both = Pattern::from_groups(Raster::PAPER, |x, y| match y {
        0..25 => near.group(x, y),
        _ => 1 + u8::from(x > 24),
    });
    assert_eq!(
        fabricated(&both, None, membrane(), &offsets, &LOST).unwrap(),
        Fabricated::ShortCircuit
    );
    let narrow = shares_of(
        &Pattern::from_groups(Raster::PAPER, |x, _| 1 + u8::from(x > 24)),
        -0.2,
        [0.0; 2],
    )
    .unwrap();
    assert!((narrow.iter().sum::<f64>() / 50.0 - 49.6).abs() < 1e-9);
}

#[test]
fn deviations_are_independent_and_normally_distributed() {
    const COUNT: u32 = 4096;
    let all: Vec<[f64; 8]> = (0..COUNT).map(|index| deviations(7, index)).collect();
    let mean = |of: &dyn Fn(&[f64; 8]) -> f64| all.iter().map(of).sum::<f64>() / f64::from(COUNT);
    for i in 0..8 {
        assert!(mean(&|z| z[i]).abs() < 2e-3 && (mean(&|z| z[i] * z[i]) - 1.0).abs() < 5e-3);
        assert!((mean(&|z| z[i].powi(4)) - 3.0).abs() < 0.1);
        for k in 0..i {
            assert!(mean(&|z| z[i] * z[k]).abs() < 0.02, "{i} {k}");
        }
    }
    assert_eq!(deviations(7, 5), all[5]);
    assert_ne!(deviations(8, 5), all[5]);
    let near: Vec<f64> = (0..65536).map(|index| deviations(7, index)[0]).collect();
    assert!(near.iter().all(|z| z.is_finite() && z.abs() < 6.0));
}

/// Means, deviations, quantiles and yields of an independent program with 512 samples.
#[test]
fn the_half_plane_has_its_known_yield() {
    let all = study(
        Scene::vhb4910(),
        "{ voltage: 1 %, shear_modulus: { relative: 5 %, distribution: lognormal }, thickness: 3 %, permittivity: 2 %, \
         prestretch: 1 %, mask: 0.15 mm, misregistration: [0.1 mm, 0.1 mm], lost_cells: 0.2 % }",
    );
    let found = yield_of(&all, &half(), 512, 2.0);
    let (mean, deviation) = (found.mean.unwrap(), found.deviation.unwrap());
    assert!((mean.value - 2.1132).abs() < 2.0 * 0.0091, "{mean:?}");
    assert!((deviation.value - 0.2047).abs() < 0.013, "{deviation:?}");
    assert!(
        (1.779..1.833).contains(&found.quantiles[0].value.value),
        "{:?}",
        found.quantiles[0]
    );
    let reached = found.reached.unwrap();
    assert!((reached.value - 0.690).abs() < 0.04, "{reached:?}");
    assert!(reached.interval[0] < 0.69 && reached.interval[1] > 0.69);
    assert_eq!((found.failed(), found.samples), (0, 512));
    let share = |source: Source| found.shares.iter().find(|(one, _)| *one == source).unwrap().1;
    let known = [
        (Source::Thickness, 0.495),
        (Source::ShearModulus, 0.337),
        (Source::Prestretch, 0.055),
        (Source::Permittivity, 0.054),
        (Source::Voltage, 0.053),
        (Source::Mask, 0.003),
    ];
    for (source, known) in known {
        assert!(
            (share(source) - known).abs() < 0.03,
            "{source:?}: {} {known}",
            share(source)
        );
    }
    assert!(found.shares.is_sorted_by(|a, b| a.1 >= b.1));
}

/// The mean of a known function of the deviations, and of lost cells, which no deviation explains.
#[test]
fn intervals_of_means_contain_the_mean_and_are_narrow() {
    const SEEDS: u64 = 100;
    let varying = [Source::Voltage, Source::Thickness, Source::Mask];
    let known = 0.005_f64.exp();
    for (samples, narrower) in [(512, 8.0), (60, 3.0), (20, 0.9)] {
        let mut inside = 0;
        for seed in 0..SEEDS {
            let mut lost = Stream::new(seed, "test", 0);
            let device = |index| {
                let deviations = deviations(seed, index);
                let [v, t, m] = varying.map(|source| deviations[source as usize]);
                Device {
                    deviations,
                    value: Ok((0.1 * v).exp() + 0.02 * t * m + 0.005 * lost.normal()),
                }
            };
            let devices: Vec<Device> = (0..samples).map(device).collect();
            let found = Yield::of(&devices, &varying, None);
            let (mean, plain) = (
                found.mean.unwrap(),
                found.deviation.unwrap().value / f64::from(samples).sqrt(),
            );
            let half = 0.5 * (mean.interval[1] - mean.interval[0]);
            assert!(half * narrower < 1.96 * plain, "{samples}: {half} {plain}");
            inside += u64::from(mean.interval[0] <= known && known <= mean.interval[1]);
        }
        assert!(inside >= 90, "{samples}: {inside} of {SEEDS}");
    }
    // Devices that fail have no known means of their deviations.
    let mut devices: Vec<Device> = (0..512)
        .map(|index| Device {
            deviations: deviations(1, index),
            value: Ok(deviations(1, index)[0]),
        })
        .collect();
    devices
        .iter_mut()
        .filter(|device| device.value.is_ok_and(|value| value > 1.5))
        .for_each(|device| device.value = Err(Failure::Unstable));
    let found = Yield::of(&devices, &[Source::Voltage], None);
    let (mean, deviation) = (found.mean.unwrap(), found.deviation.unwrap().value);
    let survivors = (512 - found.failed()) as f64;
    assert!(found.failed() > 20 && mean.value < -0.1, "{mean:?}");
    assert!((mean.interval[1] - mean.value - 1.959_963_985 * deviation / survivors.sqrt()).abs() < 1e-9);
}

/// The voltage, the permittivity, the modulus and the thickness act by one number: V² ε/(μ H²).
#[test]
fn what_acts_by_one_number_has_one_distribution() {
    let of = |text: &str| {
        yield_of(&study(Scene::vhb4910(), text), &half(), 128, 2.0)
            .deviation
            .unwrap()
            .value
    };
    let volts = of("{ voltage: 1 % }");
    let thick = of("{ thickness: 1 % }");
    let soft = of("{ permittivity: 2 % }");
    assert!(
        (volts / thick - 1.0).abs() < 0.03 && (volts / soft - 1.0).abs() < 0.03,
        "{volts} {thick} {soft}"
    );
    // d ln u/d ln κ = 1.1192 (an adjoint).
    assert!((soft / (2.11910 * 1.1192 * 0.02) - 1.0).abs() < 0.03, "{soft}");
}

#[test]
fn devices_beyond_their_stability_count_as_failed() {
    let strong = Scene::vhb4910().at_voltage(9500.0);
    let found = yield_of(
        &study(strong, "{ voltage: 15 % }"),
        &Pattern::from_fn(Raster::PAPER, |_, _| true),
        64,
        0.1,
    );
    assert!(unstable(&found) > 0 && unstable(&found) < 64, "{}", unstable(&found));
    assert!(found.reached.unwrap().value == 0.0);
    // Not a verdict on the devices.
    let options = SolveOptions::on(Mesh::bilinear(1));
    let limit = WorkLimit::of_time(Some(&Time::from_f64(1e-3).unwrap()));
    let hasty = Study::new(
        vec![Scene::vhb4910()],
        tolerances("{ voltage: 1 % }"),
        options,
        limit,
        1,
    )
    .unwrap();
    let found = yield_of(&hasty, &half(), 2, 2.0);
    assert_eq!(
        (found.failed_by(Failure::Unsolved), unstable(&found), found.failed()),
        (2, 0, 2)
    );
    // Without prestretch half of the membranes are slack on their frames.
    let loose = Scene::with_values(50.0, 1.0, 1.0, 45e3, 4.7, 100.0);
    let loose = Study::new(
        vec![loose],
        tolerances("{ prestretch: 1 % }"),
        options,
        WorkLimit::default(),
        1,
    )
    .unwrap();
    assert_eq!(unstable(&yield_of(&loose, &half(), 32, 2.0)), 16);
    let all = [Device {
        deviations: [0.0; 8],
        value: Err(Failure::Unstable),
    }; 3];
    let none = Yield::of(&all, &[], Some(1.0));
    assert_eq!((none.mean, none.deviation, unstable(&none)), (None, None, 3));
    assert!(
        none.quantiles
            .iter()
            .all(|quantile| quantile.value.value == f64::NEG_INFINITY)
    );
    let reached = none.reached.unwrap();
    assert!(reached.interval[0] == 0.0 && reached.interval[1] > 0.5);
}

#[test]
fn nothing_that_varies_and_what_does_not_fit_are_refused() {
    let of = |scene: Scene, text: &str| {
        let options = SolveOptions::on(Mesh::bilinear(1));
        Study::new(vec![scene], tolerances(text), options, WorkLimit::default(), 1).err()
    };
    assert_eq!(of(Scene::vhb4910(), "{ voltage: 0 % }"), Some(ToleranceError::None));
    assert_eq!(of(Scene::vhb4910(), "{ lost_cells: 1 % }"), None);
    let drawn = study(Scene::vhb4910(), "{ mask: 0.1 mm }");
    let Fabricated::Pattern(cut) = fabricated(
        &half(),
        None,
        membrane(),
        &MaskOffsets {
            wider_mm: 0.2,
            shift_mm: [0.0; 2],
        },
        &LOST,
    )
    .unwrap() else {
        panic!("a pattern");
    };
    assert_eq!(drawn.check(&cut), Err(ToleranceError::Cells { tolerance: "mask" }));
    assert_eq!(drawn.check(&half()), Ok(()));
}

#[test]
fn devices_are_the_same_whatever_is_simulated_with_them() {
    let study = study(Scene::vhb4910(), "{ thickness: 3 %, mask: 0.15 mm, lost_cells: 1 % }");
    let at = |range| {
        study
            .devices(&half(), range, |fields| fields[0].at([25.0, 25.0])[0], || {})
            .unwrap()
    };
    let (all, later) = (at(0..8), at(4..8));
    assert_eq!(all[4..], later[..]);
}

#[test]
fn devices_have_the_solutions_from_rest() {
    let to_the_right = |field: &Field| field.at([25.0, 25.0])[0];
    let text = "{ voltage: 1 %, shear_modulus: { relative: 10 %, distribution: lognormal }, thickness: 5 %, \
                permittivity: 2 %, prestretch: 2 % }";
    for volts in [3000.0, 5250.0, 7000.0] {
        let scene = Scene::vhb4910().at_voltage(volts);
        let tolerances = tolerances(text);
        let study = study(scene.clone(), text);
        let devices = study
            .devices(&half(), 0..48, |fields| to_the_right(&fields[0]), || {})
            .unwrap();
        let mut failures = 0;
        for device in &devices {
            let own = crate::device::scene(&scene, &tolerances, &device.deviations).unwrap();
            let solver = MembraneSolver::new(&own, SolveOptions::on(Mesh::bilinear(1))).unwrap();
            let solution = solver.solve(&half());
            match device.value {
                Ok(mm) => {
                    let expected = to_the_right(&solver.field(&solution));
                    assert!(
                        solution.outcome.is_converged() && (mm / expected - 1.0).abs() < 1e-7,
                        "{mm} {expected}"
                    );
                }
                Err(failure) => {
                    assert!(failure == Failure::Unstable && !solution.outcome.is_converged());
                    failures += 1;
                }
            }
        }
        assert!(volts < 6000.0 || (3..45).contains(&failures), "{failures}");
    }
}
