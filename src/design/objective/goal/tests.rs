use super::*;
use crate::RegionCells;
use crate::objective::aim::{BodyMarkers, Motion};
use crate::objective::measure::{Displacement, Distance, Qin2024};
use deaflow_pattern::{Pattern, Raster, Region};

/// The field that is `u` everywhere off the frame.
fn uniform(u: [f64; 2]) -> [Field; 1] {
    [Field::from_values(Raster::PAPER, (0..51 * 51).flat_map(|_| u).collect()).unwrap()]
}

fn half() -> Pattern {
    Pattern::from_fn(Raster::PAPER, |x, _| x < 25)
}

fn goal(measure: &'static dyn Measure, aims: &[(f64, f64, f64)], area: f64) -> Goal {
    let aims: Vec<Aim> = aims
        .iter()
        .map(|&(x, y, direction_deg)| Aim::new([x, y], Motion::Along(direction_deg)))
        .collect();
    Goal::new(measure, &aims, Membrane::square(50.0), Some(area), AREA_PENALTY).unwrap()
}

#[test]
fn displacement_counts_with_sign_and_magnitude() {
    let right = goal(&Displacement, &[(25.0, 25.0, 0.0)], 0.5);
    assert_eq!(right.fitness(half().area_fraction(None), &uniform([1.25, 0.7])), 0.5);
    assert_eq!(right.fitness(half().area_fraction(None), &uniform([-1.25, 0.7])), 1.5);
    let up = goal(&Displacement, &[(25.0, 25.0, 90.0)], 0.5);
    assert_eq!(up.value_mm(&uniform([1.25, 0.7])), 0.7);
    let slanted = goal(&Displacement, &[(25.0, 25.0, 30.0)], 0.5);
    let expected = 3f64.sqrt() / 2.0 + 0.5;
    assert!((slanted.value_mm(&uniform([1.0, 1.0])) - expected).abs() < 1e-15);
}

#[test]
fn an_area_error_is_penalised() {
    let wanted = goal(&Displacement, &[(25.0, 25.0, 0.0)], 0.48);
    assert!(
        (wanted.fitness(half().area_fraction(None), &[Field::zero(Raster::PAPER)]) - (1.0 + AREA_PENALTY * 0.02)).abs()
            < 1e-12
    );
}

#[test]
fn the_literal_objective_ignores_sign_and_magnitude() {
    let literal = goal(&Qin2024, &[(25.0, 25.0, 0.0)], 0.5);
    for u in [[1.2, 0.0], [-1.2, 0.0], [1e-6, 0.0]] {
        assert_eq!(literal.fitness(half().area_fraction(None), &uniform(u)), 0.0);
    }
    assert!((literal.fitness(half().area_fraction(None), &uniform([3.0, 4.0])) - 0.4).abs() < 1e-15);
    assert_eq!(
        literal.fitness(half().area_fraction(None), &[Field::zero(Raster::PAPER)]),
        1.0
    );
}

#[test]
fn several_points_count_by_their_mean() {
    // PAPER case III: four points towards the centre; a uniform field moves two of them the wrong way.
    let centripetal = [
        (12.5, 12.5, 45.0),
        (37.5, 12.5, 135.0),
        (37.5, 37.5, 225.0),
        (12.5, 37.5, 315.0),
    ];
    let goal = goal(&Displacement, &centripetal, 0.5);
    assert!(goal.value_mm(&uniform([1.0, 0.3])).abs() < 1e-15);
    let inwards = (0..51 * 51).flat_map(|i| [25.0 - f64::from(i % 51), 25.0 - f64::from(i / 51)]);
    let inwards = [Field::from_values(Raster::PAPER, inwards.collect()).unwrap()];
    assert!((goal.value_mm(&inwards) - 12.5 * 2f64.sqrt()).abs() < 1e-12);
}

fn of(measure: &'static dyn Measure, aims: &[([f64; 2], Motion, f64)]) -> Goal {
    let aim = |&(point_mm, motion, weight): &([f64; 2], Motion, f64)| Aim {
        weight,
        body: matches!(motion, Motion::Turn(_) | Motion::TurnBy(_)).then_some(MARKERS),
        ..Aim::new(point_mm, motion)
    };
    let aims: Vec<Aim> = aims.iter().map(aim).collect();
    Goal::new(measure, &aims, Membrane::square(50.0), None, AREA_PENALTY).unwrap()
}

#[test]
fn larger_and_smaller_displacements_are_distant_from_the_target() {
    let goal = of(&Distance, &[([25.0, 25.0], Motion::By(90.0, 1.0), 1.0)]);
    assert_eq!(goal.distance_mm(&uniform([0.0, 1.0])), Some(0.0));
    for u in [[0.0, 0.75], [0.0, 1.25], [0.25, 1.0]] {
        assert_eq!(goal.distance_mm(&uniform(u)), Some(0.25));
        assert_eq!(
            goal.fitness(half().area_fraction(None), &uniform(u)),
            1.1,
            "the area is free"
        );
    }
    assert_eq!(goal.value_mm(&uniform([3.0, 0.75])), 0.75);
    let vectors = of(
        &Distance,
        &[
            ([25.0, 25.0], Motion::To([0.3, 0.4]), 1.0),
            ([10.0, 25.0], Motion::To([0.0, 0.0]), 3.0),
        ],
    );
    let missed = vectors.distance_mm(&uniform([0.3, 0.4])).unwrap();
    assert!((missed - 0.5 * 0.75f64.sqrt()).abs() < 1e-15);
}

#[test]
fn points_count_by_their_weights() {
    let goal = of(
        &Displacement,
        &[
            ([25.0, 25.0], Motion::Along(0.0), 3.0),
            ([10.0, 10.0], Motion::Along(90.0), 1.0),
        ],
    );
    assert_eq!(goal.value_mm(&uniform([1.0, 2.0])), 1.25);
}

fn wavy(seed: usize) -> Field {
    let values = (0..51 * 51 * 2).map(|i| 1.0 + (((i + seed) * 37 % 101) as f64 - 50.0) / 40.0);
    Field::from_values(Raster::PAPER, values.collect()).unwrap()
}

/// A body of 6 × 4 cells about (25, 25) cells, by opposite corners.
const MARKERS: BodyMarkers = BodyMarkers {
    ends: [[22, 23], [28, 27]],
    start_mm: [-3.0, -2.0],
    offset_mm: [6.0, 4.0],
    arm_mm: 3.605_551_275_463_989,
};

#[test]
fn slopes_agree_with_finite_differences() {
    let fields = [wavy(0), wavy(11)];
    let places = |motion: [Motion; 2]| [([25.0, 25.0], motion[0], 1.0), ([12.5, 30.2], motion[1], 2.5)];
    let along = places([Motion::Along(0.0), Motion::Along(60.0)]);
    let turned = [([25.0, 25.0], Motion::TurnBy(-4.0), 1.0)];
    let mut of_states = of(&Distance, &places([Motion::By(30.0, 1.0), Motion::To([0.1, 0.2])]));
    of_states.aims[1].state = 1;
    let mut stroke = of(&Displacement, &along);
    stroke.aims[0].state = 1;
    for goal in [
        of(&Displacement, &along),
        of(&Qin2024, &along),
        of(&Displacement, &[([25.0, 25.0], Motion::Turn(false), 1.0)]),
        of(&Distance, &turned),
        body_to([0.3, -0.2]),
        of_states,
        stroke,
    ] {
        let slopes = goal.slope(&fields);
        let moved = |state: usize, at: usize, by: f64| {
            let mut values = fields[state].values().to_vec();
            values[at] += by;
            let mut fields = fields.clone();
            fields[state] = Field::from_values(Raster::PAPER, values).unwrap();
            goal.score(&fields)
        };
        let around = |x: usize, y: usize| (0..4).map(move |i| (y + i / 2) * 51 + x + i % 2);
        let corners = around(25, 25)
            .chain(around(12, 30))
            .chain(MARKERS.ends.map(|[x, y]| y * 51 + x));
        for at in corners.flat_map(|corner| [2 * corner, 2 * corner + 1]) {
            for (state, slope) in slopes.iter().enumerate() {
                let difference = (moved(state, at, 1e-5) - moved(state, at, -1e-5)) / 2e-5;
                assert!((slope.values()[at] - difference).abs() < 1e-9, "{at} in state {state}");
            }
        }
        assert_eq!(slopes[0].at_corner(3, 3), [0.0, 0.0]);
    }
}

fn body_to(translation: [f64; 2]) -> Goal {
    let aim = Aim {
        body: Some(MARKERS),
        ..Aim::new([25.0, 25.0], Motion::To(translation))
    };
    Goal::new(&Distance, &[aim], Membrane::square(50.0), None, 0.0).unwrap()
}

#[test]
fn a_body_turns_by_the_arc_of_its_outermost_corner() {
    let turned = |degrees: f64| {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let values = (0..51 * 51).flat_map(|i| {
            let [x, y] = [f64::from(i % 51) - 25.0, f64::from(i / 51) - 25.0];
            [cosine * x - sine * y - x + 0.3, sine * x + cosine * y - y - 0.1]
        });
        [Field::from_values(Raster::PAPER, values.collect()).unwrap()]
    };
    let goal = of(&Displacement, &[([25.0, 25.0], Motion::Turn(true), 1.0)]);
    for degrees in [-170.0, -3.0, 0.0, 12.5] {
        let arc = f64::to_radians(degrees) * MARKERS.arm_mm;
        assert!((goal.value_mm(&turned(degrees)) - arc).abs() < 1e-12, "{degrees}");
        // Its centroid does not move by that.
        assert!(
            body_to([0.3, -0.1]).distance_mm(&turned(degrees)).unwrap() < 1e-12,
            "{degrees}"
        );
    }
    let wanted = of(&Distance, &[([25.0, 25.0], Motion::TurnBy(-5.0), 1.0)]);
    assert!(wanted.distance_mm(&turned(-5.0)).unwrap() < 1e-12);
    let off = 2f64.to_radians() * MARKERS.arm_mm;
    assert!((wanted.distance_mm(&turned(-3.0)).unwrap() - off).abs() < 1e-12);
}

#[test]
fn forces_of_sides_have_their_own_slopes() {
    let aim = |side, degrees, weight| Aim {
        reaction: Some(side),
        weight,
        ..Aim::new([50.0, 25.0], Motion::Along(degrees))
    };
    let aims = [aim(1, 180.0, 3.0), aim(3, 30.0, 1.0)];
    let goal = Goal::new(&Displacement, &aims, Membrane::square(50.0), None, 0.0).unwrap();
    let forces = [[7.0, 8.0], [-4.0, 1.0], [9.0, 5.0], [2.0, 6.0]];
    let of = |forces| [wavy(3).with_reactions(forces)];
    let expected = 0.75 * 4.0 + 0.25 * (3f64.sqrt() + 3.0);
    assert!((goal.value_mm(&of(forces)) - expected).abs() < 1e-12 && goal.unit() == "mN");
    let slope = goal.slope(&of(forces)).remove(0);
    assert_eq!(slope.max_magnitude(), 0.0);
    for (side, c) in (0..4).flat_map(|side| [(side, 0), (side, 1)]) {
        let moved = |by: f64| {
            let mut forces = forces;
            forces[side][c] += by;
            goal.score(&of(forces))
        };
        let difference = (moved(1e-3) - moved(-1e-3)) / 2e-3;
        assert!((slope.reactions()[side][c] - difference).abs() < 1e-9, "{side} {c}");
    }
    let mixed = [aims[0].clone(), Aim::new([25.0, 25.0], Motion::Along(0.0))];
    let mixed = Goal::new(&Displacement, &mixed, Membrane::square(50.0), None, 0.0);
    assert_eq!(mixed, Err(GoalError::Units));
}

#[test]
fn areas_of_regions_have_slopes_and_targets() {
    let region = RegionCells::of(&Region::Rectangle([[20.0, 20.0], [30.0, 28.0]]), Membrane::square(50.0)).unwrap();
    let of = |measure: &'static dyn Measure, motions: [Motion; 2]| {
        let aims = [region.clone().into(), None].into_iter().zip(motions);
        let aims = aims.map(|(region, motion)| Aim {
            region,
            ..Aim::new([25.0, 24.0], motion)
        });
        Goal::new(measure, &aims.collect::<Vec<_>>(), Membrane::square(50.0), None, 0.0).unwrap()
    };
    let larger = of(&Displacement, [Motion::Grow(true), Motion::Along(0.0)]);
    let smaller = of(&Displacement, [Motion::Grow(false), Motion::Along(180.0)]);
    let target = of(&Distance, [Motion::GrowBy(0.21), Motion::To([1.0, 0.0])]);
    // Every length grows by 10 %.
    let grown = (0..51 * 51).flat_map(|i| [0.1 * f64::from(i % 51), 0.1 * f64::from(i / 51)]);
    let grown = [Field::from_values(Raster::PAPER, grown.collect()).unwrap()];
    let (radius, u) = (region.radius_mm(), 2.5);
    assert!((larger.value_mm(&grown) - (0.1 * radius + u) / 2.0).abs() < 1e-12);
    assert!((larger.value_mm(&grown) + smaller.value_mm(&grown)).abs() < 1e-12);
    // The area is met, the point is (1.5, 2.4) mm away.
    let missed = (0.5 * (1.5 * 1.5 + 2.4 * 2.4_f64)).sqrt();
    assert!((target.distance_mm(&grown).unwrap() - missed).abs() < 1e-12);
    assert!(larger.value_per_displacement() > 1.1 && larger.value_per_displacement() < 1.2);
    let base = [wavy(5).scaled(0.2)];
    for goal in [larger, smaller, target] {
        let slope = goal.slope(&base).remove(0);
        for at in [
            2 * (20 * 51 + 20),
            2 * (28 * 51 + 30) + 1,
            2 * (24 * 51 + 25),
            2 * (20 * 51 + 26) + 1,
        ] {
            let moved = |by: f64| {
                let mut values = base[0].values().to_vec();
                values[at] += by;
                goal.score(&[Field::from_values(Raster::PAPER, values).unwrap()])
            };
            let difference = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!((slope.values()[at] - difference).abs() < 1e-8, "{at}: {difference}");
        }
    }
}

#[test]
fn each_state_has_its_own_field() {
    // A stroke: to the right in one state, to the left in the other.
    let aim = |state, degrees| Aim {
        state,
        ..Aim::new([25.0, 25.0], Motion::Along(degrees))
    };
    let aims = [aim(0, 0.0), aim(1, 180.0)];
    let goal = Goal::new(&Displacement, &aims, Membrane::square(50.0), None, 0.0).unwrap();
    let [push, pull] = [uniform([1.0, 0.2]), uniform([-0.5, 0.1])];
    assert_eq!(goal.value_mm(&[push.as_slice(), &pull].concat()), 0.75);
}

#[test]
fn points_are_placed_by_the_side_of_the_membrane() {
    let aim = Aim::new([25.0, 75.0], Motion::Along(0.0));
    let goal = Goal::new(&Displacement, &[aim], Membrane::square(100.0), Some(0.5), 0.0).unwrap();
    assert_eq!(goal.aims()[0].point, [12.5, 37.5]);
}

#[test]
fn an_area_above_the_largest_one_is_a_violation_and_a_smaller_one_is_not() {
    let aim = Aim::new([25.0, 25.0], Motion::Along(0.0));
    for penalty in [0.0, AREA_PENALTY] {
        let near = Goal::new(
            &Displacement,
            std::slice::from_ref(&aim),
            Membrane::square(50.0),
            Some(0.3),
            penalty,
        )
        .unwrap();
        let largest = near.clone().with_largest_area(true);
        assert_eq!(largest.fitness_of(0.3, 0.8), 1.0 - 0.8);
        assert_eq!(largest.fitness_of(0.1, 0.8), 1.0 - 0.8);
        let above = largest.fitness_of(0.3004, 0.8);
        assert!((above - (1.2 + 0.0004 * penalty)).abs() < 1e-12, "{above}");
        assert!((near.fitness_of(0.1, 0.8) - (0.2 + 0.2 * penalty)).abs() < 1e-12);
    }
}

#[test]
fn invalid_goals_are_refused() {
    let goal = |point_mm, direction_deg, side, area, penalty| {
        let aim = Aim::new(point_mm, Motion::Along(direction_deg));
        Goal::new(&Displacement, &[aim], Membrane::square(side), Some(area), penalty).unwrap_err()
    };
    for point in [[0.0, 25.0], [25.0, 50.0], [60.0, 1.0], [f64::NAN, 1.0]] {
        assert!(matches!(goal(point, 0.0, 50.0, 0.5, 1.0), GoalError::Point { .. }));
    }
    let middle = [25.0, 25.0];
    assert!(matches!(
        goal(middle, f64::INFINITY, 50.0, 0.5, 1.0),
        GoalError::Direction(_)
    ));
    assert!(matches!(goal(middle, 0.0, -50.0, 0.5, 1.0), GoalError::Side(_)));
    assert!(matches!(goal(middle, 0.0, 50.0, 1.5, 1.0), GoalError::Area(_)));
    assert!(matches!(goal(middle, 0.0, 50.0, 0.5, -1.0), GoalError::Penalty(_)));
    let none = Goal::new(&Displacement, &[], Membrane::square(50.0), Some(0.5), 1.0);
    assert_eq!(none, Err(GoalError::NoAim));
    let of = |measure, motion, weight| {
        let aim = Aim {
            weight,
            ..Aim::new(middle, motion)
        };
        Goal::new(measure, &[aim], Membrane::square(50.0), None, 1.0).unwrap_err()
    };
    let distance: &'static dyn Measure = &Distance;
    assert_eq!(of(distance, Motion::Along(0.0), 1.0), GoalError::NoDistance);
    assert_eq!(of(distance, Motion::By(0.0, 1.0), 0.0), GoalError::Weight(0.0));
    assert!(matches!(
        of(distance, Motion::To([f64::NAN, 0.0]), 1.0),
        GoalError::Displacement(_)
    ));
}
