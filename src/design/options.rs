//! The options of a design search.

use serde_json::json;

use super::evolve::EvolveOptions;
use super::front::Pareto;
use super::genome::UNITS;
use super::objective::AREA_PENALTY;
use deaflow_base::{Canonical, Decimal, Declared, Fields, InputError, Length, Map, Seed, parameters, words};
use deaflow_pattern::CELLS;

words! {
    /// The search method.
    pub enum Method {
        /// The genetic algorithm of the source paper.
        Ga = "ga",
        /// Gradient search from several start patterns.
        Adjoint = "adjoint",
    }
}

// Errors on the best patterns are several times those on random patterns: a chord step with an error of 0.0043 mm on
// random patterns was off by 0.028 mm at the point of a design. Hence the default of `evaluator_accuracy`.
parameters! {
    /// The options of a design search.
    pub struct SearchOptions as "a design stage" {
        /// Search method.
        pub method: Method = Method::Ga,
        /// With `evaluator: auto`: largest accepted root mean square error.
        pub evaluator_accuracy: Length [1e-9..=1e3] = "0.003 mm",
        /// Weight of the area error in the fitness.
        pub area_penalty: Decimal [0.0..=1e6] = AREA_PENALTY,
        /// Tolerance of the area in the gradient search.
        pub area_tolerance: Decimal [0.0..=1.0] = 0.005,
        /// Units along a side in the gradient search: 20 or 50.
        pub units: usize [UNITS as u64..=CELLS as u64] = CELLS,
        /// Refine the designs of the genetic algorithm by a gradient search.
        pub refine: bool = false,
        /// Number of start patterns of the gradient search.
        pub starts: usize [1..=1000] = 6,
        /// Number of different designs for each target.
        pub designs: usize [1..=1000] = EvolveOptions::PAPER.designs,
        /// Minimum share of cells in which two designs differ, over all symmetries of the device.
        pub distance: Decimal [0.0..=1.0] = EvolveOptions::PAPER.distance,
        /// Number of individuals.
        pub population: usize [2..=1_000_000] = EvolveOptions::PAPER.population,
        /// Maximum number of generations.
        pub generations: usize [0..=1_000_000] = EvolveOptions::PAPER.generations,
        /// Share of each generation that is evaluated: the best by the linear response, at least 50. 1 evaluates all,
        /// as the paper does.
        pub judged: Decimal [0.0..=1.0] = 0.25,
        /// Share of the best individuals that are kept.
        pub elite: Decimal [0.0..=1.0] = EvolveOptions::PAPER.elite,
        /// Probability of a crossover.
        pub crossover: Decimal [0.0..=1.0] = EvolveOptions::PAPER.crossover,
        /// Probability of a mutation.
        pub mutation: Decimal [0.0..=1.0] = EvolveOptions::PAPER.mutation,
        /// Stop after this many generations without improvement.
        pub stagnation: Option<usize> [1..=1_000_000],
        /// Seed of the random numbers.
        pub seed: Seed,
    }
    rules(rules)
    check(SearchOptions::check)
}

/// Keys without effect for `method: adjoint`.
const GENETIC: [&str; 11] = [
    "evaluator",
    "evaluator_accuracy",
    "area_penalty",
    "population",
    "generations",
    "judged",
    "elite",
    "crossover",
    "mutation",
    "stagnation",
    "refine",
];

/// Keys without effect for `method: ga`.
const ADJOINT: [&str; 1] = ["starts"];

/// Keys without effect for a front, which has one design for each area.
const SINGLE: [&str; 3] = ["designs", "distance", "area_tolerance"];

/// The key of a front. Its search is along the gradient, also without `method`, or by a genetic algorithm.
const FRONT: &str = "objectives";

/// Keys of the genetic algorithm without effect for that of a front.
const OF_ONE_OBJECTIVE: [&str; 5] = ["area_penalty", "judged", "elite", "stagnation", "refine"];

fn rules(fields: Fields) -> Fields {
    let is_adjoint = json!({ "required": ["method"], "properties": { "method": { "const": "adjoint" } } });
    let absent = |keys: &[&str]| {
        let each: Vec<_> = keys.iter().map(|key| json!({ "required": [key] })).collect();
        json!({ "not": { "anyOf": each } })
    };
    let is_front = json!({ "required": [FRONT] });
    let is_genetic = json!({ "allOf": [is_front, Pareto::is_genetic_schema()] });
    let along_gradient = json!({ "anyOf": [is_adjoint, { "allOf": [is_front, { "not": is_genetic }] }] });
    let method = |name: &str| json!({ "properties": { "method": { "const": name } } });
    let of_front = json!({ "if": is_genetic,
        "then": { "allOf": [absent(&OF_ONE_OBJECTIVE), method("ga")] }, "else": method("adjoint") });
    fields
        .rule(json!({ "properties": { "units": { "enum": [UNITS, CELLS] } } }))
        .rule(json!({ "if": along_gradient, "then": absent(&GENETIC), "else": absent(&ADJOINT) }))
        .rule(json!({ "if": is_front, "then": { "allOf": [absent(&SINGLE), of_front] } }))
}

impl SearchOptions {
    /// Refuses keys that have no effect with the method.
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let is_front = map.optional(FRONT).is_some();
        let is_genetic = is_front && Pareto::is_genetic(map);
        let method = match (is_front, is_genetic) {
            (false, _) => self.method,
            (true, false) => Method::Adjoint,
            (true, true) => Method::Ga,
        };
        if let Some(node) = map.optional("method").filter(|_| self.method != method) {
            let (message, help) = match is_genetic {
                false => (
                    "`method: ga` cannot search a front by ε-constraints",
                    "remove it, or use `pareto: { method: nsga2 }`",
                ),
                true => (
                    "`method: adjoint` cannot search a front by a genetic algorithm",
                    "remove it, or use `pareto: { method: epsilon }`",
                ),
            };
            return Err(node.error(message).help(help));
        }
        let without_effect = [&SINGLE[..], if is_genetic { &OF_ONE_OBJECTIVE } else { &[] }].concat();
        if let Some((key, node)) = without_effect.iter().find_map(|key| Some((key, map.optional(key)?)))
            && is_front
        {
            return Err(node
                .error(format!("`{key}` has no effect with `{FRONT}`"))
                .help("remove it"));
        }
        let foreign: &[&str] = match method {
            Method::Ga => &ADJOINT,
            Method::Adjoint => &GENETIC,
        };
        if let Some((key, node)) = foreign.iter().find_map(|key| Some((key, map.optional(key)?))) {
            return Err(node
                .error(format!("`{key}` has no effect with `method: {}`", method.name()))
                .help("remove it"));
        }
        match map.optional("units") {
            Some(node) if ![UNITS, CELLS].contains(&self.units) => Err(node
                .error(format!("`units` is {}", self.units))
                .help(format!("allowed: {UNITS} or {CELLS}"))),
            _ => Ok(()),
        }
    }

    /// The options of the search of a front: along the gradient, or by a genetic algorithm.
    #[must_use]
    pub fn of_front(self, is_genetic: bool) -> Self {
        Self {
            method: if is_genetic { Method::Ga } else { Method::Adjoint },
            ..self
        }
    }

    /// The canonical values of the keys that the genetic algorithm of a front uses.
    #[must_use]
    pub fn used_by_genetic_front(&self) -> Vec<(&'static str, Canonical)> {
        let mut entries = self.used();
        entries.retain(|(key, _)| !OF_ONE_OBJECTIVE.contains(key));
        entries
    }

    /// The options of the genetic algorithm.
    #[must_use]
    pub fn evolve(&self) -> EvolveOptions {
        EvolveOptions {
            population: self.population,
            generations: self.generations,
            elite: self.elite.to_f64(),
            judged: self.judged.to_f64(),
            crossover: self.crossover.to_f64(),
            mutation: self.mutation.to_f64(),
            stagnation: self.stagnation,
            designs: self.designs,
            distance: self.distance.to_f64(),
            seed: self.seed.0,
        }
    }

    /// The canonical values of the keys that the method uses.
    #[must_use]
    pub fn used(&self) -> Vec<(&'static str, Canonical)> {
        let mut entries = Vec::new();
        self.entries(&mut entries);
        let is_used = |key: &str| match key {
            "designs" | "distance" => self.designs > 1,
            "units" => self.method == Method::Adjoint || self.refine,
            key if ADJOINT.contains(&key) => self.method == Method::Adjoint,
            key => self.method == Method::Ga || !GENETIC.contains(&key),
        };
        entries.retain(|(key, _)| is_used(key));
        entries
    }

    /// The length of the progress bar of a target.
    #[must_use]
    pub fn steps(&self) -> u64 {
        match self.method {
            Method::Ga => self.generations as u64 + 1 + u64::from(self.refine) * self.refinements(),
            Method::Adjoint => (self.starts as u64 + 1) * self.designs as u64,
        }
    }

    /// The number of local searches after the genetic algorithm: one per design, and one per replacement of a weak
    /// design.
    fn refinements(&self) -> u64 {
        self.designs as u64 * (1 + self.sweeps())
    }

    /// How often weak designs are replaced if there are several designs.
    pub(crate) fn sweeps(&self) -> u64 {
        if self.designs > 1 { 2 } else { 0 }
    }

    /// The unit of [`SearchOptions::steps`].
    #[must_use]
    pub fn unit(&self) -> &'static str {
        match self.method {
            Method::Ga if self.refine => "steps",
            Method::Ga => "generations",
            Method::Adjoint => "searches",
        }
    }

    /// The relative cost of one step.
    #[must_use]
    pub fn weight(&self) -> f64 {
        match self.method {
            Method::Ga => self.population as f64,
            Method::Adjoint => 1000.0,
        }
    }
}
