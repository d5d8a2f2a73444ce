use std::sync::Mutex;

use super::*;
use crate::{Aim, Constraints, Displacement, Distance, Goal, Ground, Limits, Measure, Motion};
use deaflow_field::{CORNERS, Differentiable, Field, InStates, PredictError, Predictor, StateFields, WithGradient};
use deaflow_pattern::{Bits, CELLS, Membrane, Raster, distance};

/// A membrane whose every point moves along x by Σ worth · active + ½ bend (Σ spread · active)², in mm.
struct Quadratic {
    worth: Vec<f64>,
    spread: Vec<f64>,
    bend: f64,
    /// More active cells than this have no field.
    most: usize,
}

impl Quadratic {
    fn sums(&self, pattern: &Pattern) -> (f64, f64) {
        let active = (0..CELLS * CELLS).filter(|&cell| pattern.cells()[cell] == 1);
        active.fold((0.0, 0.0), |(a, b), cell| (a + self.worth[cell], b + self.spread[cell]))
    }

    fn value(&self, pattern: &Pattern) -> f64 {
        let (linear, spread) = self.sums(pattern);
        linear + 0.5 * self.bend * spread * spread
    }

    fn field(&self, pattern: &Pattern) -> Field {
        Field::from_values(Raster::PAPER, [self.value(pattern), 0.0].repeat(CORNERS * CORNERS)).unwrap()
    }
}

impl Predictor<StateFields> for Quadratic {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        let some = |pattern: &Pattern| (pattern.active_cells() <= self.most).then(|| vec![self.field(pattern)]);
        Ok(patterns.iter().map(some).collect())
    }
}

impl Differentiable<StateFields> for Quadratic {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        if pattern.active_cells() > self.most {
            return Ok(None);
        }
        let fields = vec![self.field(pattern)];
        let along: f64 = slope(&fields)[0].values().iter().step_by(2).sum();
        let (_, spread) = self.sums(pattern);
        let cell = |(worth, own): (&f64, &f64)| along * (worth + self.bend * spread * own);
        let gradient = self.worth.iter().zip(&self.spread).map(cell).collect();
        Ok(Some((fields, gradient)))
    }
}

fn goal(motion: Motion) -> Goal {
    let aim = Aim::new([25.0, 25.0], motion);
    let measure: &'static dyn Measure = match motion {
        Motion::Along(_) | Motion::Turn(_) => &Displacement,
        Motion::By(..) | Motion::To(_) | Motion::TurnBy(_) => &Distance,
    };
    Goal::new(measure, &[aim], Membrane::square(50.0), None, 0.0).unwrap()
}

fn linear() -> Quadratic {
    Quadratic {
        worth: (0..2500)
            .map(|cell| ((cell * 37 % 2500) as f64 - 999.5) * 1e-6)
            .collect(),
        spread: vec![0.0; 2500],
        bend: 0.0,
        most: 2500,
    }
}

fn half() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, _| x < 25)
}

#[test]
fn the_optimum_of_a_linear_membrane_is_found_from_anywhere() {
    let (physics, goal) = (linear(), goal(Motion::Along(0.0)));
    for (area, cells) in [
        ((0.5, 0.5), 1250),
        ((0.0, 1.0), 1500),
        ((0.05, 0.055), 137),
        ((0.7, 0.8), 1750),
    ] {
        let mut worth = physics.worth.clone();
        worth.sort_by(|a, b| b.total_cmp(a));
        let best: f64 = worth[..cells].iter().sum();
        for start in [
            half(),
            Pattern::from_fn(Raster::PAPER, |_, _| false),
            Pattern::from_fn(Raster::PAPER, |_, _| true),
        ] {
            let none = Constraints::none(Membrane::square(50.0));
            let problem = SearchProblem::new(&physics, &goal, [50; 2], area, &none);
            let found = problem.refine(&start, &|_| ()).unwrap().unwrap();
            assert_eq!(found.pattern.active_cells(), cells);
            assert!((found.score * 2.5 - best).abs() < 1e-9 && found.exhausted);
            assert!(found.steps.windows(2).all(|pair| pair[0].score < pair[1].score));
        }
    }
}

#[test]
fn no_exchange_of_two_units_improves_a_local_optimum() {
    // Concave: what a cell is worth depends on all others, and a few hundred exchanges are needed from anywhere.
    let physics = Quadratic {
        spread: (0..2500)
            .map(|cell| ((cell * 53 % 1009) as f64 - 300.0) * 3e-6)
            .collect(),
        bend: -0.3,
        ..linear()
    };
    let goal = goal(Motion::Along(0.0));
    for side in [20, 50] {
        let none = Constraints::none(Membrane::square(50.0));
        let problem = SearchProblem::new(&physics, &goal, [side; 2], (0.495, 0.505), &none);
        let found = problem.refine(&half(), &|_| ()).unwrap().unwrap();
        assert!(found.exhausted && (1238..=1262).contains(&found.pattern.active_cells()));
        let on = problem.units().of(&found.pattern);
        let turned = |units: [usize; 2]| {
            let mut other = on.clone();
            units.iter().for_each(|&unit| other[unit] = 1 - other[unit]);
            problem.units().pattern(&other)
        };
        let mut gained = 0;
        for k in 0..20_000 {
            let pair = [k * 7919 % on.len(), k * 104_729 / 7 % on.len()];
            let other = turned(pair);
            if pair[0] == pair[1] || !(1238..=1262).contains(&other.active_cells()) {
                continue;
            }
            gained += usize::from(physics.value(&other) / 2.5 > found.score + 1e-6);
        }
        assert_eq!(gained, 0, "{side}");
    }
}

/// Remembers of which patterns it was asked for the field, for the gradient, and for the field near another.
struct Heard {
    physics: Quadratic,
    simulated: Mutex<[Vec<Pattern>; 3]>,
}

impl Predictor<StateFields> for Heard {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.simulated.lock().unwrap()[0].extend_from_slice(patterns);
        self.physics.predict_some(patterns)
    }
}

impl Differentiable<StateFields> for Heard {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        self.simulated.lock().unwrap()[1].push(pattern.clone());
        self.physics.gradient(pattern, slope)
    }

    fn predict_near(&self, _base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.simulated.lock().unwrap()[2].extend_from_slice(patterns);
        self.physics.predict_some(patterns)
    }
}

#[test]
fn no_pattern_is_simulated_twice() {
    let (goal, none) = (goal(Motion::Along(0.0)), Constraints::none(Membrane::square(50.0)));
    let physics = Heard {
        physics: linear(),
        simulated: Mutex::default(),
    };
    let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.5, 0.5), &none);
    let best = problem.refine(&half(), &|_| ()).unwrap().unwrap();
    *physics.simulated.lock().unwrap() = Default::default();
    // Nothing is gained any more, so all is tried, near and far, about one state.
    let again = problem.refine(&best.pattern, &|_| ()).unwrap().unwrap();
    assert!(again.exhausted && again.pattern == best.pattern && again.steps.len() == 1);
    let [fields, gradients, near] = &*physics.simulated.lock().unwrap();
    assert!(gradients.len() == 1 && near.len() > 160);
    // From rest only what is about as good.
    assert!(fields.len() < near.len() / 2, "{} of {}", fields.len(), near.len());
    for patterns in [fields, near] {
        for (at, pattern) in patterns.iter().enumerate() {
            assert!(!patterns[..at].contains(pattern), "{at} of {}", patterns.len());
        }
    }
}

#[test]
fn a_wanted_value_is_met() {
    let (physics, goal) = (linear(), goal(Motion::By(0.0, 0.1)));
    let none = Constraints::none(Membrane::square(50.0));
    let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.5, 0.5), &none);
    let found = problem.refine(&half(), &|_| ()).unwrap().unwrap();
    assert!((physics.value(&found.pattern) - 0.1).abs() < 1e-3, "{}", found.score);
}

#[test]
fn there_is_no_optimum_where_nothing_has_a_field() {
    let physics = Quadratic { most: 1000, ..linear() };
    let goal = goal(Motion::Along(0.0));
    let none = Constraints::none(Membrane::square(50.0));
    let at = |area| {
        let problem = SearchProblem::new(&physics, &goal, [50; 2], area, &none);
        problem.refine(&half(), &|_| ()).unwrap()
    };
    assert_eq!(at((0.5, 0.5)).err(), Some(Unsuited::Field));
    // Towards the edge of stability the search stops before it.
    let found = at((0.0, 0.4)).unwrap();
    assert!(found.pattern.active_cells() == 1000);
}

/// A membrane whose left side is worth most, as smoothly as a real one.
fn smooth() -> Quadratic {
    let worth = |cell: usize| ((cell % 50) as f64 / 50.0 * 3.0).cos() * (1.0 + 0.3 * (cell / 50) as f64 / 50.0) * 1e-3;
    Quadratic {
        worth: (0..2500).map(worth).collect(),
        ..linear()
    }
}

#[test]
fn several_designs_differ_as_much_as_they_must_and_lose_little() {
    let (physics, goal, none) = (
        smooth(),
        goal(Motion::Along(0.0)),
        Constraints::none(Membrane::square(50.0)),
    );
    let mut designs: Vec<Pattern> = Vec::new();
    let mut scores = Vec::new();
    for _ in 0..4 {
        let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.45, 0.55), &none).distant_from(&designs, 0.05);
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
fn constraints_are_kept_all_the_way() {
    let (physics, goal) = (smooth(), goal(Motion::Along(0.0)));
    let limits = Limits {
        min_feature_mm: Some(4.0),
        islands: Some(1),
        ..Limits::default()
    };
    let constraints = Constraints::new(limits, Membrane::square(50.0)).unwrap();
    let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.39, 0.41), &constraints);
    let scattered = Pattern::from_fn(Raster::PAPER, |x, y| (x * 7 + y * 11) % 5 < 2);
    for start in [half(), scattered] {
        let found = problem.refine(&start, &|_| ()).unwrap().unwrap();
        assert!(constraints.hold(&found.pattern) && found.exhausted);
        assert!((0.39..=0.41).contains(&found.pattern.area_fraction()));
        let free = Constraints::none(Membrane::square(50.0));
        let without = SearchProblem::new(&physics, &goal, [50; 2], (0.39, 0.41), &free);
        let best = without.refine(&start, &|_| ()).unwrap().unwrap().score;
        assert!(
            found.score <= best && found.score > 0.9 * best,
            "{} {best}",
            found.score
        );
    }
}

#[test]
fn what_is_not_feasible_is_not_taken() {
    struct FewOnTheRight;
    impl deaflow_field::Feasibility for FewOnTheRight {
        fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
            let few = |pattern: &Pattern| (0..50).filter(|&y| pattern.is_active(30, y)).count() <= 10;
            Ok(patterns.iter().map(few).collect())
        }
    }
    let physics = Quadratic {
        worth: (0..2500).map(|cell| (cell % 50) as f64 * 1e-5).collect(),
        ..linear()
    };
    let (goal, none) = (goal(Motion::Along(0.0)), Constraints::none(Membrane::square(50.0)));
    let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.5, 0.5), &none);
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

/// A state of a device: every point moves along x by what each active cell is worth times the load of its group, in mm.
struct State {
    worth: Vec<f64>,
    loads: [f64; 2],
}

impl State {
    fn load(&self, group: u8) -> f64 {
        usize::from(group).checked_sub(1).map_or(0.0, |group| self.loads[group])
    }

    fn field(&self, pattern: &Pattern) -> Field {
        let cells = self.worth.iter().zip(pattern.cells());
        let value: f64 = cells.map(|(worth, &group)| worth * self.load(group)).sum();
        Field::from_values(Raster::PAPER, [value, 0.0].repeat(CORNERS * CORNERS)).unwrap()
    }
}

impl Predictor for State {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        Ok(patterns.iter().map(|pattern| Some(self.field(pattern))).collect())
    }
}

impl Differentiable for State {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&Field) -> Field,
    ) -> Result<Option<WithGradient>, PredictError> {
        let field = self.field(pattern);
        let along: f64 = slope(&field).values().iter().step_by(2).sum();
        let groups = self.loads.iter();
        let gradient = groups.flat_map(|load| self.worth.iter().map(move |worth| along * load * worth));
        Ok(Some((field, gradient.collect())))
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

fn two_groups() -> Ground {
    Ground {
        groups: 2,
        ..Membrane::square(50.0).into()
    }
}

#[test]
fn groups_and_states_reach_the_optimum_of_a_linear_device() {
    // What a cell is worth in one of the states is not what it is in the other.
    let worth = |a: usize, b: usize| -> Vec<f64> {
        let cells = 0..2500;
        cells.map(|cell| ((cell * a % 2503) as f64 - b as f64) * 1e-6).collect()
    };
    let [push, pull] = [
        State {
            worth: worth(37, 900),
            loads: [1.0, 0.2],
        },
        State {
            worth: worth(91, 1400),
            loads: [0.0, 1.0],
        },
    ];
    let goal = stroke();
    let best = |cell: usize| {
        let of = |group: u8| push.load(group) * push.worth[cell] - pull.load(group) * pull.worth[cell];
        of(1).max(of(2)).max(0.0)
    };
    let optimum: f64 = (0..2500).map(best).sum::<f64>() / 2.0;
    let physics = InStates::new(vec![&push, &pull]);
    let constraints = Constraints::new(Limits::default(), two_groups()).unwrap();
    let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.0, 1.0), &constraints);
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
fn a_gap_between_groups_is_kept_and_costs_little() {
    // Group 1 is worth something on the left, group 2 on the right.
    let worth: Vec<f64> = (0..2500).map(|cell| (24.5 - (cell % 50) as f64) * 1e-5).collect();
    let [push, pull] = [[1.0, 0.0], [0.0, 1.0]].map(|loads| State {
        worth: worth.clone(),
        loads,
    });
    let optimum: f64 = worth.iter().map(|worth| worth.abs()).sum::<f64>() / 2.0;
    let physics = InStates::new(vec![&push, &pull]);
    let goal = stroke();
    let limits = Limits {
        min_feature_mm: Some(3.0),
        gap_mm: Some(4.0),
        ..Limits::default()
    };
    let apart = Constraints::new(limits, two_groups()).unwrap();
    let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.0, 1.0), &apart);
    let halves = Pattern::from_groups(Raster::PAPER, |x, _| if x < 23 { 1 } else { 2 });
    let found = problem.refine(&halves, &|_| ()).unwrap().unwrap();
    assert!(apart.hold(&found.pattern), "{:?}", apart.violations(&found.pattern));
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
    let room = Bits::from_fn(Raster::PAPER, |x, y| {
        let [x, y] = [x, y].map(|c| c as f64 - 24.5);
        (2.0..20.0).contains(&x.hypot(y))
    });
    let ground = Ground {
        room: Some(room),
        ..two_groups()
    };
    let limits = Limits {
        min_feature_mm: Some(3.0),
        gap_mm: Some(2.0),
        ..Limits::default()
    };
    Constraints::new(limits, ground).unwrap()
}

#[test]
fn a_wanted_area_is_reached_wherever_the_room_holds_it() {
    let apart = ring();
    // What is worth most is scattered, so that a repair changes much.
    let worth: Vec<f64> = (0..2500)
        .map(|cell| ((cell * 37 % 2503) as f64 - 1200.0) * 1e-6)
        .collect();
    let [push, pull] = [[1.0, 0.0], [0.0, 1.0]].map(|loads| State {
        worth: worth.clone(),
        loads,
    });
    let physics = InStates::new(vec![&push, &pull]);
    let goal = stroke();
    for area in [0.05, 0.15, 0.3, 0.4] {
        let range = (area - 0.005, area + 0.005);
        let problem = SearchProblem::new(&physics, &goal, [50; 2], range, &apart);
        for start in [
            Pattern::from_fn(Raster::PAPER, |_, _| false),
            Pattern::from_groups(Raster::PAPER, |x, _| if x < 25 { 1 } else { 2 }),
            Pattern::from_groups(Raster::PAPER, |x, y| ((x * 7 + y * 11) % 5 % 3) as u8),
        ] {
            let found = problem.follow_gradient(&start, &|_| ()).unwrap().unwrap();
            assert!(
                apart.hold(&found.pattern),
                "{area}: {:?}",
                apart.violations(&found.pattern)
            );
            let reached = found.pattern.area_fraction();
            assert!(
                (range.0 - 1e-9..=range.1 + 1e-9).contains(&reached),
                "{area}: {reached}"
            );
        }
    }
    let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.7, 0.8), &apart);
    let refused = problem.follow_gradient(&half(), &|_| ()).unwrap();
    assert_eq!(refused.err(), Some(Unsuited::Shape));
}

#[test]
fn electrodes_change_groups_together_where_that_is_better() {
    // Only group 2 does anything, and the start has group 1 alone: cell by cell the gap is in the way.
    let worth = vec![1e-5; 2500];
    let state = State {
        worth,
        loads: [0.0, 1.0],
    };
    let physics = InStates::new(vec![&state]);
    let goal = goal(Motion::Along(0.0));
    let apart = ring();
    let problem = SearchProblem::new(&physics, &goal, [50; 2], (0.0, 1.0), &apart);
    let found = problem.refine(&half(), &|_| ()).unwrap().unwrap();
    assert!(found.pattern.of_group(1).active_cells() == 0 && found.pattern.active_cells() > 900);
}
