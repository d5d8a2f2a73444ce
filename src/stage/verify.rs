//! `kind: verify` simulates designs on two finer meshes, beside the intuitive ones.

use super::arrays;
use super::screening::Screened;
use crate::base::{Canonical, Document, Fields, InputError, Node};
use crate::design::{Goal, Objective};
use crate::fem::{AccurateSimulation, SetupError, Solver, SolverParameters};
use crate::field::{Field, Mesh, Outcome};
use crate::orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageError};
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::store::{Artifact, Object};

/// The mesh unless a stage says otherwise.
const MESH: Mesh = Mesh::bilinear(4);

/// Patterns between two reports of progress.
const BATCH: usize = 8;

/// Stages of designs that one stage may verify.
const MOST: usize = 1000;

/// What is said of each row in a word, handed on from the design.
const TEXTS: [(&str, &str); 5] = [
    ("case", "label of the stage that designed it"),
    ("name", "name of the target"),
    (
        "role",
        "how the pattern came about: ga, refined, optimum, intuitive, intuitive-equal-area",
    ),
    ("area_target", "wanted area fraction, or free"),
    ("evaluator", "what predicted the field"),
];

/// What is said of each row at length.
const LONG_TEXTS: [(&str, &str); 3] = [
    ("objective", "the objective in YAML"),
    ("constraints", "the constraints in YAML"),
    ("status", "met, or which constraints are not, as the search knew it"),
];

/// The kind `verify`.
pub struct VerifyKind;

impl Kind for VerifyKind {
    fn name(&self) -> &'static str {
        "verify"
    }

    fn recipe(&self) -> u32 {
        3
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["design"],
            least: 1,
            most: MOST,
        }
    }

    fn schema(&self) -> Vec<Fields> {
        let fields = Fields::new("Simulates designs on two meshes, beside the intuitive ones.");
        vec![SolverParameters::schema(fields, MESH, true)]
    }

    fn teaches(&self) -> Option<&'static str> {
        Some("train")
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields(
            "a verify stage",
            &[&["kind", "needs", "rounds", "update"], &SolverParameters::KEYS[..]].concat(),
        )?;
        let scene = super::scene_of(stage, scene)?;
        Ok(Box::new(VerifyStage {
            solver: SolverParameters::read(&map, MESH)?,
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
    /// In the order of [`TEXTS`].
    texts: [String; TEXTS.len()],
    /// In the order of [`LONG_TEXTS`].
    long_texts: [String; LONG_TEXTS.len()],
    member: u64,
    units: u64,
    goal: Goal,
    pattern: Pattern,
    predicted: Field,
    simulated: Option<Simulated>,
}

/// What two meshes say.
struct Simulated {
    outcome: Outcome,
    field: Option<Field>,
    /// Estimated discretisation error of the displacement along the wanted directions, in mm, where it is known.
    error: Option<f64>,
}

impl Stage for VerifyStage {
    fn parameters(&self) -> Canonical {
        self.solver.canonical([("scene", self.scene.canonical())])
    }

    fn weight(&self) -> f64 {
        self.solver.weight()
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: inputs.iter().map(|input| input.parts.len() as u64).sum(),
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let failed = |e: SetupError| StageError::Failed(e.to_string());
        let screened = Screened::new(&self.scene).map_err(failed)?;
        let solver = self.solver.build(&screened.scene).map_err(failed)?;
        let beside = self.solver.beside().map(|other| other.build(&screened.scene));
        let beside = beside.transpose().map_err(failed)?;
        let steps = targets(job.inputs)?;
        let mut cases = self.cases(job.inputs)?;
        let count = cases.len().max(1) as u64;
        let mut told = 0;
        for start in (0..cases.len()).step_by(BATCH) {
            let end = (start + BATCH).min(cases.len());
            simulate(&mut cases[start..end], &solver, beside.as_ref()).map_err(failed)?;
            let reached = steps * end as u64 / count;
            job.progress.advance(reached - told);
            told = reached;
        }
        let object = describe(&cases)
            .attribute("scene", self.scene.to_text())
            .attribute("solver", format!("{{ {} }}", self.solver))
            .attribute("effects", screened.effects())
            .attribute("warnings", screened.warnings.join("\n"));
        Ok(object)
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

impl VerifyStage {
    /// The rows of all designs. Intuitive ones that several designs of a target were compared with are there once. What stands
    /// under one case and name is compared, so it must be for the same objective at the same area.
    fn cases(&self, designs: &[Artifact]) -> Result<Vec<Case>, StageError> {
        let mut cases: Vec<Case> = Vec::new();
        for design in designs {
            for case in self.cases_of(design)? {
                let [label, name, role, ..] = &case.texts;
                let wish = |c: &Case| (c.long_texts[0].clone(), c.texts[3].clone());
                let other = cases.iter().find(|other| other.texts[..2] == case.texts[..2]);
                if other.is_some_and(|other| wish(other) != wish(&case)) {
                    return Err(StageError::Input(format!(
                        "two stages design `{name}` of the case {label:?} for different objectives or areas, which cannot be \
                         compared: tell them apart by `case` or by the names of targets"
                    )));
                }
                let same = |other: &Case| other.texts[..3] == case.texts[..3] && other.pattern == case.pattern;
                if role.starts_with("intuitive") && cases.iter().any(same) {
                    continue;
                }
                if !role.starts_with("intuitive") {
                    let identity = |c: &Case| (c.texts[..3].to_vec(), c.member, c.units);
                    if cases.iter().any(|other| identity(other) == identity(&case)) {
                        return Err(StageError::Input(format!(
                            "two stages have a design `{name}` of role {role}, {} units and the case {label:?}: \
                             tell them apart by `case` or by the names of targets",
                            case.units
                        )));
                    }
                }
                cases.push(case);
            }
        }
        Ok(cases)
    }

    fn cases_of(&self, design: &Artifact) -> Result<Vec<Case>, StageError> {
        let wrong = |why: &str| StageError::Input(format!("artifact {}: {why}", design.digest().short()));
        let patterns = arrays::read_patterns(design, "patterns")?;
        let predicted = arrays::read_fields(design, "predicted")?;
        let (member, units) = (design.u64s("member")?.1, design.u64s("units")?.1);
        let texts: Vec<Vec<String>> = TEXTS
            .iter()
            .map(|(path, _)| Ok(design.texts(path)?.1))
            .collect::<Result<_, StageError>>()?;
        let long_texts: Vec<Vec<String>> = LONG_TEXTS
            .iter()
            .map(|(path, _)| Ok(design.long_texts(path)?))
            .collect::<Result<_, StageError>>()?;
        let n = patterns.len();
        let lengths = [predicted.len(), member.len(), units.len()];
        let mut columns = texts.iter().chain(&long_texts);
        if lengths != [n; 3] || columns.any(|column| column.len() != n) {
            return Err(wrong("its arrays differ in length"));
        }
        patterns
            .into_iter()
            .zip(predicted)
            .enumerate()
            .map(|(row, (pattern, predicted))| {
                let long_texts: [String; LONG_TEXTS.len()] = std::array::from_fn(|k| long_texts[k][row].clone());
                Ok(Case {
                    goal: goal(&long_texts[0], &self.scene).map_err(|why| wrong(&why))?,
                    texts: std::array::from_fn(|k| texts[k][row].clone()),
                    long_texts,
                    member: member[row],
                    units: units[row],
                    pattern,
                    predicted,
                    simulated: None,
                })
            })
            .collect()
    }
}

/// How many targets the designs have together: the length of the progress bar.
fn targets(designs: &[Artifact]) -> Result<u64, StageError> {
    let mut sum = 0;
    for design in designs {
        let mut names = design.texts("name")?.1;
        names.dedup();
        sum += names.len() as u64;
    }
    Ok(sum)
}

fn simulate(cases: &mut [Case], solver: &Solver, beside: Option<&Solver>) -> Result<(), SetupError> {
    let patterns: Vec<Pattern> = cases.iter().map(|case| case.pattern.clone()).collect();
    let results = solver.simulate(&patterns)?;
    let others = beside.map(|other| other.simulate(&patterns)).transpose()?;
    for (k, (case, result)) in cases.iter_mut().zip(results).enumerate() {
        let AccurateSimulation {
            simulation,
            discretisation_error,
            ..
        } = result;
        let other = others.as_ref().and_then(|others| others[k].simulation.field.as_ref());
        let difference = |field: &Field, other: &Field| (case.goal.value_mm(field) - case.goal.value_mm(other)).abs();
        let between = simulation
            .field
            .as_ref()
            .zip(other)
            .map(|(field, other)| difference(field, other));
        case.simulated = Some(Simulated {
            outcome: simulation.outcome,
            field: simulation.field,
            error: discretisation_error.or(between),
        });
    }
    Ok(())
}

/// What a design was for. Area and its weight do not enter the displacement.
fn goal(text: &str, scene: &Scene) -> Result<Goal, String> {
    let document = Document::from_text(std::path::Path::new("objective"), text).map_err(|e| e.to_string())?;
    let objective = Objective::read(&document.root).map_err(|e| e.to_string())?;
    objective.goal(scene.side_mm(), None, 0.0).map_err(|e| e.to_string())
}

fn describe(cases: &[Case]) -> Object {
    let known: Vec<(&Case, &Field, Option<f64>)> = cases
        .iter()
        .filter_map(|case| {
            let simulated = case.simulated.as_ref()?;
            Some((case, simulated.field.as_ref()?, simulated.error))
        })
        .collect();
    let outcome = |case: &Case| case.simulated.as_ref().map_or("iteration-limit", |s| s.outcome.name());
    let differences: Vec<Field> = known
        .iter()
        .filter_map(|(case, field, _)| difference(&case.predicted, field))
        .collect();
    let patterns: Vec<Pattern> = cases.iter().map(|case| case.pattern.clone()).collect();
    let predicted: Vec<&Field> = cases.iter().map(|case| &case.predicted).collect();
    let fields: Vec<&Field> = known.iter().map(|(_, field, _)| *field).collect();
    let of_known = "; one row for each pattern with a field, in their order";
    let mut object = Object::default();
    for (k, (path, note)) in TEXTS.iter().enumerate() {
        object = object.with(
            path,
            arrays::texts(note, cases.iter().map(|case| case.texts[k].as_str())),
        );
    }
    for (k, (path, note)) in LONG_TEXTS.iter().enumerate() {
        object = object.with_long_texts(path, note, cases.iter().map(|case| case.long_texts[k].as_str()));
    }
    let wholes = |note: &str, of: fn(&Case) -> u64| arrays::wholes("1", note, cases.iter().map(of).collect());
    let reals = |note: &str, values: Vec<f64>| arrays::reals("mm", &format!("{note}{of_known}"), values);
    object
        .with("member", wholes("which of several designs of the target", |case| case.member))
        .with("units", wholes("units along a side by which it was searched", |case| case.units))
        .with("outcome", arrays::texts("how the simulation ended", cases.iter().map(outcome)))
        .with(
            "patterns",
            arrays::patterns("electrode patterns [row][y][x], origin lower left, 1 = electrode", &patterns),
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
            arrays::fields("predicted displacement [row][y][x][component]", predicted.into_iter()),
        )
        .with(
            "displacement",
            arrays::fields(
                &format!("simulated displacement [y][x][component]{of_known}"),
                fields.iter().copied(),
            ),
        )
        .with(
            "difference",
            arrays::fields(&format!("predicted minus simulated{of_known}"), differences.iter()),
        )
        .with(
            "component/predicted",
            arrays::reals(
                "mm",
                "predicted mean displacement along the wanted directions",
                cases.iter().map(|case| case.goal.value_mm(&case.predicted)).collect(),
            ),
        )
        .with(
            "component/simulated",
            reals(
                "simulated mean displacement along the wanted directions",
                known.iter().map(|(case, field, _)| case.goal.value_mm(field)).collect(),
            ),
        )
        .with(
            "component/error",
            reals(
                "what a mesh of half the elements per cell says otherwise, or the estimated error where an accuracy was asked \
                 for; 0 where it is not known",
                known.iter().map(|(.., error)| error.unwrap_or(0.0)).collect(),
            ),
        )
        .with(
            "component/error_known",
            arrays::wholes(
                "1",
                &format!("whether the error is known: the other mesh has a field too{of_known}"),
                known.iter().map(|(.., error)| u64::from(error.is_some())).collect(),
            ),
        )
        .with(
            "component/distance",
            reals(
                "simulated distance from the wanted displacements, root mean square; 0 where nothing but a direction is wanted",
                known
                    .iter()
                    .map(|(case, field, _)| case.goal.distance_mm(field).unwrap_or(0.0))
                    .collect(),
            ),
        )
}

fn difference(a: &Field, b: &Field) -> Option<Field> {
    Field::from_values(a.values().iter().zip(b.values()).map(|(a, b)| a - b).collect()).ok()
}
