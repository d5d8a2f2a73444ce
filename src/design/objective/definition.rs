//! The objective of a design in YAML.

use serde_json::json;

use super::aim::Aim;
use super::error::GoalError;
use super::field_file;
use super::goal::Goal;
use super::measure::{Displacement, Distance, MEASURES, Measure};
use super::points::{
    AREAS, BarParameters, BodyParameters, HEIGHTS, MAX_MM, PointOrBody, PointParameters, ROTATIONS, ReactionParameters,
    RegionParameters, VolumeParameters,
};
use super::robust::{Masks, Robust};
use crate::text::flow_mapping;
use deaflow_base::{
    Canonical, Declared, Fields, Frequency, InputError, Length, Node, Parameter, Schema, Time, parameters,
};
use deaflow_pattern::Membrane;
use deaflow_scene::{Scene, Tolerances};

parameters! {
    /// How motions are measured.
    #[derive(Default)]
    struct MotionMeasure as "the objective" {
        /// Measure of a motion: its component along the direction (the default for directions), its distance from the
        /// target (the default for targets), or the paper's formula.
        measure: Option<&'static dyn Measure>,
        /// Time after the voltage is applied, if the elastomer creeps; by default the end of creep.
        time: Option<Time> [0.0..=1e12],
        /// Electrodes as they may be fabricated: the worst value, or the mean less some standard deviations, counts.
        robust: Option<Robust>,
    }
}

parameters! {
    /// How displacements are measured.
    #[derive(Default)]
    struct MeasureParameters as "the objective" {
        /// Target displacement along each direction.
        value: Option<Length> [-MAX_MM..=MAX_MM],
    }
    include {
        /// What they have in common with areas.
        motion: MotionMeasure,
    }
}

parameters! {
    /// How an amplitude is measured.
    struct AmplitudeParameters as "the objective" {
        /// Use the amplitude of the displacement at this frequency, for a sinusoidal drive about its bias.
        frequency: Option<Frequency> [1e-9..=1e9],
    }
    rules(amplitudes_along_directions)
}

parameters! {
    /// A point and its target motion.
    struct OnePoint as "the objective" {}
    include {
        /// The point.
        point: PointParameters,
        /// How it is measured.
        measured: MeasureParameters,
        /// Which response is measured.
        amplitude: AmplitudeParameters,
    }
}

parameters! {
    /// A rigid body and its target motion.
    struct OneBody as "the objective" {}
    include {
        /// The body.
        body: BodyParameters,
        /// How it is measured.
        measured: MeasureParameters,
    }
    rules(measure_supports_rotations)
}

parameters! {
    /// A bar on a side of the membrane and its target motion.
    struct OneBar as "the objective" {}
    include {
        /// The bar.
        bar: BarParameters,
        /// How it is measured.
        measured: MeasureParameters,
    }
    rules(measure_supports_rotations)
}

parameters! {
    /// A region of the membrane and its target area.
    struct OneRegion as "the objective" {}
    include {
        /// The region.
        region: RegionParameters,
        /// How it is measured.
        measured: MotionMeasure,
    }
    rules(measure_supports_scalars)
}

parameters! {
    /// The volume between the membrane and its plane.
    struct OneVolume as "the objective" {
        /// Measure: the change of the volume (the default for words), or its distance from the target (the default for
        /// targets).
        measure: Option<&'static dyn Measure>,
    }
    include {
        /// The volume.
        volume: VolumeParameters,
    }
    rules(measure_supports_scalars)
}

parameters! {
    /// Points and bodies; the objective is their weighted mean.
    struct ManyPoints as "the objective" {
        /// The points and bodies.
        points: Vec<PointOrBody> [((), 1..=usize::MAX)],
    }
    include {
        /// How they are measured.
        measured: MeasureParameters,
        /// Which response is measured.
        amplitude: AmplitudeParameters,
    }
    rules(targets_for_all_or_none)
}

parameters! {
    /// A target displacement field.
    struct FieldObjective as "the objective" {
        /// A CSV file in the folder of the pipeline or below, with the columns x_mm, y_mm, ux_mm, uy_mm.
        field: FieldPoints,
        /// Time after the voltage is applied, if the elastomer creeps; by default the end of creep.
        time: Option<Time> [0.0..=1e12],
    }
}

/// The points of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct FieldPoints(Vec<PointParameters>);

/// The objective of a design: points and bodies, their target motions, and how these are measured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Objective {
    points: Vec<PointOrBody>,
    measure: &'static dyn Measure,
    value: Option<Length>,
    response: ResponseKind,
    robust: Option<Robust>,
}

/// The response that an objective measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResponseKind {
    /// The equilibrium; with creep, at its end.
    Equilibrium,
    /// The displacement at a time after the voltage is applied.
    After(Time),
    /// The amplitude at a frequency.
    Amplitude(Frequency),
}

/// Only measures that support rotations.
fn measure_supports_rotations(fields: Fields) -> Fields {
    fields.rule(json!({ "if": { "anyOf": [has("rotation"), has("height")] }, "then": scalar_measures() }))
}

/// The key is there.
fn has(key: &str) -> serde_json::Value {
    json!({ "required": [key] })
}

/// Only measures that support areas.
fn measure_supports_scalars(fields: Fields) -> Fields {
    fields.rule(scalar_measures())
}

/// Either all points, bodies and regions have targets or none has; rotations and areas need a measure that supports
/// them.
fn targets_for_all_or_none(fields: Fields) -> Fields {
    let by = |required: &str, key: &str, words: [&str; 2]| {
        let value = json!({ "not": { "enum": words } });
        json!({ "required": [required], "properties": { key: value } })
    };
    let by_angle = by("rotation", "rotation", ROTATIONS);
    let by_strain = by("region", "area_strain", AREAS);
    let (by_height, by_volume) = (by("height", "height", HEIGHTS), by("volume", "volume", AREAS));
    let vectors = [has("displacement"), has("translation")];
    let target = json!({ "anyOf": [vectors[0], vectors[1], by_angle, by_strain, by_height, by_volume] });
    let both = json!([{ "contains": target }, { "contains": { "not": target } }]);
    let is_scalar = json!({ "anyOf": [has("rotation"), has("region"), has("height"), has("volume")] });
    let scalars = json!({ "points": { "contains": is_scalar } });
    fields
        .rule(json!({ "properties": { "points": { "not": { "allOf": both } } } }))
        .rule(json!({ "if": { "properties": scalars, "required": ["points"] }, "then": scalar_measures() }))
}

fn scalar_measures() -> serde_json::Value {
    let measures = MEASURES.iter().filter(|measure| measure.supports_scalars());
    let names: Vec<&str> = measures.map(|measure| measure.name()).collect();
    json!({ "properties": { "measure": { "enum": names } } })
}

/// Amplitudes are measured along directions only.
fn amplitudes_along_directions(fields: Fields) -> Fields {
    let others = json!([has("time"), has("value"), has("displacement"), has("robust")]);
    let along = json!({ "items": { "required": ["point", "direction"] } });
    let measured = json!({ "measure": { "const": Displacement.name() }, "points": along });
    let then = json!({ "not": { "anyOf": others }, "properties": measured });
    fields.rule(json!({ "if": has("frequency"), "then": then }))
}

/// Refuses the keys of motions for forces, which are those of an equilibrium and as large as possible, and forces
/// among motions.
fn refuse_keys_of_motions(
    points: &[PointOrBody],
    (measured, frequency): (&MeasureParameters, &Option<Frequency>),
    node: &Node,
) -> Result<(), InputError> {
    let refused = |key: &str, message: String, help: &str| {
        Err(node.peek(key).unwrap_or(node).error(message).help(help.to_owned()))
    };
    if points.iter().any(|point| !point.is_reaction()) {
        let message = "an objective has either motions, in mm, or reactions, in mN".to_owned();
        return refused("points", message, "use two targets in two stages");
    }
    let given = [
        ("value", measured.value.is_some()),
        ("time", measured.motion.time.is_some()),
        ("robust", measured.motion.robust.is_some()),
        ("frequency", frequency.is_some()),
        (
            "measure",
            measured
                .motion
                .measure
                .is_some_and(|measure| measure.name() != Displacement.name()),
        ),
    ];
    match given.into_iter().find(|(_, given)| *given) {
        None => Ok(()),
        Some((key, _)) => refused(key, format!("`{key}` cannot be used with a reaction"), "remove it"),
    }
}

impl Objective {
    fn new(
        points: Vec<PointOrBody>,
        measured: MeasureParameters,
        frequency: Option<Frequency>,
        node: &Node,
    ) -> Result<Self, InputError> {
        if points.iter().any(PointOrBody::is_reaction) {
            refuse_keys_of_motions(&points, (&measured, &frequency), node)?;
        }
        let MeasureParameters { value, motion } = measured;
        let MotionMeasure { measure, time, robust } = motion;
        let has_targets = value.is_some() || points.iter().all(PointOrBody::has_target);
        let default: &'static dyn Measure = if has_targets { &Distance } else { &Displacement };
        let objective = Self {
            points,
            measure: measure.unwrap_or(default),
            value,
            response: match (time, frequency) {
                (_, Some(frequency)) => ResponseKind::Amplitude(frequency),
                (Some(time), None) => ResponseKind::After(time),
                (None, None) => ResponseKind::Equilibrium,
            },
            robust,
        };
        if let (Some(_), Some(time)) = (node.peek("robust"), node.peek("time")) {
            let message =
                "`time` cannot be used with `robust`: creep is not simulated in cells that are covered in part";
            return Err(time.error(message).help("remove one of them"));
        }
        match objective.response {
            ResponseKind::Amplitude(_) => objective.check_amplitude(node)?,
            ResponseKind::Equilibrium | ResponseKind::After(_) => objective.check(node)?,
        }
        Ok(objective)
    }

    /// Whether it counts heights or volumes.
    #[must_use]
    pub fn is_out_of_plane(&self) -> bool {
        self.points.iter().any(PointOrBody::is_out_of_plane)
    }

    /// Whether its values are forces of sides in mN, and not displacements in mm.
    #[must_use]
    pub fn is_reaction(&self) -> bool {
        self.points.iter().any(PointOrBody::is_reaction)
    }

    /// Refuses keys that contradict each other.
    fn check(&self, node: &Node) -> Result<(), InputError> {
        let targets = self.points.iter().filter(|point| point.has_target()).count();
        let is_mixed = targets > 0 && targets < self.points.len();
        let refused = |key, message: &str, help: &str| Err(node.peek(key).unwrap_or(node).error(message).help(help));
        match (self.measure.needs_displacement(), &self.value) {
            (true, None) if targets < self.points.len() => refused(
                "measure",
                "`measure: distance` needs a target displacement for each point",
                "give the objective a `value`, or each point a `displacement: [x, y]` and each body a \
                 `translation` or a `rotation` by an angle",
            ),
            (false, Some(_)) => refused(
                "value",
                "`value` needs `measure: distance`; the objective has another measure",
                "remove `measure` or `value`",
            ),
            _ if is_mixed => refused(
                "points",
                "some points and bodies have a target displacement, angle or area, others only a direction",
                "use targets for all of them, or directions for all of them",
            ),
            (_, Some(_)) if targets > 0 => refused(
                "value",
                "`value` cannot be used with a `displacement`, `translation` or angle",
                "remove one of them",
            ),
            (_, Some(_)) if self.points.iter().any(PointOrBody::is_farthest_scalar) => refused(
                "value",
                "`value` is a length in the plane and cannot be used with a rotation, an area, a height or a volume",
                "give the target as `rotation`, `area_strain`, `height` or `volume`",
            ),
            _ if !self.measure.supports_scalars() && self.points.iter().any(PointOrBody::is_scalar) => refused(
                "measure",
                &format!(
                    "`measure: {}` cannot be used with a rotation, an area, a height or a volume",
                    self.measure.name()
                ),
                "remove `measure`",
            ),
            _ => Ok(()),
        }
    }

    /// Refuses keys that cannot be used with an amplitude.
    fn check_amplitude(&self, node: &Node) -> Result<(), InputError> {
        let other = ["time", "value", "displacement", "robust"]
            .into_iter()
            .find_map(|key| Some((key, node.peek(key)?)));
        if let Some((key, other)) = other {
            let message = format!("`{key}` cannot be used with `frequency`");
            return Err(other.error(message).help("remove one of them"));
        }
        if self.measure.name() != Displacement.name() {
            let measure = node.peek("measure").unwrap_or(node);
            let message = format!("`measure: {}` cannot be used with `frequency`", self.measure.name());
            return Err(measure.error(message).help("remove one of them"));
        }
        let is_along = |one: &PointOrBody| matches!(one, PointOrBody::Point(point) if point.direction.is_some());
        match self.points.iter().all(is_along) {
            true => Ok(()),
            false => Err(node
                .peek("points")
                .unwrap_or(node)
                .error("`frequency` can only be used with points along directions")
                .help("give each point a `direction`; remove bodies and displacements")),
        }
    }

    /// Reads a point (`{ point, direction }`), a rigid body (`{ body, direction }`), a bar (`{ bar, direction }`) or
    /// the force of a side (`{ reaction, direction }`), the area of a region (`{ region, area_strain }`), a volume
    /// (`{ volume }`), several of them (`{ points: [{ point, direction, weight, state
    /// }, …] }`), or a target field (`{ field: FILE.csv }`). In place of a direction a point may have a target
    /// `displacement: [x, y]` or a `height`, a body a `translation: [x, y]`, a `rotation` or a `height`. Optional keys
    /// are `measure`, `value` (the target displacement along each direction), `time` and `frequency`.
    ///
    /// # Errors
    /// If a key is unknown or missing, a value is invalid, or the keys contradict each other.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let (points, measured, frequency) = if node.peek("points").is_some() {
            let read = ManyPoints::read_with(node, &[])?;
            (read.points, read.measured, read.amplitude.frequency)
        } else if node.peek("field").is_some() {
            let FieldObjective { field, time } = FieldObjective::read_with(node, &[])?;
            let mut measured = MeasureParameters::default();
            measured.motion.time = time;
            (field.0.into_iter().map(PointOrBody::Point).collect(), measured, None)
        } else if node.peek("body").is_some() {
            let OneBody { body, measured } = OneBody::read_with(node, &[])?;
            (vec![PointOrBody::Body(body)], measured, None)
        } else if node.peek("bar").is_some() {
            let OneBar { bar, measured } = OneBar::read_with(node, &[])?;
            (vec![PointOrBody::Bar(bar)], measured, None)
        } else if node.peek("region").is_some() {
            let OneRegion { region, measured } = OneRegion::read_with(node, &[])?;
            let measured = MeasureParameters {
                value: None,
                motion: measured,
            };
            (vec![PointOrBody::Region(Box::new(region))], measured, None)
        } else if node.peek("volume").is_some() {
            let OneVolume { volume, measure } = OneVolume::read_with(node, &[])?;
            let measured = MeasureParameters {
                value: None,
                motion: MotionMeasure {
                    measure,
                    ..MotionMeasure::default()
                },
            };
            (vec![PointOrBody::Volume(volume)], measured, None)
        } else if node.peek("reaction").is_some() {
            let reaction = ReactionParameters::read_with(node, &[])?;
            (
                vec![PointOrBody::Reaction(reaction)],
                MeasureParameters::default(),
                None,
            )
        } else {
            let read = OnePoint::read_with(node, &[])?;
            (
                vec![PointOrBody::Point(read.point)],
                read.measured,
                read.amplitude.frequency,
            )
        };
        Self::new(points, measured, frequency, node)
    }

    /// The objective in YAML on one line.
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
        if !self.is_reaction() {
            entries.push(("measure", self.measure.name().to_owned()));
        }
        entries.extend(match self.response {
            ResponseKind::Equilibrium => None,
            ResponseKind::After(time) => Some(("time", time.to_string())),
            ResponseKind::Amplitude(frequency) => Some(("frequency", frequency.to_string())),
        });
        entries.extend(self.robust.as_ref().map(|robust| ("robust", robust.to_text())));
        flow_mapping(entries)
    }

    /// Whether it counts for electrodes as they may be fabricated.
    #[must_use]
    pub fn is_robust(&self) -> bool {
        self.robust.is_some()
    }

    /// The masks that count; `None` for that as drawn.
    ///
    /// # Errors
    /// If no mask differs from that drawn, or one differs by too many cells.
    pub fn masks(&self, membrane: Membrane) -> Result<Option<Masks>, GoalError> {
        let masks = self.robust.as_ref().map(|robust| robust.masks(membrane));
        masks.transpose().map_err(GoalError::Masks)
    }

    /// Whether its masks are those of the tolerances of a scene.
    pub(crate) fn takes_tolerances(&self) -> bool {
        self.robust.as_ref().is_some_and(Robust::takes_tolerances)
    }

    /// Takes standard deviations of masks that are not given from the tolerances of a scene.
    #[must_use]
    pub fn with_tolerances(self, tolerances: Option<&Tolerances>) -> Self {
        let robust = match (self.robust, tolerances) {
            (Some(robust), Some(tolerances)) => Some(robust.with_tolerances(tolerances)),
            (robust, _) => robust,
        };
        Self { robust, ..self }
    }

    /// The response that is measured.
    #[must_use]
    pub fn response(&self) -> ResponseKind {
        self.response
    }

    /// The goal in a scene, for the mask as drawn.
    ///
    /// # Errors
    /// If a point is not inside the membrane, a number is out of range, or the scene has no such body or state.
    pub fn goal(&self, scene: &Scene, area: Option<f64>, area_penalty: f64) -> Result<Goal, GoalError> {
        let aims = self.points.iter().map(|point| point.aim(self.value, scene));
        let aims: Vec<Aim> = aims.collect::<Result<_, _>>()?;
        let goal = Goal::new(self.measure, &aims, scene.membrane(), area, area_penalty)?;
        Ok(goal.with_strokes(scene.geometry.sides.is_some()))
    }
}

impl Parameter for Objective {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, _key: &str, (): &()) -> Result<Self, InputError> {
        Self::read(node)
    }

    /// Equal for one point and for a list of one point; contains the default measure.
    fn canonical(&self) -> Option<Canonical> {
        let points = Canonical::List(self.points.iter().filter_map(Parameter::canonical).collect());
        let value = self.value.as_ref().and_then(Parameter::canonical);
        let own = [("points", points), ("measure", self.measure.name().into())];
        let value = value.map(|value| ("value", value));
        let response = match &self.response {
            ResponseKind::Equilibrium => None,
            ResponseKind::After(time) => time.canonical().map(|time| ("time", time)),
            ResponseKind::Amplitude(frequency) => frequency.canonical().map(|frequency| ("frequency", frequency)),
        };
        let robust = self.robust.as_ref().map(|robust| ("robust", robust.to_canonical()));
        Some(Canonical::map(
            own.into_iter().chain(value).chain(response).chain(robust),
        ))
    }

    fn schema((): &()) -> Schema {
        let forms = [
            OnePoint::fields(),
            OneBody::fields(),
            OneBar::fields(),
            ReactionParameters::fields(),
            OneRegion::fields(),
            OneVolume::fields(),
            ManyPoints::fields(),
            FieldObjective::fields(),
        ];
        Schema::any_of(forms.map(Schema::from))
    }

    fn literal(literal: Self) -> Self {
        literal
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
    fn objectives_round_trip_through_text() {
        for text in [
            "{ point: [2.5 cm, 25], direction: 45 deg }",
            "{ points: [{ point: [1, 2], direction: 0 }, { point: [3, 4], direction: -90 deg, weight: 2.5 }], \
             measure: qin2024 }",
            "{ point: [25, 25], direction: 30 deg, value: 1.00 mm }",
            "{ point: [25, 25], direction: 30 deg, time: 10 min }",
            "{ point: [25, 25], direction: 30 deg, frequency: 40 Hz }",
            "{ points: [{ point: [1, 2], direction: 0 }, { point: [3, 4], direction: 90 deg }], frequency: 1 kHz }",
            "{ points: [{ point: [1, 2], displacement: [0.1 mm, -0.2 mm] }, { point: [3, 4], displacement: [0, 0] }] }",
            "{ point: [25, 25], direction: 30 deg, robust: { worst: [-0.3 mm, 0 mm, { misregistration: [0.2 mm, 0 mm] }] } }",
            "{ body: 0, direction: 0, robust: { mean_minus: 2, mask: 0.15 mm, misregistration: 0.1 mm } }",
            "{ reaction: right, direction: 180 deg }",
            "{ points: [{ reaction: right, direction: 0, weight: 2 }, { reaction: top, direction: 90 deg, state: on }] }",
            "{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest }",
            "{ points: [{ region: { rectangle: [[1 mm, 2 mm], [9 mm, 8 mm]] }, area_strain: 5 %, weight: 2 }, \
             { point: [1, 2], displacement: [0, 1] }] }",
            "{ point: [25 mm, 25 mm], height: up }",
            "{ body: 0, height: -1.5 mm }",
            "{ volume: largest }",
            "{ points: [{ volume: 0.5 ml, weight: 2 }, { point: [1, 2], height: 1 mm }] }",
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
            "{ point: [1, 2], direction: 0, time: 1 s, robust: { worst: [0.3 mm] } }",
            "{ point: [1, 2], direction: 0, frequency: 1 Hz, robust: { worst: [0.3 mm] } }",
            "{ points: [{ reaction: right, direction: 0 }], robust: { worst: [0.3 mm] } }",
            "{ reaction: right }",
            "{ reaction: middle, direction: 0 }",
            "{ reaction: right, direction: 0, value: 1 mm }",
            "{ reaction: right, direction: 0, time: 1 s }",
            "{ points: [{ reaction: right, direction: 0 }], value: 1 mm }",
            "{ points: [{ reaction: right, direction: 0 }], time: 1 s }",
            "{ points: [{ reaction: right, direction: 0 }], frequency: 1 Hz }",
            "{ points: [{ reaction: right, direction: 0 }], measure: qin2024 }",
            "{ points: [{ reaction: right, direction: 0 }, { bar: right, direction: 0 }] }",
            "{ point: [1, 2], height: 1 mm, direction: 0 }",
            "{ point: [1, 2], height: left }",
            "{ point: [1, 2], height: up, value: 1 mm }",
            "{ point: [1, 2], height: up, measure: qin2024 }",
            "{ points: [{ point: [1, 2], height: up }], frequency: 1 Hz }",
            "{ points: [{ point: [1, 2], height: up }, { volume: 1 ml }] }",
            "{ volume: larger }",
            "{ volume: largest, value: 1 mm }",
            "{ volume: largest, direction: 0 }",
            "{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } } }",
            "{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: larger }",
            "{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: 101 % }",
            "{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest, value: 1 mm }",
            "{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest, measure: qin2024 }",
            "{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: largest, measure: distance }",
            "{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, direction: 0 deg }",
            "{ points: [{ region: { disc: { centre: [25 mm, 25 mm], radius: 4 mm } }, area_strain: 5 % }, \
             { point: [1, 2], direction: 0 }] }",
        ] {
            assert!(read(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_reaction_needs_a_side_that_holds_the_membrane_along_its_direction() {
        let goal = |sides: &str, drive: &str, objective: &str| {
            let scene = format!(
                "{{ geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 2, cells: [20, 10], sides: {sides} \
                 }}, material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ \
                 {drive} }} }}"
            );
            let goal = read(objective)
                .unwrap()
                .goal(&Scene::from_text(&scene).unwrap(), None, 0.0);
            goal.map(|goal| goal.unit()).map_err(|error| error.to_string())
        };
        let bar = |more: &str| format!("{{ right: {{ bar: {{ {more} }} }}, top: free, bottom: roller }}");
        let blocked = bar("displacement: [0 mm, 0 mm]");
        let (sprung, moves) = (bar("moves: [x], spring: 10 N/m"), bar("moves: [x]"));
        let drive = "voltage: 4 kV";
        for (sides, drive, side, degrees, expected) in [
            (&*blocked, drive, "right", "180", Ok("mN")),
            (&blocked, drive, "left", "37", Ok("mN")),
            (&blocked, drive, "bottom", "-90", Ok("mN")),
            (
                &blocked,
                drive,
                "bottom",
                "0",
                Err("the bottom side does not hold the membrane along x"),
            ),
            (
                &blocked,
                drive,
                "top",
                "90",
                Err("the top side does not hold the membrane along y"),
            ),
            (&sprung, drive, "right", "30", Ok("mN")),
            (&moves, drive, "right", "90", Ok("mN")),
            (
                &moves,
                drive,
                "right",
                "89",
                Err("the bar on the right side moves freely along x, so its force"),
            ),
            (
                "{ left: held }",
                drive,
                "right",
                "0",
                Err("`sides` that are not all held"),
            ),
            (
                &blocked,
                "charge: { total: 1 uC }",
                "right",
                "0",
                Err("this one is a charge"),
            ),
        ] {
            let found = goal(
                sides,
                drive,
                &format!("{{ reaction: {side}, direction: {degrees} deg }}"),
            );
            match (found, expected) {
                (Ok(unit), Ok(expected)) => assert_eq!(unit, expected),
                (Err(error), Err(expected)) => assert!(error.contains(expected), "{error}"),
                (found, expected) => panic!("{sides} {side} {degrees}: {found:?} {expected:?}"),
            }
        }
        assert_eq!(
            goal(&sprung, "voltage: 4 kV", "{ bar: right, direction: 0 deg }"),
            Ok("mm")
        );
    }

    #[test]
    fn an_invalid_rotation_is_named() {
        let error = read("{ body: 0, rotation: sideways }").unwrap_err().to_string();
        assert!(error.contains("`rotation` cannot be \"sideways\""), "{error}");
    }
}
