//! Estimates of errors of geometry, by solutions on cells and on shapes.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::parameters::SolverParameters;
use super::solver::Solver;
use crate::accurate::AccurateSimulation;
use crate::error::SetupError;
use crate::geometry::{GeometryError, without_effects_of_cells};
use crate::screening::resolve;
use crate::time::AccurateHistory;
use deaflow_field::Mesh;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Elements along a cell. The second mesh is used where borders are too close to each other for the first.
const ELEMENTS: [usize; 2] = [1, 2];

/// Estimates errors of geometry in a scene.
pub struct GeometryErrors {
    /// The scenes on cells and on shapes, with decided effects.
    scenes: [Scene; 2],
    parameters: SolverParameters,
    meshes: [OnceLock<Option<[Solver; 2]>>; ELEMENTS.len()],
}

/// A solution, and its history if times are requested.
pub type SolvedOnce = (AccurateSimulation, Option<AccurateHistory>);

impl GeometryErrors {
    /// Creates the estimates of a scene; `None` if elements follow all shapes that are known. `has_drawings` says
    /// whether shapes of electrodes are known that elements do not follow.
    ///
    /// # Errors
    /// If effects of the scene cannot be decided.
    pub fn new(scene: &Scene, parameters: &SolverParameters, has_drawings: bool) -> Result<Option<Self>, SetupError> {
        let scene = &resolve(scene)?;
        let scenes = match (GeometryError::scenes(scene), has_drawings) {
            (Some(scenes), _) => scenes,
            (None, true) => [scene, scene].map(without_effects_of_cells),
            (None, false) => return Ok(None),
        };
        Ok(Some(Self {
            scenes,
            parameters: parameters.clone(),
            meshes: Default::default(),
        }))
    }

    /// Estimates the errors of patterns. `drawings` are the patterns as drawn, for the shapes of their electrodes.
    ///
    /// # Errors
    /// As [`Solver::simulate`].
    pub fn estimates(&self, patterns: &[Pattern], drawings: &[Pattern]) -> Result<Vec<GeometryError>, SetupError> {
        let error = |both: Option<[SolvedOnce; 2]>| {
            let both = both.as_ref().map(|both| both.each_ref());
            let fields = both.map(|both| both.map(|(solved, _)| solved.simulation.field.as_ref()));
            GeometryError::of_fields(fields.unwrap_or_default())
        };
        let one =
            |(at, pattern): (usize, &Pattern)| self.solve(pattern, drawings.get(at).unwrap_or(pattern)).map(error);
        patterns.par_iter().enumerate().map(one).collect()
    }

    /// Adds the estimates to results.
    ///
    /// # Errors
    /// As [`GeometryErrors::estimates`].
    pub fn add_to(
        &self,
        results: &mut [AccurateSimulation],
        patterns: &[Pattern],
        drawings: &[Pattern],
    ) -> Result<(), SetupError> {
        for (result, error) in results.iter_mut().zip(self.estimates(patterns, drawings)?) {
            result.geometry_error = result.simulation.field.is_some().then_some(error);
        }
        Ok(())
    }

    /// Solves a pattern on cells and on shapes; `None` if elements cannot follow these.
    ///
    /// # Errors
    /// As [`Solver::simulate_in_time`].
    pub fn solve(&self, pattern: &Pattern, drawing: &Pattern) -> Result<Option<[SolvedOnce; 2]>, SetupError> {
        for level in 0..ELEMENTS.len() {
            let Some([on_cells, fitted]) = self.on_level(level)? else {
                continue;
            };
            let fitted = match once(fitted, drawing) {
                Err(SetupError::Borders(_)) => continue,
                found => found?,
            };
            return Ok(Some([once(on_cells, pattern)?, fitted]));
        }
        Ok(None)
    }

    /// Returns the solvers of a mesh, which are set up on first use; `None` if its elements cannot follow the shapes of
    /// the device.
    fn on_level(&self, level: usize) -> Result<Option<&[Solver; 2]>, SetupError> {
        if let Some(solvers) = self.meshes[level].get() {
            return Ok(solvers.as_ref());
        }
        let elements = ELEMENTS[level];
        // Steps in time take the most work, and the errors of bilinear elements nearly cancel in the difference.
        let mesh = match self.parameters.follows_time() {
            true => Mesh::bilinear(elements),
            false => Mesh::biquadratic(elements),
        };
        let parameters = self.parameters.equilibria_on(mesh);
        let [on_cells, fitted] = self.scenes.each_ref().map(|scene| Solver::new(scene, &parameters));
        let solvers = match fitted {
            Err(SetupError::Borders(_)) => None,
            fitted => Some([on_cells?, fitted?]),
        };
        Ok(self.meshes[level].get_or_init(|| solvers).as_ref())
    }
}

fn once(solver: &Solver, pattern: &Pattern) -> Result<SolvedOnce, SetupError> {
    let (mut solved, histories) = solver.simulate_in_time(std::slice::from_ref(pattern))?;
    Ok((solved.swap_remove(0), histories.and_then(|mut found| found.pop())))
}
