//! Comparison of a design with the intuitive designs, at its own and at equal area, and with the best of the gradient
//! search.

use super::design::{Comparison, Design, LEAST_MM, SAME_AREA};
use deaflow_pattern::Role;

/// Compares all designs with each other.
pub fn compare(designs: &mut [Design]) {
    let compared: Vec<Comparison> = designs.iter().map(|design| of(design, designs)).collect();
    for (design, compared) in designs.iter_mut().zip(compared) {
        design.compared = compared;
    }
}

fn of(design: &Design, all: &[Design]) -> Comparison {
    let matching = |role: Role| {
        all.iter()
            .filter(move |other| other.role == role && design.has_same_target(other))
    };
    let distance = |other: &Design| (other.area - design.area).abs();
    let nearest = |role: Role| matching(role).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let equal = nearest(Role::IntuitiveEqualArea).filter(|other| distance(other) <= SAME_AREA);
    let optimum = optimum(design, &matching(Role::Optimum).collect::<Vec<_>>());
    let ratio = |optimum: f64| Some(design.simulated_mm? / optimum);
    Comparison {
        intuitive_own: nearest(Role::Intuitive).and_then(|other| other.simulated_mm),
        intuitive_equal_area: equal.and_then(|other| other.simulated_mm),
        optimum,
        ratio: optimum
            // The ratio to a tiny or negative displacement means nothing.
            .filter(|mm| !design.objective.is_met && *mm > LEAST_MM)
            .and_then(ratio),
    }
}

/// Returns the best of the optima: the largest displacement, or the one nearest to the target value.
fn optimum(design: &Design, optima: &[&Design]) -> Option<f64> {
    let badness = |mm: f64| design.objective.value_mm.map_or(-mm, |value| (mm - value).abs());
    let best = |same_units: bool| {
        let fitting = optima.iter().filter(|other| !same_units || other.units == design.units);
        let values = fitting.filter_map(|other| other.simulated_mm);
        values.min_by(|a, b| badness(*a).total_cmp(&badness(*b)))
    };
    best(true).or_else(|| best(false))
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::designs::{Objective, role_word};
    use crate::drawing::Background;
    use deaflow_pattern::{Membrane, Pattern, Raster};
    use deaflow_scene::Scene;

    /// A design of case `I` without fields.
    pub(crate) fn design(role: Role, units: u64, simulated_mm: Option<f64>) -> Design {
        Design {
            name: format!("I-centre-{}", role_word(role)),
            case: "I".into(),
            target: "centre".into(),
            role,
            member: 0,
            units,
            objective: Objective::read("{ point: [25, 25], direction: 0 }", &Scene::vhb4910()).unwrap(),
            area_target: "0.5".into(),
            area: 0.5,
            constraints: "{}".into(),
            status: "met".into(),
            scene: Arc::new(Scene::vhb4910()),
            background: Background::plain(Membrane::square(50.0)),
            pattern: Pattern::from_fn(Raster::PAPER, |_, _| true),
            predicted: Some(vec![0.0; 5202]),
            simulated: None,
            states: Vec::new(),
            predicted_mm: Some(1.0),
            simulated_mm,
            error_mm: None,
            distance_mm: None,
            interval: None,
            outcome: None,
            compared: Comparison::default(),
        }
    }

    #[test]
    fn an_optimum_on_the_same_units_is_preferred() {
        let mut designs = vec![
            design(Role::Ga, 20, Some(1.8)),
            design(Role::Refined, 50, Some(1.9)),
            design(Role::Optimum, 20, Some(1.85)),
            design(Role::Optimum, 50, Some(2.0)),
            design(Role::Intuitive, 50, Some(1.5)),
            design(Role::IntuitiveEqualArea, 50, Some(1.6)),
            design(Role::Intuitive, 50, None),
        ];
        designs[6].target = "other".into();
        compare(&mut designs);
        assert_eq!(designs[0].compared.optimum, Some(1.85));
        assert_eq!(designs[1].compared.optimum, Some(2.0));
        assert_eq!(designs[1].compared.ratio, Some(0.95));
        assert_eq!(designs[1].compared.intuitive_own, Some(1.5));
        assert_eq!(designs[1].compared.intuitive_equal_area, Some(1.6));
        assert_eq!(designs[6].compared, Comparison::default());

        designs.remove(2);
        compare(&mut designs);
        assert_eq!(designs[0].compared.optimum, Some(2.0), "the best there is");
    }

    #[test]
    fn there_is_no_ratio_to_an_optimum_that_hardly_moves_or_moves_back() {
        for (optimum, ratio) in [(1e-4, None), (-2.0, None), (2.0, Some(-0.5))] {
            let mut both = vec![
                design(Role::Refined, 50, Some(-1.0)),
                design(Role::Optimum, 50, Some(optimum)),
            ];
            compare(&mut both);
            assert_eq!(both[0].compared.ratio, ratio, "{optimum}");
        }
    }

    #[test]
    fn designs_for_another_objective_area_or_scene_are_not_compared() {
        let found = design(Role::Refined, 50, Some(1.0));
        let optimum = design(Role::Optimum, 50, Some(2.0));
        let compared = |optimum: Design| {
            let mut both = vec![found.clone(), optimum];
            compare(&mut both);
            both[0].compared.ratio
        };
        assert_eq!(compared(optimum.clone()), Some(0.5));
        let mut elsewhere = optimum.clone();
        elsewhere.objective = Objective::read("{ point: [30, 25], direction: 0 }", &Scene::vhb4910()).unwrap();
        let smaller = Design {
            area_target: "0.4".into(),
            ..optimum.clone()
        };
        let weaker = Design {
            scene: Arc::new(Scene::vhb4910().at_voltage(4000.0)),
            ..optimum
        };
        assert_eq!([elsewhere, smaller, weaker].map(compared), [None; 3]);
    }

    #[test]
    fn if_a_value_is_to_be_reached_the_optimum_is_the_nearest_to_it() {
        let mut designs = vec![
            design(Role::Ga, 20, Some(1.01)),
            design(Role::Optimum, 50, Some(1.2)),
            design(Role::Optimum, 50, Some(1.001)),
        ];
        for design in &mut designs {
            design.objective.value_mm = Some(1.0);
        }
        compare(&mut designs);
        assert_eq!(designs[0].compared.optimum, Some(1.001));
    }

    #[test]
    fn of_several_intuitive_designs_the_one_with_equal_area_is_used() {
        let mut designs = vec![
            design(Role::Refined, 50, Some(2.0)),
            design(Role::IntuitiveEqualArea, 50, Some(1.6)),
            design(Role::IntuitiveEqualArea, 50, Some(1.7)),
        ];
        designs[0].area = 0.4;
        designs[2].area = 0.4004;
        compare(&mut designs);
        assert_eq!(designs[0].compared.intuitive_equal_area, Some(1.7));
        // One with another area gives no gain at equal area.
        designs[2].area = 0.41;
        compare(&mut designs);
        assert_eq!(designs[0].compared.intuitive_equal_area, None);
    }
}
