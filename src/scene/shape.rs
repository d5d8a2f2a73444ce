//! Shapes of parts of a membrane.

use std::ops::RangeInclusive;
use std::path::Path;

use deaflow_base::{
    Angle, Canonical, Declared, Fields, InputError, Length, Map, Node, NodeValue, Parameter, Schema, confined,
    parameters,
};
use deaflow_pattern::{Arc, Bits, Contour, Contours, DrawingFormat, Piece, Raster, Region, read_mask};

use super::drawing::{Drawing, Placement};

/// The largest coordinate in mm.
pub(super) const FARTHEST: f64 = 1e4;

/// The smallest and largest radius in mm.
const RADII: RangeInclusive<f64> = 1e-6..=1e4;

/// The smallest and largest angle in degrees.
const TURNS: RangeInclusive<f64> = -360.0..=360.0;

/// The largest number of corners of a polygon.
const MOST_CORNERS: usize = 10_000;

/// A position on the membrane, from its lower left corner.
pub type Position = [Length; 2];

parameters! {
    /// A circle.
    pub struct Circle as "`disc`" {
        /// Its centre, such as [25 mm, 25 mm].
        pub centre: Position [-FARTHEST..=FARTHEST],
        /// Its radius.
        pub radius: Length [RADII],
    }
}

parameters! {
    /// An ellipse.
    pub struct Ellipse as "`ellipse`" {
        /// Its centre, such as [25 mm, 25 mm].
        pub centre: Position [-FARTHEST..=FARTHEST],
        /// Its semiaxes, such as [5 mm, 3 mm].
        pub semiaxes: [Length; 2] [RADII],
        /// The angle of the first semiaxis to x, anticlockwise.
        pub angle: Option<Angle> [TURNS],
    }
}

parameters! {
    /// A ring.
    pub struct Ring as "`ring`" {
        /// Its centre, such as [25 mm, 25 mm].
        pub centre: Position [-FARTHEST..=FARTHEST],
        /// Its inner and outer radius, such as [2 mm, 6 mm].
        pub radii: [Length; 2] [RADII],
    }
    check(check_ring)
}

parameters! {
    /// A closed curve.
    pub struct Curve as "`path`" {
        /// Where it begins. A line closes it if its end is elsewhere.
        pub from: Position [-FARTHEST..=FARTHEST],
        /// Its pieces in order.
        pub to: Vec<Step> [((), 1..=MOST_CORNERS)],
    }
    check(check_curve)
}

parameters! {
    /// A piece of a curve: one of these.
    pub struct Step as "a piece of `path`" {
        /// A line to its end.
        pub line: Option<Position> [-FARTHEST..=FARTHEST],
        /// An arc of a circle: a point on it, and its end.
        pub arc: Option<[Position; 2]> [-FARTHEST..=FARTHEST],
        /// A cubic Bézier curve: two control points, and its end.
        pub cubic: Option<Vec<Position>> [(-FARTHEST..=FARTHEST, 3..=3)],
    }
    rules(one_step)
    check(check_step)
}

fn one_step(fields: Fields) -> Fields {
    fields.exactly_one(&Step::keys())
}

fn check_step(_: &Step, map: &Map<'_>) -> Result<(), InputError> {
    match map.entries().len() {
        1 => Ok(()),
        _ => Err(map
            .error("a piece of `path` must have one of `line`, `arc` and `cubic`")
            .help("for example { line: [5 mm, 0 mm] } or { arc: [[6 mm, 1 mm], [5 mm, 2 mm]] }")),
    }
}

fn check_ring(ring: &Ring, map: &Map<'_>) -> Result<(), InputError> {
    let [inner, outer] = ring.radii;
    match inner.value() < outer.value() {
        true => Ok(()),
        false => Err(map
            .required(Ring::WHAT, "radii")?
            .error(format!(
                "`radii`: the inner radius {inner} is not smaller than the outer radius {outer}"
            ))
            .help("for example [2 mm, 6 mm]")),
    }
}

/// Checks that no arc is a line.
fn check_curve(curve: &Curve, map: &Map<'_>) -> Result<(), InputError> {
    let nodes = map.required(Curve::WHAT, "to")?.list("to")?;
    let steps = curve.steps();
    match steps.iter().zip(nodes).find(|(piece, _)| piece.is_none()) {
        Some((_, node)) => {
            let why = "the start of the arc, the point on it and its end lie on a line";
            Err(node.error(why).help("use `line`, or two arcs for a full circle"))
        }
        None => Ok(()),
    }
}

impl Curve {
    /// Returns the pieces; `None` for an arc that is a line.
    fn steps(&self) -> Vec<Option<Piece>> {
        let mut start = in_mm(&self.from);
        let piece = |step: &Step| {
            let (piece, end) = match (&step.line, &step.arc, step.cubic.as_deref()) {
                (Some(end), ..) => (Some(Piece::Line(in_mm(end))), in_mm(end)),
                (_, Some(points), _) => {
                    let [through, end] = points.each_ref().map(in_mm);
                    (Arc::through(start, through, end).map(Piece::Arc), end)
                }
                (.., Some([one, other, end])) => (Some(Piece::Cubic([one, other, end].map(in_mm))), in_mm(end)),
                // Not after reading.
                _ => (Some(Piece::Line(start)), start),
            };
            start = end;
            piece
        };
        self.to.iter().map(piece).collect()
    }

    fn contour(&self) -> Contour {
        Contour {
            start: in_mm(&self.from),
            pieces: self.steps().into_iter().flatten().collect(),
        }
    }
}

pub(super) fn in_mm(position: &Position) -> [f64; 2] {
    position.each_ref().map(|c| c.value())
}

/// A rectangle: two opposite corners, and its angle and the radius of its corners where they are not 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rectangle {
    corners: [Position; 2],
    angle: Option<Angle>,
    corner: Option<Length>,
}

parameters! {
    /// A rectangle that is turned about its centre, or has round corners.
    struct TurnedRectangle as "`rectangle`" {
        /// Two opposite corners before it is turned, such as [[0 mm, 0 mm], [5 mm, 5 mm]].
        corners: [Position; 2] [-FARTHEST..=FARTHEST],
        /// The angle by which it is turned about its centre, anticlockwise.
        angle: Option<Angle> [TURNS],
        /// The radius of its corners.
        corner: Option<Length> [0.0..=FARTHEST],
    }
    check(check_rectangle)
}

fn check_rectangle(rectangle: &TurnedRectangle, map: &Map<'_>) -> Result<(), InputError> {
    let [[a, b], [c, d]] = rectangle.corners.each_ref().map(in_mm);
    let most = (c - a).abs().min((d - b).abs()) / 2.0;
    match &rectangle.corner {
        Some(corner) if corner.value() > most * (1.0 + 1e-12) => Err(map
            .required(TurnedRectangle::WHAT, "corner")?
            .error(format!("`corner` is {corner}, more than half of the shorter side"))
            .help(format!("allowed: 0 mm to {most} mm"))),
        _ => Ok(()),
    }
}

impl Parameter for Rectangle {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        if !matches!(node.value(), NodeValue::Map(_)) {
            let corners = <[Position; 2]>::read(node, key, &(-FARTHEST..=FARTHEST))?;
            return Ok(Self {
                corners,
                angle: None,
                corner: None,
            });
        }
        let TurnedRectangle { corners, angle, corner } = TurnedRectangle::read_with(node, &[])?;
        Ok(Self {
            corners,
            angle: angle.filter(|angle| angle.value() != 0.0),
            corner: corner.filter(|radius| radius.value() != 0.0),
        })
    }

    fn canonical(&self) -> Option<Canonical> {
        let Self { corners, angle, corner } = *self;
        match (angle, corner) {
            (None, None) => corners.canonical(),
            _ => Some(TurnedRectangle { corners, angle, corner }.to_canonical()),
        }
    }

    fn schema((): &()) -> Schema {
        let corners = <[Position; 2]>::schema(&(-FARTHEST..=FARTHEST));
        Schema::any_of([corners, TurnedRectangle::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Rectangle {
    fn region(&self) -> Region {
        let corners = self.corners.each_ref().map(in_mm);
        if self.angle.is_none() && self.corner.is_none() {
            return Region::Rectangle(corners);
        }
        let [one, other] = corners;
        Region::Rounded {
            centre: [0, 1].map(|axis| (one[axis] + other[axis]) / 2.0),
            half: [0, 1].map(|axis| (other[axis] - one[axis]).abs() / 2.0),
            angle: self.angle.map_or(0.0, |angle| angle.value().to_radians()),
            radius: self.corner.map_or(0.0, |radius| radius.value()),
        }
    }
}

/// Shapes that are combined.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shapes(Vec<Shape>);

/// The number of shapes that can be combined.
const COMBINED: RangeInclusive<usize> = 1..=1000;

impl Parameter for Shapes {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        Vec::read(node, key, &((), COMBINED)).map(Self)
    }

    fn canonical(&self) -> Option<Canonical> {
        self.0.canonical()
    }

    fn schema((): &()) -> Schema {
        Vec::<Shape>::schema(&((), COMBINED))
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Shapes {
    /// Returns the covered region of each.
    #[must_use]
    pub fn regions(&self) -> Vec<Region> {
        self.0.iter().map(Shape::region).collect()
    }

    /// Returns what was ignored or assumed in the files of drawings.
    fn notes(&self) -> Vec<String> {
        self.0.iter().flat_map(Shape::notes).collect()
    }
}

/// The cells of a mask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cells(pub Bits);

parameters! {
    /// The cells in run-length encoding, as in artifacts.
    struct Runs as "`mask`" {
        /// Columns of the membrane.
        columns: usize [1..=Raster::MOST as u64],
        /// Rows of the membrane.
        rows: usize [1..=Raster::MOST as u64],
        /// Lengths of the runs of cells, row by row from below: outside, inside, outside, and so on.
        runs: Vec<usize> [(0..=MOST_CELLS as u64, 1..=MOST_CELLS)],
    }
}

const MOST_CELLS: usize = Raster::MOST * Raster::MOST;

impl Parameter for Cells {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        if matches!(node.value(), NodeValue::Map(_)) {
            let Runs { columns, rows, runs } = Runs::read_with(node, &[])?;
            let raster = Raster::new(columns, rows);
            let cells = raster.and_then(|raster| Bits::from_runs(raster, &runs));
            return cells.map(Self).ok_or_else(|| {
                node.error(format!(
                    "the runs of the mask do not add up to {columns} × {rows} cells"
                ))
            });
        }
        let name = Path::new(node.text(key)?);
        let folder = node.file().parent().unwrap_or(Path::new(""));
        let refused = |why: &str| node.error(format!("the mask {}: {why}", folder.join(name).display()));
        let found = confined(folder, name).map_err(|why| refused(&why.to_string()).help(why.help()))?;
        if DrawingFormat::of(&found).is_some() {
            let help = format!("name it as a drawing: {{ file: {} }}", name.display());
            return Err(refused("a drawing has no cells").help(help));
        }
        match read_mask(&found) {
            Ok(pattern) => Ok(Self(Bits::of(&pattern))),
            Err(refusal) => {
                let error = refused(&refusal.to_string());
                Err(match refusal.own_advice() {
                    Some(help) => error.help(help),
                    None => error.help("a mask needs one value for each cell: 0 outside, 1 inside"),
                })
            }
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        let [columns, rows] = self.0.sides();
        let runs = self.0.runs();
        Some(Runs { columns, rows, runs }.to_canonical())
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Schema::text(), Runs::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

parameters! {
    /// A part of the membrane: one of these, or what is left of it `without` others.
    pub struct Shape as "a shape" {
        /// Two opposite corners, such as [[0 mm, 0 mm], [5 mm, 5 mm]]; or { corners, angle, corner }.
        pub rectangle: Option<Rectangle>,
        /// Its centre and radius.
        pub disc: Option<Circle>,
        /// Its centre, semiaxes and angle.
        pub ellipse: Option<Ellipse>,
        /// Its centre, inner and outer radius.
        pub ring: Option<Ring>,
        /// Its corners in order, such as [[0 mm, 0 mm], [5 mm, 0 mm], [0 mm, 5 mm]].
        pub polygon: Option<Vec<Position>> [(-FARTHEST..=FARTHEST, 3..=MOST_CORNERS)],
        /// A closed curve of lines, arcs and cubics.
        pub path: Option<Curve>,
        /// FILE.npy, FILE.csv or a picture (.png, .jpg, .tif, .bmp) in the folder of the scene, with a value for each
        /// cell of the membrane: 1 or a dark pixel inside.
        pub mask: Option<Cells>,
        /// What is in any of these shapes.
        pub union: Option<Shapes>,
        /// What is in all of these shapes.
        pub intersect: Option<Shapes>,
        /// What is left out of it: shapes.
        pub without: Option<Shapes>,
    }
    include {
        /// What a drawing fills.
        pub drawing: Drawing,
    }
    rules(one_of)
    check(check)
    shared("shape")
}

/// The keys of which a shape has one.
fn kinds() -> Vec<&'static str> {
    let others = [Placement::keys(), vec!["without"]].concat();
    let keys = Shape::keys().into_iter();
    keys.filter(|key| !others.contains(key)).collect()
}

fn one_of(fields: Fields) -> Fields {
    fields.exactly_one(&kinds())
}

fn check(_: &Shape, map: &Map<'_>) -> Result<(), InputError> {
    let given = kinds().into_iter().filter(|key| map.optional(key).is_some());
    match given.count() {
        1 => Ok(()),
        _ => Err(map
            .error(format!("a shape must have one of `{}`", kinds().join("`, `")))
            .help(
                "for example { rectangle: [[0 mm, 0 mm], [5 mm, 5 mm]] }, { disc: { centre: [25 mm, 25 mm], \
                 radius: 3 mm } }, { polygon: [[0 mm, 0 mm], [5 mm, 0 mm], [0 mm, 5 mm]] } or { mask: shape.png }",
            )),
    }
}

impl Shape {
    /// Returns the covered region in mm.
    #[must_use]
    pub fn region(&self) -> Region {
        match &self.without {
            Some(without) => Region::Without(Box::new(self.whole()), without.regions()),
            None => self.whole(),
        }
    }

    /// Returns what was ignored or assumed in the files of drawings, each after the name of the file.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let combined = [&self.union, &self.intersect, &self.without].into_iter().flatten();
        let own = self.drawing.notes().into_iter();
        own.chain(combined.flat_map(Shapes::notes)).collect()
    }

    /// Returns the region with what is left out of it.
    fn whole(&self) -> Region {
        if let Some(drawn) = self.drawing.region() {
            return drawn;
        }
        if let Some(rectangle) = &self.rectangle {
            return rectangle.region();
        }
        if let Some(disc) = &self.disc {
            return Region::Disc {
                centre: in_mm(&disc.centre),
                radius: disc.radius.value(),
            };
        }
        if let Some(ellipse) = &self.ellipse {
            return Region::Ellipse {
                centre: in_mm(&ellipse.centre),
                semiaxes: ellipse.semiaxes.map(|semiaxis| semiaxis.value()),
                angle: ellipse.angle.map_or(0.0, |angle| angle.value().to_radians()),
            };
        }
        if let Some(ring) = &self.ring {
            return Region::Ring {
                centre: in_mm(&ring.centre),
                radii: ring.radii.map(|radius| radius.value()),
            };
        }
        if let Some(path) = &self.path {
            return Region::Contours(Contours::one(path.contour()));
        }
        if let Some(union) = &self.union {
            return Region::Union(union.regions());
        }
        if let Some(intersect) = &self.intersect {
            return Region::Intersection(intersect.regions());
        }
        match &self.mask {
            Some(mask) => Region::Cells(mask.0.clone()),
            None => Region::Polygon(self.polygon.iter().flatten().map(in_mm).collect()),
        }
    }
}
