//! What a design stage designs: one objective, or several by name.

use std::collections::HashSet;
use std::fmt;

use super::objective::{Goal, GoalError, Objective};
use deaflow_base::{
    Canonical, Decimal, Declared, Fields, InputError, Map, Node, NodeValue, Parameter, Schema, is_plain_name,
    parameters,
};
use deaflow_scene::Scene;

/// The name of an objective that stands by itself.
const ALONE: &str = "design";

/// Characters in a name: it is part of the names of files.
const LONGEST: usize = 60;

/// A wanted area fraction; `None` where any will do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Area(pub Option<Decimal>);

/// A name that can be part of the name of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Name(String);

parameters! {
    /// One of several things to design.
    struct NamedTarget as "a target" {
        /// Its name.
        name: Name,
        /// What the design is for.
        objective: Objective,
        /// Wanted area fraction of the electrode, as in 0.5 or `50 %`, or `free` where any will do.
        area: Option<Area>,
    }
}

parameters! {
    /// What is designed.
    pub struct Targets as "a design stage" {
        /// What the design is for.
        objective: Option<Objective>,
        /// Several designs in one stage, each with a name of its own.
        targets: Option<Vec<NamedTarget>> [((), 1..=10_000)],
        /// Wanted area fraction of the electrode, as in 0.5 or `50 %`, or `free` where any will do.
        area: Area = 0.5,
    }
    rules(either)
    check(Targets::check)
}

/// One thing to design.
#[derive(Clone, Debug)]
pub struct Target {
    /// Its name.
    pub name: String,
    /// What it is for.
    pub objective: Objective,
    /// Its area.
    pub area: Area,
    /// Both, in the scene.
    pub goal: Goal,
}

fn either(fields: Fields) -> Fields {
    fields.exactly_one(&["objective", "targets"])
}

impl Targets {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        match (map.optional("objective"), map.optional("targets")) {
            (Some(node), Some(_)) => Err(node
                .error("`objective` cannot stand beside `targets`, each of which has its own")
                .help("give either")),
            (None, None) => map.required(Self::WHAT, "objective").map(|_| ()),
            (_, None) => Ok(()),
            (None, Some(list)) => {
                let mut names = HashSet::new();
                for (target, item) in self.targets.iter().flatten().zip(list.list("targets")?) {
                    if !names.insert(&target.name.0) {
                        let node = item.peek("name").unwrap_or(item);
                        return Err(node.error(format!("two targets are named `{}`", target.name.0)));
                    }
                }
                Ok(())
            }
        }
    }

    /// The targets in a scene, with the weight of the area in the fitness; areas are those of the stage unless a
    /// target has its own. `map` is what they were read from.
    ///
    /// # Errors
    /// When an objective is none in that scene.
    pub fn in_scene(self, map: &Map<'_>, scene: &Scene, penalty: f64) -> Result<Vec<Target>, InputError> {
        let target = |name: String, objective: Objective, area: Area, node: Option<&Node>| {
            let goal = objective
                .goal(scene, area.fraction(), penalty)
                .map_err(|e| match node {
                    // Of a point alone the fault is in its own value, which `--set` may have given.
                    Some(node) => match &e {
                        GoalError::Point { .. } => node.peek("point").unwrap_or(node).error(e.to_string()),
                        _ => node.error(e.to_string()),
                    },
                    None => InputError::new(e.to_string()),
                })?;
            Ok(Target {
                name,
                objective,
                area,
                goal,
            })
        };
        if let Some(objective) = self.objective {
            let node = map.optional("objective");
            return Ok(vec![target(ALONE.to_owned(), objective, self.area, node)?]);
        }
        let items = map
            .optional("targets")
            .map_or(Ok(&[][..]), |list| list.list("targets"))?;
        let targets = self.targets.unwrap_or_default().into_iter().zip(items);
        targets
            .map(|(one, item)| {
                let area = one.area.unwrap_or(self.area);
                target(one.name.0, one.objective, area, item.peek("objective"))
            })
            .collect()
    }
}

impl Target {
    /// The canonical value.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        let entries = [
            ("name", Some(Canonical::from(self.name.as_str()))),
            ("objective", self.objective.canonical()),
            ("area", self.area.canonical()),
        ];
        Canonical::map(entries.into_iter().filter_map(|(key, value)| Some((key, value?))))
    }
}

impl Area {
    /// As a number.
    #[must_use]
    pub fn fraction(self) -> Option<f64> {
        self.0.map(Decimal::to_f64)
    }
}

impl fmt::Display for Area {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(area) => area.fmt(f),
            None => f.write_str("free"),
        }
    }
}

impl Parameter for Area {
    type Limits = ();
    type Literal = f64;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        if node.is_text("free") {
            return Ok(Self(None));
        }
        let area = Decimal::read(node, key, &(0.0..=1.0));
        area.map(|area| Self(Some(area))).map_err(|_| {
            let why = match node.percentage() {
                Some(area) if area.to_f64() > 1.0 => ": more than all of the membrane",
                Some(_) => ": less than nothing",
                None => "",
            };
            node.error(format!("`{key}` is {}{why}", node.found()))
                .help("allowed: an area fraction from 0 to 1, one in per cent such as `50 %`, or `free`")
        })
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.map_or(Canonical::from("free"), Canonical::from))
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Schema::number(0.0, 1.0), Schema::percentage(), Schema::word(&["free"])])
    }

    fn literal(literal: f64) -> Self {
        Self(Decimal::from_f64(literal))
    }
}

impl Parameter for Name {
    type Limits = ();
    type Literal = &'static str;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let name = node.text(key)?;
        let is_text = matches!(node.value(), NodeValue::Text(_));
        if !is_text || !is_plain_name(name, LONGEST) {
            return Err(node
                .error(format!("a target cannot be named {}", node.found()))
                .help(format!(
                    "allowed: up to {LONGEST} letters, digits, '_' and '-'; a number in quotes"
                )));
        }
        Ok(Self(name.to_owned()))
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.as_str().into())
    }

    fn schema((): &()) -> Schema {
        Schema::matching("^[A-Za-z0-9_-]{1,60}$")
    }

    fn literal(literal: &'static str) -> Self {
        Self(literal.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;

    fn area(text: &str) -> Result<Area, InputError> {
        let document = Document::from_text(Path::new("p.yaml"), &format!("area: {text}\n")).unwrap();
        Area::read(document.root.peek("area").unwrap(), "area", &())
    }

    #[test]
    fn an_area_in_per_cent_is_the_same_fraction() {
        for (text, same) in [("50 %", "0.5"), ("12.5%", "0.125"), ("100 %", "1"), ("\"0 %\"", "0")] {
            assert_eq!(area(text).unwrap(), area(same).unwrap(), "{text}");
            assert_eq!(
                area(text).unwrap().canonical(),
                area(same).unwrap().canonical(),
                "{text}"
            );
        }
        for text in ["101 %", "-1 %", "\"%\"", "half %", "50 % %", "1.01"] {
            assert!(area(text).is_err(), "{text}");
        }
    }
}
