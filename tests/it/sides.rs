//! Designs of membranes with sides that are not held, in sweeps over loads: what is compared, named and drawn.

use serde_json::Value;

use super::common::Workspace;
use super::model::check;

/// A strip with a weight, designed under one weight and simulated under two.
const STRIP: &str = r#"version: 1
name: strip
scene:
  geometry:
    size: [40 mm, 20 mm]
    thickness: 1 mm
    prestretch: 2
    cells: [20, 10]
    sides: { right: { bar: { load: ["${load}", 0 N] } }, top: free, bottom: free }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 4 kV }
  effects: {}
stages:
  design:
    foreach: { load: [0.3 N] }
    kind: design
    method: adjoint
    objective: { bar: right, direction: 0 deg }
    area: 0.5
    constraints: { keep_out: [{ rectangle: [[0 mm, 0 mm], [4 mm, 20 mm]] }] }
    starts: 1
    seed: 1
  curve:
    foreach: { load: [0.3 N, 0.9 N] }
    kind: verify
    needs: ["design@load=0.3N"]
    elements_per_cell: 1
"#;

fn strip() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("strip.yaml", STRIP);
    workspace
}

fn of_stage<'v>(results: &'v Value, name: &str) -> &'v Value {
    let stages = results["results"].as_array().unwrap();
    stages
        .iter()
        .find(|stage| stage["stage"] == name)
        .unwrap_or_else(|| panic!("{results}"))
}

#[test]
fn a_prediction_for_another_load_is_not_compared_and_each_load_is_named() {
    let workspace = strip();
    let ended = workspace.run(&["run", "strip.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let (own, other) = (
        of_stage(&document, "curve@load=0.3N"),
        of_stage(&document, "curve@load=0.9N"),
    );
    assert!(own["largest_difference"].is_f64(), "{own}");
    assert!(other["largest_difference"].is_null(), "{other}");
    for row in other["rows"].as_array().unwrap() {
        assert!(row["predicted_mm"].is_f64() && row["difference_mm"].is_null(), "{row}");
        let why = row["other_scene"].as_str().unwrap();
        assert!(why.contains("[0.3 N, 0 N] there and [0.9 N, 0 N] here"), "{why}");
    }
    assert!(
        own["rows"]
            .as_array()
            .unwrap()
            .iter()
            .all(|row| row["other_scene"].is_null())
    );
    let printed = workspace.run(&["run", "strip.yaml"]);
    assert!(!printed.stdout.contains("not accurate here"), "{}", printed.stdout);
    let listed = workspace.run(&["run", "strip.yaml", "-v"]).stdout;
    assert!(listed.contains("the predictions are for another scene"), "{listed}");

    // The intuitive designs keep out of what is kept out.
    let exported = |arguments: &[&str]| {
        let ended = workspace.run(&[&["export", "design"], arguments, &["-o", "found.csv"]].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        std::fs::read_to_string(workspace.path("found.csv")).unwrap()
    };
    for role in ["intuitive", "intuitive-equal-area"] {
        // A sweep of one stage is that stage.
        let cells = exported(&["strip.yaml:design", "--role", role]);
        let is_bare = |line: &str| line.split(',').take(2).all(|cell| cell.trim() == "0");
        let rows: Vec<&str> = cells.lines().filter(|line| !line.starts_with('#')).collect();
        assert_eq!(rows.len(), 10, "{cells}");
        assert!(rows.iter().all(|line| is_bare(line)) && cells.contains('1'), "{cells}");
    }
    let refused = workspace.run(&["export", "design", "strip.yaml:curve", "-o", "found.csv"]);
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("is a sweep of 2 stages"), "{}", refused.stderr);

    let report = workspace.run(&["report", "strip.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    for part in [
        // Tables and titles name the load.
        ">load=0.9N<",
        "design, load=0.3N<",
        "design, load=0.9N<",
        "id=\"design-load-0.9N-optimum\"",
        // Drawings tell the sides apart.
        "class=\"clamp\"",
        "class=\"free\"",
        "class=\"bar\"",
        "class=\"load\"",
        "a thick dark line is a rigid bar",
        "count from rest",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("not accurate there"));
}

#[test]
fn the_genetic_algorithm_keeps_the_area_of_strokes() {
    let workspace = Workspace::new();
    let (strip, _) = STRIP.split_once("  curve:").unwrap();
    workspace.write("strip.yaml", strip);
    // An electrode everywhere moves the bar by 18 mm, and half of it by less than 9 mm: each 1 % of area gains more
    // than the 0.125 mm of the penalty in mm.
    let searched = "stages.design={ kind: design, method: ga, evaluator: newton, objective: { bar: right, direction: 0 \
                    deg }, area: 0.5, population: 100, generations: 40, seed: 1 }";
    let large = "scene.geometry={ size: [300 mm, 100 mm], thickness: 0.5 mm, prestretch: 2, cells: [20, 10], sides: { \
                 right: { bar: { load: [3 N, 0 N] } }, top: free, bottom: free } }";
    let drive = "scene.drive.voltage=3.9 kV";
    let ended = workspace.run(&[
        "run",
        "strip.yaml",
        "--until",
        "design",
        "--set",
        searched,
        "--set",
        large,
        "--set",
        drive,
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let shown = workspace.run(&["show", "design", "--csv"]).stdout;
    let mut lines = shown.lines();
    assert!(
        lines
            .next()
            .is_some_and(|header| header.starts_with("area,area_target,")),
        "{shown}"
    );
    let row = lines.next().unwrap();
    let numbers = [row.split(',').next(), row.rsplit(',').next()];
    let [area, value] = numbers.map(|number| number.unwrap().parse::<f64>().unwrap());
    assert!((area - 0.5).abs() <= 0.02 && value > 5.0, "{shown}");
}

#[test]
fn membranes_that_nothing_holds_need_loads_in_balance() {
    let workspace = Workspace::new();
    workspace.write(
        "sheet.yaml",
        "geometry: { size: [20 mm, 10 mm], thickness: 1 mm, prestretch: 2, cells: [4, 2], sides: { left: free, right: \
         free, top: free, bottom: free } }\nmaterial: { model: neo-hookean, shear_modulus: 45 kPa, \
         relative_permittivity: 4.7 }\ndrive: { voltage: 4 kV }\n",
    );
    workspace.write("half.csv", "1,1,0,0\n1,1,0,0\n");
    let solve = |sides: &str, more: &[&str]| {
        let set = format!("geometry.sides={{ {sides}, top: free, bottom: free }}");
        let arguments = ["solve", "sheet.yaml", "half.csv", "--set", &set];
        workspace.run(&[&arguments[..], more].concat())
    };
    let both = |left: &str, right: &str| format!("left: {{ load: [{left}] }}, right: {{ load: [{right}] }}");
    for (sides, said) in [
        (
            "left: free, right: free".to_owned(),
            "nothing holds the membrane along x and y, and nothing keeps it from turning: its mean displacement and \
             its mean turn are zero",
        ),
        (
            "left: roller, right: free".to_owned(),
            "nothing holds the membrane along y: its mean displacement along it is zero",
        ),
        (
            both("-0.1 N, 0 N", "0.1 N, 0 N"),
            "nothing holds the membrane along x and y: its mean displacement is zero",
        ),
    ] {
        let ended = solve(&sides, &["--no-checks"]);
        assert!(
            ended.code == Some(0) && ended.stdout.contains(said),
            "{} {}",
            ended.stdout,
            ended.stderr
        );
    }
    for (sides, more, said) in [
        (
            both("0.1 N, 0 N", "0.1 N, 0 N"),
            &[][..],
            "nothing holds the membrane along x",
        ),
        (
            both("0 N, 0.1 N", "0 N, -0.1 N"),
            &[][..],
            "nothing keeps the membrane from turning",
        ),
        (
            both("-0.1 N, 0 N", "0.1 N, 0 N"),
            &["--path=load", "-o", "path.h5"][..],
            "which is not simulated with a path of the load",
        ),
    ] {
        let ended = solve(&sides, more);
        assert!(
            ended.code == Some(2) && ended.stderr.contains(said),
            "{} {}",
            ended.stdout,
            ended.stderr
        );
    }
}

/// The strip with its bar held in its place.
fn blocked() -> Workspace {
    let workspace = Workspace::new();
    let strip = STRIP
        .replace(
            "objective: { bar: right, direction: 0 deg }",
            "objective: { reaction: right, direction: 180 deg }",
        )
        .replace(
            "bar: { load: [\"${load}\", 0 N] }",
            "bar: { displacement: [0 mm, 0 mm] }",
        );
    let (design, verify) = strip.split_once("  curve:").unwrap();
    let verify = verify
        .replace("foreach: { load: [0.3 N, 0.9 N] }\n    ", "")
        .replace("design@load=0.3N", "design");
    let design = design.replace("foreach: { load: [0.3 N] }\n    ", "");
    let table = "  table: { kind: table, needs: [curve], columns: [curve.reaction, curve.predicted_reaction] }\n";
    workspace.write("blocked.yaml", &format!("{design}  curve:{verify}{table}"));
    workspace
}

#[test]
fn a_blocked_force_is_designed_and_verified_in_mn() {
    let workspace = blocked();
    let ended = workspace.run(&["run", "blocked.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let verified = of_stage(&document, "curve");
    assert_eq!(verified["unit"], "mN");
    let rows = verified["rows"].as_array().unwrap();
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row}"));
    for row in rows {
        assert!(
            row["simulated_mm"].is_null() && row.get("predicted_mm").is_none(),
            "{row}"
        );
        // The search has one biquadratic element in a cell, the stage one bilinear one.
        let (predicted, simulated) = (number(row, "predicted_mN"), number(row, "simulated_mN"));
        assert!((predicted / simulated - 1.0).abs() < 0.05, "{row}");
    }
    let of_role = |role: &str| rows.iter().find(|row| row["role"] == role).unwrap();
    let found = number(of_role("optimum"), "simulated_mN");
    assert!(found > 2.0 && found > number(of_role("intuitive-equal-area"), "simulated_mN"));

    // It is the change of what `solve` writes.
    let exported = workspace.run(&[
        "export",
        "design",
        "blocked.yaml:curve",
        "--role",
        "optimum",
        "-o",
        "best.csv",
    ]);
    assert_eq!(exported.code, Some(0), "{}", exported.stderr);
    let (scene, _) = STRIP.split_once("stages:").unwrap();
    let scene = scene
        .split_once("scene:\n")
        .unwrap()
        .1
        .replace("[\"${load}\", 0 N]", "[0.3 N, 0 N]");
    workspace.write(
        "scene.yaml",
        &scene
            .lines()
            .map(|line| format!("{}\n", &line[2..]))
            .collect::<String>(),
    );
    let force = |voltage: &str| {
        let drive = format!("drive.voltage={voltage}");
        let bar = "geometry.sides.right={ bar: { displacement: [0 mm, 0 mm] } }";
        let arguments = [
            "solve",
            "scene.yaml",
            "best.csv",
            "--no-checks",
            "--elements-per-cell",
            "1",
        ];
        let set = ["--set", &drive, "--set", bar, "-o", "out.h5"];
        let ended = workspace.run(&[&arguments[..], &set].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
        file.dataset("reaction").unwrap().read_raw::<f64>().unwrap()[2]
    };
    let change = 1e3 * (force("1 mV") - force("4 kV"));
    assert!((change - found).abs() < 1e-6 * found, "{change} {found}");

    let text = workspace.run(&["run", "blocked.yaml", "-v"]).stdout;
    assert!(
        text.contains("change of the force of sides") && text.contains(" mN"),
        "{text}"
    );
    let headline = text.lines().find(|line| line.contains("best design (gradient search)"));
    assert!(
        headline.is_some_and(|line| line.contains(" mN") && !line.contains(" mm,")),
        "{text}"
    );
    let shown = workspace.run(&["show", "blocked.yaml:table", "--csv"]).stdout;
    let cells = shown.lines().last().unwrap().split(',').collect::<Vec<_>>();
    assert!((cells[0].parse::<f64>().unwrap() - found).abs() < 1e-9, "{shown}");
    let report = workspace.run(&["report", "blocked.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    assert!(
        page.contains("Objective: change of the force of the right side on the membrane at 180°"),
        "{page}"
    );
    let table = std::fs::read_to_string(workspace.path("report/data/designs.csv")).unwrap();
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    assert!(header.contains(&"simulated_mN"), "{header:?}");
}

#[test]
fn objectives_of_forces_are_refused_where_there_are_none() {
    let workspace = blocked();
    for (set, expected) in [
        (
            "scene.geometry.sides.right={ bar: { load: [0.3 N, 0 N] } }",
            "moves freely along x, so its force along x is only its load",
        ),
        ("stages.curve.history={ at: [1 s] }", "which is that of an equilibrium"),
        (
            "stages.design.objective={ reaction: top, direction: 90 deg }",
            "the top side does not hold",
        ),
        (
            "stages.design.objective={ reaction: right, direction: 0 deg, value: 1 mm }",
            "unknown key `value`",
        ),
        (
            "stages.design.objective={ points: [{ reaction: right, direction: 0 deg }, { bar: right, direction: 0 deg }] }",
            "either motions, in mm, or reactions, in mN",
        ),
    ] {
        let ended = workspace.run(&["plan", "blocked.yaml", "--set", set]);
        assert_eq!(ended.code, Some(2), "{set}: {}", ended.stdout);
        assert!(ended.stderr.contains(expected), "{set}: {}", ended.stderr);
    }
}

/// A strip with a weight, learned by a network that then designs it.
const LEARNED: &str = "\
version: 1
name: learned
scene:
  geometry:
    size: [40 mm, 20 mm]
    thickness: 1 mm
    prestretch: 2
    cells: [20, 10]
    sides: { right: { bar: { load: [0.5 N, 0 N] } }, top: free, bottom: free }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 5 kV }
  effects: {}
stages:
  drawn:   { kind: sample, family: blobs, count: 80, seed: 1 }
  fresh:   { kind: sample, family: blobs, count: 40, seed: 2 }
  solved:  { kind: solve, needs: [drawn], elements_per_cell: 1 }
  unseen:  { kind: solve, needs: [fresh], elements_per_cell: 1 }
  network: { kind: train, needs: [solved], network: qin2024, epochs: 30, symmetry: d4, seed: 3 }
  judged:  { kind: evaluate, needs: [network, unseen] }
  best:    { kind: design, needs: [network], evaluator: surrogate, objective: { bar: right, direction: 0 deg }, area: 0.5, population: 40, generations: 8, refine: false, seed: 4 }
  checked: { kind: verify, needs: [best], elements_per_cell: 1 }
";

#[test]
fn networks_learn_strokes_of_strips_and_design_them() {
    let workspace = Workspace::new();
    workspace.write("learned.yaml", LEARNED);
    let ended = workspace.run(&["run", "learned.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let evaluation = &document["evaluations"][0];
    assert!(
        evaluation["predictors"][0]["r2"][1]
            .as_f64()
            .is_some_and(|r2| r2 > 0.95),
        "{evaluation}"
    );
    let rows = of_stage(&document, "checked")["rows"].as_array().unwrap();
    let best = rows.iter().find(|row| row["role"] == "ga").unwrap();
    let [predicted, simulated] = ["predicted_mm", "simulated_mm"].map(|key| best[key].as_f64().unwrap());
    assert!((predicted - simulated).abs() < 0.15 * simulated, "{best}");

    // Held sides do not move, and the bar does.
    workspace.write("half.csv", &"0,0,0,0,1,1,1,1,1,1,1,1,1,1,1,1,0,0,0,0\n".repeat(10));
    let ended = workspace.run(&["predict", "learned.yaml:network", "half.csv", "-o", "said.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("said.h5")).unwrap();
    let values = file.dataset("displacement").unwrap().read_raw::<f64>().unwrap();
    let at = |x: usize, y: usize| [values[2 * (21 * y + x)], values[2 * (21 * y + x) + 1]];
    assert!(
        (0..11).all(|y| at(0, y) == [0.0; 2]) && at(20, 5)[0] > 0.01,
        "{values:?}"
    );

    let ended = workspace.run(&["export", "model", "learned.yaml:network", "-o", "model.onnx"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let (agrees, said) = check(&workspace, "model.onnx", "said.h5");
    assert!(agrees && !said.contains("moved 0.0\n"), "{said}");

    for (set, expected) in [
        (
            "stages.network.network=physics",
            "network physics has the linear response of a membrane",
        ),
        (
            "stages.best.objective={ reaction: left, direction: 0 deg }",
            "networks cannot predict forces of sides",
        ),
        (
            "stages.network.needs=[balanced]",
            "the displacements of `balanced` count from the mount",
        ),
    ] {
        let balanced =
            "  balanced: { kind: balance, needs: [solved], bins: 5, range: [0 mm, 30 mm], target: 40, seed: 1 }\n";
        workspace.write("refused.yaml", &format!("{LEARNED}{balanced}"));
        let ended = workspace.run(&["plan", "refused.yaml", "--set", set]);
        assert_eq!(ended.code, Some(2), "{set}: {}", ended.stdout);
        assert!(ended.stderr.contains(expected), "{set}: {}", ended.stderr);
    }
}

#[test]
fn a_mass_without_a_load_is_said_to_do_nothing_in_an_equilibrium() {
    let workspace = Workspace::new();
    let scene = |bar: &str| {
        format!(
            "geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 2, cells: [20, 10], sides: \
             {{ right: {{ bar: {{ {bar} }} }}, top: free, bottom: free }} }}\n\
             material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}\n\
             drive: {{ voltage: 2 kV }}\neffects: {{}}\n"
        )
    };
    let ones = format!("{}\n", vec!["1"; 20].join(",")).repeat(10);
    workspace.write("ones.csv", &ones);
    let masses = |bar: &str| {
        workspace.write("scene.yaml", &scene(bar));
        let ended = workspace.run(&["solve", "scene.yaml", "ones.csv", "--json"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let warnings = ended.json()["warnings"].as_array().unwrap().clone();
        let warnings = warnings
            .into_iter()
            .filter(|warning| warning.to_string().contains("the mass"));
        warnings.collect::<Vec<_>>()
    };
    let told =
        "the mass of the bar on the right side does not act in an equilibrium: 20.00 g weigh 0.1962 N; write `load`";
    assert_eq!(masses("mass: 20 g, spring: 20 N/m"), [told]);
    assert_eq!(masses("mass: 20 g, load: [0.2 N, 0 N]"), Vec::<Value>::new());
}

#[test]
fn displacements_say_whether_they_count_from_the_mount_or_from_rest() {
    let workspace = Workspace::new();
    let scene = "geometry:
  size: [40 mm, 20 mm]
  thickness: 1 mm
  prestretch: 2
  cells: [20, 10]
  sides: { right: { bar: { load: [0.3 N, 0 N] } }, top: free, bottom: free }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 4 kV }
effects: {}
tolerances: { thickness: 1 % }
";
    workspace.write("strip.yaml", scene);
    workspace.write("full.csv", &"1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1\n".repeat(10));
    let run = |command: &str, more: &[&str]| {
        let point = [
            "strip.yaml",
            "full.csv",
            "--point",
            "40 mm, 10 mm",
            "--direction",
            "0 deg",
        ];
        let ended = workspace.run(&[&[command], &point[..], more].concat());
        assert_eq!(ended.code, Some(0), "{ended}");
        ended
    };
    let mesh = ["--elements-per-cell", "1"];
    let solved = run("solve", &[&mesh[..], &["--json"]].concat()).json()["patterns"][0].clone();
    let number = |key: &str| solved[key].as_f64().unwrap_or_else(|| panic!("{solved}"));
    let (mount, rest) = (number("along_mm"), number("along_from_rest_mm"));
    assert!((mount - rest).abs() > 0.1, "{mount} {rest}");
    // The middle of the bar is at the point.
    let bar = &solved["bars"]["right"];
    assert!((bar["from_rest_mm"][0].as_f64().unwrap() - rest).abs() < 1e-9, "{bar}");
    let drawn = run("yield", &[&mesh[..], &["--samples", "2", "--json"]].concat()).json();
    assert_eq!(drawn["patterns"][0]["as_drawn_mm"].as_f64(), Some(rest));
    let told = run("solve", &mesh).stdout;
    for words in [
        "largest displacement from the mount",
        "along 0 deg from the mount",
        "from rest",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
    let told = run("yield", &[&mesh[..], &["--samples", "2"]].concat()).stdout;
    assert!(told.contains("along 0 deg from rest of each device"), "{told}");
    // A path of the load starts without it, at the voltage.
    for (path, words) in [
        ("--path", "along 0 deg from rest "),
        ("--path=load", "along 0 deg from the state without load "),
    ] {
        let told = run("solve", &[&mesh[..], &[path, "-o", "path.h5"]].concat()).stdout;
        assert!(told.contains(words), "{words}: {told}");
    }
}

#[test]
fn warnings_about_small_membranes_have_enough_work() {
    let workspace = Workspace::new();
    let scene = "geometry:\n  size: [40 mm, 10 mm]\n  thickness: 1 mm\n  prestretch: 1\n  cells: [20, 5]\n  sides: { left: \
                 roller, bottom: roller, right: { bar: { load: [0.5 N, 0 N], moves: [x] } }, top: free }\nmaterial: { \
                 model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }\ndrive: { voltage: 4 kV }\n";
    workspace.write("strip.yaml", scene);
    workspace.write("full.csv", &format!("{}\n", ["1"; 20].join(",")).repeat(5));
    let ended = workspace.run(&["solve", "strip.yaml", "full.csv"]);
    assert_eq!(ended.code, Some(0), "{ended}");
    assert!(!ended.stdout.contains("work limit"), "{}", ended.stdout);
    // The state under the load is stretched by 1.5, the mount is not.
    let screened = workspace.run(&["screen", "strip.yaml", "full.csv"]).stdout;
    assert!(!screened.contains("Jm < 0"), "{screened}");
}
