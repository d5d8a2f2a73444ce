//! `kind: verify` simulates the design on a finer mesh, beside the intuitive design at its own and at equal area.

use super::arrays;
use super::objective::Objective;
use super::screening::Screened;
use super::solver::{SolverParameters, explained};
use crate::base::{Canonical, Document, Fields, InputError, Node};
use crate::fem::SetupError;
use crate::field::{Field, Outcome, Simulation};
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::store::{Artifact, Object};

/// The cases with the group of the design artifact that each stands in.
const CASES: [(&str, &str); 3] = [
    ("design", "best"),
    ("intuitive", "intuitive"),
    ("intuitive-equal-area", "intuitive_equal_area"),
];

/// Elements per cell unless a stage says otherwise.
const ELEMENTS_PER_CELL: u64 = 4;

/// The kind `verify`.
pub struct VerifyKind;

impl Kind for VerifyKind {
    fn name(&self) -> &'static str {
        "verify"
    }

    fn recipe(&self) -> u32 {
        2
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["design"],
            least: 1,
            most: 1,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let fields = Fields::new("Simulates a design beside the intuitive one.");
        vec![SolverParameters::schema(fields, ELEMENTS_PER_CELL, true)]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields(
            "a verify stage",
            &[&["kind", "needs"], &SolverParameters::KEYS[..]].concat(),
        )?;
        let scene = super::scene_of(stage, scene)?;
        Ok(Box::new(VerifyStage {
            solver: SolverParameters::read(&map, ELEMENTS_PER_CELL)?,
            scene,
        }))
    }
}

struct VerifyStage {
    solver: SolverParameters,
    scene: Scene,
}

/// One pattern with what was predicted and what was simulated.
struct Case {
    name: &'static str,
    pattern: Pattern,
    predicted: Field,
    simulation: Simulation,
}

impl Stage for VerifyStage {
    fn parameters(&self) -> Canonical {
        self.solver.canonical([("scene", self.scene.canonical())])
    }

    fn weight(&self) -> f64 {
        self.solver.weight()
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: CASES.len() as u64,
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let [design] = job.inputs else {
            return Err(StageError::Failed("a verify stage reads one design".to_owned()));
        };
        let failed = |e: SetupError| StageError::Failed(explained(&e));
        let screened = Screened::new(&self.scene).map_err(failed)?;
        let solver = self.solver.build(&screened.scene).map_err(failed)?;
        let mut cases = Vec::new();
        for (name, group) in CASES {
            let pattern = single(arrays::read_patterns(design, &format!("{group}/pattern"))?, design)?;
            let predicted = single(arrays::read_fields(design, &format!("{group}/predicted"))?, design)?;
            let simulated = solver.simulate(std::slice::from_ref(&pattern)).map_err(failed)?;
            let simulation = single(simulated, design)?.simulation;
            job.progress.advance(1);
            cases.push(Case {
                name,
                pattern,
                predicted,
                simulation,
            });
        }
        let value = objective_value(design, &self.scene)?;
        let text = design.attribute("objective").unwrap_or_default().to_owned();
        let object = describe(&cases, &value)
            .attribute("scene", self.scene.to_text())
            .attribute("objective", text);
        Ok(screened.describe(object))
    }

    fn unstable(&self, artifact: &Artifact) -> Result<u64, StageError> {
        Ok(artifact
            .texts("outcome")?
            .1
            .iter()
            .filter(|o| !Outcome::names_field(o))
            .count() as u64)
    }
}

fn single<T>(items: Vec<T>, design: &Artifact) -> Result<T, StageError> {
    let found = items.len();
    let wrong = || {
        StageError::Input(format!(
            "artifact {}: {found} items where one belongs",
            design.digest().short()
        ))
    };
    items.into_iter().next().filter(|_| found == 1).ok_or_else(wrong)
}

/// The displacement in mm along the wanted direction, as a function of the field.
fn objective_value(design: &Artifact, scene: &Scene) -> Result<impl Fn(&Field) -> f64 + use<>, StageError> {
    let wrong = |e: &dyn std::fmt::Display| StageError::Input(format!("artifact {}: {e}", design.digest().short()));
    let text = design
        .attribute("objective")
        .ok_or_else(|| wrong(&"it has no objective"))?;
    let document = Document::from_text(std::path::Path::new("objective"), text).map_err(|e| wrong(&e))?;
    let objective = Objective::read(&document.root).map_err(|e| wrong(&e))?;
    // Area and its weight do not enter the displacement.
    let goal = objective.goal(scene.side_mm(), 0.5, 0.0).map_err(|e| wrong(&e))?;
    Ok(move |field: &Field| goal.value_mm(field))
}

/// Gain of the design over another case; nothing where one of them is unstable or the other does not move.
fn gain(cases: &[Case], value: &impl Fn(&Field) -> f64, other: &str) -> Vec<f64> {
    let simulated = |name: &str| {
        let case = cases.iter().find(|case| case.name == name)?;
        case.simulation.field.as_ref().map(value)
    };
    match (simulated("design"), simulated(other)) {
        (Some(design), Some(other)) if other.abs() > 1e-9 => vec![(design - other) / other.abs()],
        _ => Vec::new(),
    }
}

fn describe(cases: &[Case], value: &impl Fn(&Field) -> f64) -> Object {
    let solved: Vec<(&Case, &Field)> = cases
        .iter()
        .filter_map(|c| Some((c, c.simulation.field.as_ref()?)))
        .collect();
    let differences: Vec<Field> = solved
        .iter()
        .filter_map(|(case, field)| difference(&case.predicted, field))
        .collect();
    let patterns: Vec<Pattern> = cases.iter().map(|case| case.pattern.clone()).collect();
    let fields: Vec<&Field> = solved.iter().map(|(_, field)| *field).collect();
    let predicted: Vec<&Field> = cases.iter().map(|case| &case.predicted).collect();
    let of_converged = "; one row for each case with a field, in their order";
    Object::default()
        .with(
            "case",
            arrays::texts("which design", cases.iter().map(|case| case.name)),
        )
        .with(
            "outcome",
            arrays::texts(
                "how the simulation ended",
                cases.iter().map(|case| case.simulation.outcome.name()),
            ),
        )
        .with(
            "patterns",
            arrays::patterns(
                "electrode patterns [case][y][x], origin lower left, 1 = electrode",
                &patterns,
            ),
        )
        .with(
            "area",
            arrays::reals(
                "1",
                "area fraction of the electrode",
                patterns.iter().map(Pattern::area_fraction).collect(),
            ),
        )
        .with(
            "predicted",
            arrays::fields("predicted displacement [case][y][x][component]", predicted.into_iter()),
        )
        .with(
            "displacement",
            arrays::fields(
                &format!("simulated displacement [y][x][component]{of_converged}"),
                fields.iter().copied(),
            ),
        )
        .with(
            "difference",
            arrays::fields(&format!("predicted minus simulated{of_converged}"), differences.iter()),
        )
        .with(
            "component/predicted",
            arrays::reals(
                "mm",
                "predicted displacement of the point along the wanted direction",
                cases.iter().map(|c| value(&c.predicted)).collect(),
            ),
        )
        .with(
            "component/simulated",
            arrays::reals(
                "mm",
                &format!("simulated displacement along the wanted direction{of_converged}"),
                fields.iter().map(|f| value(f)).collect(),
            ),
        )
        .with(
            "gain/own_area",
            arrays::reals(
                "1",
                "gain over the intuitive design at its own area; empty where it is not defined",
                gain(cases, value, "intuitive"),
            ),
        )
        .with(
            "gain/equal_area",
            arrays::reals(
                "1",
                "gain over the intuitive design at equal area; empty where it is not defined",
                gain(cases, value, "intuitive-equal-area"),
            ),
        )
}

fn difference(a: &Field, b: &Field) -> Option<Field> {
    Field::from_values(a.values().iter().zip(b.values()).map(|(a, b)| a - b).collect()).ok()
}
