//! Fronts and yields on the page: what a run begins with, and the figures and tables of its stages.

use serde_json::json;

use super::super::common::{Workspace, scene_file};
use super::server::Server;
use super::tab::Tab;

const FRONT: &str = "version: 1
name: front
scene: scene.yaml
stages:
  front:
    kind: design
    objectives: [{ point: [20 mm, 25 mm], direction: 0 deg }, { point: [35 mm, 25 mm], displacement: [0 mm, 0 mm] }, { area: least }]
    pareto: { points: 3, method: nsga2 }
    population: 20
    generations: 2
    seed: 1
";

const YIELD: &str = "version: 1
name: made
scene: scene.yaml
stages:
  best: { kind: design, method: adjoint, starts: 1, units: 20, seed: 1, area: 0.5, objective: { point: [25 mm, 25 mm], direction: 0 deg } }
  made: { kind: yield, needs: [best], samples: 20, wanted: 2 mm, seed: 1 }
";

#[test]
fn a_front_is_shown_as_a_front() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file().replace("cells: 50", "cells: 20"));
    workspace.write("front.yaml", FRONT);
    let ended = workspace.run(&["run", "front.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let points = ended.json()["fronts"][0]["points"].as_array().unwrap().clone();
    let number = |at: usize, name: &str| points[at][name].as_f64().unwrap();
    let last = points.len() - 1;
    assert!(last > 0, "{points:?}");

    let server = Server::start(&workspace, &["serve", "front.yaml"]);
    let run = server.get("/api/runs").json()["runs"][0]["id"]
        .as_str()
        .unwrap()
        .to_owned();
    let opening = server.get(&format!("/api/runs/{run}/opening")).json();
    let sentence = opening["sentence"].as_str().unwrap();
    let begins = format!("front of {} points at 5.25 kV, predicted: ", points.len());
    let ends = format!("at area {:.1} %", 100.0 * number(last, "area"));
    assert!(sentence.starts_with(&begins) && sentence.ends_with(&ends), "{sentence}");
    let facts = opening["facts"].as_array().unwrap();
    assert_eq!(
        facts[0],
        "objectives: displacement of (20, 25) mm at 0°; displacement of (35, 25) mm by (0, 0) mm; area"
    );
    let picture = opening["picture"].as_str().unwrap();
    assert_eq!(
        picture.matches("Electrode pattern of front-").count() % 2,
        0,
        "{picture}"
    );
    assert!(picture.contains(&format!("front-{}", last + 1)), "{picture}");

    // The report begins with the same, and its table and cards have all objectives.
    let report = workspace.run(&["report", "front.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html"))
        .unwrap()
        .replace('\u{a0}', " ");
    assert!(page.contains(sentence), "{sentence}");
    let second = "second objective: displacement of (35, 25) mm by (0, 0) mm";
    assert!(
        page.matches(second).count() > points.len() && !page.contains("against {"),
        "{page}"
    );
    assert_eq!(page.matches("<dt>second objective</dt>").count(), points.len());
    let table = std::fs::read_to_string(workspace.path("report/data/designs.csv")).unwrap();
    let mut table = csv::Reader::from_reader(table.as_bytes());
    let header = table.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|one| one == name).unwrap();
    for (row, point) in table.records().map(Result::unwrap).zip(&points) {
        let second: f64 = row[at("second_predicted_mm")].parse().unwrap();
        assert!((second - point["values"][1].as_f64().unwrap()).abs() < 1e-6);
        assert_eq!(&row[at("third_objective")], "{ area: least }");
    }
    let about = std::fs::read_to_string(workspace.path("report/data/csv-metadata.json")).unwrap();
    let about: serde_json::Value = serde_json::from_str(&about).unwrap();
    let columns = about["tables"][0]["tableSchema"]["columns"].as_array().unwrap();
    let column = columns
        .iter()
        .find(|column| column["titles"] == "second_predicted_mm")
        .unwrap();
    assert_eq!(column["schema:unitText"], "mm");
    // A sheet is that of one point; the error names all.
    let sheet = workspace.run(&["report", "front.yaml", "--sheet", "sheet.html"]);
    assert_eq!(sheet.code, Some(2));
    assert!(
        (1..=points.len()).all(|at| sheet.stderr.contains(&format!("front-{at}"))),
        "{}",
        sheet.stderr
    );
    let sheet = workspace.run(&["report", "front.yaml", "--sheet", "sheet.html", "--design", "front-1"]);
    assert_eq!(sheet.code, Some(0), "{}", sheet.stderr);

    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('[data-pipeline=\"0\"] img')?.naturalWidth > 100");
    assert_eq!(tab.text("[data-pipeline=\"0\"] .headline"), sentence);
    super::photographed(&mut tab, "front-card");
    let digest = server.get("/api/runs").json()["runs"][0]["stages"][0]["digest"].clone();
    tab.go("about:blank");
    tab.go(&format!(
        "http://127.0.0.1:{}/#/artifacts/{}",
        server.port,
        digest.as_str().unwrap()
    ));
    tab.until(&format!(
        "[...document.querySelectorAll('.card')].filter((card) => card.textContent.includes('second objective')).length === {}",
        points.len()
    ));
    assert!(!tab.text("#panel").contains("third objective"));
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn a_yield_has_the_table_and_the_figure_of_the_report() {
    let workspace = Workspace::new();
    let tolerances = "\ntolerances: { voltage: 1 %, thickness: 3 % }\n";
    workspace.write(
        "scene.yaml",
        &(scene_file().replace("cells: 50", "cells: 20") + tolerances),
    );
    workspace.write("made.yaml", YIELD);
    let digests = workspace.stages(&["run", "made.yaml"]).digests();
    let report = workspace.run(&["report", "made.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let report = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    let server = Server::start(&workspace, &["serve", "made.yaml"]);
    let page = server.get(&format!("/api/artifacts/{}/page", digests["made"])).text();
    let table = |page: &str| {
        let (_, rest) = page.split_once("Devices as they are made</h2>").unwrap();
        let (_, rest) = rest.split_once("<table").unwrap();
        rest.split_once("</table>").unwrap().0.to_owned()
    };
    assert_eq!(table(&page), table(&report));
    assert!(table(&page).contains("reach it"), "{page}");
    assert!(
        page.contains("Devices that reach a displacement") && page.contains("<svg"),
        "{page}"
    );

    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.click("a[href='#/pipelines/0']");
    // The main result of the stage is the yield.
    let result =
        "[...document.querySelectorAll('td[data-title], td')].some((cell) => cell.textContent.startsWith('yield '))";
    tab.until(result);
    let run = server.get("/api/runs").json()["runs"][0]["id"]
        .as_str()
        .unwrap()
        .to_owned();
    tab.go("about:blank");
    tab.go(&format!("http://127.0.0.1:{}/#/runs/{run}", server.port));
    tab.click("[data-stage=made] summary");
    tab.until("document.querySelector('[data-stage=made] iframe')?.contentDocument?.querySelector('table') && document.querySelector('[data-stage=made] iframe').contentDocument.querySelector('svg')");
    assert!(
        tab.text("[data-stage=made] summary").contains("yield 0."),
        "{}",
        tab.text("[data-stage=made] summary")
    );
    assert_eq!(tab.complaints, Vec::<String>::new());
    assert_eq!(json!(tab.overflow()), json!(0.0));
}
