use std::cell::Cell;
use std::path::Path;

use super::*;
use crate::evolve::{GenerationReport, Observer};
use crate::front::{FrontObjective, Pareto};
use crate::objective::Objective;
use crate::options::SearchOptions;
use crate::search::{FiniteElements, SearchProgress};
use crate::target::{Area, Target};
use crate::tests::TestDevice;
use crate::{Constraints, Cost};
use deaflow_base::{Declared, Document, Node, Parameter};
use deaflow_field::{Feasibility, InStates};
use deaflow_pattern::Membrane;
use deaflow_scene::Scene;

struct Elements<'a>(InStates<&'a TestDevice>);

impl FiniteElements for Elements<'_> {
    fn gradient(&self) -> Result<&dyn Differentiable<StateFields>, SearchError> {
        Ok(&self.0)
    }

    fn settings(&self) -> String {
        "exact".to_owned()
    }

    fn feasibility(&self) -> Result<Option<&dyn Feasibility>, SearchError> {
        Ok(None)
    }
}

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

fn node(text: &str) -> Node {
    Document::from_text(Path::new("f"), text).unwrap().root
}

/// The front of a device against the area.
fn searched(device: &TestDevice, cost: &str, points: usize) -> Result<FoundFront, SearchError> {
    let FrontObjective::Cost(cost) = FrontObjective::read(&node(cost), "objectives", &()).unwrap() else {
        panic!("{cost}")
    };
    assert!(matches!(cost, Cost::Area(_)));
    let pareto = Pareto::read_with(&node(&format!("{{ points: {points} }}")), &[]).unwrap();
    let options = SearchOptions::read_with(&node("{ method: adjoint, starts: 2, seed: 1 }"), &[]).unwrap();
    let objective = Objective::read(&node("{ point: [25 mm, 25 mm], direction: 0 deg }")).unwrap();
    let goal = objective.goal(&Scene::vhb4910(), None, 0.0).unwrap();
    let target = Target {
        name: Front::NAME.to_owned(),
        objective,
        area: Area(None),
        goal,
        masks: None,
    };
    let constraints = Constraints::none(Membrane::square(50.0));
    let (elements, progress) = (Elements(InStates::one(device)), Searches::default());
    let search = Search {
        target: &target,
        constraints: &constraints,
        options: &options,
        drivers: &[1],
        elements: &elements,
        progress: &progress,
    };
    let found = search.front(&Front { cost, pareto });
    if found.is_ok() {
        assert_eq!(progress.0.get(), options.steps() + points as u64 - 1);
    }
    found
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
    assert_eq!(found.reference, FrontPoint { value: 0.0, cost: 0.6 });
    for (k, (point, design)) in (1..).zip(found.points.iter().zip(&found.result.designs)) {
        let cells = 300 * k;
        assert_eq!((design.pattern.active_cells(), design.member), (cells, k - 1));
        assert!((point.value - device.best(cells)).abs() < 1e-12 && point.cost == 0.12 * k as f64);
        assert_eq!((design.status.as_str(), design.role), ("met", Role::Optimum));
    }
    let grows = found
        .history
        .windows(2)
        .all(|pair| pair[0].0 < pair[1].0 && pair[0].1 < pair[1].1);
    let reached = hypervolume(&found.points, found.reference);
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
    assert_eq!(found.points.len(), 1);
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
