//! What lies within contours, and the cells in it.

use super::Point;
use super::area::area;
use super::edge::{Edge, winding};
use super::piece::Contour;
use crate::{Bits, Membrane, Polygons};

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
    pub(crate) fn fills(self, winding: i32) -> bool {
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
        let is_filled = |windings: &[i32]| windings.iter().any(|winding| self.rule.fills(*winding));
        area(std::slice::from_ref(&self.contours), &is_filled)
    }

    /// Returns the cells of a membrane whose centre is filled or on a contour.
    #[must_use]
    pub fn cells(&self, membrane: Membrane) -> Bits {
        cells(&self.polygons(), self.rule, membrane)
    }

    /// Returns what is filled, within 1e-6 mm.
    #[must_use]
    pub fn filled(&self) -> Polygons {
        Polygons::filled(&self.polygons(), self.rule)
    }

    pub(super) fn polygons(&self) -> Vec<Vec<Point>> {
        self.contours.iter().map(Contour::corners).collect()
    }
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

    fn area_by(contours: &[Contour], rule: FillRule) -> f64 {
        let contours = contours.to_vec();
        Contours { contours, rule }.area()
    }

    #[test]
    fn nested_contours_have_exact_areas() {
        use FillRule::{EvenOdd, NonZero};
        let nested = [disc(10.0, 10.0, 8.0), disc(10.5, 10.0, 5.0), disc(10.2, 10.1, 2.0)];
        assert!((area_by(&nested, EvenOdd) / (PI * (64.0 - 25.0 + 4.0)) - 1.0).abs() < 1e-14);
        assert!((area_by(&nested, NonZero) / (PI * 64.0) - 1.0).abs() < 1e-14);
        let ring = [disc(10.0, 10.0, 8.0), backwards(&disc(10.0, 10.0, 5.0))];
        assert!((area_by(&ring, NonZero) / (PI * 39.0) - 1.0).abs() < 1e-14);
        // Side by side, and touching in a point.
        let apart = [disc(5.0, 10.0, 4.0), disc(13.0, 10.0, 4.0)];
        assert!((area_by(&apart, EvenOdd) / (PI * 32.0) - 1.0).abs() < 1e-8);
        assert_eq!(area_by(&[], EvenOdd), 0.0);
    }

    #[test]
    fn crossing_contours_have_their_areas() {
        use FillRule::{EvenOdd, NonZero};
        // Two discs whose circles run through each other's centre: the lens has r² (2π/3 − √3/2).
        let discs = [disc(8.0, 10.0, 4.0), disc(12.0, 10.0, 4.0)];
        let lens = 16.0 * (2.0 * PI / 3.0 - 3.0_f64.sqrt() / 2.0);
        assert!((area_by(&discs, EvenOdd) / (32.0 * PI - 2.0 * lens) - 1.0).abs() < 1e-6);
        assert!((area_by(&discs, NonZero) / (32.0 * PI - lens) - 1.0).abs() < 1e-6);
        // Rectangles that share parts of their upper and lower sides.
        let boxes = [2.0, 4.0].map(|x| Contour::rectangle([x, 5.0], [2.0, 5.0], 0.0, 0.0));
        assert!((area_by(&boxes, EvenOdd) - 40.0).abs() < 1e-9 && (area_by(&boxes, NonZero) - 60.0).abs() < 1e-9);
        // A bow tie, and a pentagram, whose middle is run around twice.
        let bow = Contour::polygon(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]]).unwrap();
        assert!((area_by(&[bow], EvenOdd) - 8.0).abs() < 1e-6);
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
            (area_by(&star, NonZero) - whole).abs() < 1e-6,
            "{} {whole}",
            area_by(&star, NonZero)
        );
        assert!((area_by(&star, EvenOdd) - (whole - pentagon)).abs() < 1e-6);
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
