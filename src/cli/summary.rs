//! The summary at the end of a run: what was built and reused, the main results, and where they are.

use std::path::Path;

use super::table;
use super::text::Text;
use super::tone::Tone;
use deaflow_orchestrator::{Outcome, RunOutcome, StageReport};
use deaflow_report::{Headline, RunResults};

/// Adds what was built, and the most important results with the number of the others.
pub fn add_results(text: &mut Text, pipeline: &str, outcome: &RunOutcome, (found, more): (&[Headline], usize)) {
    let (tone, built) = built(&outcome.stages, outcome.seconds);
    text.toned(tone, format!("{pipeline}: {built}"));
    if outcome.unstable > 0 {
        let samples = table::counted(outcome.unstable, "samples");
        let line = format!("no stable solution for {samples}; see the outcomes under `unstable/` in the artifacts");
        text.toned(Tone::Bad, line);
    }
    for line in found {
        let tone = if line.is_good { Tone::Plain } else { Tone::Caution };
        text.toned(tone, line.text.as_str());
    }
    if more > 0 {
        text.line(format!("and {}", table::counted(more as u64, "more results")));
    }
}

/// Adds the warnings, a line each, and the number of those about samples, which matter less than those about designs.
pub fn add_warnings(text: &mut Text, results: &RunResults, of_samples: &[String]) {
    let others = results.warnings().filter(|warning| !of_samples.contains(warning));
    let others: Vec<String> = others.map(|warning| format!("warning: {warning}")).collect();
    others.iter().for_each(|line| {
        text.line(line);
    });
    if !of_samples.is_empty() {
        let and = if others.is_empty() { "" } else { "and " };
        let warnings = table::counted(of_samples.len() as u64, "warnings");
        text.line(format!("{and}{warnings} about patterns of the dataset; -v prints all"));
    }
}

/// Counts the stages by outcome; with the time of the run in s.
fn built(stages: &[StageReport], seconds: f64) -> (Tone, String) {
    let count = |outcome| stages.iter().filter(|stage| stage.outcome == outcome).count() as u64;
    let (built, reused) = (count(Outcome::Built), count(Outcome::Reused));
    let took = table::seconds(seconds);
    match (built, reused) {
        (0, n) => (Tone::Dim, format!("up to date ({})", table::counted(n, "stages"))),
        (n, 0) => (Tone::Good, format!("{} built in {took}", table::counted(n, "stages"))),
        (n, m) => (
            Tone::Good,
            format!("{n} of {} stages built in {took}, {m} reused", n + m),
        ),
    }
}

/// Adds where figures and artifacts are.
pub fn add_places(text: &mut Text, results: &RunResults, store: &Path, is_verbose: bool) {
    let artifacts = format!("artifacts in {}", store.display());
    let details = if is_verbose { "" } else { "; -v prints details" };
    text.line(match results.figures() {
        Some((n, folder)) => {
            let figures = table::counted(n as u64, "figures");
            format!("{figures} in {}, {artifacts}{details}", folder.display())
        }
        None => format!("{artifacts}{details}"),
    });
}
