//! Exported designs, as other programs read them.

use std::process::Command;

use serde_json::Value;

use super::common::{Transcript, Workspace, csv, files, readers, scene_file, snapshot};

const READER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/it/export.py");
const SIDE: f64 = 50.0;

/// Rings in rings, islands that touch at corners, an electrode at the frame and in a corner of it.
fn hard(x: usize, y: usize) -> bool {
    let distance = (x as f64 - 20.0).hypot(y as f64 - 30.0);
    let rings = distance < 15.0 && !(distance > 5.0 && distance < 9.0) && distance > 2.2;
    let blocks = (5..9).contains(&x) && (12..20).contains(&y) || (9..13).contains(&x) && (8..12).contains(&y);
    rings || blocks || (40..44).contains(&x) && y < 10 || x >= 44 && y >= 44 || x == y + 18 && (20..28).contains(&x)
}

/// With a scene and patterns of every difficulty.
fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace.write("hard.csv", &csv(hard));
    workspace.write("empty.csv", &csv(|_, _| false));
    workspace.write("full.csv", &csv(|_, _| true));
    workspace.write("dots.csv", &csv(|x, y| (x + y) % 2 == 0));
    workspace
}

/// The python to read with: one with the readers of other programs if they are wanted, else one with h5py.
fn python() -> String {
    readers::find("ezdxf, gerbonara and pyvista, which read exported designs", || {
        readers::python("readers", "ezdxf, gerbonara, pyvista")
            .or_else(|| readers::python("readers", "ezdxf, gerbonara, h5py"))
    })
    .unwrap_or_else(super::h5py::python)
}

/// What strangers find in files, in order.
fn read(workspace: &Workspace, names: &[String]) -> Vec<Value> {
    let read = Command::new(python())
        .arg(READER)
        .args(names.iter().map(|name| workspace.path(name)))
        .output()
        .unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let text = String::from_utf8(read.stdout).unwrap();
    let found: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(found.len(), names.len(), "{text}");
    for (found, name) in found.iter().zip(names) {
        println!("{name}: read by {}", found["reader"]);
    }
    found
}

/// What the command says of an export that succeeds.
fn export(workspace: &Workspace, arguments: &[&str]) -> Value {
    let ended = workspace.run(&[&["export", "design"], arguments, &["--json"]].concat());
    assert_eq!(ended.code, Some(0), "{arguments:?}: {}", ended.stderr);
    ended.json()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn masks_have_the_size_area_and_holes_that_they_state() {
    let workspace = workspace();
    let (mut names, mut stated) = (Vec::new(), Vec::new());
    for pattern in ["hard", "empty", "full", "dots"] {
        for (size, outline) in [("prestretched", &[][..]), ("undeformed", &["--smooth"])] {
            for format in ["svg", "dxf", "gbr", "png"] {
                let name = format!("{pattern}-{size}.{format}");
                let source = format!("{pattern}.csv");
                let mut arguments = vec![source.as_str(), "--scene", "scene.yaml", "--size", size, "-o", &name];
                arguments.extend(outline);
                stated.push(export(&workspace, &arguments));
                names.push(name);
            }
        }
    }
    for ((found, stated), name) in read(&workspace, &names).iter().zip(&stated).zip(&names) {
        let side = if name.contains("undeformed") { SIDE / 3.0 } else { SIDE };
        assert!((number(&stated["side_mm"]) - side).abs() < 1e-9, "{stated}");
        // Coordinates are given to the nanometre; a dot of a third of a mm has few pixels.
        let area = number(&stated["outline_area_mm2"]);
        let exact = !name.ends_with("png") || name.contains("prestretched");
        let tolerance = if exact { 1e-3 } else { 0.06 * area + 1e-9 };
        assert!(
            (number(&found["area"]) - area).abs() < tolerance,
            "{name}: {found} {stated}"
        );
        match name.rsplit_once('.').unwrap().1 {
            "png" => {
                assert!((number(&found["size_mm"][0]) - side).abs() < 1e-3, "{name}: {found}");
                assert!(
                    found["text"]
                        .as_str()
                        .unwrap()
                        .contains(stated["size"].as_str().unwrap())
                );
                continue;
            }
            "svg" => {
                assert_eq!(found["rule"], "evenodd");
                let width = found["size"][0].as_str().unwrap().strip_suffix("mm").unwrap();
                assert!((width.parse::<f64>().unwrap() - side).abs() < 1e-6, "{name}: {found}");
                assert!(found["notes"].as_str().unwrap().contains("area"));
            }
            "dxf" => {
                assert_eq!(
                    (&found["unit"], &found["closed"]),
                    (&4.into(), &true.into()),
                    "{name}: {found}"
                );
                assert_eq!(found["errors"], serde_json::json!([]), "{name}");
                assert!(
                    (number(&found["frame"][0]) - side * side).abs() < 1e-4,
                    "{name}: {found}"
                );
            }
            _ => {
                assert_eq!(found["attributes"][".FileFunction"][0], "Other", "{name}: {found}");
                assert!(found["comments"].to_string().contains("area"), "{name}: {found}");
            }
        }
        assert_eq!(
            [number(&found["outer"]), number(&found["holes"])],
            [number(&stated["islands"]), number(&stated["holes"])],
            "{name}"
        );
        if let Some([low_x, low_y, high_x, high_y]) = found["box"].as_array().map(Vec::as_slice) {
            assert!(number(low_x) >= 0.0 && number(low_y) >= 0.0, "{name}: {found}");
            assert!(
                number(high_x) <= side + 1e-6 && number(high_y) <= side + 1e-6,
                "{name}: {found}"
            );
        }
    }
    let of = |name: &str| &stated[names.iter().position(|n| n == name).unwrap()];
    // The inner and the outer ring, two blocks, a chain of eight, one at the frame and one in its corner.
    let square = of("hard-prestretched.svg");
    assert_eq!((&square["islands"], &square["holes"]), (&14.into(), &2.into()));
    assert_eq!(square["area_mm2"], square["outline_area_mm2"]);
    assert_eq!(
        number(&square["area_mm2"]),
        (0..2500).filter(|i| hard(i % 50, i / 50)).count() as f64
    );
    let rounded = of("hard-undeformed.dxf");
    let [cells, outline] = ["area_mm2", "outline_area_mm2"].map(|key| number(&rounded[key]));
    assert!((cells - number(&square["area_mm2"]) / 9.0).abs() < 1e-9);
    assert!(outline < cells && outline > 0.98 * cells, "{rounded}");
    assert_eq!(
        number(&of("full-undeformed.svg")["outline_area_mm2"]),
        number(&of("full-undeformed.svg")["area_mm2"])
    );
    assert_eq!(of("dots-undeformed.gbr")["islands"], 1250);
}

#[test]
fn an_image_and_a_table_are_read_back_as_the_same_pattern() {
    let workspace = workspace();
    let lines = |name: &str| -> Vec<String> {
        let text = std::fs::read_to_string(workspace.path(name)).unwrap();
        text.lines()
            .filter(|line| !line.starts_with('#'))
            .map(str::to_owned)
            .collect()
    };
    for size in ["prestretched", "undeformed"] {
        export(
            &workspace,
            &["hard.csv", "--scene", "scene.yaml", "--size", size, "-o", "a.png"],
        );
        export(
            &workspace,
            &["a.png", "--scene", "scene.yaml", "--size", size, "-o", "b.csv"],
        );
        assert_eq!(lines("b.csv"), lines("hard.csv"));
    }
    // Resolutions that are no whole number of pixels for a cell are moved to one that is.
    let fine = [
        "hard.csv",
        "--scene",
        "scene.yaml",
        "-o",
        "a.png",
        "--pixels-per-mm",
        "7.4",
    ];
    assert_eq!(export(&workspace, &fine)["pixels"], 350);
}

#[test]
fn a_membrane_has_its_displacement_stress_and_field() {
    let workspace = workspace();
    let arguments = ["hard.csv", "--scene", "scene.yaml", "-o", "hard.vtkhdf"];
    let fine = export(&workspace, &arguments);
    let coarse = ["--elements-per-cell", "1", "--order", "1"];
    let coarse = export(
        &workspace,
        &[&["full.csv", "--scene", "scene.yaml", "-o", "full.vtkhdf"], &coarse[..]].concat(),
    );
    assert_eq!(
        (&fine["elements"], &coarse["elements"]),
        (&10_000.into(), &2_500.into())
    );
    let found = read(&workspace, &["hard.vtkhdf".to_owned(), "full.vtkhdf".to_owned()]);
    let hard = &found[0];
    assert_eq!(
        (number(&hard["points"]), number(&hard["cells"])),
        (10_201.0, 10_000.0),
        "{hard}"
    );
    assert!(
        number(&hard["smallest_area"]) > 0.0 && number(&hard["deformed"]) < 1e-12,
        "{hard}"
    );
    assert!((number(&hard["area"]) - 2500.0).abs() < 1e-9, "the frame holds: {hard}");
    // A membrane 1 mm thick, stretched 3 times to 50 mm, keeps its volume.
    assert!((number(&hard["volume"]) / (2500.0 / 9.0) - 1.0).abs() < 1e-3, "{hard}");
    assert!(
        (number(&hard["largest"]) - number(&fine["max_displacement_mm"])).abs() < 1e-9,
        "{hard}"
    );
    let solved = workspace.run(&[
        "solve",
        "scene.yaml",
        "hard.csv",
        "--order",
        "2",
        "-o",
        "hard.h5",
        "--json",
    ]);
    assert_eq!(solved.code, Some(0), "{}", solved.stderr);
    let active = (0..2500).filter(|i| self::hard(i % 50, i / 50)).count() as f64 / 2500.0;
    assert!(
        (number(&hard["active"]) - active).abs() < 1e-12 && number(&hard["field_elsewhere"]) == 0.0,
        "{hard}"
    );
    assert_eq!(hard["shapes"]["first_piola_stress"], serde_json::json!([10_000, 9]));
    // Active everywhere nothing moves: E = V λp² / H, σ = μ (λp² − λp⁻⁴) − ε E² (closed form).
    let full = &found[1];
    let field = 5250.0 * 9.0 / 1e-3;
    let stress = 45e3 * (9.0 - 1.0 / 81.0) - 4.7 * 8.854_187_812_8e-12 * field * field;
    assert!(number(&full["largest"]) < 1e-9, "{full}");
    for value in full["field"].as_array().unwrap() {
        assert!((number(value) / field - 1.0).abs() < 1e-9, "{full}");
    }
    assert!(
        (number(&full["stress"][0]) / stress - 1.0).abs() < 1e-9,
        "{full} wanted {stress}"
    );
    assert!(
        (number(&full["stress"][1]) / (stress / 3.0) - 1.0).abs() < 1e-9,
        "{full}"
    );
}

#[test]
fn a_design_is_named_by_its_target_and_role() {
    let workspace = workspace();
    workspace.write(
        "p.yaml",
        "version: 1
name: p
scene: scene.yaml
stages:
  design:   { kind: design, case: I & II, evaluator: linear, area: 0.5, population: 20, generations: 2, seed: 6, targets: [{ name: right, objective: { point: [25 mm, 25 mm], direction: 0 deg } }, { name: up-1, objective: { point: [25 mm, 25 mm], direction: 90 deg } }] }
  verified: { kind: verify, needs: [design], elements_per_cell: 2 }
",
    );
    workspace.stages(&["run", "p.yaml"]);
    for stage in ["design", "verified"] {
        let source = format!("p.yaml:{stage}");
        let ambiguous = workspace.run(&["export", "design", &source, "-o", "x.svg"]);
        assert_eq!(ambiguous.code, Some(2), "{}", ambiguous.stderr);
        for part in ["--design", "I & II", "up-1"] {
            assert!(ambiguous.stderr.contains(part), "{ambiguous}");
        }
        let said = export(&workspace, &[&source, "--design", "right", "-o", "right.svg"]);
        assert_eq!(
            (&said["design"]["role"], &said["design"]["member"]),
            (&"ga".into(), &0.into())
        );
        assert_eq!(said["design"]["case"], "I & II");
        assert!((number(&said["area_mm2"]) - 1250.0).abs() < 100.0, "{said}");
        let found = read(&workspace, &["right.svg".to_owned()]).remove(0);
        for part in ["I & II", "right", "ga", "1", "20"] {
            assert!(found["title"].as_str().unwrap().contains(part), "{found}");
        }
        snapshot!(
            format!("{}\n{}\n{ambiguous}", found["title"], found["notes"].as_str().unwrap()),
            stage
        );
        // In a folder a file is called after the design.
        let said = export(
            &workspace,
            &[&source, "--design", "up-1", "--format", "gerber", "-o", "."],
        );
        assert_eq!(said["file"], "./up-1-ga-1.gbr");
        let none = workspace.run(&["export", "design", &source, "--role", "best", "-o", "x.svg"]);
        for role in ["refined", "ga", "optimum", "intuitive", "intuitive-equal-area", "own"] {
            assert!(none.stderr.contains(role), "{role}: {none}");
        }
        let none = workspace.run(&["export", "design", &source, "--role", "own", "-o", "x.svg"]);
        for part in ["I & II", "right", "ga", "20"] {
            assert!(none.stderr.contains(part), "{none}");
        }
        assert!(!workspace.path("x.svg").exists());
    }
    let intuitive = export(
        &workspace,
        &[
            "p.yaml:verified",
            "--design",
            "right",
            "--role",
            "intuitive",
            "-o",
            "i.csv",
        ],
    );
    assert_eq!(intuitive["design"]["role"], "intuitive");
}

#[test]
fn what_cannot_be_exported_is_refused_and_nothing_is_written() {
    let workspace = workspace();
    workspace.write("high.yaml", &scene_file().replace("5.25 kV", "9 kV"));
    workspace.write("half.csv", &csv(|x, _| x < 25));
    let scene = ["--scene", "scene.yaml"];
    let solved = workspace.run(&[
        "solve",
        "scene.yaml",
        "half.csv",
        "--elements-per-cell",
        "1",
        "-o",
        "half.h5",
    ]);
    assert_eq!(solved.code, Some(0), "{solved}");
    let before = files(&workspace.path(""));
    let cases: [(&[&str], Option<i32>, &str); 13] = [
        (&["half.h5", "-o", "x.svg"], Some(2), "half.h5:/patterns"),
        (&["hard.csv", "-o", "x.svg"], Some(2), "--scene"),
        (&["hard.csv", "-o", "x.txt"], Some(2), "--format"),
        (&["hard.csv", "-o", "x.svg", "--format", "dxf"], Some(2), "--format dxf"),
        (
            &["hard.csv", "-o", "x.svg", "--pixels-per-mm", "9"],
            Some(2),
            "--pixels-per-mm",
        ),
        (&["hard.csv", "-o", "x.csv", "--smooth"], Some(2), "--smooth"),
        (
            &["hard.csv", "-o", "x.vtkhdf", "--size", "undeformed"],
            Some(2),
            "--size",
        ),
        (&["hard.csv", "-o", "x.dxf", "--order", "2"], Some(2), "--order"),
        (
            &["hard.csv", "-o", "x.svg", "--role", "ga", "--scene", "scene.yaml"],
            Some(2),
            "--role",
        ),
        (
            &["hard.csv", "-o", "hard.csv", "--scene", "scene.yaml"],
            Some(2),
            "hard.csv",
        ),
        (
            &["hard.csv", "-o", "none/x.svg", "--scene", "scene.yaml"],
            Some(2),
            "none",
        ),
        (
            &[
                "hard.csv",
                "-o",
                "x.png",
                "--pixels-per-mm",
                "500",
                "--scene",
                "scene.yaml",
            ],
            Some(2),
            "400",
        ),
        (
            &[
                "half.csv",
                "-o",
                "x.vtkhdf",
                "--scene",
                "high.yaml",
                "--order",
                "1",
                "--elements-per-cell",
                "1",
            ],
            Some(1),
            "",
        ),
    ];
    let mut printed = Transcript::default();
    for (arguments, code, named) in cases {
        let ended = workspace.run(&[&["export", "design"], arguments].concat());
        assert_eq!(ended.code, code, "{arguments:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(named), "{arguments:?}: {}", ended.stderr);
        printed.add(arguments.join(" "), ended);
    }
    snapshot!(printed);
    // Files of no more than so many blocks of 512 bytes.
    for (name, blocks) in [("x.svg", "2"), ("x.vtkhdf", "200"), ("x.vtkhdf", "4")] {
        let mut command = workspace.command(&[]);
        let binary = command.get_program().to_owned();
        command = workspace.dressed("sh");
        command
            .args(["-c", "trap '' XFSZ; ulimit -f $1; shift; exec \"$@\"", "sh", blocks])
            .arg(binary)
            .args(["export", "design", "hard.csv", "-o", name])
            .args(scene);
        let ended = command.output().unwrap();
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(1), "{name} in {blocks} blocks: {said}");
        assert!(said.contains("File too large"), "{name} in {blocks} blocks: {said}");
    }
    assert_eq!(files(&workspace.path("")), before);
}
