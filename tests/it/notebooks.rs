//! The notebooks in `docs/notebooks` run. Their code is run as scripts, so that no test needs Jupyter; a notebook that
//! needs more than numpy and h5py is left out where its packages are missing.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::common::{Workspace, readers};
use super::python::run_in;

/// Runs a notebook in its own folder, where it finds the files that it names.
fn run(name: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = root.join("docs/notebooks");
    let notebook = folder.join(format!("{name}.ipynb"));
    let document: Value = serde_json::from_str(&std::fs::read_to_string(&notebook).unwrap()).unwrap();
    let needs = document["metadata"]["deaflow"]["needs"].as_array().unwrap();
    let needs: Vec<&str> = needs.iter().map(|package| package.as_str().unwrap()).collect();
    let modules = [&["h5py"][..], &needs].concat().join(", ");
    let look = || {
        let with_figures = readers::python("frameworks", &format!("{modules}, matplotlib"));
        with_figures.or_else(|| readers::python("frameworks", &modules))
    };
    let Some(python) = readers::installed(&format!("{modules}, for the notebook {name}"), look) else {
        assert!(
            !needs.is_empty(),
            "{name} needs nothing that `make test` does not install"
        );
        return;
    };
    let script = root.join("tests/it/python/notebook.py");
    let arguments = [&script, &notebook].map(|path| path.to_str().unwrap());
    let output = run_in(&Workspace::new(), &folder, &python, &arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{name}: {stdout}{stderr}");
    assert!(
        stdout.lines().last().unwrap_or_default().starts_with("ran "),
        "{stdout}"
    );
}

#[test]
fn the_notebook_with_first_steps_runs() {
    run("first-steps");
}

#[test]
fn the_notebook_with_a_design_by_scipy_runs() {
    run("design");
}

#[test]
fn the_notebook_with_a_network_runs() {
    run("network");
}

#[test]
fn the_notebook_with_measurements_and_creep_runs() {
    run("measured");
}

#[test]
fn the_notebook_beside_felupe_and_scikit_fem_runs() {
    run("peers");
}

#[test]
fn every_notebook_is_run_here() {
    let folder: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/notebooks");
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(
        names,
        [
            "design.ipynb",
            "first-steps.ipynb",
            "measured.ipynb",
            "network.ipynb",
            "peers.ipynb"
        ]
    );
}
