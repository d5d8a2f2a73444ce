//! Queries about a store and its pipelines.

mod arrays;
mod artifacts;
mod events;
mod figures;
mod filter;
mod neighbours;
mod pipelines;
mod predictions;
mod resimulate;
mod rows;
mod run;
mod runs;
mod shapes;
mod units;

pub use arrays::arrays;
pub use artifacts::{artifact, artifact_opening, artifacts};
pub use events::events;
pub use figures::figures;
pub use neighbours::neighbours;
pub use pipelines::{pipeline, pipelines, plan, summary};
pub use predictions::{model_errors, prediction};
pub use resimulate::resimulate;
pub use rows::rows;
pub use run::run;
pub use runs::{one_run, opening, runs, status};
pub use shapes::shapes;
