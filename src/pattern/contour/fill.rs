//! What lies within contours, and the cells in it.

use super::area::area_of;
use super::piece::Contour;
use super::{Point, RESOLUTION};
use crate::{Bits, Membrane};

/// What of overlapping contours is filled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FillRule {
    /// What an odd number of contours contains.
    EvenOdd,
    /// What the contours run around, both directions not cancelling.
    NonZero,
}

impl FillRule {
    /// Returns whether a point is filled that the contours run around so many times.
    pub(super) fn fills(self, winding: i32) -> bool {
        match self {
            Self::EvenOdd => winding % 2 != 0,
            Self::NonZero => winding != 0,
        }
    }
}

/// What several contours fill together.
#[derive(Clone, Debug, PartialEq)]
pub struct Contours {
    /// The contours in mm.
    pub contours: Vec<Contour>,
    /// What of them is filled.
    pub rule: FillRule,
}

impl Contours {
    /// Returns what one contour fills by the even-odd rule.
    #[must_use]
    pub fn one(contour: Contour) -> Self {
        Self {
            contours: vec![contour],
            rule: FillRule::EvenOdd,
        }
    }

    /// Returns the filled area: exact if no contours cross, else to 1e-6 mm along them.
    #[must_use]
    pub fn area(&self) -> f64 {
        area_of(std::slice::from_ref(self))
    }

    /// Returns the cells of a membrane whose centre is filled or on a contour.
    #[must_use]
    pub fn cells(&self, membrane: Membrane) -> Bits {
        cells(&self.polygons(), self.rule, membrane)
    }

    pub(super) fn polygons(&self) -> Vec<Vec<Point>> {
        self.contours.iter().map(Contour::corners).collect()
    }
}

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

    /// Returns how far from it a point still counts as on it.
    fn tolerance(&self) -> f64 {
        let [[a, b], [c, d]] = [self.from, self.to];
        RESOLUTION * (a.abs() + b.abs() + c.abs() + d.abs())
    }

    fn span(&self, axis: usize) -> [f64; 2] {
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

/// Returns the cells of a membrane whose centre is filled or on a side of a polygon.
pub(crate) fn cells(polygons: &[Vec<Point>], rule: FillRule, membrane: Membrane) -> Bits {
    let [_, rows] = membrane.raster.sides();
    let mut edges_of_rows = vec![Vec::new(); rows];
    for edge in polygons.iter().flat_map(|corners| Edge::around(corners)) {
        // One row more on both sides, for rounding.
        let [low, high] = edge.span(1).map(|y| y / membrane.size_mm[1] * rows as f64 - 0.5);
        let (first, last) = ((low.floor() - 1.0).max(0.0), (high.ceil() + 1.0).min(rows as f64 - 1.0));
        if first <= last {
            edges_of_rows[first as usize..=last as usize]
                .iter_mut()
                .for_each(|edges| edges.push(edge));
        }
    }
    Bits::from_fn(membrane.raster, |x, y| {
        let edges = edges_of_rows[y].iter().copied();
        winding(edges, membrane.centre_mm(x, y)).is_none_or(|winding| rule.fills(winding))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;
    use std::f64::consts::PI;

    fn disc(x: f64, y: f64, radius: f64) -> Contour {
        Contour::ellipse([x, y], [radius; 2], 0.0)
    }

    fn backwards(contour: &Contour) -> Contour {
        contour
            .mapped(|[x, y]| [-x, y], |[x, y]| [-x, y])
            .mapped(|[x, y]| [20.0 + x, y], |axis| axis)
    }

    fn area(contours: &[Contour], rule: FillRule) -> f64 {
        let contours = contours.to_vec();
        Contours { contours, rule }.area()
    }

    #[test]
    fn nested_contours_have_exact_areas() {
        use FillRule::{EvenOdd, NonZero};
        let nested = [disc(10.0, 10.0, 8.0), disc(10.5, 10.0, 5.0), disc(10.2, 10.1, 2.0)];
        assert!((area(&nested, EvenOdd) / (PI * (64.0 - 25.0 + 4.0)) - 1.0).abs() < 1e-14);
        assert!((area(&nested, NonZero) / (PI * 64.0) - 1.0).abs() < 1e-14);
        let ring = [disc(10.0, 10.0, 8.0), backwards(&disc(10.0, 10.0, 5.0))];
        assert!((area(&ring, NonZero) / (PI * 39.0) - 1.0).abs() < 1e-14);
        // Side by side, and touching in a point.
        let apart = [disc(5.0, 10.0, 4.0), disc(13.0, 10.0, 4.0)];
        assert!((area(&apart, EvenOdd) / (PI * 32.0) - 1.0).abs() < 1e-8);
        assert_eq!(area(&[], EvenOdd), 0.0);
    }

    #[test]
    fn crossing_contours_have_their_areas() {
        use FillRule::{EvenOdd, NonZero};
        // Two discs whose circles run through each other's centre: the lens has r² (2π/3 − √3/2).
        let discs = [disc(8.0, 10.0, 4.0), disc(12.0, 10.0, 4.0)];
        let lens = 16.0 * (2.0 * PI / 3.0 - 3.0_f64.sqrt() / 2.0);
        assert!((area(&discs, EvenOdd) / (32.0 * PI - 2.0 * lens) - 1.0).abs() < 1e-6);
        assert!((area(&discs, NonZero) / (32.0 * PI - lens) - 1.0).abs() < 1e-6);
        // A bow tie, and a pentagram, whose middle is run around twice.
        let bow = Contour::polygon(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]]).unwrap();
        assert!((area(&[bow], EvenOdd) - 8.0).abs() < 1e-6);
        let tip = |k: usize| [90.0, 234.0, 18.0, 162.0, 306.0_f64][k].to_radians();
        let star: Vec<Point> = (0..5)
            .map(|k| [10.0 + 5.0 * tip(k).cos(), 10.0 + 5.0 * tip(k).sin()])
            .collect();
        let star = [Contour::polygon(&star).unwrap()];
        // Five triangles from the middle to each tip and its two notches; the pentagon between the notches.
        let (notch, fifth) = (
            5.0 * (72.0_f64.to_radians().cos() / 36.0_f64.to_radians().cos()),
            36.0_f64.to_radians(),
        );
        let whole = 5.0 * 5.0 * notch * fifth.sin();
        let pentagon = 2.5 * notch * notch * (2.0 * fifth).sin();
        assert!(
            (area(&star, NonZero) - whole).abs() < 1e-6,
            "{} {whole}",
            area(&star, NonZero)
        );
        assert!((area(&star, EvenOdd) - (whole - pentagon)).abs() < 1e-6);
    }

    #[test]
    fn cells_follow_the_rule() {
        let membrane = Membrane {
            raster: Raster::new(400, 400).unwrap(),
            size_mm: [20.0, 20.0],
        };
        let contours = vec![disc(10.0, 10.0, 8.0), disc(11.0, 10.0, 5.0)];
        for (rule, exact) in [(FillRule::EvenOdd, PI * 39.0), (FillRule::NonZero, PI * 64.0)] {
            let contours = contours.clone();
            let found = Contours { contours, rule }.cells(membrane).count() as f64 * 0.05 * 0.05;
            assert!((found / exact - 1.0).abs() < 2e-3, "{found} {exact}");
        }
    }
}
