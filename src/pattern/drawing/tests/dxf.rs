//! Drawings in DXF.

use super::{Drawing, DrawingFormat, DrawingOptions, area, assert_exact};
use crate::contour::Point;
use std::f64::consts::PI;
use std::fmt::Write;

/// Writes pairs as lines.
fn pairs(pairs: &[(i32, &str)]) -> String {
    pairs.iter().fold(String::new(), |mut text, (code, value)| {
        let _ = write!(text, "{code:3}\n{value}\n");
        text
    })
}

/// An entity on layer E with numbers.
fn entity(kind: &str, values: &[(i32, f64)]) -> String {
    let values: String = values
        .iter()
        .map(|(code, value)| format!("{code:3}\n{value}\n"))
        .collect();
    pairs(&[(0, kind), (8, "E")]) + &values
}

fn line([a, b]: Point, [c, d]: Point) -> String {
    entity("LINE", &[(10, a), (20, b), (11, c), (21, d)])
}

fn circle(x: f64, y: f64, radius: f64) -> String {
    entity("CIRCLE", &[(10, x), (20, y), (40, radius)])
}

/// A file with a unit, blocks and entities.
fn file(unit: &str, blocks: &str, entities: &str) -> String {
    let section = |name: &str, content: &str| pairs(&[(0, "SECTION"), (2, name)]) + content + &pairs(&[(0, "ENDSEC")]);
    let header = pairs(&[(9, "$INSUNITS"), (70, unit)]);
    section("HEADER", &header) + &section("BLOCKS", blocks) + &section("ENTITIES", entities) + &pairs(&[(0, "EOF")])
}

fn block(name: &str, base: Point, entities: &str) -> String {
    let head = format!("  0\nBLOCK\n  2\n{name}\n 10\n{}\n 20\n{}\n", base[0], base[1]);
    head + entities + &pairs(&[(0, "ENDBLK")])
}

fn insert(name: &str, values: &[(i32, f64)]) -> String {
    entity("INSERT", values) + &pairs(&[(2, name)])
}

fn read_with(text: &str, options: &DrawingOptions) -> Result<Drawing, String> {
    let told = |error: crate::PatternFileError| format!("{error} [{}]", error.own_advice().unwrap_or_default());
    super::read(text, DrawingFormat::Dxf, options).map_err(told)
}

fn read(text: &str) -> Result<Drawing, String> {
    read_with(text, &DrawingOptions::default())
}

/// Reads entities in mm.
fn drawn(entities: &str) -> Drawing {
    read(&file("4", "", entities)).unwrap()
}

/// The lower left and the upper right corner of what is drawn.
fn bounds(drawing: &Drawing) -> [Point; 2] {
    let corners = drawing
        .filled
        .iter()
        .flat_map(|filled| &filled.contours)
        .flat_map(|contour| contour.corners());
    corners.fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[low, high], [x, y]| {
        [[low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]]
    })
}

#[track_caller]
fn assert_bounds(drawing: &Drawing, exact: [Point; 2]) {
    let found = bounds(drawing);
    let close = (0..4).all(|at| (found[at / 2][at % 2] - exact[at / 2][at % 2]).abs() < 1e-5);
    assert!(close, "{found:?} {exact:?}");
}

#[test]
fn examples_have_their_areas() {
    for (text, exact, tolerance) in [
        (include_str!("files/d1_circle.dxf"), 314.1592653589793, 1e-12),
        (include_str!("files/d2_ring_text.dxf"), 357.356164345839, 1e-12),
        // With gaps of 2e-5 mm.
        (include_str!("files/d3_slot_arcs_gaps.dxf"), 353.09733552923257, 1e-6),
        (include_str!("files/d4_bulge_inches.dxf"), 523.3332775430405, 1e-12),
    ] {
        let drawing = read(text).unwrap();
        let found = area(&drawing);
        assert!((found / exact - 1.0).abs() < tolerance, "{found} {exact}");
    }
    let notes = read(include_str!("files/d2_ring_text.dxf")).unwrap().notes;
    assert_eq!(notes, ["ignored: 1 TEXT"]);
}

#[test]
fn curves_have_exact_areas_and_places() {
    let ellipse = |values: &[(i32, f64)]| {
        entity(
            "ELLIPSE",
            &[&[(10, 5.0), (20, 4.0), (11, 0.0), (21, 3.0), (40, 0.5)], values].concat(),
        )
    };
    let whole = drawn(&ellipse(&[]));
    assert_exact(area(&whole), PI * 4.5);
    assert_bounds(&whole, [[3.5, 1.0], [6.5, 7.0]]);
    // The half from the tip of the first axis to the left; the axis points up.
    let half = ellipse(&[(41, 0.0), (42, PI)]) + &line([5.0, 7.0], [5.0, 1.0]);
    assert_exact(area(&drawn(&half)), PI * 2.25);
    assert_bounds(&drawn(&half), [[3.5, 1.0], [5.0, 7.0]]);
    // From below its second axis points the other way.
    let below = ellipse(&[(41, 0.0), (42, PI), (230, -1.0)]) + &line([5.0, 7.0], [5.0, 1.0]);
    assert_bounds(&drawn(&below), [[5.0, 1.0], [6.5, 7.0]]);
    // Arcs run anticlockwise, also over 0°; seen from below x is mirrored.
    let arc = |z: f64| {
        entity(
            "ARC",
            &[(10, 5.0), (20, 5.0), (40, 2.0), (50, 270.0), (51, 90.0), (230, z)],
        )
    };
    let right = drawn(&(arc(1.0) + &line([5.0, 3.0], [5.0, 7.0])));
    assert_exact(area(&right), PI * 2.0);
    assert_bounds(&right, [[5.0, 3.0], [7.0, 7.0]]);
    let left = drawn(&(arc(-1.0) + &line([-5.0, 3.0], [-5.0, 7.0])));
    assert_bounds(&left, [[-7.0, 3.0], [-5.0, 7.0]]);
    // Bulges: a positive one is anticlockwise, so that it is on the right of its chord.
    let vertices = [
        (10, 0.0),
        (20, 0.0),
        (42, 1.0),
        (10, 4.0),
        (20, 0.0),
        (42, 0.0),
        (10, 4.0),
        (20, 3.0),
        (10, 0.0),
        (20, 3.0),
    ];
    let bulged = drawn(&entity(
        "LWPOLYLINE",
        &[&[(90, 4.0), (70, 1.0)], &vertices[..]].concat(),
    ));
    assert_exact(area(&bulged), 12.0 + 2.0 * PI);
    assert_bounds(&bulged, [[0.0, -2.0], [4.0, 3.0]]);
    // The same as the older POLYLINE, with a vertex of a frame of control points.
    let vertex = |values: &[(i32, f64)]| entity("VERTEX", values);
    let older = entity("POLYLINE", &[(66, 1.0), (10, 0.0), (20, 0.0), (70, 1.0)])
        + &vertex(&[(10, 0.0), (20, 0.0), (42, 1.0)])
        + &vertex(&[(10, 4.0), (20, 0.0)])
        + &vertex(&[(10, 99.0), (20, 99.0), (70, 16.0)])
        + &vertex(&[(10, 4.0), (20, 3.0)])
        + &vertex(&[(10, 0.0), (20, 3.0)])
        + &pairs(&[(0, "SEQEND")]);
    assert_exact(area(&drawn(&older)), 12.0 + 2.0 * PI);
}

/// A spline on layer E.
fn spline(degree: i32, knots: &[f64], points: &[Point], weights: &[f64]) -> String {
    let mut values = vec![(71, f64::from(degree))];
    values.extend(knots.iter().map(|knot| (40, *knot)));
    values.extend(weights.iter().map(|weight| (41, *weight)));
    values.extend(points.iter().flat_map(|[x, y]| [(10, *x), (20, *y)]));
    entity("SPLINE", &values)
}

#[test]
fn splines_are_cubics_or_close_to_them() {
    // One Bézier curve: 3/20 of a sum of cross products.
    let points = [[0.0, 0.0], [1.0, 2.0], [3.0, 2.0], [4.0, 0.0]];
    let arch = spline(3, &[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], &points, &[]) + &line([0.0, 0.0], [4.0, 0.0]);
    assert_exact(area(&drawn(&arch)), 4.2);
    // The same with a knot inserted in the middle (Boehm): the midpoints of its control points.
    let finer = [[0.0, 0.0], [0.5, 1.0], [2.0, 2.0], [3.5, 1.0], [4.0, 0.0]];
    let arch = spline(3, &[0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0], &finer, &[]) + &line([0.0, 0.0], [4.0, 0.0]);
    assert_exact(area(&drawn(&arch)), 4.2);
    // A rational quadratic quarter circle.
    let w = std::f64::consts::FRAC_1_SQRT_2;
    let quarter = spline(
        2,
        &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
        &[[2.0, 0.0], [2.0, 2.0], [0.0, 2.0]],
        &[1.0, w, 1.0],
    ) + &line([0.0, 2.0], [0.0, 0.0])
        + &line([0.0, 0.0], [2.0, 0.0]);
    let found = area(&drawn(&quarter));
    assert!((found / PI - 1.0).abs() < 1e-8, "{found}");
    // Polygons are splines of degree 1; knots need not begin at 0.
    let square = spline(
        1,
        &[3.0, 3.0, 4.0, 5.0, 6.0, 7.0, 7.0],
        &[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [0.0, 0.0]],
        &[],
    );
    assert_exact(area(&drawn(&square)), 4.0);
    // A cusp, in which both branches end; 3/20 of a sum of cross products again.
    let tear = [[0.0, 0.0], [4.0, 4.0], [0.0, 4.0], [4.0, 0.0]];
    let cusp = spline(3, &[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], &tear, &[]) + &line([0.0, 0.0], [4.0, 0.0]);
    let found = area(&drawn(&cusp));
    assert!((found - 4.8).abs() < 1e-5, "{found}");
    // A corner of a spline, at a knot as often as its degree.
    let roof = [
        [0.0, 0.0],
        [0.0, 1.0],
        [1.0, 2.0],
        [2.0, 3.0],
        [3.0, 2.0],
        [4.0, 1.0],
        [4.0, 0.0],
    ];
    let corner = spline(3, &[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0], &roof, &[]);
    let found = drawn(&(corner + &line([0.0, 0.0], [4.0, 0.0])));
    assert_bounds(&found, [[0.0, 0.0], [4.0, 3.0]]);
    assert_exact(area(&found), 7.5);
}

#[test]
fn blocks_are_scaled_turned_repeated_and_nested() {
    // A half disc on layer 0, around its base point.
    let half = pairs(&[(0, "ARC"), (8, "0")]) + "10\n7\n20\n7\n40\n1\n50\n0\n51\n180\n";
    let half = half + &pairs(&[(0, "LINE"), (8, "0")]) + "10\n8\n20\n7\n11\n6\n21\n7\n";
    let inner = block("HALF", [7.0, 7.0], &half);
    let outer = block(
        "PAIR",
        [0.0, 0.0],
        &(insert("HALF", &[(10, 0.0), (20, 0.0)]) + &insert("HALF", &[(10, 0.0), (20, 5.0), (50, 180.0)])),
    );
    let blocks = inner + &outer;
    let reading = |entities: &str| read(&file("4", &blocks, entities)).unwrap();
    let one = reading(&insert("HALF", &[(10, 10.0), (20, 10.0), (41, 3.0), (42, 2.0)]));
    assert_exact(area(&one), PI / 2.0 * 6.0);
    assert_bounds(&one, [[7.0, 10.0], [13.0, 12.0]]);
    let turned = reading(&insert("HALF", &[(10, 10.0), (20, 10.0), (50, 90.0)]));
    assert_bounds(&turned, [[9.0, 9.0], [10.0, 11.0]]);
    let mirrored = reading(&insert("HALF", &[(10, 10.0), (20, 10.0), (42, -1.0)]));
    assert_bounds(&mirrored, [[9.0, 9.0], [11.0, 10.0]]);
    let below = reading(&insert("HALF", &[(10, -10.0), (20, 10.0), (50, 90.0), (230, -1.0)]));
    assert_bounds(&below, [[10.0, 9.0], [11.0, 11.0]]);
    let array = reading(&insert(
        "HALF",
        &[(10, 1.0), (20, 1.0), (70, 3.0), (71, 2.0), (44, 4.0), (45, 5.0)],
    ));
    assert_exact(area(&array), 3.0 * PI);
    assert_bounds(&array, [[0.0, 1.0], [10.0, 7.0]]);
    let nested = reading(&insert("PAIR", &[(10, 10.0), (20, 10.0), (41, 2.0), (42, 2.0)]));
    assert_exact(area(&nested), 4.0 * PI);
    assert_bounds(&nested, [[8.0, 10.0], [12.0, 20.0]]);
    // A block that contains itself, and copies of copies.
    let own = block("SELF", [0.0; 2], &insert("SELF", &[(10, 0.0), (20, 0.0)]));
    let error = read(&file("4", &own, &insert("SELF", &[(10, 0.0), (20, 0.0)]))).unwrap_err();
    assert!(error.contains("nested more than 32 blocks deep"), "{error}");
    let mut bomb = block("B0", [0.0; 2], &circle(0.0, 0.0, 1.0));
    for level in 1..10 {
        let all = insert(
            &format!("B{}", level - 1),
            &[(10, 0.0), (20, 0.0), (70, 100.0), (71, 100.0)],
        );
        bomb += &block(&format!("B{level}"), [0.0; 2], &all);
    }
    let error = read(&file("4", &bomb, &insert("B9", &[(10, 0.0), (20, 0.0)]))).unwrap_err();
    assert!(error.contains("beyond the 2000000 entities"), "{error}");
    let error = read(&file("4", "", &insert("NONE", &[(10, 0.0), (20, 0.0)]))).unwrap_err();
    assert!(error.contains("line 22: INSERT inserts the block \"NONE\""), "{error}");
}

#[test]
fn units_are_read_or_asked_for() {
    let disc = circle(1.0, 1.0, 0.5);
    for (unit, mm) in [("1", 25.4), ("5", 10.0), ("6", 1000.0), ("13", 1e-3)] {
        let drawing = read(&file(unit, "", &disc)).unwrap();
        assert_exact(area(&drawing), PI * 0.25 * mm * mm);
    }
    for unit in ["0", "99"] {
        let error = read(&file(unit, "", &disc)).unwrap_err();
        assert!(error.contains("the drawing has no unit [give the unit"), "{error}");
    }
    let millimetres = DrawingOptions {
        unit_mm: Some(1.0),
        ..DrawingOptions::default()
    };
    assert_exact(
        area(&read_with(&file("0", "", &disc), &millimetres).unwrap()),
        PI * 0.25,
    );
    let drawing = read_with(&file("1", "", &disc), &millimetres).unwrap();
    assert_exact(area(&drawing), PI * 0.25);
    assert_eq!(
        drawing.notes,
        ["lengths are read in units of 1 mm; the file has units of 25.4 mm"]
    );
}

#[test]
fn drawings_are_placed() {
    let options = DrawingOptions {
        origin_mm: [-2.0e6 + 25.0, 10.0],
        ..DrawingOptions::default()
    };
    let far = read_with(&file("4", "", &circle(2.0e6, 0.0, 3.0)), &options).unwrap();
    assert!((area(&far) / (9.0 * PI) - 1.0).abs() < 1e-9);
    assert_bounds(&far, [[22.0, 7.0], [28.0, 13.0]]);
    let options = DrawingOptions {
        origin_mm: [10.0, 10.0],
        scale: 2.0,
        degrees: 90.0,
        ..DrawingOptions::default()
    };
    let turned = read_with(&file("4", "", &circle(4.0, 0.0, 1.0)), &options).unwrap();
    assert_bounds(&turned, [[8.0, 16.0], [12.0, 20.0]]);
}

#[test]
fn ends_are_joined_in_any_order_and_gaps_are_named() {
    let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]];
    let side = |k: usize, gap: f64| {
        let ([a, b], to) = (corners[k], corners[(k + 1) % 4]);
        let from = [a + gap, b];
        if k.is_multiple_of(2) {
            line(from, to)
        } else {
            line(to, from)
        }
    };
    let scattered = |gap: f64| [2, 0, 3, 1].map(|k| side(k, gap)).concat();
    assert_exact(area(&drawn(&scattered(0.0))), 12.0);
    let found = area(&drawn(&scattered(9e-4)));
    assert!((found - 12.0).abs() < 1e-2, "{found}");
    let error = read(&file("4", "", &scattered(2e-3))).unwrap_err();
    assert!(
        error.contains("a contour is open: its ends at (")
            && error.contains("are 2.000e-3 mm apart [close it, or join"),
        "{error}"
    );
    let wider = DrawingOptions {
        join_mm: 0.01,
        ..DrawingOptions::default()
    };
    assert!(read_with(&file("4", "", &scattered(2e-3)), &wider).is_ok());
    let error = read(&file("4", "", &line([1.0, 2.0], [3.0, 4.0]))).unwrap_err();
    assert!(
        error.contains("(1.000000, 2.000000) mm and (3.000000, 4.000000) mm"),
        "{error}"
    );
    // A side shorter than the distance, and sides drawn twice.
    let short = line([0.0, 0.0], [4.0, 0.0])
        + &line([4.0, 0.0], [4.0, 5e-4])
        + &line([4.0, 5e-4], [0.0, 3.0])
        + &line([0.0, 3.0], [0.0, 0.0]);
    let found = area(&drawn(&short));
    assert!((found - 6.0).abs() < 2e-3, "{found}");
    let twice =
        drawn(&(scattered(0.0) + &line([4.0, 0.0], [0.0, 0.0]) + &circle(2.0, 1.0, 0.5) + &circle(2.0, 1.0, 0.5)));
    assert_exact(area(&twice), 12.0 - PI * 0.25);
    assert_eq!(twice.notes, ["2 curves lie on equal ones and were left out"]);
}

#[test]
fn layers_are_named_and_what_is_ignored_is_told() {
    let other = |kind: &str| pairs(&[(0, kind), (8, "NOTES")]) + "10\n0\n20\n0\n40\n1\n";
    let text = file(
        "4",
        "",
        &(circle(5.0, 5.0, 2.0)
            + &other("CIRCLE")
            + &entity("HATCH", &[])
            + &entity("POINT", &[])
            + &entity("POINT", &[])),
    );
    let error = read(&text).unwrap_err();
    assert!(
        error.contains("curves on 2 layers [name the layer that is read, one of E, NOTES]"),
        "{error}"
    );
    let on = |layer: &str| {
        read_with(
            &text,
            &DrawingOptions {
                layers: vec![layer.to_owned()],
                ..DrawingOptions::default()
            },
        )
    };
    let drawing = on("E").unwrap();
    assert_exact(area(&drawing), 4.0 * PI);
    assert_eq!(
        drawing.notes,
        ["ignored: 1 HATCH, 2 POINT", "layers that were not read: NOTES"]
    );
    let error = on("X").unwrap_err();
    assert!(
        error.contains("no curves on layer \"X\" [layers with curves: E, NOTES]"),
        "{error}"
    );
    // What is hidden or on a page is no part of it.
    let hidden = entity("CIRCLE", &[(10, 5.0), (20, 5.0), (40, 9.0), (60, 1.0)]);
    assert_exact(area(&drawn(&(hidden + &circle(5.0, 5.0, 2.0)))), 4.0 * PI);
}

#[test]
fn damaged_files_are_refused() {
    let wrong = |entities: &str| read(&file("4", "", entities)).unwrap_err();
    for (entities, says) in [
        (
            entity("CIRCLE", &[(10, 1.0), (20, 1.0)]),
            "CIRCLE has no value with code 40",
        ),
        (pairs(&[(0, "CIRCLE"), (10, "one")]), "line 24: \"one\" is not a number"),
        (pairs(&[(0, "CIRCLE"), (10, "1e300")]), "\"1e300\" is not a number"),
        (pairs(&[(0, "CIRCLE"), (10, "nan")]), "\"nan\" is not a number"),
        (
            spline(3, &[0.0, 1.0], &[[0.0, 0.0]; 4], &[]),
            "SPLINE is damaged: it has 2 knots, but needs 8",
        ),
        (
            spline(1, &[0.0, 2.0, 1.0, 3.0], &[[0.0, 0.0]; 2], &[]),
            "its knots are not in ascending order",
        ),
        (
            spline(1, &[0.0, 0.0, 1.0, 1.0], &[[0.0, 0.0]; 2], &[0.0, 1.0]),
            "a weight is outside 1e-6 to 1e6",
        ),
        (spline(99, &[], &[[0.0, 0.0]; 2], &[]), "its degree is 99"),
        (
            entity("SPLINE", &[(71, 3.0), (11, 0.0), (21, 0.0)]),
            "no control points",
        ),
        (
            entity("CIRCLE", &[(10, 1.0), (20, 1.0), (40, 1.0), (210, 1.0), (230, 0.0)]),
            "is tilted",
        ),
        (
            insert("X", &[(10, 0.0), (20, 0.0), (70, 1e6), (71, 1e6)]),
            "INSERT has 1000000 × 1000000 copies",
        ),
        (entity("TEXT", &[]), "the drawing has no closed curves"),
    ] {
        let error = wrong(&entities);
        assert!(error.contains(says), "{entities}: {error}");
    }
    for (text, says) in [
        ("AutoCAD Binary DXF\r\n\u{1a}\0", "the file is binary DXF"),
        ("0\nSECTION\nwhat", "line 3: \"what\" is not a code of DXF"),
        ("0\nSECTION\n2", "line 4: the value is missing"),
        ("", "has no unit"),
    ] {
        let error = read(text).unwrap_err();
        assert!(error.contains(says), "{text}: {error}");
    }
}

#[test]
fn a_contour_of_many_lines_is_read_in_time() {
    let count = 100_000;
    let point = |k: usize| {
        let (sin, cos) = (k as f64 / f64::from(count) * 2.0 * PI).sin_cos();
        [25.0 + 20.0 * cos, 25.0 + 20.0 * sin]
    };
    let lines: String = (0..count as usize)
        .rev()
        .map(|k| line(point(k), point(k + 1)))
        .collect();
    let start = std::time::Instant::now();
    let drawing = drawn(&lines);
    let exact = 0.5 * 400.0 * f64::from(count) * (2.0 * PI / f64::from(count)).sin();
    let found = area(&drawing);
    assert!((found / exact - 1.0).abs() < 1e-9, "{found} {exact}");
    let membrane = crate::Membrane::square(50.0);
    let cells = drawing.filled[0].cells(membrane).count();
    assert!((cells as f64 - exact).abs() < 20.0, "{cells}");
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

#[test]
fn layers_of_electrodes_are_groups() {
    let disc = |layer: &str, x: f64| pairs(&[(0, "CIRCLE"), (8, layer)]) + &format!("10\n{x}\n20\n5\n40\n1\n");
    let text = file(
        "4",
        "",
        &(disc("FRAME", 20.0) + &disc("ELECTRODE_2", 5.0) + &disc("Electrode_1", 9.0)),
    );
    let read = |layers: &[&str]| {
        let options = DrawingOptions {
            layers: layers.iter().map(ToString::to_string).collect(),
            ..DrawingOptions::default()
        };
        let groups = super::read_text(&text, DrawingFormat::Dxf, &options).unwrap();
        let left = |drawing: &Drawing| bounds(drawing)[0][0].round() as i64;
        groups
            .iter()
            .map(|(group, drawing)| (*group, left(drawing)))
            .collect::<Vec<_>>()
    };
    assert_eq!(read(&[]), [(1, 8), (2, 4)]);
    assert_eq!(read(&["FRAME", "ELECTRODE_2"]), [(1, 19), (2, 4)]);
}
