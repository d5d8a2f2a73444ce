//! docs/deaflow.py reads what a run has made.

use std::process::Output;

use serde_json::Value;

use super::common::{Transcript, Workspace, files, snapshot};

fn python(workspace: &Workspace, script: &str) -> Output {
    let module = concat!(env!("CARGO_MANIFEST_DIR"), "/docs");
    let mut command = workspace.dressed(&super::h5py::python());
    command.args(["-B", "-c", script]).env("PYTHONPATH", module);
    command.output().unwrap()
}

fn printed(workspace: &Workspace, script: &str) -> String {
    let output = python(workspace, script);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// All that the module says of an artifact, in the words of `deaflow show --json`.
const SHOW: &str = r#"
import json, sys, deaflow
for name in ("tiny:solved", "verified", "tiny.yaml:surrogate"):
    artifact = deaflow.open("store", name)
    datasets = {}
    for path, values in artifact.items():
        about = {"shape": list(values.shape), "units": artifact.units[path]}
        assert values.shape == artifact.shapes[path] and len(artifact.dims[path]) == values.ndim
        assert len(artifact.descriptions[path]) > 5
        if values.dtype.kind == "U":
            about["texts"] = sorted(set(values.tolist()))
        elif values.size:
            about["min"], about["max"] = float(values.min()), float(values.max())
        datasets[path] = about
    print(json.dumps({"digest": artifact.digest, "kind": artifact.kind, "attributes": artifact.attributes,
                      "provenance": artifact.provenance, "datasets": datasets}))
"#;

#[test]
fn the_module_reads_what_the_program_shows() {
    let workspace = Workspace::tiny();
    workspace.stages(&["run", "tiny.yaml"]);
    let lines = printed(&workspace, SHOW);
    for (stage, line) in ["solved", "verified", "surrogate"].iter().zip(lines.lines()) {
        let read: Value = serde_json::from_str(line).unwrap();
        let shown = workspace.run(&["show", stage, "--json"]).json();
        for key in ["digest", "attributes", "provenance"] {
            assert_eq!(read[key], shown[key], "{stage}: {key}");
        }
        assert_eq!(read["kind"], shown["provenance"]["kind"]);
        for dataset in shown["datasets"].as_array().unwrap() {
            let path = dataset["path"].as_str().unwrap();
            // Texts of any length are one array.
            if path.ends_with("/text") || path.ends_with("/length") {
                assert!(
                    read["datasets"][path.rsplit_once('/').unwrap().0]["texts"].is_array(),
                    "{path}"
                );
                continue;
            }
            let found = &read["datasets"][path];
            assert_eq!(
                (&found["shape"], &found["units"]),
                (&dataset["shape"], &dataset["units"]),
                "{stage}: {path}"
            );
            let told = &dataset["statistics"];
            if let Some(counts) = told["counts"].as_object() {
                assert_eq!(
                    found["texts"].as_array().unwrap().len(),
                    counts.len(),
                    "{stage}: {path}"
                );
            } else {
                assert_eq!(
                    (&found["min"], &found["max"]),
                    (&told["min"], &told["max"]),
                    "{stage}: {path}"
                );
            }
        }
    }
}

#[test]
fn runs_are_listed_and_names_lead_to_the_last_of_them() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    workspace.stages(&["run", "small.yaml", "--set", "stages.small.seed=7"]);
    let script = r#"
import deaflow
last, first = deaflow.runs("store")
assert first.created < last.created and last.overrides == {"stages.small.seed": "7"}
assert deaflow.runs("store", "small") == deaflow.runs("store", "small.yaml") == [last, first]
assert deaflow.runs("store", "other") == []
assert deaflow.open("store", "small").digest == last.stages["small"] != first.stages["small"]
assert deaflow.open("store", first.stages["small"][:8]).digest == first.stages["small"]
assert last.results["solved.samples"] == len(deaflow.open("store", "solved")["family"])
print(last.id)
"#;
    let log = workspace.run(&["log", "--json"]).json();
    assert_eq!(
        printed(&workspace, script).trim(),
        log["runs"][0]["id"].as_str().unwrap()
    );
}

#[test]
fn wrong_names_and_damage_raise_errors() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let error = |script: &str| {
        let output = python(&workspace, &format!("import deaflow\n{script}"));
        assert!(!output.status.success(), "{script}");
        let text = String::from_utf8(output.stderr).unwrap();
        text.lines().last().unwrap_or_default().to_owned()
    };
    let mut printed = Transcript::default();
    for (script, parts) in [
        ("deaflow.open('store', 'solvd')", ["NotFound: ", "'solved'"]),
        ("deaflow.open('store', 'smal:solved')", ["NotFound: ", "'small'"]),
        (
            "deaflow.open('store', 'other.yaml:solved')",
            ["NotFound: ", "'other.yaml'"],
        ),
        ("deaflow.open('store', 'solved')['displacemen']", ["", "'displacement'"]),
        ("deaflow.open('nowhere', 'solved')", ["StoreError: ", "nowhere"]),
        ("deaflow.load('small.yaml')", ["StoreError: ", "small.yaml"]),
    ] {
        let message = error(script);
        for part in parts {
            assert!(message.contains(part), "{script}: {message}");
        }
        printed.add(script, message);
    }
    for package in ["xarray", "pandas"] {
        let script =
            format!("import sys; sys.modules['{package}'] = None; deaflow.open('store', 'solved').to_{package}()");
        let message = error(&script);
        assert!(
            message.contains("ImportError: ") && message.contains(package),
            "{message}"
        );
        printed.add(format!("without {package}"), message);
    }
    // A chunk that is gone shows no numbers that look like data.
    let shown = workspace.run(&["show", "solved", "--json"]).json();
    let chunk = shown["parts"][0].as_str().unwrap();
    let path = files(&workspace.path("store/objects"))
        .into_iter()
        .find(|path| path.to_string_lossy().contains(chunk));
    std::fs::remove_file(path.unwrap()).unwrap();
    let message = error("deaflow.open('store', 'solved')");
    assert!(
        message.contains("StoreError: ") && message.contains(&chunk[..12]),
        "{message}"
    );
    printed.add("a missing chunk", message);
    snapshot!(printed);
}

#[test]
fn an_exported_artifact_is_loaded_without_its_store() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let ended = workspace.run(&["export", "artifact", "solved", "-o", "solved.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let script = r#"
import deaflow, numpy as np
alone, whole = deaflow.load("solved.h5"), deaflow.open("store", "solved")
assert alone.digest == whole.digest and alone.attributes == whole.attributes and alone.dims == whole.dims
assert list(alone) == list(whole) and all(np.array_equal(alone[name], whole[name]) for name in whole)
print(len(alone))
"#;
    assert!(printed(&workspace, script).trim().parse::<u32>().unwrap() > 8);
}
