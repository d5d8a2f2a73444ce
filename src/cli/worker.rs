//! `deaflow worker`: builds what is ready in a pipeline beside other workers, until everything is there or it is told to stop. It is
//! what a batch system starts, as often as it likes.

use std::collections::BTreeSet;
use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use clap::Args;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::arguments::{PROGRESS, PipelineArguments, duration};
use super::error::CliError;
use super::examples::examples;
use super::output::{Exit, Output};
use super::progress::RunProgress;
use super::run::{ProgressForm, load};
use super::upstream::Reading;
use super::{signals, table};
use deaflow_base::{Background, CpuLevel, Pauses, host_name};
use deaflow_executor::{Failed, Sign, is_cancelled, report_begun, report_failures, report_left, report_trouble, topic};
use deaflow_orchestrator::{Environment, Outcome, Pipeline, RunOptions, run};
use deaflow_store::{Board, Store, StoreError};

/// Batch systems kill what has not ended some 30 s after they have asked it to.
const PATIENCE: Duration = Duration::from_secs(20);

/// A worker of an array waits so long for what others build: longer than a dead one keeps what it has claimed.
const LINGER: Duration = Duration::from_secs(90);

/// Between two looks at whether its submission was cancelled.
const LOOK: Duration = Duration::from_secs(5);

/// Between two looks at whether it was asked to stop.
const PAUSE: Duration = Duration::from_millis(100);

/// When a job has to end, s since 1970, as Slurm says it.
const SLURM_END: &str = "SLURM_JOB_END_TIME";

/// How long a job may take, s, as PBS says it.
const PBS_TIME: &str = "PBS_WALLTIME";

/// Build what is ready in a pipeline, beside other workers in the same store
#[derive(Debug, Args)]
#[command(
    after_help = concat!(examples!("deaflow worker pipeline.yaml --store /shared/store", "deaflow worker pipeline.yaml --stop-before 5min"), "\n\nExit codes: 0 everything is there; 75 stopped, or the machine or the disk refused: start it again; others as \
                        everywhere: to start it again does not help.")
)]
pub struct WorkerArguments {
    #[command(flatten)]
    of: PipelineArguments,
    /// Of the stage of --until build these chunks alone, from the first to the last, counted from 0
    #[arg(long, value_name = "FIRST-LAST", requires = "until", value_parser = range)]
    chunks: Option<(usize, usize)>,
    /// Build these stages, or those of a sweep, and leave all others to other workers
    #[arg(long = "stage", value_name = "STAGE", conflicts_with = "chunks")]
    stages: Vec<String>,
    /// Refuse a processor that can do less, so that all workers agree to the last bit: any, or x86-64-v3
    #[arg(long, value_name = "LEVEL", value_parser = level)]
    cpu: Option<CpuLevel>,
    /// The array that it was started in by `deaflow run --executor`, which is told what becomes of it
    #[arg(long, value_name = "NAME", requires = "topic")]
    array: Option<String>,
    /// Where `deaflow run --executor` is told
    #[arg(long, value_name = "NAME", requires = "array")]
    topic: Option<String>,
    /// Stop so long before the job has to end
    #[arg(long, value_name = "TIME", value_parser = duration)]
    stop_before: Option<Duration>,
    /// How long this job may take from now on [default: as SLURM_JOB_END_TIME or PBS_WALLTIME says]
    #[arg(long, value_name = "TIME", value_parser = duration, requires = "stop_before")]
    time: Option<Duration>,
    /// Say nothing but warnings and errors
    #[arg(short, long, help_heading = PROGRESS)]
    quiet: bool,
    /// How progress is shown on stderr [default: bars on a terminal, or else plain lines]
    #[arg(long, value_enum, value_name = "HOW", conflicts_with = "quiet", help_heading = PROGRESS)]
    progress: Option<ProgressForm>,
}

pub fn execute(arguments: &WorkerArguments, output: &Output) -> Result<Exit, CliError> {
    let (Some(array), Some(topic)) = (&arguments.array, &arguments.topic) else {
        return build(arguments, None, output);
    };
    // Who waits for it is told of whatever it finds, be it that the pipeline cannot be read here.
    let reading = open(arguments, output)?;
    let submitter = Submitter {
        array,
        board: reading.store().board(topic),
    };
    report_begun(&submitter.board, array).map_err(again)?;
    let done = build(arguments, Some((&submitter, &reading)), output);
    if let Err(error) = &done {
        submitter.tell(&[(None, error)])?;
    }
    done
}

fn open(arguments: &WorkerArguments, output: &Output) -> Result<Reading, CliError> {
    let store = Store::open(&arguments.of.store_folder()).map_err(again)?;
    arguments.of.read(store, output)
}

fn build(
    arguments: &WorkerArguments,
    submitted: Option<(&Submitter<'_>, &Reading)>,
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
        signals::heed(signal, &stop)?;
    }
    check_processor(arguments.cpu)?;
    if submitted.is_some() && arguments.topic != Some(topic(&pipeline, arguments.of.until.as_deref())) {
        return Err(
            CliError::failure("the pipeline has been changed since it was submitted")
                .help("cancel what was submitted, and run it anew"),
        );
    }
    let own;
    let reading = match submitted {
        Some((_, reading)) => reading,
        None => {
            own = open(arguments, output)?;
            &own
        }
    };
    let store = reading.store();
    let submitter = submitted.map(|(submitter, _)| submitter);
    let array = submitter.map(|submitter| submitter.array);
    let sign = Arc::new(Sign::show(store, &pipeline.name, array).map_err(again)?);
    let board = submitter.map(|submitter| submitter.board.clone());
    let _watch = watch(&stop, left, store, &sign, board)?;
    let progress = RunProgress::new(
        ProgressForm::shown(arguments.progress, arguments.quiet),
        output.beside(),
    );
    let options = RunOptions {
        until: arguments.of.until.as_deref(),
        chunks: arguments.chunks,
        stages: stages.as_ref(),
        // Who was started for work that is not there any more gives its place back.
        patience: array.map(|_| LINGER),
        parallel_stages: rayon::current_num_threads(),
        keep_going: true,
        stop: Some(&stop),
        skip_history: true,
        ..RunOptions::default()
    };
    let outcome = run(&pipeline, store, &options, &Environment::system(), &|event| {
        progress.tell(event);
    });
    reading.end(output, arguments.quiet);
    let outcome = outcome.map_err(|error| CliError::from(error).tried_again())?;
    let errors: Vec<(String, CliError)> = outcome
        .failures
        .into_iter()
        .map(|failure| {
            let error = CliError::from(failure.error).tried_again().of_stage(&failure.stage);
            (failure.stage, error)
        })
        .collect();
    let told: Vec<(Option<&str>, &CliError)> = errors
        .iter()
        .map(|(stage, error)| (Some(stage.as_str()), error))
        .collect();
    if let Some(submitter) = submitter {
        submitter.tell(&told)?;
        if outcome.stages.iter().any(|stage| stage.outcome == Outcome::Left) {
            report_left(&submitter.board, submitter.array).map_err(again)?;
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
    } else if !arguments.quiet {
        output.text(table::of_run(&outcome.stages))?;
    }
    errors.iter().for_each(|error| output.report(error));
    let hopeless = errors.iter().map(CliError::exit).find(|exit| *exit != Exit::TryAgain);
    Ok(match hopeless {
        Some(exit) => exit,
        None if errors.is_empty() && !stop.load(Ordering::Relaxed) => Exit::Done,
        None => Exit::TryAgain,
    })
}

/// Who started this worker.
struct Submitter<'a> {
    /// In which array.
    array: &'a str,
    /// Where it looks.
    board: Board,
}

impl Submitter<'_> {
    /// Lets it know of what could not be done. That a worker was stopped it knows.
    fn tell(&self, errors: &[(Option<&str>, &CliError)]) -> Result<(), CliError> {
        let is_hopeless = |error: &CliError| error.exit() != Exit::TryAgain;
        let failed = errors.iter().filter(|(_, error)| is_hopeless(error));
        let failed: Vec<Failed> = failed
            .map(|(stage, error)| Failed {
                stage: stage.map(str::to_owned),
                exit: error.exit().code(),
                message: error.message().to_owned(),
            })
            .collect();
        report_failures(&self.board, &failed).map_err(again)?;
        let trouble = errors
            .iter()
            .find(|(_, error)| !is_hopeless(error) && error.is_transient());
        if let Some((_, error)) = trouble {
            report_trouble(&self.board, error.message()).map_err(again)?;
        }
        Ok(())
    }
}

/// What the store refuses a worker another may be granted.
fn again(error: StoreError) -> CliError {
    CliError::from(error).tried_again()
}

fn check_processor(wanted: Option<CpuLevel>) -> Result<(), CliError> {
    let found = CpuLevel::of_this_machine();
    match wanted {
        Some(wanted) if found < wanted => Err(CliError::failure(format!(
            "the processor of {} is below {}: its results would differ in the last bits",
            host_name(),
            wanted.word()
        ))
        .help("`cpu` of the profile says what all workers must have")
        .elsewhere()),
        _ => Ok(()),
    }
}

/// Places of the stages that are to be built here; all of them without.
fn stages(arguments: &WorkerArguments, pipeline: &Pipeline) -> Result<Option<BTreeSet<usize>>, CliError> {
    if arguments.stages.is_empty() {
        return Ok(None);
    }
    let mut places = BTreeSet::new();
    for name in &arguments.stages {
        // A name that is none is refused there.
        pipeline.selection(Some(name))?;
        let sweep = pipeline.sweep(name);
        let is_meant = |stage: &String| stage == name || sweep.is_some_and(|sweep| sweep.stages.contains(stage));
        let named = pipeline
            .stages
            .iter()
            .enumerate()
            .filter(|(_, stage)| is_meant(&stage.name));
        places.extend(named.map(|(place, _)| place));
    }
    Ok(Some(places))
}

fn level(word: &str) -> Result<CpuLevel, String> {
    CpuLevel::of_word(word).ok_or_else(|| format!("allowed: {}", CpuLevel::WORDS.join(", ")))
}

/// One stage has chunks to choose from.
fn check_chunks(arguments: &WorkerArguments, pipeline: &Pipeline) -> Result<(), CliError> {
    match (arguments.chunks, arguments.of.until.as_deref()) {
        (Some(_), Some(until)) if pipeline.stage(until).is_none() => Err(CliError::bad_input(format!(
            "--chunks are those of one stage, and `{until}` names a sweep"
        ))
        .help("--until 'STAGE[axis=value]' names one of its stages")),
        _ => Ok(()),
    }
}

/// How long the job may go on.
fn left(time: Option<Duration>, before: Duration) -> Result<Duration, CliError> {
    let seconds = |name: &str| {
        let value = std::env::var(name).ok()?;
        Some(Duration::from_secs(value.trim().parse().ok()?))
    };
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let from_slurm = || Some(seconds(SLURM_END)?.saturating_sub(since));
    let left = time.or_else(from_slurm).or_else(|| seconds(PBS_TIME));
    let left = left.ok_or_else(|| {
        CliError::bad_input("--stop-before: it is not known when this job has to end")
            .help(format!("{SLURM_END} or {PBS_TIME} says so in a job; or give --time"))
    })?;
    Ok(left.saturating_sub(before))
}

/// Has the worker stop when its time is over, and the process end where what is under way does not stop: nothing of it is lost but its
/// last piece, and others need not wait for that.
fn watch(
    stop: &Arc<AtomicBool>,
    left: Option<Duration>,
    store: &Store,
    sign: &Arc<Sign>,
    board: Option<Board>,
) -> Result<Background, CliError> {
    let (stop, store, sign) = (stop.clone(), store.clone(), sign.clone());
    if left.is_some_and(|left| left.is_zero()) {
        stop.store(true, Ordering::Relaxed);
    }
    let end = left.and_then(|left| Instant::now().checked_add(left));
    let watch = move |pauses: &Pauses| {
        let mut looked: Option<Instant> = None;
        while !stop.load(Ordering::Relaxed) {
            if !pauses.wait(PAUSE) {
                return;
            }
            if looked.is_none_or(|looked| looked.elapsed() >= LOOK) {
                looked = Some(Instant::now());
                if board.as_ref().is_some_and(is_cancelled) {
                    stop.store(true, Ordering::Relaxed);
                }
            }
            if end.is_some_and(|end| Instant::now() >= end) {
                stop.store(true, Ordering::Relaxed);
            }
        }
        if pauses.wait(PATIENCE) {
            sign.remove();
            store.leave();
            process::exit(i32::from(Exit::TryAgain.code()));
        }
    };
    Background::start("watch", watch).map_err(|error| CliError::failure(format!("cannot start a thread: {error}")))
}

/// Reads `17-48`.
fn range(text: &str) -> Result<(usize, usize), String> {
    let parts = text.split_once('-').unwrap_or((text, text));
    match (parts.0.trim().parse(), parts.1.trim().parse()) {
        (Ok(first), Ok(last)) if first <= last => Ok((first, last)),
        _ => Err("allowed: numbers FIRST-LAST such as 17-48, or one number".to_owned()),
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
