//! `kind: design` searches the pattern that a surrogate says moves the point farthest.

use super::arrays;
use super::objective::Objective;
use crate::base::{Canonical, Decimal, Fields, InputError, Node, Quantity, Schema};
use crate::design::{AREA_PENALTY, Evolution, EvolveOptions, GenerationReport, Goal, Intuitive, UNITS, evolve};
use crate::field::{Field, Predictor};
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::pattern::Pattern;
use crate::store::{Data, Dataset, Object};
use crate::surrogate::Surrogate;

/// The kind `design`.
pub struct DesignKind;

const KEYS: [&str; 12] = [
    "kind",
    "needs",
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
        1
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["train"],
            least: 1,
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
        let fields = Fields::new("Searches the pattern that a surrogate says moves a point farthest.")
            .required("objective", Objective::schema())
            .optional("area", share("Wanted area fraction of the electrode.", 0.5))
            .optional("area_penalty", penalty.default(AREA_PENALTY))
            .optional("population", population)
            .optional("generations", generations)
            .optional("elite", share("Best individuals that stay.", defaults.elite))
            .optional("crossover", share("Probability of a crossover.", defaults.crossover))
            .optional("mutation", share("Probability of a mutation.", defaults.mutation))
            .optional("stagnation", stagnation)
            .required("seed", super::seed());
        vec![fields]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let what = "a design stage";
        let map = stage.fields(what, &KEYS)?;
        let node = map.required(what, "objective")?;
        let objective = Objective::read(node)?;
        let side = super::scene_of(stage, scene)?.geometry.side;
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
            objective,
            goal,
            side,
            area,
            penalty,
            shares,
            options,
        }))
    }
}

struct DesignStage {
    objective: Objective,
    goal: Goal,
    side: Quantity,
    area: Decimal,
    penalty: Decimal,
    /// Elite, crossover, mutation, as written.
    shares: [Decimal; 3],
    options: EvolveOptions,
}

impl Stage for DesignStage {
    fn parameters(&self) -> Canonical {
        let stagnation = self.options.stagnation.map_or(Canonical::Null, Canonical::from);
        Canonical::map([
            ("objective", self.objective.canonical()),
            ("side", Canonical::from(&self.side)),
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
        let [model] = job.inputs else {
            return Err(StageError::Failed("a design stage reads one model".to_owned()));
        };
        let surrogate = Surrogate::load(&model.u8s("weights")?.1)
            .map_err(|e| StageError::Input(format!("artifact {}: {e}", model.digest().short())))?;
        let on_generation = |report: &GenerationReport| {
            job.progress
                .note(&format!("best {:.4} mm at area {:.3}", report.value_mm, report.area));
            job.progress.advance(1);
        };
        let failed = |e: &dyn std::fmt::Display| StageError::Failed(e.to_string());
        let evolution = evolve(&surrogate, &self.goal, &self.options, &on_generation).map_err(|e| failed(&e))?;
        let intuitive = Intuitive::of(&self.goal);
        let patterns = [
            evolution.best_pattern(),
            intuitive.at_own_area(),
            intuitive.at_area(self.goal.area()),
        ];
        let predicted = surrogate.predict(&patterns).map_err(|e| failed(&e))?;
        let object = describe(&evolution, &patterns, &predicted);
        let object = object.attribute("scene", super::scene_attribute(job.inputs)?);
        Ok(object.attribute("objective", self.objective.to_text()))
    }
}

fn describe(evolution: &Evolution, patterns: &[Pattern; 3], predicted: &[Field]) -> Object {
    let curve = |units, description, value: fn(&GenerationReport) -> f64| {
        arrays::reals(units, description, evolution.history.iter().map(value).collect())
    };
    let genes = evolution
        .history
        .iter()
        .flat_map(|report| report.genome.genes().iter().map(|&on| u8::from(on)));
    let genomes = Dataset::new(
        "1",
        "best genome of each generation [generation][y][x]",
        &[evolution.history.len(), UNITS, UNITS],
        Data::U8(genes.collect()),
    );
    let mut object = Object::default()
        .with(
            "history/best",
            curve(
                "1",
                "fitness of the best individual of each generation, smaller is better",
                |r| r.best,
            ),
        )
        .with(
            "history/mean",
            curve("1", "mean fitness of each generation", |r| r.mean),
        )
        .with(
            "history/value",
            curve(
                "mm",
                "predicted displacement of the best along the wanted direction",
                |r| r.value_mm,
            ),
        )
        .with("history/area", curve("1", "area fraction of the best", |r| r.area))
        .with("history/genomes", genomes)
        .with(
            "evaluations",
            arrays::wholes("1", "patterns predicted", vec![evolution.evaluations as u64]),
        );
    for ((name, pattern), field) in ["best", "intuitive", "intuitive_equal_area"]
        .into_iter()
        .zip(patterns)
        .zip(predicted)
    {
        let shown = arrays::pattern("electrode pattern [y][x], origin lower left, 1 = electrode", pattern);
        object = object.with(&format!("{name}/pattern"), shown).with(
            &format!("{name}/predicted"),
            arrays::field("predicted displacement at the cell corners [y][x][component]", field),
        );
    }
    object
}
