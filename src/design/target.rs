//! The targets of a design stage: one objective, or several with names.

use std::collections::HashSet;
use std::fmt;

use serde_json::json;

use super::front::{Cost, Front, FrontMethod, FrontObjective, OtherObjective, Pareto};
use super::objective::{Goal, GoalError, Masks, Objective};
use deaflow_base::{
    Canonical, Decimal, Declared, Fields, InputError, Map, Node, NodeValue, Parameter, Schema, is_plain_name,
    parameters,
};
use deaflow_pattern::AT_MOST;
use deaflow_scene::{Scene, Tolerances};

/// The name of the target if a stage has a single objective.
pub const SINGLE_NAME: &str = "design";

/// Maximum length of a name; file names contain it.
const MAX_LENGTH: usize = 60;

/// The target area of electrodes, a share of the free membrane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Area {
    /// Any area.
    Free,
    /// This area, within a tolerance.
    Near(Decimal),
    /// This area or less.
    AtMost(Decimal),
}

parameters! {
    /// A largest area.
    struct LargestArea as "the area" {
        /// Largest area of the electrodes, a share of the free membrane, such as 0.3 or `30 %`.
        at_most: Decimal [0.0001..=1.0],
    }
}

/// A name that can be part of a file name.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Name(String);

/// The label of a design stage for tables: text on one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CaseLabel(pub String);

parameters! {
    /// One of several targets.
    struct NamedTarget as "a target" {
        /// Its name.
        name: Name,
        /// The objective of the design.
        objective: Objective,
        /// Target area of the electrodes, a share of the free membrane, such as 0.5 or `50 %`; `{ at_most: 50 % }`; or
        /// `free`.
        area: Option<Area>,
    }
}

parameters! {
    /// The targets of a design stage.
    pub struct Targets as "a design stage" {
        /// The objective of the design.
        objective: Option<Objective>,
        /// Several targets with unique names, in place of `objective`.
        targets: Option<Vec<NamedTarget>> [((), 1..=10_000)],
        /// Two or three objectives, in place of `objective`: those of designs, and their area or charge. The designs
        /// are those of a front, of which no other one is better in all objectives.
        objectives: Option<Vec<FrontObjective>> [((), 2..=3)],
        /// The points of the front of several `objectives`.
        pareto: Option<Pareto>,
        /// Target area of the electrodes, a share of the free membrane, such as 0.5 or `50 %`; `{ at_most: 50 % }`; or
        /// `free`.
        area: Area = 0.5,
    }
    rules(objective_or_targets)
    check(Targets::check)
}

/// A target in a scene.
#[derive(Clone, Debug)]
pub struct Target {
    /// Its name.
    pub name: String,
    /// The objective.
    pub objective: Objective,
    /// The target area.
    pub area: Area,
    /// Objective and area, in the scene.
    pub goal: Goal,
    /// The masks that count, if the objective is robust.
    pub masks: Option<Masks>,
}

fn objective_or_targets(fields: Fields) -> Fields {
    let has = |key: &str| json!({ "required": [key] });
    let fields = fields
        .exactly_one(&["objective", "targets", "objectives"])
        .rule(json!({ "if": has("pareto"), "then": has("objectives") }))
        .mutually_exclusive("objectives", "area");
    FrontObjective::rules(fields)
}

impl Targets {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        if let Some(node) = map.optional("objectives") {
            return self.check_front(map, node);
        }
        if let Some(node) = map.optional("pareto") {
            return Err(node
                .error("`pareto` needs several `objectives`")
                .help("replace `objective` by `objectives: [{ point, direction }, { area: least }]`"));
        }
        match (map.optional("objective"), map.optional("targets")) {
            (Some(node), Some(_)) => Err(node
                .error("`objective` cannot be used with `targets`: each target has its own")
                .help("remove one of them")),
            (None, None) => map.required(Self::WHAT, "objective").map(|_| ()),
            (_, None) => Ok(()),
            (None, Some(list)) => {
                let mut names = HashSet::new();
                for (target, item) in self.targets.iter().flatten().zip(list.list("targets")?) {
                    if !names.insert(&target.name.0) {
                        let node = item.peek("name").unwrap_or(item);
                        return Err(node.error(format!("duplicate target name `{}`", target.name.0)));
                    }
                }
                Ok(())
            }
        }
    }

    /// Checks several objectives of a front, in place of one or of several targets.
    fn check_front(&self, map: &Map<'_>, node: &Node) -> Result<(), InputError> {
        if let Some(key) = ["objective", "targets", "area"]
            .into_iter()
            .find(|key| map.optional(key).is_some())
        {
            let why = match key {
                "area" => "the area of their designs is free, or one of them",
                _ => "they take its place",
            };
            return Err(node
                .error(format!("`{key}` cannot be used with `objectives`: {why}"))
                .help(format!("remove `{key}`")));
        }
        let objectives = self.objectives.as_deref().unwrap_or_default();
        let is_cost = |one: &&FrontObjective| matches!(one, FrontObjective::Cost(_));
        let (costs, example) = (
            objectives.iter().filter(is_cost).count(),
            "for example `objectives: [{ point: [25 mm, 25 mm], direction: 0 deg }, { area: least }]`",
        );
        if costs == objectives.len() {
            let message = "a front needs the objective of a design, and `area: least` or `charge: least`";
            return Err(node.error(message).help(example));
        }
        let is_charge = objectives.iter().filter_map(FrontObjective::cost).map(Cost::is_charge);
        let is_charge: Vec<bool> = is_charge.collect();
        if is_charge.len() > 1 && is_charge[0] == is_charge[1] {
            let message = "two objectives of a front are the same";
            return Err(node.error(message).help("remove one of them"));
        }
        let items = node.list("objectives")?;
        if let Some(within) = items.iter().find_map(|item| item.peek("within"))
            && self.is_genetic_front()
        {
            return Err(within
                .error("`within` has no effect with `method: nsga2`")
                .help("remove it, or use `pareto: { method: epsilon }`"));
        }
        match self.front_method() {
            FrontMethod::Epsilon if (costs, objectives.len()) != (1, 2) => Err(node
                .error("`method: epsilon` needs the objective of a design, and `area: least` or `charge: least`")
                .help(format!(
                    "use `pareto: {{ method: nsga2 }}`, or two objectives: {example}"
                ))),
            _ => Ok(()),
        }
    }

    fn front_method(&self) -> FrontMethod {
        self.pareto.as_ref().map_or_else(Pareto::usual, Clone::clone).method
    }

    /// Whether they are those of a front that the genetic algorithm searches.
    #[must_use]
    pub fn is_genetic_front(&self) -> bool {
        self.is_front() && self.front_method() == FrontMethod::Nsga2
    }

    /// Whether they are those of a front.
    #[must_use]
    pub fn is_front(&self) -> bool {
        self.objectives.is_some()
    }

    /// The front in a scene; `None` with one objective or several targets. Its first objective is that of the only
    /// [target](Self::in_scene).
    ///
    /// # Errors
    /// As [`Self::in_scene`], or if the objectives cannot be those of one front.
    pub fn front(&self, map: &Map<'_>, scene: &Scene, penalty: f64) -> Result<Option<Front>, InputError> {
        let Some(objectives) = &self.objectives else {
            return Ok(None);
        };
        let nodes = map
            .optional("objectives")
            .map_or(Ok(&[][..]), |list| list.list("objectives"))?;
        let mut first = None::<&Objective>;
        let mut others = Vec::new();
        for (one, node) in objectives.iter().zip(nodes) {
            match (one, first) {
                (FrontObjective::Cost(cost), _) => others.push(OtherObjective::Cost(cost.clone())),
                (FrontObjective::Value(objective), None) => first = Some(objective),
                (FrontObjective::Value(objective), Some(first)) => {
                    if objective.response() != first.response() {
                        let message = "the objectives of a front have different times or frequencies";
                        return Err(node
                            .error(message)
                            .help("use the same `time` or `frequency` in all of them"));
                    }
                    if objective.is_reaction() != first.is_reaction() {
                        let message = "some objectives are reactions, in mN, and others motions, in mm";
                        return Err(node.error(message).help("design them in two stages"));
                    }
                    let placed = placed(Front::NAME, objective.clone(), Area::Free, Some(node), (scene, penalty))?;
                    others.push(OtherObjective::Value(objective.clone(), Box::new(placed.goal)));
                }
            }
        }
        let robust = nodes.iter().find(|node| node.peek("robust").is_some());
        if let Some(node) = robust
            && self.is_genetic_front()
        {
            return Err(node
                .error("`robust` cannot be used with `method: nsga2`")
                .help("use `method: epsilon`, or remove `robust`"));
        }
        let pareto = self.pareto.clone().unwrap_or_else(Pareto::usual);
        Ok(Some(Front { others, pareto }))
    }

    /// Returns the values of robust objectives that are those of the tolerances of a scene: by their paths in a
    /// stage, that of a single objective also by its name among targets, and by their paths in the scene.
    pub fn from_tolerances(&self) -> impl Iterator<Item = [String; 2]> {
        let single = self.objective.iter().flat_map(|objective| {
            let named = format!("targets.{SINGLE_NAME}.");
            [(String::new(), objective), (named, objective)]
        });
        let targets = self.targets.iter().flatten();
        let named = targets.map(|target| (format!("targets.{}.", target.name.0), &target.objective));
        let objectives = self.objectives.iter().flatten();
        let of_front = objectives.filter_map(|one| match one {
            FrontObjective::Value(objective) => Some((format!("targets.{}.", Front::NAME), objective)),
            FrontObjective::Cost(_) => None,
        });
        let all = single.chain(named).chain(of_front);
        let robust = all.filter(|(_, objective)| objective.takes_tolerances());
        robust.flat_map(|(start, _)| {
            ["mask", "misregistration"].map(|key| {
                let own = format!("{start}objective.robust.{key}");
                [own, format!("tolerances.{key}")]
            })
        })
    }

    /// Takes standard deviations of masks that are not given from the tolerances of a scene.
    #[must_use]
    pub fn with_tolerances(self, tolerances: Option<&Tolerances>) -> Self {
        let with = |objective: Objective| objective.with_tolerances(tolerances);
        let of_target = |target: NamedTarget| NamedTarget {
            objective: with(target.objective),
            ..target
        };
        let of_front = |one: FrontObjective| match one {
            FrontObjective::Value(objective) => FrontObjective::Value(with(objective)),
            cost @ FrontObjective::Cost(_) => cost,
        };
        Self {
            objective: self.objective.map(with),
            targets: self.targets.map(|all| all.into_iter().map(of_target).collect()),
            objectives: self.objectives.map(|both| both.into_iter().map(of_front).collect()),
            ..self
        }
    }

    /// The targets in a scene. `penalty` is the weight of the area in the fitness, `map` the source of the targets. A
    /// target without an area has that of the stage.
    ///
    /// # Errors
    /// If an objective is invalid in the scene.
    pub fn in_scene(self, map: &Map<'_>, scene: &Scene, penalty: f64) -> Result<Vec<Target>, InputError> {
        let within = (scene, penalty);
        if let Some(objective) = self.objective {
            let node = map.optional("objective");
            return Ok(vec![placed(SINGLE_NAME, objective, self.area, node, within)?]);
        }
        let first = self.objectives.into_iter().flatten().find_map(FrontObjective::value);
        if let Some(objective) = first {
            let items = map.optional("objectives").and_then(|list| list.list("objectives").ok());
            let node = items
                .unwrap_or_default()
                .iter()
                .find(|item| !FrontObjective::is_cost(item));
            return Ok(vec![placed(Front::NAME, objective, Area::Free, node, within)?]);
        }
        let items = map
            .optional("targets")
            .map_or(Ok(&[][..]), |list| list.list("targets"))?;
        let targets = self.targets.unwrap_or_default().into_iter().zip(items);
        targets
            .map(|(one, item)| {
                let area = one.area.unwrap_or(self.area);
                placed(&one.name.0, one.objective, area, item.peek("objective"), within)
            })
            .collect()
    }
}

/// A target in a scene. `penalty` is the weight of the area in the fitness, `node` the source of the objective.
fn placed(
    name: &str,
    objective: Objective,
    area: Area,
    node: Option<&Node>,
    (scene, penalty): (&Scene, f64),
) -> Result<Target, InputError> {
    let located = |error: GoalError| match (node, &error) {
        // `--set` may have set the point alone.
        (Some(node), GoalError::Point { .. }) => node.peek("point").unwrap_or(node).error(error.to_string()),
        (Some(node), GoalError::Masks(_)) => node
            .peek("robust")
            .unwrap_or(node)
            .error(error.to_string())
            .help("for example `robust: { worst: [-0.3 mm, 0 mm, 0.3 mm] }`"),
        (Some(node), _) => node.error(error.to_string()),
        (None, _) => InputError::new(error.to_string()),
    };
    let goal = objective.goal(scene, area.fraction(), penalty).map_err(located)?;
    let goal = goal.with_largest_area(matches!(area, Area::AtMost(_)));
    let masks = objective.masks(scene.membrane()).map_err(located)?;
    Ok(Target {
        name: name.to_owned(),
        objective,
        area,
        goal: match &masks {
            Some(masks) => goal.with_masks(masks.offsets.len(), masks.criterion),
            None => goal,
        },
        masks,
    })
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
    /// The fraction as a number: that of the target, or the largest one.
    #[must_use]
    pub fn fraction(self) -> Option<f64> {
        match self {
            Self::Free => None,
            Self::Near(area) | Self::AtMost(area) => Some(area.to_f64()),
        }
    }
}

impl fmt::Display for Area {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Free => f.write_str("free"),
            Self::Near(area) => area.fmt(f),
            Self::AtMost(area) => write!(f, "{AT_MOST}{area}"),
        }
    }
}

impl Parameter for Area {
    type Limits = ();
    type Literal = f64;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        if node.is_text("free") {
            return Ok(Self::Free);
        }
        if matches!(node.value(), NodeValue::Map(_)) {
            return LargestArea::read_with(node, &[]).map(|largest| Self::AtMost(largest.at_most));
        }
        let area = Decimal::read(node, key, &(0.0..=1.0));
        area.map(Self::Near).map_err(|_| {
            let number: Option<f64> = node.found().parse().ok();
            let why = match node.percentage().map_or(number, |share| Some(share.to_f64())) {
                Some(area) if area > 1.0 => ", more than the membrane",
                Some(_) => ", a negative area",
                None => "",
            };
            let allowed = "allowed: a share of the free membrane from 0 to 1, a percentage such as `50 %`, `{ at_most: \
                           50 % }`, or `free`";
            let help = match number {
                Some(area) if area > 1.0 && area <= 100.0 => format!("did you mean `{area} %`? {allowed}"),
                _ => allowed.to_owned(),
            };
            node.error(format!("`{key}` is {}{why}", node.found())).help(help)
        })
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(match self {
            Self::Free => Canonical::from("free"),
            Self::Near(area) => Canonical::from(*area),
            Self::AtMost(area) => Canonical::map([("at_most", Canonical::from(*area))]),
        })
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([
            Schema::number(0.0, 1.0),
            Schema::percentage(),
            Schema::word(&["free"]),
            LargestArea::schema(&()),
        ])
    }

    fn literal(literal: f64) -> Self {
        Decimal::from_f64(literal).map_or(Self::Free, Self::Near)
    }
}

impl Parameter for Name {
    type Limits = ();
    type Literal = &'static str;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let name = node.text(key)?;
        let is_text = matches!(node.value(), NodeValue::Text(_));
        if !is_text || !is_plain_name(name, MAX_LENGTH) {
            return Err(node
                .error(format!("invalid target name {}", node.found()))
                .help(format!(
                    "allowed: up to {MAX_LENGTH} letters, digits, '_' and '-'; a number in quotes"
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

impl Parameter for CaseLabel {
    type Limits = ();
    type Literal = &'static str;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let label = node.text(key)?;
        // Artifacts limit the length of text in bytes.
        match label.len() {
            1..=60 if !label.contains('\n') && matches!(node.value(), NodeValue::Text(_)) => Ok(Self(label.to_owned())),
            _ => Err(node
                .error(format!("`{key}` is not a valid label"))
                .help("allowed: 1 to 60 letters on one line; a number in quotes")),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.as_str().into())
    }

    fn schema((): &()) -> Schema {
        Schema::matching("^[^\\n]{1,60}$")
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
    fn percentages_are_area_fractions() {
        for (text, same) in [
            ("50 %", "0.5"),
            ("12.5%", "0.125"),
            ("100 %", "1"),
            ("\"0 %\"", "0"),
            ("{ at_most: 30 % }", "{ at_most: 0.3 }"),
        ] {
            assert_eq!(area(text).unwrap(), area(same).unwrap(), "{text}");
            assert_eq!(
                area(text).unwrap().canonical(),
                area(same).unwrap().canonical(),
                "{text}"
            );
        }
        for text in [
            "101 %",
            "-1 %",
            "\"%\"",
            "half %",
            "50 % %",
            "1.01",
            "{ at_most: 101 % }",
            "{ most: 0.3 }",
        ] {
            assert!(area(text).is_err(), "{text}");
        }
    }
}
