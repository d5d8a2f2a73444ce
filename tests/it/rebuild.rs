//! A rerun rebuilds nothing; a tweak rebuilds what depends on it and no more.

use super::common::{TINY, Workspace};

#[test]
fn only_what_changed_is_built() {
    let workspace = Workspace::tiny();
    let first = workspace.stages(&["run", "tiny.yaml"]);
    assert_eq!(first.with("built").len(), 10);

    let again = workspace.stages(&["run", "tiny.yaml"]);
    assert_eq!(again.with("built"), [""; 0], "a rerun builds nothing");
    assert_eq!(again.digests(), first.digests());

    let tweaked = workspace.stages(&["run", "tiny.yaml", "--set", "stages.design.generations=3"]);
    assert_eq!(tweaked.with("built"), ["design", "verified"]);

    // 60 → 110 small grids: the chunk 0..50 stays, 50..60 becomes 50..100, 100..110 is new.
    let larger = workspace.stages(&[
        "run",
        "tiny.yaml",
        "--until",
        "solved",
        "--set",
        "stages.small.count=110",
    ]);
    assert_eq!(larger.chunks("small"), (2, 1));
    assert_eq!(larger.chunks("solved"), (2, 4));
    assert_eq!(larger.with("built"), ["small", "solved"]);

    let voltage = workspace.stages(&[
        "run",
        "tiny.yaml",
        "--until",
        "solved",
        "--set",
        "scene.drive.voltage=\"5 kV\"",
    ]);
    assert_eq!(voltage.with("built"), ["solved"], "another voltage keeps all samples");

    let back = workspace.stages(&["run", "tiny.yaml"]);
    assert_eq!(
        back.with("built"),
        [""; 0],
        "setting parameters back finds the old artifacts"
    );
    assert_eq!(back.digests(), first.digests());
}

#[test]
fn names_order_comments_and_units_rebuild_nothing() {
    let workspace = Workspace::tiny();
    workspace.stages(&["run", "tiny.yaml", "--until", "solved"]);
    let rewritten = TINY
        .replace("small:  ", "# the small ones\n  cells:  ")
        .replace("[small, ", "[cells, ")
        .replace(
            "kind: sample, family: bezier, count: 8, seed: 3",
            "seed: 3, count: 8, family: bezier, kind: sample",
        )
        .replace("voltage: 5.25 kV", "voltage: 5250 V")
        .replace("side: 50 mm", "side: 5 cm")
        .replace("units: [2, 3]", "units: [3, 2]");
    workspace.write("rewritten.yaml", &rewritten);
    let stages = workspace.stages(&["run", "rewritten.yaml", "--until", "solved"]);
    assert_eq!(stages.with("built"), [""; 0]);
    assert!(stages.names().contains(&"cells"));
}

#[test]
fn plan_says_what_and_why_and_builds_nothing() {
    let workspace = Workspace::tiny();
    let plan = workspace.stages(&["plan", "tiny.yaml"]);
    assert_eq!(plan.with("stale").len(), 10);
    assert!(!workspace.path("store").exists(), "not even an empty store is made");
    assert_eq!(
        workspace.stages(&["plan", "tiny.yaml"]).with("reused"),
        [""; 0],
        "a plan builds nothing"
    );

    workspace.stages(&["run", "tiny.yaml", "--until", "solved"]);
    let plan = workspace.stages(&[
        "plan",
        "tiny.yaml",
        "--until",
        "solved",
        "--set",
        "stages.small.count=110",
    ]);
    assert_eq!(plan.with("stale"), ["small", "solved"]);
    assert_eq!(plan.chunks("solved"), (2, 4));
    let why = plan.stage("small")["why"].as_str().unwrap();
    assert!(
        why.contains("count") && why.contains("60") && why.contains("110"),
        "{why}"
    );
    let why = plan.stage("solved")["why"].as_str().unwrap();
    assert!(why.contains("small"), "{why}");
}
