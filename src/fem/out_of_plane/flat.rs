//! Small motions of a flat membrane out of its plane.
//!
//! The energy depends on C alone. With a displacement w out of the plane it is C = fᵀf + ∇w∇wᵀ, so that the second
//! variation in w is that of a scalar field with the stress of the flat state as its coefficient:
//!
//! ```text
//! ∫ ∇wᵀ S ∇w,   S = f⁻¹ p        second Piola-Kirchhoff stress; no coupling with the plane to first order
//! ```
//!
//! Where its smallest eigenvalue reaches zero the flat membrane buckles; without bending stiffness it wrinkles. In the
//! layers of a laminate the slopes of w differ along the normal of the edge, as gradients in the plane do. Sides
//! that are free or under a load alone move out of the plane; other sides, bars, frames and bodies stay in it.

use deaflow_linalg::{Eigen, Mat, Pair, SparseColMat, Sparsity, add_symmetric_product, eigen};

use super::point::{apply, second_stress};
use crate::eigenvalue::{add, dot};
use crate::element::{Bilinear, Biquadratic, Element};
use crate::grid::Grid;
use crate::kinematics::{Tensor, add_scaled, deformation};
use crate::material::Material;
use crate::operator::Operator;
use crate::reactions::touched;
use crate::sheet::SheetSides;
use deaflow_base::Stream;
use deaflow_field::Order;
use deaflow_pattern::Part;

/// Most blocks beyond those that the wanted eigenvalues need.
const MORE_BLOCKS: usize = 60;

/// Vectors of a block: as many equal eigenvalues are found.
const BLOCK: usize = 6;
/// Relative change of the wanted eigenvalues from block to block that counts as zero.
const SETTLED: f64 = 1e-12;

/// Most points of an element.
const MOST_POINTS: usize = 9;

/// The displacements out of the plane of a grid.
pub(crate) struct OutOfPlane {
    /// Number of the unknown of each node, by its index for the first component.
    numbers: Vec<Option<usize>>,
    /// Index of each unknown.
    free: Vec<usize>,
    sparsity: Sparsity,
}

/// The lowest eigenvalues of a stiffness in a metric.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Lowest {
    /// Eigenvalues: those of unstable motions, then the others, lowest first.
    pub values: Vec<f64>,
    /// Their vectors: the first component of nodal vectors.
    pub vectors: Vec<Vec<f64>>,
    /// Number of unstable motions.
    pub unstable: usize,
}

impl OutOfPlane {
    /// Finds what can move; `None` if memory is short.
    pub fn new(grid: &Grid) -> Option<Self> {
        let layout = grid.layout();
        let plane = layout.vector_len() / 2;
        let mut mask = vec![0.0; 2 * plane];
        let [columns, rows] = layout.nodes();
        let is_fixed = |side: usize| {
            let is_free = |sides: &SheetSides| sides.held[side] == [false; 2] && sides.bars[side].is_none();
            !grid.sheet_sides().is_some_and(is_free)
        };
        for node in (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row])) {
            let stays = touched(node, [columns, rows]).any(is_fixed);
            mask[layout.index(0, node[0], node[1])] = if stays { 0.0 } else { 1.0 };
        }
        if let Some(supports) = grid.supports() {
            supports.clear_held(&mut mask);
            for (at, _) in supports.bodies().iter().flat_map(|body| body.nodes.iter()) {
                mask[at] = 0.0;
            }
        }
        let free: Vec<usize> = (0..plane).filter(|at| mask[*at] != 0.0).collect();
        let mut numbers = vec![None; plane];
        for (number, at) in free.iter().enumerate() {
            numbers[*at] = Some(number);
        }
        let pairs: Vec<Pair<usize, usize>> = match grid.order() {
            Order::Bilinear => pairs::<4>(grid, &numbers).map(|(_, pair)| pair).collect(),
            Order::Biquadratic => pairs::<9>(grid, &numbers).map(|(_, pair)| pair).collect(),
        };
        Some(Self {
            // Without unknowns it is not used.
            sparsity: Sparsity::new(free.len().max(1), &pairs)?,
            numbers,
            free,
        })
    }

    /// Returns the entries of the stiffness of a flat state.
    pub fn stiffness<L: Material>(&self, operator: &Operator<'_, L>, u: &[f64]) -> Vec<f64> {
        match operator.activity.grid().order() {
            Order::Bilinear => self.assemble::<Bilinear, 4>(operator.activity.grid(), &mut stresses(operator, u)),
            Order::Biquadratic => self.assemble::<Biquadratic, 9>(operator.activity.grid(), &mut stresses(operator, u)),
        }
    }

    /// Returns the entries of the Laplacian.
    fn laplacian(&self, grid: &Grid) -> Vec<f64> {
        let mut points = |_| vec![[[1.0, 0.0], [0.0, 1.0]]; MOST_POINTS];
        match grid.order() {
            Order::Bilinear => self.assemble::<Bilinear, 4>(grid, &mut points),
            Order::Biquadratic => self.assemble::<Biquadratic, 9>(grid, &mut points),
        }
    }

    /// Returns the mass for the density 1; `None` if memory is short.
    pub fn mass(&self, grid: &Grid, lumped: bool) -> Option<SparseColMat<usize, f64>> {
        self.sparsity.matrix(&match grid.order() {
            Order::Bilinear => self.masses::<Bilinear, 4>(grid, lumped),
            Order::Biquadratic => self.masses::<Biquadratic, 9>(grid, lumped),
        })
    }

    fn assemble<E: Element<N>, const N: usize>(
        &self,
        grid: &Grid,
        stresses: &mut dyn FnMut([usize; 2]) -> Vec<Tensor<f64>>,
    ) -> Vec<f64> {
        let mut entries = Vec::new();
        for element in grid.each_element() {
            let own = pairs_of::<N>(grid, &self.numbers, element);
            if own.is_empty() {
                continue;
            }
            let stress: [Tensor<f64>; N] = match grid.content(element).part {
                Part::Membrane => {
                    let of_points = stresses(element);
                    std::array::from_fn(|q| of_points[q])
                }
                _ => [[[0.0; 2]; 2]; N],
            };
            let columns: [[f64; N]; N] = std::array::from_fn(|node| {
                let mut unit = [[0.0; N]; 2];
                unit[0][node] = 1.0;
                let slopes = grid.changes::<E, N>(element, &unit);
                let flows = std::array::from_fn(|q| [apply(stress[q], slopes[q][0]), [0.0; 2]]);
                grid.forces::<E, N>(element, flows)[0]
            });
            entries.extend(own.into_iter().map(|([row, column], _)| columns[column][row]));
        }
        entries
    }

    fn masses<E: Element<N>, const N: usize>(&self, grid: &Grid, lumped: bool) -> Vec<f64> {
        let each = grid.each_element().flat_map(|element| {
            let own = pairs_of::<N>(grid, &self.numbers, element);
            let (factor, masses) = grid.mass_of::<E, N>(element);
            own.into_iter()
                .map(move |([row, column], _)| match (lumped, row == column) {
                    (false, _) => factor * masses[row][column],
                    (true, true) => factor * masses[row].iter().sum::<f64>(),
                    (true, false) => 0.0,
                })
        });
        each.collect()
    }

    /// Returns whether some node can leave the plane.
    pub fn moves(&self) -> bool {
        !self.free.is_empty()
    }

    /// Sets nodes that stay in the plane to zero.
    pub fn restrict(&self, heights: &mut [f64]) {
        let fixed = heights
            .iter_mut()
            .zip(&self.numbers)
            .filter(|(_, number)| number.is_none());
        fixed.for_each(|(height, _)| *height = 0.0);
    }

    /// Returns a nodal vector of the first component.
    fn unpack(&self, packed: &[f64]) -> Vec<f64> {
        let mut vector = vec![0.0; self.numbers.len()];
        for (at, value) in self.free.iter().zip(packed) {
            vector[*at] = *value;
        }
        vector
    }

    /// Finds the lowest eigenvalues of a stiffness in a metric; fewer if there are fewer unknowns. Negative ones that
    /// do not count as unstable ([`NEARLY_ZERO`]) are left out while there are positive ones. The vectors of unstable
    /// motions are those of the longest waves, which a mesh resolves.
    ///
    /// `None` if a pivot is zero, memory is short, or the search does not settle.
    pub fn lowest(
        &self,
        grid: &Grid,
        stiffness: &[f64],
        metric: &SparseColMat<usize, f64>,
        count: usize,
    ) -> Option<Lowest> {
        if !self.moves() {
            return Some(Lowest::default());
        }
        let laplacian = self.laplacian(grid);
        let count = count.min(self.free.len());
        let (shifted, unstable) = self.factors_beyond(NEARLY_ZERO, stiffness.to_vec(), &laplacian)?;
        let (factors, negative) = self.factors_beyond(NO_TENSION, stiffness.to_vec(), &laplacian)?;
        let positive = self.free.len() - negative;
        // Negative ones that do not count fill up the list.
        let mut packed = match positive + unstable < count {
            true => self.nearest(&factors, metric, -1.0, count - positive)?,
            false => self.nearest(&shifted, metric, -1.0, unstable.min(count))?,
        };
        packed.extend(self.nearest(&factors, metric, 1.0, count - packed.len())?);
        let stiff = self.sparsity.matrix(stiffness)?;
        let value = |vector: &Vec<f64>| dot(vector, &weighed(&stiff, vector)) / dot(vector, &weighed(metric, vector));
        Some(Lowest {
            values: packed.iter().map(value).collect(),
            vectors: packed.iter().map(|vector| self.unpack(vector)).collect(),
            unstable,
        })
    }

    /// Returns the factors of a stiffness of which a share of the Laplacian counts as zero, and the number of its
    /// negative eigenvalues.
    fn factors_beyond(&self, zero: f64, mut stiffness: Vec<f64>, laplacian: &[f64]) -> Option<(Vec<f64>, usize)> {
        add(&mut stiffness, zero, laplacian);
        let factors = self.sparsity.factors(&stiffness)?;
        let negative = self.sparsity.negative_pivots(&factors);
        Some((factors, negative))
    }

    /// Finds the eigenvectors of a factorised stiffness in a metric whose eigenvalues of a sign are nearest to zero, in
    /// this order.
    ///
    /// By Rayleigh and Ritz in the Krylov space of blocks of random vectors under K⁻¹M, whose eigenvalues of largest
    /// magnitude are the inverses of the wanted ones.
    fn nearest(
        &self,
        factors: &[f64],
        metric: &SparseColMat<usize, f64>,
        sign: f64,
        count: usize,
    ) -> Option<Vec<Vec<f64>>> {
        let size = self.free.len();
        if count == 0 {
            return Some(Vec::new());
        }
        let mut basis: Vec<Vec<f64>> = Vec::new();
        let (mut heavy, mut images): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
        let mut next: Vec<Vec<f64>> = (0..BLOCK)
            .map(|index| {
                let mut stream = Stream::new(0, "motions out of the plane", index as u64);
                (0..size).map(|_| stream.normal()).collect()
            })
            .collect();
        let mut before: Vec<f64> = Vec::new();
        for _ in 0..count.div_ceil(BLOCK) + MORE_BLOCKS {
            let first = basis.len();
            for mut vector in next.drain(..) {
                let is_new = basis.len() < size && orthonormalise(&mut vector, &basis, &heavy, metric);
                if is_new {
                    let mass = weighed(metric, &vector);
                    let mut image = mass.clone();
                    self.sparsity.solve(factors, &mut image);
                    basis.push(vector);
                    heavy.push(mass);
                    images.push(image);
                }
            }
            let small = Mat::from_fn(basis.len(), basis.len(), |i, k| {
                0.5 * (dot(&heavy[i], &images[k]) + dot(&heavy[k], &images[i]))
            });
            let Eigen { values, vectors } = eigen(&small)?;
            let signed = values.iter().map(|value| sign * value.recip()).zip(0..);
            let mut magnitudes: Vec<(f64, usize)> = signed.filter(|(value, _)| *value > 0.0).collect();
            magnitudes.sort_by(|a, b| a.0.total_cmp(&b.0));
            magnitudes.truncate(count);
            let found: Vec<f64> = magnitudes.iter().map(|(value, _)| *value).collect();
            let is_settled = |(new, old): (&f64, &f64)| (new - old).abs() <= SETTLED * new;
            let is_whole = basis.len() == size || basis.len() == first;
            let has_settled =
                found.len() == count && before.len() == count && found.iter().zip(&before).all(is_settled);
            if is_whole || has_settled {
                let combined = magnitudes.iter().map(|(_, mode)| {
                    let mut sum = vec![0.0; size];
                    for (at, vector) in basis.iter().enumerate() {
                        add(&mut sum, vectors[(at, *mode)], vector);
                    }
                    sum
                });
                return Some(combined.collect());
            }
            before = found;
            next = images[first..].to_vec();
        }
        None
    }
}

/// Share of the Laplacian that is added to the stiffness where motions are counted as unstable: free edges of strips in
/// tension are compressed a little, and active membrane that is pulled along one axis has no tension across.
const NEARLY_ZERO: f64 = 0.01;
/// Share of the Laplacian that is rounding of the stress of a membrane without tension. With it such a membrane has
/// factors; eigenvalues are those of the stiffness alone.
pub(super) const NO_TENSION: f64 = 1e-12;

/// The stability of flat states against small motions out of their plane.
pub(crate) struct FlatStability {
    heights: OutOfPlane,
    /// Entries of the Laplacian.
    laplacian: Vec<f64>,
    /// Whether some node stays in the plane.
    is_held: bool,
}

impl FlatStability {
    /// Prepares it for a grid; `None` if memory is short.
    pub fn new(grid: &Grid) -> Option<Self> {
        let heights = OutOfPlane::new(grid)?;
        let laplacian = heights.laplacian(grid);
        let [columns, rows] = grid.layout().nodes();
        Some(Self {
            is_held: heights.free.len() < columns * rows,
            heights,
            laplacian,
        })
    }

    /// Returns in how many motions out of its plane a flat state is unstable. `None` if a pivot is exactly zero, or
    /// memory is short.
    pub fn unstable<L: Material>(&self, operator: &Operator<'_, L>, u: &[f64]) -> Option<usize> {
        self.unstable_beyond(NEARLY_ZERO, operator, u)
    }

    /// As [`FlatStability::unstable`], where this share of the Laplacian counts as zero.
    pub fn unstable_beyond<L: Material>(&self, zero: f64, operator: &Operator<'_, L>, u: &[f64]) -> Option<usize> {
        // A membrane without held nodes can leave its plane as a whole, which nothing resists.
        if !self.heights.moves() || !self.is_held {
            return Some(0);
        }
        let stiffness = self.heights.stiffness(operator, u);
        let (_, negative) = self.heights.factors_beyond(zero, stiffness, &self.laplacian)?;
        Some(negative)
    }
}

/// Returns the product of a metric, given by its entries on and below the diagonal, and a vector.
fn weighed(metric: &SparseColMat<usize, f64>, vector: &[f64]) -> Vec<f64> {
    let mut product = vec![0.0; vector.len()];
    let places = [metric.col_ptr(), metric.row_idx()];
    add_symmetric_product(places, metric.val(), 1.0, vector, &mut product);
    product
}

/// Makes a vector orthogonal to a basis and of unit size in a metric; returns whether something is left of it.
fn orthonormalise(
    vector: &mut [f64],
    basis: &[Vec<f64>],
    heavy: &[Vec<f64>],
    metric: &SparseColMat<usize, f64>,
) -> bool {
    let size = |vector: &[f64]| dot(vector, &weighed(metric, vector));
    let before = size(vector);
    // Twice: the first pass leaves rounding of the size of the subtracted part.
    for _ in 0..2 {
        for (other, heavy) in basis.iter().zip(heavy) {
            let part = dot(vector, heavy);
            add(vector, -part, other);
        }
    }
    let after = size(vector);
    if after.is_nan() || after <= 1e-20 * before {
        return false;
    }
    let factor = 1.0 / after.sqrt();
    vector.iter_mut().for_each(|value| *value *= factor);
    true
}

/// Returns the nodes of an element, as row and column of its matrix, whose unknowns have an entry on or below the
/// diagonal.
fn pairs_of<const N: usize>(
    grid: &Grid,
    numbers: &[Option<usize>],
    element: [usize; 2],
) -> Vec<([usize; 2], Pair<usize, usize>)> {
    let nodes = grid.nodes_of::<N>(element).map(|at| numbers[at]);
    let each = (0..N * N).map(|at| [at / N, at % N]);
    each.filter_map(|[row, column]| {
        let (of_row, of_column) = (nodes[row]?, nodes[column]?);
        (of_row >= of_column).then(|| ([row, column], Pair::new(of_row, of_column)))
    })
    .collect()
}

fn pairs<'a, const N: usize>(
    grid: &'a Grid,
    numbers: &'a [Option<usize>],
) -> impl Iterator<Item = ([usize; 2], Pair<usize, usize>)> + 'a {
    grid.each_element()
        .flat_map(move |element| pairs_of::<N>(grid, numbers, element))
}

/// Returns S at the points of an element.
fn stresses<L: Material>(operator: &Operator<'_, L>, u: &[f64]) -> impl FnMut([usize; 2]) -> Vec<Tensor<f64>> {
    let (grid, plane) = (operator.activity.grid(), u.len() / 2);
    move |element| match grid.order() {
        Order::Bilinear => of_element::<Bilinear, L, 4>(operator, u, plane, element),
        Order::Biquadratic => of_element::<Biquadratic, L, 9>(operator, u, plane, element),
    }
}

fn of_element<E: Element<N>, L: Material, const N: usize>(
    operator: &Operator<'_, L>,
    u: &[f64],
    plane: usize,
    element: [usize; 2],
) -> Vec<Tensor<f64>> {
    let (grid, material) = (operator.activity.grid(), operator.material);
    let nodes = grid.nodes_of::<N>(element);
    let gradients = grid.gradients::<E, N>(element, &[0, 1].map(|c| nodes.map(|at| u[at + c * plane])));
    let laminate = operator
        .activity
        .covered()
        .and_then(|covered| covered.laminate(element));
    let at_point = |(q, gradient): (usize, Tensor<f64>)| {
        let layers = laminate.and_then(|laminate| Some((laminate, laminate.layers(material, gradient)?)));
        let Some((laminate, layers)) = layers else {
            let active = operator.activity.at_point(element[1], q, N)[element[0]];
            return second_stress(material, deformation(gradient), active);
        };
        let covered = second_stress(material, deformation(layers.covered), laminate.load);
        let bare = second_stress(material, deformation(layers.bare), 0.0);
        in_layers(laminate.share, laminate.normal, covered, bare)
    };
    gradients.into_iter().enumerate().map(at_point).collect()
}

/// Returns the coefficient of a laminate with a covered share: w is continuous across its edges, and so is the flow
/// along their normal.
fn in_layers(share: f64, normal: [f64; 2], covered: Tensor<f64>, bare: Tensor<f64>) -> Tensor<f64> {
    let mean = add_scaled(covered.map(|row| row.map(|value| share * value)), 1.0 - share, bare);
    let jump = apply(add_scaled(covered, -1.0, bare), normal);
    let across = |layer: Tensor<f64>| dot(&apply(layer, normal), &normal);
    let stiffness = (1.0 - share) * across(covered) + share * across(bare);
    let factor = -share * (1.0 - share) / stiffness;
    add_scaled(mean, factor, [0, 1].map(|i| [0, 1].map(|k| jump[i] * jump[k])))
}
