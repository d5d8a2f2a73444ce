//! What `gc` takes and what it leaves.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::common::{SHORT, Workspace, files};

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("short.yaml", SHORT);
    workspace
}

fn objects(store: &Path) -> BTreeSet<PathBuf> {
    files(&store.join("objects")).into_iter().collect()
}

#[test]
fn what_the_last_runs_need_stays_and_the_rest_goes() {
    let workspace = workspace();
    let store = workspace.path("store");
    workspace.stages(&["run", "short.yaml"]);
    let first = objects(&store);
    workspace.stages(&["run", "short.yaml", "--set", "stages.small.seed=2"]);
    let both = objects(&store);
    assert!(both.is_superset(&first) && both.len() == 2 * first.len());

    // Young as everything is, nothing goes.
    let young = workspace.run(&["gc", "--keep-runs", "1", "--json"]).json();
    assert_eq!(young["removed"].as_array().unwrap().len(), 0);

    let rehearsal = workspace.run(&["gc", "--keep-runs", "1", "--grace", "0", "--dry-run", "--json"]);
    assert_eq!(rehearsal.json()["removed"].as_array().unwrap().len(), first.len());
    assert_eq!(objects(&store), both, "a dry run removes nothing");

    let done = workspace.run(&["gc", "--keep-runs", "1", "--grace", "0", "--json"]);
    assert_eq!(done.code, Some(0), "{}", done.stderr);
    assert_eq!(done.json()["removed"], rehearsal.json()["removed"]);
    assert_eq!(objects(&store), both.difference(&first).cloned().collect());
    let held = done.json()["kept"][0]["held_by"][0].clone();
    assert!(held.as_str().unwrap().starts_with("run of short at "), "{held}");

    let again = workspace.stages(&["run", "short.yaml", "--set", "stages.small.seed=2"]);
    assert_eq!(again.with("reused"), ["small", "solved"]);
    let rebuilt = workspace.stages(&["run", "short.yaml"]);
    assert_eq!(rebuilt.with("built"), ["small", "solved"]);
    assert_eq!(objects(&store), both, "built again to the same digests");
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn a_pin_keeps_an_artifact_its_chunks_and_what_it_was_made_from() {
    let workspace = workspace();
    let store = workspace.path("store");
    workspace.stages(&["run", "short.yaml"]);
    let first = objects(&store);
    assert_eq!(
        workspace.run(&["pin", "solved", "--label", "for the paper"]).code,
        Some(0)
    );
    let pins = workspace.run(&["pin", "--json"]).json();
    assert_eq!(pins["pins"][0]["label"], "for the paper");
    workspace.stages(&["run", "short.yaml", "--set", "stages.small.seed=2"]);
    let both = objects(&store);
    workspace.run(&["gc", "--keep-runs", "1", "--grace", "0"]);
    assert_eq!(objects(&store), both);

    let digest = pins["pins"][0]["digest"].as_str().unwrap();
    assert_eq!(workspace.run(&["unpin", &digest[..8]]).code, Some(0));
    assert_eq!(workspace.run(&["unpin", &digest[..8]]).code, Some(2));
    workspace.run(&["gc", "--keep-runs", "1", "--grace", "0"]);
    assert_eq!(objects(&store), both.difference(&first).cloned().collect());
}

#[test]
fn a_store_that_is_not_there_or_reaches_into_damage_is_not_collected() {
    let workspace = workspace();
    assert_eq!(workspace.run(&["gc"]).code, Some(2));
    assert!(!workspace.path("store").exists());

    workspace.stages(&["run", "short.yaml"]);
    let before = objects(&workspace.path("store"));
    let digest = workspace.run(&["show", "solved", "--json"]).json()["digest"]
        .as_str()
        .unwrap()
        .to_owned();
    let manifest = workspace
        .path("store")
        .join("objects")
        .join(&digest[..2])
        .join(format!("{digest}.h5"));
    let mut bytes = std::fs::read(&manifest).unwrap();
    let last = bytes.len() - 9;
    bytes[last] ^= 1;
    std::fs::write(&manifest, bytes).unwrap();
    let ended = workspace.run(&["gc", "--grace", "0", "--keep-runs", "1"]);
    assert_eq!(ended.code, Some(4), "{}", ended.stderr);
    assert!(ended.stderr.contains("damaged"), "{}", ended.stderr);
    assert_eq!(objects(&workspace.path("store")), before);
}
