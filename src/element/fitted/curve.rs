//! The border of a region in units of elements: the vertex in column i and row j of a uniform grid is at (i, j).

use deaflow_pattern::Polygons;

/// A point in units of elements.
pub type Point = [f64; 2];

/// Longest piece of a border; longer ones are divided.
const LONGEST: f64 = 1.0;
/// Shortest piece of a border, apart from rounding.
const SHORTEST: f64 = 1e-7;
/// Area in elements up to which a part is small.
const SMALL: f64 = 9.0;
/// The smallest angle in rad by which a border turns at a corner. Flattened arcs turn less.
const CORNER: f64 = 0.09;

/// The border of a region.
pub struct Curve {
    /// Pieces, with the region on the left.
    pieces: Vec<[Point; 2]>,
    /// Directions of the smooth border at both ends of each piece, and the pieces before and after it, if the border
    /// does not turn there.
    directions: Vec<[Point; 2]>,
    beside: Vec<[Option<u32>; 2]>,
    /// Pieces in each row and in each square of the grid: the first index of each, then the pieces.
    rows: Bins,
    squares: Bins,
    /// Number of columns and rows of squares, one more on each side than there are elements.
    sides: [usize; 2],
    corners: Vec<Point>,
    area: f64,
    small_parts: Vec<Part>,
}

/// A part of a region that is a few elements large, or a hole in it.
pub struct Part {
    /// Its first corner.
    pub corner: Point,
    /// The polygon around it.
    pub outline: Polygons,
    /// Its area; that of a hole is negative.
    pub area: f64,
}

/// Numbers of pieces in bins.
struct Bins {
    starts: Vec<usize>,
    pieces: Vec<u32>,
}

impl Bins {
    fn new(count: usize, pieces: &[[Point; 2]], bins: impl Fn(&[Point; 2]) -> Vec<usize>) -> Self {
        let mut starts = vec![0; count + 1];
        for piece in pieces {
            bins(piece).into_iter().for_each(|bin| starts[bin + 1] += 1);
        }
        for at in 0..count {
            starts[at + 1] += starts[at];
        }
        let mut next = starts.clone();
        let mut numbers = vec![0; starts[count]];
        for (number, piece) in pieces.iter().enumerate() {
            for bin in bins(piece) {
                numbers[next[bin]] = number as u32;
                next[bin] += 1;
            }
        }
        Self {
            starts,
            pieces: numbers,
        }
    }

    fn of(&self, bin: usize) -> &[u32] {
        &self.pieces[self.starts[bin]..self.starts[bin + 1]]
    }
}

impl Curve {
    /// Converts a region in mm with elements of the given sides in mm.
    #[must_use]
    pub fn new(region: &Polygons, size_mm: [f64; 2], elements: [usize; 2]) -> Self {
        let (mut pieces, mut corners) = (Vec::new(), Vec::new());
        let (mut directions, mut beside) = (Vec::new(), Vec::new());
        let (mut area, mut small_parts) = (0.0, Vec::new());
        for ring in region.rings() {
            let points = ring.iter().map(|point| [0, 1].map(|axis| point[axis] / size_mm[axis]));
            let points = without_short(points.collect());
            let count = points.len();
            if count < 3 {
                continue;
            }
            let first_of_ring = pieces.len();
            let area_before = area;
            let is_corner =
                |at: usize| turn(points[(at + count - 1) % count], points[at], points[(at + 1) % count]).abs() > CORNER;
            let chord = |at: usize| direction(points[at % count], points[(at + 1) % count]);
            let smooth = |at: usize| {
                let (before, after) = (chord(at + count - 1), chord(at));
                direction([0.0; 2], [before[0] + after[0], before[1] + after[1]])
            };
            for (at, &point) in points.iter().enumerate() {
                let after = points[(at + 1) % count];
                if is_corner(at) {
                    corners.push(point);
                }
                area += 0.5 * (point[0] * after[1] - point[1] * after[0]);
                let span = distance(point, after);
                let parts = (span / LONGEST).ceil().max(1.0);
                let along = |part: f64| [0, 1].map(|axis| point[axis] + part / parts * (after[axis] - point[axis]));
                let parts = parts as usize;
                for part in 0..parts {
                    let number = pieces.len() as u32;
                    pieces.push([along(part as f64), along(part as f64 + 1.0)]);
                    let starts = [at, (at + 1) % count];
                    let is_end = [part == 0, part + 1 == parts];
                    let turns = [0, 1].map(|end| is_end[end] && is_corner(starts[end]));
                    let smooth = [0, 1].map(|end| match is_end[end] && !turns[end] {
                        true => smooth(starts[end]),
                        false => chord(at),
                    });
                    directions.push(smooth);
                    beside.push([
                        (!turns[0]).then(|| number.wrapping_sub(1)),
                        (!turns[1]).then(|| number + 1),
                    ]);
                }
            }
            // The first and the last piece of a ring are beside each other.
            let last = pieces.len() - 1;
            beside[first_of_ring][0] = beside[first_of_ring][0].map(|_| last as u32);
            beside[last][1] = beside[last][1].map(|_| first_of_ring as u32);
            let own = area - area_before;
            if own.abs() <= SMALL {
                small_parts.push(Part {
                    corner: points[0],
                    outline: Polygons::of_rings(vec![points]),
                    area: own,
                });
            }
        }
        let sides = elements.map(|count| count + 2);
        let range = |[a, b]: &[Point; 2], axis: usize| {
            // Pieces beyond the grid are in the squares around it.
            let bin = |at: f64| (at.floor() + 1.0).clamp(0.0, sides[axis] as f64 - 1.0) as usize;
            bin(a[axis].min(b[axis]))..=bin(a[axis].max(b[axis]))
        };
        let rows = Bins::new(sides[1], &pieces, |piece| range(piece, 1).collect());
        let squares = Bins::new(sides[0] * sides[1], &pieces, |piece| {
            let columns = range(piece, 0);
            let row = |row: usize| columns.clone().map(move |column| row * sides[0] + column);
            range(piece, 1).flat_map(row).collect()
        });
        Self {
            pieces,
            directions,
            beside,
            rows,
            squares,
            sides,
            corners,
            area,
            // The area of one with another in it is not its own.
            small_parts: without_nested(small_parts),
        }
    }

    /// Returns the parts that are a few elements large, and the holes that are, without those that contain another.
    pub fn small_parts(&self) -> &[Part] {
        &self.small_parts
    }

    /// Returns the points at which the border turns.
    #[must_use]
    pub fn corners(&self) -> &[Point] {
        &self.corners
    }

    /// Returns the area of the region.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Returns whether a point is in the region.
    #[must_use]
    pub fn contains(&self, [x, y]: Point) -> bool {
        let row = (y.floor() + 1.0).clamp(0.0, self.sides[1] as f64 - 1.0) as usize;
        let mut inside = false;
        for &piece in self.rows.of(row) {
            let [[a, b], [c, d]] = self.pieces[piece as usize];
            if (b > y) != (d > y) && x < a + (y - b) / (d - b) * (c - a) {
                inside = !inside;
            }
        }
        inside
    }

    /// Returns the closest point of the border and its distance, if that is at most 1.
    #[must_use]
    pub fn closest(&self, point: Point) -> Option<(Point, f64)> {
        let range = |axis: usize| {
            let at = point[axis].floor() + 1.0;
            let bin = |at: f64| at.clamp(0.0, self.sides[axis] as f64 - 1.0) as usize;
            bin(at - 1.0)..=bin(at + 1.0)
        };
        let mut best: Option<(u32, f64)> = None;
        for row in range(1) {
            for column in range(0) {
                for &number in self.squares.of(row * self.sides[0] + column) {
                    let [a, b] = self.pieces[number as usize];
                    let along = [b[0] - a[0], b[1] - a[1]];
                    let from = [point[0] - a[0], point[1] - a[1]];
                    let square = along[0] * along[0] + along[1] * along[1];
                    let share = ((along[0] * from[0] + along[1] * from[1]) / square).clamp(0.0, 1.0);
                    let at = [a[0] + share * along[0], a[1] + share * along[1]];
                    let found = distance(at, point);
                    if best.is_none_or(|(_, least)| found < least) {
                        best = Some((number, found));
                    }
                }
            }
        }
        let (piece, _) = best.filter(|(_, distance)| *distance <= 1.0)?;
        let closest = self.foot(point, piece);
        Some((closest, distance(closest, point)))
    }

    /// Returns the foot of a point on the smooth border near a piece. Its direction changes linearly along a piece, so
    /// that the foot does not jump between those of straight pieces.
    fn foot(&self, point: Point, mut number: u32) -> Point {
        /// Number of pieces to look at.
        const MOST: usize = 8;
        let mut last = None;
        for _ in 0..MOST {
            let ([a, b], [from, to]) = (self.pieces[number as usize], self.directions[number as usize]);
            // How far the point is ahead of a place of the piece.
            let ahead = |share: f64| {
                let at = [0, 1].map(|axis| point[axis] - a[axis] - share * (b[axis] - a[axis]));
                let direction = [0, 1].map(|axis| (1.0 - share) * from[axis] + share * to[axis]);
                at[0] * direction[0] + at[1] * direction[1]
            };
            let (start, end) = (ahead(0.0), ahead(1.0));
            let beside = self.beside[number as usize];
            let next = match (start < 0.0, end > 0.0) {
                (true, _) => beside[0],
                (false, true) => beside[1],
                (false, false) => None,
            };
            match next {
                Some(next) if last != Some(next) => {
                    last = Some(number);
                    number = next;
                }
                _ => {
                    let (mut low, mut high) = (0.0, 1.0);
                    if start <= 0.0 {
                        high = 0.0;
                    } else if end >= 0.0 {
                        low = 1.0;
                    }
                    // The change is nearly linear: regula falsi converges at once.
                    for _ in 0..4 {
                        if high > low {
                            let (at_low, at_high) = (ahead(low), ahead(high));
                            let share = low + (high - low) * at_low / (at_low - at_high);
                            if ahead(share) > 0.0 { low = share } else { high = share }
                        }
                    }
                    let share = if high > low && ahead(high).abs() < ahead(low).abs() {
                        high
                    } else {
                        low
                    };
                    let share = if high == 0.0 { 0.0 } else { share };
                    return [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]));
                }
            }
        }
        self.pieces[number as usize][0]
    }

    /// Returns the point where the border crosses a straight line between two points, the nearest to the first.
    #[must_use]
    pub fn crossing(&self, from: Point, to: Point) -> Option<Point> {
        let along = [to[0] - from[0], to[1] - from[1]];
        let mut best: Option<f64> = None;
        let range = |axis: usize| {
            let bin = |at: f64| (at.floor() + 1.0).clamp(0.0, self.sides[axis] as f64 - 1.0) as usize;
            bin(from[axis].min(to[axis]))..=bin(from[axis].max(to[axis]))
        };
        for row in range(1) {
            for column in range(0) {
                for &piece in self.squares.of(row * self.sides[0] + column) {
                    let [a, b] = self.pieces[piece as usize];
                    let piece = [b[0] - a[0], b[1] - a[1]];
                    let cross = along[0] * piece[1] - along[1] * piece[0];
                    if cross == 0.0 {
                        continue;
                    }
                    let offset = [a[0] - from[0], a[1] - from[1]];
                    let share = (offset[0] * piece[1] - offset[1] * piece[0]) / cross;
                    let on_piece = (offset[0] * along[1] - offset[1] * along[0]) / cross;
                    let is_crossing = (0.0..=1.0).contains(&share) && (-1e-12..=1.0 + 1e-12).contains(&on_piece);
                    if is_crossing && best.is_none_or(|least| share < least) {
                        best = Some(share);
                    }
                }
            }
        }
        best.map(|share| [from[0] + share * along[0], from[1] + share * along[1]])
    }
}

/// Returns the parts that contain no other.
fn without_nested(parts: Vec<Part>) -> Vec<Part> {
    let is_nested = |outer: &Part| {
        let mut others = parts.iter().filter(|other| other.area.signum() != outer.area.signum());
        others.any(|other| outer.outline.contains(other.corner))
    };
    let nested: Vec<bool> = parts.iter().map(is_nested).collect();
    let pairs = parts.into_iter().zip(nested);
    pairs.filter_map(|(part, nested)| (!nested).then_some(part)).collect()
}

/// Returns a closed polygon without pieces that are only due to rounding.
fn without_short(points: Vec<Point>) -> Vec<Point> {
    let mut kept: Vec<Point> = Vec::with_capacity(points.len());
    for point in points {
        if kept.last().is_none_or(|last| distance(*last, point) > SHORTEST) {
            kept.push(point);
        }
    }
    while kept.len() > 1 && distance(kept[0], kept[kept.len() - 1]) <= SHORTEST {
        kept.pop();
    }
    kept
}

/// Returns the direction from a point to another.
fn direction(from: Point, to: Point) -> Point {
    let length = distance(from, to).max(f64::MIN_POSITIVE);
    [0, 1].map(|axis| (to[axis] - from[axis]) / length)
}

/// Returns the angle by which the path turns at its second point.
fn turn(before: Point, at: Point, after: Point) -> f64 {
    let (a, b) = (
        [at[0] - before[0], at[1] - before[1]],
        [after[0] - at[0], after[1] - at[1]],
    );
    (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1])
}

/// Returns the distance of two points.
#[must_use]
pub fn distance(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
