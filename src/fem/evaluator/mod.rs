//! The solver behind the traits of `field`: methods, declared parameters and construction.

mod method;
mod parameters;
mod solver;

pub use method::{Method, UnknownMethod};
pub use parameters::{MeshRequest, SolverParameters, revision_of};
pub(crate) use solver::last_state;
pub use solver::{CellStates, Solver, check_leads};
