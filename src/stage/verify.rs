//! `kind: verify` simulates designs on two finer meshes, beside the intuitive ones and a person's own.

mod compared;
mod own;

use std::collections::BTreeMap;
use std::slice;
use std::sync::Arc;

use super::design::{self, PlannedDesign, swing_of};
use super::results::of_targets;
use super::{drive_check, patterns, scene, solution};
use deaflow_base::{Canonical, Document, Fields, InputError, Map, Node};
use deaflow_content::{Components, DesignRows, Designs, Packed, SimulatedStates, Verification, predicted_rows};
use deaflow_design::{Goal, Moment, Objective};
use deaflow_fem::screening::resolved_states;
use deaflow_fem::{AccurateHistory, AccurateSimulation, History, SetupError, Solver, SolverParameters, Swing};
use deaflow_field::{Field, Mesh, Outcome, StateFields};
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_pattern::{Pattern, Role};
use deaflow_scene::{Effects, Scene};
use deaflow_store::{Artifact, Object};

use own::{OwnCase, OwnPatterns};

/// The mesh unless a stage says otherwise.
const MESH: Mesh = Mesh::bilinear(4);

/// Patterns between two reports of progress.
const BATCH: usize = 8;

/// Stages of designs that one stage may verify.
const MOST: usize = 1000;

/// The kind `verify`.
pub struct VerifyKind;

impl Kind for VerifyKind {
    fn name(&self) -> &'static str {
        "verify"
    }

    fn recipe(&self) -> u32 {
        5
    }

    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &["method", "accuracy", "history", "scene.effects"]
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Verification::open(artifact)?;
        let rows = view.rows();
        let (names, roles) = (rows.name().read()?, rows.role().read()?);
        let (simulated, area) = (view.component().simulated().read()?, rows.area().read()?);
        let found = names.iter().zip(&roles).zip(view.simulated_rows()?).enumerate();
        let found = found.filter(|(_, ((_, role), _))| role.is_found());
        // Of each target one design: an optimum is what others are held against, where there are others.
        let rank = |row: usize, at: usize| (roles[row] != Role::Optimum, simulated[at]);
        let mut best: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        for (row, at, name) in found.filter_map(|(row, ((name, _), at))| Some((row, at?, name.as_str()))) {
            let held = best.entry(name).or_insert((row, at));
            if rank(held.0, held.1) < rank(row, at) {
                *held = (row, at);
            }
        }
        let found: Vec<(&str, usize, usize)> = best.into_iter().map(|(name, (row, at))| (name, row, at)).collect();
        let by_row: Vec<(&str, usize)> = found.iter().map(|(name, row, _)| (*name, *row)).collect();
        let predicted = predicted_rows(&roles);
        let by_prediction: Vec<(&str, usize)> = by_row
            .iter()
            .filter_map(|(name, row)| Some((*name, predicted[*row]?)))
            .collect();
        let by_field: Vec<(&str, usize)> = found.iter().map(|(name, _, at)| (*name, *at)).collect();
        let mut results = of_targets(&by_field, &[("displacement", &simulated)]);
        results.extend(of_targets(&by_row, &[("area", &area)]));
        let predicted = view.component().predicted().read()?;
        results.extend(of_targets(&by_prediction, &[("predicted", &predicted)]));
        Ok(results)
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["design"],
            least: 1,
            most: MOST,
        }
    }

    fn reads_scene(&self) -> bool {
        true
    }

    fn optional_needs(&self) -> &'static [&'static str] {
        &[patterns::NAME]
    }

    fn schema(&self) -> Vec<Fields> {
        let fields =
            Fields::new("Simulates designs on two meshes, beside the intuitive ones and those of patterns stages.");
        vec![SolverParameters::schema(fields, MESH)]
    }

    fn feedback_target(&self) -> Option<&'static str> {
        Some("train")
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        let map = stage.node.fields(WHAT, &keys())?;
        let solver = SolverParameters::read(&map, MESH)?;
        let designs = needs.iter().filter(|need| need.kind == "design").map(design::planned);
        let designs = designs.collect::<Result<Vec<_>, _>>()?.concat();
        for design in &designs {
            refuse_moment(design, &solver, &map, stage)?;
        }
        let node = stage.node.peek("needs").unwrap_or(stage.node);
        compared::refuse(&designs, node)?;
        let mut check = drive_check::check_simulations(stage);
        check.warnings.splice(..0, compared::warnings(&designs));
        Ok(check)
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields(WHAT, &keys())?;
        let solver = SolverParameters::read(&map, MESH)?;
        let scene = scene::read_all_states(stage, scene)?;
        let scene = match solver.follows_time() {
            true => solver.decisive(&scene),
            // Designs may be for an amplitude about the bias.
            false => scene.simulated_about_bias(),
        };
        solver.check_scene(&map, &scene)?;
        Ok(Box::new(VerifyStage { solver, scene }))
    }
}

const WHAT: &str = "a verify stage";

fn keys() -> Vec<&'static str> {
    [&["kind", "needs", "rounds", "update"], &SolverParameters::keys()[..]].concat()
}

/// Refuses a design that is meant at a time, or an amplitude, which the stage does not simulate.
fn refuse_moment(
    design: &PlannedDesign,
    solver: &SolverParameters,
    map: &Map<'_>,
    stage: &StageDeclaration<'_>,
) -> Result<(), InputError> {
    let node = map.optional("history").unwrap_or(stage.node);
    let name = format!("design `{}` of stage `{}`", design.target, design.stage);
    moment_in(design.moment, solver)
        .map(|_| ())
        .map_err(|(what, help)| node.error(format!("{name} {what}")).help(help))
}

/// Which of the times that are simulated a moment is; the last where it is an equilibrium, the first of an amplitude. Else what is wrong, and
/// what helps.
fn moment_in(moment: Moment, solver: &SolverParameters) -> Result<usize, (String, String)> {
    let times = solver.times().unwrap_or_default();
    match moment {
        Moment::Equilibrium => Ok(times.len().saturating_sub(1)),
        Moment::After(time) => times.iter().position(|of| *of == time.value()).ok_or_else(|| {
            let what = format!("needs the time {time}, which this stage does not simulate");
            let help = format!("`history` in the verify stage must have it, as in {{ at: [{time}] }}");
            (what, help)
        }),
        Moment::Swing(frequency) if solver.follows_time() => {
            let what = format!("is meant at {frequency}, and this stage simulates a `history`");
            Err((what, "amplitudes are verified by a stage without one".to_owned()))
        }
        Moment::Swing(_) => Ok(0),
    }
}

struct VerifyStage {
    solver: SolverParameters,
    scene: Scene,
}

/// The designs of all inputs.
#[derive(Default)]
struct Cases {
    rows: DesignRows,
    /// What each is for.
    goals: Vec<Timed>,
}

/// What a design is for, and at which of the times that are asked for.
#[derive(Clone)]
struct Timed {
    goal: Goal,
    at: usize,
    /// What swings, where an amplitude counts.
    swings: Option<Arc<Swings>>,
}

/// What swings on the mesh of the stage, and on the one beside it.
struct Swings {
    own: Swing,
    beside: Option<Swing>,
}

/// A solver in each state of the device, with the one on the other mesh.
struct Solvers(Vec<(Solver, Option<Solver>)>);

/// What two meshes say of a pattern in each state of the device.
struct SolvedStates(Vec<SolvedState>);

/// The same in one state.
struct SolvedState {
    result: AccurateSimulation,
    /// How it gets there, where times were asked for.
    history: Option<History>,
    /// The fields at all times that were asked for; one where none were.
    fields: Option<Vec<Field>>,
    /// The same on the other mesh.
    others: Option<Vec<Field>>,
}

/// The same for a goal.
struct Simulated {
    /// Of the first state without a field; of the first where all have one.
    outcome: Outcome,
    /// In each state.
    fields: Option<StateFields>,
    /// Estimated discretisation error of the displacement along the wanted directions, in mm, where it is known.
    error: Option<f64>,
    /// Its value in mm at each of the times that were asked for; empty where it has no field.
    values_mm: Vec<f64>,
    /// How it moves in time, where times were asked for and there is one state.
    history: Option<History>,
}

impl Stage for VerifyStage {
    fn parameters(&self) -> Canonical {
        self.solver.canonical([("scene", self.scene.canonical())])
    }

    fn weight(&self) -> f64 {
        self.solver.weight()
    }

    fn revision(&self) -> u32 {
        self.solver.revision(&self.scene)
    }

    // Its inputs hold the whole search, of which it simulates the best alone.
    fn time_scales_with_inputs(&self) -> bool {
        false
    }

    fn unit(&self) -> &'static str {
        "targets"
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: inputs.iter().map(|input| input.parts.len() as u64).sum(),
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let failed = StageError::failed;
        let states = resolved_states(&self.scene).map_err(failed)?;
        let solvers = Solvers::new(&self.solver, &states).map_err(failed)?;
        let (own, designs): (Vec<&Artifact>, Vec<&Artifact>) =
            job.inputs.iter().partition(|input| input.kind() == patterns::NAME);
        let own = OwnPatterns::read(&own)?;
        let mut cases = self.cases(&designs, &states)?;
        let patterns = [&cases.rows.patterns, own.patterns()].concat();
        let (count, steps) = (patterns.len(), targets(&designs)?);
        let (mut solved, mut told) = (Vec::with_capacity(count), 0);
        for batch in patterns.chunks(BATCH.min(rayon::current_num_threads())) {
            solved.extend(solvers.solve(batch).map_err(failed)?);
            let reached = steps * solved.len() as u64 / count as u64;
            job.progress.advance(reached - told);
            let part = (steps as f64 * solved.len() as f64 / count as f64).fract();
            job.progress.part(part);
            told = reached;
        }
        let of_own = solved.split_off(cases.rows.len());
        let mut simulated: Vec<Simulated> = solved
            .iter()
            .zip(&cases.goals)
            .zip(&cases.rows.patterns)
            .map(|((solved, goal), pattern)| solved.judged(goal, pattern))
            .collect();
        for OwnCase { target, pattern } in own.add_to(&mut cases.rows, &self.scene)? {
            let goal = cases.goals[target].clone();
            simulated.push(of_own[pattern].judged(&goal, &own.patterns()[pattern]));
            cases.goals.push(goal);
        }
        Ok(self.verification(cases, &simulated, &states[0].effects).object())
    }

    fn unstable(&self, artifact: &Artifact) -> Result<u64, StageError> {
        let outcomes = Verification::open(artifact)?.outcome().read()?;
        Ok(outcomes.iter().filter(|o| !o.has_field()).count() as u64)
    }
}

impl VerifyStage {
    /// The rows of all designs. Intuitive ones that several designs of a target were compared with are there once. What stands
    /// under one case and name is compared, so it must be for the same objective at the same area.
    fn cases(&self, designs: &[&Artifact], states: &[Scene]) -> Result<Cases, StageError> {
        let (mut cases, mut known) = (Cases::default(), BTreeMap::new());
        for design in designs {
            let rows = Designs::open(design)?.rows().read()?;
            for row in 0..rows.len() {
                let wrong = |why: String| StageError::in_artifact(design, why);
                let text = &rows.objective.0[row];
                if !known.contains_key(text) {
                    known.insert(text.clone(), self.goal(text, states).map_err(wrong)?);
                }
                let goal = known[text].clone();
                if !cases.is_repeated(&rows, row)? {
                    cases.rows.push(&rows, row);
                    cases.goals.push(goal);
                }
            }
        }
        Ok(cases)
    }

    /// What a design was for. Area and its weight do not enter the displacement.
    fn goal(&self, text: &str, states: &[Scene]) -> Result<Timed, String> {
        let document = Document::from_text(std::path::Path::new("objective"), text).map_err(|e| e.to_string())?;
        let objective = Objective::read(&document.root).map_err(|e| e.to_string())?;
        let goal = objective.goal(&self.scene, None, 0.0).map_err(|e| e.to_string())?;
        let moment = objective.moment();
        let at = moment_in(moment, &self.solver).map_err(|(what, help)| format!("its design {what}: {help}"))?;
        match moment {
            Moment::Equilibrium | Moment::After(_) => Ok(Timed { goal, at, swings: None }),
            Moment::Swing(frequency) => {
                let swing = |parameters: &SolverParameters| swing_of(&states[0], frequency, &goal, parameters);
                let swings = || {
                    Ok(Swings {
                        own: swing(&self.solver)?,
                        beside: self.solver.with_comparison_mesh().as_ref().map(swing).transpose()?,
                    })
                };
                let swings = swings().map_err(|e: SetupError| format!("its design is meant at {frequency}: {e}"))?;
                Ok(Timed {
                    goal,
                    at,
                    swings: Some(Arc::new(swings)),
                })
            }
        }
    }

    fn verification(&self, cases: Cases, simulated: &[Simulated], effects: &Effects) -> Verification {
        let Cases { rows, goals } = cases;
        let solved = || (0..rows.len()).filter_map(|row| Some((row, simulated[row].fields.as_ref()?)));
        let predicted = predicted_rows(&rows.role);
        let prediction = |row: usize| Some(rows.predicted_in_states(predicted[row]?));
        let errors = || solved().map(|(row, _)| simulated[row].error);
        let in_states = self.scene.states.iter().len() > 1;
        let displacement = || solved().flat_map(|(_, fields)| fields.iter().cloned()).collect();
        let histories: Vec<&History> = solved()
            .filter_map(|(row, _)| simulated[row].history.as_ref())
            .collect();
        let follows_time = self.solver.follows_time() && !in_states;
        Verification {
            outcome: simulated.iter().map(|s| s.outcome.kind()).collect(),
            displacement: solved().filter_map(|(_, fields)| fields.first().cloned()).collect(),
            difference: solved()
                .filter_map(|(row, fields)| difference(prediction(row)?.first()?, fields.first()?))
                .collect(),
            states: in_states.then(|| SimulatedStates {
                displacement: displacement(),
            }),
            history: follows_time.then(|| solution::solved_histories(&histories)),
            component: Components {
                predicted: (0..rows.len())
                    .filter_map(|row| Some(goals[row].goal.value_mm(prediction(row)?)))
                    .collect(),
                simulated: solved().map(|(row, fields)| goals[row].goal.value_mm(fields)).collect(),
                error: errors().map(Option::unwrap_or_default).collect(),
                in_time: self.solver.follows_time().then(|| {
                    let values = solved().flat_map(|(row, _)| simulated[row].values_mm.iter().copied());
                    Packed(values.collect())
                }),
                error_known: errors().map(|error| u64::from(error.is_some())).collect(),
                distance: solved()
                    .map(|(row, fields)| goals[row].goal.distance_mm(fields).unwrap_or(0.0))
                    .collect(),
            },
            rows,
            scene: self.scene.clone(),
            solver: format!("{{ {} }}", self.solver),
            effects: effects.clone(),
        }
    }
}

impl Cases {
    /// Whether a row is an intuitive design that is there already.
    ///
    /// # Errors
    /// When it cannot be told from a design that is there, or not be compared with it.
    fn is_repeated(&self, others: &DesignRows, row: usize) -> Result<bool, StageError> {
        let own = &self.rows;
        let (label, name, role) = (&others.case[row], &others.name[row], others.role[row]);
        let of_target = || (0..own.len()).filter(|&k| own.case[k] == *label && own.name[k] == *name);
        let differs =
            |k: usize| own.objective.0[k] != others.objective.0[row] || own.area_target[k] != others.area_target[row];
        if of_target().next().is_some_and(differs) {
            return Err(StageError::input(format!(
                "two stages design `{name}` of the case {label:?} for different objectives or areas, which cannot be \
                 compared: tell them apart by `case` or by the names of targets"
            )));
        }
        let mut of_role = of_target().filter(|&k| own.role[k] == role);
        if !role.is_found() {
            return Ok(of_role.any(|k| own.patterns[k] == others.patterns[row]));
        }
        if of_role.any(|k| own.member[k] == others.member[row] && own.units[k] == others.units[row]) {
            return Err(StageError::input(format!(
                "two stages have a design `{name}` of role {}, {} units and the case {label:?}: \
                 tell them apart by `case` or by the names of targets",
                role.name(),
                others.units[row]
            )));
        }
        Ok(false)
    }
}

impl Solvers {
    /// For scenes whose effects are decided.
    fn new(solver: &SolverParameters, states: &[Scene]) -> Result<Self, SetupError> {
        let both = states.iter().map(|scene| {
            let beside = solver.with_comparison_mesh().map(|other| other.build(scene));
            Ok((solver.build(scene)?, beside.transpose()?))
        });
        both.collect::<Result<_, _>>().map(Self)
    }

    fn solve(&self, patterns: &[Pattern]) -> Result<Vec<SolvedStates>, SetupError> {
        let mut solved: Vec<SolvedStates> = patterns.iter().map(|_| SolvedStates(Vec::new())).collect();
        for (own, beside) in &self.0 {
            let (results, histories) = own.simulate_in_time(patterns)?;
            let mut histories = histories.unwrap_or_default().into_iter().map(|found| found.history);
            let others = beside
                .as_ref()
                .map(|other| other.simulate_in_time(patterns))
                .transpose()?;
            let mut others = others.map(fields_in_time).unwrap_or_default().into_iter();
            for (SolvedStates(states), result) in solved.iter_mut().zip(results) {
                let history = histories.next();
                states.push(SolvedState {
                    fields: fields_of(&result, history.as_ref()),
                    others: others.next().flatten(),
                    result,
                    history,
                });
            }
        }
        Ok(solved)
    }
}

impl SolvedStates {
    fn judged(&self, Timed { goal, at, swings }: &Timed, pattern: &Pattern) -> Simulated {
        if let Some(swings) = swings {
            return swings.judged(goal, pattern);
        }
        let Self(states) = self;
        let mut outcomes = states.iter().map(|state| state.result.simulation.outcome);
        let without = outcomes.find(|outcome| !outcome.has_field());
        let at_time = |at: usize| -> Option<StateFields> {
            let fields = states.iter().map(|state| state.fields.as_ref()?.get(at).cloned());
            fields.collect()
        };
        let fields = at_time(*at);
        let others: Option<StateFields> = states
            .iter()
            .map(|state| state.others.as_ref()?.get(*at).cloned())
            .collect();
        let between = fields.as_ref().zip(others);
        let between = between.map(|(fields, others)| (goal.value_mm(fields) - goal.value_mm(&others)).abs());
        let values_mm = (0..).map_while(at_time).map(|fields| goal.value_mm(&fields)).collect();
        // An error that is promised of every state is one of their mean.
        let promised = states.iter().map(|state| state.result.discretisation_error);
        let promised = promised
            .collect::<Option<Vec<f64>>>()
            .map(|errors| errors.into_iter().fold(0.0, f64::max));
        Simulated {
            outcome: without.unwrap_or(states[0].result.simulation.outcome),
            error: promised.or(between),
            values_mm,
            fields,
            history: match &states[..] {
                [only] => only.history.clone(),
                _ => None,
            },
        }
    }
}

impl Swings {
    fn judged(&self, goal: &Goal, pattern: &Pattern) -> Simulated {
        let (outcome, field) = self.own.farthest(pattern);
        let other = self.beside.as_ref().and_then(|beside| beside.farthest(pattern).1);
        let value = |field: &Field| goal.value_mm(slice::from_ref(field));
        let between = field.as_ref().zip(other.as_ref());
        Simulated {
            outcome,
            error: between.map(|(field, other)| (value(field) - value(other)).abs()),
            values_mm: field.iter().map(value).collect(),
            fields: field.map(|field| vec![field]),
            history: None,
        }
    }
}

/// The fields of a result at all times that were asked for; one where none were.
fn fields_of(result: &AccurateSimulation, history: Option<&History>) -> Option<Vec<Field>> {
    let last = result.simulation.field.clone()?;
    Some(history.map_or_else(|| vec![last], |history| history.fields.clone()))
}

/// The same of many results.
fn fields_in_time(
    (results, histories): (Vec<AccurateSimulation>, Option<Vec<AccurateHistory>>),
) -> Vec<Option<Vec<Field>>> {
    let mut histories = histories.unwrap_or_default().into_iter();
    let each = results.iter();
    each.map(|result| fields_of(result, histories.next().map(|found| found.history).as_ref()))
        .collect()
}

/// How many targets the designs have together: the length of the progress bar.
fn targets(designs: &[&Artifact]) -> Result<u64, StageError> {
    let mut sum = 0;
    for design in designs {
        let mut names = Designs::open(design)?.rows().name().read()?;
        names.dedup();
        sum += names.len() as u64;
    }
    Ok(sum)
}

fn difference(a: &Field, b: &Field) -> Option<Field> {
    Field::from_values(
        a.raster(),
        a.values().iter().zip(b.values()).map(|(a, b)| a - b).collect(),
    )
    .ok()
}
