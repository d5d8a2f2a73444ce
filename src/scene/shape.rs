//! Parts of a membrane as people draw them.

use serde_json::json;

use std::path::Path;

use deaflow_base::{
    Canonical, Declared, Fields, InputError, Length, Map, Node, NodeValue, Parameter, Schema, confined, parameters,
};
use deaflow_pattern::{Bits, Raster, Region, read_mask};

/// Largest coordinate in mm.
const FARTHEST: f64 = 1e4;

/// Smallest and largest radius in mm.
const RADII: std::ops::RangeInclusive<f64> = 1e-6..=1e4;

/// The keys that tell shapes apart.
const KEYS: [&str; 4] = ["rectangle", "disc", "polygon", "mask"];

/// Most corners of a polygon.
const MOST_CORNERS: usize = 10_000;

/// A place on the membrane, from its lower left corner.
pub type Place = [Length; 2];

parameters! {
    /// A rectangle.
    pub struct Rectangle as "a shape" {
        /// Two opposite corners, such as [[0 mm, 0 mm], [5 mm, 5 mm]].
        pub rectangle: [Place; 2] [-FARTHEST..=FARTHEST],
    }
}

parameters! {
    /// A disc.
    pub struct Disc as "a shape" {
        /// Its centre and radius.
        pub disc: Circle,
    }
}

parameters! {
    /// A circle.
    pub struct Circle as "`disc`" {
        /// Its centre, such as [25 mm, 25 mm].
        pub centre: Place [-FARTHEST..=FARTHEST],
        /// Its radius.
        pub radius: Length [RADII],
    }
}

parameters! {
    /// A polygon.
    pub struct Polygon as "a shape" {
        /// Its corners in order, such as [[0 mm, 0 mm], [5 mm, 0 mm], [0 mm, 5 mm]].
        pub polygon: Vec<Place> [(-FARTHEST..=FARTHEST, 3..=MOST_CORNERS)],
    }
}

parameters! {
    /// What is drawn cell by cell.
    pub struct Drawing as "a shape" {
        /// A file beside the scene, FILE.npy, FILE.csv or FILE.png, with a value for each cell of the membrane: 1, or a dark pixel, inside.
        pub mask: Cells,
    }
}

/// The cells of a mask, as its file had them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cells(pub Bits);

parameters! {
    /// The cells themselves, as artifacts say them.
    struct Runs as "`mask`" {
        /// Columns of the membrane.
        columns: usize [1..=Raster::MOST as u64],
        /// Rows of the membrane.
        rows: usize [1..=Raster::MOST as u64],
        /// How many cells follow each other row by row from below that are outside, then inside, then outside, and so on.
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
                    "the runs of the mask are not those of {columns} × {rows} cells"
                ))
            });
        }
        let name = Path::new(node.text(key)?);
        let folder = node.file().parent().unwrap_or(Path::new(""));
        let refused = |why: &str| node.error(format!("the mask {}: {why}", folder.join(name).display()));
        let found = confined(folder, name).map_err(|why| refused(&why.to_string()).help(why.help()))?;
        match read_mask(&found) {
            Ok(pattern) => Ok(Self(Bits::of(&pattern))),
            Err(refusal) => {
                let error = refused(&refusal.to_string());
                Err(match refusal.own_advice() {
                    Some(help) => error.help(help),
                    None => error.help("a mask has one value for each cell: 0 outside, 1 inside"),
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

/// The files of all masks and of tables of voltages that stand in a document below a node, as they are named there.
#[must_use]
pub fn scene_files(node: &Node) -> Vec<String> {
    match node.value() {
        NodeValue::List(items) => items.iter().flat_map(scene_files).collect(),
        NodeValue::Map(entries) => {
            let each = entries.iter().flat_map(|(key, value)| match value.value() {
                NodeValue::Text(file) if key.is_text("mask") || key.is_text("table") => vec![file.clone()],
                _ => scene_files(value),
            });
            each.collect()
        }
        _ => Vec::new(),
    }
}

/// A part of the membrane.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Shape {
    /// `rectangle`.
    Rectangle(Rectangle),
    /// `disc`.
    Disc(Disc),
    /// `polygon`.
    Polygon(Polygon),
    /// `mask`.
    Mask(Drawing),
}

impl Shape {
    /// The raster that it is drawn on, where it is drawn on one.
    #[must_use]
    pub fn raster(&self) -> Option<Raster> {
        match self {
            Self::Mask(Drawing { mask }) => Some(mask.0.raster()),
            Self::Rectangle(_) | Self::Disc(_) | Self::Polygon(_) => None,
        }
    }

    /// What it covers, in mm.
    #[must_use]
    pub fn region(&self) -> Region {
        let place = |place: &Place| place.each_ref().map(|c| c.value());
        match self {
            Self::Rectangle(Rectangle { rectangle }) => Region::Rectangle(rectangle.each_ref().map(place)),
            Self::Disc(Disc { disc }) => Region::Disc {
                centre: place(&disc.centre),
                radius: disc.radius.value(),
            },
            Self::Polygon(Polygon { polygon }) => Region::Polygon(polygon.iter().map(place).collect()),
            Self::Mask(Drawing { mask }) => Region::Cells(mask.0.clone()),
        }
    }
}

/// Exactly one of the keys stands in the mapping.
impl Declared for Shape {
    const WHAT: &'static str = "a shape";

    fn keys() -> Vec<&'static str> {
        KEYS.to_vec()
    }

    fn add_to(fields: Fields) -> Fields {
        fields
            .declare::<Option<[Place; 2]>>("rectangle", "Two opposite corners.", &(-FARTHEST..=FARTHEST), None)
            .declare::<Option<Circle>>("disc", "Its centre and radius.", &(), None)
            .declare::<Option<Vec<Place>>>(
                "polygon",
                "Its corners in order.",
                &(-FARTHEST..=FARTHEST, 3..=MOST_CORNERS),
                None,
            )
            .declare::<Option<Cells>>("mask", "A file with a value for each cell.", &(), None)
            .rule(json!({ "oneOf": KEYS.map(|key| json!({ "required": [key] })) }))
    }

    fn fields() -> Fields {
        Self::add_to(Fields::new("A part of the membrane: one of these."))
    }

    fn read_map(map: &Map<'_>) -> Result<Self, InputError> {
        let is_there = |key: &&str| map.optional(key).is_some();
        match Self::keys().into_iter().filter(is_there).collect::<Vec<_>>()[..] {
            ["rectangle"] => Rectangle::read_map(map).map(Self::Rectangle),
            ["disc"] => Disc::read_map(map).map(Self::Disc),
            ["polygon"] => Polygon::read_map(map).map(Self::Polygon),
            ["mask"] => Drawing::read_map(map).map(Self::Mask),
            _ => Err(map
                .error("a shape is one of a `rectangle`, a `disc`, a `polygon` and a `mask`")
                .help(
                    "for example { rectangle: [[0 mm, 0 mm], [5 mm, 5 mm]] }, { disc: { centre: [25 mm, 25 mm], \
                     radius: 3 mm } }, { polygon: [[0 mm, 0 mm], [5 mm, 0 mm], [0 mm, 5 mm]] } or { mask: shape.png }",
                )),
        }
    }

    fn entries(&self, out: &mut Vec<(&'static str, Canonical)>) {
        match self {
            Self::Rectangle(shape) => shape.entries(out),
            Self::Disc(shape) => shape.entries(out),
            Self::Polygon(shape) => shape.entries(out),
            Self::Mask(shape) => shape.entries(out),
        }
    }
}

impl Parameter for Shape {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, _key: &str, (): &()) -> Result<Self, InputError> {
        let is_there = |key: &&str| node.peek(key).is_some();
        // A shape that is known refuses other keys by its own.
        match KEYS.into_iter().filter(is_there).collect::<Vec<_>>()[..] {
            ["rectangle"] => Rectangle::read_with(node, &[]).map(Self::Rectangle),
            ["disc"] => Disc::read_with(node, &[]).map(Self::Disc),
            ["polygon"] => Polygon::read_with(node, &[]).map(Self::Polygon),
            ["mask"] => Drawing::read_with(node, &[]).map(Self::Mask),
            _ => <Self as Declared>::read_with(node, &[]),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.to_canonical())
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([
            Rectangle::schema(&()),
            Disc::schema(&()),
            Polygon::schema(&()),
            Drawing::schema(&()),
        ])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}
