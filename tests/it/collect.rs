//! What `gc` takes and what it leaves.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::common::{Ended, SHORT, Transcript, Workspace, files, snapshot};

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

    // A line of advice begins with the number of artifacts that no pin keeps, whatever the label of the pin.
    let advice = || {
        let text = workspace.run(&["gc", "--grace", "0", "-n"]).stdout;
        let line = text.lines().find(|line| line.contains("--keep-runs"));
        line.map(|line| line.split(' ').next().unwrap().parse::<usize>().unwrap())
    };
    let before = advice().expect("runs keep all");
    assert_eq!(before, both.len());
    assert_eq!(
        workspace.run(&["pin", "solved", "--label", "run of mine"]).code,
        Some(0)
    );
    assert!(advice().expect("runs keep the others") < before);
    assert_eq!(workspace.run(&["unpin", "solved"]).code, Some(0));
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
    assert!(held.as_str().unwrap().contains("short"), "{held}");

    // The last run had other parameters; that is not why what this one would make is gone.
    let plan = workspace.run(&["plan", "short.yaml", "--json"]).json();
    for stage in plan["stages"].as_array().unwrap() {
        let why = stage["why"].as_str().unwrap();
        assert!(why.contains("gc"), "{stage}");
    }
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
    assert!(ended.stderr.contains(&digest[..12]), "{ended}");
    snapshot!(ended);
    assert_eq!(objects(&workspace.path("store")), before);
}

/// The last run of a pipeline with figures, and one before whose artifacts a collection has taken.
fn collected() -> (Workspace, String) {
    let workspace = Workspace::small();
    let first = workspace.stages(&["run", "small.yaml"]);
    let digest = first.digests()["balanced"].clone();
    workspace.stages(&["run", "small.yaml", "--set", "stages.small.seed=2"]);
    let gc = workspace.run(&["gc", "--keep-runs", "1", "--grace", "0"]);
    assert_eq!(gc.code, Some(0), "{}", gc.stderr);
    (workspace, digest)
}

#[test]
fn messages_about_a_removed_artifact_name_the_collection() {
    let (workspace, digest) = collected();
    let removed = |ended: &Ended| {
        assert_eq!(ended.code, Some(2), "{}", ended.stdout);
        assert!(
            ended.stderr.contains(&digest[..12]) && ended.stderr.contains("gc"),
            "{}",
            ended.stderr
        );
    };
    let mut printed = Transcript::default();
    let ended = workspace.run(&["show", &digest]);
    removed(&ended);
    printed.add("show a removed artifact", ended);
    removed(&workspace.run(&["show", &digest[..6]]));
    removed(&workspace.run(&["pin", &digest[..6]]));
    // What was never here is not said to have been removed.
    let unknown = workspace.run(&["show", "0123456789"]);
    assert!(!unknown.stderr.contains("gc"), "{unknown}");
    printed.add("show an unknown artifact", unknown);

    let log = workspace.run(&["log", "--json"]).json();
    let stages = |run: usize| log["runs"][run]["stages"].as_array().unwrap().clone();
    let gone = |stages: &[serde_json::Value]| -> Vec<String> {
        let gone = stages.iter().filter(|stage| stage["removed"].is_string());
        gone.map(|stage| stage["name"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(gone(&stages(0)), [] as [String; 0]);
    assert_eq!(
        gone(&stages(1)),
        ["small", "solved", "balanced"],
        "`large` is in both runs"
    );
    printed.add("log", workspace.run(&["log"]));

    // All of the only run is gone.
    let gc = workspace.run(&["gc", "--keep-runs", "0", "--grace", "0"]);
    assert_eq!(gc.code, Some(0), "{}", gc.stderr);
    let set = ["--set", "stages.small.seed=2"];
    let plan = workspace
        .run(&[&["plan", "small.yaml", "--json"][..], &set].concat())
        .json();
    for stage in plan["stages"].as_array().unwrap() {
        let why = stage["why"].as_str().unwrap();
        assert!(why.contains("gc"), "{stage}");
    }
    let report = workspace.run(&[&["report", "small.yaml", "-o", "out"][..], &set].concat());
    assert_eq!(report.code, Some(2));
    assert!(report.stderr.contains("gc"), "{report}");
    printed.add("report", report);
    let show = workspace.run(&["show", "balanced"]);
    assert!(show.stderr.contains("gc"), "{show}");
    printed.add("show the last run", show);
    snapshot!(printed);

    // Built again, and lost by no collection: that is damage.
    workspace.stages(&[&["run", "small.yaml"][..], &set].concat());
    let digest = workspace.run(&["show", "balanced", "--json"]).json()["digest"].clone();
    let digest = digest.as_str().unwrap();
    let file = format!("store/objects/{}/{digest}.h5", &digest[..2]);
    std::fs::remove_file(workspace.path(&file)).unwrap();
    let lost = workspace.run(&["show", digest]);
    assert!(!lost.stderr.contains(" gc "), "{lost}");
}

#[test]
fn figures_go_with_what_they_show() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let figures = || files(&workspace.path("store/figures/small"));
    let first = figures();
    assert!(first.len() > 1, "a figure and whose it is");
    std::fs::write(workspace.path("store/figures/small/mine.png"), "mine").unwrap();
    workspace.stages(&["run", "small.yaml", "--set", "stages.small.seed=2"]);
    let both = figures();
    let dry = workspace
        .run(&["gc", "--keep-runs", "1", "--grace", "0", "-n", "--json"])
        .json();
    let would: Vec<&str> = dry["figures_removed"]
        .as_array()
        .unwrap()
        .iter()
        .map(|path| path.as_str().unwrap())
        .collect();
    assert!(!would.is_empty());
    assert_eq!(figures(), both);
    workspace.run(&["gc", "--keep-runs", "1", "--grace", "0"]);
    let left = figures();
    assert_eq!(left.len(), both.len() - would.len());
    assert!(
        left.iter().any(|path| path.ends_with("mine.png")),
        "what is not ours stays"
    );
    std::fs::remove_file(workspace.path("store/figures/small/mine.png")).unwrap();
    workspace.run(&["gc", "--keep-runs", "0", "--grace", "0"]);
    assert!(!workspace.path("store/figures/small").exists());
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn a_dry_run_counts_by_stages() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    workspace.stages(&["run", "small.yaml", "--set", "stages.small.seed=2"]);
    let gc = ["gc", "--keep-runs", "1", "--grace", "0", "-n"];
    let document = workspace.run(&[&gc[..], &["--json"]].concat()).json();
    let stages = document["stages"].as_array().unwrap();
    let names: Vec<&str> = stages.iter().map(|stage| stage["stage"].as_str().unwrap()).collect();
    assert_eq!(names, ["balanced", "large", "small", "solved"]);
    let count = |stage: &serde_json::Value, of: &str| stage[of]["artifacts"].as_u64().unwrap();
    // One of two artifacts of `balanced` goes, nothing of `large`, which both runs have.
    assert_eq!((count(&stages[0], "removed"), count(&stages[0], "kept")), (1, 1));
    assert_eq!(count(&stages[1], "removed"), 0);
    let sum = |of: &str, what: &str| {
        stages
            .iter()
            .map(|stage| stage[of][what].as_u64().unwrap())
            .sum::<u64>()
    };
    assert_eq!(
        sum("removed", "artifacts"),
        document["removed"].as_array().unwrap().len() as u64
    );
    assert_eq!(sum("removed", "bytes"), document["bytes_removed"].as_u64().unwrap());
    assert_eq!(sum("kept", "bytes"), document["bytes_kept"].as_u64().unwrap());
    let listed = workspace.run(&gc);
    assert!(listed.stdout.contains("small:balanced"), "{listed}");
    snapshot!(listed);
}

#[test]
fn a_result_can_be_kept_without_what_it_was_made_from() {
    let workspace = Workspace::small();
    let digests = workspace.stages(&["run", "small.yaml"]).digests();
    let pin = workspace.run(&["pin", "solved", "--result-only", "--json"]).json();
    assert_eq!(pin["pins"][0]["result_only"], true);
    let gc = || workspace.run(&["gc", "--keep-runs", "0", "--grace", "0", "--json"]);
    assert_eq!(gc().code, Some(0));
    // Again: what it was made from is missing, and that is no obstacle.
    let kept = gc();
    assert_eq!(kept.code, Some(0), "{}", kept.stderr);
    let kinds: BTreeSet<String> = kept.json()["kept"]
        .as_array()
        .unwrap()
        .iter()
        .map(|judged| judged["kind"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(kinds, ["solve", "solve chunk"].map(str::to_owned).into());
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
    let solved = digests["solved"].as_str();
    assert_eq!(workspace.run(&["show", &solved[..8]]).code, Some(0));
    let export = ["export", "artifact", &solved[..8], "-o", "solved.h5"];
    assert_eq!(workspace.run(&export).code, Some(0));
    // Pinned with all that it was made from it would stop every later collection.
    let whole = workspace.run(&["pin", &solved[..8]]);
    assert_eq!(whole.code, Some(2));
    assert!(whole.stderr.contains("--result-only"), "{}", whole.stderr);
    snapshot!(workspace.run(&["pin"]));
    // Once its inputs are built again, it is reused.
    let again = workspace.stages(&["run", "small.yaml"]);
    assert_eq!(again.with("reused"), ["solved"]);
    assert_eq!(again.digests(), digests);
}
