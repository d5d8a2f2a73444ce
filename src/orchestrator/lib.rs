//! Reads a pipeline, determines which stages are stale, and builds only those. Knows stages, keys and chunks, but no
//! physics.

mod build;
mod build_chunks;
mod built_stages;
mod cost_estimate;
mod declaration;
mod entry;
mod event;
mod execution;
mod explain;
mod graph;
mod kind;
mod lock_difference;
mod locked;
mod plan;
mod plan_warnings;
mod planner;
mod price;
mod provenance;
mod reserve;
mod rounds;
mod run;
mod run_error;
mod run_history;
mod scene_from;
mod scheduler;
mod schema;
mod scratch;
mod spec;
mod stage_progress;
mod stage_work;
mod staleness;
mod sweep;
mod time_shares;
mod without;

pub use built_stages::{BuiltStage, BuiltStages, built_stages};
pub use declaration::StageDeclaration;
pub use entry::{Registry, suggestion};
pub use event::{Event, Listener, Outcome, StageReport};
pub use execution::Failure;
pub use explain::{Explanation, LastRun, explain};
pub use kind::{Cause, Chunk, Expectation, Input, Job, Kind, Needs, Plan, ResultSource, Stage, StageCheck, StageError};
pub use lock_difference::LockDifference;
pub use plan::{plan, plan_document, price_total};
pub use plan_warnings::plan_warnings;
pub use price::{Estimate, Price, PriceTotal};
pub use provenance::Environment;
pub use rounds::Rounds;
pub use run::{RunOptions, RunOutcome, check_locked, run};
pub use run_error::RunError;
pub use schema::{pipeline_schema, scene_schema};
pub use scratch::Scratch;
pub use spec::{Pipeline, StageSpec, file_of, splice_scene, with_scene_file};
pub use stage_progress::{Readiness, StageProgress, stage_progress};
pub use staleness::{Staleness, as_set, is_digest, is_filled, is_of_users, with_short_digest};
pub use sweep::{MANY_STAGES, MOST_STAGES, Sweep, axes_in};
pub use without::{WITHOUT, names_stage};

#[cfg(test)]
mod tests;
