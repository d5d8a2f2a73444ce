//! Closed curves and their pieces.

use std::f64::consts::{FRAC_PI_2, TAU};

use super::{Point, RESOLUTION};

/// The largest distance in mm between a curve and the straight lines that replace it.
const SAGITTA_MM: f64 = 1e-6;

/// The largest number of lines that replace a piece.
const MOST_LINES: f64 = 1e4;

/// A piece of a curve from the end of the piece before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Piece {
    /// A straight line to a point.
    Line(Point),
    /// An arc of an ellipse.
    Arc(Arc),
    /// A cubic Bézier curve: its control points and its end.
    Cubic([Point; 3]),
}

/// An arc of an ellipse, with the points centre + cos t · first axis + sin t · second axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    /// The centre of the ellipse.
    pub centre: Point,
    /// Two conjugate semiaxes. They are perpendicular unless the arc was sheared; for a circle they have one length.
    pub axes: [Point; 2],
    /// The t of its start in rad.
    pub from: f64,
    /// The change of t from its start to its end in rad.
    pub sweep: f64,
}

impl Arc {
    /// Returns the arc of a circle through three points; `None` if they lie on a line.
    #[must_use]
    pub fn through(start: Point, through: Point, end: Point) -> Option<Self> {
        let from = |point: Point| [point[0] - start[0], point[1] - start[1]];
        let ([a, b], [c, d]) = (from(through), from(end));
        let (cross, one, other) = (a * d - b * c, a * a + b * b, c * c + d * d);
        let beyond = (c - a).hypot(d - b);
        if cross.abs() <= RESOLUTION * (one.sqrt() + beyond) * other.sqrt() {
            return None;
        }
        let [x, y] = [
            (d * one - b * other) / (2.0 * cross),
            (a * other - c * one) / (2.0 * cross),
        ];
        // The end lies on the left of the first chord if the arc runs anticlockwise.
        let angle = ((d - y).atan2(c - x) - (-y).atan2(-x)).rem_euclid(TAU);
        let sweep = if cross > 0.0 { angle } else { angle - TAU };
        Some(Self {
            centre: [start[0] + x, start[1] + y],
            axes: [[-x, -y], [y, -x]],
            from: 0.0,
            sweep,
        })
    }

    /// Returns the point at a share of the arc from its start, 0 to 1.
    #[must_use]
    pub fn at(&self, share: f64) -> Point {
        let (sin, cos) = (self.from + share * self.sweep).sin_cos();
        let [one, other] = self.axes;
        [0, 1].map(|axis| self.centre[axis] + cos * one[axis] + sin * other[axis])
    }

    /// Returns a number of lines that stay within the largest distance.
    fn lines(&self) -> f64 {
        let [one, other] = self.axes;
        // Not less than the first semiaxis of the ellipse.
        let radius = one[0].hypot(one[1]).hypot(other[0].hypot(other[1])).max(SAGITTA_MM);
        let angle = 2.0 * (1.0 - (SAGITTA_MM / radius).min(1.0)).acos();
        (self.sweep.abs() / angle)
            .ceil()
            .clamp((self.sweep.abs() / FRAC_PI_2).ceil().max(1.0), MOST_LINES)
    }
}

impl Piece {
    /// Returns its end.
    #[must_use]
    pub fn end(&self) -> Point {
        match self {
            Self::Line(end) | Self::Cubic([_, _, end]) => *end,
            Self::Arc(arc) => arc.at(1.0),
        }
    }

    /// Appends points of the curve after `start`, up to its end.
    fn add_points(&self, start: Point, points: &mut Vec<Point>) {
        match self {
            Self::Line(_) => {}
            Self::Arc(arc) => {
                let count = arc.lines();
                points.extend((1..count as usize).map(|at| arc.at(at as f64 / count)));
            }
            Self::Cubic([one, other, end]) => {
                // The second derivative is at most six times the second differences of the control points.
                let bend = |a: &Point, b: &Point, c: &Point| {
                    let part = |axis: usize| a[axis] - 2.0 * b[axis] + c[axis];
                    part(0).hypot(part(1))
                };
                let largest = 6.0 * bend(&start, one, other).max(bend(one, other, end));
                let count = (largest / (8.0 * SAGITTA_MM)).sqrt().ceil().clamp(1.0, MOST_LINES);
                points.extend((1..count as usize).map(|at| cubic([start, *one, *other, *end], at as f64 / count)));
            }
        }
        points.push(self.end());
    }

    /// Returns the area between the piece and the point (0, 0), positive on its left.
    fn area(&self, start: Point) -> f64 {
        match self {
            Self::Line(end) => cross(start, *end) / 2.0,
            Self::Arc(arc) => {
                let end = arc.at(1.0);
                let along = [end[0] - start[0], end[1] - start[1]];
                (cross(arc.centre, along) + cross(arc.axes[0], arc.axes[1]) * arc.sweep) / 2.0
            }
            Self::Cubic([one, other, end]) => {
                let ([a, b, c, d], w) = ([start, *one, *other, *end], cross);
                (6.0 * w(a, b) + 3.0 * w(a, c) + w(a, d) + 3.0 * (w(b, c) + w(b, d)) + 6.0 * w(c, d)) / 20.0
            }
        }
    }
}

/// Returns the point of a cubic at `t`.
fn cubic(points: [Point; 4], t: f64) -> Point {
    let s = 1.0 - t;
    let weights = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
    [0, 1].map(|axis| (0..4).map(|at| weights[at] * points[at][axis]).sum())
}

fn cross([a, b]: Point, [c, d]: Point) -> f64 {
    a * d - b * c
}

/// A closed curve. A straight line closes it if its end is not its start.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// Where it begins.
    pub start: Point,
    /// Its pieces in order.
    pub pieces: Vec<Piece>,
}

impl Contour {
    /// A polygon with these corners; none without corners.
    #[must_use]
    pub fn polygon(corners: &[Point]) -> Option<Self> {
        let (start, others) = corners.split_first()?;
        Some(Self {
            start: *start,
            pieces: others.iter().copied().map(Piece::Line).collect(),
        })
    }

    /// An ellipse; the first semiaxis has the angle in rad to x.
    #[must_use]
    pub fn ellipse(centre: Point, [one, other]: [f64; 2], angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        let arc = Arc {
            centre,
            axes: [[one * cos, one * sin], [-other * sin, other * cos]],
            from: 0.0,
            sweep: TAU,
        };
        Self {
            start: arc.at(0.0),
            pieces: vec![Piece::Arc(arc)],
        }
    }

    /// A rectangle that is turned about its centre by an angle in rad, with half of its sides and round corners of a
    /// radius.
    #[must_use]
    pub fn rectangle(centre: Point, half: [f64; 2], angle: f64, radius: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        let turn = |[x, y]: Point| [cos * x - sin * y, sin * x + cos * y];
        let place = |at: Point| {
            let [x, y] = turn(at);
            [centre[0] + x, centre[1] + y]
        };
        let inner = half.map(|half| half - radius);
        let quarter = |x: f64, y: f64, from: f64| {
            Piece::Arc(Arc {
                centre: place([x * inner[0], y * inner[1]]),
                axes: [[radius, 0.0], [0.0, radius]].map(turn),
                from,
                sweep: FRAC_PI_2,
            })
        };
        let corners = [(1.0, 1.0, 0.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 2.0), (1.0, -1.0, 3.0)];
        let mut pieces = Vec::new();
        for (at, (x, y, quarters)) in corners.into_iter().enumerate() {
            let before = match at % 2 {
                0 => [x * half[0], y * inner[1]],
                _ => [x * inner[0], y * half[1]],
            };
            pieces.push(Piece::Line(place(before)));
            if radius > 0.0 {
                pieces.push(quarter(x, y, quarters * FRAC_PI_2));
            }
        }
        Self {
            start: place([half[0], -inner[1]]),
            pieces,
        }
    }

    /// Returns the corners of a polygon that is within 1e-6 mm of it.
    #[must_use]
    pub fn corners(&self) -> Vec<Point> {
        let mut points = vec![self.start];
        let mut last = self.start;
        for piece in &self.pieces {
            piece.add_points(last, &mut points);
            last = piece.end();
        }
        if points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        points
    }

    /// Returns the exact area in it, negative if it runs clockwise. Parts that it runs around twice count twice.
    #[must_use]
    pub fn area(&self) -> f64 {
        // Relative to its start, so that a curve far from the origin loses no digits.
        let origin = self.start;
        let [x, y] = origin;
        let back = self.mapped(|[a, b]| [a - x, b - y], |axis| axis);
        let (mut last, mut area) = ([0.0; 2], 0.0);
        for piece in &back.pieces {
            area += piece.area(last);
            last = piece.end();
        }
        area
    }

    /// Returns the curve with all points mapped by an affine map, and directions by its linear part.
    #[must_use]
    pub fn mapped(&self, point: impl Fn(Point) -> Point, direction: impl Fn(Point) -> Point) -> Self {
        let piece = |piece: &Piece| match *piece {
            Piece::Line(end) => Piece::Line(point(end)),
            Piece::Arc(arc) => Piece::Arc(Arc {
                centre: point(arc.centre),
                axes: arc.axes.map(&direction),
                ..arc
            }),
            Piece::Cubic(points) => Piece::Cubic(points.map(&point)),
        };
        Self {
            start: point(self.start),
            pieces: self.pieces.iter().map(piece).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ring_area;
    use std::f64::consts::PI;

    fn arc(start: Point, through: Point, end: Point) -> Piece {
        Piece::Arc(Arc::through(start, through, end).unwrap())
    }

    #[test]
    fn an_arc_runs_through_its_point() {
        let of = |start, through, end| {
            let arc = Arc::through(start, through, end).unwrap();
            let far = |[a, b]: Point, [c, d]: Point| (a - c).hypot(b - d);
            assert!(far(arc.at(0.0), start) < 1e-15 && far(arc.at(1.0), end) < 1e-15);
            (arc.centre, arc.sweep)
        };
        let (centre, sweep) = of([1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]);
        assert!(centre[0].hypot(centre[1]) < 1e-15 && (sweep - PI).abs() < 1e-15);
        let (_, sweep) = of([1.0, 0.0], [0.0, -1.0], [-1.0, 0.0]);
        assert!((sweep + PI).abs() < 1e-15, "clockwise");
        let (_, sweep) = of([1.0, 0.0], [-1.0, 0.0], [0.0, -1.0]);
        assert!((sweep - 3.0 * FRAC_PI_2).abs() < 1e-15, "more than a half turn");
        assert_eq!(Arc::through([0.0, 0.0], [1.0, 1.0], [2.0, 2.0]), None);
        assert_eq!(Arc::through([0.0, 0.0], [1.0, 1.0], [0.0, 0.0]), None);
    }

    #[test]
    fn curves_have_their_exact_areas_and_polygons_nearly() {
        let slot = Contour {
            start: [0.0, -3.0],
            pieces: vec![
                Piece::Line([10.0, -3.0]),
                arc([10.0, -3.0], [13.0, 0.0], [10.0, 3.0]),
                Piece::Line([0.0, 3.0]),
                arc([0.0, 3.0], [-3.0, 0.0], [0.0, -3.0]),
            ],
        };
        // 3/20 of a sum of cross products.
        let arch = Contour {
            start: [0.0, 0.0],
            pieces: vec![Piece::Cubic([[1.0, 2.0], [3.0, 2.0], [4.0, 0.0]])],
        };
        let away = |curve: &Contour| curve.mapped(|[x, y]| [x + 1e6, y - 2e6], |axis| axis);
        let sheared = |curve: &Contour| {
            let map = |[x, y]: Point| [2.0 * x + 0.7 * y, -0.3 * x + 1.5 * y];
            curve.mapped(map, map)
        };
        let sheared_by = 2.0 * 1.5 + 0.7 * 0.3;
        for (curve, exact) in [
            (slot.clone(), 60.0 + 9.0 * PI),
            (arch.clone(), -4.2),
            (Contour::ellipse([3.0, 4.0], [5.0, 2.0], 0.4), 10.0 * PI),
            (Contour::rectangle([3.0, 4.0], [5.0, 2.0], 0.4, 0.0), 40.0),
            (Contour::rectangle([3.0, 4.0], [5.0, 2.0], -2.4, 2.0), 24.0 + 4.0 * PI),
            (Contour::polygon(&[[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]).unwrap(), 6.0),
            (sheared(&slot), sheared_by * (60.0 + 9.0 * PI)),
            (
                sheared(&Contour::ellipse([3.0, 4.0], [5.0, 2.0], 0.4)),
                sheared_by * 10.0 * PI,
            ),
        ] {
            assert!(
                (curve.area() / exact - 1.0).abs() < 1e-14,
                "{curve:?}: {} {exact}",
                curve.area()
            );
            assert!(
                (away(&curve).area() / exact - 1.0).abs() < 1e-8,
                "{curve:?}: {}",
                away(&curve).area()
            );
            let polygon = ring_area(&curve.corners());
            assert!((polygon - exact).abs() < 1e-4, "{curve:?}: {polygon} {exact}");
        }
        let two = Contour {
            start: [0.0, 0.0],
            pieces: vec![Piece::Line([1.0, 0.0]), Piece::Line([0.0, 0.0])],
        };
        assert_eq!(two.corners().len(), 2);
    }
}
