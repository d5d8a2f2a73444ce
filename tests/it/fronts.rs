//! Fronts of two and three objectives: known answers, their artifacts, and what is said of ends and of objectives that
//! agree.

use serde_json::Value;

use super::common::{Ended, Stages, Transcript, Workspace, scene_file, scene_of_20_cells, snapshot};

/// A pipeline with a front on 20 × 20 units.
fn workspace(front: &str) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("p.yaml", &pipeline(front));
    workspace
}

/// The same on a membrane of 20 × 20 cells.
fn coarse(front: &str) -> Workspace {
    let workspace = workspace(front);
    workspace.write("scene.yaml", &scene_of_20_cells());
    workspace
}

fn pipeline(front: &str) -> String {
    format!(
        "version: 1
name: p
scene: scene.yaml
stages:
  front: {{ kind: design, units: 20, starts: 2, seed: 1, {front} }}
"
    )
}

const POINT: &str = "{ point: [25 mm, 25 mm], direction: 0 deg }";

fn against_area(area: &str, points: usize) -> String {
    format!("objectives: [{POINT}, {{ area: least{area} }}], pareto: {{ points: {points} }}")
}

fn found(ended: &Ended) -> Value {
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    ended.json()["fronts"][0].clone()
}

fn points(front: &Value) -> Vec<(f64, f64)> {
    let number = |point: &Value, key: &str| point[key].as_f64().unwrap();
    let points = front["points"].as_array().unwrap().iter();
    points
        .map(|point| (number(point, "area"), number(point, "gain")))
        .collect()
}

#[test]
fn a_front_of_displacement_against_area_reaches_the_known_one() {
    let front_of_nine = against_area(", within: [0.04, 0.36], reference: 0.5", 9);
    let workspace = workspace(&front_of_nine);
    let ended = workspace.run(&["run", "p.yaml", "--json", "--jobs", "2"]);
    let front = found(&ended);
    let found = points(&front);
    assert_eq!(found.len(), 9, "{front}");
    // An independent program with gradient search at the same areas, and the same reference.
    let reached = front["hypervolume"].as_f64().unwrap();
    assert!(reached >= 0.99 * 0.88990, "{front}");
    assert_eq!(front["others"], serde_json::json!([]));
    for (k, pair) in (1..).zip(found.windows(2)) {
        assert!(pair[1].0 > pair[0].0 && pair[1].1 > pair[0].1, "{front}");
        assert!(pair[0].0 <= 0.04 * f64::from(k) + 1e-9, "{front}");
    }
    let listed = listed(&workspace, "hypervolume, area.front-9");
    assert!(
        (listed[0] - reached).abs() < 1e-6 && (listed[1] - found[8].0).abs() < 1e-6,
        "{listed:?}"
    );

    // Another number of threads gives the same bits.
    workspace.write("p.yaml", &pipeline(&front_of_nine));
    let again = workspace.stages(&["run", "p.yaml", "--store", "other", "--jobs", "1"]);
    assert_eq!(again.digests(), Stages::read(&ended.json()).digests());
}

/// Results of the front of a pipeline, as a table has them.
fn listed(workspace: &Workspace, columns: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(workspace.path("p.yaml")).unwrap();
    let table = format!("  listed: {{ kind: table, needs: [front], columns: [{columns}] }}\n");
    workspace.write("p.yaml", &(text + &table));
    assert_eq!(workspace.run(&["run", "p.yaml"]).code, Some(0));
    let shown = workspace.run(&["show", "p.yaml:listed", "--csv"]).stdout;
    let numbers = shown.lines().nth(1).unwrap().split(',');
    numbers.map(|number| number.parse().unwrap()).collect()
}

#[test]
fn the_genetic_algorithm_comes_near_the_known_front() {
    let front = format!(
        "objectives: [{POINT}, {{ area: least, reference: 0.5 }}], pareto: {{ points: 9, method: nsga2 }},
      evaluator: newton, population: 60, generations: 25"
    );
    let workspace = workspace_of_genetic(&front);
    let ended = workspace.run(&["run", "p.yaml", "--json"]);
    let front = found(&ended);
    let found = points(&front);
    // An independent program with the same population and generations, seeded in the same way: 0.918.
    let reached = front["hypervolume"].as_f64().unwrap();
    assert!(found.len() == 9 && reached > 0.9, "{front}");
    assert!(
        found
            .windows(2)
            .all(|pair| pair[1].0 > pair[0].0 && pair[1].1 > pair[0].1),
        "{front}"
    );
    // The designs that are kept make up most of it.
    let (mut volume, mut from) = (0.0, 0.0);
    for (at, &(area, _)) in found.iter().enumerate() {
        volume += if at == 0 { 0.0 } else { found[at - 1].1 * (area - from) };
        from = area;
    }
    volume += found[8].1 * (0.5 - from);
    assert!(volume > 0.95 * reached && volume <= reached, "{volume} {front}");
    let listed = listed(&workspace, "hypervolume, area.front-9");
    assert!((listed[0] - reached).abs() < 1e-6, "{listed:?}");
}

/// A pipeline with a front of the genetic algorithm.
fn workspace_of_genetic(front: &str) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("p.yaml", &genetic(front));
    workspace
}

fn genetic(front: &str) -> String {
    pipeline("").replace("units: 20, starts: 2, seed: 1, ", &format!("seed: 1, {front}"))
}

/// One point moves, another one stays, and the area is small.
const THREE: &str = "objectives: [{ area: least, reference: 0.6 }, { point: [25 mm, 25 mm], direction: 0 deg },
      { point: [37.5 mm, 25 mm], displacement: [0 mm, 0 mm] }], population: 40, generations: 6, evaluator: newton";

#[test]
fn a_front_of_three_objectives_is_verified_drawn_and_exported() {
    let front = format!("{THREE}, pareto: {{ points: 6, method: nsga2 }}");
    let workspace = coarse("");
    let verified = "  verified: { kind: verify, needs: [front], elements_per_cell: 1 }\n";
    workspace.write("p.yaml", &(genetic(&front) + verified));
    let ended = workspace.run(&["run", "p.yaml", "--json"]);
    let front = found(&ended);
    let all = front["points"].as_array().unwrap();
    assert_eq!(
        (all.len(), &front["hypervolume_unit"]),
        (6, &serde_json::json!("mm^2")),
        "{front}"
    );
    let values = |point: &Value| -> Vec<f64> {
        let values = point["values"].as_array().unwrap().iter();
        values.map(|value| value.as_f64().unwrap()).collect()
    };
    let all: Vec<Vec<f64>> = all.iter().map(values).collect();
    for one in &all {
        // The first two objectives of the file are the area, which is the second of the front, and the displacement.
        let is_better = |other: &Vec<f64>| {
            let pairs = [other[0] >= one[0], other[1] <= one[1], other[2] >= one[2]];
            pairs == [true; 3] && other != one
        };
        assert!(!all.iter().any(is_better), "{front}");
        assert!(one[0] > 0.0 && one[1] > 0.0 && one[2] <= 0.0, "{front}");
    }
    let objectives = front["objectives"].as_array().unwrap();
    assert_eq!(objectives[1]["objective"], "{ area: least }", "{front}");
    assert!(
        objectives[2]["objective"]
            .as_str()
            .unwrap()
            .contains("displacement: [0"),
        "{front}"
    );

    // One more point keeps the others.
    workspace.write(
        "p.yaml",
        &(genetic(&format!("{THREE}, pareto: {{ points: 7, method: nsga2 }}")) + verified),
    );
    let ended = workspace.run(&["run", "p.yaml", "--json", "--jobs", "2"]);
    let more = found(&ended);
    let more: Vec<Vec<f64>> = more["points"].as_array().unwrap().iter().map(values).collect();
    assert!(more.len() == 7 && all.iter().all(|one| more.contains(one)), "{more:?}");

    let said = workspace.run(&["run", "p.yaml", "-v"]).stdout;
    assert!(
        said.contains("front: front of 7 points in ") && said.contains(" and −"),
        "{said}"
    );
    let mask = workspace.run(&[
        "export",
        "design",
        "p.yaml:front",
        "--design",
        "front-2",
        "-o",
        "mask.svg",
    ]);
    assert_eq!(mask.code, Some(0), "{}", mask.stderr);
    let report = workspace.run(&["report", "p.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    assert!(page.contains("Front: displacement against area") && page.contains("Third objective [mm]"));

    // Another number of threads gives the same bits.
    let again = workspace.stages(&["run", "p.yaml", "--until", "front", "--store", "other", "--jobs", "3"]);
    let digest = |stages: &Stages| stages.stage("front")["digest"].clone();
    assert_eq!(digest(&again), digest(&Stages::read(&ended.json())));
}

#[test]
fn the_points_of_a_front_are_verified_and_exported_like_designs() {
    let workspace = coarse("");
    let text = pipeline(&against_area("", 3))
        + "  verified: { kind: verify, needs: [front], elements_per_cell: 1 }
  listed: { kind: table, needs: [verified], columns: [area.front-1, displacement.front-1, displacement.front-3] }
";
    workspace.write("p.yaml", &text);
    let ended = workspace.run(&["run", "p.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let shown = workspace.run(&["run", "p.yaml", "-v"]).stdout;
    assert!(shown.contains("front: front of 3 points in "), "{shown}");
    let row = workspace.run(&["show", "p.yaml:listed", "--csv"]).stdout;
    let numbers = row.lines().nth(1).unwrap().split(',');
    let numbers: Vec<f64> = numbers.map(|number| number.parse().unwrap()).collect();
    assert!(numbers[0] < 0.13 && numbers[1] < numbers[2], "{row}");
    let export = |more: &[&str]| {
        let arguments = ["export", "design", "p.yaml:front", "-o", "mask.svg"];
        workspace.run(&[&arguments[..], more].concat())
    };
    assert_eq!(export(&["--design", "front-2"]).code, Some(0));
    let unnamed = export(&[]);
    assert_eq!(unnamed.code, Some(2), "{}", unnamed.stdout);
    assert!(
        unnamed.stderr.contains("designs of several targets match"),
        "{}",
        unnamed.stderr
    );
    let report = workspace.run(&["report", "p.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    assert!(page.contains("Front: displacement") && page.contains("Hypervolume over the search"));
    let figures = super::common::files(&workspace.path("store/figures"));
    assert!(
        figures.iter().any(|file| file.to_string_lossy().contains("front")),
        "{figures:?}"
    );
}

#[test]
fn objectives_that_agree_give_one_point() {
    // The best design of any area has 37 % of it, so that no larger limit changes it.
    let workspace = coarse(&against_area(", within: [0.6, 0.9]", 3));
    let ended = workspace.run(&["run", "p.yaml", "--json"]);
    let front = found(&ended);
    assert_eq!(points(&front).len(), 1, "{front}");
    let others = front["others"].as_array().unwrap();
    assert_eq!(others.len(), 2, "{front}");
    assert!(
        others.iter().all(|other| other["why"] == "front-1 is at least as good"),
        "{front}"
    );
    let said = workspace.run(&["run", "p.yaml"]).stdout;
    assert!(said.contains("the objectives agree: one point"), "{said}");
}

#[test]
fn limits_without_a_design_are_said() {
    // No square of 10 mm has less than 4 % of the membrane.
    let front = against_area(", within: [0.01, 0.31]", 4) + ", constraints: { min_feature: 10 mm }";
    let workspace = coarse(&front);
    let ended = workspace.run(&["run", "p.yaml", "--json"]);
    let front = found(&ended);
    let others = front["others"].as_array().unwrap();
    assert_eq!(others.len(), 1, "{front}");
    let why = others[0]["why"].as_str().unwrap();
    assert!(
        others[0]["limit"] == 0.01 && why.starts_with("no design: each pattern"),
        "{front}"
    );
    assert_eq!(points(&front).len(), 3, "{front}");
    let said = workspace.run(&["run", "p.yaml"]).stdout;
    assert!(said.contains("no design within 1 of the limits"), "{said}");

    // Without any design, the stage fails.
    workspace.write(
        "p.yaml",
        &pipeline(&(against_area(", within: [0.01, 0.02]", 2) + ", constraints: { min_feature: 10 mm }")),
    );
    let failed = workspace.run(&["run", "p.yaml"]);
    assert_eq!(failed.code, Some(1), "{}", failed.stdout);
    assert!(
        failed.stderr.contains("cannot satisfy the target area"),
        "{}",
        failed.stderr
    );
}

#[test]
fn what_does_not_go_with_two_objectives_is_refused() {
    let area = against_area("", 3);
    let mut refused = Transcript::default();
    for front in [
        format!("objective: {POINT}, {area}"),
        format!("{area}, area: 0.4"),
        format!("{area}, method: ga"),
        format!("{area}, designs: 3"),
        format!("{area}, population: 40"),
        format!("objectives: [{POINT}, {POINT}]"),
        "objectives: [{ area: least }, { area: least }]".to_owned(),
        format!("objectives: [{POINT}]"),
        format!("objective: {POINT}, pareto: {{ points: 3 }}"),
        against_area(", within: [0.5, 0.2]", 3),
        format!("objectives: [{POINT}, {{ area: most }}]"),
        format!("objectives: [{POINT}, {{ charge: least }}, {{ area: least }}]"),
    ] {
        refused.add(&front, workspace(&front).refused(&["plan", "p.yaml"]));
    }
    let nsga2 = "pareto: { method: nsga2 }";
    for front in [
        format!("objectives: [{{ area: least }}, {POINT}, {{ area: least }}], {nsga2}"),
        format!("objectives: [{{ area: least }}, {{ charge: least }}], {nsga2}"),
        format!("objectives: [{POINT}, {{ area: least }}], {nsga2}, starts: 2"),
        format!("objectives: [{POINT}, {{ area: least, within: [10 %, 20 %] }}], {nsga2}"),
        format!("objectives: [{POINT}, {{ area: least }}], {nsga2}, refine: true"),
        format!("objectives: [{POINT}, {{ area: least }}], {nsga2}, method: adjoint"),
        format!("objectives: [{POINT}, {{ charge: least }}], {nsga2}, evaluator: linear"),
        format!("objectives: [{POINT}, {{ point: [20 mm, 20 mm], direction: 0 deg, time: 1 s }}], {nsga2}"),
        format!(
            "objectives: [{{ area: least }}, {{ point: [25, 25], direction: 0, robust: {{ worst: [0 mm] }} }}], {nsga2}"
        ),
    ] {
        refused.add(&front, workspace_of_genetic(&front).refused(&["plan", "p.yaml"]));
    }
    snapshot!(refused);
}

#[test]
fn a_front_of_displacement_against_charge_keeps_to_its_limits() {
    // An independent program: 1303 to 2153 nC by weights of the charge, which at 20 × 20 units moves the centre by up
    // to 2.2406 mm (36 % of the area).
    let charge = "charge: least, within: [1303 nC, 2.153 uC], reference: 2779 nC";
    let workspace = workspace(&format!(
        "objectives: [{{ {charge} }}, {POINT}], pareto: {{ points: 4 }}"
    ));
    let ended = workspace.run(&["run", "p.yaml", "--json"]);
    let front = found(&ended);
    let points: Vec<(f64, f64)> = front["points"].as_array().unwrap().iter().map(charged).collect();
    assert_eq!(points.len(), 4, "{front}");
    for (k, &(charge, gain)) in points.iter().enumerate() {
        let limit = 1303.0 + 850.0 * k as f64 / 3.0;
        // Units of 2 × 2 to 3 × 3 cells take up to 1 % of the charge, and change several at a time.
        assert!((0.96 * limit..=limit + 0.06).contains(&charge), "{front}");
        assert!(k == 0 || gain > points[k - 1].1, "{front}");
    }
    assert!(points[3].1 > 0.99 * 2.2406, "{front}");
    let listed = listed(&workspace, "charge.front-1, charge_hypervolume");
    assert!(
        (listed[0] - points[0].0).abs() < 1e-3 && listed[1] > 3000.0,
        "{listed:?}"
    );
    let said = workspace.run(&["run", "p.yaml", "-v"]).stdout;
    assert!(said.contains("mm nC (reference: 0 mm, 2779 nC)"), "{said}");
}

/// Charge and gain of a point.
fn charged(point: &Value) -> (f64, f64) {
    let number = |key: &str| point[key].as_f64().unwrap();
    (number("charge_nc"), number("gain"))
}

#[test]
fn a_charge_needs_one_voltage_and_one_state() {
    let workspace =
        workspace("objectives: [{ point: [25 mm, 25 mm], direction: 0 deg, time: 1 s }, { charge: least }]");
    let refused = workspace.refused(&["plan", "p.yaml"]);
    assert!(refused.contains("`charge: least` is not possible here"), "{refused}");
    workspace.write(
        "p.yaml",
        &pipeline(&format!("objectives: [{POINT}, {{ charge: least }}]")),
    );
    for (drive, why) in [
        ("drive: { charge: { total: 1 uC } }", "the drive is a charge"),
        ("drive: { voltages: [5 kV, 4 kV] }", "the device has several voltages"),
    ] {
        let scene: String = scene_file()
            .lines()
            .map(|line| {
                if line.starts_with("drive:") {
                    format!("{drive}\n")
                } else {
                    format!("{line}\n")
                }
            })
            .collect();
        workspace.write("scene.yaml", &scene);
        let refused = workspace.refused(&["plan", "p.yaml"]);
        assert!(refused.contains(why), "{refused}");
    }
}
