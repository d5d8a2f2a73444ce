//! Dense and sparse linear algebra: what deaflow uses of `faer`.
//!
//! The functions of `faer` are generic, so each crate that calls them compiles them again, for every register width. Here they are compiled
//! once: other crates call these functions, and use only the storage types of `faer` (see [`Mat`]).
//!
//! Everything runs on one thread, so that results are the same bits for any number of threads.

mod dense;
mod product;
mod sparse;

pub use dense::{Eigen, cholesky, eigen, inverse, inverse_definite, solve, solve_definite, solve_lower};
pub use faer::sparse::{Pair, SparseColMat, SymbolicSparseColMat};
pub use faer::{Accum, Mat, MatMut, MatRef};
pub use product::{product, product_into};
pub use sparse::{Indefinite, IndefiniteOrder, Sparsity};
