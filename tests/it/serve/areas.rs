//! One area fraction everywhere: the share of the membrane that is neither frame nor body.

use serde_json::{Value, json};

use super::super::common::{Workspace, csv, scene_file};
use super::rows;
use super::server::Server;
use super::tab::Tab;

/// A membrane in a round opening with a body.
fn scene() -> String {
    let device = "cells: 50, frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } } }, \
                  bodies: [{ rectangle: [[30 mm, 23 mm], [34 mm, 27 mm]] }]";
    scene_file().replace("cells: 50", device)
}

/// Whether a cell of 1 mm is membrane.
fn is_free(x: usize, y: usize) -> bool {
    let [x, y] = [x, y].map(|at| at as f64 + 0.5);
    let is_body = (30.0..=34.0).contains(&x) && (23.0..=27.0).contains(&y);
    (x - 25.0).hypot(y - 25.0) <= 20.0 && !is_body
}

/// A stripe that also covers parts of the frame and of the body.
fn stripe(x: usize, _: usize) -> bool {
    (20..32).contains(&x)
}

/// The number of cells that satisfy a condition.
fn count(is_in: impl Fn(usize, usize) -> bool) -> f64 {
    (0..2500).filter(|at| is_in(at % 50, at / 50)).count() as f64
}

fn column(workspace: &Workspace, stage: &str) -> Vec<f64> {
    let file = format!("{stage}.h5");
    let ended = workspace.run(&["export", "artifact", &format!("round.yaml:{stage}"), "-o", &file]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path(&file)).unwrap();
    file.dataset("area").unwrap().read_raw::<f64>().unwrap()
}

#[test]
fn commands_artifacts_and_page_state_the_same_share_of_the_free_membrane() {
    let (free, cells) = (count(is_free), count(|x, y| stripe(x, y) && is_free(x, y)));
    let wanted = cells / free;
    let is_wanted = |value: &Value| assert!((value.as_f64().unwrap() - wanted).abs() < 1e-12, "{value} {wanted}");
    let (workspace, text) = (Workspace::new(), scene());
    workspace.write("scene.yaml", &text);
    workspace.write("stripe.csv", &csv(stripe));
    workspace.write(
        "round.yaml",
        "version: 1\nname: round\nscene: scene.yaml\nstages:\n  \
         own: { kind: patterns, files: [stripe.csv] }\n  \
         drawn: { kind: sample, family: stripes, count: 3, area: 0.25, seed: 1 }\n  \
         curved: { kind: sample, family: bezier, count: 3, area: 0.25, seed: 1 }\n  \
         single: { kind: sample, family: small-grid, count: 3, area: 0.25, seed: 1 }\n  \
         swept: { kind: sample, family: area-sweep, count: 9, area: [0.2, 0.3], seed: 1 }\n  \
         best: { kind: design, method: adjoint, units: 20, starts: 1, seed: 1, area: 0.25, area_tolerance: 0.01, \
         objective: { point: [20 mm, 25 mm], direction: 0 deg } }\n  \
         checked: { kind: verify, needs: [best, own], elements_per_cell: 1 }\n",
    );
    let ended = workspace.run(&["run", "round.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let run: Value = serde_json::from_str(&ended.stdout).unwrap();
    let found = run["results"][0]["rows"].as_array().unwrap();
    let row = |role: &str| found.iter().find(|row| row["role"] == role).unwrap();
    is_wanted(&row("own")["area"]);
    assert!((row("own")["area_mm2"].as_f64().unwrap() - cells).abs() < 1e-9);
    // The found design has the wanted area, and the intuitive one of equal area has as many cells.
    for role in ["optimum", "intuitive-equal-area"] {
        let area = row(role)["area"].as_f64().unwrap();
        assert!((area - 0.25).abs() <= 0.01 + 1e-9, "{role} {area}");
    }
    assert_eq!(row("optimum")["status"], "met");
    assert_eq!(row("optimum")["area"], row("intuitive-equal-area")["area"]);
    assert!(
        row("own")["status"]
            .as_str()
            .unwrap()
            .starts_with(&format!("area {wanted:.4}, wanted 0.25"))
    );
    is_wanted(&json!(column(&workspace, "own")[0]));
    for stage in ["drawn", "curved", "single"] {
        let areas = column(&workspace, stage);
        assert_eq!(areas, vec![(0.25 * free).round() / free; 3], "{stage}");
    }
    let swept = column(&workspace, "swept");
    assert!(
        swept
            .iter()
            .all(|area| (0.2 - 0.5 / free..=0.3 + 0.5 / free).contains(area)),
        "{swept:?}"
    );
    // The mask, the file, and the sketchpad.
    let mask = [
        "export",
        "design",
        "round.yaml:checked",
        "--role",
        "own",
        "-o",
        "own.svg",
        "--json",
    ];
    let said: Value = serde_json::from_str(&workspace.run(&mask).stdout).unwrap();
    is_wanted(&said["area_fraction"]);
    assert_eq!(said["area_mm2"], cells);
    let checked = workspace.run(&["check", "stripe.csv", "--scene", "scene.yaml", "--json"]);
    let checked: Value = serde_json::from_str(&checked.stdout).unwrap();
    is_wanted(&checked["files"][0]["patterns"][0]["area"]);
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let body = json!({ "scene": text, "pattern": rows(stripe) });
    let reply = server.post("/api/sketch", &body);
    assert_eq!(reply.status, 200, "{}", reply.text());
    is_wanted(&reply.json()["area"]);
    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('#outcome')");
    tab.click("[data-tool=fill]");
    tab.stroke("#pad", &[[0.5, 0.5], [0.5, 0.5]]);
    tab.until(&format!(
        "document.querySelector('#area').textContent === 'area 100 % of the membrane, {free} mm²'"
    ));
}

#[test]
fn without_a_frame_the_area_is_that_of_all_cells() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("stripe.csv", &csv(stripe));
    let checked = workspace.run(&["check", "stripe.csv", "--scene", "scene.yaml", "--json"]);
    let checked: Value = serde_json::from_str(&checked.stdout).unwrap();
    let pattern = &checked["files"][0]["patterns"][0];
    assert_eq!((&pattern["area"], &pattern["area_mm2"]), (&json!(0.24), &json!(600.0)));
}
