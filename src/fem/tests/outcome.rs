//! A pattern without stable equilibrium has an outcome and no numbers.

use super::*;

#[test]
fn uniform_active_membrane_is_refused_above_its_critical_voltage() {
    // H12: stability is lost at Ē = 0.334018500209, which is 10.9838 kV.
    let solver = |voltage| solver(&Scene::vhb4910().at_voltage(voltage), 1);
    let all = [Pattern::from_fn(Raster::PAPER, |_, _| true)];
    assert_eq!(solver(10_983.5).simulate(&all)[0].outcome, Outcome::Converged);
    for voltage in [10_984.1, 12e3, 1e6, 1e12] {
        let result = solver(voltage).simulate(&all).remove(0);
        let bracket = result.outcome.bracket().unwrap();
        assert_eq!(result.outcome.name(), "not-elliptic");
        assert!(
            bracket[0] < 10_983.8 && 10_983.8 < bracket[1] && bracket[1] < 1.0011 * bracket[0],
            "{bracket:?}"
        );
        assert_eq!(result.field, None);
    }
}

#[test]
fn brackets_of_the_loss_of_stability_agree_whatever_voltage_is_asked_for() {
    let scene = Scene::vhb4910();
    let pattern = random(3);
    let bracket = |voltage: f64| match solver(&scene.at_voltage(voltage), 1).simulate(std::slice::from_ref(&pattern))[0]
        .outcome
    {
        Outcome::PullIn {
            last_stable,
            first_unstable,
        } => [last_stable, first_unstable],
        other => panic!("{other} at {voltage} V"),
    };
    let low = bracket(8e3);
    assert!(low[1] / low[0] - 1.0 < 1.1e-3, "{low:?}");
    for voltage in [12e3, 100e3] {
        let high = bracket(voltage);
        assert!(high[0] < low[1] && low[0] < high[1], "{low:?} {high:?}");
    }
    assert!(field(&scene.at_voltage(low[0]), 1, &pattern).max_magnitude() > 0.0);
}

#[test]
fn a_disc_beyond_its_fold_is_refused() {
    // H6: a disc of radius 10 mm in a clamped circle of radius 25 mm folds at κ = 0.03938512, 6.526 kV at 45 kPa. The
    // square around that circle is softer, so it folds before.
    let disc = Pattern::from_fn(Raster::PAPER, |x, y| (x as f64 - 24.5).hypot(y as f64 - 24.5) < 10.0);
    let outcome =
        |voltage| solver(&Scene::vhb4910().at_voltage(voltage), 1).simulate(std::slice::from_ref(&disc))[0].outcome;
    assert_eq!(outcome(5.0e3), Outcome::Converged);
    assert!(!outcome(6.6e3).is_converged());
}

#[test]
fn every_scene_ends_with_a_field_or_a_reason() {
    let single = Pattern::from_fn(Raster::PAPER, |x, y| x == 20 && y == 31);
    for prestretch in [1.0, 1.3, 2.0, 5.0, 10.0] {
        for voltage in [0.0, 1.0, 3e3, 8e3, 2e4, 1e6] {
            let scene = Scene::with_values(50.0, 1.0, prestretch, 45e3, 4.7, voltage);
            for result in solver(&scene, 1).simulate(&[half(), random(3), single.clone()]) {
                assert_ne!(
                    result.outcome,
                    Outcome::IterationLimit,
                    "λp = {prestretch}, {voltage} V"
                );
                assert_eq!(result.field.is_some(), result.outcome.is_converged());
                assert!(voltage < 1e6 || !result.outcome.is_converged());
                assert!(voltage > 1.0 || result.outcome.is_converged());
            }
        }
    }
}

#[test]
fn the_inertia_counts_the_unstable_modes() {
    // H12: at u = 0 the uniform active membrane is stable below κ = 0.334018500209², and unstable in every mode above.
    let grid = Grid::paper(Mesh::new(1, Order::Bilinear));
    let activity = Activity::new(&grid, &Pattern::from_fn(Raster::PAPER, |_, _| true));
    let u = vec![0.0; grid.layout().vector_len()];
    let negative = |kappa: f64| {
        let material = AnyMaterial::from(NeoHookean::new(3.0, kappa));
        let operator = Operator::new(&material, &activity);
        Factorisation::new(&operator, &u).unwrap().negative_pivots()
    };
    assert_eq!(negative(0.334_f64.powi(2)), 0);
    assert!(negative(0.336_f64.powi(2)) > 0);
}

#[test]
fn options_out_of_range_are_refused() {
    let scene = Scene::vhb4910();
    for elements_per_cell in [0, 9] {
        assert!(MembraneSolver::new(&scene, options(elements_per_cell, Order::Bilinear)).is_err());
    }
    for tolerance in [0.0, f64::NAN, 1.0] {
        let options = SolveOptions {
            tolerance,
            ..SolveOptions::default()
        };
        assert!(MembraneSolver::new(&scene, options).is_err());
    }
}
