//! What does not matter is reused, what matters is rebuilt, and nothing else.

use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use super::common::{Ended, SMALL, Stages, TINY, Workspace, files, scene_of_20_cells, with_scene_in_a_file};

fn of(ended: Ended) -> Stages {
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    Stages::read(&ended.json())
}

#[test]
fn where_when_and_in_what_language_a_run_takes_place_does_not_matter() {
    let workspace = Workspace::small();
    let first = workspace.stages(&["run", "small.yaml"]);
    let same = |stages: &Stages, what: &str| {
        assert_eq!(stages.with("built"), [""; 0], "{what}");
        assert_eq!(stages.digests(), first.digests(), "{what}");
    };
    for (name, value) in [
        ("LC_ALL", "tr_TR.UTF-8"),
        ("LC_ALL", "de_DE.UTF-8"),
        ("LANG", "C"),
        ("TZ", "Asia/Kathmandu"),
        ("RAYON_NUM_THREADS", "1"),
        ("HOME", "/nowhere"),
    ] {
        let mut command = workspace.command(&["run", "small.yaml", "--json"]);
        same(&of(command.env(name, value).output().unwrap().into()), name);
    }
    for jobs in ["1", "2"] {
        same(&workspace.stages(&["run", "small.yaml", "--jobs", jobs]), jobs);
    }
    let (pipeline, store) = (workspace.path("small.yaml"), workspace.path("store"));
    let mut command = workspace.command(&[
        "run",
        pipeline.to_str().unwrap(),
        "--json",
        "--store",
        store.to_str().unwrap(),
    ]);
    same(&of(command.current_dir("/").output().unwrap().into()), "another folder");
}

#[test]
fn how_a_pipeline_is_written_does_not_matter() {
    let workspace = Workspace::small();
    let first = workspace.stages(&["run", "small.yaml"]);
    let scene = scene_of_20_cells();
    let (header, stages) = SMALL.split_once("scene:\n").unwrap();
    let (inline, _) = stages.split_once("stages:\n").unwrap();
    let (in_a_file, stages) = with_scene_in_a_file(SMALL);
    workspace.write("scene.yaml", &scene);
    let turned: String = stages.lines().rev().map(|line| format!("{line}\n")).collect();
    for (what, text) in [
        ("scene in a file", in_a_file),
        (
            "stages turned round",
            format!("{header}scene:\n{inline}stages:\n{turned}"),
        ),
        (
            "comments and blank lines",
            format!("# a\n\n{}", SMALL.replace("stages:", "# b\nstages: # c")),
        ),
        ("Windows line ends", SMALL.replace('\n', "\r\n")),
        ("byte order mark", format!("\u{feff}{SMALL}")),
        (
            "another unit",
            SMALL.replace("5.25 kV", "5250 V").replace("45 kPa", "0.045 MPa"),
        ),
        (
            "other spellings",
            SMALL
                .replace("5.25 kV", "5.250e0 kV")
                .replace("count: 4", "\"count\": 4"),
        ),
        (
            "defaults spelt out",
            SMALL
                .replace(
                    "elements_per_cell: 1",
                    "elements_per_cell: 1, order: 1, method: newton, tolerance: 1e-8",
                )
                .replace("count: 4", "count: 4, area: 0.5"),
        ),
        (
            "an anchor",
            SMALL
                .replace("count: 4", "count: &n 4")
                .replace("target: 4", "target: *n"),
        ),
        (
            "another name",
            SMALL
                .replace("name: small", "name: other")
                .replace("small:  ", "first:  ")
                .replace("[small,", "[first,"),
        ),
    ] {
        workspace.write("again.yaml", &text);
        let ended = workspace.run(&["run", "again.yaml", "--json"]);
        assert_eq!(ended.code, Some(0), "{what}: {}", ended.stderr);
        let again = Stages::read(&ended.json());
        assert_eq!(again.with("built"), [""; 0], "{what}");
        assert_eq!(again.digests()["balanced"], first.digests()["balanced"], "{what}");
    }
}

/// A parameter of each kind, with the stages that it makes stale: its own and all that need it.
#[test]
fn every_parameter_makes_its_own_stage_and_what_needs_it_stale() {
    let workspace = Workspace::tiny();
    let first = workspace.stages(&["run", "tiny.yaml"]);
    let after_solved = ["solved", "balanced", "surrogate", "design", "verified"];
    let from = |name: &str| {
        after_solved
            .iter()
            .copied()
            .skip_while(|other| *other != name)
            .collect::<Vec<_>>()
    };
    let with = |name, more: &[&'static str]| [&[name], more].concat();
    let reference = ["reference", "accuracy"];
    let simulated = [&after_solved[..], &reference].concat();
    let bezier = with("bezier", &simulated);
    let cases: Vec<(&str, Vec<&str>)> = vec![
        ("stages.small.count=61", with("small", &after_solved)),
        ("stages.small.area=0.4", with("small", &after_solved)),
        ("stages.small.seed=11", with("small", &after_solved)),
        ("stages.large.units=[2, 4]", with("large", &after_solved)),
        ("stages.large.count_per_units=9", with("large", &after_solved)),
        ("stages.large.seed=11", with("large", &after_solved)),
        ("stages.bezier.count=9", bezier.clone()),
        ("stages.bezier.area=0.4", bezier.clone()),
        ("stages.bezier.ends=any", bezier.clone()),
        ("stages.bezier.seed=11", bezier),
        ("stages.solved.elements_per_cell=2", from("solved")),
        ("stages.solved.order=2", from("solved")),
        ("stages.solved.tolerance=1e-9", from("solved")),
        ("stages.solved.needs=[large, small, bezier]", from("solved")),
        ("stages.solved.needs=[small, large]", from("solved")),
        ("stages.balanced.bins=21", from("balanced")),
        ("stages.balanced.range=[0 mm, 2.6 mm]", from("balanced")),
        ("stages.balanced.target=61", from("balanced")),
        ("stages.balanced.symmetry=none", from("balanced")),
        ("stages.balanced.seed=14", from("balanced")),
        ("stages.surrogate.epochs=2", from("surrogate")),
        ("stages.surrogate.batch=16", from("surrogate")),
        ("stages.surrogate.learning_rate=0.0003", from("surrogate")),
        ("stages.surrogate.max_weight=0.2", from("surrogate")),
        ("stages.surrogate.auxiliary_weight=0.35", from("surrogate")),
        ("stages.surrogate.seed=15", from("surrogate")),
        ("stages.design.objective.point=[25 mm, 26 mm]", from("design")),
        ("stages.design.objective.direction=10 deg", from("design")),
        ("stages.design.objective.measure=qin2024", from("design")),
        ("stages.design.area=0.45", from("design")),
        ("stages.design.population=21", from("design")),
        ("stages.design.generations=3", from("design")),
        ("stages.design.elite=0.1", from("design")),
        ("stages.design.crossover=0.6", from("design")),
        ("stages.design.mutation=0.2", from("design")),
        ("stages.design.area_penalty=4", from("design")),
        ("stages.design.stagnation=2", from("design")),
        ("stages.design.seed=16", from("design")),
        ("stages.design.evaluator=linear", from("design")),
        // What is asked of an evaluator counts only where it is chosen.
        ("stages.design.evaluator_accuracy=0.01 mm", Vec::new()),
        ("stages.verified.elements_per_cell=2", from("verified")),
        ("stages.verified.order=2", from("verified")),
        ("stages.reference.tolerance=1e-9", reference.to_vec()),
        ("stages.reference.elements_per_cell=3", reference.to_vec()),
        (
            "stages.accuracy.methods=[{ method: linear, elements_per_cell: 1 }]",
            vec!["accuracy"],
        ),
        ("scene.drive.voltage=5 kV", simulated.clone()),
        ("scene.material.shear_modulus=46 kPa", simulated.clone()),
        ("scene.material.relative_permittivity=4.6", simulated.clone()),
        ("scene.geometry.thickness=1.1 mm", simulated.clone()),
        ("scene.geometry.prestretch=3.1", simulated.clone()),
        ("scene.geometry.side=51 mm", simulated.clone()),
        ("scene.effects.wrinkling={}", simulated),
        // What only screening looks at, and properties that no effect uses, decide about no result.
        ("scene.drive.frequency=2 Hz", Vec::new()),
        ("scene.drive.duration=10 s", Vec::new()),
        (
            "scene.properties={ density: 960, strain_stiffening: { model: gent, jm: 125 } }",
            Vec::new(),
        ),
    ];
    for (set, mut wanted) in cases {
        let ended = workspace.run(&["plan", "tiny.yaml", "--json", "--set", set]);
        assert_eq!(ended.code, Some(0), "{set}: {}", ended.stderr);
        let plan = Stages::read(&ended.json());
        let mut stale = plan.with("stale");
        stale.sort_unstable();
        wanted.sort_unstable();
        assert_eq!(stale, wanted, "{set}");
        for (name, digest) in first.digests() {
            let same = plan.stage(&name)["digest"] == *digest;
            assert!(same || stale.contains(&name.as_str()), "{set}: {name}");
        }
    }
    // A plan has built nothing, and no change was remembered.
    assert_eq!(workspace.stages(&["run", "tiny.yaml"]).with("built"), [""; 0]);
}

#[test]
fn a_scene_file_counts_as_it_is_at_the_beginning_of_each_run() {
    let workspace = Workspace::new();
    let scene = scene_of_20_cells();
    workspace.write("p.yaml", &with_scene_in_a_file(SMALL).0);
    workspace.write("scene.yaml", &scene);
    let first = workspace.stages(&["run", "p.yaml"]);
    workspace.write("scene.yaml", &scene.replace("5.25 kV", "5 kV"));
    let changed = workspace.stages(&["run", "p.yaml"]);
    assert_eq!(changed.with("built"), ["solved", "balanced"]);
    assert_ne!(changed.digests()["solved"], first.digests()["solved"]);
    workspace.write("scene.yaml", &scene);
    let back = workspace.stages(&["run", "p.yaml"]);
    assert_eq!((back.with("built"), back.digests()), (vec![], first.digests()));
}

#[test]
fn files_that_are_replaced_while_a_run_goes_on_do_not_matter() {
    let workspace = Workspace::new();
    let scene = scene_of_20_cells();
    let pipeline = with_scene_in_a_file(SMALL).0.replace("count: 4", "count: 100");
    workspace.write("p.yaml", &pipeline);
    workspace.write("scene.yaml", &scene);
    let undisturbed = workspace.stages(&["run", "p.yaml", "--store", "calm"]);
    let mut command = workspace.command(&["run", "p.yaml", "--json"]);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // A store is opened once everything has been read.
    while !workspace.path("store/format").exists() {
        sleep(Duration::from_millis(1));
    }
    workspace.write("scene.yaml", &scene.replace("5.25 kV", "2 kV"));
    workspace.write(
        "p.yaml",
        "version: 1\nname: nothing\nstages: { s: { kind: sample, family: bezier, count: 1, seed: 1 } }\n",
    );
    let stages = of(child.wait_with_output().unwrap().into());
    assert_eq!(stages.digests(), undisturbed.digests());
}

#[test]
fn the_small_pipeline_is_the_beginning_of_the_tiny_one() {
    // Both stand in for what users write: a change to one must not leave the other behind.
    let scene = |text: &str| {
        text.split_once("scene:\n")
            .unwrap()
            .1
            .split_once("stages:")
            .unwrap()
            .0
            .to_owned()
    };
    assert_eq!(scene(SMALL), scene(TINY).replace("cells: 50", "cells: 20"));
}

#[test]
fn a_rerun_tells_the_same_from_memory() {
    let workspace = Workspace::new();
    let stages = "  climbed:  { kind: design, method: adjoint, units: 20, starts: 1, seed: 1, objective: { point: [30 mm, 22 mm], direction: 20 deg } }
  verified: { kind: verify, needs: [climbed], elements_per_cell: 1 }
";
    let (header, _) = SMALL.split_once("stages:\n").unwrap();
    workspace.write("p.yaml", &format!("{header}stages:\n{stages}"));
    let document = || {
        let ended = workspace.run(&["run", "p.yaml", "--json"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let mut document = ended.json();
        document.as_object_mut().unwrap().remove("stages");
        document
    };
    let first = document();
    let figures = first["figures"].as_array().unwrap();
    assert!(
        figures.len() > 1 && !first["results"].as_array().unwrap().is_empty(),
        "{first}"
    );
    assert_eq!(document(), first);
    // What is remembered is damaged, then a figure is gone.
    for memo in files(&workspace.path("store/memos")) {
        let text = std::fs::read_to_string(&memo).unwrap();
        if text.contains("of_kinds") {
            std::fs::write(&memo, text.replace('1', "2")).unwrap();
        }
    }
    assert_eq!(document(), first);
    let figure = workspace.path(figures[0].as_str().unwrap());
    std::fs::remove_file(&figure).unwrap();
    assert_eq!(document(), first);
    assert!(figure.is_file());
    let words = |arguments: &[&str]| {
        let ended = workspace.run(arguments);
        let lines = ended.stdout.lines().skip_while(|line| !line.starts_with("verified"));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    let said = words(&["run", "p.yaml"]);
    assert!(!said.is_empty());
    assert_eq!(words(&["run", "p.yaml"]), said);
}
