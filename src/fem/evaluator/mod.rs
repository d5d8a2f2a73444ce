//! The solver behind the traits of `field`: methods, declared parameters and construction.

mod geometry_error;
mod method;
mod parameters;
mod solver;

pub use geometry_error::{GeometryErrors, SolvedOnce};
pub use method::{Method, UnknownMethod};
pub use parameters::{MeshRequest, SolverParameters, geometry_revision, revision_of};
pub(crate) use solver::last_state;
pub use solver::{CellStates, Solver, check_leads};
