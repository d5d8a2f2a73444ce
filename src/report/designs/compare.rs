//! What a design is compared with: the intuitive one at its own and at equal area, and the best that gradients find.

use super::{Design, LEAST_MM, Role, SAME_AREA};

/// Simulated displacements along the wanted directions in mm, of the same case and target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Compared {
    /// Of the intuitive design at its own area.
    pub intuitive_own: Option<f64>,
    /// Of the intuitive design at the area of this one; none where none of that area is there.
    pub intuitive_equal_area: Option<f64>,
    /// Of the optimum: of the same units where there is one of these, else the best.
    pub optimum: Option<f64>,
    /// The displacement of this design over that of the optimum; none where a displacement is to be met, as more of it is not better, or the
    /// optimum hardly moves.
    pub ratio: Option<f64>,
}

/// Compares all designs with each other.
pub fn compare(designs: &mut [Design]) {
    let compared: Vec<Compared> = designs.iter().map(|design| of(design, designs)).collect();
    for (design, compared) in designs.iter_mut().zip(compared) {
        design.compared = compared;
    }
}

fn of(design: &Design, all: &[Design]) -> Compared {
    let beside = |role: Role| {
        all.iter()
            .filter(move |other| other.role == role && design.is_beside(other))
    };
    let distance = |other: &Design| (other.area - design.area).abs();
    let nearest = |role: Role| beside(role).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let equal = nearest(Role::IntuitiveEqualArea).filter(|other| distance(other) <= SAME_AREA);
    let optimum = optimum(design, &beside(Role::Optimum).collect::<Vec<_>>());
    let ratio = |optimum: f64| Some(design.simulated_mm? / optimum);
    Compared {
        intuitive_own: nearest(Role::Intuitive).and_then(|other| other.simulated_mm),
        intuitive_equal_area: equal.and_then(|other| other.simulated_mm),
        optimum,
        ratio: optimum
            // Of next to nothing, or of a way back, there is no share.
            .filter(|mm| !design.objective.is_met && *mm > LEAST_MM)
            .and_then(ratio),
    }
}

/// The best of the optima: the largest displacement, or the nearest to the one that is to be met.
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
    use crate::drawing::Ground;
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
            ground: Ground::plain(Membrane::square(50.0)),
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
            compared: Compared::default(),
        }
    }

    #[test]
    fn an_optimum_of_the_same_units_comes_before_a_better_one_of_others() {
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
        assert_eq!(designs[6].compared, Compared::default());

        designs.remove(2);
        compare(&mut designs);
        assert_eq!(designs[0].compared.optimum, Some(2.0), "the best there is");
    }

    #[test]
    fn of_an_optimum_that_hardly_moves_or_moves_back_there_is_no_share() {
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
    fn what_is_for_another_objective_area_or_scene_is_not_compared() {
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
    fn where_a_value_is_to_be_met_the_optimum_is_the_nearest_to_it() {
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
    fn of_several_intuitive_designs_the_one_of_the_same_area_counts() {
        let mut designs = vec![
            design(Role::Refined, 50, Some(2.0)),
            design(Role::IntuitiveEqualArea, 50, Some(1.6)),
            design(Role::IntuitiveEqualArea, 50, Some(1.7)),
        ];
        designs[0].area = 0.4;
        designs[2].area = 0.4004;
        compare(&mut designs);
        assert_eq!(designs[0].compared.intuitive_equal_area, Some(1.7));
        // One of another area says nothing of a gain at equal area.
        designs[2].area = 0.41;
        compare(&mut designs);
        assert_eq!(designs[0].compared.intuitive_equal_area, None);
    }
}
