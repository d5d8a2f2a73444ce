//! The simulation of membranes: finite elements on the prestretched configuration.
//!
//! All quantities are dimensionless: stress is divided by μλp², lengths by the side of an element. So two numbers
//! describe a scene, a = λp⁻⁶ and b = κλp² with κ = ε(V/H)²/μ; for unequal prestretch, λp is √(λ₁λ₂) as described in
//! [`grid`]. The modules follow the method, from the point to the result: kinematics, energy and effects; sheet,
//! fitted, grid, rigid, supports, gauge, boundary, element, layout, sampling and lanes; coverage, laminate and
//! laminates; operator; gemm, modes and precondition; krylov, work, newton, direct and dynamic_stiffness; eigenvalue,
//! stability and continuation; solver, and on it geometry, accurate, adjoint, cells, response, margin, path, points,
//! fully_active, critical, limit, observable, gradient_evaluator, safety_margins and reactions; evaluator, which
//! implements the traits of `field`; simulators and screening.

mod accurate;
pub mod activity;
mod adjoint;
mod boundary;
mod capacitance;
mod cell_transform;
mod cells;
mod charge;
mod columns;
mod continuation;
mod coverage;
mod critical;
mod direct;
mod driven_charge;
mod dynamic_stiffness;
pub mod effects;
mod eigenvalue;
mod element;
pub mod energy;
mod error;
mod evaluator;
mod fitted;
mod fully_active;
mod gauge;
mod gemm;
mod geometry;
mod gradient_evaluator;
pub mod grid;
mod kernels;
pub mod kinematics;
mod krylov;
mod laminate;
mod laminates;
pub mod lanes;
pub mod layout;
mod limit;
mod line_transform;
mod margin;
mod mass;
pub mod material;
mod memory;
mod modes;
mod newton;
mod observable;
pub mod operator;
mod out_of_plane;
mod path;
mod points;
mod powers;
mod precision;
pub mod precondition;
mod reactions;
mod rectangle;
pub mod registers;
mod release;
mod response;
mod rigid;
mod safety_margins;
mod sampling;
pub mod screening;
pub mod sheet;
mod side_transform;
mod simulators;
mod solver;
mod stability;
mod stored;
mod supports;
mod time;
mod work;

pub use accurate::{AccurateSimulation, AccurateSolver};
pub use cells::wrinkled_fraction;
pub use critical::{CriticalVoltage, MeshLimit};
pub use error::SetupError;
pub use evaluator::{
    CellStates, GeometryErrors, MeshRequest, Method, SolvedOnce, Solver, SolverParameters, UnknownMethod, check_leads,
    geometry_revision, revision_of,
};
pub use fully_active::{FIRST_UNSTABLE, MOST_UNSTABLE, fully_active_limit, no_pattern_limit};
pub use geometry::GeometryError;
pub use gradient_evaluator::GradientEvaluator;
pub use laminates::check_covered_cells;
pub use limit::CriticalSearch;
pub use margin::StabilityReport;
pub use observable::{CellState, Tension, cell_states};
pub use out_of_plane::{Inflated, InflationOutcome, InflationSolver, Peak, SpatialMotion, SpatialSolver};
pub use path::{
    EventKind, InflationPath, InflationPathSolver, InflationPoint, LoadPath, NoPath, Observe, PathEnd, PathEvent,
    PathParameter, PathPoint, PathSolver, SideState,
};
pub use points::Weights;
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
