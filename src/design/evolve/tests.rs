use std::cell::RefCell;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::*;
use crate::tests::TestDevice;
use crate::{AREA_PENALTY, Aim, Displacement, Motion, Qin2024};
use deaflow_field::{Field, InStates};
use deaflow_pattern::{CELLS, Membrane, Pattern, Raster};

mod constrained;
mod niches;
mod resumed;
mod rough;

/// A linear device that counts predictions.
struct Linear {
    device: TestDevice,
    predicted: AtomicUsize,
}

impl Linear {
    /// The far field of a point force at `point` (cells) along x, softened at the point and fading towards the frame:
    /// the shape of the influence of an active cell on the centre of a membrane. The best pattern at half area gives 2
    /// mm.
    fn new(point: [f64; 2]) -> Self {
        let weight = |cell: usize| {
            let centre = [(cell % CELLS) as f64 + 0.5, (cell / CELLS) as f64 + 0.5];
            let from = [centre[0] - point[0], centre[1] - point[1]];
            let fade = |c: f64| (std::f64::consts::PI * c / CELLS as f64).sin().sqrt();
            -from[0] / (from[0] * from[0] + from[1] * from[1] + 4.0) * fade(centre[1])
        };
        let weights: Vec<f64> = (0..CELLS * CELLS).map(weight).collect();
        let mean = weights.iter().sum::<f64>() / weights.len() as f64;
        let mut device = TestDevice::linear(weights.into_iter().map(|w| w - mean).collect());
        let best = device.best(1250);
        device.worth.iter_mut().for_each(|w| *w *= 2.0 / best);
        Self {
            device,
            predicted: AtomicUsize::new(0),
        }
    }
}

impl Predictor<StateFields> for Linear {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.predicted.fetch_add(patterns.len(), Ordering::Relaxed);
        InStates::one(&self.device).predict_some(patterns)
    }
}

fn goal(area: f64) -> Goal {
    let aim = Aim::new([25.0, 25.0], Motion::Along(0.0));
    Goal::new(&Displacement, &[aim], Membrane::square(50.0), Some(area), AREA_PENALTY).unwrap()
}

fn small(seed: u64) -> EvolveOptions {
    EvolveOptions {
        population: 60,
        generations: 20,
        seed,
        ..EvolveOptions::default()
    }
}

/// A problem without constraints.
fn free<'a>(predictor: &'a dyn Predictor<StateFields>, goal: &'a Goal) -> EvolveProblem<'a> {
    static NONE: std::sync::LazyLock<Constraints> =
        std::sync::LazyLock::new(|| Constraints::none(Membrane::square(50.0)));
    EvolveProblem {
        predictor,
        goal,
        constraints: &NONE,
        feasibility: None,
        rough: None,
    }
}

fn evolved(
    predictor: &dyn Predictor<StateFields>,
    goal: &Goal,
    options: &EvolveOptions,
) -> Result<Evolution, EvolveError> {
    evolve(&free(predictor, goal), options, &|_: &GenerationReport| ())
}

fn run(options: &EvolveOptions, area: f64) -> Evolution {
    evolved(&Linear::new([25.0, 25.0]), &goal(area), options).unwrap()
}

#[test]
fn the_papers_search_comes_close_to_the_optimum() {
    // The optimum of a linear answer is known: the cells with the largest weights. A search on units cannot quite
    // reach it; measured over areas from 5 % to 95 % and points at and off the centre are 92 % to 100 %.
    let linear = Linear::new([37.5, 25.0]);
    let options = EvolveOptions {
        seed: 1,
        ..EvolveOptions::default()
    };
    let result = evolved(&linear, &goal(0.3), &options).unwrap();
    let last = result.history.last().unwrap();
    assert!((last.area - 0.3).abs() < 0.002, "area {}", last.area);
    let share = last.value_mm / linear.device.best(750);
    assert!((0.97..=1.01).contains(&share), "{share} of the optimum");
    assert_eq!(last.value_mm, linear.device.value(&result.best_pattern()));
}

#[test]
fn every_generation_is_reported_and_improves() {
    let heard = RefCell::new(Vec::new());
    let watch = |report: &GenerationReport| heard.borrow_mut().push(report.clone());
    let (linear, goal) = (Linear::new([25.0, 25.0]), goal(0.5));
    let result = evolve(&free(&linear, &goal), &small(3), &watch).unwrap();
    assert_eq!(result.history, heard.into_inner());
    assert_eq!(
        result.history.iter().map(|r| r.generation).collect::<Vec<_>>(),
        (0..=20).collect::<Vec<_>>()
    );
    assert!(result.history.windows(2).all(|pair| pair[1].best <= pair[0].best));
    assert!(result.history.iter().all(|r| r.best <= r.mean));
    assert!(result.history[20].best < result.history[0].best - 0.1);
    assert_eq!(result.stop, Stop::Generations);
}

#[test]
fn a_search_depends_on_its_seed() {
    assert_eq!(run(&small(3), 0.5), run(&small(3), 0.5));
    assert_ne!(run(&small(3), 0.5).history, run(&small(4), 0.5).history);
    // More generations continue the same search.
    let longer = EvolveOptions {
        generations: 25,
        ..small(3)
    };
    assert_eq!(run(&small(3), 0.5).history[..], run(&longer, 0.5).history[..21]);
}

#[test]
fn results_of_one_design_without_constraints_are_stable() {
    // Results of earlier versions without constraints, margins and niches must not change.
    let found = run(&small(3), 0.5);
    let digest = deaflow_base::Digest::of(found.best_pattern().cells());
    assert_eq!((found.evaluations, digest.short().as_str()), (1137, "3b8510874004"));
}

#[test]
fn nothing_is_predicted_twice() {
    let linear = Linear::new([25.0, 25.0]);
    let result = evolved(&linear, &goal(0.5), &small(3)).unwrap();
    assert_eq!(linear.predicted.load(Ordering::Relaxed), result.evaluations);
    assert!(result.evaluations < 60 * 21 - 20);
}

#[test]
fn without_improvement_the_search_ends_early() {
    let options = EvolveOptions {
        stagnation: Some(4),
        ..small(1)
    };
    // The paper's literal objective is the same for all motions along the line, so nothing improves.
    let aim = Aim::new([25.0, 25.0], Motion::Along(0.0));
    let literal = Goal::new(&Qin2024, &[aim], Membrane::square(50.0), Some(0.5), 0.0).unwrap();
    let result = evolved(&Linear::new([25.0, 25.0]), &literal, &options).unwrap();
    assert_eq!((result.history.len(), result.stop), (5, Stop::Stagnation));
}

#[test]
fn extreme_searches_have_sound_results() {
    let random_only = EvolveOptions {
        generations: 0,
        ..small(1)
    };
    assert_eq!(run(&random_only, 0.5).history.len(), 1);
    let two = EvolveOptions {
        population: 2,
        ..small(1)
    };
    assert_eq!(run(&two, 0.5).history.len(), 21);
    // All individuals are the same at area 0 and 1.
    for (area, cells) in [(0.0, 0), (1.0, 2500)] {
        let result = run(&small(1), area);
        assert_eq!(result.best_pattern().active_cells(), cells);
    }
}

/// Returns the same answer for all patterns.
struct Answer(fn(usize) -> Result<Vec<Field>, PredictError>);

impl Predictor<StateFields> for Answer {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        Ok(self.0(patterns.len())?
            .into_iter()
            .map(|field| Some(vec![field]))
            .collect())
    }
}

#[test]
fn wrong_predictor_results_are_errors() {
    let message = |answer| {
        let error = evolved(&Answer(answer), &goal(0.5), &small(1)).unwrap_err();
        error.to_string()
    };
    assert!(message(|_| Err(PredictError::failed("no memory"))).contains("no memory"));
    assert!(message(|count| Ok(vec![Field::zero(Raster::PAPER); count - 1])).contains("fields for"));
}

/// Has no field of patterns with more than half of the left half active.
struct Partial(Linear);

impl Predictor<StateFields> for Partial {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        let left = |pattern: &Pattern| (0..50 * 25).filter(|i| pattern.is_active(i % 25, i / 25)).count();
        let fields = self.0.predict(patterns)?.into_iter().zip(patterns);
        Ok(fields
            .map(|(field, pattern)| (left(pattern) <= 625).then_some(field))
            .collect())
    }
}

#[test]
fn patterns_without_a_field_rank_last() {
    // Free to choose, the search fills the left half.
    let free = run(&small(1), 0.5).best_pattern();
    let left = |pattern: &Pattern| (0..50 * 25).filter(|i| pattern.is_active(i % 25, i / 25)).count();
    assert!(left(&free) > 700, "{}", left(&free));
    let partial = Partial(Linear::new([25.0, 25.0]));
    let found = evolved(&partial, &goal(0.5), &small(1)).unwrap();
    assert!(left(&found.best_pattern()) <= 625);
    assert!(found.history.iter().all(|report| report.mean.is_finite()));
    let none = evolved(&partial, &goal(1.0), &small(1));
    assert!(matches!(none, Err(EvolveError::NoField)), "{none:?}");
}

#[test]
fn options_out_of_range_are_refused() {
    let error = |options| {
        let result = evolved(&Linear::new([25.0, 25.0]), &goal(0.5), &options);
        match result {
            Err(EvolveError::Options(error)) => error,
            other => panic!("{other:?}"),
        }
    };
    let with = |change: fn(&mut EvolveOptions)| {
        let mut options = small(1);
        change(&mut options);
        error(options)
    };
    assert_eq!(with(|o| o.population = 1), OptionsError::Population(1));
    assert_eq!(with(|o| o.stagnation = Some(0)), OptionsError::Stagnation);
    assert!(matches!(
        with(|o| o.elite = 1.5),
        OptionsError::Share { name: "elite", .. }
    ));
    assert!(matches!(
        with(|o| o.judged = -0.5),
        OptionsError::Share { name: "judged", .. }
    ));
    assert!(matches!(
        with(|o| o.crossover = f64::NAN),
        OptionsError::Share { name: "crossover", .. }
    ));
    assert!(matches!(
        with(|o| o.mutation = -0.1),
        OptionsError::Share { name: "mutation", .. }
    ));
}
