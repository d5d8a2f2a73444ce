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
    // Designs are listed with pictures, and their figures draw them.
    tab.go(&format!("{}#/designs", server.url));
    tab.until("[...document.querySelectorAll('.design img')].filter((one) => one.naturalWidth > 100).length === 2");
    let card = tab.text(".design");
    let area = facts
        .as_array()
        .unwrap()
        .iter()
        .find(|fact| fact.as_str().unwrap().starts_with("electrode on"));
    for told in [
        "checked",
        sentence,
        area.unwrap().as_str().unwrap(),
        "displacements drawn ",
        "verify of done",
    ] {
        assert!(card.contains(told), "{told} in {card}");
    }
    photographed(&mut tab, "designs");
    let checked = server.get(&format!("/api/runs/{run}")).json()["stages"][3]["digest"].clone();
    // Long texts do not make rows high.
    tab.go(&format!(
        "{}#/artifacts/{}?tab=rows",
        server.url,
        checked.as_str().unwrap()
    ));
    tab.until("document.querySelector('[aria-label=Rows] .clipped')");
    let highest = tab.value(
        "Math.max(...[...document.querySelectorAll('[aria-label=Rows] tbody tr')].map((row) => row.clientHeight))",
    );
    assert!(highest.as_f64().unwrap() < 60.0, "{highest}");
    let page = server.get(&format!("/api/artifacts/{}/page", checked.as_str().unwrap()));
    assert!(
        page.text().contains("<svg") && page.text().contains("verification of verify"),
        "{}",
        page.text()
    );
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn after_a_failed_run_the_results_that_hold_are_shown_and_removed_artifacts_are_marked() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    let pipeline = |range: &str| {
        let stages = STAGES.split("  best:").next().unwrap();
        format!(
            "version: 1\nname: again\nscene: scene.yaml\nstages:{stages}  some: {{ kind: balance, needs: [solved], bins: 5, \
             range: {range}, target: 4, seed: 4 }}\n"
        )
    };
    workspace.write("again.yaml", &pipeline("[0 mm, 2.5 mm]"));
    let first = workspace.stages(&["run", "again.yaml"]).digests();
    workspace.write("again.yaml", &pipeline("[60 mm, 70 mm]"));
    assert_eq!(workspace.run(&["run", "again.yaml"]).code, Some(1));
    workspace.write("again.yaml", &pipeline("[0 mm, 2.5 mm]"));
    let server = Server::start(&workspace, &["serve", "again.yaml"]);
    let runs = server.get("/api/runs").json();
    let summary = server.get("/api/pipelines/0/summary").json();
    assert_eq!(
        (&summary["stale"], &summary["run"]["failed"], &summary["shown"]),
        (&json!([]), &json!(["some"]), &runs["runs"][1]["id"])
    );
    assert_eq!(runs["units"]["solved.max_displacement"], "mm", "{runs}");
    let results = &server.get("/api/pipelines/0").json()["last"]["results"];
    assert_eq!(results, &runs["runs"][1]["results"]);
    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('.state').dataset.state === 'failed'");
    assert_eq!(tab.text(".state"), "last run failed: some; results are up to date");
    tab.go(&format!("{}#/runs", server.url));
    tab.until("document.querySelector('[aria-label=Runs]')?.textContent.includes('solved.max_displacement')");
    let listed = tab.text("[aria-label=Runs]");
    assert!(
        listed.split("solved.max_displacement ").nth(1).unwrap()[..12].contains(" mm"),
        "{listed}"
    );
    // What `gc` removed is not a link, and its page says when it was removed.
    assert_eq!(workspace.run(&["gc", "--keep-runs", "0", "--grace", "0"]).code, Some(0));
    let digest = &first["solved"];
    let listed = server.get("/api/artifacts").json();
    let one = listed["artifacts"]
        .as_array()
        .unwrap()
        .iter()
        .find(|one| one["digest"] == digest.as_str());
    assert!(one.unwrap()["removed"].is_string(), "{listed}");
    let gone = server.get(&format!("/api/artifacts/{digest}"));
    let told = gone.json()["error"]["message"].as_str().unwrap().to_owned();
    let begins = format!("artifact {} (solve) was removed by gc at 20", &digest[..12]);
    assert!(gone.status == 404 && told.starts_with(&begins), "{told}");
    tab.go(&format!("{}#/artifacts", server.url));
    tab.until("document.querySelector('[aria-label=Artifacts]')?.textContent.includes('removed by gc at 20')");
    assert_eq!(
        tab.value("document.querySelectorAll('[aria-label=Artifacts] a[href*=artifacts]').length"),
        0
    );
    tab.go(&format!("{}#/artifacts/{digest}", server.url));
    tab.until("document.querySelector('[role=alert]')?.textContent.includes('was removed by gc at 20')");
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
