//! A cubic Bézier curve inside a rectangle: self-intersection, the cells on its left, and distances from it.
//!
//! A curve from frame to frame that stays inside and does not cross itself divides the rectangle into exactly two
//! regions.

use super::canvas::Canvas;

/// A point from the lower left corner.
pub(super) type Point = [f64; 2];

/// Segments that approximate a curve; their distance from it is far below a cell.
const SEGMENTS: usize = 128;

/// The four control points of a cubic Bézier curve, and its canvas.
#[derive(Clone, Debug)]
pub(super) struct Cubic(pub(super) [Point; 4], pub(super) Canvas);

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn minus(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1]]
}

/// Returns the point of the frame at a position from 0 to 4 sides, counterclockwise from the lower left corner.
pub(super) fn on_frame(canvas: &Canvas, position: f64) -> Point {
    let ([width, height], along) = (canvas.size(), position.fract());
    match position as u32 {
        0 => [width * along, 0.0],
        1 => [width, height * along],
        2 => [width - width * along, height],
        _ => [0.0, height - height * along],
    }
}

impl Cubic {
    /// Returns the point at parameter `t`.
    pub(super) fn at(&self, t: f64) -> Point {
        let s = 1.0 - t;
        let weights = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
        std::array::from_fn(|k| self.0.iter().zip(weights).map(|(p, w)| w * p[k]).sum())
    }

    /// Returns whether the curve meets itself at two parameters within [0, 1].
    ///
    /// With B(t) = a t³ + b t² + c t + P0, B(t₁) = B(t₂) for t₁ ≠ t₂ reads a (σ² − π) + b σ + c = 0, where σ = t₁ + t₂
    /// and π = t₁ t₂. The cross product with a gives σ, the scalar product then π; t₁ and t₂ solve t² − σ t + π = 0.
    pub(super) fn crosses_itself(&self) -> bool {
        let [p0, p1, p2, p3] = self.0;
        let a: Point = std::array::from_fn(|k| p3[k] - 3.0 * p2[k] + 3.0 * p1[k] - p0[k]);
        let b: Point = std::array::from_fn(|k| 3.0 * (p2[k] - 2.0 * p1[k] + p0[k]));
        let c: Point = std::array::from_fn(|k| 3.0 * (p1[k] - p0[k]));
        let denominator = cross(b, a);
        if denominator == 0.0 {
            // A parabola, which does not cross itself, or points on one line, where the curve may reverse.
            return cross(c, a) == 0.0 && cross(b, c) == 0.0 && self.folds();
        }
        let sum = -cross(c, a) / denominator;
        let product = sum * sum + (dot(b, a) * sum + dot(c, a)) / dot(a, a);
        let discriminant = sum * sum - 4.0 * product;
        if discriminant <= 0.0 {
            return false;
        }
        let root = discriminant.sqrt();
        (sum - root) / 2.0 >= 0.0 && (sum + root) / 2.0 <= 1.0
    }

    /// Returns whether a curve along a line ever moves against its chord.
    fn folds(&self) -> bool {
        let chord = minus(self.0[3], self.0[0]);
        self.points().windows(2).any(|s| dot(minus(s[1], s[0]), chord) <= 0.0)
    }

    /// Returns points along the curve, both ends included.
    fn points(&self) -> Vec<Point> {
        (0..=SEGMENTS).map(|i| self.at(i as f64 / SEGMENTS as f64)).collect()
    }

    /// Returns whether all points between the ends lie strictly inside the rectangle.
    pub(super) fn stays_inside(&self) -> bool {
        let [width, height] = self.1.size();
        let inside = |[x, y]: &Point| *x > 0.0 && *x < width && *y > 0.0 && *y < height;
        self.points()[1..SEGMENTS].iter().all(inside)
    }

    /// Returns for each cell whether its centre lies on the left of a curve from frame to frame, `[y][x]`.
    pub(super) fn left_side(&self) -> Vec<bool> {
        let outline = self.closed_along_frame();
        let raster = self.1.raster();
        let mut inside = vec![false; raster.cells()];
        for (row, cells) in inside.chunks_exact_mut(raster.columns()).enumerate() {
            let [_, y] = self.1.centre(0, row);
            for (start, end) in outline.iter().zip(outline.iter().cycle().skip(1)) {
                // Half-open in y, so that a corner on the line counts once.
                if (start[1] <= y) != (end[1] <= y) {
                    let x = start[0] + (y - start[1]) / (end[1] - start[1]) * (end[0] - start[0]);
                    for (column, cell) in cells.iter_mut().enumerate() {
                        *cell ^= self.1.centre(column, row)[0] > x;
                    }
                }
            }
        }
        inside
    }

    /// Returns the outline of the region on the left: the curve, then the frame counterclockwise back to its start.
    fn closed_along_frame(&self) -> Vec<Point> {
        let mut outline = self.points();
        let [start, end] = [self.0[0], self.0[3]].map(|point| frame_position(&self.1, point));
        let length = (start - end).rem_euclid(4.0);
        let mut corner = end.floor() + 1.0;
        while corner - end < length {
            outline.push(on_frame(&self.1, corner.rem_euclid(4.0)));
            corner += 1.0;
        }
        outline
    }

    /// Returns the distance of the centre of each cell from the curve, `[y][x]`.
    pub(super) fn distances(&self) -> Vec<f64> {
        let points = self.points();
        let segments: Vec<(Point, Point, f64)> = points
            .windows(2)
            .map(|s| {
                let along = minus(s[1], s[0]);
                (s[0], along, 1.0 / dot(along, along).max(f64::MIN_POSITIVE))
            })
            .collect();
        let distance = |centre: Point| {
            let nearest = segments.iter().map(|&(start, along, inverse)| {
                let from = minus(centre, start);
                let t = (dot(from, along) * inverse).clamp(0.0, 1.0);
                let off = [from[0] - t * along[0], from[1] - t * along[1]];
                dot(off, off)
            });
            nearest.fold(f64::INFINITY, f64::min).sqrt()
        };
        self.1.centres().map(distance).collect()
    }
}

/// The inverse of [`on_frame`].
fn frame_position(canvas: &Canvas, [x, y]: Point) -> f64 {
    let [width, height] = canvas.size();
    if y == 0.0 && x < width {
        x / width
    } else if x == width && y < height {
        1.0 + y / height
    } else if y == height && x > 0.0 {
        3.0 - x / width
    } else {
        4.0 - y / height
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::Stream;
    use deaflow_pattern::CELLS;

    /// Whether two of the chain's segments that are not neighbours cross, by the signs of four triangles.
    fn chain_crosses(curve: &Cubic) -> bool {
        let points: Vec<Point> = (0..=400).map(|i| curve.at(f64::from(i) / 400.0)).collect();
        let turn = |p: Point, q: Point, r: Point| cross(minus(q, p), minus(r, p));
        (0..400).any(|i| {
            (i + 2..400).any(|j| {
                let [p, q, r, s] = [points[i], points[i + 1], points[j], points[j + 1]];
                turn(p, q, r) * turn(p, q, s) < 0.0 && turn(r, s, p) * turn(r, s, q) < 0.0
            })
        })
    }

    #[test]
    fn the_algebraic_test_finds_the_crossings_that_a_fine_chain_has() {
        let mut stream = Stream::new(1, "test", 0);
        let mut crossing = 0;
        for _ in 0..300 {
            let points = std::array::from_fn(|_| [stream.range(0.0, 50.0), stream.range(0.0, 50.0)]);
            let curve = Cubic(points, Canvas::PAPER);
            assert_eq!(curve.crosses_itself(), chain_crosses(&curve), "{curve:?}");
            crossing += u32::from(curve.crosses_itself());
        }
        assert!(crossing > 10, "only {crossing} of 300 random curves cross themselves");
    }

    #[test]
    fn a_curve_that_bulges_over_the_frame_does_not_stay_inside() {
        let bulging = |height: f64| {
            Cubic(
                [[0.0, 25.0], [10.0, height], [40.0, height], [50.0, 25.0]],
                Canvas::PAPER,
            )
        };
        // The top of the curve is at (25 + 3 height) / 4.
        assert!(bulging(58.0).stays_inside() && bulging(-8.0).stays_inside());
        assert!(!bulging(59.0).stays_inside() && !bulging(-9.0).stays_inside());
    }

    #[test]
    fn frame_positions_go_around_once() {
        for i in 0..400 {
            let position = f64::from(i) / 100.0;
            assert!(
                (frame_position(&Canvas::PAPER, on_frame(&Canvas::PAPER, position)) - position).abs() < 1e-12,
                "{position}"
            );
        }
    }

    #[test]
    fn the_left_of_an_upward_line_is_the_left_half() {
        let line = |x: f64| Cubic([[x, 0.0], [x, 20.0], [x, 30.0], [x, 50.0]], Canvas::PAPER);
        let left = line(20.0).left_side();
        assert!((0..CELLS * CELLS).all(|i| left[i] == (i % CELLS < 20)));
        let distances = line(20.0).distances();
        assert!((distances[7] - 12.5).abs() < 1e-12 && (distances[2499] - 29.5).abs() < 1e-12);
    }

    #[test]
    fn both_sides_of_a_curve_make_up_the_membrane() {
        let mut stream = Stream::new(2, "test", 0);
        for _ in 0..50 {
            let (start, end) = (
                on_frame(&Canvas::PAPER, stream.range(0.0, 4.0)),
                on_frame(&Canvas::PAPER, stream.range(0.0, 4.0)),
            );
            let inner = [[stream.range(5.0, 45.0), 20.0], [30.0, stream.range(5.0, 45.0)]];
            let forth = Cubic([start, inner[0], inner[1], end], Canvas::PAPER);
            let back = Cubic([end, inner[1], inner[0], start], Canvas::PAPER);
            if forth.crosses_itself() || !forth.stays_inside() {
                continue;
            }
            let (left, right) = (forth.left_side(), back.left_side());
            assert!(left.iter().zip(&right).all(|(l, r)| l != r));
        }
    }
}
