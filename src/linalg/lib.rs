//! Dense and sparse linear algebra: the functions of `faer` that deaflow uses.
//!
//! The functions of `faer` are generic, so every calling crate compiles them again for each register width. Here they
//! are compiled once: other crates call these functions, and use only the storage types of `faer` (see [`Mat`]).
//!
//! All functions run on one thread, so results are identical for any number of threads.

mod dense;
mod product;
mod sparse;

pub use dense::{Eigen, cholesky, eigen, inverse, inverse_definite, solve, solve_definite, solve_lower};
pub use faer::sparse::{Pair, SparseColMat, SymbolicSparseColMat};
pub use faer::{Accum, Mat, MatMut, MatRef};
pub use product::{product, product_into};
pub use sparse::{Indefinite, IndefiniteOrder, Sparsity, add_symmetric_product};
