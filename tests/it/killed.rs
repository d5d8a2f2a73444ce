//! A run that is killed at any moment loses nothing that it had finished, and the next one ends as if nothing had been.

use std::fs;
use std::path::PathBuf;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use super::common::{Stages, Workspace, files};

/// Chunks and whole artifacts that a run built; manifests are no work.
fn built(stages: &Stages) -> u64 {
    stages.names().iter().map(|name| stages.chunks(name).0).sum()
}

/// The records of what was built: a piece of work is kept once its record is there.
fn records(workspace: &Workspace) -> Vec<PathBuf> {
    files(&workspace.path("store/records"))
}

#[test]
fn a_run_killed_at_any_moment_is_gone_on_with() {
    const RUN: [&str; 6] = ["run", "small.yaml", "--jobs", "2", "--until", "solved"];
    const KILLS: u64 = 12;
    let undisturbed = Workspace::small().stages(&RUN);
    let manifests = undisturbed.names().len() as u64;
    let mut midway = 0;
    for k in 0..KILLS {
        let workspace = Workspace::small();
        let mut child = workspace.command(&RUN);
        let mut child = child.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        // By what is done and not by the clock: one run is faster than another. A little later it is anywhere in what
        // comes next; the golden ratio spreads these moments evenly.
        let wanted = (built(&undisturbed) + manifests) * k / KILLS;
        while child.try_wait().unwrap().is_none() && (records(&workspace).len() as u64) < wanted {
            sleep(Duration::from_millis(1));
        }
        sleep(Duration::from_millis(20).mul_f64(k as f64 * 0.618_034 % 1.0));
        child.kill().unwrap();
        child.wait().unwrap();
        let kept = records(&workspace);
        let kept: Vec<_> = kept.iter().map(|path| (path, fs::read(path).unwrap())).collect();
        midway += u64::from(!kept.is_empty() && (kept.len() as u64) < built(&undisturbed) + manifests);

        let resumed = workspace.stages(&RUN);
        assert_eq!(resumed.digests(), undisturbed.digests(), "kill {k}");
        for (path, bytes) in &kept {
            assert!(
                fs::read(path).unwrap() == *bytes,
                "kill {k}: {} was made again",
                path.display()
            );
        }
        let most = built(&undisturbed) + manifests - kept.len() as u64;
        assert!(
            built(&resumed) <= most,
            "kill {k}: built {}, {} were recorded",
            built(&resumed),
            kept.len()
        );
        for folder in ["tmp", "quarantine"] {
            let left = files(&workspace.path("store").join(folder));
            assert!(left.is_empty(), "kill {k}: {left:?}");
        }
        let fsck = workspace.run(&["fsck"]);
        assert_eq!(fsck.code, Some(0), "kill {k}: {}", fsck.stdout);
    }
    assert!(midway > 0, "none was killed while it worked");
}
