//! Displacement fields on the corners of the cells, and the two ways to obtain one: simulate and predict.

mod displacement;
mod feasibility;
mod observation;
mod simulate;

pub use displacement::{CORNERS, Field, FieldError};
pub use feasibility::Feasibility;
pub use observation::Observation;
pub use simulate::{Differentiable, Outcome, PredictError, Predictor, Simulation, Simulator, WithGradient};
