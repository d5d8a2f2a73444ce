//! Membranes that are not the source paper's square.

use hdf5::types::FixedUnicode;

use super::common::{Transcript, Workspace, snapshot};

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

/// Runs a command whose input is bad, checks that the message names some values, and returns the message.
fn refused(workspace: &Workspace, arguments: &[&str], named: &[&str]) -> String {
    let ended = workspace.run(arguments);
    assert_eq!(ended.code, Some(2), "{arguments:?}: {}", ended.stderr);
    for part in named {
        assert!(ended.stderr.contains(part), "{arguments:?}, {part}: {}", ended.stderr);
    }
    ended.stderr
}

fn texts(file: &hdf5::File, path: &str) -> Vec<String> {
    let texts = file.dataset(path).unwrap().read_raw::<FixedUnicode<64>>().unwrap();
    texts.iter().map(|text| text.as_str().to_owned()).collect()
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
fn input_that_does_not_fit_the_membrane_is_refused() {
    let workspace = workspace();
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
    let mut printed = Transcript::default();
    for (arguments, named) in [
        (
            &["solve", "scene.yaml", "square.csv", "-o", "x.h5"][..],
            &["square.csv", "24", "40"][..],
        ),
        (&["solve", "both.yaml", "disc.csv", "-o", "x.h5"], &["`size`", "`side`"]),
        (&["solve", "none.yaml", "disc.csv", "-o", "x.h5"], &["side"]),
        (&["solve", "many.yaml", "disc.csv", "-o", "x.h5"], &["401", "400"]),
        (&["solve", "three.yaml", "disc.csv", "-o", "x.h5"], &["prestretch"]),
    ] {
        printed.add(arguments[1], refused(&workspace, arguments, named));
    }
    snapshot!(printed);
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
fn mistakes_in_a_device_are_refused_with_their_line() {
    let workspace = Workspace::new();
    workspace.write("bare.csv", &csv([20, 20], |_, _| false));
    let body =
        |place: &str| format!("bodies: [{{ rectangle: [[8 mm, 8 mm], [12 mm, 12 mm]] }}, {{ rectangle: {place} }}]");
    let mut printed = Transcript::default();
    for (device, line, named) in [
        ("frame: { }", 2, "`frame`"),
        ("frame: { held: [{ rectangle: [[0, 0], [20, 20]] }] }", 2, "frame"),
        (
            "frame: { opening: { disc: { centre: [50, 50], radius: 1 } } }",
            2,
            "frame",
        ),
        ("frame: { opening: { } }", 2, "rectangle"),
        (
            "frame: { opening: { disc: { centre: [5, 5], radius: 1 }, rectangle: [[0, 0], [1, 1]] } }",
            2,
            "rectangle",
        ),
        (&body("[[2 mm, 2 mm], [2.1 mm, 2.1 mm]]"), 2, "body 1"),
        (&body("[[0 mm, 2 mm], [4 mm, 6 mm]]"), 2, "body 1"),
        (&body("[[0 mm, 0 mm], [20 mm, 20 mm]]"), 2, "body 1"),
        (&body("[[12 mm, 12 mm], [14 mm, 14 mm]]"), 2, "bodies 0 and 1"),
        ("bodies: [{ load: [1 N, 0 N] }]", 2, "rectangle"),
        (
            "bodies: [{ disc: { centre: [10, 10], radius: 2 }, load: [1 V, 0 N] }]",
            2,
            "1 V",
        ),
        ("bodies: []", 2, "bodies"),
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
            ended.stderr.contains(named) && ended.stderr.contains(&place),
            "{device}: {}",
            ended.stderr
        );
        printed.add(device, ended);
    }
    snapshot!(printed);
}

#[test]
fn groups_have_their_voltages_and_states_an_axis() {
    let workspace = workspace();
    let number = |x: usize| match x {
        0..14 => 1,
        14..26 => 0,
        _ => 2,
    };
    let line: Vec<String> = (0..40).map(|x| number(x).to_string()).collect();
    workspace.write("groups.csv", &(line.join(",") + "\n").repeat(24));
    let states =
        "states: { push: { voltages: [4 kV, 0 V] }, pull: { voltages: [0 V, 4 kV] }, rest: { voltages: [0 V, 0 V] } }";
    workspace.write("states.yaml", &SCENE.replace("drive: { voltage: 4 kV }", states));
    let ended = workspace.run(&["solve", "states.yaml", "groups.csv", "--voltage", "3 kV"]);
    assert_eq!(ended.code, Some(2));
    for part in ["--voltage cannot be used", "states.push.voltages"] {
        assert!(ended.stderr.contains(part), "{ended}");
    }
    workspace.write("push.yaml", &SCENE.replace("voltage: 4 kV", "voltages: [4 kV, 0 V]"));
    for (scene, file) in [("states.yaml", "states.h5"), ("push.yaml", "push.h5")] {
        let ended = workspace.run(&["solve", scene, "groups.csv", "groups.csv", "-o", file, "--cells"]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }
    let (shape, all) = dataset(&workspace, "states.h5", "displacement");
    assert_eq!(shape, [2, 3, 25, 41, 2]);
    assert_eq!(dataset(&workspace, "states.h5", "max_displacement").0, [2, 3]);
    assert_eq!(
        dataset(&workspace, "states.h5", "cells/electric_field").0,
        [2, 3, 24, 40]
    );
    assert_eq!(dataset(&workspace, "states.h5", "patterns").0, [2, 24, 40]);
    let file = hdf5::File::open(workspace.path("states.h5")).unwrap();
    let names = texts(&file, "states");
    assert_eq!(names, ["pull", "push", "rest"]);
    let row = 25 * 41 * 2;
    let (_, push) = dataset(&workspace, "push.h5", "displacement");
    assert_eq!(push[..row], all[row..2 * row]);
    assert_eq!(all[..3 * row], all[3 * row..]);
    assert!(all[2 * row..3 * row].iter().all(|u| *u == 0.0));
    // Mirrored halves of a mirrored device: pull is push, seen in a mirror.
    let largest = push.iter().fold(0.0, |most: f64, u| most.max(u.abs()));
    for (at, u) in all[..row].chunks(2).enumerate() {
        let mirrored = &push[2 * (at / 41 * 41 + 40 - at % 41)..][..2];
        assert!((u[0] + mirrored[0]).abs() < 1e-6 * largest && (u[1] - mirrored[1]).abs() < 1e-6 * largest);
    }
    // One of the states alone.
    let ended = workspace.run(&["solve", "states.yaml", "groups.csv", "-o", "one.h5", "--state", "push"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    assert_eq!(dataset(&workspace, "one.h5", "displacement").1, push[..row]);
    let drawn = [
        "export",
        "design",
        "groups.csv",
        "--scene",
        "states.yaml",
        "--elements-per-cell",
        "1",
        "-o",
        "at.vtkhdf",
    ];
    let largest = |state: &[&str]| {
        let ended = workspace.run(&[&drawn[..], &["--json"], state].concat());
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let said = ended.json();
        (said["state"].clone(), said["max_displacement_mm"].as_f64().unwrap())
    };
    let (pull, rest) = (largest(&[]), largest(&["--state", "rest"]));
    assert_eq!((&pull.0, &rest.0), (&"pull".into(), &"rest".into()));
    assert!(pull.1 > 0.1 && rest.1 == 0.0, "{pull:?} {rest:?}");
    // A path is that of the first state by name, or of the requested one.
    let path = ["solve", "states.yaml", "groups.csv", "--path", "-o", "path.h5"];
    let told = workspace.run(&path).stdout;
    assert!(told.contains("\nstate: pull\n"), "{told}");
    let document = workspace
        .run(&[&path[..], &["--state", "push", "--json"]].concat())
        .json();
    assert_eq!(document["state"], "push");
    let unknown = ["solve", "states.yaml", "groups.csv", "-o", "no.h5", "--state", "hold"];
    let mut printed = Transcript::default();
    printed.add(
        "an unknown state",
        refused(&workspace, &unknown, &["`hold`", "pull, push, rest"]),
    );
    let screened = workspace.run(&["screen", "states.yaml", "--state", "rest"]);
    assert_eq!(screened.code, Some(0), "{}", screened.stderr);
    refused(
        &workspace,
        &["solve", "scene.yaml", "groups.csv", "-o", "no.h5"],
        &["groups.csv", "[y=0][x=26]", "2"],
    );
    // Stages of a pipeline simulate one drive; groups are theirs too.
    workspace.write(
        "p.yaml",
        &PIPELINE
            .replace("disc.csv", "groups.csv")
            .replace("scene.yaml", "states.yaml"),
    );
    printed.add(
        "a pipeline without a state",
        refused(&workspace, &["run", "p.yaml"], &["pull, push, rest"]),
    );
    snapshot!(printed);
    let text = PIPELINE
        .replace("disc.csv", "groups.csv")
        .replace("scene.yaml", "push.yaml");
    workspace.write("p.yaml", &text);
    assert_eq!(workspace.stages(&["run", "p.yaml"]).with("built"), ["drawn", "solved"]);
}

#[test]
fn a_mask_is_a_shape_and_what_is_in_it_counts_not_its_name() {
    let workspace = workspace();
    let disc = |x: usize, y: usize| (1.5 * (x as f64 + 0.5) - 30.0).hypot(1.25 * (y as f64 + 0.5) - 15.0) <= 14.0;
    workspace.write("opening.csv", &csv([40, 24], disc));
    workspace.write(
        "tip.csv",
        &csv([40, 24], |x, y| (18..22).contains(&x) && (10..14).contains(&y)),
    );
    let frame = |opening: &str, tip: &str| {
        let cells = "cells: [40, 24]";
        let more = format!("{cells}, frame: {{ opening: {{ {opening} }} }}, bodies: [{{ {tip} }}]");
        SCENE.replace(cells, &more)
    };
    workspace.write("mask.yaml", &frame("mask: opening.csv", "mask: tip.csv"));
    let (disc, tip) = (
        "disc: { centre: [30 mm, 15 mm], radius: 14 mm }",
        "rectangle: [[27 mm, 12.5 mm], [33 mm, 17.5 mm]]",
    );
    workspace.write("shapes.yaml", &frame(disc, tip));
    for scene in ["mask", "shapes"] {
        let ended = workspace.run(&[
            "solve",
            &format!("{scene}.yaml"),
            "disc.csv",
            "-o",
            &format!("{scene}.h5"),
        ]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }
    for array in ["displacement", "body_translation", "body_rotation"] {
        assert_eq!(
            dataset(&workspace, "mask.h5", array),
            dataset(&workspace, "shapes.h5", array)
        );
    }
    // The artifact holds the cells: it is found again under another name, and missed where a cell differs.
    let digest = |scene: &str| {
        workspace.write("p.yaml", &PIPELINE.replace("scene.yaml", scene));
        workspace.stages(&["run", "p.yaml"]).digests()["solved"].clone()
    };
    let first = digest("mask.yaml");
    let text = std::fs::read_to_string(workspace.path("opening.csv")).unwrap();
    workspace.write("other.csv", &text);
    workspace.write("renamed.yaml", &frame("mask: other.csv", "mask: tip.csv"));
    assert_eq!(digest("renamed.yaml"), first);
    // A crate has the masks beside the scene.
    let arguments = ["export", "crate", "p.yaml", "-o", "crate"];
    let ended = workspace.run(&arguments);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    for file in ["other.csv", "tip.csv", "disc.csv"] {
        assert!(workspace.path("crate/workflow").join(file).is_file(), "{file}");
    }
    workspace.write("other.csv", &text.replacen("1,1", "0,1", 1));
    assert_ne!(digest("renamed.yaml"), first);
    let mut printed = Transcript::default();
    for (opening, named) in [
        ("mask: nowhere.csv", &["nowhere.csv"][..]),
        ("mask: square.csv", &["50 × 50", "40 × 24"]),
        ("mask: scene.yaml", &["scene.yaml"]),
        ("mask: ../scene.csv", &["scene.csv"]),
        ("mask: { columns: 40, rows: 24, runs: [3, 4] }", &["runs"]),
    ] {
        workspace.write("wrong.yaml", &frame(opening, tip));
        let arguments = ["solve", "wrong.yaml", "disc.csv", "-o", "no.h5"];
        printed.add(opening, refused(&workspace, &arguments, named));
    }
    snapshot!(printed);
}

#[test]
fn families_draw_within_frames_and_in_groups() {
    let workspace = workspace();
    let frame = "cells: [40, 24], frame: { opening: { disc: { centre: [30 mm, 15 mm], radius: 14 mm } } }";
    let scene = SCENE.replace("cells: [40, 24]", frame);
    workspace.write(
        "scene.yaml",
        &scene.replace("voltage: 4 kV", "voltages: [4 kV, 3 kV, 0 V]"),
    );
    let text = "version: 1
name: groups
scene: scene.yaml
stages:
  one: { kind: sample, family: blobs, count: 6, seed: 1 }
  three: { kind: sample, family: blobs, count: 6, seed: 1, groups: 3 }
  solved: { kind: solve, needs: [one, three], elements_per_cell: 1 }
";
    workspace.write("groups.yaml", text);
    assert_eq!(workspace.stages(&["run", "groups.yaml"]).with("built").len(), 3);
    let cells = |stage: &str| {
        let file = format!("{stage}.h5");
        let ended = workspace.run(&["export", "artifact", &format!("groups.yaml:{stage}"), "-o", &file]);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        dataset(&workspace, &file, "patterns").1
    };
    let (one, three) = (cells("one"), cells("three"));
    for (at, (one, three)) in one.iter().zip(&three).enumerate() {
        let (x, y) = (at % 40, at / 40 % 24);
        let is_inside = (1.5 * (x as f64 + 0.5) - 30.0).hypot(1.25 * (y as f64 + 0.5) - 15.0) <= 14.0;
        assert!(is_inside || *one == 0.0, "({x}, {y})");
        assert_eq!(*one > 0.0, *three > 0.0);
    }
    for group in 1..=3 {
        let share = three.iter().filter(|cell| **cell == f64::from(group)).count();
        assert!(
            10 * share > one.iter().filter(|cell| **cell > 0.0).count(),
            "group {group}: {share}"
        );
    }
    workspace.write("groups.yaml", &text.replace("groups: 3", "groups: 4"));
    snapshot!(refused(&workspace, &["run", "groups.yaml"], &["3", "4"]));
}

#[test]
fn masks_have_a_layer_for_each_group_and_show_the_real_shape() {
    let workspace = workspace();
    let cells = "cells: [40, 24]";
    let device = format!(
        "{cells}, frame: {{ opening: {{ disc: {{ centre: [30 mm, 15 mm], radius: 14 mm }} }} }}, \
         bodies: [{{ rectangle: [[27 mm, 12 mm], [33 mm, 18 mm]] }}]"
    );
    let scene = SCENE
        .replace(cells, &device)
        .replace("voltage: 4 kV", "voltages: [4 kV, 3 kV]");
    workspace.write("device.yaml", &scene);
    let lines = csv([40, 24], |x, _| (12..17).contains(&x))
        .lines()
        .map(|line| line.to_owned() + "\n")
        .collect::<String>();
    let right = csv([40, 24], |x, _| (23..28).contains(&x)).replace('1', "2");
    let both: String = lines
        .chars()
        .zip(right.chars())
        .map(|(one, two)| if two == '2' { '2' } else { one })
        .collect();
    workspace.write("groups.csv", &both);
    let exported = ["export", "design", "groups.csv", "--scene", "device.yaml"];
    let export = |more: &[&str], file: &str| {
        let arguments = [
            &["export", "design", "groups.csv", "--scene", "device.yaml", "-o", file],
            more,
        ]
        .concat();
        workspace.run(&arguments)
    };
    for file in ["mask.dxf", "mask.svg", "mask.png", "mask.csv", "membrane.vtkhdf"] {
        let ended = export(&[], file);
        assert_eq!(ended.code, Some(0), "{file}: {}", ended.stderr);
    }
    let text = |file: &str| std::fs::read_to_string(workspace.path(file)).unwrap();
    let dxf = text("mask.dxf");
    for (layer, rings) in [("ELECTRODE_1", 1), ("ELECTRODE_2", 1), ("FRAME", 2), ("BODIES", 1)] {
        assert_eq!(
            dxf.matches(&format!("AcDbEntity\n  8\n{layer}\n")).count(),
            rings,
            "{layer}"
        );
    }
    assert!(text("mask.svg").contains("id=\"electrode-2\"") && text("mask.svg").contains("id=\"bodies\""));
    // What is written is read again: the image by its grey levels, the numbers as they are.
    let cells = |file: &str| {
        let solved = workspace.run(&["solve", "device.yaml", file, "-o", "out.h5"]);
        assert_eq!(solved.code, Some(0), "{file}: {}", solved.stderr);
        let out = hdf5::File::open(workspace.path("out.h5")).unwrap();
        out.dataset("patterns").unwrap().read_raw::<u8>().unwrap()
    };
    let wanted = cells("groups.csv");
    // An image has blocks of pixels for cells, which are not square here.
    for file in ["mask.png", "mask.csv"] {
        assert_eq!(cells(file), wanted, "{file}");
    }
    refused(
        &workspace,
        &[&exported[..], &["-o", "mask.gbr"]].concat(),
        &["--group 1", "--group 2"],
    );
    for group in ["1", "2"] {
        let file = format!("mask-{group}.gbr");
        assert_eq!(export(&["--group", group], &file).code, Some(0));
        assert_eq!(text(&file).matches("%LPD*%").count(), 1);
    }
    assert_ne!(text("mask-1.gbr"), text("mask-2.gbr"));
    refused(
        &workspace,
        &[&exported[..], &["-o", "mask.svg", "--group", "3"]].concat(),
        &["3"],
    );
}

#[test]
fn a_tip_in_an_odd_frame_is_designed_verified_drawn_and_exported() {
    let workspace = workspace();
    let cells = "cells: [40, 24]";
    // The upper right corner is cut off; the tip hangs on a spring.
    let device = format!(
        "{cells}, frame: {{ opening: {{ polygon: [[0 mm, 0 mm], [60 mm, 0 mm], [60 mm, 20 mm], [50 mm, 30 mm], [0 mm, \
         30 mm]] }} }}, bodies: [{{ rectangle: [[36 mm, 11 mm], [42 mm, 19 mm]], spring: 1 N/m }}]"
    );
    workspace.write("scene.yaml", &SCENE.replace(cells, &device).replace("[3, 4]", "3"));
    let objective = "objective: { point: [39 mm, 15 mm], direction: 0 deg }, area: 0.3";
    workspace.write(
        "tip.yaml",
        &format!(
            "version: 1\nname: tip\nscene: scene.yaml\nstages:\n  \
             best: {{ kind: design, method: adjoint, {objective}, starts: 2, seed: 1 }}\n  \
             searched: {{ kind: design, case: ga, {objective}, evaluator: linear, population: 20, generations: 3, \
             refine: true, constraints: {{ min_feature: 3 mm }}, seed: 1 }}\n  \
             checked: {{ kind: verify, needs: [best, searched] }}\n"
        ),
    );
    assert_eq!(workspace.stages(&["run", "tip.yaml"]).with("built").len(), 3);
    let ended = workspace.run(&["export", "artifact", "tip.yaml:checked", "-o", "checked.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("checked.h5")).unwrap();
    let roles: Vec<String> = texts(&file, "role");
    let (shape, patterns) = dataset(&workspace, "checked.h5", "patterns");
    assert_eq!(shape[1..], [24, 40]);
    let (_, moved) = dataset(&workspace, "checked.h5", "component/simulated");
    let of = |role: &str| {
        roles
            .iter()
            .position(|one| one == role)
            .unwrap_or_else(|| panic!("no {role} among {roles:?}"))
    };
    assert!(
        moved[of("optimum")] > 1.05 * moved[of("intuitive-equal-area")],
        "{roles:?} {moved:?}"
    );
    assert!(
        moved[of("refined")] > moved[of("intuitive-equal-area")],
        "{roles:?} {moved:?}"
    );
    for (at, cell) in patterns.iter().enumerate().filter(|(_, cell)| **cell != 0.0) {
        let [x, y] = [1.5 * ((at % 40) as f64 + 0.5), 1.25 * ((at / 40 % 24) as f64 + 0.5)];
        let is_held = x + y > 80.0;
        let is_body = (36.0..=42.0).contains(&x) && (11.0..=19.0).contains(&y);
        assert!(*cell == 1.0 && !is_held && !is_body, "({x}, {y})");
    }
    // The tip moves as one: its corners keep their distance, though it may turn.
    let (shape, fields) = dataset(&workspace, "checked.h5", "displacement");
    assert_eq!(shape[1..], [25, 41, 2]);
    let row = &fields[of("optimum") * 25 * 41 * 2..][..25 * 41 * 2];
    let moved_to = |x: usize, y: usize| {
        let u = &row[2 * (y * 41 + x)..][..2];
        [1.5 * x as f64 + u[0], 1.25 * y as f64 + u[1]]
    };
    let [from, to] = [moved_to(24, 9), moved_to(28, 15)];
    let distance = (to[0] - from[0]).hypot(to[1] - from[1]);
    assert!(
        (distance - 6.0_f64.hypot(7.5)).abs() < 1e-9 && from[0] > 36.1,
        "{distance} {from:?}"
    );
    let report = workspace.run(&["report", "tip.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    assert!(page.contains("class=\"held\"") && page.contains("class=\"body\""));
    let mask = workspace.run(&[
        "export",
        "design",
        "tip.yaml:best",
        "--role",
        "optimum",
        "-o",
        "mask.dxf",
    ]);
    assert_eq!(mask.code, Some(0), "{}", mask.stderr);
    let text = std::fs::read_to_string(workspace.path("mask.dxf")).unwrap();
    assert!(text.contains("BODIES") && text.contains("ELECTRODE\n"));
    let held = objective.replace("[39 mm, 15 mm]", "[58 mm, 28 mm]");
    workspace.write(
        "held.yaml",
        &format!("version: 1\nname: held\nscene: scene.yaml\nstages:\n  best: {{ kind: design, method: adjoint, {held}, seed: 1 }}\n"),
    );
    snapshot!(refused(&workspace, &["run", "held.yaml"], &["held.yaml", "58 mm"]));
}

/// A strip of 40 × 20 mm with a tip, pushed by one group of electrodes and pulled by another.
const PUSH_PULL: &str = "\
geometry: { size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 3, cells: [20, 10], bodies: [{ rectangle: [[18 mm, 8 mm], [22 mm, 12 mm]] }] }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
states: { push: { voltages: [5 kV, 0 V] }, pull: { voltages: [0 V, 4 kV] } }
";

#[test]
fn groups_are_designed_for_the_states_of_a_device() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", PUSH_PULL);
    let stroke =
        "{ points: [{ body: 0, direction: 0 deg, state: push }, { body: 0, direction: 180 deg, state: pull }] }";
    let turn = "{ body: 0, rotation: clockwise, state: pull }";
    let targets = format!("[{{ name: stroke, objective: {stroke} }}, {{ name: turn, objective: {turn} }}]");
    let made = "constraints: { min_feature: 4 mm, gap: 4 mm, leads: true }, area: free";
    workspace.write(
        "stage.yaml",
        &format!(
            "version: 1\nname: stage\nscene: scene.yaml\nstages:\n  \
             best: {{ kind: design, method: adjoint, targets: {targets}, {made}, starts: 3, seed: 1 }}\n  \
             searched: {{ kind: design, objective: {stroke}, {made}, population: 60, generations: 6, refine: true, \
             case: ga, seed: 2 }}\n  checked: {{ kind: verify, needs: [best, searched], elements_per_cell: 1, order: 2 }}\n"
        ),
    );
    assert_eq!(workspace.stages(&["run", "stage.yaml"]).with("built").len(), 3);
    assert_eq!(workspace.stages(&["run", "stage.yaml"]).with("reused").len(), 3);
    let ended = workspace.run(&["export", "artifact", "stage.yaml:checked", "-o", "checked.h5"]);
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let file = hdf5::File::open(workspace.path("checked.h5")).unwrap();
    let (roles, names) = (texts(&file, "role"), texts(&file, "name"));
    let (_, value) = dataset(&workspace, "checked.h5", "component/simulated");
    let (shape, fields) = dataset(&workspace, "checked.h5", "states/displacement");
    assert_eq!(
        shape,
        [roles.len(), 2, 11, 21, 2],
        "every row has a field in both states"
    );
    let (_, first) = dataset(&workspace, "checked.h5", "displacement");
    let (_, patterns) = dataset(&workspace, "checked.h5", "patterns");
    let size = 11 * 21 * 2;
    // The first of the states is that whose name comes first.
    assert_eq!(first[..size], fields[..size]);
    let corner = |row: usize, state: usize, [x, y]: [usize; 2]| {
        let at = (2 * row + state) * size + 2 * (y * 21 + x);
        [fields[at], fields[at + 1]]
    };
    for row in 0..roles.len() {
        // The centroid of the tip is the mean of its corners, and it turns as one.
        let mean = |state: usize| {
            let corners = [[9, 4], [11, 4], [9, 6], [11, 6]].map(|at| corner(row, state, at)[0]);
            corners.iter().sum::<f64>() / 4.0
        };
        let expected = match names[row].as_str() {
            "turn" => {
                let [a, b] = [corner(row, 0, [9, 4]), corner(row, 0, [11, 6])];
                let [x, y] = [4.0 + b[0] - a[0], 4.0 + b[1] - a[1]];
                -(y.atan2(x) - std::f64::consts::FRAC_PI_4) * 8f64.sqrt()
            }
            _ => (mean(1) - mean(0)) / 2.0,
        };
        assert!(
            (value[row] - expected).abs() < 1e-9,
            "{} {}: {} {expected}",
            names[row],
            roles[row],
            value[row]
        );
        let cells = &patterns[200 * row..][..200];
        let group = |x: usize, y: usize| cells[20 * y + x] as u8;
        if ["optimum", "refined"].contains(&roles[row].as_str()) {
            let near = |x: usize, y: usize, other: u8| {
                let (xs, ys) = (
                    x.saturating_sub(2)..=(x + 2).min(19),
                    y.saturating_sub(2)..=(y + 2).min(9),
                );
                ys.flat_map(|j| xs.clone().map(move |i| (i, j)))
                    .any(|(i, j)| group(i, j) == other)
            };
            let apart = (0..200).all(|at| group(at % 20, at / 20) != 1 || !near(at % 20, at / 20, 2));
            assert!(apart, "{} {}", names[row], roles[row]);
        }
    }
    let of = |name: &str, role: &str| {
        let mut rows = 0..roles.len();
        let found = rows.find(|&row| names[row] == name && roles[row] == role);
        found.unwrap_or_else(|| panic!("no {role} of {name} among {names:?} {roles:?}"))
    };
    let best = of("stroke", "optimum");
    let groups: std::collections::BTreeSet<u8> =
        patterns[200 * best..][..200].iter().map(|group| *group as u8).collect();
    assert_eq!(groups.into_iter().collect::<Vec<_>>(), [0, 1, 2]);
    assert!(value[best] > 0.2 && value[of("turn", "optimum")] > 0.02, "{value:?}");
    assert!(value[best] > 0.99 * value[of("design", "refined")], "{value:?}");
    assert!(
        value[of("design", "refined")] >= value[of("design", "ga")] - 1e-6,
        "{value:?}"
    );
    let report = workspace.run(&["report", "stage.yaml", "-o", "report"]);
    assert_eq!(report.code, Some(0), "{}", report.stderr);
    let page = std::fs::read_to_string(workspace.path("report/index.html")).unwrap();
    assert!(page.contains("<figcaption>push</figcaption>") && page.contains("180°"));
    // A rotation is an arc length at the corners of the tip, √8 mm from its centroid; its angle stands beside it.
    let turned = value[of("turn", "optimum")];
    let degrees = (turned / 8f64.sqrt()).to_degrees();
    let angle = format!("({}°)", deaflow::base::four_digits(degrees));
    assert!(page.contains(&angle.replace(' ', "&nbsp;")), "{angle}");
    let lines = workspace.run(&["run", "stage.yaml", "-v"]);
    assert!(lines.stdout.contains(&angle), "{angle} {}", lines.stdout);
    let mut table = csv::Reader::from_path(workspace.path("report/data/designs.csv")).unwrap();
    let header = table.headers().unwrap().clone();
    let column = |name: &str| {
        header
            .iter()
            .position(|own| own == name)
            .unwrap_or_else(|| panic!("{name}: {header:?}"))
    };
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    let row = |name: &str| {
        rows.iter()
            .find(|row| row[0] == *name)
            .unwrap_or_else(|| panic!("{name}: {rows:?}"))
    };
    let listed: f64 = row("turn-optimum")[column("simulated_deg")].parse().unwrap();
    assert!((listed - degrees).abs() < 1e-5, "{listed} {degrees}");
    assert_eq!(&row("stroke-optimum")[column("simulated_deg")], "");
    let sheet = workspace.run(&["report", "stage.yaml", "--sheet", "sheet.html", "--design", "turn"]);
    assert_eq!(sheet.code, Some(0), "{}", sheet.stderr);
    let sheet = std::fs::read_to_string(workspace.path("sheet.html")).unwrap();
    assert!(sheet.contains(&angle), "{angle}");
    let exported = [
        "export",
        "design",
        "stage.yaml:checked",
        "--design",
        "stroke",
        "-o",
        "mask.dxf",
    ];
    let mask = workspace.run(&exported);
    assert_eq!(mask.code, Some(0), "{}", mask.stderr);
    let text = std::fs::read_to_string(workspace.path("mask.dxf")).unwrap();
    assert!(
        ["ELECTRODE_1", "ELECTRODE_2", "BODIES"]
            .iter()
            .all(|layer| text.contains(layer))
    );
}

#[test]
fn what_a_device_does_not_have_cannot_be_designed() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", PUSH_PULL);
    let one_drive = PUSH_PULL.replace(
        "states: { push: { voltages: [5 kV, 0 V] }, pull: { voltages: [0 V, 4 kV] } }",
        "drive: { voltage: 5 kV }",
    );
    workspace.write("one.yaml", &one_drive);
    let mut printed = Transcript::default();
    for (scene, objective, more, named) in [
        (
            "scene.yaml",
            "{ body: 0, direction: 0 deg }",
            "",
            &["`state`", "pull, push"][..],
        ),
        (
            "scene.yaml",
            "{ body: 0, direction: 0 deg, state: hold }",
            "",
            &["`hold`", "pull, push"],
        ),
        ("scene.yaml", "{ body: 1, direction: 0 deg, state: pull }", "", &["1"]),
        ("scene.yaml", "{ body: 0, state: pull }", "", &["`rotation`"]),
        (
            "scene.yaml",
            "{ body: 0, direction: 0 deg, rotation: 3 deg, state: pull }",
            "",
            &["`direction`", "`rotation`"],
        ),
        (
            "scene.yaml",
            "{ body: 0, rotation: left, state: pull }",
            "",
            &["clockwise", "-179 deg"],
        ),
        (
            "scene.yaml",
            "{ body: 0, rotation: clockwise, value: 1 mm, state: pull }",
            "",
            &["rotation"],
        ),
        ("one.yaml", "{ body: 0, direction: 0 deg, state: pull }", "", &["state"]),
        (
            "one.yaml",
            "{ body: 0, direction: 0 deg }",
            ", constraints: { gap: 2 mm }",
            &["gap"],
        ),
        (
            "scene.yaml",
            "{ body: 0, direction: 0 deg, state: pull }",
            ", constraints: { gap: 70 mm }",
            &["70 mm"],
        ),
    ] {
        workspace.write(
            "p.yaml",
            &format!("version: 1\nname: p\nscene: {scene}\nstages:\n  d: {{ kind: design, method: adjoint, objective: {objective}{more}, seed: 1 }}\n"),
        );
        let refused = refused(&workspace, &["run", "p.yaml"], named);
        printed.add(format!("{objective}{more} in {scene}"), refused);
    }
    snapshot!(printed);
}

/// A strip whose right end has this support.
fn strip(right: &str) -> String {
    format!(
        "geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 2, cells: [8, 4], sides: {{ right: {right}, \
         top: free, bottom: free }} }}\nmaterial: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: \
         4.7 }}\ndrive: {{ voltage: 4 kV }}\neffects: {{}}\n"
    )
}

#[test]
fn paths_of_loads_and_displacements_have_the_motions_and_forces_of_sides() {
    let workspace = Workspace::new();
    workspace.write("pulled.yaml", &strip("{ bar: { displacement: [10 mm, 0 mm] } }"));
    workspace.write("loaded.yaml", &strip("{ bar: { load: [0.6 N, 0 N] } }"));
    workspace.write("middle.csv", &csv([8, 4], |x, _| 0 < x && x < 7));
    let follow =
        |scene: &str, path: &str| workspace.run(&["solve", scene, "middle.csv", path, "-o", "out.h5", "--json"]);
    for (scene, path, name) in [
        ("pulled.yaml", "--path=displacement", "displacement"),
        ("loaded.yaml", "--path=load", "load"),
    ] {
        let ended = follow(scene, path);
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
        let document = ended.json();
        let points = document["paths"][0]["points"].as_array().unwrap();
        let last = &points[points.len() - 1];
        assert_eq!(
            (&document["parameter"], &document["paths"][0]["end"]),
            (&name.into(), &"complete".into())
        );
        assert!((last["share"].as_f64().unwrap() - 1.0).abs() < 1e-8, "{last}");
        // All forces are in balance.
        let reactions = &last["reactions_n"];
        let [left, right] = ["left", "right"].map(|side| reactions[side][0].as_f64().unwrap());
        assert!((left + right).abs() < 1e-7 && right > 0.1, "{reactions}");
        let moved = last["bars"]["right"]["translation_mm"][0].as_f64().unwrap();
        if name == "displacement" {
            assert!((moved - 10.0).abs() < 1e-6);
        } else {
            assert!((right - 0.6).abs() < 1e-7);
        }
        let file = hdf5::File::open(workspace.path("out.h5")).unwrap();
        let count = points.len();
        for (array, shape) in [
            ("share", vec![count]),
            ("bar_translation", vec![count, 1, 2]),
            ("bar_rotation", vec![count, 1]),
            ("reaction", vec![count, 4, 2]),
            ("rest", vec![1, 5, 9, 2]),
        ] {
            assert_eq!(file.dataset(array).unwrap().shape(), shape, "{array}");
        }
        let table = std::fs::read_to_string(workspace.path("out.csv")).unwrap();
        let header = table.lines().next().unwrap();
        let expected = "event,share,bar_right_x_mm,bar_right_y_mm,bar_right_turn_deg,reaction_left_x_N";
        assert!(header.contains(expected), "{header}");
        let columns = header.split(',').count();
        assert!(table.lines().all(|line| line.split(',').count() == columns) && table.lines().count() == count + 1);
    }
    for (scene, path, message) in [
        ("pulled.yaml", "--path=load", "the scene has none"),
        ("loaded.yaml", "--path=displacement", "the scene has none"),
        ("loaded.yaml", "--path=force", "allowed: voltage, load, displacement"),
    ] {
        let ended = follow(scene, path);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(ended.stderr.contains(message), "{}", ended.stderr);
    }
    // Pushed together until it has no stable state.
    workspace.write("pushed.yaml", &strip("{ bar: { displacement: [-45 mm, 0 mm] } }"));
    let ended = follow("pushed.yaml", "--path");
    assert_eq!(ended.code, Some(1), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("no stable state without voltage"),
        "{}",
        ended.stderr
    );
}

#[test]
fn estimates_of_devices_with_sides_that_are_not_held_are_refused_by_plan() {
    let workspace = Workspace::new();
    workspace.write("scene.yaml", &strip("free"));
    for method in ["linear", "chord:2"] {
        let stages = format!(
            "version: 1\nname: estimated\nscene: scene.yaml\nstages:\n  drawn: {{ kind: sample, family: blobs, area: \
             0.5, count: 2, seed: 1 }}\n  solved: {{ kind: solve, needs: [drawn], method: {method} }}\n"
        );
        workspace.write("estimated.yaml", &stages);
        let ended = workspace.run(&["plan", "estimated.yaml"]);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        assert!(
            ended.stderr.contains("method") && ended.stderr.contains("estimated.yaml"),
            "{}",
            ended.stderr
        );
    }
}

#[test]
fn the_motion_of_bodies_in_the_plane_is_printed() {
    let workspace = Workspace::new();
    workspace.write(
        "scene.yaml",
        "geometry: { size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 3, cells: [20, 10], bodies: [
  { rectangle: [[18 mm, 8 mm], [22 mm, 12 mm]] }, { rectangle: [[6 mm, 4 mm], [10 mm, 8 mm]] } ] }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 4 kV }
effects: {}
",
    );
    let rows = (0..10).map(|y| {
        (0..20)
            .map(|x| if x > 10 && y < 6 { "1" } else { "0" })
            .collect::<Vec<_>>()
            .join(",")
    });
    workspace.write("part.csv", &rows.collect::<Vec<_>>().join("\n"));
    let solve = ["solve", "scene.yaml", "part.csv", "--no-checks"];
    let ended = workspace.run(&[&solve[..], &["-o", "out.h5", "--json"]].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    let document = ended.json();
    let pattern = &document["patterns"][0];
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        let each = value.as_array().unwrap().iter();
        each.flat_map(|one| one.as_array().cloned().unwrap_or_else(|| vec![one.clone()]))
            .map(|number| number.as_f64().unwrap())
            .collect()
    };
    let (_, translation) = dataset(&workspace, "out.h5", "body_translation");
    let (_, rotation) = dataset(&workspace, "out.h5", "body_rotation");
    assert_eq!(numbers(&pattern["body_translation_mm"]), translation);
    assert_eq!(numbers(&pattern["body_rotation_deg"]), rotation);
    assert!(translation[0] < -0.01 && rotation.len() == 2, "{translation:?}");
    let shown = workspace.run(&solve).stdout;
    let table = shown.split(" body ").nth(1).unwrap_or_else(|| panic!("{shown}"));
    for part in ["along x", "along y", "rotation", " deg"] {
        assert!(table.contains(part), "{part}: {shown}");
    }
    assert_eq!(table.matches(" deg").count(), 2, "{shown}");
}
