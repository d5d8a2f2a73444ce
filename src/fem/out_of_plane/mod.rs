//! Motions of a membrane out of its plane: small ones of a flat membrane, and those of a membrane under pressure or
//! under forces on bodies.

mod flat;
mod inflation;
mod lifted;
mod point;
mod surface;

pub(super) use flat::{FlatStability, Lowest, OutOfPlane};
pub use inflation::{Inflated, InflationOutcome, InflationSolver, SpatialMotion};
