//! Where the solutions of devices start.
//!
//! A device differs from the pattern as drawn mostly by its [drive](device::drive). So the pattern is solved at three
//! drives, and the displacements of a device are interpolated between these: a start that is fewer steps of Newton's
//! method from the solution than the undisplaced membrane.

use deaflow_fem::{MembraneSolver, SetupError};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

use crate::device;

/// Distance of the drives, in standard deviations.
const DISTANCE: f64 = 1.5;
/// Largest distance of the drives.
const FARTHEST: f64 = 0.2;
/// Smallest distance of the drives that matters.
const NEAREST: f64 = 1e-6;

/// The solutions of a pattern as drawn at some drives.
pub(crate) struct Starts {
    /// Solvers on equal meshes share what this one holds.
    _solver: MembraneSolver,
    drive: f64,
    as_drawn: Vec<f64>,
    /// The distance of the other drives and the displacements at the lower and the higher one, if both are stable.
    others: Option<(f64, [Vec<f64>; 2])>,
}

impl Starts {
    /// Solves a pattern in a state of a scene, whose drive varies by a standard deviation. `None` if it has no stable
    /// solution.
    ///
    /// # Errors
    /// If the scene cannot be simulated.
    pub(crate) fn new(
        scene: &Scene,
        pattern: &Pattern,
        deviation: f64,
        solver: impl Fn(&Scene) -> Result<MembraneSolver, SetupError>,
    ) -> Result<Option<Self>, SetupError> {
        let scene = scene.with_electrodes_of(pattern);
        let solution = |scene: &Scene| {
            let solver = solver(scene)?;
            let solution = solver.solve(pattern);
            let displacement = solution.outcome.is_converged().then_some(solution.displacement);
            Ok(displacement.map(|displacement| (solver, displacement)))
        };
        let Some((of_scene, as_drawn)) = solution(&scene)? else {
            return Ok(None);
        };
        let distance = (DISTANCE * deviation).min(FARTHEST);
        let mut others = None;
        if distance > NEAREST {
            let at = |shift: f64| solution(&scene.at_voltage(scene.voltage_v() * (0.5 * shift).exp()));
            if let (Some((_, low)), Some((_, high))) = (at(-distance)?, at(distance)?) {
                others = Some((distance, [low, high]));
            }
        }
        Ok(Some(Self {
            _solver: of_scene,
            drive: device::drive(&scene),
            as_drawn,
            others,
        }))
    }

    /// Returns the displacements from which a device starts.
    pub(crate) fn at(&self, scene: &Scene) -> Vec<f64> {
        let Some((distance, [low, high])) = &self.others else {
            return self.as_drawn.clone();
        };
        // A parabola through three points.
        let x = (device::drive(scene) - self.drive) / distance;
        let weights = [0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)];
        let all = self.as_drawn.iter().zip(low).zip(high);
        all.map(|((drawn, low), high)| weights[0] * low + weights[1] * drawn + weights[2] * high)
            .collect()
    }
}
