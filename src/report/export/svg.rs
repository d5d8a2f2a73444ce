//! SVG 1.1: one unit is one mm, and the drawing is as large as the membrane.

use std::fmt::Write;

use super::{Drawing, Point, Shape, number, rings};

/// Colours of electrode groups.
const COLOURS: [&str; 6] = ["#000000", "#c44e52", "#4c72b0", "#55a868", "#8172b2", "#ccb974"];

/// Writes the electrode as a filled path (`id="electrode"`, or `electrode-1` and so on for groups), and as thin lines
/// the frame (`id="frame"`), its opening (`opening`) and rigid bodies (`bodies`).
#[must_use]
pub fn svg(drawing: &Drawing) -> Vec<u8> {
    let [width, height] = drawing.size.map(number);
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = write!(
        text,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" version=\"1.1\" width=\"{width}mm\" height=\"{height}mm\" \
         viewBox=\"0 0 {width} {height}\">\n\
         <title>{}</title>\n<desc>{}</desc>\n\
         <metadata><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\" \
         xmlns:dc=\"http://purl.org/dc/elements/1.1/\"><rdf:Description rdf:about=\"\">\
         <dc:source>{}</dc:source><dc:creator>{}</dc:creator></rdf:Description></rdf:RDF></metadata>\n\
",
        escaped(&drawing.title),
        escaped(&drawing.notes.join("\n")),
        escaped(&drawing.source),
        escaped(&drawing.program),
    );
    text += &svg_elements(drawing);
    text.push_str("</svg>\n");
    text.into_bytes()
}

/// Writes the elements of [`svg`], without the document around them.
#[must_use]
pub fn svg_elements(drawing: &Drawing) -> String {
    let [width, height] = drawing.size.map(number);
    let path = |shapes: &[Shape]| -> String {
        let paths: Vec<String> = rings(shapes).map(|ring| subpath(ring, drawing.size[1])).collect();
        paths.join(" ")
    };
    let line = number(drawing.size[0].max(drawing.size[1]) / 500.0);
    let mut text = String::new();
    for (layer, colour) in drawing.layers.iter().zip(COLOURS.iter().cycle()) {
        let _ = writeln!(
            text,
            "<path id=\"{}\" fill=\"{colour}\" fill-rule=\"evenodd\" stroke=\"none\" d=\"{}\"/>",
            layer.name("-"),
            path(&layer.shapes)
        );
    }
    let _ = writeln!(
        text,
        "<rect id=\"frame\" x=\"0\" y=\"0\" width=\"{width}\" height=\"{height}\" fill=\"none\" stroke=\"#808080\" \
         stroke-width=\"{line}\"/>"
    );
    for (id, shapes) in [("opening", &drawing.opening), ("bodies", &drawing.bodies)] {
        if !shapes.is_empty() {
            let _ = writeln!(
                text,
                "<path id=\"{id}\" fill=\"none\" stroke=\"#808080\" stroke-width=\"{line}\" d=\"{}\"/>",
                path(shapes)
            );
        }
    }
    text
}

/// Returns a ring; in SVG, y points down.
fn subpath(ring: &[Point], height: f64) -> String {
    let points: Vec<String> = ring
        .iter()
        .map(|[x, y]| format!("{},{}", number(*x), number(height - y)))
        .collect();
    format!("M{} Z", points.join(" L"))
}

/// Escapes a text for XML, which does not allow most control characters.
fn escaped(text: &str) -> String {
    let each = |c: char| match c {
        '&' => "&amp;".to_owned(),
        '<' => "&lt;".to_owned(),
        '>' => "&gt;".to_owned(),
        '\n' => "\n".to_owned(),
        c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => " ".to_owned(),
        c => c.to_string(),
    };
    text.chars().map(each).collect()
}
