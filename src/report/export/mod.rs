//! Designs in the formats of other programs: one file per format, with a function from a drawing to the bytes of a
//! file.
//!
//! The bytes depend only on the drawing; no format has a time.

mod csv;
mod dxf;
mod gerber;
mod mask;
mod png;
mod svg;
mod vtkhdf;

pub use csv::{cell_lines, csv};
pub use dxf::dxf;
pub use gerber::gerber;
pub use mask::{mask_drawing, one_or_both, side_or_sides};
pub use png::{MOST_PIXELS, png};
pub use svg::{svg, svg_elements};
pub use vtkhdf::{Surface, write_vtkhdf};

/// A point in mm, the origin at the lower left corner of the membrane, y upwards.
pub type Point = [f64; 2];

/// A polygon with holes. The last point of a ring is joined to the first.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// The outer ring, anticlockwise.
    pub outer: Vec<Point>,
    /// The rings of its holes, clockwise. A hole may contain other shapes.
    pub holes: Vec<Vec<Point>>,
}

/// A layer of a drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// The number of an electrode group; `None` if there is one group.
    pub group: Option<usize>,
    /// Its shapes. A shape within a hole comes after the shape with the hole.
    pub shapes: Vec<Shape>,
}

impl Layer {
    /// Returns all rings, outer ones before their holes.
    fn rings(&self) -> impl Iterator<Item = &Vec<Point>> {
        rings(&self.shapes)
    }

    /// Returns its name in lower case: `electrode`, or `electrode` and its number.
    fn name(&self, between: &str) -> String {
        self.group
            .map_or_else(|| "electrode".to_owned(), |group| format!("electrode{between}{group}"))
    }
}

/// Returns all rings of shapes, outer ones before their holes.
fn rings(shapes: &[Shape]) -> impl Iterator<Item = &Vec<Point>> {
    shapes
        .iter()
        .flat_map(|shape| std::iter::once(&shape.outer).chain(&shape.holes))
}

/// The drawing of an electrode.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// The title.
    pub title: String,
    /// Notes on size, scale and areas, a line each.
    pub notes: Vec<String>,
    /// The source: an artifact and its stage, or a file.
    pub source: String,
    /// The program.
    pub program: String,
    /// Sides of the membrane in mm; the origin is its lower left corner.
    pub size: [f64; 2],
    /// The electrode, or its groups.
    pub layers: Vec<Layer>,
    /// The opening of the frame, if it is not the whole rectangle.
    pub opening: Vec<Shape>,
    /// Rigid bodies.
    pub bodies: Vec<Shape>,
}

impl Drawing {
    /// Returns title and notes.
    pub fn lines(&self) -> impl Iterator<Item = &str> {
        std::iter::once(self.title.as_str()).chain(self.notes.iter().map(String::as_str))
    }
}

/// Writes a length in mm with up to six decimals, without trailing zeros.
fn number(mm: f64) -> String {
    crate::drawing::number(mm, 6)
}

/// Replaces control characters by spaces, and characters outside of ASCII as `escape` does.
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
