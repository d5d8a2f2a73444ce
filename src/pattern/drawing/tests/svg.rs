//! Drawings in SVG.

use super::{Drawing, DrawingFormat, DrawingOptions, area, assert_exact};
use crate::{Membrane, Raster};
use std::f64::consts::PI;

fn read_with(text: &str, options: &DrawingOptions) -> Result<Drawing, String> {
    let told = |error: crate::PatternFileError| format!("{error} [{}]", error.own_advice().unwrap_or_default());
    super::read(text, DrawingFormat::Svg, options).map_err(told)
}

/// Reads a drawing of 50 mm with units of mm.
fn drawn(content: &str) -> Drawing {
    read_with(&page(content), &DrawingOptions::default()).unwrap()
}

fn page(content: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" width=\"50mm\" \
         height=\"50mm\" viewBox=\"0 0 50 50\">{content}</svg>"
    )
}

#[test]
fn examples_have_their_areas() {
    for (text, layer, exact) in [
        (include_str!("files/s1_circle_rect.svg"), None, 309.06192982974676),
        (include_str!("files/s2_path_evenodd.svg"), None, 505.7964172279567),
        (
            include_str!("files/s3_transform_px.svg"),
            Some("ELECTRODE"),
            70.37603876354136,
        ),
        (
            include_str!("files/s3_transform_px.svg"),
            Some("layer1"),
            70.37603876354136,
        ),
    ] {
        let options = DrawingOptions {
            layers: layer.map(str::to_owned).into_iter().collect(),
            ..DrawingOptions::default()
        };
        let drawing = read_with(text, &options).unwrap();
        let found = area(&drawing);
        assert!((found / exact - 1.0).abs() < 1e-9, "{found} {exact}");
    }
}

#[test]
fn shapes_have_exact_areas_and_y_points_down() {
    let whole = |content: &str, exact: f64| assert_exact(area(&drawn(content)), exact);
    whole("<rect x='5' y='6' width='10' height='8'/>", 80.0);
    whole("<rect width='10' height='8' rx='2'/>", 64.0 + 4.0 * PI);
    whole("<rect width='10' height='8' rx='2' ry='99'/>", 80.0 - 32.0 + 8.0 * PI);
    whole("<ellipse cx='20' cy='20' rx='5' ry='2'/>", 10.0 * PI);
    whole("<polygon points='1,1 5,1 5,4'/>", 6.0);
    whole("<polyline points='1 1 5 1 5 4'/>", 6.0);
    whole("<path d='M1 1h4v3z m10 10 l4 0 0 3z'/>", 12.0);
    whole("<path d='M10 10 A5 5 0 0 1 20 10'/>", 12.5 * PI);
    whole("<path d='M10 10 a5 5 0 1 0 10 0 z'/>", 12.5 * PI);
    whole("<path d='M10 10 A5 2 90 0 1 10 20 z'/>", 5.0 * PI);
    // Radii that are too small grow: half a circle of radius 4.
    whole("<path d='M10 10 A1 1 0 0 1 18 10'/>", 8.0 * PI);
    whole("<path d='M0 0 C1 2 3 2 4 0z'/>", 4.2);
    // A quadratic curve has 2/3 of its triangle; T mirrors its control point.
    whole("<path d='M0 0 Q2 3 4 0z'/>", 4.0);
    whole("<path d='M0 9 Q2 12 4 9 T8 9 V20 H0z'/>", 88.0);
    whole("<path d='M0 9 C1 12 3 12 4 9 S7 6 8 9 V20 H0z'/>", 88.0);
    let membrane = Membrane {
        raster: Raster::new(50, 50).unwrap(),
        size_mm: [50.0, 50.0],
    };
    let cells = drawn("<rect x='5' y='6' width='10' height='8'/>").filled[0].cells(membrane);
    assert!(cells.has(5, 43) && !cells.has(5, 44) && cells.has(14, 36) && !cells.has(14, 35));
}

#[test]
fn transforms_views_uses_and_units_are_followed() {
    let whole = |content: &str, exact: f64| assert_exact(area(&drawn(content)), exact);
    whole(
        "<g transform='scale(2) rotate(30)'><rect width='3' height='2' transform='skewX(20)'/></g>",
        24.0,
    );
    whole("<circle r='2' transform='matrix(1 2 3 4 5 6)'/>", 8.0 * PI);
    whole(
        "<defs><circle id='c' r='2'/></defs><use href='#c' x='9'/><use xlink:href='#c' x='20' y='20'/>",
        8.0 * PI,
    );
    whole(
        "<symbol id='s' viewBox='0 0 2 2'><circle cx='1' cy='1' r='1'/></symbol><use href='#s'/>",
        625.0 * PI,
    );
    whole(
        "<svg x='3' width='10' height='20' viewBox='0 0 1 1'><rect width='1' height='1'/></svg>",
        100.0,
    );
    whole(
        "<svg width='10' height='20' viewBox='0 0 1 1' preserveAspectRatio='none'><rect width='1' height='1'/></svg>",
        200.0,
    );
    whole("<rect width='50%' height='10%'/>", 125.0);
    let read = |text: &str, unit_mm: Option<f64>| {
        let options = DrawingOptions {
            unit_mm,
            ..DrawingOptions::default()
        };
        read_with(text, &options).unwrap()
    };
    let inch = "<svg width='1in' height='96'><rect width='1cm' height='96px'/></svg>";
    assert_exact(area(&read(inch, None)), 254.0);
    assert_exact(area(&read(inch, Some(1.0))), 96.0 * 96.0 / 2.54);
    let bare = read("<svg viewBox='0 0 96 96'><rect width='96' height='96'/></svg>", None);
    assert_exact(area(&bare), 25.4 * 25.4);
    assert_eq!(bare.notes, ["the page has no size; its units are read as 1/96 inch"]);
}

#[test]
fn fills_follow_rules_styles_and_sheets() {
    let whole = |content: &str, exact: f64| assert_exact(area(&drawn(content)), exact);
    let nested = "M10 10h20v20h-20z M15 15h10v10h-10z";
    whole(&format!("<path d='{nested}'/>"), 400.0);
    whole(&format!("<path fill-rule='evenodd' d='{nested}'/>"), 300.0);
    whole(&format!("<g style='fill-rule:evenodd'><path d='{nested}'/></g>"), 300.0);
    whole("<path d='M10 10h20v20h-20z M15 15v10h10v-10z'/>", 300.0);
    // Shapes that overlap count once.
    whole(
        "<rect width='10' height='10'/><rect x='2' y='2' width='4' height='4'/>",
        100.0,
    );
    whole(
        "<style>.a{fill:none} rect.b{fill:#000}</style><rect class='a' width='9' height='9'/>\
         <rect class='b' width='2' height='2'/>",
        4.0,
    );
    let drawing = drawn(
        "<rect fill='none' stroke='red' width='9' height='9'/><rect fill='#FFF' width='50' height='50'/><text>x</text>\
         <rect style='display:none' width='3' height='3'/><rect width='2' height='2'/><line x1='1' x2='2'/>",
    );
    assert_exact(area(&drawing), 4.0);
    assert_eq!(
        drawing.notes,
        ["ignored: 1 curve without fill, 1 line, 1 text, 1 white area"]
    );
}

#[test]
fn damaged_files_are_refused() {
    let deep = format!("{}{}", "<g>".repeat(250), "</g>".repeat(250));
    for (text, says) in [
        ("<svg", "not SVG"),
        ("<html/>", "the first element is `html`"),
        (
            "<svg><rect width='1' height='1'/></svg>",
            "neither width and height nor a viewBox",
        ),
        (page("").as_str(), "the drawing has no filled area"),
        (
            page("<path fill='none' d='M0 0h1v1z'/>").as_str(),
            "found 1 curve without fill",
        ),
        (
            page("\n<path d='M0 0h1x'/>").as_str(),
            "line 2: element `path`: cannot read `d`",
        ),
        (
            page("<rect width='1em' height='1'/>").as_str(),
            "cannot read `width` \"1em\" [give lengths",
        ),
        (
            page("<rect transform='wrong(1)' width='1' height='1'/>").as_str(),
            "cannot read `transform`",
        ),
        (
            page("<rect width='1e308' height='1e308' transform='scale(9)'/>").as_str(),
            "too far from the origin",
        ),
        (page("<g id='g'><use href='#g'/></g>").as_str(), "is beyond the limits"),
        (page(&deep).as_str(), "200 inside each other"),
    ] {
        let error = read_with(text, &DrawingOptions::default()).unwrap_err();
        assert!(error.contains(says), "{text:.200}: {error}");
    }
    let options = DrawingOptions {
        layers: vec!["X".to_owned()],
        ..DrawingOptions::default()
    };
    let error = read_with(&page("<g id='A'><rect width='2' height='2'/></g>"), &options).unwrap_err();
    assert!(error.contains("the drawing has no layer \"X\" [groups: A]"), "{error}");
}
