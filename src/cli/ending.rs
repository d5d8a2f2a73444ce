//! The few lines that a run ends with: what was built and reused, what was found, how far that is to be trusted, where it is, and what
//! comes next.

use super::run::RunArguments;
use super::table;
use super::text::Text;
use super::tone::Tone;
use deaflow_orchestrator::{Outcome, RunOutcome, StageReport};
use deaflow_report::{Headline, RunResults};
use deaflow_store::{Command, Store};

/// Adds what was built, and what was found: the lines that matter most, and how many more there are.
pub fn add_to(
    text: &mut Text,
    pipeline: &str,
    outcome: &RunOutcome,
    (found, more): (&[Headline], usize),
    seconds: f64,
) {
    let (tone, built) = built(&outcome.stages, seconds);
    text.toned(tone, format!("{pipeline}: {built}"));
    if outcome.unstable > 0 {
        let n = outcome.unstable;
        text.toned(
            Tone::Bad,
            format!(
                "no stable solution was found for {}; the outcomes stand in the artifacts under `unstable/`",
                table::counted(n, "samples")
            ),
        );
    }
    for line in found {
        let tone = if line.is_good { Tone::Plain } else { Tone::Caution };
        text.toned(tone, line.text.as_str());
    }
    if more > 0 {
        text.line(format!("and {} more", table::counted(more as u64, "results")));
    }
}

/// What became of the stages, and how long that took in all, s.
fn built(stages: &[StageReport], seconds: f64) -> (Tone, String) {
    let count = |outcome| stages.iter().filter(|stage| stage.outcome == outcome).count();
    let (built, reused) = (count(Outcome::Built), count(Outcome::Reused));
    let took = table::seconds(seconds);
    match (built, reused) {
        (0, 1) => (Tone::Dim, "its stage is reused, nothing to build".to_owned()),
        (0, n) => (Tone::Dim, format!("all {n} stages are reused, nothing to build")),
        (1, 0) => (Tone::Good, format!("1 stage built in {took}")),
        (n, 0) => (Tone::Good, format!("{n} stages built in {took}")),
        (n, m) => (
            Tone::Good,
            format!("{n} of {} stages built in {took}, {m} reused", n + m),
        ),
    }
}

/// Adds where figures and artifacts are, and what comes next.
pub fn places(text: &mut Text, results: &RunResults, store: &Store, (command, arguments): (Command, &RunArguments)) {
    let artifacts = format!("artifacts in {}", store.root().display());
    let details = if arguments.verbose { "" } else { "; -v prints details" };
    text.line(match results.figures() {
        Some((1, folder)) => format!("1 figure in {}, {artifacts}{details}", folder.display()),
        Some((n, folder)) => format!("{n} figures in {}, {artifacts}{details}", folder.display()),
        None => format!("{artifacts}{details}"),
    });
    // A sweep is of stages that the file does not have.
    if command == Command::Run {
        text.command(format!("next: deaflow report {} -o report", words(arguments)));
    }
}

/// The pipeline with its changes and its store, as a shell reads them.
fn words(arguments: &RunArguments) -> String {
    let of = &arguments.of;
    let mut words = vec![of.pipeline.display().to_string()];
    for set in &of.set.sets {
        words.extend(["--set".to_owned(), set.clone()]);
    }
    if let Some(until) = &of.until {
        words.extend(["--until".to_owned(), until.clone()]);
    }
    if let Some(store) = of.store.given() {
        words.extend(["--store".to_owned(), store.display().to_string()]);
    }
    let quoted = words.iter().map(|word| shlex::try_quote(word).unwrap_or_default());
    quoted.collect::<Vec<_>>().join(" ")
}
