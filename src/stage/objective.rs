//! The objective of a design as it stands in a pipeline and, word for word the same, in an artifact.

use crate::base::{Canonical, Dimension, Fields, InputError, Node, Quantity, Schema};
use crate::design::{Aim, Goal, GoalError, Measure};

/// A point, where it should move, and how a motion is measured.
pub struct Objective {
    aims: Vec<(Point, Quantity)>,
    measure: Measure,
}

type Point = [Quantity; 2];

const MEASURES: [&str; 2] = ["displacement", "qin2024"];

impl Objective {
    /// Reads `{ point, direction }` or `{ points: [{ point, direction }, …] }`, either with an optional `measure`.
    ///
    /// # Errors
    /// When a key is unknown or missing, or a value is no length or angle.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let what = "the objective";
        let many = node.peek("points").is_some();
        let keys: &[&str] = if many {
            &["points", "measure"]
        } else {
            &["point", "direction", "measure"]
        };
        let map = node.fields(what, keys)?;
        let measure = map
            .optional("measure")
            .map_or(Ok("displacement"), |n| n.word("measure", &MEASURES))?;
        let measure = if measure == "qin2024" {
            Measure::Qin2024
        } else {
            Measure::Displacement
        };
        let aims = if many {
            let list = map.required(what, "points")?.list("points")?;
            list.iter()
                .map(|aim| read_aim(aim, &["point", "direction"]))
                .collect::<Result<_, _>>()?
        } else {
            vec![read_aim(node, keys)?]
        };
        Ok(Self { aims, measure })
    }

    /// What [`Objective::read`] accepts.
    pub fn schema() -> Schema {
        let measure = || {
            let word = Schema::word(&MEASURES).default("displacement");
            word.says("How a motion is measured: its component along the direction, or the paper's formula.")
        };
        let aims = Schema::list(aim_schema("A point and where it should move.").into(), 1, usize::MAX);
        let many = Fields::new("Points whose displacements count by their mean.")
            .required("points", aims)
            .optional("measure", measure());
        let one = aim_schema("A point and where it should move.").optional("measure", measure());
        Schema::any_of([one.into(), many.into()]).says("What the design is for.")
    }

    /// The canonical value.
    pub fn canonical(&self) -> Canonical {
        let aim = |(point, direction): &(Point, Quantity)| {
            Canonical::map([
                ("point", point.iter().collect()),
                ("direction", Canonical::from(direction)),
            ])
        };
        let aims = Canonical::List(self.aims.iter().map(aim).collect());
        Canonical::map([("points", aims), ("measure", self.measure_name().into())])
    }

    /// The objective in its own YAML syntax on one line.
    pub fn to_text(&self) -> String {
        let aim = |(p, d): &(Point, Quantity)| format!("point: [{}, {}], direction: {d}", p[0], p[1]);
        let measure = self.measure_name();
        match &self.aims[..] {
            [single] => format!("{{ {}, measure: {measure} }}", aim(single)),
            many => {
                let list: Vec<String> = many.iter().map(|a| format!("{{ {} }}", aim(a))).collect();
                format!("{{ points: [{}], measure: {measure} }}", list.join(", "))
            }
        }
    }

    /// The goal on a membrane of a side in mm.
    ///
    /// # Errors
    /// When a point lies outside the membrane or a number out of range.
    pub fn goal(&self, side_mm: f64, area: f64, area_penalty: f64) -> Result<Goal, GoalError> {
        let aim = |(point, direction): &(Point, Quantity)| Aim {
            point_mm: [point[0].value(), point[1].value()],
            direction_deg: direction.value(),
        };
        Goal::new(
            self.measure,
            &self.aims.iter().map(aim).collect::<Vec<_>>(),
            side_mm,
            area,
            area_penalty,
        )
    }

    fn measure_name(&self) -> &'static str {
        match self.measure {
            Measure::Displacement => "displacement",
            Measure::Qin2024 => "qin2024",
        }
    }
}

fn read_aim(node: &Node, keys: &[&str]) -> Result<(Point, Quantity), InputError> {
    let what = "the objective";
    let map = node.fields(what, keys)?;
    let point = map.required(what, "point")?;
    let [x, y] = point.list("point")? else {
        return Err(point
            .error("`point` must have two coordinates")
            .help("for example [25 mm, 25 mm]"));
    };
    let length = |node: &Node| node.quantity_in("point", Dimension::Length, 0.0, 1e4);
    let direction = map
        .required(what, "direction")?
        .quantity_in("direction", Dimension::Angle, -360.0, 360.0)?;
    Ok(([length(x)?, length(y)?], direction))
}

fn aim_schema(description: &str) -> Fields {
    let point = Schema::list(Schema::quantity(Dimension::Length, 0.0, 1e4), 2, 2);
    let direction = Schema::quantity(Dimension::Angle, -360.0, 360.0);
    Fields::new(description)
        .required("point", point.says("Its place, such as [25 mm, 25 mm]."))
        .required("direction", direction.says("Counterclockwise from the x axis."))
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
            "{ points: [{ point: [1, 2], direction: 0 }, { point: [3, 4], direction: -90 deg }], measure: qin2024 }",
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
        ] {
            assert!(read(text).is_err(), "{text}");
        }
    }
}
