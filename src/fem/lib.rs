//! The simulation of membranes: finite elements on the prestretched configuration.
//!
//! Energies, grids, the operator and its preconditioner, and units, are those of [`deaflow_element`], whose modules are
//! re-exported. The modules follow the method: effects; work, newton, direct and dynamic_stiffness; eigenvalue,
//! stability and continuation; solver, and on it geometry, accurate, adjoint, cells, response, margin, path, points,
//! fully_active, critical, limit, observable, gradient_evaluator, safety_margins and reactions; evaluator, which
//! implements the traits of `field`; simulators and screening.

mod accurate;
mod adjoint;
mod cells;
mod charge;
mod continuation;
mod critical;
mod direct;
mod driven_charge;
mod dynamic_stiffness;
pub mod effects;
mod eigenvalue;
mod evaluator;
mod fully_active;
mod geometry;
mod gradient_evaluator;
mod limit;
mod margin;
mod newton;
mod observable;
mod out_of_plane;
mod path;
mod points;
mod reactions;
mod release;
mod response;
mod safety_margins;
pub mod screening;
mod simulators;
mod solver;
mod stability;
mod time;
mod work;

pub use deaflow_element::{
    activity, energy, grid, kinematics, lanes, layout, material, operator, precondition, registers, sheet,
};
use deaflow_element::{
    boundary, composition, coverage, element, error, gauge, krylov, laminate, laminates, mass, memory, rigid, sampling,
    stored, supports,
};

pub use accurate::{AccurateSimulation, AccurateSolver};
pub use cells::wrinkled_fraction;
pub use critical::{CriticalVoltage, MeshLimit};
pub use deaflow_element::error::SetupError;
pub use deaflow_element::laminates::check_covered_cells;
pub use deaflow_element::sampling::Weights;
pub use evaluator::{
    CellStates, GeometryErrors, MeshRequest, Method, SolvedOnce, Solver, SolverParameters, UnknownMethod, check_leads,
    geometry_revision, revision_of,
};
pub use fully_active::{FIRST_UNSTABLE, MOST_UNSTABLE, fully_active_limit, no_pattern_limit};
pub use geometry::GeometryError;
pub use gradient_evaluator::GradientEvaluator;
pub use limit::CriticalSearch;
pub use margin::StabilityReport;
pub use observable::{CellState, Tension, cell_states};
pub use out_of_plane::{Inflated, InflationOutcome, InflationSolver, Peak, SpatialMotion, SpatialSolver};
pub use path::{
    EventKind, InflationPath, InflationPathSolver, InflationPoint, LoadPath, NoPath, Observe, PathEnd, PathEvent,
    PathParameter, PathPoint, PathSolver, SideState,
};
pub use response::{Estimator, LinearResponse};
pub use safety_margins::SafetyMargins;
pub use simulators::SceneSimulators;
pub use solver::{MembraneSolver, MeshSolution, SolveOptions};
pub use time::{
    AccurateHistory, AtFrequency, FrequencyResponse, FrequencySolver, History, HistoryOptions, HistoryRequest,
    HistorySolver, Instant, MOST_MODES, StepEstimate, StepEstimates, Swing, ThreeSolves, Transverse, USUAL_TIME_ERROR,
    Vibration, at_bias, at_peak, creep_settings, history_check,
};
pub use work::{DEFAULT_SECONDS, WorkLimit};

#[cfg(test)]
mod tests;
