//! Drawings of CAD programs and shapes in pipelines as patterns.

use std::path::Path;

use serde_json::Value;

use super::common::{Transcript, Workspace, scene_file, snapshot};

/// An example drawing in the sources of the reader.
fn example(workspace: &Workspace, name: &str) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/pattern/drawing/tests/files");
    std::fs::copy(folder.join(name), workspace.path(name)).unwrap();
}

fn with_scene() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &scene_file());
    workspace
}

/// The first pattern of a file as `deaflow check` reads it.
fn checked(workspace: &Workspace, arguments: &[&str]) -> Value {
    let ended = workspace.run(&[&["check", "--scene", "scene.yaml", "--json"], arguments].concat());
    assert_eq!(ended.code, Some(0), "{arguments:?}: {}", ended.stderr);
    ended.json()["files"][0].clone()
}

#[test]
fn drawings_are_read_where_patterns_are() {
    let workspace = with_scene();
    for name in ["d2_ring_text.dxf", "d4_bulge_inches.dxf", "s3_transform_px.svg"] {
        example(&workspace, name);
    }
    for (arguments, exact) in [
        (&["d2_ring_text.dxf"][..], 357.356),
        (&["d2_ring_text.dxf", "--layer", "ELECTRODE"], 357.356),
        (&["s3_transform_px.svg", "--layer", "ELECTRODE"], 70.376),
    ] {
        let found = checked(&workspace, arguments);
        let area = found["patterns"][0]["area_mm2"].as_f64().unwrap();
        assert!((area - exact).abs() < 0.05 * exact, "{arguments:?}: {area} {exact}");
        let notes = found["notes"].to_string();
        assert!(notes.contains("read by the centres of cells"), "{notes}");
    }
    // Moved by 3 cells, it has the same shape in other cells.
    let cells = |more: &[&str]| -> Vec<Vec<u64>> {
        let found = checked(&workspace, &[&["d2_ring_text.dxf"], more].concat());
        serde_json::from_value(found["patterns"][0]["rows_from_below"].clone()).unwrap()
    };
    let (here, moved) = (cells(&[]), cells(&["--origin", "3 mm, -2 mm"]));
    let is_moved = |(x, y): (usize, usize)| moved[y][x + 3] == here[y + 2][x];
    let places = (0..48).flat_map(|y| (0..47).map(move |x| (x, y)));
    assert!(here != moved && places.into_iter().all(is_moved));
    let away = [
        "check",
        "d2_ring_text.dxf",
        "--scene",
        "scene.yaml",
        "--origin",
        "90 mm, 0 mm",
    ];
    let ended = workspace.run(&away);
    assert!(
        ended.code == Some(2) && ended.stderr.contains("`--origin`"),
        "{}",
        ended.stderr
    );
    let notes = checked(&workspace, &["d2_ring_text.dxf"])["notes"].to_string();
    assert!(
        notes.contains("ignored: 1 TEXT") && notes.contains("357.4 mm² are drawn"),
        "{notes}"
    );
    let refused = |arguments: &[&str], says: &str| {
        let ended = workspace.run(arguments);
        assert!(
            ended.code == Some(2) && ended.stderr.contains(says),
            "{arguments:?}: {:?} {}",
            ended.code,
            ended.stderr
        );
    };
    refused(&["check", "d2_ring_text.dxf"], "a drawing has no cells");
    refused(
        &["check", "d2_ring_text.dxf", "--scene", "scene.yaml", "--layer", "X"],
        "no curves on layer",
    );
    let solved = workspace.run(&[
        "solve",
        "scene.yaml",
        "d4_bulge_inches.dxf",
        "--method",
        "linear",
        "-o",
        "out.h5",
    ]);
    assert_eq!(solved.code, Some(0), "{}", solved.stderr);
}

/// A pattern with a hole, an island in it, and cells that touch in corners.
fn pattern(value: impl Fn(i64, i64) -> u8) -> String {
    let row = |y: i64| (0..50).map(|x| value(x, y).to_string()).collect::<Vec<_>>().join(",");
    (0..50).map(|y| row(y) + "\n").collect()
}

#[test]
fn exported_masks_are_read_as_the_same_pattern() {
    let workspace = with_scene();
    let ring = |x: i64, y: i64| {
        let radius = (x - 20).pow(2) + (y - 27).pow(2);
        u8::from((40..250).contains(&radius) || radius < 9 || (x + y) % 7 == 0 && x > 40)
    };
    workspace.write("own.csv", &pattern(ring));
    let rows = |file: &str| checked(&workspace, &[file])["patterns"][0]["rows_from_below"].clone();
    for file in ["mask.dxf", "mask.svg"] {
        let ended = workspace.run(&["export", "design", "own.csv", "--scene", "scene.yaml", "-o", file]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert_eq!(rows("own.csv"), rows(file), "{file}");
    }
    // Groups, on their layers.
    let scene = scene_file().replace("voltage: 5.25 kV", "voltages: [5 kV, 3 kV]");
    assert!(scene.contains("voltages"), "{scene}");
    workspace.write("scene.yaml", &scene);
    workspace.write("own.csv", &pattern(|x, y| ring(x, y) * if x < 18 { 1 } else { 2 }));
    for file in ["mask.dxf", "mask.svg"] {
        let ended = workspace.run(&["export", "design", "own.csv", "--scene", "scene.yaml", "-o", file]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert_eq!(rows("own.csv"), rows(file), "{file}");
    }
}

#[test]
fn shapes_are_drawn_and_swept() {
    let workspace = with_scene();
    example(&workspace, "d1_circle.dxf");
    let pipeline = |shapes: &str| {
        workspace.write(
            "rings.yaml",
            &format!(
                "version: 1\nname: rings\nscene: scene.yaml\nstages:\n  own: {{ foreach: {{ r: [5 mm, 6 mm, 7 mm] }}, \
                 kind: patterns, shapes: [{shapes}] }}\n  \
                 solved: {{ kind: solve, needs: [own], gather: true, method: linear }}\n"
            ),
        );
        workspace.run(&["run", "rings.yaml", "--json"])
    };
    let ended = pipeline(
        "{ ring: { centre: [25 mm, 25 mm], radii: [2 mm, '${r}'] }, \
         without: [{ rectangle: [[24 mm, 0 mm], [26 mm, 25 mm]] }] }",
    );
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let shown = workspace.run(&["show", "rings.yaml:solved", "--csv"]);
    assert_eq!(shown.code, Some(0), "{}", shown.stderr);
    let drawn = pipeline("{ file: d1_circle.dxf, without: [{ disc: { centre: [25 mm, 25 mm], radius: '${r}' } }] }");
    assert_eq!(drawn.code, Some(0), "{}", drawn.stderr);
    for (shapes, says) in [
        (
            "{ disc: { centre: [25 mm, 25 mm], radius: '${r}' } }, \
             { group: 2, disc: { centre: [25 mm, 25 mm], radius: 1 mm } }",
            "found electrode group 2",
        ),
        (
            "{ disc: { centre: [90 mm, 25 mm], radius: '${r}' } }",
            "nothing of it lies on the membrane of 50 mm",
        ),
        (
            "{ file: d1_circle.dxf, layer: X, join: '${r}' }",
            "the file d1_circle.dxf: the drawing has no curves on layer",
        ),
        ("{ file: missing.dxf, join: '${r}' }", "missing.dxf: it does not exist"),
        (
            "{ file: d1_circle.dxf, disc: { centre: [25 mm, 25 mm], radius: '${r}' } }",
            "unknown key `disc`",
        ),
    ] {
        let ended = pipeline(shapes);
        let flat = ended.stderr.replace("\n  │ ", " ");
        assert!(
            ended.code == Some(2) && flat.contains(says),
            "{shapes}: {:?} {}",
            ended.code,
            ended.stderr
        );
    }
}

/// A scene with a disc of 20 mm as membrane, at 5 kV.
fn disc_scene(curves: &str) -> String {
    format!(
        "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50, frame: {{ opening: {{ disc: {{ \
         centre: [25 mm, \
         25 mm], radius: 20 mm }} }}, curves: {curves} }} }}\nmaterial: {{ model: neo-hookean, shear_modulus: 45 kPa, \
         relative_permittivity: 4.7 }}\ndrive: {{ voltage: 5 kV }}\neffects: {{}}\n"
    )
}

/// A drawing in mm of circles, each with its layer, centre and radius.
fn circles(all: &[(&str, [f64; 2], f64)]) -> String {
    let circle = |(layer, [x, y], radius): &(&str, [f64; 2], f64)| {
        format!("0\nCIRCLE\n8\n{layer}\n10\n{x}\n20\n{y}\n40\n{radius}\n")
    };
    let entities: String = all.iter().map(circle).collect();
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{entities}0\nTEXT\n8\nFRAME\n\
         10\n0\n20\n0\n1\nlabel\n0\nENDSEC\n0\nEOF\n"
    )
}

/// The scene of [`disc_scene`] with its shapes in a drawing, whose origin is the centre of the membrane.
fn drawn_scene(file: &str, curves: &str) -> String {
    let disc = "disc: { centre: [25 mm, 25 mm], radius: 20 mm }";
    let scene = disc_scene(curves);
    assert!(scene.contains(disc));
    scene.replace(
        disc,
        &format!("file: {file}, layer: FRAME, unit: mm, origin: [25 mm, 25 mm], join: 1 um"),
    )
}

#[test]
fn drawings_are_frames_bodies_and_regions() {
    let workspace = Workspace::new();
    let drawing = circles(&[("FRAME", [0.0; 2], 20.0), ("TIP", [12.0, 0.0], 3.0)]);
    workspace.write("device.dxf", &drawing);
    std::fs::create_dir(workspace.path("own")).unwrap();
    workspace.write("own/other.dxf", &drawing.replace("label", "renamed"));
    workspace.write(
        "disc.svg",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"50mm\" height=\"50mm\" viewBox=\"0 0 50 50\"><circle \
         cx=\"25\" cy=\"25\" r=\"6\"/></svg>",
    );
    let tip =
        |shape: &str, curves: &str| format!(", curves: {curves} }}, bodies: [{{ {shape}, curves: {curves} }}] }}");
    let solved = |name: &str, scene: &str| {
        workspace.write(&format!("{name}.yaml"), scene);
        let (scene, out) = (format!("{name}.yaml"), format!("{name}.h5"));
        let arguments = [
            "solve",
            &scene,
            "disc.svg",
            "--edges",
            "fitted",
            "--no-checks",
            "--json",
            "-o",
            &out,
        ];
        let ended = workspace.run(&arguments);
        assert_eq!(ended.code, Some(0), "{name}: {}", ended.stderr);
        let file = hdf5::File::open(workspace.path(&out)).unwrap();
        let field = file.dataset("displacement").unwrap().read_raw::<f64>().unwrap();
        (field, ended.json())
    };
    for curves in ["fitted", "cells"] {
        let end = format!(", curves: {curves} }} }}");
        let in_yaml = tip("disc: { centre: [37 mm, 25 mm], radius: 3 mm }", curves);
        let in_file = tip("file: device.dxf, layer: TIP, origin: [25 mm, 25 mm]", curves);
        let (written, _) = solved("written", &disc_scene(curves).replace(&end, &in_yaml));
        let (drawn, told) = solved("drawn", &drawn_scene("device.dxf", curves).replace(&end, &in_file));
        let far = written
            .iter()
            .zip(&drawn)
            .map(|(one, other)| (one - other).abs())
            .fold(0.0, f64::max);
        assert!(far < 1e-9 && written.iter().any(|u| u.abs() > 0.1), "{curves}: {far}");
        assert!(
            told["notes"].to_string().contains("device.dxf: ignored: 1 TEXT"),
            "{told}"
        );
    }
    // What is drawn counts, not the name of its file; a crate has the file.
    let pipeline = |file: &str| {
        workspace.write(
            "scene.yaml",
            &drawn_scene(file, "fitted").replace("cells: 50", "cells: 16"),
        );
        workspace.write(
            "p.yaml",
            "version: 1\nname: frame\nscene: scene.yaml\nstages:\n  own: { kind: patterns, edges: fitted, files: \
             [disc.svg] }\n  solved: { kind: solve, needs: [own] }\n",
        );
        let run = workspace.stages(&["run", "p.yaml"]);
        (run.digests()["solved"].clone(), run.with("built").len())
    };
    let (first, built) = pipeline("device.dxf");
    assert_eq!(built, 2);
    assert_eq!(pipeline("own/other.dxf"), (first.clone(), 0));
    let ended = workspace.run(&["export", "crate", "p.yaml", "-o", "crate"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert!(workspace.path("crate/workflow/own/other.dxf").is_file());
    workspace.write("own/other.dxf", &circles(&[("FRAME", [0.0; 2], 19.0)]));
    assert_ne!(pipeline("own/other.dxf").0, first);
    // Regions without electrodes of a search.
    let plan = |region: &str| {
        workspace.write(
            "d.yaml",
            &format!(
                "version: 1\nname: search\nscene: scene.yaml\nstages:\n  best: {{ kind: design, seed: 1, objective: {{ \
                 point: [30 mm, 25 mm], direction: 0 deg }}, constraints: {{ keep_out: [{{ {region} }}] }} }}\n"
            ),
        );
        workspace.run(&["plan", "d.yaml", "--json"])
    };
    let ended = plan("file: device.dxf, layer: TIP, origin: [25 mm, 25 mm]");
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let ended = plan("file: device.dxf, layer: TIP, origin: [90 mm, 25 mm]");
    assert!(
        ended.code == Some(2) && ended.stderr.contains("contains no cell centre"),
        "{}",
        ended.stderr
    );
    let ended = plan("file: device.dxf, layer: RIM");
    assert!(
        ended.code == Some(2) && ended.stderr.contains("no curves on layer \"RIM\""),
        "{}",
        ended.stderr
    );
}

#[test]
fn drawings_that_are_no_frames_are_refused() {
    let workspace = Workspace::new();
    workspace.write("far.dxf", &circles(&[("FRAME", [100.0, 0.0], 20.0)]));
    workspace.write(
        "other.dxf",
        &circles(&[("RIM", [0.0; 2], 20.0), ("PADS", [3.0; 2], 2.0)]),
    );
    let line = "0\nLINE\n8\nFRAME\n10\n0\n20\n0\n11\n9\n21\n0\n";
    workspace.write("open.dxf", &circles(&[]).replace("0\nTEXT", &format!("{line}0\nTEXT")));
    workspace.write(
        "unit.dxf",
        &circles(&[("FRAME", [0.0; 2], 20.0)]).replace("$INSUNITS", "$OTHER"),
    );
    workspace.write("disc.csv", &pattern(|x, _| u8::from(x < 25)));
    let mut printed = Transcript::default();
    for file in ["far.dxf", "other.dxf", "open.dxf", "unit.dxf", "none.dxf", "disc.csv"] {
        let scene = drawn_scene(file, "fitted");
        let scene = if file == "unit.dxf" {
            scene.replace("unit: mm, ", "")
        } else {
            scene
        };
        workspace.write("scene.yaml", &scene);
        let ended = workspace.run(&["solve", "scene.yaml", "disc.csv", "--no-checks"]);
        assert_eq!(ended.code, Some(2), "{file}: {}", ended.stderr);
        printed.add(file, ended.stderr);
    }
    snapshot!(printed);
}

#[test]
fn elements_follow_drawn_electrodes() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &disc_scene("fitted"));
    example(&workspace, "d1_circle.dxf");
    workspace.write(
        "disc.svg",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"50mm\" height=\"50mm\" viewBox=\"0 0 50 50\"><circle \
         cx=\"25\" cy=\"25\" r=\"10\"/></svg>",
    );
    // The closed form of a disc electrode of 10 mm: 1.0482346 mm at its edge.
    let largest = |arguments: &[&str]| {
        let ended = workspace.run(
            &[
                &[
                    "solve",
                    "scene.yaml",
                    "--json",
                    "--no-checks",
                    "--elements-per-cell",
                    "1",
                ],
                arguments,
            ]
            .concat(),
        );
        assert_eq!(ended.code, Some(0), "{arguments:?}: {}", ended.stderr);
        let found = ended.json();
        assert!(!found["notes"].to_string().contains("centres of cells"), "{found}");
        found["patterns"][0]["max_displacement_mm"].as_f64().unwrap()
    };
    let fitted = ["disc.svg", "--edges", "fitted"];
    assert!((largest(&[&fitted[..], &["--order", "2"]].concat()) - 1.048_234_6).abs() < 1e-4);
    assert!((largest(&fitted) - 1.048_234_6).abs() < 2e-3);
    let file = ["-o", "out.h5", "--order", "2"];
    largest(&[&fitted[..], &file].concat());
    // The drawn shape is in the result, and is read from there.
    let again = largest(&["out.h5:/patterns", "--order", "2"]);
    assert!(
        (again - 1.048_234_6).abs() > 1e-3,
        "cells are read from a file that is no artifact: {again}"
    );
    workspace.write("coarse.yaml", &disc_scene("fitted").replace("cells: 50", "cells: 16"));
    for (arguments, says) in [
        (&["--modes", "1"][..], "density"),
        (&["--history", "--at", "0 s", "-o", "h.h5"], ""),
        (&["--path", "-o", "p.h5"], ""),
        (&["--cells", "--no-checks", "-o", "c.h5"], ""),
        (&["--accuracy", "0.1 mm", "--no-checks"], ""),
    ] {
        let ended = workspace.run(&[&["solve", "coarse.yaml"], &fitted[..], arguments].concat());
        let is_expected = match says {
            "" => ended.code == Some(0),
            says => ended.code == Some(2) && ended.stderr.contains(says),
        };
        assert!(is_expected, "{arguments:?}: {:?} {}", ended.code, ended.stderr);
    }
    workspace.write("cells.csv", &pattern(|x, _| u8::from(x < 25)));
    let ended = workspace.run(&["solve", "scene.yaml", "cells.csv", "--edges", "fitted"]);
    assert!(
        ended.code == Some(2) && ended.stderr.contains("elements can follow the edges of drawings alone"),
        "{}",
        ended.stderr
    );
}

#[test]
fn drawn_electrodes_cover_parts_of_cells() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &disc_scene("fitted"));
    workspace.write("coarse.yaml", &disc_scene("fitted").replace("cells: 50", "cells: 16"));
    example(&workspace, "d1_circle.dxf");
    let grey = |pixel: usize| {
        let inside = |k: usize| {
            let place = |at: usize, k: usize| at as f64 + (k as f64 + 0.5) / 16.0;
            let (x, y) = (place(pixel % 50, k % 16), place(pixel / 50, k / 16));
            (x - 25.0).hypot(y - 25.0) < 10.0
        };
        255 - (255 * (0..256).filter(|k| inside(*k)).count() / 256) as u8
    };
    let pixels: Vec<u8> = (0..2500).map(grey).collect();
    let mut encoder = png::Encoder::new(std::fs::File::create(workspace.path("disc.png")).unwrap(), 50, 50);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    workspace.write(
        "disc.svg",
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"50mm\" height=\"50mm\" viewBox=\"0 0 50 50\"><circle \
         cx=\"25\" cy=\"25\" r=\"10\"/></svg>",
    );
    let solve = |scene: &str, file: &str, arguments: &[&str]| {
        let all = [&["solve", scene, file, "--edges", "coverage"], arguments].concat();
        workspace.run(&all)
    };
    // The closed form of a disc electrode of 10 mm, at the corner 5 mm right of the centre: 0.5241173 mm.
    let right = |file: &str| {
        let arguments = [
            "--json",
            "--no-checks",
            "--elements-per-cell",
            "1",
            "--order",
            "2",
            "--point",
            "30 mm, 25 mm",
        ];
        let ended = solve("scene.yaml", file, &arguments);
        assert_eq!(ended.code, Some(0), "{file}: {}", ended.stderr);
        let found = ended.json();
        assert!(!found["notes"].to_string().contains("centres of cells"), "{found}");
        found["patterns"][0]["along_mm"]
            .as_f64()
            .unwrap_or_else(|| panic!("{found}"))
    };
    for (file, most) in [("disc.svg", 1e-3), ("disc.png", 2e-3)] {
        let found = right(file);
        assert!((found - 0.524_117_3).abs() < most, "{file}: {found}");
    }
    for (arguments, says) in [
        (&["--modes", "1"][..], "density"),
        (&["--path", "-o", "p.h5"], ""),
        (&["--cells", "--no-checks", "-o", "c.h5"], ""),
        (&["--accuracy", "0.1 mm", "--no-checks"], "together with `accuracy`"),
        (&["--method", "linear", "--no-checks"], "together with `method: linear`"),
        (&["--history", "--at", "0 s", "-o", "h.h5"], "together with a history"),
        (
            &["--set", "effects.wrinkling={}", "--no-checks"],
            "together with `wrinkling`",
        ),
    ] {
        let ended = solve("coarse.yaml", "disc.svg", arguments);
        let is_expected = match says {
            "" => ended.code == Some(0),
            says => ended.code == Some(2) && ended.stderr.replace("\n  │ ", " ").contains(says),
        };
        assert!(is_expected, "{arguments:?}: {:?} {}", ended.code, ended.stderr);
    }
    workspace.write("cells.csv", &pattern(|x, _| u8::from(x < 25)));
    let ended = solve("scene.yaml", "cells.csv", &[]);
    assert!(
        ended.code == Some(2)
            && ended
                .stderr
                .contains("drawings and pictures alone cover parts of cells"),
        "{}",
        ended.stderr
    );
}

#[test]
fn covered_cells_are_kept_in_artifacts() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &disc_scene("cells"));
    let pipeline = |edges: &str, more: &str| {
        workspace.write(
            "rings.yaml",
            &format!(
                "version: 1\nname: rings\nscene: scene.yaml\nstages:\n  own: {{ foreach: {{ r: [9 mm, 10 mm, 10.05 \
                 mm] }}, kind: patterns, edges: {edges}, shapes: [{{ ring: {{ centre: [25 mm, 25 mm], radii: [3 mm, \
                 '${{r}}'] }} }}] }}\n  square: {{ kind: patterns, edges: {edges}, shapes: [{{ rectangle: [[20 mm, 20 mm], \
                 [30 mm, 30 mm]] }}] }}\n  plain: {{ kind: sample, family: blobs, count: 2, seed: 1 }}\n  solved: {{ \
                 kind: solve, needs: [own, square], gather: true, elements_per_cell: 1 }}\n{more}"
            ),
        );
    };
    let run = || {
        let ended = workspace.run(&["run", "rings.yaml", "--json"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let shown = workspace.run(&["show", "rings.yaml:solved", "--csv"]);
        assert_eq!(shown.code, Some(0), "{}", shown.stderr);
        (ended.json(), shown.stdout)
    };
    pipeline("cells", "");
    let (_, of_cells) = run();
    pipeline("coverage", "");
    let (first, covered) = run();
    let (again, _) = run();
    let built = |run: &Value, stage: &str| {
        let mut stages = run["stages"].as_array().unwrap().iter();
        let found = stages.find(|found| found["name"] == stage);
        found
            .and_then(|found| found["chunks_built"].as_u64())
            .unwrap_or_else(|| panic!("{run}"))
    };
    assert_eq!((built(&first, "solved"), built(&again, "solved")), (4, 0));
    // 10 mm and 10.05 mm have the same cells but not the same cover; the square has whole cells.
    let rows = |text: &str| text.lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
    let (of_cells, covered) = (rows(&of_cells), rows(&covered));
    assert!(covered.len() == 4 && covered[1] != covered[2], "{covered:?}");
    assert_ne!(of_cells[1], covered[1]);
    for (more, says) in [
        (
            "  balanced: { kind: balance, needs: [solved], bins: 4, range: [0 mm, 2 mm], target: 3, seed: 1 }\n",
            "edges by coverage",
        ),
        ("  checked: { kind: audit, needs: [solved] }\n", "edges by coverage"),
        (
            "  both: { kind: solve, needs: [own, plain], gather: true }\n",
            "solve them in two stages",
        ),
        (
            "  fine: { kind: solve, needs: [own], gather: true, accuracy: 0.1 mm }\n",
            "together with `accuracy`",
        ),
    ] {
        pipeline("coverage", more);
        let ended = workspace.run(&["plan", "rings.yaml"]);
        assert!(
            ended.code == Some(2) && ended.stderr.replace("\n  │ ", " ").contains(says),
            "{more}: {:?} {}",
            ended.code,
            ended.stderr
        );
    }
}

#[test]
fn drawn_electrodes_are_kept_in_artifacts() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &disc_scene("cells"));
    let pipeline = |edges: &str, more: &str| {
        workspace.write(
            "rings.yaml",
            &format!(
                "version: 1\nname: rings\nscene: scene.yaml\nstages:\n  own: {{ \
                 foreach: {{ r: [9 mm, 10 mm, 10.2 mm] }}, \
                 kind: patterns, edges: {edges}, \
                 shapes: [{{ ring: {{ centre: [25 mm, 25 mm], radii: [3 mm, '${{r}}'] }} }}] }}\n  \
                 plain: {{ kind: sample, family: blobs, count: 2, seed: 1 }}\n  \
                 solved: {{ kind: solve, needs: [own], gather: true, elements_per_cell: 1 }}\n{more}"
            ),
        );
    };
    let run = || {
        let ended = workspace.run(&["run", "rings.yaml", "--json"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        ended.json()
    };
    let displacement = || {
        let shown = workspace.run(&["show", "rings.yaml:solved", "--csv"]);
        assert_eq!(shown.code, Some(0), "{}", shown.stderr);
        shown.stdout
    };
    pipeline("cells", "");
    run();
    let of_cells = displacement();
    pipeline("fitted", "");
    let first = run();
    let fitted = displacement();
    assert_ne!(of_cells, fitted);
    // Nothing is built twice.
    let again = run();
    let built = |run: &Value, stage: &str| {
        let stages = run["stages"].as_array().unwrap().iter();
        let found = stages
            .clone()
            .find(|found| found["name"] == stage)
            .unwrap_or_else(|| panic!("{run}"));
        found["chunks_built"].as_u64().unwrap_or_else(|| panic!("{found}"))
    };
    assert_eq!((built(&first, "solved"), built(&again, "solved")), (3, 0));
    // 10 mm and 10.2 mm have the same cells but not the same electrode.
    let rows: Vec<&str> = fitted.lines().collect();
    assert!(rows.len() == 4 && rows[2] != rows[3], "{fitted}");
    for (more, says) in [
        (
            "  balanced: { kind: balance, needs: [solved], bins: 4, range: [0 mm, 2 mm], target: 3, seed: 1 }\n",
            "fitted edges",
        ),
        ("  checked: { kind: audit, needs: [solved] }\n", "fitted edges"),
        (
            "  both: { kind: solve, needs: [own, plain], gather: true }\n",
            "solve them in two stages",
        ),
    ] {
        pipeline("fitted", more);
        let ended = workspace.run(&["plan", "rings.yaml"]);
        assert!(
            ended.code == Some(2) && ended.stderr.contains(says),
            "{more}: {:?} {}",
            ended.code,
            ended.stderr
        );
    }
}

#[test]
fn stated_errors_contain_that_of_cells_in_place_of_curves() {
    let workspace = Workspace::new();
    workspace.write("mask.dxf", &circles(&[("M", [25.0, 25.0], 9.7)]));
    // What solve, accuracy and verify state with the frame and the electrode on cells, or followed by elements.
    let stated = |curves: &str| {
        let scene = disc_scene(curves)
            .replace("cells: 50", "cells: 20")
            .replace("radius: 20 mm", "radius: 20.4 mm");
        workspace.write("scene.yaml", &scene.replace("5 kV", "4 kV"));
        let solve = [
            "solve",
            "scene.yaml",
            "mask.dxf",
            "--accuracy",
            "0.05 mm",
            "--edges",
            curves,
            "--no-checks",
        ];
        let solved = workspace.run(&[&solve[..], &["--json"]].concat());
        assert_eq!(solved.code, Some(0), "{}", solved.stderr);
        let told = workspace
            .run(&solve)
            .stdout
            .contains("elements follow cells instead of curves");
        workspace.write(
            "cells.csv",
            &(0..20)
                .map(|_| "0,0,0,0,0,0,0,0,1,1,1,1,1,1,0,0,0,0,0,0\n")
                .collect::<String>(),
        );
        let measured = workspace.run(&[
            "accuracy",
            "scene.yaml",
            "--patterns",
            "cells.csv",
            "-o",
            curves,
            "--reference",
            "{ elements_per_cell: 2, order: 2 }",
            "--methods",
            "[{ elements_per_cell: 1, order: 1 }]",
            "--json",
        ]);
        assert_eq!(measured.code, Some(0), "{}", measured.stderr);
        workspace.write(
            "verify.yaml",
            "version: 1\nname: verify\nscene: scene.yaml\nstages:\n  design: { kind: design, \
             method: adjoint, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, starts: 1, seed: 1 }\n  \
             verified: { kind: verify, needs: [design], elements_per_cell: 2 }\n",
        );
        let run = workspace.run(&["run", "verify.yaml"]);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let line = run
            .stdout
            .lines()
            .find(|line| line.contains("simulated") && line.contains('±'));
        let error = line.and_then(|line| line.split('±').nth(1)?.split_whitespace().next()?.parse::<f64>().ok());
        let pattern = solved.json()["patterns"][0].clone();
        let of_methods = measured.json()["reference"]["geometry_error_mm"].as_f64();
        let bound = measured.json()["methods"][0]["bound_mm"].as_f64().unwrap();
        (
            pattern["geometry_error"].as_f64(),
            told,
            of_methods,
            bound,
            error.unwrap(),
        )
    };
    let (solved, told, measured, bound, verified) = stated("cells");
    assert!(solved.unwrap() > 0.03 && told, "{solved:?}");
    assert!(
        measured.unwrap() > 0.01 && bound > measured.unwrap(),
        "{measured:?} {bound}"
    );
    let (of_curves, is_told, of_methods, _, of_mesh) = stated("fitted");
    assert_eq!((of_curves, is_told, of_methods), (None, false, None));
    assert!(verified > 3.0 * of_mesh, "{verified} {of_mesh}");
}
