//! The equilibria of patterns in each state of a scene: what `deaflow solve` writes, and what the Python package
//! returns.

use std::time::Instant;

use rayon::prelude::*;

use super::cells;
use super::simulation::PatternSolver;
use crate::CliError;
use crate::job::seconds_each;
use deaflow_base::Progress;
use deaflow_content::{CoveredCells, DrawnElectrodes, Lines, Observations, Packed, SolveFile};
use deaflow_fem::effects::Examined;
use deaflow_fem::screening::{ScreenedScene, TestPattern, examined, observing_breakdown, resolve, resolve_states};
use deaflow_fem::{
    AccurateSimulation, CriticalSearch, CriticalVoltage, GeometryErrors, MeshRequest, Method, SetupError, SolveOptions,
    Solver, SolverParameters, wrinkled_fraction,
};
use deaflow_field::{Field, Mesh};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_stage::solution;

/// Patterns that one thread solves between two reports of progress.
const BATCH: usize = 8;

/// What warnings call a pattern.
const NAME: &str = "pattern";

/// The solvers of a scene, one for each of its states.
pub struct Equilibria {
    scene: Scene,
    parameters: SolverParameters,
    solvers: Vec<StateSolver>,
}

/// The solver of one state.
struct StateSolver {
    /// The name of the state, if the scene has several.
    state: Option<String>,
    /// The scene in this state, with its effects decided.
    scene: Scene,
    solver: Solver,
}

/// The patterns to solve, and what is wanted of them.
#[derive(Clone, Copy, Debug)]
pub struct SolveRequest<'a> {
    /// The patterns.
    pub patterns: &'a [Pattern],
    /// The patterns as drawn, where cells stand for shapes; else the same.
    pub drawings: &'a [Pattern],
    /// Whether the states of cells are wanted.
    pub cells: bool,
    /// Whether to check if a finer mesh could find no stable solution, and how much neglected effects would change the
    /// displacement.
    pub checks: bool,
}

/// The solutions of some patterns in all states.
pub struct Solved<'a> {
    equilibria: &'a Equilibria,
    request: SolveRequest<'a>,
    runs: Vec<StateRun>,
}

/// What the patterns do in one state.
pub(super) struct StateRun {
    pub state: Option<String>,
    pub screened: ScreenedScene,
    pub solutions: Vec<AccurateSimulation>,
    seconds: Vec<f64>,
    /// The states of the cells, if they were requested.
    pub cells: Vec<cells::States>,
    /// By pattern, as in [`crate::results::SampleResult::near_limit`].
    pub near_limit: Vec<Option<Option<CriticalVoltage>>>,
}

impl Equilibria {
    /// Sets up the solvers of a scene. With `effects: auto` its effects have been [decided](crate::decide), or are
    /// decided first.
    ///
    /// # Errors
    /// When the scene cannot be simulated in the plane, or not with these parameters.
    pub fn new(scene: &Scene, parameters: &SolverParameters) -> Result<Self, CliError> {
        if let Some(error) = SetupError::in_space(scene) {
            return Err(error.into());
        }
        let mut solvers = Vec::new();
        for (name, scene) in resolve_states(scene)?.in_states() {
            let scene = resolve(&scene)?;
            solvers.push(StateSolver {
                state: (!name.is_empty()).then(|| name.to_owned()),
                solver: parameters.build(&observing_breakdown(&scene))?,
                scene,
            });
        }
        Ok(Self {
            scene: scene.clone(),
            parameters: parameters.clone(),
            solvers,
        })
    }

    /// Returns the parameters of the solvers.
    #[must_use]
    pub fn parameters(&self) -> &SolverParameters {
        &self.parameters
    }

    /// Returns the names of the states; none if the scene has a single drive.
    #[must_use]
    pub fn states(&self) -> Vec<String> {
        self.solvers.iter().filter_map(|solver| solver.state.clone()).collect()
    }

    /// Returns the solver of each state, or the only one.
    pub fn solvers(&self) -> impl Iterator<Item = &Solver> {
        self.solvers.iter().map(|solver| &solver.solver)
    }

    /// Finds the equilibria of patterns in all states.
    ///
    /// # Errors
    /// When a pattern cannot be simulated in this way.
    pub fn solve<'a>(&'a self, request: &SolveRequest<'a>, progress: &dyn Progress) -> Result<Solved<'a>, CliError> {
        let runs = self.solvers.iter().map(|solver| self.run(solver, request, progress));
        Ok(Solved {
            equilibria: self,
            request: *request,
            runs: runs.collect::<Result<_, _>>()?,
        })
    }

    fn run(
        &self,
        StateSolver { state, scene, solver }: &StateSolver,
        request: &SolveRequest<'_>,
        progress: &dyn Progress,
    ) -> Result<StateRun, CliError> {
        let (patterns, parameters) = (request.patterns, &self.parameters);
        let threads = rayon::current_num_threads();
        let mut solutions = Vec::with_capacity(patterns.len());
        let errors = match parameters.accuracy() {
            Some(_) => GeometryErrors::new(scene, parameters, request.drawings != patterns)?,
            None => None,
        };
        let mut seconds = Vec::with_capacity(patterns.len());
        let mut cells = Vec::new();
        // The first batch is small, so that the pace is known early.
        let (first, rest) = patterns.split_at(threads.min(patterns.len()));
        for batch in std::iter::once(first).chain(rest.chunks(BATCH * threads)) {
            CliError::if_interrupted()?;
            let start = Instant::now();
            if request.cells {
                let (found, of_cells) = solver.simulate_cells(batch)?;
                solutions.extend(found);
                cells.extend(of_cells);
            } else {
                let mut found = solver.simulate(batch)?;
                if let Some(errors) = &errors {
                    errors.add_to(&mut found, batch, &request.drawings[solutions.len()..])?;
                }
                solutions.extend(found);
            }
            seconds.extend(seconds_each(start, batch.len()));
            progress.advance(batch.len() as u64);
        }
        let (near_limit, screened) = match request.checks {
            false => (
                vec![None; patterns.len()],
                screened(scene, patterns, &solutions, (&[], parameters))?,
            ),
            true => {
                let tests = TestPattern::some_of(patterns, NAME);
                (
                    near_limit(scene, patterns, &solutions, parameters)?,
                    screened(scene, patterns, &solutions, (&tests, parameters))?,
                )
            }
        };
        Ok(StateRun {
            state: state.clone(),
            screened,
            solutions,
            seconds,
            cells,
            near_limit,
        })
    }
}

impl Solved<'_> {
    /// Returns the solutions in each state.
    pub(super) fn runs(&self) -> &[StateRun] {
        &self.runs
    }

    /// Returns the position of each pattern with each state, pattern by pattern.
    pub(super) fn samples(&self) -> impl Iterator<Item = (usize, &StateRun)> {
        (0..self.request.patterns.len()).flat_map(|index| self.runs.iter().map(move |run| (index, run)))
    }

    fn solutions(&self) -> impl Iterator<Item = &AccurateSimulation> {
        self.samples().map(|(index, run)| &run.solutions[index])
    }

    /// Returns the displacement of each pattern in each state; `None` without a stable solution.
    pub fn fields(&self) -> impl Iterator<Item = Option<&Field>> {
        self.solutions().map(|solution| solution.simulation.field.as_ref())
    }

    /// Returns the warnings about neglected effects, one line each.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let of_run = |run: &StateRun| -> Vec<String> {
            let state = run.state.as_ref().map(|state| format!("in state {state}: "));
            let state = state.unwrap_or_default();
            let warnings = run.screened.warnings.iter();
            warnings.map(|warning| format!("{state}{warning}")).collect()
        };
        self.runs.iter().flat_map(of_run).collect()
    }

    /// Returns the arrays of all patterns, each in all states.
    #[must_use]
    pub fn content(&self) -> SolveFile {
        let solutions: Vec<&AccurateSimulation> = self.solutions().collect();
        let Equilibria {
            scene,
            parameters,
            solvers,
        } = self.equilibria;
        let (screened, solver) = (&self.runs[0].screened, &solvers[0].solver);
        let observed: Vec<_> = solutions
            .iter()
            .map(|solution| Some(&solution.simulation.observation))
            .collect();
        let mut observations = Observations::of(&solver.observed(&screened.scene.effects), &screened.scene, &observed);
        let cells: Vec<&cells::States> = self.samples().filter_map(|(index, run)| run.cells.get(index)).collect();
        let with_cells = !cells.is_empty();
        if with_cells {
            let fraction = |states: &&cells::States| states.as_deref().map_or(f64::NAN, wrinkled_fraction);
            observations.wrinkled_fraction = Some(cells.iter().map(fraction).collect());
        }
        let row = 2 * scene.membrane().raster.corners();
        let mut displacement = Vec::with_capacity(solutions.len() * row);
        for field in self.fields() {
            match field {
                Some(field) => displacement.extend_from_slice(field.values()),
                None => displacement.extend(std::iter::repeat_n(f64::NAN, row)),
            }
        }
        let patterns = self.samples().map(|(index, _)| self.request.patterns[index].clone());
        let patterns: Vec<Pattern> = patterns.collect();
        SolveFile {
            electrodes: DrawnElectrodes::of(&patterns),
            covered: CoveredCells::of(&patterns),
            patterns,
            displacement: Packed(displacement),
            outcome: solutions
                .iter()
                .map(|solution| solution.simulation.outcome.kind())
                .collect(),
            max_displacement: self
                .fields()
                .map(|field| field.map_or(f64::NAN, Field::max_magnitude))
                .collect(),
            residual: Some(solutions.iter().map(|solution| solution.simulation.residual).collect()),
            solve_seconds: self.samples().map(|(index, run)| run.seconds[index]).collect(),
            observations,
            meshes: solver
                .estimates_errors()
                .then(|| solution::meshes(solutions.iter().copied())),
            cells: with_cells.then(|| cells::fields(&cells, scene.membrane().raster)),
            scene: scene.with_effects(screened.scene.effects.clone()).to_text(),
            solver: Some(format!("{{ {parameters} }}")),
            effects: Some(screened.scene.effects.clone()),
            warnings: Some(Lines(self.warnings())),
            ..SolveFile::default()
        }
    }
}

/// Screens a scene for effects that the solutions neglect; without tests by the scene and these solutions alone.
fn screened(
    scene: &Scene,
    patterns: &[Pattern],
    solutions: &[AccurateSimulation],
    (tests, parameters): (&[TestPattern], &SolverParameters),
) -> Result<ScreenedScene, SetupError> {
    let limit = parameters.work_limit();
    // An estimate has no outcome that tells the stability.
    if parameters.method() != Method::Newton {
        return ScreenedScene::for_patterns(scene, tests, limit);
    }
    let solved = patterns.iter().zip(solutions).enumerate();
    let solved: Vec<Examined> = solved
        .map(|(at, (pattern, solution))| examined(&format!("{NAME} {at}"), scene, pattern, &solution.simulation))
        .collect();
    ScreenedScene::for_solutions(scene, tests, &solved, limit)
}

/// Finds the stable solutions that a finer mesh could reject, with their critical voltages.
fn near_limit(
    scene: &Scene,
    patterns: &[Pattern],
    solutions: &[AccurateSimulation],
    parameters: &SolverParameters,
) -> Result<Vec<Option<Option<CriticalVoltage>>>, CliError> {
    let none = vec![None; patterns.len()];
    let mesh = match (parameters.method(), parameters.mesh_request()) {
        (Method::Newton, MeshRequest::Fixed(mesh)) => mesh,
        // A requested accuracy compares meshes of up to four elements along a cell.
        (Method::Newton, MeshRequest::Accuracy(_)) => Mesh::biquadratic(2),
        // An estimate is not an equilibrium.
        _ => return Ok(none),
    };
    let tolerance = parameters.tolerance();
    let options = SolveOptions { mesh, tolerance };
    let searches = PatternSolver::new(scene, |scene| CriticalSearch::if_in_question(scene, options))?;
    if searches.usual().is_none() {
        return Ok(none);
    }
    let is_far_where_taut = scene.effects.wrinkling.is_some() && CriticalSearch::is_far_from_any_taut(scene)?;
    let is_in_question = |AccurateSimulation { simulation, .. }: &AccurateSimulation| {
        let is_taut = simulation.observation.wrinkled_fraction() == Some(0.0);
        simulation.field.is_some() && !(is_far_where_taut && is_taut)
    };
    let solved = patterns.par_iter().zip(solutions);
    let doubt = |(pattern, solution): (&Pattern, _)| {
        if !is_in_question(solution) {
            return Ok(None);
        }
        Ok(searches.with(pattern, |search| search.as_ref()?.uncertain_limit(pattern))?)
    };
    solved.map(doubt).collect()
}
