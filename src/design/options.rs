//! How designs are searched.

use serde_json::json;

use super::evolve::EvolveOptions;
use super::genome::UNITS;
use super::objective::AREA_PENALTY;
use deaflow_base::{Canonical, Decimal, Declared, Fields, InputError, Length, Map, Seed, parameters, words};
use deaflow_pattern::CELLS;

words! {
    /// How to search.
    pub enum Method {
        /// The genetic algorithm of the source paper.
        Ga = "ga",
        /// Along the gradient, from several starts.
        Adjoint = "adjoint",
    }
}

// Errors on the best pattern are several times those on random patterns: a chord step that errs by 0.0043 mm on these was 0.028 mm
// short at the point of a design. Hence the default of `evaluator_accuracy`.
parameters! {
    /// How designs are searched.
    pub struct SearchOptions as "a design stage" {
        /// How to search.
        pub method: Method = Method::Ga,
        /// With `evaluator: auto`: the root mean square error that is accurate enough.
        pub evaluator_accuracy: Length [1e-9..=1e3] = "0.003 mm",
        /// Weight of the distance from the wanted area in the fitness.
        pub area_penalty: Decimal [0.0..=1e6] = AREA_PENALTY,
        /// Distance from the wanted area fraction that a design found along the gradient may have.
        pub area_tolerance: Decimal [0.0..=1.0] = 0.005,
        /// Units along a side of a search along the gradient, 20 or 50.
        pub units: usize [UNITS as u64..=CELLS as u64] = CELLS,
        /// Whether the genetic algorithm's best is improved along the gradient.
        pub refine: bool = false,
        /// Patterns from which the gradient is followed.
        pub starts: usize [1..=1000] = 6,
        /// So many different designs of each target.
        pub designs: usize [1..=1000] = EvolveOptions::PAPER.designs,
        /// Share of the cells in which two of them differ at least, whichever way they are turned.
        pub distance: Decimal [0.0..=1.0] = EvolveOptions::PAPER.distance,
        /// Individuals.
        pub population: usize [2..=1_000_000] = EvolveOptions::PAPER.population,
        /// Generations at most.
        pub generations: usize [0..=1_000_000] = EvolveOptions::PAPER.generations,
        /// Share of each generation that the evaluator judges: those that the linear response ranks first, and 50 at least. 1 judges all, as the paper does.
        pub judged: Decimal [0.0..=1.0] = 0.25,
        /// Best individuals that stay.
        pub elite: Decimal [0.0..=1.0] = EvolveOptions::PAPER.elite,
        /// Probability of a crossover.
        pub crossover: Decimal [0.0..=1.0] = EvolveOptions::PAPER.crossover,
        /// Probability of a mutation.
        pub mutation: Decimal [0.0..=1.0] = EvolveOptions::PAPER.mutation,
        /// Generations without gain after which the search ends.
        pub stagnation: Option<usize> [1..=1_000_000],
        /// Names the random numbers.
        pub seed: Seed,
    }
    rules(rules)
    check(SearchOptions::check)
}

/// Keys that mean nothing along the gradient alone; a network, an evaluator and its accuracy are named in the stage.
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

/// Keys that mean nothing to the genetic algorithm.
const ADJOINT: [&str; 1] = ["starts"];

fn rules(fields: Fields) -> Fields {
    let is_adjoint = json!({ "required": ["method"], "properties": { "method": { "const": "adjoint" } } });
    let absent = |keys: &[&str]| {
        let each: Vec<_> = keys.iter().map(|key| json!({ "required": [key] })).collect();
        json!({ "not": { "anyOf": each } })
    };
    fields
        .rule(json!({ "properties": { "units": { "enum": [UNITS, CELLS] } } }))
        .rule(json!({ "if": is_adjoint, "then": absent(&GENETIC), "else": absent(&ADJOINT) }))
}

impl SearchOptions {
    /// Refuses keys that mean nothing with the method.
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let foreign: &[&str] = match self.method {
            Method::Ga => &ADJOINT,
            Method::Adjoint => &GENETIC,
        };
        if let Some((key, node)) = foreign.iter().find_map(|key| Some((key, map.optional(key)?))) {
            return Err(node
                .error(format!("`{key}` means nothing with `method: {}`", self.method.name()))
                .help("leave it out"));
        }
        match map.optional("units") {
            Some(node) if ![UNITS, CELLS].contains(&self.units) => Err(node
                .error(format!("`units` is {}", self.units))
                .help(format!("allowed: {UNITS} or {CELLS}"))),
            _ => Ok(()),
        }
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

    /// The canonical value of each key that the method uses.
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

    /// How many local searches finish designs: one each, and of several each may be replaced.
    fn refinements(&self) -> u64 {
        self.designs as u64 * (1 + self.sweeps())
    }

    /// How often weak ones of several designs are replaced.
    pub(crate) fn sweeps(&self) -> u64 {
        if self.designs > 1 { 2 } else { 0 }
    }

    /// What these steps are: those of a genetic algorithm whose designs are refined are of two sorts.
    #[must_use]
    pub fn unit(&self) -> &'static str {
        match self.method {
            Method::Ga if self.refine => "steps",
            Method::Ga => "generations",
            Method::Adjoint => "searches",
        }
    }

    /// How much work one step is, beside other settings.
    #[must_use]
    pub fn weight(&self) -> f64 {
        match self.method {
            Method::Ga => self.population as f64,
            Method::Adjoint => 1000.0,
        }
    }
}
