//! The distance of a solution from the loss of stability.

use deaflow_pattern::Pattern;

use super::continuation::{LoadRange, LoadingEnd};
use super::effects::{Model, WithMaterial};
use super::eigenvalue::smallest;
use super::error::SetupError;
use super::material::Material;
use super::newton::Workspace;
use super::operator::{Activity, Operator};
use super::solver::{MembraneSolver, MeshSolution};

/// Highest load of a path, in units of the critical one of a fully active membrane: 50 times its voltage.
pub(super) const MAX_PATH_LOAD: f64 = 2500.0;
/// Highest load of a search for a margin, in the same units: 3 times the voltage. Membranes without stiffening lose
/// stability far below; with it, further steps are expensive and tell little.
const MAX_SEARCH_LOAD: f64 = 9.0;
/// Reference voltage in V for a scene without voltage.
const REFERENCE_VOLTAGE: f64 = 1e3;

/// The distance of a solution from the loss of stability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StabilityReport {
    /// The smallest eigenvalue μ of K v = μ L v, with the tangent K at the solution and the Laplacian L: dimensionless,
    /// near 1 for a bare membrane at rest, zero at the loss of stability. `None` without a stable solution.
    pub smallest_eigenvalue: Option<f64>,
    /// The voltages in V that bracket the loss of stability, at most one part in a thousand apart; `None` if it is
    /// unknown or above 3 times the critical voltage of a fully active membrane.
    pub critical: Option<[f64; 2]>,
    /// The critical voltage over that of the scene; `None` if either is unknown or zero.
    pub margin: Option<f64>,
}

impl MembraneSolver {
    /// Returns the model and the voltage in V of its full load: those of the scene, or a reference voltage if the scene
    /// has none.
    pub(super) fn driven(&self) -> Result<(Model, f64), SetupError> {
        match self.scene.voltage_v() {
            0.0 => Ok((
                Model::new(&self.scene.at_voltage(REFERENCE_VOLTAGE))?,
                REFERENCE_VOLTAGE,
            )),
            voltage => Ok((self.model.clone(), voltage)),
        }
    }

    /// Returns the distance of a solution of [`MembraneSolver::solve`] for this pattern from the loss of stability.
    #[must_use]
    pub fn stability(&self, pattern: &Pattern, solution: &MeshSolution) -> StabilityReport {
        let activity = self.model.activity(&self.grid, pattern);
        let (mut smallest_eigenvalue, mut critical) = (None, solution.outcome.bracket());
        if solution.outcome.is_converged() {
            let mut u = solution.displacement.clone();
            smallest_eigenvalue = self.model.with(Smallest {
                solver: self,
                activity: &activity,
                u: &u,
            });
            critical = self.critical(&activity, smallest_eigenvalue.unwrap_or_default(), &mut u);
        }
        let voltage = self.scene.voltage_v();
        let middle = critical.map(|[low, high]| 0.5 * (low + high));
        StabilityReport {
            smallest_eigenvalue,
            critical,
            margin: middle.filter(|_| voltage > 0.0).map(|middle| middle / voltage),
        }
    }

    /// Returns the voltages that bracket the loss of stability, from the stable state `u`, which is overwritten.
    fn critical(&self, activity: &Activity, eigenvalue: f64, u: &mut [f64]) -> Option<[f64; 2]> {
        let search = SearchOn {
            solver: self,
            activity,
            eigenvalue,
            u,
        };
        let (model, voltage) = self.driven().ok()?;
        let shares = if self.scene.voltage_v() > 0.0 {
            model.with(search)?
        } else {
            // Without voltage nothing has moved, so the load steps start at rest.
            model.with(FromRest(search))?
        };
        Some(shares.map(|share| share.sqrt() * voltage))
    }
}

/// Computes the smallest eigenvalue at a solution.
struct Smallest<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    u: &'a [f64],
}

impl WithMaterial for Smallest<'_> {
    type Output = Option<f64>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<f64> {
        let material = material(1.0);
        let operator = Operator::new(&material, self.activity);
        smallest(&operator, &self.solver.laplacian, self.u, None).map(|pair| pair.value)
    }
}

/// Finds the shares of the full load that bracket the loss of stability, from a solution at the full load.
struct SearchOn<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    eigenvalue: f64,
    u: &'a mut [f64],
}

/// The same, from rest.
struct FromRest<'a>(SearchOn<'a>);

impl SearchOn<'_> {
    fn raise_load<L: Material, F: Fn(f64) -> L>(self, material: F, from: f64) -> Option<[f64; 2]> {
        let full = material(1.0);
        let unit = 0.5 * full.largest_load() / full.load();
        let problem = self.solver.problem(self.activity, material);
        // Near a fold the eigenvalue decreases like the root of the distance to it.
        let guess = self.eigenvalue.clamp(1e-2, 1.0).powi(2);
        let range = LoadRange {
            from,
            to: (MAX_SEARCH_LOAD * unit).max(from),
            step: guess * from.max(0.25 * unit),
        };
        let mut workspace = Workspace::new(self.u.len(), &self.solver.laplacian);
        match problem.raise_load(range, self.u, &mut workspace).ending {
            LoadingEnd::Lost { stable, unstable, .. } => Some([stable, unstable]),
            LoadingEnd::Stable | LoadingEnd::Unknown { .. } | LoadingEnd::WorkLimit { .. } => None,
        }
    }
}

impl WithMaterial for SearchOn<'_> {
    type Output = Option<[f64; 2]>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Self::Output {
        self.raise_load(material, 1.0)
    }
}

impl WithMaterial for FromRest<'_> {
    type Output = Option<[f64; 2]>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Self::Output {
        self.0.raise_load(material, 0.0)
    }
}
