//! Past runs, and the status of the store.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::{Value, json};

use super::pipelines::load;
use super::units::units;
use crate::http::{ApiError, Request, Response};
use crate::jobs::running_jobs;
use crate::state::ServerState;
use deaflow_base::{ActionKey, Canonical, read_own};
use deaflow_executor::workers;
use deaflow_orchestrator::as_set;
use deaflow_report::{
    Headline, Opening, RemovedArtifacts, RunArtifacts, StageArtifact, headlines, opening_picture, run_document,
};
use deaflow_store::{Run, RunStage, Store};

/// Runs in one response.
const MAX_RUNS: usize = 1000;

/// Lists past runs, the latest first, as `deaflow log --json`; parameters `limit` and `offset`. With `values`, paths of
/// `--set` separated by commas, each run has `values`: those that it did not change, as far as its records have them.
/// `units` are those of the results of all runs.
///
/// # Errors
/// If the store cannot be read.
pub fn runs(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&["limit", "offset", "values"])?;
    let (limit, offset) = (
        request.integer("limit", 100, MAX_RUNS)?,
        request.integer("offset", 0, usize::MAX)?,
    );
    let Some(store) = state.store()? else {
        return Ok(json!({ "runs": [], "more": false, "units": {} }).into());
    };
    let mut all = store.runs()?;
    let page: Vec<Run> = all.by_ref().skip(offset).take(limit).collect::<Result<_, _>>()?;
    let more = all.next().transpose()?.is_some();
    let removed = RemovedArtifacts::of(&store);
    let paths = request.nonempty("values");
    let paths: Vec<&str> = paths.map_or_else(Vec::new, |paths| paths.split(',').collect());
    let mut recorded = RecordedValues::new(&store);
    let mut documents: Vec<Value> = Vec::with_capacity(page.len());
    let mut all_units = BTreeMap::new();
    for run in &page {
        all_units.extend(units(run));
        let mut document = run_document(run, &removed);
        if !paths.is_empty() {
            document["values"] = json!(recorded.of(run, &paths)?);
        }
        documents.push(document);
    }
    Ok(json!({ "runs": documents, "more": more, "units": all_units }).into())
}

/// Values of runs in the records of their stages.
struct RecordedValues<'s> {
    store: &'s Store,
    /// The parameters of each stage by path; runs share many stages.
    read: BTreeMap<ActionKey, BTreeMap<String, String>>,
}

impl<'s> RecordedValues<'s> {
    fn new(store: &'s Store) -> Self {
        Self {
            store,
            read: BTreeMap::new(),
        }
    }

    /// Returns the parameters of a stage; none if its record is gone.
    fn parameters(&mut self, stage: &RunStage) -> Result<&BTreeMap<String, String>, ApiError> {
        Ok(match self.read.entry(stage.key) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => {
                let record = self.store.record(&stage.key)?.record();
                let leaves = record.iter().flat_map(|record| record.action.parameters.leaves());
                let leaves = leaves.flat_map(|(path, value)| {
                    let area = area_of_only_target(&path, value).map(|area| (AREA.to_owned(), area.to_string()));
                    [Some((path, value.to_string())), area]
                });
                place.insert(leaves.flatten().collect())
            }
        })
    }

    /// Returns the values at some paths of `--set` that a run did not change. A value of the scene that differs between
    /// stages is not that of the file.
    fn of<'p>(&mut self, run: &Run, paths: &[&'p str]) -> Result<BTreeMap<&'p str, String>, ApiError> {
        let mut found = BTreeMap::new();
        for path in paths.iter().filter(|path| !run.overrides.contains_key(**path)) {
            let mut values: BTreeSet<String> = BTreeSet::new();
            for stage in &run.stages {
                let own = path.strip_prefix("stages.").map_or(Some(*path), |rest| {
                    rest.strip_prefix(stage.name.as_str())?.strip_prefix('.')
                });
                if let Some(own) = own {
                    let parameters = self.parameters(stage)?.iter();
                    values.extend(
                        parameters
                            .filter(|(path, _)| as_set(path, &stage.from_scene) == own)
                            .map(|(_, value)| value.clone()),
                    );
                }
            }
            if let (1, Some(value)) = (values.len(), values.pop_first()) {
                found.insert(*path, value);
            }
        }
        Ok(found)
    }
}

/// The key of the area of a design stage.
const AREA: &str = "area";

/// Returns the area of a design stage with one target: files have it beside the keys of the stage, records in a list of
/// targets.
fn area_of_only_target<'v>(path: &str, value: &'v Canonical) -> Option<&'v Canonical> {
    match (path, value) {
        ("targets", Canonical::List(targets)) => match &targets[..] {
            [Canonical::Map(only)] => only.get(AREA),
            _ => None,
        },
        _ => None,
    }
}

/// Bytes of a log file that are read.
const MAX_LOG_BYTES: u64 = 4 << 20;

/// Returns a run: the parameters of its stages as far as their records exist, its main results, and its warnings.
///
/// # Errors
/// If there is no such run, or the store cannot be read.
pub fn one_run(state: &ServerState, request: &Request, id: &str) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let store = state.existing_store()?;
    let run = find_run(&store, id)?;
    let mut recorded = RecordedValues::new(&store);
    let mut parameters: BTreeMap<String, &String> = BTreeMap::new();
    for stage in &run.stages {
        recorded.parameters(stage)?;
    }
    for stage in &run.stages {
        let own = recorded.read.get(&stage.key).into_iter().flatten();
        parameters.extend(own.map(|(path, value)| (format!("stages.{}.{path}", stage.name), value)));
    }
    let mut document = run_document(&run, &RemovedArtifacts::of(&store));
    document["parameters"] = json!(parameters);
    document["units"] = json!(units(&run));
    document["headlines"] = json!(headline_texts(&store, &run, &stage_artifacts(&store, &run)));
    document["warnings"] = json!(warnings(&store, &run));
    Ok(document.into())
}

/// Finds a run by its id.
fn find_run(store: &Store, id: &str) -> Result<Run, ApiError> {
    for run in store.runs()? {
        let run = run?;
        if run.id == id {
            return Ok(run);
        }
    }
    Err(ApiError::not_found(format!("unknown run {id:?}")).help("GET /api/runs lists the runs"))
}

/// Returns the artifacts of a run that the store still has.
fn stage_artifacts(store: &Store, run: &Run) -> Vec<StageArtifact> {
    let there = run.stages.iter().filter(|stage| store.has(&stage.artifact));
    let made = there.map(|stage| StageArtifact {
        stage: stage.name.clone(),
        kind: stage.kind.clone(),
        digest: stage.artifact,
    });
    made.collect()
}

/// Returns what the report of a run begins with: `sentence`, `facts` of the best design, and `picture`, an SVG document
/// or null, with its `caption`.
///
/// # Errors
/// If there is no such run, or its artifacts cannot be read.
pub fn opening(state: &ServerState, request: &Request, id: &str) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let store = state.existing_store()?;
    let run = find_run(&store, id)?;
    let path = Path::new(&run.path);
    // Only files that are served are read.
    let is_served = state.pipelines()?.iter().any(|served| served == path);
    let pipeline = is_served.then(|| load(path, &[]).ok()).flatten();
    let rounds = pipeline.map(|pipeline| pipeline.rounds).unwrap_or_default();
    let artifacts = RunArtifacts {
        store: &store,
        file: path,
        stages: &stage_artifacts(&store, &run),
        rounds: &rounds,
    };
    Ok(opening_document(&artifacts)?.into())
}

/// Returns what a report of some artifacts begins with.
pub(super) fn opening_document(artifacts: &RunArtifacts<'_>) -> Result<Value, ApiError> {
    let Opening { sentence, facts } = Opening::of(artifacts)?;
    let picture = opening_picture(artifacts)?;
    Ok(json!({
        "sentence": sentence,
        "facts": facts,
        "picture": picture.as_ref().map(|picture| &picture.svg),
        "caption": picture.as_ref().map(|picture| &picture.caption),
    }))
}

/// Returns the main results of a run; nothing if its artifacts cannot be read.
fn headline_texts(store: &Store, run: &Run, stages: &[StageArtifact]) -> Vec<String> {
    let artifacts = RunArtifacts {
        store,
        file: Path::new(&run.path),
        stages,
        rounds: &[],
    };
    let (lines, _) = headlines(&artifacts).unwrap_or_default();
    lines.into_iter().map(|Headline { text, .. }| text).collect()
}

/// Returns the warnings in the log of a run; none if the log is gone.
fn warnings(store: &Store, run: &Run) -> Vec<String> {
    let Some(log) = &run.log else { return Vec::new() };
    let Ok(text) = read_own(&store.root().join(log), MAX_LOG_BYTES) else {
        return Vec::new();
    };
    let text = String::from_utf8_lossy(&text);
    let lines = text
        .lines()
        .filter_map(|line| line.split_once(' ')?.1.strip_prefix("warning: "));
    lines.map(str::to_owned).collect()
}

/// Returns the status: what is in the store, and what is running.
///
/// # Errors
/// If the store cannot be read.
pub fn status(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    Ok(status_document(state)?.into())
}

/// Returns the status as a document.
///
/// # Errors
/// If the store cannot be read.
pub fn status_document(state: &ServerState) -> Result<Value, ApiError> {
    let begun = state.runner.progress();
    let Some(store) = state.store()? else {
        return Ok(
            json!({ "store": null, "last_run": null, "in_flight": 0, "workers": [], "runs": [], "begun": begun }),
        );
    };
    let totals = state.totals.of(&store)?;
    let last = store.runs()?.next().transpose()?;
    let seen = workers(&store)?;
    let workers: Vec<Value> = seen
        .iter()
        .map(|seen| {
            json!({
                "host": seen.worker.owner.host,
                "pid": seen.worker.owner.pid,
                "pipeline": seen.worker.pipeline,
                // A worker reports about once a minute; seconds would change the status at every check.
                "silent": seen.silent.as_secs() / 60 * 60,
            })
        })
        .collect();
    Ok(json!({
        "store": store.root(),
        "objects": totals.objects,
        "bytes": totals.bytes,
        "records": totals.records,
        "in_flight": totals.in_flight,
        "quarantined": totals.quarantined,
        "last_run": last.map(|run| json!({ "id": run.id, "created": run.created, "pipeline": run.pipeline })),
        "workers": workers,
        "runs": running_jobs(&store),
        "begun": begun,
    }))
}
