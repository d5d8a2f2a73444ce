//! The kind `verify`: simulates designs on two finer meshes, with the intuitive designs and the user's own patterns
//! for comparison.

mod own;
mod solvers;

use std::collections::BTreeMap;
use std::sync::Arc;

use super::design::{self, amplitude_solver};
use super::results::{PREDICTED_REACTION, PREDICTED_VOLUME, REACTION, VOLUME, ml_per_mm, of_targets};
use super::{drive_check, needed, patterns, scene, solution};
use deaflow_base::{Canonical, Fields, InputError, Map, Node};
use deaflow_content::{
    Components, DesignRank, DesignRows, Designs, HeightChanges, Packed, SimulatedStates, Verification,
    VerificationView, best_of_targets, predicted_rows,
};
use deaflow_design::{Goal, PlannedDesign, ResponseKind};
use deaflow_fem::screening::resolved_states;
use deaflow_fem::{GeometryError, History, SetupError, SolverParameters, geometry_revision};
use deaflow_field::{Field, Mesh, REACTION_UNIT};
use deaflow_orchestrator::{Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_scene::{Effects, Scene};
use deaflow_store::{Artifact, Object};

use own::{OwnCase, OwnPatterns};
use solvers::{AmplitudeSolvers, Simulated, Solvers, second_mesh};

/// The default mesh.
const MESH: Mesh = Mesh::bilinear(4);

/// Maximum number of patterns between two progress reports.
const BATCH: usize = 8;

/// Maximum number of design stages that one stage can verify.
const MAX_STAGES: usize = 1000;

/// The kind `verify`.
pub struct VerifyKind;

impl Kind for VerifyKind {
    fn name(&self) -> &'static str {
        "verify"
    }

    fn recipe(&self) -> u32 {
        6
    }

    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &["method", "accuracy", "history", "scene.effects"]
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Verification::open(artifact)?;
        let best = BestDesigns::read(&view)?;
        let [simulated_name, predicted_name] = names_of_values(&view)?;
        let simulated = view.component().simulated().read()?;
        let mut results = of_targets(&best.places(|one| Some(one.field)), &[(simulated_name, &simulated)]);
        let area = view.rows().area().read()?;
        results.extend(of_targets(&best.places(|one| Some(one.row)), &[("area", &area)]));
        let predicted = view.component().predicted().read()?;
        let predictions = best.places(|one| one.prediction);
        results.extend(of_targets(&predictions, &[(predicted_name, &predicted)]));
        if let Some(ml_per_mm) = common_ml_per_mm(&view)? {
            let [simulated, predicted] = [simulated, predicted].map(|values| in_ml(&values, ml_per_mm));
            let fields = best.places(|one| Some(one.field));
            results.extend(of_targets(&fields, &[(VOLUME, &simulated)]));
            results.extend(of_targets(&predictions, &[(PREDICTED_VOLUME, &predicted)]));
        }
        Ok(results)
    }

    fn errors(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Verification::open(artifact)?;
        let best = BestDesigns::read(&view)?;
        let [name, _] = names_of_values(&view)?;
        let (errors, known) = (view.component().error().read()?, view.component().error_known().read()?);
        // Those that are not known are zero in files.
        let both = errors.into_iter().zip(known);
        let errors: Vec<f64> = both
            .map(|(error, known)| if known == 1 { error } else { f64::NAN })
            .collect();
        let fields = best.places(|one| Some(one.field));
        let mut results = of_targets(&fields, &[(name, &errors)]);
        if let Some(ml_per_mm) = common_ml_per_mm(&view)? {
            results.extend(of_targets(&fields, &[(VOLUME, &in_ml(&errors, ml_per_mm))]));
        }
        results.retain(|(_, error)| error.is_finite());
        Ok(results)
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["design"],
            least: 1,
            most: MAX_STAGES,
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
            Fields::new("Simulates designs, intuitive designs and the patterns of patterns stages on two meshes.");
        vec![SolverParameters::schema(fields, MESH)]
    }

    fn feedback_target(&self) -> Option<&'static str> {
        Some("train")
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        needed::no_edges_within_cells(stage, needs)?;
        let map = stage.node.fields(WHAT, &keys())?;
        let solver = SolverParameters::read(&map, MESH)?;
        let designs = needs.iter().filter(|need| need.kind == "design").map(design::planned);
        let designs = designs.collect::<Result<Vec<_>, _>>()?.concat();
        for design in &designs {
            check_response(design, &solver, &map, stage)?;
        }
        let node = stage.node.peek("needs").unwrap_or(stage.node);
        PlannedDesign::check_comparable(&designs, node)?;
        let mut check = drive_check::check_simulations(stage);
        check.warnings.splice(..0, PlannedDesign::constraint_warnings(&designs));
        Ok(check)
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields(WHAT, &keys())?;
        let solver = SolverParameters::read(&map, MESH)?;
        let scene = scene::read_in_space(stage, scene)?;
        let scene = match solver.follows_time() {
            true => solver.decisive(&scene),
            // Amplitudes of designs depend on the bias voltage.
            false => scene.simulated_about_bias(),
        };
        solver.check_scene(&map, &scene)?;
        Ok(Box::new(VerifyStage { solver, scene }))
    }
}

/// The best design of each target, ordered by the names of the targets.
struct BestDesigns(Vec<(String, BestDesign)>);

/// Where the numbers of a design are.
#[derive(Clone, Copy)]
struct BestDesign {
    row: usize,
    /// Its place in the arrays of simulated numbers.
    field: usize,
    /// Its place in the arrays of predictions, if it has one.
    prediction: Option<usize>,
}

impl BestDesigns {
    fn read(view: &VerificationView<'_>) -> Result<Self, StageError> {
        let rows = view.rows();
        let (names, roles) = (rows.name().read()?, rows.role().read()?);
        let (statuses, distances) = (rows.status().read()?.0, view.component().distance().read()?);
        let simulated = view.component().simulated().read()?;
        let (places, predictions) = (view.simulated_rows()?, predicted_rows(&roles));
        let found = (0..names.len()).filter(|row| roles[*row].is_found());
        let ranked = found.filter_map(|row| {
            let field = places[row]?;
            let distance = Some(distances[field]);
            let rank = DesignRank::simulated(roles[row], &statuses[row], distance, simulated[field]);
            let prediction = predictions[row];
            Some((&names[row], rank, BestDesign { row, field, prediction }))
        });
        let best = best_of_targets(ranked).into_iter();
        let mut best: Vec<(String, BestDesign)> = best.map(|(name, one)| (name.clone(), one)).collect();
        best.sort_by(|one, other| one.0.cmp(&other.0));
        Ok(Self(best))
    }

    /// Returns the targets with a place of their design.
    fn places(&self, place: impl Fn(&BestDesign) -> Option<usize>) -> Vec<(&str, usize)> {
        let known = self.0.iter();
        known
            .filter_map(|(name, one)| Some((name.as_str(), place(one)?)))
            .collect()
    }
}

/// Returns the names of the simulated and the predicted values.
fn names_of_values(view: &VerificationView<'_>) -> Result<[&'static str; 2], StageError> {
    Ok(match view.unit()? {
        REACTION_UNIT => [REACTION, PREDICTED_REACTION],
        _ => ["displacement", "predicted"],
    })
}

/// Returns the volume in ml of a value of 1 mm, if the objectives of all designs are volumes.
fn common_ml_per_mm(view: &VerificationView<'_>) -> Result<Option<f64>, StageError> {
    let scene = view.scene().read()?;
    let objectives = view.rows().objective().read()?.0;
    let each: Option<Vec<f64>> = objectives.iter().map(|text| ml_per_mm(text, &scene)).collect();
    Ok(each.and_then(|each| each.first().copied()))
}

/// Converts mean heights in mm to volumes.
fn in_ml(values: &[f64], ml_per_mm: f64) -> Vec<f64> {
    values.iter().map(|value| ml_per_mm * value).collect()
}

const WHAT: &str = "a verify stage";

fn keys() -> Vec<&'static str> {
    [&["kind", "needs", "rounds", "update"], &SolverParameters::keys()[..]].concat()
}

/// Refuses a design for a time or an amplitude that the stage does not simulate.
fn check_response(
    design: &PlannedDesign,
    solver: &SolverParameters,
    map: &Map<'_>,
    stage: &StageDeclaration<'_>,
) -> Result<(), InputError> {
    let node = map.optional("history").unwrap_or(stage.node);
    let refused = |(what, help): (String, String)| {
        let message = format!("design `{}` of stage `{}` {what}", design.target, design.stage);
        node.error(message).help(help)
    };
    if design.is_reaction && solver.follows_time() {
        let what = "has a `reaction`, which is that of an equilibrium, but this stage simulates a `history`";
        return Err(refused((what.to_owned(), "remove `history`".to_owned())));
    }
    time_index(design.response, solver).map(|_| ()).map_err(refused)
}

/// Returns the index of the simulated time for a response: the last one for an equilibrium, 0 for an amplitude. The
/// error is a message and its help.
fn time_index(response: ResponseKind, solver: &SolverParameters) -> Result<usize, (String, String)> {
    let times = solver.times().unwrap_or_default();
    match response {
        ResponseKind::Equilibrium => Ok(times.len().saturating_sub(1)),
        ResponseKind::After(time) => times.iter().position(|of| *of == time.value()).ok_or_else(|| {
            let what = format!("needs the time {time}, which this stage does not simulate");
            let help = format!("add it to `history` of the verify stage, as in {{ at: [{time}] }}");
            (what, help)
        }),
        ResponseKind::Amplitude(frequency) if solver.follows_time() => {
            let what = format!("needs the amplitude at {frequency}, but this stage simulates a `history`");
            Err((what, "verify amplitudes in a stage without `history`".to_owned()))
        }
        ResponseKind::Amplitude(_) => Ok(0),
    }
}

struct VerifyStage {
    solver: SolverParameters,
    scene: Scene,
}

/// The designs of all inputs, with their goals.
#[derive(Default)]
struct Cases {
    rows: DesignRows,
    /// The goal of each row.
    goals: Vec<CaseGoal>,
    /// The predicted value of each row of a design stage.
    predicted: Vec<f64>,
}

/// The goal of a design, and the response that it measures.
#[derive(Clone)]
struct CaseGoal {
    goal: Goal,
    /// The goal on cells and on the shapes that they stand for, if there are any, by which errors of geometry are
    /// measured; `None` inside if a body has too few cells.
    on_both: Option<Option<[Goal; 2]>>,
    /// The index of the time among the requested times.
    time_index: usize,
    /// The solvers, if the response is an amplitude.
    amplitude: Option<Arc<AmplitudeSolvers>>,
}

impl Stage for VerifyStage {
    fn parameters(&self) -> Canonical {
        self.solver.canonical([("scene", self.scene.canonical())])
    }

    fn weight(&self) -> f64 {
        self.solver.weight()
    }

    fn revision(&self) -> u32 {
        // With an accuracy, the solver has the revision of geometry itself.
        let of_errors = match self.solver.accuracy() {
            Some(_) => 0,
            None => geometry_revision(&self.scene),
        };
        let of_area = Scene::area_revision(self.scene.free_cells().as_ref());
        // Errors of geometry are those of bodies on shapes.
        let on_shapes = GeometryError::scenes(&self.scene).map_or(0, |[_, on_shapes]| on_shapes.body_revision());
        self.solver.revision(&self.scene) + of_area + of_errors + on_shapes.max(self.scene.body_revision())
    }

    // Its inputs contain whole searches; only the designs are simulated.
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
        let (mut solved, mut reported) = (Vec::with_capacity(count), 0);
        for batch in patterns.chunks(BATCH.min(rayon::current_num_threads())) {
            solved.extend(solvers.solve(batch).map_err(failed)?);
            let reached = steps * solved.len() as u64 / count as u64;
            job.progress.advance(reached - reported);
            let part = (steps as f64 * solved.len() as f64 / count as f64).fract();
            job.progress.part(part);
            reported = reached;
        }
        let of_own = solved.split_off(cases.rows.len());
        let mut simulated: Vec<Simulated> = solved
            .iter()
            .zip(&cases.goals)
            .zip(&cases.rows.patterns)
            .map(|((solved, goal), pattern)| solved.simulated(goal, pattern))
            .collect();
        for OwnCase { target, pattern } in own.add_to(&mut cases.rows, &self.scene)? {
            let goal = cases.goals[target].clone();
            simulated.push(of_own[pattern].simulated(&goal, &own.patterns()[pattern]));
            cases.goals.push(goal);
        }
        Ok(self.verification(cases, &simulated, &states[0].effects))
    }

    fn unstable(&self, artifact: &Artifact) -> Result<u64, StageError> {
        let outcomes = Verification::open(artifact)?.outcome().read()?;
        Ok(outcomes.iter().filter(|o| !o.has_field()).count() as u64)
    }
}

impl VerifyStage {
    /// Collects the rows of all designs; repeated intuitive designs of a target appear once. Designs with the same
    /// case and name are compared, so they must have the same objective and area.
    fn cases(&self, designs: &[&Artifact], states: &[Scene]) -> Result<Cases, StageError> {
        let (mut cases, mut known) = (Cases::default(), BTreeMap::new());
        let on_both = GeometryError::scenes(&self.scene);
        for design in designs {
            let view = Designs::open(design)?;
            let (rows, values) = (view.rows().read()?, view.value().read()?);
            for (row, predicted) in (0..rows.len()).zip(values) {
                let wrong = |why: String| StageError::in_artifact(design, why);
                let text = &rows.objective.0[row];
                if !known.contains_key(text) {
                    known.insert(text.clone(), self.goal(text, states, on_both.as_ref()).map_err(wrong)?);
                }
                let goal = known[text].clone();
                if !cases.is_repeated(&rows, row)? {
                    cases.rows.push(&rows, row);
                    cases.goals.push(goal);
                    cases.predicted.push(predicted);
                }
            }
        }
        Ok(cases)
    }

    /// Reads the goal of a design; `on_both` is the scene on cells and on shapes, if these differ. Area and its weight do
    /// not affect the displacement.
    fn goal(&self, text: &str, states: &[Scene], on_both: Option<&[Scene; 2]>) -> Result<CaseGoal, String> {
        let objective = design::stored_objective(text)?;
        let goal = objective.goal(&self.scene, None, 0.0).map_err(|e| e.to_string())?;
        let on_both = on_both.map(|scenes| {
            let [on_cells, on_shapes] = scenes.each_ref().map(|scene| objective.goal(scene, None, 0.0));
            Some([on_cells.ok()?, on_shapes.ok()?])
        });
        let response = objective.response();
        let index = time_index(response, &self.solver);
        let time_index = index.map_err(|(what, help)| format!("its design {what}: {help}"))?;
        let amplitude = match response {
            ResponseKind::Equilibrium | ResponseKind::After(_) => None,
            ResponseKind::Amplitude(frequency) => {
                let solver = |scene: &Scene, parameters: &SolverParameters| {
                    amplitude_solver(scene, frequency, &goal, parameters)
                };
                let solvers = || {
                    let state = &states[0];
                    let other = second_mesh(&self.solver);
                    Ok(AmplitudeSolvers {
                        own: solver(state, &self.solver)?,
                        other: other
                            .map(|(other, margin)| Ok((solver(state, &other)?, margin)))
                            .transpose()?,
                        geometry: GeometryError::scenes(state)
                            .map(
                                |scenes| match scenes.each_ref().map(|scene| solver(scene, &self.solver)) {
                                    [_, Err(SetupError::Borders(_))] => Ok(None),
                                    [on_cells, on_shapes] => Ok(Some([on_cells?, on_shapes?])),
                                },
                            )
                            .transpose()?,
                    })
                };
                let failed = |e: SetupError| format!("its design needs the amplitude at {frequency}: {e}");
                Some(Arc::new(solvers().map_err(failed)?))
            }
        };
        Ok(CaseGoal {
            goal,
            on_both,
            time_index,
            amplitude,
        })
    }

    fn verification(&self, cases: Cases, simulated: &[Simulated], effects: &Effects) -> Object {
        let unit = cases.goals.first().map_or("mm", |case| case.goal.unit());
        let Cases {
            rows,
            goals,
            predicted: values,
        } = cases;
        let solved = || (0..rows.len()).filter_map(|row| Some((row, simulated[row].fields.as_ref()?)));
        let predicted = predicted_rows(&rows.role);
        let prediction = |row: usize| Some(rows.predicted_in_states(predicted[row]?));
        let errors = || solved().map(|(row, _)| simulated[row].error);
        let in_states = self.scene.states.iter().len() > 1;
        let displacement = || -> Vec<Field> { solved().flat_map(|(_, fields)| fields.iter().cloned()).collect() };
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
            space: self.scene.is_in_space().then(|| HeightChanges {
                height: Packed(displacement().iter().flat_map(Field::heights).copied().collect()),
                volume: Packed(displacement().iter().map(Field::volume).collect()),
            }),
            history: follows_time.then(|| solution::solved_histories(&histories, solution::Datum::Rest)),
            component: Components {
                predicted: (0..rows.len())
                    .filter_map(|row| {
                        let (fields, goal) = (prediction(row)?, &goals[row].goal);
                        // Fields in files have no forces of sides and no heights.
                        Some(if goal.is_reaction() || goal.is_out_of_plane() {
                            values[row]
                        } else {
                            goal.value_mm(fields)
                        })
                    })
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
        .object_in(unit)
    }
}

impl Cases {
    /// Returns whether a row repeats an intuitive design.
    ///
    /// # Errors
    /// If the row cannot be distinguished from another design, or cannot be compared with it.
    fn is_repeated(&self, others: &DesignRows, row: usize) -> Result<bool, StageError> {
        let own = &self.rows;
        let (label, name, role) = (&others.case[row], &others.name[row], others.role[row]);
        let of_target = || (0..own.len()).filter(|&k| own.case[k] == *label && own.name[k] == *name);
        let differs =
            |k: usize| own.objective.0[k] != others.objective.0[row] || own.area_target[k] != others.area_target[row];
        if of_target().next().is_some_and(differs) {
            return Err(StageError::input(format!(
                "two designs `{name}` of case {label:?} have different objectives or areas and cannot be compared: \
                 give them different `case` labels or target names"
            )));
        }
        let mut of_role = of_target().filter(|&k| own.role[k] == role);
        if !role.is_found() {
            return Ok(of_role.any(|k| own.patterns[k] == others.patterns[row]));
        }
        if of_role.any(|k| own.member[k] == others.member[row] && own.units[k] == others.units[row]) {
            return Err(StageError::input(format!(
                "two stages have a design `{name}` of role {}, {} units and case {label:?}: give them different `case` \
                 labels or target names",
                role.name(),
                others.units[row]
            )));
        }
        Ok(false)
    }
}

/// Returns the number of targets of all designs: the length of the progress bar.
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
