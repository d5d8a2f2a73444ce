use std::cell::Cell;

use super::*;
use crate::evolve::{GenerationReport, Observer};
use crate::front::{FrontObjective, Pareto, hypervolume_of};
use crate::objective::Objective;
use crate::options::SearchOptions;
use crate::search::{Candidate, SearchProgress};
use crate::target::{Area, Target};
use crate::tests::{Elements, TestDevice, node};
use crate::{Constraints, Cost, Limits};
use deaflow_base::{Declared, Parameter};
use deaflow_field::{Evaluator, InStates};
use deaflow_pattern::Membrane;
use deaflow_scene::Scene;

/// Counts the steps of the progress bar.
#[derive(Default)]
struct Searches(Cell<u64>);

impl Observer for Searches {
    fn generation(&self, _: &GenerationReport) {}
}

impl SearchProgress for Searches {
    fn step(&self, _: &SearchStep) {}

    fn searched(&self) {
        self.0.set(self.0.get() + 1);
    }
}

/// The front of a device against the area.
fn searched(device: &TestDevice, cost: &str, points: usize) -> Result<FoundFront, SearchError> {
    let FrontObjective::Cost(cost) = FrontObjective::read(&node(cost), "objectives", &()).unwrap() else {
        panic!("{cost}")
    };
    assert!(matches!(cost, Cost::Area(_)));
    let options = SearchOptions::read_with(&node("{ method: adjoint, starts: 2, seed: 1 }"), &[]).unwrap();
    let front = Front {
        others: vec![OtherObjective::Cost(cost)],
        pareto: pareto(&format!("{{ points: {points} }}")),
    };
    let (found, searched) = searched_by(device, &front, &options, Constraints::none(Membrane::square(50.0)));
    if found.is_ok() {
        assert_eq!(searched, options.steps() + points as u64 - 1);
    }
    found
}

fn pareto(text: &str) -> Pareto {
    Pareto::read_with(&node(text), &[]).unwrap()
}

fn objective(text: &str) -> (Objective, Goal) {
    let objective = Objective::read(&node(text)).unwrap();
    let goal = objective.goal(&Scene::vhb4910(), None, 0.0).unwrap();
    (objective, goal)
}

/// A front of the motion of the centre and others, and the number of local searches.
fn searched_by(
    device: &TestDevice,
    front: &Front,
    options: &SearchOptions,
    constraints: Constraints,
) -> (Result<FoundFront, SearchError>, u64) {
    let (objective, goal) = objective("{ point: [25 mm, 25 mm], direction: 0 deg }");
    let target = Target {
        name: Front::NAME.to_owned(),
        objective,
        area: Area::Free,
        goal,
        masks: None,
    };
    let (elements, progress) = (Elements(InStates::one(device)), Searches::default());
    let search = Search {
        target: &target,
        constraints: &constraints,
        options,
        drivers: &[1],
        elements: &elements,
        progress: &progress,
    };
    let exact = Candidate {
        settings: "exact".to_owned(),
        evaluator: Ok(InStates::one(Box::new(device.clone()) as Box<dyn Evaluator>)),
    };
    let found = search.front(front, || Evaluators::Named(exact));
    (found, progress.0.get())
}

/// The front of a linear device by the genetic algorithm.
fn evolved(device: &TestDevice, others: Vec<OtherObjective>, points: usize, limits: Limits) -> FoundFront {
    let front = Front {
        others,
        pareto: pareto(&format!("{{ points: {points}, method: nsga2 }}")),
    };
    let options = SearchOptions::read_with(&node("{ population: 30, generations: 10, seed: 1 }"), &[]).unwrap();
    let constraints = Constraints::new(limits, Membrane::square(50.0)).unwrap();
    searched_by(device, &front, &options, constraints).0.unwrap()
}

fn least_area(reference: &str) -> OtherObjective {
    let text = format!("{{ area: least{reference} }}");
    match FrontObjective::read(&node(&text), "objectives", &()).unwrap() {
        FrontObjective::Cost(cost) => OtherObjective::Cost(cost),
        FrontObjective::Value(_) => panic!("{text}"),
    }
}

#[test]
fn the_genetic_algorithm_begins_at_the_linear_response_of_a_linear_device() {
    let worth = |cell: usize| (cell % 50) as f64 * 1e-6 - 1.5e-5;
    let device = TestDevice::linear((0..2500).map(worth).collect());
    let found = evolved(&device, vec![least_area(", reference: 0.9")], 9, Limits::default());
    assert_eq!((found.values.len(), found.result.designs.len()), (9, 9));
    assert_eq!(found.reference, [0.0, 0.9]);
    let scale = device.best(1700);
    for (values, design) in found.values.iter().zip(&found.result.designs) {
        let area = design.pattern.active_cells() as f64 / 2500.0;
        assert_eq!(values[1], area);
        assert!((values[0] - device.value(&design.pattern)).abs() < 1e-12);
        assert_eq!((design.role, design.status.as_str()), (Role::Ga, "met"));
        // Units of 2 and 3 cells: near the best patterns of the area.
        let best = device.best(design.pattern.active_cells());
        assert!(values[0] > best - 0.05 * scale, "{values:?} {best}");
    }
    let sorted = found
        .values
        .windows(2)
        .all(|pair| pair[0][0] < pair[1][0] && pair[0][1] < pair[1][1]);
    assert!(sorted, "{:?}", found.values);
    // More points keep those of a front with fewer.
    let fewer = evolved(&device, vec![least_area(", reference: 0.9")], 4, Limits::default());
    assert!(fewer.values.len() == 4 && fewer.values.iter().all(|one| found.values.contains(one)));
    let reached = found.history.last().unwrap().1;
    // At the end stands what the last generation has.
    let before = &found.history[..found.history.len() - 1];
    assert!(
        before
            .windows(2)
            .all(|pair| pair[0].0 < pair[1].0 && pair[0].1 < pair[1].1)
    );
    let value = |values: &Vec<f64>| vec![values[0], -values[1]];
    let of_points = hypervolume_of(&found.values.iter().map(value).collect::<Vec<_>>(), &[0.0, -0.9]);
    assert!(
        of_points <= reached && of_points > 0.95 * reached,
        "{of_points} {reached}"
    );
}

#[test]
fn three_objectives_keep_constraints_and_have_a_reference_at_the_worst_of_losses() {
    let device = linear();
    // All points move alike, so that a point that stays is the opposite of one that moves.
    let (stays, goal) = objective("{ point: [10 mm, 25 mm], displacement: [0 mm, 0 mm] }");
    let others = vec![OtherObjective::Value(stays, Box::new(goal)), least_area("")];
    let limits = Limits {
        min_feature_mm: Some(4.0),
        ..Limits::default()
    };
    let found = evolved(&device, others, 5, limits);
    assert_eq!(found.values.len(), 5);
    for values in &found.values {
        assert!((values[0] + values[1]).abs() < 1e-12 && values[2] > 0.0, "{values:?}");
    }
    let worst = found.values.iter().map(|values| values[1]).fold(0.0, f64::min);
    let most = found.values.iter().map(|values| values[2]).fold(0.0, f64::max);
    assert!(found.reference[0] == 0.0 && found.reference[1] <= worst && found.reference[2] >= most);
    assert!(found.result.designs.iter().all(|design| design.status == "met"));
}

/// 1500 cells are worth something.
fn linear() -> TestDevice {
    let worth = |cell: usize| ((cell * 37 % 2500) as f64 - 999.5) * 1e-6;
    TestDevice::linear((0..2500).map(worth).collect())
}

#[test]
fn the_front_of_a_linear_device_is_found() {
    let device = linear();
    let found = searched(&device, "{ area: least }", 5).unwrap();
    assert_eq!(found.limits, [0.12, 0.24, 0.36, 0.48, 0.6]);
    assert_eq!(found.outcomes, [PointOutcome::Found; 5]);
    assert_eq!(found.reference, [0.0, 0.6]);
    for (k, (values, design)) in (1..).zip(found.values.iter().zip(&found.result.designs)) {
        let cells = 300 * k;
        assert_eq!((design.pattern.active_cells(), design.member), (cells, k - 1));
        assert!((values[0] - device.best(cells)).abs() < 1e-12 && values[1] == 0.12 * k as f64);
        assert_eq!((design.status.as_str(), design.role), ("met", Role::Optimum));
    }
    let grows = found
        .history
        .windows(2)
        .all(|pair| pair[0].0 < pair[1].0 && pair[0].1 < pair[1].1);
    let points = found.values.iter().map(|values| FrontPoint {
        value: values[0],
        cost: values[1],
    });
    let reference = FrontPoint { value: 0.0, cost: 0.6 };
    let reached = hypervolume(&points.collect::<Vec<_>>(), reference);
    assert!(
        grows && (found.history.last().unwrap().1 - reached).abs() < 1e-12,
        "{:?}",
        found.history
    );
}

#[test]
fn limits_beyond_the_best_design_add_no_points() {
    let found = searched(&linear(), "{ area: least, within: [0.5, 0.9] }", 5).unwrap();
    assert_eq!(found.limits, [0.5, 0.6, 0.7, 0.8, 0.9]);
    let expected = [
        PointOutcome::Found,
        PointOutcome::Found,
        PointOutcome::Dominated(1),
        PointOutcome::Dominated(1),
        PointOutcome::Dominated(1),
    ];
    assert_eq!(found.outcomes, expected);
    assert_eq!(found.result.designs.len(), 2);
    // Where all are beyond it, the objectives agree.
    let found = searched(&linear(), "{ area: least, within: [0.61, 0.9] }", 3).unwrap();
    assert_eq!(found.values.len(), 1);
    assert_eq!(found.result.designs[0].pattern.active_cells(), 1500);
}

#[test]
fn limits_without_a_design_are_told_from_dominated_ones() {
    // A limit of less than a cell has no electrode.
    let found = searched(&linear(), "{ area: least, within: [0.0001, 0.4001] }", 3).unwrap();
    assert_eq!(found.outcomes[0], PointOutcome::None(StartError::NoPattern));
    assert_eq!(found.outcomes[1..], [PointOutcome::Found; 2]);
    // Without any design there is no front.
    let worthless = TestDevice::linear(vec![-1e-6; 2500]);
    for cost in ["{ area: least }", "{ area: least, within: [0.1, 0.5] }"] {
        let error = searched(&worthless, cost, 3).unwrap_err();
        assert!(matches!(error, SearchError::NoStart { .. }), "{error}");
    }
}

#[test]
fn weights_approach_a_limit() {
    // A charge that falls with its weight.
    let charge = |weight: f64| 2000.0 / (1.0 + 3.0 * weight).powi(2);
    for limit in [1500.0, 700.0, 60.0] {
        let (mut above, mut below, mut weight) = (None, None, 0.1);
        let mut tried = 0;
        while !((1.0 - CLOSE) * limit..=limit).contains(&charge(weight)) {
            match charge(weight) > limit {
                true => above = Some((weight, charge(weight))),
                false => below = Some((weight, charge(weight))),
            }
            weight = next_weight(above, below, limit);
            tried += 1;
            assert!(tried < 25, "{limit}: {weight}");
        }
    }
}
