//! Motions of a membrane out of its plane: small ones of a flat membrane, and those of a membrane under pressure or
//! under forces on bodies.

mod adjoint;
mod flat;
mod goals;
mod inflation;
mod leaving;
mod lifted;
mod point;
mod spatial_solver;
mod surface;
mod system;

pub(super) use flat::{FlatStability, Lowest, OutOfPlane};
pub(super) use inflation::{BRACKET, Failure, Given, Search, State, combined};
pub use inflation::{Inflated, InflationOutcome, InflationSolver, Peak, SpatialMotion};
pub use spatial_solver::SpatialSolver;
