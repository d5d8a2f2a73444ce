//! Sweeps: in a file, on the command line, as tables, and with thousands of stages.

use std::fs;

use serde_json::{Value, json};

use super::common::{SHORT, Transcript, Workspace, snapshot};

const SWEEP: &str = r#"version: 1
name: sweep
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: "${voltage}" }
  effects: {}
stages:
  drawn:
    foreach: { area: [0.3, 0.5] }
    kind: sample
    family: blobs
    area: "${area}"
    count: 4
    seed: 1
  solved: { kind: solve, needs: [drawn], foreach: { voltage: [3 kV, 4 kV] }, elements_per_cell: 1 }
  table:
    kind: table
    needs: [solved]
    columns: [voltage, area, max_displacement, solved.samples]
    plot: { x: voltage, y: max_displacement, series: area }
"#;

fn built(workspace: &Workspace, arguments: &[&str]) -> Vec<String> {
    let document = workspace.run(&[arguments, &["--json"]].concat()).json();
    let stages = document["stages"].as_array().unwrap_or_else(|| panic!("{document}"));
    let built = stages.iter().filter(|stage| stage["outcome"] == "built");
    built.map(|stage| stage["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn thickness_and_prestretch_are_swept_with_patterns_that_are_drawn_once() {
    let workspace = Workspace::new();
    let frame = ", frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 20 mm } } } }";
    for geometry in [" }", frame] {
        let scene = SWEEP.replace(" cells: 50 }", &format!(" cells: 20{geometry}"));
        let scene = scene
            .replace("${voltage}", "2 kV")
            .replace("foreach: { voltage: [3 kV, 4 kV] }, ", "")
            .replace("voltage, area", "area")
            .replace(
                "x: voltage, y: max_displacement, series: area",
                "x: area, y: max_displacement",
            );
        workspace.write("plain.yaml", &scene);
        let sweep = |set: &str| {
            let more = [
                "--set",
                set,
                "--until",
                "solved",
                "--table",
                "solved.max_displacement",
                "--json",
            ];
            workspace.run(&[&["sweep", "plain.yaml"][..], &more].concat())
        };
        for set in [
            "scene.geometry.prestretch=2, 3",
            "scene.geometry.thickness=0.5 mm, 1 mm",
        ] {
            let ended = sweep(set);
            assert_eq!(ended.code, Some(0), "{set}: {}", ended.stderr);
            assert_eq!(ended.json()["tables"][0]["rows"].as_array().unwrap().len(), 4);
        }
        let ended = sweep("scene.geometry.cells=10, 20");
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(ended.stderr.contains("patterns are drawn once"), "{}", ended.stderr);
    }
}

#[test]
fn a_sweep_of_scene_and_samples_ends_in_a_table_and_a_figure() {
    let workspace = Workspace::new();
    workspace.write("sweep.yaml", SWEEP);
    let run = workspace.run(&["run", "sweep.yaml", "--json"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let table = run.json()["tables"][0].clone();
    let unit = |at: usize| table["columns"][at]["unit"].as_str().unwrap().to_owned();
    assert_eq!([unit(0), unit(1), unit(2), unit(3)], ["V", "1", "mm", "1"]);
    let rows: Vec<Vec<f64>> = serde_json::from_value(table["rows"].clone()).unwrap();
    let axes: Vec<[f64; 2]> = rows.iter().map(|row| [row[0], row[1]]).collect();
    assert_eq!(axes, [[3000.0, 0.3], [3000.0, 0.5], [4000.0, 0.3], [4000.0, 0.5]]);
    // Displacement goes with the square of the voltage, and somewhat faster.
    for at in [0, 1] {
        let ratio = rows[at + 2][2] / rows[at][2];
        assert!(ratio > 16.0 / 9.0 && ratio < 2.2, "{ratio}");
    }
    let solved = &run.json()["solved"][0];
    assert_eq!(
        (&solved["stage"], &solved["samples"]),
        (&json!("solved@voltage=3kV,area=0.3"), &json!(4))
    );
    assert_eq!(solved["max_displacement_mm"], json!(rows[0][2]));
    let shown = workspace.run(&["show", "table"]).stdout;
    assert!(
        shown.contains("voltage [V]") && shown.contains("max_displacement [mm]"),
        "{shown}"
    );
    let figures = run.json()["figures"].clone();
    let figure = figures
        .as_array()
        .unwrap()
        .iter()
        .find(|path| path.as_str().unwrap().contains("table"));
    assert!(
        fs::metadata(workspace.path(figure.unwrap().as_str().unwrap()))
            .unwrap()
            .len()
            > 5000
    );

    // What it made is what plain stages make.
    let plain = SWEEP
        .replace("foreach: { voltage: [3 kV, 4 kV] }, ", "")
        .replace("    foreach: { area: [0.3, 0.5] }\n", "")
        .replace("\"${voltage}\"", "4 kV")
        .replace("\"${area}\"", "0.5");
    workspace.write(
        "plain.yaml",
        &plain
            .replace(
                "[voltage, area, max_displacement, solved.samples]",
                "[max_displacement]",
            )
            .replace("    plot: { x: voltage, y: max_displacement, series: area }\n", ""),
    );
    assert_eq!(built(&workspace, &["run", "plain.yaml"]), ["table"]);
    // One more value is one more stage each.
    workspace.write("sweep.yaml", &SWEEP.replace("[3 kV, 4 kV]", "[3 kV, 3.5 kV, 4 kV]"));
    assert_eq!(
        built(&workspace, &["run", "sweep.yaml"]),
        [
            "solved@voltage=3.5kV,area=0.3",
            "solved@voltage=3.5kV,area=0.5",
            "table"
        ]
    );
    assert!(built(&workspace, &["run", "sweep.yaml"]).is_empty());
    // A stage of a sweep is found by its name, in the last run and in the pipeline.
    for name in ["solved@voltage=4kV,area=0.5", "sweep.yaml:solved@voltage=4kV,area=0.5"] {
        let shown = workspace.run(&["show", name]);
        assert_eq!(shown.code, Some(0), "{}", shown.stderr);
    }
    let locked = workspace.run(&["run", "sweep.yaml", "--lock", "--quiet"]);
    assert_eq!(locked.code, Some(0), "{}", locked.stderr);
    assert_eq!(
        workspace.run(&["run", "sweep.yaml", "--locked", "--quiet"]).code,
        Some(0)
    );
    let dag = workspace.run(&["dag", "sweep.yaml", "--format", "dot"]);
    assert_eq!(dag.code, Some(0), "{}", dag.stderr);
}

#[test]
fn a_pipeline_is_swept_without_editing_it() {
    let workspace = Workspace::new();
    let plain = SWEEP
        .split("  table:")
        .next()
        .unwrap()
        .replace("foreach: { voltage: [3 kV, 4 kV] }, ", "")
        .replace("    foreach: { area: [0.3, 0.5] }\n", "")
        .replace("\"${voltage}\"", "4 kV")
        .replace("\"${area}\"", "0.5");
    workspace.write("plain.yaml", &plain);
    let sweep = [
        "sweep",
        "plain.yaml",
        "--set",
        "scene.drive.voltage=3 kV, 4 kV",
        "--set",
        "stages.drawn.area=0.3,0.5",
        "--set",
        "stages.drawn.count=3",
        "--table",
        "max_displacement,drawn.samples",
        "--plot",
        "voltage,max_displacement,area",
        "--csv",
        "-o",
        "table.csv",
    ];
    let run = workspace.run(&sweep);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert_eq!(lines[0], "voltage_V,area,max_displacement_mm,drawn.samples");
    assert_eq!(lines.len(), 5, "{}", run.stdout);
    assert!(
        lines[1].starts_with("3000,0.3,0.") && lines[4].ends_with(",3"),
        "{}",
        run.stdout
    );
    assert_eq!(fs::read_to_string(workspace.path("table.csv")).unwrap(), run.stdout);
    let about: Value = serde_json::from_slice(&fs::read(workspace.path("table.csv-metadata.json")).unwrap()).unwrap();
    let listed = workspace.run(&["log", "plain.yaml", "--json"]).json()["runs"][0]["stages"].clone();
    let made = listed.as_array().unwrap().iter().map(|stage| &stage["digest"]);
    assert!(
        made.filter(|digest| **digest == about["dc:source"]).count() == 1,
        "{about}"
    );
    assert_eq!(
        (&about["url"], &about["@context"]),
        (&json!("table.csv"), &json!("http://www.w3.org/ns/csvw"))
    );
    let columns = about["tableSchema"]["columns"].as_array().unwrap();
    let units = columns
        .iter()
        .map(|column| (&column["titles"], &column["schema:unitText"]));
    assert_eq!(
        units.collect::<Vec<_>>()[..3],
        [
            (&json!("voltage_V"), &json!("V")),
            (&json!("area"), &json!("1")),
            (&json!("max_displacement_mm"), &json!("mm"))
        ]
    );
    // Without --csv it prints the table for people, and where the files are.
    let told = workspace.run(&sweep.map(|word| if word == "--csv" { "--keep-going" } else { word }));
    for part in [
        "voltage [V]",
        "table: table.csv (described by ",
        "figure: store/figures/",
    ] {
        assert!(told.stdout.contains(part), "{part}: {}", told.stdout);
    }
    workspace.write("scene.yaml", &super::common::scene_file());
    let refused = workspace.refused(&["sweep", "scene.yaml", "--set", "drive.voltage=3 kV, 4 kV"]);
    assert!(refused.contains("this file is a scene, not a pipeline"), "{refused}");
    let log = workspace.run(&["log", "plain.yaml", "--json"]).json();
    assert_eq!(
        log["runs"][0]["overrides"],
        json!({ "scene.drive.voltage": "3 kV, 4 kV", "stages.drawn.area": "0.3,0.5", "stages.drawn.count": 3 })
    );
    assert_eq!(log["runs"][0]["command"], "sweep");
    let mut printed = Transcript::default();
    for (arguments, named) in [
        (&["--set", "stages.drawn.count=3"][..], "--set"),
        (&["--set", "stages.none.count=3,4"], "`none`"),
        (&["--set", "name=3,4"], "name"),
        (&["--set", "stages.drawn.count=3,4", "--table", "nothing"], "`nothing`"),
        (
            &["--set", "stages.drawn.count=3,4", "--table", "samples", "--plot", "a"],
            "--plot",
        ),
        (&["--set", "stages.drawn.count=3,x", "--table", "samples"], "`count`"),
        (&["--set", "stages.drawn.cuont=3,4"], "did you mean `count`?"),
        (&["--set", "scene.drive.voltage=3 kV, 3 kV"], "twice"),
        (&["--set", "scene.drive.voltage=3 kV, 4 mm"], "mm"),
        (
            &[
                "--set",
                "stages.none.count=3",
                "--set",
                "stages.drawn.count=3,4",
                "--table",
                "samples",
            ],
            "`none`",
        ),
        (
            &[
                "--set",
                "stages.drawn.count=3,4",
                "--table",
                "samples",
                "--plot",
                "count,foo",
            ],
            "`plot.y`",
        ),
        (
            &[
                "--set",
                "stages.drawn.count=3,4",
                "--set",
                "stages.drawn.count=5",
                "--table",
                "samples",
            ],
            "stages.drawn.count",
        ),
        (
            &[
                "--set",
                "stages.drawn.count=3,4",
                "--table",
                "samples",
                "-o",
                "plain.yaml",
            ],
            "plain.yaml",
        ),
        (
            &[
                "--set",
                "stages.drawn.count=3,4",
                "--table",
                "samples",
                "-o",
                "figure.png",
            ],
            "figure.csv",
        ),
        (
            &[
                "--set",
                "stages.drawn.count=3,4",
                "--table",
                "samples",
                "-o",
                "store/objects/t.csv",
            ],
            "store",
        ),
    ] {
        let ended = workspace.run(&[&["sweep", "plain.yaml"], arguments].concat());
        assert!(
            ended.code == Some(2) && ended.stderr.contains(named),
            "{named}: {}",
            ended.stderr
        );
        // Axes that the command has named are not quoted.
        let is_made = |text: &str| ended.stderr.contains(text);
        let made = ["${", "kind: table", "foreach={", "foreach:1", "sweep="];
        assert!(!made.into_iter().any(is_made), "{}", ended.stderr);
        printed.add(arguments.join(" "), ended);
    }
    snapshot!(printed);
}

#[test]
fn a_sweep_ends_with_a_stage_and_names_the_results_of_several_by_stage() {
    let workspace = Workspace::new();
    let plain = SHORT.replace(
        "solved: {",
        "fine: { kind: solve, needs: [small], elements_per_cell: 2 }\n  solved: {",
    );
    workspace.write("plain.yaml", &plain);
    let sweep = |more: &[&str]| {
        let given = [
            "sweep",
            "plain.yaml",
            "--set",
            "scene.drive.voltage=3 kV, 4 kV",
            "--set",
            "stages.small.count=2",
        ];
        workspace.run(&[&given[..], more].concat())
    };
    let table = |more: &[&str]| {
        let ended = sweep(&[&["--csv", "--table", "max_displacement"], more].concat());
        assert_eq!(ended.code, Some(0), "{ended}");
        ended.stdout.lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let misspelt = sweep(&["--table", "max_displacement", "--until", "solvd"]);
    assert!(misspelt.stderr.contains("did you mean `solved"), "{misspelt}");
    let both = table(&[]);
    assert_eq!(both[0], "voltage_V,fine.max_displacement_mm,solved.max_displacement_mm");
    let cells: Vec<&str> = both[1].split(',').collect();
    assert!(cells.len() == 3 && cells[1] != cells[2], "{both:?}");
    // Rows say of which values they are, of the file too: of stages that both last ones need.
    let axis = plain.replace("small:  {", "small: { foreach: { seeds: [1, 2] },");
    workspace.write("plain.yaml", &axis.replace("seed: 1", "seed: \"${seeds}\""));
    let swept = table(&[]);
    assert_eq!(
        swept[0],
        "voltage_V,seeds,fine.max_displacement_mm,solved.max_displacement_mm"
    );
    assert_eq!(swept.len(), 5, "{swept:?}");
    workspace.write("plain.yaml", &plain);
    let one = table(&["--until", "fine"]);
    assert_eq!(one[0], "voltage_V,max_displacement_mm");
    assert_eq!(one[1], format!("3000,{}", cells[1]));
    // The stage is built too where the table does not collect its results.
    let ended = sweep(&["--json", "--table", "solved.samples", "--until", "fine"]);
    let stages = ended.json()["stages"].clone();
    let is_fine = |stage: &Value| stage["name"] == "fine@voltage=3kV";
    assert!(stages.as_array().unwrap().iter().any(is_fine), "{stages}");
    let stages = sweep(&["--json", "--until", "small"]).json()["stages"].clone();
    let is_small = |stage: &Value| stage["name"].as_str().is_some_and(|name| name.starts_with("small"));
    assert!(stages.as_array().unwrap().iter().all(is_small), "{stages}");
    for more in [&["--until", "fien"][..], &["--table", "samples", "--until", "fien"]] {
        let ended = sweep(more);
        assert_eq!(ended.code, Some(2), "{ended}");
        assert!(ended.stderr.contains("no stage `fien`"), "{ended}");
    }
}

#[test]
fn a_table_with_unknown_results_lists_the_known_ones() {
    let workspace = Workspace::new();
    let mut printed = Transcript::default();
    for (columns, named) in [
        ("[voltage, displacement]", "`displacement`"),
        ("[voltage, voltage]", "voltage"),
        ("[]", "0"),
        ("[voltage], plot: { x: voltage, y: area }", "area"),
    ] {
        let start = SWEEP.find("    columns:").unwrap();
        let text = format!("{}    columns: COLUMNS\n", &SWEEP[..start]);
        let text = match columns.split_once("], ") {
            Some((columns, rest)) => text.replace("COLUMNS", &format!("{columns}]\n    {rest}")),
            None => text.replace("COLUMNS", columns),
        };
        workspace.write("sweep.yaml", &text);
        let ended = workspace.run(&["run", "sweep.yaml"]);
        assert!(
            matches!(ended.code, Some(1 | 2)) && ended.stderr.contains(named),
            "{named}: {}",
            ended.stderr
        );
        printed.add(columns, ended.stderr);
    }
    snapshot!(printed);
    let both = SWEEP
        .replace("needs: [solved]\n", "needs: [solved, drawn]\n")
        .replace("solved.samples", "samples");
    workspace.write("sweep.yaml", &both);
    let ended = workspace.run(&["run", "sweep.yaml"]);
    for name in ["drawn.samples", "solved.samples"] {
        assert!(ended.stderr.contains(name), "{}", ended.stderr);
    }
}

#[test]
fn more_than_a_thousand_stages_need_an_option() {
    let workspace = Workspace::new();
    let values: Vec<String> = (1..=600).map(|n| format!("{}", f64::from(n) / 1000.0)).collect();
    workspace.write(
        "sweep.yaml",
        &SWEEP.replace("[0.3, 0.5]", &format!("[{}]", values.join(", "))),
    );
    let refused = workspace.run(&["plan", "sweep.yaml"]);
    assert_eq!(refused.code, Some(2));
    assert!(
        refused.stderr.contains("--many") && refused.stderr.contains("sweep.yaml:"),
        "{}",
        refused.stderr
    );
    let plan = workspace.run(&["plan", "sweep.yaml", "--many", "--json"]).json();
    assert_eq!(plan["stages"].as_array().map(Vec::len), Some(1801));
    let vast: Value = workspace
        .run(&[
            "sweep",
            "sweep.yaml",
            "--set",
            "stages.drawn.seed=1,2,3,4,5,6,7,8,9",
            "--json",
        ])
        .json();
    assert!(vast["error"]["message"].as_str().unwrap().contains("1000"), "{vast}");
}
