//! What a page shows comes out elsewhere: by the command and the stages that it names, on the mesh of an audit, near a
//! wanted value.

use serde_json::{Value, json};

use super::super::common::{Workspace, csv};
use super::server::Server;
use super::{disc, rows, with_scene};

/// Words of a command as a shell reads them: by blanks, but within single quotes.
fn words(command: &str) -> Vec<String> {
    let (mut found, mut word, mut is_quoted) = (Vec::new(), String::new(), false);
    for character in command.chars() {
        match character {
            '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => found.push(std::mem::take(&mut word)),
            _ => word.push(character),
        }
    }
    found.push(word);
    found
}

/// Runs a command that begins with `deaflow`.
fn run(workspace: &Workspace, command: &str, more: &[&str]) -> super::super::common::Ended {
    let words = words(command);
    assert_eq!(words[0], "deaflow", "{command}");
    let words: Vec<&str> = words[1..].iter().map(String::as_str).collect();
    workspace.run(&[&words, more].concat())
}

/// The largest displacement in mm of the first row that a stage has solved.
fn of_stage(server: &Server, digest: &str) -> f64 {
    let found = server.get(&format!("/api/artifacts/{digest}/rows")).json();
    let columns = found["columns"].as_array().unwrap();
    let at = columns
        .iter()
        .position(|column| column["name"] == "max_displacement_mm")
        .unwrap();
    found["rows"][0][at].as_f64().unwrap()
}

/// A device of two groups of electrodes in two states, with the voltage of each as it is written.
const DEVICE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
states:
  push: { voltages: [5.25 kV, 1 kV] }
  pull: { voltages: [0 V, 5 kV] }
properties: { strain_stiffening: { model: gent, jm: 120 } }
";

#[test]
fn what_is_shown_comes_out_of_the_command_and_of_the_stages_that_are_told() {
    let workspace = with_scene();
    workspace.write("device.yaml", DEVICE);
    for (name, scene) in [("plain", "scene.yaml"), ("states", "device.yaml")] {
        let stages = "  small: { kind: sample, family: small-grid, count: 4, seed: 1 }\n";
        workspace.write(
            &format!("{name}.yaml"),
            &format!("version: 1\nname: {name}\nscene: {scene}\nstages:\n{stages}"),
        );
    }
    let server = Server::start(&workspace, &["serve", "plain.yaml", "states.yaml"]);
    let halves: Vec<Vec<u8>> = (0..50)
        .map(|_| {
            (0..50)
                .map(|x| if x < 20 { 1 } else { u8::from(x >= 30) * 2 })
                .collect()
        })
        .collect();
    let text = |rows: &[Vec<u8>]| -> String {
        let line = |row: &Vec<u8>| row.iter().map(u8::to_string).collect::<Vec<_>>().join(",");
        rows.iter().map(|row| line(row) + "\n").collect()
    };
    let cases = [
        (json!({ "scene": "plain", "pattern": rows(disc) }), 0),
        (
            json!({ "scene": "plain", "pattern": rows(disc), "voltage": "4.1 kV", "order": 2 }),
            1,
        ),
        (
            json!({ "scene": "plain", "pattern": rows(disc), "method": "chord:2", "effects": ["wrinkling"] }),
            1,
        ),
        (json!({ "scene": "states", "pattern": halves, "state": "pull" }), 0),
        (
            json!({ "scene": "states", "pattern": halves, "state": "push", "voltage": 5000, "effects": ["strain_stiffening"] }),
            2,
        ),
    ];
    for (at, (mut body, changes)) in cases.into_iter().enumerate() {
        body["elements_per_cell"] = json!(1);
        body["point"] = json!([32.5, 20]);
        body["direction"] = json!(30);
        body["quick"] = json!(true);
        let shown = server.post("/api/sketch", &body);
        assert_eq!(shown.status, 200, "{}", shown.text());
        let shown = shown.json();
        let name = format!("drawn{at}");
        body["name"] = json!(name);
        let told = server.post("/api/sketch/reproduce", &body);
        assert_eq!(told.status, 200, "{}", told.text());
        let told = told.json();
        assert_eq!(told["set"].as_array().unwrap().len(), changes, "{told}");
        let pattern = if body["scene"] == "plain" {
            csv(disc)
        } else {
            text(&halves)
        };
        workspace.write(&format!("{name}.csv"), &pattern);
        // The command prints the numbers of the page.
        let printed = run(&workspace, told["command"].as_str().unwrap(), &[]);
        assert_eq!(printed.code, Some(0), "{told}: {}", printed.stderr);
        let printed = printed.json();
        for (own, key) in [("value", "along_mm"), ("max_displacement", "max_displacement_mm")] {
            let (found, own) = (
                printed["patterns"][0][key].as_f64().unwrap(),
                shown[own].as_f64().unwrap(),
            );
            assert!((found - own).abs() < 1e-6, "{told}: {own} and {found}");
        }
        // So do the stages, in the pipeline that they are put into, and in one of their own.
        let file = format!("{}.yaml", body["scene"].as_str().unwrap());
        let before = std::fs::read_to_string(workspace.path(&file)).unwrap();
        workspace.write(&file, &(before + told["stages"].as_str().unwrap()));
        workspace.write("own.yaml", told["pipeline"].as_str().unwrap());
        for command in [told["run"].as_str().unwrap(), "deaflow run own.yaml"] {
            let ended = run(&workspace, command, &["--json"]);
            assert_eq!(ended.code, Some(0), "{command}: {}", ended.stderr);
            let digest = ended.json()["stages"]
                .as_array()
                .unwrap()
                .iter()
                .find(|stage| stage["name"] == format!("{name}-solved"))
                .unwrap()["digest"]
                .as_str()
                .unwrap()
                .to_owned();
            let (found, own) = (of_stage(&server, &digest), shown["max_displacement"].as_f64().unwrap());
            assert!((found - own).abs() < 1e-6, "{command}: {own} and {found}");
        }
    }
    // A scene of the gallery has no file: it is that of the complete pipeline, which the command names.
    let ring = rows(|x, y| {
        let from = |at: usize| (at as f64 - 24.5).powi(2);
        (100.0..260.0).contains(&(from(x) + from(y)))
    });
    let mut body = json!({ "scene": "lens (example)", "pattern": ring, "voltage": 4000, "elements_per_cell": 1 });
    body["quick"] = json!(true);
    let shown = server.post("/api/sketch", &body).json();
    body["name"] = json!("lens");
    let told = server.post("/api/sketch/reproduce", &body).json();
    assert_eq!(told["saved"], "lens.yaml", "{told}");
    let lines = ring.as_array().unwrap().iter().map(|row| row.to_string());
    let lines: Vec<String> = lines.map(|row| row.trim_matches(['[', ']']).to_owned()).collect();
    workspace.write("lens.csv", &(lines.join("\n") + "\n"));
    workspace.write("lens.yaml", told["pipeline"].as_str().unwrap());
    let printed = run(&workspace, told["command"].as_str().unwrap(), &[]);
    assert_eq!(printed.code, Some(0), "{told}: {}", printed.stderr);
    let (found, own) = (
        printed.json()["patterns"][0]["max_displacement_mm"].as_f64().unwrap(),
        shown["max_displacement"].as_f64().unwrap(),
    );
    assert!((found - own).abs() < 1e-6, "{told}: {own} and {found}");
    let wrong = json!({ "scene": "plain", "pattern": rows(disc), "name": "../mine" });
    assert_eq!(server.post("/api/sketch/reproduce", &wrong).status, 400);
    // Of each state the voltage of each group.
    let scenes = server.get("/api/scenes").json();
    assert_eq!(scenes["scenes"][1]["states"], json!(["pull", "push"]));
    assert_eq!(
        scenes["scenes"][1]["voltages"],
        json!([[0.0, 5000.0], [5250.0, 1000.0]])
    );
}

#[test]
fn a_search_stops_at_what_is_wanted_above_and_below() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let body = |more: Value| {
        let mut body = json!({ "pattern": rows(|x, y| x < 25 && y < 20), "point": [25, 25], "direction": 0 });
        for (key, value) in more.as_object().unwrap() {
            body[key] = value.clone();
        }
        body
    };
    let mut once = body(json!({ "quick": true, "elements_per_cell": 1, "order": 2 }));
    let start = server.post("/api/sketch", &once).json()["value"].as_f64().unwrap();
    for (wanted, more) in [
        (start + 0.3, json!({})),
        (start + 0.1, json!({ "area": 0.2 })),
        (start - 0.5, json!({})),
        (-0.25, json!({})),
    ] {
        let mut asked = body(more.clone());
        asked["wanted"] = json!(format!("{wanted} mm"));
        let reply = server.post("/api/sketch/improve", &asked);
        assert_eq!(reply.status, 200, "{}", reply.text());
        let lines: Vec<Value> = reply
            .text()
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        let last = lines.last().unwrap();
        let value = last["value"].as_f64().unwrap();
        assert_eq!(
            (&last["done"], &last["reached"]),
            (&json!(true), &json!(true)),
            "{value} for {wanted}"
        );
        let near = (0.005 * wanted.abs()).max(0.001);
        assert!((value - wanted).abs() <= near, "{value} for {wanted}");
        // Each pattern that is told is nearer than the one before.
        let off: Vec<f64> = lines
            .iter()
            .map(|line| (line["value"].as_f64().unwrap() - wanted).abs())
            .collect();
        assert!(off.windows(2).all(|two| two[1] <= two[0]), "{off:?}");
        if let Some(area) = more["area"].as_f64() {
            assert!((last["area"].as_f64().unwrap() - area).abs() <= 0.0051, "{last}");
        }
        once["pattern"] = last["pattern"].clone();
        let found = server.post("/api/sketch", &once).json()["value"].as_f64().unwrap();
        assert!((found - value).abs() < 1e-6, "{found} and {value}");
    }
    // What is out of reach is not called reached.
    let far = server.post("/api/sketch/improve", &body(json!({ "wanted": 30 })));
    let last: Value = serde_json::from_str(far.text().lines().last().unwrap()).unwrap();
    assert_eq!(last["reached"], json!(false), "{last}");
    assert!(last["value"].as_f64().unwrap() > start + 0.3, "{last}");
}

#[test]
fn a_row_of_an_audit_is_simulated_as_its_finding_says() {
    let workspace = with_scene();
    let stages = "  small:    { kind: sample, family: small-grid, count: 12, seed: 1 }
  solved:   { kind: solve, needs: [small], elements_per_cell: 1 }
  balanced: { kind: balance, needs: [solved], bins: 5, range: [0 mm, 2.5 mm], target: 12, symmetry: d4, seed: 4 }
  audited:  { kind: audit, needs: [balanced], samples: 4, accuracy: 1e-4 mm, seed: 7, fail_on: never }
";
    workspace.write(
        "audited.yaml",
        &format!("version: 1\nname: audited\nscene: scene.yaml\nstages:\n{stages}"),
    );
    let digests = workspace.stages(&["run", "audited.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "audited.yaml"]);
    let (set, audit) = (&digests["balanced"], &digests["audited"]);
    let artifact = server.get(&format!("/api/artifacts/{audit}")).json();
    let findings: Value = serde_json::from_str(artifact["attributes"]["findings"].as_str().unwrap()).unwrap();
    let finding = findings
        .as_array()
        .unwrap()
        .iter()
        .find(|finding| finding["check"] == "accuracy")
        .unwrap_or_else(|| panic!("{findings}"));
    // The errors that the audit has found of its rows.
    let known = server
        .get(&format!("/api/artifacts/{audit}/rows?along=finer_row&limit=100"))
        .json();
    let place = |name: &str| {
        let columns = known["columns"].as_array().unwrap();
        columns
            .iter()
            .position(|column| column["name"] == name)
            .unwrap_or_else(|| panic!("{columns:?}"))
    };
    let (row_at, error_at) = (place("resimulated/row"), place("resimulated/error_mm"));
    let examples = finding["examples"].as_array().unwrap();
    assert!(!examples.is_empty(), "{finding}");
    for row in examples {
        let rows = known["rows"].as_array().unwrap().iter();
        let expected = rows.clone().find(|one| one[row_at] == *row).unwrap()[error_at]
            .as_f64()
            .unwrap();
        let reply = server.get(&format!("/api/artifacts/{set}/again?row={row}&audit={audit}"));
        assert_eq!(reply.status, 200, "{}", reply.text());
        let (document, _) = reply.frame();
        assert_eq!(
            document["again"]["mesh"], "elements_per_cell: 1, order: 1",
            "{document}"
        );
        assert_eq!(
            document["finer"]["mesh"], "elements_per_cell: 1, order: 2",
            "{document}"
        );
        let told = |of: &str| document[of]["max_error_mm"].as_f64().unwrap();
        assert!((told("finer") - expected).abs() < 1e-9, "{document}: {expected}");
        // On their own mesh labels are right, but for their rounding.
        assert!(told("again") < 1e-5 && told("finer") > 1e-4, "{document}");
        // The fields are those of which this is told.
        let (label, finer) = (reply.numbers("label"), reply.numbers("finer"));
        let off = label
            .chunks(2)
            .zip(finer.chunks(2))
            .map(|(a, b)| f64::from(a[0] - b[0]).hypot(f64::from(a[1] - b[1])));
        assert!((off.fold(0.0, f64::max) - expected).abs() < 1e-6);
    }
    for (query, status) in [
        ("row=0", 200),
        ("row=99999", 404),
        ("row=x", 404),
        ("row=0&audit=zz", 404),
        ("rows=1", 400),
    ] {
        assert_eq!(
            server.get(&format!("/api/artifacts/{set}/again?{query}")).status,
            status,
            "{query}"
        );
    }
    assert_eq!(server.get(&format!("/api/artifacts/{audit}/again?row=0")).status, 404);
}

#[test]
fn a_run_from_the_page_tells_its_values_its_end_and_what_it_has_printed() {
    let workspace = Workspace::small();
    let server = Server::start(&workspace, &["serve", "small.yaml", "--allow-run"]);
    let set = json!({ "scene.drive.voltage": "9 kV", "stages.balanced.target": 3 });
    // What is foreseen stands with the plan.
    let plan = server.post("/api/plan", &json!({ "set": set })).json();
    let foreseen: Vec<&str> = plan["warnings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|text| text.as_str().unwrap())
        .collect();
    assert!(foreseen.iter().any(|text| text.contains("stab")), "{plan}");
    assert_eq!(server.post("/api/run", &json!({ "set": set })).status, 200);
    let told = (0..600).find_map(|_| {
        std::thread::sleep(std::time::Duration::from_millis(100));
        let told = server.get("/api/run").json();
        (told["running"] == false && told["printed"] != "").then_some(told)
    });
    let told = told.unwrap();
    assert_eq!(told["set"]["scene.drive.voltage"], "9 kV", "{told}");
    assert_eq!(told["stopped"], false, "{told}");
    assert!(
        told["seconds"].as_f64().unwrap() > 0.0 && told["pid"].as_u64().unwrap() > 1,
        "{told}"
    );
    let run = server.get("/api/runs?limit=1").json()["runs"][0].clone();
    let log = run["log"].as_str().unwrap_or_default();
    assert!(log.ends_with(&format!("-{}.log", told["pid"])), "{run}");
    // The run itself has them, too.
    let one = server.get(&format!("/api/runs/{}", run["id"].as_str().unwrap())).json();
    let warnings = one["warnings"].as_array().unwrap();
    assert!(
        foreseen.iter().all(|text| warnings.contains(&json!(text))),
        "{warnings:?} and {foreseen:?}"
    );
    assert!(one["headlines"].is_array(), "{one}");
}
