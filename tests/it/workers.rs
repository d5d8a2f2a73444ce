//! Workers: what a batch system starts, kills and starts again.

use std::path::PathBuf;
use std::process::{Child, Command};
use std::thread::sleep;
use std::time::{Duration, Instant, SystemTime};

use super::common::{Ended, Stages, TINY, Workspace, ended, files, started};

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill")
        .args(["-s", name, &child.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
}

#[test]
fn workers_share_what_is_to_be_done_and_leave_what_a_run_leaves() {
    let workspace = Workspace::tiny();
    let wanted = workspace.stages(&["run", "tiny.yaml", "--store", "alone"]);
    let worker = ["worker", "tiny.yaml", "--jobs", "1", "--json"];
    let workers = [(); 2].map(|()| started(workspace.command(&worker))).map(ended);
    let stages = workers.map(|ended| {
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        Stages::read(&ended.json())
    });
    for name in wanted.names() {
        let built: u64 = stages.iter().map(|stages| stages.chunks(name).0).sum();
        assert_eq!(built, wanted.chunks(name).0, "{name}");
    }
    assert!(stages.iter().all(|stages| stages.digests() == wanted.digests()));
    assert!(
        files(&workspace.path("store/runs")).is_empty(),
        "workers write no history"
    );
    let run = workspace.stages(&["run", "tiny.yaml"]);
    assert_eq!(run.with("built"), [""; 0]);
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn a_worker_that_is_stopped_keeps_its_progress() {
    let workspace = Workspace::new();
    workspace.write("long.yaml", &TINY.replace("epochs: 1,", "epochs: 40,"));
    let wanted = workspace.stages(&["run", "long.yaml", "--until", "surrogate", "--store", "alone"]);
    let worker = ["worker", "long.yaml", "--until", "surrogate"];
    for name in ["TERM", "INT"] {
        let (begun, start) = (SystemTime::now(), Instant::now());
        let child = started(workspace.command(&worker));
        // It has kept something, so it is in the midst of its training.
        let is_new = |path: &PathBuf| std::fs::metadata(path).is_ok_and(|found| found.modified().unwrap() > begun);
        while !files(&workspace.path("store/checkpoints")).iter().any(is_new) {
            assert!(start.elapsed() < Duration::from_secs(60));
            sleep(Duration::from_millis(20));
        }
        signal(&child, name);
        let asked = Instant::now();
        let ended = ended(child);
        assert_eq!(ended.code, Some(75), "{}{}", ended.stdout, ended.stderr);
        assert!(asked.elapsed() < Duration::from_secs(20));
        assert!(!files(&workspace.path("store/checkpoints")).is_empty());
        assert!(files(&workspace.path("store/tmp")).is_empty());
    }
    let last = ended(started(workspace.command(&[&worker[..], &["--json"]].concat())));
    assert_eq!(last.code, Some(0), "{}", last.stderr);
    assert_eq!(Stages::read(&last.json()).digests(), wanted.digests());
}

#[test]
fn the_exit_code_of_a_worker_tells_whether_to_restart_it() {
    let workspace = Workspace::small();
    let code = |arguments: &[&str]| {
        let ended = workspace.run(arguments);
        (ended.code, ended.stderr)
    };
    for (arguments, wanted, words) in [
        (&["worker", "none.yaml"][..], 2, "none.yaml"),
        (&["worker", "small.yaml", "--until", "nothing"], 2, "nothing"),
        (&["worker", "small.yaml", "--chunks", "0-1"], 2, "--until"),
        (
            &["worker", "small.yaml", "--until", "solved", "--chunks", "2-1"],
            2,
            "FIRST-LAST",
        ),
        (
            &["worker", "small.yaml", "--stop-before", "5min"],
            2,
            "SLURM_JOB_END_TIME",
        ),
        (&["worker", "small.yaml", "--stop-before", "5 quarks"], 2, "quarks"),
        (
            &["worker", "small.yaml", "--until", "balanced", "--chunks", "0"],
            1,
            "balanced",
        ),
        (&["worker", "small.yaml", "--stop-before", "1h", "--time", "1h"], 75, ""),
        (
            &["worker", "small.yaml", "--set", "stages.balanced.range=[8 mm, 9 mm]"],
            1,
            "balanced",
        ),
        (
            &["worker", "small.yaml", "--stop-before", "1min", "--time", "1h"],
            0,
            "",
        ),
    ] {
        let (code, said) = code(arguments);
        assert_eq!(code, Some(wanted), "{arguments:?}: {said}");
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
    // A disk that refuses is no fault of the work.
    let mut command = workspace.dressed("sh");
    let binary = workspace.command(&[]).get_program().to_owned();
    let limited = "ulimit -f 2; exec \"$0\" worker small.yaml --store other";
    let ended = Ended::from(command.args(["-c", limited]).arg(binary).output().unwrap());
    assert_eq!(ended.code, Some(75), "{}", ended.stderr);
}
