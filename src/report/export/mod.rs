//! Designs in the formats of other programs; one file per format, each a function from a drawing to the bytes of a file.
//!
//! The bytes depend on the drawing alone: no file says when it was made.

mod csv;
mod dxf;
mod gerber;
mod mask;
mod png;
mod svg;
mod vtkhdf;

pub use csv::csv;
pub use dxf::dxf;
pub use gerber::gerber;
pub use mask::{notes_of, shown_both, side_or_sides};
pub use png::{MOST_PIXELS, png};
pub use svg::svg;
pub use vtkhdf::{Surface, write_vtkhdf};

/// A point in mm, the origin at the lower left corner of the membrane, y upwards.
pub type Point = [f64; 2];

/// A polygon with holes. The last point of a ring is joined to the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// The outer ring, anticlockwise.
    pub outer: Vec<Point>,
    /// The rings of its holes, clockwise. A hole may hold other shapes.
    pub holes: Vec<Vec<Point>>,
}

/// What is drawn apart from the rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// The number of a group of electrodes; none where there is one group.
    pub group: Option<usize>,
    /// Its shapes. A shape within a hole comes after the one that has the hole.
    pub shapes: Vec<Shape>,
}

impl Layer {
    /// All rings, outer ones before their holes.
    fn rings(&self) -> impl Iterator<Item = &Vec<Point>> {
        rings(&self.shapes)
    }

    /// What it is called, in lower case: `electrode`, or `electrode` and its number.
    fn name(&self, between: &str) -> String {
        self.group
            .map_or_else(|| "electrode".to_owned(), |group| format!("electrode{between}{group}"))
    }
}

/// All rings of some shapes, outer ones before their holes.
fn rings(shapes: &[Shape]) -> impl Iterator<Item = &Vec<Point>> {
    shapes
        .iter()
        .flat_map(|shape| std::iter::once(&shape.outer).chain(&shape.holes))
}

/// An electrode as it is to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// What it is called.
    pub title: String,
    /// What must be known of it: size, scale, areas; a line each.
    pub notes: Vec<String>,
    /// Where it comes from: an artifact and its stage, or a file.
    pub source: String,
    /// The program that draws it.
    pub program: String,
    /// Sides of the membrane in mm: its lower left corner is the origin.
    pub size: [f64; 2],
    /// The electrode, or its groups.
    pub layers: Vec<Layer>,
    /// What is not frame, where there is more of it than the edge of the membrane.
    pub opening: Vec<Shape>,
    /// Rigid bodies.
    pub bodies: Vec<Shape>,
}

impl Drawing {
    /// Title and notes.
    pub fn lines(&self) -> impl Iterator<Item = &str> {
        std::iter::once(self.title.as_str()).chain(self.notes.iter().map(String::as_str))
    }
}

/// A length in mm to the nanometre, without zeros that say nothing.
fn number(mm: f64) -> String {
    let text = format!("{mm:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A text on one line, each other character than printable ASCII as `escape` writes it.
fn ascii(text: &str, escape: impl Fn(char) -> String) -> String {
    let each = |c: char| match c {
        ' '..='~' => c.to_string(),
        c if c.is_control() => " ".to_owned(),
        c => escape(c),
    };
    text.chars().map(each).collect()
}

#[cfg(test)]
mod tests;
