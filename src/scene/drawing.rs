//! Shapes that are drawn by CAD programs or programs for vector graphics.
//!
//! The scene keeps what is drawn and not the name of the file: contours of lines, arcs and cubics, where they lie on
//! the membrane. Numbers are kept with all digits of doubles, so that a scene that is read again has the same shapes to
//! the bit.

use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc as Shared;

use deaflow_base::{
    Angle, Canonical, Decimal, Declared, Fields, InputError, Length, Map, Node, NodeValue, Parameter, Schema, confined,
    parameters, words,
};
use deaflow_pattern::{
    Arc, Contour, Contours, DrawingFormat, DrawingOptions, DrawingUnit, FillRule, PictureFormat, Piece, Region,
    read_shape,
};
use serde_json::json;

use super::shape::{FARTHEST, Position, in_mm};

/// The key of the file of a drawing.
const FILE: &str = "file";

/// The key of what is drawn.
const CONTOURS: &str = "contours";

/// The largest coordinate in mm at which the origin of a drawing may be placed.
const FARTHEST_ORIGIN: f64 = 1e9;

/// The factors by which a drawing may be enlarged.
const SCALES: RangeInclusive<f64> = 1e-6..=1e6;

/// The largest distance in mm between ends that are joined.
const JOINS: RangeInclusive<f64> = 1e-9..=10.0;

/// The parameters of arcs in rad.
const RADIANS: RangeInclusive<f64> = -1e3..=1e3;

/// The largest number of lines, arcs and cubics of a drawing: scenes are stored with them.
const MOST_PIECES: usize = 10_000;

/// A text, such as the name of a layer or a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Text(pub String);

impl Parameter for Text {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        node.text(key).map(|text| Self(text.to_owned()))
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(Canonical::from(self.0.as_str()))
    }

    fn schema((): &()) -> Schema {
        Schema::text()
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

parameters! {
    /// What is read of a drawing, and where it lies on the membrane.
    pub struct Placement as "a drawing" {
        /// The layer that is read; without it the only one with curves in DXF, and all in SVG; of electrodes layers
        /// named ELECTRODE, if there are any.
        pub layer: Option<Text>,
        /// The unit of its lengths; without it the unit that the file states.
        pub unit: Option<DrawingUnit>,
        /// Where the origin of the drawing lies on the membrane. That of SVG is the lower left corner of the page.
        pub origin: Option<Position> [-FARTHEST_ORIGIN..=FARTHEST_ORIGIN],
        /// The factor by which it is enlarged about its origin.
        pub scale: Option<Decimal> [SCALES],
        /// The angle by which it is turned about its origin, anticlockwise.
        pub angle: Option<Angle> [-360.0..=360.0],
        /// The largest distance between ends of curves that are joined; 1 um if it is not given.
        pub join: Option<Length> [JOINS],
    }
}

impl Placement {
    /// Returns the options of the reader of drawings.
    #[must_use]
    pub fn options(&self) -> DrawingOptions {
        let usual = DrawingOptions::default();
        DrawingOptions {
            layers: self.layer.iter().map(|layer| layer.0.clone()).collect(),
            unit_mm: self.unit.map(DrawingUnit::mm),
            origin_mm: self.origin.map_or(usual.origin_mm, |origin| in_mm(&origin)),
            scale: self.scale.map_or(usual.scale, Decimal::to_f64),
            degrees: self.angle.map_or(usual.degrees, |angle| angle.value()),
            join_mm: self.join.map_or(usual.join_mm, |join| join.value()),
            ..usual
        }
    }
}

words! {
    /// What of overlapping curves is filled.
    enum Rule {
        /// What an odd number of curves contains.
        EvenOdd = "even-odd",
        /// What the curves run around, both directions not cancelling.
        NonZero = "nonzero",
    }
}

parameters! {
    /// An area of a drawing.
    struct Area as "an area of `contours`" {
        /// What of overlapping curves is filled: what an odd number of them contains, or all that they run around.
        rule: Rule,
        /// The closed curves.
        curves: Vec<Closed> [((), 1..=MOST_PIECES)],
    }
}

parameters! {
    /// A closed curve of a drawing.
    struct Closed as "a curve of `contours`" {
        /// Where it begins.
        from: Position [-FARTHEST..=FARTHEST],
        /// Its pieces in order.
        to: Vec<Stretch> [((), 1..=MOST_PIECES)],
    }
}

parameters! {
    /// A piece of a curve of a drawing: one of these.
    struct Stretch as "a piece of a curve" {
        /// A line to its end.
        line: Option<Position> [-FARTHEST..=FARTHEST],
        /// An arc of an ellipse.
        arc: Option<EllipticArc>,
        /// A cubic Bézier curve: two control points, and its end.
        cubic: Option<Vec<Position>> [(-FARTHEST..=FARTHEST, 3..=3)],
    }
    rules(one_stretch)
    check(check_stretch)
}

parameters! {
    /// An arc of an ellipse: the points centre + cos t · first axis + sin t · second axis.
    struct EllipticArc as "an arc" {
        /// The centre of the ellipse.
        centre: Position [-FARTHEST..=FARTHEST],
        /// Two conjugate semiaxes.
        axes: [Position; 2] [-FARTHEST..=FARTHEST],
        /// The t of its start in rad.
        start: Decimal [RADIANS],
        /// The change of t to its end in rad.
        sweep: Decimal [RADIANS],
    }
}

fn one_stretch(fields: Fields) -> Fields {
    fields.exactly_one(&Stretch::keys())
}

fn check_stretch(_: &Stretch, map: &Map<'_>) -> Result<(), InputError> {
    match map.entries().len() {
        1 => Ok(()),
        _ => Err(map.error("a piece of a curve must have one of `line`, `arc` and `cubic`")),
    }
}

/// The number closest to a double; a number that is none is refused before.
fn number(value: f64) -> Option<Decimal> {
    Decimal::from_f64(value).filter(|_| RADIANS.contains(&value))
}

fn position(point: [f64; 2]) -> Option<Position> {
    let [x, y] = point.map(|at| Length::from_f64(at).filter(|_| at.abs() <= FARTHEST));
    Some([x?, y?])
}

impl Stretch {
    /// Returns a piece; `None` if it reaches too far.
    fn of(piece: &Piece) -> Option<Self> {
        let (mut line, mut arc, mut cubic) = (None, None, None);
        match piece {
            Piece::Line(end) => line = Some(position(*end)?),
            Piece::Arc(own) => {
                let [one, other] = own.axes.map(position);
                arc = Some(EllipticArc {
                    centre: position(own.centre)?,
                    axes: [one?, other?],
                    start: number(own.from)?,
                    sweep: number(own.sweep)?,
                });
            }
            Piece::Cubic(points) => cubic = Some(points.iter().map(|point| position(*point)).collect::<Option<_>>()?),
        }
        Some(Self { line, arc, cubic })
    }

    fn piece(&self) -> Option<Piece> {
        match (&self.line, &self.arc, self.cubic.as_deref()) {
            (Some(end), ..) => Some(Piece::Line(in_mm(end))),
            (_, Some(arc), _) => Some(Piece::Arc(Arc {
                centre: in_mm(&arc.centre),
                axes: arc.axes.each_ref().map(in_mm),
                from: arc.start.to_f64(),
                sweep: arc.sweep.to_f64(),
            })),
            (.., Some([one, other, end])) => Some(Piece::Cubic([one, other, end].map(in_mm))),
            // Not after reading.
            _ => None,
        }
    }
}

impl Area {
    /// Returns an area; `None` if it reaches too far.
    fn of(contours: &Contours) -> Option<Self> {
        let closed = |contour: &Contour| {
            Some(Closed {
                from: position(contour.start)?,
                to: contour.pieces.iter().map(Stretch::of).collect::<Option<_>>()?,
            })
        };
        Some(Self {
            rule: match contours.rule {
                FillRule::EvenOdd => Rule::EvenOdd,
                FillRule::NonZero => Rule::NonZero,
            },
            curves: contours.contours.iter().map(closed).collect::<Option<_>>()?,
        })
    }

    fn contours(&self) -> Contours {
        let contour = |closed: &Closed| Contour {
            start: in_mm(&closed.from),
            pieces: closed.to.iter().filter_map(Stretch::piece).collect(),
        };
        Contours {
            contours: self.curves.iter().map(contour).collect(),
            rule: match self.rule {
                Rule::EvenOdd => FillRule::EvenOdd,
                Rule::NonZero => FillRule::NonZero,
            },
        }
    }

    fn pieces(&self) -> usize {
        self.curves.iter().map(|curve| curve.to.len()).sum()
    }
}

/// What a drawing fills.
#[derive(Debug)]
struct Filled {
    areas: Vec<Area>,
    /// The same in mm, since conversions of numbers take time.
    region: Region,
    /// What was ignored or assumed in the file.
    notes: Vec<String>,
}

impl Filled {
    fn new(areas: Vec<Area>, notes: Vec<String>) -> Self {
        let each = areas.iter().map(|area| Region::Contours(area.contours()));
        Self {
            region: Region::Union(each.collect()),
            areas,
            notes,
        }
    }
}

/// A drawing as a shape, if there is one: `file` with the keys of its placement, or the `contours` that were read.
#[derive(Clone, Debug)]
pub struct Drawing(Option<Shared<Filled>>);

impl PartialEq for Drawing {
    fn eq(&self, other: &Self) -> bool {
        let areas = |drawing: &Self| drawing.0.clone();
        match (areas(self), areas(other)) {
            (Some(one), Some(other)) => one.areas == other.areas,
            (one, other) => one.is_none() && other.is_none(),
        }
    }
}

impl Eq for Drawing {}

impl Drawing {
    /// The keys of which a shape that is drawn has one.
    pub const KINDS: [&'static str; 2] = [FILE, CONTOURS];

    /// Returns the covered region in mm, if there is a drawing.
    pub fn region(&self) -> Option<Region> {
        self.0.as_ref().map(|filled| filled.region.clone())
    }

    /// Returns what was ignored or assumed in the file, each after its name.
    pub fn notes(&self) -> Vec<String> {
        self.0.iter().flat_map(|filled| filled.notes.clone()).collect()
    }
}

impl Declared for Drawing {
    const WHAT: &'static str = "a shape";

    fn keys() -> Vec<&'static str> {
        [Self::KINDS.to_vec(), Placement::keys()].concat()
    }

    fn add_to(fields: Fields) -> Fields {
        let file = "FILE.dxf or FILE.svg in the folder of the scene or below: what its closed curves fill.";
        let contours = "What a drawing fills, as scenes in artifacts have it.";
        let areas = Vec::<Area>::schema(&((), 1..=MOST_PIECES));
        let fields = fields
            .optional(FILE, Schema::text().description(file))
            .optional(CONTOURS, areas.description(contours));
        let placed: Vec<_> = Placement::keys()
            .into_iter()
            .map(|key| json!({ "required": [key] }))
            .collect();
        Placement::add_to(fields).rule(json!({ "anyOf": [{ "required": [FILE] }, { "not": { "anyOf": placed } }] }))
    }

    fn fields() -> Fields {
        Self::add_to(Fields::new("A drawing."))
    }

    fn read_map(map: &Map<'_>) -> Result<Self, InputError> {
        let placed = || {
            Placement::keys()
                .into_iter()
                .find_map(|key| Some((key, map.optional(key)?)))
        };
        let filled = match (map.optional(FILE), map.optional(CONTOURS), placed()) {
            (Some(node), _, _) => Some(read(node, &Placement::read_map(map)?)?),
            (None, _, Some((key, node))) => {
                return Err(node
                    .error(format!("`{key}` is a key of drawings, but there is no `{FILE}`"))
                    .help("remove it, or name a drawing, as in { file: frame.dxf, layer: FRAME }"));
            }
            (None, Some(node), None) => {
                let areas = Vec::<Area>::read(node, CONTOURS, &((), 1..=MOST_PIECES))?;
                check_pieces(&areas).map_err(|why| node.error(why).help(SIMPLIFY))?;
                Some(Filled::new(areas, Vec::new()))
            }
            (None, None, None) => None,
        };
        Ok(Self(filled.map(Shared::new)))
    }

    fn entries(&self, out: &mut Vec<(&'static str, Canonical)>) {
        let areas = self.0.as_ref().and_then(|filled| filled.areas.canonical());
        out.extend(areas.map(|areas| (CONTOURS, areas)));
    }
}

const SIMPLIFY: &str = "draw arcs as arcs and not as many lines, and name the layer that is needed";

fn check_pieces(areas: &[Area]) -> Result<(), String> {
    match areas.iter().map(Area::pieces).sum::<usize>() {
        pieces if pieces > MOST_PIECES => Err(format!(
            "the drawing has {pieces} lines, arcs and cubics; a shape can have {MOST_PIECES}"
        )),
        _ => Ok(()),
    }
}

/// Reads the drawing that a node names.
fn read(node: &Node, placement: &Placement) -> Result<Filled, InputError> {
    if !matches!(node.value(), NodeValue::Text(_) | NodeValue::Number(_)) {
        return Err(node
            .error(format!("`{FILE}` must be the name of a file, found {}", node.found()))
            .help("allowed: .dxf and .svg"));
    }
    let name = node.text(FILE)?;
    let folder = node.file().parent().unwrap_or(Path::new(""));
    let layer = placement.layer.iter().map(|layer| format!(", layer {}", layer.0));
    let what = format!(
        "the drawing {}{}",
        folder.join(name).display(),
        layer.collect::<String>()
    );
    let refused = |why: &str, help: &str| match help {
        "" => node.error(format!("{what}: {why}")),
        help => node.error(format!("{what}: {why}")).help(help),
    };
    let path = confined(folder, Path::new(name)).map_err(|why| refused(&why.to_string(), why.help()))?;
    let Some(format) = DrawingFormat::of(&path) else {
        return Err(match PictureFormat::of(&path) {
            Some(_) => refused(
                "a picture has no curves",
                "name it as `mask`: a picture with a pixel for each cell of the membrane; or draw the shape in .dxf or \
                 .svg",
            ),
            None => refused("not a drawing", "allowed: .dxf and .svg"),
        });
    };
    let drawn = read_shape(&path, format, &placement.options());
    let drawn = drawn.map_err(|refusal| refused(&refusal.to_string(), refusal.own_advice().unwrap_or_default()))?;
    let areas: Option<Vec<Area>> = drawn.filled.iter().map(Area::of).collect();
    let areas = areas.ok_or_else(|| {
        refused(
            &format!("it reaches further than {FARTHEST} mm from the lower left corner of the membrane"),
            "check its unit, or move it by `origin`: where the origin of the drawing lies on the membrane",
        )
    })?;
    check_pieces(&areas).map_err(|why| refused(&why, SIMPLIFY))?;
    let notes = drawn.notes.iter().map(|note| format!("{name}: {note}"));
    Ok(Filled::new(areas, notes.collect()))
}

#[cfg(test)]
mod tests;
