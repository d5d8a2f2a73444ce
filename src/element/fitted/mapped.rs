//! Elements with moved nodes, and halves of split cells, with the gradients of their basis at each point.

use super::curve::{Curve, Point};
use super::snap::Snapped;
use super::{Content, NodeLayout};
use crate::element::Line;
use crate::kinematics::Tensor;
use crate::precision::{BothPrecisions, Precision};
use deaflow_pattern::Part;

/// Smallest area of a point relative to a point of a square element.
const SMALLEST: f64 = 1e-5;

/// A cell and the number of its half.
pub(super) type Half = (usize, usize);

/// Mapped elements, in rows of [`NodeLayout::part`] elements like those of the grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapped {
    elements: Vec<MappedElement>,
    /// Number of rows.
    rows: usize,
    /// Index of each node for the first component, in lines of elements for each node of a row.
    nodes: Vec<u32>,
    /// Derivatives of the basis along x and y, in lines of elements: for each row, point, node and axis.
    slopes: BothPrecisions,
    /// Area of each point, in lines of elements: for each row and point.
    areas: BothPrecisions,
    /// For each element of the grid, in rows of [`NodeLayout::part`] numbers: 0 if its cell is mapped, else 1.
    unmapped: BothPrecisions,
}

/// A mapped element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MappedElement {
    /// The element (column, row) of the grid that it is, or is half of.
    pub place: [usize; 2],
    /// What it is made of.
    pub content: Content,
    /// Its corners by the numbers of the vertices of a cell, and how many there are.
    corners: ([usize; 4], usize),
}

impl MappedElement {
    /// Returns whether it is half of a cell.
    #[must_use]
    pub fn is_half(&self) -> bool {
        self.corners.1 == 3
    }

    /// Returns the derivatives of the basis at a place in reference coordinates: on the square [0, 1]², or on the
    /// triangle of its three corners. The values are first.
    fn basis(&self, degree: usize, at: Point) -> ([f64; 9], [[f64; 2]; 9]) {
        match self.is_half() {
            true => self.basis_of_triangle(degree, at),
            false => basis_of_square(degree, at),
        }
    }

    fn basis_of_triangle(&self, degree: usize, [s, t]: Point) -> ([f64; 9], [[f64; 2]; 9]) {
        let (mut values, mut slopes) = ([0.0; 9], [[0.0; 2]; 9]);
        let shares = [1.0 - s - t, s, t];
        let along = [[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]];
        let side = degree + 1;
        // Column and row of a corner among the nodes of its cell.
        let place = |corner: usize| [corner % 2 * degree, corner / 2 * degree];
        let node = |[column, row]: [usize; 2]| row * side + column;
        for (a, &corner) in self.corners.0[..3].iter().enumerate() {
            let own = node(place(corner));
            if degree == 1 {
                values[own] = shares[a];
                slopes[own] = along[a];
                continue;
            }
            values[own] = shares[a] * (2.0 * shares[a] - 1.0);
            slopes[own] = along[a].map(|slope| (4.0 * shares[a] - 1.0) * slope);
            let b = (a + 1) % 3;
            let (from, to) = (place(corner), place(self.corners.0[b]));
            let middle = node([0, 1].map(|axis| (from[axis] + to[axis]) / 2));
            values[middle] = 4.0 * shares[a] * shares[b];
            slopes[middle] = [0, 1].map(|axis| 4.0 * (shares[a] * along[b][axis] + shares[b] * along[a][axis]));
        }
        (values, slopes)
    }

    /// Returns for each node of its cell whether it is a node of the element.
    #[must_use]
    pub fn has_nodes(&self, degree: usize) -> Vec<bool> {
        // The derivatives of every basis function are not zero at this place.
        let (_, slopes) = self.basis(degree, [0.3, 0.2]);
        let side = degree + 1;
        slopes[..side * side].iter().map(|slope| *slope != [0.0; 2]).collect()
    }

    /// Returns the points of integration with their weights.
    fn points(&self, degree: usize) -> Vec<(Point, f64)> {
        let line: Vec<(f64, f64)> = match degree {
            1 => Line::LINEAR.points.into_iter().zip(Line::LINEAR.weights).collect(),
            _ => Line::QUADRATIC
                .points
                .into_iter()
                .zip(Line::QUADRATIC.weights)
                .collect(),
        };
        let pairs = line.iter().flat_map(|y| line.iter().map(move |x| (*x, *y)));
        let point = |((x, along), (y, across)): ((f64, f64), (f64, f64))| match self.is_half() {
            // The square collapsed to a triangle.
            true => ([x, y * (1.0 - x)], along * across * (1.0 - x)),
            false => ([x, y], along * across),
        };
        pairs.map(point).collect()
    }

    /// Returns the values of the basis at each point.
    #[must_use]
    pub fn values_at_points<const N: usize>(&self, degree: usize) -> [[f64; N]; N] {
        let points = self.points(degree);
        std::array::from_fn(|q| {
            let (values, _) = self.basis(degree, points[q].0);
            std::array::from_fn(|node| values[node])
        })
    }

    /// Returns the indices of its nodes for the first component.
    #[must_use]
    pub fn nodes(&self, layout: NodeLayout) -> Vec<usize> {
        let count = (layout.degree() + 1).pow(2);
        (0..count).map(|node| layout.node_of(self.place, node)).collect()
    }

    /// Returns the values of the basis where the element covers a point, given the positions of its nodes; `None` if it
    /// does not.
    pub(super) fn values_at(&self, degree: usize, positions: &[Point], point: Point) -> Option<Vec<f64>> {
        const CLOSE: f64 = 1e-9;
        // The inverse map of an element with curved sides may have other solutions outside of it.
        const STARTS: [Point; 4] = [[0.3, 0.3], [0.1, 0.1], [0.8, 0.1], [0.1, 0.8]];
        STARTS.into_iter().find_map(|start| {
            let at = self.place_of(degree, positions, point, start)?;
            let within = at.iter().all(|at| *at >= -CLOSE && *at <= 1.0 + CLOSE);
            let covers = within && (!self.is_half() || at[0] + at[1] <= 1.0 + CLOSE);
            covers.then(|| self.basis(degree, at).0[..positions.len()].to_vec())
        })
    }

    /// Returns the reference coordinates of a point by Newton's method; `None` if it does not converge.
    fn place_of(&self, degree: usize, positions: &[Point], point: Point, start: Point) -> Option<Point> {
        const STEPS: usize = 30;
        let mut at = start;
        for _ in 0..STEPS {
            let (values, slopes) = self.basis(degree, at);
            let (mut off, mut map) = (point, [[0.0; 2]; 2]);
            for ((position, value), slope) in positions.iter().zip(values).zip(slopes) {
                for c in 0..2 {
                    off[c] -= value * position[c];
                    map[c] = [0, 1].map(|axis| map[c][axis] + slope[axis] * position[c]);
                }
            }
            if off[0].hypot(off[1]) < 1e-12 * (1.0 + point[0].hypot(point[1])) {
                return Some(at);
            }
            let area = map[0][0] * map[1][1] - map[0][1] * map[1][0];
            at[0] += (map[1][1] * off[0] - map[0][1] * off[1]) / area;
            at[1] += (map[0][0] * off[1] - map[1][0] * off[0]) / area;
        }
        None
    }
}

/// Returns the values and derivatives of the basis on the square.
pub(crate) fn basis_of_square(degree: usize, at: Point) -> ([f64; 9], [[f64; 2]; 9]) {
    let (mut values, mut slopes) = ([0.0; 9], [[0.0; 2]; 9]);
    let line = at.map(|x| match degree {
        1 => ([1.0 - x, x, 0.0], [-1.0, 1.0, 0.0]),
        _ => (
            [(1.0 - x) * (1.0 - 2.0 * x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)],
            [4.0 * x - 3.0, 4.0 - 8.0 * x, 4.0 * x - 1.0],
        ),
    });
    let side = degree + 1;
    for node in 0..side * side {
        let (a, b) = (node % side, node / side);
        values[node] = line[0].0[a] * line[1].0[b];
        slopes[node] = [line[0].1[a] * line[1].0[b], line[0].0[a] * line[1].1[b]];
    }
    (values, slopes)
}

impl Mapped {
    /// Creates the mapped elements of a grid, and returns which cells are mapped. `scale` converts positions to the
    /// units of gradients.
    ///
    /// # Errors
    /// If elements that are not frame are too flat, with their cells and halves.
    pub(super) fn new(
        layout: NodeLayout,
        scale: [f64; 2],
        snapped: &Snapped,
        fine: &[Point],
        content: impl Fn(usize, usize) -> Content,
    ) -> Result<(Self, Vec<bool>), Vec<Half>> {
        let (degree, part) = (layout.degree(), layout.part());
        let [columns, rows] = [layout.columns(), layout.rows()];
        let (mut elements, mut is_mapped) = (Vec::new(), Vec::with_capacity(columns * rows));
        let (mut halves, mut flat) = (Vec::new(), Vec::new());
        for cell in 0..columns * rows {
            let place = [cell % columns, cell / columns];
            let corners = match snapped.splits[cell] {
                Some(diagonal) => {
                    let of = |half: [usize; 3]| ([half[0], half[1], half[2], 0], 3);
                    diagonal.halves().map(of).to_vec()
                }
                None if is_moved(layout, fine, place) => vec![([0, 1, 2, 3], 4)],
                None => Vec::new(),
            };
            is_mapped.push(!corners.is_empty());
            halves.extend((0..corners.len()).map(|half| (cell, half)));
            elements.extend(corners.into_iter().enumerate().map(|(half, corners)| MappedElement {
                place,
                content: content(cell, half),
                corners,
            }));
        }
        let side = degree + 1;
        let count = side * side;
        let lines = elements.len().div_ceil(columns);
        let mut nodes = vec![0; lines * count * part];
        let mut slopes = vec![0.0; lines * count * count * 2 * part];
        let mut areas = vec![0.0; lines * count * part];
        for (number, element) in elements.iter().enumerate() {
            let (row, column) = (number / columns, number % columns);
            let positions = positions(layout, fine, element.place);
            for (node, index) in element.nodes(layout).into_iter().enumerate() {
                nodes[(row * count + node) * part + column] = index as u32;
            }
            for (q, (at, weight)) in element.points(degree).into_iter().enumerate() {
                let (_, along) = element.basis(degree, at);
                let mut map = [[0.0; 2]; 2];
                for (position, slope) in positions.iter().zip(along) {
                    for c in 0..2 {
                        map[c] = [0, 1].map(|axis| map[c][axis] + slope[axis] * scale[c] * position[c]);
                    }
                }
                let area = map[0][0] * map[1][1] - map[0][1] * map[1][0];
                if area < SMALLEST * scale[0] * scale[1] || area.is_nan() {
                    // A frame that touches a side leaves elements that are as flat as one likes. They do not count.
                    if element.content.part == Part::Frame {
                        continue;
                    }
                    flat.push(halves[number]);
                    break;
                }
                areas[(row * count + q) * part + column] = weight * area;
                for (node, [s, t]) in along.into_iter().take(count).enumerate() {
                    let gradient = [
                        (map[1][1] * s - map[1][0] * t) / area,
                        (map[0][0] * t - map[0][1] * s) / area,
                    ];
                    for (axis, slope) in gradient.into_iter().enumerate() {
                        slopes[(((row * count + q) * count + node) * 2 + axis) * part + column] = slope;
                    }
                }
            }
        }
        if !flat.is_empty() {
            return Err(flat);
        }
        let unmapped = (0..rows * part).map(|at| match at % part < columns {
            true => f64::from(u8::from(!is_mapped[at / part * columns + at % part])),
            false => 1.0,
        });
        let mapped = Self {
            elements,
            rows: lines,
            nodes,
            slopes: BothPrecisions::new(slopes),
            areas: BothPrecisions::new(areas),
            unmapped: BothPrecisions::new(unmapped.collect()),
        };
        Ok((mapped, is_mapped))
    }

    /// Returns the elements, row by row.
    #[must_use]
    pub fn elements(&self) -> &[MappedElement] {
        &self.elements
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the place of an element (column, row) in its row, and the number of its row.
    fn place(layout: NodeLayout, [column, row]: [usize; 2]) -> (usize, usize) {
        (column, row - layout.rows())
    }

    /// Returns the area of each point of an element (column, row).
    #[must_use]
    pub fn areas_of<const N: usize>(&self, layout: NodeLayout, element: [usize; 2]) -> [f64; N] {
        let (column, row) = Self::place(layout, element);
        std::array::from_fn(|q| self.areas.double()[(row * N + q) * layout.part() + column])
    }

    /// Returns the area of an element (column, row).
    #[must_use]
    pub fn area_of(&self, layout: NodeLayout, element: [usize; 2]) -> f64 {
        match layout.degree() {
            1 => self.areas_of::<4>(layout, element).iter().sum(),
            _ => self.areas_of::<9>(layout, element).iter().sum(),
        }
    }

    /// Returns the derivatives of the basis function of a node at a point of an element.
    fn slope<const N: usize>(&self, layout: NodeLayout, element: [usize; 2], q: usize, node: usize) -> [f64; 2] {
        let (column, row) = Self::place(layout, element);
        let line = ((row * N + q) * N + node) * 2;
        [0, 1].map(|axis| self.slopes.double()[(line + axis) * layout.part() + column])
    }

    /// Returns the gradients at the points of an element (column, row) from its nodal values.
    #[must_use]
    pub fn gradients<const N: usize>(
        &self,
        layout: NodeLayout,
        element: [usize; 2],
        nodal: &[[f64; N]; 2],
    ) -> [Tensor<f64>; N] {
        std::array::from_fn(|q| {
            let mut gradient = [[0.0; 2]; 2];
            for node in 0..N {
                let slope = self.slope::<N>(layout, element, q, node);
                for (row, of) in gradient.iter_mut().zip(nodal) {
                    *row = [0, 1].map(|axis| row[axis] + of[node] * slope[axis]);
                }
            }
            gradient
        })
    }

    /// Returns the nodal forces of the stresses at the points of an element (column, row).
    #[must_use]
    pub fn forces<const N: usize>(
        &self,
        layout: NodeLayout,
        element: [usize; 2],
        stresses: &[Tensor<f64>; N],
    ) -> [[f64; N]; 2] {
        let areas = self.areas_of::<N>(layout, element);
        let mut forces = [[0.0; N]; 2];
        for (q, stress) in stresses.iter().enumerate() {
            for node in 0..N {
                let slope = self.slope::<N>(layout, element, q, node);
                for (force, row) in forces.iter_mut().zip(stress) {
                    force[node] += areas[q] * (row[0] * slope[0] + row[1] * slope[1]);
                }
            }
        }
        forces
    }

    /// Returns the data for kernels.
    pub fn view<T: Precision>(&self) -> MappedView<'_, T> {
        MappedView {
            nodes: &self.nodes,
            slopes: T::of(&self.slopes),
            areas: T::of(&self.areas),
            unmapped: T::of(&self.unmapped),
        }
    }
}

/// Mapped elements in one precision, for kernels.
#[derive(Clone, Copy)]
pub struct MappedView<'a, T> {
    /// Index of each node for the first component, in lines of elements for each node of a row.
    pub nodes: &'a [u32],
    /// Derivatives of the basis along x and y, in lines of elements: for each row, point, node and axis.
    pub slopes: &'a [T],
    /// Area of each point, in lines of elements: for each row and point.
    pub areas: &'a [T],
    /// For each element of the grid: 0 if its cell is mapped, else 1.
    pub unmapped: &'a [T],
}

/// Returns the positions of the nodes of biquadratic elements, row by row.
pub(super) fn fine_nodes([columns, rows]: [usize; 2], snapped: &Snapped, curves: &[Curve]) -> Vec<Point> {
    let wide = 2 * columns + 1;
    let mut nodes = vec![[0.0; 2]; wide * (2 * rows + 1)];
    let vertex = |column: usize, row: usize| row * (columns + 1) + column;
    for (column, row) in (0..=rows).flat_map(|row| (0..=columns).map(move |column| (column, row))) {
        nodes[2 * row * wide + 2 * column] = snapped.position(vertex(column, row));
        let cell = |column: usize, row: usize| row * columns + column;
        if column < columns {
            let below = (row > 0).then(|| {
                let cell = cell(column, row - 1);
                (cell, usize::from(snapped.splits[cell].is_some()))
            });
            let above = (row < rows).then(|| (cell(column, row), 0));
            let ends = [vertex(column, row), vertex(column + 1, row)];
            nodes[2 * row * wide + 2 * column + 1] = snapped.middle(curves, ends, [below, above]);
        }
        if row < rows {
            // The right side of a cell belongs to its lower half along a rising diagonal, the left side to its upper.
            let half = |cell: usize, is_right: bool| match snapped.splits[cell] {
                None => 0,
                Some(super::snap::Diagonal::Rising) => usize::from(!is_right),
                Some(super::snap::Diagonal::Falling) => usize::from(is_right),
            };
            let left = (column > 0).then(|| {
                let cell = cell(column - 1, row);
                (cell, half(cell, true))
            });
            let right = (column < columns).then(|| {
                let cell = cell(column, row);
                (cell, half(cell, false))
            });
            let ends = [vertex(column, row), vertex(column, row + 1)];
            nodes[(2 * row + 1) * wide + 2 * column] = snapped.middle(curves, ends, [left, right]);
        }
    }
    for cell in 0..columns * rows {
        let (column, row) = (cell % columns, cell / columns);
        let at = (2 * row + 1) * wide + 2 * column + 1;
        nodes[at] = match snapped.splits[cell] {
            Some(diagonal) => {
                let vertices = snapped.vertices_of(cell);
                let ends = diagonal.ends().map(|end| vertices[end]);
                snapped.middle(curves, ends, [Some((cell, 0)), Some((cell, 1))])
            }
            None => {
                let sum = |places: [usize; 4], axis: usize| -> f64 { places.iter().map(|&at| nodes[at][axis]).sum() };
                let middles = [at - 1, at + 1, at - wide, at + wide];
                let corners = [at - wide - 1, at - wide + 1, at + wide - 1, at + wide + 1];
                [0, 1].map(|axis| 0.5 * sum(middles, axis) - 0.25 * sum(corners, axis))
            }
        };
    }
    nodes
}

/// Returns the positions of the nodes of an element (column, row).
pub(super) fn positions(layout: NodeLayout, fine: &[Point], [column, row]: [usize; 2]) -> Vec<Point> {
    let (side, every) = (layout.degree() + 1, 2 / layout.degree());
    let wide = 2 * layout.columns() + 1;
    let node = |node: usize| (2 * row + node / side * every) * wide + 2 * column + node % side * every;
    (0..side * side).map(|at| fine[node(at)]).collect()
}

/// Returns whether a node of an element is not where it is in a uniform grid.
fn is_moved(layout: NodeLayout, fine: &[Point], place: [usize; 2]) -> bool {
    let (side, degree) = (layout.degree() + 1, layout.degree() as f64);
    positions(layout, fine, place)
        .into_iter()
        .enumerate()
        .any(|(node, position)| {
            let uniform = [node % side, node / side].map(|at| at as f64 / degree);
            (0..2).any(|axis| position[axis] != place[axis] as f64 + uniform[axis])
        })
}

/// Returns the area of half a cell with quadratic edges, or of a whole one.
pub(super) fn area([columns, _]: [usize; 2], snapped: &Snapped, fine: &[Point], cell: usize, half: usize) -> f64 {
    let wide = 2 * columns + 1;
    let first = 2 * (cell / columns) * wide + 2 * (cell % columns);
    let corners = snapped.corners_around(cell, half);
    let place = |corner: usize| [corner % 2 * 2, corner / 2 * 2];
    let point = |[x, y]: [usize; 2]| fine[first + y * wide + x];
    let cross = |a: Point, b: Point| a[0] * b[1] - a[1] * b[0];
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    edges
        .map(|(from, to)| {
            let (from, to) = (place(*from), place(*to));
            let middle = point([0, 1].map(|axis| (from[axis] + to[axis]) / 2));
            let (a, b) = (point(from), point(to));
            // The control point of the parabola through the three.
            let control = [0, 1].map(|axis| 2.0 * middle[axis] - 0.5 * (a[axis] + b[axis]));
            (2.0 * cross(a, control) + 2.0 * cross(control, b) + cross(a, b)) / 6.0
        })
        .sum()
}
