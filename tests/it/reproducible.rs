//! The same pipeline gives the same digests whatever happens on the way.

use std::thread::sleep;
use std::time::Duration;

use super::common::{Workspace, files};

#[test]
fn the_number_of_threads_changes_nothing() {
    let workspace = Workspace::tiny();
    let one = workspace.stages(&["run", "tiny.yaml", "--store", "one", "--jobs", "1"]);
    let two = workspace.stages(&["run", "tiny.yaml", "--store", "two", "--jobs", "2"]);
    assert_eq!(one.digests(), two.digests());
}

#[test]
fn a_killed_run_loses_nothing_that_was_finished_and_ends_the_same() {
    let workspace = Workspace::tiny();
    let undisturbed = workspace.stages(&["run", "tiny.yaml", "--store", "calm"]);
    // Killed ever later, in one store, until a run gets through.
    let mut kept = 0;
    for attempt in 0..40 {
        let mut child = workspace.command(&["run", "tiny.yaml", "--store", "killed", "--json"]);
        let mut child = child
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        sleep(Duration::from_millis(40 + 60 * attempt));
        child.kill().unwrap();
        let finished = child.wait().unwrap().success();
        let records = files(&workspace.path("killed/records")).len();
        assert!(
            records >= kept,
            "finished chunks are kept: {records} records after {kept}"
        );
        kept = records;
        if finished {
            break;
        }
    }
    let resumed = workspace.stages(&["run", "tiny.yaml", "--store", "killed"]);
    assert_eq!(resumed.digests(), undisturbed.digests());
    assert_eq!(workspace.run(&["fsck", "--store", "killed"]).code, Some(0));
    assert_eq!(
        files(&workspace.path("killed/tmp")),
        [""; 0].map(std::path::PathBuf::from),
        "nothing is left behind"
    );
}

#[test]
fn two_runs_at_once_in_one_store_agree() {
    let workspace = Workspace::tiny();
    let start = || {
        let mut command = workspace.command(&["run", "tiny.yaml", "--json"]);
        command
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap()
    };
    let (first, second) = (start(), start());
    let read = |child: std::process::Child| {
        let ended = super::common::Ended::from(child.wait_with_output().unwrap());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        super::common::Stages::read(&ended.json()).digests()
    };
    assert_eq!(read(first), read(second));
}

#[test]
fn damage_is_found_reported_and_repaired() {
    let workspace = Workspace::tiny();
    let before = workspace.stages(&["run", "tiny.yaml", "--until", "solved"]);
    let victim = files(&workspace.path("store/objects"))
        .into_iter()
        .max_by_key(|f| f.metadata().unwrap().len())
        .unwrap();
    let mut bytes = std::fs::read(&victim).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&victim, bytes).unwrap();
    let check = workspace.run(&["fsck"]);
    assert_eq!(check.code, Some(4), "{}", check.stdout);
    let name = victim.file_stem().unwrap().to_str().unwrap();
    assert!(check.stdout.contains(&name[..12]), "{}", check.stdout);
    let after = workspace.stages(&["run", "tiny.yaml", "--until", "solved"]);
    assert_eq!(after.digests(), before.digests());
    assert_eq!(after.chunks("solved"), (1, 4), "only the damaged chunk is built again");
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}
