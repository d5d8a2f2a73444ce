//! A crate holds what it says it holds, by the rules of RO-Crate 1.1 and Workflow Run Crate 0.5 that a validator
//! requires.

use std::collections::BTreeSet;
use std::fs;

use serde_json::Value;

use super::common::{SHORT, SMALL, Transcript, Workspace, csv, files, snapshot, with_scene_in_a_file};

fn export(workspace: &Workspace, arguments: &[&str]) -> Value {
    let ended = workspace.run(&[&["export", "crate"], arguments, &["--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}{}", ended.stdout, ended.stderr);
    ended.json()
}

fn graph(workspace: &Workspace, folder: &str) -> Vec<Value> {
    let text = fs::read_to_string(workspace.path(folder).join("ro-crate-metadata.json")).unwrap();
    let document: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(document["@context"], "https://w3id.org/ro/crate/1.1/context");
    document["@graph"].as_array().unwrap().clone()
}

fn has_type(entity: &Value, kind: &str) -> bool {
    match &entity["@type"] {
        Value::Array(kinds) => kinds.iter().any(|own| own == kind),
        own => own == kind,
    }
}

/// All identifiers that an entity refers to.
fn references(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::Object(map) if map.len() == 1 && map.contains_key("@id") => {
            found.push(map["@id"].as_str().unwrap().to_owned());
        }
        Value::Object(map) => map.values().for_each(|value| references(value, found)),
        Value::Array(values) => values.iter().for_each(|value| references(value, found)),
        _ => {}
    }
}

fn of<'a>(graph: &'a [Value], id: &str) -> &'a Value {
    graph
        .iter()
        .find(|entity| entity["@id"] == id)
        .unwrap_or_else(|| panic!("no {id}"))
}

/// What the profiles require.
fn check(workspace: &Workspace, folder: &str) {
    let graph = graph(workspace, folder);
    let ids: Vec<&str> = graph.iter().map(|entity| entity["@id"].as_str().unwrap()).collect();
    assert_eq!(ids.iter().collect::<BTreeSet<_>>().len(), ids.len(), "each entity once");
    let mut named = Vec::new();
    references(&Value::Array(graph.clone()), &mut named);
    let outside = |id: &&String| !ids.contains(&id.as_str()) && !id.starts_with("https://w3id.org/ro/crate/");
    assert_eq!(named.iter().filter(outside).collect::<Vec<_>>(), Vec::<&String>::new());

    let root = of(&graph, "./");
    for key in ["name", "description", "datePublished", "license", "mainEntity"] {
        assert!(!root[key].is_null(), "{key}");
    }
    let parts: BTreeSet<String> = root["hasPart"]
        .as_array()
        .unwrap()
        .iter()
        .map(|part| part["@id"].as_str().unwrap().to_owned())
        .collect();
    let mut there: BTreeSet<String> = files(&workspace.path(folder))
        .iter()
        .map(|path| {
            path.strip_prefix(workspace.path(folder))
                .unwrap()
                .to_str()
                .unwrap()
                .replace(' ', "%20")
        })
        .collect();
    assert!(there.remove("ro-crate-metadata.json"));
    assert_eq!(parts, there, "what is there is what is said");
    assert!(parts.iter().all(|part| has_type(of(&graph, part), "File")));

    let workflow = of(&graph, root["mainEntity"]["@id"].as_str().unwrap());
    assert!(
        ["File", "SoftwareSourceCode", "ComputationalWorkflow"]
            .iter()
            .all(|kind| has_type(workflow, kind))
    );
    assert!(has_type(
        of(&graph, workflow["programmingLanguage"]["@id"].as_str().unwrap()),
        "ComputerLanguage"
    ));
    let actions: Vec<&Value> = graph.iter().filter(|entity| has_type(entity, "CreateAction")).collect();
    assert!(
        actions
            .iter()
            .any(|action| action["instrument"]["@id"] == workflow["@id"])
    );
    for action in actions {
        assert!(
            root["mentions"]
                .as_array()
                .unwrap()
                .contains(&serde_json::json!({ "@id": action["@id"] }))
        );
        assert!(action["startTime"].as_str().unwrap() <= action["endTime"].as_str().unwrap());
        assert!(has_type(
            of(&graph, action["agent"]["@id"].as_str().unwrap()),
            "SoftwareApplication"
        ));
        assert!(!action["result"].is_null() && !action["instrument"].is_null());
    }
}

#[test]
fn a_crate_holds_what_it_says() {
    let workspace = Workspace::new();
    let (pipeline, _) = with_scene_in_a_file(SMALL);
    fs::create_dir_all(workspace.path("my pipelines/scenes")).unwrap();
    workspace.write(
        "my pipelines/small.yaml",
        &pipeline.replace("scene.yaml", "scenes/scene.yaml"),
    );
    workspace.write("my pipelines/scenes/scene.yaml", &super::common::scene_of_20_cells());
    let path = "my pipelines/small.yaml";
    assert_eq!(workspace.run(&["run", path, "--lock", "--quiet"]).code, Some(0));
    let said = export(
        &workspace,
        &[path, "-o", "crate", "--license", "https://spdx.org/licenses/CC-BY-4.0"],
    );
    check(&workspace, "crate");
    assert_eq!(
        of(&graph(&workspace, "crate"), "./")["license"],
        "https://spdx.org/licenses/CC-BY-4.0"
    );
    for file in ["workflow/small.yaml", "workflow/scenes/scene.yaml", "README.md"] {
        assert!(said["files"].as_array().unwrap().contains(&file.into()), "{said}");
    }
    let figures = files(&workspace.path("crate/figures"));
    assert_eq!(figures.len(), 2, "{figures:?}");

    // A rerun of what is in it is held to the lock.
    let lock = "workflow/small.yaml.lock";
    let (ours, theirs) = (
        workspace.path("my pipelines/small.yaml.lock"),
        workspace.path("crate").join(lock),
    );
    assert_eq!(fs::read(ours).unwrap(), fs::read(theirs).unwrap());
    let rerun = workspace.run(&[
        "run",
        "crate/workflow/small.yaml",
        "--locked",
        "--store",
        "fresh",
        "--quiet",
    ]);
    assert_eq!(rerun.code, Some(0), "{}", rerun.stderr);

    // The same crate whenever it is made.
    fs::create_dir(workspace.path("again")).unwrap();
    export(
        &workspace,
        &[path, "-o", "again", "--license", "https://spdx.org/licenses/CC-BY-4.0"],
    );
    let text = |folder: &str| fs::read(workspace.path(folder).join("ro-crate-metadata.json")).unwrap();
    assert!(text("crate") == text("again"));
}

#[test]
fn overrides_are_recorded() {
    let workspace = Workspace::small();
    let set = ["--set", "scene.drive.voltage=5 kV"];
    workspace.run(&[&["run", "small.yaml", "--quiet"][..], &set].concat());
    export(&workspace, &[&["small.yaml", "-o", "crate"][..], &set].concat());
    check(&workspace, "crate");
    let graph = graph(&workspace, "crate");
    let value = of(&graph, "#set-scene.drive.voltage");
    assert_eq!(
        (&value["name"], &value["value"]),
        (&"scene.drive.voltage".into(), &"5 kV".into())
    );
    let readme = fs::read_to_string(workspace.path("crate/README.md")).unwrap();
    assert!(
        readme.contains("--set 'scene.drive.voltage=5 kV'") && !readme.contains("--locked"),
        "{readme}"
    );
}

#[test]
fn what_is_not_built_and_folders_in_use_are_refused() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml", "--until", "solved"]);
    let mut printed = Transcript::default();
    let mut refused = |output: &str, named: &[&str]| {
        let ended = workspace.run(&["export", "crate", "small.yaml", "-o", output]);
        assert_eq!(ended.code, Some(2), "{output}: {}", ended.stderr);
        for part in named {
            assert!(ended.stderr.contains(part), "{output}: {}", ended.stderr);
        }
        printed.add(output, ended);
    };
    refused("crate", &["balanced", "deaflow run small.yaml"]);
    assert!(!workspace.path("crate").exists());
    workspace.stages(&["run", "small.yaml"]);
    refused("store", &["store"]);
    refused("small.yaml", &["small.yaml"]);
    refused("none/crate", &["none"]);
    snapshot!(printed);
    // A damaged artifact leaves nothing half-written.
    let shown = workspace.run(&["show", "solved", "--json"]).json();
    let chunk = shown["parts"][0].as_str().unwrap();
    let chunk = workspace
        .path("store/objects")
        .join(&chunk[..2])
        .join(format!("{chunk}.h5"));
    let mut bytes = fs::read(&chunk).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&chunk, bytes).unwrap();
    let ended = workspace.run(&["export", "crate", "small.yaml", "-o", "crate"]);
    assert_ne!(ended.code, Some(0));
    assert!(!workspace.path("crate").exists());
    let left = fs::read_dir(workspace.path(""))
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    let left: Vec<_> = left.filter(|name| name.to_string_lossy().starts_with(".tmp")).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn a_crate_holds_the_files_that_stages_read() {
    let workspace = Workspace::new();
    fs::create_dir_all(workspace.path("data")).unwrap();
    workspace.write("data/own.csv", &csv(|x, _| x < 20));
    let short = SHORT.replace("cells: 20", "cells: 50");
    let own = format!("{short}  own: {{ kind: patterns, files: [./data/own.csv] }}\n");
    workspace.write("own.yaml", &own);
    assert_eq!(workspace.run(&["run", "own.yaml", "--quiet"]).code, Some(0));
    let said = export(&workspace, &["own.yaml", "-o", "crate"]);
    check(&workspace, "crate");
    assert!(
        said["files"]
            .as_array()
            .unwrap()
            .contains(&"workflow/data/own.csv".into()),
        "{said}"
    );
    let rerun = [
        "run",
        "crate/workflow/own.yaml",
        "--locked",
        "--store",
        "fresh",
        "--quiet",
    ];
    let rerun = workspace.run(&rerun);
    assert_eq!(rerun.code, Some(0), "{}", rerun.stderr);
}

#[test]
fn what_a_killed_export_left_is_removed_by_the_next() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    std::fs::create_dir(workspace.path("out")).unwrap();
    let left = workspace.path("out/.deaflow-tmp-aaaaaa");
    std::fs::create_dir(&left).unwrap();
    std::fs::write(left.join("part"), "1").unwrap();
    let then = std::time::SystemTime::now() - std::time::Duration::from_secs(60);
    std::fs::File::open(&left).unwrap().set_modified(then).unwrap();
    let ended = workspace.run(&["export", "crate", "small.yaml", "-o", "out/crate"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let names = std::fs::read_dir(workspace.path("out"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    assert_eq!(names.collect::<Vec<_>>(), ["crate"]);
}
