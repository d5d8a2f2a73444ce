//! Moves the vertices of a grid onto borders, and splits the cells that borders cut.
//!
//! First each corner of a border takes its nearest free vertex. Then, while an edge of the grid has its ends on
//! different sides of a border, the end nearest to the border moves to the closest point on it. A cell with both sides
//! then has them at opposite vertices, and is split along the diagonal between the other two, which are on the border.
//! The numbers of vertices and their neighbours stay.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeSet, BinaryHeap};

use super::curve::{Curve, Part, Point, distance};

/// Distance from a border below which a point is on it.
const ON: f64 = 1e-6;
/// Largest distance of a corner from its vertex.
const FARTHEST: f64 = 0.75;
/// Distance from a corner within which vertices move along the grid, so that they do not crowd there.
const AT_CORNER: f64 = 0.35;
/// Distance from a border from which the side of a triangle with all its vertices on the border counts.
const CLEAR: f64 = 0.02;
/// Cosine of the largest angle of a quadrilateral.
const WIDEST: f64 = -0.866;
/// Largest difference of the area of a region on the mesh, in elements.
const LARGEST_LOSS: f64 = 0.05;

/// Why borders cannot be fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Misfit {
    /// Borders are too close to each other at a point, in units of elements.
    Crowded(Point),
    /// A region differs from its shape by an area, in elements, with the number of its border, and a point of the part
    /// if that is small.
    Area(usize, f64, Option<Point>),
}

/// Vertices on borders, and cells that are split.
pub struct Snapped {
    elements: [usize; 2],
    /// Positions of the vertices, row by row.
    vertices: Vec<Point>,
    /// Side of each border that each vertex is on: 1 inside, −1 outside, 0 on it.
    signs: Vec<Vec<i8>>,
    /// The diagonal along which each cell is split, if any.
    pub splits: Vec<Option<Diagonal>>,
    /// For each cell and each of its two halves, whether it is inside each border; both are equal without a split.
    inside: Vec<[Vec<bool>; 2]>,
    /// Edges between two vertices, the smaller number first, whose middle does not move to a border.
    straight: BTreeSet<[usize; 2]>,
}

/// A diagonal of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Diagonal {
    /// From the lower left to the upper right vertex.
    Rising,
    /// From the lower right to the upper left vertex.
    Falling,
}

impl Diagonal {
    /// Its ends by the numbers of the vertices of a cell: lower left, lower right, upper left, upper right.
    pub const fn ends(self) -> [usize; 2] {
        match self {
            Self::Rising => [0, 3],
            Self::Falling => [1, 2],
        }
    }

    /// Returns the halves, anticlockwise from one end of the diagonal: the lower, then the upper.
    pub const fn halves(self) -> [[usize; 3]; 2] {
        match self {
            Self::Rising => [[0, 1, 3], [0, 3, 2]],
            Self::Falling => [[1, 2, 0], [1, 3, 2]],
        }
    }

    /// Returns the diagonal through a vertex.
    const fn through(vertex: usize) -> Self {
        match vertex {
            0 | 3 => Self::Rising,
            _ => Self::Falling,
        }
    }
}

/// A vertex that may move to a border.
#[derive(Clone, Copy, PartialEq)]
struct Candidate {
    distance: f64,
    vertex: usize,
    curve: usize,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        let of = |candidate: &Self| (candidate.vertex, candidate.curve);
        self.distance
            .total_cmp(&other.distance)
            .then_with(|| of(self).cmp(&of(other)))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

struct Snapper<'a> {
    curves: &'a [Curve],
    snapped: Snapped,
    /// Whether each vertex is on a border.
    is_taken: Vec<bool>,
}

impl Snapped {
    /// Fits a grid with these numbers of columns and rows to borders.
    ///
    /// # Errors
    /// If that does not succeed.
    pub fn new(elements: [usize; 2], curves: &[Curve]) -> Result<Self, Misfit> {
        let [columns, rows] = elements.map(|count| count + 1);
        let vertices: Vec<Point> = (0..columns * rows)
            .map(|at| [(at % columns) as f64, (at / columns) as f64])
            .collect();
        let signs: Vec<Vec<i8>> = curves
            .iter()
            .map(|curve| vertices.iter().map(|vertex| sign(curve, *vertex)).collect())
            .collect();
        let mut snapper = Snapper {
            curves,
            is_taken: vec![false; vertices.len()],
            snapped: Self {
                elements,
                vertices,
                signs,
                splits: Vec::new(),
                inside: Vec::new(),
                straight: BTreeSet::new(),
            },
        };
        snapper.take_corners();
        snapper.take_vertices_on_borders();
        snapper.move_vertices()?;
        snapper.split()?;
        Ok(snapper.snapped)
    }

    /// Returns the vertices of a cell: lower left, lower right, upper left, upper right.
    pub fn vertices_of(&self, cell: usize) -> [usize; 4] {
        let [columns, _] = self.elements;
        let first = cell / columns * (columns + 1) + cell % columns;
        [first, first + 1, first + columns + 1, first + columns + 2]
    }

    /// Returns the numbers of the halves of a cell; a cell without a split is its first half.
    fn halves(&self, cell: usize) -> std::ops::Range<usize> {
        0..1 + usize::from(self.splits[cell].is_some())
    }

    /// Returns the position of a vertex.
    pub fn position(&self, vertex: usize) -> Point {
        self.vertices[vertex]
    }

    /// Returns whether a half of a cell is inside a border.
    pub fn is_inside(&self, cell: usize, half: usize, curve: usize) -> bool {
        self.inside[cell][half][curve]
    }

    /// Makes the edges of a half of a cell straight, as one that is flat would fold otherwise. Returns whether some
    /// were not.
    pub fn straighten(&mut self, cell: usize, half: usize) -> bool {
        let vertices = self.vertices_of(cell);
        let corners = self.corners_around(cell, half);
        let ends = corners.iter().zip(corners.iter().cycle().skip(1));
        let edges = ends.map(|(a, b)| [vertices[*a].min(vertices[*b]), vertices[*a].max(vertices[*b])]);
        let before = self.straight.len();
        self.straight.extend(edges);
        self.straight.len() > before
    }

    /// Returns the corners of a half of a cell, or of the whole cell without a split, anticlockwise.
    pub fn corners_around(&self, cell: usize, half: usize) -> Vec<usize> {
        match self.splits[cell] {
            None => vec![0, 1, 3, 2],
            Some(diagonal) => diagonal.halves()[half].to_vec(),
        }
    }

    /// Returns the middle of the vertices of a cell.
    pub fn middle_of(&self, cell: usize) -> Point {
        middle(&self.vertices_of(cell).map(|vertex| self.vertices[vertex]))
    }

    /// Returns the middle of an edge between two vertices: on the border, if it separates the halves (cell, half) on
    /// either side of it.
    pub fn middle(&self, curves: &[Curve], [a, b]: [usize; 2], beside: [Option<(usize, usize)>; 2]) -> Point {
        let [from, to] = [a, b].map(|vertex| self.vertices[vertex]);
        let straight = [0, 1].map(|axis| 0.5 * (from[axis] + to[axis]));
        let [Some(one), Some(other)] = beside else {
            return straight;
        };
        if self.straight.contains(&[a.min(b), a.max(b)]) {
            return straight;
        }
        let separating = (0..curves.len()).find(|&curve| {
            let signs = &self.signs[curve];
            let inside = |(cell, half): (usize, usize)| self.inside[cell][half][curve];
            signs[a] == 0 && signs[b] == 0 && inside(one) != inside(other)
        });
        let closest = separating.and_then(|curve| curves[curve].closest(straight));
        match closest {
            // A middle node that moves farther folds the element.
            Some((point, moved)) if moved <= 0.2 * distance(from, to) => point,
            _ => straight,
        }
    }

    /// Checks that the area of each region, from those of its halves (cell, half), is that of its shape.
    ///
    /// # Errors
    /// If one is not.
    pub fn check_areas(&self, curves: &[Curve], area: impl Fn(usize, usize) -> f64) -> Result<(), Misfit> {
        for (number, curve) in curves.iter().enumerate() {
            let cells = (0..self.splits.len()).map(|cell| {
                let inside = self.halves(cell).filter(|half| self.inside[cell][*half][number]);
                inside.map(|half| area(cell, half)).sum::<f64>()
            });
            let lost = curve.area() - cells.sum::<f64>();
            if lost.abs() > LARGEST_LOSS || lost.is_nan() {
                return Err(Misfit::Area(number, lost, None));
            }
            for part in curve.small_parts() {
                let lost = part.area.abs() - self.area_of_part(number, part, &area);
                if lost.abs() > LARGEST_LOSS * part.area.abs().min(1.0) {
                    return Err(Misfit::Area(number, lost * part.area.signum(), Some(part.corner)));
                }
            }
        }
        Ok(())
    }

    /// Returns the area on the mesh of a small part of a region, or of a small hole in it.
    fn area_of_part(&self, curve: usize, part: &Part, area: &impl Fn(usize, usize) -> f64) -> f64 {
        let range = |axis: usize| {
            let all = part.outline.rings().iter().flatten().map(|corner| corner[axis]);
            let (low, high) = all.fold((f64::INFINITY, 0.0), |(low, high), at: f64| (at.min(low), at.max(high)));
            let last = self.elements[axis];
            (low.floor() - 1.0).clamp(0.0, last as f64) as usize..((high.ceil() + 1.0).max(0.0) as usize).min(last)
        };
        let (columns, rows) = (range(0), range(1));
        let cells = rows.flat_map(|row| columns.clone().map(move |column| row * self.elements[0] + column));
        let halves = cells.flat_map(|cell| self.halves(cell).map(move |half| (cell, half)));
        let within = halves.filter(|&(cell, half)| {
            let vertices = self.vertices_of(cell);
            let corners = corners_of(self.splits[cell], half);
            let points: Vec<Point> = corners.iter().map(|&at| self.vertices[vertices[at]]).collect();
            self.inside[cell][half][curve] == (part.area > 0.0) && part.outline.contains(middle(&points))
        });
        within.map(|(cell, half)| area(cell, half)).sum()
    }
}

/// Returns the side of a border that a point is on.
fn sign(curve: &Curve, point: Point) -> i8 {
    match curve.closest(point) {
        Some((_, distance)) if distance <= ON => 0,
        _ if curve.contains(point) => 1,
        _ => -1,
    }
}

impl Snapper<'_> {
    /// Returns the limits of a vertex along an axis: one on the edge of the grid stays on it.
    fn may_move_to(&self, vertex: usize, point: Point) -> bool {
        let from = self.snapped.vertices[vertex];
        let last = self.snapped.elements.map(|count| count as f64);
        (0..2).all(|axis| {
            let is_at_end = from[axis] == 0.0 || from[axis] == last[axis];
            if is_at_end {
                (point[axis] - from[axis]).abs() <= ON
            } else {
                point[axis] > ON && point[axis] < last[axis] - ON
            }
        })
    }

    /// Moves a vertex onto a border.
    fn take(&mut self, vertex: usize, mut point: Point) {
        let last = self.snapped.elements.map(|count| count as f64);
        let from = self.snapped.vertices[vertex];
        for axis in 0..2 {
            if from[axis] == 0.0 || from[axis] == last[axis] {
                point[axis] = from[axis];
            }
        }
        self.snapped.vertices[vertex] = point;
        self.is_taken[vertex] = true;
        for (curve, signs) in self.curves.iter().zip(&mut self.snapped.signs) {
            signs[vertex] = sign(curve, point);
        }
    }

    /// Moves the nearest free vertex to each corner, after those that are at one.
    fn take_corners(&mut self) {
        let curves = self.curves;
        let last = self.snapped.elements.map(|count| count as f64 + ON);
        let is_within = |corner: &&Point| (0..2).all(|axis| corner[axis] >= -ON && corner[axis] <= last[axis]);
        let corners = curves.iter().flat_map(Curve::corners).filter(is_within);
        let corners: Vec<Point> = corners.copied().collect();
        for corner in &corners {
            let there = self.around(*corner).find(|vertex| self.is_at(*vertex, *corner));
            if let Some(vertex) = there {
                self.is_taken[vertex] = true;
            }
        }
        for corner in corners {
            let far = |vertex: usize| distance(self.snapped.vertices[vertex], corner);
            let vertices: Vec<usize> = self.around(corner).collect();
            // That of another border may be the same.
            if vertices.iter().any(|vertex| self.is_at(*vertex, corner)) {
                continue;
            }
            let free = vertices.into_iter().filter(|vertex| self.is_free_for(*vertex, corner));
            let nearest = free.min_by(|a, b| far(*a).total_cmp(&far(*b)));
            if let Some(vertex) = nearest.filter(|vertex| far(*vertex) <= FARTHEST) {
                self.take(vertex, corner);
            }
        }
    }

    /// Returns the vertices around a point.
    fn around(&self, [x, y]: Point) -> impl Iterator<Item = usize> + use<> {
        let [columns, rows] = self.snapped.elements;
        let first = [x, y].map(|at| (at.floor() - 1.0).max(0.0) as usize);
        let rows = first[1]..=(first[1] + 3).min(rows);
        rows.flat_map(move |row| {
            (first[0]..=(first[0] + 3).min(columns)).map(move |column| row * (columns + 1) + column)
        })
    }

    fn is_at(&self, vertex: usize, point: Point) -> bool {
        distance(self.snapped.vertices[vertex], point) <= ON
    }

    /// Returns whether a vertex may move to a corner: it stays on the borders that it is on.
    fn is_free_for(&self, vertex: usize, corner: Point) -> bool {
        let mut borders = self.curves.iter().zip(&self.snapped.signs);
        let stays = borders.all(|(curve, signs)| signs[vertex] != 0 || sign(curve, corner) == 0);
        stays && !self.is_taken[vertex] && self.may_move_to(vertex, corner)
    }

    /// Keeps the vertices that are on borders where they are.
    fn take_vertices_on_borders(&mut self) {
        for signs in &self.snapped.signs {
            for (is_taken, sign) in self.is_taken.iter_mut().zip(signs) {
                *is_taken |= *sign == 0;
            }
        }
    }

    /// Returns the neighbours of a vertex along the grid.
    fn neighbours(&self, vertex: usize) -> impl Iterator<Item = usize> + use<> {
        let [columns, rows] = self.snapped.elements.map(|count| count + 1);
        let (column, row) = (vertex % columns, vertex / columns);
        let left = (column > 0).then(|| vertex - 1);
        let right = (column + 1 < columns).then_some(vertex + 1);
        let below = (row > 0).then(|| vertex - columns);
        let above = (row + 1 < rows).then_some(vertex + columns);
        [left, right, below, above].into_iter().flatten()
    }

    /// Returns the neighbours on the other side of a border.
    fn opposite(&self, vertex: usize, curve: usize) -> impl Iterator<Item = usize> {
        let signs = &self.snapped.signs[curve];
        self.neighbours(vertex)
            .filter(move |&other| signs[vertex] * signs[other] < 0)
    }

    /// Returns the neighbours on a border or on the same side of it, to which the edge of the grid clearly crosses the
    /// border in between, as near a corner.
    fn beyond(&self, vertex: usize, curve: usize) -> Vec<usize> {
        let (of, signs) = (&self.curves[curve], &self.snapped.signs[curve]);
        let from = self.snapped.vertices[vertex];
        if signs[vertex] == 0 || of.closest(from).is_none() {
            return Vec::new();
        }
        let is_crossed = |&other: &usize| {
            let to = self.snapped.vertices[other];
            let last = match signs[other] {
                0 => Some(to),
                _ => of.crossing(to, from),
            };
            of.crossing(from, to).zip(last).is_some_and(|(crossing, last)| {
                let between = middle(&[crossing, last]);
                let is_across = of.contains(between) != (signs[vertex] > 0);
                is_across && of.closest(between).is_none_or(|(_, distance)| distance > CLEAR)
            })
        };
        self.neighbours(vertex).filter(is_crossed).collect()
    }

    /// Returns the neighbours to which the grid crosses a border, and whether they are on its other side.
    fn crossed(&self, vertex: usize, curve: usize) -> (Vec<usize>, bool) {
        let opposite: Vec<usize> = self.opposite(vertex, curve).collect();
        match opposite.is_empty() {
            true => (self.beyond(vertex, curve), false),
            false => (opposite, true),
        }
    }

    /// Returns where a vertex moves onto a border, if it can.
    fn target(&self, vertex: usize, curve: usize) -> Option<Point> {
        let of = &self.curves[curve];
        let from = self.snapped.vertices[vertex];
        let (others, is_opposite) = self.crossed(vertex, curve);
        let crossings = others
            .iter()
            .filter_map(|&other| of.crossing(from, self.snapped.vertices[other]));
        let mut crossings: Vec<Point> = crossings.collect();
        crossings.sort_by(|a, b| distance(from, *a).total_cmp(&distance(from, *b)));
        let (closest, _) = of.closest(from).filter(|_| !others.is_empty())?;
        let at_corner = || {
            let mut corners = of.corners().iter();
            corners.any(|corner| distance(*corner, closest) < AT_CORNER)
        };
        // The closest part of the border may be another than the one that the edge crosses.
        let is_same = || {
            let mut crossings = crossings.iter();
            is_opposite || crossings.any(|crossing| distance(*crossing, closest) < 0.5)
        };
        // Two crossings at one distance, as on a diagonal of symmetry, leave no choice between them.
        let is_even = match crossings[..] {
            [one, other, ..] => distance(from, other) - distance(from, one) < ON,
            _ => false,
        };
        if is_same() && (is_even || !at_corner()) && self.may_move_to(vertex, closest) {
            return Some(closest);
        }
        let mut crossings = crossings.into_iter();
        crossings.find(|crossing| self.may_move_to(vertex, *crossing))
    }

    /// Adds the vertices that border edges of the grid cross at a vertex.
    fn propose(&self, vertex: usize, heap: &mut BinaryHeap<Reverse<Candidate>>) {
        for (curve, of) in self.curves.iter().enumerate() {
            let (others, _) = self.crossed(vertex, curve);
            let either = if others.is_empty() { &[][..] } else { &[vertex][..] };
            for &vertex in others.iter().chain(either) {
                if let Some((_, distance)) = of.closest(self.snapped.vertices[vertex]) {
                    heap.push(Reverse(Candidate {
                        distance,
                        vertex,
                        curve,
                    }));
                }
            }
        }
    }

    /// Moves vertices until no edge of the grid has its ends on different sides of a border.
    fn move_vertices(&mut self) -> Result<(), Misfit> {
        let mut heap = BinaryHeap::new();
        for vertex in 0..self.snapped.vertices.len() {
            self.propose(vertex, &mut heap);
        }
        while let Some(Reverse(Candidate { vertex, curve, .. })) = heap.pop() {
            if self.is_taken[vertex] {
                continue;
            }
            if let Some(target) = self.target(vertex, curve) {
                self.take(vertex, target);
                let around: Vec<usize> = self.neighbours(vertex).chain([vertex]).collect();
                around.into_iter().for_each(|vertex| self.propose(vertex, &mut heap));
            }
        }
        let crossed = (0..self.snapped.vertices.len())
            .find(|&vertex| (0..self.curves.len()).any(|curve| self.opposite(vertex, curve).next().is_some()));
        match crossed {
            Some(vertex) => Err(Misfit::Crowded(self.snapped.vertices[vertex])),
            None => Ok(()),
        }
    }

    /// Splits the cells that borders cut.
    fn split(&mut self) -> Result<(), Misfit> {
        let [columns, rows] = self.snapped.elements;
        for cell in 0..columns * rows {
            let vertices = self.snapped.vertices_of(cell);
            let points = vertices.map(|vertex| self.snapped.vertices[vertex]);
            let mut diagonal = None;
            for curve in 0..self.curves.len() {
                let Some(wanted) = self.cut(curve, vertices, points)? else {
                    continue;
                };
                if *diagonal.get_or_insert(wanted) != wanted {
                    return Err(Misfit::Crowded(middle(&points)));
                }
            }
            let diagonal = diagonal.or_else(|| widest(points));
            let inside = [0, 1].map(|half| {
                let corners = corners_of(diagonal, half);
                (0..self.curves.len())
                    .map(|curve| self.is_inside(curve, corners.iter().map(|&at| (vertices[at], points[at])).collect()))
                    .collect()
            });
            self.snapped.splits.push(diagonal);
            self.snapped.inside.push(inside);
        }
        Ok(())
    }

    /// Returns whether a part of a cell with these vertices is inside a border.
    fn is_inside(&self, curve: usize, vertices: Vec<(usize, Point)>) -> bool {
        let sign = vertices
            .iter()
            .map(|(vertex, _)| self.snapped.signs[curve][*vertex])
            .find(|sign| *sign != 0);
        match sign {
            Some(sign) => sign > 0,
            None => {
                let points: Vec<Point> = vertices.iter().map(|(_, point)| *point).collect();
                self.curves[curve].contains(middle(&points))
            }
        }
    }

    /// Returns the diagonal along which a border cuts a cell.
    fn cut(&self, curve: usize, vertices: [usize; 4], points: [Point; 4]) -> Result<Option<Diagonal>, Misfit> {
        let signs = vertices.map(|vertex| self.snapped.signs[curve][vertex]);
        if signs.contains(&1) && signs.contains(&-1) {
            let wanted = if signs[0] * signs[3] < 0 {
                Diagonal::Falling
            } else {
                Diagonal::Rising
            };
            return match wanted.ends().iter().all(|&end| signs[end] == 0) {
                true => Ok(Some(wanted)),
                false => Err(Misfit::Crowded(middle(&points))),
            };
        }
        let zeros = signs.iter().filter(|sign| **sign == 0).count();
        if zeros < 3 {
            return Ok(None);
        }
        // A corner of the border may lie in a cell whose vertices are all on it.
        let side = |half: [usize; 3]| {
            let strict = half.iter().map(|&at| signs[at]).find(|sign| *sign != 0);
            let centre = middle(&half.map(|at| points[at]));
            let of = &self.curves[curve];
            let far = of.closest(centre).map_or(1.0, |(_, distance)| distance);
            match strict {
                Some(sign) => (sign > 0, 1.0),
                None => (of.contains(centre), far),
            }
        };
        let mut best: Option<(f64, Diagonal)> = None;
        for diagonal in [Diagonal::Rising, Diagonal::Falling] {
            if diagonal.ends().iter().any(|&end| signs[end] != 0) {
                continue;
            }
            let [(one, far), (other, farther)] = diagonal.halves().map(side);
            let clear = far.min(farther);
            if one != other && clear > CLEAR && best.is_none_or(|(most, _)| clear > most) {
                best = Some((clear, diagonal));
            }
        }
        Ok(best.map(|(_, diagonal)| diagonal))
    }
}

/// Returns the corners of a half of a cell by the numbers of its vertices; without a split those of the cell.
fn corners_of(split: Option<Diagonal>, half: usize) -> Vec<usize> {
    match split {
        None => vec![0, 1, 2, 3],
        Some(diagonal) => diagonal.halves()[half].to_vec(),
    }
}

/// Returns the diagonal through the vertex with the widest angle, if that is too wide for a quadrilateral.
fn widest(points: [Point; 4]) -> Option<Diagonal> {
    let cosine = |at: usize, before: usize, after: usize| {
        let [a, b] = [before, after].map(|other| [0, 1].map(|axis| points[other][axis] - points[at][axis]));
        let sizes = a[0].hypot(a[1]) * b[0].hypot(b[1]);
        let is_reflex = a[0] * b[1] - a[1] * b[0] > 0.0;
        if is_reflex {
            -2.0
        } else {
            (a[0] * b[0] + a[1] * b[1]) / sizes
        }
    };
    // Neighbours in the order clockwise, at, anticlockwise around the cell.
    let angles = [(0, 2, 1), (1, 0, 3), (3, 1, 2), (2, 3, 0)];
    let widest = angles
        .map(|(at, before, after)| (cosine(at, before, after), at))
        .into_iter()
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (cosine, at) = widest?;
    (cosine < WIDEST).then(|| Diagonal::through(at))
}

/// Returns the mean of points.
fn middle(points: &[Point]) -> Point {
    let sum = points
        .iter()
        .fold([0.0; 2], |sum, point| [sum[0] + point[0], sum[1] + point[1]]);
    sum.map(|sum| sum / points.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::super::mapped;
    use super::*;
    use deaflow_pattern::Polygons;

    /// Returns the area of a region on a grid of 50 × 50 elements.
    fn area_of(region: &Polygons) -> Result<f64, Misfit> {
        let elements = [50, 50];
        let curves = [Curve::new(region, [1.0; 2], elements)];
        let snapped = Snapped::new(elements, &curves)?;
        let fine = mapped::fine_nodes(elements, &snapped, &curves);
        let halves = (0..2500).flat_map(|cell| (0..2).map(move |half| (cell, half)));
        let inside = halves
            .filter(|&(cell, half)| half == 0 || snapped.splits[cell].is_some())
            .filter(|&(cell, half)| snapped.is_inside(cell, half, 0));
        Ok(inside
            .map(|(cell, half)| mapped::area(elements, &snapped, &fine, cell, half))
            .sum())
    }

    #[test]
    fn polygons_keep_their_area() {
        // Through corners of elements, along their sides, with obtuse and sharp corners, and corners beside each other.
        for ring in [
            vec![[10.0, 10.0], [40.0, 10.0], [40.0, 35.0], [10.0, 35.0]],
            vec![[10.0, 10.0], [40.0, 40.0], [10.0, 40.0]],
            vec![[10.5, 10.5], [40.5, 10.5], [40.5, 35.5], [10.5, 35.5]],
            vec![[10.3, 20.0], [25.0, 5.7], [39.9, 20.0], [25.0, 44.2]],
            vec![
                [17.2, 38.3],
                [12.0, 28.7],
                [15.4, 19.0],
                [38.5, 11.5],
                [40.6, 36.0],
                [22.8, 37.1],
            ],
            vec![[12.8, 30.4], [8.6, 13.6], [10.6, 14.1], [32.9, 22.8], [27.2, 36.5]],
            vec![[25.6, 36.7], [14.5, 22.1], [19.3, 13.5], [40.3, 18.0], [28.9, 43.6]],
            vec![[44.0, 25.6], [26.5, 15.3], [35.2, 18.5]],
        ] {
            let region = Polygons::new(std::slice::from_ref(&ring));
            let found = area_of(&region).unwrap();
            assert!(
                (found - region.area()).abs() < 1e-9,
                "{ring:?}: {found} {}",
                region.area()
            );
        }
    }

    #[test]
    fn smooth_borders_lose_little_area_and_small_ones_are_noticed() {
        let disc = |x: f64, y: f64, r: f64| -> Vec<Point> {
            let at = |k: usize| std::f64::consts::TAU * k as f64 / 20_000.0;
            (0..20_000)
                .map(|k| [x + r * at(k).cos(), y + r * at(k).sin()])
                .collect()
        };
        let lost = |region: Polygons| area_of(&region).map(|found| (found - region.area()).abs());
        for (x, y, r) in [
            (25.0, 25.0, 20.0),
            (25.0, 25.0, 24.9),
            (24.7, 25.3, 10.0),
            (25.5, 25.5, 3.5),
            (20.1, 31.7, 2.2),
        ] {
            let lost = lost(Polygons::new(&[disc(x, y, r)])).unwrap();
            assert!(lost < 6e-3, "{x} {y} {r}: {lost}");
        }
        let ring = Polygons::new(&[disc(25.0, 25.0, 20.0), disc(27.0, 25.0, 2.0)]);
        assert!(lost(ring).unwrap() < 6e-3);
        // Smaller than an element: all of it is lost, which the check of areas notices.
        let tiny = Polygons::new(&[disc(25.5, 25.5, 0.3)]);
        assert!(!lost(tiny).is_ok_and(|lost| lost < LARGEST_LOSS));
    }

    #[test]
    fn borders_closer_than_an_element_are_refused() {
        let square = |low: f64, high: f64| vec![[low, low], [high, low], [high, high], [low, high]];
        let curves = |sides: &[(f64, f64)]| -> Vec<Curve> {
            let regions = sides.iter().map(|(low, high)| Polygons::new(&[square(*low, *high)]));
            regions.map(|region| Curve::new(&region, [1.0; 2], [50, 50])).collect()
        };
        // Two borders take both ends of an edge between them, and no third one.
        let mut sides = vec![(10.3, 30.4), (10.8, 29.0)];
        assert!(Snapped::new([50, 50], &curves(&sides)).is_ok());
        sides.push((10.55, 27.0));
        assert!(matches!(
            Snapped::new([50, 50], &curves(&sides)),
            Err(Misfit::Crowded(_))
        ));
    }
}
