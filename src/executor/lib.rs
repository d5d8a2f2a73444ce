//! Runs stages on other machines: workers that an engine starts, which is Slurm or any other by a command.
//!
//! A worker is `deaflow worker`. A [`Profile`] says which resources the workers of each stage get. [`supervise()`]
//! keeps as many workers running as there is work. Engines start, count and end workers; only the store says what is
//! built.

mod command;
mod engine;
mod ledger;
mod notes;
mod profile;
mod slurm;
mod submission;
mod supervise;
mod workers;

pub use command::CommandEngine;
pub use engine::{Engine, EngineError, Request};
pub use ledger::{Array, LEDGER, Ledger, SubmitOptions};
pub use notes::{Failed, cancel, is_cancelled, report_failures, report_no_work, report_start, report_trouble, topic};
pub use profile::{EngineKind, Profile, Resources, SlurmOptions};
pub use slurm::SlurmEngine;
pub use submission::{Ending, Submission, SubmissionStatus, SubmitError};
pub use supervise::supervise;
pub use workers::{HEARTBEAT_TIMEOUT, Heartbeat, Seen, Worker, workers};
