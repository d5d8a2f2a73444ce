//! Screening: the table, `effects: auto`, and the warnings of a run.

use super::common::{TINY, Transcript, Workspace, csv, snapshot};

const SCENE: &str = "\
geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5.25 kV }
effects: EFFECTS
properties: { strain_stiffening: { model: gent, jm: 125 } }
";

fn screened(effects: &str) -> serde_json::Value {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &SCENE.replace("EFFECTS", effects));
    let ended = workspace.run(&["screen", "scene.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    ended.json()
}

#[test]
fn a_scene_is_screened_with_number_threshold_and_verdict() {
    let document = screened("{}");
    let rows = document["effects"].as_array().unwrap();
    let row = |name: &str| rows.iter().find(|row| row["effect"] == name).unwrap();
    let stiffening = row("strain_stiffening");
    let patterns = stiffening["patterns"].as_array().unwrap();
    let differences = patterns.iter().map(|pattern| pattern["difference"].as_f64().unwrap());
    assert_eq!(stiffening["number"].as_f64(), differences.reduce(f64::max));
    assert_eq!(
        (&stiffening["called_for"], &stiffening["status"]),
        (&"yes".into(), &"off".into())
    );
    let half = patterns
        .iter()
        .find(|pattern| pattern["pattern"] == "half plane")
        .unwrap();
    // Half of a membrane under Gent's law and without it, which nobody screened: the same on a finer mesh to a
    // hundredth of the change.
    let change = half["change"].as_f64().unwrap();
    let [without, with] = ["{}", "{ strain_stiffening: { model: gent, jm: 125 } }"].map(half_moves);
    assert!(
        (change / (with / without - 1.0) - 1.0).abs() < 0.01,
        "{change} {with} {without}"
    );
    assert_eq!(row("inertia")["status"], "off");
    assert!(rows.iter().all(|row| row["status"] == "off"), "{rows:?}");
    assert_eq!(document["simulated"].as_array().unwrap().len(), 0);
    let warning = document["warnings"][0].as_str().unwrap();
    for part in ["strain stiffening", " %", "2 %"] {
        assert!(warning.contains(part), "{warning}");
    }
    snapshot!(warning);
}

/// The largest displacement of half of a membrane with some effects, as `solve` writes it.
fn half_moves(effects: &str) -> f64 {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &SCENE.replace("EFFECTS", effects));
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let ended = workspace.run(&["solve", "scene.yaml", "half.csv", "-o", "out.h5", "--order", "2"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let field = file.dataset("displacement").unwrap().read_raw::<f32>().unwrap();
    let lengths = field.chunks_exact(2).map(|u| f64::from(u[0].hypot(u[1])));
    lengths.reduce(f64::max).unwrap()
}

#[test]
fn the_scene_near_pull_in_is_below_it() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let workspace = Workspace::new();
    let scene = std::fs::read_to_string(root.join("pipelines/scenes/near-pull-in.yaml")).unwrap();
    workspace.write("scene.yaml", &scene);
    let document = workspace.run(&["screen", "scene.yaml", "--json"]).json();
    let rows = document["effects"].as_array().unwrap();
    let row = rows
        .iter()
        .find(|row| row["effect"] == "electromechanical_stability")
        .unwrap();
    let [number, error] = ["number", "error"].map(|key| row[key].as_f64().unwrap());
    assert!(number > 0.9 && number + error < 1.0, "{number} {error}");
}

#[test]
fn auto_simulates_significant_effects() {
    let document = screened("auto");
    let simulated: Vec<&str> = document["simulated"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|s| s.as_str())
        .collect();
    assert_eq!(simulated, ["strain_stiffening", "fringe_field"]);
    assert_eq!(document["warnings"].as_array().unwrap().len(), 0);
}

#[test]
fn a_run_warns_of_neglected_effects() {
    let workspace = Workspace::new();
    workspace.write("tiny.yaml", TINY);
    let first = workspace.run(&["run", "tiny.yaml", "--until", "solved", "--json"]);
    let warnings = first.json()["warnings"].clone();
    let warning = warnings[0].as_str().unwrap();
    assert!(
        warning.starts_with("solved: ") && warning.contains("fringe field"),
        "{warning}"
    );
    snapshot!(warning);
    // What is reused still lacks it.
    let again = workspace.run(&["run", "tiny.yaml", "--until", "solved"]);
    assert!(again.stdout.contains(warning), "{}", again.stdout);
}

#[test]
fn electrodes_with_a_resistance_need_leads() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &SCENE.replace("EFFECTS", "{ electrode_resistance: {} }"));
    let ended = workspace.run(&["screen", "scene.yaml"]);
    assert_eq!(ended.code, Some(2));
    for part in ["`electrode_resistance`", "`sheet_resistance`", "scene.yaml:4"] {
        assert!(ended.stderr.contains(part), "{part}: {ended}");
    }
    let mut printed = Transcript::default();
    printed.add("no sheet resistance", ended);
    let wired = SCENE.replace("EFFECTS", "{ electrode_resistance: { sheet_resistance: 50 kOhm } }");
    workspace.write("scene.yaml", &wired);
    let ended = workspace.run(&["screen", "scene.yaml"]);
    assert_eq!(ended.code, Some(2));
    for part in ["`electrode_resistance`", "`leads`", "help"] {
        assert!(ended.stderr.contains(part), "{part}: {ended}");
    }
    printed.add("no leads", ended);
    snapshot!(printed);
}

#[test]
fn an_effect_that_is_on_is_observed_in_every_sample() {
    let workspace = Workspace::new();
    workspace.write("tiny.yaml", TINY);
    let set = "scene.effects={ dielectric_breakdown: { law: constant, field: 50 MV/m } }";
    let ended = workspace.run(&["run", "tiny.yaml", "--until", "solved", "--set", set, "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let warnings = ended.json()["warnings"].to_string();
    // An active cell that expands by 6 % is beyond 50 MV/m.
    assert!(warnings.contains("82"), "{warnings}");
    snapshot!(warnings);
    let shown = workspace.run(&["show", "solved", "--json"]).json();
    let datasets = shown["datasets"].as_array().unwrap();
    let ratio = datasets.iter().find(|d| d["path"] == "breakdown_ratio").unwrap();
    assert_eq!(ratio["shape"][0], 82);
    let plain = workspace.run(&["run", "tiny.yaml", "--until", "solved", "--json"]);
    assert_eq!(plain.code, Some(0));
    let shown = workspace.run(&["show", "solved", "--json"]).json();
    assert!(!shown.to_string().contains("breakdown_ratio"));
}

#[test]
fn a_run_whose_artifacts_carry_no_breakdown_ratio_ends_well() {
    // An estimate is no state to read a field from, and a verified design keeps no ratio.
    let workspace = Workspace::new();
    workspace.write("tiny.yaml", TINY);
    let effects = "scene.effects={ dielectric_breakdown: { law: huang } }";
    let sets = ["--set", effects, "--set", "stages.solved.method=linear"];
    let ended = workspace.run(&[&["run", "tiny.yaml", "--until", "verified", "--json"], &sets[..]].concat());
    assert_eq!(ended.code, Some(0), "{}\n{}", ended.stdout, ended.stderr);
    assert_eq!(ended.json()["results"].as_array().unwrap().len(), 1);
}

/// A single cell at thrice the voltage at which it would snap without stiffening.
const FAR_BEYOND: &str = "\
geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 16 kV }
effects: { strain_stiffening: { model: yeoh, c2: -150 Pa, c3: 4 Pa } }
";

#[test]
fn a_pattern_that_takes_too_long_ends_with_an_outcome_and_more_time_may_be_given() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", FAR_BEYOND);
    workspace.write("cell.csv", &csv(|x, y| (x, y) == (25, 25)));
    let solve = |time: &[&str]| {
        let plain = [
            "solve",
            "scene.yaml",
            "cell.csv",
            "-o",
            "out.h5",
            "--order",
            "1",
            "--json",
        ];
        let ended = workspace.run(&[&plain, time].concat());
        (ended.code, ended.json())
    };
    let (code, document) = solve(&["--time-limit", "0.05 s"]);
    assert_eq!((code, &document["unstable"]), (Some(3), &1.into()), "{document}");
    let outcome = document["unstable_samples"][0]["outcome"].as_str().unwrap();
    assert!(outcome.starts_with("work-limit"), "{document}");
    let (code, document) = solve(&["--time-limit", "30 s"]);
    assert_eq!((code, &document["unstable"]), (Some(0), &0.into()), "{document}");
    for (time, named) in [("0 s", "1 ms to 1e6 s"), ("5 mm", "s"), ("soon", "soon")] {
        let arguments = ["solve", "scene.yaml", "cell.csv", "-o", "out.h5", "--time-limit", time];
        let ended = workspace.run(&arguments);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(ended.stderr.contains(named), "{}", ended.stderr);
    }
}
