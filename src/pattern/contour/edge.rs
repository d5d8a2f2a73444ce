//! The sides of polygons, and how often they run around a point.

use super::{Point, RESOLUTION};

/// A side of a polygon.
#[derive(Clone, Copy)]
pub(super) struct Edge {
    pub from: Point,
    pub to: Point,
}

impl Edge {
    /// The sides of a polygon.
    pub fn around(corners: &[Point]) -> impl Iterator<Item = Self> {
        let next = corners.iter().cycle().skip(1);
        corners.iter().zip(next).map(|(&from, &to)| Self { from, to })
    }

    /// Returns 1 if it runs upwards, else −1.
    pub fn turn(&self) -> i32 {
        if self.to[1] > self.from[1] { 1 } else { -1 }
    }

    pub fn length(&self) -> f64 {
        (self.to[0] - self.from[0]).hypot(self.to[1] - self.from[1])
    }

    /// Returns how far from it a point still counts as on it.
    fn tolerance(&self) -> f64 {
        let [[a, b], [c, d]] = [self.from, self.to];
        RESOLUTION * (a.abs() + b.abs() + c.abs() + d.abs())
    }

    pub fn span(&self, axis: usize) -> [f64; 2] {
        let (a, b, tolerance) = (self.from[axis], self.to[axis], self.tolerance());
        [a.min(b) - tolerance, a.max(b) + tolerance]
    }

    fn has(&self, [x, y]: Point) -> bool {
        let [[a, b], [c, d]] = [self.from, self.to];
        let (along, across) = ([c - a, d - b], [x - a, y - b]);
        let length = along[0].hypot(along[1]);
        let distance = (along[0] * across[1] - along[1] * across[0]).abs() / length;
        let share = (along[0] * across[0] + along[1] * across[1]) / (length * length);
        distance <= self.tolerance() && (0.0..=1.0).contains(&share)
    }

    /// Returns whether a ray from a point to the right crosses it.
    fn is_right_of(&self, [x, y]: Point) -> bool {
        let [[a, b], [c, d]] = [self.from, self.to];
        (b > y) != (d > y) && x < a + (y - b) / (d - b) * (c - a)
    }
}

/// Returns how often edges run around a point; `None` if it is on one of them. Edges that do not reach the height of
/// the point may be left out.
pub(super) fn winding(edges: impl Iterator<Item = Edge>, point: Point) -> Option<i32> {
    let mut winding = 0;
    for edge in edges {
        let [low, high] = edge.span(0);
        if point[0] > high {
            continue;
        }
        if point[0] >= low && edge.has(point) {
            return None;
        }
        if edge.is_right_of(point) {
            winding += edge.turn();
        }
    }
    Some(winding)
}
