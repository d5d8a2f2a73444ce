//! Knows stages, keys and chunks, and no physics: reads a pipeline, decides what is stale, builds that and no more.

mod build;
mod built;
mod cost_estimate;
mod difference;
mod entry;
mod event;
mod execute;
mod explain;
mod foresight;
mod graph;
mod kind;
mod locked;
mod plan;
mod planner;
mod price;
mod provenance;
mod reserve;
mod rounds;
mod schema;
mod scratch;
mod shares;
mod spec;
mod staleness;
mod standing;
mod sweep;
mod work;

pub use built::{Built, BuiltStage, built};
pub use difference::Difference;
pub use entry::{Registry, suggestion};
pub use event::{Event, Listener, Outcome, StageReport};
pub use execute::{Failure, RunError, RunOptions, RunOutcome, check_locked, run};
pub use explain::{Explanation, Last, explain};
pub use foresight::foreseen;
pub use kind::{Chunk, Expectation, Foreseeable, Foreseen, Input, Job, Kind, Needs, Plan, Stage, StageError, Whose};
pub use plan::{bill, plan, plan_document};
pub use price::{Bill, Estimate, Price};
pub use provenance::Environment;
pub use rounds::Rounds;
pub use schema::{of_pipeline, of_scene};
pub use scratch::Scratch;
pub use spec::{Pipeline, StageSpec, file_of, splice_scene};
pub use staleness::{Staleness, as_set, is_filled};
pub use standing::{Standing, Stands, standings};
pub use sweep::{MANY_STAGES, MOST_STAGES, Sweep};

#[cfg(test)]
mod tests;
