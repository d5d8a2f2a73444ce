//! A training that was killed resumes to the same bits; a training that diverges fails or keeps its best epoch with a
//! warning.

use std::fs;
use std::path::PathBuf;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::common::{SMALL, Stages, Workspace, files, snapshot, snapshots::without_numbers};
use super::damage::copy;

const RUN: [&str; 2] = ["run", "train.yaml"];

/// A training on balanced and on solved samples, long enough to be killed in.
fn workspace() -> Workspace {
    let workspace = Workspace::new();
    let stage = "  surrogate: { kind: train, needs: [balanced, solved], network: qin2024, epochs: 120, symmetry: d4, seed: 5 }\n";
    workspace.write("train.yaml", &format!("{SMALL}{stage}"));
    workspace
}

/// The file in which a training under way is kept.
fn state(workspace: &Workspace) -> Option<PathBuf> {
    files(&workspace.path("store/checkpoints")).into_iter().next()
}

/// Kills the run after the training has kept its state for the first time.
fn kill_in_the_training(workspace: &Workspace) {
    let mut run = workspace.command(&RUN);
    let mut run = run.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while state(workspace).is_none() {
        assert!(run.try_wait().unwrap().is_none(), "it ended before it could be killed");
        assert!(start.elapsed() < Duration::from_secs(120), "nothing was kept");
        sleep(Duration::from_millis(5));
    }
    run.kill().unwrap();
    run.wait().unwrap();
}

#[test]
fn a_killed_training_resumes_to_the_same_bits() {
    let killed = workspace();
    kill_in_the_training(&killed);
    let status = killed.run(&["status", "--json"]).json();
    assert_eq!(status["checkpoints"], 1, "{status}");
    let unfinished = &status["unfinished"][0];
    assert_eq!(
        (&unfinished["stage"], &unfinished["unit"]),
        (&"surrogate".into(), &"epochs".into())
    );
    let steps = unfinished["steps"].as_u64().unwrap();
    assert!((1..120).contains(&steps), "{unfinished}");
    let planned = killed.run(&["plan", "train.yaml"]).stdout;
    let words = planned.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(words.contains(&format!("{steps} of 120 epochs")), "{planned}");
    let listed = killed.run(&["status"]).stdout;
    assert!(listed.contains(": surrogate "), "{listed}");
    // A run that did not end stands in the log, and no more once it has been run to its end.
    let log = killed.run(&["log", "train.yaml", "--json"]).json();
    let path = log["unfinished"][0]["path"].as_str().unwrap();
    assert!(path.ends_with("train.yaml"), "{log}");
    let listed = killed.run(&["log", "train.yaml"]);
    assert_eq!(listed.code, Some(0), "{listed}");
    snapshot!(listed.stdout);
    let fsck = killed.run(&["fsck", "--json"]).json();
    assert_eq!((&fsck["sound"], &fsck["checkpoints"]), (&true.into(), &1.into()));

    // What was kept is damaged in a copy of the store: there the training begins again.
    let damaged = workspace();
    copy(&killed.path("store"), &damaged.path("store"));
    let file = state(&damaged).unwrap();
    let mut bytes = fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&file, bytes).unwrap();

    let run = |workspace: &Workspace, more: &[&str]| {
        let ended = workspace.run(&[&RUN[..], &["--json", "--progress", "json"], more].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert_eq!(state(workspace), None, "what was kept is still there");
        let digest = Stages::read(&ended.json()).digests()["surrogate"].clone();
        (digest, ended.stderr)
    };
    let (gone_on, told) = run(&killed, &[]);
    assert!(told.contains(r#""event":"resumed","name":"surrogate""#), "{told}");
    let log = killed.run(&["log", "train.yaml", "--json"]).json();
    assert_eq!(log["unfinished"], serde_json::json!([]), "it has been gone on with");
    // What it cost is that of the epochs that were left.
    let costs = fs::read_to_string(killed.path("store/costs.jsonl")).unwrap();
    let costs: Vec<serde_json::Value> = costs.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let cost = costs.iter().rfind(|cost| cost["kind"] == "train").unwrap();
    let did = cost["steps"].as_u64().unwrap();
    assert!(did < 120 && did + steps >= 120, "{did} after {steps}");
    let (begun_again, told) = run(&damaged, &[]);
    assert!(!told.contains("resumed"), "{told}");
    // Of one thread too.
    let undisturbed = workspace();
    copy(&killed.path("store"), &undisturbed.path("store"));
    for folder in ["records", "runs", "checkpoints"] {
        let _ = fs::remove_dir_all(undisturbed.path("store").join(folder));
    }
    let (whole, told) = run(&undisturbed, &["--jobs", "1"]);
    assert!(!told.contains("resumed"), "{told}");
    assert_eq!((gone_on, begun_again), (whole.clone(), whole));
}

#[test]
fn a_training_that_diverges_is_reported() {
    let workspace = workspace();
    let rate = ["--set", "stages.surrogate.learning_rate=10"];
    let run = |more: &[&str]| workspace.run(&[&RUN[..], &rate, more].concat());
    let ended = run(&["--set", "stages.surrogate.epochs=4"]);
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("`surrogate`") && ended.stderr.contains("epoch"),
        "{}",
        ended.stderr
    );
    // Where the rate rises slowly, some epochs are good before it is too large: the best of them is kept.
    let many = [
        "stages.surrogate.epochs=20000",
        "stages.large.units=[2, 3, 4]",
        "stages.large.count_per_units=30",
    ];
    let many = many.map(|set| ["--set", set]).concat();
    let ended = run(&[&many[..], &["--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let warnings = document["warnings"].as_array().unwrap();
    let warned = warnings
        .iter()
        .filter_map(|warning| warning.as_str())
        .find(|warning| warning.starts_with("surrogate: ") && warning.contains("epoch"));
    snapshot!(without_numbers(warned.unwrap_or_else(|| panic!("{document}"))));
    let line = document["trainings"][0].as_str().unwrap();
    assert!(line.starts_with("surrogate: qin2024"), "{line}");
}
