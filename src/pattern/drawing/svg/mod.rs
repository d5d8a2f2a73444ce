//! Reads the filled areas of a drawing in SVG.
//!
//! Source: W3C, Scalable Vector Graphics 1.1. Shapes are read with their transforms, units, styles and fill rules, as
//! exact arcs and cubics; what has no fill draws no electrode.

mod path;
mod style;

use std::collections::BTreeMap;
use std::str::FromStr;

use roxmltree::{Document, Node, ParsingOptions};
use svgtypes::{AspectRatio, Length, LengthUnit, PointsParser, TransformListParser, TransformListToken, ViewBox};

use super::affine::Affine;
use crate::PatternFileError;
use crate::contour::{Contour, Contours, Point};
use style::{Style, StyleSheet};

/// How deep elements may be nested, uses counted.
const DEEPEST: usize = 200;

/// The largest number of elements, in all uses.
const MOST: usize = 200_000;

/// The largest absolute coordinate in mm.
const LARGEST: f64 = 1e9;

/// The length of a pixel in mm.
const PIXEL_MM: f64 = 25.4 / 96.0;

const INKSCAPE: &str = "http://www.inkscape.org/namespaces/inkscape";

const XLINK: &str = "http://www.w3.org/1999/xlink";

/// Parses a drawing.
///
/// # Errors
/// When the text is not SVG.
pub(super) fn parse(text: &str) -> Result<Document<'_>, PatternFileError> {
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(text, options)
        .map_err(|error| PatternFileError::new(format!("not SVG: {error}")).help("export the drawing again"))?;
    match document.root_element().tag_name().name() {
        "svg" => Ok(document),
        found => Err(PatternFileError::new(format!("not SVG: the first element is `{found}`")).help("allowed: svg")),
    }
}

/// Returns the names of elements: their id, and their label in Inkscape.
pub(super) fn names<'a>(document: &'a Document<'_>) -> impl Iterator<Item = &'a str> {
    let names = |node: Node<'a, '_>| [node.attribute("id"), node.attribute((INKSCAPE, "label"))];
    document.descendants().flat_map(names).flatten()
}

/// Returns what is filled, in mm from the lower left corner of the page, and notes.
///
/// # Errors
/// When a shape is damaged, or nothing is filled.
pub(super) fn read(
    document: &Document<'_>,
    unit_mm: Option<f64>,
    layer: Option<&str>,
) -> Result<(Vec<Contours>, Vec<String>), PatternFileError> {
    let root = document.root_element();
    let mut reading = Reading {
        document,
        sheet: StyleSheet::of(document),
        layer,
        filled: Vec::new(),
        ignored: BTreeMap::new(),
        layers: Vec::new(),
        found: false,
        count: 0,
    };
    let (page, mut notes) = page(root, unit_mm)?;
    let place = Place {
        map: page.map,
        size: page.size,
        style: Style::default(),
        is_wanted: layer.is_none(),
        depth: 0,
    };
    reading.add(root, &place, true)?;
    reading.finish(&mut notes)
}

/// The page of a drawing.
struct Page {
    /// From user units to mm, with y upwards.
    map: Affine,
    /// Its size in user units.
    size: [f64; 2],
}

/// Returns the page, and notes.
fn page(root: Node<'_, '_>, unit_mm: Option<f64>) -> Result<(Page, Vec<String>), PatternFileError> {
    let view = view_box(root)?;
    let length = |name: &str| -> Result<Option<f64>, PatternFileError> {
        match root.attribute(name) {
            Some(text) => Ok(pixels(root, name, text, None)?),
            None => Ok(None),
        }
    };
    let own = [length("width")?, length("height")?];
    let mut notes = Vec::new();
    if let Some(unit) = unit_mm {
        // The unit of the user overrides the size of the page.
        let (origin, size) = match (view, own) {
            (Some(view), _) => ([view.x, view.y], [view.w, view.h]),
            (None, [Some(width), Some(height)]) => ([0.0; 2], [width, height]),
            _ => return Err(no_size()),
        };
        let map = Affine {
            columns: [[unit, 0.0], [0.0, -unit]],
            origin: [-origin[0] * unit, (origin[1] + size[1]) * unit],
        };
        return Ok((Page { map, size }, notes));
    }
    let size = match (own, view) {
        ([Some(width), Some(height)], _) => [width, height],
        ([Some(width), None], Some(view)) => [width, width * view.h / view.w],
        ([None, Some(height)], Some(view)) => [height * view.w / view.h, height],
        (_, Some(view)) => {
            notes.push("the page has no size; its units are read as 1/96 inch".to_owned());
            [view.w, view.h]
        }
        _ => return Err(no_size()),
    };
    let to_mm = Affine {
        columns: [[PIXEL_MM, 0.0], [0.0, -PIXEL_MM]],
        origin: [0.0, size[1] * PIXEL_MM],
    };
    let (map, size) = match view {
        Some(view) => (to_mm.after(&fitted(root, view, size)?), [view.w, view.h]),
        None => (to_mm, size),
    };
    Ok((Page { map, size }, notes))
}

fn no_size() -> PatternFileError {
    PatternFileError::new("the drawing has neither width and height nor a viewBox")
        .help("set the size of the page in the drawing")
}

fn view_box(node: Node<'_, '_>) -> Result<Option<ViewBox>, PatternFileError> {
    let Some(text) = node.attribute("viewBox") else {
        return Ok(None);
    };
    match ViewBox::from_str(text) {
        Ok(view) => Ok(Some(view)),
        Err(_) => Err(damaged(node, "viewBox", text)),
    }
}

/// Returns the map from a view box to a rectangle at the origin.
fn fitted(node: Node<'_, '_>, view: ViewBox, [width, height]: [f64; 2]) -> Result<Affine, PatternFileError> {
    use svgtypes::Align;
    let ratio = match node.attribute("preserveAspectRatio") {
        Some(text) => AspectRatio::from_str(text).map_err(|_| damaged(node, "preserveAspectRatio", text))?,
        None => AspectRatio::default(),
    };
    let stretch = [width / view.w, height / view.h];
    let scale = match (ratio.align, ratio.slice) {
        (Align::None, _) => stretch,
        (_, true) => [stretch[0].max(stretch[1]); 2],
        (_, false) => [stretch[0].min(stretch[1]); 2],
    };
    let spare = [width - view.w * scale[0], height - view.h * scale[1]];
    let share = match ratio.align {
        Align::None | Align::XMinYMin => [0.0, 0.0],
        Align::XMidYMin => [0.5, 0.0],
        Align::XMaxYMin => [1.0, 0.0],
        Align::XMinYMid => [0.0, 0.5],
        Align::XMidYMid => [0.5, 0.5],
        Align::XMaxYMid => [1.0, 0.5],
        Align::XMinYMax => [0.0, 1.0],
        Align::XMidYMax => [0.5, 1.0],
        Align::XMaxYMax => [1.0, 1.0],
    };
    Ok(Affine {
        columns: [[scale[0], 0.0], [0.0, scale[1]]],
        origin: [
            share[0] * spare[0] - view.x * scale[0],
            share[1] * spare[1] - view.y * scale[1],
        ],
    })
}

/// Returns a length in user units; `None` for a share of an unknown whole.
fn pixels(node: Node<'_, '_>, name: &str, text: &str, whole: Option<f64>) -> Result<Option<f64>, PatternFileError> {
    let Ok(length) = Length::from_str(text.trim()) else {
        return Err(damaged(node, name, text));
    };
    let inch = 96.0;
    let factor = match length.unit {
        LengthUnit::None | LengthUnit::Px => 1.0,
        LengthUnit::In => inch,
        LengthUnit::Cm => inch / 2.54,
        LengthUnit::Mm => inch / 25.4,
        LengthUnit::Pt => inch / 72.0,
        LengthUnit::Pc => inch / 6.0,
        LengthUnit::Percent => match whole {
            Some(whole) => whole / 100.0,
            None => return Ok(None),
        },
        LengthUnit::Em | LengthUnit::Ex => {
            return Err(damaged(node, name, text).help("give lengths in mm, cm, in, pt, pc or px"));
        }
    };
    Ok(Some(length.number * factor))
}

fn damaged(node: Node<'_, '_>, name: &str, text: &str) -> PatternFileError {
    let shown: String = text.chars().take(40).collect();
    PatternFileError::new(format!("{}: cannot read `{name}` \"{shown}\"", described(node)))
        .help("export the drawing again")
}

/// Names an element with its line.
fn described(node: Node<'_, '_>) -> String {
    let row = node.document().text_pos_at(node.range().start).row;
    format!("line {row}: element `{}`", node.tag_name().name())
}

/// Where an element is, and what it inherits.
#[derive(Clone)]
struct Place {
    map: Affine,
    /// The size of the page in user units.
    size: [f64; 2],
    style: Style,
    /// Whether it is on the layer that is read.
    is_wanted: bool,
    depth: usize,
}

struct Reading<'a, 'input> {
    document: &'a Document<'input>,
    sheet: StyleSheet<'a>,
    layer: Option<&'a str>,
    filled: Vec<Contours>,
    /// The numbers of ignored elements by what they are.
    ignored: BTreeMap<String, usize>,
    /// The names of layers.
    layers: Vec<String>,
    /// Whether the layer exists.
    found: bool,
    count: usize,
}

impl<'a, 'input> Reading<'a, 'input> {
    fn ignore(&mut self, place: &Place, what: &str) {
        if place.is_wanted {
            *self.ignored.entry(what.to_owned()).or_default() += 1;
        }
    }

    /// Adds an element with what it contains. `is_shown`: symbols are shown only where they are used.
    fn add(&mut self, node: Node<'a, 'input>, place: &Place, is_shown: bool) -> Result<(), PatternFileError> {
        self.count += 1;
        if self.count > MOST || place.depth > DEEPEST {
            return Err(
                PatternFileError::new(format!("{} is beyond the limits", described(node)))
                    .help(format!("allowed: {MOST} elements, {DEEPEST} inside each other")),
            );
        }
        let name = node.tag_name().name();
        let style = self.sheet.style(node, &place.style);
        if style.is_hidden {
            return Ok(());
        }
        let mut here = Place {
            style,
            depth: place.depth + 1,
            ..place.clone()
        };
        if let Some(layer) = self.layer {
            let label = node.attribute((INKSCAPE, "label"));
            if node.attribute("id") == Some(layer) || label == Some(layer) {
                (here.is_wanted, self.found) = (true, true);
            }
            if name == "g" && self.layers.len() < 100 {
                self.layers.extend(label.or(node.attribute("id")).map(str::to_owned));
            }
        }
        if let Some(text) = node.attribute("transform") {
            here.map = here.map.after(&transform(node, text)?);
        }
        for word in ["clip-path", "mask"] {
            if node.attribute(word).is_some_and(|value| value != "none") {
                self.ignore(&here, word);
            }
        }
        match name {
            "g" | "a" | "switch" => self.add_children(node, &here),
            "svg" if here.depth == 1 => self.add_children(node, &here),
            "svg" | "symbol" if is_shown || name == "svg" => self.add_view(node, here),
            "use" => self.add_used(node, here),
            "text" | "image" | "foreignObject" => {
                self.ignore(&here, name);
                Ok(())
            }
            "rect" | "circle" | "ellipse" | "polygon" | "polyline" | "path" => self.add_shape(node, &here),
            "line" => {
                self.ignore(&here, "line");
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn add_children(&mut self, node: Node<'a, 'input>, place: &Place) -> Result<(), PatternFileError> {
        let children = node.children().filter(Node::is_element);
        for child in children {
            self.add(child, place, false)?;
        }
        Ok(())
    }

    /// Adds a picture within the picture.
    fn add_view(&mut self, node: Node<'a, 'input>, mut place: Place) -> Result<(), PatternFileError> {
        let corner = [self.length(node, "x", &place, 0)?, self.length(node, "y", &place, 1)?];
        let size = [0, 1].map(|axis| {
            let name = ["width", "height"][axis];
            match node.attribute(name) {
                Some(_) => self.length(node, name, &place, axis),
                None => Ok(place.size[axis]),
            }
        });
        let [width, height] = size;
        let size = [width?, height?];
        place.map = place.map.after(&Affine::moved(corner));
        place.size = size;
        if let Some(view) = view_box(node)? {
            place.map = place.map.after(&fitted(node, view, size)?);
            place.size = [view.w, view.h];
        }
        self.add_children(node, &place)
    }

    fn add_used(&mut self, node: Node<'a, 'input>, mut place: Place) -> Result<(), PatternFileError> {
        let reference = node.attribute("href").or(node.attribute((XLINK, "href")));
        let id = reference.and_then(|reference| reference.strip_prefix('#'));
        let Some(used) = id.and_then(|id| {
            self.document
                .descendants()
                .find(|node| node.attribute("id") == Some(id))
        }) else {
            self.ignore(&place, "use of something that is not in the file");
            return Ok(());
        };
        let corner = [self.length(node, "x", &place, 0)?, self.length(node, "y", &place, 1)?];
        place.map = place.map.after(&Affine::moved(corner));
        self.add(used, &place, true)
    }

    /// Returns a length in user units, 0 without the attribute. `axis`: of what a percentage is a share.
    fn length(&self, node: Node<'_, '_>, name: &str, place: &Place, axis: usize) -> Result<f64, PatternFileError> {
        let [width, height] = place.size;
        let whole = match axis {
            0 => width,
            1 => height,
            _ => (width.hypot(height)) / std::f64::consts::SQRT_2,
        };
        match node.attribute(name) {
            None | Some("auto") => Ok(0.0),
            Some(text) => Ok(pixels(node, name, text, Some(whole))?.unwrap_or(0.0)),
        }
    }

    fn add_shape(&mut self, node: Node<'a, 'input>, place: &Place) -> Result<(), PatternFileError> {
        if !place.is_wanted {
            return Ok(());
        }
        let contours = self.contours(node, place)?;
        if contours.is_empty() {
            return Ok(());
        }
        match &place.style {
            style if !style.is_filled => self.ignore(place, "curve without fill"),
            style if style.is_white => self.ignore(place, "white area"),
            style => {
                let contours: Vec<Contour> = contours.iter().map(|contour| place.map.contour(contour)).collect();
                let is_near = |point: &Point| point.iter().all(|at| at.abs() <= LARGEST);
                let ends = |contour: &Contour| contour.pieces.iter().all(|piece| is_near(&piece.end()));
                if !contours.iter().all(|contour| is_near(&contour.start) && ends(contour)) {
                    return Err(
                        PatternFileError::new(format!("{} is too far from the origin", described(node)))
                            .help(format!("allowed: up to {LARGEST:e} mm")),
                    );
                }
                let rule = style.rule;
                self.filled.push(Contours { contours, rule });
            }
        }
        Ok(())
    }

    fn contours(&self, node: Node<'_, '_>, place: &Place) -> Result<Vec<Contour>, PatternFileError> {
        let length = |name: &str, axis: usize| self.length(node, name, place, axis);
        Ok(match node.tag_name().name() {
            "circle" => {
                let (centre, radius) = ([length("cx", 0)?, length("cy", 1)?], length("r", 2)?);
                (radius > 0.0)
                    .then(|| Contour::ellipse(centre, [radius; 2], 0.0))
                    .into_iter()
                    .collect()
            }
            "ellipse" => {
                let centre = [length("cx", 0)?, length("cy", 1)?];
                let radii = self.radii(node, place)?;
                let is_shown = radii[0] > 0.0 && radii[1] > 0.0;
                is_shown
                    .then(|| Contour::ellipse(centre, radii, 0.0))
                    .into_iter()
                    .collect()
            }
            "rect" => {
                let corner = [length("x", 0)?, length("y", 1)?];
                let half = [length("width", 0)? / 2.0, length("height", 1)? / 2.0];
                let radii = self.radii(node, place)?;
                let is_shown = half[0] > 0.0 && half[1] > 0.0;
                is_shown.then(|| rounded(corner, half, radii)).into_iter().collect()
            }
            "path" => match node.attribute("d") {
                Some(data) => path::contours(data).ok_or_else(|| damaged(node, "d", data))?,
                None => Vec::new(),
            },
            _ => {
                let text = node.attribute("points").unwrap_or_default();
                let points: Vec<Point> = PointsParser::from(text).map(|(x, y)| [x, y]).collect();
                Contour::polygon(&points).into_iter().collect()
            }
        })
    }

    /// Returns the two radii of an ellipse or of round corners; one that is not given is as the other.
    fn radii(&self, node: Node<'_, '_>, place: &Place) -> Result<[f64; 2], PatternFileError> {
        let given = |name: &str| node.attribute(name).is_some_and(|text| text != "auto");
        let [x, y] = [self.length(node, "rx", place, 0)?, self.length(node, "ry", place, 1)?];
        Ok(match (given("rx"), given("ry")) {
            (true, false) => [x, x],
            (false, true) => [y, y],
            _ => [x, y],
        })
    }

    fn finish(self, notes: &mut Vec<String>) -> Result<(Vec<Contours>, Vec<String>), PatternFileError> {
        if let (Some(layer), false) = (self.layer, self.found) {
            let error = PatternFileError::new(format!("the drawing has no layer \"{layer}\""));
            return Err(match self.layers.is_empty() {
                true => error.help("the drawing has no groups with a name; leave the layer out to read all of it"),
                false => error.help(format!("groups: {}", self.layers.join(", "))),
            });
        }
        let ignored: Vec<String> = self
            .ignored
            .iter()
            .map(|(what, count)| format!("{count} {what}"))
            .collect();
        if self.filled.is_empty() {
            let found = match ignored.is_empty() {
                true => String::new(),
                false => format!("; found {}", ignored.join(", ")),
            };
            return Err(PatternFileError::new(format!("the drawing has no filled area{found}"))
                .help("fill the electrodes with a colour"));
        }
        if !ignored.is_empty() {
            notes.push(format!("ignored: {}", ignored.join(", ")));
        }
        Ok((self.filled, std::mem::take(notes)))
    }
}

/// A rectangle with elliptic corners.
fn rounded(corner: Point, half: [f64; 2], radii: [f64; 2]) -> Contour {
    let radii = [0, 1].map(|axis: usize| radii[axis].clamp(0.0, half[axis]));
    let centre = [corner[0] + half[0], corner[1] + half[1]];
    if radii[0] == 0.0 || radii[1] == 0.0 {
        return Contour::rectangle(centre, half, 0.0, 0.0);
    }
    // The corners are circles once y is stretched.
    let stretch = radii[0] / radii[1];
    let squeezed = Affine::moved(centre).after(&Affine::scaled([1.0, 1.0 / stretch]));
    squeezed.contour(&Contour::rectangle(
        [0.0; 2],
        [half[0], half[1] * stretch],
        0.0,
        radii[0],
    ))
}

fn transform(node: Node<'_, '_>, text: &str) -> Result<Affine, PatternFileError> {
    let mut map = Affine::IDENTITY;
    for token in TransformListParser::from(text) {
        let skewed = |columns: [Point; 2]| Affine {
            columns,
            origin: [0.0; 2],
        };
        let next = match token.map_err(|_| damaged(node, "transform", text))? {
            TransformListToken::Matrix { a, b, c, d, e, f } => Affine {
                columns: [[a, b], [c, d]],
                origin: [e, f],
            },
            TransformListToken::Translate { tx, ty } => Affine::moved([tx, ty]),
            TransformListToken::Scale { sx, sy } => Affine::scaled([sx, sy]),
            TransformListToken::Rotate { angle } => Affine::turned(angle),
            TransformListToken::SkewX { angle } => skewed([[1.0, 0.0], [angle.to_radians().tan(), 1.0]]),
            TransformListToken::SkewY { angle } => skewed([[1.0, angle.to_radians().tan()], [0.0, 1.0]]),
        };
        map = map.after(&next);
    }
    Ok(map)
}
