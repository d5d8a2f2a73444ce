use std::sync::Mutex;

use super::*;
use crate::tests::TestDevice;
use crate::{Aim, Constraints, DesignDomain, Displacement, Distance, Goal, Limits, Measure, Motion};
use deaflow_field::{Differentiable, InStates, PredictError, Predictor, StateFields, WithGradient};
use deaflow_pattern::{Bits, Membrane, Raster, Region, distance};

fn goal(motion: Motion) -> Goal {
    let aim = Aim::new([25.0, 25.0], motion);
    let measure: &'static dyn Measure = match motion {
        _ if motion.has_target() => &Distance,
        _ => &Displacement,
    };
    Goal::new(measure, &[aim], Membrane::square(50.0), None, 0.0).unwrap()
}

fn linear() -> TestDevice {
    let worth = |cell: usize| ((cell * 37 % 2500) as f64 - 999.5) * 1e-6;
    TestDevice::linear((0..2500).map(worth).collect())
}

fn half() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, _| x < 25)
}

#[test]
fn the_optimum_of_a_linear_device_is_found_from_any_start() {
    let (device, goal) = (linear(), goal(Motion::Along(0.0)));
    let model = InStates::one(&device);
    for (area, cells) in [
        ((0.5, 0.5), 1250),
        ((0.0, 1.0), 1500),
        ((0.05, 0.055), 137),
        ((0.7, 0.8), 1750),
    ] {
        let mut worth = device.worth.clone();
        worth.sort_by(|a, b| b.total_cmp(a));
        let best: f64 = worth[..cells].iter().sum();
        for start in [
            half(),
            Pattern::from_fn(Raster::PAPER, |_, _| false),
            Pattern::from_fn(Raster::PAPER, |_, _| true),
        ] {
            let none = Constraints::none(Membrane::square(50.0));
            let problem = SearchProblem::new(&model, &goal, [50; 2], area, &none);
            let found = problem.refine(&start, &|_| ()).unwrap().unwrap();
            assert_eq!(found.pattern.active_cells(), cells);
            assert!((found.score * 2.5 - best).abs() < 1e-9 && found.exhausted);
            assert!(found.steps.windows(2).all(|pair| pair[0].score < pair[1].score));
        }
    }
}

#[test]
fn no_exchange_of_two_units_improves_a_local_optimum() {
    // Concave: the value of a cell depends on all others, and any start needs a few hundred exchanges.
    let device = TestDevice {
        spread: (0..2500)
            .map(|cell| ((cell * 53 % 1009) as f64 - 300.0) * 3e-6)
            .collect(),
        bend: -0.3,
        ..linear()
    };
    let model = InStates::one(&device);
    let goal = goal(Motion::Along(0.0));
    for side in [20, 50] {
        let none = Constraints::none(Membrane::square(50.0));
        let problem = SearchProblem::new(&model, &goal, [side; 2], (0.495, 0.505), &none);
        let found = problem.refine(&half(), &|_| ()).unwrap().unwrap();
        assert!(found.exhausted && (1238..=1262).contains(&found.pattern.active_cells()));
        let on = problem.units.of(&found.pattern);
        let turned = |units: [usize; 2]| {
            let mut other = on.clone();
            units.iter().for_each(|&unit| other[unit] = 1 - other[unit]);
            problem.units.pattern(&other)
        };
        let mut gained = 0;
        for k in 0..20_000 {
            let pair = [k * 7919 % on.len(), k * 104_729 / 7 % on.len()];
            let other = turned(pair);
            if pair[0] == pair[1] || !(1238..=1262).contains(&other.active_cells()) {
                continue;
            }
            gained += usize::from(device.value(&other) / 2.5 > found.score + 1e-6);
        }
        assert_eq!(gained, 0, "{side}");
    }
}

/// Records the patterns of which fields, gradients and approximate fields were requested.
struct Recorder {
    device: TestDevice,
    simulated: Mutex<[Vec<Pattern>; 3]>,
}

impl Predictor<StateFields> for Recorder {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.simulated.lock().unwrap()[0].extend_from_slice(patterns);
        InStates::one(&self.device).predict_some(patterns)
    }
}

impl Differentiable<StateFields> for Recorder {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        self.simulated.lock().unwrap()[1].push(pattern.clone());
        InStates::one(&self.device).gradient(pattern, slope)
    }

    fn predict_near(&self, _base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.simulated.lock().unwrap()[2].extend_from_slice(patterns);
        InStates::one(&self.device).predict_some(patterns)
    }
}

#[test]
fn no_pattern_is_simulated_twice() {
    let (goal, none) = (goal(Motion::Along(0.0)), Constraints::none(Membrane::square(50.0)));
    let model = Recorder {
        device: linear(),
        simulated: Mutex::default(),
    };
    let problem = SearchProblem::new(&model, &goal, [50; 2], (0.5, 0.5), &none);
    let best = problem.refine(&half(), &|_| ()).unwrap().unwrap();
    *model.simulated.lock().unwrap() = Default::default();
    // Nothing is gained any more, so all is tried, near and far, about one state.
    let again = problem.refine(&best.pattern, &|_| ()).unwrap().unwrap();
    assert!(again.exhausted && again.pattern == best.pattern && again.steps.len() == 1);
    let [fields, gradients, near] = &*model.simulated.lock().unwrap();
    assert!(gradients.len() == 1 && near.len() > 160);
    // Only patterns with a similar score are simulated from rest.
    assert!(fields.len() < near.len() / 2, "{} of {}", fields.len(), near.len());
    for patterns in [fields, near] {
        for (at, pattern) in patterns.iter().enumerate() {
            assert!(!patterns[..at].contains(pattern), "{at} of {}", patterns.len());
        }
    }
}

#[test]
fn a_target_value_is_met() {
    let (device, goal) = (linear(), goal(Motion::By(0.0, 0.1)));
    let model = InStates::one(&device);
    let none = Constraints::none(Membrane::square(50.0));
    let problem = SearchProblem::new(&model, &goal, [50; 2], (0.5, 0.5), &none);
    let found = problem.refine(&half(), &|_| ()).unwrap().unwrap();
    assert!((device.value(&found.pattern) - 0.1).abs() < 1e-3, "{}", found.score);
}

#[test]
fn without_a_field_there_is_no_optimum() {
    let device = TestDevice {
        max_cells: 1000,
        ..linear()
    };
    let model = InStates::one(&device);
    let goal = goal(Motion::Along(0.0));
    let none = Constraints::none(Membrane::square(50.0));
    let at = |area| {
        let problem = SearchProblem::new(&model, &goal, [50; 2], area, &none);
        problem.refine(&half(), &|_| ()).unwrap()
    };
    assert_eq!(at((0.5, 0.5)).err(), Some(StartError::NoField));
    // Towards the edge of stability the search stops before it.
    let found = at((0.0, 0.4)).unwrap();
    assert!(found.pattern.active_cells() == 1000);
}

/// A membrane whose left side is worth most, as smoothly as a real one.
fn smooth() -> TestDevice {
    let worth = |cell: usize| ((cell % 50) as f64 / 50.0 * 3.0).cos() * (1.0 + 0.3 * (cell / 50) as f64 / 50.0) * 1e-3;
    TestDevice {
        worth: (0..2500).map(worth).collect(),
        ..linear()
    }
}

#[test]
fn several_designs_keep_the_distance_at_a_small_loss() {
    let (device, goal, none) = (
        smooth(),
        goal(Motion::Along(0.0)),
        Constraints::none(Membrane::square(50.0)),
    );
    let model = InStates::one(&device);
    let mut designs: Vec<Pattern> = Vec::new();
    let mut scores = Vec::new();
    for _ in 0..4 {
        let problem = SearchProblem::new(&model, &goal, [50; 2], (0.45, 0.55), &none).distant_from(&designs, 0.05);
        let found = problem.refine(&half(), &|_| ()).unwrap().unwrap();
        assert!(designs.iter().all(|other| distance(other, &found.pattern) >= 0.05));
        scores.push(found.score);
        designs.push(found.pattern);
    }
    assert!(
        scores[1..]
            .iter()
            .all(|score| *score < scores[0] && *score > 0.97 * scores[0]),
        "{scores:?}"
    );
}

#[test]
fn constraints_are_satisfied() {
    let (device, goal) = (smooth(), goal(Motion::Along(0.0)));
    let model = InStates::one(&device);
    let limits = Limits {
        min_feature_mm: Some(4.0),
        islands: Some(1),
        ..Limits::default()
    };
    let constraints = Constraints::new(limits, Membrane::square(50.0)).unwrap();
    let problem = SearchProblem::new(&model, &goal, [50; 2], (0.39, 0.41), &constraints);
    let scattered = Pattern::from_fn(Raster::PAPER, |x, y| (x * 7 + y * 11) % 5 < 2);
    for start in [half(), scattered] {
        let found = problem.refine(&start, &|_| ()).unwrap().unwrap();
        assert!(constraints.satisfied_by(&found.pattern) && found.exhausted);
        assert!((0.39..=0.41).contains(&found.pattern.area_fraction(None)));
        let free = Constraints::none(Membrane::square(50.0));
        let without = SearchProblem::new(&model, &goal, [50; 2], (0.39, 0.41), &free);
        let best = without.refine(&start, &|_| ()).unwrap().unwrap().score;
        assert!(
            found.score <= best && found.score > 0.9 * best,
            "{} {best}",
            found.score
        );
    }
}

#[test]
fn infeasible_patterns_are_rejected() {
    struct FewOnTheRight;
    impl deaflow_field::Feasibility for FewOnTheRight {
        fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
            let few = |pattern: &Pattern| (0..50).filter(|&y| pattern.is_active(30, y)).count() <= 10;
            Ok(patterns.iter().map(few).collect())
        }
    }
    let device = TestDevice {
        worth: (0..2500).map(|cell| (cell % 50) as f64 * 1e-5).collect(),
        ..linear()
    };
    let model = InStates::one(&device);
    let (goal, none) = (goal(Motion::Along(0.0)), Constraints::none(Membrane::square(50.0)));
    let problem = SearchProblem::new(&model, &goal, [50; 2], (0.5, 0.5), &none);
    assert!(
        problem
            .refine(&half(), &|_| ())
            .unwrap()
            .unwrap()
            .pattern
            .is_active(30, 0)
    );
    let problem = problem.with_feasibility(Some(&FewOnTheRight));
    let found = problem.refine(&half(), &|_| ()).unwrap().unwrap();
    assert_eq!((0..50).filter(|&y| found.pattern.is_active(30, y)).count(), 10);
}

/// A state of a device with two groups.
fn state(worth: Vec<f64>, loads: [f64; 2]) -> TestDevice {
    TestDevice {
        loads: loads.to_vec(),
        ..TestDevice::linear(worth)
    }
}

/// Pushed to the right in one state and to the left in the other.
fn stroke() -> Goal {
    let aim = |state, degrees| Aim {
        state,
        ..Aim::new([25.0, 25.0], Motion::Along(degrees))
    };
    let aims = [aim(0, 0.0), aim(1, 180.0)];
    Goal::new(&Displacement, &aims, Membrane::square(50.0), None, 0.0).unwrap()
}

fn two_groups() -> DesignDomain {
    DesignDomain {
        groups: 2,
        ..Membrane::square(50.0).into()
    }
}

#[test]
fn groups_and_states_reach_the_optimum_of_a_linear_device() {
    // The value of a cell differs between the states.
    let worth = |a: usize, b: usize| -> Vec<f64> {
        let cells = 0..2500;
        cells.map(|cell| ((cell * a % 2503) as f64 - b as f64) * 1e-6).collect()
    };
    let [push, pull] = [state(worth(37, 900), [1.0, 0.2]), state(worth(91, 1400), [0.0, 1.0])];
    let goal = stroke();
    let best = |cell: usize| {
        let of = |group: usize| push.loads[group] * push.worth[cell] - pull.loads[group] * pull.worth[cell];
        of(0).max(of(1)).max(0.0)
    };
    let optimum: f64 = (0..2500).map(best).sum::<f64>() / 2.0;
    let model = InStates::new(vec![&push, &pull]);
    let constraints = Constraints::new(Limits::default(), two_groups()).unwrap();
    let problem = SearchProblem::new(&model, &goal, [50; 2], (0.0, 1.0), &constraints);
    for start in [half(), Pattern::from_groups(Raster::PAPER, |x, y| ((x + y) % 3) as u8)] {
        let found = problem.refine(&start, &|_| ()).unwrap().unwrap();
        assert!(
            (found.score * 2.5 - optimum).abs() < 1e-9 && found.exhausted,
            "{} {optimum}",
            found.score * 2.5
        );
        assert_eq!(found.pattern.groups(), 2);
    }
}

#[test]
fn a_gap_between_groups_costs_little() {
    // Group 1 is worth something on the left, group 2 on the right.
    let worth: Vec<f64> = (0..2500).map(|cell| (24.5 - (cell % 50) as f64) * 1e-5).collect();
    let [push, pull] = [[1.0, 0.0], [0.0, 1.0]].map(|loads| state(worth.clone(), loads));
    let optimum: f64 = worth.iter().map(|worth| worth.abs()).sum::<f64>() / 2.0;
    let model = InStates::new(vec![&push, &pull]);
    let goal = stroke();
    let limits = Limits {
        min_feature_mm: Some(3.0),
        gap_mm: Some(4.0),
        ..Limits::default()
    };
    let apart = Constraints::new(limits, two_groups()).unwrap();
    let problem = SearchProblem::new(&model, &goal, [50; 2], (0.0, 1.0), &apart);
    let halves = Pattern::from_groups(Raster::PAPER, |x, _| if x < 23 { 1 } else { 2 });
    let found = problem.refine(&halves, &|_| ()).unwrap().unwrap();
    assert!(
        apart.satisfied_by(&found.pattern),
        "{:?}",
        apart.violations(&found.pattern)
    );
    let share = found.score * 2.5 / optimum;
    assert!((0.98..1.0).contains(&share), "{share}");
    let nearest = |x: usize, y: usize| {
        let (from, to) = (
            [x.saturating_sub(4), y.saturating_sub(4)],
            [(x + 4).min(49), (y + 4).min(49)],
        );
        (from[1]..=to[1]).all(|j| (from[0]..=to[0]).all(|i| found.pattern.group(i, j) != 2))
    };
    assert!((0..2500).all(|cell| found.pattern.group(cell % 50, cell / 50) != 1 || nearest(cell % 50, cell / 50)));
}

/// A ring between a disc and a hub for two groups that keep a distance; electrodes are at least as wide.
fn ring() -> Constraints {
    let available = Bits::from_fn(Raster::PAPER, |x, y| {
        let [x, y] = [x, y].map(|c| c as f64 - 24.5);
        (2.0..20.0).contains(&x.hypot(y))
    });
    let domain = DesignDomain {
        available: Some(available),
        ..two_groups()
    };
    let limits = Limits {
        min_feature_mm: Some(3.0),
        gap_mm: Some(2.0),
        ..Limits::default()
    };
    Constraints::new(limits, domain).unwrap()
}

#[test]
fn a_target_area_is_reached_if_there_is_space() {
    let apart = ring();
    // What is worth most is scattered, so that a repair changes much.
    let worth: Vec<f64> = (0..2500)
        .map(|cell| ((cell * 37 % 2503) as f64 - 1200.0) * 1e-6)
        .collect();
    let [push, pull] = [[1.0, 0.0], [0.0, 1.0]].map(|loads| state(worth.clone(), loads));
    let model = InStates::new(vec![&push, &pull]);
    let goal = stroke();
    // About half of the cells are free.
    assert_eq!(apart.free_count(), 1252);
    for cells in [125.0, 375.0, 750.0, 1000.0] {
        let area = cells / 1252.0;
        let range = ((cells - 12.5) / 1252.0, (cells + 12.5) / 1252.0);
        let problem = SearchProblem::new(&model, &goal, [50; 2], range, &apart);
        for start in [
            Pattern::from_fn(Raster::PAPER, |_, _| false),
            Pattern::from_groups(Raster::PAPER, |x, _| if x < 25 { 1 } else { 2 }),
            Pattern::from_groups(Raster::PAPER, |x, y| ((x * 7 + y * 11) % 5 % 3) as u8),
        ] {
            let found = problem.follow_gradient(&start, &|_| ()).unwrap().unwrap();
            assert!(
                apart.satisfied_by(&found.pattern),
                "{area}: {:?}",
                apart.violations(&found.pattern)
            );
            let reached = apart.area_fraction(&found.pattern);
            assert!(
                (range.0 - 1e-9..=range.1 + 1e-9).contains(&reached),
                "{area}: {reached}"
            );
        }
    }
    // Half of the free cells are kept out.
    let limits = Limits {
        keep_out: vec![Region::Rectangle([[0.0, 0.0], [25.0, 50.0]])],
        ..apart.limits().clone()
    };
    let domain = DesignDomain {
        available: apart.available().cloned(),
        ..two_groups()
    };
    let kept_out = Constraints::new(limits, domain).unwrap();
    let problem = SearchProblem::new(&model, &goal, [50; 2], (0.7, 0.8), &kept_out);
    let refused = problem.follow_gradient(&half(), &|_| ()).unwrap();
    assert_eq!(refused.err(), Some(StartError::NoPattern));
}

#[test]
fn electrodes_change_groups_together() {
    // Only group 2 does anything, and the start has group 1 alone: cell by cell the gap is in the way.
    let worth = vec![1e-5; 2500];
    let device = state(worth, [0.0, 1.0]);
    let model = InStates::one(&device);
    let goal = goal(Motion::Along(0.0));
    let apart = ring();
    let problem = SearchProblem::new(&model, &goal, [50; 2], (0.0, 1.0), &apart);
    let found = problem.refine(&half(), &|_| ()).unwrap().unwrap();
    assert!(found.pattern.of_group(1).active_cells() == 0 && found.pattern.active_cells() > 900);
}
