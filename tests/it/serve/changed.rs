//! Runs with changed values: cards and pipelines show the file as it stands, and runs are drawn over their values.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::super::common::{Workspace, scene_file};
use super::photographed;
use super::server::Server;
use super::tab::Tab;

const STAGES: &str = "
  drawn: { kind: sample, family: small-grid, count: 2, seed: 1 }
  best: { kind: design, method: adjoint, starts: 1, units: 20, seed: 1, area: 0.5, objective: { point: [25 mm, 25 mm], direction: 0 deg } }
";

fn workspace(names: &[&str]) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file().replace("cells: 50", "cells: 20"));
    for name in names {
        // The stages of no two pipelines are equal.
        let stages = STAGES.replace("seed: 1", &format!("seed: {}", name.len()));
        let text = format!("version: 1\nname: {name}\nscene: scene.yaml\nstages:{stages}");
        workspace.write(&format!("{name}.yaml"), &text);
    }
    workspace
}

fn run(workspace: &Workspace, arguments: &[&str]) {
    let ended = workspace.run(arguments);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
}

#[test]
fn cards_and_pipelines_show_the_file_as_it_stands() {
    let workspace = workspace(&["own", "tried"]);
    run(&workspace, &["run", "own.yaml"]);
    run(&workspace, &["run", "own.yaml", "--set", "scene.drive.voltage=4 kV"]);
    run(&workspace, &["run", "tried.yaml", "--set", "scene.drive.voltage=3 kV"]);
    let server = Server::start(&workspace, &["serve", "own.yaml", "tried.yaml"]);
    let runs = server.get("/api/runs").json()["runs"].clone();
    let id = |at: usize| runs[at]["id"].as_str().unwrap().to_owned();
    let summary = |at: usize| server.get(&format!("/api/pipelines/{at}/summary")).json();
    let changed = |run: usize, volts: &str| json!({ "id": id(run), "created": runs[run]["created"], "overrides": { "scene.drive.voltage": volts } });
    let own = summary(0);
    assert_eq!(
        (&own["run"]["id"], &own["changed"]),
        (&json!(id(2)), &changed(1, "4 kV"))
    );
    let tried = summary(1);
    assert_eq!((&tried["run"], &tried["changed"]), (&Value::Null, &changed(0, "3 kV")));
    // The last results are those of the values of the file, too.
    let last = server.get("/api/pipelines/0").json()["last"].clone();
    assert_eq!(last["results"], runs[2]["results"]);
    assert_eq!(server.get("/api/pipelines/1").json()["last"]["results"], Value::Null);

    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    let card = |at: usize| format!("[data-pipeline=\"{at}\"]");
    tab.until(&format!(
        "document.querySelector('{} .headline')?.textContent.endsWith(' at 5.25 kV')",
        card(0)
    ));
    let text = tab.text(&card(0));
    assert!(
        text.contains("up to date") && text.contains(" with scene.drive.voltage=4 kV"),
        "{text}"
    );
    tab.until(&format!(
        "document.querySelector('{} .state').dataset.state === 'stale'",
        card(1)
    ));
    let text = tab.text(&card(1));
    assert!(
        text.contains("no run with the values of the file") && text.contains("with scene.drive.voltage=3 kV"),
        "{text}"
    );
    assert_eq!(
        tab.value(&format!(
            "document.querySelectorAll('{0} .headline, {0} img').length",
            card(1)
        )),
        0
    );
    photographed(&mut tab, "changed-cards");
    tab.click(&format!("{} h2 a", card(0)));
    tab.until("document.querySelector('#last-runs')?.textContent.includes('with scene.drive.voltage=4 kV')");
    tab.until("[...document.querySelectorAll('.dag .last')].some((text) => text.textContent.includes(' mm'))");
    tab.write("[data-path='scene.drive.voltage']", "4 kV");
    tab.until(
        "[...document.querySelectorAll('td')].some((cell) => cell.textContent.startsWith('of the file: predicted '))",
    );
    let drawn = tab.value("[...document.querySelectorAll('.dag .last')].map((text) => text.textContent).join('')");
    assert_eq!(drawn, "");
    tab.go("about:blank");
    tab.go(&format!("http://127.0.0.1:{}/#/runs/{}", server.port, id(1)));
    tab.until("document.querySelector('main')?.textContent.includes(', with scene.drive.voltage=4 kV')");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn runs_without_a_change_stand_at_the_value_of_the_file() {
    let workspace = workspace(&["swept"]);
    run(&workspace, &["run", "swept.yaml"]);
    for set in [
        "scene.drive.voltage=4 kV",
        "stages.drawn.count=5",
        "stages.best.area=30 %",
        "stages.best.area=5 %",
    ] {
        run(&workspace, &["run", "swept.yaml", "--set", set]);
    }
    run(
        &workspace,
        &["sweep", "swept.yaml", "--set", "scene.drive.voltage=3 kV, 3.5 kV"],
    );
    let server = Server::start(&workspace, &["serve", "swept.yaml"]);
    let paths = "scene.drive.voltage,stages.drawn.count,stages.best.area";
    let runs = server.get(&format!("/api/runs?values={paths}")).json()["runs"].clone();
    let values: Vec<&Value> = runs
        .as_array()
        .unwrap()
        .iter()
        .rev()
        .map(|run| &run["values"])
        .collect();
    // Records have the area of a search with one target in their list of targets.
    let (volts, count, area) = ("scene.drive.voltage", "stages.drawn.count", "stages.best.area");
    assert_eq!(values[0], &json!({ volts: "5250 V", count: "2", area: "0.5" }));
    assert_eq!(values[1], &json!({ count: "2", area: "0.5" }));
    assert_eq!(values[2], &json!({ volts: "5250 V", area: "0.5" }));
    assert_eq!(values[3], &json!({ volts: "5250 V", count: "2" }));
    assert!(server.get("/api/runs").json()["runs"][0].get("values").is_none());

    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('#views')");
    tab.go("about:blank");
    tab.go(&format!("http://127.0.0.1:{}/#/runs", server.port));
    tab.until("document.querySelectorAll('#parallel [data-run]').length === 5");
    let texts = tab.value("[...document.querySelectorAll('#parallel svg > text')].map((text) => text.firstChild.data)");
    assert_eq!(
        texts,
        json!([
            "scene.drive.voltage",
            "5250 V",
            "4 kV",
            "stages.best.area",
            "0.5",
            "5 %",
            "stages.drawn.count",
            "5",
            "2",
            "best.predicted",
            texts[10],
            texts[11]
        ])
    );
    // Each line reaches all four axes; the run of the file is at the upper end of the voltage.
    let lines = tab.value("Object.fromEntries([...document.querySelectorAll('#parallel [data-run]')].map((one) => [one.dataset.run, one.querySelector('.run').getAttribute('points').split(' ').map((point) => Number(point.split(',')[1]))]))");
    let lines: BTreeMap<String, Vec<f64>> = serde_json::from_value(lines).unwrap();
    let of = |at: usize| &lines[runs[5 - at]["id"].as_str().unwrap()];
    assert!(lines.values().all(|heights| heights.len() == 4), "{lines:?}");
    assert!(of(0)[0] < of(1)[0] && of(0)[0] == of(2)[0], "{lines:?}");
    assert!(
        of(4)[1] > of(3)[1] && of(3)[1] > of(0)[1] && of(0)[1] == of(1)[1],
        "{lines:?}"
    );
    assert!(of(0)[2] > of(2)[2], "{lines:?}");
    photographed(&mut tab, "parallel-file");
    assert_eq!(tab.complaints, Vec::<String>::new());
}
