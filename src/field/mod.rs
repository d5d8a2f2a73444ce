//! Displacement fields on the corners of the cells, and the two ways to obtain one: simulate and predict.

mod displacement;
mod simulate;

pub use displacement::{CORNERS, Field, FieldError};
pub use simulate::{Outcome, PredictError, Predictor, Simulation, Simulator};
