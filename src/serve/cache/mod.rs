//! Values that the server keeps in memory between requests: solvers, tables, model errors and store totals.

mod evaluation_columns;
mod lru;
mod model_errors;
mod solvers;
mod tables;
mod totals;

pub use lru::{LruCache, lock};
pub use model_errors::{ModelErrors, score_document};
pub use solvers::{CriticalVoltage, PreparedSolver, SimulationSetup, SolverCache, VoltageLimits};
pub use tables::TableCache;
pub use totals::StoreTotals;
