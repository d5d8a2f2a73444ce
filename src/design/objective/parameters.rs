//! What a design is for, as it stands in a pipeline.

use super::aim::{Aim, Motion};
use super::field_file;
use super::goal::{Goal, GoalError};
use super::measure::{Displacement, Distance, MEASURES, Measure};
use crate::base::{Canonical, Decimal, Dimension, Fields, InputError, Map, Node, Quantity, Schema};

/// What a design is for: points, how each should move, and how that is measured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Objective {
    aims: Vec<AimText>,
    measure: &'static dyn Measure,
    value: Option<Quantity>,
}

/// A point and how it should move, as written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct AimText {
    pub(super) point: [Quantity; 2],
    pub(super) motion: MotionText,
    pub(super) weight: Decimal,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum MotionText {
    Direction(Quantity),
    Displacement([Quantity; 2]),
}

const WHAT: &str = "the objective";

const AIM_KEYS: [&str; 4] = ["point", "direction", "displacement", "weight"];

/// Largest coordinate and displacement in mm.
pub(super) const LONGEST_MM: f64 = 1e4;

impl Objective {
    /// Reads a point (`{ point, direction }`), points (`{ points: [{ point, direction, weight }, …] }`, or `displacement: [x, y]`
    /// in place of a direction), with an optional `measure`, and an optional `value`: the displacement that is wanted along each
    /// direction; or a wanted field (`{ field: FILE.csv }`).
    ///
    /// # Errors
    /// When a key is unknown or missing, a value is no length or angle, or the keys contradict each other.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let many = ["points", "field"].into_iter().find(|key| node.peek(key).is_some());
        let keys: &[&str] = match many {
            Some("points") => &["points", "measure", "value"],
            Some(_) => &["field"],
            None => &[&AIM_KEYS[..], &["measure", "value"]].concat(),
        };
        let map = node.fields(WHAT, keys)?;
        let aims = match many {
            Some("points") => {
                let list = map.required(WHAT, "points")?;
                let aims = list.list("points")?;
                if aims.is_empty() {
                    return Err(list.error("`points` is empty").help("name at least one point"));
                }
                let aim = |aim: &Node| read_aim(&aim.fields("a point of the objective", &AIM_KEYS)?);
                aims.iter().map(aim).collect::<Result<_, _>>()?
            }
            Some(_) => field_file::read(map.required(WHAT, "field")?)?,
            None => vec![read_aim(&map)?],
        };
        let value = map.optional("value");
        let value = value.map(|n| n.quantity_in("value", Dimension::Length, -LONGEST_MM, LONGEST_MM));
        let objective = Self {
            measure: read_measure(&map, &aims)?,
            aims,
            value: value.transpose()?,
        };
        objective.check(node, &map)
    }

    /// Refuses keys that contradict each other.
    fn check(self, node: &Node, map: &Map<'_>) -> Result<Self, InputError> {
        let vectors = self
            .aims
            .iter()
            .filter(|aim| matches!(aim.motion, MotionText::Displacement(_)));
        let vectors = vectors.count();
        let at = |key| map.optional(key).unwrap_or(node);
        match (self.measure.needs_displacement(), &self.value) {
            (true, None) if vectors < self.aims.len() => Err(at("measure")
                .error("a distance is measured from a wanted displacement, and a point has none")
                .help("give each point `displacement: [x, y]` in place of a direction, or the objective a `value`")),
            (false, Some(_)) => Err(at("value")
                .error("`value` is the displacement from which the distance is measured, and this measure is another")
                .help("leave `measure` out, or `value`")),
            (_, Some(_)) if vectors > 0 => Err(at("value")
                .error("`value` stands for the length of the displacements, and a point has its `displacement`")
                .help("give either")),
            _ => Ok(self),
        }
    }

    /// What [`Objective::read`] accepts.
    pub fn schema() -> Schema {
        let measured = |fields: Fields| {
            let measure = Schema::word(&MEASURES.map(Measure::name)).says(
                "How a motion is measured: its component along the direction (the default where points have directions), its \
                 distance from what is wanted (the default where that is given), or the paper's formula.",
            );
            let value = Schema::quantity(Dimension::Length, -LONGEST_MM, LONGEST_MM);
            fields.optional("measure", measure).optional(
                "value",
                value.says("The displacement wanted along each direction, no more and no less."),
            )
        };
        let aims = Schema::list(aim_schema().into(), 1, usize::MAX);
        let many = Fields::new("Points whose displacements count by their weighted mean.").required("points", aims);
        let file =
            Schema::text().says("A CSV file beside the pipeline or below with the columns x_mm, y_mm, ux_mm, uy_mm.");
        let wanted = Fields::new("A wanted displacement field.").required("field", file);
        let all = [measured(aim_schema()), measured(many), wanted];
        Schema::any_of(all.map(Schema::from)).says("What the design is for.")
    }

    /// The canonical value.
    pub fn canonical(&self) -> Canonical {
        let aim = |aim: &AimText| {
            let (key, motion) = match &aim.motion {
                MotionText::Direction(angle) => ("direction", Canonical::from(angle)),
                MotionText::Displacement(vector) => ("displacement", vector.iter().collect()),
            };
            Canonical::map([
                ("point", aim.point.iter().collect()),
                (key, motion),
                ("weight", aim.weight.into()),
            ])
        };
        Canonical::map([
            ("points", Canonical::List(self.aims.iter().map(aim).collect())),
            ("measure", self.measure.name().into()),
            ("value", self.value.as_ref().map_or(Canonical::Null, Canonical::from)),
        ])
    }

    /// The objective in its own YAML syntax on one line.
    pub fn to_text(&self) -> String {
        let aim = |aim: &AimText| {
            let motion = match &aim.motion {
                MotionText::Direction(angle) => format!("direction: {angle}"),
                MotionText::Displacement([x, y]) => format!("displacement: [{x}, {y}]"),
            };
            let weight = match aim.weight.to_f64() {
                1.0 => String::new(),
                _ => format!(", weight: {}", aim.weight),
            };
            format!("point: [{}, {}], {motion}{weight}", aim.point[0], aim.point[1])
        };
        let value = self
            .value
            .as_ref()
            .map_or(String::new(), |value| format!(", value: {value}"));
        let more = format!("{value}, measure: {}", self.measure.name());
        match &self.aims[..] {
            [single] => format!("{{ {}{more} }}", aim(single)),
            many => {
                let list: Vec<String> = many.iter().map(|a| format!("{{ {} }}", aim(a))).collect();
                format!("{{ points: [{}]{more} }}", list.join(", "))
            }
        }
    }

    /// The goal on a membrane of a side in mm.
    ///
    /// # Errors
    /// When a point lies outside the membrane or a number out of range.
    pub fn goal(&self, side_mm: f64, area: Option<f64>, area_penalty: f64) -> Result<Goal, GoalError> {
        let aim = |aim: &AimText| Aim {
            point_mm: aim.point.each_ref().map(Quantity::value),
            motion: match (&aim.motion, &self.value) {
                (MotionText::Direction(angle), None) => Motion::Along(angle.value()),
                (MotionText::Direction(angle), Some(value)) => Motion::By(angle.value(), value.value()),
                (MotionText::Displacement(vector), _) => Motion::To(vector.each_ref().map(Quantity::value)),
            },
            weight: aim.weight.to_f64(),
        };
        let aims: Vec<Aim> = self.aims.iter().map(aim).collect();
        Goal::new(self.measure, &aims, side_mm, area, area_penalty)
    }
}

fn read_measure(map: &Map<'_>, aims: &[AimText]) -> Result<&'static dyn Measure, InputError> {
    let wanted =
        map.optional("value").is_some() || aims.iter().all(|a| matches!(a.motion, MotionText::Displacement(_)));
    match map.optional("measure") {
        Some(node) => {
            let word = node.word("measure", &MEASURES.map(Measure::name))?;
            let found = MEASURES.into_iter().find(|measure| measure.name() == word);
            Ok(found.unwrap_or(&Displacement))
        }
        None if wanted => Ok(&Distance),
        None => Ok(&Displacement),
    }
}

fn read_aim(map: &Map<'_>) -> Result<AimText, InputError> {
    let point = pair(map.required(WHAT, "point")?, "point", 0.0)?;
    let motion = match (map.optional("displacement"), map.optional("direction")) {
        (Some(node), Some(_)) => {
            return Err(node
                .error("`displacement` says the direction too, so `direction` cannot stand beside it")
                .help("give either"));
        }
        (Some(node), None) => MotionText::Displacement(pair(node, "displacement", -LONGEST_MM)?),
        (None, _) => MotionText::Direction(map.required(WHAT, "direction")?.quantity_in(
            "direction",
            Dimension::Angle,
            -360.0,
            360.0,
        )?),
    };
    Ok(AimText {
        point,
        motion,
        weight: map.number("weight", 1.0, 1e-9, 1e9)?,
    })
}

/// Two lengths in mm, from `low` up.
fn pair(node: &Node, field: &str, low: f64) -> Result<[Quantity; 2], InputError> {
    let length = |node: &Node| node.quantity_in(field, Dimension::Length, low, LONGEST_MM);
    match node.list(field)? {
        [x, y] => Ok([length(x)?, length(y)?]),
        _ => Err(node
            .error(format!("`{field}` must have two components"))
            .help("for example [25 mm, 25 mm]")),
    }
}

fn aim_schema() -> Fields {
    let pair = |low| Schema::list(Schema::quantity(Dimension::Length, low, LONGEST_MM), 2, 2);
    let direction = Schema::quantity(Dimension::Angle, -360.0, 360.0);
    Fields::new("A point and where it should move.")
        .required("point", pair(0.0).says("Its place, such as [25 mm, 25 mm]."))
        .optional("direction", direction.says("Counterclockwise from the x axis."))
        .optional(
            "displacement",
            pair(-LONGEST_MM).says("The displacement that is wanted, in place of a direction."),
        )
        .optional(
            "weight",
            Schema::number(1e-9, 1e9)
                .says("What the point counts beside others.")
                .default(1.0),
        )
        .rule(serde_json::json!({ "oneOf": [{ "required": ["direction"] }, { "required": ["displacement"] }] }))
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
