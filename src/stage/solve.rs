//! `kind: solve` simulates every sample with finite elements.

use std::sync::OnceLock;

use super::{drive_check, needed, results, scene, solution};
use deaflow_base::{Canonical, Fields, InputError, Node};
use deaflow_content::{SAMPLED, Samples, Solutions};
use deaflow_fem::screening::resolve;
use deaflow_fem::{GeometryErrors, SetupError, Solver, SolverParameters, check_covered_cells};
use deaflow_field::Mesh;
use deaflow_orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_pattern::Edges;
use deaflow_scene::{Effects, Scene};
use deaflow_store::{Artifact, Object};

/// Patterns between two reports of progress.
const BATCH: usize = 16;

/// The default mesh.
const MESH: Mesh = Mesh::bilinear(2);

/// The kind `solve`.
pub struct SolveKind;

impl Kind for SolveKind {
    fn name(&self) -> &'static str {
        "solve"
    }

    fn recipe(&self) -> u32 {
        4
    }

    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &["method", "accuracy", "history", "scene.effects"]
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        results::of_solutions(artifact)
    }

    fn needs(&self) -> Needs {
        Needs::new(&SAMPLED, 1, 1000)
    }

    fn reads_scene(&self) -> bool {
        true
    }

    fn schema(&self) -> Vec<Fields> {
        let fields = Fields::new("Simulates every sample with finite elements.");
        vec![SolverParameters::schema(scene::with_state(fields), MESH)]
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        needed::one_kind_of_edges(stage, needs)?;
        let within_cells = needs
            .iter()
            .find_map(|need| Some((need, needed::edges_within_cells(need)?)));
        if let Some((need, edges)) = within_cells
            && let Ok(scene) = scene::read_in_state(stage.node, stage.scene)
            && let Ok(solver) = solver_of(stage.node)
            && let Err(fault) = check_edges(edges, &scene, &solver)
        {
            return Err(needed::named(stage, need.name).error(fault.to_string()));
        }
        Ok(drive_check::check_simulations(stage))
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let map = stage.fields(WHAT, &keys())?;
        let solver = SolverParameters::read(&map, MESH)?;
        let scene = solver.decisive(&scene::read_in_state(stage, scene)?);
        solver.check_scene(&map, &scene)?;
        Ok(Box::new(SolveStage {
            solver,
            scene,
            ready: OnceLock::new(),
        }))
    }
}

/// Checks that patterns with edges within cells can be simulated.
fn check_edges(edges: Edges, scene: &Scene, solver: &SolverParameters) -> Result<(), SetupError> {
    match edges {
        Edges::Fitted if scene.effects.fringe_field.is_some() => Err(SetupError::Curves { with: "fringe fields" }),
        Edges::Fitted | Edges::Cells => Ok(()),
        Edges::Coverage => solver.check_covered_cells().and_then(|()| check_covered_cells(scene)),
    }
}

const WHAT: &str = "a solve stage";

fn keys() -> Vec<&'static str> {
    [&["kind", "needs", scene::STATE], &SolverParameters::keys()[..]].concat()
}

/// Returns the solver of a solve stage.
///
/// # Errors
/// If its keys are invalid.
pub fn solver_of(stage: &Node) -> Result<SolverParameters, InputError> {
    SolverParameters::read(&stage.fields(WHAT, &keys())?, MESH)
}

struct SolveStage {
    solver: SolverParameters,
    scene: Scene,
    /// Set up by the first chunk for all chunks.
    ready: OnceLock<Ready>,
}

struct Ready {
    /// The simulated effects.
    effects: Effects,
    solver: Solver,
    /// Errors of geometry, if errors are stated and elements follow cells in place of shapes.
    geometry: Option<GeometryErrors>,
}

impl SolveStage {
    fn settings(&self) -> String {
        format!("{{ {} }}", self.solver)
    }

    fn ready(&self) -> Result<&Ready, SetupError> {
        if let Some(ready) = self.ready.get() {
            return Ok(ready);
        }
        let scene = resolve(&self.scene)?;
        let solver = self.solver.build(&scene)?;
        let geometry = match solver.estimates_errors() {
            true => GeometryErrors::new(&scene, &self.solver, false)?,
            false => None,
        };
        Ok(self.ready.get_or_init(|| Ready {
            effects: scene.effects,
            solver,
            geometry,
        }))
    }
}

impl Stage for SolveStage {
    fn parameters(&self) -> Canonical {
        self.solver.canonical([("scene", self.scene.canonical())])
    }

    fn weight(&self) -> f64 {
        self.solver.weight()
    }

    fn revision(&self) -> u32 {
        self.solver.revision(&self.scene)
    }

    fn unit(&self) -> &'static str {
        "patterns"
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        let chunk = |&(digest, samples): &(Option<_>, u64)| Chunk {
            parameters: self.parameters(),
            inputs: vec![digest],
            samples,
        };
        Plan::Chunks(inputs.iter().flat_map(|input| input.parts.iter().map(chunk)).collect())
    }

    fn pieces(&self, inputs: u64) -> u64 {
        inputs
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let [samples] = job.inputs else {
            return Err(StageError::failed(
                "a chunk of a solve stage reads one chunk of samples",
            ));
        };
        let rows = Samples::open(samples)?.rows().read()?;
        let rows = rows.drawn().map_err(|e| StageError::in_artifact(samples, e))?;
        let failed = |error: SetupError| match error.is_of_the_scene() {
            true => StageError::input(error),
            false => StageError::failed(error),
        };
        let Ready {
            effects,
            solver,
            geometry,
        } = self.ready().map_err(failed)?;
        let mut simulations = Vec::with_capacity(rows.patterns.len());
        let mut histories = Vec::new();
        // The first batch is small, so that slow patterns give an early progress report; histories are always slow.
        let few = rayon::current_num_threads();
        let (first, rest) = rows.patterns.split_at(few.min(rows.patterns.len()));
        let batch = if self.solver.follows_time() { few } else { BATCH };
        for batch in std::iter::once(first).chain(rest.chunks(batch)) {
            let (mut found, in_time) = solver.simulate_in_time(batch).map_err(failed)?;
            if let Some(geometry) = geometry {
                geometry.add_to(&mut found, batch, &[]).map_err(failed)?;
            }
            simulations.extend(found);
            histories.extend(in_time.into_iter().flatten());
            job.progress.advance(batch.len() as u64);
        }
        let solver = (solver, self.settings());
        let solved = solution::solutions(&rows, &simulations, &self.scene, solver, effects);
        let solved = if self.solver.follows_time() {
            solution::in_time(solved, &histories)
        } else {
            solved
        };
        Ok(solved.object())
    }

    fn attributes(&self) -> Vec<(String, String)> {
        vec![
            ("scene".to_owned(), self.scene.to_text()),
            ("solver".to_owned(), self.settings()),
        ]
    }

    fn unstable(&self, artifact: &Artifact) -> Result<u64, StageError> {
        Ok(Solutions::open(artifact)?.unstable().outcome().rows()? as u64)
    }
}
