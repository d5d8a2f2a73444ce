//! `deaflow measure` on files of specimens and devices.

use serde_json::{Value, json};

use super::common::Workspace;

const DEVICE: &str = "geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 4 }
material: { model: neo-hookean, shear_modulus: 60 kPa, relative_permittivity: 4.7 }
drive: { voltage: 4 kV }
effects: {}
";

fn with_files() -> Workspace {
    let workspace = Workspace::new();
    for (name, text) in [
        ("device.yaml", DEVICE),
        ("half.csv", "1,1,0,0\n1,1,0,0\n1,1,0,0\n1,1,0,0\n"),
        (
            "ut.csv",
            "strain_%,nominal_stress_MPa\n0,0\n50,0.05\n100,0.08\n",
        ),
        (
            "relax.csv",
            "time_s,stretch,nominal_stress_kPa,sigma_Pa\n1,2,60,500\n10,2,50,400\n",
        ),
        (
            "centre.csv",
            "voltage_kV,displacement [um]\n1,31\n4,843\n5,1375\n",
        ),
        (
            "dic.csv",
            "x_px,y_px,ux_px,uy_px\n500,500,12,1\n1000,1000,30,-1\n1500,500,11,1\n1000,1500,,\n4000,100,1,1\n500,1500,9,-2\n",
        ),
        (
            "list.yaml",
            "files:
  - { file: relax.csv, test: uniaxial }
  - { file: centre.csv, test: voltage-displacement, pattern: half.csv, point: [25 mm, 25 mm], direction: 0 deg, sigma: 10 um }
  - { file: dic.csv, test: field, pattern: half.csv, voltage: 4 kV, scale: 25 um/px }
",
        ),
    ] {
        workspace.write(name, text);
    }
    workspace
}

fn ends(file: &Value, name: &str) -> Value {
    let ranges = file["ranges"].as_array().unwrap();
    let range = ranges.iter().find(|range| range["name"] == name);
    range.unwrap_or_else(|| panic!("{name}: {file}"))["ends"].clone()
}

#[test]
fn ranges_noise_and_left_out_rows_are_shown() {
    let workspace = with_files();
    let ended = workspace.run(&[
        "measure",
        "uniaxial=ut.csv",
        "list.yaml",
        "--sigma",
        "2 %",
        "--json",
        "-o",
        "read.png",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let found = ended.json();
    let files = found["files"].as_array().unwrap();
    let [curve, history, series, field] = &files[..] else {
        panic!("{found}")
    };
    assert_eq!((&curve["rows"], &curve["used"]), (&json!(3), &json!(2)));
    assert_eq!(
        (ends(curve, "stretch"), ends(curve, "nominal stress")),
        (json!([1.0, 2.0]), json!([0.0, 80e3]))
    );
    assert_eq!(curve["sigma"], json!({ "source": "usual", "share": 0.02 }));
    assert_eq!(
        (&history["quantities"], ends(history, "time")),
        (&json!("stress-time"), json!([1.0, 10.0]))
    );
    assert_eq!(
        history["sigma"],
        json!({ "source": "column", "ends": [400.0, 500.0], "unit": "Pa" })
    );
    assert_eq!(
        (ends(series, "voltage"), ends(series, "displacement")),
        (json!([1e3, 5e3]), json!([0.031, 1.375]))
    );
    assert_eq!(
        series["sigma"],
        json!({ "source": "entry", "ends": [0.01, 0.01], "unit": "mm" })
    );
    assert_eq!(series["electrode_area"], 0.5);
    assert_eq!(
        (&field["rows"], &field["used"], ends(field, "x")),
        (&json!(6), &json!(5), json!([12.5, 100.0]))
    );
    assert_eq!(field["sigma"], json!({ "source": "unknown", "assumed": "absolute" }));
    assert_eq!(
        field["entry"],
        json!(["pattern: half.csv", "voltage: 4 kV", "scale: 25 um/px"])
    );
    assert_eq!(
        found["notes"],
        json!(["dic.csv: 1 of 6 rows have no numbers, and are not used"])
    );
    assert!(ended.stderr.contains("1 of 6 rows have no numbers"), "{}", ended.stderr);
    let picture = std::fs::read(workspace.path("read.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && found["figure"] == "read.png");
}

#[test]
fn a_scene_tells_which_points_are_on_the_membrane() {
    let workspace = with_files();
    let ended = workspace.run(&["measure", "list.yaml", "--scene", "device.yaml"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    for part in ["1 of 6 rows have no numbers", "1 of 6 points are not on the membrane"] {
        assert!(ended.stderr.contains(part), "{}", ended.stderr);
    }
    for part in [
        "0.03100 to 1.375 mm",
        "0.01000 mm",
        "scale: 25 um/px",
        "0.4000 to 0.5000 kPa (column)",
        "equal at all points",
    ] {
        assert!(ended.stdout.contains(part), "{part}: {}", ended.stdout);
    }
    let alone = workspace.run(&["measure", "uniaxial=ut.csv"]);
    assert!(
        alone.stdout.contains("1 row at a stretch of 1") && alone.stdout.contains("unknown, in proportion"),
        "{}",
        alone.stdout
    );
}

#[test]
fn what_cannot_be_read_is_refused_with_the_reason() {
    let workspace = with_files();
    workspace.write("wide.csv", "1,1,0,0,1\n1,1,0,0,1\n");
    workspace.write(
        "wide.yaml",
        "files: [ { file: dic.csv, test: field, pattern: wide.csv, scale: 25 um/px } ]",
    );
    workspace.write(
        "px.yaml",
        "files: [ { file: dic.csv, test: field, pattern: half.csv } ]",
    );
    for (arguments, says) in [
        (&["ut.csv"][..], "name the test, as in uniaxial=ut.csv"),
        (&["uniaxial=none.csv"], "none.csv"),
        (
            &["uniaxial=ut.csv", "uniaxial=ut.csv"],
            "the file ut.csv is listed twice",
        ),
        (&["uniaxial=centre.csv"], "there is no column `stretch`"),
        (&["px.yaml"], "state the size of a pixel"),
        (&["wide.yaml", "--scene", "device.yaml"], "wide.csv"),
        (&["uniaxial=ut.csv", "-o", "ut.csv"], "is an input"),
        (&["list.yaml", "-o", "half.csv"], "is an input"),
        (&["uniaxial=ut.csv", "--sigma", "2 mm"], "mm"),
        (
            &["uniaxial=ut.csv", "--absolute", "--sigma", "2 %"],
            "cannot be used with",
        ),
    ] {
        let ended = workspace.run(&[&["measure"], arguments].concat());
        let flat = ended.stderr.replace("\n  │ ", " ").replace("\n  | ", " ");
        assert!(
            ended.code == Some(2) && flat.contains(says),
            "{arguments:?}: {:?} {}",
            ended.code,
            ended.stderr
        );
    }
    // Nothing is drawn if a file cannot be read.
    assert!(!workspace.path("read.png").exists());
}

/// Motions of a device that are simulated by `compare` are read by a pipeline, and agree with it.
#[test]
fn motions_of_a_device_are_read_stored_and_compared() {
    let workspace = with_files();
    let effects = "effects: { inertia: { density: 960 kg/m3 }, viscoelasticity: { branches: [ { modulus: 20 kPa, time: 0.1 s } ] } }";
    workspace.write("device.yaml", &DEVICE.replace("effects: {}", effects));
    let point = "pattern: half.csv, point: [25 mm, 25 mm], direction: 0 deg";
    let entries = format!(
        "
    - {{ file: motion.csv, test: time-displacement, {point} }}
    - {{ file: response.csv, test: frequency-response, {point}, alternating: 50 V, sigma: 2 % }}
"
    );
    workspace.write("motions.yaml", &format!("files:{entries}"));
    workspace.write(
        "motion.csv",
        "time_s,voltage_kV,displacement_mm\n0,0,0\n0.1,3,0\n0.4,3,0\n",
    );
    workspace.write(
        "response.csv",
        "frequency_Hz,amplitude_um,phase_deg\n1,1,1\n10,1,1\n40,1,1\n",
    );
    let mesh = ["--elements-per-cell", "1"];
    let ended = workspace.run(
        &[
            &["compare", "device.yaml", "motions.yaml", "-o", "truth.csv"],
            &mesh[..],
        ]
        .concat(),
    );
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let table = std::fs::read_to_string(workspace.path("truth.csv")).unwrap();
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let of = |component: &str| -> Vec<f64> {
        // From the end: the name of a file may have a comma.
        let own = rows.iter().filter(|row| row[row.len() - 4] == component);
        own.map(|row| row[row.len() - 2].parse().unwrap()).collect()
    };
    let (u, amplitude, phase) = (of("u"), of("amplitude"), of("phase"));
    assert!(u.len() == 3 && u[2] > 0.05 && amplitude[0] > 1e-4, "{table}");
    let phase: Vec<f64> = phase
        .iter()
        .map(|phase| (phase + 180.0).rem_euclid(360.0) - 180.0)
        .collect();
    workspace.write(
        "motion.csv",
        &format!(
            "time_s,voltage_kV,displacement_mm\n0,0,{}\n0.1,3,{}\n0.4,3,{}\n",
            u[0], u[1], u[2]
        ),
    );
    let rows = [1.0, 10.0, 40.0].into_iter().zip(amplitude.iter().zip(&phase));
    let rows = rows.map(|(frequency, (mm, deg))| format!("{frequency},{},{deg}\n", 1e3 * mm));
    workspace.write(
        "response.csv",
        &format!("frequency_Hz,amplitude_um,phase_deg\n{}", rows.collect::<String>()),
    );
    workspace.write(
        "motions-pipeline.yaml",
        &format!(
            "version: 1
name: motions
scene: device.yaml
stages:
  seen:
    kind: measure
    files:{entries}
  beside: {{ kind: compare, needs: [seen], elements_per_cell: 1 }}
"
        ),
    );
    let ended = workspace.run(&["run", "motions-pipeline.yaml", "--json"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let run = ended.json();
    let files = run["comparisons"][0]["files"].as_array().unwrap();
    let names: Vec<&str> = files.iter().map(|file| file["file"].as_str().unwrap()).collect();
    assert_eq!(names, ["motion.csv", "response.csv", "response.csv, phase"]);
    for (file, size) in files.iter().zip([u[2], amplitude[0], 180.0]) {
        assert!(file["rms"].as_f64().unwrap() < 1e-9 * size, "{file}");
    }
    let ended = workspace.run(&["report", "motions-pipeline.yaml", "-o", "report"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    assert!(page.contains("frequency, Hz") && page.contains("phase, deg"));
}
