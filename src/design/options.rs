//! How designs are searched.

use serde_json::json;

use super::evolve::EvolveOptions;
use super::genome::UNITS;
use super::objective::AREA_PENALTY;
use crate::base::{Canonical, Decimal, Dimension, Fields, InputError, Map, Quantity, Schema};
use crate::pattern::CELLS;

/// Accuracy in mm that is asked of an evaluator unless said otherwise. Errors on the best pattern are several times those on
/// patterns that are drawn: a chord step that errs by 0.0043 mm on these was 0.028 mm short at the point of a design.
const EVALUATOR_ACCURACY: &str = "0.003";

/// Distance of the area fraction from the wanted one that a design found along the gradient may have.
const AREA_TOLERANCE: f64 = 0.005;

/// Starts of a search along the gradient.
const STARTS: u64 = 6;

/// What the genetic algorithm alone uses.
const GENETIC: [&str; 10] = [
    "evaluator",
    "evaluator_accuracy",
    "area_penalty",
    "population",
    "generations",
    "elite",
    "crossover",
    "mutation",
    "stagnation",
    "refine",
];

/// How to search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The genetic algorithm of the source paper.
    Ga,
    /// Along the gradient, from several starts.
    Adjoint,
}

impl Method {
    /// The word after `method:`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ga => "ga",
            Self::Adjoint => "adjoint",
        }
    }
}

/// The settings of a stage.
pub struct SearchOptions {
    /// How to search.
    pub method: Method,
    /// What is asked of an evaluator that is not named.
    pub accuracy: Quantity,
    /// Weight of the distance from the wanted area in the fitness.
    pub penalty: Decimal,
    /// Distance from the wanted area that is allowed along the gradient.
    pub tolerance: Decimal,
    /// Units along a side of a search along the gradient.
    pub units: usize,
    /// Whether the genetic algorithm's best is improved along the gradient.
    pub refine: bool,
    /// Starts of a search along the gradient.
    pub starts: usize,
    /// Elite, crossover, mutation, as written.
    shares: [Decimal; 3],
    /// Between several designs, as written.
    distance: Decimal,
    /// Those of the genetic algorithm.
    pub evolve: EvolveOptions,
}

impl SearchOptions {
    /// The keys that [`SearchOptions::read`] looks for.
    pub const KEYS: [&str; 16] = [
        "method",
        "evaluator_accuracy",
        "area_penalty",
        "area_tolerance",
        "units",
        "refine",
        "starts",
        "designs",
        "distance",
        "population",
        "generations",
        "elite",
        "crossover",
        "mutation",
        "stagnation",
        "seed",
    ];

    /// Adds what [`SearchOptions::read`] accepts to the schema of a stage.
    pub fn schema(fields: Fields, seed: Schema) -> Fields {
        let defaults = EvolveOptions::default();
        let share = |says: &str, default: f64| Schema::number(0.0, 1.0).says(says).default(default);
        let penalty = Schema::number(0.0, 1e6).says("Weight of the distance from the wanted area in the fitness.");
        let tolerance = "Distance from the wanted area fraction that a design found along the gradient may have.";
        let population = Schema::whole(2, 1_000_000)
            .says("Individuals.")
            .default(defaults.population);
        let generations = Schema::whole(0, 1_000_000)
            .says("Generations at most.")
            .default(defaults.generations);
        let stagnation = Schema::whole(1, 1_000_000).says("Generations without gain after which the search ends.");
        let units = json!({ "enum": [UNITS, CELLS], "default": CELLS });
        let starts = Schema::whole(1, 1000).says("Patterns from which the gradient is followed.");
        let refine = Schema::new(json!({ "type": "boolean", "default": false }));
        let is_adjoint = json!({ "required": ["method"], "properties": { "method": { "const": "adjoint" } } });
        let absent = |keys: &[&str]| {
            let each: Vec<_> = keys.iter().map(|key| json!({ "required": [key] })).collect();
            json!({ "not": { "anyOf": each } })
        };
        fields
            .optional("method", Schema::word(&["ga", "adjoint"]).says("How to search.").default("ga"))
            .optional(
                "evaluator_accuracy",
                Schema::quantity(Dimension::Length, 1e-9, 1e3)
                    .says("With `evaluator: auto`: the root mean square error that is accurate enough.")
                    .default("0.003 mm"),
            )
            .optional("area_penalty", penalty.default(AREA_PENALTY))
            .optional("area_tolerance", share(tolerance, AREA_TOLERANCE))
            .optional("units", Schema::new(units).says("Units along a side of a search along the gradient."))
            .optional("refine", refine.says("Whether the genetic algorithm's best is improved along the gradient."))
            .optional("starts", starts.default(STARTS))
            .optional(
                "designs",
                Schema::whole(1, 1000).says("So many different designs of each target.").default(defaults.designs),
            )
            .optional(
                "distance",
                share("Share of the cells in which two of them differ at least, whichever way they are turned.", defaults.distance),
            )
            .optional("population", population)
            .optional("generations", generations)
            .optional("elite", share("Best individuals that stay.", defaults.elite))
            .optional("crossover", share("Probability of a crossover.", defaults.crossover))
            .optional("mutation", share("Probability of a mutation.", defaults.mutation))
            .optional("stagnation", stagnation)
            .required("seed", seed)
            .rule(json!({ "if": is_adjoint, "then": absent(&[&GENETIC[..], &["needs"]].concat()), "else": absent(&["starts"]) }))
    }

    /// Reads the settings.
    ///
    /// # Errors
    /// When one is out of range, or has no meaning for the method.
    pub fn read(what: &str, map: &Map<'_>) -> Result<Self, InputError> {
        let method = match map
            .optional("method")
            .map_or(Ok("ga"), |n| n.word("method", &["ga", "adjoint"]))?
        {
            "adjoint" => Method::Adjoint,
            _ => Method::Ga,
        };
        let foreign: &[&str] = match method {
            Method::Ga => &["starts"],
            Method::Adjoint => &GENETIC,
        };
        if let Some((key, node)) = foreign.iter().find_map(|key| Some((key, map.optional(key)?))) {
            return Err(node
                .error(format!("`{key}` means nothing with `method: {}`", method.name()))
                .help("leave it out"));
        }
        let seed = map.required(what, "seed")?;
        let accuracy = match map.optional("evaluator_accuracy") {
            Some(node) => node.quantity_in("evaluator_accuracy", Dimension::Length, 1e-9, 1e3)?,
            None => Quantity::parse(EVALUATOR_ACCURACY, Dimension::Length).map_err(|e| seed.error(e.to_string()))?,
        };
        let defaults = EvolveOptions::default();
        let count = |key, default: usize, low, high| {
            map.optional(key)
                .map_or(Ok(default), |n| n.whole(key, low, high).map(|n| n as usize))
        };
        let shares = [
            map.number("elite", defaults.elite, 0.0, 1.0)?,
            map.number("crossover", defaults.crossover, 0.0, 1.0)?,
            map.number("mutation", defaults.mutation, 0.0, 1.0)?,
        ];
        let distance = map.number("distance", defaults.distance, 0.0, 1.0)?;
        let stagnation = map
            .optional("stagnation")
            .map(|n| n.whole("stagnation", 1, 1_000_000))
            .transpose()?;
        let units = count("units", CELLS, UNITS as u64, CELLS as u64)?;
        if units != UNITS && units != CELLS {
            let error = map.optional("units").map_or(seed, |node| node);
            return Err(error
                .error(format!("`units` is {units}"))
                .help(format!("allowed: {UNITS} or {CELLS}")));
        }
        Ok(Self {
            method,
            accuracy,
            penalty: map.number("area_penalty", AREA_PENALTY, 0.0, 1e6)?,
            tolerance: map.number("area_tolerance", AREA_TOLERANCE, 0.0, 1.0)?,
            units,
            refine: map.optional("refine").map_or(Ok(false), |n| n.bool("refine"))?,
            starts: count("starts", STARTS as usize, 1, 1000)?,
            evolve: EvolveOptions {
                population: count("population", defaults.population, 2, 1_000_000)?,
                generations: count("generations", defaults.generations, 0, 1_000_000)?,
                elite: shares[0].to_f64(),
                crossover: shares[1].to_f64(),
                mutation: shares[2].to_f64(),
                stagnation: stagnation.map(|n| n as usize),
                designs: count("designs", defaults.designs, 1, 1000)?,
                distance: distance.to_f64(),
                seed: seed.whole("seed", 0, i64::MAX as u64)?,
            },
            shares,
            distance,
        })
    }

    /// The canonical value, with further entries. What a method does not use is no part of it.
    pub fn canonical<'a>(&self, more: impl IntoIterator<Item = (&'a str, Canonical)>) -> Canonical {
        let mut own = vec![
            ("method", Canonical::from(self.method.name())),
            ("seed", self.evolve.seed.into()),
            ("area_tolerance", self.tolerance.into()),
        ];
        if self.evolve.designs > 1 {
            own.extend([
                ("designs", self.evolve.designs.into()),
                ("distance", self.distance.into()),
            ]);
        }
        match self.method {
            Method::Adjoint => own.extend([("units", self.units.into()), ("starts", self.starts.into())]),
            Method::Ga => {
                let refine = match self.refine {
                    true => Canonical::from(self.units),
                    false => Canonical::Null,
                };
                own.extend([
                    ("area_penalty", self.penalty.into()),
                    ("refine", refine),
                    ("population", self.evolve.population.into()),
                    ("generations", self.evolve.generations.into()),
                    ("elite", self.shares[0].into()),
                    ("crossover", self.shares[1].into()),
                    ("mutation", self.shares[2].into()),
                    (
                        "stagnation",
                        self.evolve.stagnation.map_or(Canonical::Null, Canonical::from),
                    ),
                ]);
            }
        }
        Canonical::map(own.into_iter().chain(more))
    }

    /// The length of the progress bar of a target.
    pub fn steps(&self) -> u64 {
        match self.method {
            Method::Ga => self.evolve.generations as u64 + 1 + u64::from(self.refine) * self.evolve.designs as u64,
            Method::Adjoint => (self.starts as u64 + 1) * self.evolve.designs as u64,
        }
    }

    /// How much work one step is, beside other settings.
    pub fn weight(&self) -> f64 {
        match self.method {
            Method::Ga => self.evolve.population as f64,
            Method::Adjoint => 1000.0,
        }
    }
}
