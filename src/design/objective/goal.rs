//! What is wanted of a design, and how far a field is from it.
//!
//! The source paper minimises F = 1 − |D·d|/‖D‖ + λ|α − α_target| (Qin et al., doi 10.1089/soro.2024.0063, equation 6),
//! D being the displacement of the point. Taken literally this is blind to the magnitude and the sign of D: a motion of
//! a micrometre straight backwards is as good as any. Used here is F = 1 − (D·d)/2.5 mm + λ|α − α_target| with d the
//! signed unit direction; the literal form stays selectable. A design that is to reach a wanted displacement, at one point or
//! at many that make up a wanted field, is judged by its distance from there instead.

use super::aim::{Aim, PlacedAim};
use super::measure::Measure;
use deaflow_field::{Field, StateFields};
use deaflow_pattern::{Membrane, Pattern, Raster};

/// The default weight λ of the area: leaving the wanted area fraction by 1 % costs as much as 0.125 mm gain. That is just
/// above the steepest gain that area gives in the linear response of the default scene (0.12 mm for 1 %, between area
/// fractions of 5 % and 95 %), so that the optimum keeps to the wanted area; a larger weight only makes the search stiffer.
pub const AREA_PENALTY: f64 = 5.0;

/// A valid goal of a design.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    measure: &'static dyn Measure,
    raster: Raster,
    aims: Vec<PlacedAim>,
    area: Option<f64>,
    area_penalty: f64,
}

/// What is not a goal.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GoalError {
    /// Nothing to move.
    #[error("a design needs at least one point")]
    NoAim,
    /// A side that is no length.
    #[error("the side of the membrane is a positive length, found {0} mm")]
    Side(f64),
    /// A point that cannot move.
    #[error(
        "the point ({} mm, {} mm) does not lie inside the membrane of {size}; on the frame nothing moves", point[0], point[1]
    )]
    Point {
        /// The point as given, in mm.
        point: [f64; 2],
        /// The sides of the membrane, in words.
        size: String,
    },
    /// A point has no direction.
    #[error("a rotation is that of a rigid body, and this is a point")]
    PointTurns,
    /// A body that is not there.
    #[error("there is no body {found}: the scene has {count}, counted from 0")]
    Body {
        /// Its number.
        found: usize,
        /// How many there are.
        count: usize,
    },
    /// A state that is not there.
    #[error("there is no state `{found}`: the scene has {}", if states.is_empty() { "none" } else { states.as_str() })]
    State {
        /// Its name.
        found: String,
        /// Those that there are.
        states: String,
    },
    /// One of several states is meant.
    #[error("a point or body does not say in which `state` it should move; the scene has {states}")]
    NoState {
        /// Those that there are.
        states: String,
    },
    /// A direction that is no angle.
    #[error("a direction is a finite angle, found {0} deg")]
    Direction(f64),
    /// A weight of a point that is none.
    #[error("the weight of a point is finite and positive, found {0}")]
    Weight(f64),
    /// A wanted displacement that is none.
    #[error("a wanted displacement is a finite vector, found ({} mm, {} mm)", _0[0], _0[1])]
    Wanted([f64; 2]),
    /// Distances from nowhere.
    #[error("a point is to move as far as it gets, and its distance from there is not defined")]
    NoDistance,
    /// An area fraction outside its range.
    #[error("an area fraction lies between 0 and 1, found {0}")]
    Area(f64),
    /// A weight that is none.
    #[error("the weight of the area is finite and not negative, found {0}")]
    Penalty(f64),
}

impl Goal {
    /// A goal for one or several points of a membrane, at an area fraction, or at whatever area serves it best;
    /// `area_penalty` is λ, by default [`AREA_PENALTY`]. Several points count by their weighted mean.
    ///
    /// # Errors
    /// When there is no point, one does not lie inside the membrane, a number is out of range, or distances are to be measured
    /// and a point has no wanted displacement.
    pub fn new(
        measure: &'static dyn Measure,
        aims: &[Aim],
        membrane: Membrane,
        area: Option<f64>,
        area_penalty: f64,
    ) -> Result<Self, GoalError> {
        if let Some(side) = membrane
            .size_mm
            .into_iter()
            .find(|side| !(side.is_finite() && *side > 0.0))
        {
            return Err(GoalError::Side(side));
        }
        if let Some(area) = area.filter(|area| !(0.0..=1.0).contains(area)) {
            return Err(GoalError::Area(area));
        }
        if !(area_penalty.is_finite() && area_penalty >= 0.0) {
            return Err(GoalError::Penalty(area_penalty));
        }
        if aims.is_empty() {
            return Err(GoalError::NoAim);
        }
        if measure.needs_displacement() && aims.iter().any(|aim| !aim.motion.is_wanted()) {
            return Err(GoalError::NoDistance);
        }
        let mut placed: Vec<PlacedAim> = aims.iter().map(|aim| aim.placed(&membrane)).collect::<Result<_, _>>()?;
        let total: f64 = placed.iter().map(|aim| aim.weight).sum();
        placed.iter_mut().for_each(|aim| aim.weight /= total);
        Ok(Self {
            measure,
            raster: membrane.raster,
            aims: placed,
            area,
            area_penalty,
        })
    }

    /// The wanted area fraction; `None` where any will do.
    #[must_use]
    pub fn area(&self) -> Option<f64> {
        self.area
    }

    /// The cells of its membrane.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// Its aims.
    #[must_use]
    pub fn aims(&self) -> &[PlacedAim] {
        &self.aims
    }

    /// The value of a design in mm by its fields in the states of the device: the mean displacement of the points along their directions.
    #[must_use]
    pub fn value_mm(&self, fields: &[Field]) -> f64 {
        self.value_of(&self.motions(fields))
    }

    /// The motion of each aim in mm in the states of the device, as [`PlacedAim::motion`] has it.
    #[must_use]
    pub fn motions(&self, fields: &[Field]) -> Vec<[f64; 2]> {
        self.aims.iter().map(|aim| aim.motion(fields)).collect()
    }

    /// The value of a design in mm by the motions of its aims.
    #[must_use]
    pub fn value_of(&self, motions: &[[f64; 2]]) -> f64 {
        self.mean(motions, PlacedAim::along)
    }

    /// How far the points are from where they are wanted, root mean square in mm; `None` where nothing but a direction is
    /// wanted.
    #[must_use]
    pub fn distance_mm(&self, fields: &[Field]) -> Option<f64> {
        self.measure
            .needs_displacement()
            .then(|| self.distance(&self.motions(fields)))
    }

    /// F of a pattern and its fields; smaller is better.
    #[must_use]
    pub fn fitness(&self, pattern: &Pattern, fields: &[Field]) -> f64 {
        self.fitness_of(pattern, self.score(fields))
    }

    /// F of a pattern and its score; smaller is better.
    #[must_use]
    pub fn fitness_of(&self, pattern: &Pattern, score: f64) -> f64 {
        let off = self.area.map_or(0.0, |area| (pattern.area_fraction() - area).abs());
        1.0 - score + self.area_penalty * off
    }

    /// How good fields are, whatever the area of their pattern; larger is better.
    #[must_use]
    pub fn score(&self, fields: &[Field]) -> f64 {
        self.score_of(&self.motions(fields))
    }

    /// How good motions of the aims are; larger is better.
    #[must_use]
    pub fn score_of(&self, motions: &[[f64; 2]]) -> f64 {
        self.measure.score(self, motions)
    }

    /// The derivative of [`Goal::score`] with respect to the displacement of each corner in each state, per mm; zero where there is none.
    #[must_use]
    pub fn slope(&self, fields: &[Field]) -> StateFields {
        let gradients = self.measure.gradients(self, &self.motions(fields));
        let pairs = self.aims.iter().zip(gradients);
        self.slopes(
            fields,
            pairs.map(|(aim, gradient)| (aim, gradient.map(|g| aim.weight * g))),
        )
    }

    /// The derivative of what changes by `gradient` with the motion of one aim.
    pub(super) fn slope_of(&self, aim: &PlacedAim, fields: &[Field], gradient: [f64; 2]) -> StateFields {
        self.slopes(fields, [(aim, gradient)].into_iter())
    }

    fn slopes<'a>(&self, fields: &[Field], each: impl Iterator<Item = (&'a PlacedAim, [f64; 2])>) -> StateFields {
        let mut slopes = vec![vec![0.0; 2 * self.raster.corners()]; fields.len()];
        for (aim, gradient) in each {
            for (corner, slope) in aim.slope(fields, gradient) {
                for (k, g) in slope.into_iter().enumerate() {
                    slopes[aim.state][2 * corner + k] += g;
                }
            }
        }
        let field = |slope| Field::from_values(self.raster, slope).unwrap_or_else(|_| Field::zero(self.raster));
        slopes.into_iter().map(field).collect()
    }

    /// How far the points are from the wanted displacements, root mean square in mm.
    #[must_use]
    pub fn distance(&self, motions: &[[f64; 2]]) -> f64 {
        self.mean(motions, |aim, motion| {
            let off = aim.off(motion);
            off[0] * off[0] + off[1] * off[1]
        })
        .sqrt()
    }

    /// The weighted mean of a value of each aim, by its motion.
    #[must_use]
    pub fn mean(&self, motions: &[[f64; 2]], of: impl Fn(&PlacedAim, [f64; 2]) -> f64) -> f64 {
        let pairs = self.aims.iter().zip(motions);
        pairs.map(|(aim, motion)| aim.weight * of(aim, *motion)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objective::aim::{Lever, Motion};
    use crate::objective::measure::{Displacement, Distance, Qin2024};
    use deaflow_pattern::Raster;

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
        assert_eq!(right.fitness(&half(), &uniform([1.25, 0.7])), 0.5);
        assert_eq!(right.fitness(&half(), &uniform([-1.25, 0.7])), 1.5);
        let up = goal(&Displacement, &[(25.0, 25.0, 90.0)], 0.5);
        assert_eq!(up.value_mm(&uniform([1.25, 0.7])), 0.7);
        let slanted = goal(&Displacement, &[(25.0, 25.0, 30.0)], 0.5);
        let expected = 3f64.sqrt() / 2.0 + 0.5;
        assert!((slanted.value_mm(&uniform([1.0, 1.0])) - expected).abs() < 1e-15);
    }

    #[test]
    fn leaving_the_area_costs() {
        let wanted = goal(&Displacement, &[(25.0, 25.0, 0.0)], 0.48);
        assert!((wanted.fitness(&half(), &[Field::zero(Raster::PAPER)]) - (1.0 + AREA_PENALTY * 0.02)).abs() < 1e-12);
    }

    #[test]
    fn the_literal_objective_is_blind_to_sign_and_magnitude() {
        let literal = goal(&Qin2024, &[(25.0, 25.0, 0.0)], 0.5);
        for u in [[1.2, 0.0], [-1.2, 0.0], [1e-6, 0.0]] {
            assert_eq!(literal.fitness(&half(), &uniform(u)), 0.0);
        }
        assert!((literal.fitness(&half(), &uniform([3.0, 4.0])) - 0.4).abs() < 1e-15);
        assert_eq!(literal.fitness(&half(), &[Field::zero(Raster::PAPER)]), 1.0);
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
            body: matches!(motion, Motion::Turn(_) | Motion::TurnBy(_)).then_some(LEVER),
            ..Aim::new(point_mm, motion)
        };
        let aims: Vec<Aim> = aims.iter().map(aim).collect();
        Goal::new(measure, &aims, Membrane::square(50.0), None, AREA_PENALTY).unwrap()
    }

    #[test]
    fn a_wanted_displacement_is_missed_by_too_much_and_by_too_little() {
        let goal = of(&Distance, &[([25.0, 25.0], Motion::By(90.0, 1.0), 1.0)]);
        assert_eq!(goal.distance_mm(&uniform([0.0, 1.0])), Some(0.0));
        for u in [[0.0, 0.75], [0.0, 1.25], [0.25, 1.0]] {
            assert_eq!(goal.distance_mm(&uniform(u)), Some(0.25));
            assert_eq!(goal.fitness(&half(), &uniform(u)), 1.1, "the area is free");
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
    const LEVER: Lever = Lever {
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
                .chain(LEVER.ends.map(|[x, y]| y * 51 + x));
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
            body: Some(LEVER),
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
            let arc = f64::to_radians(degrees) * LEVER.arm_mm;
            assert!((goal.value_mm(&turned(degrees)) - arc).abs() < 1e-12, "{degrees}");
            // Its centroid does not move by that.
            assert!(
                body_to([0.3, -0.1]).distance_mm(&turned(degrees)).unwrap() < 1e-12,
                "{degrees}"
            );
        }
        let wanted = of(&Distance, &[([25.0, 25.0], Motion::TurnBy(-5.0), 1.0)]);
        assert!(wanted.distance_mm(&turned(-5.0)).unwrap() < 1e-12);
        let off = 2f64.to_radians() * LEVER.arm_mm;
        assert!((wanted.distance_mm(&turned(-3.0)).unwrap() - off).abs() < 1e-12);
    }

    #[test]
    fn states_count_each_with_their_own_field() {
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
    fn refuses_what_is_not_a_goal() {
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
            GoalError::Wanted(_)
        ));
    }
}
