//! Answers of routes beyond those of commands: what is refused at start, limits, changed values, neighbours, and news.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};

use super::super::common::{SHORT, SMALL, Workspace, scene_file, scene_of_20_cells, with_scene_in_a_file};
use super::server::{Reply, Server};
use super::tab::Tab;
use super::{disc, rows, rows_of, with_scene};

#[test]
fn what_is_named_must_be_there_and_be_read() {
    let workspace = with_scene();
    workspace.write("bad.yaml", "version: 1\nname: [\n");
    workspace.write("wrong.yaml", &SHORT.replace("count: 60", "cuont: 60"));
    for (arguments, told) in [
        (&["serve", "nope.yaml"][..], "nope.yaml"),
        (&["serve", "bad.yaml"], "bad.yaml:"),
        (&["serve", "wrong.yaml"], "did you mean `count`"),
        (&["serve", "scene.yaml"], "scene.yaml:"),
        (&["sketch", "nope.yaml"], "nope.yaml"),
        (&["sketch", "bad.yaml"], "bad.yaml:"),
    ] {
        let ended = workspace.run(arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(told), "{arguments:?}: {}", ended.stderr);
        assert_eq!(ended.stdout, "", "{arguments:?}");
    }
}

#[test]
fn the_critical_voltage_is_that_of_the_pattern_whatever_voltage_is_asked_for() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_of_20_cells());
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let pattern = rows_of(20, |x, y| disc(5 * x / 2 + 1, 5 * y / 2 + 1));
    let at = |voltage: &str| {
        let body = json!({ "pattern": pattern, "voltage": voltage, "elements_per_cell": 1 });
        let found = server.post("/api/sketch", &body).json();
        let number = |key: &str| found[key].as_f64().unwrap_or_else(|| panic!("{voltage}: {found}"));
        let ends = [0, 1].map(|end| found["critical_bracket"][end].as_f64().unwrap());
        let (middle, half) = (0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]));
        (
            [number("critical_voltage"), number("critical_voltage_error"), middle],
            half,
            found,
        )
    };
    // On the mesh itself.
    let ([critical, error_of_meshes, limit], error, _) = at("5 kV");
    assert!(error > 0.0 && error < 1e-3 * limit, "{error} of {limit}");
    for voltage in ["0 V", "1 kV", "5.9 kV"] {
        assert_eq!(at(voltage).0, [critical, error_of_meshes, limit], "{voltage}");
    }
    // Whatever the mesh: meshes make a membrane too stiff, so that it is lost below, and a finer one finds it within
    // the error.
    assert!(critical < limit, "{critical} and {limit}");
    assert!(
        error_of_meshes > 0.0 && error_of_meshes < 0.05 * critical,
        "{error_of_meshes}"
    );
    let fine = json!({ "pattern": pattern, "elements_per_cell": 2, "order": 2 });
    let fine = server.post("/api/sketch", &fine).json();
    let fine = 0.5 * (fine["critical_bracket"][0].as_f64().unwrap() + fine["critical_bracket"][1].as_f64().unwrap());
    assert!(
        (fine - critical).abs() < error_of_meshes,
        "{fine} is not within {critical} ± {error_of_meshes}"
    );
    // It is where a solution is lost, to what either is known.
    let ([_, _, same], _, lost) = at("9 kV");
    assert_eq!(same, limit);
    let bracket = [0, 1].map(|end| lost["bracket"][end].as_f64().unwrap());
    assert!(
        bracket[0] < limit + 2.0 * error && bracket[1] > limit - 2.0 * error,
        "{bracket:?} and {limit}"
    );
}

#[test]
fn every_value_that_is_listed_can_be_set_as_it_is_written() {
    let workspace = Workspace::small();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let [quickstart, cases] = ["quickstart.yaml", "cases.yaml"].map(|name| folder.join(name).display().to_string());
    let server = Server::start(&workspace, &["serve", "small.yaml", &quickstart, &cases]);
    let fresh = |found: &Value| {
        found["stages"]
            .as_array()
            .unwrap()
            .iter()
            .map(|stage| stage["digest"].clone())
            .collect::<Vec<_>>()
    };
    for id in 0..3 {
        let found = server.get(&format!("/api/pipelines/{id}")).json();
        let values = found["values"].as_array().unwrap();
        assert!(values.len() > 10, "{values:?}");
        let layout = &found["layout"];
        let needs: usize = found["needs"]
            .as_object()
            .unwrap()
            .values()
            .map(|of| of["needs"].as_array().unwrap().len())
            .sum();
        assert_eq!(layout["lines"].as_array().unwrap().len(), needs, "{layout}");
        // Of the long one the first and last, which stand for the others.
        let step = values.len() / 40 + 1;
        for one in values.iter().step_by(step).chain(
            values
                .iter()
                .filter(|one| one["value"].as_str().unwrap().contains("${")),
        ) {
            let set = json!({ one["path"].as_str().unwrap(): one["value"] });
            let reply = server.post("/api/plan", &json!({ "pipeline": id, "set": set }));
            assert_eq!(reply.status, 200, "{set}: {}", reply.text());
            assert_eq!(fresh(&reply.json()), fresh(&found), "{set}");
        }
    }
}

#[test]
fn a_value_that_is_refused_is_named_and_has_no_place_in_a_file() {
    let workspace = Workspace::small();
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    for (set, refused) in [
        (json!({ "stages.small.cuont": 3 }), json!("stages.small.cuont")),
        (
            json!({ "scene.drive.voltage": "many", "stages.small.count": 5 }),
            json!("scene.drive.voltage"),
        ),
        (json!({ "stages.small.count": "[" }), json!("stages.small.count")),
        (json!({ "stages.small.files": ["x"] }), json!("stages.small.files")),
        // Of two that are wrong neither is the one.
        (
            json!({ "stages.small.cuont": 3, "scene.drive.voltage": "many" }),
            Value::Null,
        ),
    ] {
        let reply = server.post("/api/plan", &json!({ "set": set }));
        let error = &reply.json()["error"];
        assert_eq!(reply.status, 400, "{}", reply.text());
        assert_eq!(
            (&error["line"], &error["column"], &error["value"]),
            (&Value::Null, &Value::Null, &refused),
            "{set}: {error}"
        );
    }
    // A pipeline that breaks later has its problem, with its place.
    let text = std::fs::read_to_string(workspace.path("small.yaml")).unwrap();
    workspace.write("small.yaml", &text.replace("count: 4", "cuont: 4"));
    let found = server.get("/api/pipelines/0").json();
    let line = 1 + text.lines().position(|line| line.contains("count: 4")).unwrap();
    assert_eq!(found["problem"]["line"], line, "{found}");
    let error = server
        .post("/api/plan", &json!({ "set": { "stages.large.seed": 3 } }))
        .json()["error"]
        .clone();
    assert_eq!(
        (&error["line"], &error["value"]),
        (&json!(line), &Value::Null),
        "{error}"
    );
}

/// Cells of all patterns of an artifact.
fn patterns(server: &Server, digest: &str, count: usize) -> Vec<Vec<u8>> {
    let rows: Vec<String> = (0..count).map(|row| row.to_string()).collect();
    let reply = server.get(&format!(
        "/api/artifacts/{digest}/arrays?paths=patterns&rows={}",
        rows.join(",")
    ));
    reply.frame().1[..2500 * count]
        .chunks_exact(2500)
        .map(<[u8]>::to_vec)
        .collect()
}

/// In how many cells the nearest of the eight images differs.
fn apart(one: &[u8], other: &[u8]) -> usize {
    let image = |turns: usize, mirrored: bool| {
        let count = (0..2500).filter(|&at| {
            let (mut x, mut y) = (at % 50, at / 50);
            if mirrored {
                x = 49 - x;
            }
            (0..turns).for_each(|_| (x, y) = (49 - y, x));
            one[at] != other[50 * y + x]
        });
        count.count()
    };
    let all = (0..4).flat_map(|turns| [image(turns, false), image(turns, true)]);
    all.min().unwrap()
}

#[test]
fn neighbours_are_those_that_differ_in_the_fewest_cells_however_they_are_turned() {
    let workspace = Workspace::new();
    workspace.write("small.yaml", &SMALL.replace("cells: 20", "cells: 50"));
    let digests = workspace.stages(&["run", "small.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    let (solved, balanced) = (&digests["solved"], &digests["balanced"]);
    let ask = |query: &str| server.get(&format!("/api/artifacts/{solved}/neighbours?{query}"));
    let total = ask("row=0&limit=0").json()["total"].as_u64().unwrap() as usize;
    let all = patterns(&server, solved, total);
    for row in 0..total {
        let found = ask(&format!("row={row}&limit=100")).json();
        let near = found["neighbours"].as_array().unwrap();
        assert_eq!((near.len(), &found["cells"]), (total - 1, &json!(2500)));
        let told: Vec<(usize, usize)> = near
            .iter()
            .map(|one| {
                (
                    one["distance"].as_u64().unwrap() as usize,
                    one["row"].as_u64().unwrap() as usize,
                )
            })
            .collect();
        let mut expected: Vec<(usize, usize)> = (0..total)
            .filter(|other| *other != row)
            .map(|other| (apart(&all[row], &all[other]), other))
            .collect();
        expected.sort_unstable();
        assert_eq!(told, expected, "row {row}");
    }
    // Every row of a balanced set is an image of one that was solved.
    let of = server
        .get(&format!(
            "/api/artifacts/{solved}/neighbours?row=0&of={balanced}&limit=1"
        ))
        .json();
    // Of the set itself, those of one part alone; what is not divided has no parts.
    let parts = columns(&server, balanced, &["split"]);
    let in_part = server
        .get(&format!(
            "/api/artifacts/{balanced}/neighbours?row=0&limit=100&split=train"
        ))
        .json();
    let found: Vec<usize> = in_part["neighbours"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["row"].as_u64().unwrap() as usize)
        .collect();
    let trained = (1..parts.len()).filter(|row| parts[*row][0] == "train").count();
    assert!(
        found.len() == trained && trained < parts.len() - 1,
        "{found:?} {parts:?}"
    );
    assert!(found.iter().all(|row| *row != 0 && parts[*row][0] == "train"));
    assert_eq!(ask("row=0&split=train").status, 400);
    assert_eq!(of["neighbours"][0]["distance"], 0, "{of}");
    let small = &digests["small"];
    for (query, status) in [
        ("", 400),
        ("row=x", 404),
        (&format!("row={total}"), 404),
        ("row=0&limit=101", 400),
        ("row=0&of=zz", 404),
    ] {
        assert_eq!(ask(query).status, status, "{query}");
    }
    assert_eq!(
        server.get(&format!("/api/artifacts/{small}/neighbours?row=0")).status,
        200
    );
}

#[test]
fn an_evaluation_says_of_each_pattern_how_it_errs_and_where_it_stands() {
    let workspace = Workspace::small();
    let stages = "  fresh: { kind: sample, family: small-grid, count: 5, seed: 9 }\n  truth: { kind: solve, needs: [fresh], elements_per_cell: 2 }\n  judged: { kind: evaluate, needs: [truth, solved], estimates: [linear, \"chord:1\"] }\n";
    let text = std::fs::read_to_string(workspace.path("small.yaml")).unwrap();
    workspace.write("small.yaml", &(text + stages));
    let digests = workspace.stages(&["run", "small.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    let found = server
        .get(&format!(
            "/api/artifacts/{}/rows?sort=-pattern/max_error.0_mm",
            digests["judged"]
        ))
        .json();
    let at = |name: &str| {
        found["columns"]
            .as_array()
            .unwrap()
            .iter()
            .position(|column| column["name"] == name)
            .unwrap_or_else(|| panic!("{name}: {}", found["columns"]))
    };
    let rows = found["rows"].as_array().unwrap();
    let errors: Vec<f64> = rows
        .iter()
        .map(|row| row[at("pattern/max_error.0_mm")].as_f64().unwrap())
        .collect();
    assert!(
        errors.len() == 11 && errors[0] > 0.0 && errors.windows(2).all(|two| two[0] >= two[1]),
        "{errors:?}"
    );
    for row in rows {
        let (set, place) = (row[at("set")].as_str().unwrap(), row[at("set_row")].as_u64().unwrap());
        assert!(
            digests["truth"].starts_with(set) || digests["solved"].starts_with(set),
            "{set}"
        );
        let of_set = server
            .get(&format!("/api/artifacts/{set}/rows?limit=1&offset={place}"))
            .json();
        let own = |name: &str| {
            let at = of_set["columns"]
                .as_array()
                .unwrap()
                .iter()
                .position(|column| column["name"] == name)
                .unwrap();
            of_set["rows"][0][at].clone()
        };
        assert_eq!(
            (own("family"), own("max_displacement_mm")),
            (
                row[at("pattern/family")].clone(),
                row[at("pattern/simulated_max_mm")].clone()
            )
        );
    }
}

/// Values of some columns of each row of an artifact.
fn columns(server: &Server, digest: &str, names: &[&str]) -> Vec<Vec<Value>> {
    let found = server.get(&format!("/api/artifacts/{digest}/rows?limit=1000")).json();
    let all = found["columns"].as_array().unwrap();
    let place = |name: &&str| all.iter().position(|column| column["name"] == *name).unwrap();
    let places: Vec<usize> = names.iter().map(place).collect();
    let rows = found["rows"].as_array().unwrap().iter();
    rows.map(|row| places.iter().map(|place| row[*place].clone()).collect())
        .collect()
}

/// A network on a small balanced set, and its evaluation on the rows that the set keeps for tests.
pub const MODEL: &str = "  small:    { kind: sample, family: small-grid, count: 40, seed: 1 }
  solved:   { kind: solve, needs: [small], elements_per_cell: 1 }
  balanced: { kind: balance, needs: [solved], bins: 5, range: [0 mm, 2.5 mm], target: 40, symmetry: d4, seed: 4 }
  network:  { kind: train, needs: [balanced], network: physics, epochs: 1, batch: 8, seed: 5 }
";

#[test]
fn a_model_is_judged_by_the_test_rows_of_its_own_set_without_an_evaluation() {
    let workspace = with_scene();
    let judged = "  judged: { kind: evaluate, needs: [network, balanced] }\n  direct: { kind: train, needs: [solved], network: physics, epochs: 1, batch: 8, seed: 5 }\n";
    workspace.write(
        "model.yaml",
        &format!("version: 1\nname: model\nscene: scene.yaml\nstages:\n{MODEL}{judged}"),
    );
    let digests = workspace.stages(&["run", "model.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "model.yaml"]);
    let (network, balanced) = (&digests["network"], &digests["balanced"]);
    let found = server
        .get(&format!("/api/artifacts/{network}/judged?limit=1000"))
        .json();
    // What the evaluation finds, from the worst.
    let names = [
        "pattern/max_error.0_mm",
        "pattern/rms.0_mm",
        "pattern/predicted_max.0_mm",
        "set_row",
    ];
    let mut expected: Vec<Vec<f64>> = columns(&server, &digests["judged"], &names)
        .iter()
        .map(|row| row.iter().map(|value| value.as_f64().unwrap()).collect())
        .collect();
    expected.sort_by(|a, b| b[0].total_cmp(&a[0]));
    let own: Vec<Vec<f64>> = found["rows"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| {
            ["max_error_mm", "rms_mm", "predicted_max_mm", "row"]
                .map(|key| row[key].as_f64().unwrap())
                .to_vec()
        })
        .collect();
    assert!(own.len() > 1 && own.len() == expected.len(), "{found}");
    for (one, other) in own.iter().zip(&expected) {
        assert!(
            one.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-9),
            "{one:?} and {other:?}"
        );
    }
    let parts = columns(&server, balanced, &["split"]);
    let count = |part: &str| parts.iter().filter(|row| row[0] == part).count();
    assert_eq!(
        (&found["judged"], &found["total"], &found["learned"]),
        (&json!(count("test")), &json!(count("test")), &json!(count("train")))
    );
    assert_eq!(found["sets"], json!([balanced]));
    let all = found["families"].as_array().unwrap().last().unwrap();
    assert_eq!(
        (&all["family"], &all["max_error_mm"]),
        (&json!("all"), &json!(own[0][0]))
    );
    // The least error of all is among the least of its family.
    let least = json!(own[own.len() - 1][3] as u64);
    let best = found["best"].as_array().unwrap();
    assert!(best.iter().any(|best| best["row"] == least), "{found}");
    // Another part of the set, each row of which is of that part.
    for part in ["validation", "train"] {
        let other = server
            .get(&format!("/api/artifacts/{network}/judged?split={part}&limit=1000"))
            .json();
        assert_eq!((&other["split"], &other["judged"]), (&json!(part), &json!(count(part))));
        for row in other["rows"].as_array().unwrap() {
            assert_eq!(parts[row["row"].as_u64().unwrap() as usize][0], part);
        }
    }
    // The worst row, with what is said of it beside its label.
    let row = own[0][3];
    let reply = server.get(&format!("/api/artifacts/{network}/prediction?row={row}&of={balanced}"));
    let (document, _) = reply.frame();
    assert_eq!(document["max_error_mm"], json!(own[0][0]));
    let (label, predicted) = (reply.numbers("label"), reply.numbers("predicted"));
    let worst = label
        .iter()
        .zip(&predicted)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max);
    assert!((f64::from(worst) - own[0][0]).abs() < 1e-6, "{worst}");
    let stored = server
        .get(&format!(
            "/api/artifacts/{balanced}/arrays?paths=displacement&rows={row}"
        ))
        .frame()
        .1;
    let stored: Vec<f32> = stored[..4 * 5202]
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes(four.try_into().unwrap()))
        .collect();
    assert_eq!(label, stored);
    for (path, status) in [
        (format!("{balanced}/judged"), 400),
        (format!("{}/judged", digests["direct"]), 404),
        (format!("{network}/judged?limit=1001"), 400),
        (format!("{network}/judged?split=all"), 400),
        (format!("{network}/prediction"), 404),
        (format!("{network}/prediction?row=99999"), 404),
        (format!("{network}/prediction?row=0&of={network}"), 404),
        (format!("{network}/prediction?row=0&of={}", digests["small"]), 400),
        (format!("{network}/prediction?row=0&of={}", digests["solved"]), 200),
    ] {
        let reply = server.get(&format!("/api/artifacts/{path}"));
        assert_eq!(reply.status, status, "{path}: {}", reply.text());
    }
    for path in ["judged", "prediction"] {
        let target = format!("/api/artifacts/{network}/{path}");
        assert_eq!(server.post(&target, &json!({})).status, 405);
        assert_eq!(server.request("GET", &target, &[], b"").status, 401);
    }
}

#[test]
fn an_effect_that_lacks_its_data_says_so_before_it_is_asked_for() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let scene = server.get("/api/scenes").json()["scenes"][0].clone();
    let effect = |name: &str| {
        let all = scene["effects"].as_array().unwrap();
        all.iter().find(|effect| effect["name"] == name).unwrap().clone()
    };
    let solve = |name: &str| {
        let body = json!({ "pattern": rows(disc), "effects": [name], "elements_per_cell": 1, "quick": true });
        server.post("/api/sketch", &body)
    };
    let mut refused = 0;
    for one in scene["effects"].as_array().unwrap() {
        let name = one["name"].as_str().unwrap();
        if one["on"] != false || one["in_time"] == true {
            continue;
        }
        let reply = solve(name);
        match one["refused"].as_str() {
            None => assert_eq!(reply.status, 200, "{name}: {}", reply.text()),
            Some(why) => {
                refused += 1;
                let told = reply.json()["error"]["message"].as_str().unwrap().to_owned();
                assert!(
                    reply.status == 400 && why.starts_with(&told),
                    "{name}: {why:?} and {told:?}"
                );
            }
        }
    }
    assert!(refused > 0, "{scene}");
    let stiffening = effect("strain_stiffening")["refused"].as_str().unwrap().to_owned();
    assert!(
        stiffening.contains("Jm <") && stiffening.contains("properties"),
        "{stiffening}"
    );
    assert_eq!(effect("wrinkling")["refused"], Value::Null);
}

#[test]
fn numbers_without_a_unit_are_noted_at_the_start_and_beside_the_scene() {
    let workspace = with_scene();
    let scene = std::fs::read_to_string(workspace.path("scene.yaml")).unwrap();
    let bare = scene.replace("5.25 kV", "5250");
    assert_ne!(bare, scene);
    workspace.write("scene.yaml", &bare);
    workspace.write("short.yaml", &with_scene_in_a_file(SHORT).0);
    for (arguments, path) in [
        (["sketch", "scene.yaml"], "drive.voltage"),
        (["serve", "short.yaml"], "scene.drive.voltage"),
    ] {
        let server = Server::start(&workspace, &arguments);
        let found = server.get("/api/scenes").json();
        let note = found["scenes"][0]["note"].as_str().unwrap().to_owned();
        assert!(note.ends_with("drive.voltage: 5250 as 5250 V"), "{note}");
        let said = server.end(Signal::TERM).stderr;
        let warning = format!(
            "warning: {}: numbers without a unit were read in base units: {path}: 5250 as 5250 V\n",
            arguments[1]
        );
        assert_eq!(said, warning);
    }
}

#[test]
fn a_scene_that_is_broken_later_is_listed_with_its_problem() {
    let workspace = with_scene();
    workspace.write("short.yaml", SHORT);
    workspace.write("two.yaml", &with_scene_in_a_file(SHORT).0);
    let server = Server::start(&workspace, &["serve", "short.yaml", "two.yaml"]);
    let names = |found: &Value| found["scenes"].as_array().unwrap().len();
    let before = server.get("/api/scenes").json();
    assert_eq!((names(&before), &before["refused"]), (2, &json!([])));
    workspace.write("scene.yaml", "version: 1\nmembrane: [\n");
    let after = server.get("/api/scenes").json();
    assert_eq!(names(&after), 1);
    let refused = after["refused"].as_array().unwrap();
    assert_eq!(refused.len(), 1, "{after}");
    assert!(refused[0]["path"].as_str().unwrap().ends_with("two.yaml"));
    let message = refused[0]["error"]["message"].as_str().unwrap();
    assert!(message.contains("scene.yaml is not valid YAML"), "{message}");
    assert!(
        refused[0]["error"]["file"].as_str().unwrap().ends_with("scene.yaml"),
        "{after}"
    );
    // The place is said once.
    assert!(
        !message.contains(" line ") && refused[0]["error"]["line"].is_u64(),
        "{after}"
    );
}

#[test]
fn scenes_that_the_sketchpad_does_not_show_are_named_with_the_reason() {
    let workspace = with_scene();
    workspace.write("short.yaml", SHORT);
    let swept = SHORT
        .replace("5.25 kV", "\"${volts}\"")
        .replace("kind: sample,", "kind: sample, foreach: { volts: [4 kV, 5 kV] },")
        .replace("needs: [small]", "needs: [small], foreach: { volts: [4 kV, 5 kV] }");
    workspace.write("swept.yaml", &swept);
    let blown = scene_file() + "loads: { pressure: 500 Pa }\n";
    workspace.write("blown.yaml", &blown);
    let stages = "stages:\n  one: { kind: sample, family: small-grid, count: 2, seed: 1 }\n";
    workspace.write(
        "pump.yaml",
        &format!("version: 1\nname: pump\nscene: blown.yaml\n{stages}"),
    );
    let server = Server::start(&workspace, &["serve", "short.yaml", "swept.yaml", "pump.yaml"]);
    let found = server.get("/api/scenes").json();
    assert_eq!(
        (found["scenes"].as_array().unwrap().len(), &found["refused"]),
        (1, &json!([]))
    );
    let in_space = "the sketchpad simulates membranes in the plane; this one has a pressure";
    for (at, file, reason) in [
        (
            0,
            "swept.yaml",
            "the sweep of the pipeline sets `${volts}` of its scene",
        ),
        (1, "pump.yaml", in_space),
    ] {
        let left_out = &found["left_out"][at];
        assert!(left_out["path"].as_str().unwrap().ends_with(file), "{left_out}");
        assert_eq!(left_out["reason"], reason);
    }
    let help = found["left_out"][1]["help"].as_str().unwrap();
    assert!(help.contains("pump.yaml PATTERN --figure out.png"), "{help}");
    // Requests and the command refuse them in the same words.
    let asked = server.post("/api/sketch", &json!({ "scene": blown, "pattern": rows(disc) }));
    assert_eq!(
        (asked.status, asked.json()["error"]["message"].as_str()),
        (400, Some(in_space))
    );
    for (file, told) in [
        ("blown.yaml", in_space),
        ("swept.yaml", "the sweep of the pipeline sets `${volts}`"),
    ] {
        let ended = workspace.run(&["sketch", file]);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(
            ended.stderr.contains(told) && ended.stderr.contains("deaflow s"),
            "{}",
            ended.stderr
        );
    }
    let Some(mut tab) = Tab::open() else { return };
    tab.screen(1440, 900, "light");
    tab.go(&format!("{}#/sketch", server.url));
    tab.until("document.querySelector('#left-out')");
    assert_eq!(tab.text("#left-out summary"), "Not shown here: swept.yaml, pump.yaml");
    let shown = tab.value("[document.querySelector('#left-out').open, document.querySelectorAll('.refused').length]");
    assert_eq!(shown, json!([false, 0]));
    tab.until("document.querySelector('#results').dataset.settled === 'true'");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn a_search_ends_the_one_before() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let pattern: Vec<Vec<u8>> = (0..50).map(|_| (0..50).map(|x| u8::from(x < 25)).collect()).collect();
    let body = json!({ "pattern": pattern, "point": [25, 25], "direction": 0 });
    let search = || server.post("/api/sketch/improve", &body).text();
    let both = std::thread::scope(|scope| {
        let one = scope.spawn(search);
        let other = scope.spawn(search);
        [one.join().unwrap(), other.join().unwrap()]
    });
    let last = |text: &String| -> Value { serde_json::from_str(text.lines().last().unwrap()).unwrap() };
    let ended = both.iter().map(last).filter(|last| last["error"].is_null());
    assert_eq!(ended.count(), 1, "{both:?}");
    let told = both
        .iter()
        .map(last)
        .filter_map(|last| Some(last["error"]["message"].as_str()?.to_owned()));
    assert_eq!(
        told.collect::<Vec<_>>(),
        ["another search was started, which stops this one"]
    );
}

#[test]
fn what_is_looked_for_and_is_not_there_is_said() {
    let workspace = Workspace::small();
    let digests = workspace.stages(&["run", "small.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    let solved = &digests["solved"];
    let found = server
        .get(&format!(
            "/api/artifacts/{solved}/rows?filter=family+%3D+smallgrid&limit=0"
        ))
        .json();
    assert_eq!(found["matched"], 0);
    let unknown = &found["unknown"][0];
    assert_eq!(
        (&unknown["column"], &unknown["value"]),
        (&json!("family"), &json!("smallgrid"))
    );
    assert!(
        unknown["known"].as_array().unwrap().contains(&json!("small-grid")),
        "{unknown}"
    );
    // A page says so, too, where it has nothing to show.
    for digest in digests.values() {
        let page = server.get(&format!("/api/artifacts/{digest}/page")).text();
        let shown = ["<svg", "<table", "<ul", "have no figures"];
        assert!(shown.iter().any(|mark| page.contains(mark)), "{page}");
    }
    let wrong = server.request("POST", "/api/sketch/import?format=gif", &[&server.bearer()], b"");
    let help = wrong.json()["error"]["help"].as_str().unwrap().to_owned();
    assert!(
        wrong.status == 400 && help.contains("png, jpg, jpeg, tif, tiff, bmp, dxf, svg"),
        "{help}"
    );
    // Results of a run have their units.
    let id = server.get("/api/runs").json()["runs"][0]["id"]
        .as_str()
        .unwrap()
        .to_owned();
    let run = server.get(&format!("/api/runs/{id}")).json();
    let units = run["units"].as_object().unwrap();
    assert_eq!(units["solved.max_displacement"], "mm", "{run}");
    assert!(
        !units.contains_key("solved.samples") && run["results"]["solved.samples"].is_number(),
        "{run}"
    );
}

/// A stream of lines that is being read.
struct News(BufReader<TcpStream>);

impl News {
    fn open(server: &Server) -> Self {
        let mut stream = TcpStream::connect(("127.0.0.1", server.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let head = format!(
            "GET /api/events HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{}\r\n\r\n",
            server.port,
            server.bearer()
        );
        stream.write_all(head.as_bytes()).unwrap();
        Self(BufReader::new(stream))
    }

    /// The next document of which something holds.
    fn until(&mut self, holds: impl Fn(&Value) -> bool) -> Value {
        for _ in 0..1000 {
            let mut line = String::new();
            assert!(self.0.read_line(&mut line).unwrap() > 0, "the stream has ended");
            // Between the documents stand the sizes of chunks and the head.
            if let Ok(found) = serde_json::from_str::<Value>(&line)
                && found.is_object()
                && holds(&found)
            {
                return found;
            }
        }
        panic!("it is not told");
    }
}

/// A run in a process of its own that takes longer than any test waits; it is ended by who began it.
pub fn long_run(workspace: &Workspace, more: &[&str]) -> Child {
    workspace.write(
        "long.yaml",
        &SHORT
            .replace("count: 60", "count: 4000")
            .replace("elements_per_cell: 1", "elements_per_cell: 4"),
    );
    let mut command = workspace.command(&[&["run", "long.yaml"], more].concat());
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

#[test]
fn what_another_process_builds_is_told_while_it_builds() {
    let workspace = Workspace::small();
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    assert_eq!(server.get("/api/events?since=1").status, 400);
    assert_eq!(server.post("/api/events", &json!({})).status, 405);
    assert_eq!(server.request("GET", "/api/events", &[], b"").status, 401);
    let mut news = News::open(&server);
    let none = news.until(|_| true);
    assert!(none["store"].is_null() && none["runs"] == json!([]), "{none}");
    let mut child = long_run(&workspace, &["--set", "stages.solved.elements_per_cell=5"]);
    let told = news.until(|found| found["runs"][0]["stages"][0]["name"] == "solved");
    let run = &told["runs"][0];
    assert_eq!(
        (&run["pid"], &run["pipeline"]),
        (&json!(child.id()), &json!("short")),
        "{run}"
    );
    assert_eq!(run["set"], json!({ "stages.solved.elements_per_cell": "5" }), "{run}");
    assert!(
        run["stages"][0]["told"]
            .as_str()
            .unwrap()
            .starts_with("4000 patterns to do"),
        "{run}"
    );
    assert_eq!(server.get("/api/status").json()["runs"][0]["pid"], child.id());
    let before = told["objects"].as_u64().unwrap();
    // Chunks appear as they are built.
    news.until(|found| found["objects"].as_u64().unwrap() > before);
    child.kill().unwrap();
    child.wait().unwrap();
    news.until(|found| found["runs"] == json!([]));
}

#[test]
fn a_run_that_was_begun_here_is_told_step_by_step() {
    let workspace = Workspace::small();
    // Some seconds of work: the server looks twice in each.
    workspace.write(
        "long.yaml",
        &SHORT
            .replace("count: 60", "count: 600")
            .replace("elements_per_cell: 1", "elements_per_cell: 4"),
    );
    let server = Server::start(&workspace, &["serve", "long.yaml", "--allow-run"]);
    let mut news = News::open(&server);
    let begun: Reply = server.post("/api/run", &json!({}));
    assert_eq!(begun.status, 200, "{}", begun.text());
    let told = news.until(|found| {
        let stage = &found["begun"]["stages"][0];
        stage["unit"] == "patterns" && stage["done"].as_f64().is_some_and(|done| done > 0.0)
    });
    let stage = &told["begun"]["stages"][0];
    assert_eq!(
        (&stage["steps"], &stage["unit"]),
        (&json!(600), &json!("patterns")),
        "{stage}"
    );
    let ended = news.until(|found| found["begun"].is_null() && !found["last_run"].is_null());
    assert_eq!(ended["last_run"]["pipeline"], "short");
    assert_eq!(server.get("/api/run").json()["exit_code"], 0);
}

#[test]
fn a_scene_of_its_own_is_where_a_pattern_of_an_artifact_is_saved_from() {
    // What the page sends of a design: the scene as it stands in the artifact.
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let body = json!({ "scene": scene_file(), "pattern": rows(disc), "format": "dxf", "smooth": true });
    let file = server.post("/api/sketch/export", &body);
    assert!(
        file.status == 200 && file.text().contains("LWPOLYLINE"),
        "{}",
        file.text()
    );
}
