//! Affine maps of the plane.

use crate::contour::{Contour, Point};

/// A linear map, then a translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// The images of the unit vectors along x and y.
    pub columns: [Point; 2],
    /// The image of the origin.
    pub origin: Point,
}

impl Affine {
    pub const IDENTITY: Self = Self {
        columns: [[1.0, 0.0], [0.0, 1.0]],
        origin: [0.0; 2],
    };

    pub fn moved(origin: Point) -> Self {
        Self {
            origin,
            ..Self::IDENTITY
        }
    }

    pub fn scaled([x, y]: [f64; 2]) -> Self {
        Self {
            columns: [[x, 0.0], [0.0, y]],
            ..Self::IDENTITY
        }
    }

    /// Turned anticlockwise by an angle in degrees, exactly for quarter turns.
    pub fn turned(degrees: f64) -> Self {
        let quarters = degrees / 90.0;
        let (sin, cos) = match quarters.fract() == 0.0 {
            true => [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarters.rem_euclid(4.0) as usize % 4],
            false => degrees.to_radians().sin_cos(),
        };
        Self {
            columns: [[cos, sin], [-sin, cos]],
            ..Self::IDENTITY
        }
    }

    /// Returns this map after another.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            columns: first.columns.map(|column| self.direction(column)),
            origin: self.point(first.origin),
        }
    }

    pub fn direction(&self, [x, y]: Point) -> Point {
        let [one, other] = self.columns;
        [x * one[0] + y * other[0], x * one[1] + y * other[1]]
    }

    pub fn point(&self, point: Point) -> Point {
        let [x, y] = self.direction(point);
        [x + self.origin[0], y + self.origin[1]]
    }

    pub fn contour(&self, contour: &Contour) -> Contour {
        contour.mapped(|point| self.point(point), |axis| self.direction(axis))
    }
}
