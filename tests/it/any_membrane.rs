//! Imports, audits and networks on membranes that are not the source paper's square.

use serde_json::Value;

use super::common::{Transcript, Workspace, snapshot};
use super::model::check;

/// A rectangle of 50 × 30 mm, stretched a little more across than along.
const SCENE: &str = "geometry: { size: [50 mm, 30 mm], thickness: 1.0 mm, prestretch: [3, 3.2], cells: [40, 24] }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 4.5 kV }
effects: {}
";

const IMPORTED: &str = "version: 1
name: own
scene: scene.yaml
stages:
  labels:   { kind: import, files: [FILE] }
  audited:  { kind: audit, needs: [labels], samples: 2, seed: 1, fail_on: never }
  balanced: { kind: balance, needs: [labels, audited], bins: 5, range: [0 mm, 3 mm], target: 40, symmetry: d4, seed: 1 }
";

/// A disc frame with a hub.
const RING: &str = "geometry: { side: 40 mm, thickness: 1.0 mm, prestretch: 3, cells: 30,
  frame: { opening: { disc: { centre: [20 mm, 20 mm], radius: 18 mm } }, held: [{ rectangle: [[18 mm, 18 mm], [22 mm, 22 mm]] }] } }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltages: [5 kV, 3 kV] }
effects: {}
";

/// Writes patterns of a raster as CSV files, and gives their names.
fn patterns(
    workspace: &Workspace,
    count: usize,
    [columns, rows]: [usize; 2],
    cell: impl Fn(usize, usize, usize) -> u8,
) -> Vec<String> {
    let write = |k: usize| {
        let line = |y| {
            (0..columns)
                .map(|x| cell(k, x, y).to_string())
                .collect::<Vec<_>>()
                .join(",")
                + "\n"
        };
        let name = format!("p{k}.csv");
        workspace.write(&name, &(0..rows).map(line).collect::<String>());
        name
    };
    (0..count).map(write).collect()
}

/// Solves patterns by the command.
fn solve(workspace: &Workspace, names: &[String], out: &str) {
    let mut arguments = vec!["solve", "scene.yaml"];
    arguments.extend(names.iter().map(String::as_str));
    arguments.extend(["--elements-per-cell", "1", "-o", out]);
    let ended = workspace.run(&arguments);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
}

/// Changes the displacements of a file.
fn rewrite(workspace: &Workspace, from: &str, to: &str, change: impl Fn(&mut [f64])) {
    // Another test's program may inherit a file that is open here, and its lock.
    let folder = tempfile::tempdir().unwrap();
    let aside = folder.path().join("aside.h5");
    std::fs::copy(workspace.path(from), &aside).unwrap();
    let file = hdf5::File::open_rw(&aside).unwrap();
    let dataset = file.dataset("displacement").unwrap();
    let mut values = dataset.read_raw::<f64>().unwrap();
    change(&mut values);
    dataset.write_raw(&values).unwrap();
    // What is open keeps what is written to itself.
    drop(dataset);
    file.close().unwrap();
    std::fs::copy(&aside, workspace.path(to)).unwrap();
}

fn checks(found: &Value) -> Vec<(&str, Vec<u64>)> {
    let rows = |finding: &Value| {
        let examples = finding["examples"].as_array().unwrap().iter();
        examples.map(|row| row.as_u64().unwrap()).collect()
    };
    let findings = found["findings"].as_array().unwrap_or_else(|| panic!("{found}"));
    findings
        .iter()
        .map(|f| (f["check"].as_str().unwrap(), rows(f)))
        .collect()
}

/// A pattern of a number below 11 on 40 × 24 cells without a symmetry.
fn scattered(k: usize, x: usize, y: usize) -> u8 {
    u8::from((x / 4 * 7 + y / 3 * 5 + (x / 4) * (y / 3) * (k + 1)) % 11 < 5)
}

#[test]
fn labels_of_a_rectangle_are_imported_audited_and_balanced() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", SCENE);
    let mut names = patterns(&workspace, 10, [40, 24], scattered);
    workspace.write("image.csv", &{
        let line = |y: usize| {
            (0..40)
                .map(|x| scattered(0, 39 - x, 23 - y).to_string())
                .collect::<Vec<_>>()
                .join(",")
        };
        (0..24).map(|y| line(y) + "\n").collect::<String>()
    });
    names.push("image.csv".to_owned());
    solve(&workspace, &names, "sound.h5");
    workspace.write("own.yaml", &IMPORTED.replace("FILE", "sound.h5"));
    let built = workspace.stages(&["run", "own.yaml"]);
    assert_eq!(built.with("built"), ["labels", "audited", "balanced"]);
    let sound = workspace.run(&["audit", "own.yaml:labels", "--samples", "2", "--json"]);
    assert_eq!(sound.code, Some(0), "{}{}", sound.stdout, sound.stderr);
    assert_eq!(sound.json()["findings"].as_array().unwrap().len(), 0);
    // Half a turn of a pattern is an image of it, a quarter is none.
    assert_eq!(sound.json()["summary"]["orbits"], 10);
    let balanced = workspace.run(&["audit", "own.yaml:balanced", "--samples", "2", "--json"]);
    assert_eq!(balanced.code, Some(0), "{}{}", balanced.stdout, balanced.stderr);

    const FIELD: usize = 25 * 41 * 2;
    type Fault = (&'static str, fn(&mut [f64]));
    let faults: [Fault; 4] = [
        ("sign", |u| u.iter_mut().for_each(|u| *u = -*u)),
        ("rotation", |u| u.chunks_mut(2).for_each(|u| u[0] = -u[0])),
        ("boundary", |u| u[2 * 40] = 0.003),
        ("label", |u| {
            u.iter_mut().enumerate().for_each(|(i, u)| *u += 1e-3 * (i % 7) as f64)
        }),
    ];
    for (check, fault) in faults {
        rewrite(&workspace, "sound.h5", "bad.h5", |all| {
            fault(&mut all[9 * FIELD..10 * FIELD])
        });
        let ended = workspace.run(&["audit", "bad.h5", "--scene", "scene.yaml", "--samples", "0", "--json"]);
        assert_eq!(ended.code, Some(5), "{check}: {}", ended.stderr);
        let found = ended.json();
        assert!(checks(&found).contains(&(check, vec![9])), "{check}: {found}");
    }
    let ended = workspace.run(&[
        "audit",
        "bad.h5",
        "--scene",
        "scene.yaml",
        "--samples",
        "0",
        "-o",
        "page",
    ]);
    assert_eq!(ended.code, Some(5), "{}", ended.stderr);
    assert!(workspace.path("page").join("label-9.png").exists());

    workspace.write("bad.yaml", &IMPORTED.replace("FILE", "bad.h5"));
    let said = workspace.refused(&["run", "bad.yaml"]);
    assert!(said.contains("bad.h5") && said.contains("row 9"), "{said}");
    let mut printed = Transcript::default();
    printed.add("a frame that moves", said);
    workspace.write("square.yaml", &SCENE.replace("cells: [40, 24]", "cells: [24, 40]"));
    workspace.write(
        "turned.yaml",
        &IMPORTED
            .replace("FILE", "sound.h5")
            .replace("scene.yaml", "square.yaml"),
    );
    let said = workspace.refused(&["run", "turned.yaml"]);
    assert!(said.contains("(11, 24, 40)") && said.contains("(n, 40, 24)"), "{said}");
    printed.add("another raster", said);
    snapshot!(printed);
}

#[test]
fn labels_of_groups_in_a_frame_are_imported_and_audited() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", RING);
    let inside = |x: usize, y: usize| {
        let radius = (x as f64 - 14.5).hypot(y as f64 - 14.5);
        (4.0..12.0).contains(&radius)
    };
    let names = patterns(&workspace, 4, [30, 30], |k, x, y| {
        u8::from(inside(x, y)) * ((x / 5 + (k + 1) * (y / 5)) % 3) as u8
    });
    solve(&workspace, &names, "sound.h5");
    workspace.write("own.yaml", &IMPORTED.replace("FILE", "sound.h5"));
    let built = workspace.stages(&["run", "own.yaml", "--until", "audited"]);
    assert_eq!(built.with("built"), ["labels", "audited"]);
    let sound = workspace.run(&["audit", "own.yaml:labels", "--samples", "1", "--json"]);
    assert_eq!(sound.code, Some(0), "{}{}", sound.stdout, sound.stderr);

    // A corner of the hub moves: it is held like the edges.
    rewrite(&workspace, "sound.h5", "moved.h5", |all| {
        all[2 * (31 * (31 + 15) + 15)] = 0.01
    });
    let ended = workspace.run(&["audit", "moved.h5", "--scene", "scene.yaml", "--samples", "0", "--json"]);
    assert_eq!(ended.code, Some(5), "{}", ended.stderr);
    let found = ended.json();
    assert!(checks(&found).contains(&("boundary", vec![1])), "{found}");

    workspace.write("moved.yaml", &IMPORTED.replace("FILE", "moved.h5"));
    let said = workspace.refused(&["run", "moved.yaml"]);
    for part in ["moved.h5", "row 1", "1.000e-2 mm", "[y=15][x=15]"] {
        assert!(said.contains(part), "{said}");
    }
}

const TRAINED: &str = "version: 1
name: trained
scene: scene.yaml
stages:
  blobs:     { kind: sample, family: blobs, count: 60, seed: 1 }
  bezier:    { kind: sample, family: bezier, count: 40, seed: 2 }
  solved:    { kind: solve, needs: [blobs, bezier], elements_per_cell: 1 }
  balanced:  { kind: balance, needs: [solved], bins: 6, range: [0 mm, 3 mm], target: 160, symmetry: d4, seed: 3 }
  physics:   { kind: train, needs: [balanced], network: physics, epochs: 6, symmetry: d4, seed: 4 }
  qin:       { kind: train, needs: [balanced], network: qin2024, epochs: 1, seed: 4 }
  fresh:     { kind: sample, family: blobs, count: 90, seed: 5 }
  unseen:    { kind: solve, needs: [fresh], elements_per_cell: 1 }
  intervals: { kind: calibrate, needs: [physics, unseen], seed: 6 }
  evaluated: { kind: evaluate, needs: [physics, qin, intervals, balanced], estimates: [linear] }
";

/// The displacements of a file, with the shape of their array.
fn displacement(workspace: &Workspace, file: &str) -> (Vec<usize>, Vec<f64>) {
    let file = hdf5::File::open(workspace.path(file)).unwrap();
    let dataset = file.dataset("displacement").unwrap();
    (dataset.shape(), dataset.read_raw().unwrap())
}

/// The error of each predictor over the patterns of all families.
fn errors_over_all(evaluation: &Value) -> Vec<f64> {
    let predictors = evaluation["predictors"].as_array().unwrap().iter();
    let over_all = |predictor: &Value| predictor["rmse_mm"].as_array().unwrap().last().unwrap().as_f64();
    predictors.map(|predictor| over_all(predictor).unwrap()).collect()
}

#[test]
fn networks_learn_a_rectangle_are_calibrated_and_judged() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", SCENE);
    workspace.write("trained.yaml", TRAINED);
    let ended = workspace.run(&["run", "trained.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let evaluation = &ended.json()["evaluations"][0];
    let errors = errors_over_all(evaluation);
    let [physics, _, linear] = errors[..] else {
        panic!("{evaluation}")
    };
    assert!(physics < 0.5 * linear, "{errors:?}");
    let again = workspace.stages(&["run", "trained.yaml"]);
    assert!(again.with("built").is_empty());

    // The prediction of an image is the image of the prediction, by the four symmetries of the rectangle.
    let mirrored = |k: usize| (k % 2 == 1, k >= 2);
    let names = patterns(&workspace, 4, [40, 24], |k, x, y| {
        let (along, up) = mirrored(k);
        scattered(2, if along { 39 - x } else { x }, if up { 23 - y } else { y })
    });
    let files: Vec<&str> = names.iter().map(String::as_str).collect();
    for model in ["physics", "qin"] {
        let name = format!("trained.yaml:{model}");
        let mut arguments = vec!["predict", &name];
        arguments.extend(&files);
        arguments.extend(["-o", "out.h5", "--scene", "scene.yaml"]);
        let ended = workspace.run(&arguments);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let (shape, values) = displacement(&workspace, "out.h5");
        assert_eq!(shape, [4, 25, 41, 2]);
        if model == "physics" {
            let fields: Vec<&[f64]> = values.chunks(25 * 41 * 2).collect();
            let largest = fields[0].iter().fold(0.0, |most: f64, u| most.max(u.abs()));
            assert!(largest > 0.05, "{largest}");
            for (k, field) in fields.iter().enumerate() {
                for (x, y) in (0..25).flat_map(|y| (0..41).map(move |x| (x, y))) {
                    let (mirrored_x, mirrored_y) = mirrored(k);
                    let from = (if mirrored_x { 40 - x } else { x }, if mirrored_y { 24 - y } else { y });
                    let of = |field: &[f64], (x, y): (usize, usize), component| field[2 * (41 * y + x) + component];
                    for (component, mirrored) in [mirrored_x, mirrored_y].into_iter().enumerate() {
                        let sign = if mirrored { -1.0 } else { 1.0 };
                        let difference = of(field, (x, y), component) - sign * of(fields[0], from, component);
                        assert!(difference.abs() < 2e-5 * largest, "{k} {x} {y}: {difference}");
                    }
                }
            }
        }
        let ended = workspace.run(&["export", "model", &name, "-o", "model.onnx"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let (agrees, said) = check(&workspace, "model.onnx", "out.h5");
        assert!(agrees, "{model}: {said}");
    }

    // Without a file the table alone is printed.
    let ended = workspace.run(&["predict", "trained.yaml:physics", "p0.csv"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(
        ended.stdout.contains("1 pattern in ") && ended.stdout.contains("novelty"),
        "{ended}"
    );
    // A model of another device is refused with the difference.
    workspace.write(
        "other.yaml",
        &SCENE.replace("prestretch: [3, 3.2]", "prestretch: [3, 3.3]"),
    );
    let said = workspace.refused(&[
        "predict",
        "trained.yaml:physics",
        "p0.csv",
        "-o",
        "no.h5",
        "--scene",
        "other.yaml",
    ]);
    assert!(said.contains("prestretch"), "{said}");
    let mut printed = Transcript::default();
    printed.add("predict in another scene", said);
    workspace.write("square.csv", &(vec!["0"; 50].join(",") + "\n").repeat(50));
    let said = workspace.refused(&["predict", "trained.yaml:physics", "square.csv", "-o", "no.h5"]);
    assert!(said.contains("24") && said.contains("40"), "{said}");
    printed.add("predict on another raster", said);
    snapshot!(printed);

    // A search by the network, verified by finite elements.
    let design = "stages.design={ kind: design, needs: [physics], evaluator: surrogate, population: 20, generations: \
                  4, seed: 1, objective: { point: [25 mm, 15 mm], direction: 0 deg }, area: 0.5 }";
    let verified = "stages.verified={ kind: verify, needs: [design], elements_per_cell: 1 }";
    let made = workspace.stages(&[
        "run",
        "trained.yaml",
        "--until",
        "verified",
        "--set",
        design,
        "--set",
        verified,
    ]);
    assert_eq!(made.with("built"), ["design", "verified"]);
}

#[test]
fn networks_learn_a_frame_and_a_body() {
    let workspace = Workspace::new();
    let geometry = "geometry: { side: 40 mm, thickness: 1.0 mm, prestretch: 3, cells: 30,
  frame: { opening: { disc: { centre: [20 mm, 20 mm], radius: 18 mm } } },
  bodies: [{ rectangle: [[18 mm, 16 mm], [22 mm, 24 mm]] }] }";
    let rest = SCENE.split_once('\n').unwrap().1;
    workspace.write("scene.yaml", &format!("{geometry}\n{rest}"));
    let pipeline: String = TRAINED
        .lines()
        .filter(|line| !line.contains("qin"))
        .fold(String::new(), |text, line| text + line + "\n");
    let pipeline =
        pipeline + "  evaluated: { kind: evaluate, needs: [physics, intervals, balanced], estimates: [linear] }\n";
    workspace.write("trained.yaml", &pipeline);
    let ended = workspace.run(&["run", "trained.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let evaluation = &ended.json()["evaluations"][0];
    let errors = errors_over_all(evaluation);
    assert!(errors[0] < 0.6 * errors[1], "{evaluation}");
}

/// A strip with a tip that is pulled, and two groups of electrodes in two states.
const STATES: &str = "\
geometry: { size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 3, cells: [20, 10], bodies: [{ rectangle: [[18 mm, 8 mm], [22 mm, 12 mm]], load: [2 mN, 1 mN] }] }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
states: { push: { voltages: [5 kV, 3 kV] }, pull: { voltages: [0 V, 5 kV] } }
";

const OF_STATES: &str = "version: 1
name: states
scene: scene.yaml
stages:
  drawn:   { kind: sample, family: blobs, groups: 2, count: 80, seed: 1 }
  fresh:   { kind: sample, family: blobs, groups: 2, count: 90, seed: 2 }
  push:    { kind: solve, needs: [drawn], state: push }
  pull:    { kind: solve, needs: [drawn], state: pull }
  unseen:  { kind: solve, needs: [fresh], state: push }
  of_push: { kind: train, needs: [push], network: physics, epochs: 8, symmetry: d4, seed: 3 }
  of_pull: { kind: train, needs: [pull], network: physics, epochs: 8, symmetry: d4, seed: 3 }
  convolved: { kind: train, needs: [push], network: qin2024, epochs: 1, seed: 3 }
  intervals: { kind: calibrate, needs: [of_push, unseen], seed: 6 }
  judged:  { kind: evaluate, needs: [of_push, intervals, unseen], estimates: [linear] }
  best:    { kind: design, needs: [of_push, of_pull], evaluator: surrogate, area: free, population: 60, generations: 8, seed: 4, refine: false,
             objective: { points: [{ body: 0, direction: 0 deg, state: push }, { body: 0, direction: 180 deg, state: pull }] } }
  checked: { kind: verify, needs: [best], elements_per_cell: 1, order: 2 }
";

#[test]
fn networks_learn_groups_and_loads_and_judge_the_states_of_a_device() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", STATES);
    workspace.write("states.yaml", OF_STATES);
    let ended = workspace.run(&["run", "states.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let told = ended.json();
    let errors = errors_over_all(&told["evaluations"][0]);
    assert!(errors[0] < 0.6 * errors[1], "physics and linear: {errors:?}");
    let rows = told["results"][0]["rows"].as_array().unwrap();
    let best = rows.iter().find(|row| row["role"] == "ga").unwrap();
    let [predicted, simulated] = ["predicted_mm", "simulated_mm"].map(|key| best[key].as_f64().unwrap());
    assert!((predicted - simulated).abs() < 0.06 * simulated, "{best}");
    // What a model says of patterns in a file is what it says in a pipeline, and it knows its groups.
    let groups = |x: usize, y: usize| ((x / 3 + y / 2) % 3) as u8;
    let line = |y: usize| (0..20).map(|x| groups(x, y).to_string()).collect::<Vec<_>>().join(",") + "\n";
    workspace.write("groups.csv", &(0..10).map(line).collect::<String>());
    let ended = workspace.run(&["predict", "states.yaml:of_push", "groups.csv", "-o", "said.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    for model in ["of_push", "convolved"] {
        let model = format!("states.yaml:{model}");
        let ended = workspace.run(&["export", "model", &model, "-o", "model.onnx"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let ended = workspace.run(&["predict", &model, "groups.csv", "-o", "of_model.h5"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let (agrees, said) = check(&workspace, "model.onnx", "of_model.h5");
        assert!(agrees && !said.contains("moved 0.0\n"), "{model}: {said}");
    }
    workspace.write(
        "push.yaml",
        &STATES.replace(
            "states: { push: { voltages: [5 kV, 3 kV] }, pull: { voltages: [0 V, 5 kV] } }",
            "drive: { voltages: [5 kV, 3 kV] }",
        ),
    );
    let ended = workspace.run(&["solve", "push.yaml", "groups.csv", "-o", "solved.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let [(_, predicted), (_, solved)] = ["said.h5", "solved.h5"].map(|file| displacement(&workspace, file));
    let size = |values: &[f64]| values.iter().map(|u| u * u).sum::<f64>().sqrt();
    let off: Vec<f64> = predicted.iter().zip(&solved).map(|(a, b)| a - b).collect();
    assert!(size(&off) < 0.1 * size(&solved), "{} of {}", size(&off), size(&solved));

    let one = OF_STATES.replace("needs: [of_push, of_pull]", "needs: [of_push]");
    workspace.write("one.yaml", &one);
    let said = workspace.refused(&["plan", "one.yaml"]);
    assert!(said.contains("2 states (pull, push)"), "{said}");
    workspace.write("three.csv", &"3,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0\n".repeat(10));
    let said = workspace.refused(&["predict", "states.yaml:of_push", "three.csv", "-o", "three.h5"]);
    assert!(said.contains("[y=0][x=0]") && said.contains('3'), "{said}");
}
