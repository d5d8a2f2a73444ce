//! Two processes in one store share the work.

use std::thread::sleep;
use std::time::Duration;

use super::common::{SMALL, Stages, Workspace, files, started};

/// Enough chunks that two processes meet.
const COUNT: &str = "stages.small.count=250";

fn built(stages: &Stages, name: &str) -> u64 {
    stages.chunks(name).0
}

#[test]
fn two_runs_of_one_pipeline_build_each_chunk_once() {
    let workspace = Workspace::small();
    let arguments = ["run", "small.yaml", "--json", "--jobs", "1", "--set", COUNT];
    let (first, second) = (
        started(workspace.command(&arguments)),
        started(workspace.command(&arguments)),
    );
    let (first, second) = (Stages::of(first), Stages::of(second));
    assert_eq!(first.digests(), second.digests());
    for (name, pieces) in [("small", 5), ("large", 1), ("solved", 6), ("balanced", 1)] {
        let by_both = built(&first, name) + built(&second, name);
        assert_eq!(
            by_both,
            pieces,
            "{name}: {} and {}",
            built(&first, name),
            built(&second, name)
        );
    }
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn two_pipelines_that_overlap_share_what_they_have_in_common() {
    let workspace = Workspace::small();
    let other = SMALL
        .replace("name: small", "name: other")
        .replace("solved: ", "done: ")
        .replace("[solved]", "[done]");
    workspace.write("other.yaml", &other.replace("bins: 5", "bins: 6"));
    let run = |file: &str| started(workspace.command(&["run", file, "--json", "--set", COUNT]));
    let (first, second) = (run("small.yaml"), run("other.yaml"));
    let (first, second) = (Stages::of(first), Stages::of(second));
    assert_eq!(first.digests()["solved"], second.digests()["done"]);
    assert_eq!(built(&first, "solved") + built(&second, "done"), 6);
    assert_eq!(built(&first, "balanced") + built(&second, "balanced"), 2);
}

#[test]
fn a_run_takes_over_from_one_that_was_killed_beside_it() {
    let workspace = Workspace::small();
    let arguments = ["run", "small.yaml", "--json", "--jobs", "1", "--set", COUNT];
    let alone = workspace.stages(&["run", "small.yaml", "--store", "calm", "--set", COUNT]);
    let (mut first, second) = (
        started(workspace.command(&arguments)),
        started(workspace.command(&arguments)),
    );
    // Once eight records are there the two are in the middle of their work, whatever the machine.
    while files(&workspace.path("store/records")).len() < 8 && first.try_wait().unwrap().is_none() {
        sleep(Duration::from_millis(2));
    }
    first.kill().unwrap();
    first.wait().unwrap();
    assert_eq!(Stages::of(second).digests(), alone.digests());
    let again = workspace.stages(&["run", "small.yaml", "--set", COUNT]);
    assert_eq!((again.with("built"), again.digests()), (vec![], alone.digests()));
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
    assert!(files(&workspace.path("store/tmp")).is_empty());
}
