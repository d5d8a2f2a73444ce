//! The JSON Schemas agree with the readers: an independent validator accepts and refuses the same files.

mod documents;
mod faults;
mod validator;
mod walk;

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

use serde_json::Value;

use deaflow::orchestrator::{pipeline_schema, scene_schema};
use deaflow::stage::registry;

use super::common::{TINY, Workspace, files, snapshot, snapshots::without_numbers};
use documents::{Kind, json};
use faults::Fault;

fn pipelines() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines")
}

/// The pipelines and scenes that are shipped, with the kind of each.
fn shipped() -> Vec<(PathBuf, Kind)> {
    let is_data = |f: &PathBuf| {
        let folder = f.parent();
        folder.is_some_and(|folder| folder.ends_with("materials") || folder.ends_with("measured"))
    };
    let yaml = files(&pipelines())
        .into_iter()
        .filter(|f| f.extension().is_some_and(|e| e == "yaml") && !is_data(f));
    let found: Vec<(PathBuf, Kind)> = yaml
        .map(|f| {
            let scene = f.parent().is_some_and(|folder| folder.ends_with("scenes"));
            (f, if scene { Kind::Scene } else { Kind::Pipeline })
        })
        .collect();
    assert!(found.len() >= 7, "{found:?}");
    found
}

#[test]
fn schema_prints_the_schema_of_pipelines_unless_asked_for_scenes() {
    let workspace = Workspace::new();
    let print = |arguments: &[&str]| {
        let ended = workspace.run(arguments);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        serde_json::from_str::<Value>(&ended.stdout).unwrap()
    };
    let registry = registry();
    assert_eq!(print(&["schema"]), pipeline_schema(&registry));
    assert_eq!(print(&["schema", "pipeline"]), pipeline_schema(&registry));
    assert_eq!(print(&["schema", "scene"]), scene_schema(&registry));
}

#[test]
fn shipped_files_name_their_schema() {
    for (file, kind) in shipped() {
        let text = std::fs::read_to_string(&file).unwrap();
        let named = text
            .lines()
            .next()
            .and_then(|line| line.strip_prefix("# yaml-language-server: $schema="));
        let schema = file
            .parent()
            .unwrap()
            .join(named.unwrap_or_else(|| panic!("{} names none", file.display())));
        // `make build` writes the schemas, so they need not be there: the path is compared without reading it.
        let mut resolved = PathBuf::new();
        for part in schema.components() {
            match part {
                Component::ParentDir => _ = resolved.pop(),
                part => resolved.push(part),
            }
        }
        assert_eq!(
            resolved,
            pipelines().join("schema").join(kind.file()),
            "{}",
            file.display()
        );
    }
}

#[test]
fn shipped_files_are_valid() {
    let mut cases: Vec<(Kind, Value)> = shipped()
        .iter()
        .map(|(file, kind)| (*kind, json(&std::fs::read_to_string(file).unwrap())))
        .collect();
    let more = [TINY, documents::SWEPT_WORDS].map(|text| (Kind::Pipeline, json(text)));
    for (kind, document) in &more {
        kind.read(document).unwrap();
    }
    cases.extend(more);
    assert_eq!(validator::verdicts(&cases), vec![true; cases.len()]);
}

#[test]
fn a_pipeline_holds_the_schema_of_scenes() {
    let mut scene = scene_schema(&registry());
    for key in ["$schema", "title", "$defs"] {
        assert!(scene.as_object_mut().unwrap().remove(key).is_some());
    }
    assert_eq!(pipeline_schema(&registry())["$defs"]["scene"], scene);
}

/// Visits every mapping and every key of the schemas, and makes the reader list the keys that it allows there.
#[test]
fn readers_and_schemas_know_the_same_keys() {
    for kind in [Kind::Pipeline, Kind::Scene] {
        let schema = kind.schema();
        let mut visited = BTreeSet::new();
        for document in documents::of(kind) {
            kind.read(&document).unwrap_or_else(|e| panic!("{e}: {document}"));
            for place in walk::mappings(&schema, &document) {
                for key in place.value(&document).as_object().unwrap().keys() {
                    let property = format!("{}/properties/{key}", place.schema);
                    let shared = schema.pointer(&property).and_then(walk::shared);
                    visited.insert(shared.unwrap_or(property));
                }
                faults::keys_agree(kind, &schema, &document, &place);
            }
        }
        let all = walk::properties(&schema, kind);
        let missed: Vec<_> = all.difference(&visited).collect();
        assert!(missed.is_empty(), "no document here has {missed:#?}");
        assert!(all.len() > 40, "{}", all.len());
    }
}

/// The schema accepts what the reader accepts, and refuses what the reader refuses for its structure.
#[test]
fn readers_and_schemas_refuse_the_same_faults() {
    let mut faults: Vec<Fault> = Vec::new();
    for kind in [Kind::Pipeline, Kind::Scene] {
        let mut seen = BTreeSet::new();
        for document in documents::of(kind) {
            faults::collect(kind, &document, &mut seen, &mut faults);
        }
    }
    let cases: Vec<(Kind, Value)> = faults.iter().map(|fault| (fault.kind, fault.local.clone())).collect();
    let verdicts = validator::verdicts(&cases);
    let mut wrong = Vec::new();
    let mut beyond = BTreeSet::new();
    for (fault, valid) in faults.iter().zip(verdicts) {
        match &fault.refusal {
            None if !valid => wrong.push(format!("the schema refuses what is read: {}", fault.what)),
            Some(why) if valid && !fault.is_axis => _ = beyond.insert(without_numbers(why)),
            _ => {}
        }
    }
    // Faults that only the reader can refuse: by names elsewhere, by several values together, by text with a unit.
    snapshot!(beyond.into_iter().collect::<Vec<_>>().join("\n"));
    assert!(
        wrong.is_empty(),
        "{} of {}:\n{}",
        wrong.len(),
        faults.len(),
        wrong.join("\n")
    );
    assert!(faults.len() > 1000, "{}", faults.len());
}
