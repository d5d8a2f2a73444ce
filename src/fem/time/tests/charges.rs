//! Charges and sources with inertia, and charges with the finite law: energy balances, orders, equilibria and
//! frequencies.

use std::f64::consts::TAU;

use super::bodies::{by_steps, open_balance, solver, within};
use super::*;
use crate::SetupError;
use crate::charge::sprayed;
use crate::energy::NeoHookean;
use crate::mass::Mass;
use crate::material::AnyMaterial;
use crate::operator::Operator;
use crate::time::modes::lowest;

const FED: [&str; 4] = [
    "charge: { total: 1 uC }",
    "charge: { immobile: 1 uC }",
    "voltage: 4 kV, source: { resistance: 5 MOhm }",
    "voltage: 4 kV, source: { resistance: 1 MOhm, current_limit: 0.2 mA }, waveform: { ramp: { time: 2 ms } }",
];

fn moving(drive: &str, more: &str) -> Scene {
    scene(&format!(
        "{SQUARE}, drive: {{ {drive} }}, properties: {{ density: 960 }}, effects: {{ inertia: {{}}, {more} }}"
    ))
}

#[test]
fn motion_at_a_charge_and_behind_a_source_keeps_its_energy() {
    let branch = "viscoelasticity: { law: finite, branches: [{ modulus: 20 kPa, time: 3 ms }] }";
    for (drive, more) in FED.into_iter().flat_map(|drive| ["", branch].map(|more| (drive, more))) {
        let found = within(&moving(drive, more), &odd(ten()), vec![0.0, 1e-3, 4e-3], 1e-3);
        assert!(found.outcome.is_converged(), "{drive} {more}: {}", found.outcome);
        let open = open_balance(&found);
        assert!(open < 1e-8, "{drive} {more}: {open:e}");
        let last = found.instants.last().unwrap();
        assert!(
            last.charge > 0.0 && last.kinetic > 0.0 && found.fields[2].max_magnitude() > 0.05,
            "{drive}"
        );
        for pair in found.instants.windows(2) {
            assert!(
                pair[1].dissipated >= pair[0].dissipated - 1e-9 * last.supplied,
                "{drive} {more} {}",
                pair[1].time
            );
        }
        for now in &found.instants {
            let twice = 2.0 * now.electric;
            assert!((twice - now.charge * now.voltage).abs() <= 1e-12 * twice, "{drive}");
        }
        if drive.starts_with("charge") {
            assert!(found.instants.iter().all(|now| (now.charge / 1e-6 - 1.0).abs() < 1e-12));
            assert!(
                found
                    .instants
                    .iter()
                    .all(|now| now.supplied == found.instants[0].supplied)
            );
        } else {
            assert!(found.instants[0].charge == 0.0 && last.dissipated > 0.0);
        }
    }
}

#[test]
fn motion_behind_a_source_is_of_second_order() {
    // With a voltage that rises slowly from zero, so does the charge.
    let scene = moving(
        "voltage: 4 kV, source: { resistance: 2 MOhm }, waveform: { ramp: { time: 5 ms } }",
        "",
    );
    let found = by_steps(
        &[1e-2, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 1e-9],
        |accuracy| within(&scene, &odd(ten()), vec![2e-3, 4e-3], accuracy),
    );
    // The last passes are not extrapolated: x(n) = x + e/n².
    let at = |found: &History| {
        (
            found.asked().last().unwrap().charge,
            (found.instants.len() as f64 - 1.0).powi(-2),
        )
    };
    let [coarse, middle, fine] = found.each_ref().map(at);
    let slope = (coarse.0 - middle.0) / (coarse.1 - middle.1);
    let error = middle.0 + slope * (fine.1 - middle.1) - fine.0;
    assert!(
        error.abs() < 0.05 * (slope * coarse.1).abs() + 1e-9 * fine.0,
        "{error:e} {:e}",
        slope * coarse.1
    );
}

#[test]
fn viscous_motion_comes_to_rest_at_the_equilibrium_of_what_feeds_it() {
    for (drive, still) in [
        (FED[0], FED[0]),
        (FED[1], FED[1]),
        (FED[2], "voltage: 4 kV"),
        (FED[3], "voltage: 4 kV"),
    ] {
        let branch = "viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 ms }] }";
        let found = within(&moving(drive, branch), &odd(ten()), vec![0.08], 1e-2);
        assert!(found.outcome.is_converged(), "{drive}: {}", found.outcome);
        let still = scene(&format!("{SQUARE}, drive: {{ {still} }}, effects: {{}}"));
        let still = solver(&still).simulate(&[odd(ten())]).remove(0).field.unwrap();
        let apart = found.fields[0].max_difference(&still);
        assert!(apart < 1e-3 * still.max_magnitude(), "{drive}: {apart:e}");
        assert!(open_balance(&found) < 1e-8, "{drive}");
    }
}

#[test]
fn a_stiff_source_is_a_voltage_and_a_weak_one_does_nothing() {
    let ramp = "waveform: { ramp: { time: 5 ms } }";
    let at = |source: &str| {
        let scene = moving(&format!("voltage: 4 kV, {ramp}{source}"), "");
        within(&scene, &odd(ten()), vec![5e-3], 1e-5)
    };
    let [plain, stiff, weak] = [
        "",
        ", source: { resistance: 1 Ohm }",
        ", source: { resistance: 1e18 Ohm }",
    ]
    .map(at);
    let size = plain.fields[0].max_magnitude();
    let apart = plain.fields[0].max_difference(&stiff.fields[0]);
    assert!(apart < 3e-4 * size, "{apart:e} of {size}");
    assert!(weak.outcome.is_converged() && weak.fields[0].max_magnitude() < 1e-9 * size);
}

#[test]
fn a_body_in_a_charged_membrane_swings_at_its_linear_frequency() {
    // The whole membrane is an electrode: it moves only by the small force on the body, about a charged equilibrium at
    // rest.
    let all = Pattern::from_fn(ten(), |x, y| !((3..6).contains(&x) && (4..6).contains(&y)));
    let geometry = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10, bodies: \
                    [{ rectangle: [[15 mm, 20 mm], [30 mm, 30 mm]], load: [20 uN, 0 N] }] }";
    let mut first = Vec::new();
    for (drive, is_sprayed) in [("charge: { total: 4 uC }", false), ("charge: { immobile: 4 uC }", true)] {
        let charged = scene(&format!("{geometry}, drive: {{ {drive} }}, {MOVING}"));
        let solver = solver(&charged);
        let plain = solver.model.activity(&solver.grid, &all);
        let mass = Mass::new(&solver.grid, false);
        let none = vec![0.0; solver.grid.layout().vector_len()];
        // C = ε λp² A/H at rest; to first order it does not change with a small translation of the body.
        let area = (100.0 - 6.0) * 25e-6;
        let volts = 4e-6 * 1e-3 / (charged.permittivity() * 9.0 * area);
        let share = (volts / charged.voltage_v()).powi(2);
        let kappa = if is_sprayed { 0.0 } else { share * charged.kappa() };
        let law = AnyMaterial::from(NeoHookean::new(3.0, kappa));
        let activity = match is_sprayed {
            true => sprayed(&plain, &charged, 4e-6),
            false => plain,
        };
        let operator = Operator::new(&law, &activity);
        let modes = lowest(&operator, &solver.laplacian, &mass, &none, 4);
        let per_second = crate::time::modes::wave_speed(&charged).unwrap() / (1e-3 * solver.grid.unit_mm());
        let hertz: Vec<f64> = modes.iter().map(|(value, _)| value.sqrt() * per_second / TAU).collect();
        let times: Vec<f64> = (0..16).map(|k| 0.13 * f64::from(k) / hertz[0]).collect();
        let found = within(&charged, &all, times.clone(), 1e-7);
        assert!(found.outcome.is_converged(), "{drive}");
        let layout = solver.grid.layout();
        let along = |mode: &[f64], field: &Field| {
            let mut u = none.clone();
            for (x, y) in (0..=10).flat_map(|y| (0..=10).map(move |x| (x, y))) {
                for (c, value) in field.at_corner(x, y).into_iter().enumerate() {
                    u[layout.index(c, x, y)] = value;
                }
            }
            let mut heavy = none.clone();
            mass.apply(&u, &mut heavy);
            mode.iter().zip(&heavy).map(|(a, b)| a * b).sum::<f64>()
        };
        let reach = |mode: &[f64]| {
            found
                .fields
                .iter()
                .map(|field| along(mode, field).abs())
                .fold(0.0, f64::max)
        };
        let largest = modes.iter().map(|(_, mode)| reach(mode)).fold(0.0, f64::max);
        let mut moved = 0;
        for ((_, mode), hertz) in modes.iter().zip(&hertz) {
            if reach(mode) < 0.1 * largest {
                continue;
            }
            moved += 1;
            // A(1 − cos ωt): the amplitude by least squares.
            let swing: Vec<f64> = times.iter().map(|time| 1.0 - (TAU * hertz * time).cos()).collect();
            let values: Vec<f64> = found.fields.iter().map(|field| along(mode, field)).collect();
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let amplitude = product(&swing, &values) / product(&swing, &swing);
            for (value, swing) in values.iter().zip(&swing) {
                let error = (value - amplitude * swing).abs();
                assert!(
                    error < 3e-3 * amplitude.abs(),
                    "{drive}, {hertz} Hz: {error:e} of {amplitude:e}"
                );
            }
        }
        assert!(moved >= 1);
        first.push(hertz[0]);
    }
    // A spreading field softens, a fixed one stiffens.
    assert!(first[0] < 0.99 * first[1], "{first:?}");
}

#[test]
fn charge_that_stays_does_not_pull_in_at_once() {
    let half = Pattern::from_fn(ten(), |x, _| x < 5);
    // Half of the membrane at rest has 4.2 µC at 9 kV.
    for (drive, holds) in [
        ("charge: { immobile: 5 uC }", true),
        ("voltage: 9 kV", false),
        ("charge: { total: 14 uC }", false),
    ] {
        let found = within(&moving(drive, ""), &half, vec![0.0, 0.02], 0.1);
        assert_eq!(found.outcome.is_converged(), holds, "{drive}: {}", found.outcome);
        if holds {
            let open = open_balance(&found);
            assert!(open < 1e-8, "{open:e}");
        } else {
            assert!(
                matches!(found.outcome, Outcome::DelayedPullIn { .. }),
                "{}",
                found.outcome
            );
        }
    }
    // Without electrodes there is no charge.
    let bare = Pattern::from_fn(ten(), |_, _| false);
    for drive in FED {
        let found = within(&moving(drive, ""), &bare, vec![0.0, 1e-3], 1e-3);
        assert!(found.outcome.is_converged());
        assert!(
            found
                .instants
                .iter()
                .all(|now| now.charge == 0.0 && now.electric == 0.0 && now.voltage == 0.0)
        );
        assert_eq!(found.fields[1], Field::zero(ten()));
    }
}

#[test]
fn conducting_charge_creeps_by_the_finite_law_to_second_order() {
    let scene = square_of_ten(
        "charge: { total: 1.5 uC }",
        "viscoelasticity: { law: finite, branches: [{ modulus: 60 kPa, time: 1 s }, { modulus: 30 kPa, time: 10 s }] }",
        "",
    );
    let found = [1e-3, 1e-4, 1e-6].map(|accuracy| within(&scene, &odd(ten()), vec![0.5, 3.0], accuracy));
    for found in &found {
        assert_eq!(found.outcome, Outcome::Converged);
    }
    for coarse in &found[..2] {
        let error = coarse.difference(&found[2]);
        let said = coarse.time_error_mm.unwrap();
        assert!(
            error <= 1.5 * said + 2e-6 && said <= 4.0 * error + 2e-6,
            "{error:e} {said:e}"
        );
    }
    let linear = square_of_ten(
        "charge: { total: 1.5 uC }",
        "viscoelasticity: { law: linear, branches: [{ modulus: 60 kPa, time: 1 s }, { modulus: 30 kPa, time: 10 s }] }",
        "",
    );
    let other = within(&linear, &odd(ten()), vec![0.5, 3.0], 1e-4);
    // The laws differ by a few per cent in between.
    let apart = other.difference(&found[1]);
    assert!(
        apart > 1e-3 * other.fields[1].max_magnitude() && apart < 0.1 * other.fields[1].max_magnitude(),
        "{apart}"
    );
}

#[test]
fn charges_on_what_moves_and_wrinkles_are_refused() {
    for drive in [FED[0], FED[2]] {
        let refused = history::refusal(&moving(drive, "wrinkling: {}")).unwrap();
        assert_eq!(refused, SetupError::MovingCharge);
        assert!(refused.is_of_the_scene() && refused.to_string().contains("`wrinkling`"));
    }
    assert_eq!(history::refusal(&moving(FED[1], "wrinkling: {}")), None);
    assert_eq!(history::refusal(&moving("voltage: 3 kV", "wrinkling: {}")), None);
}
