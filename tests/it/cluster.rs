//! Workers that an engine starts: what is submitted, killed, cancelled and lost ends with the digests of a run on one
//! machine.
//!
//! `scale/slurm` stands for Slurm. `tests/cluster.sh` does the same with a real one.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use super::common::{Ended, SHORT, SMALL, Stages, Transcript, Workspace, ended, files, snapshot, started};

/// Thirty chunks of samples and thirty of solutions.
const COUNT: &str = "stages.small.count=1500";

const PROFILE: &str = "version: 1
executor: slurm
cpu: any
defaults: { workers: 2, threads: 1, memory: 1 GB, time: 1 h, retries: 2 }
kinds: { sample: { workers: 1 } }
";

/// A cluster, and a workspace with `short.yaml` and `cluster.yaml` in it.
struct Cluster {
    workspace: Workspace,
}

impl Cluster {
    fn new() -> Self {
        let workspace = Workspace::new();
        // Of more cells: the work must last until it is interrupted.
        workspace.write("short.yaml", &SHORT.replace("cells: 20", "cells: 50"));
        workspace.write("cluster.yaml", PROFILE);
        fs::create_dir_all(workspace.path("slurm/jobs")).unwrap();
        fs::create_dir(workspace.path("slurm/bin")).unwrap();
        let fake = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/scale/slurm");
        for name in ["sbatch", "squeue", "scancel", "scontrol"] {
            symlink(&fake, workspace.path("slurm/bin").join(name)).unwrap();
        }
        Self { workspace }
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = self.workspace.command(arguments);
        let path = std::env::var("PATH").unwrap();
        let own = self.workspace.path("slurm/bin");
        command.env("PATH", format!("{}:{path}", own.display()));
        command.env("FAKE_SLURM", self.workspace.path("slurm"));
        command.env("DEAFLOW_ASK_SECONDS", "0.2");
        command
    }

    /// Begins a run on the cluster.
    fn run(&self, more: &[&str]) -> Child {
        let run = [
            "run",
            "short.yaml",
            "--profile",
            "cluster.yaml",
            "--json",
            "--set",
            COUNT,
        ];
        started(self.command(&[&run[..], more].concat()))
    }

    /// How many workers have been submitted.
    fn submitted(&self) -> usize {
        let calls = fs::read_to_string(self.workspace.path("slurm/calls")).unwrap_or_default();
        let arrays = calls.lines().filter(|call| call.starts_with("sbatch"));
        let tasks = arrays.filter_map(|call| {
            call.split("--array=0-")
                .nth(1)?
                .split(' ')
                .next()?
                .parse::<usize>()
                .ok()
        });
        tasks.map(|last| last + 1).sum()
    }

    /// Numbers of the processes of tasks that live.
    fn tasks(&self) -> Vec<String> {
        let jobs = files(&self.workspace.path("slurm/jobs"));
        let text = |path| fs::read_to_string(path).unwrap_or_default();
        let numbers = jobs
            .into_iter()
            .filter_map(|path| Some(text(path).split(' ').next()?.to_owned()));
        let lives = |number: &String| {
            let stat = text(Path::new("/proc").join(number).join("stat"));
            !stat.is_empty() && !stat.contains(") Z ")
        };
        numbers.filter(lives).collect()
    }

    fn until(&self, what: &str, mut is_so: impl FnMut() -> bool) {
        let start = Instant::now();
        while !is_so() {
            assert!(start.elapsed() < Duration::from_secs(120), "{what}");
            sleep(Duration::from_millis(20));
        }
    }

    /// Waits until some solutions are there, and not all.
    fn wait_for_work(&self) {
        self.until("some work", || files(&self.workspace.path("store/records")).len() > 33);
    }

    /// What the pipeline makes on one machine, and a store that is sound and has no worker any more.
    fn is_as_alone(&self, stages: &Stages) {
        let alone = self
            .workspace
            .stages(&["run", "short.yaml", "--store", "alone", "--set", COUNT]);
        assert_eq!(stages.digests(), alone.digests());
        let fsck = self.workspace.run(&["fsck"]);
        assert_eq!(fsck.code, Some(0), "{}", fsck.stdout);
        self.until("the end of all workers", || self.tasks().is_empty());
        let status = self.workspace.run(&["status", "--json"]).json();
        assert_eq!(status["workers"], serde_json::json!([]));
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        let _ = fs::remove_file(self.workspace.path("slurm/held"));
        for process in self.tasks() {
            signal(&process, "KILL");
        }
    }
}

fn signal(process: &str, name: &str) {
    // It may have ended.
    let _ = Command::new("kill")
        .args(["-s", name, process])
        .stderr(Stdio::null())
        .status();
}

#[test]
fn a_run_on_a_cluster_makes_what_a_run_here_makes_and_a_rerun_asks_nobody() {
    let cluster = Cluster::new();
    fs::write(cluster.workspace.path("slurm/held"), "").unwrap();
    let run = cluster.run(&[]);
    cluster.until("an array", || cluster.submitted() == 1);
    fs::remove_file(cluster.workspace.path("slurm/held")).unwrap();
    let mut seen = serde_json::Value::Null;
    cluster.until("a worker in the status", || {
        seen = cluster.workspace.run(&["status", "--json"]).json()["workers"][0].clone();
        seen["pipeline"] == "short"
    });
    assert!(seen["array"].as_str().unwrap().starts_with("deaflow-"), "{seen}");
    let stages = Stages::of(run);
    cluster.is_as_alone(&stages);
    assert_eq!(stages.with("built"), [""; 0], "workers have built all of it");
    assert_eq!(cluster.submitted(), 3, "one for the samples, two for the solutions");
    let calls = fs::read_to_string(cluster.workspace.path("slurm/calls")).unwrap();
    let first = calls.lines().find(|call| call.starts_with("sbatch")).unwrap();
    assert!(first.contains("--time=60") && first.contains("--mem=954M"), "{first}");
    fs::write(cluster.workspace.path("slurm/down"), "").unwrap();
    let before = fs::read_to_string(cluster.workspace.path("slurm/calls")).unwrap();
    assert_eq!(Stages::of(cluster.run(&[])).digests(), stages.digests());
    assert_eq!(
        fs::read_to_string(cluster.workspace.path("slurm/calls")).unwrap(),
        before
    );
}

#[test]
fn what_is_killed_or_cancelled_is_gone_on_with() {
    let cluster = Cluster::new();
    // The submitter: another finds its array and starts none beside it.
    let mut first = cluster.run(&[]);
    cluster.wait_for_work();
    first.kill().unwrap();
    first.wait().unwrap();
    let submitted = cluster.submitted();
    let second = cluster.run(&[]);
    sleep(Duration::from_millis(500));
    assert_eq!(cluster.submitted(), submitted);
    // Its workers, one and then all of them.
    signal(
        cluster.tasks().first().expect("workers live on without a submitter"),
        "KILL",
    );
    sleep(Duration::from_millis(500));
    let left = cluster.tasks();
    assert!(!left.is_empty());
    left.iter().for_each(|process| signal(process, "TERM"));
    cluster.is_as_alone(&Stages::of(second));
    assert!(cluster.submitted() > submitted);
}

#[test]
fn of_two_submitters_one_submits_and_both_report_the_results() {
    let cluster = Cluster::new();
    // Arrays of this cluster have one task.
    fs::write(cluster.workspace.path("slurm/size"), "1").unwrap();
    let runs = [cluster.run(&[]), cluster.run(&[])];
    let [first, second] = runs.map(Stages::of);
    assert_eq!(first.digests(), second.digests());
    cluster.is_as_alone(&first);
    let calls = fs::read_to_string(cluster.workspace.path("slurm/calls")).unwrap();
    let arrays: Vec<&str> = calls.lines().filter(|call| call.starts_with("sbatch")).collect();
    assert!(arrays.iter().all(|call| call.contains("--array=0-0 ")), "{arrays:?}");
    assert!((3..=4).contains(&arrays.len()), "{arrays:?}");
}

#[test]
fn an_interrupt_cancels_and_what_was_built_is_kept() {
    let cluster = Cluster::new();
    let run = cluster.run(&[]);
    cluster.wait_for_work();
    // A terminal that is closed is no wish to cancel.
    signal(&run.id().to_string(), "HUP");
    sleep(Duration::from_millis(700));
    assert!(!cluster.tasks().is_empty());
    signal(&run.id().to_string(), "INT");
    let ended = ended(run);
    assert_eq!(ended.code, Some(75), "{}", ended.stderr);
    assert!(ended.stderr.contains("cancel"), "{}", ended.stderr);
    cluster.until("the end of all workers", || cluster.tasks().is_empty());
    let kept = files(&cluster.workspace.path("store/records")).len();
    let attach = ["attach", "short.yaml", "--json", "--set", COUNT];
    let wrong = cluster.workspace.run(&["attach", "short.yaml"]);
    assert_eq!(
        (wrong.code, wrong.stderr.contains("--set")),
        (Some(2), true),
        "{}",
        wrong.stderr
    );
    let stages = Stages::of(started(cluster.command(&attach)));
    assert!(files(&cluster.workspace.path("store/records")).len() > kept);
    cluster.is_as_alone(&stages);
}

#[test]
fn a_controller_that_does_not_answer_says_nothing_of_its_workers() {
    let cluster = Cluster::new();
    let run = cluster.run(&[]);
    cluster.until("samples", || cluster.submitted() > 1);
    let submitted = cluster.submitted();
    let asked = || fs::read_to_string(cluster.workspace.path("slurm/calls")).unwrap().len();
    let before = asked();
    fs::write(cluster.workspace.path("slurm/down"), "").unwrap();
    cluster.until("a question", || asked() > before);
    sleep(Duration::from_millis(1000));
    fs::remove_file(cluster.workspace.path("slurm/down")).unwrap();
    let ended = ended(run);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("Unable to contact slurm controller"),
        "{}",
        ended.stderr
    );
    assert_eq!(cluster.submitted(), submitted);
    cluster.is_as_alone(&Stages::read(&ended.json()));
}

#[test]
fn a_stage_that_no_worker_can_build_fails_and_is_not_retried() {
    let cluster = Cluster::new();
    cluster.workspace.write("small.yaml", SMALL);
    let nothing = "stages.balanced.range=[8 mm, 9 mm]";
    let run = ["run", "small.yaml", "--profile", "cluster.yaml", "--set", nothing];
    let ended = ended(started(cluster.command(&run)));
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert!(ended.stderr.contains("`balanced`"), "{}", ended.stderr);
    assert!(cluster.submitted() <= 4, "{}", cluster.submitted());
    cluster.until("the end of all workers", || cluster.tasks().is_empty());
    assert_eq!(cluster.workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn workers_that_end_again_and_again_are_given_up() {
    let cluster = Cluster::new();
    let profile = format!("{PROFILE}environment: [\"echo no such module >&2; exit 7\"]\n");
    cluster.workspace.write("cluster.yaml", &profile);
    let ended = ended(cluster.run(&[]));
    assert_eq!(ended.code, Some(75), "{}", ended.stderr);
    assert_eq!(cluster.submitted(), 3, "the first and two retries");
    let logs = files(&cluster.workspace.path("store/cluster"));
    let said = |path: &&std::path::PathBuf| fs::read_to_string(path).unwrap_or_default().contains("no such module");
    assert!(logs.iter().any(|path| said(&path)), "{logs:?}");
}

#[test]
fn any_engine_starts_workers_by_a_command() {
    let cluster = Cluster::new();
    let submit = "for i in $(seq {n}); do {worker} > /dev/null 2>&1 & done; echo 7";
    let run = ["run", "short.yaml", "--submit", submit, "--set", COUNT];
    let detached = Ended::from(
        cluster
            .command(&[&run[..], &["--detach", "--json"]].concat())
            .output()
            .unwrap(),
    );
    assert_eq!(detached.code, Some(0), "{}", detached.stderr);
    let submitter = detached.json()["submitter"].to_string();
    let stages = Stages::of(started(cluster.command(&[
        "attach",
        "short.yaml",
        "--json",
        "--set",
        COUNT,
    ])));
    cluster.until("the end of the submitter", || {
        let stat = fs::read_to_string(format!("/proc/{submitter}/stat")).unwrap_or_default();
        stat.is_empty() || stat.contains(") Z ")
    });
    cluster.until("the end of all workers", || {
        cluster.workspace.run(&["status", "--json"]).json()["workers"] == serde_json::json!([])
    });
    cluster.is_as_alone(&stages);
}

#[test]
fn whoever_attaches_may_cancel_what_no_engine_can() {
    const LONG: &str = "stages.small.count=6000";
    let cluster = Cluster::new();
    let submit = "for i in $(seq {n}); do {worker} > /dev/null 2>&1 & done";
    cluster
        .workspace
        .write("cluster.yaml", &PROFILE.replace("executor: slurm", "executor: command"));
    let run = [
        "run",
        "short.yaml",
        "--profile",
        "cluster.yaml",
        "--submit",
        submit,
        "--set",
        LONG,
    ];
    let run = started(cluster.command(&run));
    cluster.until("solutions", || {
        files(&cluster.workspace.path("store/records")).len() > 125
    });
    // Who only follows leaves the workers to the other.
    let follower = started(cluster.command(&["attach", "short.yaml", "--set", LONG]));
    sleep(Duration::from_millis(1500));
    signal(&follower.id().to_string(), "INT");
    let left = ended(follower);
    assert_eq!(left.code, Some(75), "{}", left.stderr);
    let workers = || {
        cluster.workspace.run(&["status", "--json"]).json()["workers"]
            .as_array()
            .unwrap()
            .len()
    };
    assert!(workers() > 0);
    let cancelled = cluster
        .workspace
        .run(&["attach", "short.yaml", "--set", LONG, "--cancel"]);
    assert_eq!(cancelled.code, Some(0), "{}", cancelled.stderr);
    let run = ended(run);
    assert_eq!(
        (run.code, run.stderr.contains("cancel")),
        (Some(75), true),
        "{}",
        run.stderr
    );
    cluster.until("the end of all workers", || workers() == 0);
    assert_eq!(cluster.workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn mistakes_in_a_profile_are_refused_with_their_line() {
    let cluster = Cluster::new();
    let mut printed = Transcript::default();
    for (line, named) in [
        ("defaults: { worker: 2 }", "`workers`"),
        ("stages: { solvd: { workers: 2 } }", "`solved`"),
        ("kinds: { solver: { workers: 2 } }", "`solve`"),
        ("defaults: { memory: 8 }", "GB"),
        ("defaults: { time: 2 }", "2 h"),
        ("cpu: x86-64-v5", "x86-64-v3"),
        ("executor: sge", "command"),
        ("environment: [\"a\\nb\"]", "environment"),
    ] {
        cluster
            .workspace
            .write("cluster.yaml", &format!("version: 1\n{line}\n"));
        let refused = cluster
            .workspace
            .run(&["run", "short.yaml", "--executor", "slurm", "--profile", "cluster.yaml"]);
        assert_eq!(refused.code, Some(2), "{line}: {}", refused.stderr);
        let is_shown = refused.stderr.contains("cluster.yaml:2:") && refused.stderr.contains(named);
        assert!(is_shown, "{line}: {}", refused.stderr);
        printed.add(line, refused);
    }
    for (arguments, named) in [
        (&["--executor", "command"][..], "--submit"),
        (&["--submit", "run.sh {n}"], "{worker}"),
        (&["--detach"], "--executor"),
    ] {
        let refused = cluster.workspace.run(&[&["run", "short.yaml"], arguments].concat());
        assert_eq!(
            (refused.code, refused.stderr.contains(named)),
            (Some(2), true),
            "{}",
            refused.stderr
        );
        printed.add(arguments.join(" "), refused);
    }
    let mut none = cluster.workspace.command(&["run", "short.yaml", "--executor", "slurm"]);
    let none = Ended::from(none.env("PATH", cluster.workspace.path("nothing")).output().unwrap());
    assert_eq!(
        (none.code, none.stderr.contains("Slurm")),
        (Some(1), true),
        "{}",
        none.stderr
    );
    printed.add("--executor slurm without Slurm", none.stderr);
    snapshot!(printed);
}
