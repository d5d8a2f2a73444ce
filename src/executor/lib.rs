//! Where work runs beside this process: workers on other machines, started by an engine that exists (Slurm, or any by a command).
//!
//! A worker is `deaflow worker`; which stages it builds and what it gets for that a [`Profile`] says. [`supervise()`] keeps as many as there
//! is work. Engines start, count and end workers; what has been built the store alone says.

mod command;
mod engine;
mod ledger;
mod profile;
mod slurm;
mod supervise;
mod workers;

pub use command::CommandEngine;
pub use engine::{Engine, EngineError, Request};
pub use ledger::{Array, LEDGER, Ledger, Recipe};
pub use profile::{EngineKind, Profile, Resources, SlurmOptions};
pub use slurm::SlurmEngine;
pub use supervise::{
    Ending, Failed, Standings, Submission, SubmitError, cancel, is_cancelled, report_begun, report_failures,
    report_left, report_trouble, supervise, topic,
};
pub use workers::{SILENT, Seen, Sign, Worker, workers};
