//! Warnings about a pipeline before any work: from the checks of its stages, and from results of earlier runs.

use std::collections::BTreeMap;

use super::event::StageReport;
use super::kind::{Expectation, ResultSource};
use super::spec::Pipeline;
use deaflow_base::ArtifactId;
use deaflow_store::{Run, Store, StoreError};

/// Number of runs that are searched for results.
const SEARCHED_RUNS: usize = 100;

/// Maximum number of stage names in a warning.
const MAX_NAMES: usize = 4;

/// Returns the warnings about the stages of a plan, each preceded by the names of its stages.
///
/// # Errors
/// If the store cannot be read.
pub fn plan_warnings(pipeline: &Pipeline, stages: &[StageReport], store: &Store) -> Result<Vec<String>, StoreError> {
    let mut warnings: Vec<(String, Vec<&str>)> = Vec::new();
    let mut results = Results::new(pipeline, stages, store);
    for report in stages {
        let Some(spec) = pipeline.stage(&report.name) else {
            continue;
        };
        let mut own = spec.check.warnings.clone();
        for expectation in &spec.check.expectations {
            own.extend(results.compare(expectation)?);
        }
        for text in own {
            match warnings.iter_mut().find(|(known, _)| *known == text) {
                Some((_, names)) => names.push(&spec.name),
                None => warnings.push((text, vec![&spec.name])),
            }
        }
    }
    let line = |(text, names): &(String, Vec<&str>)| format!("{}: {text}", joined(names));
    Ok(pipeline
        .bare_numbers
        .iter()
        .cloned()
        .chain(warnings.iter().map(line))
        .collect())
}

/// Joins names, and counts those beyond the maximum.
fn joined(names: &[&str]) -> String {
    let some = names.iter().take(MAX_NAMES).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        n if n > MAX_NAMES => format!("{some} and {} more", n - MAX_NAMES),
        _ => some,
    }
}

/// Formats a number with two significant digits.
fn two_digits(value: f64) -> String {
    let decimals = match value.abs() {
        size if size.is_normal() => (1.0 - size.log10().floor()).clamp(0.0, 12.0) as usize,
        _ => 0,
    };
    format!("{value:.decimals$}")
}

/// Results of artifacts, from the history of runs.
struct Results<'a> {
    pipeline: &'a Pipeline,
    stages: &'a [StageReport],
    store: &'a Store,
    /// Values by artifact and name; read on first use.
    known: Option<BTreeMap<ArtifactId, BTreeMap<String, f64>>>,
}

impl<'a> Results<'a> {
    fn new(pipeline: &'a Pipeline, stages: &'a [StageReport], store: &'a Store) -> Self {
        Self {
            pipeline,
            stages,
            store,
            known: None,
        }
    }

    /// Returns a warning for each stage whose artifact, present or expected, exceeds the limit.
    fn compare(&mut self, expectation: &Expectation) -> Result<Vec<String>, StoreError> {
        let of = self.stages.iter().filter(|stage| match &expectation.source {
            ResultSource::Stage(name) => stage.name == *name,
            ResultSource::Kind(kind) => stage.kind == *kind,
        });
        let mut warnings = Vec::new();
        for (name, digest) in of.filter_map(|stage| Some((&stage.name, stage.digest?))) {
            let known = self.known()?.get(&digest).and_then(|of| of.get(&expectation.result));
            if let Some(value) = known.filter(|value| **value > expectation.limit) {
                let text = expectation.warning.replace("{value}", &two_digits(*value));
                warnings.push(text.replace("{stage}", name));
            }
        }
        Ok(warnings)
    }

    fn known(&mut self) -> Result<&BTreeMap<ArtifactId, BTreeMap<String, f64>>, StoreError> {
        if self.known.is_none() {
            let mut known = BTreeMap::new();
            let runs = self.store.runs()?.take(SEARCHED_RUNS);
            for run in self.store.runs_of(runs, &self.pipeline.file(), &self.pipeline.name) {
                add(&run?, &mut known);
            }
            self.known = Some(known);
        }
        Ok(self.known.get_or_insert_default())
    }
}

/// Adds the results of a run, without replacing those of later runs.
fn add(run: &Run, known: &mut BTreeMap<ArtifactId, BTreeMap<String, f64>>) {
    for stage in &run.stages {
        let results = known.entry(stage.artifact).or_default();
        for (name, value) in &run.results {
            let own = name.strip_prefix(&stage.name).and_then(|name| name.strip_prefix('.'));
            if let Some(own) = own {
                results.entry(own.to_owned()).or_insert(*value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_two_digits_and_lists_are_short() {
        let written = [0.0, 0.491_5, 0.001_42, 12.7, 4321.0].map(two_digits);
        assert_eq!(written, ["0", "0.49", "0.0014", "13", "4321"]);
        assert_eq!(joined(&["a", "b"]), "a, b");
        assert_eq!(joined(&["a", "b", "c", "d", "e", "f"]), "a, b, c, d and 2 more");
    }
}
