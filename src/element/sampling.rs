//! Transfer between cells and nodes: activities, displacements and forces at the cell corners.

use deaflow_base::Stream;
use deaflow_field::Field;
use deaflow_pattern::Part;

use super::fitted::{Fitted, basis_of_square};
use super::grid::Grid;
use super::lanes::Real;
#[cfg(doc)]
use super::layout::NodeLayout;

/// The weights of nodes at a point: indices for the first component, and the values of their basis functions.
pub type Weights = Vec<(usize, f64)>;

impl Grid {
    /// Writes the activity of each element, that of its cell (column, row), in rows of [`NodeLayout::part`] numbers.
    pub fn write_activity<T: Real>(&self, share: impl Fn(usize, usize) -> f64, activity: &mut [T]) {
        let (layout, [along, across]) = (self.layout(), self.per_cell());
        let part = layout.part();
        let (regular, mapped) = activity.split_at_mut(layout.rows() * part);
        for (cell_row, rows) in regular.chunks_exact_mut(across * part).enumerate() {
            let (first, others) = rows.split_at_mut(part);
            for (cell, elements) in first[..layout.columns()].chunks_exact_mut(along).enumerate() {
                elements.fill(T::from_f64(share(cell, cell_row)));
            }
            others.chunks_exact_mut(part).for_each(|row| row.copy_from_slice(first));
        }
        if mapped.is_empty() {
            return;
        }
        regular.fill(T::default());
        for element in self.each_element() {
            let ([x, y], [column, row]) = (self.cell_of(element), element);
            activity[row * part + column] = T::from_f64(share(x, y));
        }
    }

    /// Returns the index of component `c` of the cell corner at (column, row) in a vector.
    fn corner(&self, c: usize, column: usize, row: usize) -> usize {
        let layout = self.layout();
        let [along, across] = self.per_cell().map(|count| count * layout.degree());
        layout.index(c, column * along, row * across)
    }

    /// Returns forces at the cell corners as nodal forces: the transpose of sampling at a displacement `u`.
    #[must_use]
    pub fn spread(&self, corners: &Field, u: &[f64]) -> Vec<f64> {
        let mut vector = self.scatter(corners);
        self.restrict(u, &mut vector);
        vector
    }

    /// Returns forces out of the plane at the cell corners, `[y][x]`, as nodal forces: the transpose of
    /// [`Self::sample_heights`], also on nodes that are held.
    #[must_use]
    pub fn spread_heights(&self, forces: &[f64]) -> Vec<f64> {
        let pairs = forces.iter().flat_map(|force| [*force, 0.0]).collect();
        let corners = Field::from_values(self.raster(), pairs).expect("there is a finite force for each corner");
        let mut vector = self.scatter(&corners);
        vector.truncate(vector.len() / 2);
        vector
    }

    /// Returns forces at the cell corners as nodal forces, also on nodes that are held.
    fn scatter(&self, corners: &Field) -> Vec<f64> {
        let (layout, [columns, _]) = (self.layout(), self.raster().corner_sides());
        let mut vector = vec![0.0; layout.vector_len()];
        for (at, value) in corners.values().iter().enumerate() {
            let (c, x, y) = (at % 2, at / 2 % columns, at / 2 / columns);
            vector[self.corner(c, x, y)] = *value;
        }
        self.spread_moved(corners, &mut vector);
        vector
    }

    /// Returns random nodal forces at a displacement `u`, with a part along every mode: normal deviates at the cell
    /// corners, or at all nodes if the corners may all be fixed.
    #[must_use]
    pub fn random_load(&self, stream: &mut Stream, u: &[f64]) -> Vec<f64> {
        if self.raster().sides().contains(&1) || self.supports().is_some() {
            let mut vector: Vec<f64> = (0..self.layout().vector_len()).map(|_| stream.normal()).collect();
            self.restrict(u, &mut vector);
            return vector;
        }
        let forces = (0..self.raster().corners() * 2).map(|_| stream.normal()).collect();
        self.spread(
            &Field::from_values(self.raster(), forces).expect("normal deviates are finite"),
            u,
        )
    }

    /// Returns the displacement at the cell corners in mm from nodal values in units of [`Grid::unit_mm`].
    #[must_use]
    pub fn sample(&self, vector: &[f64]) -> Field {
        let [columns, rows] = self.raster().corner_sides();
        let mut values = Vec::with_capacity(self.raster().corners() * 2);
        for y in 0..rows {
            for x in 0..columns {
                for c in 0..2 {
                    values.push(self.unit_mm() * vector[self.corner(c, x, y)]);
                }
            }
        }
        self.sample_moved(vector, &mut values);
        Field::from_values(self.raster(), values).expect("a solution is finite")
    }

    /// Returns a displacement out of the plane at the cell corners, `[y][x]`, in mm, like [`Self::sample`], from nodal
    /// values in the order of the first component.
    #[must_use]
    pub fn sample_heights(&self, heights: &[f64]) -> Vec<f64> {
        let both = [heights, &vec![0.0; heights.len()]].concat();
        self.sample(&both)
            .values()
            .chunks_exact(2)
            .map(|both| both[0])
            .collect()
    }

    /// Computes the displacement at cell corners whose node is elsewhere.
    fn sample_moved(&self, vector: &[f64], values: &mut [f64]) {
        let ([columns, _], plane) = (self.raster().corner_sides(), vector.len() / 2);
        for moved in self.follows_borders().into_iter().flat_map(Fitted::interpolations) {
            let [x, y] = moved.corner;
            for c in 0..2 {
                let terms = moved.weights.iter().map(|(at, weight)| weight * vector[at + c * plane]);
                values[2 * (y * columns + x) + c] = self.unit_mm() * terms.sum::<f64>();
            }
        }
    }

    /// Adds the forces at cell corners whose node is elsewhere: the transpose of [`Self::sample_moved`].
    fn spread_moved(&self, corners: &Field, vector: &mut [f64]) {
        let plane = vector.len() / 2;
        let moved = || self.follows_borders().into_iter().flat_map(Fitted::interpolations);
        for [x, y] in moved().map(|moved| moved.corner) {
            (0..2).for_each(|c| vector[self.corner(c, x, y)] = 0.0);
        }
        for moved in moved() {
            let force = corners.at_corner(moved.corner[0], moved.corner[1]);
            for (at, weight) in &moved.weights {
                (0..2).for_each(|c| vector[at + c * plane] += weight * force[c]);
            }
        }
    }
}

impl Grid {
    /// Returns the weights of the nodes at a point of the prestretched membrane in mm from its lower left corner;
    /// `None` outside of it and in the frame.
    #[must_use]
    pub fn weights_at(&self, point_mm: [f64; 2]) -> Option<Weights> {
        let elements = self.elements();
        let sides = [0, 1].map(|axis| self.side_mm(axis));
        let point = [0, 1].map(|axis| point_mm[axis] / sides[axis]);
        let inside = |axis: usize| (0.0..=elements[axis] as f64).contains(&point[axis]);
        if !inside(0) || !inside(1) {
            return None;
        }
        let element = [0, 1].map(|axis| self.element_at(axis, point[axis]));
        let regular = |fitted: &Fitted| fitted.regular(self.layout(), element).is_some();
        if let Some(fitted) = self.follows_borders().filter(|fitted| !regular(fitted)) {
            let (weights, part) = fitted.covering(self.layout(), point)?;
            return (part != Part::Frame).then_some(weights);
        }
        if self.content(element).part == Part::Frame {
            return None;
        }
        let layout = self.layout();
        let within =
            [0, 1].map(|axis| (point[axis] - self.start(axis, element[axis])) / self.size(axis, element[axis]));
        let (values, _) = basis_of_square(layout.degree(), within);
        let count = (layout.degree() + 1).pow(2);
        let weight = |node: usize| (layout.node_of(element, node), values[node]);
        Some((0..count).map(weight).collect())
    }

    /// Returns the mean side of elements in mm.
    fn side_mm(&self, axis: usize) -> f64 {
        let [columns, rows] = self.elements();
        let far = self.node_position([columns, rows].map(|count| count * self.layout().degree()));
        self.unit_mm() * far[axis] / [columns, rows][axis] as f64
    }

    /// Returns the element at a place along an axis in units of the mean element, from 0 to their number.
    fn element_at(&self, axis: usize, at: f64) -> usize {
        let (count, all) = (self.per_cell()[axis], self.elements()[axis]);
        let first = at as usize / count * count;
        let ends_after = |element: &usize| at < self.start(axis, *element) + self.size(axis, *element);
        (first..all.min(first + count))
            .find(ends_after)
            .unwrap_or(first + count - 1)
            .min(all - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sheet::Sheet;
    use deaflow_field::{Mesh, Order};
    use deaflow_pattern::{Membrane, Raster};

    fn grid(mesh: Mesh) -> Grid {
        let membrane = Membrane {
            raster: Raster::new(50, 32).unwrap(),
            size_mm: [50.0, 8.0],
        };
        let sheet = Sheet {
            membrane,
            ..Sheet::paper()
        };
        Grid::uniform(mesh, &sheet)
    }

    #[test]
    fn activity_follows_the_cells() {
        let grid = grid(Mesh::bilinear(3));
        let (layout, width) = (grid.layout(), grid.layout().part());
        let mut activity = vec![0.0; layout.rows() * width];
        grid.write_activity(|x, y| if (x, y) == (49, 7) { 1.0 } else { 0.0 }, &mut activity);
        assert_eq!(activity.iter().sum::<f64>(), 9.0);
        assert_eq!(activity[22 * width + 148], 1.0);
    }

    #[test]
    fn sampling_picks_the_corners_of_the_cells() {
        for order in [Order::Bilinear, Order::Biquadratic] {
            let grid = grid(Mesh::new(2, order));
            let layout = grid.layout();
            let mut vector = vec![0.0; layout.vector_len()];
            let step = 2 * order.degree();
            vector[layout.index(1, 7 * step, 30 * step)] = 4.0;
            // √(½ · ⅛) mm
            assert_eq!(grid.sample(&vector).at_corner(7, 30), [0.0, 1.0]);
            let spread = grid.spread(&grid.sample(&vector), &vector);
            assert_eq!(spread[layout.index(1, 7 * step, 30 * step)], 1.0);
            assert_eq!(spread.iter().sum::<f64>(), 1.0);
        }
    }
}
