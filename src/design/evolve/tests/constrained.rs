//! Searches under constraints and margins.

use std::sync::Mutex;

use super::*;
use crate::{Limits, Sides};
use deaflow_pattern::Region;
use deaflow_pattern::{Membrane, Raster};

fn limited() -> Constraints {
    let limits = Limits {
        min_feature_mm: Some(4.0),
        islands: Some(1),
        leads: Some(Sides::ALL),
        keep_out: vec![Region::Disc {
            centre: [25.0, 25.0],
            radius: 5.0,
        }],
        ..Limits::default()
    };
    Constraints::new(limits, Membrane::square(50.0)).unwrap()
}

fn under(constraints: &Constraints, goal: &Goal, options: &EvolveOptions) -> Evolution {
    let linear = Linear::new([25.0, 25.0]);
    let problem = EvolveProblem {
        constraints,
        ..free(&linear, goal)
    };
    evolve(&problem, options, &|_: &GenerationReport| ()).unwrap()
}

#[test]
fn a_search_satisfies_its_constraints() {
    let constraints = limited();
    let goal = goal(0.5);
    let found = under(&constraints, &goal, &small(2));
    let winner = &found.winners[0];
    assert!(constraints.satisfied_by(&winner.pattern) && winner.violations.is_empty());
    assert!((winner.area - 0.5).abs() < 0.02, "area {}", winner.area);
    let last = found.history.last().unwrap();
    assert_eq!((winner.fitness, winner.value_mm), (last.best, last.value_mm));
    // The constraints reduce the value, which is still far above that of the first random patterns.
    let unconstrained = run(&small(2), 0.5).winners[0].value_mm;
    assert!(winner.value_mm < unconstrained && winner.value_mm > found.history[0].value_mm + 0.2);
    assert_eq!(winner.value_mm, Linear::new([25.0, 25.0]).device.value(&winner.pattern));
}

#[test]
fn units_in_keep_out_regions_are_off() {
    let limits = Limits {
        keep_out: vec![Region::Rectangle([[0.0, 0.0], [20.0, 50.0]])],
        ..Limits::default()
    };
    let constraints = Constraints::new(limits, Membrane::square(50.0)).unwrap();
    let found = under(&constraints, &goal(0.5), &small(2));
    // Only the 60 % on the right are left, all behind the point or beside it.
    assert!(
        found
            .history
            .iter()
            .all(|report| (0..8).all(|x| (0..20).all(|y| report.genome.group(x, y) == 0)))
    );
    assert!((found.winners[0].area - 0.5).abs() < 0.02);
    // The search knows it: no two genomes that differ in these units alone are judged.
    let first = first_generation(Some(0.9), &constraints, 1, 50);
    assert!(
        first
            .iter()
            .all(|genome| genome.pattern(Raster::PAPER).active_cells() == 1500)
    );
}

#[test]
fn violated_constraints_are_reported() {
    // Only the whole corner is an electrode that is wide enough, and the target area is half of it.
    let limits = Limits {
        min_feature_mm: Some(10.0),
        keep_out: vec![
            Region::Rectangle([[10.0, 0.0], [50.0, 50.0]]),
            Region::Rectangle([[0.0, 10.0], [50.0, 50.0]]),
        ],
        ..Limits::default()
    };
    let constraints = Constraints::new(limits, Membrane::square(50.0)).unwrap();
    let options = EvolveOptions {
        generations: 0,
        population: 10,
        ..small(1)
    };
    let found = under(&constraints, &goal(0.015), &options);
    let winner = &found.winners[0];
    assert!(!constraints.satisfied_by(&winner.pattern) && winner.fitness > 1.0);
    let words = winner.violations.to_string();
    assert!(words.contains("narrower than 10 mm"), "{words}");
}

/// Accepts patterns with at most 625 active cells in the left half; counts the checked patterns.
struct Left(Mutex<usize>);

fn left(pattern: &Pattern) -> usize {
    (0..50 * 25).filter(|i| pattern.is_active(i % 25, i / 25)).count()
}

impl Feasibility for Left {
    fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
        *self.0.lock().unwrap() += patterns.len();
        Ok(patterns.iter().map(|pattern| left(pattern) <= 625).collect())
    }
}

#[test]
fn margins_are_checked_for_the_best_only() {
    let (linear, goal) = (Linear::new([25.0, 25.0]), goal(0.5));
    let feasibility = Left(Mutex::new(0));
    let problem = EvolveProblem {
        feasibility: Some(&feasibility),
        ..free(&linear, &goal)
    };
    let bests = RefCell::new(Vec::new());
    let watch = |report: &GenerationReport| bests.borrow_mut().push(left(&report.genome.pattern(Raster::PAPER)));
    let options = EvolveOptions { designs: 3, ..small(1) };
    let found = evolve(&problem, &options, &watch).unwrap();
    // Free to choose, the search fills the left half.
    assert!(left(&run(&small(1), 0.5).best_pattern()) > 700);
    assert!(bests.borrow().iter().all(|&left| left <= 625));
    assert!(found.winners.iter().all(|winner| left(&winner.pattern) <= 625));
    assert!(found.history.last().unwrap().value_mm > found.history[0].value_mm);
    let checked = *feasibility.0.lock().unwrap();
    assert!(
        checked > 0 && 2 * checked < found.evaluations,
        "{checked} of {}",
        found.evaluations
    );
}

/// Returns the same verdicts for all patterns.
struct Verdict(fn(usize) -> Result<Vec<bool>, PredictError>);

impl Feasibility for Verdict {
    fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
        self.0(patterns.len())
    }
}

#[test]
fn margins_that_no_pattern_satisfies_are_an_error() {
    let judged = |verdict| {
        let (linear, goal) = (Linear::new([25.0, 25.0]), goal(0.5));
        let problem = EvolveProblem {
            feasibility: Some(&Verdict(verdict)),
            ..free(&linear, &goal)
        };
        evolve(&problem, &small(1), &|_: &GenerationReport| ())
    };
    let none = judged(|count| Ok(vec![false; count])).unwrap_err();
    assert!(matches!(none, EvolveError::NotFeasible), "{none}");
    let failed = judged(|_| Err(PredictError::failed("no memory")))
        .unwrap_err()
        .to_string();
    assert!(failed.contains("no memory"), "{failed}");
    let few = judged(|count| Ok(vec![true; count - 1])).unwrap_err().to_string();
    assert!(few.contains("verdicts for"), "{few}");
    // A check that accepts all patterns changes nothing.
    assert_eq!(judged(|count| Ok(vec![true; count])).unwrap(), run(&small(1), 0.5));
}

#[test]
fn a_free_area_starts_from_many_areas() {
    let areas: Vec<f64> = first_generation(None, &Constraints::none(Membrane::square(50.0)), 1, 200)
        .iter()
        .map(|genome| genome.pattern(Raster::PAPER).area_fraction(None))
        .collect();
    let share = |from: f64, to: f64| areas.iter().filter(|&&a| (from..to).contains(&a)).count();
    assert_eq!(share(0.0, 0.03) + share(0.97, 1.1), 0);
    for tenth in 1..9 {
        let from = f64::from(tenth) / 10.0;
        assert!(share(from, from + 0.1) > 8, "{from}: {}", share(from, from + 0.1));
    }
    assert_eq!(
        first_generation(None, &Constraints::none(Membrane::square(50.0)), 1, 10),
        first_generation(None, &Constraints::none(Membrane::square(50.0)), 1, 200)[..10]
    );
}

#[test]
fn a_free_area_comes_close_to_the_optimum() {
    // Free to choose its area, the best pattern of a linear answer is all cells that help.
    let linear = Linear::new([37.5, 25.0]);
    let helpful: Vec<f64> = linear.device.worth.iter().copied().filter(|&w| w > 0.0).collect();
    let aim = Aim::new([37.5, 25.0], Motion::Along(0.0));
    let goal = Goal::new(&Displacement, &[aim], Membrane::square(50.0), None, AREA_PENALTY).unwrap();
    let options = EvolveOptions {
        population: 300,
        generations: 40,
        ..small(1)
    };
    let found = evolved(&linear, &goal, &options).unwrap();
    let share = found.winners[0].value_mm / helpful.iter().sum::<f64>();
    assert!(share > 0.97 && share <= 1.0, "{share} of the optimum");
    let area = helpful.len() as f64 / 2500.0;
    assert!(
        (found.winners[0].area - area).abs() < 0.05,
        "{} instead of {area}",
        found.winners[0].area
    );
}
