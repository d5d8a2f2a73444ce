//! Points and bodies, and how they should move.

use super::goal::GoalError;
use deaflow_field::Field;
use deaflow_pattern::Membrane;

/// What should move, in which state of the device, and where to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Position in mm from the lower left corner of the membrane; of a body its centroid.
    pub point_mm: [f64; 2],
    /// Where a rigid body is meant and not a point, how its motion is told.
    pub body: Option<Lever>,
    /// How it should move.
    pub motion: Motion,
    /// What it counts beside other points; positive.
    pub weight: f64,
    /// The state of the device in which it should, from 0.
    pub state: usize,
}

/// How a point or a body should move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// In a direction, in degrees counterclockwise from +x, as far as it gets.
    Along(f64),
    /// In a direction so many mm, no more and no less.
    By(f64, f64),
    /// By this vector in mm.
    To([f64; 2]),
    /// A body turns counterclockwise, or where it is false clockwise, as far as it gets.
    Turn(bool),
    /// A body turns by so many degrees counterclockwise, no more and no less.
    TurnBy(f64),
}

/// By what the motion of a rigid body is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lever {
    /// Two corners of its cells, by column and row.
    pub ends: [[usize; 2]; 2],
    /// From the centroid of its cells to the first of them, in mm.
    pub start_mm: [f64; 2],
    /// From the first to the second in mm.
    pub offset_mm: [f64; 2],
    /// How far its outermost corner is from its centroid, in mm. A rotation counts by the arc of that corner.
    pub arm_mm: f64,
}

/// An aim in the units of the raster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedAim {
    /// Position in cells.
    pub point: [f64; 2],
    /// Unit vector; of a rotation (1, 0), or (−1, 0) where it should be clockwise.
    pub direction: [f64; 2],
    /// Wanted displacement in mm; zero where as far as possible is wanted.
    pub wanted: [f64; 2],
    /// Share of all aims; they add up to 1.
    pub weight: f64,
    /// The state of the device, from 0.
    pub state: usize,
    /// What it is that moves.
    pub subject: Subject,
}

/// What moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Subject {
    /// A point.
    Point,
    /// The centroid of a rigid body.
    Translation(Lever),
    /// A rigid body about its centroid.
    Rotation(Lever),
}

impl Aim {
    /// The only one of a device without states.
    #[must_use]
    pub const fn new(point_mm: [f64; 2], motion: Motion) -> Self {
        Self {
            point_mm,
            body: None,
            motion,
            weight: 1.0,
            state: 0,
        }
    }

    pub(super) fn placed(&self, membrane: &Membrane) -> Result<PlacedAim, GoalError> {
        let mut inside = self.point_mm.iter().zip(membrane.size_mm);
        if !inside.all(|(&c, side)| c > 0.0 && c < side) {
            return Err(GoalError::Point {
                point: self.point_mm,
                size: membrane.size_text(),
            });
        }
        if !(self.weight.is_finite() && self.weight > 0.0) {
            return Err(GoalError::Weight(self.weight));
        }
        let (subject, arm_mm) = match (self.motion.turns(), self.body) {
            (false, None) => (Subject::Point, 0.0),
            (false, Some(lever)) => (Subject::Translation(lever), 0.0),
            (true, Some(lever)) => (Subject::Rotation(lever), lever.arm_mm),
            (true, None) => return Err(GoalError::PointTurns),
        };
        let (direction, wanted) = self.motion.vectors(arm_mm)?;
        Ok(PlacedAim {
            point: membrane.in_cells(self.point_mm),
            direction,
            wanted,
            weight: self.weight,
            state: self.state,
            subject,
        })
    }
}

impl Motion {
    /// Whether it says how far, and not only where to.
    #[must_use]
    pub fn is_wanted(&self) -> bool {
        !matches!(self, Self::Along(_) | Self::Turn(_))
    }

    fn turns(self) -> bool {
        matches!(self, Self::Turn(_) | Self::TurnBy(_))
    }

    /// The direction, and the wanted displacement in mm: of a rotation the arc at the end of an arm.
    fn vectors(self, arm_mm: f64) -> Result<([f64; 2], [f64; 2]), GoalError> {
        let direction = |degrees: f64| match degrees.is_finite() {
            true => Ok(unit_vector(degrees)),
            false => Err(GoalError::Direction(degrees)),
        };
        let (direction, wanted) = match self {
            Self::Along(degrees) => (direction(degrees)?, [0.0; 2]),
            Self::By(degrees, length) => (direction(degrees)?, direction(degrees)?.map(|c| c * length)),
            Self::To(wanted) => {
                let length = wanted[0].hypot(wanted[1]);
                let along = if length > 0.0 {
                    wanted.map(|c| c / length)
                } else {
                    [1.0, 0.0]
                };
                (along, wanted)
            }
            Self::Turn(counterclockwise) => ([if counterclockwise { 1.0 } else { -1.0 }, 0.0], [0.0; 2]),
            Self::TurnBy(degrees) => (
                [if degrees < 0.0 { -1.0 } else { 1.0 }, 0.0],
                [degrees.to_radians() * arm_mm, 0.0],
            ),
        };
        match wanted.iter().all(|c| c.is_finite()) {
            true => Ok((direction, wanted)),
            false => Err(GoalError::Wanted(wanted)),
        }
    }
}

impl Lever {
    /// From the first end to the second in a field, in mm.
    fn offset(&self, field: &Field) -> [f64; 2] {
        let [from, to] = self.ends.map(|[x, y]| field.at_corner(x, y));
        [0, 1].map(|k| self.offset_mm[k] + to[k] - from[k])
    }

    /// How far the body has turned, in radians.
    fn angle(&self, field: &Field) -> f64 {
        let ([x, y], [a, b]) = (self.offset_mm, self.offset(field));
        (x * b - y * a).atan2(x * a + y * b)
    }

    /// The derivative of the angle with respect to the displacement of the second end, and the negative of that to the first.
    fn turn(&self, field: &Field) -> [f64; 2] {
        let [a, b] = self.offset(field);
        let squared = a * a + b * b;
        [-b / squared, a / squared]
    }

    /// How far the centroid has moved, in mm: u = t + (R − I)(X − Xc) at the first end.
    fn translation(&self, field: &Field) -> [f64; 2] {
        let ([x, y], [u, v]) = (self.start_mm, field.at_corner(self.ends[0][0], self.ends[0][1]));
        let (sine, cosine) = self.angle(field).sin_cos();
        [u - (cosine - 1.0) * x + sine * y, v - sine * x - (cosine - 1.0) * y]
    }

    /// The derivative of the translation with respect to the angle where the first end stays.
    fn translation_by_turn(&self, field: &Field) -> [f64; 2] {
        let ([x, y], (sine, cosine)) = (self.start_mm, self.angle(field).sin_cos());
        [sine * x + cosine * y, sine * y - cosine * x]
    }
}

impl PlacedAim {
    /// Its motion in mm in the states of a device: a displacement, or (arc, 0) of a body that turns.
    #[must_use]
    pub fn motion(&self, fields: &[Field]) -> [f64; 2] {
        let field = &fields[self.state];
        match self.subject {
            Subject::Point => field.at(self.point),
            Subject::Translation(lever) => lever.translation(field),
            Subject::Rotation(lever) => [lever.arm_mm * lever.angle(field), 0.0],
        }
    }

    /// How far a motion goes along its direction, in mm.
    #[must_use]
    pub fn along(&self, [x, y]: [f64; 2]) -> f64 {
        x * self.direction[0] + y * self.direction[1]
    }

    /// What of a motion is beyond the wanted one, in mm.
    #[must_use]
    pub fn off(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [x - self.wanted[0], y - self.wanted[1]]
    }

    /// How what changes by `gradient` with its motion changes with the displacements of corners: of each, by its place in `[y][x]`, the
    /// derivative with respect to both components.
    pub(super) fn slope(&self, fields: &[Field], gradient: [f64; 2]) -> Vec<(usize, [f64; 2])> {
        let field = &fields[self.state];
        let (lever, by_turn, at_start) = match self.subject {
            Subject::Point => {
                let shares = Field::interpolation_weights(field.raster(), self.point).into_iter();
                return shares
                    .map(|(corner, share)| (corner, gradient.map(|g| g * share)))
                    .collect();
            }
            Subject::Rotation(lever) => (lever, lever.arm_mm * gradient[0], [0.0; 2]),
            Subject::Translation(lever) => {
                let [x, y] = lever.translation_by_turn(field);
                (lever, x * gradient[0] + y * gradient[1], gradient)
            }
        };
        let turn = lever.turn(field).map(|slope| slope * by_turn);
        let columns = field.raster().columns() + 1;
        let [start, end] = lever.ends.map(|[x, y]| y * columns + x);
        vec![(start, [0, 1].map(|k| at_start[k] - turn[k])), (end, turn)]
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

    #[test]
    fn opposite_directions_are_exactly_opposite() {
        for degrees in [0.0, 45.0, 90.0, 135.0, 405.0, -45.0] {
            let (there, back) = (unit_vector(degrees), unit_vector(degrees + 180.0));
            assert_eq!(there.map(|c| -c), back);
            assert!((there[0] - degrees.to_radians().cos()).abs() < 1e-15);
            assert!((there[1] - degrees.to_radians().sin()).abs() < 1e-15);
        }
    }
}
