//! Artifacts copied to another store, exported as files and shown as tables.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Instant;

use serde_json::Value;

use super::common::{Transcript, Workspace, files, snapshot};

fn copy(workspace: &Workspace, stage: &str, to: &str) -> Value {
    let ended = workspace.run(&["copy", stage, "--to", to, "--json"]);
    assert_eq!(ended.code, Some(0), "{}{}", ended.stdout, ended.stderr);
    ended.json()
}

fn count(document: &Value, name: &str) -> u64 {
    document[name].as_u64().unwrap()
}

#[test]
fn a_run_reuses_what_was_copied() {
    let workspace = Workspace::small();
    let here = workspace.stages(&["run", "small.yaml"]);
    let copied = copy(&workspace, "small.yaml:balanced", "there");
    let objects = files(&workspace.path("there/objects"));
    let bytes: u64 = objects.iter().map(|path| fs::metadata(path).unwrap().len()).sum();
    assert_eq!(
        (count(&copied, "artifacts"), count(&copied, "bytes")),
        (objects.len() as u64, bytes)
    );
    assert_eq!(
        count(&copied, "records"),
        files(&workspace.path("store/records")).len() as u64
    );
    assert_eq!(workspace.run(&["fsck", "--store", "there"]).code, Some(0));

    let there = workspace.stages(&["run", "small.yaml", "--store", "there"]);
    assert_eq!(there.with("built"), Vec::<&str>::new());
    assert_eq!(there.digests(), here.digests());

    let again = copy(&workspace, "small.yaml:balanced", "there");
    assert_eq!((count(&again, "artifacts"), count(&again, "records")), (0, 0));
    assert_eq!(count(&again, "artifacts_there"), objects.len() as u64);
}

#[test]
fn a_stage_is_copied_without_what_needs_it() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    copy(&workspace, "solved", "there");
    let there = workspace.stages(&["run", "small.yaml", "--store", "there"]);
    assert_eq!(there.with("built"), ["balanced"]);
}

#[test]
fn a_damaged_artifact_is_not_copied() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let shown = workspace.run(&["show", "solved", "--json"]).json();
    let victim = object(&workspace.path("store"), shown["parts"][0].as_str().unwrap());
    let mut bytes = fs::read(&victim).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&victim, bytes).unwrap();
    let ended = workspace.run(&["copy", "balanced", "--to", "there"]);
    let name = victim.file_name().unwrap().to_str().unwrap();
    assert_eq!(ended.code, Some(4), "{}", ended.stderr);
    assert!(ended.stderr.contains(name), "{}", ended.stderr);
    assert!(!workspace.path("there/objects").join(&name[..2]).join(name).exists());
    // A collection here could not tell what the rest is needed for either: nothing is promised there.
    assert!(files(&workspace.path("there/records")).is_empty());
    assert_eq!(workspace.run(&["fsck", "--store", "there"]).code, Some(0));
}

#[test]
fn only_stores_are_copied_into() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml", "--until", "small"]);
    fs::create_dir(workspace.path("papers")).unwrap();
    workspace.write("papers/thesis.tex", "");
    fs::create_dir(workspace.path("elsewhere")).unwrap();
    copy(&workspace, "small", "linked");
    fs::remove_dir_all(workspace.path("linked/objects")).unwrap();
    std::os::unix::fs::symlink("../elsewhere", workspace.path("linked/objects")).unwrap();
    let mut printed = Transcript::default();
    for to in ["papers", "papers/thesis.tex", "store", "linked"] {
        let ended = workspace.run(&["copy", "small", "--to", to]);
        assert_eq!(ended.code, Some(2), "{to}: {}", ended.stderr);
        assert!(ended.stderr.contains(to), "{to}: {}", ended.stderr);
        printed.add(to, ended);
    }
    snapshot!(printed);
    assert!(files(&workspace.path("elsewhere")).is_empty());
    assert_eq!(files(&workspace.path("papers")).len(), 1);
}

#[test]
fn a_copy_killed_at_any_moment_leaves_a_sound_store() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let start = Instant::now();
    copy(&workspace, "balanced", "calm");
    let length = start.elapsed();
    let all = files(&workspace.path("calm/objects")).len();
    for k in 0..12u32 {
        let to = format!("there-{k}");
        let mut command = workspace.command(&["copy", "balanced", "--to", &to]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        sleep(length.mul_f64(f64::from(k) * 0.618_034 % 1.0));
        child.kill().unwrap();
        child.wait().unwrap();
        if workspace.path(&to).join("format").exists() {
            let fsck = workspace.run(&["fsck", "--store", &to]);
            assert_eq!(fsck.code, Some(0), "kill {k}: {}", fsck.stdout);
        }
        copy(&workspace, "balanced", &to);
        assert_eq!(files(&workspace.path(&to).join("objects")).len(), all, "kill {k}");
        assert!(files(&workspace.path(&to).join("tmp")).is_empty(), "kill {k}");
    }
}

/// Compares a file of its own with the artifact in the store that it was made from.
const COMPARE: &str = r#"
import sys, h5py, numpy as np
whole, alone = h5py.File(sys.argv[1]), h5py.File(sys.argv[2])
arrays = 0
def look(name, item):
    global arrays
    if name.split("/")[0] in ("provenance", "parts", "long_attributes"):
        return
    other = alone[name]
    assert dict(item.attrs.items()).keys() == dict(other.attrs.items()).keys(), name
    if not isinstance(item, h5py.Dataset) or "CLASS" in item.attrs:
        return
    arrays += 1
    assert not other.is_virtual and other.external is None, name
    assert other.dtype == item.dtype and np.array_equal(other[...], item[...]), name
    for key in ("units", "description", "axes", "_Netcdf4Coordinates"):
        assert np.array_equal(item.attrs[key], other.attrs[key]), (name, key)
whole.visititems(look)
for name, value in whole.attrs.items():
    assert alone.attrs[name] == value, name
told = alone["provenance"]
actions = told.attrs["actions"].decode().split("\n")
assert told.attrs["artifact"].decode() in sys.argv[1]
for name in actions:
    about = {key: value.decode() for key, value in told[name].attrs.items()}
    for key in ("kind", "recipe", "parameters", "artifact", "created", "host", "version", "build", "seconds"):
        assert about[key], (name, key)
    for digest in about["inputs"].split():
        assert any(digest.startswith(other.split("-")[-1]) for other in actions[actions.index(name) + 1:]), name
print(arrays, *(name.split("-")[0] for name in actions))
"#;

#[test]
fn an_exported_artifact_needs_no_store() {
    let workspace = Workspace::tiny();
    let digests = workspace.stages(&["run", "tiny.yaml", "--until", "verified"]).digests();
    let moved = tempfile::tempdir().unwrap();
    for (stage, told) in [
        ("solved", "15 solve sample sample sample"),
        ("verified", "24 verify design train balance solve sample sample sample"),
    ] {
        let file = format!("{stage}.h5");
        workspace.write(&file, "replaced");
        let said = workspace.run(&[
            "export",
            "artifact",
            &format!("tiny.yaml:{stage}"),
            "-o",
            &file,
            "--json",
        ]);
        assert_eq!(said.code, Some(0), "{}", said.stderr);
        assert_eq!(said.json()["artifact"].as_str(), Some(digests[stage].as_str()));
        let alone = moved.path().join(&file);
        fs::copy(workspace.path(&file), &alone).unwrap();
        let whole = object(&workspace.path("store"), &digests[stage]);
        let read = Command::new(super::h5py::python())
            .args(["-c", COMPARE])
            .args([&whole, &alone])
            .output()
            .unwrap();
        assert!(
            read.status.success(),
            "{stage}: {}",
            String::from_utf8_lossy(&read.stderr)
        );
        let text = String::from_utf8(read.stdout).unwrap();
        assert_eq!(text.trim(), told, "{stage}");
    }
    let left = fs::read_dir(workspace.path("")).unwrap();
    let left = left.filter(|entry| {
        entry
            .as_ref()
            .unwrap()
            .file_name()
            .to_string_lossy()
            .starts_with(".tmp")
    });
    assert_eq!(left.count(), 0, "nothing half-written stays");
}

#[test]
fn an_export_of_what_is_damaged_leaves_what_was_there() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    workspace.write("out.h5", "precious");
    let shown = workspace.run(&["show", "solved", "--json"]).json();
    let chunk = object(&workspace.path("store"), shown["parts"][1].as_str().unwrap());
    let mut bytes = fs::read(&chunk).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&chunk, bytes).unwrap();
    let ended = workspace.run(&["export", "artifact", "solved", "-o", "out.h5"]);
    assert_eq!(ended.code, Some(4), "{}", ended.stderr);
    assert_eq!(fs::read(workspace.path("out.h5")).unwrap(), b"precious");
}

fn object(store: &Path, digest: &str) -> std::path::PathBuf {
    store.join("objects").join(&digest[..2]).join(format!("{digest}.h5"))
}

fn table(workspace: &Workspace, arguments: &[&str]) -> (Vec<Vec<String>>, String) {
    let ended = workspace.run(&[&["show", "--csv"], arguments].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let mut reader = ::csv::ReaderBuilder::new()
        .has_headers(false)
        .from_reader(ended.stdout.as_bytes());
    let rows = reader
        .records()
        .map(|row| row.unwrap().iter().map(str::to_owned).collect());
    (rows.collect(), ended.stderr)
}

#[test]
fn rows_are_shown_as_a_table() {
    let workspace = Workspace::tiny();
    workspace.stages(&["run", "tiny.yaml", "--until", "verified"]);
    let (rows, left_out) = table(&workspace, &["solved"]);
    assert_eq!(
        rows[0],
        [
            "family",
            "index",
            "max_displacement_mm",
            "newton_iterations",
            "outcome",
            "residual",
            "units"
        ]
    );
    assert_eq!(rows.len(), 1 + 82);
    let shown = workspace.run(&["show", "solved", "--json"]).json();
    let datasets = shown["datasets"].as_array().unwrap();
    let largest = datasets.iter().find(|d| d["path"] == "max_displacement").unwrap()["statistics"]["max"].as_f64();
    let found = rows[1..]
        .iter()
        .map(|row| row[2].parse::<f64>().unwrap())
        .fold(0.0, f64::max);
    assert_eq!(Some(found), largest, "all digits are there");
    assert!(
        left_out.contains("patterns (82 × 50 × 50)") && left_out.contains("unstable/family (0)"),
        "{left_out}"
    );

    // Texts that hold commas and quotes, and rows of which all were simulated.
    let (rows, _) = table(&workspace, &["verified"]);
    let column = |name: &str| {
        rows[0]
            .iter()
            .position(|title| title == name)
            .unwrap_or_else(|| panic!("{name}"))
    };
    assert!(rows[1][column("objective")].starts_with("{ point: [25 mm, 25 mm], direction"));
    assert!(rows[1][column("component/simulated_mm")].parse::<f64>().is_ok());

    let (rows, _) = table(&workspace, &["surrogate", "--along", "epoch"]);
    assert!(
        rows[0].contains(&"curves/validation_rmse_mm".to_owned()) && rows.len() == 2,
        "{rows:?}"
    );
    let ended = workspace.run(&["show", "--csv", "solved", "--along", "epoch"]);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("sample, unstable_sample"), "{}", ended.stderr);
}
