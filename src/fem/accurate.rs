//! Solutions with an estimated discretisation error.
//!
//! A pattern is solved on a sequence of meshes, coarse to fine, until the error of a solution, estimated from the next
//! finer one, is small enough. The coarser of the two is the result: their difference is its error up to the error of
//! the finer one, so the estimate is sharp. (Extrapolation to the error of the finer one needs the order of
//! convergence, which is unknown: the displacement has r log r singularities at the corners of electrodes, but none at
//! a straight electrode along the mesh.) For random, block, disc, ring, stripe, curve, bar and single-cell patterns the
//! true error was at most 1.3 times the difference between the bilinear and the biquadratic solution on one mesh. It
//! was at most 1.6 times that between two biquadratic ones up to 5.25 kV in the default scene, and 1.9 times at 6 kV,
//! where many patterns are close to their loss of stability. The factors below are larger.

use std::sync::OnceLock;

use rayon::prelude::*;

use deaflow_field::{Mesh, Simulation};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

use super::error::SetupError;
use super::geometry::GeometryError;
use super::solver::{MembraneSolver, SolveOptions};
use super::work::WorkLimit;

/// The meshes, each with the assumed ratio of the true error to the difference from the next one.
pub(super) const MESHES: [(Mesh, f64); 5] = [
    (Mesh::bilinear(1), 2.0),
    (Mesh::biquadratic(1), 2.5),
    (Mesh::biquadratic(2), 2.5),
    (Mesh::biquadratic(4), 2.5),
    (Mesh::biquadratic(8), 2.5),
];

/// Index of the mesh that decides about stability if a coarser one does not prove it. Coarse meshes are too stiff and
/// become unstable at a voltage some per cent too high; four biquadratic elements per cell at one a few parts in a
/// thousand too high.
const DECIDING_MESH: usize = 3;

/// Index of the first mesh with a loose tolerance if it only gives the error of the one before: coarser meshes take
/// little time, and their solutions are rarely the last.
const FIRST_LOOSE: usize = 2;

/// Relative residual of such a solution, in units of the accuracy over the side of the membrane. Its error is below a
/// fiftieth of the accuracy, which the ratios of the meshes cover.
const LOOSE_RESIDUAL: f64 = 0.5;

/// Largest relative residual.
const MAX_RESIDUAL: f64 = 1e-3;

/// A solution with its estimated discretisation error.
#[derive(Clone, Debug, PartialEq)]
pub struct AccurateSimulation {
    /// The result on the selected mesh.
    pub simulation: Simulation,
    /// The selected mesh.
    pub mesh: Mesh,
    /// Estimate of the largest displacement error at a cell corner in mm; present exactly if the outcome is converged.
    /// It exceeds the requested accuracy if even the finest mesh does not reach it.
    pub discretisation_error: Option<f64>,
    /// Estimate of the difference from the shapes of the device, if it was asked for; `None` if elements follow them.
    pub geometry_error: Option<GeometryError>,
}

impl AccurateSimulation {
    /// Returns the estimate of the largest error of the displacement in mm, of the mesh and of the geometry; `None` if
    /// one of them is unknown.
    #[must_use]
    pub fn error_mm(&self) -> Option<f64> {
        GeometryError::added_to(self.geometry_error, self.discretisation_error)
    }
}

/// Simulates patterns with a requested accuracy.
pub struct AccurateSolver {
    scene: Scene,
    accuracy_mm: f64,
    tolerance: f64,
    /// Relative residual of a solution that only gives the error of a coarser one.
    loose: f64,
    limit: WorkLimit,
    solvers: [OnceLock<MembraneSolver>; MESHES.len()],
}

impl AccurateSolver {
    /// Returns the finest mesh that an accuracy can choose.
    #[must_use]
    pub fn finest_mesh() -> Mesh {
        let [.., (finest, _)] = MESHES;
        finest
    }

    /// Creates a solver for a scene, an accuracy in mm and a relative residual.
    ///
    /// # Errors
    /// If the accuracy is not a positive number or the tolerance is out of range.
    pub fn new(scene: &Scene, accuracy_mm: f64, tolerance: f64) -> Result<Self, SetupError> {
        if !(accuracy_mm.is_finite() && accuracy_mm > 0.0) {
            return Err(SetupError::Accuracy { found: accuracy_mm });
        }
        let solver = Self {
            scene: scene.clone(),
            accuracy_mm,
            tolerance,
            loose: loose(scene, accuracy_mm).max(tolerance),
            limit: WorkLimit::default(),
            solvers: Default::default(),
        };
        solver.on_level(0)?;
        Ok(solver)
    }

    /// Sets the work limit of each pattern on each mesh.
    #[must_use]
    pub fn within(self, limit: WorkLimit) -> Self {
        Self {
            limit,
            solvers: Default::default(),
            ..self
        }
    }

    /// Simulates patterns in order; results do not depend on the other patterns or the number of threads.
    ///
    /// # Errors
    /// If the preconditioner of a finer mesh cannot be computed.
    pub fn simulate(&self, patterns: &[Pattern]) -> Result<Vec<AccurateSimulation>, SetupError> {
        patterns.par_iter().map(|pattern| self.simulate_one(pattern)).collect()
    }

    /// Returns the requested accuracy in mm.
    pub(super) fn accuracy_mm(&self) -> f64 {
        self.accuracy_mm
    }

    fn simulate_one(&self, pattern: &Pattern) -> Result<AccurateSimulation, SetupError> {
        let mut level = 0;
        let (mut coarse, _) = self.solve(level, pattern)?;
        loop {
            let last = level + 2 == MESHES.len();
            let error_by = |fine: &Simulation| match (&coarse.field, &fine.field) {
                (Some(coarse), Some(fine)) => Some(MESHES[level].1 * coarse.max_difference(fine)),
                _ => None,
            };
            let settles = |error: Option<f64>| error.is_some_and(|error| error <= self.accuracy_mm || last);
            let is_loose = level + 1 >= FIRST_LOOSE && self.loose > self.tolerance;
            let (mut fine, mut proven) = match is_loose {
                true => self.on_level(level + 1)?.simulate_to(pattern, self.loose),
                false => self.solve(level + 1, pattern)?,
            };
            let mut error = error_by(&fine);
            // A solution that does not end the loop may be the result of the next pass.
            if is_loose && !settles(error) {
                (fine, proven) = self.solve(level + 1, pattern)?;
                error = error_by(&fine);
            }
            if settles(error) {
                return match self.contradiction(level, proven, pattern)? {
                    Some(contradiction) => Ok(answer(DECIDING_MESH, contradiction, None)),
                    None => Ok(answer(level, coarse, error)),
                };
            }
            // If a finer mesh is unstable, the coarse solution is not reliable.
            if fine.field.is_none() {
                return Ok(answer(level + 1, fine, None));
            }
            if last {
                return Ok(answer(level, coarse, None));
            }
            coarse = fine;
            level += 1;
        }
    }

    /// Returns the solution of the deciding mesh if it contradicts the result. It is computed only if the finer
    /// solution has no proof of stability and is coarser than that mesh.
    fn contradiction(&self, level: usize, proven: bool, pattern: &Pattern) -> Result<Option<Simulation>, SetupError> {
        if proven || level + 1 >= DECIDING_MESH {
            return Ok(None);
        }
        let (verdict, _) = self.solve(DECIDING_MESH, pattern)?;
        Ok(verdict.field.is_none().then_some(verdict))
    }

    /// Returns the solution on a mesh, and whether its stability is proven.
    fn solve(&self, level: usize, pattern: &Pattern) -> Result<(Simulation, bool), SetupError> {
        Ok(self.on_level(level)?.simulate_to(pattern, self.tolerance))
    }

    /// Returns the solver of a mesh; creates it on first use.
    pub(super) fn on_level(&self, level: usize) -> Result<&MembraneSolver, SetupError> {
        if let Some(solver) = self.solvers[level].get() {
            return Ok(solver);
        }
        let options = SolveOptions {
            mesh: MESHES[level].0,
            tolerance: self.tolerance,
        };
        let solver = MembraneSolver::new(&self.scene, options)?.within(self.limit);
        Ok(self.solvers[level].get_or_init(|| solver))
    }
}

/// Returns the relative residual of a solution that only gives the error of another.
fn loose(scene: &Scene, accuracy_mm: f64) -> f64 {
    // A prescribed charge is reached by a search for its voltage, each step of which needs full accuracy.
    if scene.drive.charge.is_some() {
        return 0.0;
    }
    let [width, height] = scene.membrane().size_mm;
    (LOOSE_RESIDUAL * accuracy_mm / f64::max(width, height)).min(MAX_RESIDUAL)
}

fn answer(level: usize, simulation: Simulation, discretisation_error: Option<f64>) -> AccurateSimulation {
    AccurateSimulation {
        simulation,
        mesh: MESHES[level].0,
        discretisation_error,
        geometry_error: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::Stream;
    use deaflow_field::{Outcome, Simulator};
    use deaflow_pattern::Raster;

    fn patterns() -> Vec<Pattern> {
        let mut stream = Stream::new(11, "accuracy test", 0);
        let bits: Vec<bool> = (0..2500).map(|_| stream.chance(0.5)).collect();
        let blocks: Vec<bool> = (0..25).map(|_| stream.chance(0.5)).collect();
        let distance = |x: usize, y: usize| (x as f64 - 20.5).hypot(y as f64 - 27.5);
        vec![
            Pattern::from_fn(Raster::PAPER, |x, y| bits[50 * y + x]),
            Pattern::from_fn(Raster::PAPER, |x, y| blocks[y / 10 * 5 + x / 10]),
            Pattern::from_fn(Raster::PAPER, |x, _| x < 25),
            Pattern::from_fn(Raster::PAPER, |_, y| y % 6 < 3),
            Pattern::from_fn(Raster::PAPER, |x, y| (x + y) % 2 == 0),
            Pattern::from_fn(Raster::PAPER, |x, y| x == 33 && y == 8),
            Pattern::from_fn(Raster::PAPER, |x, y| x == 0 && y == 49),
            Pattern::from_fn(Raster::PAPER, |x, y| distance(x, y) < 12.0),
            Pattern::from_fn(Raster::PAPER, |x, y| (8.0..14.0).contains(&distance(x, y))),
            Pattern::from_fn(Raster::PAPER, |x, y| (y as f64) < 25.0 + 9.0 * (x as f64 / 6.0).sin()),
            Pattern::from_fn(Raster::PAPER, |x, y| 2 * x > y + 10),
        ]
    }

    #[test]
    fn estimates_cover_the_true_error_and_stay_within_five_times_of_it() {
        for voltage in [2500.0, 4890.0] {
            let scene = Scene::vhb4910().at_voltage(voltage);
            let options = SolveOptions::on(Mesh::biquadratic(4));
            let truth = MembraneSolver::new(&scene, options).unwrap().simulate(&patterns());
            for accuracy in [0.05, 0.003] {
                let solver = AccurateSolver::new(&scene, accuracy, 1e-8).unwrap();
                let results = solver.simulate(&patterns()).unwrap();
                for (at, (result, truth)) in results.iter().zip(&truth).enumerate() {
                    let estimate = result.discretisation_error.unwrap();
                    let (field, truth) = (result.simulation.field.as_ref().unwrap(), truth.field.as_ref().unwrap());
                    let error = field.max_difference(truth);
                    assert!(estimate <= accuracy, "pattern {at}");
                    assert!(
                        error <= estimate && estimate <= 5.0 * error,
                        "pattern {at}: {error:e} {estimate:e}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_solution_that_only_tells_an_error_is_off_by_a_fiftieth_of_the_accuracy() {
        for (voltage, accuracy) in [(2500.0, 0.01), (4890.0, 0.05), (4890.0, 0.01), (4890.0, 0.001)] {
            let solver = AccurateSolver::new(&Scene::vhb4910().at_voltage(voltage), accuracy, 1e-8).unwrap();
            assert!(solver.loose > 100.0 * solver.tolerance);
            let mesh_solver = solver.on_level(FIRST_LOOSE).unwrap();
            for (at, pattern) in patterns().iter().enumerate() {
                let [(fully, _), (loosely, _)] =
                    [solver.tolerance, solver.loose].map(|r| mesh_solver.simulate_to(pattern, r));
                let off = fully.field.unwrap().max_difference(&loosely.field.unwrap());
                assert!(
                    off < accuracy / 50.0,
                    "pattern {at} at {voltage} V: {off:e} of {accuracy}"
                );
            }
        }
    }

    #[test]
    fn what_a_fine_mesh_refuses_is_not_answered_by_a_coarse_one() {
        // Just above the pull-in of four biquadratic elements per cell, coarse meshes still find an equilibrium.
        let scene = Scene::from_text(
            "{ geometry: { side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 20 }, material: { model: neo-hookean, \
             shear_modulus: 45 kPa, relative_permittivity: 4.7 }, drive: { voltage: 7 kV }, effects: {} }",
        )
        .unwrap();
        let pattern = &Pattern::from_fn(Raster::new(20, 20).unwrap(), |x, y| {
            (3.2..5.6).contains(&(x as f64 - 8.2).hypot(y as f64 - 11.0))
        });
        let outcome = |mesh, voltage: f64| {
            let solver = MembraneSolver::new(&scene.at_voltage(voltage), SolveOptions::on(mesh)).unwrap();
            solver.solve(pattern).outcome
        };
        let Outcome::PullIn {
            first_unstable: voltage,
            ..
        } = outcome(Mesh::biquadratic(4), 7000.0)
        else {
            panic!("the ring pulls in below 7 kV");
        };
        assert!(
            [Mesh::bilinear(1), Mesh::biquadratic(1)]
                .iter()
                .all(|&mesh| outcome(mesh, voltage).is_converged())
        );
        let solver = AccurateSolver::new(&scene.at_voltage(voltage), 0.5, 1e-8).unwrap();
        let result = solver.simulate(std::slice::from_ref(pattern)).unwrap().remove(0);
        assert_ne!(result.simulation.outcome, Outcome::Converged);
        assert_eq!((result.simulation.field, result.discretisation_error), (None, None));
    }

    #[test]
    fn what_is_not_stable_has_no_error_and_no_field() {
        let scene = Scene::vhb4910().at_voltage(9e3);
        let result = AccurateSolver::new(&scene, 0.05, 1e-8)
            .unwrap()
            .simulate(&patterns()[2..3])
            .unwrap()
            .remove(0);
        assert_ne!(result.simulation.outcome, Outcome::Converged);
        assert_eq!((result.simulation.field, result.discretisation_error), (None, None));
    }

    #[test]
    fn a_pattern_that_does_not_move_is_exact() {
        let solver = AccurateSolver::new(&Scene::vhb4910(), 1e-6, 1e-8).unwrap();
        let result = solver
            .simulate(&[Pattern::from_fn(Raster::PAPER, |_, _| true)])
            .unwrap()
            .remove(0);
        assert_eq!(
            (result.mesh.elements_per_cell(), result.discretisation_error),
            (1, Some(0.0))
        );
    }

    #[test]
    fn an_accuracy_must_be_a_positive_number() {
        for accuracy in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(AccurateSolver::new(&Scene::vhb4910(), accuracy, 1e-8).is_err());
        }
    }
}
