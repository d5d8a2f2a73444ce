//! Load paths: ends, points and events, and states beyond a fold.

use super::snapping::Stiffening;
use super::*;
use crate::continuation::{LoadingEnd, Problem};
use crate::newton::Workspace;
use crate::path::{curve::Curve, trace::follow};
use crate::precondition::Laplacian;

fn disc(radius: f64) -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, y| (x as f64 - 24.5).hypot(y as f64 - 24.5) < radius)
}

fn one_cell() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (25, 25))
}

fn path(scene: &Scene, order: Order, pattern: &Pattern) -> LoadPath {
    MembraneSolver::new(scene, options(1, order))
        .unwrap()
        .path(pattern)
        .unwrap()
}

#[test]
fn limits_are_those_of_an_independent_analysis() {
    // At 25 kPa, in V, by an independent analysis with one element per cell. A single cell needs a finer mesh than a
    // straight electrode.
    for (pattern, order, known, within) in [
        (half(), Order::Bilinear, 5500.0, 0.01),
        (one_cell(), Order::Biquadratic, 4550.0, 1e-3),
    ] {
        let limit = path(&soft(1e3), order, &pattern).limit().unwrap();
        assert!((limit.voltage / known - 1.0).abs() < within, "{limit:?} {known}");
    }
}

#[test]
fn a_membrane_active_everywhere_never_moves_and_is_lost_at_the_closed_form_voltage() {
    // H12: √κ = √(λ⁻² + 3λ⁻⁸), whatever the voltage of the scene.
    let all = Pattern::from_fn(Raster::PAPER, |_, _| true);
    for (prestretch, voltage) in [(1.5_f64, 1e5), (3.0, 0.0), (6.0, 1.0)] {
        let scene = Scene::with_values(50.0, 1.0, prestretch, 25e3, 4.7, voltage);
        let unit = scene.at_voltage(1e3);
        let exact = 1e3 * ((prestretch.powi(-2) + 3.0 * prestretch.powi(-8)) / unit.kappa()).sqrt();
        let path = path(&scene, Order::Bilinear, &all);
        let limit = path.limit().unwrap();
        assert_eq!((limit.kind, path.end), (EventKind::NotElliptic, PathEnd::NotElliptic));
        assert!((limit.voltage / exact - 1.0).abs() < 2e-5, "{} {exact}", limit.voltage);
        assert!(path.points.iter().all(|p| p.max_displacement < 1e-9));
    }
}

#[test]
fn limits_grow_with_the_root_of_the_modulus_and_a_bare_membrane_has_none() {
    let limit = |modulus| {
        let scene = Scene::with_values(50.0, 1.0, 3.0, modulus, 4.7, 3e3);
        path(&scene, Order::Bilinear, &one_cell()).limit().unwrap().voltage
    };
    assert!((limit(45e3) / limit(25e3) / 1.8f64.sqrt() - 1.0).abs() < 1e-6);
    let bare = path(
        &soft(1e3),
        Order::Bilinear,
        &Pattern::from_fn(Raster::PAPER, |_, _| false),
    );
    assert_eq!((bare.limit(), bare.end), (None, PathEnd::NoLimit));
}

#[test]
fn the_solver_agrees_with_the_path_on_both_sides_of_a_fold() {
    let path = path(&soft(1e3), Order::Bilinear, &one_cell());
    let limit = path.limit().unwrap();
    assert_eq!((limit.kind, path.watched), (EventKind::Fold, [25, 25]));
    let at = |voltage: f64| solver(&soft(voltage), 1).simulate(&[one_cell()]).remove(0);
    assert!(at(0.999 * limit.voltage).outcome.is_converged());
    let bracket = at(1.05 * limit.voltage).outcome.bracket().unwrap();
    assert!(
        bracket[0] < 1.0001 * limit.voltage && limit.voltage < 1.0001 * bracket[1],
        "{bracket:?}"
    );
    let stable = &path.points[..=limit.point];
    for point in [&stable[limit.point / 3], &stable[2 * limit.point / 3]] {
        let solved = at(point.voltage).field.unwrap().max_magnitude();
        assert!((solved / point.max_displacement - 1.0).abs() < 1e-7, "{point:?}");
    }
    assert!(stable.iter().all(|p| p.stable && p.negative_eigenvalues == 0));
    let beyond = &path.points[limit.point + 1..];
    assert!(beyond.len() > 3 && beyond.iter().all(|p| !p.stable && p.negative_eigenvalues == 1));
    let displacements: Vec<f64> = path.points.iter().map(|p| p.displacement).collect();
    assert!(displacements.is_sorted(), "it goes on moving past the fold");
    assert!(
        beyond
            .iter()
            .all(|p| p.voltage <= limit.voltage && p.smallest_eigenvalue < 0.0)
    );
}

#[test]
fn the_smallest_eigenvalue_falls_like_the_root_of_the_distance_to_a_fold() {
    let limit = path(&soft(1e3), Order::Bilinear, &one_cell()).limit().unwrap().voltage;
    let report = |share: f64| {
        let solver = solver(&soft(share * limit), 1);
        solver.stability(&one_cell(), &solver.solve(&one_cell()))
    };
    let [near, far] = [2e-4, 8e-4].map(|gap| report(1.0 - gap).smallest_eigenvalue.unwrap());
    assert!((far / near - 2.0).abs() < 0.05, "{far} {near}");
    for share in [0.01, 0.6, 0.98] {
        let margin = report(share).margin.unwrap();
        assert!((margin * share - 1.0).abs() < 1e-3, "{share}: {margin}");
    }
    let lost = report(1.1);
    assert!(lost.smallest_eigenvalue.is_none() && (lost.margin.unwrap() * 1.1 - 1.0).abs() < 1e-3);
}

#[test]
fn margins_of_uniform_membranes_have_closed_forms() {
    // u = 0, and the tangent is L + (3a − b) (div)² + multiples of a null Lagrangian with a = λ⁻⁶, b = κλ²: for fields
    // without rotation the smallest eigenvalue is 1 + 3a − b, which a mesh approaches from above.
    let all = Pattern::from_fn(Raster::PAPER, |_, _| true);
    let scene = soft(6e3);
    let solver = solver(&scene, 1);
    let results = [all, Pattern::from_fn(Raster::PAPER, |_, _| false)].map(|pattern| {
        let solution = solver.solve(&pattern);
        (solution.outcome, solver.stability(&pattern, &solution))
    });
    let exact = 1.0 + 3.0 * 3f64.powi(-6) - 9.0 * scene.kappa();
    let [(full, report), (_, bare)] = &results;
    assert!(full.is_converged());
    let value = report.smallest_eigenvalue.unwrap();
    assert!((-1e-6..2e-3).contains(&(value - exact)), "{value} {exact}");
    assert!((report.margin.unwrap() * 6e3 / 8186.86 - 1.0).abs() < 1e-3);
    assert_eq!((bare.critical, bare.margin), (None, None));
    let resting = MembraneSolver::new(&soft(0.0), options(1, Order::Bilinear)).unwrap();
    let report = resting.stability(&one_cell(), &resting.solve(&one_cell()));
    assert!(report.critical.is_some() && report.margin.is_none());
}

/// Materials at shares of the load, of the type that scenes have.
type Law<'a> = &'a (dyn Fn(f64) -> AnyMaterial + Sync);

fn with_stiffening<R>(work: impl FnOnce(&Problem<'_, Law<'_>>) -> R) -> R {
    let grid = Grid::paper(Mesh::new(1, Order::Bilinear));
    let activity = Activity::new(&grid, &disc(1.0));
    let problem = Problem {
        activity: &activity,
        laplacian: &Laplacian::new(&grid).unwrap(),
        material: &Stiffening::at as Law<'_>,
        tolerance: 1e-10,
        at_rest: None,
    };
    work(&problem)
}

#[test]
fn a_stiffening_membrane_snaps_to_another_stable_branch() {
    with_stiffening(|problem| {
        let trace = follow(&Curve::new(problem).unwrap(), |state| state);
        let folds: Vec<(EventKind, f64)> = trace.events.iter().map(|event| (event.kind, event.share)).collect();
        assert_eq!(trace.end, PathEnd::Recovered);
        assert_eq!(trace.events.len(), 2);
        assert!(folds.iter().all(|(kind, _)| *kind == EventKind::Fold) && folds[1].1 < folds[0].1);
        assert!(trace.states.last().unwrap().stable);
        // Every state on the way is an equilibrium.
        for state in &trace.states {
            let material = Stiffening::at(state.share);
            let operator = Operator::new(&material, problem.activity);
            let mut force = vec![0.0; state.u.len()];
            assert!(operator.residual(&state.u, &mut force) > 0.0);
            assert!(norm(&force) < 1e-8);
        }
    });
}

#[test]
fn loading_does_not_jump_to_the_branch_beyond_a_snap() {
    with_stiffening(|problem| {
        let first = follow(&Curve::new(problem).unwrap(), |_| ()).events[0].share;
        for share in [0.98, 1.02, 1.3, 2.0] {
            let law = |part: f64| Stiffening::at(part * share * first);
            let problem = Problem {
                material: &law as Law<'_>,
                activity: problem.activity,
                laplacian: problem.laplacian,
                tolerance: problem.tolerance,
                at_rest: None,
            };
            let mut u = vec![0.0; problem.activity.grid().layout().vector_len()];
            let mut workspace = Workspace::new(u.len(), problem.laplacian);
            match problem.load(&mut u, &mut workspace).ending {
                LoadingEnd::Stable => assert!(share < 1.0, "{share}"),
                LoadingEnd::Lost { stable, unstable, .. } => {
                    assert!(
                        stable * share < 1.0001 && unstable * share > 0.9999,
                        "{share}: {stable} {unstable}"
                    );
                }
                LoadingEnd::Unknown { .. } | LoadingEnd::WorkLimit { .. } => panic!("{share}"),
            }
        }
    });
}
