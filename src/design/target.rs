//! What a design stage designs: one objective, or several by name.

use std::collections::HashSet;
use std::fmt;

use super::objective::{Goal, Objective};
use crate::base::{Canonical, Decimal, Fields, InputError, Map, Node, NodeValue, Schema};

/// The name of an objective that stands by itself.
pub const ALONE: &str = "design";

/// Characters in a name: it is part of the names of files.
const LONGEST: usize = 60;

/// Targets of one stage.
const MOST: usize = 10_000;

/// A wanted area fraction; `None` where any will do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Area(pub Option<Decimal>);

impl Area {
    /// Reads a fraction, or `free`; `default` where there is none.
    ///
    /// # Errors
    /// When it is neither.
    pub fn read(map: &Map<'_>, default: Self) -> Result<Self, InputError> {
        match map.optional("area") {
            None => Ok(default),
            Some(node) if node.is_text("free") => Ok(Self(None)),
            Some(node) => match map.number("area", 0.5, 0.0, 1.0) {
                Ok(area) => Ok(Self(Some(area))),
                Err(_) => Err(node
                    .error(format!("`area` is {}", node.found()))
                    .help("allowed: an area fraction from 0 to 1, or `free`")),
            },
        }
    }

    /// What [`Area::read`] accepts.
    pub fn schema() -> Schema {
        Schema::any_of([Schema::number(0.0, 1.0), Schema::word(&["free"])])
            .says("Wanted area fraction of the electrode, or `free` where any will do.")
    }

    /// As a number.
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

/// One thing to design.
pub struct Target {
    /// Its name.
    pub name: String,
    /// What it is for.
    pub objective: Objective,
    /// Its area.
    pub area: Area,
    /// Both, on the membrane of the scene.
    pub goal: Goal,
}

impl Target {
    /// Reads `objective`, or `targets: [{ name, objective, area }, …]`, of a stage; areas are those of the stage unless a target has
    /// its own.
    ///
    /// # Errors
    /// When there is neither, both, two of the same name, or an objective that is none on a membrane of `side_mm`.
    pub fn read_all(what: &str, map: &Map<'_>, side_mm: f64, penalty: f64) -> Result<Vec<Self>, InputError> {
        let area = Area::read(map, Area(Decimal::from_f64(0.5)))?;
        let target = |name: String, node: &Node, area: Area| {
            let objective = Objective::read(node)?;
            let goal = objective.goal(side_mm, area.fraction(), penalty);
            Ok(Self {
                name,
                goal: goal.map_err(|e| node.error(e.to_string()))?,
                objective,
                area,
            })
        };
        let Some(list) = map.optional("targets") else {
            return Ok(vec![target(ALONE.to_owned(), map.required(what, "objective")?, area)?]);
        };
        if let Some(node) = map.optional("objective") {
            return Err(node
                .error("`objective` cannot stand beside `targets`, each of which has its own")
                .help("give either"));
        }
        let items = list.list("targets")?;
        if items.is_empty() || items.len() > MOST {
            return Err(list
                .error(format!("`targets` has {} items", items.len()))
                .help(format!("allowed: 1 to {MOST}")));
        }
        let mut names = HashSet::new();
        let mut targets = Vec::with_capacity(items.len());
        for item in items {
            let what = "a target";
            let map = item.fields(what, &["name", "objective", "area"])?;
            let node = map.required(what, "name")?;
            let name = checked_name(node)?;
            if !names.insert(name.clone()) {
                return Err(node.error(format!("two targets are named `{name}`")));
            }
            targets.push(target(name, map.required(what, "objective")?, Area::read(&map, area)?)?);
        }
        Ok(targets)
    }

    /// Adds what [`Target::read_all`] accepts to the schema of a stage.
    #[must_use]
    pub fn schema(fields: Fields) -> Fields {
        let target = Fields::new("One of several things to design.")
            .required("name", Schema::matching("^[A-Za-z0-9_-]{1,60}$").says("Its name."))
            .required("objective", Objective::schema())
            .optional("area", Area::schema());
        let targets =
            Schema::list(target.into(), 1, MOST).says("Several designs in one stage, each with a name of its own.");
        fields
            .optional("objective", Objective::schema())
            .optional("targets", targets)
            .optional("area", Area::schema().default(0.5))
            .rule(serde_json::json!({ "oneOf": [{ "required": ["objective"] }, { "required": ["targets"] }] }))
    }

    /// The canonical value.
    pub fn canonical(&self) -> Canonical {
        Canonical::map([
            ("name", Canonical::from(self.name.as_str())),
            ("objective", self.objective.canonical()),
            ("area", self.area.0.map_or(Canonical::Null, Canonical::from)),
        ])
    }
}

/// A name that can be part of the name of a file.
fn checked_name(node: &Node) -> Result<String, InputError> {
    let name = node.text("name")?;
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    let is_text = matches!(node.value(), NodeValue::Text(_));
    if !is_text || name.is_empty() || name.len() > LONGEST || !name.chars().all(plain) {
        return Err(node
            .error(format!("a target cannot be named {}", node.found()))
            .help(format!(
                "allowed: up to {LONGEST} letters, digits, '_' and '-'; a number in quotes"
            )));
    }
    Ok(name.to_owned())
}
