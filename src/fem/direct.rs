//! The assembled tangent, factorised: the robust path beside conjugate gradients, and the judge of stability.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::supernodal::SupernodalLdltRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{Argsort, Pair, SparseColMat, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par, Side};

use super::element::{Bilinear, Biquadratic, Element};
use super::energy::Material;
use super::kinematics::Tensor;
use super::layout::NodeLayout;
use super::operator::{Operator, from_rest, on_sides, per_side};
use crate::field::Order;

/// Where the entries of the tangent stand, and an order of the unknowns in which its factors stay sparse: the same for all
/// tangents of a grid.
pub struct Structure {
    layout: NodeLayout,
    matrix: SymbolicSparseColMat<usize>,
    /// From the order of assembly to that of the matrix.
    sorting: Argsort<usize>,
    symbolic: SymbolicCholesky<usize>,
}

impl Structure {
    /// The structure of a grid; `None` when memory is short.
    pub fn new(layout: NodeLayout) -> Option<Arc<Self>> {
        let mut pairs = Vec::new();
        let mut collect = |i: usize, k: usize| pairs.push(Pair::new(i, k));
        match layout.degree() {
            1 => for_each_entry::<4>(layout, |_, rows, k| rows.for_each(|(_, i)| collect(i, k))),
            _ => for_each_entry::<9>(layout, |_, rows, k| rows.for_each(|(_, i)| collect(i, k))),
        }
        let [columns, rows] = layout.nodes().map(|nodes| nodes - 2);
        let count = 2 * columns * rows;
        let (matrix, sorting) = SymbolicSparseColMat::try_new_from_indices(count, count, &pairs).ok()?;
        let symbolic = factorize_symbolic_cholesky(
            matrix.as_ref(),
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams::default(),
        )
        .ok()?;
        Some(Arc::new(Self {
            layout,
            matrix,
            sorting,
            symbolic,
        }))
    }

    /// The factors of the tangent at `u`; `None` when a pivot is exactly zero or memory is short.
    pub fn factorise<L: Material>(self: &Arc<Self>, operator: &Operator<'_, L>, u: &[f64]) -> Option<Factorisation> {
        let entries = match operator.activity.grid().order() {
            Order::Bilinear => assemble::<Bilinear, L, 4>(operator, u),
            Order::Biquadratic => assemble::<Biquadratic, L, 9>(operator, u),
        };
        let matrix = SparseColMat::new_from_argsort(self.matrix.clone(), &self.sorting, &entries).ok()?;
        let mut values = vec![0.0; self.symbolic.len_val()];
        let need = self
            .symbolic
            .factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(need).ok()?;
        self.symbolic
            .factorize_numeric_ldlt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LdltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .ok()?;
        Some(Factorisation {
            structure: Arc::clone(self),
            values,
        })
    }
}

/// LDLᵀ of the tangent at the interior nodes, in a fill-reducing order.
pub struct Factorisation {
    structure: Arc<Structure>,
    values: Vec<f64>,
}

impl Factorisation {
    /// The tangent at `u`; `None` when a pivot is exactly zero or memory is short.
    #[cfg(test)]
    pub fn new<L: Material>(operator: &Operator<'_, L>, u: &[f64]) -> Option<Self> {
        Structure::new(operator.layout())?.factorise(operator, u)
    }

    /// How many eigenvalues of the tangent are negative.
    #[must_use]
    pub fn negative_pivots(&self) -> usize {
        match self.structure.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                let starts = &symbolic.col_ptr()[..symbolic.ncols()];
                starts.iter().filter(|&&start| self.values[start] < 0.0).count()
            }
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                let factors = SupernodalLdltRef::new(symbolic, &self.values);
                let negative = |s: usize| {
                    let block = factors.supernode(s).val();
                    (0..block.ncols()).filter(|&i| block[(i, i)] < 0.0).count()
                };
                (0..symbolic.n_supernodes()).map(negative).sum()
            }
        }
    }

    /// Solves with the factors: `r` is a residual, the result a displacement, both zero on the frame.
    #[must_use]
    pub fn solve(&self, r: &[f64]) -> Vec<f64> {
        let Structure { layout, symbolic, .. } = &*self.structure;
        let places = unknowns(*layout);
        let mut packed: Vec<f64> = places.iter().map(|&at| r[at]).collect();
        let count = packed.len();
        let mut memory = MemBuffer::new(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        LdltRef::new(symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut packed, count, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        let mut solution = vec![0.0; layout.vector_len()];
        places.iter().zip(packed).for_each(|(&at, value)| solution[at] = value);
        solution
    }
}

/// Where the unknowns lie in a vector: interior nodes row by row, both components together.
fn unknowns(layout: NodeLayout) -> Vec<usize> {
    let [columns, rows] = layout.nodes().map(|nodes| 1..nodes - 1);
    let nodes = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
    nodes
        .flat_map(|(column, row)| [0, 1].map(|c| layout.index(c, column, row)))
        .collect()
}

/// The number of an unknown; `None` on the frame.
fn number(layout: NodeLayout, c: usize, column: usize, row: usize) -> Option<usize> {
    let [columns, rows] = layout.nodes().map(|nodes| 1..nodes - 1);
    (columns.contains(&column) && rows.contains(&row)).then(|| 2 * ((row - 1) * columns.len() + column - 1) + c)
}

/// Visits the columns of the element matrices in the order of assembly: `visit` takes the element (column, row) with the
/// component and node of the column, the entries on and below the diagonal as (position among the forces of the element,
/// row of the matrix), and the column of the matrix.
fn for_each_entry<const N: usize>(
    layout: NodeLayout,
    mut visit: impl FnMut(([usize; 2], usize, usize), &mut dyn Iterator<Item = (usize, usize)>, usize),
) {
    let degree = layout.degree();
    let side = degree + 1;
    for [column, row] in layout.each_element() {
        let place = |node: usize| (column * degree + node % side, row * degree + node / side);
        let numbers: [[Option<usize>; N]; 2] =
            std::array::from_fn(|c| std::array::from_fn(|node| number(layout, c, place(node).0, place(node).1)));
        for (c, node) in (0..2 * N).map(|i| (i / N, i % N)) {
            let Some(k) = numbers[c][node] else { continue };
            let all = numbers.as_flattened().iter().enumerate();
            let mut below = all.filter_map(|(at, i)| i.filter(|&i| i >= k).map(|i| (at, i)));
            visit(([column, row], c, node), &mut below, k);
        }
    }
}

/// The entries of the tangent in the order of [`for_each_entry`].
fn assemble<E: Element<N>, L: Material, const N: usize>(operator: &Operator<'_, L>, u: &[f64]) -> Vec<f64> {
    let (layout, grid) = (operator.layout(), operator.activity.grid());
    let side = E::DEGREE + 1;
    let units = unit_gradients::<E, N>();
    let mut entries = Vec::new();
    let mut gradients = [[[0.0; 2]; 2]; N];
    let mut current = None;
    for_each_entry::<N>(layout, |([column, row], c, node), rows, _| {
        let sides = grid.sides([column, row]);
        if current.replace([column, row]) != Some([column, row]) {
            let place = |node: usize| (column * E::DEGREE + node % side, row * E::DEGREE + node / side);
            let value = |c, node| u[layout.index(c, place(node).0, place(node).1)];
            gradients = E::gradients(&std::array::from_fn(|c| std::array::from_fn(|node| value(c, node))));
            per_side(&mut gradients, sides);
            from_rest(&mut gradients, grid.rest());
        }
        let mut changes = units[c][node];
        per_side(&mut changes, sides);
        let active = operator.activity.elements()[row * layout.part() + column];
        let mut stresses = std::array::from_fn(|q| operator.material.tangent(gradients[q], active, changes[q]));
        on_sides(&mut stresses, sides);
        let forces = E::forces(&stresses);
        entries.extend(rows.map(|(at, _)| forces[at / N][at % N]));
    });
    entries
}

/// ∇u at the points of an element for a unit displacement of each node, `[component][node][point]`.
fn unit_gradients<E: Element<N>, const N: usize>() -> [[[Tensor<f64>; N]; N]; 2] {
    std::array::from_fn(|c| {
        std::array::from_fn(|node| {
            let mut unit = [[0.0; N]; 2];
            unit[c][node] = 1.0;
            E::gradients(&unit)
        })
    })
}
