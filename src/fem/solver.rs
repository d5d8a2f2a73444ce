//! The simulator that the rest of the program uses: a scene and a mesh, ready for any number of patterns.

use rayon::prelude::*;

use deaflow_field::{Charged, Field, Mesh, Observation, Outcome, Simulation, Simulator};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_scene::laws::StiffeningLaw;

use super::adjoint;
use super::charge::{self, ChargedLoading};
use super::continuation::{LoadingEnd, Loss, Problem};
use super::effects::{Model, WithMaterial, breakdown_ratio};
use super::error::SetupError;
use super::grid::Grid;
use super::material::Material;
use super::newton::{self, Workspace};
use super::observable::{CellState, Survey, states};
use super::operator::{Activity, Operator};
use super::precondition::Laplacian;
use super::sheet::Sheet;
use super::work::WorkLimit;

/// Mesh and tolerance of a solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolveOptions {
    /// The mesh, with 1 to 8 elements along the side of a cell.
    pub mesh: Mesh,
    /// Relative residual at which the iteration ends, 1e-12 to 1e-2.
    pub tolerance: f64,
}

impl Default for SolveOptions {
    fn default() -> Self {
        Self {
            mesh: Mesh::bilinear(2),
            tolerance: 1e-8,
        }
    }
}

impl SolveOptions {
    /// A mesh, with the usual tolerance.
    #[must_use]
    pub fn on(mesh: Mesh) -> Self {
        Self {
            mesh,
            ..Self::default()
        }
    }
}

/// A mesh that is in range.
pub(super) fn checked(mesh: Mesh) -> Result<Mesh, SetupError> {
    if mesh.is_solvable() {
        Ok(mesh)
    } else {
        Err(SetupError::ElementsPerCell {
            found: mesh.elements_per_cell(),
        })
    }
}

/// A solution with the resolution of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshSolution {
    /// How it ended.
    pub outcome: Outcome,
    /// The highest voltage in V at which a stable equilibrium was found; 0 is rest.
    pub last_stable: f64,
    /// Nodal displacements in units of [`Grid::unit_mm`], laid out as [`Grid::layout`] says; those of the last stable state where the outcome is
    /// not converged.
    pub displacement: Vec<f64>,
    /// Newton steps over all load steps.
    pub newton_iterations: u32,
    /// Conjugate-gradient iterations within them.
    pub krylov_iterations: u32,
    /// Work in the units of [`WorkLimit`].
    pub work: u64,
    /// Relative residual at the end.
    pub residual: f64,
    /// Where the drive is a charge, what that makes.
    pub charged: Option<Charged>,
}

/// Simulates patterns under one scene on one mesh.
pub struct MembraneSolver {
    pub(super) scene: Scene,
    pub(super) model: Model,
    mesh: Mesh,
    /// The elements of solutions: up to two more along a cell than was asked for.
    pub(super) grid: Grid,
    pub(super) tolerance: f64,
    pub(super) laplacian: Laplacian,
    pub(super) limit: WorkLimit,
}

impl MembraneSolver {
    /// A solver for a scene.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        Self::of_model(scene, Model::new(scene)?, options)
    }

    /// A solver for a scene with branches that have no time to relax, of a modulus in units of μλp².
    ///
    /// # Errors
    /// As [`MembraneSolver::new`].
    pub(super) fn slowed(scene: &Scene, slowness: f64, options: SolveOptions) -> Result<Self, SetupError> {
        Self::of_model(scene, Model::new(scene)?.slowed(slowness), options)
    }

    /// A solver on elements of another solver for the scene with a fringe field, so that solutions with it and without it differ by nothing
    /// else.
    ///
    /// # Errors
    /// As [`MembraneSolver::new`].
    pub(super) fn on_grid(scene: &Scene, options: SolveOptions, grid: Grid) -> Result<Self, SetupError> {
        Self::of_grid(scene, Model::new(scene)?, options.mesh, grid, options.tolerance)
    }

    /// A solver for a scene whose elastomer stiffens by a law that the scene does not know, in place of its own.
    ///
    /// # Errors
    /// As [`MembraneSolver::new`].
    pub fn with_law(scene: &Scene, law: &dyn StiffeningLaw, options: SolveOptions) -> Result<Self, SetupError> {
        Self::of_model(scene, Model::with_law(scene, Some(law))?, options)
    }

    fn of_model(scene: &Scene, model: Model, options: SolveOptions) -> Result<Self, SetupError> {
        let SolveOptions { mesh, tolerance } = options;
        if !(1e-12..=1e-2).contains(&tolerance) {
            return Err(SetupError::Tolerance { found: tolerance });
        }
        let grid = model.grid(checked(mesh)?);
        Self::of_grid(scene, model, mesh, grid, tolerance)
    }

    fn of_grid(scene: &Scene, model: Model, mesh: Mesh, grid: Grid, tolerance: f64) -> Result<Self, SetupError> {
        let limit = WorkLimit::default();
        let solver = Self {
            scene: scene.clone(),
            model,
            mesh,
            laplacian: Laplacian::new(&grid)?,
            grid,
            tolerance,
            limit,
        };
        Ok(solver.within(limit))
    }

    /// The same with another limit of work for each pattern. Where a fringe field adds elements, it is divided by the root of the
    /// ratio of unknowns: an iteration takes longer, and as many are needed.
    #[must_use]
    pub fn within(self, limit: WorkLimit) -> Self {
        let limit = self.scaled(limit);
        self.within_iterations(limit)
    }

    /// A limit of work on the elements that there are.
    pub(super) fn scaled(&self, limit: WorkLimit) -> WorkLimit {
        let asked = Grid::uniform(self.mesh, &Sheet::of(&self.scene));
        let [asked, all] = [&asked, &self.grid].map(|grid| grid.layout().vector_len() as f64);
        limit.part((asked / all).sqrt())
    }

    /// The same with a limit of work on the elements that there are.
    #[must_use]
    pub(super) fn within_iterations(self, limit: WorkLimit) -> Self {
        Self { limit, ..self }
    }

    /// The mesh that was asked for. With a fringe field solutions have up to two elements more along a cell.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        self.mesh
    }

    /// The elements of solutions.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Simulates one pattern and keeps the whole nodal solution.
    #[must_use]
    pub fn solve(&self, pattern: &Pattern) -> MeshSolution {
        self.solve_in(pattern, &mut self.room(self.limit)).0
    }

    /// The same with a limit of work of its own, as [`MembraneSolver::within`] takes it.
    #[must_use]
    pub fn solve_within(&self, pattern: &Pattern, limit: WorkLimit) -> MeshSolution {
        self.solve_in(pattern, &mut self.room(self.scaled(limit))).0
    }

    /// The displacement of a solution at the cell corners, in mm.
    #[must_use]
    pub fn field(&self, solution: &MeshSolution) -> Field {
        self.grid.sample(&solution.displacement)
    }

    /// What [`Simulator::simulate`] keeps of a solution of this pattern.
    #[must_use]
    pub fn simulation(&self, pattern: &Pattern, solution: &MeshSolution) -> Simulation {
        let converged = solution.outcome.is_converged();
        Simulation {
            outcome: solution.outcome,
            field: converged.then(|| self.field(solution)),
            newton_iterations: solution.newton_iterations,
            residual: solution.residual,
            observation: if converged {
                self.observe(pattern, solution)
            } else {
                Observation {
                    critical_voltage: solution
                        .outcome
                        .bracket()
                        .filter(|_| self.scene.effects.electromechanical_stability.is_some()),
                    charged: solution.charged,
                    ..Observation::default()
                }
            },
        }
    }

    /// The displacement at the cell corners, in mm, of patterns that differ little from that of a solution: equilibria next to it, to
    /// [`NEAR`] of the residual at rest. Whether they are stable is not asked; `None` where there is none.
    #[must_use]
    pub(super) fn fields_near(&self, solution: &MeshSolution, patterns: &[Pattern]) -> Vec<Option<Field>> {
        // A charge is held by a search for its voltage, from rest.
        if !solution.outcome.is_converged() || self.scene.drive.charge.is_some() {
            return self.simulate(patterns).into_iter().map(|found| found.field).collect();
        }
        let room = || {
            let room = self.room(self.limit);
            Room {
                workspace: room.workspace.near(),
                ..room
            }
        };
        let near = |room: &mut Room, pattern: &Pattern| {
            room.displacement.copy_from_slice(&solution.displacement);
            let found = self.model.with(Near {
                solver: self,
                activity: &self.model.activity(&self.grid, pattern),
                room,
            });
            found.then(|| self.grid.sample(&room.displacement))
        };
        patterns.par_iter().map_init(room, near).collect()
    }

    /// The gradient of J = Σ weights · u, with u in mm at the cell corners, with respect to the activity of each cell,
    /// `[y][x]`, at a solution of [`MembraneSolver::solve`]. It is that of letting the activity of a cell vary
    /// between 0 and 1. `None` when the solution is not a converged one, and
    /// with wrinkling, a fringe field or a charge in place of a voltage, where the energy is not linear in the activity of a cell.
    #[must_use]
    pub fn gradient(&self, pattern: &Pattern, solution: &MeshSolution, weights: &Field) -> Option<Vec<f64>> {
        let is_charged = self.scene.drive.charge.is_some();
        if !solution.outcome.is_converged() || !self.model.is_linear_in_cells() || is_charged {
            return None;
        }
        self.model.with(adjoint::InMm {
            activity: &self.model.activity(&self.grid, pattern),
            laplacian: &self.laplacian,
            u: &solution.displacement,
            weights,
            workspace: &mut self.workspace(),
        })
    }

    /// The state of each cell, `[y][x]`, in a solution of this pattern.
    #[must_use]
    pub fn cell_states(&self, pattern: &Pattern, solution: &MeshSolution) -> Vec<CellState> {
        states(&self.scene, &self.model, &self.grid, pattern, &solution.displacement)
    }

    /// The least favourable states of the cells in a solution of this pattern.
    #[must_use]
    pub fn survey(&self, pattern: &Pattern, solution: &MeshSolution) -> Survey {
        Survey::of(&self.cell_states(pattern, solution), self.scene.shear_modulus_pa())
    }

    /// Simulates one pattern, and says whether the stability of the result is beyond doubt: a pointwise condition that is
    /// sufficient holds everywhere. It stops to hold well before stability is lost.
    pub(super) fn simulate_surely(&self, pattern: &Pattern) -> (Simulation, bool) {
        self.simulate_roughly(pattern, self.tolerance)
    }

    /// The same to another relative residual.
    pub(super) fn simulate_roughly(&self, pattern: &Pattern, tolerance: f64) -> (Simulation, bool) {
        let (solution, sure) = self.solve_to(tolerance, pattern, &mut self.room(self.limit));
        (self.simulation(pattern, &solution), sure)
    }

    /// Room for iterations.
    pub(super) fn workspace(&self) -> Workspace {
        self.room(self.limit).workspace
    }

    fn room(&self, limit: WorkLimit) -> Room {
        let len = self.grid.layout().vector_len();
        let mut workspace = Workspace::new(len, &self.laplacian);
        workspace.begin(limit);
        Room {
            displacement: vec![0.0; len],
            workspace,
        }
    }

    /// Loads a pattern, and says whether the stability of the result is beyond doubt. The displacement is taken out of the room.
    fn solve_in(&self, pattern: &Pattern, room: &mut Room) -> (MeshSolution, bool) {
        self.solve_to(self.tolerance, pattern, room)
    }

    /// The same to another relative residual.
    fn solve_to(&self, tolerance: f64, pattern: &Pattern, room: &mut Room) -> (MeshSolution, bool) {
        let before = room.workspace.krylov_iterations();
        let ChargedLoading { loading, charged } = self.model.with(Load {
            solver: self,
            tolerance,
            activity: &self.model.activity(&self.grid, pattern),
            room,
        });
        let solution = MeshSolution {
            outcome: self.outcome(loading.ending),
            last_stable: loading.ending.stable().sqrt() * self.scene.voltage_v(),
            displacement: std::mem::take(&mut room.displacement),
            newton_iterations: loading.steps,
            krylov_iterations: room.workspace.krylov_iterations() - before,
            work: room.workspace.work(),
            residual: loading.residual,
            charged,
        };
        (solution, loading.pointwise)
    }

    /// The equilibrium of an activity under a law, as continuation and paths take it.
    pub(super) fn problem<'a, F>(&'a self, activity: &'a Activity, material: F) -> Problem<'a, F> {
        Problem {
            activity,
            laplacian: &self.laplacian,
            material,
            tolerance: self.tolerance,
        }
    }

    /// How a loading ended, in volts.
    pub(super) fn outcome(&self, ending: LoadingEnd) -> Outcome {
        match ending {
            LoadingEnd::Stable => Outcome::Converged,
            LoadingEnd::Lost { stable, unstable, loss } => {
                let volts = [stable, unstable].map(|s| s.sqrt() * self.scene.voltage_v());
                let [last_stable, first_unstable] = match self.scene.drive.charge {
                    // Beyond the fold the voltage falls while the charge rises.
                    Some(_) => [volts[0].min(volts[1]), volts[0].max(volts[1])],
                    None => volts,
                };
                match loss {
                    Loss::Stability => Outcome::PullIn {
                        last_stable,
                        first_unstable,
                    },
                    Loss::Ellipticity => Outcome::NotElliptic {
                        last_stable,
                        first_unstable,
                    },
                    Loss::Tension => Outcome::Slack {
                        last_stable,
                        first_unstable,
                    },
                }
            }
            LoadingEnd::Unknown { .. } => Outcome::IterationLimit,
            LoadingEnd::WorkLimit { .. } => Outcome::WorkLimit,
        }
    }

    /// What the effects of the scene say beside the displacement.
    fn observe(&self, pattern: &Pattern, solution: &MeshSolution) -> Observation {
        let effects = &self.scene.effects;
        let mut observation = Observation {
            bodies: self.grid.motions(&solution.displacement),
            charged: solution.charged,
            ..Observation::default()
        };
        if effects.dielectric_breakdown.is_some() || effects.wrinkling.is_some() {
            let cells = self.cell_states(pattern, solution);
            let breakdown = effects.dielectric_breakdown.as_ref();
            observation.breakdown_ratio = breakdown.map(|law| breakdown_ratio(law, self.scene.thickness_mm(), &cells));
            observation.tension = effects
                .wrinkling
                .as_ref()
                .map(|_| cells.iter().map(|cell| cell.tension.code()).collect());
        }
        if effects.electromechanical_stability.is_some() {
            let report = self.stability(pattern, solution);
            observation.smallest_eigenvalue = report.smallest_eigenvalue;
            observation.critical_voltage = report.critical;
        }
        observation
    }
}

/// Loading a pattern.
struct Load<'a> {
    solver: &'a MembraneSolver,
    tolerance: f64,
    activity: &'a Activity,
    room: &'a mut Room,
}

impl WithMaterial for Load<'_> {
    type Output = ChargedLoading;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> ChargedLoading {
        let problem = Problem {
            tolerance: self.tolerance,
            ..self.solver.problem(self.activity, material)
        };
        let Room {
            displacement: u,
            workspace,
        } = self.room;
        let Some(charge) = &self.solver.scene.drive.charge else {
            return ChargedLoading {
                loading: problem.load(u, workspace),
                charged: None,
            };
        };
        let coulombs = charge.in_coulombs();
        workspace.begin(self.solver.limit.part(charge::WORK));
        match charge.total {
            Some(_) => charge::conducting(&problem, &self.solver.scene, coulombs, u, workspace),
            None => charge::immobile(&problem, &self.solver.scene, coulombs, u, workspace),
        }
    }
}

/// The relative residual at which equilibria next to a known one are found: a hundred thousandth of what a cell changes, or less.
const NEAR: f64 = 1e-7;

/// From where the room is to the equilibrium of an activity next to it; whether there is one.
struct Near<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    room: &'a mut Room,
}

impl WithMaterial for Near<'_> {
    type Output = bool;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> bool {
        let operator = Operator {
            material: &material(1.0),
            activity: self.activity,
            pulled: 1.0,
        };
        let Room {
            displacement: u,
            workspace,
        } = self.room;
        workspace.begin_again();
        newton::solve(&operator, &self.solver.laplacian, NEAR, u, workspace).is_ok()
    }
}

/// What one thread needs to solve one pattern after another.
struct Room {
    displacement: Vec<f64>,
    workspace: Workspace,
}

impl Simulator for MembraneSolver {
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation> {
        patterns
            .par_iter()
            .map_init(
                || self.room(self.limit),
                |room, pattern| {
                    let (solution, _) = self.solve_in(pattern, room);
                    let simulation = self.simulation(pattern, &solution);
                    room.displacement = solution.displacement;
                    simulation
                },
            )
            .collect()
    }
}
