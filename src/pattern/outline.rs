//! The outline of an electrode as closed polygons with holes, for mask makers and drawing programs.
//!
//! Cells that share a side belong to one island. Formats forbid polygons that touch themselves, so cells that touch
//! only at a corner need a rule: cells of one island are joined there, since current reaches both anyway; cells of
//! different islands are separated. So every ring is simple, two rings meet only at corners, and each island has one
//! outer ring.

use super::raster::{Pattern, Raster};

/// A point in units of a cell, the origin at the lower left corner of the membrane.
pub type Point = [f64; 2];

/// Straight pieces per arc of a rounded outline; a power of two keeps coordinates exact.
const PIECES: usize = 4;

/// An island of cells as polygons; the last point of a polygon is joined to the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Island {
    /// The outer ring, anticlockwise.
    pub outer: Vec<Point>,
    /// The rings of its holes, clockwise. A hole may contain other islands.
    pub holes: Vec<Vec<Point>>,
}

impl Island {
    /// Returns the outer ring, and then those of the holes.
    pub fn into_rings(self) -> impl Iterator<Item = Vec<Point>> {
        std::iter::once(self.outer).chain(self.holes)
    }
}

/// How corners are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Corners {
    /// Along the sides of the cells: the area is that of the cells.
    Square,
    /// Rounded: a quadratic B-spline with the midpoints of cell sides as control points (Chaikin 1974), drawn with
    /// straight pieces. Straight edges stay in place and steps of one cell become a straight slope. Corners on the
    /// frame stay, so that a lead keeps its width there. An isolated convex corner loses ⅙ of a cell; a concave corner
    /// gains it. Arcs never meet: islands and holes are those of the square outline.
    Rounded,
}

/// Returns the islands of a pattern, largest outer ring first: an island in a hole comes after the island with the
/// hole.
#[must_use]
pub fn outlines(pattern: &Pattern, corners: Corners) -> Vec<Island> {
    let (labels, count) = islands(pattern);
    let mut found = vec![
        Island {
            outer: Vec::new(),
            holes: Vec::new()
        };
        count
    ];
    for ring in rings(pattern) {
        let [x, y] = ring.cell;
        let island = &mut found[labels[y * pattern.raster().columns() + x]];
        let points = match corners {
            Corners::Square => square(&ring.corners),
            Corners::Rounded => rounded(&ring.corners, pattern.raster()),
        };
        if area(&square(&ring.corners)) > 0.0 {
            island.outer = points;
        } else {
            island.holes.push(points);
        }
    }
    found.sort_by(|a, b| area(&b.outer).total_cmp(&area(&a.outer)));
    found
}

/// Returns the area within a ring, negative for a clockwise ring.
#[must_use]
pub fn area(ring: &[Point]) -> f64 {
    let next = ring.iter().cycle().skip(1);
    0.5 * ring
        .iter()
        .zip(next)
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum::<f64>()
}

/// Returns the area of islands without their holes.
#[must_use]
pub fn total_area(islands: &[Island]) -> f64 {
    let of = |island: &Island| area(&island.outer) + island.holes.iter().map(|hole| area(hole)).sum::<f64>();
    // The sum of an empty list is −0.
    islands.iter().map(of).sum::<f64>() + 0.0
}

/// Returns the island number of each cell (undefined for bare cells) and the number of islands.
fn islands(pattern: &Pattern) -> (Vec<usize>, usize) {
    const NONE: usize = usize::MAX;
    let raster = pattern.raster();
    let mut labels = vec![NONE; raster.cells()];
    let mut count = 0;
    for start in 0..raster.cells() {
        if pattern.cells()[start] == 0 || labels[start] != NONE {
            continue;
        }
        labels[start] = count;
        let mut open = vec![start];
        while let Some(at) = open.pop() {
            for next in neighbours(at, raster) {
                if pattern.cells()[next] != 0 && labels[next] == NONE {
                    labels[next] = count;
                    open.push(next);
                }
            }
        }
        count += 1;
    }
    (labels, count)
}

/// Returns the cells that share a side with a cell.
fn neighbours(at: usize, raster: Raster) -> impl Iterator<Item = usize> {
    let [columns, rows] = raster.sides();
    let (x, y) = (at % columns, at / columns);
    let left = (x > 0).then(|| at - 1);
    let right = (x + 1 < columns).then_some(at + 1);
    let below = (y > 0).then(|| at - columns);
    let above = (y + 1 < rows).then_some(at + columns);
    [left, right, below, above].into_iter().flatten()
}

/// A closed walk along the sides of cells, in steps of one side, with the electrode on its left; it visits each corner
/// once.
struct Ring {
    corners: Vec<[usize; 2]>,
    /// A cell of the island inside.
    cell: [usize; 2],
}

/// A side of a cell, walked from a corner in a direction: 0 right, 1 up, 2 left, 3 down.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Side {
    from: [usize; 2],
    direction: usize,
}

impl Side {
    fn end(self) -> [usize; 2] {
        let [x, y] = self.from;
        match self.direction {
            0 => [x + 1, y],
            1 => [x, y + 1],
            2 => [x - 1, y],
            _ => [x, y - 1],
        }
    }

    /// Returns the cell on the left if it has an electrode and the cell on the right has none.
    fn electrode(self, pattern: &Pattern) -> Option<[usize; 2]> {
        let [x, y] = self.from;
        let (low_left, low_right) = ((x.checked_sub(1), y.checked_sub(1)), (Some(x), y.checked_sub(1)));
        let (up_left, up_right) = ((x.checked_sub(1), Some(y)), (Some(x), Some(y)));
        let (left, right) = match self.direction {
            0 => (up_right, low_right),
            1 => (up_left, up_right),
            2 => (low_left, up_left),
            _ => (low_right, low_left),
        };
        let [columns, rows] = pattern.raster().sides();
        let active = |cell: (Option<usize>, Option<usize>)| match cell {
            (Some(x), Some(y)) if x < columns && y < rows && pattern.is_active(x, y) => Some([x, y]),
            _ => None,
        };
        active(left).filter(|_| active(right).is_none())
    }

    fn number(self, raster: Raster) -> usize {
        corner_index(self.from, raster) * 4 + self.direction
    }
}

/// Returns the index of a corner, row by row.
fn corner_index([x, y]: [usize; 2], raster: Raster) -> usize {
    y * (raster.columns() + 1) + x
}

fn rings(pattern: &Pattern) -> Vec<Ring> {
    let raster = pattern.raster();
    let columns = raster.columns() + 1;
    let mut walked = vec![false; raster.corners() * 4];
    let mut found = Vec::new();
    for number in 0..walked.len() {
        let (corner, direction) = (number / 4, number % 4);
        let start = Side {
            from: [corner % columns, corner / columns],
            direction,
        };
        let Some(cell) = start.electrode(pattern).filter(|_| !walked[number]) else {
            continue;
        };
        let mut corners = Vec::new();
        let mut side = start;
        loop {
            walked[side.number(raster)] = true;
            corners.push(side.from);
            side = following(pattern, side);
            if side == start {
                break;
            }
        }
        found.extend(
            simple(corners, raster)
                .into_iter()
                .map(|corners| Ring { corners, cell }),
        );
    }
    found
}

/// Returns the next side of a walk. Left turns come first: where cells touch at a corner, the walk stays at its own
/// cell.
fn following(pattern: &Pattern, side: Side) -> Side {
    let from = side.end();
    let towards = |turn: usize| Side {
        from,
        direction: (side.direction + turn) % 4,
    };
    [1, 0]
        .map(towards)
        .into_iter()
        .find(|side| side.electrode(pattern).is_some())
        .unwrap_or_else(|| towards(3))
}

/// Cuts a walk where it visits a corner again: a walk is the border of one island, so its cells are joined there.
fn simple(walk: Vec<[usize; 2]>, raster: Raster) -> Vec<Vec<[usize; 2]>> {
    let mut position = vec![None; raster.corners()];
    let mut path: Vec<[usize; 2]> = Vec::new();
    let mut found = Vec::new();
    for corner in walk {
        let at = corner_index(corner, raster);
        if let Some(earlier) = position[at] {
            let piece: Vec<[usize; 2]> = path.drain(earlier..).collect();
            for corner in &piece {
                position[corner_index(*corner, raster)] = None;
            }
            found.push(piece);
        }
        position[at] = Some(path.len());
        path.push(corner);
    }
    found.push(path);
    found
}

/// Returns the corners at which a ring turns.
fn square(ring: &[[usize; 2]]) -> Vec<Point> {
    turning(&ring.iter().map(|c| c.map(|v| v as f64)).collect::<Vec<_>>())
}

/// Removes points that lie on the line through their neighbours, or on a neighbour.
fn turning(ring: &[Point]) -> Vec<Point> {
    let n = ring.len();
    let turns = |i: &usize| {
        let (before, at, after) = (ring[(i + n - 1) % n], ring[*i], ring[(i + 1) % n]);
        let (a, b) = (
            [at[0] - before[0], at[1] - before[1]],
            [after[0] - at[0], after[1] - at[1]],
        );
        a[0] * b[1] - a[1] * b[0] != 0.0
    };
    (0..n).filter(turns).map(|i| ring[i]).collect()
}

/// A control point of a rounded ring.
#[derive(Clone, Copy)]
enum Control {
    /// The curve passes through it, with a corner.
    Corner(Point),
    /// The curve bends towards it.
    Middle(Point),
}

fn rounded(ring: &[[usize; 2]], raster: Raster) -> Vec<Point> {
    let controls = controls(ring, raster);
    let n = controls.len();
    let mut points: Vec<Point> = Vec::with_capacity(n * PIECES);
    for i in 0..n {
        match controls[i] {
            Control::Corner(point) => add(&mut points, point),
            Control::Middle(middle) => {
                let towards = |other: Control| match other {
                    Control::Corner(point) => point,
                    Control::Middle(other) => [0, 1].map(|c| 0.5 * (middle[c] + other[c])),
                };
                let (start, end) = (towards(controls[(i + n - 1) % n]), towards(controls[(i + 1) % n]));
                for piece in 0..=PIECES {
                    let t = piece as f64 / PIECES as f64;
                    let weights = [(1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t), t * t];
                    add(
                        &mut points,
                        [0, 1].map(|c| weights[0] * start[c] + weights[1] * middle[c] + weights[2] * end[c]),
                    );
                }
            }
        }
    }
    if points.len() > 1 && points.first() == points.last() {
        points.pop();
    }
    turning(&points)
}

fn add(points: &mut Vec<Point>, point: Point) {
    if points.last() != Some(&point) {
        points.push(point);
    }
}

/// Returns the control points: corners on the frame, and the midpoints of all sides off the frame.
fn controls(ring: &[[usize; 2]], raster: Raster) -> Vec<Control> {
    let (n, last) = (ring.len(), raster.sides());
    let mut found = Vec::with_capacity(n);
    for i in 0..n {
        let (a, b) = (ring[i], ring[(i + 1) % n]);
        let on_frame = |corner: [usize; 2]| [0, 1].map(|c| corner[c] == 0 || corner[c] == last[c]);
        if on_frame(a) != [false; 2] {
            found.push(Control::Corner(a.map(|v| v as f64)));
        }
        let along = [0, 1]
            .into_iter()
            .any(|c| a[c] == b[c] && (a[c] == 0 || a[c] == last[c]));
        if !along {
            found.push(Control::Middle([0, 1].map(|c| 0.5 * (a[c] + b[c]) as f64)));
        }
    }
    found
}

#[cfg(test)]
mod tests;
