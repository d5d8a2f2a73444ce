//! What a design is for, as it stands in a pipeline.

use serde_json::json;

use super::aim::{Aim, Lever, Motion};
use super::field_file;
use super::goal::{Goal, GoalError};
use super::measure::{Displacement, Distance, MEASURES, Measure};
use crate::text::{flow_mapping, flow_value};
use deaflow_base::{
    Angle, Canonical, Decimal, Declared, Fields, Frequency, InputError, Length, Map, Node, Parameter, Schema, Time,
    parameters,
};
use deaflow_scene::{MOST_BODIES, Scene, States};

/// Largest coordinate and displacement in mm.
pub(super) const LONGEST_MM: f64 = 1e4;

parameters! {
    /// A point and where it should move.
    pub(super) struct PointParameters as "a point of the objective" {
        /// Its place, such as [25 mm, 25 mm].
        pub(super) point: [Length; 2] [0.0..=LONGEST_MM],
        /// Counterclockwise from the x axis.
        pub(super) direction: Option<Angle> [-360.0..=360.0],
        /// The displacement that is wanted, in place of a direction.
        pub(super) displacement: Option<[Length; 2]> [-LONGEST_MM..=LONGEST_MM],
        /// What the point counts beside others.
        pub(super) weight: Decimal [1e-9..=1e9] = 1.0,
        /// The state of the device in which it should, where the scene has several.
        pub(super) state: Option<StateName>,
    }
    rules(either_motion)
    check(PointParameters::check)
}

parameters! {
    /// A rigid body and where it should move, or how it should turn.
    struct BodyParameters as "a body of the objective" {
        /// Its number among the `bodies` of the scene, from 0.
        body: usize [0..=MOST_BODIES as u64 - 1],
        /// Counterclockwise from the x axis: where its centroid should move.
        direction: Option<Angle> [-360.0..=360.0],
        /// The translation that is wanted of its centroid.
        translation: Option<[Length; 2]> [-LONGEST_MM..=LONGEST_MM],
        /// `counterclockwise` or `clockwise` where it should turn as far as it gets, or the angle that is wanted, counterclockwise. A rotation
        /// counts by the arc of the body's outermost corner.
        rotation: Option<Rotation>,
        /// What the body counts beside others.
        weight: Decimal [1e-9..=1e9] = 1.0,
        /// The state of the device in which it should, where the scene has several.
        state: Option<StateName>,
    }
    rules(one_motion)
    check(BodyParameters::check)
}

parameters! {
    /// How displacements are measured.
    struct MeasureParameters as "the objective" {
        /// The displacement wanted along each direction, no more and no less.
        value: Option<Length> [-LONGEST_MM..=LONGEST_MM],
        /// How a motion is measured: its component along the direction (the default where points have directions), its distance from
        /// what is wanted (the default where that is given), or the paper's formula.
        measure: Option<&'static dyn Measure>,
        /// When, since the voltage was put on, where the elastomer creeps; at the end of creep unless it is said.
        time: Option<Time> [0.0..=1e12],
    }
}

parameters! {
    /// What is measured of a swing.
    struct SwingParameters as "the objective" {
        /// The amplitude of the displacement at this frequency counts, under the sine of the drive about its bias.
        frequency: Option<Frequency> [1e-9..=1e9],
    }
    rules(of_directions)
}

parameters! {
    /// A point and where it should move.
    struct OnePoint as "the objective" {}
    include {
        /// The point.
        point: PointParameters,
        /// How it is measured.
        measured: MeasureParameters,
        /// Of what.
        swing: SwingParameters,
    }
}

parameters! {
    /// A rigid body and where it should move, or how it should turn.
    struct OneBody as "the objective" {}
    include {
        /// The body.
        body: BodyParameters,
        /// How it is measured.
        measured: MeasureParameters,
    }
    rules(a_measure_of_rotations)
}

parameters! {
    /// Points and bodies whose motions count by their weighted mean.
    struct ManyPoints as "the objective" {
        /// The points and bodies.
        points: Vec<Target> [((), 1..=usize::MAX)],
    }
    include {
        /// How they are measured.
        measured: MeasureParameters,
        /// Of what.
        swing: SwingParameters,
    }
    rules(all_far_or_none)
}

parameters! {
    /// A wanted displacement field.
    struct FieldObjective as "the objective" {
        /// A CSV file beside the pipeline or below with the columns x_mm, y_mm, ux_mm, uy_mm.
        field: FieldPoints,
        /// When, since the voltage was put on, where the elastomer creeps; at the end of creep unless it is said.
        time: Option<Time> [0.0..=1e12],
    }
}

/// The points of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct FieldPoints(Vec<PointParameters>);

/// A point or a body, and where it should move.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Target {
    Point(PointParameters),
    Body(BodyParameters),
}

/// The name of a state of the device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct StateName(String);

/// How a body should turn.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Rotation {
    /// Counterclockwise as far as it gets, or clockwise where it is false.
    Farthest(bool),
    By(Angle),
}

/// The words of a rotation as far as it gets.
const TURNS: [&str; 2] = ["clockwise", "counterclockwise"];

/// Largest wanted angle in degrees: rotations are told up to half a turn.
const LARGEST_TURN: std::ops::RangeInclusive<f64> = -179.0..=179.0;

/// What a design is for: points and bodies, how each should move, and how that is measured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Objective {
    points: Vec<Target>,
    measure: &'static dyn Measure,
    value: Option<Length>,
    moment: Moment,
}

/// Of what a displacement counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// An equilibrium, where the elastomer creeps that at the end.
    Equilibrium,
    /// So long after the voltage was put on.
    After(Time),
    /// Its amplitude at a frequency.
    Swing(Frequency),
}

fn either_motion(fields: Fields) -> Fields {
    one_of(fields, &["direction", "displacement"])
}

/// A rotation is not measured by what compares directions.
fn a_measure_of_rotations(fields: Fields) -> Fields {
    fields.rule(json!({ "if": { "required": ["rotation"] }, "then": without_comparison() }))
}

/// Either each has a wanted displacement or angle, or none has; and what compares directions measures no rotation.
fn all_far_or_none(fields: Fields) -> Fields {
    let has = |key: &str| json!({ "required": [key] });
    let by_angle = json!({ "required": ["rotation"], "properties": { "rotation": { "not": { "enum": TURNS } } } });
    let far = json!({ "anyOf": [has("displacement"), has("translation"), by_angle] });
    let both = json!([{ "contains": far }, { "contains": { "not": far } }]);
    let turned = json!({ "points": { "contains": has("rotation") } });
    fields
        .rule(json!({ "properties": { "points": { "not": { "allOf": both } } } }))
        .rule(json!({ "if": { "properties": turned, "required": ["points"] }, "then": without_comparison() }))
}

fn without_comparison() -> serde_json::Value {
    let others = MEASURES.iter().filter(|measure| measure.takes_rotations());
    let others: Vec<&str> = others.map(|measure| measure.name()).collect();
    json!({ "properties": { "measure": { "enum": others } } })
}

/// Amplitudes are those of displacements along directions.
fn of_directions(fields: Fields) -> Fields {
    let has = |key: &str| json!({ "required": [key] });
    let others = json!([has("time"), has("value"), has("displacement")]);
    let along = json!({ "items": { "required": ["point", "direction"] } });
    let measured = json!({ "measure": { "const": Displacement.name() }, "points": along });
    let then = json!({ "not": { "anyOf": others }, "properties": measured });
    fields.rule(json!({ "if": has("frequency"), "then": then }))
}

/// Ways in which a body may move.
const MOTIONS: [&str; 3] = ["direction", "translation", "rotation"];

fn one_motion(fields: Fields) -> Fields {
    one_of(fields, &MOTIONS)
}

fn one_of(fields: Fields, keys: &[&str]) -> Fields {
    let each: Vec<_> = keys.iter().map(|key| json!({ "required": [key] })).collect();
    fields.rule(json!({ "oneOf": each }))
}

impl BodyParameters {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let mut given = MOTIONS.into_iter().filter_map(|key| map.optional(key));
        match (given.next(), given.next()) {
            (None, _) => Err(map
                .error("a body has no `direction`, `translation` or `rotation`")
                .help("give one of them")),
            (Some(_), Some(node)) => Err(node
                .error("a body moves in a `direction`, by a `translation`, or has a `rotation`, and it is given two of them")
                .help("give one of them; a body may stand in `points` several times")),
            (Some(_), None) => Ok(()),
        }
    }

    fn motion(&self, value: Option<Length>) -> Motion {
        match (&self.translation, &self.rotation, &self.direction) {
            (Some(vector), ..) => Motion::To(vector.map(|c| c.value())),
            (None, Some(Rotation::Farthest(counterclockwise)), _) => Motion::Turn(*counterclockwise),
            (None, Some(Rotation::By(angle)), _) => Motion::TurnBy(angle.value()),
            (None, None, direction) => along(*direction, value),
        }
    }
}

/// In a direction, so far or as far as it gets.
fn along(direction: Option<Angle>, value: Option<Length>) -> Motion {
    let degrees = direction.map_or(0.0, |angle| angle.value());
    match value {
        Some(value) => Motion::By(degrees, value.value()),
        None => Motion::Along(degrees),
    }
}

impl Target {
    /// Whether it says itself how far it should move.
    fn is_far(&self) -> bool {
        match self {
            Self::Point(point) => point.displacement.is_some(),
            Self::Body(body) => body.translation.is_some() || matches!(body.rotation, Some(Rotation::By(_))),
        }
    }

    fn is_rotation(&self) -> bool {
        matches!(self, Self::Body(body) if body.rotation.is_some())
    }

    /// Whether it is a rotation, as far as it gets.
    fn turns(&self) -> bool {
        matches!(self, Self::Body(body) if matches!(body.rotation, Some(Rotation::Farthest(_))))
    }

    /// As a value is in a pipeline, the usual weight left out.
    fn text_entries(&self) -> Vec<(&'static str, String)> {
        let mut entries = Vec::new();
        let weight = match self {
            Self::Point(point) => {
                point.entries(&mut entries);
                point.weight
            }
            Self::Body(body) => {
                body.entries(&mut entries);
                body.weight
            }
        };
        let usual = weight.to_f64() == 1.0;
        entries.retain(|(key, _)| *key != "weight" || !usual);
        entries
            .into_iter()
            .map(|(key, value)| (key, flow_value(&value)))
            .collect()
    }

    fn aim(&self, value: Option<Length>, scene: &Scene) -> Result<Aim, GoalError> {
        let (point_mm, lever, motion, weight, state) = match self {
            Self::Point(point) => {
                let motion = match &point.displacement {
                    Some(vector) => Motion::To(vector.map(|c| c.value())),
                    None => along(point.direction, value),
                };
                (point.point.map(|c| c.value()), None, motion, point.weight, &point.state)
            }
            Self::Body(body) => {
                let (centroid_mm, lever) = body_of(scene, body.body)?;
                (centroid_mm, Some(lever), body.motion(value), body.weight, &body.state)
            }
        };
        Ok(Aim {
            point_mm,
            body: lever,
            motion,
            weight: weight.to_f64(),
            state: state_of(scene, state.as_ref())?,
        })
    }
}

/// The place of a state among those of a scene.
fn state_of(scene: &Scene, wanted: Option<&StateName>) -> Result<usize, GoalError> {
    let names: Vec<&str> = scene.states.iter().map(|(name, _)| name).collect();
    let listed = || names.join(", ");
    match wanted {
        None if names.len() < 2 => Ok(0),
        None => Err(GoalError::NoState { states: listed() }),
        Some(wanted) => names
            .iter()
            .position(|name| *name == wanted.0)
            .ok_or_else(|| GoalError::State {
                found: wanted.0.clone(),
                states: listed(),
            }),
    }
}

/// The centroid in mm of a body of a scene, and by what its rotation is told.
fn body_of(scene: &Scene, body: usize) -> Result<([f64; 2], Lever), GoalError> {
    let count = scene.parts().map_or(0, |parts| parts.bodies());
    let missing = || GoalError::Body { found: body, count };
    let (membrane, cells) = (scene.membrane(), scene.cells_of_body(body));
    let centroid = scene.centroid_of_body(body).ok_or_else(missing)?;
    let cell = membrane.cell_mm();
    let place = |corner: [usize; 2]| [0, 1].map(|axis| corner[axis] as f64 * cell[axis]);
    let between = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
    let far = |a: [f64; 2], b: [f64; 2]| {
        let [x, y] = between(a, b);
        x.hypot(y)
    };
    let corners = || {
        cells
            .iter()
            .flat_map(|[x, y]| (0..4).map(move |k| [x + k % 2, y + k / 2]))
    };
    let farthest = |from: [f64; 2]| {
        let all = corners().map(|corner| (far(from, place(corner)), corner));
        // The first of those that are equally far.
        all.reduce(|best, one| if one.0 > best.0 { one } else { best })
    };
    let (arm_mm, from) = farthest(centroid).ok_or_else(missing)?;
    let (_, to) = farthest(place(from)).ok_or_else(missing)?;
    let lever = Lever {
        ends: [from, to],
        start_mm: between(centroid, place(from)),
        offset_mm: between(place(from), place(to)),
        arm_mm,
    };
    Ok((centroid, lever))
}

impl PointParameters {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        match (map.optional("displacement"), map.optional("direction")) {
            (Some(node), Some(_)) => Err(node
                .error("`displacement` says the direction too, so `direction` cannot stand beside it")
                .help("give either")),
            (None, None) => map.required(Self::WHAT, "direction").map(|_| ()),
            _ => Ok(()),
        }
    }
}

impl Objective {
    fn new(
        points: Vec<Target>,
        measured: MeasureParameters,
        swing: SwingParameters,
        node: &Node,
    ) -> Result<Self, InputError> {
        let MeasureParameters { measure, value, time } = measured;
        let wanted = value.is_some() || points.iter().all(Target::is_far);
        let usual: &'static dyn Measure = if wanted { &Distance } else { &Displacement };
        let objective = Self {
            points,
            measure: measure.unwrap_or(usual),
            value,
            moment: match (time, swing.frequency) {
                (_, Some(frequency)) => Moment::Swing(frequency),
                (Some(time), None) => Moment::After(time),
                (None, None) => Moment::Equilibrium,
            },
        };
        objective.check(node)?;
        Ok(objective)
    }

    /// Refuses keys that contradict each other.
    fn check(&self, node: &Node) -> Result<(), InputError> {
        let vectors = self.points.iter().filter(|point| point.is_far()).count();
        let at = |key| node.peek(key).unwrap_or(node);
        if matches!(self.moment, Moment::Swing(_)) {
            return self.check_swing(node);
        }
        match (self.measure.needs_displacement(), &self.value) {
            (true, None) if vectors < self.points.len() => Err(at("measure")
                .error("a distance is measured from a wanted displacement, and a point has none")
                .help("give each point `displacement: [x, y]` in place of a direction, or the objective a `value`; a body has its `translation` or `rotation`")),
            (false, Some(_)) => Err(at("value")
                .error("`value` is the displacement from which the distance is measured, and this measure is another")
                .help("leave `measure` out, or `value`")),
            _ if vectors > 0 && vectors < self.points.len() => Err(at("points")
                .error("some points and bodies have a wanted displacement or angle, and others a direction alone: these cannot count together")
                .help("give each a direction, or each what is wanted of it")),
            (_, Some(_)) if vectors > 0 => Err(at("value")
                .error("`value` stands for the length of the displacements, and a point has its `displacement`")
                .help("give either")),
            (_, Some(_)) if self.points.iter().any(Target::turns) => Err(at("value")
                .error("`value` is a length, and a body is to turn")
                .help("give the wanted angle as its `rotation`")),
            _ if !self.measure.takes_rotations() && self.points.iter().any(Target::is_rotation) => Err(at("measure")
                .error(format!("`measure: {}` compares directions, and a body is to turn", self.measure.name()))
                .help("leave `measure` out")),
            _ => Ok(()),
        }
    }

    /// Refuses what an amplitude cannot be of.
    fn check_swing(&self, node: &Node) -> Result<(), InputError> {
        let other = ["time", "value", "displacement"]
            .into_iter()
            .find_map(|key| Some((key, node.peek(key)?)));
        if let Some((key, other)) = other {
            let message = format!("`{key}` cannot stand beside `frequency`, at which the amplitude counts");
            return Err(other.error(message).help("leave one of them out"));
        }
        if self.measure.name() != Displacement.name() {
            let measure = node.peek("measure").unwrap_or(node);
            let message = format!("`measure: {}` measures no amplitude", self.measure.name());
            return Err(measure.error(message).help("leave `measure` out, or `frequency`"));
        }
        let is_along = |one: &Target| matches!(one, Target::Point(point) if point.displacement.is_none());
        match self.points.iter().all(is_along) {
            true => Ok(()),
            false => Err(node
                .peek("points")
                .unwrap_or(node)
                .error("an amplitude is that of points along directions")
                .help("give each point its `direction`, and leave bodies and displacements out")),
        }
    }

    /// Reads a point (`{ point, direction }`) or a rigid body (`{ body, direction }`), or several
    /// (`{ points: [{ point, direction, weight, state }, …] }`), with an optional `measure`, and an optional `value`: the displacement that
    /// is wanted along each direction; or a wanted field (`{ field: FILE.csv }`). In place of a direction a point may have a wanted
    /// `displacement: [x, y]`, a body a `translation: [x, y]` or a `rotation`.
    ///
    /// # Errors
    /// When a key is unknown or missing, a value is no length or angle, or the keys contradict each other.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let still = SwingParameters { frequency: None };
        let (points, measured, swing) = if node.peek("points").is_some() {
            let ManyPoints {
                points,
                measured,
                swing,
            } = ManyPoints::read_with(node, &[])?;
            (points, measured, swing)
        } else if node.peek("field").is_some() {
            let FieldObjective { field, time } = FieldObjective::read_with(node, &[])?;
            let measured = MeasureParameters {
                value: None,
                measure: None,
                time,
            };
            (field.0.into_iter().map(Target::Point).collect(), measured, still)
        } else if node.peek("body").is_some() {
            let OneBody { body, measured } = OneBody::read_with(node, &[])?;
            (vec![Target::Body(body)], measured, still)
        } else {
            let OnePoint { point, measured, swing } = OnePoint::read_with(node, &[])?;
            (vec![Target::Point(point)], measured, swing)
        };
        Self::new(points, measured, swing, node)
    }

    /// The objective in its own YAML syntax on one line.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut entries = match &self.points[..] {
            [single] => single.text_entries(),
            many => {
                let points: Vec<String> = many.iter().map(|point| flow_mapping(point.text_entries())).collect();
                vec![("points", format!("[{}]", points.join(", ")))]
            }
        };
        entries.extend(self.value.map(|value| ("value", value.to_string())));
        entries.push(("measure", self.measure.name().to_owned()));
        entries.extend(match self.moment {
            Moment::Equilibrium => None,
            Moment::After(time) => Some(("time", time.to_string())),
            Moment::Swing(frequency) => Some(("frequency", frequency.to_string())),
        });
        flow_mapping(entries)
    }

    /// Of what the displacement counts.
    #[must_use]
    pub fn moment(&self) -> Moment {
        self.moment
    }

    /// The goal in a scene.
    ///
    /// # Errors
    /// When a point lies outside the membrane, a number out of range, or the scene has no such body or state.
    pub fn goal(&self, scene: &Scene, area: Option<f64>, area_penalty: f64) -> Result<Goal, GoalError> {
        let aims = self.points.iter().map(|point| point.aim(self.value, scene));
        let aims: Vec<Aim> = aims.collect::<Result<_, _>>()?;
        Goal::new(self.measure, &aims, scene.membrane(), area, area_penalty)
    }
}

impl Parameter for Objective {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, _key: &str, (): &()) -> Result<Self, InputError> {
        Self::read(node)
    }

    /// The same for one point and for a list of one; the measure stands in it even where none is written.
    fn canonical(&self) -> Option<Canonical> {
        let points = Canonical::List(self.points.iter().filter_map(Parameter::canonical).collect());
        let value = self.value.as_ref().and_then(Parameter::canonical);
        let own = [("points", points), ("measure", self.measure.name().into())];
        let value = value.map(|value| ("value", value));
        let moment = match &self.moment {
            Moment::Equilibrium => None,
            Moment::After(time) => time.canonical().map(|time| ("time", time)),
            Moment::Swing(frequency) => frequency.canonical().map(|frequency| ("frequency", frequency)),
        };
        Some(Canonical::map(own.into_iter().chain(value).chain(moment)))
    }

    fn schema((): &()) -> Schema {
        let forms = [
            OnePoint::fields(),
            OneBody::fields(),
            ManyPoints::fields(),
            FieldObjective::fields(),
        ];
        Schema::any_of(forms.map(Schema::from))
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Parameter for Target {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match node.peek("body") {
            Some(_) => BodyParameters::read(node, key, &()).map(Self::Body),
            None => PointParameters::read(node, key, &()).map(Self::Point),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(match self {
            Self::Point(point) => point.to_canonical(),
            Self::Body(body) => body.to_canonical(),
        })
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([PointParameters::schema(&()), BodyParameters::schema(&())])
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

impl Parameter for Rotation {
    type Limits = ();
    type Literal = bool;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        match TURNS.iter().position(|word| node.is_text(word)) {
            Some(at) => Ok(Self::Farthest(at == 1)),
            None => Angle::read(node, key, &LARGEST_TURN).map(Self::By).map_err(|error| {
                let words = TURNS.join(", ");
                let is_word = |text: &&str| text.starts_with(char::is_alphabetic);
                let error = match node.text(key).ok().filter(is_word) {
                    Some(word) => node.error(format!("`{key}` cannot be {word:?}")),
                    None => error,
                };
                error.help(format!("allowed: {words}, or an angle from -179 deg to 179 deg"))
            }),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Farthest(counterclockwise) => Some(TURNS[usize::from(*counterclockwise)].into()),
            Self::By(angle) => angle.canonical(),
        }
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Schema::word(&TURNS), Angle::schema(&LARGEST_TURN)])
    }

    fn literal(counterclockwise: bool) -> Self {
        Self::Farthest(counterclockwise)
    }
}

impl Parameter for &'static dyn Measure {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let word = node.word(key, &MEASURES.map(Measure::name))?;
        let found = MEASURES.into_iter().find(|measure| measure.name() == word);
        Ok(found.expect("the word is one of these"))
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.name().into())
    }

    fn schema((): &()) -> Schema {
        Schema::word(&MEASURES.map(Measure::name))
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Parameter for FieldPoints {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, _key: &str, (): &()) -> Result<Self, InputError> {
        field_file::read(node).map(Self)
    }

    fn canonical(&self) -> Option<Canonical> {
        self.0.canonical()
    }

    fn schema((): &()) -> Schema {
        Schema::text()
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;

    fn read(text: &str) -> Result<Objective, InputError> {
        Objective::read(&Document::from_text(Path::new("t"), text).unwrap().root)
    }

    #[test]
    fn an_objective_survives_its_own_text() {
        for text in [
            "{ point: [2.5 cm, 25], direction: 45 deg }",
            "{ points: [{ point: [1, 2], direction: 0 }, { point: [3, 4], direction: -90 deg, weight: 2.5 }], measure: qin2024 }",
            "{ point: [25, 25], direction: 30 deg, value: 1.00 mm }",
            "{ point: [25, 25], direction: 30 deg, time: 10 min }",
            "{ point: [25, 25], direction: 30 deg, frequency: 40 Hz }",
            "{ points: [{ point: [1, 2], direction: 0 }, { point: [3, 4], direction: 90 deg }], frequency: 1 kHz }",
            "{ points: [{ point: [1, 2], displacement: [0.1 mm, -0.2 mm] }, { point: [3, 4], displacement: [0, 0] }] }",
        ] {
            let objective = read(text).unwrap();
            assert_eq!(read(&objective.to_text()).unwrap().canonical(), objective.canonical());
        }
    }

    #[test]
    fn incomplete_objectives_are_refused() {
        for text in [
            "{ point: [1, 2] }",
            "{ direction: 0 deg }",
            "{ point: [1], direction: 0 }",
            "{ point: [1 V, 2], direction: 0 }",
            "{}",
            "{ points: [] }",
            "{ point: [1, 2], direction: 0, displacement: [1, 1] }",
            "{ point: [1, 2], direction: 0, measure: distance }",
            "{ point: [1, 2], direction: 0, value: 1 mm, measure: displacement }",
            "{ point: [1, 2], displacement: [1, 0], value: 1 mm }",
            "{ points: [{ point: [1, 2], direction: 0 }, { point: [1, 2], displacement: [0, 1] }], measure: distance }",
            "{ point: [1, 2], direction: 0, weight: 0 }",
            "{ points: [{ point: [1, 2], direction: 0 }, { point: [1, 2], displacement: [0, 1] }] }",
            "{ points: [{ body: 0, rotation: 1 deg }, { body: 0, direction: 0 }], measure: displacement }",
            "{ body: 0, rotation: clockwise, measure: qin2024 }",
            "{ point: [1, 2], direction: 0, frequency: 1 Hz, time: 1 s }",
            "{ point: [1, 2], direction: 0, frequency: 1 Hz, value: 1 mm }",
            "{ point: [1, 2], direction: 0, frequency: 1 Hz, measure: qin2024 }",
            "{ point: [1, 2], displacement: [0, 1], frequency: 1 Hz }",
            "{ points: [{ point: [1, 2], displacement: [0, 1] }], frequency: 1 Hz }",
            "{ points: [{ body: 0, direction: 0 }], frequency: 1 Hz }",
            "{ body: 0, direction: 0, frequency: 1 Hz }",
        ] {
            assert!(read(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_word_that_is_no_rotation_is_named() {
        let error = read("{ body: 0, rotation: sideways }").unwrap_err().to_string();
        assert!(error.contains("`rotation` cannot be \"sideways\""), "{error}");
    }
}
