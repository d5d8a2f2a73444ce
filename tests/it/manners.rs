//! What a new user tries first: a project of one's own, help, completions, manual pages, dry runs, the store of the
//! project.

use std::fs;
use std::path::Path;
use std::process::Command;

use super::common::{Ended, SMALL, Transcript, Workspace, csv, scene_file, scene_of_20_cells, snapshot};

/// Runs a command in a folder of the workspace.
fn run_in(workspace: &Workspace, folder: &str, arguments: &[&str]) -> Ended {
    let mut command = workspace.command(arguments);
    command.current_dir(workspace.path(folder)).output().unwrap().into()
}

#[test]
fn a_new_project_is_complete_and_nothing_is_replaced() {
    let workspace = Workspace::new();
    let made = workspace.run(&["init", "tweezers"]);
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    assert!(
        made.stdout.contains("deaflow run tweezers/pipeline.yaml"),
        "{}",
        made.stdout
    );
    let planned = workspace.run(&["plan", "tweezers/pipeline.yaml", "--json"]);
    assert_eq!(planned.code, Some(0), "{}", planned.stderr);
    let document = planned.json();
    assert_eq!(document["pipeline"], "tweezers");
    assert_eq!(document["stages"].as_array().unwrap().len(), 6);
    assert_eq!(document["store"], "tweezers/store");
    for file in ["pipeline.yaml", "scene.yaml"] {
        let text = fs::read_to_string(workspace.path("tweezers").join(file)).unwrap();
        let schema = text.lines().next().unwrap().rsplit_once('=').unwrap().1;
        let printed = workspace.run(&["schema", Path::new(schema).file_stem().unwrap().to_str().unwrap()]);
        let written = fs::read_to_string(workspace.path("tweezers").join(schema)).unwrap();
        assert!(written == printed.stdout, "{schema}");
    }
    assert_eq!(
        workspace.run(&["screen", "tweezers/scene.yaml", "--help"]).code,
        Some(0)
    );

    let coarse = ["--set", "geometry.cells=20"];
    let screened = workspace.run(&[&["screen", "tweezers/scene.yaml", "--json"], &coarse[..]].concat());
    assert_eq!(screened.code, Some(0), "{}", screened.stderr);
    let effects = screened.json()["effects"].as_array().unwrap().clone();
    let stiffening = effects.iter().find(|row| row["effect"] == "strain_stiffening").unwrap();
    assert_eq!(
        stiffening["called_for"], "yes",
        "what matters most is judged: {stiffening}"
    );
    let file = workspace.run(&["init", "tweezers/pipeline.yaml"]);
    assert_eq!(file.code, Some(2));
    assert!(file.stderr.contains("tweezers/pipeline.yaml"), "{file}");

    let again = workspace.run(&["init", "tweezers"]);
    assert_eq!(again.code, Some(2));
    assert!(again.stderr.contains("tweezers/pipeline.yaml"), "{again}");
    fs::create_dir(workspace.path("mine")).unwrap();
    workspace.write("mine/scene.yaml", "mine");
    let taken = run_in(&workspace, "mine", &["init"]);
    assert_eq!(taken.code, Some(2));
    assert!(taken.stderr.contains("scene.yaml"), "{taken}");
    assert_eq!(
        fs::read_dir(workspace.path("mine")).unwrap().count(),
        1,
        "nothing is half made"
    );
    let inside = workspace.run(&["init", "tweezers/store/inside"]);
    assert_eq!(inside.code, Some(2));
    let mut printed = Transcript::default();
    for (title, ended) in [
        ("init tweezers", made),
        ("init a file", file),
        ("init again", again),
        ("init beside a scene", taken),
        ("init in a store", inside),
    ] {
        printed.add(title, ended);
    }
    snapshot!(printed);
}

#[test]
fn a_misspelt_command_or_folder_gets_a_suggestion() {
    let workspace = Workspace::new();
    fs::create_dir(workspace.path("pipelines")).unwrap();
    workspace.write("pipelines/small.yaml", SMALL);
    for (arguments, near) in [
        (&["rnu"][..], "did you mean `run`?"),
        (&["export", "desgn"], "did you mean `design`?"),
        (&["run", "pipelins/small.yaml"], "did you mean pipelines/small.yaml?"),
        (&["run", "pipelins/smal.yaml"], "did you mean pipelines/small.yaml?"),
        (&["run", "pipelines/smal.yaml"], "did you mean pipelines/small.yaml?"),
    ] {
        let ended = workspace.run(arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stdout);
        assert!(ended.stderr.contains(near), "{arguments:?}: {}", ended.stderr);
    }
    let ended = workspace.run(&["run", "elsewhere/small.yaml"]);
    assert!(
        ended.code == Some(2) && !ended.stderr.contains("did you mean"),
        "{}",
        ended.stderr
    );
}

#[test]
fn a_project_can_be_created_in_the_current_folder() {
    let workspace = Workspace::new();
    fs::create_dir(workspace.path("grip")).unwrap();
    let made = run_in(&workspace, "grip", &["init", "--json"]);
    assert_eq!(made.code, Some(0), "{}", made.stderr);
    assert_eq!(made.json()["files"][0], "pipeline.yaml");
    let dag = run_in(&workspace, "grip", &["plan", "pipeline.yaml", "--json"]);
    assert_eq!(dag.json()["pipeline"], "grip");
}

#[test]
fn shells_complete_commands_and_options() {
    let workspace = Workspace::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let printed = workspace.run(&["completions", shell]);
        assert_eq!(printed.code, Some(0), "{shell}: {}", printed.stderr);
        for word in ["predict", "dry-run", "keep-going"] {
            assert!(printed.stdout.contains(word), "{shell}: {word}");
        }
    }
    workspace.write("completions.bash", &workspace.run(&["completions", "bash"]).stdout);
    let sound = Command::new("bash")
        .arg("-n")
        .arg(workspace.path("completions.bash"))
        .status();
    assert!(sound.unwrap().success());
    assert_eq!(workspace.run(&["completions", "tcsh"]).code, Some(2));
}

#[test]
fn every_command_has_a_manual_page() {
    let workspace = Workspace::new();
    let written = workspace.run(&["man", "pages/man1", "--json"]);
    assert_eq!(written.code, Some(0), "{}", written.stderr);
    assert!(written.json()["files"].as_array().unwrap().len() > 35);
    let page = fs::read_to_string(workspace.path("pages/man1/deaflow-run.1")).unwrap();
    for part in [
        ".TH deaflow-run 1",
        ".SH EXAMPLES\n",
        "deaflow run pipeline.yaml",
        ".SH STORE",
    ] {
        assert!(page.contains(part), "{part}: {page}");
    }
    assert!(workspace.path("pages/man1/deaflow-remote-add.1").is_file());
}

#[test]
fn make_installs_program_pages_and_completions_and_removes_them() {
    let workspace = Workspace::new();
    let make = |target: &str| {
        let mut command = workspace.dressed("make");
        command.current_dir(env!("CARGO_MANIFEST_DIR")).arg("-s").arg(target);
        command.arg(format!("PROGRAM={}", env!("CARGO_BIN_EXE_deaflow")));
        command
            .arg(format!("DESTDIR={}", workspace.path("root").display()))
            .arg("PREFIX=/usr");
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    make("install");
    let at = |name: &str| workspace.path("root/usr").join(name);
    for file in [
        "bin/deaflow",
        "share/man/man1/deaflow.1",
        "share/man/man1/deaflow-run.1",
        "share/bash-completion/completions/deaflow",
        "share/zsh/site-functions/_deaflow",
        "share/fish/vendor_completions.d/deaflow.fish",
    ] {
        assert!(at(file).is_file(), "{file}");
    }
    fs::write(at("share/man/man1/other.1"), "").unwrap();
    make("uninstall");
    let left = super::common::files(&workspace.path("root"));
    assert_eq!(left, [at("share/man/man1/other.1")]);
}

#[test]
fn help_is_grouped_narrow_and_ends_with_examples() {
    let workspace = Workspace::new();
    let help = workspace.run(&["--help"]).stdout;
    let run = workspace.run(&["run", "-h"]).stdout;
    let place = |word: &str| help.find(word).unwrap_or_else(|| panic!("{word}: {help}"));
    let commands = [
        "  run ",
        "  show ",
        "  gc ",
        "  solve ",
        "  help ",
        "--jobs",
        "  deaflow run ",
    ];
    for pair in commands.windows(2) {
        let between = &help[place(pair[0])..place(pair[1])];
        let is_heading = |line: &str| !line.starts_with(' ') && line.ends_with(':');
        assert!(between.lines().any(is_heading), "{pair:?}: {help}");
    }
    assert!(run.contains("\n  deaflow run pipeline.yaml\n"), "{run}");
    snapshot!(help, "all");
    snapshot!(run, "run");
    assert!(help.lines().chain(run.lines()).all(|line| line.chars().count() <= 100));
}

#[test]
fn a_dry_run_plans_and_builds_nothing() {
    let workspace = Workspace::small();
    let plan = workspace.run(&["plan", "small.yaml"]);
    for dry in ["-n", "--dry-run"] {
        let ended = workspace.run(&["run", "small.yaml", dry]);
        assert_eq!((ended.code, &ended.stdout), (Some(0), &plan.stdout), "{}", ended.stderr);
    }
    let swept = [
        "sweep",
        "small.yaml",
        "--set",
        "stages.solved.elements_per_cell=1,2",
        "-n",
        "--json",
    ];
    let swept = workspace.run(&swept);
    assert_eq!(swept.code, Some(0), "{}", swept.stderr);
    assert!(swept.json()["stages"].as_array().unwrap().len() > 4);
    assert!(!workspace.path("store").exists());
    assert_eq!(workspace.run(&["run", "small.yaml", "-n", "--lock"]).code, Some(2));
}

#[test]
fn threads_are_asked_for_here_or_in_the_environment() {
    let workspace = Workspace::small();
    let jobs = |value: &str, arguments: &[&str]| -> Ended {
        let mut command = workspace.command(&[&["dag", "small.yaml"], arguments].concat());
        command.env("DEAFLOW_JOBS", value).output().unwrap().into()
    };
    for (value, arguments, code) in [
        ("2", &[][..], 0),
        ("", &[], 0),
        ("x", &["-j", "1"], 0),
        ("x", &["--jobs=1"], 0),
        ("0", &[], 2),
        ("x", &[], 2),
        ("1", &["-j", "0"], 2),
    ] {
        let ended = jobs(value, arguments);
        assert_eq!(ended.code, Some(code), "{value} {arguments:?}: {}", ended.stderr);
        let named = if arguments.is_empty() { "DEAFLOW_JOBS" } else { "--jobs" };
        let is_explained = [named, "1", "1024"].iter().all(|part| ended.stderr.contains(part));
        assert!(code == 0 || is_explained, "{ended}");
    }
}

#[test]
fn colours_are_those_that_are_asked_for() {
    let workspace = Workspace::new();
    workspace.write("bad.yaml", "version: 2\nname: bad\nstages: {}\n");
    let coloured = |arguments: &[&str], setting: Option<(&str, &str)>| {
        let mut command = workspace.command(arguments);
        command.envs(setting);
        let ended: Ended = command.output().unwrap().into();
        (ended.stdout + &ended.stderr).contains('\u{1b}')
    };
    for (arguments, setting, is_coloured) in [
        (&["run", "bad.yaml"][..], None, false),
        (&["run", "bad.yaml", "--color", "always"], None, true),
        (&["--color=always", "run", "bad.yaml"], Some(("NO_COLOR", "1")), true),
        (&["run", "bad.yaml"], Some(("CLICOLOR_FORCE", "1")), true),
        (
            &["run", "bad.yaml", "--color", "never"],
            Some(("CLICOLOR_FORCE", "1")),
            false,
        ),
        (&["run", "--help"], None, false),
        (&["run", "--help", "--color", "always"], None, true),
        (&["--help", "--color=always"], None, true),
        (&["frobnicate", "--color", "always"], None, true),
    ] {
        assert_eq!(coloured(arguments, setting), is_coloured, "{arguments:?} {setting:?}");
    }
    assert_eq!(workspace.run(&["run", "bad.yaml", "--color", "pink"]).code, Some(2));
}

/// A project with its pipeline in a folder, and a folder beside the project.
fn project() -> Workspace {
    let workspace = Workspace::new();
    for folder in ["project/pipelines/deep", "elsewhere"] {
        fs::create_dir_all(workspace.path(folder)).unwrap();
    }
    workspace.write("project/pipelines/small.yaml", SMALL);
    workspace
}

/// The store of the project is one whatever folder the command is given in, once it is known.
#[test]
fn the_store_is_that_of_the_project_from_every_folder() {
    for known_by in ["store", ".git"] {
        let workspace = project();
        match known_by {
            ".git" => fs::create_dir(workspace.path("project/.git")).unwrap(),
            _ => {
                // Where nothing marks the project, its first run says where that is.
                let run = run_in(
                    &workspace,
                    "project",
                    &["run", "pipelines/small.yaml", "--until", "small"],
                );
                assert_eq!(run.code, Some(0), "{}", run.stderr);
                assert!(workspace.path("project/store/format").is_file());
            }
        }
        let absolute = workspace.path("project/pipelines/small.yaml");
        for (folder, pipeline) in [
            ("project", "pipelines/small.yaml"),
            ("project/pipelines", "small.yaml"),
            ("project/pipelines/deep", "../small.yaml"),
            ("elsewhere", "../project/pipelines/small.yaml"),
            ("elsewhere", absolute.to_str().unwrap()),
        ] {
            let run = run_in(&workspace, folder, &["run", pipeline, "--until", "large", "--json"]);
            assert_eq!(run.code, Some(0), "{folder}: {}", run.stderr);
            let store = workspace.path(folder).join(run.json()["store"].as_str().unwrap());
            let wanted = workspace.path("project/store").canonicalize().unwrap();
            assert_eq!(store.canonicalize().unwrap(), wanted, "{known_by} {folder}");
            let shown = run_in(&workspace, folder, &["show", &format!("{pipeline}:large"), "--json"]);
            assert_eq!(shown.code, Some(0), "{folder}: {}", shown.stderr);
        }
        for folder in ["project", "project/pipelines/deep"] {
            for arguments in [&["status"][..], &["fsck"], &["gc", "-n"], &["show", "large"], &["log"]] {
                let ended = run_in(&workspace, folder, arguments);
                assert_eq!(ended.code, Some(0), "{folder} {arguments:?}: {}", ended.stderr);
            }
        }
        assert_eq!(run_in(&workspace, "elsewhere", &["status"]).code, Some(2));
        let stores = [
            "project/pipelines/store",
            "project/pipelines/deep/store",
            "elsewhere/store",
        ];
        assert!(stores.iter().all(|store| !workspace.path(store).exists()));
    }
}

#[test]
fn option_and_environment_name_the_store_from_every_folder() {
    let workspace = project();
    fs::create_dir(workspace.path("project/.git")).unwrap();
    let run = |arguments: &[&str]| {
        let arguments = [&["run", "small.yaml", "--until", "small"], arguments].concat();
        let mut command = workspace.command(&arguments);
        command
            .current_dir(workspace.path("project/pipelines"))
            .env("DEAFLOW_STORE", "of-environment");
        assert!(command.output().unwrap().status.success());
    };
    run(&[]);
    assert!(workspace.path("project/pipelines/of-environment/format").is_file());
    run(&["--store", "of-option"]);
    assert!(workspace.path("project/pipelines/of-option/format").is_file());
    assert!(!workspace.path("project/store").exists());
}

#[test]
fn without_a_mark_the_store_is_beside_the_pipeline_or_here() {
    let workspace = project();
    let pipeline = "../project/pipelines/small.yaml";
    let run = run_in(&workspace, "elsewhere", &["run", pipeline, "--until", "small"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(workspace.path("project/pipelines/store/format").is_file());
    assert!(!workspace.path("elsewhere/store").exists());
}

#[test]
fn a_field_that_lacks_a_step_is_found() {
    let workspace = Workspace::small();
    let mut printed = Transcript::default();
    for (set, named) in [
        ("small.count=4", "`stages.small.count`"),
        ("solved.elements_per_cell=2", "`stages.solved.elements_per_cell`"),
        ("drive.voltage=5 kV", "`scene.drive.voltage`"),
        ("scene.voltage.now=5 kV", "`scene.drive.voltage.now`"),
        ("stage.small.count=4", "`stages`"),
        ("scene.effects.wrinkling.modell=x", "modell"),
    ] {
        let ended = workspace.run(&["plan", "small.yaml", "--set", set]);
        assert_eq!(ended.code, Some(2), "{set}");
        assert!(ended.stderr.contains(named), "{set}: {}", ended.stderr);
        printed.add(set, ended);
    }
    snapshot!(printed);
}

#[test]
fn a_part_that_is_not_written_yet_can_be_set() {
    let workspace = Workspace::tiny();
    let planned = |set: &str| workspace.run(&["plan", "tiny.yaml", "--set", set]);
    let ended = planned("stages.design.constraints.min_feature=2 mm");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let misspelt = planned("stages.design.constraints.min_featur=2 mm");
    assert_eq!(misspelt.code, Some(2));
    assert!(misspelt.stderr.contains("`min_feature`"), "{misspelt}");
    let nothing = planned("stages.design.colours.red=2");
    assert!(
        nothing.code == Some(2) && nothing.stderr.contains("`colours`"),
        "{nothing}"
    );
    // A point that is set is refused where it stands.
    let point = planned("stages.design.objective.point=[375 mm, 25 mm]");
    assert!(
        point.stderr.contains("--set stages.design.objective.point:1:"),
        "{point}"
    );
    let mut printed = Transcript::default();
    printed.add("a misspelt key", misspelt);
    printed.add("an unknown key", nothing);
    printed.add("a point outside", point);
    snapshot!(printed);
}

#[test]
fn a_pipeline_alone_in_a_folder_need_not_be_named() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let mut printed = Transcript::default();
    let forgotten = workspace.run(&["explain", "small.yaml"]);
    assert!(
        forgotten.code == Some(2) && forgotten.stderr.contains("small.yaml"),
        "{forgotten}"
    );
    printed.add("explain without a stage", forgotten);
    // Arguments of another kind are recognised.
    let digest = workspace.run(&["explain", "0123456789ab"]);
    assert!(
        digest.code == Some(2) && digest.stderr.contains("deaflow show 0123456789ab"),
        "{digest}"
    );
    printed.add("explain a digest", digest);
    for command in ["status", "log", "plan"] {
        let store = workspace.run(&[command, "store"]);
        assert!(
            store.code == Some(2) && store.stderr.contains("`--store store`"),
            "{command}: {store}"
        );
        printed.add(format!("{command} a store"), store);
    }
    let folder = workspace.run(&["status", "."]);
    assert!(
        folder.code == Some(0) && folder.stdout.contains("small.yaml"),
        "{}{}",
        folder.stdout,
        folder.stderr
    );
    let still = workspace.run(&["plan", "small.yaml", "--set", "scene.drive.voltage=0 V"]);
    assert!(
        still.stderr.contains("solved: ") && still.stderr.contains("0 V"),
        "{still}"
    );
    printed.add("plan at 0 V", still.stderr);
    let empty = workspace.run(&["plan", "small.yaml", "--set", "stages.small.count="]);
    assert!(empty.code == Some(2) && empty.stderr.contains("`null`"), "{empty}");
    printed.add("plan with an empty value", empty);
    // The folder of a pipeline, wherever it may be named.
    for arguments in [
        &["dag", "."][..],
        &["dag"],
        &["diff", "."],
        &["diff", ".@1", "."],
        &["show", ".:solved"],
        &["explain", ".:solved"],
        &["sweep", ".", "-n", "--set", "stages.small.count=3,4"],
    ] {
        let ended = workspace.run(arguments);
        assert_eq!(ended.code, Some(0), "{arguments:?}: {ended}");
    }
    let explained = workspace.run(&["explain", "solved"]);
    assert_eq!(explained.code, Some(0), "{}", explained.stderr);
    assert_eq!(
        explained.stdout,
        workspace.run(&["explain", "small.yaml", "solved"]).stdout
    );
    assert_eq!(
        explained.stdout,
        workspace.run(&["explain", "small.yaml:solved"]).stdout
    );
    let reported = workspace.run(&["report", "-o", "page"]);
    assert_eq!(reported.code, Some(0), "{}", reported.stderr);
    workspace.write(
        "second.yaml",
        &fs::read_to_string(workspace.path("small.yaml")).unwrap(),
    );
    let which = workspace.run(&["plan"]);
    assert_eq!(which.code, Some(2));
    for file in ["second.yaml", "small.yaml"] {
        assert!(which.stderr.contains(file), "{which}");
    }
    printed.add("plan with two pipelines", which);
    snapshot!(printed);
}

#[test]
fn another_scene_is_taken_from_a_file() {
    let workspace = Workspace::small();
    fs::create_dir(workspace.path("deep")).unwrap();
    workspace.write("deep/other.yaml", &scene_of_20_cells().replace("5.25 kV", "4 kV"));
    workspace.write("same.yaml", &scene_of_20_cells());
    let keys = |folder: &str, arguments: &[&str]| {
        let ended = run_in(&workspace, folder, &[&["explain"], arguments, &["--json"]].concat());
        assert_eq!(ended.code, Some(0), "{arguments:?}: {}", ended.stderr);
        ended.json()
    };
    // What is not yet built has no key: the first stage that reads a scene is asked for once its needs are there.
    assert_eq!(workspace.run(&["run", "small.yaml", "--until", "small"]).code, Some(0));
    assert_eq!(workspace.run(&["run", "small.yaml", "--until", "large"]).code, Some(0));
    let own = keys("", &["small.yaml", "solved"]);
    assert_eq!(
        own["key"],
        keys("", &["small.yaml", "solved", "--set", "scene=same.yaml"])["key"]
    );
    let set = ["small.yaml", "solved", "--set", "scene.drive.voltage=4 kV"];
    let other = keys("", &set);
    assert_ne!(own["key"], other["key"]);
    assert_eq!(
        other["key"],
        keys("", &["small.yaml", "solved", "--set", "scene=deep/other.yaml"])["key"]
    );
    // Relative to the folder at hand, and before what changes a field of it.
    let both = [
        "../small.yaml",
        "solved",
        "--set",
        "scene=other.yaml",
        "--set",
        "scene.drive.voltage=5.25 kV",
    ];
    assert_eq!(own["key"], keys("deep", &both)["key"]);
    let mut printed = Transcript::default();
    for (set, named) in [
        ("scene=none.yaml", "none.yaml"),
        ("scene=[1]", "scene"),
        ("scene=small.yaml", "small.yaml"),
    ] {
        let ended = workspace.run(&["plan", "small.yaml", "--set", set]);
        assert_eq!(ended.code, Some(2), "{set}");
        assert!(ended.stderr.contains(named), "{set}: {}", ended.stderr);
        printed.add(set, ended);
    }
    snapshot!(printed);
}

#[test]
fn an_unknown_role_is_refused_with_the_known_ones() {
    let workspace = Workspace::new();
    let ended = workspace.run(&["export", "design", "verified", "--role", "refind", "-o", "x.svg"]);
    assert_eq!(ended.code, Some(2));
    assert!(
        ended.stderr.contains("did you mean `refined`?") && ended.stderr.contains("intuitive-equal-area"),
        "{}",
        ended.stderr
    );
}

#[test]
fn files_are_shown_without_a_store() {
    let workspace = Workspace::small();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("p.csv", &csv(|x, y| x == 25 && y == 25));
    let solved = workspace.run(&[
        "solve",
        "scene.yaml",
        "p.csv",
        "--elements-per-cell",
        "1",
        "--method",
        "linear",
        "-o",
        "o.h5",
    ]);
    assert_eq!(solved.code, Some(0), "{}", solved.stderr);
    let text = workspace.run(&["show", "o.h5"]);
    assert_eq!(text.code, Some(0), "{}", text.stderr);
    for part in ["o.h5", "1 × 51 × 51 × 2", "estimated 1", "max_displacement", "solve"] {
        assert!(text.stdout.contains(part), "{part}: {}", text.stdout);
    }
    let shown = workspace.run(&["show", "o.h5", "--json"]).json();
    assert_eq!(shown["digest"], serde_json::Value::Null);
    assert_eq!(shown["datasets"][0]["path"], "displacement");
    let rows = workspace.run(&["show", "o.h5", "--csv"]).stdout;
    assert!(
        rows.starts_with("max_displacement_mm,outcome,") && rows.lines().count() == 2,
        "{rows}"
    );
    assert!(!workspace.path("store").exists());

    // An artifact of chunks by its file in the store, and one that is a single file anywhere.
    let run = workspace.stages(&["run", "small.yaml", "--until", "small"]);
    let digest = run.digests()["small"].clone();
    let file = format!("store/objects/{}/{digest}.h5", &digest[..2]);
    assert_eq!(workspace.run(&["show", &file, "--json"]).json()["digest"], *digest);
    let part = workspace.run(&["show", "small", "--json"]).json()["parts"][0]
        .as_str()
        .unwrap()
        .to_owned();
    fs::copy(
        workspace.path(&format!("store/objects/{}/{part}.h5", &part[..2])),
        workspace.path("part.h5"),
    )
    .unwrap();
    fs::copy(workspace.path(&file), workspace.path("manifest.h5")).unwrap();
    assert_eq!(
        workspace.run(&["export", "artifact", "small", "-o", "whole.h5"]).code,
        Some(0)
    );
    fs::remove_dir_all(workspace.path("store")).unwrap();
    let shown = workspace.run(&["show", "part.h5", "--json"]).json();
    assert_eq!(
        (&shown["digest"], &shown["record"]),
        (&part.into(), &serde_json::Value::Null)
    );
    assert!(workspace.run(&["show", "whole.h5"]).stdout.contains("4 × 20 × 20"));
    let mut printed = Transcript::default();
    for (file, named) in [
        ("manifest.h5", "export artifact"),
        ("none.h5", "none.h5"),
        ("text.h5", "text.h5"),
    ] {
        workspace.write("text.h5", "no HDF5");
        let ended = workspace.run(&["show", file]);
        assert_eq!(ended.code, Some(2), "{file}: {}", ended.stderr);
        assert!(ended.stderr.contains(named), "{file}: {}", ended.stderr);
        printed.add(file, ended);
    }
    snapshot!(printed);
}

#[test]
fn results_are_written_only_to_files_with_an_hdf5_ending() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("p.csv", &csv(|x, _| x < 25));
    for arguments in [
        &["solve", "scene.yaml", "p.csv"][..],
        &["predict", "model.safetensors", "p.csv"],
    ] {
        for name in ["x.csv", "x.npy", "x.h5.txt"] {
            let ended = workspace.run(&[arguments, &["-o", name]].concat());
            assert_eq!(ended.code, Some(2), "{name}");
            assert!(
                ended.stderr.contains(".h5") && ended.stderr.contains(".hdf5"),
                "{name}: {ended}"
            );
            assert!(!workspace.path(name).exists());
        }
    }
}
