//! Pipelines: the state of their stages, and what would be built after a change.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Value, json};

use super::units::units;
use crate::http::{ApiError, Request, Response};
use crate::state::ServerState;
use deaflow_base::{Document, InputError, Node, NodeValue, Override};
use deaflow_orchestrator::{Environment, Pipeline, plan as planned, plan_document, plan_warnings, splice_scene};
use deaflow_report::{STAGE_HEIGHT, layout};
use deaflow_scene::scene_files;
use deaflow_stage as stage;
use deaflow_store::{Command, Run, RunStage, Store};

/// Bytes of a pipeline file that are shown.
const MAX_FILE_BYTES: u64 = 4 << 20;

/// Keys under which a pipeline names files. A change in a request must not name files.
const FILE_KEYS: [&str; 5] = ["files", "field", "mask", "table", "file"];

/// Lists the pipelines with their numbers.
///
/// # Errors
/// If the store cannot be read.
pub fn pipelines(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let each = state.pipelines()?.into_iter().enumerate().map(|(id, path)| {
        let name = load(&path, &[]).map(|pipeline| pipeline.name).ok();
        json!({ "id": id, "path": path, "name": name })
    });
    Ok(json!({ "pipelines": each.collect::<Vec<_>>() }).into())
}

/// Returns a pipeline: its stages as in `deaflow plan`, their needs and positions in the drawing, all values that can
/// be changed, and its text. A pipeline with an error has its text and the position of the error.
///
/// # Errors
/// If there is no pipeline with that number, or the store cannot be read.
pub fn pipeline(state: &ServerState, request: &Request, number: &str) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let path = find_pipeline(state, &json!(number))?;
    let text = deaflow_base::read_bounded(&path, MAX_FILE_BYTES).unwrap_or_default();
    let text = String::from_utf8_lossy(&text).into_owned();
    let mut document = match load(&path, &[]) {
        Ok(pipeline) => {
            let mut document = plan_of(state, &pipeline, None)?;
            let mut needs = serde_json::Map::new();
            for spec in &pipeline.stages {
                let names =
                    |stages: &[usize]| -> Vec<&String> { stages.iter().map(|&at| &pipeline.stages[at].name).collect() };
                let entry = json!({ "needs": names(&spec.needs), "gates": names(&spec.gates) });
                needs.insert(spec.name.clone(), entry);
            }
            document["needs"] = json!(needs);
            document["layout"] = layout_document(&pipeline);
            document["values"] = json!(values(&path)?);
            document["last"] = last_results(state, &pipeline, &document)?;
            document["problem"] = Value::Null;
            document
        }
        Err(problem) => json!({ "problem": ApiError::from(problem).document()["error"] }),
    };
    document["path"] = json!(path);
    document["text"] = json!(text);
    Ok(document.into())
}

/// Returns the state of a pipeline in short: its stages, those that have to run with the estimated time, its last runs,
/// and the run whose results hold, as `shown`. A pipeline with an error has that as `problem`.
///
/// # Errors
/// If there is no pipeline with that number, or the store cannot be read.
pub fn summary(state: &ServerState, request: &Request, number: &str) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let path = find_pipeline(state, &json!(number))?;
    let pipeline = match load(&path, &[]) {
        Ok(pipeline) => pipeline,
        Err(problem) => return Ok(json!({ "problem": ApiError::from(problem).document()["error"] }).into()),
    };
    let plan = plan_of(state, &pipeline, None)?;
    let stages = plan["stages"].as_array().map(Vec::as_slice).unwrap_or_default();
    let stale: Vec<&Value> = stages
        .iter()
        .filter(|stage| stage["outcome"] == "stale")
        .map(|stage| &stage["name"])
        .collect();
    let store = state.store()?;
    let last = store.map(|store| LastRuns::of(&store, &pipeline)).transpose()?;
    let last = last.unwrap_or_default();
    Ok(json!({
        "problem": null,
        "stages": stages.len(),
        "stale": stale,
        "price": plan["price"],
        "run": last.own_document(&pipeline),
        "shown": last.shown(&plan).map(|run| &run.id),
        "changed": last.changed_document(),
    })
    .into())
}

/// Returns the results of the last run of a pipeline with its values, or of its last complete one, `results` with their
/// `units`; its last runs as in its summary; and the computing time of each stage that is up to date, `seconds`.
fn last_results(state: &ServerState, pipeline: &Pipeline, plan: &Value) -> Result<Value, ApiError> {
    let Some(store) = state.store()? else {
        return Ok(Value::Null);
    };
    let mut seconds: BTreeMap<&str, f64> = BTreeMap::new();
    for stage in plan["stages"].as_array().into_iter().flatten() {
        let (Some(name), Some(digest)) = (stage["name"].as_str(), stage["digest"].as_str()) else {
            continue;
        };
        let Some(digest) = digest.parse().ok().filter(|_| stage["outcome"] != "stale") else {
            continue;
        };
        if !store.has(&digest) {
            continue;
        }
        let provenance = store.artifact(&digest)?.provenance()?;
        if let Some(own) = provenance.get("seconds").and_then(|text| text.parse().ok()) {
            seconds.insert(name, own);
        }
    }
    let last = LastRuns::of(&store, pipeline)?;
    let shown = last.shown(plan);
    Ok(json!({
        "results": shown.map(|run| &run.results),
        "units": shown.map(units),
        "seconds": seconds,
        "run": last.own_document(pipeline),
        "changed": last.changed_document(),
    }))
}

/// The last runs of a pipeline.
#[derive(Default)]
struct LastRuns {
    /// The last run with the values of the pipeline.
    own: Option<Run>,
    /// The last one of these that built all of its stages.
    complete: Option<Run>,
    /// The last run with other values, if it is later.
    changed: Option<Run>,
}

impl LastRuns {
    fn of(store: &Store, pipeline: &Pipeline) -> Result<Self, ApiError> {
        let mut found = Self::default();
        for run in store.runs_of(store.runs()?.take(MAX_RUNS), &pipeline.file(), &pipeline.name) {
            let run = run?;
            match run.command {
                Command::Run if run.overrides == pipeline.overrides => {
                    let is_complete = run.is_complete();
                    if is_complete {
                        found.complete = Some(run.clone());
                    }
                    found.own.get_or_insert(run);
                    if is_complete {
                        break;
                    }
                }
                Command::Run if found.own.is_none() && found.changed.is_none() => found.changed = Some(run),
                // An audit builds one stage, and a sweep other stages.
                Command::Run | Command::Audit | Command::Sweep => {}
            }
        }
        Ok(found)
    }

    /// Returns the run whose results hold: the last complete one if everything that it built is up to date in a plan,
    /// or else the last one.
    fn shown(&self, plan: &Value) -> Option<&Run> {
        let is_up_to_date = |done: &RunStage| {
            let stages = plan["stages"].as_array().into_iter().flatten();
            let mut own = stages.filter(|stage| stage["name"] == done.name.as_str() && stage["outcome"] != "stale");
            own.any(|stage| stage["digest"] == done.artifact.to_string())
        };
        let (complete, own) = (self.complete.as_ref(), self.own.as_ref());
        complete
            .filter(|run| own.is_none_or(|own| own.stages.len() <= run.stages.len()))
            .filter(|run| run.stages.iter().all(is_up_to_date))
            .or(own)
    }

    /// Returns the last run, with the stages of the pipeline that failed or were stopped.
    fn own_document(&self, pipeline: &Pipeline) -> Option<Value> {
        let still_there = |names: &[String]| -> Vec<String> {
            let is_there = |name: &&String| pipeline.stages.iter().any(|spec| spec.name == **name);
            names.iter().filter(is_there).cloned().collect()
        };
        let document = |run: &Run| {
            json!({
                "id": run.id,
                "created": run.created,
                "seconds": run.seconds,
                "failed": still_there(&run.failures),
                "stopped": still_there(&run.stopped),
            })
        };
        self.own.as_ref().map(document)
    }

    fn changed_document(&self) -> Option<Value> {
        let document = |run: &Run| json!({ "id": run.id, "created": run.created, "overrides": run.overrides });
        self.changed.as_ref().map(document)
    }
}

/// Runs that are searched for the last one of a pipeline.
const MAX_RUNS: usize = 1000;

/// Returns the layout of the drawing, as in the report: layer and height of each stage, and the points of each line.
fn layout_document(pipeline: &Pipeline) -> Value {
    let needs = pipeline.stages.iter().map(|spec| {
        let all: BTreeSet<usize> = spec.needs.iter().chain(&spec.gates).copied().collect();
        all.into_iter().collect()
    });
    let needs: Vec<Vec<usize>> = needs.collect();
    let placed = layout(&needs);
    let name = |at: usize| pipeline.stages[at].name.as_str();
    let stages: BTreeMap<&str, (usize, f64)> = placed
        .stages
        .iter()
        .enumerate()
        .map(|(at, place)| (name(at), *place))
        .collect();
    let pairs = needs
        .iter()
        .enumerate()
        .flat_map(|(to, from)| from.iter().map(move |from| (*from, to)));
    let lines = pairs.zip(&placed.lines).map(|((from, to), places)| {
        let is_gate = !pipeline.stages[to].needs.contains(&from);
        json!({ "from": name(from), "to": name(to), "gate": is_gate, "places": places })
    });
    json!({
        "stages": stages,
        "lines": lines.collect::<Vec<_>>(),
        "layers": placed.layers,
        "height": placed.height,
        "stage_height": STAGE_HEIGHT,
    })
}

/// What to plan or to run.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BuildRequest {
    /// The number of a pipeline, or its file as listed; the first one by default.
    #[serde(default)]
    pub pipeline: Value,
    /// Changed values by path, as for `--set`.
    #[serde(default)]
    pub set: BTreeMap<String, Value>,
    /// The last stage to build.
    #[serde(default)]
    pub until: Option<String>,
}

/// Returns what a run with changed values would build, as `deaflow plan --json`. Nothing is built.
///
/// # Errors
/// If a change is invalid, or the store cannot be read.
pub fn plan(state: &ServerState, request: &Request) -> Result<Response, ApiError> {
    request.allow(&[])?;
    let plan: BuildRequest = request.json()?;
    let path = find_pipeline(state, &plan.pipeline)?;
    let changes = overrides(&plan.set)?;
    let pipeline = load(&path, &changes).map_err(|problem| match load(&path, &[]) {
        // Without the changes there is no error: one of them causes it, and it has no position in the file.
        Ok(_) => change_error(&path, &changes, problem),
        Err(own) => own.into(),
    })?;
    Ok(plan_of(state, &pipeline, plan.until.as_deref())?.into())
}

/// Converts the error of changed values; it names the value if a single one causes it.
fn change_error(path: &Path, changes: &[Override], problem: InputError) -> ApiError {
    let fails = |change: &&Override| load(path, std::slice::from_ref(change)).is_err();
    let mut failing = changes.iter().filter(fails);
    let error = ApiError::from(problem).without_position();
    match (failing.next(), failing.next()) {
        (Some(change), None) => error.for_parameter(change.path_and_text().0),
        _ => error,
    }
}

/// Finds a pipeline in the list of those that are served; other paths are never opened.
pub fn find_pipeline(state: &ServerState, requested: &Value) -> Result<PathBuf, ApiError> {
    let pipelines = state.pipelines()?;
    let found = match requested {
        Value::Null => pipelines.first(),
        Value::Number(number) => number.as_u64().and_then(|at| pipelines.get(usize::try_from(at).ok()?)),
        Value::String(text) => match text.parse::<usize>() {
            Ok(at) => pipelines.get(at),
            Err(_) => pipelines.iter().find(|path| path.to_str() == Some(text)),
        },
        _ => None,
    };
    let none = || ApiError::not_found("this pipeline is not served").help("GET /api/pipelines lists the pipelines");
    found.cloned().ok_or_else(none)
}

/// Parses changed values; they must not name files.
pub fn overrides(set: &BTreeMap<String, Value>) -> Result<Vec<Override>, ApiError> {
    let one = |(path, value): (&String, &Value)| {
        let change = Override::parse(&format!("{path}={}", value_text(value)));
        let change = change.map_err(|problem| ApiError::from(problem).without_position().for_parameter(path))?;
        if names_file(change.path(), change.node()) {
            return Err(
                ApiError::bad_request(format!("{path}: the page cannot change file names"))
                    .help("change the file of the pipeline, or use `deaflow plan --set`")
                    .for_parameter(path),
            );
        }
        Ok(change)
    };
    set.iter().map(one).collect()
}

/// Writes a value as for `--set`.
pub fn value_text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// Whether a value may name a file: its path or one of its keys is such a key, or it replaces a scene.
fn names_file(path: &[String], node: &Node) -> bool {
    let is_key = |key: &str| key.split('.').any(|step| FILE_KEYS.contains(&step));
    let of_scene = path.last().is_some_and(|last| last == "scene")
        && matches!(node.value(), NodeValue::Text(_) | NodeValue::List(_));
    let of_material = path.iter().any(|step| step == "material")
        && (path.last().is_some_and(|last| last == "from") || node.peek("from").is_some());
    path.iter().any(|step| is_key(step))
        || of_scene
        || of_material
        || !scene_files(node).is_empty()
        || holds_key(node, &|key: &str| is_key(key) || key.ends_with("scene"))
}

fn holds_key(node: &Node, is_key: &dyn Fn(&str) -> bool) -> bool {
    match node.value() {
        NodeValue::List(items) => items.iter().any(|item| holds_key(item, is_key)),
        NodeValue::Map(entries) => entries.iter().any(|(key, value)| {
            let named = match key.value() {
                NodeValue::Text(text) => is_key(text),
                _ => false,
            };
            named || holds_key(value, is_key)
        }),
        _ => false,
    }
}

/// Loads a pipeline with changed values.
pub(super) fn load(path: &Path, overrides: &[Override]) -> Result<Pipeline, InputError> {
    Pipeline::load(path, overrides, &stage::registry())
}

/// Returns the plan. If there is no store yet, it is made in an empty temporary one.
fn plan_of(state: &ServerState, pipeline: &Pipeline, until: Option<&str>) -> Result<Value, ApiError> {
    let in_store = |store: &Store| -> Result<Value, ApiError> {
        let stages = planned(pipeline, store, until, &Environment::system())?;
        let warnings = plan_warnings(pipeline, &stages, store)?;
        Ok(plan_document(pipeline, state.store_folder(), &stages, &warnings))
    };
    if let Some(store) = state.store()? {
        return in_store(&store);
    }
    let scratch = tempfile::tempdir();
    let scratch = scratch.map_err(|error| ApiError::new(503, format!("cannot create a temporary folder: {error}")))?;
    in_store(&Store::open(scratch.path())?)
}

/// Lists all values of a pipeline and its scene as written, by the path that `--set` takes.
fn values(path: &Path) -> Result<Vec<Value>, ApiError> {
    let mut root = Document::load(path)?.root;
    splice_scene(&mut root, path, Vec::new(), stage::registry().complete_scene)?;
    let mut found = Vec::new();
    collect(&root, &mut Vec::new(), &mut found);
    Ok(found)
}

fn collect(node: &Node, path: &mut Vec<String>, found: &mut Vec<Value>) {
    if let NodeValue::Map(entries) = node.value() {
        for (key, value) in entries {
            if let NodeValue::Text(key) = key.value() {
                path.push(key.clone());
                collect(value, path, found);
                path.pop();
            }
        }
        return;
    }
    let can_be_set = path.len() > 1 && !names_file(path, node);
    if can_be_set {
        found.push(json!({ "path": path.join("."), "value": node.written() }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_that_name_files_are_refused() {
        let refused = |path: &str, value: Value| overrides(&BTreeMap::from([(path.to_owned(), value)])).is_err();
        for (path, value) in [
            ("scene", json!("../other.yaml")),
            ("stages.mine.files", json!(["/etc/passwd"])),
            ("stages.mine", json!({ "kind": "patterns", "files": ["x.csv"] })),
            ("stages.design.objective", json!({ "field": "x.csv" })),
            ("scene.geometry.frame", json!({ "mask": "x.png" })),
            ("scene.drive.waveform.table", json!("x.csv")),
            ("stages.a.sweep", json!({ "scene": ["x.yaml"] })),
            ("stages.a.sweep", json!({ "objective.field": ["x.csv"] })),
        ] {
            assert!(refused(path, value.clone()), "{path}={value}");
        }
        for (path, value) in [
            ("scene.drive.voltage", json!("4 kV")),
            ("stages.a.count", json!(300)),
            (
                "stages.a.objective",
                json!({ "point": ["25 mm", "25 mm"], "direction": "0 deg" }),
            ),
        ] {
            assert!(!refused(path, value.clone()), "{path}={value}");
        }
        assert!(refused("no path", json!(1)));
    }
}
