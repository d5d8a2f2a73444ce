//! The yield of devices under tolerances, from the command line.

use serde_json::Value;

use super::common::{Ended, Workspace};

const SCENE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5.25 kV }
";

const TOLERANCES: &str = "tolerances: { voltage: 1 %, shear_modulus: { relative: 5 %, distribution: lognormal }, \
                          thickness: 3 %, mask: 0.3 mm, misregistration: [0.2 mm, 0 mm], lost_cells: 1 % }\n";

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &format!("{SCENE}{TOLERANCES}"));
    let half: String = (0..10).map(|_| "1,1,1,1,1,0,0,0,0,0\n").collect();
    workspace.write("half.csv", &half);
    workspace
}

fn yields(workspace: &Workspace, more: &[&str]) -> Ended {
    let first = [
        "yield",
        "scene.yaml",
        "half.csv",
        "--point",
        "25,25",
        "--direction",
        "0",
    ];
    workspace.run(&[&first[..], more].concat())
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[test]
fn a_yield_has_intervals_and_does_not_depend_on_threads() {
    let workspace = workspace();
    let options = ["--json", "--wanted", "2 mm", "--samples", "200", "-o", "devices.csv"];
    let ended = yields(&workspace, &[&options[..], &["-j", "1"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json()["patterns"][0].clone();
    let table = std::fs::read_to_string(workspace.path("devices.csv")).unwrap();
    let again = yields(&workspace, &[&options[..], &["-j", "2"]].concat());
    assert_eq!(again.json()["patterns"][0], found);
    assert_eq!(std::fs::read_to_string(workspace.path("devices.csv")).unwrap(), table);
    assert_eq!(table.lines().count(), 201);
    let header = "pattern,device,voltage_deviation,shear_modulus_deviation,thickness_deviation,mask_deviation,\
                  misregistration_x_deviation,outcome,displacement_mm";
    assert_eq!(table.lines().next(), Some(header));
    let mm: Vec<f64> = table
        .lines()
        .skip(1)
        .map(|line| line.rsplit(',').next().unwrap().parse().unwrap())
        .collect();
    let mean = mm.iter().sum::<f64>() / 200.0;
    assert!((number(&found["mean_mm"]["value"]) - mean).abs() < 1e-12);
    let reached = mm.iter().filter(|mm| **mm >= 2.0).count() as f64 / 200.0;
    assert_eq!(number(&found["yield"]["value"]), reached);
    let [low, high] = [0, 1].map(|end| number(&found["yield"]["interval"][end]));
    assert!(
        low < reached && reached < high && high - low < 0.15,
        "{low} {reached} {high}"
    );
    assert!(number(&found["shares"]["thickness"]) > number(&found["shares"]["voltage"]));
    // Another seed is another sample of the same distribution.
    let other = yields(&workspace, &[&options[..], &["--seed", "1"]].concat()).json()["patterns"][0].clone();
    let difference = number(&other["mean_mm"]["value"]) - mean;
    assert!(difference != 0.0 && difference.abs() < 0.02, "{difference}");
    let narrow = yields(
        &workspace,
        &["--json", "--wanted", "2 mm", "--samples", "100", "--within", "0.05"],
    )
    .json();
    let narrow = &narrow["patterns"][0];
    assert!(number(&narrow["samples"]) >= 200.0, "{narrow}");
    let value = number(&narrow["yield"]["value"]);
    assert!(
        [0, 1]
            .into_iter()
            .all(|end| (number(&narrow["yield"]["interval"][end]) - value).abs() <= 0.05)
    );
}

#[test]
fn what_a_yield_needs_is_said() {
    let workspace = workspace();
    workspace.write("bare.yaml", SCENE);
    let point: [&str; 2] = ["--point", "25,25"];
    let with = |first: &[&'static str], more: &[&'static str]| [&["yield"], first, &["half.csv"], more].concat();
    let cases: [(Vec<&str>, &str); 8] = [
        (with(&["bare.yaml"], &point), "no device differs from another"),
        (with(&["scene.yaml"], &[]), "--point"),
        (
            with(&["scene.yaml"], &["--point", "25,25", "--samples", "1"]),
            "2 to 65536",
        ),
        (
            with(&["scene.yaml"], &["--point", "25,25", "--within", "0.1"]),
            "--wanted",
        ),
        (
            with(
                &["scene.yaml"],
                &["--point", "25,25", "--set", "tolerances.voltage=20 %"],
            ),
            "0 % to 15 %",
        ),
        (
            with(
                &["scene.yaml"],
                &["--point", "25,25", "--set", "tolerances.voltage={ relative: 20 % }"],
            ),
            "lognormal",
        ),
        (
            with(&["scene.yaml"], &["--point", "25,25", "--set", "tolerances.width=1 mm"]),
            "width",
        ),
        (
            with(
                &["scene.yaml"],
                &["--point", "25,25", "--set", "loads={ pressure: 10 Pa }"],
            ),
            "pressure",
        ),
    ];
    for (arguments, why) in cases {
        let ended = workspace.run(&arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(why), "{arguments:?}: {}", ended.stderr);
    }
}

/// Tolerances are no part of what a stage depends on.
#[test]
fn tolerances_rebuild_nothing() {
    let workspace = workspace();
    let pipeline = |tolerances: &str| {
        format!(
            "version: 1\nname: made\nscene: {{ {}{tolerances} }}\nstages:\n  small: {{ kind: sample, family: \
             small-grid, count: 2, seed: 1 }}\n  solved: {{ kind: solve, needs: [small] }}\n",
            SCENE.trim_end().replace('\n', ", ")
        )
    };
    workspace.write("made.yaml", &pipeline(""));
    assert_eq!(workspace.run(&["run", "made.yaml"]).code, Some(0));
    workspace.write("made.yaml", &pipeline(", tolerances: { mask: 0.1 mm }"));
    let plan = workspace.run(&["plan", "made.yaml", "--json"]).json();
    for stage in plan["stages"].as_array().unwrap() {
        assert_ne!(stage["outcome"], "stale", "{stage}");
    }
}
