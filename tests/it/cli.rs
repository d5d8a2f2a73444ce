//! The command line: errors with their place, one JSON document, exit codes.

use std::process::Stdio;

use serde_json::Value;

use super::common::{Stages, TINY, Transcript, Workspace, csv, scene_file, snapshot};

/// Runs `plan`, which reads everything and builds nothing, on a changed tiny pipeline.
fn refused(from: &str, to: &str) -> (String, Value) {
    let workspace = Workspace::new();
    assert!(TINY.contains(from), "{from}");
    workspace.write("bad.yaml", &TINY.replacen(from, to, 1));
    let ended = workspace.run(&["plan", "bad.yaml"]);
    assert_eq!(ended.code, Some(2), "{to}: {}", ended.stderr);
    assert_eq!(ended.stdout, "", "errors go to stderr");
    let document = workspace.run(&["plan", "bad.yaml", "--json"]);
    assert_eq!(document.code, Some(2));
    assert!(
        !workspace.path("store").exists(),
        "nothing is made before the pipeline is read"
    );
    (ended.stderr, document.json()["error"].clone())
}

#[test]
fn mistakes_in_a_pipeline_are_refused_with_file_line_caret_and_spelling() {
    let mut printed = Transcript::default();
    for (from, to, line, named) in [
        ("voltage: 5.25 kV", "voltge: 5.25 kV", 6, "`voltage`"),
        ("voltage: 5.25 kV", "voltage: 5.25 km", 6, "km"),
        ("kind: balance", "kind: balanc", 13, "`balance`"),
        ("needs: [balanced]", "needs: [balance]", 14, "`balanced`"),
        (
            "kind: solve, needs: [small, large, bezier]",
            "kind: solve, needs: [verified]",
            12,
            "verified",
        ),
        ("bins: 20", "bins: many", 13, "many"),
        ("epochs: 1", "epoch: 1", 14, "`epochs`"),
        ("elements_per_cell: 1 }", "elements_per_cell: 99 }", 12, "99"),
        ("method: linear,", "method: liner,", 18, "`linear`"),
        ("needs: [reference]", "needs: [small]", 18, "`small`"),
        (
            "needs: [bezier], elements_per_cell: 2",
            "needs: [bezier], method: chord:2, accuracy: 1 mm",
            17,
            "accuracy",
        ),
        ("version: 1", "version: 2", 1, "version"),
        ("name: tiny", "name: [", 4, "YAML"),
    ] {
        let (text, error) = refused(from, to);
        assert!(text.contains(named), "{to}: {text}");
        assert!(text.contains("bad.yaml:"), "{to}: {text}");
        assert!(text.contains('^'), "{to}: {text}");
        assert_eq!(error["file"], "bad.yaml", "{to}: {error}");
        // An unclosed bracket is noticed only where no list can go on.
        assert_eq!(error["line"], line, "{to}: {error}");
        assert!(!error["message"].as_str().unwrap().is_empty());
        printed.add(to, text);
    }
    snapshot!(printed);
}

#[test]
fn the_caret_stands_under_the_word() {
    let (text, error) = refused("bins: 20", "bin: 20");
    let lines: Vec<&str> = text.lines().collect();
    let at = lines.iter().position(|line| line.contains("bin: 20")).unwrap();
    let column = lines[at].find("bin: 20").unwrap();
    let carets: Vec<usize> = lines[at + 1].match_indices('^').map(|(at, _)| at).collect();
    assert_eq!(carets, [column, column + 1, column + 2], "{text}");
    let line = TINY
        .replacen("bins: 20", "bin: 20", 1)
        .lines()
        .nth(12)
        .unwrap()
        .to_owned();
    assert_eq!(
        error["column"].as_u64(),
        line.find("bin: 20").map(|at| at as u64 + 1),
        "{error}"
    );
}

#[test]
fn a_circle_of_needs_is_refused() {
    let workspace = Workspace::new();
    workspace.write("circle.yaml", &TINY.replace("needs: [solved]", "needs: [balanced]"));
    let ended = workspace.run(&["run", "circle.yaml"]);
    assert_eq!(ended.code, Some(2));
    assert!(
        ended.stderr.contains("balanced") && ended.stderr.contains('^'),
        "{}",
        ended.stderr
    );
}

#[test]
fn overrides_are_checked_like_the_file() {
    let workspace = Workspace::tiny();
    let mut printed = Transcript::default();
    for (set, named) in [
        ("stages.smal.count=4", "`small`"),
        ("stages.small.count=none", "count"),
        ("stages.small.cuont=4", "count"),
        ("scene.drive.voltage=5 mm", "mm"),
        ("stages.small.count", "stages.small.count"),
        ("=4", "--set"),
    ] {
        let ended = workspace.run(&["plan", "tiny.yaml", "--set", set]);
        assert_eq!(ended.code, Some(2), "{set}: {}", ended.stderr);
        assert!(
            ended.stderr.contains("--set") && ended.stderr.contains(named),
            "{set}: {}",
            ended.stderr
        );
        printed.add(set, ended);
    }
    let ended = workspace.run(&["plan", "tiny.yaml", "--until", "solve"]);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("`solved`"), "{}", ended.stderr);
    printed.add("--until solve", ended);
    snapshot!(printed);
}

#[test]
fn json_is_one_document_whatever_happens() {
    let workspace = Workspace::tiny();
    let run = workspace.run(&["run", "tiny.yaml", "--until", "large", "--json"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("large"), "progress goes to stderr");
    let document = run.json();
    let stage = &document["stages"][0];
    for (key, kind) in [("name", "large"), ("kind", "sample"), ("outcome", "built")] {
        assert_eq!(stage[key], kind, "{document}");
    }
    assert_eq!(stage["digest"].as_str().unwrap().len(), 64);
    assert!(stage["seconds"].is_number() && stage["chunks_built"].is_u64() && stage["chunks_reused"].is_u64());
    assert!(stage["why"].is_string());
    for arguments in [
        &["run", "absent.yaml", "--json"][..],
        &["run", "tiny.yaml", "--jobs", "0", "--json"],
        &["explain", "--json"],
        &["show", "nothing", "--json"],
        &["show", "large", "--store", "elsewhere", "--json"],
        &["fsck", "--store", "elsewhere", "--json"],
        &["solve", "tiny.yaml", "absent.npy", "-o", "out.h5", "--json"],
        &[
            "solve",
            "tiny.yaml",
            "absent.npy",
            "-o",
            "no/such/folder/out.h5",
            "--json",
        ],
        &["predict", "large", "absent.npy", "-o", "out.h5", "--json"],
    ] {
        let ended = workspace.run(arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        let error = &ended.json()["error"];
        assert!(
            error["message"]
                .as_str()
                .is_some_and(|m| !m.is_empty() && !m.starts_with("error")),
            "{arguments:?}"
        );
        assert_eq!(error["exit_code"], 2);
    }
    assert!(
        !workspace.path("elsewhere").exists(),
        "looking into a store does not make one"
    );
}

#[test]
fn usage_errors_are_bad_input_and_help_is_not() {
    let workspace = Workspace::new();
    for arguments in [&[][..], &["frobnicate"], &["run"], &["solve", "s.yaml", "p.npy"]] {
        assert_eq!(workspace.run(arguments).code, Some(2), "{arguments:?}");
    }
    let help = workspace.run(&["--help"]);
    assert_eq!(help.code, Some(0));
    for command in ["run", "plan", "dag", "show", "fsck", "solve", "predict"] {
        assert!(help.stdout.contains(command), "{command}");
        assert_eq!(workspace.run(&[command, "--help"]).code, Some(0));
    }
    assert!(workspace.run(&["--version"]).stdout.contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_reader_that_stops_listening_is_no_failure() {
    let workspace = Workspace::tiny();
    workspace.stages(&["run", "tiny.yaml", "--until", "small"]);
    for arguments in [
        &["show", "small"][..],
        &["dag", "tiny.yaml"],
        &["run", "tiny.yaml", "--until", "small"],
        &["--help"],
    ] {
        let mut command = workspace.command(arguments);
        // The reading end is closed before the first byte is written.
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = command
            .stdout(Stdio::from(writer))
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        let complaint = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {complaint}");
        assert!(!complaint.contains("panicked"), "{complaint}");
    }
}

#[test]
fn the_store_is_where_the_option_or_the_environment_says() {
    let workspace = Workspace::tiny();
    let run = |arguments: &[&str]| {
        let mut command = workspace.command(&[&["run", "tiny.yaml", "--until", "small"], arguments].concat());
        assert!(
            command
                .env("DEAFLOW_STORE", "from-environment")
                .output()
                .unwrap()
                .status
                .success()
        );
    };
    run(&[]);
    assert!(workspace.path("from-environment").is_dir() && !workspace.path("store").exists());
    run(&["--store", "from-option"]);
    assert!(workspace.path("from-option").is_dir());
}

#[test]
fn what_is_not_a_store_is_left_alone() {
    let workspace = Workspace::tiny();
    std::fs::create_dir(workspace.path("mine")).unwrap();
    workspace.write("mine/letter.txt", "dear");
    let ended = workspace.run(&["run", "tiny.yaml", "--store", "mine"]);
    assert_eq!(ended.code, Some(2), "{}", ended.stderr);
    assert_eq!(std::fs::read_dir(workspace.path("mine")).unwrap().count(), 1);
    for command in [&["serve"][..], &["sketch", "tiny.yaml"]] {
        let said = workspace.refused(&[command, &["--store", "mine/letter.txt"]].concat());
        assert!(said.contains("mine/letter.txt is not an artifact store"), "{said}");
    }
}

#[test]
fn a_store_of_another_version_is_refused() {
    let workspace = Workspace::tiny();
    workspace.stages(&["run", "tiny.yaml", "--until", "large"]);
    workspace.write("store/format", "deaflow-store 99\n");
    for arguments in [
        &["run", "tiny.yaml"][..],
        &["plan", "tiny.yaml"],
        &["show", "large"],
        &["fsck"],
    ] {
        let ended = workspace.run(arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        assert!(
            ended.stderr.contains("deaflow-store 99"),
            "{arguments:?}: {}",
            ended.stderr
        );
    }
}

#[test]
fn artifacts_are_shown_by_name_digest_and_pipeline() {
    let workspace = Workspace::tiny();
    let run = workspace.stages(&["run", "tiny.yaml", "--until", "large"]);
    let digest = &run.digests()["large"];
    for reference in ["large", digest, &digest[..6], &digest.to_uppercase(), "tiny.yaml:large"] {
        let shown = workspace.run(&["show", reference, "--json"]);
        assert_eq!(shown.code, Some(0), "{reference}: {}", shown.stderr);
        let shown = shown.json();
        assert_eq!(shown["digest"], **digest, "{reference}");
        let datasets = shown["datasets"].as_array().unwrap();
        let patterns = datasets.iter().find(|d| d["path"] == "patterns").unwrap();
        // Two units a side have 6 balanced patterns, of three units a side 8 are wanted.
        assert_eq!(patterns["shape"], serde_json::json!([14, 50, 50]));
        assert_eq!(
            (&patterns["statistics"]["min"], &patterns["statistics"]["max"]),
            (&0.0.into(), &1.0.into())
        );
        let family = datasets.iter().find(|d| d["path"] == "family").unwrap();
        assert_eq!(family["statistics"]["counts"]["large-grid"], 14);
        assert_eq!(shown["provenance"]["kind"], "sample");
    }
    let text = workspace.run(&["show", "large"]).stdout;
    assert!(
        text.contains("14 × 50 × 50") && text.contains("large-grid 14"),
        "{text}"
    );
    let mut printed = Transcript::default();
    for (reference, named) in [("lrge", "`large`"), ("ab", "ab"), ("tiny.yaml:small", "small")] {
        let ended = workspace.run(&["show", reference]);
        assert_eq!(ended.code, Some(2), "{reference}");
        assert!(ended.stderr.contains(named), "{reference}: {}", ended.stderr);
        printed.add(reference, ended);
    }
    snapshot!(printed);
}

#[test]
fn damage_has_an_exit_code_of_its_own() {
    let workspace = Workspace::tiny();
    let run = workspace.stages(&["run", "tiny.yaml", "--until", "small"]);
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
    let shown = workspace.run(&["show", "small", "--json"]).json();
    let part = shown["parts"][0].as_str().unwrap().to_owned();
    let file = workspace
        .path("store/objects")
        .join(&part[..2])
        .join(format!("{part}.h5"));
    let mut bytes = std::fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let mut permissions = std::fs::metadata(&file).unwrap().permissions();
    #[allow(clippy::permissions_set_readonly_false)]
    permissions.set_readonly(false);
    std::fs::set_permissions(&file, permissions).unwrap();
    std::fs::write(&file, bytes).unwrap();

    let mut printed = Transcript::default();
    for named in ["small", "tiny.yaml:small"] {
        let show = workspace.run(&["show", named]);
        assert_eq!(show.code, Some(4), "{}", show.stderr);
        printed.add(named, show);
    }
    printed.add("status", workspace.run(&["status"]));
    let fsck = workspace.run(&["fsck", "--json"]);
    assert_eq!(fsck.code, Some(4), "{}", fsck.stderr);
    let report = fsck.json();
    assert_eq!(report["sound"], false);
    assert!(
        report["damaged"][0]["path"].as_str().unwrap().contains(&part),
        "{report}"
    );

    // The damage has been set aside, and is missing now.
    let checked = workspace.run(&["fsck"]);
    assert!(checked.stdout.contains("deaflow fsck --repair"), "{checked}");
    printed.add("fsck", checked);
    snapshot!(printed);

    let again = workspace.stages(&["run", "tiny.yaml", "--until", "small"]);
    assert_eq!((again.chunks("small"), again.digests()), ((1, 1), run.digests()));
    assert_eq!(workspace.run(&["fsck"]).code, Some(0));
}

#[test]
fn the_graph_is_drawn_in_three_forms() {
    let workspace = Workspace::tiny();
    let draw = |format: &str| workspace.run(&["dag", "tiny.yaml", "--format", format]).stdout;
    assert!(
        draw("text")
            .lines()
            .any(|l| l.starts_with("solved ") && l.ends_with("<- small, large, bezier"))
    );
    assert!(draw("mermaid").starts_with("flowchart LR"));
    assert!(draw("dot").contains("\"design\" -> \"verified\";"));
    assert_eq!(workspace.run(&["dag", "tiny.yaml", "--format", "svg"]).code, Some(2));
}

#[test]
fn a_stage_that_fails_ends_the_run_and_is_named() {
    let workspace = Workspace::new();
    let few = TINY.replace("needs: [small, large, bezier]", "needs: [large]");
    workspace.write("fails.yaml", &few.replace("[0 mm, 2.5 mm]", "[9 mm, 9.5 mm]"));
    let ended = workspace.run(&["run", "fails.yaml", "--json"]);
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    let document = ended.json();
    let stages = Stages::read(&document);
    assert_eq!(stages.with("failed"), ["balanced"], "{document}");
    // Stages that ran at the same time are finished, and no other stage starts.
    assert!(stages.with("skipped").contains(&"surrogate"), "{document}");
    let of_stage = |name: &str| {
        let all = document["stages"].as_array().unwrap();
        all.iter().find(|stage| stage["name"] == name).unwrap().clone()
    };
    assert_eq!(of_stage("surrogate")["missing"], "balanced");
    let message = document["error"]["message"].as_str().unwrap();
    assert!(message.contains("`balanced`"), "{document}");

    let text = workspace.run(&["run", "fails.yaml"]);
    assert_eq!(text.code, Some(1));
    assert!(
        text.stdout
            .lines()
            .any(|l| l.contains("solved") && l.contains("reused")),
        "{}",
        text.stdout
    );
    let error = text.stderr.lines().find(|line| line.starts_with("error: "));
    assert!(error.is_some_and(|line| line.contains("`balanced`")), "{text}");
    assert!(
        text.stdout
            .lines()
            .any(|l| l.contains("surrogate") && l.contains("skipped") && l.contains("balanced")),
        "{text}"
    );
    // The message about a misplaced constraint names the right place.
    let misplaced = workspace.run(&["plan", "fails.yaml", "--set", "stages.design.min_feature=2 mm"]);
    assert_eq!(misplaced.code, Some(2), "{}", misplaced.stderr);
    assert!(misplaced.stderr.contains("`constraints`"), "{misplaced}");
    snapshot!(misplaced);
}

#[test]
fn unstable_samples_set_the_exit_code_and_are_counted() {
    let workspace = Workspace::new();
    let few = TINY.replace("needs: [small, large, bezier]", "needs: [large]");
    workspace.write(
        "tiny.yaml",
        &few.replace("[2, 3], count_per_units: 8", "[2], count_per_units: 2"),
    );
    let arguments = [
        "run",
        "tiny.yaml",
        "--until",
        "solved",
        "--set",
        "scene.drive.voltage=14 kV",
    ];
    let ended = workspace.run(&[&arguments[..], &["--json"]].concat());
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let unstable = ended.json()["unstable"].as_u64().unwrap();
    assert!(unstable > 0);
    let again = workspace.run(&arguments);
    assert_eq!(again.code, Some(3), "a reused stage is no more stable");
    assert!(again.stdout.contains(&format!(" {unstable} ")), "{again}");
    // The output names the voltages between which stability is lost.
    snapshot!(again.stdout);
}

#[test]
fn a_missing_file_is_reported_with_a_file_of_a_similar_name() {
    let workspace = Workspace::small();
    let ended = workspace.run(&["plan", "smal.yaml"]);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains(" small.yaml"), "{ended}");
    let other = workspace.run(&["plan", "nothing-of-the-kind.yaml"]);
    assert!(!other.stderr.contains(" small.yaml"), "{other}");
    let mut printed = Transcript::default();
    printed.add("smal.yaml", ended);
    printed.add("nothing-of-the-kind.yaml", other);
    snapshot!(printed);
}

#[test]
fn a_negative_voltage_is_refused_as_what_it_is() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("p.csv", &csv(|x, _| x < 25));
    let ended = workspace.run(&["solve", "scene.yaml", "p.csv", "--voltage", "-5 kV"]);
    assert_eq!(ended.code, Some(2));
    assert!(
        ended.stderr.contains("`voltage`") && !ended.stderr.contains("unexpected argument"),
        "{}",
        ended.stderr
    );
    // The message names the option that was given, not the field that it sets.
    let mut printed = Transcript::default();
    for command in ["solve", "screen"] {
        for (voltage, named) in [("-5 kV", "--voltage:1:1"), ("many", "V, kV"), ("", "--voltage")] {
            let ended = workspace.run(&[command, "scene.yaml", "p.csv", "--voltage", voltage]);
            assert_eq!(ended.code, Some(2));
            assert!(
                ended.stderr.contains(named) && !ended.stderr.contains("--set"),
                "{}",
                ended.stderr
            );
            printed.add(format!("{command} --voltage {voltage}"), ended);
        }
    }
    snapshot!(printed);
}
