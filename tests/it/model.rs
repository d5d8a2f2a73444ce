//! Models outside the store: exported files are complete, predict the same elsewhere, and only in their own scene.

use std::process::Command;

use serde_json::Value;

use super::common::{TINY, Transcript, Workspace, readers, scene_file, snapshot};

const ONNX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/it/onnx.py");

/// With a model trained at 5.25 kV, and patterns in it.
fn workspace() -> Workspace {
    let workspace = Workspace::tiny();
    workspace.stages(&["run", "tiny.yaml", "--until", "surrogate"]);
    workspace.write("scene.yaml", &scene_file());
    workspace.write("low.yaml", &scene_file().replace("5.25 kV", "5 kV"));
    workspace
}

/// The python to check with: one with onnxruntime if it is wanted, else one with h5py.
fn python() -> String {
    readers::find("onnxruntime, which runs exported models", || {
        readers::python("onnxruntime", "onnxruntime, h5py")
    })
    .unwrap_or_else(super::h5py::python)
}

pub fn check(workspace: &Workspace, model: &str, predicted: &str) -> (bool, String) {
    let checked = Command::new(python())
        .arg(ONNX)
        .args([workspace.path(model), workspace.path(predicted)])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&[checked.stdout, checked.stderr].concat()).into_owned();
    (checked.status.success(), said)
}

#[test]
fn an_exported_onnx_file_predicts_what_we_predict() {
    let workspace = workspace();
    workspace.write("physics.yaml", &TINY.replace("network: qin2024", "network: physics"));
    workspace.stages(&["run", "physics.yaml", "--until", "surrogate"]);
    let patterns = format!("{}:/patterns", artifact(&workspace, "bezier"));
    for pipeline in ["tiny.yaml", "physics.yaml"] {
        let model = format!("{pipeline}:surrogate");
        let ended = workspace.run(&["export", "model", &model, "-o", "model.onnx"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let ended = workspace.run(&["predict", &model, &patterns, "-o", "out.h5", "--scene", "tiny.yaml"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let (agrees, said) = check(&workspace, "model.onnx", "out.h5");
        println!("{pipeline}: {said}");
        assert!(
            agrees && said.contains("numpy: ") && !said.contains("moved 0.0\n"),
            "{pipeline}: {said}"
        );
    }

    // A weight that is another must be seen.
    let mut bytes = std::fs::read(workspace.path("model.onnx")).unwrap();
    let at = bytes.len() / 2;
    bytes[at..at + 400].fill(0x3e);
    std::fs::write(workspace.path("other.onnx"), bytes).unwrap();
    let (agrees, said) = check(&workspace, "other.onnx", "out.h5");
    assert!(!agrees, "{said}");
}

/// The file of a stage's artifact.
fn artifact(workspace: &Workspace, stage: &str) -> String {
    workspace.run(&["show", stage, "--json"]).json()["path"]
        .as_str()
        .unwrap()
        .to_owned()
}

#[test]
fn an_exported_model_is_complete_and_refused_in_another_scene_or_when_damaged() {
    let workspace = workspace();
    let export = |output: &str, more: &[&str]| {
        let command = ["export", "model", "tiny.yaml:surrogate", "-o", output, "--json"];
        workspace.run(&[&command[..], more].concat())
    };
    std::fs::create_dir(workspace.path("models")).unwrap();
    let ended = export("models", &["--format", "safetensors"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    assert_eq!(document["file"], "models/qin2024.safetensors");
    let header = &document["header"];
    assert_eq!(header["network"], "qin2024");
    assert_eq!(header["format_version"], 2);
    assert!(
        header["scene"].as_str().unwrap().contains("voltage: 5250 V"),
        "{header}"
    );
    let training = &header["training"];
    assert_eq!(
        (&training["epochs"], &training["best_epoch"], &training["seed"]),
        (&1.into(), &1.into(), &5.into())
    );
    assert!(
        training["examples"]["train"]["bezier"].as_u64().unwrap() > 0,
        "{training}"
    );
    let inputs = training["inputs"].as_array().unwrap();
    assert_eq!(inputs.len(), 1);
    assert_eq!(
        inputs[0],
        workspace.run(&["show", "balanced", "--json"]).json()["digest"]
    );
    let bytes = std::fs::read(workspace.path("models/qin2024.safetensors")).unwrap();
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let outer: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    assert_eq!(outer["__metadata__"].as_object().unwrap().len(), 1);

    // The file predicts like the stage, and not in another scene.
    let pattern = format!("{}:/patterns", artifact(&workspace, "large"));
    let predict =
        |model: &str, more: &[&str]| workspace.run(&[&["predict", model, &pattern, "-o", "out.h5"][..], more].concat());
    let file = "models/qin2024.safetensors";
    assert_eq!(predict(file, &[]).code, Some(0));
    let ended = predict(file, &["--scene", "scene.yaml"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let ended = predict(file, &["--scene", "low.yaml"]);
    assert_eq!(ended.code, Some(2));
    for part in ["drive.voltage", "5250 V", "5000 V"] {
        assert!(ended.stderr.contains(part), "{ended}");
    }
    let mut printed = Transcript::default();
    printed.add("another scene", ended);

    let mut damaged = bytes;
    let end = damaged.len();
    damaged[end - 10] ^= 4;
    std::fs::write(workspace.path("damaged.safetensors"), damaged).unwrap();
    for command in [
        predict("damaged.safetensors", &[]),
        workspace.run(&["export", "model", "damaged.safetensors", "-o", "x.onnx"]),
    ] {
        assert_eq!(command.code, Some(2));
        printed.add("a damaged file", command);
    }
    for (output, more, named) in [
        ("model.h5", &[][..], "--format"),
        ("model.onnx", &["--format", "safetensors"], "--format safetensors"),
        ("absent/model.onnx", &[], "absent"),
    ] {
        let ended = export(output, more);
        assert!(ended.code == Some(2) || ended.code == Some(1), "{output}");
        let message = ended.json()["error"].to_string();
        assert!(message.contains(named), "{output}: {message}");
        printed.add(output, message);
    }
    let ended = workspace.run(&["export", "model", file, "-o", file]);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains(file), "{}", ended.stderr);
    printed.add("export to the file itself", ended);
    snapshot!(printed);
}
