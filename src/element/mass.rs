//! The mass matrix of a membrane: density times area, in units in which both are 1.
//!
//! On rectangles it is M⊗M with the one-dimensional mass matrices; with mapped elements it is assembled. The image is
//! projected onto admissible motions like any force: a body is as heavy as the membrane in its place. The mass of a bar
//! is spread evenly along its side: for motions t and ω of a rigid side of length L the functions of its nodes, which
//! are exact, give m and m L²/12.

use crate::registers::dispatch;
use deaflow_linalg::Mat;

use super::element::{Bilinear, Biquadratic, Element, Line};
use super::grid::Grid;
use super::lanes::Real;
use super::layout::NodeLayout;
use super::modes::line_matrices;
use super::rectangle::{matrices_along, matrices_of};
use super::sheet::{Mount, SheetSides};
use deaflow_field::Order;

/// Largest number of entries of a row on either side of the diagonal.
const REACH: usize = 2;

/// Entries of a row from [`REACH`] before the diagonal to [`REACH`] after it.
type Band = [f64; 2 * REACH + 1];

/// The mass matrix of a grid.
pub enum Mass {
    /// Of a grid of rectangles.
    Product(Product),
    /// Of a grid that follows borders, or has sides that are not held.
    Sparse(Sparse),
}

/// The mass matrix of a grid of rectangles: a product of one along x and one along y.
pub struct Product {
    layout: NodeLayout,
    /// Along x, for each offset from the diagonal, the entries of all interior nodes.
    along: [Vec<f64>; 2 * REACH + 1],
    /// Along y, for each interior node.
    across: Vec<Band>,
    /// Index of each node of a row.
    places: Vec<usize>,
}

/// The mass matrix of a grid that follows borders, row by row.
pub struct Sparse {
    layout: NodeLayout,
    /// For each node, by its index for the first component, the indices of the nodes of its row with their entries.
    rows: Vec<Vec<(usize, f64)>>,
}

impl Mass {
    /// Creates the consistent or the lumped mass matrix of a grid.
    #[must_use]
    pub fn new(grid: &Grid, lumped: bool) -> Self {
        let is_product = grid.follows_borders().is_none() && grid.boundary().is_none();
        match (is_product, grid.order()) {
            (true, _) => Self::Product(Product::new(grid, lumped)),
            (false, Order::Bilinear) => Self::Sparse(Sparse::new::<Bilinear, 4>(grid, lumped)),
            (false, Order::Biquadratic) => Self::Sparse(Sparse::new::<Biquadratic, 9>(grid, lumped)),
        }
    }

    /// Multiplies with a vector, at interior nodes.
    pub fn apply<T: Real>(&self, vector: &[T], out: &mut [T]) {
        match self {
            Self::Product(product) => product.apply(vector, out),
            Self::Sparse(sparse) => sparse.apply(vector, out),
        }
    }
}

/// Returns the masses of pairs of nodes of bars, by the indices of the nodes for the first component.
fn of_bars(grid: &Grid) -> Vec<(usize, usize, f64)> {
    let layout = grid.layout();
    let bars = grid.sheet_sides().into_iter().flat_map(SheetSides::bars);
    let of_bar = |(side, bar): (usize, Mount)| {
        let along = 1 - side / 2;
        let nodes: Vec<usize> = layout.side_nodes(side).map(|[x, y]| layout.index(0, x, y)).collect();
        // Nodes may have moved along the side.
        let degree = layout.degree();
        let places: Vec<f64> = layout
            .side_nodes(side)
            .map(|node| grid.node_position(node)[along])
            .collect();
        let size = |at: usize| places[(at + 1) * degree] - places[at * degree];
        let (_, mass) = match grid.follows_borders() {
            Some(_) => matrices_of(grid.order(), 0..nodes.len(), grid.elements()[along], size),
            None => matrices_along(grid, along, 0..nodes.len()),
        };
        let length: f64 = match grid.follows_borders() {
            Some(_) => places[places.len() - 1] - places[0],
            None => (0..grid.elements()[along]).map(|at| grid.sides([at; 2])[along]).sum(),
        };
        let pairs = (0..nodes.len()).flat_map(|i| (0..nodes.len()).map(move |k| (i, k)));
        let masses = pairs.map(|(i, k)| (nodes[i], nodes[k], bar.mass * mass[(i, k)] / length));
        masses.filter(|(.., mass)| *mass != 0.0).collect::<Vec<_>>()
    };
    bars.filter(|(_, bar)| bar.mass > 0.0).flat_map(of_bar).collect()
}

impl Sparse {
    fn new<E: Element<N>, const N: usize>(grid: &Grid, lumped: bool) -> Self {
        let layout = grid.layout();
        let mut rows: Vec<Vec<(usize, f64)>> = vec![Vec::new(); layout.vector_len() / 2];
        for element in grid.each_element() {
            let (nodes, (factor, masses)) = (grid.nodes_of::<N>(element), grid.mass_of::<E, N>(element));
            for (node, masses) in nodes.iter().zip(masses) {
                for (other, mass) in nodes.iter().zip(masses).filter(|(_, mass)| *mass != 0.0) {
                    let mass = factor * mass;
                    let column = if lumped { node } else { other };
                    let row = &mut rows[*node];
                    match row.iter_mut().find(|(at, _)| at == column) {
                        Some((_, sum)) => *sum += mass,
                        None => row.push((*column, mass)),
                    }
                }
            }
        }
        for (node, other, mass) in of_bars(grid) {
            rows[node].push((other, mass));
        }
        Self { layout, rows }
    }

    fn apply<T: Real>(&self, vector: &[T], out: &mut [T]) {
        let plane = self.rows.len();
        for c in 0..2 {
            let vector = &vector[c * plane..][..plane];
            for (out, row) in out[c * plane..][..plane].iter_mut().zip(&self.rows) {
                let sum: f64 = row.iter().map(|(at, mass)| mass * vector[*at].to_f64()).sum();
                *out = T::from_f64(sum);
            }
        }
        self.layout.clear_frame(out);
    }
}

impl Product {
    fn new(grid: &Grid, lumped: bool) -> Self {
        let layout = grid.layout();
        let [along, across] = [0, 1].map(|axis| {
            let size = |at: usize| grid.sides([at; 2])[axis];
            let (_, mass) = match grid.order() {
                Order::Bilinear => line_matrices(grid.elements()[axis], &Line::LINEAR, size),
                Order::Biquadratic => line_matrices(grid.elements()[axis], &Line::QUADRATIC, size),
            };
            if lumped {
                diagonal(&mass, grid, axis)
            } else {
                band(&mass)
            }
        });
        let (degree, part) = (layout.degree(), layout.part());
        let places = (0..layout.nodes()[0]).map(|column| column % degree * part + column / degree);
        Self {
            layout,
            along: std::array::from_fn(|offset| along.iter().map(|band| band[offset]).collect()),
            across,
            places: places.collect(),
        }
    }

    fn apply<T: Real>(&self, vector: &[T], out: &mut [T]) {
        dispatch(
            #[inline(always)]
            || self.apply_here(vector, out),
        );
    }

    #[inline(always)]
    fn apply_here<T: Real>(&self, vector: &[T], out: &mut [T]) {
        let [columns, rows] = self.layout.nodes().map(|nodes| nodes - 2);
        out.fill(T::default());
        let stride = self.layout.stride();
        let is_linear = self.layout.degree() == 1;
        let mut images = vec![0.0; columns * rows];
        let mut line = vec![0.0; columns + 2 * REACH];
        let mut sum = vec![0.0; columns];
        for c in 0..2 {
            let start = |row: usize| (c * (rows + 2) + row + 1) * stride;
            for row in 0..rows {
                let nodes = &vector[start(row)..][..stride];
                if is_linear {
                    let pairs = line[REACH..].iter_mut().zip(&nodes[1..=columns]);
                    pairs.for_each(|(value, node)| *value = node.to_f64());
                } else {
                    let pairs = line[REACH..].iter_mut().zip(&self.places[1..=columns]);
                    pairs.for_each(|(value, place)| *value = nodes[*place].to_f64());
                }
                let image = &mut images[row * columns..][..columns];
                image.fill(0.0);
                for (offset, entries) in self.along.iter().enumerate() {
                    let pairs = entries.iter().zip(&line[offset..]);
                    image
                        .iter_mut()
                        .zip(pairs)
                        .for_each(|(image, (entry, value))| *image += entry * value);
                }
            }
            for (row, band) in self.across.iter().enumerate() {
                sum.fill(0.0);
                for other in row.saturating_sub(REACH)..=(row + REACH).min(rows - 1) {
                    let (entry, image) = (band[other + REACH - row], &images[other * columns..][..columns]);
                    sum.iter_mut().zip(image).for_each(|(sum, image)| *sum += entry * image);
                }
                let nodes = &mut out[start(row)..][..stride];
                if is_linear {
                    let pairs = nodes[1..=columns].iter_mut().zip(&sum);
                    pairs.for_each(|(node, sum)| *node = T::from_f64(*sum));
                } else {
                    let pairs = self.places[1..=columns].iter().zip(&sum);
                    pairs.for_each(|(place, sum)| nodes[*place] = T::from_f64(*sum));
                }
            }
        }
    }
}

fn band(mass: &Mat<f64>) -> Vec<Band> {
    let n = mass.nrows();
    let entry = |row: usize, at: usize| match (row + at).checked_sub(REACH) {
        Some(column) if column < n => mass[(row, column)],
        _ => 0.0,
    };
    (0..n).map(|row| std::array::from_fn(|at| entry(row, at))).collect()
}

/// Returns row sums, including the coupling of the end nodes to the fixed ones.
fn diagonal(mass: &Mat<f64>, grid: &Grid, axis: usize) -> Vec<Band> {
    let n = mass.nrows();
    let mut sums: Vec<f64> = (0..n)
        .map(|row| (0..n).map(|column| mass[(row, column)]).sum())
        .collect();
    let last = grid.elements()[axis] - 1;
    let ends = [(0, grid.sides([0; 2])[axis]), (n - 1, grid.sides([last; 2])[axis])];
    // The coupling of an end node to the fixed one: h/6 for linear elements; h/15 and −h/30 for quadratic ones.
    match grid.order() {
        Order::Bilinear => ends.into_iter().for_each(|(at, size)| sums[at] += size / 6.0),
        Order::Biquadratic => {
            for ((at, size), next) in ends.into_iter().zip([1, n.saturating_sub(2)]) {
                sums[at] += size / 15.0;
                if next != at && next < n {
                    sums[next] -= size / 30.0;
                }
            }
        }
    }
    sums.into_iter()
        .map(|sum| {
            let mut entries = [0.0; 2 * REACH + 1];
            entries[REACH] = sum;
            entries
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::Mesh;

    #[test]
    fn the_mass_of_a_field_is_the_integral_of_its_square() {
        // u = sin πx sin πy: ∫u² = ¼ of the area.
        for mesh in [Mesh::bilinear(2), Mesh::biquadratic(1)] {
            let grid = Grid::paper(mesh);
            let layout = grid.layout();
            let [columns, rows] = layout.nodes();
            let mut vector = vec![0.0; layout.vector_len()];
            let wave = |at: usize, of: usize| (std::f64::consts::PI * at as f64 / (of - 1) as f64).sin();
            for (x, y) in (1..rows - 1).flat_map(|y| (1..columns - 1).map(move |x| (x, y))) {
                vector[layout.index(0, x, y)] = wave(x, columns) * wave(y, rows);
            }
            let area = grid.elements().iter().product::<usize>() as f64;
            for lumped in [false, true] {
                let mut image = vec![0.0; vector.len()];
                Mass::new(&grid, lumped).apply(&vector, &mut image);
                let sum: f64 = vector.iter().zip(&image).map(|(a, b)| a * b).sum();
                assert!(
                    (sum / (0.25 * area) - 1.0).abs() < 1e-3,
                    "{mesh} {lumped}: {}",
                    sum / area
                );
            }
        }
    }

    #[test]
    fn lumped_masses_add_up_to_those_that_are_not_on_the_edge() {
        for (mesh, edge) in [(Mesh::bilinear(1), 0.5), (Mesh::biquadratic(1), 1.0 / 6.0)] {
            let grid = Grid::paper(mesh);
            let mass = Product::new(&grid, true);
            let length = grid.elements()[0] as f64;
            let sum: f64 = mass.along[REACH].iter().sum();
            assert!((sum - (length - 2.0 * edge)).abs() < 1e-12, "{mesh}: {sum}");
        }
    }
}
