//! Membranes that are not the source paper's square.

use super::common::Workspace;

/// A stretched strip of 60 × 30 mm whose cells are not square.
const SCENE: &str = "geometry: { size: [60 mm, 30 mm], thickness: 1.0 mm, prestretch: [3, 4], cells: [40, 24] }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 4 kV }
effects: {}
";

const PIPELINE: &str = "version: 1
name: device
scene: scene.yaml
stages:
  drawn: { kind: patterns, files: [disc.csv] }
  solved: { kind: solve, needs: [drawn] }
";

fn csv([columns, rows]: [usize; 2], active: impl Fn(usize, usize) -> bool) -> String {
    let line = |y: usize| -> String {
        let cells: Vec<&str> = (0..columns).map(|x| if active(x, y) { "1" } else { "0" }).collect();
        cells.join(",") + "\n"
    };
    (0..rows).map(line).collect()
}

fn workspace() -> Workspace {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", SCENE);
    workspace.write(
        "disc.csv",
        &csv([40, 24], |x, y| {
            (1.5 * x as f64 - 20.0).hypot(1.25 * y as f64 - 15.0) < 9.0
        }),
    );
    workspace.write("square.csv", &csv([50, 50], |x, _| x < 20));
    workspace
}

fn dataset(workspace: &Workspace, file: &str, path: &str) -> (Vec<usize>, Vec<f64>) {
    let file = hdf5::File::open(workspace.path(file)).unwrap();
    let dataset = file.dataset(path).unwrap();
    (dataset.shape(), dataset.read_raw::<f64>().unwrap())
}

#[test]
fn a_rectangle_is_solved_and_its_mirror_image_is_the_mirrored_solution() {
    let workspace = workspace();
    workspace.write(
        "image.csv",
        &csv([40, 24], |x, y| {
            (1.5 * (39 - x) as f64 - 20.0).hypot(1.25 * y as f64 - 15.0) < 9.0
        }),
    );
    let arguments = [
        "solve",
        "scene.yaml",
        "disc.csv",
        "image.csv",
        "-o",
        "out.h5",
        "--cells",
    ];
    let ended = workspace.run(&arguments);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let (shape, displacement) = dataset(&workspace, "out.h5", "displacement");
    assert_eq!(shape, [2, 25, 41, 2]);
    assert_eq!(dataset(&workspace, "out.h5", "cells/stretches").0, [2, 24, 40, 2]);
    let (one, image) = displacement.split_at(25 * 41 * 2);
    let largest = one.iter().fold(0.0, |largest: f64, u| largest.max(u.abs()));
    assert!(largest > 0.5, "{largest}");
    for (at, u) in one.chunks(2).enumerate() {
        let mirrored = &image[2 * (at / 41 * 41 + 40 - at % 41)..][..2];
        assert!((u[0] + mirrored[0]).abs() < 1e-6 && (u[1] - mirrored[1]).abs() < 1e-6);
    }
}

#[test]
fn a_pipeline_solves_patterns_of_a_rectangle_and_knows_them_again() {
    let workspace = workspace();
    workspace.write("device.yaml", PIPELINE);
    let built = workspace.stages(&["run", "device.yaml"]);
    assert_eq!(built.with("built"), ["drawn", "solved"]);
    assert_eq!(
        workspace.stages(&["run", "device.yaml"]).with("reused"),
        ["drawn", "solved"]
    );
    // A square said as two equal sides is a square.
    workspace.write("side.yaml", &SCENE.replace("size: [60 mm, 30 mm]", "side: 40 mm"));
    workspace.write(
        "size.yaml",
        &SCENE.replace("size: [60 mm, 30 mm]", "size: [40 mm, 4 cm]"),
    );
    let digests = ["side", "size"].map(|scene| {
        let file = format!("{scene}-device.yaml");
        workspace.write(&file, &PIPELINE.replace("scene.yaml", &format!("{scene}.yaml")));
        workspace.stages(&["run", &file]).digests()["solved"].clone()
    });
    assert_eq!(digests[0], digests[1]);
    assert_ne!(digests[0], built.digests()["solved"]);
}

#[test]
fn every_family_draws_on_any_membrane_and_on_the_square_as_before() {
    let workspace = workspace();
    let families = [
        "small-grid, count: 2",
        "large-grid, units: [4], count_per_units: 2",
        "bezier, count: 2",
        "area-sweep, count: 2",
        "stripes, count: 2",
        "blobs, count: 2",
        "curves, count: 2",
        "checker, count: 2",
        "dithers, count: 2",
        "mazes, count: 2",
        "diagonals, count: 2",
        "spirals, count: 2",
        "glyphs, count: 2",
    ];
    let mut text = String::from("version: 1\nname: device\nscene: scene.yaml\nstages:\n");
    for (at, family) in families.iter().enumerate() {
        text += &format!("  s{at}: {{ kind: sample, family: {family}, seed: 1 }}\n");
    }
    let needs: Vec<String> = (0..families.len()).map(|at| format!("s{at}")).collect();
    text += &format!(
        "  solved: {{ kind: solve, needs: [{}], elements_per_cell: 1 }}\n",
        needs.join(", ")
    );
    workspace.write("families.yaml", &text);
    let built = workspace.stages(&["run", "families.yaml"]);
    assert_eq!(built.with("built").len(), families.len() + 1);
    // Of the same square, however large, the samples are the same; of another membrane they are not.
    for (size, same) in [("[20 mm, 20 mm]", true), ("[20 mm, 21 mm]", false)] {
        let sets = [
            format!("scene.geometry.size={size}"),
            "scene.geometry.cells=50".to_owned(),
        ];
        let arguments = [
            "run",
            "families.yaml",
            "--until",
            "s5",
            "--set",
            &sets[0],
            "--set",
            &sets[1],
        ];
        let drawn = workspace.stages(&arguments).digests()["s5"].clone();
        let drawn_alone = text
            .split("  solved")
            .next()
            .unwrap()
            .replace("scene: scene.yaml\n", "");
        workspace.write("no-scene.yaml", &drawn_alone);
        let of_square = workspace.stages(&["run", "no-scene.yaml", "--until", "s5"]).digests()["s5"].clone();
        assert_eq!(drawn == of_square, same, "{size}");
    }
}

#[test]
fn a_mask_has_the_sides_of_its_membrane_stretched_or_not() {
    let workspace = workspace();
    for (size, sides) in [("prestretched", [60.0, 30.0]), ("undeformed", [20.0, 7.5])] {
        let arguments = [
            "export",
            "design",
            "disc.csv",
            "--scene",
            "scene.yaml",
            "--size",
            size,
            "-o",
            "mask.svg",
            "--json",
        ];
        let ended = workspace.run(&arguments);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        assert_eq!(ended.json()["side_mm"], serde_json::json!(sides));
        let drawn = std::fs::read_to_string(workspace.path("mask.svg")).unwrap();
        assert!(
            drawn.contains(&format!("viewBox=\"0 0 {} {}\"", sides[0], sides[1])),
            "{drawn}"
        );
    }
    let ended = workspace.run(&[
        "export",
        "design",
        "disc.csv",
        "--scene",
        "scene.yaml",
        "-o",
        "membrane.vtkhdf",
        "--json",
    ]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(ended.json()["elements"], 80 * 48);
}

#[test]
fn what_does_not_fit_the_membrane_is_said() {
    let workspace = workspace();
    let pipeline = |stages: &str| format!("version: 1\nname: device\nscene: scene.yaml\nstages:\n{stages}");
    workspace.write(
        "trained.yaml",
        &pipeline(
            "  s: { kind: sample, family: blobs, count: 3, seed: 1 }\n  v: { kind: solve, needs: [s] }\n  \
             b: { kind: balance, needs: [v], bins: 5, range: [0 mm, 2 mm], target: 10, seed: 1 }\n  \
             m: { kind: train, needs: [b], network: physics, epochs: 1, seed: 1 }\n",
        ),
    );
    workspace.write(
        "imported.yaml",
        &pipeline("  i: { kind: import, files: [square.npz] }\n"),
    );
    for (name, geometry) in [
        (
            "both",
            "{ side: 5 mm, size: [5 mm, 6 mm], thickness: 1 mm, prestretch: 3, cells: 50 }",
        ),
        ("none", "{ thickness: 1 mm, prestretch: 3, cells: 50 }"),
        (
            "many",
            "{ side: 5 mm, thickness: 1 mm, prestretch: 3, cells: [401, 20] }",
        ),
        (
            "three",
            "{ side: 5 mm, thickness: 1 mm, prestretch: [3, 3, 3], cells: 50 }",
        ),
    ] {
        let rest = SCENE.split_once('\n').unwrap().1;
        workspace.write(&format!("{name}.yaml"), &format!("geometry: {geometry}\n{rest}"));
    }
    for (arguments, says) in [
        (
            &["solve", "scene.yaml", "square.csv", "-o", "x.h5"][..],
            &["square.csv", "24 lines of 40 values"][..],
        ),
        (&["run", "trained.yaml"], &["50 × 50", "40 × 24"]),
        (&["run", "imported.yaml"], &["50 × 50", "40 × 24"]),
        (
            &["solve", "both.yaml", "disc.csv", "-o", "x.h5"],
            &["`size` and `side`"],
        ),
        (&["solve", "none.yaml", "disc.csv", "-o", "x.h5"], &["side"]),
        (&["solve", "many.yaml", "disc.csv", "-o", "x.h5"], &["401", "400"]),
        (&["solve", "three.yaml", "disc.csv", "-o", "x.h5"], &["two values"]),
    ] {
        let ended = workspace.run(arguments);
        assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
        for word in says {
            assert!(ended.stderr.contains(word), "{arguments:?}, {word}: {}", ended.stderr);
        }
    }
}

/// A disc frame with a hub, and a loaded body on a spring.
const DEVICE: &str = "geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3, cells: [40, 40],
  frame: { opening: { disc: { centre: [25 mm, 25 mm], radius: 23 mm } }, held: [{ rectangle: [[23 mm, 30 mm], [27 mm, 34 mm]] }] },
  bodies: [{ polygon: [[20 mm, 14 mm], [30 mm, 14 mm], [25 mm, 22 mm]], load: [10 mN, 0 N], spring: 2 N/m }] }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5 kV }
effects: {}
";

#[test]
fn frames_hold_bodies_move_and_pipelines_keep_both() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", DEVICE);
    workspace.write("left.csv", &csv([40, 40], |x, _| x < 20));
    workspace.write("bare.csv", &csv([40, 40], |_, _| false));
    let ended = workspace.run(&["solve", "scene.yaml", "left.csv", "bare.csv", "-o", "out.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let (shape, displacement) = dataset(&workspace, "out.h5", "displacement");
    assert_eq!(shape, [2, 41, 41, 2]);
    let at = |x: usize, y: usize| &displacement[2 * (y * 41 + x)..][..2];
    // Outside of the disc, and on the hub.
    for (x, y) in [(1, 1), (39, 2), (20, 26)] {
        assert_eq!(at(x, y), [0.0, 0.0]);
    }
    let (shape, translation) = dataset(&workspace, "out.h5", "body_translation");
    let (angles, rotation) = dataset(&workspace, "out.h5", "body_rotation");
    assert_eq!((shape, angles), (vec![2, 1, 2], vec![2, 1]));
    // The active left half and the load push to the right; the load alone pushes less.
    assert!(
        translation[0] > translation[2] && translation[2] > 0.04,
        "{translation:?}"
    );
    // Corners within the body move as it says: two of them tell the rotation.
    let (low, high) = (at(20, 12), at(20, 16));
    let turned = (low[0] - high[0]).atan2(1.25 * 4.0 + high[1] - low[1]).to_degrees();
    assert!((turned - rotation[0]).abs() < 1e-6, "{turned} {rotation:?}");
    workspace.write("device.yaml", &PIPELINE.replace("disc.csv", "left.csv"));
    workspace.stages(&["run", "device.yaml"]);
    assert_eq!(
        workspace.stages(&["run", "device.yaml"]).with("reused"),
        ["drawn", "solved"]
    );
}

#[test]
fn what_is_no_device_is_said_where_it_stands() {
    let workspace = Workspace::new();
    workspace.write("bare.csv", &csv([20, 20], |_, _| false));
    let body =
        |place: &str| format!("bodies: [{{ rectangle: [[8 mm, 8 mm], [12 mm, 12 mm]] }}, {{ rectangle: {place} }}]");
    for (device, line, says) in [
        ("frame: { }", 2, "`frame` holds nothing"),
        (
            "frame: { held: [{ rectangle: [[0, 0], [20, 20]] }] }",
            2,
            "no cell of the membrane is left free",
        ),
        (
            "frame: { opening: { disc: { centre: [50, 50], radius: 1 } } }",
            2,
            "no cell of the membrane is left free",
        ),
        ("frame: { opening: { } }", 2, "a shape is one of"),
        (
            "frame: { opening: { disc: { centre: [5, 5], radius: 1 }, rectangle: [[0, 0], [1, 1]] } }",
            2,
            "a shape is one of",
        ),
        (&body("[[2 mm, 2 mm], [2.1 mm, 2.1 mm]]"), 2, "body 1 covers no cell"),
        (&body("[[0 mm, 2 mm], [4 mm, 6 mm]]"), 2, "body 1 touches the frame"),
        (&body("[[0 mm, 0 mm], [20 mm, 20 mm]]"), 2, "body 1 touches the frame"),
        (&body("[[12 mm, 12 mm], [14 mm, 14 mm]]"), 2, "bodies 0 and 1 touch"),
        ("bodies: [{ load: [1 N, 0 N] }]", 2, "a shape is one of"),
        (
            "bodies: [{ disc: { centre: [10, 10], radius: 2 }, load: [1 V, 0 N] }]",
            2,
            "unknown unit",
        ),
        ("bodies: []", 2, "is empty"),
    ] {
        workspace.write(
            "scene.yaml",
            &format!(
                "geometry: {{ side: 20 mm, thickness: 1.0 mm, prestretch: 3, cells: 20,\n  {device} }}\n{}",
                SCENE.split_once('\n').unwrap().1
            ),
        );
        let ended = workspace.run(&["solve", "scene.yaml", "bare.csv", "-o", "x.h5"]);
        assert_eq!(ended.code, Some(2), "{device}: {}", ended.stderr);
        let place = format!("scene.yaml:{line}:");
        assert!(
            ended.stderr.contains(says) && ended.stderr.contains(&place),
            "{device}: {}",
            ended.stderr
        );
    }
}
