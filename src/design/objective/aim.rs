//! Points, and how they should move.

use super::goal::GoalError;
use crate::field::Field;
use crate::pattern::Membrane;

/// One point and where it should move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Position in mm from the lower left corner of the membrane.
    pub point_mm: [f64; 2],
    /// How it should move.
    pub motion: Motion,
    /// What it counts beside other points; positive.
    pub weight: f64,
}

/// How a point should move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// In a direction, in degrees counterclockwise from +x, as far as it gets.
    Along(f64),
    /// In a direction so many mm, no more and no less.
    By(f64, f64),
    /// By this vector in mm.
    To([f64; 2]),
}

/// An aim in the units of the raster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedAim {
    /// Position in cells.
    pub point: [f64; 2],
    /// Unit vector.
    pub direction: [f64; 2],
    /// Wanted displacement in mm; zero where as far as possible is wanted.
    pub wanted: [f64; 2],
    /// Share of all aims; they add up to 1.
    pub weight: f64,
}

impl Aim {
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
        let (direction, wanted) = self.motion.vectors()?;
        Ok(PlacedAim {
            point: membrane.in_cells(self.point_mm),
            direction,
            wanted,
            weight: self.weight,
        })
    }
}

impl Motion {
    /// The direction, and the wanted displacement in mm.
    fn vectors(self) -> Result<([f64; 2], [f64; 2]), GoalError> {
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
        };
        match wanted.iter().all(|c| c.is_finite()) {
            true => Ok((direction, wanted)),
            false => Err(GoalError::Wanted(wanted)),
        }
    }
}

impl PlacedAim {
    /// The displacement of the point along its direction in mm.
    #[must_use]
    pub fn along(&self, field: &Field) -> f64 {
        let [x, y] = field.at(self.point);
        x * self.direction[0] + y * self.direction[1]
    }

    /// The displacement of the point beyond the wanted one, in mm.
    #[must_use]
    pub fn off(&self, field: &Field) -> [f64; 2] {
        let u = field.at(self.point);
        [u[0] - self.wanted[0], u[1] - self.wanted[1]]
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
