//! Everyday work around a run: lock files, cost estimates, quiet runs, pins, status and repair of the store.

use serde_json::Value;

use super::common::{SHORT, Transcript, Workspace, snapshot};

/// With a third stage that needs nothing.
fn forked() -> String {
    format!("{SHORT}  other:  {{ kind: sample, family: small-grid, count: 5, seed: 2 }}\n")
}

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("short.yaml", &forked());
    workspace
}

#[test]
fn a_lock_file_holds_a_pipeline_wherever_it_is_run() {
    let workspace = workspace();
    let missing = workspace.run(&["run", "short.yaml", "--locked"]);
    assert_eq!(missing.code, Some(2));
    assert!(
        missing.stderr.contains("short.yaml.lock") && missing.stderr.contains("--lock"),
        "{}",
        missing.stderr
    );
    let written = workspace.run(&["run", "short.yaml", "--lock"]);
    assert_eq!(written.code, Some(0), "{written}");
    assert!(written.stdout.contains("lock file: short.yaml.lock"), "{written}");
    let text = std::fs::read_to_string(workspace.path("short.yaml.lock")).unwrap();
    // In another store, from nothing.
    let elsewhere = workspace.run(&["run", "short.yaml", "--locked", "--store", "other"]);
    assert_eq!(elsewhere.code, Some(0), "{}", elsewhere.stderr);
    let agreed = "all results are those of short.yaml.lock";
    assert!(elsewhere.stdout.contains(agreed), "{elsewhere}");
    // A tweak is told before anything is built.
    let tweaked = workspace.run(&["run", "short.yaml", "--locked", "--set", "stages.small.seed=9"]);
    assert_eq!(tweaked.code, Some(6));
    for part in ["`small`", "seed", "1", "9"] {
        assert!(tweaked.stderr.contains(part), "{}", tweaked.stderr);
    }
    snapshot!(tweaked.stderr);
    // A different artifact is named.
    let small = workspace.run(&["plan", "short.yaml", "--json"]).json()["stages"][0]["digest"].clone();
    let digest = small.as_str().unwrap();
    let other = digest.chars().rev().collect::<String>();
    workspace.write("short.yaml.lock", &text.replace(digest, &other));
    let differs = workspace.run(&["run", "short.yaml", "--locked", "--json"]);
    assert_eq!(differs.code, Some(6), "{}", differs.stderr);
    let message = differs.json()["error"]["message"].as_str().unwrap().to_owned();
    assert!(
        message.contains("`solved`") || message.contains(&digest[..12]),
        "{message}"
    );
    // One that cannot be read is refused with its line.
    workspace.write("short.yaml.lock", &text.replace("artifact: \"", "artifact: \"?"));
    let broken = workspace.run(&["run", "short.yaml", "--locked", "--json"]);
    assert_eq!(broken.code, Some(2));
    assert_eq!(broken.json()["error"]["line"], 8, "{}", broken.stdout);
    let both = workspace.run(&["run", "short.yaml", "--lock", "--set", "stages.small.seed=9"]);
    assert_eq!(both.code, Some(2));
}

#[test]
fn gc_keeps_what_a_lock_file_names_for_as_long_as_it_is_there() {
    let workspace = workspace();
    assert_eq!(workspace.run(&["run", "short.yaml", "--lock"]).code, Some(0));
    workspace.stages(&["run", "short.yaml", "--set", "stages.small.seed=2"]);
    let gc = ["gc", "--keep-runs", "0", "--grace", "0", "--json"];
    let kept = workspace.run(&gc).json();
    let holders = kept["kept"].as_array().unwrap();
    assert!(!holders.is_empty());
    let lock = std::fs::canonicalize(workspace.path("short.yaml.lock")).unwrap();
    for artifact in holders {
        let holder = artifact["held_by"][0].as_str().unwrap();
        assert!(holder.ends_with(&lock.display().to_string()), "{holder}");
    }
    let plan = workspace.run(&["plan", "short.yaml", "--json"]).json();
    assert!(
        plan["stages"]
            .as_array()
            .unwrap()
            .iter()
            .all(|stage| stage["outcome"] == "reused")
    );
    std::fs::remove_file(workspace.path("short.yaml.lock")).unwrap();
    assert_eq!(workspace.run(&gc).json()["kept"], serde_json::json!([]));
}

#[test]
fn a_lock_file_may_name_what_was_never_built_here() {
    let workspace = workspace();
    assert_eq!(workspace.run(&["run", "short.yaml", "--lock"]).code, Some(0));
    let part = workspace.run(&["run", "short.yaml", "--locked", "--until", "small", "--store", "other"]);
    assert_eq!(part.code, Some(0), "{}", part.stderr);
    let gc = ["gc", "--keep-runs", "0", "--grace", "0", "--store", "other", "--json"];
    let kept = workspace.run(&gc);
    assert_eq!(kept.code, Some(0), "{}", kept.stderr);
    // Two chunks and their manifest.
    assert_eq!(kept.json()["kept"].as_array().unwrap().len(), 3);
    // What was built here and is gone is another matter.
    let digest = workspace
        .run(&["plan", "short.yaml", "--json", "--store", "other"])
        .json()["stages"][0]["digest"]
        .clone();
    let digest = digest.as_str().unwrap();
    let path = workspace
        .path("other/objects")
        .join(&digest[..2])
        .join(format!("{digest}.h5"));
    std::fs::remove_file(path).unwrap();
    let refused = workspace.run(&gc);
    assert_eq!(refused.code, Some(4), "{}", refused.stdout);
    assert!(refused.stderr.contains(&digest[..12]), "{}", refused.stderr);
}

#[test]
fn a_plan_has_a_cost_estimate_and_a_run_the_actual_cost() {
    let workspace = workspace();
    let first = workspace.run(&["plan", "short.yaml"]);
    snapshot!(first);
    workspace.stages(&["run", "short.yaml"]);
    let more = ["--set", "stages.small.count=160"];
    let plan = workspace
        .run(&[&["plan", "short.yaml", "--json"][..], &more].concat())
        .json();
    let solved = &plan["stages"][1];
    let seconds = |which: &str| solved["price"]["seconds"][which].as_f64().unwrap();
    assert!(0.0 <= seconds("low") && seconds("low") < seconds("likely") && seconds("likely") < seconds("high"));
    // 110 more fields of 21×21×2 numbers, and a little about each.
    let bytes = solved["price"]["bytes"]["likely"].as_f64().unwrap();
    assert!(
        (0.9..1.5).contains(&(bytes / (110.0 * 21.0 * 21.0 * 2.0 * 8.0))),
        "{bytes}"
    );
    assert_eq!(plan["unpriced"], 0);
    let run = workspace
        .run(&[&["run", "short.yaml", "--json"][..], &more].concat())
        .json();
    let solved = &run["stages"][1];
    assert_eq!(
        solved["price"]["seconds"]["likely"].as_f64().unwrap(),
        seconds("likely")
    );
    let built = solved["size_built"].as_f64().unwrap();
    assert!((built / bytes - 1.0).abs() < 0.1, "estimated {bytes}, wrote {built}");
}

#[test]
fn unpin_names_what_was_unpinned_and_gc_what_would_free_space() {
    let workspace = workspace();
    workspace.stages(&["run", "short.yaml"]);
    let first = workspace
        .run(&["pin", "solved", "--label", "figure 3", "--json"])
        .json()["pins"][0]["digest"]
        .clone();
    workspace.stages(&["run", "short.yaml", "--set", "stages.solved.elements_per_cell=2"]);
    // The pinned artifact is meant, not that of the last run.
    let unpinned = workspace.run(&["unpin", "solved"]);
    assert_eq!(unpinned.code, Some(0), "{}", unpinned.stderr);
    let line = unpinned.stdout.lines().next().unwrap();
    assert!(
        line.contains(&first.as_str().unwrap()[..12]) && line.contains("figure 3"),
        "{line}"
    );
    let mut printed = Transcript::default();
    printed.add("unpin solved", unpinned);
    assert_eq!(workspace.run(&["unpin", "solved"]).code, Some(2));
    // By its label, too.
    assert_eq!(workspace.run(&["pin", "small", "--label", "figure 4"]).code, Some(0));
    assert_eq!(workspace.run(&["unpin", "figure 5"]).code, Some(2));
    let by_label = workspace.run(&["unpin", "figure 4"]);
    assert!(by_label.stdout.contains("figure 4"), "{by_label}");
    printed.add("unpin figure 4", by_label);
    let nothing = workspace.run(&["gc", "-n", "--keep-runs", "0"]).stdout;
    assert!(nothing.contains("--grace 0"), "{nothing}");
    // Columns are as wide as sizes, which differ by the length of times and names. On a fast machine both runs end in
    // the same second.
    let unaligned = |text: &str| -> String {
        let lines = text
            .lines()
            .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
        lines.collect::<Vec<_>>().join("\n").replace(", and 1 more", "")
    };
    printed.add("gc -n --keep-runs 0", unaligned(&nothing));
    let of_runs = workspace.run(&["gc", "-n", "--grace", "0"]).stdout;
    assert!(of_runs.contains("--keep-runs"), "{of_runs}");
    printed.add("gc -n --grace 0", unaligned(&of_runs));
    snapshot!(printed);
    assert!(of_runs.contains(" UTC") && !of_runs.contains("Z,"), "{of_runs}");
}

#[test]
fn quiet_is_quiet_and_json_progress_is_one_event_a_line() {
    let workspace = workspace();
    let quiet = workspace.run(&["run", "short.yaml", "--quiet"]);
    assert_eq!((quiet.code, quiet.stdout.as_str()), (Some(0), ""));
    for line in quiet.stderr.lines() {
        assert!(line.starts_with("warning: "), "{line}");
    }
    let told = workspace.run(&[
        "run",
        "short.yaml",
        "--progress",
        "json",
        "--set",
        "stages.small.count=70",
    ]);
    let events: Vec<Value> = told
        .stderr
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let names: Vec<&str> = events.iter().map(|event| event["event"].as_str().unwrap()).collect();
    assert_eq!(names.first(), Some(&"run-started"));
    assert_eq!(events[0]["stale"], 2);
    for wanted in [
        "stage-started",
        "chunk-built",
        "stage-finished",
        "stage-reused",
        "progress",
    ] {
        assert!(names.contains(&wanted), "no {wanted} in {names:?}");
    }
    let built: Vec<&Value> = events
        .iter()
        .filter(|e| e["event"] == "chunk-built" && e["name"] == "small")
        .collect();
    assert_eq!(built.len(), 1);
    assert_eq!(
        workspace
            .run(&["run", "short.yaml", "--quiet", "--progress", "json"])
            .code,
        Some(2)
    );
}

#[test]
fn status_lists_the_contents_of_the_store_and_stale_stages() {
    let workspace = workspace();
    assert_eq!(workspace.run(&["status"]).code, Some(2), "there is no store");
    workspace.stages(&["run", "short.yaml"]);
    let status = workspace.run(&["status", "--json"]).json();
    // Three manifests, two chunks of 50 and one of 5 samples, and two solved.
    assert_eq!((&status["objects"], &status["records"]), (&8.into(), &8.into()));
    assert_eq!((&status["runs"], &status["in_flight"]), (&1.into(), &0.into()));
    assert_eq!(status["pipelines"][0]["path"], "short.yaml");
    workspace.write("short.yaml", &forked().replace("seed: 2", "seed: 3"));
    let text = workspace.run(&["status"]).stdout;
    assert!(text.contains("1 of 3") && text.contains("other"), "{text}");
    // A pipeline that is gone is no failure, unless it is asked for.
    std::fs::remove_file(workspace.path("short.yaml")).unwrap();
    let gone = workspace.run(&["status"]);
    assert_eq!(gone.code, Some(0), "{gone}");
    let mut printed = Transcript::default();
    printed.add("a stale stage", text);
    printed.add("a removed pipeline", gone);
    snapshot!(printed);
    assert_eq!(workspace.run(&["status", "short.yaml"]).code, Some(2));
}

#[test]
fn a_repaired_store_is_sound_and_is_built_to_the_same_digests() {
    let workspace = workspace();
    let before = workspace.stages(&["run", "short.yaml"]).digests();
    let object = |name: &str| {
        let digest = &before[name];
        workspace
            .path("store/objects")
            .join(&digest[..2])
            .join(format!("{digest}.h5"))
    };
    std::fs::remove_file(object("solved")).unwrap();
    let mut bytes = std::fs::read(object("small")).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(object("small"), bytes).unwrap();
    assert_eq!(workspace.run(&["fsck"]).code, Some(4));
    let repaired = workspace.run(&["fsck", "--repair"]);
    assert_eq!(repaired.code, Some(0), "{}", repaired.stdout);
    snapshot!(repaired);
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
    let again = workspace.stages(&["run", "short.yaml"]);
    assert_eq!(again.digests(), before);
    assert_eq!((again.chunks("small"), again.chunks("solved")), ((0, 2), (0, 2)));
}

/// `script` (bsdutils, which every Debian has) gives the command a terminal.
#[test]
fn colours_are_for_terminals_that_want_them() {
    let workspace = workspace();
    workspace.write("bad.yaml", "version: 2\nname: bad\nstages: {}\n");
    let coloured = |no_color: Option<&str>| {
        let line = format!("{} run bad.yaml", env!("CARGO_BIN_EXE_deaflow"));
        let mut command = workspace.dressed("script");
        command
            .args(["-qec", &line, "/dev/null"])
            .stdin(std::process::Stdio::null());
        no_color.map(|value| command.env("NO_COLOR", value));
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.contains("bad.yaml"), "{text}");
        text.contains('\u{1b}')
    };
    assert!(coloured(None));
    assert!(!coloured(Some("1")));
}
