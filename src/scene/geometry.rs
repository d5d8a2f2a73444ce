//! The geometry of a scene: sides, cells, thickness and prestretch of the membrane, frame and rigid bodies.

use std::ops::RangeInclusive;
use std::sync::Arc;

use super::components::{Components, Springs, Untilted};
use super::floating::{Floating, LoadedBody};
use super::shape::Shape;
use super::sides::Sides;
use deaflow_base::{
    Canonical, Decimal, Fields, Force, InputError, Length, Map, Node, NodeValue, Parameter, Schema, four_digits,
    parameters, words,
};
use deaflow_pattern::{Bits, Borders, Electrodes, Membrane, Part, Parts, PartsError, Polygons, Raster};

/// A value along x and one along y; equal values are written as one.
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
    /// The membrane, prestretched and clamped on a rigid frame. Two values are along x and y.
    pub struct Geometry as "`geometry`" {
        /// Side of a square membrane, prestretched.
        pub side: Option<Length> [SIDES],
        /// Sides of the prestretched membrane, instead of `side`.
        pub size: Option<[Length; 2]> [SIDES],
        /// Undeformed thickness, before prestretch.
        pub thickness: Length [1e-4..=1e3],
        /// Prestretch; one number if it is equibiaxial.
        pub prestretch: Both<Decimal> [PRESTRETCH],
        /// Cells along the sides; one number if they are equal.
        pub cells: Both<usize> [CELLS],
        /// A rigid frame inside the rectangle.
        pub frame: Option<Frame>,
        /// Rigid bodies in the membrane, such as end effectors, tips and rotors.
        pub bodies: Option<Vec<Body>> [((), 1..=MOST_BODIES)],
        /// How the sides of the membrane are supported; held where not given.
        pub sides: Option<Sides>,
    }
    rules(side_or_size)
    check(check)
}

/// The largest number of rigid bodies.
pub const MOST_BODIES: usize = 64;
/// The largest number of shapes of a frame.
const MOST_HELD: usize = 1000;
/// Share of the membrane by which regions with the same border differ.
const ROUNDING: f64 = 1e-7;
/// The largest force in N and spring rate in N/m.
const STRONGEST: f64 = 1e6;

words! {
    /// What elements follow along the border of a shape.
    pub enum Curves {
        /// The border: nodes move onto it, and cells that it cuts are split.
        Fitted = "fitted",
        /// The sides of cells whose centre lies in the shape.
        Cells = "cells",
    }
}

parameters! {
    /// A rigid frame. A cell belongs to it if its centre lies in it; the corners of its cells do not move.
    pub struct Frame as "`frame`" {
        /// The membrane; all else is frame.
        pub opening: Option<Shape>,
        /// Parts of the frame inside the opening, such as hubs.
        pub held: Option<Vec<Shape>> [((), 1..=MOST_HELD)],
        /// What elements follow: the borders of the shapes, or of cells whose centre lies in them, if not given.
        pub curves: Option<Curves>,
    }
    rules(opening_or_held)
    check(check_frame)
}

fn opening_or_held(fields: Fields) -> Fields {
    fields.at_least_one(&["opening", "held"])
}

parameters! {
    /// A rigid body, which translates and rotates: one of the shapes, with a load and a spring. A cell belongs to it if
    /// its centre lies in it. With three numbers in `load` or `spring`, and under pressure, it moves out of the plane,
    /// too.
    pub struct Body as "a body" {
        /// The force on the centroid along x and y, or along x, y and out of the plane.
        pub load: Option<Components<Force>> [-STRONGEST..=STRONGEST],
        /// A spring between the centroid and its initial position: its rate in all directions, or a rate along x and
        /// along y, and out of the plane.
        pub spring: Option<Springs> [0.0..=STRONGEST],
        /// Whether the body tilts out of the plane.
        pub tilt: Option<Untilted>,
        /// What elements follow: the border of the shape, or of cells whose centre lies in it, if not given.
        pub curves: Option<Curves>,
    }
    include {
        /// The shape of the body.
        pub shape: Shape,
    }
}

impl Frame {
    /// Returns what is not frame.
    fn free(&self, membrane: Membrane) -> Polygons {
        let whole = Polygons::of_membrane(membrane);
        let polygons = |shape: &Shape| shape.region().polygons(membrane);
        let opening = self.opening.as_ref().map(polygons);
        let within = opening.map_or_else(|| whole.clone(), |opening| whole.intersection(&opening));
        let held = self.held.iter().flatten().map(polygons);
        held.fold(within, |free, held| free.without(&held))
    }
}

impl Body {
    /// Returns the force on the centroid along x and y in N.
    #[must_use]
    pub fn load_n(&self) -> [f64; 2] {
        let load = self.load.as_ref().map(Components::in_plane);
        load.map_or([0.0; 2], |load| load.map(|force| force.value()))
    }

    /// Returns the force out of the plane in N.
    #[must_use]
    pub fn lift_n(&self) -> f64 {
        let load = self.load.as_ref().and_then(Components::height);
        load.map_or(0.0, |force| force.value())
    }

    /// Returns the spring rates along x, y and out of the plane in N/m.
    #[must_use]
    pub fn springs_n_per_m(&self) -> [f64; 3] {
        self.spring.as_ref().map_or([0.0; 3], Springs::n_per_m)
    }

    /// Returns the spring rates along x and y in N/m.
    #[must_use]
    pub fn spring_n_per_m(&self) -> [f64; 2] {
        let [x, y, _] = self.springs_n_per_m();
        [x, y]
    }

    /// Returns whether a force or a spring out of the plane is given.
    #[must_use]
    pub fn is_in_space(&self) -> bool {
        let has_lift = self.load.as_ref().is_some_and(|load| load.height().is_some());
        has_lift || self.spring.as_ref().is_some_and(Springs::is_in_space)
    }

    /// Returns the body without forces and springs out of the plane.
    #[must_use]
    pub fn in_plane(&self) -> Self {
        Self {
            load: self.load.as_ref().map(Components::without_height),
            spring: self.spring.as_ref().map(Springs::without_height),
            ..self.clone()
        }
    }
}

fn check_frame(frame: &Frame, map: &Map<'_>) -> Result<(), InputError> {
    match (&frame.opening, &frame.held) {
        (None, None) => Err(map
            .error("`frame` is empty")
            .help("give an `opening`, or parts that are `held`")),
        _ => Ok(()),
    }
}

fn check(geometry: &Geometry, map: &Map<'_>) -> Result<(), InputError> {
    check_size(geometry, map)?;
    check_files(geometry, map)?;
    check_sides(geometry, map)?;
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
        PartsError::NothingFree => {
            "a cell is membrane if its centre lies in `opening` and outside all shapes of `held`"
        }
        PartsError::EmptyBody { .. } => "enlarge it to at least one cell, or increase `cells`",
        PartsError::BodyAtFrame { .. } => {
            "leave membrane between bodies and frame; make an immobile body a part of the frame"
        }
        PartsError::BodiesTouch { .. } => "leave membrane between bodies, or combine them",
    };
    let message = error.to_string();
    Err(node
        .map_or_else(|| map.error(&message), |node| node.error(&message))
        .help(help))
}

/// Checks that no load moves the membrane as a whole.
fn check_sides(geometry: &Geometry, map: &Map<'_>) -> Result<(), InputError> {
    match geometry.find_floating() {
        Err(why) => Err(map.required("`geometry`", "sides")?.error(why).help(
            "let the loads balance, hold a side, put sides on a `roller`, or give a bar a spring or fewer `moves`",
        )),
        Ok(_) => Ok(()),
    }
}

/// Checks that masks have the cells of the membrane, and that drawings reach it.
fn check_files(geometry: &Geometry, map: &Map<'_>) -> Result<(), InputError> {
    let membrane = geometry.membrane();
    let raster = membrane.raster;
    let check = |shape: &Shape, node: Option<&Node>| {
        let Some(node) = node else { return Ok(()) };
        if let Some(other) = shape.region().other_raster(raster) {
            return Err(node
                .error(format!("the mask has {other} cells, but the membrane has {raster}"))
                .help("a mask needs one value for each cell of the membrane"));
        }
        let bounds = shape.drawing.region().and_then(|region| region.bounds());
        match bounds.filter(|[low, high]| !reaches(*low, *high, membrane.size_mm)) {
            Some([low, high]) => {
                let place = |[x, y]: [f64; 2]| format!("({}, {})", four_digits(x), four_digits(y));
                Err(node
                    .error(format!(
                        "nothing of the drawing lies on the membrane of {}: it reaches from {} to {} mm",
                        membrane.size_text(),
                        place(low),
                        place(high)
                    ))
                    .help(
                        "check its unit, or move it by `origin`: where the origin of the drawing lies on the membrane",
                    ))
            }
            None => Ok(()),
        }
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

/// Whether a rectangle overlaps that from (0, 0) to a size.
fn reaches(low: [f64; 2], high: [f64; 2], size: [f64; 2]) -> bool {
    (0..2).all(|axis| low[axis] < size[axis] && high[axis] > 0.0)
}

fn side_or_size(fields: Fields) -> Fields {
    fields.exactly_one(&["side", "size"])
}

pub(super) const SIDES: RangeInclusive<f64> = 1e-3..=1e4;
pub(super) const PRESTRETCH: RangeInclusive<f64> = 1.0..=10.0;
pub(super) const CELLS: RangeInclusive<u64> = 1..=Raster::MOST as u64;

fn check_size(geometry: &Geometry, map: &Map<'_>) -> Result<(), InputError> {
    match (&geometry.side, &geometry.size) {
        (Some(_), None) | (None, Some(_)) => Ok(()),
        (None, None) => map.required("`geometry`", "side").map(|_| ()),
        (Some(_), Some(_)) => Err(map
            .required("`geometry`", "size")?
            .error("`size` and `side` cannot be given together")
            .help("give `side` for a square membrane, or `size: [along x, along y]`")),
    }
}

impl Geometry {
    /// Creates a square membrane with the raster of the source paper from side and thickness in mm and prestretch.
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
            sides: None,
        }
    }

    /// Returns the canonical form, in which a square has `side`, and sides that are held are not given.
    #[must_use]
    pub fn normalised(self) -> Self {
        let sides = self.sides.and_then(Sides::normalised);
        match &self.size {
            Some([x, y]) if x == y => Self {
                side: Some(*x),
                size: None,
                sides,
                ..self
            },
            _ => Self { sides, ..self },
        }
    }

    /// Returns the geometry without the masses of bars.
    #[must_use]
    pub(super) fn without_masses(&self) -> Self {
        Self {
            sides: self.sides.as_ref().map(Sides::without_masses),
            ..self.clone()
        }
    }

    /// Returns whether a body has a force or a spring out of the plane.
    #[must_use]
    pub fn has_bodies_in_space(&self) -> bool {
        self.bodies.iter().flatten().any(Body::is_in_space)
    }

    /// Returns the geometry without forces and springs out of the plane.
    #[must_use]
    pub(super) fn in_plane(&self) -> Self {
        let bodies = self.bodies.as_ref();
        Self {
            bodies: bodies.map(|bodies| bodies.iter().map(Body::in_plane).collect()),
            ..self.clone()
        }
    }

    /// Returns the membrane, on which patterns are drawn.
    ///
    /// # Panics
    /// Never, since the number of cells has been checked.
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

    /// Returns whether the membrane moves without voltage: a force acts on a body, or a side is not held.
    #[must_use]
    pub fn has_forces(&self) -> bool {
        self.sides.is_some() || self.bodies.iter().flatten().any(|body| body.load_n() != [0.0; 2])
    }

    /// Returns the part of the device that each cell belongs to; `None` if all are membrane.
    #[must_use]
    pub fn parts(&self) -> Option<Arc<Parts>> {
        // The geometry has been checked.
        self.read_parts().ok().flatten().map(Arc::new)
    }

    /// Returns the motions of the membrane as a whole that nothing resists.
    #[must_use]
    pub fn floating(&self) -> Floating {
        // The geometry has been checked.
        self.find_floating().unwrap_or_default()
    }

    fn find_floating(&self) -> Result<Floating, &'static str> {
        let (Some(sides), Ok(parts)) = (&self.sides, self.read_parts()) else {
            return Ok(Floating::default());
        };
        if parts.is_some_and(|parts| parts.cells(|part| part == Part::Frame).count() > 0) {
            return Ok(Floating::default());
        }
        let membrane = self.membrane();
        let body = |body: &Body| LoadedBody {
            centroid: body.shape.region().polygons(membrane).centroid().unwrap_or_default(),
            load: body.load_n(),
            is_sprung: body.spring_n_per_m().map(|rate| rate > 0.0),
        };
        let bodies: Vec<LoadedBody> = self.bodies.iter().flatten().map(body).collect();
        Floating::of(sides, membrane.size_mm, &bodies)
    }

    /// Returns what was ignored or assumed in the drawings of frame and bodies, each after the name of the file.
    #[must_use]
    pub fn notes(&self) -> Vec<String> {
        let frame = self.frame.iter();
        let of_frame = frame.flat_map(|frame| frame.opening.iter().chain(frame.held.iter().flatten()));
        let of_bodies = self.bodies.iter().flatten().map(|body| &body.shape);
        of_frame.chain(of_bodies).flat_map(Shape::notes).collect()
    }

    /// Returns whether elements follow the border of a shape.
    #[must_use]
    pub fn has_fitted_curves(&self) -> bool {
        let of_frame = self.frame.iter().filter_map(|frame| frame.curves);
        let of_bodies = self.bodies.iter().flatten().filter_map(|body| body.curves);
        of_frame.chain(of_bodies).any(|curves| curves == Curves::Fitted)
    }

    /// Returns the geometry with elements along the shapes of its frame and bodies, if they follow cells that differ
    /// from these shapes. Masks, and rectangles along the sides of cells, do not differ.
    #[must_use]
    pub fn with_fitted_curves(&self) -> Option<Self> {
        let mut fitted = self.clone();
        if let Some(frame) = &mut fitted.frame {
            frame.curves = Some(Curves::Fitted);
        }
        for body in fitted.bodies.iter_mut().flatten() {
            body.curves = Some(Curves::Fitted);
        }
        let [width, height] = self.membrane().size_mm;
        let rounding = ROUNDING * width * height;
        let regions = |borders: Borders| borders.opening.into_iter().chain(borders.bodies);
        let (own, followed) = (self.borders_of_parts()?, fitted.borders_of_parts()?);
        let mut pairs = regions(own).zip(regions(followed));
        pairs
            .any(|(own, followed)| !own.is_within(rounding, &followed))
            .then_some(fitted)
    }

    /// Returns the borders that elements follow, with drawn electrodes if there are any; `None` if all are those of
    /// cells.
    #[must_use]
    pub fn borders(&self, electrodes: Option<&Electrodes>) -> Option<Arc<Borders>> {
        if !self.has_fitted_curves() && electrodes.is_none() {
            return None;
        }
        let borders = self.borders_of_parts().unwrap_or_default();
        let groups = electrodes.iter().flat_map(|electrodes| electrodes.groups());
        let groups = groups.map(|(group, region)| (*group, borders.on_membrane(region)));
        let electrodes = electrodes.is_some().then(|| groups.collect());
        Some(Arc::new(Borders { electrodes, ..borders }))
    }

    /// Returns the borders of frame and bodies, those of cells included; `None` without frame and bodies.
    fn borders_of_parts(&self) -> Option<Borders> {
        let frame = self.frame.as_ref();
        let (membrane, parts) = (self.membrane(), self.parts()?);
        let of_cells = |part: Part| Polygons::of_cells(&parts.cells(|at| at == part), membrane);
        let opening = frame.map(|frame| match frame.curves {
            None | Some(Curves::Cells) => Polygons::of_membrane(membrane).without(&of_cells(Part::Frame)),
            Some(Curves::Fitted) => frame.free(membrane),
        });
        let bodies = self.bodies.iter().flatten().enumerate();
        let bodies = bodies.map(|(number, body)| match body.curves {
            None | Some(Curves::Cells) => of_cells(Part::Body(number)),
            Some(Curves::Fitted) => body.shape.region().polygons(membrane),
        });
        Some(Borders {
            opening,
            bodies: bodies.collect(),
            electrodes: None,
        })
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
