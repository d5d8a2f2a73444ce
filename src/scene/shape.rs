//! Shapes of parts of a membrane.

use std::path::Path;

use deaflow_base::{
    Canonical, Declared, Fields, InputError, Length, Map, Node, NodeValue, Parameter, Schema, confined, parameters,
};
use deaflow_pattern::{Bits, Raster, Region, read_mask};

/// The largest coordinate in mm.
const FARTHEST: f64 = 1e4;

/// The smallest and largest radius in mm.
const RADII: std::ops::RangeInclusive<f64> = 1e-6..=1e4;

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

/// Returns the files of all masks and voltage tables below a node, as named in the document.
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

parameters! {
    /// A part of the membrane: one of these.
    pub struct Shape as "a shape" {
        /// Two opposite corners, such as [[0 mm, 0 mm], [5 mm, 5 mm]].
        pub rectangle: Option<[Position; 2]> [-FARTHEST..=FARTHEST],
        /// Its centre and radius.
        pub disc: Option<Circle>,
        /// Its corners in order, such as [[0 mm, 0 mm], [5 mm, 0 mm], [0 mm, 5 mm]].
        pub polygon: Option<Vec<Position>> [(-FARTHEST..=FARTHEST, 3..=MOST_CORNERS)],
        /// FILE.npy, FILE.csv or FILE.png in the folder of the scene, with a value for each cell of the membrane: 1 or
        /// a dark pixel inside.
        pub mask: Option<Cells>,
    }
    rules(one_of)
    check(check)
}

fn one_of(fields: Fields) -> Fields {
    fields.exactly_one(&Shape::keys())
}

fn check(_: &Shape, map: &Map<'_>) -> Result<(), InputError> {
    match Shape::keys()
        .into_iter()
        .filter(|key| map.optional(key).is_some())
        .count()
    {
        1 => Ok(()),
        _ => Err(map
            .error("a shape must have one of `rectangle`, `disc`, `polygon` and `mask`")
            .help(
                "for example { rectangle: [[0 mm, 0 mm], [5 mm, 5 mm]] }, { disc: { centre: [25 mm, 25 mm], \
                 radius: 3 mm } }, { polygon: [[0 mm, 0 mm], [5 mm, 0 mm], [0 mm, 5 mm]] } or { mask: shape.png }",
            )),
    }
}

impl Shape {
    /// Returns the raster of a mask; `None` for other shapes.
    #[must_use]
    pub fn raster(&self) -> Option<Raster> {
        self.mask.as_ref().map(|mask| mask.0.raster())
    }

    /// Returns the covered region in mm.
    #[must_use]
    pub fn region(&self) -> Region {
        let in_mm = |position: &Position| position.each_ref().map(|c| c.value());
        if let Some(rectangle) = &self.rectangle {
            return Region::Rectangle(rectangle.each_ref().map(in_mm));
        }
        if let Some(disc) = &self.disc {
            return Region::Disc {
                centre: in_mm(&disc.centre),
                radius: disc.radius.value(),
            };
        }
        match &self.mask {
            Some(mask) => Region::Cells(mask.0.clone()),
            None => Region::Polygon(self.polygon.iter().flatten().map(in_mm).collect()),
        }
    }
}
