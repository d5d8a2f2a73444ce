//! The finite-element solver of a scene on one mesh, for any number of patterns.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use deaflow_base::is_interrupted;
use deaflow_field::{Charged, Field, Mesh, Observation, Outcome, Simulation, Simulator};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_scene::laws::StiffeningLaw;

use super::adjoint;
use super::charge::{self, ChargedLoading};
use super::continuation::{Loading, LoadingEnd, Loads, Problem};
use super::effects::{Model, WithMaterial, breakdown_ratio};
use super::error::SetupError;
use super::grid::Grid;
use super::layout::NodeLayout;
use super::material::Material;
use super::newton::{self, Workspace};
use super::observable::{CellState, states};
use super::operator::{Activity, Operator};
use super::precondition::Laplacian;
use super::reactions::SideForces;
use super::stability::{Basin, Loss};
use super::work::WorkLimit;

/// Mesh and tolerance of a solution.
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
    /// A mesh with the default tolerance.
    #[must_use]
    pub fn on(mesh: Mesh) -> Self {
        Self {
            mesh,
            ..Self::default()
        }
    }
}

/// Checks the range of elements per cell.
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
    /// Outcome.
    pub outcome: Outcome,
    /// The highest voltage in V with a stable equilibrium; 0 is rest.
    pub last_stable: f64,
    /// Nodal displacements in units of [`Grid::unit_mm`], in the order of [`Grid::layout`]; those of the last stable
    /// state if the outcome is not converged.
    pub displacement: Vec<f64>,
    /// Newton steps over all load steps.
    pub newton_iterations: u32,
    /// Conjugate-gradient iterations in these steps.
    pub krylov_iterations: u32,
    /// Work in the units of [`WorkLimit`].
    pub work: u64,
    /// Relative residual at the end.
    pub residual: f64,
    /// Voltages and charges, if the drive is a charge.
    pub charged: Option<Charged>,
}

impl MeshSolution {
    /// Returns what is known of a pattern before its first iteration.
    fn interrupted(displacement: Vec<f64>) -> Self {
        Self {
            outcome: Outcome::WorkLimit,
            last_stable: 0.0,
            displacement,
            newton_iterations: 0,
            krylov_iterations: 0,
            work: 0,
            residual: 1.0,
            charged: None,
        }
    }
}

/// Simulates patterns under one scene on one mesh.
pub struct MembraneSolver {
    pub(super) scene: Scene,
    pub(super) model: Model,
    mesh: Mesh,
    /// The grid of the solutions, which a fringe field refines by up to two elements along a cell.
    pub(super) grid: Grid,
    pub(super) tolerance: f64,
    pub(super) laplacian: Arc<Laplacian>,
    pub(super) limit: WorkLimit,
    /// The state without voltage, if it is not the mount and no pattern changes it.
    rest: OnceLock<Option<Vec<f64>>>,
    /// Whether observations have the charge.
    measures_charge: bool,
}

impl MembraneSolver {
    /// Creates a solver for a scene.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        Self::of_model(scene, Model::new(scene)?, options)
    }

    /// Creates a solver with viscoelastic branches that have no time to relax, of a modulus γ in units of μλp².
    ///
    /// # Errors
    /// As [`MembraneSolver::new`].
    pub(super) fn with_unrelaxed(scene: &Scene, gamma: f64, options: SolveOptions) -> Result<Self, SetupError> {
        Self::of_model(scene, Model::new(scene)?.with_unrelaxed(gamma), options)
    }

    /// Creates a solver on the grid of another solver, so that solutions with and without a fringe field have the same
    /// elements.
    ///
    /// # Errors
    /// As [`MembraneSolver::new`].
    pub(super) fn on_grid(scene: &Scene, options: SolveOptions, grid: Grid) -> Result<Self, SetupError> {
        Self::of_grid(scene, Model::new(scene)?, options.mesh, grid, options.tolerance)
    }

    /// Creates a solver with a custom stiffening law instead of that of the scene.
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
        let grid = model.grid(checked(mesh)?)?;
        Self::of_grid(scene, model, mesh, grid, tolerance)
    }

    fn of_grid(scene: &Scene, model: Model, mesh: Mesh, grid: Grid, tolerance: f64) -> Result<Self, SetupError> {
        let limit = WorkLimit::default();
        let solver = Self {
            scene: scene.clone(),
            model,
            mesh,
            laplacian: Laplacian::shared(&grid)?,
            grid,
            tolerance,
            limit,
            rest: OnceLock::new(),
            measures_charge: false,
        };
        Ok(solver.within(limit))
    }

    /// Adds the charge on the electrodes to observations and fields.
    #[must_use]
    pub(super) fn measuring_charge(self) -> Self {
        Self {
            measures_charge: true,
            ..self
        }
    }

    /// Sets the work limit of each pattern. If a fringe field adds elements, the limit is divided by the root of the
    /// ratio of unknowns, because each iteration takes longer.
    #[must_use]
    pub fn within(self, limit: WorkLimit) -> Self {
        let limit = self.scaled(limit);
        self.within_iterations(limit)
    }

    /// Scales a work limit to the grid of the solutions.
    pub(super) fn scaled(&self, limit: WorkLimit) -> WorkLimit {
        let cells = self.scene.membrane().raster.sides();
        let asked = cells.map(|count| count * self.mesh.elements_per_cell());
        let asked = NodeLayout::new(asked, self.mesh.order());
        let [asked, all] = [asked, self.grid.layout()].map(|layout| layout.vector_len() as f64);
        limit.part((asked / all).sqrt())
    }

    /// Sets a work limit that is already scaled to the grid of the solutions.
    #[must_use]
    pub(super) fn within_iterations(self, limit: WorkLimit) -> Self {
        Self { limit, ..self }
    }

    /// Returns the requested mesh. With a fringe field, solutions have up to two more elements along a cell.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        self.mesh
    }

    /// Returns the grid of the solutions.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Simulates one pattern and returns the nodal solution.
    #[must_use]
    pub fn solve(&self, pattern: &Pattern) -> MeshSolution {
        self.solve_in(pattern, &mut self.scratch(self.limit)).0
    }

    /// Like [`Self::solve`], with its own work limit as in [`MembraneSolver::within`].
    #[must_use]
    pub fn solve_within(&self, pattern: &Pattern, limit: WorkLimit) -> MeshSolution {
        self.solve_in(pattern, &mut self.scratch(self.scaled(limit))).0
    }

    /// Simulates one pattern from displacements of the nodes near its equilibrium. `None` if Newton's method does not
    /// lead to a stable equilibrium from there, if the material may have several, or if the charge is prescribed:
    /// [`Self::solve`] loads it from rest.
    #[must_use]
    pub fn solve_near(&self, pattern: &Pattern, start: &[f64]) -> Option<MeshSolution> {
        let mut scratch = self.near_scratch();
        if self.scene.drive.charge.is_some() || start.len() != scratch.displacement.len() || is_interrupted() {
            return None;
        }
        scratch.displacement.copy_from_slice(start);
        let total = self.model.with(LoadNear {
            solver: self,
            activity: &self.activity(pattern),
            scratch: &mut scratch,
        })?;
        Some(MeshSolution {
            outcome: self.outcome(LoadingEnd::Stable),
            last_stable: self.scene.voltage_v(),
            displacement: scratch.displacement,
            newton_iterations: total.steps,
            krylov_iterations: scratch.workspace.krylov_iterations(),
            work: scratch.workspace.work(),
            residual: total.residual,
            charged: None,
        })
    }

    /// Returns the displacement of a solution at the cell corners, in mm.
    #[must_use]
    pub fn field(&self, solution: &MeshSolution) -> Field {
        self.grid.sample(&solution.displacement)
    }

    /// Returns the displacement of a solution of this pattern at the cell corners, in mm: from rest if not all sides are
    /// held, from the mount otherwise.
    #[must_use]
    pub fn stroke(&self, pattern: &Pattern, solution: &MeshSolution) -> Field {
        self.stroke_of(pattern, &solution.displacement)
    }

    /// Like [`Self::stroke`], for a displacement of the nodes.
    fn stroke_of(&self, pattern: &Pattern, u: &[f64]) -> Field {
        let observation = self.observe_sides(pattern, u);
        observation.displacement_from_rest(&self.grid.sample(u))
    }

    /// Converts a solution of this pattern to the result of [`Simulator::simulate`].
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

    /// Returns the [strokes](Self::stroke) of patterns that differ little from that of a solution: equilibria near it
    /// with a residual of [`NEAR`] times that at rest. Their stability is not checked; `None` if there is none.
    #[must_use]
    pub(super) fn strokes_near(&self, solution: &MeshSolution, patterns: &[Pattern]) -> Vec<Option<Field>> {
        // A prescribed charge needs a search for its voltage, from rest.
        if !solution.outcome.is_converged() || self.scene.drive.charge.is_some() {
            return self.simulate(patterns).iter().map(Simulation::stroke).collect();
        }
        let near = |scratch: &mut Scratch, pattern: &Pattern| {
            scratch.displacement.copy_from_slice(&solution.displacement);
            let found = self.model.with(SolveNear {
                solver: self,
                activity: &self.activity(pattern),
                scratch,
            });
            found.then(|| self.stroke_of(pattern, &scratch.displacement))
        };
        patterns.par_iter().map_init(|| self.near_scratch(), near).collect()
    }

    /// Returns the gradient of J = Σ weights · u, with u in mm at the cell corners, with respect to the activity of
    /// each cell, `[y][x]`, which varies between 0 and 1: the covered share if electrodes cover parts of cells. `None`
    /// if the solution is not converged, or if the energy is not linear in the activity: with wrinkling, a fringe field
    /// or a prescribed charge. The [reactions](Field::reactions) of `weights` are those of the forces of sides in mN,
    /// and its [charge](Field::charge) that of the charge in nC.
    #[must_use]
    pub fn gradient(&self, pattern: &Pattern, solution: &MeshSolution, weights: &Field) -> Option<Vec<f64>> {
        let is_charged = self.scene.drive.charge.is_some();
        if !solution.outcome.is_converged() || !self.model.is_linear_in_cells() || is_charged {
            return None;
        }
        let weighs_forces = weights.reactions().as_flattened().iter().any(|weight| *weight != 0.0);
        let forces = match weighs_forces {
            true => Some(SideForces::new(self, pattern)?),
            false => None,
        };
        self.model.with(adjoint::InMm {
            activity: &self.activity(pattern),
            laplacian: &self.laplacian,
            u: &solution.displacement,
            weights,
            forces: forces.as_ref(),
            charge_unit: self.charge_unit(),
            workspace: &mut self.workspace(),
        })
    }

    /// Returns the state of each cell, `[y][x]`, in a solution of this pattern.
    #[must_use]
    pub fn cell_states(&self, pattern: &Pattern, solution: &MeshSolution) -> Vec<CellState> {
        states(&self.scene, &self.model, &self.grid, pattern, &solution.displacement)
    }

    /// Simulates one pattern to a relative residual, and returns whether a sufficient pointwise condition proves the
    /// stability of the result. It fails well before stability is lost.
    pub(super) fn simulate_to(&self, pattern: &Pattern, tolerance: f64) -> (Simulation, bool) {
        let (solution, proven) = self.solve_to(tolerance, pattern, &mut self.scratch(self.limit));
        (self.simulation(pattern, &solution), proven)
    }

    /// Creates the vectors of an iteration.
    pub(super) fn workspace(&self) -> Workspace {
        self.scratch(self.limit).workspace
    }

    fn scratch(&self, limit: WorkLimit) -> Scratch {
        let len = self.grid.layout().vector_len();
        let mut workspace = Workspace::new(len, &self.laplacian);
        workspace.begin(limit);
        Scratch {
            displacement: vec![0.0; len],
            workspace,
        }
    }

    /// Creates the vectors for iterations that start near their end.
    fn near_scratch(&self) -> Scratch {
        let scratch = self.scratch(self.limit);
        Scratch {
            workspace: scratch.workspace.near(),
            ..scratch
        }
    }

    /// Solves a pattern, and returns whether a pointwise condition proves its stability. Takes the displacement out of
    /// `scratch`.
    fn solve_in(&self, pattern: &Pattern, scratch: &mut Scratch) -> (MeshSolution, bool) {
        self.solve_to(self.tolerance, pattern, scratch)
    }

    /// Like [`Self::solve_in`], with another relative residual.
    fn solve_to(&self, tolerance: f64, pattern: &Pattern, scratch: &mut Scratch) -> (MeshSolution, bool) {
        // Of many patterns, those that are left would each take the time of a first iteration.
        if is_interrupted() {
            let displacement = std::mem::take(&mut scratch.displacement);
            return (MeshSolution::interrupted(displacement), false);
        }
        let before = scratch.workspace.krylov_iterations();
        let ChargedLoading { loading, charged } = self.model.with(Load {
            solver: self,
            tolerance,
            activity: &self.activity(pattern),
            scratch,
        });
        let solution = MeshSolution {
            outcome: self.outcome(loading.ending),
            last_stable: loading.ending.stable().sqrt() * self.scene.voltage_v(),
            displacement: std::mem::take(&mut scratch.displacement),
            newton_iterations: loading.steps,
            krylov_iterations: scratch.workspace.krylov_iterations() - before,
            work: scratch.workspace.work(),
            residual: loading.residual,
            charged,
        };
        (solution, loading.pointwise)
    }

    /// Returns the activity of a pattern, with branches that have no time to relax from the state without voltage.
    fn activity(&self, pattern: &Pattern) -> Activity {
        let activity = self.model.activity(&self.grid, pattern);
        if !self.model.has_unrelaxed() {
            return activity;
        }
        match self.released(&activity) {
            Ok(Some(rest)) => self.model.add_unrelaxed_at(activity, &rest),
            // Branches are relaxed at the mount, or there is no equilibrium.
            Ok(None) | Err(_) => activity,
        }
    }

    /// Returns the equilibrium problem of an activity, for load stepping and paths.
    pub(super) fn problem<'a, F>(&'a self, activity: &'a Activity, material: F) -> Problem<'a, F> {
        Problem {
            activity,
            laplacian: &self.laplacian,
            material,
            tolerance: self.tolerance,
            at_rest: self.common_rest(),
        }
    }

    /// Returns the state without voltage of all patterns; `None` where all sides are held, it depends on the pattern,
    /// or there is none.
    fn common_rest(&self) -> Option<&[f64]> {
        let has_stiff_electrodes = self.scene.effects.electrode_stiffness.is_some();
        if self.grid.boundary().is_none() || has_stiff_electrodes {
            return None;
        }
        let bare = || Pattern::from_fn(self.grid.raster(), |_, _| false);
        self.rest.get_or_init(|| self.find_rest(&bare())).as_deref()
    }

    /// Returns the displacement without voltage, if not all sides are held and it is stable.
    fn rest_of(&self, pattern: &Pattern) -> Option<Cow<'_, [f64]>> {
        self.grid.boundary()?;
        match self.common_rest() {
            Some(rest) => Some(Cow::Borrowed(rest)),
            None => self.find_rest(pattern).map(Cow::Owned),
        }
    }

    /// Returns whether sides are not held and there is no stable state without voltage.
    #[must_use]
    pub fn lacks_rest(&self, pattern: &Pattern) -> bool {
        self.grid.boundary().is_some() && self.rest_of(pattern).is_none()
    }

    fn find_rest(&self, pattern: &Pattern) -> Option<Vec<f64>> {
        self.release(&self.model.activity(&self.grid, pattern)).ok()
    }

    /// Returns the state without voltage of an activity.
    fn release(&self, activity: &Activity) -> Result<Vec<f64>, LoadingEnd> {
        let mut scratch = self.scratch(self.limit);
        self.model.with(Rest {
            solver: self,
            activity,
            scratch: &mut scratch,
        })?;
        Ok(scratch.displacement)
    }

    /// Returns the state without voltage of an activity; `None` if all sides are held, where it is the mount.
    ///
    /// # Errors
    /// If it is not stable.
    pub(super) fn released(&self, activity: &Activity) -> Result<Option<Cow<'_, [f64]>>, LoadingEnd> {
        if self.grid.boundary().is_none() {
            return Ok(None);
        }
        match self.common_rest() {
            Some(rest) => Ok(Some(Cow::Borrowed(rest))),
            None => self.release(activity).map(|rest| Some(Cow::Owned(rest))),
        }
    }

    /// Converts the end of a loading to an outcome in volts.
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

    /// Returns the state of rest and the forces of the sides, if not all sides are held.
    fn observe_sides(&self, pattern: &Pattern, u: &[f64]) -> Observation {
        let rest = self.rest_of(pattern);
        let (reactions, reaction_changes) = match self.reactions_from_rest(pattern, u, rest.as_deref()) {
            Some((reactions, changes)) => (Some(reactions), changes),
            None => (None, None),
        };
        Observation {
            reactions,
            reaction_changes,
            rest: rest.map(|rest| self.grid.sample(&rest)),
            charge: self.measures_charge.then(|| self.driven_charge(pattern, u)),
            ..Observation::default()
        }
    }

    /// Returns the results of effects other than the displacement.
    fn observe(&self, pattern: &Pattern, solution: &MeshSolution) -> Observation {
        let effects = &self.scene.effects;
        let mut observation = Observation {
            bodies: self.grid.motions(&solution.displacement),
            bars: self.grid.bar_motions(&solution.displacement),
            charged: solution.charged,
            ..self.observe_sides(pattern, &solution.displacement)
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

/// Loads a pattern.
struct Load<'a> {
    solver: &'a MembraneSolver,
    tolerance: f64,
    activity: &'a Activity,
    scratch: &'a mut Scratch,
}

impl WithMaterial for Load<'_> {
    type Output = ChargedLoading;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> ChargedLoading {
        let problem = Problem {
            tolerance: self.tolerance,
            ..self.solver.problem(self.activity, material)
        };
        let Scratch {
            displacement: u,
            workspace,
        } = self.scratch;
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

/// Finds the state without voltage.
struct Rest<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    scratch: &'a mut Scratch,
}

impl WithMaterial for Rest<'_> {
    type Output = Result<(), LoadingEnd>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Self::Output {
        let problem = Problem {
            activity: self.activity,
            laplacian: &self.solver.laplacian,
            material,
            tolerance: self.solver.tolerance,
            at_rest: None,
        };
        let Scratch {
            displacement: u,
            workspace,
        } = self.scratch;
        problem.rest(u, workspace).map_err(|loading| loading.ending)
    }
}

/// Relative residual of equilibria near a known one: at most 1e-5 of the change by a single cell.
const NEAR: f64 = 1e-7;

/// Finds an equilibrium near the displacement of `scratch`; returns whether there is one.
struct SolveNear<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    scratch: &'a mut Scratch,
}

impl WithMaterial for SolveNear<'_> {
    type Output = bool;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> bool {
        let material = material(1.0);
        let operator = Operator::new(&material, self.activity);
        let Scratch {
            displacement: u,
            workspace,
        } = self.scratch;
        workspace.begin_again();
        newton::solve(&operator, &self.solver.laplacian, NEAR, u, workspace).is_ok()
    }
}

/// Finds a stable equilibrium near a displacement; `None` if there is none, or the material may have several.
struct LoadNear<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    scratch: &'a mut Scratch,
}

impl WithMaterial for LoadNear<'_> {
    type Output = Option<Loading>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<Loading> {
        let problem = self.solver.problem(self.activity, material);
        if (problem.material)(1.0).has_several_branches() {
            return None;
        }
        let Scratch {
            displacement: u,
            workspace,
        } = self.scratch;
        let mut total = Loading::from(0.0);
        workspace.begin_again();
        let found = problem.attempt(Loads::at(1.0), Basin::Rest, u, workspace, &mut total);
        found.is_ok().then_some(total)
    }
}

/// The vectors of one thread, reused for its patterns.
struct Scratch {
    displacement: Vec<f64>,
    workspace: Workspace,
}

impl Simulator for MembraneSolver {
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation> {
        patterns
            .par_iter()
            .map_init(
                || self.scratch(self.limit),
                |scratch, pattern| {
                    let (solution, _) = self.solve_in(pattern, scratch);
                    let simulation = self.simulation(pattern, &solution);
                    scratch.displacement = solution.displacement;
                    simulation
                },
            )
            .collect()
    }
}
