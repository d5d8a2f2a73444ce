//! The area that contours fill.
//!
//! Between two heights at which no polygon has a corner, sides are straight; if they do not cross there, the filled
//! width in the middle times the height is the area. Heights between which sides cross are halved. If none cross, the
//! exact area of each contour counts by what is filled on both its sides.

use super::Point;
use super::edge::{Edge, winding};
use super::piece::Contour;

/// By how much in mm sides may cross where contours touch: the lines that replace them are as far off.
const TOUCHING_MM: f64 = 1e-9;

/// How often a strip is halved.
const MOST_HALVINGS: u32 = 24;

/// The largest number of sides that are looked at, over all strips. Beyond it strips are not halved, and the height of
/// strips is at least 1e-9 mm.
const MOST_WORK: usize = 30_000_000;

/// Whether a point is filled, by how often each of several contours runs around it.
pub(crate) type IsFilled<'a> = &'a dyn Fn(&[i32]) -> bool;

/// Returns the filled area.
pub(crate) fn area(sets: &[Vec<Contour>], is_filled: IsFilled<'_>) -> f64 {
    let polygons = polygons(sets);
    let mut strips = Strips::new(is_filled);
    let by_strips = strips.area(&polygons, [f64::NEG_INFINITY; 2], [f64::INFINITY; 2]);
    if strips.crossed {
        return by_strips;
    }
    // Contours that cross on a common side cross in no strip, but then their areas do not add up.
    let contours = sets.iter().flatten().zip(polygons.iter().flatten());
    let rounding: f64 = contours
        .map(|(contour, corners)| {
            let own = contour.area();
            (own - polygon_area(corners)).abs() + 1e-9 * own.abs()
        })
        .sum();
    let is_close = |exact: &f64| (exact - by_strips).abs() <= rounding;
    by_contours(sets, &polygons, is_filled)
        .filter(is_close)
        .unwrap_or(by_strips)
}

/// Returns the area of a polygon, negative if it runs clockwise.
fn polygon_area(corners: &[Point]) -> f64 {
    // Relative to a corner, so that a polygon far from the origin loses no digits.
    let [x, y] = corners.first().copied().unwrap_or_default();
    let doubled = |edge: Edge| (edge.from[0] - x) * (edge.to[1] - y) - (edge.from[1] - y) * (edge.to[0] - x);
    Edge::around(corners).map(doubled).sum::<f64>() / 2.0
}

/// Returns the filled area within the rectangle from (0, 0) to its size.
pub(crate) fn area_within(sets: &[Vec<Contour>], is_filled: IsFilled<'_>, size: [f64; 2]) -> f64 {
    Strips::new(is_filled).area(&polygons(sets), [0.0; 2], size)
}

fn polygons(sets: &[Vec<Contour>]) -> Vec<Vec<Vec<Point>>> {
    let corners = |set: &Vec<Contour>| set.iter().map(Contour::corners).collect();
    sets.iter().map(corners).collect()
}

/// Returns the area of contours that do not cross; `None` where one lies on another.
fn by_contours(sets: &[Vec<Contour>], polygons: &[Vec<Vec<Point>>], is_filled: IsFilled<'_>) -> Option<f64> {
    let all = || {
        polygons
            .iter()
            .enumerate()
            .flat_map(|(set, all)| (0..all.len()).map(move |at| (set, at)))
    };
    let sides: usize = polygons.iter().flatten().map(Vec::len).sum();
    if all().count().saturating_mul(sides) > MOST_WORK {
        return None;
    }
    let boxes: Vec<Vec<[Point; 2]>> = polygons
        .iter()
        .map(|all| all.iter().map(|one| bounds(one)).collect())
        .collect();
    let mut area = 0.0;
    for (set, at) in all() {
        let own = sets[set][at].area();
        let Some(point) = middle_of_longest(&polygons[set][at]) else {
            continue;
        };
        let mut outside = vec![0; sets.len()];
        for (other_set, other) in all().filter(|other| *other != (set, at)) {
            let [low, high] = boxes[other_set][other];
            if (0..2).all(|axis| (low[axis]..=high[axis]).contains(&point[axis])) {
                outside[other_set] += winding(Edge::around(&polygons[other_set][other]), point)?;
            }
        }
        let mut inside = outside.clone();
        inside[set] += if own > 0.0 { 1 } else { -1 };
        let share = |windings: &[i32]| f64::from(u8::from(is_filled(windings)));
        area += own.abs() * (share(&inside) - share(&outside));
    }
    Some(area)
}

/// Returns the lower left and the upper right corner of the rectangle around points.
fn bounds(points: &[Point]) -> [Point; 2] {
    let empty = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    points.iter().fold(empty, |[low, high], point| {
        [
            [low[0].min(point[0]), low[1].min(point[1])],
            [high[0].max(point[0]), high[1].max(point[1])],
        ]
    })
}

fn middle_of_longest(corners: &[Point]) -> Option<Point> {
    let longest = Edge::around(corners).max_by(|one, other| one.length().total_cmp(&other.length()))?;
    Some([0, 1].map(|axis| f64::midpoint(longest.from[axis], longest.to[axis])))
}

/// Adds the filled area of strips.
struct Strips<'a> {
    is_filled: IsFilled<'a>,
    /// The number of sets of contours.
    sets: usize,
    work: usize,
    /// Whether sides cross.
    crossed: bool,
}

/// A side that rises or falls, with its set of contours.
#[derive(Clone, Copy)]
struct Slope {
    edge: Edge,
    set: usize,
}

impl Slope {
    fn low(&self) -> f64 {
        self.edge.from[1].min(self.edge.to[1])
    }

    fn high(&self) -> f64 {
        self.edge.from[1].max(self.edge.to[1])
    }

    fn x(&self, y: f64) -> f64 {
        let [[a, b], [c, d]] = [self.edge.from, self.edge.to];
        a + (y - b) / (d - b) * (c - a)
    }
}

/// Where a slope is at the bottom, in the middle and at the top of a strip.
struct Side {
    at: [f64; 3],
    slope: Slope,
}

impl<'a> Strips<'a> {
    fn new(is_filled: IsFilled<'a>) -> Self {
        Self {
            is_filled,
            sets: 0,
            work: 0,
            crossed: false,
        }
    }

    /// Returns the filled area within a rectangle.
    fn area(&mut self, polygons: &[Vec<Vec<Point>>], from: Point, to: Point) -> f64 {
        self.sets = polygons.len();
        let sets = polygons.iter().enumerate();
        let edges = sets.flat_map(|(set, all)| {
            all.iter()
                .flat_map(|one| Edge::around(one))
                .map(move |edge| Slope { edge, set })
        });
        let mut slopes: Vec<Slope> = edges.filter(|slope| slope.low() < slope.high()).collect();
        slopes.sort_by(|one, other| one.low().total_cmp(&other.low()));
        let corners = slopes.iter().flat_map(|slope| [slope.low(), slope.high()]);
        // Sides that cross the edges of the rectangle bend there.
        let crossing = slopes.iter().flat_map(|slope| {
            let [[a, b], [c, d]] = [slope.edge.from, slope.edge.to];
            let at = move |x: f64| ((a - x) * (c - x) < 0.0).then(|| b + (x - a) / (c - a) * (d - b));
            [at(from[0]), at(to[0])].into_iter().flatten()
        });
        let mut heights: Vec<f64> = corners.chain(crossing).map(|y| y.clamp(from[1], to[1])).collect();
        heights.sort_by(f64::total_cmp);
        heights.dedup();
        let mut waiting = slopes.into_iter().peekable();
        let mut active: Vec<Slope> = Vec::new();
        let (mut area, mut last) = (0.0, None);
        for height in heights {
            let Some(bottom) = last.replace(height) else {
                continue;
            };
            if self.work > MOST_WORK && height - bottom < TOUCHING_MM {
                last = Some(bottom);
                continue;
            }
            while let Some(slope) = waiting.next_if(|slope| slope.low() <= bottom) {
                active.push(slope);
            }
            active.retain(|slope| slope.high() >= height);
            area += self.strip(&active, [bottom, height], [from[0], to[0]], 0);
        }
        area
    }

    fn strip(&mut self, active: &[Slope], [bottom, top]: [f64; 2], [left, right]: [f64; 2], halvings: u32) -> f64 {
        self.work += active.len();
        let middle = f64::midpoint(bottom, top);
        let side = |slope: &Slope| Side {
            at: [bottom, middle, top].map(|y| slope.x(y).clamp(left, right)),
            slope: *slope,
        };
        let mut sides: Vec<Side> = active.iter().map(side).collect();
        sides.sort_by(|one, other| one.at[1].total_cmp(&other.at[1]));
        let crosses = |pair: &[Side]| {
            [0, 2]
                .iter()
                .any(|end| pair[1].at[*end] < pair[0].at[*end] - TOUCHING_MM)
        };
        // Ends that differ by rounding are no crossing.
        if top - bottom > TOUCHING_MM && sides.windows(2).any(crosses) {
            self.crossed = true;
            if halvings < MOST_HALVINGS && self.work < MOST_WORK {
                return self.strip(active, [bottom, middle], [left, right], halvings + 1)
                    + self.strip(active, [middle, top], [left, right], halvings + 1);
            }
        }
        let (mut windings, mut width) = (vec![0; self.sets], 0.0);
        for pair in sides.windows(2) {
            windings[pair[0].slope.set] += pair[0].slope.edge.turn();
            let step = pair[1].at[1] - pair[0].at[1];
            if step > 0.0 && (self.is_filled)(&windings) {
                width += step;
            }
        }
        width * (top - bottom)
    }
}
