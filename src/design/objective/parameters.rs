//! What a design is for, as it stands in a pipeline.

use serde_json::json;

use super::aim::{Aim, Motion};
use super::field_file;
use super::goal::{Goal, GoalError};
use super::measure::{Displacement, Distance, MEASURES, Measure};
use crate::base::{
    Angle, Canonical, Decimal, Declared, Fields, InputError, Length, Map, Node, Parameter, Schema, parameters,
};
use crate::design::text::{flow_mapping, flow_value};
use crate::pattern::Membrane;

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
    }
    rules(either_motion)
    check(PointParameters::check)
}

parameters! {
    /// How displacements are measured.
    struct MeasureParameters as "the objective" {
        /// The displacement wanted along each direction, no more and no less.
        value: Option<Length> [-LONGEST_MM..=LONGEST_MM],
        /// How a motion is measured: its component along the direction (the default where points have directions), its distance from
        /// what is wanted (the default where that is given), or the paper's formula.
        measure: Option<&'static dyn Measure>,
    }
}

parameters! {
    /// A point and where it should move.
    struct OnePoint as "the objective" {}
    include {
        /// The point.
        point: PointParameters,
        /// How it is measured.
        measured: MeasureParameters,
    }
}

parameters! {
    /// Points whose displacements count by their weighted mean.
    struct ManyPoints as "the objective" {
        /// The points.
        points: Vec<PointParameters> [((), 1..=usize::MAX)],
    }
    include {
        /// How they are measured.
        measured: MeasureParameters,
    }
}

parameters! {
    /// A wanted displacement field.
    struct WantedField as "the objective" {
        /// A CSV file beside the pipeline or below with the columns x_mm, y_mm, ux_mm, uy_mm.
        field: FieldPoints,
    }
}

/// The points of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct FieldPoints(Vec<PointParameters>);

/// What a design is for: points, how each should move, and how that is measured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Objective {
    points: Vec<PointParameters>,
    measure: &'static dyn Measure,
    value: Option<Length>,
}

fn either_motion(fields: Fields) -> Fields {
    fields.rule(json!({ "oneOf": [{ "required": ["direction"] }, { "required": ["displacement"] }] }))
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

    /// As a value is in a pipeline, the usual weight left out.
    fn text_entries(&self) -> Vec<(&'static str, String)> {
        let mut entries = Vec::new();
        self.entries(&mut entries);
        let usual = self.weight.to_f64() == 1.0;
        entries.retain(|(key, _)| *key != "weight" || !usual);
        entries
            .into_iter()
            .map(|(key, value)| (key, flow_value(&value)))
            .collect()
    }

    fn aim(&self, value: Option<Length>) -> Aim {
        Aim {
            point_mm: self.point.map(|c| c.value()),
            motion: match (&self.displacement, &self.direction, value) {
                (Some(vector), ..) => Motion::To(vector.map(|c| c.value())),
                (None, Some(angle), Some(value)) => Motion::By(angle.value(), value.value()),
                (None, angle, _) => Motion::Along(angle.map_or(0.0, |angle| angle.value())),
            },
            weight: self.weight.to_f64(),
        }
    }
}

impl Objective {
    fn new(points: Vec<PointParameters>, measured: Option<MeasureParameters>, node: &Node) -> Result<Self, InputError> {
        let (measure, value) = measured.map_or((None, None), |measured| (measured.measure, measured.value));
        let wanted = value.is_some() || points.iter().all(|point| point.displacement.is_some());
        let usual: &'static dyn Measure = if wanted { &Distance } else { &Displacement };
        let objective = Self {
            points,
            measure: measure.unwrap_or(usual),
            value,
        };
        objective.check(node)?;
        Ok(objective)
    }

    /// Refuses keys that contradict each other.
    fn check(&self, node: &Node) -> Result<(), InputError> {
        let vectors = self.points.iter().filter(|point| point.displacement.is_some()).count();
        let at = |key| node.peek(key).unwrap_or(node);
        match (self.measure.needs_displacement(), &self.value) {
            (true, None) if vectors < self.points.len() => Err(at("measure")
                .error("a distance is measured from a wanted displacement, and a point has none")
                .help("give each point `displacement: [x, y]` in place of a direction, or the objective a `value`")),
            (false, Some(_)) => Err(at("value")
                .error("`value` is the displacement from which the distance is measured, and this measure is another")
                .help("leave `measure` out, or `value`")),
            (_, Some(_)) if vectors > 0 => Err(at("value")
                .error("`value` stands for the length of the displacements, and a point has its `displacement`")
                .help("give either")),
            _ => Ok(()),
        }
    }

    /// Reads a point (`{ point, direction }`), points (`{ points: [{ point, direction, weight }, …] }`, or `displacement: [x, y]`
    /// in place of a direction), with an optional `measure`, and an optional `value`: the displacement that is wanted along each
    /// direction; or a wanted field (`{ field: FILE.csv }`).
    ///
    /// # Errors
    /// When a key is unknown or missing, a value is no length or angle, or the keys contradict each other.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let (points, measured) = if node.peek("points").is_some() {
            let ManyPoints { points, measured } = ManyPoints::read_with(node, &[])?;
            (points, Some(measured))
        } else if node.peek("field").is_some() {
            (WantedField::read_with(node, &[])?.field.0, None)
        } else {
            let OnePoint { point, measured } = OnePoint::read_with(node, &[])?;
            (vec![point], Some(measured))
        };
        Self::new(points, measured, node)
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
        flow_mapping(entries)
    }

    /// The goal on a membrane.
    ///
    /// # Errors
    /// When a point lies outside the membrane or a number out of range.
    pub fn goal(&self, membrane: Membrane, area: Option<f64>, area_penalty: f64) -> Result<Goal, GoalError> {
        let aims: Vec<Aim> = self.points.iter().map(|point| point.aim(self.value)).collect();
        Goal::new(self.measure, &aims, membrane, area, area_penalty)
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
        let points = Canonical::List(self.points.iter().map(Declared::to_canonical).collect());
        let value = self.value.as_ref().and_then(Parameter::canonical);
        let own = [("points", points), ("measure", self.measure.name().into())];
        let value = value.map(|value| ("value", value));
        Some(Canonical::map(own.into_iter().chain(value)))
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([OnePoint::fields(), ManyPoints::fields(), WantedField::fields()].map(Schema::from))
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
    use crate::base::Document;

    fn read(text: &str) -> Result<Objective, InputError> {
        Objective::read(&Document::from_text(Path::new("t"), text).unwrap().root)
    }

    #[test]
    fn an_objective_survives_its_own_text() {
        for text in [
            "{ point: [2.5 cm, 25], direction: 45 deg }",
            "{ points: [{ point: [1, 2], direction: 0 }, { point: [3, 4], direction: -90 deg, weight: 2.5 }], measure: qin2024 }",
            "{ point: [25, 25], direction: 30 deg, value: 1.00 mm }",
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
        ] {
            assert!(read(text).is_err(), "{text}");
        }
    }
}
