//! B-splines as cubics.

use crate::contour::{Piece, Point};

/// Cubics that replace the span between two knots of a spline that is rational or of a degree above 3. Their distance
/// is about 1e-9 of the size of a span that turns by a right angle.
const CUBICS: usize = 64;

/// The largest degree.
const MOST_DEGREE: usize = 15;

/// A B-spline.
pub struct Spline {
    pub degree: usize,
    pub knots: Vec<f64>,
    pub points: Vec<Point>,
    /// The weights of the points; none if all are equal.
    pub weights: Vec<f64>,
}

impl Spline {
    /// Returns what is wrong with it.
    pub fn fault(&self) -> Option<String> {
        let (degree, points) = (self.degree, self.points.len());
        if !(1..=MOST_DEGREE).contains(&degree) {
            return Some(format!("its degree is {degree}; allowed: 1 to {MOST_DEGREE}"));
        }
        if points <= degree {
            return Some(format!(
                "it has {points} control points, but needs {} or more",
                degree + 1
            ));
        }
        if self.knots.len() != points + degree + 1 {
            let needs = points + degree + 1;
            return Some(format!("it has {} knots, but needs {needs}", self.knots.len()));
        }
        if self.knots.windows(2).any(|pair| pair[0] > pair[1]) {
            return Some("its knots are not in ascending order".to_owned());
        }
        if !self.weights.is_empty() && self.weights.len() != points {
            return Some(format!(
                "it has {} weights for {points} control points",
                self.weights.len()
            ));
        }
        let positive = self.weights.iter().all(|weight| (1e-6..=1e6).contains(weight));
        (!positive).then(|| "a weight is outside 1e-6 to 1e6".to_owned())
    }

    /// Returns its start, and cubics up to its end. Without a fault, each span has them.
    pub fn pieces(&self) -> Option<(Point, Vec<Piece>)> {
        let (degree, last) = (self.degree, self.points.len());
        let is_polynomial = self.weights.windows(2).all(|pair| pair[0] == pair[1]);
        let count = if is_polynomial && degree <= 3 { 1 } else { CUBICS };
        let (mut start, mut pieces) = (None, Vec::new());
        for span in (degree..last).filter(|span| self.knots[*span] < self.knots[span + 1]) {
            let (from, to) = (self.knots[span], self.knots[span + 1]);
            let third = (to - from) / count as f64 / 3.0;
            let at = |step: usize| self.at(span, from + (to - from) * step as f64 / count as f64);
            let (mut here, mut slope) = at(0);
            start.get_or_insert(here);
            for step in 1..=count {
                let (next, next_slope) = at(step);
                pieces.push(Piece::Cubic([
                    [0, 1].map(|axis| here[axis] + third * slope[axis]),
                    [0, 1].map(|axis| next[axis] - third * next_slope[axis]),
                    next,
                ]));
                (here, slope) = (next, next_slope);
            }
        }
        start.map(|start| (start, pieces))
    }

    /// Returns point and derivative at a parameter by the polynomials of a span.
    fn at(&self, span: usize, parameter: f64) -> (Point, Point) {
        let first = span - self.degree;
        let weighted: Vec<[f64; 3]> = (first..=span)
            .map(|at| {
                let (point, weight) = (self.points[at], self.weights.get(at).copied().unwrap_or(1.0));
                [point[0] * weight, point[1] * weight, weight]
            })
            .collect();
        let differences: Vec<[f64; 3]> = (1..weighted.len())
            .map(|at| {
                let width = self.knots[first + at + self.degree] - self.knots[first + at];
                [0, 1, 2].map(|axis| self.degree as f64 * (weighted[at][axis] - weighted[at - 1][axis]) / width)
            })
            .collect();
        let [x, y, weight] = self.blended(weighted, span, self.degree, parameter);
        let [along, up, grows] = self.blended(differences, span, self.degree - 1, parameter);
        let point = [x / weight, y / weight];
        let slope = [(along - grows * point[0]) / weight, (up - grows * point[1]) / weight];
        (point, slope)
    }

    /// Returns the value of a spline of some degree by de Boor's algorithm, from its points that act on a span.
    fn blended(&self, mut points: Vec<[f64; 3]>, span: usize, degree: usize, parameter: f64) -> [f64; 3] {
        for level in 1..=degree {
            for at in (level..=degree).rev() {
                let knot = span - degree + at;
                let (low, high) = (self.knots[knot], self.knots[knot + degree + 1 - level]);
                let share = (parameter - low) / (high - low);
                points[at] = [0, 1, 2].map(|axis| points[at - 1][axis] * (1.0 - share) + points[at][axis] * share);
            }
        }
        points.get(degree).copied().unwrap_or([0.0, 0.0, 1.0])
    }
}
