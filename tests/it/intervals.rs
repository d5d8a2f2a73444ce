//! Prediction intervals and novelty in files, tables, text and JSON, for predictions and designs.

use std::collections::BTreeMap;

use serde_json::Value;

use super::common::{Transcript, Workspace, snapshot, snapshots::without_numbers};

const MORE: &str = "stages.more={ kind: sample, family: small-grid, count: 90, seed: 14 }";
const UNSEEN: &str = "stages.unseen={ kind: solve, needs: [more], elements_per_cell: 1 }";
const INTERVALS: &str = "stages.intervals={ kind: calibrate, needs: [surrogate, unseen], seed: 1 }";
pub const POINT: &str = "{ point: [20 mm, 25 mm], direction: 0 deg }";

/// A calibrated model in a store, a pattern of its families and one that is far from them.
pub fn workspace() -> Workspace {
    let workspace = Workspace::tiny();
    workspace.stages(&[
        "run",
        "tiny.yaml",
        "--until",
        "intervals",
        "--set",
        MORE,
        "--set",
        UNSEEN,
        "--set",
        INTERVALS,
    ]);
    let csv = |active: &dyn Fn(usize, usize) -> bool| -> String {
        let row = |y| {
            (0..50)
                .map(|x| if active(x, y) { "1" } else { "0" })
                .collect::<Vec<_>>()
                .join(",")
                + "\n"
        };
        (0..50).map(row).collect()
    };
    // Half of the cells at random, as a small grid has them, and single cells in order.
    let mut state = 7u64;
    let mut ranked: Vec<(u64, usize)> = (0..2500)
        .map(|cell| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 20, cell)
        })
        .collect();
    ranked.sort_unstable();
    let mut random = [false; 2500];
    ranked[..1250].iter().for_each(|&(_, cell)| random[cell] = true);
    workspace.write("cells.csv", &csv(&|x, y| random[50 * y + x]));
    workspace.write("board.csv", &csv(&|x, y| (x + y) % 2 == 0));
    workspace
}

fn predict(workspace: &Workspace, model: &str, more: &[&str]) -> super::common::Ended {
    let common = ["predict", model, "cells.csv", "board.csv", "-o", "out.h5"];
    workspace.run(&[&common[..], more].concat())
}

fn column(workspace: &Workspace, path: &str) -> Vec<f64> {
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    file.dataset(path).unwrap().read_raw::<f64>().unwrap()
}

/// The table by column.
fn table(workspace: &Workspace) -> BTreeMap<String, Vec<f64>> {
    let mut reader = csv::Reader::from_path(workspace.path("out.csv")).unwrap();
    let names: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let column = |k: usize| rows.iter().map(|row| row[k].parse().unwrap()).collect();
    names
        .iter()
        .enumerate()
        .map(|(k, name)| (name.clone(), column(k)))
        .collect()
}

#[test]
fn a_prediction_carries_its_interval_in_every_format() {
    let workspace = workspace();
    let ended = predict(&workspace, "surrogate", &["--objective", POINT, "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let said = &document["intervals"];
    let artifact = workspace.run(&["show", "intervals", "--json"]).json();
    assert_eq!(
        said["calibration"], artifact["digest"],
        "that of the run is found by itself"
    );
    assert_eq!(
        (&said["coverage"], &said["out_of_distribution"]),
        (&0.95.into(), &1.into())
    );
    assert!(
        said["calibrated_on"].as_str().unwrap().starts_with("small-grid 90"),
        "{said}"
    );

    let table = table(&workspace);
    let number = |value: &Value| value.as_f64().unwrap();
    for (k, row) in said["predictions"].as_array().unwrap().iter().enumerate() {
        let [value, lower, upper] =
            ["predicted_mm", "lower_mm", "upper_mm"].map(|end| number(&row["max_displacement"][end]));
        let radius = number(&row["radius_mm"]);
        assert!(radius > 0.0 && lower >= 0.0 && lower < value);
        assert!((upper - value - 2f64.sqrt() * radius).abs() < 1e-12);
        let objective = &row["objectives"][0];
        let ends = ["predicted_mm", "lower_mm", "upper_mm"].map(|end| number(&objective[end]));
        assert!(ends[1] < ends[0] && ends[0] < ends[2], "{ends:?}");
        // The point moves as the written field says: 20 mm of 50 mm is corner 20 of row 25.
        let field = column(&workspace, "displacement");
        assert!((field[k * 5202 + 2 * (25 * 51 + 20)] - ends[0]).abs() < 1e-9);
        for (name, path, expected) in [
            ("max_displacement_mm", "max_displacement", value),
            ("max_displacement_lower_mm", "interval/max_displacement_lower", lower),
            ("max_displacement_upper_mm", "interval/max_displacement_upper", upper),
            ("radius_mm", "interval/radius", radius),
            ("novelty", "interval/novelty", number(&row["novelty"])),
            ("objective_1_mm", "interval/objective/predicted", ends[0]),
            ("objective_1_lower_mm", "interval/objective/lower", ends[1]),
            ("objective_1_upper_mm", "interval/objective/upper", ends[2]),
        ] {
            assert!((table[name][k] - expected).abs() < 1e-12, "{name}");
            assert!((column(&workspace, path)[k] - expected).abs() < 1e-12, "{path}");
        }
        let flagged = row["out_of_distribution"].as_bool().unwrap();
        assert_eq!(flagged, k == 1, "the board is far from cells at random");
        assert_eq!(flagged, number(&row["novelty"]) > 1.0);
        assert_eq!(
            column(&workspace, "interval/out_of_distribution")[k],
            f64::from(u8::from(flagged))
        );
        assert_eq!(table["out_of_distribution"][k], f64::from(u8::from(flagged)));
        assert_eq!(table["coverage"][k], 0.95);
    }

    let text = predict(&workspace, "surrogate", &["--objective", POINT]).stdout;
    for part in ["small-grid 90", "95 %", "{ point: [20 mm, 25 mm]", "out.csv"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    snapshot!(without_numbers(&text));
}

#[test]
fn a_calibration_belongs_to_one_model() {
    let workspace = workspace();
    let export = ["export", "model", "surrogate", "-o", "model.safetensors"];
    assert_eq!(workspace.run(&export).code, Some(0));
    let path = workspace.run(&["show", "intervals", "--json"]).json()["path"]
        .as_str()
        .unwrap()
        .to_owned();
    std::fs::copy(workspace.path(&path), workspace.path("calibration.h5")).unwrap();

    // Files stand for themselves: nothing of the store is taken unless it is named.
    let ended = predict(&workspace, "model.safetensors", &["--json"]);
    assert_eq!((ended.code, &ended.json()["intervals"]), (Some(0), &Value::Null));
    let mut printed = Transcript::default();
    let text = predict(&workspace, "model.safetensors", &[]).stdout;
    printed.add("without a calibration", without_numbers(&text));
    assert!(!workspace.path("out.csv").exists());
    let with_file = predict(
        &workspace,
        "model.safetensors",
        &["--calibration", "calibration.h5", "--json"],
    );
    assert_eq!(with_file.code, Some(0), "{}", with_file.stderr);
    let by_store = predict(&workspace, "surrogate", &["--calibration", "intervals", "--json"]);
    assert_eq!(
        with_file.json()["intervals"]["predictions"],
        by_store.json()["intervals"]["predictions"]
    );

    let other = "stages.surrogate={ kind: train, needs: [balanced], network: qin2024, epochs: 1, seed: 6 }";
    workspace.stages(&["run", "tiny.yaml", "--until", "surrogate", "--set", other]);
    let mut refused = |more: &[&str], named: &str| {
        let ended = predict(&workspace, "surrogate", more);
        assert_eq!(ended.code, Some(2), "{more:?}: {}", ended.stdout);
        assert!(ended.stderr.contains(named), "{more:?}: {}", ended.stderr);
        printed.add(more.join(" "), ended);
    };
    refused(&["--calibration", "calibration.h5"], "model");
    refused(&["--calibration", "balanced"], "`balance`");
    refused(&["--calibration", "absent.h5"], "absent.h5");
    refused(&["--objective", POINT], "calibration");
    let exported = |more: &[&str]| {
        let common = [
            "predict",
            "model.safetensors",
            "board.csv",
            "--calibration",
            "calibration.h5",
        ];
        workspace.run(&[&common[..], more].concat())
    };
    for (more, named) in [
        (
            &["-o", "o.h5", "--objective", "{ point: [60 mm, 25 mm], direction: 0 }"][..],
            "60",
        ),
        (&["-o", "o.h5", "--objective", "{ pint: [6 mm, 25 mm] }"], "pint"),
        (&["-o", "o.csv"], ".h5"),
        (&["-o", "calibration.h5"], "calibration.h5"),
        (&["-o", "board.h5"], "board.csv"),
    ] {
        let ended = exported(more);
        assert_eq!(ended.code, Some(2), "{more:?}: {}", ended.stdout);
        assert!(ended.stderr.contains(named), "{more:?}: {}", ended.stderr);
        printed.add(more.join(" "), ended);
    }
    snapshot!(printed);
}

#[test]
fn designs_have_intervals_to_compare_with_the_simulation() {
    let workspace = workspace();
    let design = |needs: &str| {
        format!(
            "stages.design={{ kind: design, needs: {needs}, evaluator: surrogate, objective: {{ point: [25 mm, 25 \
             mm], direction: 0 deg }}, area: 0.5, population: 20, generations: 2, seed: 6 }}"
        )
    };
    let run = |design: &str, more: &[&str]| {
        let common = [
            "run",
            "tiny.yaml",
            "--until",
            "verified",
            "--set",
            MORE,
            "--set",
            UNSEEN,
            "--set",
            INTERVALS,
            "--set",
            design,
        ];
        workspace.run(&[&common[..], more].concat())
    };
    let ended = run(&design("[surrogate, intervals]"), &["--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let stated = &document["design_intervals"][0]["designs"][0];
    let rows = document["results"][0]["rows"].as_array().unwrap();
    let found = rows.iter().find(|row| row["role"] == "ga").unwrap();
    assert_eq!(stated["interval"], found["interval"], "verification carries it on");
    let number = |key: &str| found["interval"][key].as_f64().unwrap();
    assert!(number("lower_mm") < number("predicted_mm") && number("predicted_mm") < number("upper_mm"));
    assert!(
        (number("predicted_mm") - found["predicted_mm"].as_f64().unwrap()).abs() < 1e-9,
        "the network judged"
    );
    assert!(
        rows.iter().all(|row| row["interval"]["coverage"] == 0.95),
        "of intuitive designs too"
    );
    let said = run(&design("[surrogate, intervals]"), &["-v"]).stdout;
    for part in ["95 %", "small-grid 90"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let shown = workspace.run(&["show", "design"]).stdout;
    assert!(
        shown.contains("interval/lower") && shown.contains("interval/novelty"),
        "{shown}"
    );

    let sets = [
        "--set",
        MORE,
        "--set",
        UNSEEN,
        "--set",
        INTERVALS,
        "--partial",
        "-o",
        "report",
    ];
    let with_design = design("[surrogate, intervals]");
    let report = [&["report", "tiny.yaml", "--set", with_design.as_str()][..], &sets].concat();
    let ended = workspace.run(&report);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    assert!(page.contains("95 %"));
    let mut designs = csv::Reader::from_path(workspace.path("report/data/designs.csv")).unwrap();
    let at = designs
        .headers()
        .unwrap()
        .iter()
        .position(|name| name == "interval_upper_mm")
        .unwrap();
    assert!(designs.records().all(|row| row.unwrap()[at].parse::<f64>().is_ok()));

    let ended = run(&design("[intervals]"), &["--json"]);
    assert_eq!(ended.code, Some(2), "{}", ended.stdout);
    let message = ended.json()["error"]["message"].to_string();
    assert!(message.contains("needs a network"), "{message}");
    snapshot!(message);
}
