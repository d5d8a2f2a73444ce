//! An interrupt ends what is computed within a few iterations.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::*;
use crate::screening::{TestPattern, screen};
use deaflow_base::Interrupt;

/// Checks of the interrupt after it is raised, at most, or a tenth of all: each takes an iteration or less.
const LATE_CHECKS: u64 = 40;

/// Runs work on a thread of its own, whose interrupt is raised at its check number `at`, counted from 1. Returns the
/// result and the number of checks.
fn interrupted<T: Send + 'static>(at: u64, work: impl FnOnce() -> T + Send + 'static) -> (T, u64) {
    let checks = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&checks);
    let interrupt = Interrupt::when(move || count.fetch_add(1, Ordering::Relaxed) + 1 >= at);
    let run = move || {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .start_handler(move |_| interrupt.clone().watch())
            .build()
            .unwrap();
        pool.install(work)
    };
    (run(), checks.load(Ordering::Relaxed))
}

/// Runs work without an interrupt, then interrupts it in its middle and near its end: it checks the interrupt many
/// times, and only a few times more once it is raised. Returns the interrupted results.
fn in_the_middle<T: Send + 'static>(work: impl Fn() -> T + Clone + Send + 'static) -> Vec<T> {
    let (_, all) = interrupted(u64::MAX, work.clone());
    assert!(all > 2 * LATE_CHECKS, "the interrupt is checked {all} times");
    let each = [1, all / 2, all * 9 / 10].into_iter();
    each.map(|at| {
        let (found, checks) = interrupted(at, work.clone());
        assert!(
            checks - at <= LATE_CHECKS.max(all / 10),
            "{checks} checks, interrupted at {at} of {all}"
        );
        found
    })
    .collect()
}

#[test]
fn an_interrupt_ends_a_solution_and_the_searches_for_limits() {
    let options = SolveOptions::on(Mesh::bilinear(1));
    let beyond = Scene::vhb4910().at_voltage(9e3);
    let outcomes = in_the_middle(move || MembraneSolver::new(&beyond, options).unwrap().solve(&half()).outcome);
    assert!(outcomes.contains(&Outcome::WorkLimit), "{outcomes:?}");
    let reports = in_the_middle(move || {
        let solver = MembraneSolver::new(&Scene::vhb4910(), options).unwrap();
        solver.stability(&half(), &solver.solve(&half()))
    });
    assert!(reports.iter().all(|report| report.critical.is_none()), "{reports:?}");
    let limits = in_the_middle(move || {
        let solver = MembraneSolver::new(&Scene::vhb4910(), options).unwrap();
        solver.limit_between(&half(), [5e3, 8e3])
    });
    assert!(limits.iter().all(Option::is_none), "{limits:?}");
    let searches = in_the_middle(move || {
        let search = CriticalSearch::for_solutions_on(&Scene::vhb4910(), options).unwrap();
        search.near_on_coarse(&half(), 6.5e3)
    });
    assert!(searches.iter().all(Option::is_none), "{searches:?}");
}

#[test]
fn an_interrupt_ends_paths_gradients_and_screening() {
    let options = SolveOptions::on(Mesh::bilinear(1));
    in_the_middle(move || {
        MembraneSolver::new(&Scene::vhb4910(), options)
            .unwrap()
            .path(&half())
            .is_some()
    });
    in_the_middle(|| {
        let evaluator = GradientEvaluator::new(&Scene::vhb4910()).unwrap();
        let patterns: Vec<Pattern> = (0..8).map(random).collect();
        deaflow_field::Predictor::<Field>::predict_some(&evaluator, &patterns).unwrap()
    });
    in_the_middle(|| screen(&Scene::vhb4910(), &[TestPattern::new("half", half())]).is_ok());
}
