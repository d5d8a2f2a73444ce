//! Displacement fields at the corners of the cells, and the interfaces for simulation and prediction.

mod displacement;
mod feasibility;
mod mesh;
mod observation;
mod outcome_kind;
mod simulate;
mod simulators;
mod states;

pub use displacement::{CHARGE_UNIT, CORNERS, Field, FieldError, REACTION_UNIT, Reactions};
pub use feasibility::Feasibility;
pub use mesh::{Mesh, Order};
pub use observation::{Charged, MESH_OVERESTIMATE, Motion, Observation};
pub use outcome_kind::OutcomeKind;
pub use simulate::{
    Differentiable, Evaluator, NO_FIELD, Outcome, PredictError, Predictor, Simulation, Simulator, WithGradient,
};
pub use simulators::{SharedSimulator, SimulatorError, SimulatorKind, Simulators};
pub use states::{InStates, StateFields, Weighted};
