//! `kind: design` searches the pattern that an evaluator says moves the point farthest: a network, an estimate, or Newton's
//! method, whichever is the cheapest that is accurate enough unless one is named.

mod content;
mod evaluator;
mod probe;

use content::{describe, with_probes};
use evaluator::{Evaluator, Wanted};
use probe::Probe;

use serde_json::json;

use super::model;
use super::objective::Objective;
use crate::base::{Canonical, Decimal, Dimension, Fields, InputError, Node, Quantity, Schema};
use crate::design::{AREA_PENALTY, EvolveOptions, GenerationReport, Genome, Goal, Intuitive, evolve, first_generation};
use crate::field::Field;
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::store::Object;

/// The kind `design`.
pub struct DesignKind;

/// Accuracy in mm that is asked of an evaluator unless said otherwise. Errors on the best pattern are several times those on
/// patterns that are drawn: a chord step that errs by 0.0043 mm on these was 0.028 mm short at the point of a design.
const EVALUATOR_ACCURACY: &str = "0.003";

const KEYS: [&str; 14] = [
    "kind",
    "needs",
    "evaluator",
    "evaluator_accuracy",
    "objective",
    "area",
    "area_penalty",
    "population",
    "generations",
    "elite",
    "crossover",
    "mutation",
    "stagnation",
    "seed",
];

impl Kind for DesignKind {
    fn name(&self) -> &'static str {
        "design"
    }

    fn recipe(&self) -> u32 {
        2
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["train"],
            least: 0,
            most: 1,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let defaults = EvolveOptions::default();
        let share = |says: &str, default: f64| Schema::number(0.0, 1.0).says(says).default(default);
        let penalty = Schema::number(0.0, 1e6).says("Weight of the distance from the wanted area in the fitness.");
        let population = Schema::whole(2, 1_000_000)
            .says("Individuals.")
            .default(defaults.population);
        let generations = Schema::whole(0, 1_000_000)
            .says("Generations at most.")
            .default(defaults.generations);
        let stagnation = Schema::whole(1, 1_000_000).says("Generations without gain after which the search ends.");
        let fields = Fields::new("Searches the pattern that an evaluator says moves a point farthest.")
            .optional("evaluator", Wanted::schema())
            .optional(
                "evaluator_accuracy",
                Schema::quantity(Dimension::Length, 1e-9, 1e3)
                    .says("With `evaluator: auto`: the root mean square error that is accurate enough.")
                    .default("0.003 mm"),
            )
            .required("objective", Objective::schema())
            .optional("area", share("Wanted area fraction of the electrode.", 0.5))
            .optional("area_penalty", penalty.default(AREA_PENALTY))
            .optional("population", population)
            .optional("generations", generations)
            .optional("elite", share("Best individuals that stay.", defaults.elite))
            .optional("crossover", share("Probability of a crossover.", defaults.crossover))
            .optional("mutation", share("Probability of a mutation.", defaults.mutation))
            .optional("stagnation", stagnation)
            .required("seed", super::seed())
            .rule(json!({
                "if": { "required": ["evaluator"], "properties": { "evaluator": { "const": "surrogate" } } },
                "then": { "required": ["needs"] },
            }));
        vec![fields]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a design stage";
        let map = stage.fields(what, &KEYS)?;
        let node = map.required(what, "objective")?;
        let objective = Objective::read(node)?;
        let scene = super::scene_of(stage, scene)?;
        let side = scene.geometry.side;
        let evaluator = map.optional("evaluator").map_or(Ok(Wanted::Auto), Wanted::read)?;
        if evaluator == Wanted::Surrogate && map.optional("needs").is_none() {
            return Err(stage
                .error("`evaluator: surrogate` judges by a network, and the stage needs none")
                .help("add `needs: [STAGE]` with a stage of kind `train`, or take another evaluator"));
        }
        let accuracy = match map.optional("evaluator_accuracy") {
            Some(node) => node.quantity_in("evaluator_accuracy", Dimension::Length, 1e-9, 1e3)?,
            None => Quantity::parse(EVALUATOR_ACCURACY, Dimension::Length).map_err(|e| stage.error(e.to_string()))?,
        };
        let defaults = EvolveOptions::default();
        let (area, penalty) = (
            map.number("area", 0.5, 0.0, 1.0)?,
            map.number("area_penalty", AREA_PENALTY, 0.0, 1e6)?,
        );
        let goal = objective
            .goal(side.value(), area.to_f64(), penalty.to_f64())
            .map_err(|e| node.error(e.to_string()))?;
        let count = |key, default: usize, low, high| {
            map.optional(key)
                .map_or(Ok(default), |n| n.whole(key, low, high).map(|n| n as usize))
        };
        let shares = [
            map.number("elite", defaults.elite, 0.0, 1.0)?,
            map.number("crossover", defaults.crossover, 0.0, 1.0)?,
            map.number("mutation", defaults.mutation, 0.0, 1.0)?,
        ];
        let stagnation = map
            .optional("stagnation")
            .map(|n| n.whole("stagnation", 1, 1_000_000))
            .transpose()?;
        let options = EvolveOptions {
            population: count("population", defaults.population, 2, 1_000_000)?,
            generations: count("generations", defaults.generations, 0, 1_000_000)?,
            elite: shares[0].to_f64(),
            crossover: shares[1].to_f64(),
            mutation: shares[2].to_f64(),
            stagnation: stagnation.map(|n| n as usize),
            seed: map.required(what, "seed")?.whole("seed", 0, i64::MAX as u64)?,
        };
        Ok(Box::new(DesignStage {
            evaluator,
            accuracy,
            objective,
            goal,
            scene,
            area,
            penalty,
            shares,
            options,
        }))
    }
}

struct DesignStage {
    evaluator: Wanted,
    /// What is asked of an evaluator that is not named.
    accuracy: Quantity,
    objective: Objective,
    goal: Goal,
    scene: Scene,
    area: Decimal,
    penalty: Decimal,
    /// Elite, crossover, mutation, as written.
    shares: [Decimal; 3],
    options: EvolveOptions,
}

impl Stage for DesignStage {
    fn parameters(&self) -> Canonical {
        let stagnation = self.options.stagnation.map_or(Canonical::Null, Canonical::from);
        let accuracy = match self.evaluator {
            Wanted::Auto => Canonical::from(&self.accuracy),
            Wanted::Surrogate | Wanted::Elements(_) => Canonical::Null,
        };
        Canonical::map([
            ("evaluator", Canonical::from(self.evaluator.to_string().as_str())),
            ("evaluator_accuracy", accuracy),
            ("objective", self.objective.canonical()),
            ("scene", self.scene.canonical()),
            ("area", self.area.into()),
            ("area_penalty", self.penalty.into()),
            ("population", self.options.population.into()),
            ("generations", self.options.generations.into()),
            ("elite", self.shares[0].into()),
            ("crossover", self.shares[1].into()),
            ("mutation", self.shares[2].into()),
            ("stagnation", stagnation),
            ("seed", self.options.seed.into()),
        ])
    }

    fn weight(&self) -> f64 {
        self.options.population as f64
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: self.options.generations as u64 + 1,
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let (evaluator, probes) = self.evaluator(job)?;
        let settings = evaluator.settings;
        let predictor = evaluator
            .predictor
            .map_err(|why| StageError::Failed(format!("{{ {settings} }}: {why}")))?;
        let on_generation = |report: &GenerationReport| {
            job.progress
                .note(&format!("best {:.4} mm at area {:.3}", report.value_mm, report.area));
            job.progress.advance(1);
        };
        let failed = |e: &dyn std::fmt::Display| StageError::Failed(e.to_string());
        let evolution =
            evolve(predictor.as_ref(), &self.goal, &self.options, &on_generation).map_err(|e| failed(&e))?;
        let intuitive = Intuitive::of(&self.goal);
        let patterns = [
            evolution.best_pattern(),
            intuitive.at_own_area(),
            intuitive.at_area(self.goal.area()),
        ];
        let predicted = predictor.predict_some(&patterns).map_err(|e| failed(&e))?;
        let predicted: Option<Vec<Field>> = predicted.into_iter().collect();
        let predicted = predicted.ok_or_else(|| {
            StageError::Failed(format!(
                "{{ {settings} }} has no field for the intuitive design, which is not stable there"
            ))
        })?;
        let object = describe(&evolution, &patterns, &predicted);
        Ok(with_probes(object, &probes)
            .attribute("evaluator", settings)
            .attribute("scene", self.scene.to_text())
            .attribute("objective", self.objective.to_text()))
    }
}

impl DesignStage {
    /// What judges the patterns, with what every candidate said of some where it had to be chosen.
    fn evaluator(&self, job: &Job<'_>) -> Result<(Evaluator, Vec<Probe>), StageError> {
        let surrogate = job
            .inputs
            .first()
            .map(|input| model::in_scene(input, &self.scene))
            .transpose()?;
        match (self.evaluator, surrogate) {
            (Wanted::Elements(method), _) => Ok((Evaluator::elements(&self.scene, method, 1), Vec::new())),
            (Wanted::Surrogate, Some(surrogate)) => Ok((Evaluator::network(surrogate), Vec::new())),
            (Wanted::Surrogate, None) => Err(StageError::Input(
                "`evaluator: surrogate` judges by a network, and the stage needs none".to_owned(),
            )),
            (Wanted::Auto, surrogate) => {
                let count = self.options.population.min(probe::PATTERNS);
                let genomes = first_generation(self.goal.area(), self.options.seed, count);
                let patterns: Vec<Pattern> = genomes.iter().map(Genome::pattern).collect();
                let candidates = probe::candidates(&self.scene, surrogate);
                probe::cheapest(candidates, &patterns, self.accuracy.value())
                    .map_err(|e| StageError::Failed(e.to_string()))
            }
        }
    }
}
