//! Factorisation of sparse symmetric matrices.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SupernodalLdltRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, IntranodeLbltRef, LdltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{Argsort, Pair, SparseColMat, SymbolicSparseColMat};
use faer::{Conj, MatMut, Par, Side};

/// The sparsity of a symmetric matrix and a fill-reducing order of its unknowns.
pub struct Sparsity {
    matrix: SymbolicSparseColMat<usize>,
    /// Permutation from the order of assembly to that of the matrix.
    sorting: Argsort<usize>,
    symbolic: SymbolicCholesky<usize>,
}

impl Sparsity {
    /// Creates the sparsity of a matrix with `count` unknowns from its entries on and below the diagonal, which may
    /// repeat; `None` if memory is short.
    #[must_use]
    pub fn new(count: usize, entries: &[Pair<usize, usize>]) -> Option<Self> {
        let (matrix, sorting) = SymbolicSparseColMat::try_new_from_indices(count, count, entries).ok()?;
        let symbolic = order(&matrix, CholeskySymbolicParams::default())?;
        Some(Self {
            matrix,
            sorting,
            symbolic,
        })
    }

    /// Assembles the matrix with these entries, in the order of [`Sparsity::new`]; repeated entries are added. `None`
    /// if memory is short.
    #[must_use]
    pub fn matrix(&self, entries: &[f64]) -> Option<SparseColMat<usize, f64>> {
        SparseColMat::new_from_argsort(self.matrix.clone(), &self.sorting, entries).ok()
    }

    /// Computes LDLᵀ of the matrix with these entries, in the order of [`Sparsity::new`]; repeated entries are added.
    /// `None` if a pivot is exactly zero or memory is short.
    #[must_use]
    pub fn factors(&self, entries: &[f64]) -> Option<Vec<f64>> {
        let matrix = self.matrix(entries)?;
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
        Some(values)
    }

    /// Solves with the factors; overwrites the right side with the solution.
    pub fn solve(&self, factors: &[f64], right: &mut [f64]) {
        let count = right.len();
        let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        LdltRef::new(&self.symbolic, factors).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(right, count, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
    }

    /// Returns the number of negative eigenvalues of the factorised matrix.
    #[must_use]
    pub fn negative_pivots(&self, factors: &[f64]) -> usize {
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(symbolic) => {
                let starts = &symbolic.col_ptr()[..symbolic.ncols()];
                starts.iter().filter(|&&start| factors[start] < 0.0).count()
            }
            SymbolicCholeskyRaw::Supernodal(symbolic) => {
                let factors = SupernodalLdltRef::new(symbolic, factors);
                let negative = |s: usize| {
                    let block = factors.supernode(s).val();
                    (0..block.ncols()).filter(|&i| block[(i, i)] < 0.0).count()
                };
                (0..symbolic.n_supernodes()).map(negative).sum()
            }
        }
    }
}

/// Adds the product of a symmetric matrix and a vector, times a factor. The matrix is given by its entries on and below
/// the diagonal: the starts of its columns, the rows of its entries and their values.
pub fn add_symmetric_product(
    [starts, rows]: [&[usize]; 2],
    values: &[f64],
    factor: f64,
    vector: &[f64],
    out: &mut [f64],
) {
    for (column, range) in starts.windows(2).enumerate() {
        let mut sum = 0.0;
        for at in range[0]..range[1] {
            let (row, value) = (rows[at], values[at]);
            if row == column {
                sum += value * vector[column];
            } else {
                out[row] += factor * value * vector[column];
                sum += value * vector[row];
            }
        }
        out[column] += factor * sum;
    }
}

/// An order of elimination of an indefinite symmetric matrix.
pub struct IndefiniteOrder {
    matrix: SymbolicSparseColMat<usize>,
    symbolic: SymbolicCholesky<usize>,
}

impl IndefiniteOrder {
    /// Creates the order of a matrix given by its entries on and below the diagonal; `None` if memory is short.
    #[must_use]
    pub fn new(matrix: SymbolicSparseColMat<usize>) -> Option<Self> {
        let parameters = CholeskySymbolicParams {
            // Pivots are chosen within dense blocks only.
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..CholeskySymbolicParams::default()
        };
        let symbolic = order(&matrix, parameters)?;
        Some(Self { matrix, symbolic })
    }
}

fn order(matrix: &SymbolicSparseColMat<usize>, parameters: CholeskySymbolicParams) -> Option<SymbolicCholesky<usize>> {
    factorize_symbolic_cholesky(matrix.as_ref(), Side::Lower, SymmetricOrdering::Amd, parameters).ok()
}

/// A factorised indefinite symmetric matrix, with pivots chosen within dense blocks (Bunch and Kaufman, Math. Comp. 31
/// (1977) 163).
pub struct Indefinite<'a> {
    order: &'a IndefiniteOrder,
    values: Vec<f64>,
    below: Vec<f64>,
    forward: Vec<usize>,
    inverse: Vec<usize>,
}

impl<'a> Indefinite<'a> {
    /// Factorises the entries in the order of the matrix of `order`; `None` if memory is short.
    #[must_use]
    pub fn new(order: &'a IndefiniteOrder, entries: Vec<f64>) -> Option<Self> {
        let count = order.matrix.ncols();
        let matrix = SparseColMat::new(order.matrix.clone(), entries);
        let mut factors = Self {
            order,
            values: vec![0.0; order.symbolic.len_val()],
            below: vec![0.0; count],
            forward: vec![0; count],
            inverse: vec![0; count],
        };
        let need = order
            .symbolic
            .factorize_numeric_intranode_lblt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(need).ok()?;
        order.symbolic.factorize_numeric_intranode_lblt(
            &mut factors.values,
            &mut factors.below,
            &mut factors.forward,
            &mut factors.inverse,
            matrix.as_ref(),
            Side::Lower,
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        Some(factors)
    }

    /// Solves; overwrites the right side with the solution.
    pub fn solve(&self, right: &mut [f64]) {
        let symbolic = &self.order.symbolic;
        let permutation = PermRef::new_checked(&self.forward, &self.inverse, right.len());
        let mut memory = MemBuffer::new(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        let count = right.len();
        IntranodeLbltRef::new(symbolic, &self.values, &self.below, permutation).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(right, count, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
    }
}
