//! `solve` simulates patterns of the user and reports patterns without a solution.

use std::process::Command;

use super::common::{Transcript, Workspace, csv, size_of_png, snapshot};

const SCENE: &str = "geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: VOLTAGE }
effects: {}
";

fn workspace(voltage: &str) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &SCENE.replace("VOLTAGE", voltage));
    workspace
}

fn column(workspace: &Workspace, file: &str, path: &str) -> Vec<f64> {
    let file = hdf5::File::open(workspace.path(file)).unwrap();
    file.dataset(path).unwrap().read_raw::<f64>().unwrap()
}

fn relative_rms(a: &[f64], b: &[f64]) -> f64 {
    let difference: f64 = a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum();
    (difference / b.iter().map(|y| y * y).sum::<f64>()).sqrt()
}

#[test]
fn two_elements_per_cell_are_within_one_percent_of_a_converged_solution() {
    let workspace = workspace("5.25 kV");
    workspace.write("stripes.csv", &csv(|x, _| x / 5 % 2 == 0));
    workspace.write("disc.csv", &csv(|x, y| (x as f64 - 20.0).hypot(y as f64 - 26.0) < 13.0));
    workspace.write("blocks.csv", &csv(|x, y| (x / 5 * 7 + y / 5 * 11) % 13 < 6));
    let patterns = ["stripes.csv", "disc.csv", "blocks.csv"];
    for (elements, file) in [("2", "coarse.h5"), ("8", "fine.h5")] {
        let options = ["-o", file, "--elements-per-cell", elements];
        let ended = workspace.run(&[&["solve", "scene.yaml"], &patterns[..], &options].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }
    let (coarse, fine) = (
        column(&workspace, "coarse.h5", "displacement"),
        column(&workspace, "fine.h5", "displacement"),
    );
    for (i, (a, b)) in coarse.chunks(51 * 51 * 2).zip(fine.chunks(51 * 51 * 2)).enumerate() {
        let error = relative_rms(a, b);
        assert!(error < 0.01 && error > 1e-7, "{}: {error}", patterns[i]);
    }
    assert!(
        column(&workspace, "coarse.h5", "solve_seconds")
            .iter()
            .all(|&s| s > 0.0)
    );
}

#[test]
fn an_unstable_pattern_gets_its_outcome_and_no_numbers() {
    let workspace = workspace("14 kV");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    workspace.write("bare.csv", &csv(|_, _| false));
    let ended = workspace.run(&["solve", "scene.yaml", "half.csv", "bare.csv", "-o", "out.h5", "--json"]);
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let report = ended.json();
    assert_eq!(report["unstable"], 1, "{report}");
    let displacement = column(&workspace, "out.h5", "displacement");
    let (unstable, bare) = displacement.split_at(51 * 51 * 2);
    assert!(unstable.iter().all(|u| u.is_nan()));
    assert!(bare.iter().all(|&u| u == 0.0), "a bare membrane does not move");
    let largest = column(&workspace, "out.h5", "max_displacement");
    assert!(largest[0].is_nan() && largest[1] == 0.0);
}

#[test]
fn patterns_of_every_format_are_the_same_pattern() {
    let workspace = workspace("5.25 kV");
    workspace.write("corner.csv", &csv(|x, y| x < 20 && y < 10));
    let script = "import numpy as np, h5py
p = np.loadtxt('corner.csv', delimiter=',').astype(np.uint8)
np.save('corner.npy', p)
np.savetxt('spaces.csv', p)
with h5py.File('corner.h5', 'w') as f: f['a/b'] = p[None]
";
    let python = super::h5py::python();
    let written = Command::new(python)
        .args(["-c", script])
        .current_dir(workspace.path(""))
        .output()
        .unwrap();
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    let arguments = [
        "solve",
        "scene.yaml",
        "corner.csv",
        "corner.npy",
        "corner.h5:/a/b",
        "spaces.csv",
        "-o",
        "out.h5",
        "--elements-per-cell",
        "1",
    ];
    assert_eq!(workspace.run(&arguments).code, Some(0));
    let all = column(&workspace, "out.h5", "displacement");
    let fields: Vec<&[f64]> = all.chunks(51 * 51 * 2).collect();
    assert_eq!(fields.len(), 4);
    assert!(fields.iter().all(|field| *field == fields[0]));
    // The electrode in the lower left corner expands: the membrane at its inner corner moves up and to the right.
    let at = 2 * (10 * 51 + 20);
    assert!(fields[0][at] > 0.01 && fields[0][at + 1] > 0.01);
}

#[test]
fn an_accuracy_picks_the_mesh_and_its_estimate_covers_the_error() {
    let workspace = workspace("5.25 kV");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    workspace.write(
        "ring.csv",
        &csv(|x, y| (8.0..15.0).contains(&(x as f64 - 24.0).hypot(y as f64 - 20.0))),
    );
    workspace.write("dots.csv", &csv(|x, y| (x * 7 + y * 11) % 13 < 6));
    let patterns = ["half.csv", "ring.csv", "dots.csv"];
    let solve = |options: &[&str]| workspace.run(&[&["solve", "scene.yaml"], &patterns[..], options].concat());
    let ended = solve(&["-o", "picked.h5", "--accuracy", "0.005 mm"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(
        solve(&["-o", "fine.h5", "--elements-per-cell", "4", "--order", "2"]).code,
        Some(0)
    );
    let (picked, fine) = (
        column(&workspace, "picked.h5", "displacement"),
        column(&workspace, "fine.h5", "displacement"),
    );
    let estimates = column(&workspace, "picked.h5", "discretisation_error");
    let meshes = column(&workspace, "picked.h5", "elements_per_cell");
    for (i, (a, b)) in picked.chunks(51 * 51 * 2).zip(fine.chunks(51 * 51 * 2)).enumerate() {
        let pairs = a.chunks(2).zip(b.chunks(2));
        let error = pairs.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
        assert!(
            error <= estimates[i] && estimates[i] <= 5.0 * error,
            "{}: {error} {}",
            patterns[i],
            estimates[i]
        );
        assert!(estimates[i] <= 0.005 && (1.0..=8.0).contains(&meshes[i]));
    }
    let ended = solve(&["-o", "x.h5", "--accuracy", "0.005 mm", "--order", "2"]);
    assert_eq!(ended.code, Some(2), "an accuracy and a mesh exclude each other");
    assert_eq!(solve(&["-o", "x.h5", "--accuracy", "5 V"]).code, Some(2));
}

#[test]
fn a_model_is_found_by_digest_by_stage_and_predicts_like_the_pipeline() {
    let workspace = Workspace::tiny();
    let digest = workspace.stages(&["run", "tiny.yaml", "--until", "design"]).digests()["surrogate"].clone();
    let design = workspace.run(&["show", "design", "--json"]).json()["path"]
        .as_str()
        .unwrap()
        .to_owned();
    let pattern = format!("{design}:/patterns");
    for (model, file) in [(digest.as_str(), "a.h5"), ("tiny.yaml:surrogate", "b.h5")] {
        let ended = workspace.run(&["predict", model, &pattern, "-o", file]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }
    let predicted = column(&workspace, "a.h5", "displacement");
    assert_eq!(predicted, column(&workspace, "b.h5", "displacement"));
    assert_eq!(predicted, column(&workspace, &design, "predicted"));
    assert!(predicted.iter().any(|u| u.abs() > 0.01));
    assert_eq!(
        workspace
            .run(&["predict", "tiny.yaml:small", &pattern, "-o", "c.h5"])
            .code,
        Some(2),
        "samples are no model"
    );
}

#[test]
fn an_output_never_replaces_what_is_read() {
    let workspace = workspace("5.25 kV");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let before = std::fs::read(workspace.path("half.csv")).unwrap();
    for output in ["half.csv", "./half.csv", "scene.yaml"] {
        let ended = workspace.run(&["solve", "scene.yaml", "half.csv", "-o", output]);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(
            ended.stderr.contains(output.trim_start_matches("./")),
            "{}",
            ended.stderr
        );
    }
    assert_eq!(std::fs::read(workspace.path("half.csv")).unwrap(), before);
    assert_eq!(
        workspace
            .run(&[
                "solve",
                "scene.yaml",
                "half.csv",
                "-o",
                "out.h5",
                "--elements-per-cell",
                "1"
            ])
            .code,
        Some(0)
    );
    let again = workspace.run(&["solve", "scene.yaml", "out.h5:/patterns", "-o", "out.h5"]);
    assert_eq!(again.code, Some(2), "{}", again.stderr);
}

#[test]
fn an_accuracy_that_no_mesh_reaches_is_reported_as_missed() {
    let workspace = workspace("5.25 kV");
    workspace.write("dot.csv", &csv(|x, y| (x, y) == (20, 30)));
    let ended = workspace.run(&[
        "solve",
        "scene.yaml",
        "dot.csv",
        "-o",
        "out.h5",
        "--accuracy",
        "1e-7 mm",
        "--json",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let missed = ended.json()["accuracy_missed"].clone();
    assert_eq!(missed[0]["index"], 0, "{missed}");
    assert!(missed[0]["discretisation_error"].as_f64().unwrap() > 1e-7);
}

#[test]
fn a_path_finds_the_voltage_at_which_stability_is_lost() {
    let workspace = workspace("0 V");
    workspace.write(
        "scene.yaml",
        &SCENE.replace("VOLTAGE", "0 V").replace("45 kPa", "25 kPa"),
    );
    workspace.write("half.csv", &csv(|x, _| x < 25));
    workspace.write("bare.csv", &csv(|_, _| false));
    let path = ["--path"];
    let solve = |options: &[&str]| workspace.run(&[&["solve", "scene.yaml", "half.csv", "bare.csv"], options].concat());
    let ended = solve(&[&path[..], &["-o", "out.h5", "--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let report = ended.json();
    // Without a file the results are only printed.
    let printed = solve(&[&path[..], &["--json"]].concat()).json();
    assert!(printed["file"].is_null() && printed["paths"] == report["paths"]);
    let half = &report["paths"][0];
    // 5.50 kV by an independent analysis.
    let limit = half["limit"]["voltage"].as_f64().unwrap();
    assert!((limit / 5.5e3 - 1.0).abs() < 0.005, "{limit}");
    let error = half["limit"]["error"].as_f64().unwrap();
    assert!(error > 0.0 && error < 0.01 * limit, "{error}");
    let meshes = half["limit"]["meshes"].as_array().unwrap();
    assert_eq!(meshes.len(), 2);
    assert_eq!(
        meshes[0]["voltage"], half["events"][0]["voltage"],
        "the path is on the coarser mesh"
    );
    // Reading a number of a document may miss its last digit.
    let same = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs();
    assert!(same(column(&workspace, "out.h5", "limit_error")[0], error));
    assert!(report["paths"][1]["limit"].is_null(), "a bare membrane has no limit");
    let voltages = column(&workspace, "out.h5", "voltage");
    let points = half["points"].as_array().unwrap();
    assert_eq!(
        voltages.len(),
        points.len() + report["paths"][1]["points"].as_array().unwrap().len()
    );
    assert!(same(voltages[1], points[1]["voltage"].as_f64().unwrap()));
    let found = column(&workspace, "out.h5", "limit_voltage");
    assert!(same(found[0], limit) && found[1].is_nan());
    let rows = std::fs::read_to_string(workspace.path("out.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + voltages.len());
    assert!(
        std::fs::read(workspace.path("out.png"))
            .unwrap()
            .starts_with(b"\x89PNG")
    );
    // What is written beside the file must not be lost either.
    for output in ["half.h5", "x.csv", "x.png"] {
        let ended = solve(&[&path[..], &["-o", output]].concat());
        assert_eq!(ended.code, Some(2), "{output}: {}", ended.stderr);
    }
    assert_eq!(
        solve(&[&path[..], &["-o", "x.h5", "--accuracy", "1 mm"]].concat()).code,
        Some(2)
    );
}

#[test]
fn a_figure_has_a_row_for_each_pattern_with_a_stable_solution() {
    let workspace = workspace("5 kV");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    workspace.write("none.csv", &csv(|_, _| false));
    let draw = |patterns: &[&str], file: &str| {
        let options = ["--no-checks", "--json", "--figure", file];
        workspace.run(&[&["solve", "scene.yaml"], patterns, &options[..]].concat())
    };
    let height = |patterns: &[&str]| {
        let ended = draw(patterns, "moved.png");
        assert_eq!(
            (ended.code, &ended.json()["figure"]),
            (Some(0), &"moved.png".into()),
            "{}",
            ended.stderr
        );
        size_of_png(&std::fs::read(workspace.path("moved.png")).unwrap())[1]
    };
    let one = height(&["half.csv"]);
    // Heights are whole pixels.
    assert!(height(&["half.csv", "none.csv"]).abs_diff(2 * one) <= 2);
    assert!(height(&["half.csv"; 8]).abs_diff(6 * one) <= 6);
    for (file, part) in [
        ("moved.svg", "name it moved.png"),
        ("moved.png", "moved.png is an input"),
    ] {
        let ended = draw(&["half.csv", "moved.png"], file);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(ended.stderr.contains(part), "{}", ended.stderr);
    }
    let ended = workspace.run(&[
        "solve",
        "scene.yaml",
        "half.csv",
        "--voltage",
        "9 kV",
        "--figure",
        "lost.png",
    ]);
    assert!(
        ended
            .stderr
            .contains("there is no figure lost.png: cannot draw the figure: no pattern has a stable solution"),
        "{}",
        ended.stderr
    );
    assert!(!workspace.path("lost.png").exists());
}

#[test]
fn neglected_effects_are_judged_below_the_limit_of_a_path() {
    let workspace = workspace("0 V");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let warnings = |voltage: &str| {
        let scene = SCENE.replace("VOLTAGE", voltage);
        let known = "properties: { strain_stiffening: { model: gent, jm: 100 } }\n";
        workspace.write("scene.yaml", &format!("{scene}{known}"));
        let ended = workspace.run(&["solve", "scene.yaml", "half.csv", "-o", "out.h5", "--path", "--json"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        (
            ended.json()["warnings"].to_string(),
            ended.json()["paths"][0]["limit"]["voltage"].as_f64().unwrap(),
        )
    };
    let (told, limit) = warnings("12 kV");
    assert!(limit < 12e3, "{limit}");
    assert!(
        told.contains("strain stiffening is off; switched on, the displacement") && !told.contains("work limit"),
        "{told}"
    );
    let at = "neglected effects are judged at ";
    assert!(told.contains(at), "{told}");
    // A voltage that the pattern reaches is that of the scene.
    let (told, _) = warnings("1 kV");
    assert!(!told.contains(at), "{told}");
}

#[test]
fn a_path_says_where_the_electric_field_exceeds_the_breakdown_field() {
    let workspace = workspace("0 V");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let with_strength = |field: &str, voltage: &str| {
        let effects = format!("effects: {{ dielectric_breakdown: {{ law: constant, field: {field} }} }}");
        let scene = SCENE.replace("effects: {}", &effects).replace("VOLTAGE", voltage);
        assert!(scene.contains(field));
        workspace.write("scene.yaml", &scene);
    };
    let solve = |options: &[&str]| {
        let ended = workspace.run(&[&["solve", "scene.yaml", "half.csv", "-o", "out.h5", "--json"], options].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        ended
    };
    with_strength("60 MV/m", "0 V");
    let ended = solve(&["--path"]);
    let path = ended.json()["paths"][0].clone();
    let from = path["breakdown"]["voltage"].as_f64().unwrap();
    assert!(from < path["limit"]["voltage"].as_f64().unwrap(), "{path}");
    let said = workspace.run(&["solve", "scene.yaml", "half.csv", "-o", "out.h5", "--path"]);
    let warning = "on the electric field exceeds the breakdown field, before the loss of stability (E/E_B up to ";
    assert!(
        said.stderr.contains(warning) || said.stdout.contains(warning),
        "{}",
        said.stderr
    );
    // What fails first stands in the line of the pattern.
    let line = said.stdout.lines().find(|line| line.starts_with(" 0 ")).unwrap();
    assert!(
        said.stdout.contains("fails first") && line.contains(&format!("breakdown at {:.0} V", from)),
        "{}",
        said.stdout
    );
    let ratios = column(&workspace, "out.h5", "breakdown_ratio");
    assert!(ratios[0] == 0.0 && ratios.len() == path["points"].as_array().unwrap().len());

    // That of a solution at this voltage: the path is interpolated between two of its points.
    with_strength("60 MV/m", &format!("{from} V"));
    solve(&[]);
    let ratio = column(&workspace, "out.h5", "breakdown_ratio")[0];
    assert!((ratio - 1.0).abs() < 0.005, "{ratio}");

    // Known, but off: it is told once, from the lowest voltage on.
    let known = "properties: { dielectric_breakdown: { law: constant, field: 60 MV/m } }\n";
    workspace.write("scene.yaml", &format!("{}{known}", SCENE.replace("VOLTAGE", "5.25 kV")));
    let told = |options: &[&str]| {
        let document = solve(options).json();
        let warnings = document["warnings"].as_array().unwrap().iter();
        warnings
            .filter(|warning| warning.to_string().contains("breakdown"))
            .count()
    };
    assert_eq!([told(&[]), told(&["--path"])], [1, 1]);

    with_strength("600 MV/m", "0 V");
    let path = solve(&["--path"]).json()["paths"][0].clone();
    assert!(path["breakdown"].is_null() && !path["limit"].is_null(), "{path}");
}

#[test]
fn a_solution_that_a_finer_mesh_could_refuse_is_named() {
    // A single cell is lost at 6.02 kV; two bilinear elements per cell have a stable state up to 6.25 kV.
    for (voltage, near) in [("6.05 kV", true), ("5.42 kV", false), ("2 kV", false)] {
        let workspace = workspace(voltage);
        workspace.write("scene.yaml", &SCENE.replace("VOLTAGE", voltage));
        workspace.write("cell.csv", &csv(|x, y| (x, y) == (25, 25)));
        let ended = workspace.run(&["solve", "scene.yaml", "cell.csv", "-o", "out.h5", "--json"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let named = ended.json()["near_limit"].as_array().unwrap().clone();
        assert_eq!(named.len(), usize::from(near), "{voltage}: {named:?}");
        // A stage says so where critical voltages are observed.
        let observed = SCENE.replace("effects: {}", "effects: { electromechanical_stability: {} }");
        workspace.write("observed.yaml", &observed.replace("VOLTAGE", voltage));
        workspace.write(
            "own.yaml",
            "version: 1\nname: own\nscene: observed.yaml\nstages:\n  \
             own: { kind: patterns, files: [cell.csv] }\n  solved: { kind: solve, needs: [own] }\n",
        );
        let run = workspace.run(&["run", "own.yaml", "--json"]);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let warnings = run.json()["warnings"].to_string();
        let told = warnings.contains("solved: 1 of 1 samples converged near the limit");
        assert_eq!(told, near, "{voltage}: {warnings}");
        assert_eq!(ended.json()["patterns"][0]["near_limit"], near, "{voltage}");
        if near {
            let [found, error] = ["critical_voltage", "error"].map(|key| named[0][key].as_f64().unwrap());
            assert!((found - 6023.0).abs() < error, "{found} {error}");
            let text = workspace
                .run(&["solve", "scene.yaml", "cell.csv", "-o", "out.h5"])
                .stdout;
            assert!(text.contains("   converged (near the limit)   "), "{text}");
            assert!(text.contains("pattern 0: "), "{text}");
            snapshot!(text);
            // The limit is told once, also where it is searched for on the mesh of the solution too.
            let searched = "effects={ electromechanical_stability: {} }";
            let both = workspace
                .run(&["solve", "scene.yaml", "cell.csv", "--set", searched])
                .stdout;
            for text in [text, both] {
                let told = text
                    .lines()
                    .filter(|line| line.contains("critical voltage") || line.contains("is lost"));
                assert_eq!(told.count(), 1, "{text}");
                assert!(
                    !text.contains("is unstable") && !text.contains("the field of"),
                    "{text}"
                );
            }
        }
    }
    // An accuracy asks meshes up to four biquadratic elements along a cell, and yet finer ones could refuse what these
    // bear.
    let workspace = workspace("6 kV");
    workspace.write("scene.yaml", &SCENE.replace("VOLTAGE", "6 kV"));
    workspace.write("cell.csv", &csv(|x, y| (x, y) == (25, 25)));
    let ended = workspace.run(&["solve", "scene.yaml", "cell.csv", "--accuracy", "0.01 mm", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(ended.json()["near_limit"].as_array().unwrap().len(), 1);
}

#[test]
fn checks_after_a_solution_can_be_skipped() {
    let workspace = workspace("6.05 kV");
    workspace.write("scene.yaml", &SCENE.replace("VOLTAGE", "6.05 kV"));
    workspace.write("cell.csv", &csv(|x, y| (x, y) == (25, 25)));
    let solve = |more: &[&str]| workspace.run(&[&["solve", "scene.yaml", "cell.csv"], more].concat());
    let checked = solve(&["--json"]).json();
    let ended = solve(&["--no-checks", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let skipped = ended.json();
    assert_eq!((&checked["checks"], &skipped["checks"]), (&true.into(), &false.into()));
    let near = |document: &serde_json::Value| document["patterns"][0]["near_limit"].clone();
    assert_eq!((near(&checked), near(&skipped)), (true.into(), serde_json::Value::Null));
    assert!(skipped["near_limit"].as_array().unwrap().is_empty());
    assert_eq!(skipped["max_displacement_mm"], checked["max_displacement_mm"]);
    let warnings = |document: &serde_json::Value| document["warnings"].as_array().unwrap().len();
    assert_eq!((warnings(&checked) > 0, warnings(&skipped)), (true, 0));
    let text = solve(&["--no-checks"]).stdout;
    assert!(
        text.contains("not checked, because of --no-checks: whether a finer mesh"),
        "{text}"
    );
    assert!(!text.contains("near the limit") && !text.contains("fringe"), "{text}");
    for form in [&["--path"][..], &["--history", "--at", "1 s"], &["--modes", "2"]] {
        assert_eq!(solve(&[&["--no-checks", "-o", "o.h5"], form].concat()).code, Some(2));
    }
}

#[test]
fn a_number_without_a_unit_is_warned_of_once_with_how_it_was_read() {
    let workspace = workspace("5 kV");
    workspace.write("scene.yaml", &SCENE.replace("VOLTAGE", "5.25"));
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let warned = |arguments: &[&str]| {
        let ended = workspace.run(arguments);
        let lines = ended.stderr.lines().filter(|line| line.contains("without a unit"));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    let modulus = ["--set", "material.shear_modulus=45"];
    let both = "warning: numbers without a unit were read in base units: material.shear_modulus: 45 as 45 Pa, \
                drive.voltage: 5.25 as 5.25 V";
    for command in [
        &["solve", "scene.yaml", "half.csv"][..],
        &["screen", "scene.yaml", "half.csv"],
    ] {
        assert_eq!(warned(&[command, &modulus].concat()), [both], "{command:?}");
        // What has a unit, or no dimension as the prestretch, is not mentioned.
        let only = warned(&[command, &["--voltage", "5 kV"]].concat());
        assert_eq!(only, Vec::<String>::new(), "{command:?}");
        let only = warned(&[command, &["--voltage", "5"]].concat());
        assert_eq!(only.len(), 1, "{command:?}: {only:?}");
        assert!(only[0].ends_with("drive.voltage: 5 as 5 V"), "{only:?}");
    }
    let options = [
        "solve",
        "scene.yaml",
        "half.csv",
        "--voltage",
        "1 kV",
        "--point",
        "25, 25 mm",
    ];
    let told = "warning: options without a unit were read in base units: 25 as 25 mm";
    assert_eq!(warned(&options), [told]);
    assert_eq!(
        warned(&["check", "--scene", "scene.yaml", "half.csv"]),
        ["warning: numbers without a unit were read in base units: drive.voltage: 5.25 as 5.25 V"]
    );
    let document = workspace.run(&["solve", "scene.yaml", "half.csv", "--json"]).json();
    assert!(
        document["warnings"].to_string().contains("5.25 as 5.25 V") && document["notes"] == serde_json::json!([]),
        "{document}"
    );
    // In each command they are among the warnings, with those of options.
    for command in [
        &["screen", "scene.yaml", "half.csv"][..],
        &["check", "--scene", "scene.yaml", "half.csv"],
        &["solve", "scene.yaml", "half.csv", "--point", "25, 25 mm"],
    ] {
        let document = workspace.run(&[command, &["--json"]].concat()).json();
        let told = document["warnings"].to_string();
        assert!(told.contains("5.25 as 5.25 V"), "{command:?}: {document}");
        assert_eq!(
            told.contains("25 as 25 mm"),
            command.contains(&"--point"),
            "{command:?}: {told}"
        );
    }
    // A pipeline tells it in its plan and its run.
    let tiny = Workspace::tiny();
    for command in ["plan", "run"] {
        let set = ["--set", "scene.geometry.thickness=1", "--until", "solved", "--json"];
        let document = tiny.run(&[&[command, "tiny.yaml"][..], &set].concat()).json();
        let warnings = document["warnings"].as_array().unwrap();
        let told = warnings
            .iter()
            .filter(|text| text.as_str().unwrap().contains("without a unit"));
        let told: Vec<_> = told.collect();
        assert_eq!(told.len(), 1, "{warnings:?}");
        assert!(
            told[0]
                .as_str()
                .unwrap()
                .ends_with("scene.geometry.thickness: 1 as 1 mm"),
            "{told:?}"
        );
    }
    // So do other commands that use its numbers, and not those that only read the file.
    let set = ["--set", "scene.geometry.thickness=1"];
    let told = |arguments: &[&str]| {
        let text = tiny.run(arguments).stderr;
        text.matches("thickness: 1 as 1 mm").count()
    };
    for command in [
        &["explain", "tiny.yaml", "solved"][..],
        &["report", "tiny.yaml", "-o", "page"],
    ] {
        assert_eq!(told(&[command, &set].concat()), 1, "{command:?}");
    }
    let text = std::fs::read_to_string(tiny.path("tiny.yaml")).unwrap();
    tiny.write("tiny.yaml", &text.replace("1.0 mm", "1"));
    assert_eq!(told(&["explain", "tiny.yaml", "solved"]), 1);
    assert_eq!(told(&["report", "tiny.yaml", "-o", "page"]), 1);
    for command in ["dag", "status"] {
        assert_eq!(told(&[command, "tiny.yaml"]), 0, "{command}");
    }
    // Options with a document name it.
    workspace.write("taken", "");
    for (option, value) in [
        ("--reference", "{ accuracy: 0.01 }"),
        ("--methods", "[{ accuracy: 0.01 }]"),
    ] {
        let said = warned(&["accuracy", "scene.yaml", option, value, "-o", "taken"]);
        let of_option = said
            .iter()
            .filter(|line| line.starts_with(&format!("warning: {option}: ")));
        let of_option: Vec<_> = of_option.collect();
        assert_eq!(of_option.len(), 1, "{said:?}");
        assert!(of_option[0].ends_with("accuracy: 0.01 as 0.01 mm"), "{said:?}");
    }
}

#[test]
fn the_displacement_of_a_point_stands_in_the_file_too() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &SCENE.replace("VOLTAGE", "5 kV"));
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let solve = |more: &[&str]| {
        let options = [
            "solve",
            "scene.yaml",
            "half.csv",
            "-o",
            "out.h5",
            "--elements-per-cell",
            "1",
            "--json",
        ];
        let ended = workspace.run(&[&options[..], &["--point", "25 mm, 20 mm"], more].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let told = ended.json()["patterns"][0]["along_mm"].as_f64().unwrap();
        assert_eq!(column(&workspace, "out.h5", "at_point"), [told]);
        told
    };
    let [x, y] = ["0 deg", "90 deg"].map(|angle| solve(&["--direction", angle]));
    assert!(x.abs() > 0.1 && y.abs() > 1e-6, "{x} {y}");
    // Without a direction it is the size of the displacement.
    assert!((solve(&[]) - x.hypot(y)).abs() < 1e-12);
    let rows = workspace.run(&["show", "out.h5", "--csv"]).stdout;
    assert!(rows.lines().next().unwrap().contains("at_point"), "{rows}");
    let shown = workspace.run(&["show", "out.h5"]).stdout;
    assert!(shown.contains("25 mm, 20 mm"), "{shown}");
}

#[test]
fn cells_have_stresses_and_wrinkled_states() {
    let workspace = Workspace::new();
    workspace.write(
        "scene.yaml",
        &SCENE
            .replace("VOLTAGE", "20 kV")
            .replace("prestretch: 3.0", "prestretch: 1.3"),
    );
    workspace.write("disc.csv", &csv(|x, y| (x as f64 - 24.5).hypot(y as f64 - 24.5) < 12.0));
    workspace.write("half.csv", &csv(|x, _| x < 25));
    workspace.write("bare.csv", &csv(|_, _| false));
    workspace.write("full.csv", &csv(|_, _| true));
    let patterns = ["half.csv", "bare.csv", "full.csv", "disc.csv"];
    let options = ["-o", "out.h5", "--cells", "--elements-per-cell", "1", "--json"];
    let ended = workspace.run(&[&["solve", "scene.yaml"], &patterns[..], &options].concat());
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let fraction = column(&workspace, "out.h5", "wrinkled_fraction");
    let stresses = column(&workspace, "out.h5", "cells/principal_stresses");
    let negative = |pattern: usize| {
        let own = &stresses[pattern * 5000..(pattern + 1) * 5000];
        own.chunks(2).filter(|s| s[1] <= 0.0).count() as f64 / 2500.0
    };
    assert!(
        (0..3).all(|pattern| fraction[pattern] == negative(pattern)),
        "{fraction:?}"
    );
    assert!(
        fraction[0] > 0.1 && fraction[0] < 0.3 && fraction[1] == 0.0,
        "{fraction:?}"
    );
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let state = file.dataset("cells/state").unwrap().read_raw::<u8>().unwrap();
    let count = |range: std::ops::Range<usize>, code| state[range].iter().filter(|s| **s == code).count();
    assert_eq!(
        count(0..2500, 1) + count(0..2500, 2),
        (2500.0 * fraction[0]).round() as usize
    );
    assert_eq!(count(2500..7500, 0), 5000);
    // Beyond its limit the disc has no state.
    assert_eq!(count(7500..10_000, 255), 2500);
    assert!(fraction[3].is_nan() && stresses[15_000..].iter().all(|s| s.is_nan()));
    // Bare and at rest: σ = μ (λ² − λ⁻⁴) and P = σ/λ.
    let (stretch, modulus) = (1.3_f64, 45e3);
    let sigma = modulus * (stretch.powi(2) - stretch.powi(-4));
    assert!((stresses[5000] / sigma - 1.0).abs() < 1e-12);
    let piola = column(&workspace, "out.h5", "cells/first_piola_stress");
    assert!((piola[10_000] * stretch / sigma - 1.0).abs() < 1e-12 && piola[10_001] == 0.0);
    // Active everywhere: the field is V λ²/H.
    let electric = column(&workspace, "out.h5", "cells/electric_field");
    assert!((electric[5000] / (20e3 * stretch.powi(2) / 1e-3) - 1.0).abs() < 1e-12);
    let told = ended.json()["wrinkled"].clone();
    assert_eq!(
        (told[0]["index"].as_u64(), told[0]["wrinkled_fraction"].as_f64()),
        (Some(0), Some(fraction[0]))
    );
}

#[test]
fn the_critical_voltage_is_reported_with_the_elements() {
    let workspace = workspace("5.25 kV");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let solve = |more: &[&str]| workspace.run(&[&["solve", "scene.yaml", "half.csv"], more].concat());
    // Where the scene asks for it, and by which elements.
    let on = ["--set", "effects.electromechanical_stability=true"];
    let ended = solve(&on);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(
        ended.stdout.contains("pattern 0: ") && ended.stdout.contains("--order 2"),
        "{}",
        ended.stdout
    );
    // The critical voltage depends on the mesh, so the output names a mesh that was picked.
    assert!(!ended.stdout.contains("elements_per_cell"), "{}", ended.stdout);
    let picked = solve(&[&on[..], &["--accuracy", "0.1 mm"]].concat());
    assert!(
        picked.stdout.contains("elements_per_cell: 1, order: "),
        "{}",
        picked.stdout
    );
    let mut printed = Transcript::default();
    printed.add("bilinear elements", ended.stdout);
    printed.add("a mesh that was picked", picked.stdout);
    let ended = solve(&[&on[..], &["--order", "2", "--json"]].concat());
    let critical = ended.json()["critical_voltages"][0].clone();
    assert_eq!(
        (critical["elements_per_cell"].as_u64(), critical["order"].as_u64()),
        (Some(2), Some(2))
    );
    let between = critical["between"].clone();
    let bracket = [0, 1].map(|end| between[end].as_f64().unwrap());
    assert!(
        bracket[0] > 5250.0 && bracket[1] > bracket[0] && bracket[1] < 12e3,
        "{bracket:?}"
    );
    let ended = solve(&["--order", "2"]);
    assert!(!ended.stdout.contains(" V"), "{}", ended.stdout);
    // A voltage without its unit.
    let ended = solve(&["--voltage", "5.25"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(ended.stderr.contains("5.25 V"), "{}", ended.stderr);
    assert!(!solve(&["--voltage", "5.25 kV"]).stderr.contains("5.25 V"));
    printed.add("a voltage without a unit", ended.stderr);
    // A path of one step names a part of the scene.
    assert_eq!(solve(&["--set", "effects={ fringe_field: true }"]).code, Some(0));
    let ended = solve(&["--set", "effects.strain_stiffening=auto"]);
    assert_eq!(ended.code, Some(2), "{}", ended.stdout);
    assert!(ended.stderr.contains("`effects: auto`"), "{}", ended.stderr);
    printed.add("an effect set to auto", ended);
    snapshot!(printed);
    let screened = workspace.run(&["screen", "scene.yaml", "half.csv", "--voltage", "1 kV", "--json"]);
    assert_eq!(screened.code, Some(0), "{}", screened.stderr);
    assert_eq!(
        screened.json()["warnings"].as_array().unwrap().len(),
        0,
        "{}",
        screened.stdout
    );
}

#[test]
fn a_voltage_that_is_given_twice_is_refused() {
    let workspace = workspace("4 kV");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let solve = ["solve", "scene.yaml", "half.csv", "--no-checks", "--voltage", "4kV"];
    for set in ["drive.voltage=3kV", "scene.drive.voltage = 3 kV"] {
        let ended = workspace.run(&[&solve[..], &["--set", set]].concat());
        assert_eq!(ended.code, Some(2), "{}", ended.stdout);
        assert!(ended.stderr.contains("the voltage is given twice"), "{}", ended.stderr);
    }
    let ended = workspace.run(&[&solve[..], &["--set", "geometry.thickness=1.1 mm"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
}

#[test]
fn effects_without_data_are_said_to_be_unchecked() {
    let workspace = workspace("4 kV");
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let line = "not checked, no data: strain stiffening, electrode stiffness, stretch dependent permittivity";
    let warnings = |more: &[&str]| {
        let ended = workspace.run(&[&["solve", "scene.yaml", "half.csv", "--json"], more].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        ended.json()["warnings"].as_array().unwrap().clone()
    };
    assert!(warnings(&[]).contains(&line.into()));
    let known = "properties={ strain_stiffening: { model: gent, jm: 120 } }";
    assert!(warnings(&["--set", known]).contains(&line.replace("strain stiffening, ", "").into()));
    assert_eq!(warnings(&["--no-checks"]), Vec::<serde_json::Value>::new());
}
