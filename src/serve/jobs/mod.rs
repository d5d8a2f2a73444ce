//! Runs of pipelines: the one that the page started, and all that write into the store.

mod runner;
mod running;

pub use runner::Runner;
pub use running::running_jobs;
