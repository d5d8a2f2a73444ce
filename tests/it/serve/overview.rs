//! The first view: a card for each pipeline, and the page of a run.

use serde_json::json;

use super::super::common::{Workspace, scene_file};
use super::photographed;
use super::server::Server;
use super::tab::Tab;

const STAGES: &str = "
  drawn: { kind: sample, family: small-grid, count: 2, seed: 1 }
  solved: { kind: solve, needs: [drawn], elements_per_cell: 1 }
  best: { kind: design, method: adjoint, starts: 1, units: 20, seed: 1, area: 0.5, objective: { point: [25 mm, 25 mm], direction: 0 deg } }
  checked: { kind: verify, needs: [best], elements_per_cell: 1, order: 1 }
";

#[test]
fn cards_state_each_pipeline_and_a_run_begins_with_its_best_design() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    let pipeline = |name: &str| format!("version: 1\nname: {name}\nscene: scene.yaml\nstages:{STAGES}");
    workspace.write("done.yaml", &pipeline("done"));
    workspace.write("new.yaml", &pipeline("new").replace("seed: 1", "seed: 2"));
    workspace.write("broken.yaml", &pipeline("broken"));
    let ended = workspace.run(&["run", "done.yaml"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let server = Server::start(&workspace, &["serve", "done.yaml", "new.yaml", "broken.yaml"]);
    workspace.write(
        "broken.yaml",
        &pipeline("broken").replace("kind: verify", "kind: verifies"),
    );
    // What the report of the run begins with.
    let report = workspace.run(&["report", "done.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let report = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    let run = server.get("/api/runs").json()["runs"][0]["id"]
        .as_str()
        .unwrap()
        .to_owned();
    let opening = server.get(&format!("/api/runs/{run}/opening")).json();
    let sentence = opening["sentence"].as_str().unwrap();
    assert!(sentence.ends_with(" mm at 5.25 kV"), "{opening}");
    // There numbers stay with their units.
    assert!(report.replace('\u{a0}', " ").contains(sentence), "{sentence}");
    let picture = opening["picture"].as_str().unwrap();
    assert!(picture.starts_with("<svg") && !picture.contains("<script"), "{picture}");

    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('[data-pipeline=\"0\"] img')?.naturalWidth > 100");
    for (at, state, words) in [
        (0, "fresh", "up to date"),
        (1, "stale", "has to run: "),
        (2, "failed", "invalid file"),
    ] {
        tab.until(&format!(
            "document.querySelector('[data-pipeline=\"{at}\"] .state').dataset.state === '{state}'"
        ));
        let told = tab.text(&format!("[data-pipeline=\"{at}\"] .state"));
        assert!(told.starts_with(words), "{told}");
    }
    assert_eq!(tab.text("[data-pipeline=\"0\"] .headline"), sentence);
    assert!(tab.text("[data-pipeline=\"0\"]").contains("took "));
    assert!(tab.text("[data-pipeline=\"1\"]").contains("never run"));
    photographed(&mut tab, "overview");

    tab.click(&format!("[data-pipeline=\"0\"] a[href='#/runs/{run}']"));
    tab.until("document.querySelector('#opening img')?.naturalWidth > 100");
    assert_eq!(tab.text("#opening .headline"), sentence);
    let facts = tab.value("[...document.querySelectorAll('#headlines li')].map((line) => line.textContent)");
    assert_eq!(facts, opening["facts"]);
    // The rest is folded by stage, with its own results and figures.
    let folded = tab
        .value("[...document.querySelectorAll('#run-stages > details')].map((one) => [one.dataset.stage, one.open])");
    assert_eq!(
        folded,
        json!([["drawn", false], ["solved", false], ["best", false], ["checked", false]])
    );
    tab.click("[data-stage=checked] summary");
    tab.until(
        "document.querySelector('[data-stage=checked] iframe')?.contentDocument?.querySelector('svg, table, pre')",
    );
    let results = tab.text("[aria-label='Results of checked']");
    assert!(results.contains("displacement") && results.contains("mm"), "{results}");
    photographed(&mut tab, "run");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn a_card_says_which_stage_failed() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    let stages = STAGES.split("  best:").next().unwrap();
    let none = "  none: { kind: balance, needs: [solved], bins: 5, range: [60 mm, 70 mm], target: 4, seed: 4 }\n";
    workspace.write(
        "failing.yaml",
        &format!("version: 1\nname: failing\nscene: scene.yaml\nstages:{stages}{none}"),
    );
    assert_eq!(workspace.run(&["run", "failing.yaml"]).code, Some(1));
    let server = Server::start(&workspace, &["serve", "failing.yaml"]);
    let summary = server.get("/api/pipelines/0/summary").json();
    assert_eq!(
        (&summary["run"]["failed"], &summary["stale"]),
        (&json!(["none"]), &json!(["none"]))
    );
    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('[data-pipeline=\"0\"] .state').dataset.state === 'failed'");
    let state = tab.text("[data-pipeline=\"0\"] .state");
    assert!(state.starts_with("failed: none; 1 of 3 stages"), "{state}");
    // Once the stage can be built, nothing has failed any more.
    let mended = std::fs::read_to_string(workspace.path("failing.yaml")).unwrap();
    workspace.write("failing.yaml", &mended.replace(none, ""));
    tab.reload();
    tab.until("document.querySelector('[data-pipeline=\"0\"] .state').dataset.state === 'fresh'");
    assert_eq!(tab.complaints, Vec::<String>::new());
}
