//! Membranes that leave their plane, from the command line: pressure, volume, frequencies, and what is refused.

use serde_json::Value;

use super::common::{Ended, Workspace, size_of_png};

const SCENE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
properties: { density: 960 kg/m3 }
drive: { voltage: 4 kV }
";

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", SCENE);
    let half: String = (0..10).map(|_| "1,1,1,1,1,0,0,0,0,0\n").collect();
    workspace.write("half.csv", &half);
    workspace
}

fn solve(workspace: &Workspace, more: &[&str]) -> Ended {
    let first = [
        "solve",
        "scene.yaml",
        "half.csv",
        "-o",
        "out.h5",
        "--order",
        "2",
        "--elements-per-cell",
        "1",
    ];
    workspace.run(&[&first[..], more].concat())
}

fn column(workspace: &Workspace, path: &str) -> Vec<f64> {
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    file.dataset(path).unwrap().read_raw::<f64>().unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[test]
fn a_figure_also_shows_the_membrane_from_the_side() {
    let workspace = workspace();
    let width = |more: &[&str]| {
        let ended = solve(&workspace, &[&["--figure", "moved.png"], more].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert!(
            ended.stdout.contains("out.h5, moved.png: 1 pattern"),
            "{}",
            ended.stdout
        );
        size_of_png(&std::fs::read(workspace.path("moved.png")).unwrap())[0]
    };
    let in_plane = width(&[]);
    assert!(width(&["--set", "loads={ pressure: 500 Pa }"]) > in_plane + 300);
}

#[test]
fn a_point_moves_along_three_axes() {
    let workspace = workspace();
    let point = ["--point", "10 mm, 25 mm", "--direction", "90 deg"];
    let loads = ["--set", "loads={ pressure: 500 Pa }"];
    let ended = solve(&workspace, &[&["--json"], &loads[..], &point].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json()["equilibria"][0].clone();
    let corner = 3 * (5 * 11 + 2);
    let displacement = column(&workspace, "displacement")[corner..corner + 3].to_vec();
    for (axis, expected) in displacement.iter().enumerate() {
        assert!(
            (number(&found["at_point_mm"][axis]) - expected).abs() < 1e-12,
            "{found}"
        );
    }
    assert!(displacement[2] > 1.0 && (number(&found["along_mm"]) - displacement[1]).abs() < 1e-12);
    let printed = solve(&workspace, &[&loads[..], &point].concat()).stdout;
    assert!(
        printed.contains("height at 10, 25 mm") && printed.contains("at 10, 25 mm along 90 deg"),
        "{printed}"
    );
}

#[test]
fn a_membrane_in_space_is_exported_with_its_heights() {
    let workspace = workspace();
    let loads = ["--set", "loads={ pressure: 500 Pa }"];
    let solved = solve(&workspace, &[&["--json"], &loads[..]].concat()).json()["equilibria"][0].clone();
    workspace.write("loaded.yaml", &format!("{SCENE}loads: {{ pressure: 500 Pa }}\n"));
    let mesh = ["--order", "2", "--elements-per-cell", "1", "--json"];
    let export = [
        "export",
        "design",
        "half.csv",
        "--scene",
        "loaded.yaml",
        "-o",
        "half.vtkhdf",
    ];
    let ended = workspace.run(&[&export[..], &mesh].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("half.vtkhdf")).unwrap();
    let points = file.dataset("VTKHDF/Points").unwrap().read_raw::<f64>().unwrap();
    assert_eq!(points.len(), 3 * 11 * 11);
    let highest = points.chunks_exact(3).map(|point| point[2]).fold(0.0, f64::max);
    assert!(
        (highest - number(&solved["height_mm"])).abs() < 0.02 * highest,
        "{highest} {solved}"
    );
    assert!((number(&ended.json()["max_displacement_mm"]) - number(&solved["largest_displacement_mm"])).abs() < 1e-9);
}

#[test]
fn a_pressure_and_the_volume_that_it_makes_are_the_same_state() {
    let workspace = workspace();
    let ended = solve(&workspace, &["--json", "--set", "loads={ pressure: 500 Pa }"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let by_pressure = ended.json()["equilibria"][0].clone();
    assert_eq!(by_pressure["outcome"], "converged");
    let volume = number(&by_pressure["volume_ml"]);
    // On 50² cells the centre rises by 2.2216 mm.
    assert!((number(&by_pressure["height_mm"]) - 2.22).abs() < 0.02, "{by_pressure}");
    let set = format!("loads={{ volume: {volume} ml }}");
    let ended = solve(&workspace, &["--json", "--set", &set]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let by_volume = ended.json()["equilibria"][0].clone();
    for (key, error) in [
        ("pressure_pa", 1e-4),
        ("height_mm", 1e-6),
        ("largest_displacement_mm", 1e-6),
    ] {
        let [a, b] = [&by_pressure, &by_volume].map(|of| number(&of[key]));
        assert!((a - b).abs() < error * a, "{key}: {a} {b}");
    }
}

#[test]
fn a_pressure_beyond_the_largest_has_no_field_and_an_exit_code() {
    let workspace = workspace();
    let ended = solve(&workspace, &["--json", "--set", "loads={ pressure: 20 kPa }"]);
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    let found = ended.json()["equilibria"][0].clone();
    assert_eq!(found["outcome"], "limit-point");
    let [below, above] = ["last_stable", "first_unstable"].map(|key| number(&found[key]));
    assert!(
        0.0 < below && below < above && above - below < 1e-3 * below,
        "{below} {above}"
    );
    assert!(
        (number(&found["limit_pa"]) / (2e4 * below) - 1.0).abs() < 1e-9,
        "{found}"
    );
    assert!(found.get("height_mm").is_none());
    let ended = solve(&workspace, &["--set", "loads={ pressure: 20 kPa }"]);
    assert!(ended.stdout.contains("limit-point at 2496 Pa"), "{}", ended.stdout);
}

#[test]
fn the_electric_field_under_pressure_is_compared_with_the_breakdown_field() {
    let workspace = workspace();
    let with = |field: &str, more: &[&str]| {
        let law = format!("properties={{ dielectric_breakdown: {{ law: constant, field: {field} }} }}");
        let ended = solve(&workspace, &[&["--json", "--set", &law], more].concat());
        assert_eq!(ended.code, Some(0), "{ended}");
        ended.json()
    };
    let pressure = ["--set", "loads={ pressure: 500 Pa }"];
    let told = |document: &Value| {
        let warnings = document["warnings"].as_array().unwrap().iter();
        let own = warnings.filter(|warning| warning.to_string().contains("breakdown"));
        own.map(|warning| warning.as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    let ratio = number(&with("1000 MV/m", &pressure)["equilibria"][0]["breakdown_ratio"]);
    let near = |of: f64| format!("{} MV/m", 1e3 * ratio / of);
    assert_eq!(told(&with(&near(0.79), &pressure)), Vec::<String>::new());
    assert_eq!(
        told(&with(&near(0.9), &pressure)),
        ["pattern 0: the electric field is close to the breakdown field: E/E_B = 0.90"]
    );
    assert_eq!(
        told(&with(&near(1.2), &pressure)),
        ["pattern 0: the electric field exceeds the breakdown field: E/E_B = 1.20"]
    );
    with("1000 MV/m", &pressure);
    assert!((column(&workspace, "breakdown_ratio")[0] / ratio - 1.0).abs() < 1e-12);
    // With hardly any pressure it is that of the flat membrane.
    let effects = ["--set", "effects={ dielectric_breakdown: {} }"];
    let flat = with("1000 MV/m", &effects)["breakdown"][0]["breakdown_ratio"].clone();
    let hardly = with("1000 MV/m", &["--set", "loads={ pressure: 0.01 Pa }"]);
    let hardly = number(&hardly["equilibria"][0]["breakdown_ratio"]);
    assert!((hardly / number(&flat) - 1.0).abs() < 1e-6, "{hardly} {flat}");
    // Along a path it is reached where a state has it.
    let path = with(&near(1.0), &["--path=pressure", "--set", "loads={ pressure: 1000 Pa }"]);
    let warnings = told(&path);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let from = warnings[0].strip_prefix("pattern 0: from ").unwrap();
    let pascals: f64 = from
        .split_once(" Pa on the electric field exceeds")
        .unwrap()
        .0
        .parse()
        .unwrap();
    assert!((pascals - 500.0).abs() < 5.0, "{pascals}");
}

#[test]
fn paths_under_pressure_have_a_table_a_figure_and_the_largest_pressure() {
    let workspace = workspace();
    let by_volume = ["--json", "--path=volume", "--set", "loads={ volume: 23 ml }"];
    let ended = solve(&workspace, &by_volume);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    assert_eq!(document["parameter"], "volume");
    let path = document["paths"][0].clone();
    assert_eq!(
        (&path["end"], &path["limit"]),
        (&"complete".into(), &Value::Null),
        "{path}"
    );
    let points = path["points"].as_array().unwrap();
    let largest = &path["largest_pressure"];
    let at = largest["point"].as_u64().unwrap() as usize;
    assert_eq!(points[at]["pressure_pa"], largest["pressure_pa"]);
    let pressures: Vec<f64> = points.iter().map(|point| number(&point["pressure_pa"])).collect();
    let most = pressures.iter().fold(0.0_f64, |most, one| most.max(*one));
    assert_eq!(most, pressures[at]);
    let table = std::fs::read_to_string(workspace.path("out.csv")).unwrap();
    assert_eq!(table.lines().count(), points.len() + 1, "{table}");
    assert!(table.starts_with("pattern,voltage_V,pressure_Pa,volume_ml,"), "{table}");
    let header = table.lines().next().unwrap();
    assert!(
        header.ends_with(",wrinkled_fraction,breakdown_ratio,watched_height_mm"),
        "{header}"
    );
    assert!(workspace.path("out.png").exists());
    let each = |key: &str| -> Vec<f64> { points.iter().map(|point| number(&point[key])).collect() };
    assert_eq!(column(&workspace, "breakdown_ratio"), each("breakdown_ratio"));
    // One point for all of the path: at its end that which moves most.
    let (watched, height) = (column(&workspace, "watched_height"), each("height_mm"));
    assert_eq!(watched, each("watched_height_mm"));
    assert_eq!((watched[0], watched.last()), (0.0, height.last()));
    assert!(watched != height, "another point moves most at the beginning");
    let unchecked = "not checked, no data: strain stiffening, electrode stiffness, stretch dependent permittivity";
    assert_eq!(document["warnings"][0], unchecked);

    // The same limit by pressure.
    let ended = solve(
        &workspace,
        &["--json", "--path=pressure", "--set", "loads={ pressure: 20 kPa }"],
    );
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let by_pressure = ended.json()["paths"][0].clone();
    assert_eq!(
        (&by_pressure["end"], &by_pressure["limit"]["kind"]),
        (&"limit-point".into(), &"limit-point".into())
    );
    let limit = number(&by_pressure["limit"]["pressure_pa"]);
    assert!((limit / most - 1.0).abs() < 1e-4, "{limit} {most}");

    let ended = solve(&workspace, &["--path", "--set", "loads={ pressure: 500 Pa }"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(ended.stdout.contains("complete"), "{}", ended.stdout);
}

#[test]
fn what_is_not_simulated_under_pressure_is_refused() {
    let workspace = workspace();
    let pressure = "loads={ pressure: 500 Pa }";
    let free = "geometry.sides={ right: roller }";
    let body = "geometry.bodies=[{ disc: { centre: [25 mm, 25 mm], radius: 6 mm }, load: [0 N, 0 N, 0.2 N] }]";
    let two = "give two numbers";
    let refused: [(&[&str], &str); 14] = [
        (&["--set", pressure, "--modes", "2"], "with `--modes`"),
        (
            &["--set", pressure, "--set", body, "--path=pressure"],
            "`bodies` along a path",
        ),
        (&["--set", pressure, "--path=load"], "--path=pressure"),
        (&["--set", pressure, "--path=volume"], "--path=pressure"),
        (&["--path=volume"], "add `loads: { pressure: 500 Pa }`"),
        (&["--set", pressure, "--set", free], "`sides` that are not held"),
        (&["--set", body, "--modes", "2"], two),
        (&["--set", body, "--path"], two),
        (&["--set", body, "--set", free], "`sides` that are not held"),
        (&["--set", body, "--cells"], "bodies that move out of the plane"),
        (&["--set", pressure, "--cells"], "--cells"),
        (&["--set", pressure, "--path=pressure", "--point", "25,25"], "--point"),
        (
            &["--set", "loads={ pressure: 1 Pa, volume: 1 ml }"],
            "either a `pressure` or a `volume`",
        ),
        (&["--set", "loads={ volume: 1 mm }"], "volume"),
    ];
    for (more, why) in refused {
        let ended = solve(&workspace, more);
        assert_eq!(ended.code, Some(2), "{more:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(why), "{more:?}: {}", ended.stderr);
    }
    let bodies = body.trim_start_matches("geometry.");
    let hub = SCENE.replace("cells: 10", &format!("cells: 10, {}", bodies.replacen('=', ": ", 1)));
    for (scene, why) in [
        (format!("{SCENE}loads: {{ pressure: 1 kPa }}"), "remove `loads`"),
        (hub, two),
    ] {
        let pipeline = format!(
            "version: 1\nname: blown\nscene: {{ {} }}\nstages:\n  small: {{ kind: sample, family: small-grid, count: \
             2, seed: 1 }}\n  solved: {{ kind: solve, needs: [small] }}\n",
            scene.trim_end().replace('\n', ", ")
        );
        workspace.write("blown.yaml", &pipeline);
        let ended = workspace.run(&["plan", "blown.yaml"]);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(ended.stderr.contains(why), "{}", ended.stderr);
    }
}

/// A pipeline that designs and verifies in the scene of this file, with more keys of the scene and of the stages.
fn pipeline(scene: &str, design: &str, verify: &str) -> String {
    format!(
        "version: 1\nname: pump\nscene: {{ {}, {scene} }}\nstages:\n  design: {{ kind: design, method: adjoint, area: \
         free, starts: 1, seed: 1, {design} }}\n  verified: {{ kind: verify, needs: [design], elements_per_cell: 1, \
         order: 2{verify} }}\n",
        SCENE.trim_end().replace('\n', ", ")
    )
}

#[test]
fn designs_for_heights_and_volumes_are_what_solve_finds() {
    let workspace = workspace();
    workspace.write("all.csv", &"1,1,1,1,1,1,1,1,1,1\n".repeat(10));
    let body = "{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]], load: [0 N, 0 N, 0.3 N] }";
    let hub = format!("bodies: [{body}]");
    let of_hub = SCENE.replace("cells: 10", &format!("cells: 10, {hub}"));
    workspace.write("hub.yaml", &of_hub);
    let membrane_mm2 = 2500.0;
    for (loads, objective, key, per_mm) in [
        (
            "loads: { pressure: 1 kPa }",
            "{ volume: largest }",
            "volume_ml",
            1e-3 * membrane_mm2,
        ),
        (
            "loads: { volume: 3 ml }",
            "{ point: [25 mm, 25 mm], height: up }",
            "height_mm",
            1.0,
        ),
        ("", "{ body: 0, height: up }", "body_translation_mm", 1.0),
    ] {
        let (scene, text) = match loads {
            "" => (
                "hub.yaml",
                pipeline("", &format!("objective: {objective}"), "").replace("cells: 10", &format!("cells: 10, {hub}")),
            ),
            _ => ("scene.yaml", pipeline(loads, &format!("objective: {objective}"), "")),
        };
        workspace.write("pump.yaml", &text.replace(", , ", ", ").replace(",  }", " }"));
        let ended = workspace.run(&["run", "pump.yaml", "--json"]);
        assert_eq!(ended.code, Some(0), "{loads}: {}", ended.stderr);
        let document = ended.json();
        let results = document["results"].as_array().unwrap();
        let rows = results.iter().find(|of| of["stage"] == "verified").unwrap()["rows"]
            .as_array()
            .unwrap();
        let row = |role: &str| rows.iter().find(|row| row["role"] == role).unwrap();
        // Any electrode lets the membrane rise more than none, and the best one as much as all of it, or more.
        let [best, all] = ["optimum", "intuitive"].map(|role| number(&row(role)["simulated_mm"]));
        assert!(best > 0.01 && best >= all - 1e-6, "{objective}: {best} {all}");
        assert!((number(&row("optimum")["predicted_mm"]) - best).abs() < 1e-6 * best);
        // The intuitive design covers everything.
        let state = |volts: &str| {
            let mut more = vec!["--json", "--set", volts];
            let set = loads.replacen(": ", "=", 1);
            if !loads.is_empty() {
                more.extend(["--set", set.as_str()]);
            }
            let first = [
                "solve",
                scene,
                "all.csv",
                "-o",
                "out.h5",
                "--order",
                "2",
                "--elements-per-cell",
                "1",
            ];
            let ended = workspace.run(&[&first[..], &more].concat());
            assert_eq!(ended.code, Some(0), "{}", ended.stderr);
            let found = ended.json()["equilibria"][0].clone();
            match key {
                "body_translation_mm" => number(&found[key][0][2]),
                _ => number(&found[key]),
            }
        };
        let stroke = state("drive.voltage=4 kV") - state("drive.voltage=0 V");
        assert!(
            (per_mm * all - stroke).abs() < 1e-5 * stroke.abs().max(0.1),
            "{objective}: {all} {stroke}"
        );
        if key == "volume_ml" {
            assert!((number(&row("intuitive")["simulated_ml"]) - stroke).abs() < 1e-5 * stroke);
            let printed = workspace.run(&["run", "pump.yaml"]).stdout;
            assert!(printed.contains(" ml (mesh)") && !printed.contains(" mm"), "{printed}");
            let with_table = text.replace(", , ", ", ").replace(",  }", " }")
                + "  stroke: { kind: table, needs: [verified], columns: [volume] }\n";
            workspace.write("table.yaml", &with_table);
            let stroke = workspace.run(&["run", "table.yaml", "--json"]).json()["tables"][0].clone();
            assert_eq!(stroke["columns"][0]["unit"], "ml");
            assert!((number(&stroke["rows"][0][0]) - number(&row("optimum")["simulated_ml"])).abs() < 1e-12);
            let report = workspace.run(&["report", "pump.yaml", "-o", "page"]);
            assert_eq!(report.code, Some(0), "{}", report.stderr);
            let table = std::fs::read_to_string(workspace.path("page/data/designs.csv")).unwrap();
            assert!(table.lines().next().unwrap().contains("simulated_ml"), "{table}");
            let page = std::fs::read_to_string(workspace.path("page/index.html")).unwrap();
            let told = "change of the volume below the membrane by the voltage (largest)";
            assert!(page.contains(told) && page.contains("Volumes are in ml"), "{objective}");
        }
    }
}

#[test]
fn stages_refuse_what_is_not_simulated_out_of_the_plane() {
    let workspace = workspace();
    let blown = "loads: { pressure: 500 Pa }";
    let volume = "objective: { volume: largest }";
    let point = "objective: { point: [25 mm, 25 mm], height: up";
    for (scene, design, verify, why) in [
        ("", volume, "", "needs a membrane that leaves its plane"),
        (
            "",
            &*format!("{point} }}"),
            "",
            "needs a membrane that leaves its plane",
        ),
        (
            blown,
            &format!("{point}, robust: {{ worst: [1 mm] }} }}"),
            "",
            "with a `robust` objective",
        ),
        (
            blown,
            &format!("{point}, time: 1 s }}"),
            "",
            "with a `time` or `frequency`",
        ),
        (blown, volume, ", accuracy: 10 um", "with `accuracy`"),
        (blown, volume, ", history: { at: [1 s] }", "with a `history`"),
        (blown, volume, ", method: linear", "with a `method` other than `newton`"),
        (
            "loads: { pressure: 1 Pa }, effects: { fringe_field: {} }",
            volume,
            "",
            "with `fringe_field`",
        ),
    ] {
        let text = pipeline(scene, design, verify).replace("order: 2, accuracy", "accuracy");
        let text = match verify.contains("accuracy") {
            true => text.replace("elements_per_cell: 1, accuracy", "accuracy"),
            false => text.replace(",  }", " }"),
        };
        workspace.write("refused.yaml", &text);
        let ended = workspace.run(&["plan", "refused.yaml"]);
        assert_eq!(ended.code, Some(2), "{why}: {}", ended.stderr);
        assert!(ended.stderr.contains(why), "{why}: {}", ended.stderr);
    }
    let genetic = pipeline(blown, volume, "")
        .replace("method: adjoint", "evaluator: linear")
        .replace("starts: 1, ", "");
    workspace.write("refused.yaml", &genetic);
    let ended = workspace.run(&["plan", "refused.yaml"]);
    assert!(
        ended.stderr.contains("`evaluator: linear` cannot predict"),
        "{}",
        ended.stderr
    );
    let trained = pipeline(blown, volume, "")
        + "  network: { kind: train, needs: [verified], network: qin2024, epochs: 1, seed: 1 }\n";
    workspace.write("refused.yaml", &trained);
    let ended = workspace.run(&["plan", "refused.yaml"]);
    assert!(ended.stderr.contains("there are no networks"), "{}", ended.stderr);
}

#[test]
fn a_hub_that_is_pulled_out_of_the_plane_has_a_translation_in_space() {
    let workspace = workspace();
    let body = "geometry.bodies=[{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]], load: [0 N, 0 N, 0.2 N] }]";
    let more = [
        "--set",
        body,
        "--set",
        "geometry.cells=50",
        "--set",
        "drive.voltage=5.25 kV",
    ];
    let half: String = (0..50)
        .map(|_| [["1"; 25], ["0"; 25]].concat().join(",") + "\n")
        .collect();
    workspace.write("half.csv", &half);
    let coarse = ["--order", "1", "--json"];
    let first = [
        "solve",
        "scene.yaml",
        "half.csv",
        "-o",
        "out.h5",
        "--elements-per-cell",
        "1",
    ];
    let ended = workspace.run(&[&first[..], &coarse, &more].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json()["equilibria"][0].clone();
    let translation = found["body_translation_mm"][0].as_array().unwrap().iter().map(number);
    for (found, known) in translation.zip([1.59534, 0.0, 1.22249]) {
        assert!((found - known).abs() < 1e-5, "{found} {known}");
    }
    assert!(number(&found["body_rotation_deg"][0]).abs() < 1e-6);
    assert_eq!(found["pressure_pa"], 0.0);
    let ended = workspace.run(&[&first[..], &["--order", "1"], &more].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    for text in ["body", "1.595 mm", "1.222 mm"] {
        assert!(ended.stdout.contains(text), "{}", ended.stdout);
    }
    for path in ["--path", "--path=load"] {
        let refused = workspace.run(&[&first[..], &[path], &more].concat());
        let told = "bodies that move out of the plane are not simulated with `--path`";
        assert!(refused.code == Some(2) && refused.stderr.contains(told), "{refused}");
    }
    // Pulled apart: there is no motion to list.
    let far = "geometry.bodies.0.load=[0 N, 0 N, 100 N]";
    let ended = workspace.run(&[&first[..], &["--order", "1"], &more, &["--set", far]].concat());
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(
        ended.stdout.contains("limit-point") && !ended.stdout.contains("body"),
        "{}",
        ended.stdout
    );
}

#[test]
fn flat_membranes_have_frequencies_out_of_the_plane_and_a_voltage_at_which_they_buckle() {
    let workspace = workspace();
    let ended = solve(&workspace, &["--json", "--modes", "2"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json()["vibrations"][0].clone();
    let hertz = number(&found["out_of_plane_frequencies"][0]);
    assert!(hertz > 200.0 && hertz < number(&found["frequencies"][0]), "{found}");
    assert_eq!(found["out_of_plane_unstable"], 0);
    // Hardly stretched, the active half loses its tension long before it is unstable in the plane.
    let slack = ["--set", "geometry.prestretch=1.1", "--set", "drive.voltage=4 kV"];
    let ended = solve(&workspace, &[&["--json", "--path"][..], &slack].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let path = document["paths"][0].clone();
    let buckles = number(&path["out_of_plane"]["voltage"]);
    assert!(
        buckles > 0.0 && buckles < number(&path["limit"]["voltage"]),
        "{buckles}"
    );
    assert!(
        document["warnings"].to_string().contains("wrinkles or buckles"),
        "{document}"
    );
    let unstable = |volts: f64| {
        let voltage = format!("drive.voltage={volts} V");
        let more = [
            "--json",
            "--modes",
            "1",
            "--set",
            "geometry.prestretch=1.1",
            "--set",
            &voltage,
        ];
        let ended = solve(&workspace, &more);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        number(&ended.json()["vibrations"][0]["out_of_plane_unstable"])
    };
    assert_eq!(unstable(0.97 * buckles), 0.0);
    assert!(unstable(1.03 * buckles) > 0.0);
}
