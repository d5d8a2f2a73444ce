//! Designs that were verified teach the surrogate that predicted them: each round is cached, a surrogate that is wrong
//! is exposed by verification, and after learning from what was verified it is less wrong.

use std::path::Path;

use hdf5::types::FixedUnicode;
use serde_json::Value;

use super::common::{Stages, Workspace, files, scene_file, snapshot, snapshots::without_numbers};

/// The surrogate has seen fine grids only, for one epoch that changes nothing: it knows nothing of designs.
const WRONG: &str = "version: 1
name: wrong
scene: scene.yaml
stages:
  small:     { kind: sample, family: small-grid, count: 12, seed: 1 }
  solved:    { kind: solve, needs: [small], elements_per_cell: 1 }
  surrogate: { kind: train, needs: [solved], network: qin2024, epochs: 1, learning_rate: 1e-6, seed: 5 }
  design:    { kind: design, needs: [surrogate], evaluator: surrogate, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, population: 20, generations: 2, seed: 6 }
  verified:  { kind: verify, needs: [design], elements_per_cell: 1, rounds: 2, update: { epochs: 30, learning_rate: 0.002 } }
";

fn workspace(pipeline: &str) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("wrong.yaml", pipeline);
    workspace
}

fn wrong() -> Workspace {
    workspace(WRONG)
}

/// One whose second round takes no time.
fn short() -> Workspace {
    workspace(&WRONG.replace("epochs: 30", "epochs: 2"))
}

const RUN: [&str; 2] = ["run", "wrong.yaml"];

fn texts(file: &Path, dataset: &str) -> Vec<String> {
    let read = hdf5::File::open(file).unwrap().dataset(dataset).unwrap();
    let found = read.read_raw::<FixedUnicode<64>>().unwrap();
    found.iter().map(ToString::to_string).collect()
}

#[test]
fn a_wrong_surrogate_is_exposed_and_learns_from_what_was_verified() {
    let workspace = wrong();
    let ended = workspace.run(&[&RUN[..], &["--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let stages = Stages::read(&document);
    let names = [
        "small",
        "solved",
        "surrogate",
        "design",
        "verified",
        "surrogate-2",
        "design-2",
        "verified-2",
    ];
    assert_eq!(stages.names(), names);
    assert_eq!(stages.with("built"), names);
    let digests = stages.digests();
    assert_ne!(digests["surrogate"], digests["surrogate-2"]);

    // It has seen the verified designs, and holds out what it held out before.
    let objects = files(&workspace.path("store/objects"));
    let learnt = |stage: &str| {
        let file = objects
            .iter()
            .find(|f| f.to_string_lossy().contains(&digests[stage]))
            .unwrap();
        let rows = texts(file, "metrics/family")
            .into_iter()
            .zip(texts(file, "metrics/split"));
        rows.map(|(family, split)| format!("{family} {split}"))
            .collect::<Vec<_>>()
    };
    assert!(!learnt("surrogate").iter().any(|row| row.starts_with("verified")));
    let second = learnt("surrogate-2");
    assert!(second.contains(&"verified train".to_owned()), "{second:?}");
    assert_eq!(second.iter().filter(|row| row.starts_with("verified")).count(), 1);

    // Round 1 is not to be trusted, and round 2 is better: in JSON, in words and as a figure.
    let rounds = document["rounds"][0]["rounds"].as_array().unwrap();
    let relative: Vec<f64> = rounds.iter().map(|r| r["largest_relative"].as_f64().unwrap()).collect();
    assert!(relative[0] > 0.5 && relative[1] < 0.3 * relative[0], "{relative:?}");
    assert_eq!(document["rounds"][0]["stage"], "verified");
    let found = |stage: usize| document["results"][stage]["largest_difference"].as_f64().unwrap();
    assert_eq!([found(0), found(1)], relative[..]);
    let told = workspace.run(&[&RUN[..], &["-v"]].concat()).stdout;
    assert!(told.contains("-rounds.png"), "{told}");
    snapshot!(without_numbers(&told));
    let figures = document["figures"].as_array().unwrap();
    let drawn = figures
        .iter()
        .filter_map(Value::as_str)
        .find(|f| f.ends_with("-rounds.png"))
        .unwrap();
    assert!(workspace.path(drawn).exists());

    // Of one thread, from nothing: the same bits.
    let other = wrong();
    let again = other.stages(&[&RUN[..], &["--jobs", "1"]].concat()).digests();
    assert_eq!(again, digests);
}

#[test]
fn rounds_are_planned_locked_and_added_to_like_other_stages() {
    let workspace = short();
    let first = workspace.stages(&[&RUN[..], &["--until", "verified"][..]].concat());
    assert_eq!(first.names(), ["small", "solved", "surrogate", "design", "verified"]);
    let built = |more: &[&str]| {
        let stages = workspace.stages(&[&RUN[..], more].concat());
        stages.with("built").iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    assert_eq!(built(&["--until", "surrogate-2"]), ["surrogate-2"]);
    assert_eq!(built(&["--lock"]), ["design-2", "verified-2"]);
    assert_eq!(workspace.run(&[&RUN[..], &["--locked"][..]].concat()).code, Some(0));
    assert_eq!(
        workspace
            .run(&[&RUN[..], &["--locked", "--set", "stages.verified.rounds=3"][..]].concat())
            .code,
        Some(6)
    );

    // One more round is one more round.
    let plan = |set: &str| {
        let plan = [&["plan", "wrong.yaml", "--json"][..], &["--set", set][..]].concat();
        let plan = Stages::read(&workspace.run(&plan).json());
        plan.with("stale").iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    assert_eq!(
        plan("stages.verified.rounds=3"),
        ["surrogate-3", "design-3", "verified-3"]
    );
    // A stage of a round answers to its name.
    assert_eq!(plan("stages.design-2.generations=3"), ["design-2", "verified-2"]);
    let explained = workspace
        .run(&[&["explain", "wrong.yaml", "surrogate-2"][..], &[][..]].concat())
        .stdout;
    let first = explained.lines().next().unwrap();
    for part in ["surrogate-2", "train", "reused"] {
        assert!(first.contains(part), "{explained}");
    }
    assert!(
        explained.contains("verified: ") && explained.contains("solved: "),
        "{explained}"
    );
    let dag = workspace.run(&["dag", "wrong.yaml"]).stdout;
    assert!(
        dag.contains("surrogate-2  train   <- solved, surrogate, verified\n"),
        "{dag}"
    );
}
