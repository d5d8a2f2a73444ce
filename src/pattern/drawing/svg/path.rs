//! The data of paths in SVG.

use std::f64::consts::{PI, TAU};

use svgtypes::{PathParser, PathSegment};

use crate::contour::{Arc, Contour, Piece, Point};

/// Reads path data; `None` if it is damaged. Open subpaths are closed, as they are filled.
///
/// Source: W3C, Scalable Vector Graphics 1.1, section 8.3; arcs by appendix F.6.
pub fn contours(data: &str) -> Option<Vec<Contour>> {
    let mut path = Path::default();
    for segment in PathParser::from(data) {
        path.add(segment.ok()?);
    }
    path.finish();
    Some(path.contours)
}

#[derive(Default)]
struct Path {
    contours: Vec<Contour>,
    start: Point,
    at: Point,
    pieces: Vec<Piece>,
    /// The last control points of a cubic and of a quadratic curve, if the last segment was one.
    controls: [Option<Point>; 2],
}

impl Path {
    fn place(&self, is_absolute: bool, x: f64, y: f64) -> Point {
        match is_absolute {
            true => [x, y],
            false => [self.at[0] + x, self.at[1] + y],
        }
    }

    /// Returns the mirror image of a control point at the current point.
    fn mirrored(&self, control: Option<Point>) -> Point {
        control.map_or(self.at, |control| {
            [0, 1].map(|axis| 2.0 * self.at[axis] - control[axis])
        })
    }

    fn finish(&mut self) {
        let pieces = std::mem::take(&mut self.pieces);
        if !pieces.is_empty() {
            let start = self.start;
            self.contours.push(Contour { start, pieces });
        }
    }

    fn push(&mut self, piece: Piece, end: Point) {
        self.pieces.push(piece);
        self.at = end;
    }

    fn quadratic(&mut self, control: Point, end: Point) {
        let between = |one: Point| [0, 1].map(|axis| one[axis] + 2.0 / 3.0 * (control[axis] - one[axis]));
        self.push(Piece::Cubic([between(self.at), between(end), end]), end);
    }

    fn add(&mut self, segment: PathSegment) {
        let controls = std::mem::take(&mut self.controls);
        match segment {
            PathSegment::MoveTo { abs, x, y } => {
                self.finish();
                self.at = self.place(abs, x, y);
                self.start = self.at;
            }
            PathSegment::LineTo { abs, x, y } => {
                let end = self.place(abs, x, y);
                self.push(Piece::Line(end), end);
            }
            PathSegment::HorizontalLineTo { abs, x } => {
                let end = [if abs { x } else { self.at[0] + x }, self.at[1]];
                self.push(Piece::Line(end), end);
            }
            PathSegment::VerticalLineTo { abs, y } => {
                let end = [self.at[0], if abs { y } else { self.at[1] + y }];
                self.push(Piece::Line(end), end);
            }
            PathSegment::CurveTo {
                abs,
                x1,
                y1,
                x2,
                y2,
                x,
                y,
            } => {
                let [one, other, end] = [[x1, y1], [x2, y2], [x, y]].map(|[x, y]| self.place(abs, x, y));
                self.push(Piece::Cubic([one, other, end]), end);
                self.controls[0] = Some(other);
            }
            PathSegment::SmoothCurveTo { abs, x2, y2, x, y } => {
                let (one, [other, end]) = (
                    self.mirrored(controls[0]),
                    [[x2, y2], [x, y]].map(|[x, y]| self.place(abs, x, y)),
                );
                self.push(Piece::Cubic([one, other, end]), end);
                self.controls[0] = Some(other);
            }
            PathSegment::Quadratic { abs, x1, y1, x, y } => {
                let [control, end] = [[x1, y1], [x, y]].map(|[x, y]| self.place(abs, x, y));
                self.quadratic(control, end);
                self.controls[1] = Some(control);
            }
            PathSegment::SmoothQuadratic { abs, x, y } => {
                let (control, end) = (self.mirrored(controls[1]), self.place(abs, x, y));
                self.quadratic(control, end);
                self.controls[1] = Some(control);
            }
            PathSegment::EllipticalArc {
                abs,
                rx,
                ry,
                x_axis_rotation,
                large_arc,
                sweep,
                x,
                y,
            } => {
                let end = self.place(abs, x, y);
                let piece = arc(self.at, [rx, ry], x_axis_rotation, large_arc, sweep, end);
                self.push(piece.map_or(Piece::Line(end), Piece::Arc), end);
            }
            PathSegment::ClosePath { .. } => {
                self.finish();
                self.at = self.start;
            }
        }
    }
}

/// Returns an arc from its ends; `None` if it is a line.
fn arc(start: Point, radii: [f64; 2], degrees: f64, is_large: bool, is_positive: bool, end: Point) -> Option<Arc> {
    let [mut rx, mut ry] = radii.map(f64::abs);
    if rx == 0.0 || ry == 0.0 || start == end {
        return None;
    }
    let (sin, cos) = degrees.to_radians().sin_cos();
    let half = [(start[0] - end[0]) / 2.0, (start[1] - end[1]) / 2.0];
    let [x, y] = [cos * half[0] + sin * half[1], cos * half[1] - sin * half[0]];
    // Radii that are too small grow.
    let reach = (x / rx).hypot(y / ry);
    if reach > 1.0 {
        (rx, ry) = (rx * reach, ry * reach);
    }
    let inside = ((x / rx).powi(2) + (y / ry).powi(2)).clamp(f64::MIN_POSITIVE, 1.0);
    let sign = if is_large == is_positive { -1.0 } else { 1.0 };
    let factor = sign * ((1.0 - inside) / inside).sqrt();
    let [cx, cy] = [factor * rx * y / ry, -factor * ry * x / rx];
    let angle = |x: f64, y: f64| (y / ry).atan2(x / rx);
    let from = angle(x - cx, y - cy);
    let turn = (angle(-x - cx, -y - cy) - from).rem_euclid(TAU);
    let sweep = match (is_positive, turn) {
        (true, _) => turn,
        (false, 0.0) => 0.0,
        (false, turn) => turn - TAU,
    };
    // A half circle whose angle was rounded to none.
    let sweep = if sweep.abs() < 1e-9 && reach >= 1.0 {
        PI.copysign(if is_positive { 1.0 } else { -1.0 })
    } else {
        sweep
    };
    Some(Arc {
        centre: [
            cos * cx - sin * cy + f64::midpoint(start[0], end[0]),
            sin * cx + cos * cy + f64::midpoint(start[1], end[1]),
        ],
        axes: [[rx * cos, rx * sin], [-ry * sin, ry * cos]],
        from,
        sweep,
    })
}
