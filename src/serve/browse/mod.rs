//! Questions about a store and its pipelines.

mod again;
mod artifacts;
mod events;
mod filter;
mod judged;
mod neighbours;
mod page;
mod pick;
mod pipelines;
mod rows;
mod run;
mod runs;

pub use again::again;
pub use artifacts::{artifact, artifacts};
pub use events::events;
pub use judged::{Judgement, judged, prediction};
pub use neighbours::neighbours;
pub use page::page;
pub use pick::arrays;
pub use pipelines::{pipeline, pipelines, plan};
pub use rows::rows;
pub use run::run;
pub use runs::{one_run, runs, status};
