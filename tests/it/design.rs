//! Designs are judged by the cheapest evaluator that is accurate enough, which is told; a network is needed only where one is
//! asked for.

use serde_json::Value;

use super::common::{TINY, Workspace, scene_file};

/// A pipeline of one design and its verification, which needs no dataset and no network.
fn alone() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write(
        "alone.yaml",
        "version: 1
name: alone
scene: scene.yaml
stages:
  design:   { kind: design, objective: { point: [25 mm, 25 mm], direction: 0 deg }, population: 40, generations: 2, seed: 6 }
  verified: { kind: verify, needs: [design], elements_per_cell: 2 }
",
    );
    workspace
}

fn evaluators(workspace: &Workspace, arguments: &[&str]) -> Value {
    let ended = workspace.run(&[&["run"], arguments, &["--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    ended.json()["evaluators"][0].clone()
}

#[test]
fn the_cheapest_evaluator_that_is_accurate_enough_judges() {
    let workspace = alone();
    let found = evaluators(&workspace, &["alone.yaml"]);
    let candidates = found["candidates"].as_array().unwrap();
    assert_eq!(candidates.len(), 5, "{found}");
    let suffices = |c: &&Value| c["rmse_mm"].as_f64().unwrap() <= 0.003 && c["disagree"] == 0;
    let cheapest = candidates.iter().find(suffices).unwrap();
    assert_eq!(found["used"], cheapest["settings"]);
    assert!(candidates[0]["rmse_mm"].as_f64().unwrap() > candidates[1]["rmse_mm"].as_f64().unwrap());

    let told = workspace.run(&["run", "alone.yaml"]).stdout;
    let line = format!(
        "design: patterns judged by {{ {} }}",
        cheapest["settings"].as_str().unwrap()
    );
    assert!(
        told.contains(&line) && told.contains("gain over the intuitive design"),
        "{told}"
    );

    let loose = evaluators(
        &workspace,
        &["alone.yaml", "--set", "stages.design.evaluator_accuracy=1 mm"],
    );
    assert_eq!(loose["used"], "method: linear, elements_per_cell: 1, order: 1");
    let named = evaluators(&workspace, &["alone.yaml", "--set", "stages.design.evaluator=chord:2"]);
    assert_eq!(named["used"], "method: chord:2, elements_per_cell: 1, order: 1");
    assert_eq!(named["candidates"], serde_json::json!([]));
}

#[test]
fn a_network_that_is_not_accurate_enough_is_not_taken_unless_it_is_asked_for() {
    let workspace = Workspace::tiny();
    let asked = evaluators(&workspace, &["tiny.yaml", "--until", "design"]);
    assert_eq!(asked["used"], "network: qin2024");
    let chosen = evaluators(
        &workspace,
        &[
            "tiny.yaml",
            "--until",
            "design",
            "--set",
            "stages.design.evaluator=auto",
        ],
    );
    let candidates = chosen["candidates"].as_array().unwrap();
    let network = candidates.iter().find(|c| c["settings"] == "network: qin2024").unwrap();
    assert!(
        network["rmse_mm"].as_f64().unwrap() > 0.02,
        "one epoch of sixty patterns: {chosen}"
    );
    assert!(chosen["used"].as_str().unwrap().starts_with("method: "), "{chosen}");

    // Without a network the same search is refused before anything is built.
    workspace.write("bare.yaml", &TINY.replace("needs: [surrogate], evaluator", "evaluator"));
    let ended = workspace.run(&["plan", "bare.yaml"]);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("judges by a network"), "{}", ended.stderr);
}

#[test]
fn an_evaluator_without_a_single_field_is_a_failure_that_says_so() {
    let workspace = alone();
    let hot = [
        "run",
        "alone.yaml",
        "--set",
        "scene.drive.voltage=20 kV",
        "--set",
        "stages.design.evaluator=linear",
    ];
    let ended = workspace.run(&hot);
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("not stable"), "{}", ended.stderr);
}
