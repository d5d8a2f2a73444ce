//! `deaflow worker`: builds the ready stages of a pipeline next to other workers, until everything is built or it is
//! stopped.
//! Batch systems start any number of them.

use std::collections::BTreeSet;
use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use clap::Args;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::arguments::{PipelineArguments, ProgressArguments, duration};
use super::pipeline::load;
use super::progress::RunProgress;
use super::upstream::StoreAccess;
use super::{CliError, Exit, Output, signals, table};
use deaflow_base::{Background, CpuLevel, Pauses, host_name};
use deaflow_executor::{
    Failed, Heartbeat, is_cancelled, report_failures, report_no_work, report_start, report_trouble, topic,
};
use deaflow_orchestrator::{Environment, Outcome, Pipeline, RunOptions, run};
use deaflow_store::{Board, Store, StoreError};

/// The time to stop after a request: batch systems kill a process after some 30 s.
const STOP_TIME: Duration = Duration::from_secs(20);

/// How long a worker of an array waits for work of others: longer than the claims of a dead worker last.
const LINGER: Duration = Duration::from_secs(90);

/// The time between two checks whether the submission was cancelled.
const CANCEL_CHECK: Duration = Duration::from_secs(5);

/// The time between two checks whether to stop.
const PAUSE: Duration = Duration::from_millis(100);

/// The variable of Slurm for the end of a job, s since 1970.
const SLURM_END: &str = "SLURM_JOB_END_TIME";

/// The variable of PBS for the time limit of a job, s.
const PBS_TIME: &str = "PBS_WALLTIME";

/// Build ready stages of a pipeline next to other workers in the same store
#[derive(Debug, Args)]
#[command(after_help = concat!(
    examples!(
        "deaflow worker pipeline.yaml --store /shared/store",
        "deaflow worker pipeline.yaml --stop-before 5min"
    ),
    "\n\nExit codes: 0 everything is built; 75 stopped, or refused by the machine or the disk: start it again; others \
     as for all commands: starting it again does not help."
))]
pub struct WorkerArguments {
    #[command(flatten)]
    of: PipelineArguments,
    /// Build only these chunks of the stage of --until, counted from 0
    #[arg(long, value_name = "FIRST-LAST", requires = "until", value_parser = range)]
    chunks: Option<(usize, usize)>,
    /// Build only this stage, or the stages of this sweep; can be repeated
    #[arg(long = "stage", value_name = "STAGE", conflicts_with = "chunks")]
    stages: Vec<String>,
    /// Refuse processors below this level, so that all workers produce identical bits: any, or x86-64-v3
    #[arg(long, value_name = "LEVEL", value_parser = level)]
    cpu: Option<CpuLevel>,
    /// The job array of this worker, as `deaflow run --executor` names it
    #[arg(long, value_name = "NAME", requires = "topic")]
    array: Option<String>,
    /// The folder for messages of this worker to `deaflow run --executor`
    #[arg(long, value_name = "NAME", requires = "array")]
    topic: Option<String>,
    /// Stop this long before the end of the job
    #[arg(long, value_name = "TIME", value_parser = duration)]
    stop_before: Option<Duration>,
    /// Remaining time of this job [default: from SLURM_JOB_END_TIME or PBS_WALLTIME]
    #[arg(long, value_name = "TIME", value_parser = duration, requires = "stop_before")]
    time: Option<Duration>,
    #[command(flatten)]
    progress: ProgressArguments,
}

pub fn execute(arguments: &WorkerArguments, output: &Output) -> Result<Exit, CliError> {
    let (Some(array), Some(topic)) = (&arguments.array, &arguments.topic) else {
        return build(arguments, None, output);
    };
    // The submitter is told of any error, even if the pipeline cannot be read here.
    let access = open(arguments, output)?;
    let submitter = Submitter {
        array,
        board: access.store().board(topic),
    };
    unless_noted(report_start(&submitter.board, array), output);
    let done = build(arguments, Some((&submitter, &access)), output);
    if let Err(error) = &done {
        submitter.report(&[(None, error)], output);
    }
    done
}

fn open(arguments: &WorkerArguments, output: &Output) -> Result<StoreAccess, CliError> {
    let store = Store::open(&arguments.of.store_folder()).map_err(again)?;
    StoreAccess::open(store, &arguments.of, output)
}

fn build(
    arguments: &WorkerArguments,
    submitted: Option<(&Submitter<'_>, &StoreAccess)>,
    output: &Output,
) -> Result<Exit, CliError> {
    let pipeline = load(&arguments.of)?;
    check_chunks(arguments, &pipeline)?;
    let stages = stages(arguments, &pipeline)?;
    let left = arguments
        .stop_before
        .map(|before| left(arguments.time, before))
        .transpose()?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        signals::set_on(signal, &stop)?;
    }
    check_processor(arguments.cpu)?;
    if submitted.is_some() && arguments.topic != Some(topic(&pipeline, arguments.of.until.as_deref())) {
        return Err(CliError::failure("the pipeline has changed since it was submitted")
            .help("cancel the workers and submit again"));
    }
    let own;
    let access = match submitted {
        Some((_, access)) => access,
        None => {
            own = open(arguments, output)?;
            &own
        }
    };
    let store = access.store();
    let submitter = submitted.map(|(submitter, _)| submitter);
    let array = submitter.map(|submitter| submitter.array);
    let heartbeat = Arc::new(Heartbeat::start(store, &pipeline.name, array));
    let board = submitter.map(|submitter| submitter.board.clone());
    let _watch = watch(&stop, left, store, &heartbeat, board)?;
    let progress = RunProgress::new(arguments.progress.mode(), output.errors());
    let options = RunOptions {
        until: arguments.of.until.as_deref(),
        chunks: arguments.chunks,
        stages: stages.as_ref(),
        // A worker without work frees its place in the queue.
        patience: array.map(|_| LINGER),
        parallel_stages: rayon::current_num_threads(),
        keep_going: true,
        stop: Some(&stop),
        skip_history: true,
        ..RunOptions::default()
    };
    let outcome = run(&pipeline, store, &options, &Environment::system(), &|event| {
        progress.show(event);
    });
    access.end(output, arguments.progress.quiet);
    let outcome = outcome.map_err(|error| CliError::from(error).for_worker())?;
    let errors: Vec<(String, CliError)> = outcome
        .failures
        .into_iter()
        .map(|failure| {
            let error = CliError::from(failure.error).for_worker().of_stage(&failure.stage);
            (failure.stage, error)
        })
        .collect();
    if let Some(submitter) = submitter {
        let named = errors.iter().map(|(stage, error)| (Some(stage.as_str()), error));
        submitter.report(&named.collect::<Vec<_>>(), output);
        if outcome.stages.iter().any(|stage| stage.outcome == Outcome::Left) {
            unless_noted(report_no_work(&submitter.board, submitter.array), output);
        }
    }
    let errors: Vec<CliError> = errors.into_iter().map(|(_, error)| error).collect();
    if output.is_json() {
        output.document(&json!({
            "pipeline": pipeline.name,
            "store": store.root(),
            "stages": outcome.stages,
            "unstable": outcome.unstable,
            "errors": errors.iter().map(CliError::to_json).collect::<Vec<_>>(),
        }))?;
    } else if !arguments.progress.quiet {
        output.text(table::of_run(&outcome.stages))?;
    }
    errors.iter().for_each(|error| output.report(error));
    let permanent = errors.iter().map(CliError::exit).find(|exit| *exit != Exit::TryAgain);
    Ok(match permanent {
        Some(exit) => exit,
        None if errors.is_empty() && !stop.load(Ordering::Relaxed) => Exit::Done,
        None => Exit::TryAgain,
    })
}

/// The process that has started this worker.
struct Submitter<'a> {
    /// The array of the worker.
    array: &'a str,
    /// The board that it reads.
    board: Board,
}

impl Submitter<'_> {
    /// Reports errors; a stop is not reported.
    fn report(&self, errors: &[(Option<&str>, &CliError)], output: &Output) {
        let is_permanent = |error: &CliError| error.exit() != Exit::TryAgain;
        let failed = errors.iter().filter(|(_, error)| is_permanent(error));
        let failed: Vec<Failed> = failed
            .map(|(stage, error)| Failed {
                stage: stage.map(str::to_owned),
                exit: error.exit().code(),
                message: error.message().to_owned(),
            })
            .collect();
        unless_noted(report_failures(&self.board, &failed), output);
        let temporary = errors
            .iter()
            .find(|(_, error)| !is_permanent(error) && error.is_transient());
        if let Some((_, error)) = temporary {
            unless_noted(report_trouble(&self.board, error.message()), output);
        }
    }
}

/// Warns if a note to the submitter could not be written: the work goes on without it.
fn unless_noted(noted: Result<(), StoreError>, output: &Output) {
    if let Err(why) = noted {
        output.warn(format_args!(
            "`deaflow run --executor` is not told about this worker: {why}"
        ));
    }
}

/// An error of the store after which another worker may succeed.
fn again(error: StoreError) -> CliError {
    CliError::from(error).for_worker()
}

fn check_processor(required: Option<CpuLevel>) -> Result<(), CliError> {
    let found = CpuLevel::detect();
    match required {
        Some(required) if found < required => Err(CliError::failure(format!(
            "the processor of {} is below level {}: results would differ in the last bits",
            host_name(),
            required.name()
        ))
        .help("`cpu` of the profile sets the level that all workers need")
        .transient()),
        _ => Ok(()),
    }
}

/// Returns the positions of the stages to build; none for all.
fn stages(arguments: &WorkerArguments, pipeline: &Pipeline) -> Result<Option<BTreeSet<usize>>, CliError> {
    if arguments.stages.is_empty() {
        return Ok(None);
    }
    let mut positions = BTreeSet::new();
    for name in &arguments.stages {
        // This refuses an unknown name.
        pipeline.selection(Some(name))?;
        let sweep = pipeline.sweep(name);
        let is_meant = |stage: &String| stage == name || sweep.is_some_and(|sweep| sweep.stages.contains(stage));
        let named = pipeline
            .stages
            .iter()
            .enumerate()
            .filter(|(_, stage)| is_meant(&stage.name));
        positions.extend(named.map(|(position, _)| position));
    }
    Ok(Some(positions))
}

fn level(word: &str) -> Result<CpuLevel, String> {
    CpuLevel::from_name(word).ok_or_else(|| format!("allowed: {}", CpuLevel::NAMES.join(", ")))
}

/// Refuses chunks of several stages.
fn check_chunks(arguments: &WorkerArguments, pipeline: &Pipeline) -> Result<(), CliError> {
    match (arguments.chunks, arguments.of.until.as_deref()) {
        (Some(_), Some(until)) if pipeline.stage(until).is_none() => Err(CliError::bad_input(format!(
            "--chunks needs a single stage; `{until}` is a sweep"
        ))
        .help("name one of its stages: --until 'STAGE[axis=value]'")),
        _ => Ok(()),
    }
}

/// Returns the time until this worker has to stop.
fn left(time: Option<Duration>, before: Duration) -> Result<Duration, CliError> {
    let seconds = |name: &str| {
        let value = std::env::var(name).ok()?;
        Some(Duration::from_secs(value.trim().parse().ok()?))
    };
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let from_slurm = || Some(seconds(SLURM_END)?.saturating_sub(since));
    let left = time.or_else(from_slurm).or_else(|| seconds(PBS_TIME));
    let left = left.ok_or_else(|| {
        CliError::bad_input("--stop-before needs the end of this job")
            .help(format!("set --time, or run in a job with {SLURM_END} or {PBS_TIME}"))
    })?;
    Ok(left.saturating_sub(before))
}

/// Stops the worker when its time is over, and ends the process if the running work does not stop: only its last piece
/// is lost.
fn watch(
    stop: &Arc<AtomicBool>,
    left: Option<Duration>,
    store: &Store,
    heartbeat: &Arc<Heartbeat>,
    board: Option<Board>,
) -> Result<Background, CliError> {
    let (stop, store, heartbeat) = (stop.clone(), store.clone(), heartbeat.clone());
    if left.is_some_and(|left| left.is_zero()) {
        stop.store(true, Ordering::Relaxed);
    }
    let end = left.and_then(|left| Instant::now().checked_add(left));
    let watch = move |pauses: &Pauses| {
        let mut checked: Option<Instant> = None;
        while !stop.load(Ordering::Relaxed) {
            if !pauses.wait(PAUSE) {
                return;
            }
            if checked.is_none_or(|checked| checked.elapsed() >= CANCEL_CHECK) {
                checked = Some(Instant::now());
                if board.as_ref().is_some_and(is_cancelled) {
                    stop.store(true, Ordering::Relaxed);
                }
            }
            if end.is_some_and(|end| Instant::now() >= end) {
                stop.store(true, Ordering::Relaxed);
            }
        }
        if pauses.wait(STOP_TIME) {
            heartbeat.remove();
            store.leave();
            process::exit(i32::from(Exit::TryAgain.code()));
        }
    };
    Background::start("watch", watch).map_err(|error| CliError::failure(format!("cannot start a thread: {error}")))
}

/// Parses `17-48`.
fn range(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once('-').unwrap_or((text, text));
    match (parts.0.trim().parse(), parts.1.trim().parse()) {
        (Ok(first), Ok(last)) if first <= last => Ok((first, last)),
        _ => Err("expected FIRST-LAST with FIRST ≤ LAST, such as 17-48, or one number".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_chunks_are_read() {
        assert_eq!(range("17-48"), Ok((17, 48)));
        assert_eq!(range("3"), Ok((3, 3)));
        for wrong in ["", "-", "4-3", "-3", "1-2-3", "a-b"] {
            assert!(range(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_is_left_of_a_job_is_its_time_less_what_is_asked_for() {
        let minutes = |n: u64| Duration::from_secs(60 * n);
        assert_eq!(left(Some(minutes(60)), minutes(5)).unwrap(), minutes(55));
        assert_eq!(left(Some(minutes(1)), minutes(5)).unwrap(), minutes(0));
    }
}
