//! What is wanted of a design, and how far a field is from it.
//!
//! The source paper minimises F = 1 − |D·d|/‖D‖ + λ|α − α_target| (Qin et al., doi 10.1089/soro.2024.0063, equation 6),
//! D being the displacement of the point. Taken literally this is blind to the magnitude and the sign of D: a motion of
//! a micrometre straight backwards is as good as any. Used here is F = 1 − (D·d)/2.5 mm + λ|α − α_target| with d the
//! signed unit direction; the literal form stays selectable.

use crate::field::Field;
use crate::pattern::{CELLS, Pattern};

/// The displacement in mm that counts as 1: the top of the paper's deformation space.
const SCALE_MM: f64 = 2.5;

/// The default weight λ of the area: leaving the wanted area fraction by 1 % costs as much as 0.125 mm gain. That is just
/// above the steepest gain that area gives in the linear response of the default scene (0.12 mm for 1 %, between area
/// fractions of 5 % and 95 %), so that the optimum keeps to the wanted area; a larger weight only makes the search stiffer.
pub const AREA_PENALTY: f64 = 5.0;

/// One point and the direction in which it should move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Position in mm from the lower left corner of the membrane.
    pub point_mm: [f64; 2],
    /// Direction in degrees, counterclockwise from +x.
    pub direction_deg: f64,
}

/// How a field is measured against the aims.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Measure {
    /// Displacement along the wanted directions.
    #[default]
    Displacement,
    /// The paper's equation 6 to the letter: only how well the directions agree, regardless of sign and magnitude.
    Qin2024,
}

/// A valid goal of a design.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    measure: Measure,
    aims: Vec<Placed>,
    area: f64,
    area_penalty: f64,
}

/// An aim in the units of the raster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    /// Position in cells.
    pub(super) point: [f64; 2],
    /// Unit vector.
    pub(super) direction: [f64; 2],
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
        "the point ({} mm, {} mm) does not lie inside the membrane of {side} mm; on the frame nothing moves", point[0], point[1]
    )]
    Point {
        /// The point as given, in mm.
        point: [f64; 2],
        /// The side of the membrane in mm.
        side: f64,
    },
    /// A direction that is no angle.
    #[error("a direction is a finite angle, found {0} deg")]
    Direction(f64),
    /// An area fraction outside its range.
    #[error("an area fraction lies between 0 and 1, found {0}")]
    Area(f64),
    /// A weight that is none.
    #[error("the weight of the area is finite and not negative, found {0}")]
    Penalty(f64),
}

impl Goal {
    /// A goal for one or several points of a membrane of `side_mm`, at an area fraction; `area_penalty` is λ, by default
    /// [`AREA_PENALTY`]. With several points their mean counts.
    ///
    /// # Errors
    /// When there is no point, one does not lie inside the membrane, or a number is out of range.
    pub fn new(measure: Measure, aims: &[Aim], side_mm: f64, area: f64, area_penalty: f64) -> Result<Self, GoalError> {
        if !(side_mm.is_finite() && side_mm > 0.0) {
            return Err(GoalError::Side(side_mm));
        }
        if !(0.0..=1.0).contains(&area) {
            return Err(GoalError::Area(area));
        }
        if !(area_penalty.is_finite() && area_penalty >= 0.0) {
            return Err(GoalError::Penalty(area_penalty));
        }
        if aims.is_empty() {
            return Err(GoalError::NoAim);
        }
        Ok(Self {
            measure,
            aims: aims.iter().map(|aim| aim.placed(side_mm)).collect::<Result<_, _>>()?,
            area,
            area_penalty,
        })
    }

    /// The wanted area fraction.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.area
    }

    pub(super) fn aims(&self) -> &[Placed] {
        &self.aims
    }

    /// The value of a design in mm: the mean displacement of the points along their directions.
    #[must_use]
    pub fn value_mm(&self, field: &Field) -> f64 {
        self.mean(|aim| aim.along(field))
    }

    /// F of a pattern and its field; smaller is better.
    #[must_use]
    pub fn fitness(&self, pattern: &Pattern, field: &Field) -> f64 {
        let merit = match self.measure {
            Measure::Displacement => self.value_mm(field) / SCALE_MM,
            Measure::Qin2024 => self.mean(|aim| {
                let [x, y] = field.at(aim.point);
                let length = x.hypot(y);
                if length > 0.0 {
                    aim.along(field).abs() / length
                } else {
                    0.0
                }
            }),
        };
        1.0 - merit + self.area_penalty * (pattern.area_fraction() - self.area).abs()
    }

    fn mean(&self, of: impl Fn(&Placed) -> f64) -> f64 {
        self.aims.iter().map(of).sum::<f64>() / self.aims.len() as f64
    }
}

impl Aim {
    fn placed(&self, side: f64) -> Result<Placed, GoalError> {
        if !self.point_mm.iter().all(|&c| c > 0.0 && c < side) {
            return Err(GoalError::Point {
                point: self.point_mm,
                side,
            });
        }
        if !self.direction_deg.is_finite() {
            return Err(GoalError::Direction(self.direction_deg));
        }
        Ok(Placed {
            point: self.point_mm.map(|c| c / side * CELLS as f64),
            direction: unit_vector(self.direction_deg),
        })
    }
}

impl Placed {
    fn along(&self, field: &Field) -> f64 {
        let [x, y] = field.at(self.point);
        x * self.direction[0] + y * self.direction[1]
    }
}

/// The unit vector at an angle, exact at multiples of 90° and with equal components at odd multiples of 45°, so that
/// goals that are images of each other are treated alike to the last bit.
fn unit_vector(degrees: f64) -> [f64; 2] {
    let degrees = degrees.rem_euclid(360.0);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let eighths = degrees / 45.0;
    if eighths.fract() == 0.0 {
        return match eighths as u32 {
            1 => [half, half],
            2 => [0.0, 1.0],
            3 => [-half, half],
            4 => [-1.0, 0.0],
            5 => [-half, -half],
            6 => [0.0, -1.0],
            7 => [half, -half],
            _ => [1.0, 0.0],
        };
    }
    let (sine, cosine) = degrees.to_radians().sin_cos();
    [cosine, sine]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The field that is `u` everywhere off the frame.
    fn uniform(u: [f64; 2]) -> Field {
        Field::from_values((0..51 * 51).flat_map(|_| u).collect()).unwrap()
    }

    fn half() -> Pattern {
        Pattern::from_fn(|x, _| x < 25)
    }

    fn goal(measure: Measure, aims: &[(f64, f64, f64)], area: f64) -> Goal {
        let aims: Vec<Aim> = aims
            .iter()
            .map(|&(x, y, direction_deg)| Aim {
                point_mm: [x, y],
                direction_deg,
            })
            .collect();
        Goal::new(measure, &aims, 50.0, area, AREA_PENALTY).unwrap()
    }

    #[test]
    fn displacement_counts_with_sign_and_magnitude() {
        let right = goal(Measure::Displacement, &[(25.0, 25.0, 0.0)], 0.5);
        assert_eq!(right.fitness(&half(), &uniform([1.25, 0.7])), 0.5);
        assert_eq!(right.fitness(&half(), &uniform([-1.25, 0.7])), 1.5);
        let up = goal(Measure::Displacement, &[(25.0, 25.0, 90.0)], 0.5);
        assert_eq!(up.value_mm(&uniform([1.25, 0.7])), 0.7);
        let slanted = goal(Measure::Displacement, &[(25.0, 25.0, 30.0)], 0.5);
        let expected = 3f64.sqrt() / 2.0 + 0.5;
        assert!((slanted.value_mm(&uniform([1.0, 1.0])) - expected).abs() < 1e-15);
    }

    #[test]
    fn leaving_the_area_costs() {
        let wanted = goal(Measure::Displacement, &[(25.0, 25.0, 0.0)], 0.48);
        assert!((wanted.fitness(&half(), &Field::zero()) - (1.0 + AREA_PENALTY * 0.02)).abs() < 1e-12);
    }

    #[test]
    fn the_literal_objective_is_blind_to_sign_and_magnitude() {
        let literal = goal(Measure::Qin2024, &[(25.0, 25.0, 0.0)], 0.5);
        for u in [[1.2, 0.0], [-1.2, 0.0], [1e-6, 0.0]] {
            assert_eq!(literal.fitness(&half(), &uniform(u)), 0.0);
        }
        assert!((literal.fitness(&half(), &uniform([3.0, 4.0])) - 0.4).abs() < 1e-15);
        assert_eq!(literal.fitness(&half(), &Field::zero()), 1.0);
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
        let goal = goal(Measure::Displacement, &centripetal, 0.5);
        assert!(goal.value_mm(&uniform([1.0, 0.3])).abs() < 1e-15);
        let inwards = (0..51 * 51).flat_map(|i| [25.0 - f64::from(i % 51), 25.0 - f64::from(i / 51)]);
        let inwards = Field::from_values(inwards.collect()).unwrap();
        assert!((goal.value_mm(&inwards) - 12.5 * 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn points_are_placed_by_the_side_of_the_membrane() {
        let aim = Aim {
            point_mm: [25.0, 75.0],
            direction_deg: 0.0,
        };
        let goal = Goal::new(Measure::Displacement, &[aim], 100.0, 0.5, 0.0).unwrap();
        assert_eq!(goal.aims()[0].point, [12.5, 37.5]);
    }

    #[test]
    fn opposite_directions_are_exactly_opposite() {
        for degrees in [0.0, 45.0, 90.0, 135.0, 405.0, -45.0] {
            let (there, back) = (unit_vector(degrees), unit_vector(degrees + 180.0));
            assert_eq!(there.map(|c| -c), back);
            assert!((there[0] - degrees.to_radians().cos()).abs() < 1e-15);
            assert!((there[1] - degrees.to_radians().sin()).abs() < 1e-15);
        }
    }

    #[test]
    fn refuses_what_is_not_a_goal() {
        let goal = |point_mm, direction_deg, side, area, penalty| {
            let aim = Aim {
                point_mm,
                direction_deg,
            };
            Goal::new(Measure::Displacement, &[aim], side, area, penalty).unwrap_err()
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
        let none = Goal::new(Measure::Displacement, &[], 50.0, 0.5, 1.0);
        assert_eq!(none, Err(GoalError::NoAim));
    }
}
