//! The objectives of a front in YAML: those of designs, and the area or the charge that these take.

use serde_json::json;

use crate::objective::{Goal, Objective};
use deaflow_base::{
    Canonical, Charge, Decimal, Declared, Fields, InputError, Map, Node, Parameter, Schema, parameters, words,
};
use deaflow_field::CHARGE_UNIT;

words! {
    /// That an objective is minimised.
    pub enum Least {
        /// As small as possible.
        Least = "least",
    }
}

words! {
    /// How the points of a front are searched.
    pub enum FrontMethod {
        /// Gradient search of the first objective at several limits of the second one (ε-constraints).
        Epsilon = "epsilon",
        /// The genetic algorithm NSGA-II, for two or three objectives.
        Nsga2 = "nsga2",
    }
}

parameters! {
    /// The active area, which should be small.
    pub struct LeastArea as "the objective" {
        /// Minimise the active area.
        area: Least,
        /// Smallest and largest limit of the area, a share of the free membrane; by default the largest is the area of
        /// the best design of any area, and the smallest is that divided by the number of points.
        pub within: Option<[Decimal; 2]> [0.0..=1.0],
        /// Area of the reference of the hypervolume, by default the largest limit. Its displacement is 0.
        pub reference: Option<Decimal> [0.0..=1.0],
    }
    check(LeastArea::check)
}

parameters! {
    /// The charge on the electrodes, which should be small.
    pub struct LeastCharge as "the objective" {
        /// Minimise the charge at the voltage.
        charge: Least,
        /// Smallest and largest limit of the charge; by default the largest is the charge of the best design of any
        /// charge, and the smallest is that divided by the number of points.
        pub within: Option<[Charge; 2]> [1e-15..=1.0],
        /// Charge of the reference of the hypervolume, by default the largest limit. Its displacement is 0.
        pub reference: Option<Charge> [1e-15..=1.0],
    }
    check(LeastCharge::check)
}

parameters! {
    /// Number and search method.
    pub struct Pareto as "`pareto`" {
        /// Number of points: at equal steps of the second objective, or the most different ones of the genetic
        /// algorithm.
        pub points: usize [2..=1000] = 9,
        /// Search method.
        pub method: FrontMethod = FrontMethod::Epsilon,
    }
}

/// One of the objectives of a front.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FrontObjective {
    /// That of a design.
    Value(Objective),
    /// What a design takes.
    Cost(Cost),
}

/// What a design takes, which should be small.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cost {
    /// Active area.
    Area(LeastArea),
    /// Charge on the electrodes.
    Charge(LeastCharge),
}

/// An objective of a front besides the first one, in a scene.
#[derive(Clone, Debug)]
pub enum OtherObjective {
    /// That of a design.
    Value(Objective, Box<Goal>),
    /// What a design takes.
    Cost(Cost),
}

/// What is searched besides the first objective, which is that of a target.
#[derive(Clone, Debug)]
pub struct Front {
    /// The other objectives: one cost for ε-constraints.
    pub others: Vec<OtherObjective>,
    /// The points.
    pub pareto: Pareto,
}

impl LeastArea {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        check_ends(self.within.map(|ends| ends.map(Decimal::to_f64)), map)
    }
}

impl LeastCharge {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        check_ends(self.within.map(|ends| ends.map(in_nano)), map)
    }
}

/// Refuses ends in the wrong order.
fn check_ends(within: Option<[f64; 2]>, map: &Map<'_>) -> Result<(), InputError> {
    match (within, map.optional("within")) {
        (Some([low, high]), Some(node)) if low >= high => Err(node
            .error("`within` has nothing between its ends")
            .help("give the smaller one first")),
        _ => Ok(()),
    }
}

/// A charge in nC.
fn in_nano(charge: Charge) -> f64 {
    charge.base().scaled(9).to_f64()
}

impl FrontObjective {
    /// What designs take; `None` for the objective of a design.
    pub(crate) fn cost(&self) -> Option<&Cost> {
        match self {
            Self::Value(_) => None,
            Self::Cost(cost) => Some(cost),
        }
    }

    /// The objective of a design; `None` for what designs take.
    pub(crate) fn value(self) -> Option<Objective> {
        match self {
            Self::Value(objective) => Some(objective),
            Self::Cost(_) => None,
        }
    }

    /// Whether a mapping is that of what designs take.
    pub(crate) fn is_cost(node: &Node) -> bool {
        Cost::KEYS.iter().any(|key| node.peek(key).is_some())
    }

    /// Whether a stage searches a front by ε-constraints, as a JSON schema.
    #[must_use]
    pub fn is_within_limits() -> serde_json::Value {
        json!({ "required": ["objectives"], "not": Pareto::is_genetic_schema() })
    }

    /// Adds to the schema of a stage which objectives a method searches.
    pub(crate) fn rules(fields: Fields) -> Fields {
        let costs = Cost::KEYS.map(|key| json!({ "required": [key] }));
        let once = costs
            .clone()
            .map(|cost| json!({ "contains": cost, "minContains": 0, "maxContains": 1 }));
        let cost = json!({ "anyOf": costs });
        let value = json!({ "contains": { "not": cost } });
        let both = json!({ "allOf": [{ "contains": cost }, value], "maxItems": 2 });
        fields
            .rule(json!({ "properties": { "objectives": { "allOf": [value, once[0], once[1]] } } }))
            .rule(json!({
                "if": Pareto::is_genetic_schema(),
                "then": { "properties": { "objectives": { "items": { "not": { "required": ["within"] } } } } },
                "else": { "properties": { "objectives": both } },
            }))
    }
}

impl Cost {
    /// The key of each.
    const KEYS: [&str; 2] = ["area", "charge"];

    /// The smallest and the largest limit, if they are given: a share of the free membrane, or nC.
    #[must_use]
    pub fn within(&self) -> Option<[f64; 2]> {
        match self {
            Self::Area(area) => area.within.map(|ends| ends.map(Decimal::to_f64)),
            Self::Charge(charge) => charge.within.map(|ends| ends.map(in_nano)),
        }
    }

    fn given_reference(&self) -> Option<f64> {
        match self {
            Self::Area(area) => area.reference.map(Decimal::to_f64),
            Self::Charge(charge) => charge.reference.map(in_nano),
        }
    }

    /// Whether it is the charge.
    #[must_use]
    pub fn is_charge(&self) -> bool {
        matches!(self, Self::Charge(_))
    }

    /// The cost in YAML on one line, without limits and reference.
    #[must_use]
    pub fn to_text(&self) -> String {
        let key = Self::KEYS[usize::from(self.is_charge())];
        format!("{{ {key}: {} }}", Least::Least.name())
    }

    /// The unit of limits.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        if self.is_charge() { CHARGE_UNIT } else { "1" }
    }

    /// Rounds a limit to 0.0001 of the membrane, or to 0.1 nC.
    fn rounded(&self, limit: f64) -> f64 {
        let per_unit = if self.is_charge() { 10.0 } else { 1e4 };
        (per_unit * limit).round() / per_unit
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Area(area) => area.canonical(),
            Self::Charge(charge) => charge.canonical(),
        }
    }
}

impl Parameter for FrontObjective {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, _key: &str, (): &()) -> Result<Self, InputError> {
        let [area, charge] = Cost::KEYS.map(|key| node.peek(key).is_some());
        match (area, charge) {
            (true, _) => LeastArea::read_with(node, &[]).map(|area| Self::Cost(Cost::Area(area))),
            (false, true) => LeastCharge::read_with(node, &[]).map(|charge| Self::Cost(Cost::Charge(charge))),
            (false, false) => Objective::read(node).map(Self::Value),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Value(objective) => objective.canonical(),
            Self::Cost(cost) => cost.canonical(),
        }
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Objective::schema(&()), LeastArea::schema(&()), LeastCharge::schema(&())])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Front {
    /// The name of the front, with which those of its points begin.
    pub const NAME: &'static str = "front";

    /// The name of a point, from 0 at the smallest limit.
    #[must_use]
    pub fn point_name(at: usize) -> String {
        format!("{}-{}", Self::NAME, at + 1)
    }

    /// The canonical value.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        let mut entries: Vec<_> = match &self.others[..] {
            [OtherObjective::Cost(cost)] => vec![("second", cost.canonical())],
            several => {
                let several = several.iter().filter_map(OtherObjective::canonical);
                vec![("others", Some(Canonical::List(several.collect())))]
            }
        };
        entries.push(("pareto", self.pareto.canonical()));
        Canonical::map(entries.into_iter().filter_map(|(key, value)| Some((key, value?))))
    }

    /// Whether fields need to have the charge.
    #[must_use]
    pub fn has_charge(&self) -> bool {
        let is_charge = |other: &OtherObjective| matches!(other, OtherObjective::Cost(Cost::Charge(_)));
        self.others.iter().any(is_charge)
    }
}

impl Cost {
    /// A number of limits for a largest one; ascending. Those in between are rounded.
    #[must_use]
    pub fn limits(&self, points: usize, largest: f64) -> Vec<f64> {
        let [low, high] = self.within().unwrap_or([largest / points as f64, largest]);
        let limit = |at: usize| match at {
            0 => low,
            at if at + 1 == points => high,
            at => {
                let step = (high - low) / (points - 1) as f64;
                self.rounded(low + step * at as f64)
            }
        };
        (0..points).map(limit).collect()
    }

    /// The reference of the hypervolume, given the largest limit.
    #[must_use]
    pub fn reference(&self, largest: f64) -> f64 {
        self.given_reference().unwrap_or(largest)
    }
}

impl OtherObjective {
    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Value(objective, _) => objective.canonical(),
            Self::Cost(cost) => cost.canonical(),
        }
    }
}

impl Pareto {
    /// Nine points by ε-constraints, the defaults of the keys.
    pub(crate) fn usual() -> Self {
        Self {
            points: 9,
            method: FrontMethod::Epsilon,
        }
    }

    /// Whether a stage searches a front by the genetic algorithm.
    pub(crate) fn is_genetic(stage: &Map<'_>) -> bool {
        let method = stage.optional("pareto").and_then(|pareto| pareto.peek("method"));
        method.is_some_and(|method| method.is_text(FrontMethod::Nsga2.name()))
    }

    /// The same as a JSON schema of the stage.
    pub(crate) fn is_genetic_schema() -> serde_json::Value {
        let method =
            json!({ "required": ["method"], "properties": { "method": { "const": FrontMethod::Nsga2.name() } } });
        json!({ "required": ["pareto"], "properties": { "pareto": method } })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use deaflow_base::Document;

    fn node(text: &str) -> Node {
        Document::from_text(Path::new("f"), text).unwrap().root
    }

    fn cost(text: &str) -> Cost {
        match FrontObjective::read(&node(text), "objectives", &()).unwrap() {
            FrontObjective::Cost(cost) => cost,
            FrontObjective::Value(_) => panic!("{text}"),
        }
    }

    #[test]
    fn limits_are_at_equal_steps() {
        let of = cost("{ area: least }");
        let limits = of.limits(9, 0.36);
        for (k, limit) in (1..).zip(&limits) {
            assert!((limit - 0.04 * f64::from(k)).abs() < 1e-15, "{limits:?}");
        }
        assert_eq!(of.reference(0.36), 0.36);
        let given = cost("{ area: least, within: [10 %, 0.2], reference: 0.5 }");
        assert_eq!(given.limits(3, 0.7), [0.1, 0.15, 0.2]);
        assert_eq!(given.reference(0.2), 0.5);
        assert_eq!(Pareto::read_with(&node("{}"), &[]).unwrap(), Pareto::usual());
        let charge = cost("{ charge: least, within: [1 uC, 2000.5 nC], reference: 2779 nC }");
        assert_eq!(charge.limits(3, 0.0), [1000.0, 1500.3, 2000.5]);
        assert_eq!((charge.reference(0.0), charge.unit()), (2779.0, "nC"));
    }

    #[test]
    fn ends_in_the_wrong_order_are_refused() {
        for text in [
            "{ area: least, within: [0.3, 0.2] }",
            "{ area: least, within: [0.3, 0.3] }",
            "{ charge: least, within: [2 uC, 1 uC] }",
        ] {
            assert!(FrontObjective::read(&node(text), "objectives", &()).is_err(), "{text}");
        }
    }
}
