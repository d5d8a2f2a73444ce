//! Stores that move, and clocks that are wrong.

use std::fs::{self, File, FileTimes};
use std::path::Path;
use std::time::{Duration, SystemTime};

use super::common::{Stages, Workspace, files};
use super::damage::copy;

fn reused(workspace: &Workspace, store: &str, wanted: &Stages) {
    let stages = workspace.stages(&["run", "small.yaml", "--store", store]);
    assert_eq!(stages.with("built"), [""; 0], "{store}");
    assert_eq!(stages.digests(), wanted.digests(), "{store}");
    for (name, digest) in wanted.digests() {
        let shown = workspace.run(&["show", &name, "--store", store, "--json"]);
        assert_eq!(shown.code, Some(0), "{store}: {}", shown.stderr);
        assert_eq!(shown.json()["digest"], *digest, "{store}");
    }
    assert_eq!(workspace.run(&["fsck", "--store", store]).code, Some(0), "{store}");
}

#[test]
fn a_store_works_wherever_it_is_moved_or_copied() {
    let workspace = Workspace::small();
    let first = workspace.stages(&["run", "small.yaml"]);
    fs::create_dir_all(workspace.path("some/where")).unwrap();
    copy(&workspace.path("store"), &workspace.path("some/where/else"));
    reused(&workspace, "some/where/else", &first);
    fs::rename(workspace.path("store"), workspace.path("some/moved")).unwrap();
    reused(&workspace, "some/moved", &first);
    let absolute = workspace.path("some/moved");
    reused(&workspace, absolute.to_str().unwrap(), &first);
}

fn set_time(path: &Path, time: SystemTime) {
    let file = File::open(path).unwrap();
    file.set_times(FileTimes::new().set_modified(time)).unwrap();
}

#[test]
fn files_from_the_future_are_neither_lost_nor_collected() {
    let workspace = Workspace::small();
    let first = workspace.stages(&["run", "small.yaml"]);
    let tomorrow = SystemTime::now() + Duration::from_secs(86_400);
    let all = files(&workspace.path("store"));
    all.iter().for_each(|path| set_time(path, tomorrow));
    reused(&workspace, "store", &first);
    assert_eq!(workspace.run(&["gc"]).code, Some(0));
    // Nothing holds them but their age.
    fs::remove_dir_all(workspace.path("store/runs")).unwrap();
    assert_eq!(workspace.run(&["gc"]).code, Some(0));
    reused(&workspace, "store", &first);
}

/// The last run as the store knows it, though the clock has been set back by a century since the one before.
#[test]
fn the_last_run_is_the_newest_whatever_the_clock_says() {
    let workspace = Workspace::small();
    let first = workspace.stages(&["run", "small.yaml"]);
    let runs = || files(&workspace.path("store/runs"));
    let name = runs()[0].file_name().unwrap().to_str().unwrap().to_owned();
    let text = fs::read_to_string(&runs()[0]).unwrap();
    let century = |text: &str| text.replacen("20", "21", 1);
    fs::write(
        workspace.path("store/runs").join(century(&name)),
        text.replace("\"created\": \"20", "\"created\": \"21"),
    )
    .unwrap();
    fs::remove_file(workspace.path("store/runs").join(&name)).unwrap();
    let mut last = first.digests();
    for count in 5..9 {
        let set = format!("stages.small.count={count}");
        last = workspace.stages(&["run", "small.yaml", "--set", &set]).digests();
        let shown = workspace.run(&["show", "small", "--json"]).json();
        assert_eq!(shown["digest"], *last["small"], "count {count}");
        let plan = workspace.stages(&["plan", "small.yaml", "--set", "stages.small.count=50"]);
        let why = plan.stage("small")["why"].as_str().unwrap().to_owned();
        assert!(
            why.contains(&count.to_string()) && why.contains("50"),
            "compared with the last run: {why}"
        );
    }
    assert_eq!(runs().len(), 5);
    let gc = workspace.run(&["gc", "--keep-runs", "1", "--grace", "0"]);
    assert_eq!(gc.code, Some(0), "{}", gc.stderr);
    let kept = workspace.stages(&["run", "small.yaml", "--set", "stages.small.count=8"]);
    assert_eq!(
        (kept.with("built"), kept.digests()),
        (vec![], last),
        "the last run is what was kept"
    );
}
