//! The store and the sketchpad in a browser: what is served over the wire, who is let in, and what a person sees.

mod answers;
mod areas;
mod changed;
mod fronts;
mod gallery;
mod overview;
mod pad;
mod reproduced;
mod server;
pub(super) mod tab;
mod views;

use std::collections::BTreeSet;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};

use super::browser::MEASURE;
use super::common::{Workspace, csv, csv_of, files, scene_file, scene_of_20_cells};
use server::Server;
use tab::Tab;

/// A disc about the middle, which stays stable.
fn disc(x: usize, y: usize) -> bool {
    let from = |at: usize| (at as f64 - 24.5).powi(2);
    from(x) + from(y) < 120.0
}

fn rows(active: impl Fn(usize, usize) -> bool) -> Value {
    rows_of(50, active)
}

/// A pattern of `cells` × `cells` cells.
fn rows_of(cells: usize, active: impl Fn(usize, usize) -> bool) -> Value {
    let row = |y: usize| (0..cells).map(|x| u8::from(active(x, y))).collect::<Vec<_>>();
    json!((0..cells).map(row).collect::<Vec<_>>())
}

fn with_scene() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace
}

/// What `deaflow solve` finds of a pattern: its largest displacement in mm, exit code and outcome.
fn solved(workspace: &Workspace, pattern: &str, scene: &str, options: &[&str]) -> (f64, Option<i32>, String) {
    let ended = workspace.run(&[&["solve", scene, pattern, "-o", "out.h5"], options].concat());
    let shown = workspace.run(&["show", "out.h5", "--csv"]);
    let mut lines = shown.stdout.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row: Vec<&str> = lines.next().unwrap().split(',').collect();
    let of = |name: &str| {
        row[header
            .iter()
            .position(|head| *head == name)
            .unwrap_or_else(|| panic!("{header:?}"))]
    };
    (
        of("max_displacement_mm").parse().unwrap(),
        ended.code,
        of("outcome").to_owned(),
    )
}

#[test]
fn a_drawn_pattern_is_solved_as_the_command_solves_it() {
    let workspace = with_scene();
    workspace.write("disc.csv", &csv(disc));
    workspace.write("high.yaml", &scene_file().replace("5.25 kV", "9 kV"));
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    for (body, options) in [
        (json!({}), &[][..]),
        (
            json!({ "elements_per_cell": 1, "order": 2 }),
            &["--elements-per-cell", "1", "--order", "2"],
        ),
        (json!({ "method": "chord:2" }), &["--method", "chord:2"]),
    ] {
        let mut body = body;
        body["pattern"] = rows(disc);
        body["point"] = json!([35, "20 mm"]);
        body["direction"] = json!("90 deg");
        let reply = server.post("/api/sketch", &body);
        assert_eq!(reply.status, 200, "{}", reply.text());
        let found = reply.json();
        let (largest, _, outcome) = solved(&workspace, "disc.csv", "scene.yaml", options);
        assert_eq!(found["outcome"], outcome.as_str());
        let drawn = found["max_displacement"].as_f64().unwrap();
        assert!((drawn - largest).abs() < 1e-6, "{options:?}: {drawn} and {largest}");
        assert!(found["value"].as_f64().unwrap().abs() < largest);
        let error = found["error"].as_f64().unwrap();
        assert!((0.0..0.1 * largest).contains(&error), "{found}");
        assert!(found["seconds"].as_f64().unwrap() > 0.0);
        if options.is_empty() {
            assert!(found["critical_voltage_error"].as_f64().unwrap() > 0.0, "{found}");
            let critical = found["critical_voltage"].as_f64().unwrap();
            assert!((5250.0..9000.0).contains(&critical), "{found}");
        }
    }
    let high = server
        .post("/api/sketch", &json!({ "pattern": rows(disc), "voltage": "9 kV" }))
        .json();
    let (_, code, outcome) = solved(&workspace, "disc.csv", "high.yaml", &[]);
    assert_eq!(
        (code, high["outcome"].as_str()),
        (Some(3), Some(outcome.as_str())),
        "{high}"
    );
    assert!(high["max_displacement"].is_null() && high["value"].is_null());
    let bracket = [0, 1].map(|end| high["bracket"][end].as_f64().unwrap());
    assert!(
        5250.0 < bracket[0] && bracket[0] < bracket[1] && bracket[1] <= 9000.0,
        "{bracket:?}"
    );
}

#[test]
fn fields_and_sensitivities_come_as_frames() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let mut body = json!({ "pattern": rows(|x, _| x < 25), "point": [25, 25], "direction": 0, "quick": true,
        "fields": ["displacement", "stress", "field", "tension", "sensitivity"] });
    let reply = server.post("/api/sketch", &body);
    let (document, data) = reply.frame();
    let numbers = |name: &str| -> Vec<f32> {
        let arrays = document["arrays"].as_array().unwrap();
        let array = arrays
            .iter()
            .find(|array| array["name"] == name)
            .unwrap_or_else(|| panic!("{document}"));
        let count: u64 = array["shape"]
            .as_array()
            .unwrap()
            .iter()
            .map(|n| n.as_u64().unwrap())
            .product();
        let start = array["start"].as_u64().unwrap() as usize;
        let each = data[start..start + 4 * count as usize].chunks_exact(4);
        each.map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
    };
    let moved = numbers("displacement");
    let largest = moved
        .chunks_exact(2)
        .map(|u| f64::from(u[0]).hypot(f64::from(u[1])))
        .fold(0.0, f64::max);
    assert!((largest - document["max_displacement"].as_f64().unwrap()).abs() < 1e-6);
    assert!(numbers("stress").iter().all(|stress| *stress > 0.0));
    assert_eq!(numbers("field").iter().filter(|field| **field > 0.0).count(), 1250);
    // To first order: a whole cell that becomes active changes the value by some times as much, in the same direction.
    let sensitivity = numbers("sensitivity");
    let value = document["value"].as_f64().unwrap();
    body["fields"] = json!([]);
    for (x, y) in [(26, 25), (40, 25), (26, 40)] {
        body["pattern"] = rows(|a, b| a < 25 || (a, b) == (x, y));
        let changed = server.post("/api/sketch", &body).json()["value"].as_f64().unwrap() - value;
        let told = f64::from(sensitivity[50 * y + x]);
        assert_eq!(changed > 0.0, told > 0.0, "({x}, {y}): {changed} and {told}");
        assert!(
            changed.abs() < 6.0 * told.abs() && told.abs() < 6.0 * changed.abs(),
            "({x}, {y}): {changed} and {told}"
        );
    }
}

#[test]
fn a_search_is_told_step_by_step_and_gains() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let body = json!({ "pattern": rows(disc), "point": [25, 25], "direction": 0, "area": 0.3 });
    let reply = server.post("/api/sketch/improve", &body);
    assert_eq!(reply.status, 200, "{}", reply.text());
    let steps: Vec<Value> = reply
        .text()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let last = steps.last().unwrap();
    assert_eq!(last["done"], true, "{last}");
    let values: Vec<f64> = steps.iter().map(|step| step["value"].as_f64().unwrap()).collect();
    assert!(
        steps.len() > 2 && values.windows(2).all(|pair| pair[1] >= pair[0]),
        "{values:?}"
    );
    assert!((last["area"].as_f64().unwrap() - 0.3).abs() <= 0.0051);
    let mut again = body.clone();
    again["pattern"] = last["pattern"].clone();
    again.as_object_mut().unwrap().remove("area");
    (again["elements_per_cell"], again["order"]) = (json!(1), json!(2));
    let found = server.post("/api/sketch", &again).json();
    assert!((found["value"].as_f64().unwrap() - last["value"].as_f64().unwrap()).abs() < 1e-6);
    let none = server.post("/api/sketch/improve", &json!({ "pattern": rows(disc) }));
    assert_eq!(none.status, 400, "{}", none.text());
}

#[test]
fn files_of_drawn_patterns_are_read_back_as_they_were_drawn() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    for format in ["csv", "npy", "png"] {
        let file = server.post(
            "/api/sketch/export",
            &json!({ "pattern": rows(disc), "format": format }),
        );
        assert_eq!(file.status, 200, "{}", file.text());
        assert!(
            file.head.contains(&format!("filename=\"drawn.{format}\"")),
            "{}",
            file.head
        );
        let read = server.request(
            "POST",
            &format!("/api/sketch/import?format={format}"),
            &[&server.bearer()],
            &file.body,
        );
        assert_eq!(read.json()["patterns"], json!([rows(disc)]), "{format}");
        std::fs::write(workspace.path(&format!("mine.{format}")), &file.body).unwrap();
        let name = format!("mine.{format}");
        assert_eq!(
            workspace.run(&["solve", "scene.yaml", &name, "-o", "out.h5"]).code,
            Some(0)
        );
    }
    for format in ["svg", "dxf", "gbr"] {
        let file = server.post(
            "/api/sketch/export",
            &json!({ "pattern": rows(disc), "format": format, "smooth": true }),
        );
        assert!(file.status == 200 && file.body.len() > 500, "{format}");
    }
    let wrong = server.request("POST", "/api/sketch/import?format=csv", &[&server.bearer()], b"1,2\n");
    assert_eq!(wrong.status, 400, "{}", wrong.text());
    assert!(wrong.json()["error"]["help"].as_str().unwrap().contains("50"));
}

#[test]
fn nobody_is_let_in_without_the_token_or_from_elsewhere() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let (bearer, port) = (server.bearer(), server.port);
    let ask = |lines: &[&str]| server.request("GET", "/api/start", lines, b"").status;
    assert_eq!(ask(&[&bearer]), 200);
    assert_eq!(ask(&[]), 401);
    assert_eq!(ask(&["Authorization: Bearer 00"]), 401);
    let own = format!("Origin: http://127.0.0.1:{port}");
    assert_eq!(ask(&[&bearer, &own]), 200);
    for line in [
        "Host: evil.example",
        "Host: 127.0.0.1",
        "Origin: http://evil.example",
        "Origin: null",
        "Sec-Fetch-Site: cross-site",
    ] {
        assert_eq!(ask(&[&bearer, line]), 403, "{line}");
    }
    for line in [
        format!("Host: [::1]:{port}"),
        format!("Origin: http://localhost:{port}"),
    ] {
        assert_eq!(ask(&[&bearer, &line]), 403, "{line}");
    }
    // The page itself is shown to nobody else either.
    assert_eq!(server.request("GET", "/", &[], b"").status, 401);
    assert_eq!(server.request("GET", "/?token=00", &[], b"").status, 401);
    assert_eq!(server.request("GET", "/sketch.js", &[], b"").status, 401);
    let entered = server.request("GET", &format!("/?token={}", server.token), &[], b"");
    assert_eq!(entered.status, 200);
    let head = entered.head.to_ascii_lowercase();
    let cookie = head.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    assert!(
        cookie.contains("httponly") && cookie.contains("samesite=strict"),
        "{cookie}"
    );
    let cookie = format!("Cookie: {}", cookie.split(';').next().unwrap());
    assert_eq!(ask(&[&cookie]), 200);
    let policy = head
        .lines()
        .find_map(|line| line.strip_prefix("content-security-policy: "))
        .unwrap();
    assert!(
        policy.contains("script-src 'self';") && !policy.contains("unsafe"),
        "{policy}"
    );
    for name in ["main.js", "sketch.js", "page.css"] {
        assert_eq!(
            server.request("GET", &format!("/{name}"), &[&cookie], b"").status,
            200,
            "{name}"
        );
    }
    // The other side of the machine's addresses is not listened on.
    let all = std::fs::read_to_string("/proc/net/tcp").unwrap_or_default();
    let hex = format!(":{port:04X}");
    let listening = all.lines().filter(|line| {
        line.contains(" 0A ")
            && line
                .split_whitespace()
                .nth(1)
                .is_some_and(|local| local.ends_with(&hex))
    });
    assert!(listening.into_iter().all(|line| line.contains("0100007F:")), "{all}");
}

#[test]
fn what_is_asked_cannot_reach_files_or_change_anything() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    workspace.write("secret.yaml", &scene_file());
    let before = files(&workspace.path("store"));
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    for path in [
        "/../small.yaml",
        "/..%2fsmall.yaml",
        "/api/artifacts/..%2f..%2fsmall.yaml",
        "/api/artifacts/%2e%2e",
        "/api/pipelines/..%2fsecret.yaml",
        "/api/runs/..",
        "/small.yaml",
        "/etc/passwd",
        "//etc/passwd",
        "/api/pipelines/secret.yaml",
    ] {
        let reply = server.get(path);
        assert_eq!(reply.status, 404, "{path}: {}", reply.text());
    }
    for body in [
        json!({ "pipeline": "secret.yaml" }),
        json!({ "set": { "scene": "secret.yaml" } }),
        json!({ "set": { "stages.small.files": ["/etc/passwd"] } }),
        json!({ "set": { "scene.geometry.frame": { "mask": "/etc/passwd" } } }),
        json!({ "set": { "scene.geometry.frame": { "opening": { "file": "/etc/passwd.dxf" } } } }),
    ] {
        let reply = server.post("/api/plan", &body);
        assert!(matches!(reply.status, 400 | 404), "{body}: {}", reply.text());
        assert!(!reply.text().contains("root:"));
    }
    for shape in ["mask: /etc/passwd", "file: frame.dxf"] {
        let masked = scene_file().replace("cells: 50", &format!("cells: 50, frame: {{ opening: {{ {shape} }} }}"));
        let reply = server.post("/api/sketch", &json!({ "scene": masked, "pattern": rows(disc) }));
        assert_eq!(reply.status, 400, "{}", reply.text());
        assert!(reply.text().contains("must not name files"), "{}", reply.text());
    }
    for (method, path) in [("POST", "/api/run"), ("DELETE", "/api/run")] {
        assert_eq!(
            server.request(method, path, &[&server.bearer()], b"{}").status,
            403,
            "{method}"
        );
    }
    for method in ["PUT", "PATCH", "DELETE", "OPTIONS", "TRACE"] {
        assert_eq!(
            server.request(method, "/api/runs", &[&server.bearer()], b"").status,
            405,
            "{method}"
        );
    }
    let long = vec![b' '; (4 << 20) + 1];
    assert_eq!(
        server.request("POST", "/api/sketch", &[&server.bearer()], &long).status,
        413
    );
    assert_eq!(
        server.request("POST", "/api/sketch", &[&server.bearer()], b"[").status,
        400
    );
    let ended = server.end(Signal::INT);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(files(&workspace.path("store")), before, "nothing is left behind");
    // Nothing is held that a collection would wait for.
    assert_eq!(workspace.run(&["gc", "--keep-runs", "1", "-n"]).code, Some(0));
}

#[test]
fn runs_artifacts_and_rows_are_those_of_the_commands() {
    let workspace = Workspace::small();
    let digests = workspace.stages(&["run", "small.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    let log = workspace.run(&["log", "--json"]).json();
    assert_eq!(server.get("/api/runs").json()["runs"], log["runs"]);
    // A page that is open keeps no collection from its work.
    for gc in [&["gc", "-n"][..], &["gc"]] {
        assert_eq!(workspace.run(gc).code, Some(0));
    }
    let id = log["runs"][0]["id"].as_str().unwrap();
    let run = server.get(&format!("/api/runs/{id}")).json();
    assert_eq!(run["parameters"]["stages.small.count"], "4", "{run}");
    let listed = server.get("/api/artifacts").json();
    let listed: BTreeSet<&str> = listed["artifacts"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["digest"].as_str().unwrap())
        .collect();
    assert_eq!(listed, digests.values().map(String::as_str).collect());
    let solved = &digests["solved"];
    let artifact = server.get(&format!("/api/artifacts/{solved}")).json();
    assert_eq!(
        (artifact["kind"].as_str(), artifact["digest"].as_str()),
        (Some("solve"), Some(solved.as_str()))
    );
    assert_eq!(
        server.get(&format!("/api/artifacts/{}", &solved[..12])).json(),
        artifact
    );
    // The rows are those of `show --csv`, with the area beside.
    let shown = workspace.run(&["show", "solved", "--csv"]).stdout;
    let header: Vec<&str> = shown.lines().next().unwrap().split(',').collect();
    let column = header.iter().position(|name| *name == "max_displacement_mm").unwrap();
    let mut expected: Vec<f64> = shown
        .lines()
        .skip(1)
        .map(|line| line.split(',').nth(column).unwrap().parse().unwrap())
        .collect();
    let rows = |query: &str| server.get(&format!("/api/artifacts/{solved}/rows?{query}"));
    let all = rows("sort=-max_displacement_mm").json();
    let place = |name: &str| {
        all["columns"]
            .as_array()
            .unwrap()
            .iter()
            .position(|column| column["name"] == name)
            .unwrap()
    };
    let values = |answer: &Value, at: usize| -> Vec<f64> {
        answer["rows"]
            .as_array()
            .unwrap()
            .iter()
            .map(|row| row[at].as_f64().unwrap())
            .collect()
    };
    let at = place("max_displacement_mm");
    expected.sort_by(|a, b| b.total_cmp(a));
    assert_eq!(values(&all, at), expected);
    let middle = expected[expected.len() / 2];
    let some = rows(&format!(
        "filter=max_displacement_mm+%3E%3D+{middle}+and+family+%3D+small-grid&histogram=area&bins=4"
    ))
    .json();
    assert!(
        some["matched"].as_u64().unwrap() < some["total"].as_u64().unwrap(),
        "{some}"
    );
    assert!(values(&some, at).iter().all(|value| *value >= middle));
    let counts: u64 = some["histogram"]["counts"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| n.as_u64().unwrap())
        .sum();
    assert_eq!(Some(counts), some["matched"].as_u64());
    assert_eq!(rows("filter=nothing+%3D+1").status, 400);
    assert_eq!(rows("filter=family+%3D+bezier+or+family+%3D+small-grid").status, 400);
    assert_eq!(rows("limit=many").status, 400);
    assert_eq!(rows("fliter=x").status, 400);
    // Pictures: the same cells as in the table's area, from whichever chunk.
    let total = all["total"].as_u64().unwrap();
    let reply = server.get(&format!(
        "/api/artifacts/{solved}/arrays?paths=patterns,displacement&rows=0,{}",
        total - 1
    ));
    let (document, data) = reply.frame();
    assert_eq!(document["arrays"][0]["shape"], json!([2, 20, 20]));
    let plain = rows("").json();
    for (k, row) in [0, total as usize - 1].into_iter().enumerate() {
        let active = data[k * 400..(k + 1) * 400].iter().filter(|cell| **cell == 1).count();
        assert!((plain["rows"][row][place("area")].as_f64().unwrap() - active as f64 / 400.0).abs() < 1e-12);
    }
    assert_eq!(
        server
            .get(&format!("/api/artifacts/{solved}/arrays?paths=patterns&rows={total}"))
            .status,
        404
    );
    for digest in digests.values() {
        let page = server.get(&format!("/api/artifacts/{digest}/page"));
        assert_eq!(page.status, 200, "{}", page.text());
        assert!(!page.text().contains("<script") && page.head.contains("default-src 'none'"));
    }
}

#[test]
fn a_plan_is_that_of_the_command() {
    let workspace = Workspace::small();
    workspace.stages(&["run", "small.yaml"]);
    let server = Server::start(&workspace, &["serve", "small.yaml", "--allow-run"]);
    let planned = |set: &str| workspace.run(&["plan", "small.yaml", "--json", "--set", set]).json();
    let asked = |path: &str, value: Value| {
        let reply = server.post("/api/plan", &json!({ "pipeline": 0, "set": { path: value } }));
        assert_eq!(reply.status, 200, "{}", reply.text());
        reply.json()
    };
    for (path, value, set) in [
        ("scene.drive.voltage", json!("4 kV"), "scene.drive.voltage=4 kV"),
        ("stages.balanced.target", json!(3), "stages.balanced.target=3"),
        ("stages.small.count", json!(4), "stages.small.count=4"),
    ] {
        let (own, command) = (asked(path, value), planned(set));
        for key in ["pipeline", "stages", "unpriced"] {
            assert_eq!(own[key], command[key], "{set}: {key}");
        }
    }
    let wrong = server.post("/api/plan", &json!({ "set": { "stages.small.cuont": 3 } }));
    assert_eq!(wrong.status, 400);
    assert!(
        wrong.json()["error"]["help"].as_str().unwrap().contains("count"),
        "{}",
        wrong.text()
    );
    // A run from here is one of `deaflow run`, and ends.
    let begun = server.post("/api/run", &json!({ "set": { "stages.balanced.target": 3 } }));
    assert_eq!(begun.status, 200, "{}", begun.text());
    let told = (0..600).find_map(|_| {
        std::thread::sleep(Duration::from_millis(100));
        let told = server.get("/api/run").json();
        (told["running"] == false).then_some(told)
    });
    assert_eq!(told.unwrap()["exit_code"], 0);
    assert_eq!(
        asked("stages.balanced.target", json!(3))["stages"][3]["outcome"],
        "reused"
    );
}

#[test]
fn no_request_brings_the_server_down() {
    let workspace = Workspace::small();
    let digests = workspace.stages(&["run", "small.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    let solved = &digests["solved"];
    let paths = [
        "/api/start".to_owned(),
        "/api/scenes".into(),
        "/api/status".into(),
        "/api/pipelines".into(),
        "/api/pipelines/0".into(),
        "/api/runs".into(),
        "/api/artifacts".into(),
        format!("/api/artifacts/{solved}"),
        format!("/api/artifacts/{solved}/rows"),
        format!("/api/artifacts/{solved}/arrays"),
        format!("/api/artifacts/{solved}/shapes"),
        format!("/api/artifacts/{solved}/page"),
        format!("/api/artifacts/{solved}/neighbours"),
        format!("/api/artifacts/{solved}/again"),
        format!("/api/artifacts/{solved}/judged"),
        format!("/api/artifacts/{solved}/prediction"),
        // Without a query it has no end.
        "/api/events?x=1".into(),
        "/api/plan".into(),
        "/api/run".into(),
        "/api/sketch".into(),
        "/api/sketch/improve".into(),
        "/api/sketch/screen".into(),
        "/api/sketch/reproduce".into(),
        "/api/sketch/export".into(),
        "/api/sketch/import".into(),
        "/".into(),
        "/sketch.js".into(),
    ];
    // SplitMix64 (Steele, Lea and Flood 2014), so that a failure comes again.
    let mut state = 20_u64;
    let mut draw = |below: usize| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) % below as u64) as usize
    };
    let keys = [
        "scene",
        "pattern",
        "voltage",
        "method",
        "elements_per_cell",
        "order",
        "point",
        "direction",
        "effects",
        "fields",
        "quick",
        "area",
        "constraints",
        "format",
        "size",
        "smooth",
        "wanted",
        "name",
        "state",
        "set",
        "pipeline",
        "until",
    ];
    let values = [
        "null",
        "1",
        "-1",
        "0.5",
        "1e308",
        "\"\"",
        "\"newton\"",
        "\"chord:999\"",
        "\"5 kV\"",
        "[]",
        "[[1]]",
        "{}",
        "[25,25]",
        "true",
        "\"\\u0000\\u202e\"",
        "{\"scene.drive.voltage\":\"1 kV\"}",
        "{\"a\":1}",
        "\"small\"",
        "[\"wrinkling\"]",
        "99999999999999999999",
        "[1,[2]]",
    ];
    let words = [
        "filter=a+%3E+1",
        "filter=%FF",
        "sort=-area",
        "limit=-1",
        "limit=1000",
        "offset=999999999999",
        "histogram=family",
        "bins=0",
        "along=nothing",
        "rows=0,1,99999",
        "rows=x",
        "row=0",
        "row=99999",
        "row=1&of=zz",
        "row=1&audit=zz",
        "filter=a+or+b",
        "paths=patterns",
        "paths=..%2f",
        "format=png",
        "scene=small",
        "token=x",
        "%00=%00",
    ];
    let pattern = rows(disc).to_string();
    for round in 0..1000 {
        let path = &paths[draw(paths.len())];
        let method = ["GET", "POST", "POST", "DELETE"][draw(4)];
        let query: Vec<&str> = (0..draw(3)).map(|_| words[draw(words.len())]).collect();
        let entries: Vec<String> = (0..draw(5))
            .map(|_| {
                let value = if draw(8) == 0 {
                    pattern.as_str()
                } else {
                    values[draw(values.len())]
                };
                format!("\"{}\":{value}", keys[draw(keys.len())])
            })
            .collect();
        let mut body = format!("{{{}}}", entries.join(",")).into_bytes();
        if draw(4) == 0 {
            let at = draw(body.len());
            body[at] = draw(256) as u8;
        }
        let target = format!("{path}?{}", query.join("&"));
        let reply = server.request(method, &target, &[&server.bearer()], &body);
        assert!(
            (200..500).contains(&reply.status),
            "{round}: {method} {target} {}: {} {}",
            String::from_utf8_lossy(&body),
            reply.status,
            reply.text()
        );
    }
    // What is no HTTP is closed or refused, and all others are still served.
    for bytes in [
        &b"\x00\x01\x02\r\n\r\n"[..],
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET /api/start HTTP/1.1\r\n\r\n",
        &[b'A'; 100_000],
    ] {
        assert!(server.raw(bytes).status < 500);
    }
    assert_eq!(server.get("/api/start").status, 200);
    let ended = server.end(Signal::TERM);
    assert_eq!(ended.code, Some(0));
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
}

#[test]
fn sketches_whose_clients_have_left_keep_nobody_waiting() {
    let workspace = with_scene();
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    let scenes = server.get("/api/scenes").json();
    let prices = scenes["scenes"][0]["prices"].as_array().unwrap();
    let price = |elements: u64, order: u64| {
        let of = |price: &&Value| price["elements_per_cell"] == elements && price["order"] == order;
        prices.iter().find(of).unwrap()["seconds"].as_f64().unwrap()
    };
    assert!(price(8, 2) > 20.0 * price(1, 1), "{prices:?}");
    // Each would take a minute or more.
    let fine = json!({ "pattern": rows(disc), "elements_per_cell": 8, "order": 2 });
    let waiting: Vec<_> = (0..8).map(|_| server.begin("/api/sketch", &fine)).collect();
    let coarse = json!({ "pattern": rows(disc), "elements_per_cell": 1, "quick": true });
    assert_eq!(server.post("/api/sketch", &coarse).status, 200);
    drop(waiting);
    // It needs one of the places that they had.
    let next = json!({ "pattern": rows(disc), "elements_per_cell": 4 });
    assert_eq!(server.post("/api/sketch", &next).json()["outcome"], "converged");
    assert_eq!(server.end(Signal::INT).code, Some(0));
}

/// Where photographs are to be kept, for who writes the documentation.
fn album() -> Option<std::path::PathBuf> {
    std::env::var_os("DEAFLOW_ALBUM").map(Into::into)
}

fn photographed(tab: &mut Tab, name: &str) {
    for (width, look) in [(1440, "light"), (1440, "dark"), (390, "light"), (390, "dark")] {
        tab.screen(width, 900, look);
        tab.value("scrollTo(0, 0)");
        std::thread::sleep(Duration::from_millis(400));
        assert!(tab.overflow() <= 0.0, "{name} at {width} px is wider than the screen");
        assert_eq!(tab.small_targets(), json!([]), "{name} at {width} px");
        let faults = tab.value(&format!("(() => {{ {MEASURE} return measured('{name}').faults }})()"));
        let unreadable = faults.as_array().unwrap().iter().filter_map(Value::as_str);
        let unreadable: Vec<&str> = unreadable.filter(|fault| fault.contains(": contrast ")).collect();
        assert!(unreadable.is_empty(), "{width} px, {look}: {unreadable:?}");
        if let Some(album) = album() {
            tab.photograph(&album.join(format!("{name}-{width}-{look}.png")));
        }
    }
    tab.screen(1440, 900, "light");
}

/// Opens the sketchpad with a scene and waits for its first answer.
fn on_the_sketchpad(tab: &mut Tab) -> (Workspace, Server) {
    sketchpad_of(tab, &scene_file(), 50)
}

fn sketchpad_of(tab: &mut Tab, scene: &str, cells: usize) -> (Workspace, Server) {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", scene);
    let server = Server::start(&workspace, &["sketch", "scene.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.until("document.querySelector('#outcome')");
    blank(tab, "scene", cells);
    (workspace, server)
}

/// Opens the sketchpad anew with an empty drawing of a scene: by itself it begins with a pattern.
fn blank(tab: &mut Tab, scene: &str, cells: usize) {
    let key = format!("deaflow {scene}");
    let cells = rows_of(cells, |_, _| false).to_string();
    tab.value(&format!("sessionStorage.setItem({}, {})", json!(key), json!(cells)));
    tab.reload();
    tab.until("document.querySelector('#outcome')");
}

#[test]
fn strokes_on_the_sketchpad_are_solved_and_limits_are_told() {
    let Some(mut tab) = Tab::open() else { return };
    let (workspace, _server) = sketchpad_of(&mut tab, &scene_of_20_cells(), 20);
    assert_eq!(
        tab.value("location.search"),
        "",
        "the token does not stay in the address"
    );
    tab.stroke("#pad", &[[0.2, 0.3], [0.4, 0.5], [0.5, 0.3], [0.6, 0.7]]);
    tab.click("[data-tool=ellipse]");
    tab.stroke("#pad", &[[0.6, 0.6], [0.9, 0.9]]);
    let settled = "document.querySelector('#results').dataset.settled === 'true'";
    tab.until(settled);
    // The pattern is what the page itself would save.
    let drawn = tab.value("JSON.parse(localStorage.getItem('deaflow scene'))");
    let cells = |x: usize, y: usize| drawn[y][x] == 1;
    let active = (0..400).filter(|at| cells(at % 20, at / 20)).count();
    assert!((16..240).contains(&active), "{active}");
    workspace.write("drawn.csv", &csv_of(20, cells));
    let (largest, code, _) = solved(&workspace, "drawn.csv", "scene.yaml", &["--elements-per-cell", "1"]);
    assert_eq!(code, Some(0));
    let shown = tab.number("#max-displacement");
    assert!((shown - largest).abs() < 1e-6, "{shown} and {largest}");
    // The pad says where the limit is, and beyond it what has become of the membrane.
    let told = tab.text("#critical-voltage");
    assert!(told.starts_with("limit "), "{told}");
    photographed(&mut tab, "sketchpad");
    tab.write("#volts", "9000");
    tab.until("document.querySelector('#outcome').textContent === 'pull-in' || document.querySelector('#outcome').textContent === 'not-elliptic'");
    tab.until("document.querySelector('#notice').textContent.includes('stable up to')");
    workspace.write("high.yaml", &scene_of_20_cells().replace("5.25 kV", "9 kV"));
    let (_, code, outcome) = solved(&workspace, "drawn.csv", "high.yaml", &["--elements-per-cell", "1"]);
    assert_eq!((code, outcome), (Some(3), tab.text("#outcome")));
    tab.write("#volts", "5250");
    tab.until(settled);
    // By the keyboard: the cursor moves, space draws, and Ctrl Z takes it back.
    tab.value("document.querySelector('#pad').focus()");
    let area = tab.text("#area");
    for _ in 0..3 {
        tab.key("ArrowLeft", 0);
    }
    tab.key("e", 0);
    tab.key(" ", 0);
    tab.until(&format!(
        "document.querySelector('#area').textContent !== {}",
        json!(area)
    ));
    tab.key("z", 2);
    tab.until(&format!(
        "document.querySelector('#area').textContent === {}",
        json!(area)
    ));
    // A search that is stopped leaves what it has reached.
    tab.click("#improve");
    tab.until("document.querySelector('#course')");
    tab.click("#stop");
    tab.until("!document.querySelector('#improve').disabled");
    tab.click("#screen");
    tab.until("document.querySelector('[aria-label=Screening] tbody tr')");
    tab.click("#compare");
    tab.until("document.querySelectorAll('[aria-label=Methods] tbody tr').length === 6");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

#[test]
fn pipelines_rows_and_runs_are_looked_at() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = Workspace::small();
    let digests = workspace.stages(&["run", "small.yaml"]).digests();
    let server = Server::start(&workspace, &["serve", "small.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.click("a[href='#/pipelines/0']");
    tab.until("document.querySelector('#bill').textContent.includes('up to date')");
    tab.write("input[name=find]", "voltage");
    tab.write("[data-path='scene.drive.voltage']", "4 kV");
    tab.until("document.querySelector('#bill').dataset.stale");
    let planned = workspace
        .run(&["plan", "small.yaml", "--json", "--set", "scene.drive.voltage=4 kV"])
        .json();
    let stale: Vec<&str> = planned["stages"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|s| s["outcome"] == "stale")
        .map(|s| s["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        tab.value("document.querySelector('#bill').dataset.stale"),
        stale.join(" ")
    );
    photographed(&mut tab, "pipeline");
    assert_eq!(tab.value("document.title"), "small – Pipelines – deaflow");
    // What is changed has a link of its own.
    let link = tab.value("location.hash");
    assert_eq!(link, "#/pipelines/0?set=scene.drive.voltage%3D4+kV");
    tab.write("[data-path='scene.drive.voltage']", "many");
    tab.until("document.querySelector('[role=alert]')");
    // The plan of before is grey, and no longer counted.
    tab.until("document.querySelector('svg.dag').closest('.old')");
    assert_eq!(tab.value("document.querySelector('#bill').dataset.stale"), "");
    assert!(tab.text("#bill").starts_with("No plan"));
    tab.write("[data-path='scene.drive.voltage']", "4 kV");
    tab.until("document.querySelector('#bill').dataset.stale && !document.querySelector('.old')");
    tab.go("about:blank");
    tab.go(&format!("http://127.0.0.1:{}/{}", server.port, link.as_str().unwrap()));
    tab.until(&format!(
        "document.querySelector('#bill').dataset.stale === {}",
        json!(stale.join(" "))
    ));
    // Rows are filtered by the server, and the address says by what.
    tab.go(&format!(
        "http://127.0.0.1:{}/#/artifacts/{}?tab=rows",
        server.port, digests["solved"]
    ));
    tab.until("document.querySelector('#matched')?.dataset.matched");
    tab.write("input[name=filter]", "family = small-grid");
    tab.until("document.querySelector('#matched').dataset.matched === '4'");
    assert!(tab.value("location.hash").as_str().unwrap().contains("filter=family"));
    tab.until("document.querySelectorAll('.card').length === 4");
    tab.click(".card");
    tab.until("document.querySelector('#sample canvas')");
    photographed(&mut tab, "rows");
    assert!(
        tab.value("document.title")
            .as_str()
            .unwrap()
            .starts_with("solved solve ")
    );
    // A filter that is none leaves no count; a family that there is not is said; the button back goes through all of
    // it.
    tab.write("input[name=filter]", "family");
    tab.until("document.querySelector('#matched').textContent.includes('invalid filter') && !document.querySelector('#matched').dataset.matched");
    tab.until("document.querySelector('.cards.old')");
    tab.write("input[name=filter]", "family = small-grid or family = large-grid");
    tab.until("document.querySelector('[role=alert]')?.textContent.includes('do not support or')");
    tab.write("input[name=filter]", "family = smallgrid");
    tab.until("document.querySelector('#unknown').textContent.includes('large-grid, small-grid')");
    tab.until("document.querySelector('#matched').dataset.matched === '0' && !document.querySelector('.old')");
    tab.value("history.go(-3)");
    tab.until("document.querySelector('input[name=filter]').value === 'family = small-grid' && document.querySelector('#sample canvas')");
    tab.value("history.back()");
    tab.until(
        "document.querySelector('#matched')?.dataset.matched === '4' && !document.querySelector('#sample canvas')",
    );
    // Arrow keys go through the tabs.
    tab.value("document.querySelector('[role=tab][aria-selected=true]').focus()");
    tab.key("ArrowRight", 0);
    tab.until("document.activeElement.id === 'tab-figures' && location.hash.includes('tab=figures')");
    tab.key("ArrowLeft", 0);
    tab.until("document.activeElement.id === 'tab-rows' && document.querySelectorAll('[role=tab][tabindex=\"0\"]').length === 1");
    tab.go(&format!(
        "http://127.0.0.1:{}/#/artifacts/{}?tab=figures",
        server.port, digests["balanced"]
    ));
    tab.until("document.querySelector('iframe')?.contentDocument?.querySelector('svg')");
    photographed(&mut tab, "figures");
    // A run of another process appears once it has ended.
    tab.go(&format!("http://127.0.0.1:{}/#/runs", server.port));
    tab.until("document.querySelectorAll('tbody tr').length === 1");
    workspace.stages(&["run", "small.yaml", "--set", "stages.balanced.target=3"]);
    tab.until("document.querySelectorAll('tbody tr').length === 2");
    photographed(&mut tab, "runs");
    runs_are_sorted_chosen_and_drawn(&mut tab, server.port);
    tab.value("document.querySelectorAll('tbody input').forEach((box) => box.click())");
    tab.click(".tools button");
    tab.until("document.body.innerText.includes('stages.balanced.target')");
    let shown = tab.value("document.querySelectorAll('[aria-label=Results] tbody tr').length");
    tab.click("input[name=equal]");
    let all = tab.value("document.querySelectorAll('[aria-label=Results] tbody tr').length");
    assert!(shown.as_u64() < all.as_u64(), "{shown} of {all}");
    assert!(tab.text("[aria-label=Results]").contains("solved.max_displacement, mm"));
    tab.click("input[name=equal]");
    photographed(&mut tab, "compare");
    assert_eq!(tab.complaints, Vec::<String>::new());
}

/// Of two runs, one with a changed value: columns and their order are in the address, and each run is a line.
fn runs_are_sorted_chosen_and_drawn(tab: &mut Tab, port: u16) {
    let latest = tab.value("[...document.querySelectorAll('tbody a.mono')].map((link) => link.textContent)");
    tab.click("[data-sort=ended]");
    tab.until("location.hash === '#/runs?sort=ended' && document.querySelector('th[aria-sort=ascending]')");
    let oldest = tab.value("[...document.querySelectorAll('tbody a.mono')].map((link) => link.textContent).reverse()");
    assert_eq!(latest, oldest);
    tab.click("input[name=column-took]");
    tab.until("!location.hash.includes('took') && location.hash.includes('columns=') && !document.querySelector('[data-title=took]')");
    let changed = "set:stages.balanced.target";
    tab.click(&format!("input[name='column-{changed}']"));
    tab.until(&format!("document.querySelector(\"[data-sort='{changed}']\")"));
    // The address holds all of it.
    let link = tab.value("location.hash");
    tab.go("about:blank");
    tab.go(&format!("http://127.0.0.1:{port}/{}", link.as_str().unwrap()));
    tab.until(&format!(
        "document.querySelector(\"[data-sort='{changed}']\") && !document.querySelector('[data-title=took]')"
    ));
    // One line for each run, which is named while it is pointed at.
    tab.until("document.querySelectorAll('#parallel [data-run] .run').length === 2");
    tab.value("document.querySelector('#parallel [data-run]').dispatchEvent(new Event('mouseenter'))");
    tab.until("document.querySelector('#hovered').textContent.startsWith(`run ${document.querySelector('#parallel [data-run]').dataset.run}, `)");
    tab.value("(() => { const result = document.querySelector('select[name=result]'); result.value = 'balanced.rows'; result.dispatchEvent(new Event('change')) })()");
    tab.until("location.hash.includes('result=balanced.rows')");
    let colours = "new Set([...document.querySelectorAll('#parallel .run')].map((line) => getComputedStyle(line).stroke)).size === 2";
    tab.until(colours);
    photographed(tab, "parallel");
    tab.go("about:blank");
    tab.go(&format!("http://127.0.0.1:{port}/#/runs"));
    tab.until("document.querySelectorAll('tbody tr').length === 2");
}

#[test]
fn a_planted_fault_is_found_drawn_and_marked() {
    let Some(mut tab) = Tab::open() else { return };
    let workspace = with_scene();
    let (cells, mut fields) = super::import::solved(&workspace, 6);
    fields[3 * 5202..4 * 5202].iter_mut().for_each(|value| *value *= 1.2);
    super::import::npz(&workspace.path("labels.npz"), &cells, &fields);
    let stages =
        "  labels: { kind: import, files: [labels.npz] }\n  audited: { kind: audit, needs: [labels], samples: 6 }\n";
    let pipeline = format!("version: 1\nname: wrong\nscene: scene.yaml\nstages:\n{stages}");
    workspace.write("wrong.yaml", &pipeline);
    workspace.run(&["run", "wrong.yaml"]);
    let server = Server::start(&workspace, &["serve", "wrong.yaml"]);
    tab.screen(1440, 900, "light");
    tab.go(&server.url);
    tab.click("a[href='#/audits']");
    let button = "[...document.querySelectorAll('.panel button')].find((button) => button.textContent === 'row 3')";
    tab.until(button);
    tab.value(&format!("{button}.click()"));
    tab.until("document.querySelectorAll('figcaption').length === 4");
    tab.until("document.querySelectorAll('figcaption')[3].textContent.includes('Difference: largest')");
    let caption = |k: usize, tab: &mut Tab| -> f64 {
        let text = tab.value(&format!("document.querySelectorAll('figcaption')[{k}].textContent"));
        let words: Vec<&str> = text.as_str().unwrap().split(' ').collect();
        words[words.len() - 2].parse().unwrap()
    };
    let [label, again, difference] = [1, 2, 3].map(|k| caption(k, &mut tab));
    assert!((label / again - 1.2).abs() < 0.05, "{label} and {again}");
    assert!((difference / again - 0.2).abs() < 0.05, "{difference} of {again}");
    photographed(&mut tab, "audit");
    tab.value("[...document.querySelectorAll('.panel button')].find((button) => button.textContent === 'Mark these rows').click()");
    tab.until("document.body.innerText.includes('rows marked')");
    assert_eq!(tab.complaints, Vec::<String>::new());
}
