//! A submission: its input, its state and its end.

use std::sync::atomic::AtomicBool;

use super::engine::{Engine, EngineError};
use super::ledger::SubmitOptions;
use super::notes::Failed;
use super::profile::Profile;
use deaflow_orchestrator::{Pipeline, RunError, StageProgress};
use deaflow_store::{Store, StoreError};

/// A submission.
pub struct Submission<'a> {
    /// The pipeline to build.
    pub pipeline: &'a Pipeline,
    /// The store.
    pub store: &'a Store,
    /// The resources of the workers.
    pub profile: &'a Profile,
    /// The engine that starts workers.
    pub engine: &'a dyn Engine,
    /// The command line of a worker, without its stages and its array.
    pub worker: &'a [String],
    /// The options with which another submitter can continue it.
    pub options: SubmitOptions,
    /// Cancels everything once it is set.
    pub cancel: &'a AtomicBool,
    /// Whether to return once workers have been submitted.
    pub once: bool,
    /// Whether it only continues what another process has submitted; cancelled work then stays cancelled.
    pub is_continuation: bool,
}

/// The state of a submission.
pub struct SubmissionStatus<'a> {
    /// The progress of its stages.
    pub stages: &'a [StageProgress],
    /// Number of workers that are queued or running, as far as is known.
    pub workers: u32,
    /// The last error of the engine or the store.
    pub trouble: Option<&'a str>,
    /// Whether another submitter leads.
    pub follows: bool,
}

/// How a submission ended.
#[derive(Debug)]
pub enum Ending {
    /// Everything is built.
    Done,
    /// These arrays were submitted; nothing else was requested.
    Submitted(Vec<String>),
    /// Another submitter continues these arrays, and this one does not wait for it.
    Left(Vec<String>),
    /// The engine refused the workers at the only attempt.
    Refused(String),
    /// Some stages cannot be built.
    Failed(Vec<Failed>),
    /// It was cancelled, here or by another process; the error if not all workers could be cancelled.
    Cancelled(Option<EngineError>),
    /// Workers end repeatedly without building anything: the stages, and the last error message.
    GivenUp(Vec<String>, Option<String>),
}

/// Why a submission cannot continue.
#[derive(Debug, thiserror::Error)]
pub enum SubmitError {
    /// An error of the pipeline or the store.
    #[error(transparent)]
    Run(#[from] RunError),
    /// An error of the store.
    #[error(transparent)]
    Store(#[from] StoreError),
}
