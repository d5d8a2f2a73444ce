//! Past runs, and what is at work in the store.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};

use crate::held::at_work;
use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_base::read_own;
use deaflow_executor::workers;
use deaflow_report::{Gone, Headline, Made, RunArtifacts, headlines, run_document};
use deaflow_stage::result_unit;
use deaflow_store::{Run, Store};

/// Runs in one answer.
const MOST: usize = 1000;

/// Past runs, the latest first, as `deaflow log --json` tells them. `?limit=` and `?offset=` take some of them.
///
/// # Errors
/// When the store cannot be read.
pub fn runs(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&["limit", "offset"])?;
    let (limit, offset) = (
        request.number("limit", 100, MOST)?,
        request.number("offset", 0, usize::MAX)?,
    );
    let Some(store) = state.store()? else {
        return Ok(json!({ "runs": [], "more": false }).into());
    };
    let mut all = store.runs()?;
    let some: Vec<Run> = all.by_ref().skip(offset).take(limit).collect::<Result<_, _>>()?;
    let more = all.next().transpose()?.is_some();
    let gone = Gone::in_store(&store);
    let documents: Vec<Value> = some.iter().map(|run| run_document(run, &gone)).collect();
    Ok(json!({ "runs": documents, "more": more }).into())
}

/// Bytes of a log that is read.
const LONGEST: u64 = 4 << 20;

/// How a warning begins in a log, after its time.
const WARNING: &str = "warning: ";

/// A run by its digits, with the parameters of its stages as far as their records are there, what matters most of what it found, and its
/// warnings.
///
/// # Errors
/// When there is none, or the store cannot be read.
pub fn one_run(state: &ServedState, request: &Request, id: &str) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let store = state.existing_store()?;
    for run in store.runs()? {
        let run = run?;
        if run.id != id {
            continue;
        }
        let mut parameters: BTreeMap<String, String> = BTreeMap::new();
        let mut made = Vec::new();
        for stage in &run.stages {
            let record = store.record(&stage.key)?.record();
            if let Some(record) = record.as_ref().filter(|_| store.has(&stage.artifact)) {
                made.push(Made {
                    stage: stage.name.clone(),
                    kind: record.action.kind.clone(),
                    digest: stage.artifact,
                });
            }
            let leaves = record.iter().flat_map(|record| record.action.parameters.leaves());
            parameters.extend(leaves.map(|(path, value)| (format!("stages.{}.{path}", stage.name), value.to_string())));
        }
        let mut document = run_document(&run, &Gone::in_store(&store));
        document["parameters"] = json!(parameters);
        document["units"] = json!(units(&run));
        document["headlines"] = json!(found(&store, &run, &made));
        document["warnings"] = json!(warnings(&store, &run));
        return Ok(document.into());
    }
    Err(Refusal::absent("no run of that name is remembered").help("GET /api/runs lists them"))
}

/// What matters most of what a run found, as the command says it; nothing where what it made cannot be read any more.
fn found(store: &Store, run: &Run, made: &[Made]) -> Vec<String> {
    let artifacts = RunArtifacts {
        store,
        file: Path::new(&run.path),
        made,
        rounds: &[],
    };
    let (lines, _) = headlines(&artifacts).unwrap_or_default();
    lines.into_iter().map(|Headline { text, .. }| text).collect()
}

/// The warnings in the log of a run; none where it has none any more.
fn warnings(store: &Store, run: &Run) -> Vec<String> {
    let Some(log) = &run.log else { return Vec::new() };
    let Ok(text) = read_own(&store.root().join(log), LONGEST) else {
        return Vec::new();
    };
    let text = String::from_utf8_lossy(&text);
    let lines = text
        .lines()
        .filter_map(|line| line.split_once(' ')?.1.strip_prefix(WARNING));
    lines.map(str::to_owned).collect()
}

/// The units of the results that have one, by their names, which begin with that of the stage.
fn units(run: &Run) -> BTreeMap<&str, &'static str> {
    let stage = |name: &str| {
        let own = run.stages.iter().map(|stage| stage.name.as_str());
        own.filter_map(|stage| name.strip_prefix(stage)?.strip_prefix('.').map(str::len))
            .min()
    };
    let unit = |name: &str| result_unit(&name[name.len() - stage(name).unwrap_or(name.len())..]);
    let all = run.results.keys().map(|name| (name.as_str(), unit(name)));
    all.filter(|(_, unit)| *unit != "1").collect()
}

/// What is in the store and at work in it, at this moment; `/api/events` tells it again and again.
///
/// # Errors
/// When the store cannot be read.
pub fn status(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    Ok(standing(state)?.into())
}

/// What is in the store and at work in it.
///
/// # Errors
/// When the store cannot be read.
pub fn standing(state: &ServedState) -> Result<Value, Refusal> {
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
                // A worker signs about once a minute; seconds would be news at every look.
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
        "runs": at_work(&store),
        "begun": begun,
    }))
}
