//! The notes in a store through which the workers and submitters of a pipeline inform each other.

use std::time::SystemTime;

use serde::{Deserialize, Serialize};

use super::engine::{Engine, EngineError};
use super::ledger::{LEDGER, Ledger};
use deaflow_base::{Digest, host_name};
use deaflow_orchestrator::Pipeline;
use deaflow_store::{Board, StoreError};

/// Prefix of notes of failures.
pub const FAILED: &str = "failed-";

/// The note on why a worker that will be restarted has ended.
pub const TROUBLE: &str = "trouble";

/// The note that everything is cancelled.
pub const CANCELLED: &str = "cancelled";

/// Prefix of notes of workers that have started; the name of the array follows.
pub const BEGAN: &str = "began-";

/// Prefix of notes of arrays whose workers found only stages that others are building.
pub const LEFT: &str = "left-";

/// A stage that a worker could not build.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failed {
    /// The stage, if the failure is that of a stage.
    pub stage: Option<String>,
    /// The exit code of the worker.
    pub exit: u8,
    /// The error message.
    pub message: String,
}

/// Returns the topic of the notes of a pipeline. It depends on the stages, not on the path of the file.
#[must_use]
pub fn topic(pipeline: &Pipeline, until: Option<&str>) -> String {
    let mut text = format!("{}\n{}\n", pipeline.name, until.unwrap_or_default());
    for stage in &pipeline.stages {
        let parameters = Digest::of(stage.stage().parameters().to_string().as_bytes());
        text += &format!("{} {} {parameters}\n", stage.name, stage.kind.name());
    }
    Digest::of(text.as_bytes()).short()
}

/// Reports the stages that a worker could not build.
///
/// # Errors
/// If a note cannot be written.
pub fn report_failures(board: &Board, failures: &[Failed]) -> Result<(), StoreError> {
    for failed in failures {
        let stage = failed.stage.as_deref().unwrap_or_default();
        board.write(&format!("{FAILED}{}", Digest::of(stage.as_bytes()).short()), failed)?;
    }
    Ok(())
}

/// Reads the reported failures.
///
/// # Errors
/// If a note cannot be read.
pub fn failures(board: &Board) -> Result<Vec<Failed>, StoreError> {
    let names = board.names(FAILED)?;
    let failures = names.iter().map(|name| board.read(name));
    let failures: Vec<Option<Failed>> = failures.collect::<Result<_, _>>()?;
    Ok(failures.into_iter().flatten().collect())
}

/// Reports why a worker must be restarted.
///
/// # Errors
/// If the note cannot be written.
pub fn report_trouble(board: &Board, message: &str) -> Result<(), StoreError> {
    board.write(TROUBLE, &message)
}

/// Reports that a worker of an array has started.
///
/// # Errors
/// If the note cannot be written.
pub fn report_start(board: &Board, array: &str) -> Result<(), StoreError> {
    let since = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap_or_default();
    let own = format!("{}-{}-{:x}", host_name(), std::process::id(), since.as_nanos());
    board.write(&format!("{BEGAN}{array}-{}", Digest::of(own.as_bytes()).short()), &true)
}

/// Reports that a worker of an array found only stages that others are building: that it built nothing is then no
/// failure.
///
/// # Errors
/// If the note cannot be written.
pub fn report_no_work(board: &Board, array: &str) -> Result<(), StoreError> {
    board.write(&format!("{LEFT}{array}"), &true)
}

/// Whether a submission has been cancelled.
#[must_use]
pub fn is_cancelled(board: &Board) -> bool {
    board.has(CANCELLED)
}

/// Cancels everything that was submitted for a pipeline by any process. Returns the number of arrays, or why the engine
/// could not cancel them.
///
/// # Errors
/// If a note cannot be read or written.
pub fn cancel(board: &Board, engine: &dyn Engine) -> Result<Result<usize, EngineError>, StoreError> {
    let mut ledger: Ledger = board.read(LEDGER)?.unwrap_or_default();
    // The note comes first, so that the leading submitter starts no more workers and those that the engine cannot
    // cancel stop by themselves. If it cannot be written, the workers are cancelled anyway.
    let noted = board.write(CANCELLED, &true);
    let cancelled = cancel_arrays(&ledger, engine);
    noted?;
    if cancelled.is_ok()
        && let Some(_lead) = board.try_lock()?
    {
        ledger.end_all();
        board.write(LEDGER, &ledger)?;
    }
    Ok(cancelled)
}

/// Has the engine cancel all arrays that may have workers; returns their number.
///
/// # Errors
/// If the engine refuses or does not answer.
pub fn cancel_arrays(ledger: &Ledger, engine: &dyn Engine) -> Result<usize, EngineError> {
    let active: Vec<(&str, Option<&str>)> = ledger
        .active()
        .map(|array| (array.name.as_str(), array.number.as_deref()))
        .collect();
    match active.as_slice() {
        [] => Ok(0),
        active => engine.cancel(active).map(|()| active.len()),
    }
}
