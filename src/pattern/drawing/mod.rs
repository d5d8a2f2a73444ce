//! Reads drawings: closed curves of CAD programs and of vector graphics, placed on a membrane.

mod affine;
mod curves;
mod dxf;
mod svg;
#[cfg(test)]
mod tests;

use std::path::Path;

use crate::contour::{Contours, FillRule};
use crate::{Edges, PatternFileError, file};
use affine::Affine;

/// The largest drawing in bytes.
const MOST_BYTES: u64 = 256 << 20;

/// What is read of a drawing, and where it is placed; and how pictures are read.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawingOptions {
    /// The layer of each electrode group. If there are none: layers named electrode, or electrode_1 and so on for
    /// groups, as deaflow exports them; else the only layer with curves in DXF, and all in SVG.
    pub layers: Vec<String>,
    /// The length in mm of a unit of the drawing; without it the unit that the file states.
    pub unit_mm: Option<f64>,
    /// Where the origin of the drawing is placed, in mm from the lower left corner of the membrane. The origin of SVG
    /// is the lower left corner of the page.
    pub origin_mm: [f64; 2],
    /// The factor by which the drawing is enlarged about its origin.
    pub scale: f64,
    /// The angle in degrees by which it is turned anticlockwise about its origin.
    pub degrees: f64,
    /// The largest distance in mm between ends that are joined.
    pub join_mm: f64,
    /// The dark share from which on a cell of a picture is an electrode.
    pub threshold: f64,
    /// How the edges of drawings are followed, and whether greys of pictures cover parts of cells.
    pub edges: Edges,
}

impl Default for DrawingOptions {
    fn default() -> Self {
        Self {
            layers: Vec::new(),
            unit_mm: None,
            origin_mm: [0.0; 2],
            scale: 1.0,
            degrees: 0.0,
            join_mm: 1e-3,
            threshold: 0.5,
            edges: Edges::Cells,
        }
    }
}

deaflow_base::words! {
    /// Units of the lengths in a drawing.
    pub enum DrawingUnit {
        /// Micrometres.
        Micrometre = "um",
        /// Millimetres.
        Millimetre = "mm",
        /// Centimetres.
        Centimetre = "cm",
        /// Metres.
        Metre = "m",
        /// Inches.
        Inch = "in",
    }
}

impl DrawingUnit {
    /// Returns its length in mm.
    #[must_use]
    pub fn mm(self) -> f64 {
        match self {
            Self::Micrometre => 1e-3,
            Self::Millimetre => 1.0,
            Self::Centimetre => 10.0,
            Self::Metre => 1e3,
            Self::Inch => 25.4,
        }
    }
}

/// What a drawing fills on the membrane.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// What is filled: all of it together.
    pub filled: Vec<Contours>,
    /// What was ignored or assumed.
    pub notes: Vec<String>,
}

/// Formats of drawings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawingFormat {
    /// The exchange format of CAD programs.
    Dxf,
    /// Scalable Vector Graphics.
    Svg,
}

impl DrawingFormat {
    /// Returns the format of a file by its extension.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?;
        match extension.to_ascii_lowercase().as_str() {
            "dxf" => Some(Self::Dxf),
            "svg" => Some(Self::Svg),
            _ => None,
        }
    }
}

/// Reads what a drawing fills, for each electrode group in it.
///
/// # Errors
/// When the file cannot be read, is damaged, has no unit, has an open contour, or nothing on a layer.
pub fn read_drawing(
    path: &Path,
    format: DrawingFormat,
    options: &DrawingOptions,
) -> Result<Vec<(usize, Drawing)>, PatternFileError> {
    let bytes = file::bytes(path, MOST_BYTES)?;
    read_text(&String::from_utf8_lossy(&bytes), format, options)
}

/// Reads what a layer of a drawing fills: the first that the options name, else the only one with curves in DXF, and
/// all in SVG.
///
/// # Errors
/// As [`read_drawing`].
pub fn read_shape(path: &Path, format: DrawingFormat, options: &DrawingOptions) -> Result<Drawing, PatternFileError> {
    let bytes = file::bytes(path, MOST_BYTES)?;
    let layer = options.layers.first().map(String::as_str);
    with_layers(&String::from_utf8_lossy(&bytes), format, options, |_, of| of(layer))
}

fn read_text(
    text: &str,
    format: DrawingFormat,
    options: &DrawingOptions,
) -> Result<Vec<(usize, Drawing)>, PatternFileError> {
    with_layers(text, format, options, |names, of| {
        let groups = groups_of(&options.layers, names.iter().copied());
        let each = groups.into_iter();
        each.map(|(group, layer)| Ok((group, of(layer.as_deref())?))).collect()
    })
}

/// Returns what a layer fills, or all layers.
type OfLayer<'a> = &'a dyn Fn(Option<&str>) -> Result<Drawing, PatternFileError>;

/// Reads a drawing by the names of its layers and a reader of one.
fn with_layers<T>(
    text: &str,
    format: DrawingFormat,
    options: &DrawingOptions,
    read: impl FnOnce(&[&str], OfLayer<'_>) -> Result<T, PatternFileError>,
) -> Result<T, PatternFileError> {
    let placed = |(filled, notes): (Vec<Contours>, Vec<String>)| Drawing {
        filled: filled.into_iter().map(|contours| placed(contours, options)).collect(),
        notes,
    };
    match format {
        DrawingFormat::Dxf => {
            let curves = dxf::read(text, options.unit_mm)?;
            let of = |layer: Option<&str>| {
                let (contours, notes) = curves.contours(layer, options.join_mm)?;
                let rule = FillRule::EvenOdd;
                Ok(placed((vec![Contours { contours, rule }], notes)))
            };
            read(&curves.layers().collect::<Vec<_>>(), &of)
        }
        DrawingFormat::Svg => {
            let document = svg::parse(text)?;
            let of = |layer: Option<&str>| Ok(placed(svg::read(&document, options.unit_mm, layer)?));
            read(&svg::names(&document).collect::<Vec<_>>(), &of)
        }
    }
}

/// Returns the groups with their layers: those that are named, or those of layers that are named as deaflow does.
fn groups_of<'a>(named: &[String], layers: impl Iterator<Item = &'a str>) -> Vec<(usize, Option<String>)> {
    if !named.is_empty() {
        return (1..).zip(named.iter().cloned().map(Some)).collect();
    }
    let mut found: Vec<(usize, Option<String>)> = layers
        .filter_map(|layer| Some((electrode_group(layer)?, Some(layer.to_owned()))))
        .collect();
    found.sort();
    found.dedup_by_key(|(group, _)| *group);
    match found.is_empty() {
        true => vec![(1, None)],
        false => found,
    }
}

/// Returns the group whose electrodes are on a layer of this name.
fn electrode_group(layer: &str) -> Option<usize> {
    let lower = layer.to_ascii_lowercase();
    match lower.strip_prefix("electrode")? {
        "" => Some(1),
        number => number.strip_prefix(['_', '-'])?.parse().ok().filter(|group| *group > 0),
    }
}

fn placed(contours: Contours, options: &DrawingOptions) -> Contours {
    let place = Affine::moved(options.origin_mm)
        .after(&Affine::turned(options.degrees))
        .after(&Affine::scaled([options.scale; 2]));
    Contours {
        contours: contours.contours.iter().map(|contour| place.contour(contour)).collect(),
        rule: contours.rule,
    }
}
