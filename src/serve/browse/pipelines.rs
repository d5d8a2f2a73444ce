//! Pipelines: how they stand, and what a change would have built anew.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Value, json};

use crate::http::{Answer, Refusal, Request};
use crate::state::ServedState;
use deaflow_base::{Document, InputError, Node, NodeValue, Override};
use deaflow_orchestrator::{Environment, Pipeline, plan as planned, plan_document, plan_warnings, splice_scene};
use deaflow_report::{STAGE_HEIGHT, layout};
use deaflow_stage as stage;
use deaflow_store::Store;

/// Bytes of a pipeline's file that are shown.
const MOST_BYTES: u64 = 4 << 20;

/// Keys under which a pipeline names files. What a request changes must not name any.
const FILES: [&str; 5] = ["files", "field", "mask", "table", "file"];

/// The pipelines, by numbers.
///
/// # Errors
/// When the store cannot be read.
pub fn pipelines(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let each = state.pipelines()?.into_iter().enumerate().map(|(id, path)| {
        let name = load(&path, &[]).map(|pipeline| pipeline.name).ok();
        json!({ "id": id, "path": path, "name": name })
    });
    Ok(json!({ "pipelines": each.collect::<Vec<_>>() }).into())
}

/// A pipeline: its stages as `deaflow plan` has them, what each needs and where it is drawn, every value that can be changed, and its text.
/// One with a problem has its text, and where the problem stands.
///
/// # Errors
/// When there is none of that number, or the store cannot be read.
pub fn pipeline(state: &ServedState, request: &Request, number: &str) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let path = numbered(state, &json!(number))?;
    let text = deaflow_base::read_bounded(&path, MOST_BYTES).unwrap_or_default();
    let text = String::from_utf8_lossy(&text).into_owned();
    let document = match load(&path, &[]) {
        Ok(pipeline) => {
            let mut document = plan_of(state, &pipeline, None)?;
            let needs: BTreeMap<&str, Value> = pipeline
                .stages
                .iter()
                .map(|spec| {
                    let names = |places: &[usize]| {
                        places
                            .iter()
                            .map(|&at| pipeline.stages[at].name.as_str())
                            .collect::<Vec<_>>()
                    };
                    (
                        spec.name.as_str(),
                        json!({ "needs": names(&spec.needs), "gates": names(&spec.gates) }),
                    )
                })
                .collect();
            document["needs"] = json!(needs);
            document["layout"] = places(&pipeline);
            document["values"] = json!(values(&path)?);
            document["problem"] = Value::Null;
            document
        }
        Err(problem) => json!({ "problem": Refusal::from(problem).document()["error"] }),
    };
    let mut document = document;
    document["path"] = json!(path);
    document["text"] = json!(text);
    Ok(document.into())
}

/// Where the stages stand as the report draws them: layers from left to right, and middles from above, in the order of the pipeline; and of
/// each need the places that its line goes through.
fn places(pipeline: &Pipeline) -> Value {
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanRequest {
    /// The number of a pipeline, or its file as it is listed; the first where none is named.
    #[serde(default)]
    pipeline: Value,
    /// What is changed: values by their paths, as `--set` takes them.
    #[serde(default)]
    set: BTreeMap<String, Value>,
    /// The last stage.
    #[serde(default)]
    until: Option<String>,
}

/// What a run with other values would build: what `deaflow plan --json` prints. Nothing is built.
///
/// # Errors
/// When the change cannot be made, or the store cannot be read.
pub fn plan(state: &ServedState, request: &Request) -> Result<Answer, Refusal> {
    request.allow(&[])?;
    let asked: PlanRequest = request.json()?;
    let path = numbered(state, &asked.pipeline)?;
    let changes = overrides(&asked.set)?;
    let pipeline = load(&path, &changes).map_err(|problem| match load(&path, &[]) {
        // Without the changes there is none: it is one of them, whose place is none in the file.
        Ok(_) => of_change(&path, &changes, problem),
        Err(own) => own.into(),
    })?;
    Ok(plan_of(state, &pipeline, asked.until.as_deref())?.into())
}

/// A refusal of changed values: it names the one that is refused, where one alone is.
fn of_change(path: &Path, changes: &[Override], problem: InputError) -> Refusal {
    let alone = |change: &&Override| load(path, std::slice::from_ref(change)).is_err();
    let mut refused = changes.iter().filter(alone);
    let refusal = Refusal::from(problem).without_place();
    match (refused.next(), refused.next()) {
        (Some(change), None) => refusal.of_value(change.said().0),
        _ => refusal,
    }
}

/// The file of a pipeline that is served. It is found in the list of them: what a request says is no path.
pub fn numbered(state: &ServedState, wanted: &Value) -> Result<PathBuf, Refusal> {
    let pipelines = state.pipelines()?;
    let found = match wanted {
        Value::Null => pipelines.first(),
        Value::Number(number) => number.as_u64().and_then(|at| pipelines.get(usize::try_from(at).ok()?)),
        Value::String(text) => match text.parse::<usize>() {
            Ok(at) => pipelines.get(at),
            Err(_) => pipelines.iter().find(|path| path.to_str() == Some(text)),
        },
        _ => None,
    };
    let none = || Refusal::absent("no such pipeline is served").help("GET /api/pipelines lists them");
    found.cloned().ok_or_else(none)
}

/// Overrides as `--set` has them, none of which names a file.
pub fn overrides(set: &BTreeMap<String, Value>) -> Result<Vec<Override>, Refusal> {
    let one = |(path, value): (&String, &Value)| {
        let text = match value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        let set = Override::parse(&format!("{path}={text}"));
        let set = set.map_err(|problem| Refusal::from(problem).without_place().of_value(path))?;
        if names_file(set.path(), set.node()) {
            return Err(Refusal::bad(format!("{path}: a request names no files"))
                .help("change the pipeline's file, or give `--set` to `deaflow plan`")
                .of_value(path));
        }
        Ok(set)
    };
    set.iter().map(one).collect()
}

/// Whether a value may name a file: it stands under a key that does, has one, or is in the place of a scene.
fn names_file(path: &[String], node: &Node) -> bool {
    let is_key = |key: &str| key.split('.').any(|step| FILES.contains(&step));
    let of_scene = path.last().is_some_and(|last| last == "scene")
        && matches!(node.value(), NodeValue::Text(_) | NodeValue::List(_));
    path.iter().any(|step| is_key(step))
        || of_scene
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

fn load(path: &Path, overrides: &[Override]) -> Result<Pipeline, InputError> {
    Pipeline::load(path, overrides, &stage::registry())
}

/// The plan, and the folder of the store. Where there is no store yet, an empty one elsewhere stands in for it.
fn plan_of(state: &ServedState, pipeline: &Pipeline, until: Option<&str>) -> Result<Value, Refusal> {
    let in_store = |store: &Store| -> Result<Value, Refusal> {
        let stages = planned(pipeline, store, until, &Environment::system())?;
        let warnings = plan_warnings(pipeline, &stages, store)?;
        Ok(plan_document(pipeline, state.store_folder(), &stages, &warnings))
    };
    if let Some(store) = state.store()? {
        return in_store(&store);
    }
    let scratch = tempfile::tempdir();
    let scratch = scratch.map_err(|error| Refusal::new(503, format!("cannot make a temporary folder: {error}")))?;
    in_store(&Store::open(scratch.path())?)
}

/// Every single value of a pipeline and its scene as it was written, by the path that `--set` takes.
fn values(path: &Path) -> Result<Vec<Value>, Refusal> {
    let mut root = Document::load(path)?.root;
    splice_scene(&mut root, path)?;
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
    fn what_names_a_file_is_refused() {
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
