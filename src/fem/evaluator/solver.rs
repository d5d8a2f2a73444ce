//! The solver: Newton's method on one mesh or on a mesh for each pattern, an estimate, or a history.

use std::borrow::Cow;

use rayon::prelude::*;

use super::method::Method;
use super::parameters::{MeshRequest, SolverParameters};
use crate::accurate::{AccurateSimulation, AccurateSolver};
use crate::error::SetupError;
use crate::laminates::check_covered_cells;
use crate::observable::CellState;
use crate::out_of_plane::SpatialSolver;
use crate::response::{Estimator, LinearResponse};
use crate::screening::resolve;
use crate::solver::{MembraneSolver, SolveOptions};
use crate::time::{AccurateHistory, HistorySolver};
use deaflow_field::{Evaluator, Field, Mesh, PredictError, Predictor, Simulation, Simulator};
use deaflow_pattern::{Pattern, PatternForm};
use deaflow_scene::{Effects, Leads, Scene, Unreached};

/// A solver for the patterns of a scene.
pub struct Solver {
    /// The scene with decided effects.
    scene: Scene,
    parameters: SolverParameters,
    /// γ of branches that have no time to relax, as in [`Solver::with_unrelaxed`].
    gamma: f64,
    form: PatternForm,
    leads: Option<Leads>,
    engine: Engine,
}

impl SolverParameters {
    /// Creates the solver for a scene.
    ///
    /// # Errors
    /// As [`Solver::new`].
    pub fn build(&self, scene: &Scene) -> Result<Solver, SetupError> {
        Solver::new(scene, self)
    }
}

enum Engine {
    /// Newton's method on one mesh.
    Fixed(Box<MembraneSolver>),
    /// Newton's method on a mesh for each pattern.
    Accurate(Box<AccurateSolver>),
    /// Chord steps from the linear response on one mesh.
    Estimate(Box<Estimator>, Mesh),
    /// The drive in time.
    History(Box<HistorySolver>),
    /// Newton's method in space on one mesh.
    Spatial(Box<SpatialSolver>, Mesh),
}

impl Solver {
    /// Creates the solver for a scene; effects are decided first with `effects: auto`.
    ///
    /// # Errors
    /// If the mesh or tolerance is out of range, the membrane has no linear response, or its effects cannot be
    /// simulated.
    pub fn new(scene: &Scene, parameters: &SolverParameters) -> Result<Self, SetupError> {
        Self::with_unrelaxed(scene, parameters, 0.0)
    }

    /// Like [`Solver::new`], with viscoelastic branches that have no time to relax, of a modulus γ in units of μλp²;
    /// for one mesh without history.
    ///
    /// # Errors
    /// As [`Solver::new`].
    pub(crate) fn with_unrelaxed(scene: &Scene, parameters: &SolverParameters, gamma: f64) -> Result<Self, SetupError> {
        let limit = parameters.work_limit();
        let scene = &resolve(scene)?;
        let tolerance = parameters.tolerance();
        let (times, mesh) = (parameters.times(), parameters.mesh_request());
        let engine = match (times, mesh, parameters.method().chord_steps()) {
            _ if scene.is_in_space() => {
                let mesh = parameters.mesh_in_space(scene)?;
                let solver = SpatialSolver::new(scene, SolveOptions { mesh, tolerance })?;
                Engine::Spatial(Box::new(solver.within(limit)), mesh)
            }
            (Some(times), ..) => Engine::History(Box::new(parameters.history_solver(scene, times)?)),
            (None, MeshRequest::Accuracy(accuracy), _) => {
                let solver = AccurateSolver::new(scene, accuracy.value(), tolerance)?;
                Engine::Accurate(Box::new(solver.within(limit)))
            }
            (None, MeshRequest::Fixed(mesh), None) => {
                let options = SolveOptions { mesh, tolerance };
                Engine::Fixed(Box::new(
                    MembraneSolver::with_unrelaxed(scene, gamma, options)?.within(limit),
                ))
            }
            (None, MeshRequest::Fixed(mesh), Some(chord_steps)) => {
                let response = LinearResponse::with_unrelaxed(scene, gamma, mesh)?;
                Engine::Estimate(Box::new(Estimator { response, chord_steps }), mesh)
            }
        };
        Ok(Self {
            scene: scene.clone(),
            gamma,
            parameters: parameters.clone(),
            form: scene.form(),
            leads: scene.leads.clone(),
            engine,
        })
    }

    /// Returns its parameters.
    #[must_use]
    pub fn parameters(&self) -> &SolverParameters {
        &self.parameters
    }

    /// Returns whether results have an estimate of their discretisation error.
    #[must_use]
    pub fn estimates_errors(&self) -> bool {
        self.parameters.accuracy().is_some()
    }

    /// Returns the effects that results report in addition to the displacement: none for estimates and histories.
    #[must_use]
    pub fn observed<'a>(&self, effects: &'a Effects) -> Cow<'a, Effects> {
        match self.engine {
            Engine::Estimate(..) | Engine::History(_) | Engine::Spatial(..) => Cow::Owned(Effects::default()),
            Engine::Fixed(_) | Engine::Accurate(_) => Cow::Borrowed(effects),
        }
    }

    /// Returns the solver on one mesh with Newton's method, for details of a solution.
    ///
    /// # Errors
    /// If it is another method, or the mesh depends on the pattern.
    pub fn on_one_mesh(&self) -> Result<&MembraneSolver, SetupError> {
        match &self.engine {
            Engine::Fixed(solver) => Ok(solver),
            Engine::Accurate(_) | Engine::Estimate(..) | Engine::History(_) => Err(SetupError::SeveralMeshes),
            Engine::Spatial(..) => Err(SetupError::not_in_space(&self.scene, "states of cells")),
        }
    }

    /// Simulates patterns in order; results on a fixed mesh have no error estimate.
    ///
    /// # Errors
    /// If a pattern has electrode groups without voltage, a part without a lead, or cells that are covered in part and
    /// cannot be simulated in this way, or if a finer mesh cannot be set up.
    pub fn simulate(&self, patterns: &[Pattern]) -> Result<Vec<AccurateSimulation>, SetupError> {
        self.check(patterns)?;
        self.each(patterns, |solver, patterns| solver.simulate_on_own_borders(patterns))
    }

    /// Runs this solver on patterns. One with other drawn electrodes than those of the scene has its own solver, whose
    /// elements follow them.
    fn each<R: Send>(
        &self,
        patterns: &[Pattern],
        run: impl Fn(&Self, &[Pattern]) -> Result<Vec<R>, SetupError> + Sync,
    ) -> Result<Vec<R>, SetupError> {
        let is_own = |pattern: &Pattern| pattern.electrodes() == self.scene.electrodes.as_ref();
        if patterns.iter().all(is_own) {
            return run(self, patterns);
        }
        let one = |pattern: &Pattern| {
            let patterns = std::slice::from_ref(pattern);
            match self.scene.with_electrodes_of(pattern) {
                Cow::Borrowed(_) => run(self, patterns),
                Cow::Owned(scene) => run(&Self::with_unrelaxed(&scene, &self.parameters, self.gamma)?, patterns),
            }
        };
        let found: Vec<Vec<R>> = patterns.par_iter().map(one).collect::<Result<_, _>>()?;
        Ok(found.into_iter().flatten().collect())
    }

    fn simulate_on_own_borders(&self, patterns: &[Pattern]) -> Result<Vec<AccurateSimulation>, SetupError> {
        match &self.engine {
            Engine::Accurate(solver) => solver.simulate(patterns),
            Engine::Fixed(solver) => Ok(on(solver.mesh(), solver.simulate(patterns))),
            Engine::Estimate(estimator, mesh) => Ok(on(*mesh, estimator.simulate(patterns))),
            Engine::Spatial(solver, mesh) => Ok(on(*mesh, solver.simulate(patterns))),
            Engine::History(solver) => {
                let each = patterns.par_iter();
                each.map(|pattern| solver.displace(pattern).map(|found| last_state(&found)))
                    .collect()
            }
        }
    }

    /// Like [`Solver::simulate`], with the histories if the parameters ask for them.
    ///
    /// # Errors
    /// As [`Solver::simulate`].
    pub fn simulate_in_time(
        &self,
        patterns: &[Pattern],
    ) -> Result<(Vec<AccurateSimulation>, Option<Vec<AccurateHistory>>), SetupError> {
        if !matches!(self.engine, Engine::History(_)) {
            return Ok((self.simulate(patterns)?, None));
        }
        self.check(patterns)?;
        let histories = self.each(patterns, |solver, patterns| match &solver.engine {
            Engine::History(solver) => patterns.par_iter().map(|pattern| solver.follow(pattern)).collect(),
            _ => Ok(Vec::new()),
        })?;
        Ok((histories.iter().map(last_state).collect(), Some(histories)))
    }

    /// Checks that patterns can be simulated.
    ///
    /// # Errors
    /// As [`Solver::simulate`].
    pub fn check(&self, patterns: &[Pattern]) -> Result<(), SetupError> {
        let groups = self.form.groups;
        if patterns.iter().any(|pattern| pattern.coverage().is_some()) {
            check_covered_cells(&self.scene)?;
            self.parameters.check_covered_cells()?;
            if self.scene.is_in_space() {
                return Err(SetupError::not_in_space(&self.scene, "cells that are covered in part"));
            }
            if self.gamma != 0.0 {
                return Err(SetupError::Coverage {
                    with: "`viscoelasticity`",
                });
            }
        }
        let Some(pattern) = patterns.iter().find(|pattern| pattern.groups() > groups) else {
            return check_leads(self.leads.as_ref(), patterns);
        };
        let coverage = pattern.coverage();
        let cells = coverage.map_or(pattern.cells(), |coverage| coverage.groups());
        let columns = pattern.raster().columns();
        let at = cells
            .iter()
            .position(|&group| usize::from(group) > groups)
            .unwrap_or_default();
        let (y, x, group) = (at / columns, at % columns, cells[at]);
        Err(SetupError::Group { y, x, group, groups })
    }

    /// Like [`Solver::simulate`], with the state of every cell; `None` without a stable solution.
    ///
    /// # Errors
    /// As [`Solver::on_one_mesh`].
    pub fn simulate_cells(&self, patterns: &[Pattern]) -> Result<(Vec<AccurateSimulation>, CellStates), SetupError> {
        self.check(patterns)?;
        let mesh = self.on_one_mesh()?.mesh();
        let found = self.each(patterns, |solver, patterns| {
            Ok(solver.on_one_mesh()?.simulate_cells(patterns))
        })?;
        let (simulations, states) = found.into_iter().unzip();
        Ok((on(mesh, simulations), states))
    }
}

/// Checks that every part of the electrodes has a lead, if leads are given.
///
/// # Errors
/// If a part has none.
pub fn check_leads(leads: Option<&Leads>, patterns: &[Pattern]) -> Result<(), SetupError> {
    let Some(leads) = leads else {
        return Ok(());
    };
    let mut islands = patterns.iter().enumerate().filter_map(|(at, pattern)| {
        let island = leads.unreached(pattern)?;
        Some((at, island))
    });
    match islands.next() {
        Some((pattern, Unreached { cells, at: [x, y] })) => Err(SetupError::Island { pattern, cells, y, x }),
        None => Ok(()),
    }
}

/// The state of every cell of each pattern; `None` without a stable solution.
pub type CellStates = Vec<Option<Vec<CellState>>>;

/// Returns the state at the end of a history.
pub(crate) fn last_state(found: &AccurateHistory) -> AccurateSimulation {
    AccurateSimulation {
        simulation: found.history.last_state(),
        mesh: found.mesh,
        discretisation_error: found.space_error_mm,
        geometry_error: None,
    }
}

/// Wraps results of one mesh, without error estimates.
fn on(mesh: Mesh, simulations: Vec<Simulation>) -> Vec<AccurateSimulation> {
    let each = |simulation| AccurateSimulation {
        simulation,
        mesh,
        discretisation_error: None,
        geometry_error: None,
    };
    simulations.into_iter().map(each).collect()
}

impl Predictor for Solver {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let results = self.simulate(patterns).map_err(PredictError::failed)?;
        Ok(results.into_iter().map(|result| result.simulation.stroke()).collect())
    }
}

impl Evaluator for Solver {
    fn settings(&self) -> String {
        self.parameters.to_string()
    }

    fn finds_equilibria(&self) -> bool {
        self.parameters.method() == Method::Newton && !self.parameters.follows_time()
    }

    fn promised_error_mm(&self) -> Option<f64> {
        self.parameters.accuracy().map(|accuracy| accuracy.value())
    }
}
