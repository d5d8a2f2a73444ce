//! Past runs, and what differs between two of them.

use serde_json::{Value, json};

use super::common::{SHORT, Transcript, Workspace, snapshot};

/// Two runs of one pipeline, the second with other values.
fn two_runs() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("short.yaml", SHORT);
    workspace.stages(&["run", "short.yaml"]);
    workspace.stages(&SECOND);
    workspace
}

const SECOND: [&str; 6] = [
    "run",
    "short.yaml",
    "--set",
    "scene.drive.voltage=4 kV",
    "--set",
    "stages.small.count=61",
];

fn log(workspace: &Workspace, arguments: &[&str]) -> Vec<Value> {
    let log = workspace.run(&[&["log", "--json"], arguments].concat()).json();
    log["runs"].as_array().unwrap().clone()
}

fn diff(workspace: &Workspace, arguments: &[&str]) -> (Vec<Value>, Vec<Value>) {
    let ended = workspace.run(&[&["diff", "--json"], arguments].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let list = |key: &str| ended.json()[key].as_array().unwrap().clone();
    (list("parameters"), list("results"))
}

#[test]
fn runs_are_listed_with_what_was_changed_built_and_found() {
    let workspace = two_runs();
    let runs = log(&workspace, &[]);
    assert_eq!(runs.len(), 2);
    let (last, first) = (&runs[0], &runs[1]);
    assert_eq!(first["overrides"], json!({}));
    assert_eq!(
        last["overrides"],
        json!({ "scene.drive.voltage": "4 kV", "stages.small.count": 61 })
    );
    let stage = |run: &Value, at: usize| {
        let stage = &run["stages"][at];
        (stage["name"].clone(), stage["outcome"].clone())
    };
    assert_eq!(stage(first, 0), (json!("small"), json!("built")));
    assert_eq!(stage(last, 1), (json!("solved"), json!("built")));
    assert_eq!(last["stages"][1]["digest"].as_str().unwrap().len(), 64);
    let found = |run: &Value, name: &str| run["results"][name].as_f64().unwrap();
    assert_eq!(
        (found(first, "solved.samples"), found(last, "solved.samples")),
        (60.0, 61.0)
    );
    // The displacement goes with the square of the voltage, and somewhat faster.
    let ratio = found(last, "solved.max_displacement") / found(first, "solved.max_displacement");
    assert!(ratio > 0.4 && ratio < (4.0_f64 / 5.25).powi(2), "{ratio}");
    for key in ["created", "host", "version", "pipeline", "path"] {
        assert!(!last[key].as_str().unwrap().is_empty(), "{key}");
    }
    assert!(last["created"].as_str() > first["created"].as_str());
    // A change in a file is listed with both values, a change by `--set` is not.
    let listed = workspace.run(&["log"]).stdout;
    assert!(!listed.contains("5250 V"), "{listed}");
    let edited = Workspace::new();
    edited.write("short.yaml", SHORT);
    edited.stages(&["run", "short.yaml"]);
    let text = SHORT.replacen("5.25 kV", "4 kV", 1);
    assert_ne!(text, SHORT);
    edited.write("short.yaml", &text);
    edited.stages(&["run", "short.yaml"]);
    let listed = edited.run(&["log"]).stdout;
    for part in ["scene.drive.voltage", "5250 V", "4000 V"] {
        assert!(listed.contains(part), "{listed}");
    }
    snapshot!(listed);
    // The same run twice is listed once; an earlier one that runs again is listed again.
    workspace.stages(&SECOND);
    assert_eq!(log(&workspace, &[]), runs);
    workspace.stages(&["run", "short.yaml"]);
    let runs = log(&workspace, &[]);
    assert_eq!(runs.len(), 3);
    assert_eq!(stage(&runs[0], 1), (json!("solved"), json!("reused")));
    assert_eq!(runs[0]["results"], first["results"]);
    assert_eq!(log(&workspace, &["-n", "1"]).len(), 1);

    let csv = workspace.run(&["log", "--csv"]).stdout;
    let lines: Vec<&str> = csv.lines().collect();
    assert_eq!(lines.len(), 4, "{csv}");
    assert!(
        lines[0].starts_with("id,created,pipeline,") && lines[0].ends_with("solved.unstable"),
        "{csv}"
    );
    let text = workspace.run(&["log", "short.yaml"]).stdout;
    assert!(
        text.contains("scene.drive.voltage=4 kV") && text.contains("@3"),
        "{text}"
    );
}

#[test]
fn a_failed_stage_stands_in_the_list() {
    let workspace = Workspace::new();
    let broken = SHORT.replace("{ kind: solve, needs: [small], elements_per_cell: 1 }", "{ kind: solve, needs: [small], elements_per_cell: 1 }\n  none: { kind: balance, needs: [solved], bins: 5, range: [60 mm, 70 mm], target: 4, seed: 4 }");
    workspace.write("short.yaml", &broken);
    assert_eq!(workspace.run(&["run", "short.yaml"]).code, Some(1));
    let stages = log(&workspace, &[])[0]["stages"].clone();
    assert_eq!(
        stages[2],
        json!({ "name": "none", "outcome": "failed", "digest": null, "removed": null })
    );
    assert_eq!(stages[1]["outcome"], "built");
    let status = workspace.run(&["status", "short.yaml", "--json"]).json();
    assert_eq!(status["pipelines"][0]["last_failed"], json!(["none"]));
    let mut printed = Transcript::default();
    printed.add("status", workspace.run(&["status", "short.yaml"]));

    // What was not begun counts among the stages, as the run counts them.
    let more = "  model: { kind: train, needs: [none], network: physics, epochs: 1, seed: 1 }\n";
    workspace.write("short.yaml", &format!("{broken}{more}"));
    let set = ["--set", "stages.none.target=5"];
    assert_eq!(
        workspace.run(&[&["run", "short.yaml"], &set[..]].concat()).code,
        Some(1)
    );
    let stages = log(&workspace, &["-n", "1"])[0]["stages"].clone();
    assert_eq!(
        stages[3],
        json!({ "name": "model", "outcome": "skipped", "digest": null, "removed": null })
    );
    printed.add("log", workspace.run(&["log", "-n", "1"]));
    let status = workspace.run(&["status", "short.yaml"]);
    assert!(status.stdout.contains("--set"), "{status}");
    printed.add("status after a run with --set", status);
    snapshot!(printed);
    let status = workspace.run(&["status", "short.yaml", "--json"]).json();
    assert_eq!(status["pipelines"][0]["last_failed"], json!(["none"]));
}

#[test]
fn what_a_collection_has_made_unknown_is_no_sameness() {
    let workspace = Workspace::new();
    workspace.write("short.yaml", SHORT);
    workspace.stages(&["run", "short.yaml"]);
    workspace.write("short.yaml", &SHORT.replace("seed: 1", "seed: 2"));
    workspace.stages(&["run", "short.yaml"]);
    let mut printed = Transcript::default();
    printed.add("log", workspace.run(&["log", "short.yaml"]));
    let gc = workspace.run(&["gc", "--keep-runs", "1", "--grace", "0"]);
    assert_eq!(gc.code, Some(0), "{}", gc.stderr);
    let compared = workspace.run(&["diff", "@2", "@1"]);
    assert!(compared.stdout.contains("`small`"), "{compared}");
    printed.add("diff after gc", compared);
    assert_eq!(workspace.run(&["log", "short.yaml", "--json"]).code, Some(0));
    printed.add("log after gc", workspace.run(&["log", "short.yaml"]));
    snapshot!(printed);
}

#[test]
fn two_runs_are_compared_by_parameters_and_results() {
    let workspace = two_runs();
    let change = |path: &str, from: Value, to: Value| json!({ "path": path, "from": from, "to": to });
    let expected = vec![
        change("scene.drive.voltage", json!("5250 V"), json!("4000 V")),
        change("stages.small.count", json!(60), json!(61)),
    ];
    let (parameters, results) = diff(&workspace, &["@2", "@1"]);
    assert_eq!(parameters, expected);
    let names: Vec<&str> = results.iter().map(|change| change["name"].as_str().unwrap()).collect();
    assert!(
        names.contains(&"solved.max_displacement") && names.contains(&"small.samples"),
        "{names:?}"
    );
    assert!(!names.contains(&"solved.unstable"), "it does not differ");
    assert_eq!(diff(&workspace, &[]).0, expected, "the last two");
    let runs = log(&workspace, &[]);
    let moved = results
        .iter()
        .find(|change| change["name"] == "solved.max_displacement")
        .unwrap();
    assert_eq!(moved["from"], runs[1]["results"]["solved.max_displacement"]);
    assert_eq!(moved["to"], runs[0]["results"]["solved.max_displacement"]);

    // A pipeline as it stands, with and without overrides; runs by their digits and as those of a pipeline; lock files.
    let sets = ["--set", "scene.drive.voltage=4 kV", "--set", "stages.small.count=61"];
    let same = (parameters, results);
    assert_eq!(diff(&workspace, &[&["short.yaml"], &sets[..]].concat()), same);
    assert_eq!(diff(&workspace, &[&["@2", "short.yaml"], &sets[..]].concat()), same);
    let id = |at: usize| runs[at]["id"].as_str().unwrap();
    assert_eq!(diff(&workspace, &[id(1), id(0)]), same);
    assert_eq!(diff(&workspace, &["short.yaml@2", "short.yaml@1"]), same);
    workspace.stages(&["run", "short.yaml", "--lock"]);
    assert_eq!(diff(&workspace, &["short.yaml.lock", id(0)]), same);
    assert_eq!(diff(&workspace, &["@1", "short.yaml.lock"]), (vec![], vec![]));
    // Artifacts.
    let digest = |at: usize| runs[at]["stages"][1]["digest"].as_str().unwrap();
    let (parameters, results) = diff(&workspace, &[digest(1), digest(0)]);
    assert_eq!(
        parameters,
        vec![change("scene.drive.voltage", json!("5250 V"), json!("4000 V"))]
    );
    assert!(results.iter().any(|change| change["name"] == "solve.samples"));

    let text = workspace.run(&["diff", "short.yaml@3", "short.yaml@2"]).stdout;
    for words in ["scene.drive.voltage", "5250 V", "4000 V", "solved.samples", "+1.7 %"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let csv = workspace.run(&["diff", "short.yaml@3", "short.yaml@2", "--csv"]).stdout;
    assert!(
        csv.starts_with("what,name,from,to,from_error,to_error\nparameter,scene.drive.voltage,5250 V,4000 V,,\n"),
        "{csv}"
    );
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let workspace = two_runs();
    let mut printed = Transcript::default();
    for (arguments, named) in [
        (vec!["@1"], "@1"),
        (vec!["@1", "@9"], "@9"),
        (vec!["@1", "@x"], "x"),
        (vec!["@1", "@0"], "0"),
        (vec!["@1", "nowhere"], "nowhere"),
        (vec!["@1", "nowhere.yaml"], "nowhere.yaml"),
        (vec!["@2", "@1", "--set", "stages.small.count=5"], "--set"),
    ] {
        let ended = workspace.run(&[&["diff"], &arguments[..]].concat());
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(named), "{arguments:?}: {}", ended.stderr);
        printed.add(arguments.join(" "), ended);
    }
    let ended = workspace.run(&["log", "other.yaml"]);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("other.yaml"), "{ended}");
    printed.add("log other.yaml", ended);
    snapshot!(printed);
}

#[test]
fn the_last_two_runs_of_one_pipeline_are_compared_and_a_pipeline_with_its_last_run() {
    let workspace = two_runs();
    let (both, _) = diff(&workspace, &["@2", "@1"]);
    workspace.write("other.yaml", SHORT);
    let only = |workspace: &Workspace| workspace.run(&["diff"]).stderr;
    workspace.stages(&["run", "other.yaml", "--set", "stages.small.count=8"]);
    assert!(only(&workspace).contains("no other run"), "{}", only(&workspace));
    // The run of the other pipeline lies between these two.
    workspace.stages(&["run", "short.yaml"]);
    let back = diff(&workspace, &[]).0;
    let paths = |changes: &[Value]| changes.iter().map(|change| change["path"].clone()).collect::<Vec<_>>();
    assert_eq!(paths(&back), paths(&both));
    // The file against the run with an override, and against one without.
    let (changed, _) = diff(&workspace, &["other.yaml"]);
    assert_eq!(changed, [json!({ "path": "stages.small.count", "from": 8, "to": 60 })]);
    assert_eq!(diff(&workspace, &["short.yaml"]), (Vec::new(), Vec::new()));
    // A sweep has other stages than the file.
    let sweep = ["sweep", "short.yaml", "--quiet", "--set", "stages.small.count=4,5"];
    workspace.stages(&sweep);
    assert_eq!(diff(&workspace, &["short.yaml"]), (Vec::new(), Vec::new()));
}

#[test]
fn history_belongs_to_the_file_and_not_to_its_name() {
    let workspace = two_runs();
    workspace.write("copy.yaml", &SHORT.replace("seed: 1", "seed: 7"));
    workspace.stages(&["run", "copy.yaml"]);
    assert_eq!(log(&workspace, &["copy.yaml"]).len(), 1);
    assert_eq!(log(&workspace, &["short.yaml"]).len(), 2);
    assert_eq!(log(&workspace, &[]).len(), 3);
    // Compared with its own last run, not with that of the copy.
    let plan = workspace
        .run(&["plan", "short.yaml", "--set", "stages.small.seed=9", "--json"])
        .json();
    let reasons = plan["stages"][0]["reasons"].to_string();
    let is_named = ["seed", "1", "9"].iter().all(|part| reasons.contains(part));
    assert!(is_named && !reasons.contains('7'), "{reasons}");
    // A file that was moved takes its history along.
    std::fs::rename(workspace.path("short.yaml"), workspace.path("moved.yaml")).unwrap();
    assert_eq!(log(&workspace, &["moved.yaml"]).len(), 2);
    // One that has always stood in its place has its own alone.
    assert_eq!(log(&workspace, &["copy.yaml"]).len(), 1);
    assert_eq!(log(&workspace, &["./store/../copy.yaml"]).len(), 1);
    let last = workspace.run(&["diff", "moved.yaml@2", "moved.yaml@1"]);
    assert_eq!(last.code, Some(0), "{}", last.stderr);
    // A file that nobody has run takes no part of two that are gone.
    std::fs::rename(workspace.path("copy.yaml"), workspace.path("third.yaml")).unwrap();
    assert_eq!(workspace.run(&["log", "third.yaml"]).code, Some(2));
}

#[test]
fn history_is_moved_with_the_store() {
    let workspace = Workspace::new();
    for (folder, seed) in [("a", "seed: 1"), ("b", "seed: 7")] {
        std::fs::create_dir_all(workspace.path(&format!("all/{folder}"))).unwrap();
        workspace.write(&format!("all/{folder}/short.yaml"), &SHORT.replace("seed: 1", seed));
        let file = format!("all/{folder}/short.yaml");
        workspace.stages(&["run", &file, "--store", "all/store"]);
    }
    std::fs::rename(workspace.path("all"), workspace.path("elsewhere")).unwrap();
    for folder in ["a", "b"] {
        let file = format!("elsewhere/{folder}/short.yaml");
        let runs = log(&workspace, &[&file, "--store", "elsewhere/store"]);
        assert_eq!(runs.len(), 1);
        let path = runs[0]["path"].as_str().unwrap();
        assert!(path.ends_with(&format!("all/{folder}/short.yaml")), "{path}");
    }
    // They stay after a run at the new place, and the old place is forgotten.
    workspace.stages(&["run", "elsewhere/a/short.yaml", "--store", "elsewhere/store"]);
    let runs = log(&workspace, &["elsewhere/a/short.yaml", "--store", "elsewhere/store"]);
    assert_eq!(runs.len(), 2);
    let status = workspace
        .run(&["status", "--store", "elsewhere/store", "--json"])
        .json();
    let pipelines = status["pipelines"].as_array().unwrap();
    assert!(
        pipelines.len() == 2 && pipelines.iter().all(|pipeline| pipeline["error"].is_null()),
        "{status}"
    );
}

#[test]
fn an_audit_is_in_the_list_and_dates_no_report() {
    let workspace = two_runs();
    workspace.stages(&["run", "short.yaml"]);
    let last = |workspace: &Workspace| workspace.run(&["status", "--json"]).json()["pipelines"][0]["last_run"].clone();
    let before = last(&workspace);
    let audit = workspace.run(&["audit", "short.yaml:solved", "--samples", "0", "--json"]);
    assert_eq!(audit.code, Some(0), "{}", audit.stderr);
    let runs = log(&workspace, &[]);
    assert_eq!(runs[0]["command"], "audit");
    assert_eq!(last(&workspace), before);
    // It is no run of the pipeline: what that made is kept.
    let kept = workspace.run(&["gc", "--keep-runs", "1", "--grace", "0", "--json"]);
    assert_eq!(kept.code, Some(0), "{}", kept.stderr);
    let plan = workspace.run(&["plan", "short.yaml", "--json"]).json();
    let stages = plan["stages"].as_array().unwrap();
    assert!(stages.iter().all(|stage| stage["outcome"] == "reused"), "{plan}");
    let unknown = workspace.run(&["show", "nothing-of-the-kind"]);
    assert!(!unknown.stderr.contains("audit-of"), "{}", unknown.stderr);
}

#[test]
fn a_stage_is_compared_with_the_nearest_of_past_runs() {
    let workspace = Workspace::new();
    workspace.write("short.yaml", super::common::SHORT);
    workspace.stages(&["run", "short.yaml"]);
    workspace.stages(&[
        "run",
        "short.yaml",
        "--set",
        "stages.small.seed=9",
        "--set",
        "stages.solved.order=2",
    ]);
    let reasons = |sets: &[&str]| {
        let plan = workspace
            .run(&[&["plan", "short.yaml", "--json"][..], sets].concat())
            .json();
        let stages = plan["stages"].as_array().unwrap().clone();
        let solved = stages.into_iter().find(|stage| stage["name"] == "solved").unwrap();
        solved["reasons"].as_array().unwrap().clone()
    };
    // The last run had other samples; that of the file's own parameters differs in the mesh alone.
    let found = reasons(&["--set", "stages.solved.elements_per_cell=2"]);
    assert_eq!(found.len(), 1, "{found:?}");
    let reason = found[0].as_str().unwrap();
    let is_named = ["elements_per_cell", "1", "2"].iter().all(|part| reason.contains(part));
    assert!(is_named, "{reason}");
}

#[test]
fn what_an_override_or_a_sweep_has_changed_is_not_a_change_of_the_files() {
    let workspace = Workspace::new();
    workspace.write("short.yaml", SHORT);
    let sweep = |table: &str| {
        let set = ["--set", "scene.drive.voltage=4 kV, 5 kV", "--quiet"];
        workspace.stages(&[&["sweep", "short.yaml", "--table", table], &set[..]].concat());
    };
    sweep("max_displacement");
    sweep("mean_displacement");
    // Another mesh and another order of elements, of one stage.
    workspace.stages(&["run", "short.yaml"]);
    workspace.stages(&[
        "run",
        "short.yaml",
        "--set",
        "stages.solved.accuracy=0.1 mm",
        "--set",
        "stages.solved.elements_per_cell=null",
    ]);
    let listed = workspace.run(&["log"]).stdout;
    assert!(!listed.contains("changed in the files"), "{listed}");
    assert!(listed.lines().all(|line| line.chars().count() <= 120), "{listed}");
    // A change of the file is told beside overrides of another stage.
    workspace.write("short.yaml", &SHORT.replace("seed: 1", "seed: 2"));
    workspace.stages(&["run", "short.yaml"]);
    let listed = workspace.run(&["log"]).stdout;
    assert!(listed.contains("changed in the files"), "{listed}");
}

#[test]
fn parameters_that_were_added_to_the_files_or_removed_are_listed() {
    let workspace = Workspace::new();
    let run = |text: &str, sets: &[&str]| {
        workspace.write("short.yaml", text);
        let ended = workspace.run(&[&["run", "short.yaml"], sets].concat());
        let listed = workspace.run(&["log", "-n", "1"]);
        assert_eq!(listed.code, Some(0), "{listed}");
        let words: Vec<&str> = listed.stdout.split_whitespace().collect();
        (ended.code, words.join(" "))
    };
    let effects = |effects: &str| SHORT.replace("effects: {}", &format!("effects: {effects}"));
    assert_ne!(effects("x"), SHORT);
    let (_, first) = run(SHORT, &[]);
    assert!(!first.contains("changed in the files"), "{first}");
    // Several values of a part are one change. The run before is not in the list.
    let stiffening = "{ strain_stiffening: { model: gent, jm: 90 } }";
    let (_, added) = run(&effects(stiffening), &[]);
    assert!(
        added.contains("changed in the files: scene.effects.strain_stiffening added"),
        "{added}"
    );
    assert!(!added.contains("gent"), "{added}");
    let (_, removed) = run(SHORT, &[]);
    assert!(
        removed.contains("changed in the files: scene.effects.strain_stiffening removed"),
        "{removed}"
    );
    // An override explains what it adds.
    let set = format!("scene.effects={stiffening}");
    let (_, set) = run(SHORT, &["--set", &set]);
    assert!(!set.contains("changed in the files"), "{set}");
    // A stage that a run did not reach, or that is new, is no change of parameters.
    let more = format!("{SHORT}  again: {{ kind: solve, needs: [small], elements_per_cell: 2 }}\n");
    run(SHORT, &[]);
    let (_, new) = run(&more, &[]);
    assert!(!new.contains("changed in the files"), "{new}");
}
