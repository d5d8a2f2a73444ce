//! Parts of a membrane as people draw them.

use serde_json::json;

use crate::base::{Canonical, Declared, Fields, InputError, Length, Map, Node, Parameter, Schema, parameters};
use crate::pattern::Region;

/// Largest coordinate in mm.
const FARTHEST: f64 = 1e4;

/// Smallest and largest radius in mm.
const RADII: std::ops::RangeInclusive<f64> = 1e-6..=1e4;

/// The keys that tell shapes apart.
const KEYS: [&str; 3] = ["rectangle", "disc", "polygon"];

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

/// A part of the membrane.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Shape {
    /// `rectangle`.
    Rectangle(Rectangle),
    /// `disc`.
    Disc(Disc),
    /// `polygon`.
    Polygon(Polygon),
}

impl Shape {
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
            _ => Err(map
                .error("a shape is one of a `rectangle`, a `disc` and a `polygon`")
                .help(
                    "for example { rectangle: [[0 mm, 0 mm], [5 mm, 5 mm]] }, { disc: { centre: [25 mm, 25 mm], \
                     radius: 3 mm } } or { polygon: [[0 mm, 0 mm], [5 mm, 0 mm], [0 mm, 5 mm]] }",
                )),
        }
    }

    fn entries(&self, out: &mut Vec<(&'static str, Canonical)>) {
        match self {
            Self::Rectangle(shape) => shape.entries(out),
            Self::Disc(shape) => shape.entries(out),
            Self::Polygon(shape) => shape.entries(out),
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
            _ => <Self as Declared>::read_with(node, &[]),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.to_canonical())
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Rectangle::schema(&()), Disc::schema(&()), Polygon::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}
