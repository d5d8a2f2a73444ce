//! The membrane of a scene: its sides, cells, thickness and prestretch.

use std::ops::RangeInclusive;
use std::sync::Arc;

use serde_json::json;

use super::model::{SECTIONS, WHAT};
use super::shape::Shape;
use deaflow_base::{
    Canonical, Decimal, Declared, Fields, Force, InputError, Length, Map, Node, NodeValue, Parameter, Schema,
    SpringRate, parameters,
};
use deaflow_pattern::{Bits, Membrane, Part, Parts, PartsError, PatternForm, Raster};

/// A value along x and one along y; as one where they are equal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Both<T>(pub [T; 2]);

impl<T: Parameter + Clone + PartialEq> Parameter for Both<T> {
    type Limits = T::Limits;
    type Literal = T::Literal;

    fn read(node: &Node, key: &str, limits: &T::Limits) -> Result<Self, InputError> {
        match node.value() {
            NodeValue::List(_) => <[T; 2]>::read(node, key, limits).map(Self),
            _ => T::read(node, key, limits).map(|value| Self([value.clone(), value])),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match &self.0 {
            [x, y] if x == y => x.canonical(),
            both => both.canonical(),
        }
    }

    fn schema(limits: &T::Limits) -> Schema {
        Schema::any_of([T::schema(limits), <[T; 2]>::schema(limits)])
    }

    fn literal(literal: T::Literal) -> Self {
        let value = T::literal(literal);
        Self([value.clone(), value])
    }
}

parameters! {
    /// The membrane, prestretched and clamped on a rigid frame. What is two values is along x and y.
    pub struct Geometry as "`geometry`" {
        /// Side of a square membrane, prestretched.
        pub side: Option<Length> [SIDES],
        /// Sides of the prestretched membrane, in place of `side`.
        pub size: Option<[Length; 2]> [SIDES],
        /// Undeformed thickness, before prestretch.
        pub thickness: Length [1e-4..=1e3],
        /// Prestretch: one number where it is equibiaxial.
        pub prestretch: Both<Decimal> [PRESTRETCH],
        /// Cells along the sides: one number where they are as many.
        pub cells: Both<usize> [CELLS],
        /// What holds the membrane beside the edge of the rectangle.
        pub frame: Option<Frame>,
        /// Rigid bodies in the membrane, such as end effectors, tips and rotors.
        pub bodies: Option<Vec<Body>> [((), 1..=MOST_BODIES)],
    }
    rules(side_or_size)
    check(check)
}

/// Most rigid bodies.
pub const MOST_BODIES: usize = 64;
/// Most shapes of a frame.
const MOST_HELD: usize = 1000;
/// Largest force in N, and spring rate in N/m.
const STRONGEST: f64 = 1e6;

parameters! {
    /// A rigid frame. A cell belongs to it if its centre lies in it; nothing moves at its corners.
    pub struct Frame as "`frame`" {
        /// Where there is membrane; all else is frame.
        pub opening: Option<Shape>,
        /// Parts of the frame within the opening, such as hubs.
        pub held: Option<Vec<Shape>> [((), 1..=MOST_HELD)],
    }
    rules(opening_or_held)
    check(check_frame)
}

fn opening_or_held(fields: Fields) -> Fields {
    fields.rule(json!({ "anyOf": [{ "required": ["opening"] }, { "required": ["held"] }] }))
}

parameters! {
    /// A rigid body, which moves and turns as a whole: one of the shapes, what pulls it and what draws it back. A cell belongs to it if its
    /// centre lies in it.
    pub struct Body as "a body" {
        /// The force on its centroid, along x and y.
        pub load: Option<[Force; 2]> [-STRONGEST..=STRONGEST],
        /// A spring that draws its centroid back to where it rests.
        pub spring: Option<SpringRate> [0.0..=STRONGEST],
    }
    include {
        /// The cells that it covers.
        pub shape: Shape,
    }
}

impl Body {
    /// The force on its centroid in N.
    #[must_use]
    pub fn load_n(&self) -> [f64; 2] {
        self.load.map_or([0.0; 2], |load| load.map(|force| force.value()))
    }

    /// The rate of its spring in N/m.
    #[must_use]
    pub fn spring_n_per_m(&self) -> f64 {
        self.spring.map_or(0.0, |spring| spring.value())
    }
}

fn check_frame(frame: &Frame, map: &Map<'_>) -> Result<(), InputError> {
    match (&frame.opening, &frame.held) {
        (None, None) => Err(map
            .error("`frame` holds nothing")
            .help("give an `opening`, or what is `held` within the rectangle")),
        _ => Ok(()),
    }
}

fn check(geometry: &Geometry, map: &Map<'_>) -> Result<(), InputError> {
    check_size(geometry, map)?;
    check_masks(geometry, map)?;
    let Err(error) = geometry.read_parts() else {
        return Ok(());
    };
    let body = |number: usize| {
        let bodies = map.optional("bodies").and_then(|node| node.list("bodies").ok());
        bodies.and_then(|bodies| bodies.get(number))
    };
    let node = match error {
        PartsError::NothingFree => map.optional("frame"),
        PartsError::EmptyBody { body: number } | PartsError::BodyAtFrame { body: number, .. } => body(number),
        PartsError::BodiesTouch { bodies, .. } => body(bodies[1]),
    };
    let help = match error {
        PartsError::NothingFree => "a cell is membrane if its centre lies in the opening, and in nothing that is held",
        PartsError::EmptyBody { .. } => "give it at least a cell, or the membrane more cells",
        PartsError::BodyAtFrame { .. } => {
            "leave membrane between bodies and frame; what cannot move belongs to the frame"
        }
        PartsError::BodiesTouch { .. } => "leave membrane between bodies, or make them one",
    };
    let message = error.to_string();
    Err(node
        .map_or_else(|| map.error(&message), |node| node.error(&message))
        .help(help))
}

/// Masks are drawn on the cells of the membrane.
fn check_masks(geometry: &Geometry, map: &Map<'_>) -> Result<(), InputError> {
    let raster = geometry.membrane().raster;
    let check = |shape: &Shape, node: Option<&Node>| match (shape.raster(), node) {
        (Some(other), Some(node)) if other != raster => Err(node
            .error(format!("the mask has {other} cells, and the membrane has {raster}"))
            .help("a mask has one value for each cell of the membrane")),
        _ => Ok(()),
    };
    let frame = map.optional("frame");
    let opening = geometry.frame.as_ref().and_then(|frame| frame.opening.as_ref());
    if let Some(opening) = opening {
        check(opening, frame.and_then(|frame| frame.peek("opening")))?;
    }
    let held = geometry.frame.iter().flat_map(|frame| frame.held.iter().flatten());
    let bodies = geometry.bodies.iter().flatten().map(|body| &body.shape);
    let nodes = |parent: Option<&Node>, key: &str| -> Vec<Node> {
        let list = parent.and_then(|parent| parent.list(key).ok());
        list.unwrap_or_default().to_vec()
    };
    let held_nodes = nodes(frame.and_then(|frame| frame.peek("held")), "held");
    let body_nodes = nodes(map.optional("bodies"), "bodies");
    held.zip(&held_nodes)
        .chain(bodies.zip(&body_nodes))
        .try_for_each(|(shape, node)| check(shape, Some(node)))
}

fn side_or_size(fields: Fields) -> Fields {
    fields.rule(json!({ "oneOf": [{ "required": ["side"] }, { "required": ["size"] }] }))
}

/// What those need to know of a membrane who draw patterns on it or learn from them. Of a scene that is swept it is the same for all values of
/// an axis, unless the axis stands in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// Its cells and its sides; [`Outline::read`] says 1 mm of those of a square, however large it is.
    pub membrane: Membrane,
    /// Prestretch along x and y; [`Outline::read`] says 1 and 1 where it is one number.
    pub prestretch: [f64; 2],
    /// Whether there is a frame beside the edge of the rectangle.
    pub has_frame: bool,
    /// Whether there are rigid bodies.
    pub has_bodies: bool,
    /// How many groups of electrodes there are.
    pub groups: usize,
}

impl Outline {
    /// The outline in the mapping of a scene. All else in it is left alone.
    ///
    /// # Errors
    /// When it has no geometry, or sides or cells cannot be read.
    pub fn read(scene: &Node) -> Result<Self, InputError> {
        let sections = scene.fields(WHAT, &SECTIONS)?;
        let node = sections.required(WHAT, "geometry")?;
        let map = node.fields(Geometry::WHAT, &Geometry::keys())?;
        let Both([columns, rows]) = map.read(Geometry::WHAT, "cells", &CELLS, None)?;
        let size = match map.optional("size") {
            Some(size) => <[Length; 2]>::read(size, "size", &SIDES)?.map(|side| side.value()),
            None => [1.0; 2],
        };
        let prestretch = match map.optional("prestretch") {
            Some(node) if matches!(node.value(), NodeValue::List(_)) => {
                <[Decimal; 2]>::read(node, "prestretch", &PRESTRETCH)?.map(Decimal::to_f64)
            }
            _ => [1.0; 2],
        };
        let size_mm = if size[0] == size[1] { [1.0; 2] } else { size };
        Ok(Self {
            membrane: Membrane {
                raster: Raster::new(columns, rows).expect("cells are in range"),
                size_mm,
            },
            prestretch,
            has_frame: map.optional("frame").is_some(),
            has_bodies: map.optional("bodies").is_some(),
            groups: groups(&sections),
        })
    }

    /// The cells in the mapping of a scene that may carry electrodes; none are told where all of them may.
    ///
    /// # Errors
    /// When the geometry cannot be read.
    pub fn room(scene: &Node) -> Result<Option<Bits>, InputError> {
        let node = scene.fields(WHAT, &SECTIONS)?.required(WHAT, "geometry")?;
        let parts = Geometry::read_with(node, &[])?.parts();
        Ok(parts.map(|parts| parts.free_cells()))
    }

    /// What patterns on it are.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        PatternForm {
            raster: self.membrane.raster,
            groups: self.groups,
        }
    }
}

/// How many groups of electrodes a scene has whose drive, or first state, may be anything yet.
fn groups(scene: &Map<'_>) -> usize {
    let first = || {
        scene
            .optional("states")?
            .entries("`states`")
            .ok()?
            .first()
            .map(|(_, state)| state)
    };
    let voltages = scene
        .optional("drive")
        .or_else(first)
        .and_then(|drive| drive.peek("voltages"));
    voltages
        .and_then(|voltages| voltages.list("voltages").ok())
        .map_or(1, <[Node]>::len)
}

const SIDES: RangeInclusive<f64> = 1e-3..=1e4;
const PRESTRETCH: RangeInclusive<f64> = 1.0..=10.0;
const CELLS: RangeInclusive<u64> = 1..=Raster::MOST as u64;

fn check_size(geometry: &Geometry, map: &Map<'_>) -> Result<(), InputError> {
    match (&geometry.side, &geometry.size) {
        (Some(_), None) | (None, Some(_)) => Ok(()),
        (None, None) => map.required("`geometry`", "side").map(|_| ()),
        (Some(_), Some(_)) => Err(map
            .required("`geometry`", "size")?
            .error("`size` and `side` cannot stand beside each other")
            .help("give `side` of a square membrane, or `size: [along x, along y]`")),
    }
}

impl Geometry {
    /// A square membrane with the raster of the source paper: its side and thickness in mm, and its prestretch.
    ///
    /// # Panics
    /// When a number is not finite.
    #[must_use]
    pub fn square(side: f64, thickness: f64, prestretch: f64) -> Self {
        let finite = "a finite number";
        Self {
            side: Some(Length::from_f64(side).expect(finite)),
            size: None,
            thickness: Length::from_f64(thickness).expect(finite),
            prestretch: Both::literal(prestretch),
            cells: Both(Raster::PAPER.sides()),
            frame: None,
            bodies: None,
        }
    }

    /// The same geometry in the one way of saying it that is canonical: a square has a side.
    #[must_use]
    pub fn normalised(self) -> Self {
        match &self.size {
            Some([x, y]) if x == y => Self {
                side: Some(*x),
                size: None,
                ..self
            },
            _ => self,
        }
    }

    /// Its outline, with its true sides.
    pub(super) fn outline(&self, groups: usize) -> Outline {
        Outline {
            groups,
            membrane: self.membrane(),
            prestretch: self.prestretch.0.each_ref().map(|stretch| stretch.to_f64()),
            has_frame: self.frame.is_some(),
            has_bodies: self.bodies.is_some(),
        }
    }

    /// What patterns are drawn on.
    ///
    /// # Panics
    /// Never: a geometry has been checked.
    #[must_use]
    pub fn membrane(&self) -> Membrane {
        let Both([columns, rows]) = self.cells;
        let size_mm = match (&self.size, &self.side) {
            (Some(size), _) => size.each_ref().map(|side| side.value()),
            (None, side) => [side.as_ref().map_or(0.0, |side| side.value()); 2],
        };
        Membrane {
            raster: Raster::new(columns, rows).expect("cells are in range"),
            size_mm,
        }
    }

    /// Whether a force pulls one of its bodies.
    #[must_use]
    pub fn has_forces(&self) -> bool {
        self.bodies.iter().flatten().any(|body| body.load_n() != [0.0; 2])
    }

    /// What its cells are; nothing where all of them are membrane.
    #[must_use]
    pub fn parts(&self) -> Option<Arc<Parts>> {
        // A geometry has been checked.
        self.read_parts().ok().flatten().map(Arc::new)
    }

    fn read_parts(&self) -> Result<Option<Parts>, PartsError> {
        if self.frame.is_none() && self.bodies.is_none() {
            return Ok(None);
        }
        let membrane = self.membrane();
        let cells = |shape: &Shape| shape.region().cells(membrane);
        let frame = self.frame.as_ref();
        let opening = frame.and_then(|frame| frame.opening.as_ref()).map(cells);
        let held = frame.and_then(|frame| frame.held.as_ref()).into_iter().flatten();
        let held: Vec<Bits> = held.map(cells).collect();
        let bodies: Vec<Bits> = self.bodies.iter().flatten().map(|body| cells(&body.shape)).collect();
        let part = |x: usize, y: usize| {
            let is_frame =
                opening.as_ref().is_some_and(|opening| !opening.has(x, y)) || held.iter().any(|held| held.has(x, y));
            match bodies.iter().position(|body| body.has(x, y)) {
                _ if is_frame => Part::Frame,
                Some(body) => Part::Body(body),
                None => Part::Membrane,
            }
        };
        Parts::new(membrane.raster, bodies.len(), part).map(Some)
    }
}
