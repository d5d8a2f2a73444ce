//! Drawings as frames and bodies against the same shapes in YAML.

use std::fmt::Write;
use std::fs;

use super::*;
use crate::{Scene, Shape, scene_files};
use deaflow_base::Document;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.0.path().join(name), text).unwrap();
    }

    /// Reads a scene with a frame and bodies.
    fn scene(&self, frame: &str, bodies: &str) -> Result<Scene, String> {
        let parts = match bodies {
            "" => format!("frame: {frame}"),
            _ => format!("frame: {frame}, bodies: {bodies}"),
        };
        let text = format!(
            "geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50, {parts} }}\n\
             material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}\n\
             drive: {{ voltage: 5 kV }}\n"
        );
        let root = Document::from_text(&self.0.path().join("scene.yaml"), &text)
            .unwrap()
            .root;
        Scene::read(&root).map_err(|error| format!("{error} [{}]", help(&error)))
    }
}

fn help(error: &InputError) -> String {
    miette::Diagnostic::help(error).map_or_else(String::new, |help| help.to_string())
}

/// An entity of a drawing: its kind, its layer and its pairs.
type Entity<'a> = (&'a str, &'a str, &'a [(i32, f64)]);

/// A drawing of entities in mm.
fn dxf(entities: &[Entity<'_>]) -> String {
    let mut text = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n".to_owned();
    for (kind, layer, pairs) in entities {
        write!(text, "0\n{kind}\n8\n{layer}\n").unwrap();
        for (code, value) in *pairs {
            match *code {
                70..=79 | 90..=99 => write!(text, "{code}\n{value:.0}\n").unwrap(),
                _ => write!(text, "{code}\n{value}\n").unwrap(),
            }
        }
    }
    text + "0\nENDSEC\n0\nEOF\n"
}

fn circle(x: f64, y: f64, radius: f64) -> [(i32, f64); 3] {
    [(10, x), (20, y), (40, radius)]
}

/// Frame, hub and body on layers of one drawing, whose origin is the centre of the membrane.
fn device() -> String {
    dxf(&[
        ("CIRCLE", "FRAME", &circle(0.0, 0.0, 20.0)),
        ("TEXT", "FRAME", &[(10, 1.0), (20, 1.0)]),
        ("CIRCLE", "HUB", &circle(0.0, 0.0, 5.0)),
        ("LINE", "TIP", &[(10, 8.0), (20, -2.0), (11, 12.0), (21, -2.0)]),
        (
            "ARC",
            "TIP",
            &[(10, 12.0), (20, 0.0), (40, 2.0), (50, -90.0), (51, 90.0)],
        ),
        ("LINE", "TIP", &[(10, 12.0), (20, 2.0), (11, 8.0), (21, 2.0)]),
        (
            "ARC",
            "TIP",
            &[(10, 8.0), (20, 0.0), (40, 2.0), (50, 90.0), (51, 270.0)],
        ),
    ])
}

const CENTRE: &str = "unit: mm, origin: [25 mm, 25 mm]";

#[test]
fn a_drawing_is_the_shape_that_it_shows() {
    let folder = Folder::new();
    folder.write("device.dxf", &device());
    for curves in ["fitted", "cells"] {
        let drawn = folder
            .scene(
                &format!(
                    "{{ opening: {{ file: device.dxf, layer: FRAME, {CENTRE} }}, \
                     held: [{{ file: device.dxf, layer: HUB, {CENTRE} }}], curves: {curves} }}"
                ),
                &format!("[{{ file: device.dxf, layer: TIP, {CENTRE}, curves: {curves}, load: [0.01 N, 0 N] }}]"),
            )
            .unwrap();
        let written = folder
            .scene(
                &format!(
                    "{{ opening: {{ disc: {{ centre: [25 mm, 25 mm], radius: 20 mm }} }}, \
                     held: [{{ disc: {{ centre: [25 mm, 25 mm], radius: 5 mm }} }}], curves: {curves} }}"
                ),
                &format!(
                    "[{{ path: {{ from: [33 mm, 23 mm], to: [{{ line: [37 mm, 23 mm] }}, \
                     {{ arc: [[39 mm, 25 mm], [37 mm, 27 mm]] }}, {{ line: [33 mm, 27 mm] }}, \
                     {{ arc: [[31 mm, 25 mm], [33 mm, 23 mm]] }}] }}, curves: {curves}, load: [0.01 N, 0 N] }}]"
                ),
            )
            .unwrap();
        assert_eq!(drawn.parts(), written.parts(), "{curves}");
        assert_eq!(drawn.borders().is_some(), curves == "fitted");
        if let (Some(drawn), Some(written)) = (drawn.borders(), written.borders()) {
            assert_eq!(drawn.opening, written.opening, "circles are to the bit");
            let pairs = drawn.bodies[0].area() - written.bodies[0].area();
            assert!(pairs.abs() < 1e-6, "{pairs}");
            let exact = 16.0 + 4.0 * std::f64::consts::PI;
            assert!(
                (drawn.bodies[0].area() - exact).abs() < 1e-4,
                "{}",
                drawn.bodies[0].area()
            );
        }
        let notes = drawn.geometry.notes();
        let of_frame = [
            "device.dxf: ignored: 1 TEXT",
            "device.dxf: layers that were not read: HUB, TIP",
        ];
        assert_eq!(
            (notes.len(), &notes[..2]),
            (4, &of_frame.map(str::to_owned)[..]),
            "{notes:?}"
        );
    }
}

#[test]
fn what_is_drawn_is_kept_and_not_the_name_of_its_file() {
    let folder = Folder::new();
    folder.write("device.dxf", &device());
    let of = |name: &str| {
        let frame = format!("{{ opening: {{ file: {name}, layer: FRAME, {CENTRE} }}, curves: fitted }}");
        folder.scene(&frame, "").unwrap()
    };
    let first = of("device.dxf");
    let text = first.to_text();
    assert!(!text.contains("device.dxf") && text.contains("contours: [{"), "{text}");
    let again = Scene::from_text(&text).unwrap();
    assert_eq!(again, first);
    assert_eq!(again.to_text(), text);
    assert_eq!(again.borders(), first.borders());
    folder.write("other.dxf", &device());
    assert_eq!(of("other.dxf").canonical(), first.canonical());
    // Another layer does not count, the circle does.
    folder.write("other.dxf", &device().replace("40\n5\n", "40\n6\n"));
    assert_eq!(of("other.dxf").canonical(), first.canonical());
    folder.write("other.dxf", &device().replace("40\n20\n", "40\n19.999\n"));
    assert_ne!(of("other.dxf").canonical(), first.canonical());
    assert_ne!(of("other.dxf"), first);
}

#[test]
fn curves_of_all_kinds_are_kept_to_the_bit() {
    let folder = Folder::new();
    folder.write(
        "all.dxf",
        &dxf(&[
            (
                "ELLIPSE",
                "0",
                &[
                    (10, 25.1),
                    (20, 24.7),
                    (11, 17.3),
                    (21, 3.3),
                    (40, 0.7),
                    (41, 0.0),
                    (42, std::f64::consts::TAU),
                ],
            ),
            (
                "SPLINE",
                "0",
                &[
                    (70, 8.0),
                    (71, 3.0),
                    (40, 0.0),
                    (40, 0.0),
                    (40, 0.0),
                    (40, 0.0),
                    (40, 1.0),
                    (40, 1.0),
                    (40, 1.0),
                    (40, 1.0),
                    (10, 20.3),
                    (20, 21.0),
                    (10, 24.0),
                    (20, 21.1),
                    (10, 30.0),
                    (20, 28.0),
                    (10, 21.0),
                    (20, 27.0),
                ],
            ),
            ("LINE", "0", &[(10, 21.0), (20, 27.0), (11, 20.3), (21, 21.0)]),
        ]),
    );
    folder.write(
        "all.svg",
        "<svg xmlns='http://www.w3.org/2000/svg' width='50mm' height='50mm' viewBox='0 0 50 50'>\
         <path fill-rule='nonzero' d='M10 10 h30 v30 h-30 z M15 15 h10 v10 h-10 z'/>\
         <circle cx='40' cy='40' r='5.5'/></svg>",
    );
    for name in ["all.dxf", "all.svg"] {
        let frame = format!(
            "{{ opening: {{ file: {name}, angle: 7.3 deg, scale: 1.01, origin: [1 mm, -2.2 mm] }}, curves: fitted }}"
        );
        let scene = folder.scene(&frame, "").unwrap();
        let again = Scene::from_text(&scene.to_text()).unwrap();
        let region = |scene: &Scene| {
            scene
                .geometry
                .frame
                .as_ref()
                .and_then(|frame| frame.opening.as_ref()?.drawing.region())
        };
        assert_eq!(region(&again), region(&scene), "{name}");
        assert_eq!(again, scene);
    }
    // The rule: nonzero fills the inner square, which runs around in the same direction.
    let scene = folder.scene("{ opening: { file: all.svg } }", "").unwrap();
    let area = scene
        .geometry
        .frame
        .unwrap()
        .opening
        .unwrap()
        .region()
        .area_mm2()
        .unwrap();
    let quarter = std::f64::consts::PI * 5.5 * 5.5;
    assert!((area - (900.0 + 0.75 * quarter)).abs() < 1e-3, "{area}");
}

#[test]
fn drawings_are_combined_with_shapes() {
    let folder = Folder::new();
    folder.write("device.dxf", &device());
    let frame = format!(
        "{{ opening: {{ intersect: [{{ file: device.dxf, layer: FRAME, {CENTRE} }}, \
         {{ rectangle: [[0 mm, 0 mm], [50 mm, 25 mm]] }}], without: [{{ file: device.dxf, layer: HUB, {CENTRE} }}] }} }}"
    );
    let scene = folder.scene(&frame, "").unwrap();
    let area = scene
        .geometry
        .frame
        .as_ref()
        .unwrap()
        .opening
        .as_ref()
        .unwrap()
        .region()
        .area_mm2()
        .unwrap();
    let exact = std::f64::consts::PI * (400.0 - 25.0) / 2.0;
    assert!((area - exact).abs() < 1e-3, "{area} {exact}");
    assert_eq!(Scene::from_text(&scene.to_text()).unwrap(), scene);
    let root = Document::from_text(&folder.0.path().join("scene.yaml"), &frame)
        .unwrap()
        .root;
    assert_eq!(scene_files(&root), ["device.dxf", "device.dxf"]);
    assert!(
        scene
            .geometry
            .notes()
            .iter()
            .all(|note| note.starts_with("device.dxf: "))
    );
}

#[test]
fn drawings_that_are_no_shapes_are_refused() {
    let folder = Folder::new();
    folder.write("device.dxf", &device());
    folder.write("open.dxf", &device().replace("51\n270\n", "51\n200\n"));
    folder.write("far.dxf", &dxf(&[("CIRCLE", "0", &circle(2e4, 0.0, 20.0))]));
    folder.write(
        "electrodes.dxf",
        &dxf(&[
            ("CIRCLE", "ELECTRODE", &circle(25.0, 25.0, 5.0)),
            ("CIRCLE", "FRAME", &circle(25.0, 25.0, 20.0)),
        ]),
    );
    folder.write("text.txt", "text");
    folder.write("picture.png", "text");
    let corner = |at: usize| {
        (
            25.0 + 20.0 * (at as f64 / 1000.0).cos(),
            25.0 + 20.0 * (at as f64 / 1000.0).sin(),
        )
    };
    let pairs: Vec<(i32, f64)> = (0..10_001)
        .flat_map(|at| [(10, corner(at % 6000).0), (20, corner(at % 6000).1 + at as f64 * 1e-6)])
        .collect();
    folder.write(
        "many.dxf",
        &dxf(&[("LWPOLYLINE", "0", &[vec![(70, 1.0)], pairs].concat())]),
    );
    for (opening, says) in [
        ("file: none.dxf", "none.dxf: it does not exist"),
        (
            "file: device.dxf, layer: RIM",
            "device.dxf, layer RIM: the drawing has no curves on layer \"RIM\" [layers with curves: FRAME, HUB, TIP]",
        ),
        (
            "file: device.dxf",
            "the drawing has curves on 3 layers [name the layer that is read, one of FRAME, HUB, TIP]",
        ),
        ("file: electrodes.dxf", "the drawing has curves on 2 layers"),
        (
            "file: open.dxf, layer: TIP",
            "open.dxf, layer TIP: a contour is open: its ends at (8.000000, -2.000000) mm",
        ),
        (
            "file: far.dxf",
            "it reaches further than 10000 mm from the lower left corner",
        ),
        (
            "file: far.dxf, scale: 0.1",
            "nothing of the drawing lies on the membrane of 50 mm: it reaches from (1998, −2.000) to (2002, 2.000) mm",
        ),
        ("file: many.dxf", "lines, arcs and cubics; a shape can have 10000"),
        ("file: text.txt", "text.txt: not a drawing [allowed: .dxf and .svg]"),
        ("file: picture.png", "a picture has no curves [name it as `mask`"),
        (
            "mask: device.dxf",
            "device.dxf: a drawing has no cells [name it as a drawing: { file: device.dxf }]",
        ),
        ("file: 3", "3: it does not exist"),
        ("file: [device.dxf]", "`file` must be the name of a file"),
        ("layer: FRAME", "`layer` is a key of drawings, but there is no `file`"),
        (
            "disc: { centre: [25 mm, 25 mm], radius: 3 mm }, layer: FRAME",
            "`layer` is a key of drawings, but there is no `file`",
        ),
        (
            "file: device.dxf, layer: FRAME, disc: { centre: [25 mm, 25 mm], radius: 3 mm }",
            "a shape must have one of",
        ),
        ("contours: []", "`contours` is empty"),
        (
            "contours: [{ rule: even-odd, curves: [{ from: [1 mm, 1 mm], to: [{ }] }] }]",
            "one of `line`, `arc` and `cubic`",
        ),
    ] {
        let error = folder
            .scene(&format!("{{ opening: {{ {opening} }} }}"), "")
            .unwrap_err();
        assert!(error.contains(says), "{opening}: {error}");
    }
    assert!(Shape::keys().contains(&"contours"));
}
