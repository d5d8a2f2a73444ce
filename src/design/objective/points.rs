//! Points, bodies, bars, regions and forces of sides in an objective in YAML.

use std::ops::RangeInclusive;

use super::aim::{Aim, BodyMarkers, Motion};
use super::error::GoalError;
use super::region::RegionCells;
use crate::text::flow_value;
use deaflow_base::{
    Angle, Canonical, Decimal, Declared, Fields, InputError, Length, Map, Node, Parameter, Schema, Volume, parameters,
};
use deaflow_scene::{Edge, MOST_BODIES, Scene, Shape, States};

/// Largest coordinate and displacement in mm.
pub(super) const MAX_MM: f64 = 1e4;

/// The values of `rotation` for a rotation as far as possible.
pub(super) const ROTATIONS: [&str; 2] = ["clockwise", "counterclockwise"];

/// The values of `area_strain` for an area as large or as small as possible.
pub(super) const AREAS: [&str; 2] = ["smallest", "largest"];

/// The values of `height` for a height as far as possible.
pub(super) const HEIGHTS: [&str; 2] = ["down", "up"];

/// The keys for the motion of a body.
const MOTIONS: [&str; 4] = ["direction", "translation", "rotation", "height"];

parameters! {
    /// A point and its target motion.
    pub(super) struct PointParameters as "a point of the objective" {
        /// Position, such as [25 mm, 25 mm].
        pub(super) point: [Length; 2] [0.0..=MAX_MM],
        /// Direction, counterclockwise from the x axis.
        pub(super) direction: Option<Angle> [-360.0..=360.0],
        /// Target displacement, in place of a direction.
        pub(super) displacement: Option<[Length; 2]> [-MAX_MM..=MAX_MM],
        /// `up` or `down` for a height that changes as far as possible by the voltage, or its target change.
        pub(super) height: Option<Height>,
        /// Weight relative to other points.
        pub(super) weight: Decimal [1e-9..=1e9] = 1.0,
        /// State of the device, if the scene has several.
        pub(super) state: Option<StateName>,
    }
    rules(one_of_its_motions)
    check(PointParameters::check)
}

parameters! {
    /// The target motion of a rigid body or a bar.
    pub(super) struct RigidMotion as "a body of the objective" {
        /// Direction of the centroid, counterclockwise from the x axis.
        pub(super) direction: Option<Angle> [-360.0..=360.0],
        /// Target displacement of the centroid.
        pub(super) translation: Option<[Length; 2]> [-MAX_MM..=MAX_MM],
        /// `counterclockwise` or `clockwise` for a rotation as far as possible, or a target angle, positive
        /// counterclockwise. A rotation counts as the arc length of the body's outermost corner.
        pub(super) rotation: Option<Rotation>,
        /// Weight relative to other points.
        pub(super) weight: Decimal [1e-9..=1e9] = 1.0,
        /// State of the device, if the scene has several.
        pub(super) state: Option<StateName>,
    }
    rules(one_of_all_motions)
    check(RigidMotion::check)
}

parameters! {
    /// A rigid body and its target motion.
    pub(super) struct BodyParameters as "a body of the objective" {
        /// Index in the `bodies` of the scene, from 0.
        pub(super) body: usize [0..=MOST_BODIES as u64 - 1],
        /// `up` or `down` for a height that changes as far as possible by the voltage, or its target change.
        pub(super) height: Option<Height>,
    }
    include {
        /// Its motion.
        pub(super) motion: RigidMotion,
    }
}

parameters! {
    /// A bar on a side of the membrane and its target motion.
    pub(super) struct BarParameters as "a bar of the objective" {
        /// The side of the membrane.
        pub(super) bar: Edge,
    }
    include {
        /// Its motion.
        pub(super) motion: RigidMotion,
    }
}

parameters! {
    /// The change of the force of a side on the membrane by the voltage, counted along a direction.
    pub(super) struct ReactionParameters as "a reaction of the objective" {
        /// The side of the membrane, which is held or has a bar.
        pub(super) reaction: Edge,
        /// Direction, counterclockwise from the x axis.
        pub(super) direction: Angle [-360.0..=360.0],
        /// Weight relative to other reactions.
        pub(super) weight: Decimal [1e-9..=1e9] = 1.0,
        /// State of the device, if the scene has several.
        pub(super) state: Option<StateName>,
    }
}

parameters! {
    /// A region of the membrane and its target area.
    pub(super) struct RegionParameters as "a region of the objective" {
        /// A shape; the cells whose centres lie in it count.
        pub(super) region: Shape,
        /// `largest` or `smallest` for an area that changes as far as possible, or a target: the change of the area
        /// relative to that of the prestretched membrane. It counts as the change of the radius of the disc of the
        /// same area.
        pub(super) area_strain: AreaStrain,
        /// Weight relative to other points.
        pub(super) weight: Decimal [1e-9..=1e9] = 1.0,
        /// State of the device, if the scene has several.
        pub(super) state: Option<StateName>,
    }
}

parameters! {
    /// The change of the volume between the membrane and its plane by the voltage.
    pub(super) struct VolumeParameters as "a volume of the objective" {
        /// `largest` or `smallest` for a volume that changes as far as possible, or its target change. It counts as
        /// the mean height over the rectangle of the membrane.
        pub(super) volume: VolumeChange,
        /// Weight relative to other points.
        pub(super) weight: Decimal [1e-9..=1e9] = 1.0,
        /// State of the device, if the scene has several.
        pub(super) state: Option<StateName>,
    }
}

/// A point, a body, a bar or a region, and its target motion; the force of a side; or a volume.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum PointOrBody {
    Point(PointParameters),
    Body(BodyParameters),
    Bar(BarParameters),
    Reaction(ReactionParameters),
    Region(Box<RegionParameters>),
    Volume(VolumeParameters),
}

/// The name of a state of the device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct StateName(String);

/// The target of a scalar quantity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum ScalarMotion<T> {
    /// As far as possible; true is counterclockwise, larger or up.
    Farthest(bool),
    By(T),
}

/// The target rotation of a body.
type Rotation = ScalarMotion<Angle>;

/// The target area of a region.
type AreaStrain = ScalarMotion<Decimal>;

/// The target height of a point or body.
type Height = ScalarMotion<Length>;

/// The target volume.
type VolumeChange = ScalarMotion<Volume>;

impl Height {
    fn motion(&self) -> Motion {
        match self {
            Self::Farthest(up) => Motion::Rise(*up),
            Self::By(height) => Motion::RiseBy(height.value()),
        }
    }
}

fn one_of_its_motions(fields: Fields) -> Fields {
    fields.exactly_one(&["direction", "displacement", "height"])
}

fn one_of_all_motions(fields: Fields) -> Fields {
    fields.exactly_one(&MOTIONS)
}

impl PointParameters {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let keys = ["direction", "displacement", "height"];
        let mut given = keys.into_iter().filter_map(|key| Some((key, map.optional(key)?)));
        match (given.next(), given.next()) {
            (Some((first, _)), Some((key, node))) => Err(node
                .error(format!("`{key}` cannot be used with `{first}`"))
                .help("remove one of them")),
            (None, _) => map.required(Self::WHAT, "direction").map(|_| ()),
            _ => Ok(()),
        }
    }

    fn motion(&self, value: Option<Length>) -> Motion {
        match (&self.displacement, &self.height) {
            (Some(vector), _) => Motion::To(vector.map(|c| c.value())),
            (None, Some(height)) => height.motion(),
            (None, None) => along(self.direction, value),
        }
    }
}

impl RigidMotion {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let mut given = MOTIONS.into_iter().filter_map(|key| map.optional(key));
        match (given.next(), given.next()) {
            (None, _) => Err(map
                .error("a body or bar needs a `direction`, `translation`, `rotation` or `height`")
                .help("add one of them")),
            (Some(_), Some(node)) => Err(node
                .error("a body or bar takes only one of `direction`, `translation`, `rotation` and `height`")
                .help("remove one of them, or list it in `points` once for each motion")),
            (Some(_), None) => Ok(()),
        }
    }

    fn motion(&self, value: Option<Length>) -> Motion {
        match (&self.translation, &self.rotation) {
            (Some(vector), _) => Motion::To(vector.map(|c| c.value())),
            (None, Some(Rotation::Farthest(counterclockwise))) => Motion::Turn(*counterclockwise),
            (None, Some(Rotation::By(angle))) => Motion::TurnBy(angle.value()),
            (None, None) => along(self.direction, value),
        }
    }
}

/// A motion in a direction, by a length or as far as possible.
fn along(direction: Option<Angle>, value: Option<Length>) -> Motion {
    let degrees = direction.map_or(0.0, |angle| angle.value());
    match value {
        Some(value) => Motion::By(degrees, value.value()),
        None => Motion::Along(degrees),
    }
}

impl PointOrBody {
    /// The motion of a body or a bar.
    fn rigid(&self) -> Option<&RigidMotion> {
        match self {
            Self::Point(_) | Self::Reaction(_) | Self::Region(_) | Self::Volume(_) => None,
            Self::Body(body) => Some(&body.motion),
            Self::Bar(bar) => Some(&bar.motion),
        }
    }

    fn rotation(&self) -> Option<&Rotation> {
        self.rigid()?.rotation.as_ref()
    }

    /// The height of a point or a body.
    fn height(&self) -> Option<&Height> {
        match self {
            Self::Point(point) => point.height.as_ref(),
            Self::Body(body) => body.height.as_ref(),
            Self::Bar(_) | Self::Reaction(_) | Self::Region(_) | Self::Volume(_) => None,
        }
    }

    /// Whether there is a target displacement or angle, not only a direction.
    pub fn has_target(&self) -> bool {
        let has_own = match self {
            Self::Point(point) => point.displacement.is_some(),
            Self::Region(region) => matches!(region.area_strain, AreaStrain::By(_)),
            Self::Volume(volume) => matches!(volume.volume, VolumeChange::By(_)),
            Self::Body(_) | Self::Bar(_) | Self::Reaction(_) => {
                self.rigid().is_some_and(|rigid| rigid.translation.is_some())
            }
        };
        has_own || matches!(self.rotation(), Some(Rotation::By(_))) || matches!(self.height(), Some(Height::By(_)))
    }

    pub fn is_reaction(&self) -> bool {
        matches!(self, Self::Reaction(_))
    }

    /// Whether it is a height or a volume.
    pub fn is_out_of_plane(&self) -> bool {
        self.height().is_some() || matches!(self, Self::Volume(_))
    }

    /// Whether it is a rotation, an area, a height or a volume, which have no direction in the plane.
    pub fn is_scalar(&self) -> bool {
        self.rotation().is_some() || matches!(self, Self::Region(_)) || self.is_out_of_plane()
    }

    /// Whether it is one of these that changes as far as possible.
    pub fn is_farthest_scalar(&self) -> bool {
        self.is_scalar() && !self.has_target()
    }

    /// Keys and values in YAML; the default weight is omitted.
    pub fn text_entries(&self) -> Vec<(&'static str, String)> {
        let mut entries = Vec::new();
        let weight = match self {
            Self::Point(point) => {
                point.entries(&mut entries);
                point.weight
            }
            Self::Body(body) => {
                body.entries(&mut entries);
                body.motion.weight
            }
            Self::Bar(bar) => {
                bar.entries(&mut entries);
                bar.motion.weight
            }
            Self::Reaction(reaction) => {
                reaction.entries(&mut entries);
                reaction.weight
            }
            Self::Region(region) => {
                region.entries(&mut entries);
                region.weight
            }
            Self::Volume(volume) => {
                volume.entries(&mut entries);
                volume.weight
            }
        };
        let is_default = weight.to_f64() == 1.0;
        entries.retain(|(key, _)| *key != "weight" || !is_default);
        let texts = entries.into_iter().map(|(key, value)| (key, flow_value(&value)));
        texts.collect()
    }

    /// The aim in a scene; `value` is the target displacement along directions.
    pub fn aim(&self, value: Option<Length>, scene: &Scene) -> Result<Aim, GoalError> {
        if self.is_out_of_plane() && !scene.is_in_space() {
            return Err(GoalError::StaysInPlane);
        }
        let rigid = |own: &RigidMotion, height: Option<&Height>, (centroid_mm, markers)| Aim {
            point_mm: centroid_mm,
            body: Some(markers),
            reaction: None,
            region: None,
            motion: height.map_or_else(|| own.motion(value), Height::motion),
            weight: own.weight.to_f64(),
            state: 0,
        };
        let (aim, state) = match self {
            Self::Point(point) => {
                let aim = Aim {
                    point_mm: point.point.map(|c| c.value()),
                    body: None,
                    reaction: None,
                    region: None,
                    motion: point.motion(value),
                    weight: point.weight.to_f64(),
                    state: 0,
                };
                (aim, &point.state)
            }
            Self::Body(body) => (
                rigid(&body.motion, body.height.as_ref(), markers(scene, body.body)?),
                &body.motion.state,
            ),
            Self::Bar(bar) => (
                rigid(&bar.motion, None, markers_of_bar(scene, bar.bar)?),
                &bar.motion.state,
            ),
            Self::Reaction(reaction) => (reaction.aim(scene)?, &reaction.state),
            Self::Region(region) => (region.aim(scene)?, &region.state),
            Self::Volume(volume) => (volume.aim(scene), &volume.state),
        };
        Ok(Aim {
            state: state_index(scene, state.as_ref())?,
            ..aim
        })
    }
}

impl RegionParameters {
    fn aim(&self, scene: &Scene) -> Result<Aim, GoalError> {
        if scene.geometry.sides.is_some() {
            return Err(GoalError::RegionOfSides);
        }
        let region = RegionCells::of(&self.region.region(), scene.membrane())?;
        let motion = match self.area_strain {
            AreaStrain::Farthest(larger) => Motion::Grow(larger),
            AreaStrain::By(strain) => Motion::GrowBy(strain.to_f64()),
        };
        Ok(Aim {
            weight: self.weight.to_f64(),
            region: Some(region.clone()),
            ..Aim::new(region.centroid_mm(), motion)
        })
    }
}

impl VolumeParameters {
    fn aim(&self, scene: &Scene) -> Aim {
        let motion = match &self.volume {
            VolumeChange::Farthest(larger) => Motion::Fill(*larger),
            VolumeChange::By(volume) => Motion::FillBy(volume.value()),
        };
        Aim {
            weight: self.weight.to_f64(),
            ..Aim::new(scene.membrane().size_mm.map(|side| 0.5 * side), motion)
        }
    }
}

impl ReactionParameters {
    fn aim(&self, scene: &Scene) -> Result<Aim, GoalError> {
        if scene.drive.charge.is_some() {
            return Err(GoalError::ReactionOfCharge);
        }
        let (edge, degrees) = (self.reaction, self.direction.value());
        let side = scene.geometry.sides.as_ref().map(|sides| sides.of(edge));
        let side = side.ok_or(GoalError::ReactionOfHeld)?;
        // A bar without a spring is in balance with its load along the axes that it moves along.
        let is_free = match side.bar() {
            Some(bar) => {
                let [x, y, _] = bar.moves();
                [x, y].map(|moves| moves && bar.spring_n_per_m() == 0.0)
            }
            None => side.holds(edge).map(|holds| !holds),
        };
        let quarters = (degrees / 90.0).rem_euclid(2.0);
        let counts = [quarters != 1.0, quarters != 0.0];
        if let Some(axis) = (0..2).find(|axis| is_free[*axis] && counts[*axis]) {
            let what = match side.bar() {
                Some(_) => format!("the bar on the {} side moves freely", edge.name()),
                None => format!("the {} side does not hold the membrane", edge.name()),
            };
            let axis = ["x", "y"][axis];
            return Err(GoalError::Reaction { what, axis });
        }
        Ok(Aim {
            reaction: Some(edge as usize),
            weight: self.weight.to_f64(),
            ..Aim::new(edge.middle(scene.membrane().size_mm), Motion::Along(degrees))
        })
    }
}

/// The index of a state among those of a scene.
fn state_index(scene: &Scene, state: Option<&StateName>) -> Result<usize, GoalError> {
    let names: Vec<&str> = scene.states.iter().map(|(name, _)| name).collect();
    let states = || names.join(", ");
    let Some(StateName(found)) = state else {
        return match names.len() {
            0 | 1 => Ok(0),
            _ => Err(GoalError::NoState { states: states() }),
        };
    };
    let index = names.iter().position(|name| name == found);
    index.ok_or_else(|| GoalError::State {
        found: found.clone(),
        states: states(),
    })
}

/// The centroid of a body in mm, and its markers: the corner of cells farthest from the centroid, and the corner
/// farthest from that. If elements follow the border of the body, only corners inside of it move with it.
fn markers(scene: &Scene, body: usize) -> Result<([f64; 2], BodyMarkers), GoalError> {
    let count = scene.parts().map_or(0, |parts| parts.bodies());
    let missing = || GoalError::Body { found: body, count };
    let corners = scene.corners_of_body(body).ok_or_else(missing)?;
    let centroid = corners.centroid_mm;
    let between = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
    let small = || GoalError::SmallBody { body };
    let (arm_mm, start) = corners.farthest(centroid).ok_or_else(small)?;
    let (apart, end) = corners.farthest(corners.place_mm(start)).ok_or_else(small)?;
    if apart == 0.0 {
        return Err(small());
    }
    let markers = BodyMarkers {
        ends: [start, end],
        start_mm: between(centroid, corners.place_mm(start)),
        offset_mm: between(corners.place_mm(start), corners.place_mm(end)),
        arm_mm,
    };
    Ok((centroid, markers))
}

/// The middle of a bar in mm, and its ends as markers.
fn markers_of_bar(scene: &Scene, edge: Edge) -> Result<([f64; 2], BodyMarkers), GoalError> {
    let arm_mm = scene.arm_of_bar_mm(edge);
    let arm_mm = arm_mm.ok_or(GoalError::Bar { side: edge.name() })?;
    let membrane = scene.membrane();
    let size = membrane.size_mm;
    let mut offset_mm = [0.0; 2];
    let along = 1 - edge.normal_axis();
    offset_mm[along] = size[along];
    let markers = BodyMarkers {
        ends: edge.ends(membrane.raster.sides()),
        start_mm: offset_mm.map(|offset| -0.5 * offset),
        offset_mm,
        arm_mm,
    };
    Ok((edge.middle(size), markers))
}

impl Parameter for PointOrBody {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let has = |key: &str| node.peek(key).is_some();
        if has("body") {
            BodyParameters::read(node, key, &()).map(Self::Body)
        } else if has("bar") {
            BarParameters::read(node, key, &()).map(Self::Bar)
        } else if has("reaction") {
            ReactionParameters::read(node, key, &()).map(Self::Reaction)
        } else if has("region") {
            RegionParameters::read(node, key, &()).map(|region| Self::Region(Box::new(region)))
        } else if has("volume") {
            VolumeParameters::read(node, key, &()).map(Self::Volume)
        } else {
            PointParameters::read(node, key, &()).map(Self::Point)
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(match self {
            Self::Point(point) => point.to_canonical(),
            Self::Body(body) => body.to_canonical(),
            Self::Bar(bar) => bar.to_canonical(),
            Self::Reaction(reaction) => reaction.to_canonical(),
            Self::Region(region) => region.to_canonical(),
            Self::Volume(volume) => volume.to_canonical(),
        })
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([
            PointParameters::schema(&()),
            BodyParameters::schema(&()),
            BarParameters::schema(&()),
            ReactionParameters::schema(&()),
            RegionParameters::schema(&()),
            VolumeParameters::schema(&()),
        ])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Parameter for StateName {
    type Limits = ();
    type Literal = &'static str;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        Ok(Self(node.text(key)?.to_owned()))
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.as_str().into())
    }

    fn schema((): &()) -> Schema {
        Schema::matching(&States::name_pattern())
    }

    fn literal(literal: &'static str) -> Self {
        Self(literal.to_owned())
    }
}

/// The index of the word that a value is; `None` for other values.
fn word_of(words: [&str; 2], node: &Node) -> Option<usize> {
    words.iter().position(|word| node.is_text(word))
}

/// Refuses a value that is neither one of two words nor `others`, as which its reader has refused it.
fn neither(error: InputError, words: [&str; 2], others: &str, (node, key): (&Node, &str)) -> InputError {
    let is_word = |text: &&str| text.starts_with(char::is_alphabetic);
    let error = match node.text(key).ok().filter(is_word) {
        Some(word) => node.error(format!("`{key}` cannot be {word:?}")),
        None => error,
    };
    error.help(format!("allowed: {}, or {others}", words.join(", ")))
}

/// A quantity without a direction in the plane that an objective changes.
pub(super) trait Scalar: Parameter<Limits = RangeInclusive<f64>> {
    /// The words for a change as far as possible, the positive one last.
    const WORDS: [&'static str; 2];
    /// The range of targets.
    const RANGE: RangeInclusive<f64>;
    /// What is allowed besides the words.
    const TARGETS: &'static str;
}

impl Scalar for Angle {
    const WORDS: [&'static str; 2] = ROTATIONS;
    // Rotations are unique up to half a turn.
    const RANGE: RangeInclusive<f64> = -179.0..=179.0;
    const TARGETS: &'static str = "an angle from -179 deg to 179 deg";
}

impl Scalar for Decimal {
    const WORDS: [&'static str; 2] = AREAS;
    const RANGE: RangeInclusive<f64> = 0.0..=1.0;
    const TARGETS: &'static str = "a target from 0 % to 100 %";
}

impl Scalar for Length {
    const WORDS: [&'static str; 2] = HEIGHTS;
    const RANGE: RangeInclusive<f64> = -MAX_MM..=MAX_MM;
    const TARGETS: &'static str = "a target such as 1.5 mm";
}

impl Scalar for Volume {
    const WORDS: [&'static str; 2] = AREAS;
    const RANGE: RangeInclusive<f64> = -1e6..=1e6;
    const TARGETS: &'static str = "a target such as 0.5 ml";
}

impl<T: Scalar> Parameter for ScalarMotion<T> {
    type Limits = ();
    type Literal = bool;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match word_of(T::WORDS, node) {
            Some(at) => Ok(Self::Farthest(at == 1)),
            None => T::read(node, key, &T::RANGE)
                .map(Self::By)
                .map_err(|error| neither(error, T::WORDS, T::TARGETS, (node, key))),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Farthest(positive) => Some(T::WORDS[usize::from(*positive)].into()),
            Self::By(target) => target.canonical(),
        }
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Schema::word(&T::WORDS), T::schema(&T::RANGE)])
    }

    fn literal(positive: bool) -> Self {
        Self::Farthest(positive)
    }
}
