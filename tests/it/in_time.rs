//! Histories, natural frequencies and charges on the command line and in pipelines.

use crate::common::{Transcript, Workspace, snapshot};

const SCENE: &str = "
geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 10 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { DRIVE }
effects: { viscoelasticity: {} }
properties: { viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 s }] }, density: 960 }
";

fn workspace(drive: &str) -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &SCENE.replace("DRIVE", drive));
    let rows: Vec<String> = (0..10)
        .map(|y| {
            (0..10)
                .map(|x| if (x + y) % 3 == 0 { "1" } else { "0" })
                .collect::<Vec<_>>()
                .join(",")
        })
        .collect();
    workspace.write("odd.csv", &rows.join("\n"));
    workspace
}

#[test]
fn a_history_has_its_arrays_its_table_and_its_figure() {
    let workspace = workspace("voltage: 5 kV, waveform: { step: {} }, duration: 10 s");
    const HISTORY: [&str; 7] = ["solve", "scene.yaml", "odd.csv", "-o", "out.h5", "--history", "--at"];
    let ended = workspace.run(&[&HISTORY[..], &["10 s, 0 s, 1 s", "--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    assert_eq!(document["times"], serde_json::json!([0.0, 1.0, 10.0]));
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let shape = |name: &str| file.dataset(name).unwrap().shape();
    assert_eq!(shape("displacement"), [1, 3, 11, 11, 2]);
    assert_eq!(
        (shape("time"), shape("charge"), shape("outcome")),
        (vec![3], vec![1, 3], vec![1])
    );
    let moved = file.dataset("max_displacement").unwrap().read_raw::<f64>().unwrap();
    assert!(moved[0] < moved[1] && moved[1] < moved[2], "{moved:?}");
    let error = file.dataset("error_in_time").unwrap().read_raw::<f64>().unwrap()[0];
    assert!(error > 0.0 && error < 1e-4 * moved[2], "{error}");
    let table = std::fs::read_to_string(workspace.path("out.csv")).unwrap();
    assert!(table.starts_with("pattern,time_s,voltage_V,"), "{table}");
    assert!(table.lines().count() > 20);
    assert!(
        std::fs::read(workspace.path("out.png"))
            .unwrap()
            .starts_with(b"\x89PNG")
    );
    // Each time has its row, and the rows of the file their times.
    let told = workspace.run(&[&HISTORY[..], &["0 s, 1 s, 10 s"]].concat());
    for words in ["0 s", "1 s", "10 s"] {
        let has = |line: &str| line.split("  ").any(|cell| cell.trim() == words);
        assert!(told.stdout.lines().any(has), "{words}: {}", told.stdout);
    }
    assert!(told.stdout.contains("out.csv-metadata.json"), "{}", told.stdout);
    let rows = workspace.run(&["show", "out.h5", "--csv"]).stdout;
    let header: Vec<&str> = rows.lines().next().unwrap().split(',').collect();
    let of = |name: &str| {
        let at = header.iter().position(|column| *column == name).expect(name);
        rows.lines().nth(1).unwrap().split(',').nth(at).unwrap()
    };
    assert_eq!((of("time.0_s"), of("time.1_s"), of("time.2_s")), ("0.0", "1.0", "10.0"));
    // The end of creep is the equilibrium, which says what it leaves out.
    let still = workspace.run(&["solve", "scene.yaml", "odd.csv", "-o", "still.h5"]);
    assert_eq!(still.code, Some(0), "{}", still.stderr);
    assert!(still.stdout.contains("viscoelasticity"), "{still}");
    snapshot!(still.stdout);
    // Evenly spaced times up to the end of the drive; without an end they are asked for.
    let every = workspace.run(&[
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "every.h5",
        "--history",
        "--every",
        "2.5 s",
        "--json",
    ]);
    assert_eq!(every.json()["times"], serde_json::json!([0.0, 2.5, 5.0, 7.5, 10.0]));
    let uneven = workspace.run(&[
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "every.h5",
        "--history",
        "--every",
        "4 s",
        "--json",
    ]);
    assert_eq!(uneven.json()["times"], serde_json::json!([0.0, 4.0, 8.0, 10.0]));
}

#[test]
fn a_history_of_bodies_has_their_motion_at_each_time() {
    let workspace = workspace("voltage: 3 kV");
    let scene = SCENE.replace("DRIVE", "voltage: 3 kV").replace(
        "cells: 10",
        "cells: 10, bodies: [{ rectangle: [[20 mm, 20 mm], [30 mm, 30 mm]], load: [10 mN, 0 N] }]",
    );
    workspace.write("scene.yaml", &scene);
    let ended = workspace.run(&[
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "out.h5",
        "--history",
        "--at",
        "0 s, 1 s, 9 s",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let moved = file.dataset("body_translation").unwrap();
    assert_eq!(moved.shape(), [1, 3, 1, 2]);
    let along: Vec<f64> = moved.read_raw::<f64>().unwrap().into_iter().step_by(2).collect();
    assert!(
        0.0 < along[0] && along[0] < along[1] && along[1] < along[2],
        "{along:?}"
    );
    workspace.write("creep.yaml", PIPELINE);
    let ran = workspace.run(&["run", "creep.yaml", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    // With inertia they swing.
    workspace.write("scene.yaml", &scene.replace("effects: {", "effects: { inertia: {},"));
    let swung = workspace.run(&[
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "swing.h5",
        "--history",
        "--at",
        "1 ms, 2 ms",
    ]);
    assert_eq!(swung.code, Some(0), "{}", swung.stderr);
    let file = hdf5::File::open(workspace.path("swing.h5")).unwrap();
    let moved = file.dataset("body_translation").unwrap();
    assert_eq!(moved.shape(), [1, 2, 1, 2]);
    let along = moved.read_raw::<f64>().unwrap()[0];
    assert!(along > 0.0, "{along}");
}

/// A strip with a weight on a bar, with branches.
const STRIP: &str = "
geometry: { size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 2, cells: [8, 4], sides: { right: { bar: { load: [0.3 N, 0 N] } }, top: free, bottom: free } }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 6 kV }
effects: { viscoelasticity: { branches: [{ modulus: 45 kPa, time: 1 s }] } }
properties: { density: 960 kg/m3 }
";

const LIFT: &str = "
version: 1
name: lift
scene: strip.yaml
stages:
  blocks: { kind: sample, family: large-grid, units: [4], count_per_units: 3, seed: 1 }
  crept: { kind: solve, needs: [blocks], elements_per_cell: 1, history: { at: [0.1 s, 10 s] } }
  still: { kind: solve, needs: [blocks], elements_per_cell: 1 }
  searched: { kind: design, method: adjoint, objective: { bar: right, direction: 0 deg, time: 1 s }, area: 0.5, starts: 1, seed: 1 }
  verified: { kind: verify, needs: [searched], elements_per_cell: 1, history: { at: [1 s] } }
";

#[test]
fn a_history_of_free_sides_counts_from_the_released_state() {
    let workspace = Workspace::new();
    workspace.write("strip.yaml", STRIP);
    workspace.write("middle.csv", &["0,1,1,1,1,1,1,0"; 4].join("\n"));
    let ended = workspace.run(&[
        "solve",
        "strip.yaml",
        "middle.csv",
        "-o",
        "out.h5",
        "--history",
        "--at",
        "0 s, 1 s, 20 s",
        "--json",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let along = document["histories"][0]["bars"]["right"]["from_rest_mm"][0]
        .as_f64()
        .unwrap();
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let read = |name: &str| file.dataset(name).unwrap().read_raw::<f64>().unwrap();
    assert_eq!(file.dataset("bar_translation").unwrap().shape(), [1, 3, 1, 2]);
    assert_eq!(file.dataset("rest").unwrap().shape(), [1, 5, 9, 2]);
    let (bars, rest, largest) = (read("bar_translation"), read("rest"), read("max_displacement"));
    // The middle of the bar is the corner (8, 2).
    let at_rest = rest[2 * (2 * 9 + 8)];
    let strokes = [0, 1, 2].map(|k| bars[2 * k] - at_rest);
    assert!(
        0.0 < strokes[0] && strokes[0] < strokes[1] && strokes[1] < strokes[2],
        "{strokes:?}"
    );
    assert!(
        at_rest < -10.0 && (strokes[2] - along).abs() < 1e-9,
        "{at_rest} {along}"
    );
    assert!(largest.iter().all(|largest| *largest < 2.0), "{largest:?}");

    workspace.write("lift.yaml", LIFT);
    let ran = workspace.run(&["run", "lift.yaml", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    let plan = |set: &str| {
        let document = workspace.run(&["plan", "lift.yaml", "--json", "--set", set]).json();
        let stages = document["stages"].as_array().unwrap().clone();
        let stale = stages.iter().filter(|stage| stage["outcome"] == "stale");
        stale
            .map(|stage| stage["name"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    // A mass is in no key without inertia.
    assert_eq!(plan("scene.geometry.sides.right.bar.mass=20 g"), Vec::<String>::new());
    let refused = workspace.run(&["plan", "lift.yaml", "--set", "scene.drive.rest=1 min"]);
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    assert!(refused.stderr.contains("`rest`"), "{}", refused.stderr);
    let moving = STRIP.replace("load: [0.3 N, 0 N]", "load: [0.3 N, 0 N], mass: 10 g");
    let moving = moving.replace("effects: {", "effects: { inertia: {},");
    workspace.write("strip.yaml", &moving);
    let swung = workspace.run(&[
        "solve",
        "strip.yaml",
        "middle.csv",
        "-o",
        "swing.h5",
        "--history",
        "--at",
        "5 ms",
    ]);
    assert_eq!(swung.code, Some(0), "{}", swung.stderr);
    assert!(
        swung
            .stdout
            .contains("pattern 0 at 0.005 s: the bar on the right side moves by"),
        "{}",
        swung.stdout
    );
}

#[test]
fn a_requested_point_is_a_column_of_histories_and_paths() {
    let workspace = workspace("voltage: 4 kV, waveform: { step: {} }, duration: 10 s");
    let run = |form: &[&str], more: &[&str]| {
        let first = [
            "solve",
            "scene.yaml",
            "odd.csv",
            "-o",
            "out.h5",
            "--elements-per-cell",
            "1",
        ];
        let ended = workspace.run(&[&first[..], form, more].concat());
        assert_eq!(ended.code, Some(0), "{ended}");
        ended
    };
    let file = |name: &str| {
        let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
        file.dataset(name).unwrap().read_raw::<f64>().unwrap()
    };
    // The point that moves most, so that its displacement is known.
    let watched = |one: &serde_json::Value| {
        let [x, y] = [0, 1].map(|c| 5.0 * one["watched_corner"][c].as_f64().unwrap());
        format!("{x} mm, {y} mm")
    };
    let history = ["--history", "--at", "0 s, 1 s, 10 s"];
    let most = run(&history, &["--json"]).json()["histories"][0].clone();
    let point = watched(&most);
    let found = run(&history, &["--json", "--point", &point]).json();
    let own = &found["histories"][0];
    let [along, largest] = [&own["along_mm"][2], &most["max_displacement"][2]].map(|mm| mm.as_f64().unwrap());
    assert!((along - largest).abs() < 1e-9, "{along} {largest}");
    assert_eq!(found["along"]["direction_deg"], serde_json::Value::Null);
    assert_eq!(serde_json::json!(file("at_point")), own["along_mm"]);
    let table = std::fs::read_to_string(workspace.path("out.csv")).unwrap();
    assert!(
        table.lines().next().unwrap().ends_with(",point_displacement_mm"),
        "{table}"
    );
    let known = table.lines().skip(1).filter(|line| !line.ends_with(','));
    assert_eq!(known.count(), 3, "{table}");
    let told = run(&history, &["--point", &point, "--direction", "0 deg"]).stdout;
    assert!(told.contains("along 0 deg"), "{told}");

    let path = ["--path", "--order", "1"];
    let most = run(&path, &["--json"]).json()["paths"][0].clone();
    let found = run(&path, &["--json", "--point", &watched(&most)]).json()["paths"][0].clone();
    let points = found["points"].as_array().unwrap();
    assert!(points.len() > 5, "{points:?}");
    for point in points {
        let [along, displacement] = ["along_mm", "displacement"].map(|key| point[key].as_f64().unwrap());
        assert!((along - displacement).abs() < 1e-9, "{point}");
    }
    assert_eq!(file("at_point").len(), points.len());
    let table = std::fs::read_to_string(workspace.path("out.csv")).unwrap();
    assert!(
        table.lines().next().unwrap().ends_with(",point_displacement_mm"),
        "{table}"
    );
    let told = run(&path, &["--point", "25 mm, 25 mm", "--direction", "0 deg"]).stdout;
    assert!(told.contains("along 0 deg"), "{told}");
}

#[test]
fn each_form_warns_of_neglected_effects_whose_data_the_scene_has() {
    let workspace = workspace("voltage: 4 kV");
    let scene = SCENE
        .replace("DRIVE", "voltage: 4 kV")
        .replace("effects: { viscoelasticity: {} }", "effects: {}")
        .replace(
            "properties: {",
            "properties: { strain_stiffening: { model: gent, jm: 125 },",
        );
    workspace.write("scene.yaml", &scene);
    let solve = [
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "out.h5",
        "--elements-per-cell",
        "1",
    ];
    let tolerances = "tolerances={ thickness: 1 % }";
    let made = [
        "yield",
        "scene.yaml",
        "odd.csv",
        "--point",
        "25,25",
        "--samples",
        "2",
        "--set",
        tolerances,
    ];
    let off = "strain stiffening is off";
    let forms: [&[&str]; 6] = [
        &[],
        &["--path"],
        &["--modes", "1"],
        &["--response", "1Hz:10Hz", "--points", "2"],
        &["--set", "loads={ pressure: 10 Pa }"],
        &["--path=pressure", "--set", "loads={ pressure: 10 Pa }"],
    ];
    let all = forms
        .iter()
        .map(|form| [&solve[..], form].concat())
        .chain([made.to_vec()]);
    for arguments in all {
        let ended = workspace.run(&arguments);
        assert_eq!(ended.code, Some(0), "{arguments:?}: {ended}");
        assert!(
            ended.stdout.contains(&format!("model warning: {off}")),
            "{arguments:?}: {ended}"
        );
        let document = workspace.run(&[&arguments[..], &["--json"]].concat()).json();
        let warnings = document["warnings"].as_array().unwrap();
        assert!(
            warnings
                .iter()
                .any(|warning| warning.as_str().unwrap().starts_with(off)),
            "{document}"
        );
        let unchecked = "not checked, no data: electrode stiffness, stretch dependent permittivity";
        let is_said = warnings
            .iter()
            .any(|warning| warning.as_str().unwrap().starts_with(unchecked));
        assert!(is_said, "{arguments:?}: {document}");
    }
}

#[test]
fn options_that_a_history_lacks_or_excludes_are_refused() {
    let workspace = workspace("voltage: 5 kV");
    let mut printed = Transcript::default();
    for (more, parts) in [
        (vec!["--history"], ["`duration`", ""]),
        (vec!["--history", "--at", "1 V"], ["1 V", ""]),
        (
            vec!["--history", "--at", "1 s, 20 s", "--set", "drive.duration=10 s"],
            ["--at 20 s", "10 s"],
        ),
        (vec!["--at", "1 s"], ["--history", ""]),
        (
            vec!["--history", "--at", "1 s", "--method", "linear"],
            ["--history", "--method linear"],
        ),
        (vec!["--history", "--path"], ["--history", "--path"]),
        (vec!["--path", "pressure"], ["--path=pressure", ""]),
        (vec!["--modes", "2", "--point", "25,25"], ["--point", "--modes"]),
        (vec!["--lumped"], ["--modes", ""]),
        (vec!["--response", "1Hz:10Hz", "--lumped"], ["--response", "--lumped"]),
        (vec!["--response", "1Hz:10Hz", "--at", "1 s"], ["--response", "--at"]),
        (vec!["--modes", "2", "--at", "1 s"], ["--modes", "--at"]),
    ] {
        let ended = workspace.run(&[&["solve", "scene.yaml", "odd.csv", "-o", "out.h5"], &more[..]].concat());
        assert_eq!(ended.code, Some(2), "{more:?}: {}", ended.stderr);
        for part in parts {
            assert!(ended.stderr.contains(part), "{more:?}: {}", ended.stderr);
        }
        printed.add(more.join(" "), ended);
    }
    snapshot!(printed);
}

#[test]
fn a_table_beside_the_scene_drives_and_is_refused_by_line() {
    let workspace = workspace("waveform: { table: drive.csv }");
    workspace.write("drive.csv", "t_s,voltage_V\n0,0\n1,5000\n1,2000\n3,2000\n");
    let solve = [
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "out.h5",
        "--history",
        "--at",
        "1 s, 2 s",
    ];
    let ended = workspace.run(&solve);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let volts = file.dataset("voltage").unwrap().read_raw::<f64>().unwrap();
    assert_eq!(volts, [2000.0, 2000.0]);
    // The table is not overwritten by the one that is written beside the arrays.
    let over = workspace.run(&[
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "drive.h5",
        "--history",
        "--at",
        "1 s",
    ]);
    assert_eq!(over.code, Some(2), "{}", over.stderr);
    assert!(over.stderr.contains("drive.csv"), "{}", over.stderr);
    workspace.write("drive.csv", "t_s,voltage_V\n0,0\n2,5000\n1,2000\n");
    let ended = workspace.run(&solve);
    assert_eq!(ended.code, Some(2));
    for part in ["drive.csv", "line 4", "1 s", "2 s", "scene.yaml:4"] {
        assert!(ended.stderr.contains(part), "{part}: {ended}");
    }
    snapshot!(ended);
}

#[test]
fn pull_in_with_delay_has_its_times_and_nothing_after_them() {
    let workspace = workspace("voltage: 7.6 kV");
    workspace.write("half.csv", &csv_of_ten(|x| x < 5));
    let ended = workspace.run(&[
        "solve",
        "scene.yaml",
        "half.csv",
        "-o",
        "out.h5",
        "--history",
        "--at",
        "0 s, 1000 s",
        "--elements-per-cell",
        "1",
    ]);
    assert_eq!(ended.code, Some(3), "{}{}", ended.stdout, ended.stderr);
    assert!(ended.stdout.contains("delayed-pull-in"), "{}", ended.stdout);
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let [last, first] = file.dataset("time_bracket").unwrap().read_raw::<f64>().unwrap()[..] else {
        panic!("two times");
    };
    assert!(0.0 < last && last < first && first < 1000.0, "{last} {first}");
    let moved = file.dataset("max_displacement").unwrap().read_raw::<f64>().unwrap();
    assert!(moved[0] > 0.0 && moved[1].is_nan());
}

fn csv_of_ten(active: impl Fn(usize) -> bool) -> String {
    let row: Vec<&str> = (0..10).map(|x| if active(x) { "1" } else { "0" }).collect();
    vec![row.join(","); 10].join("\n")
}

#[test]
fn natural_frequencies_are_written_with_their_modes() {
    let workspace = workspace("voltage: 3 kV");
    let ended = workspace.run(&[
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "out.h5",
        "--modes",
        "3",
        "--json",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    assert_eq!(file.dataset("modes").unwrap().shape(), [1, 3, 11, 11, 2]);
    let told = workspace.run(&["solve", "scene.yaml", "odd.csv", "--modes", "2"]);
    assert_eq!(told.code, Some(0), "{}", told.stderr);
    assert!(told.stdout.contains(" Hz"), "{told}");
    snapshot!(told.stdout);
    let hertz = file.dataset("frequencies").unwrap().read_raw::<f64>().unwrap();
    assert!(
        hertz[0] > 250.0 && hertz[0] <= hertz[1] && hertz[1] <= hertz[2] && hertz[2] < 600.0,
        "{hertz:?}"
    );
    workspace.write(
        "scene.yaml",
        &SCENE.replace("DRIVE", "voltage: 3 kV").replace(", density: 960", ""),
    );
    let ended = workspace.run(&["solve", "scene.yaml", "odd.csv", "-o", "out.h5", "--modes", "3"]);
    assert_ne!(ended.code, Some(0));
    assert!(ended.stderr.contains("`density`"), "{}", ended.stderr);
}

#[test]
fn a_frequency_response_has_its_arrays_its_table_and_its_figure() {
    let workspace = workspace("voltage: 5 kV");
    let dynamic = SCENE
        .replace(
            "DRIVE",
            "voltage: 20 V, waveform: { sine: { frequency: 1 Hz, bias: 5 kV } }",
        )
        .replace(
            "effects: { viscoelasticity: {} }",
            "effects: { viscoelasticity: {}, inertia: {} }",
        );
    workspace.write("scene.yaml", &dynamic);
    let solve = [
        "solve",
        "scene.yaml",
        "odd.csv",
        "-o",
        "out.h5",
        "--response",
        "1 mHz:1kHz",
    ];
    let ended = workspace.run(&[&solve[..], &["--points", "7", "--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    assert_eq!(
        (&document["bias"], &document["unstable"]),
        (&serde_json::json!(5000.0), &serde_json::json!(0))
    );
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let shape = |name: &str| file.dataset(name).unwrap().shape();
    assert_eq!(shape("response_real"), [1, 7, 11, 11, 2]);
    assert_eq!(shape("response_imaginary"), [1, 7, 11, 11, 2]);
    assert_eq!((shape("frequency"), shape("slope")), (vec![7], vec![1, 11, 11, 2]));
    let numbers = |name: &str| file.dataset(name).unwrap().read_raw::<f64>().unwrap();
    let (frequency, amplitude, phase) = (numbers("frequency"), numbers("amplitude"), numbers("phase"));
    assert_eq!((frequency[0], frequency[6]), (1e-3, 1e3));
    // The branches follow at 1 mHz and do not at 1 Hz; at 1 kHz inertia turns the motion round.
    assert!(amplitude[0] > 1.3 * amplitude[3], "{amplitude:?}");
    assert!(
        phase[0] < 0.0 && phase[0] > -1.0 && phase[3] < phase[0] && phase[6] < -90.0,
        "{phase:?}"
    );
    let [x, y] = file.dataset("watched_corner").unwrap().read_raw::<u64>().unwrap()[..] else {
        panic!("a corner");
    };
    let at = 2 * (11 * y + x) as usize;
    let [real, imaginary] = ["response_real", "response_imaginary"].map(numbers);
    let sizes = [0, 1].map(|c| real[at + c].hypot(imaginary[at + c]));
    assert!((f64::max(sizes[0], sizes[1]) / amplitude[0] - 1.0).abs() < 1e-12);
    let table = std::fs::read_to_string(workspace.path("out.csv")).unwrap();
    assert!(
        table.starts_with("pattern,frequency_Hz,amplitude_mm_per_V,phase_deg,outcome"),
        "{table}"
    );
    assert!(
        std::fs::read(workspace.path("out.png"))
            .unwrap()
            .starts_with(b"\x89PNG")
    );
    // Without a stable equilibrium there is none.
    workspace.write("scene.yaml", &SCENE.replace("DRIVE", "voltage: 12 kV"));
    let ended = workspace.run(&[&solve[..], &["--points", "2"]].concat());
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(ended.stdout.contains("pull-in"), "{}", ended.stdout);
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    assert!(file.dataset("amplitude").unwrap().read_raw::<f64>().unwrap()[0].is_nan());
}

#[test]
fn options_that_a_frequency_response_lacks_or_excludes_are_refused() {
    let workspace = workspace("voltage: 5 kV");
    let solve = ["solve", "scene.yaml", "odd.csv", "-o", "out.h5"];
    let mut printed = Transcript::default();
    let mut refused = |more: &[&str], parts: &[&str]| {
        let ended = workspace.run(&[&solve[..], more].concat());
        assert_eq!(ended.code, Some(2), "{more:?}: {}", ended.stderr);
        for part in parts {
            assert!(ended.stderr.contains(part), "{more:?}: {}", ended.stderr);
        }
        printed.add(more.join(" "), ended);
    };
    refused(&["--response", "1Hz"], &["1Hz:1kHz"]);
    refused(&["--response", "10Hz:1Hz"], &["10Hz", "1Hz"]);
    refused(&["--response", "1 V:1Hz"], &["unit"]);
    refused(&["--response", "1Hz:1kHz", "--points", "1"], &["2 to 10000"]);
    refused(&["--points", "5"], &["--response"]);
    refused(&["--response", "1Hz:1kHz", "--modes", "3"], &["--response", "--modes"]);
    refused(
        &["--response", "1Hz:1kHz", "--method", "linear"],
        &["--response", "--method linear"],
    );
    let other = |scene: String| workspace.write("scene.yaml", &scene);
    let range = ["--response", "1Hz:1kHz"];
    other(SCENE.replace("DRIVE", "charge: { total: 1 uC }"));
    refused(&range, &["`voltage`"]);
    other(SCENE.replace("DRIVE", "voltage: 1 kV, waveform: { sine: { frequency: 1 Hz } }"));
    refused(&range, &["`bias`"]);
    let moving = SCENE.replace("effects: { viscoelasticity: {} }", "effects: { inertia: {} }");
    other(moving.replace("DRIVE", "voltage: 5 kV").replace(", density: 960", ""));
    refused(&range, &["`density`"]);
    snapshot!(printed);
}

#[test]
fn a_charge_gives_the_voltage_and_a_voltage_no_charge_control() {
    let workspace = workspace("charge: { total: 1 uC }");
    let ended = workspace.run(&["solve", "scene.yaml", "odd.csv", "-o", "out.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let volts = file.dataset("voltage").unwrap().read_raw::<f64>().unwrap()[0];
    assert!(volts > 1000.0 && volts < 9000.0, "{volts}");
    assert_eq!(file.dataset("charge").unwrap().read_raw::<f64>().unwrap(), [1e-6]);
    let mut printed = Transcript::default();
    for (drive, parts) in [
        ("voltage: 5 kV, charge: { total: 1 uC }", ["charge", "voltage"]),
        ("charge: {}", ["`total`", "`immobile`"]),
        ("charge: { total: 1 C }", ["total", "1 C"]),
    ] {
        workspace.write("scene.yaml", &SCENE.replace("DRIVE", drive));
        let ended = workspace.run(&["solve", "scene.yaml", "odd.csv", "-o", "out.h5"]);
        assert_eq!(ended.code, Some(2), "{drive}");
        for part in parts {
            assert!(ended.stderr.contains(part), "{drive}: {}", ended.stderr);
        }
        printed.add(drive, ended);
    }
    snapshot!(printed);
}

const PIPELINE: &str = "
version: 1
name: creep
scene: scene.yaml
stages:
  blocks: { kind: sample, family: large-grid, units: [5], count_per_units: 6, seed: 1 }
  crept: { kind: solve, needs: [blocks], elements_per_cell: 1, history: { at: [10 s, 0.1 s] } }
  still: { kind: solve, needs: [blocks], elements_per_cell: 1 }
";

#[test]
fn histories_are_audited_by_histories() {
    let workspace = workspace("voltage: 4 kV");
    let audited = PIPELINE.replace(
        "elements_per_cell: 1, history",
        "elements_per_cell: 4, order: 2, history",
    );
    let audited = audited.replace("count_per_units: 6", "count_per_units: 2");
    workspace.write(
        "audited.yaml",
        &format!("{audited}  audited: {{ kind: audit, needs: [crept], samples: 2 }}\n"),
    );
    let ran = workspace.run(&["run", "audited.yaml", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
}

#[test]
fn methods_that_do_not_fit_the_scene_are_refused_before_the_reference() {
    let workspace = workspace("voltage: 4 kV, waveform: { ramp: { time: 1 s } }");
    let measure = |methods: &[&str], reference: &str| {
        let asked = [
            "accuracy",
            "scene.yaml",
            "-o",
            "out",
            "--patterns",
            "odd.csv",
            "--reference",
            reference,
        ];
        workspace.run(&[&asked[..], methods].concat())
    };
    let in_time = "{ elements_per_cell: 4, history: { at: [0.5 s] } }";
    let mut printed = Transcript::default();
    for (methods, reference, named) in [
        ("[creep:3]", in_time, "`waveform`"),
        ("[creep:3]", "{ elements_per_cell: 4 }", "`history`"),
        ("[creep:2]", in_time, "creep:2"),
        ("[history+newton]", in_time, "+chord:N"),
    ] {
        let refused = measure(&["--methods", methods], reference);
        assert_eq!(refused.code, Some(2), "{methods}: {}", refused.stderr);
        assert!(refused.stderr.contains(named), "{methods}: {}", refused.stderr);
        printed.add(format!("{methods} against {reference}"), refused);
    }
    snapshot!(printed);
    assert!(!workspace.path("out").exists());
    let methods = "[{ method: history+chord:1, elements_per_cell: 1 }, { method: history, elements_per_cell: 1 }]";
    let measured = measure(&["--methods", methods, "--json"], in_time);
    assert_eq!(measured.code, Some(0), "{}", measured.stderr);
}

#[test]
fn a_stage_keeps_histories_and_its_key_knows_the_time() {
    let workspace = workspace("voltage: 4 kV");
    workspace.write("creep.yaml", PIPELINE);
    let first = workspace.run(&["run", "creep.yaml", "--json"]);
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let plan = |set: &str| {
        let document = workspace.run(&["plan", "creep.yaml", "--json", "--set", set]).json();
        let stages = document["stages"].as_array().unwrap().clone();
        let stale = stages.iter().filter(|stage| stage["outcome"] == "stale");
        stale
            .map(|stage| stage["name"].as_str().unwrap().to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(plan("stages.crept.history.at=[10 s, 1 s]"), ["crept"]);
    assert_eq!(plan("stages.crept.history.at=[0.1 s, 10 s]"), Vec::<String>::new());
    // How the voltage rises decides about histories alone.
    assert_eq!(plan("scene.drive.waveform={ ramp: { time: 1 s } }"), ["crept"]);
    assert_eq!(plan("scene.drive.rest=1 min"), ["crept"]);
    assert_eq!(plan("scene.drive.duration=1 min"), Vec::<String>::new());
}

#[test]
fn designs_swing_as_far_as_predicted() {
    let workspace = workspace("voltage: 100 V, waveform: { sine: { frequency: 1 Hz, bias: 4 kV } }");
    let pipeline = "
version: 1
name: swing
scene: scene.yaml
stages:
  searched:
    kind: design
    targets:
      - { name: slow, objective: { point: [25, 25], direction: 0 deg, frequency: 0.01 Hz } }
      - { name: fast, objective: { points: [{ point: [20, 25], direction: 30 deg }, { point: [30, 25], direction: 30 deg }], frequency: 20 Hz } }
    area: 0.5
    population: 12
    generations: 3
    refine: true
    seed: 1
  best: { kind: design, method: adjoint, starts: 2, targets: [{ name: best, objective: { point: [25, 25], direction: 0 deg, frequency: 0.01 Hz } }], seed: 2 }
  verified: { kind: verify, needs: [searched, best], elements_per_cell: 2, order: 1 }
";
    workspace.write("swing.yaml", pipeline);
    let ran = workspace.run(&["run", "swing.yaml", "--json"]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    let results = &workspace.run(&["log", "--json"]).json()["runs"][0]["results"].clone();
    let of = |name: &str, what: &str| {
        let value = results[format!("verified.{what}.{name}")].as_f64();
        value.unwrap_or_else(|| panic!("{what}.{name}: {results}"))
    };
    for name in ["slow", "fast"] {
        let [simulated, predicted] = ["displacement", "predicted"].map(|what| of(name, what));
        assert!(
            simulated > 5e-3 && (predicted / simulated - 1.0).abs() < 0.05,
            "{results}"
        );
    }
    assert!(
        of("best", "displacement") > 0.97 * of("slow", "displacement"),
        "{results}"
    );
    // The bias decides about amplitudes.
    let plan = |set: &str| {
        let planned = workspace.run(&["plan", "swing.yaml", "--json", "--set", set]);
        planned.json()["stages"][0]["outcome"].clone()
    };
    assert_eq!(plan("scene.drive.waveform.sine.bias=3.9 kV"), "stale");
    assert_eq!(plan("stages.searched.seed=1"), "reused");
    let search = "population: 12\n    generations: 3";
    let mut printed = Transcript::default();
    for (from, to, named) in [
        (search, "evaluator: chord:2", "auto, newton"),
        ("frequency: 20 Hz", "frequency: 20 Hz, time: 1 s", "`frequency`"),
    ] {
        workspace.write("changed.yaml", &pipeline.replace(from, to));
        let refused = workspace.run(&["plan", "changed.yaml"]);
        assert_eq!(refused.code, Some(2), "{to}: {}", refused.stderr);
        assert!(refused.stderr.contains(named), "{to}: {}", refused.stderr);
        printed.add(to, refused);
    }
    workspace.write("scene.yaml", &SCENE.replace("DRIVE", "voltage: 4 kV"));
    let refused = workspace.run(&["plan", "swing.yaml"]);
    assert_eq!(refused.code, Some(2), "{}", refused.stderr);
    for part in ["`sine`", "`bias`"] {
        assert!(refused.stderr.contains(part), "{refused}");
    }
    printed.add("a constant voltage", refused);
    snapshot!(printed);
}

#[test]
fn electrodes_charge_from_their_leads_and_islands_are_refused() {
    let workspace = workspace("voltage: 5 kV");
    let scene = |resistance: &str| {
        SCENE
            .replace("DRIVE", "voltage: 5 kV, duration: 1 ms")
            .replace(
                "effects: { viscoelasticity: {} }",
                &format!("leads: [left]\neffects: {{ {resistance} }}"),
            )
            .replace("density: 960", "density: 960, sheet_resistance: 50 kOhm")
    };
    // The cells of the pattern touch at corners only.
    let mut printed = Transcript::default();
    for (effects, more) in [
        ("", vec![]),
        ("", vec!["--modes", "2"]),
        ("", vec!["--path"]),
        ("electrode_resistance: {}", vec!["--history"]),
    ] {
        workspace.write("scene.yaml", &scene(effects));
        let ended = workspace.run(&[&["solve", "scene.yaml", "odd.csv", "-o", "out.h5"], &more[..]].concat());
        assert_eq!(ended.code, Some(2), "{more:?}: {}", ended.stderr);
        for part in ["pattern 0", "1 cell", "[y=0][x=3]"] {
            assert!(ended.stderr.contains(part), "{more:?}: {}", ended.stderr);
        }
        printed.add(format!("{effects} {}", more.join(" ")), ended);
    }
    snapshot!(printed);
    workspace.write("left.csv", &csv_of_ten(|x| x < 6));
    let history = [
        "solve",
        "scene.yaml",
        "left.csv",
        "-o",
        "out.h5",
        "--history",
        "--at",
        "0 s, 20 us, 1 ms",
    ];
    let ended = workspace.run(&history);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
    let of = |name: &str| file.dataset(name).unwrap().read_raw::<f64>().unwrap();
    let volts = of("electrode_voltage");
    assert!(volts[0] == 0.0 && volts[1] > 500.0 && volts[1] < 4500.0, "{volts:?}");
    assert!((volts[2] / 5000.0 - 1.0).abs() < 1e-6, "{volts:?}");
    let [supplied, dissipated, electric] = ["supplied", "dissipated", "electric"].map(|name| of(name)[2]);
    assert!(dissipated > 0.4 * electric && supplied > dissipated + electric);
    // Without time it is charged, and says what it leaves out.
    let still = workspace.run(&["solve", "scene.yaml", "left.csv", "-o", "still.h5"]);
    assert_eq!(still.code, Some(0), "{}", still.stderr);
}
