//! How far a membrane is from losing stability.

use deaflow_pattern::Pattern;

use super::continuation::{LoadRange, LoadingEnd};
use super::effects::{Model, WithMaterial};
use super::eigenvalue::smallest;
use super::error::SetupError;
use super::material::Material;
use super::newton::Workspace;
use super::operator::{Activity, Operator};
use super::solver::{MembraneSolver, MeshSolution};

/// The highest load in units of the critical one of a membrane that is active everywhere: 50 times its voltage.
pub(super) const HIGHEST: f64 = 2500.0;
/// The highest load at which a margin is searched for, in the same units: 3 times the voltage. Membranes without stiffening are
/// lost far below; with it, every step beyond is dear and says little.
const REACH: f64 = 9.0;
/// Where the scene has no voltage, one to measure the load by.
const SOME_VOLTAGE: f64 = 1e3;

/// How far a solution is from losing stability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StabilityReport {
    /// The smallest eigenvalue μ of K v = μ L v, with the tangent K at the solution and the Laplacian L: without unit, near
    /// 1 for a bare membrane at rest, zero where stability is lost. `None` without a stable solution.
    pub smallest_eigenvalue: Option<f64>,
    /// The voltages in V between which stability is lost, at most one part in a thousand apart; `None` where it is not lost
    /// below 3 times the critical voltage of a membrane that is active everywhere, or nothing is known.
    pub critical: Option<[f64; 2]>,
    /// The critical voltage over that of the scene; `None` where either is missing or zero.
    pub margin: Option<f64>,
}

impl MembraneSolver {
    /// The physics with the voltage in V of its full load: those of the scene, or at some voltage where the scene has none.
    pub(super) fn driven(&self) -> Result<(Model, f64), SetupError> {
        match self.scene.voltage_v() {
            0.0 => Ok((Model::new(&self.scene.at_voltage(SOME_VOLTAGE))?, SOME_VOLTAGE)),
            voltage => Ok((self.model.clone(), voltage)),
        }
    }

    /// How far a solution of [`MembraneSolver::solve`] for this pattern is from losing stability.
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

    /// The voltages between which stability is lost, going on from the stable state `u`, which is lost.
    fn critical(&self, activity: &Activity, eigenvalue: f64, u: &mut [f64]) -> Option<[f64; 2]> {
        let onward = Onward {
            solver: self,
            activity,
            eigenvalue,
            u,
        };
        let (model, voltage) = self.driven().ok()?;
        let shares = if self.scene.voltage_v() > 0.0 {
            model.with(onward)?
        } else {
            // Nothing has moved at no voltage or at any share of it, so the scale is another one.
            model.with(FromRest(onward))?
        };
        Some(shares.map(|share| share.sqrt() * voltage))
    }
}

/// The smallest eigenvalue at a solution.
struct Smallest<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    u: &'a [f64],
}

impl WithMaterial for Smallest<'_> {
    type Output = Option<f64>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<f64> {
        let operator = Operator {
            material: &material(1.0),
            activity: self.activity,
            pulled: 1.0,
        };
        smallest(&operator, &self.solver.laplacian, self.u, None).map(|pair| pair.value)
    }
}

/// The shares of the full load between which stability is lost, on from a solution at the full load.
struct Onward<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    eigenvalue: f64,
    u: &'a mut [f64],
}

/// The same, from rest.
struct FromRest<'a>(Onward<'a>);

impl Onward<'_> {
    fn raise_load<L: Material, F: Fn(f64) -> L>(self, material: F, from: f64) -> Option<[f64; 2]> {
        let full = material(1.0);
        let unit = 0.5 * full.largest_load() / full.load();
        let problem = self.solver.problem(self.activity, material);
        // Towards a fold the eigenvalue falls like the root of the distance to it.
        let guess = self.eigenvalue.clamp(1e-2, 1.0).powi(2);
        let range = LoadRange {
            from,
            to: (REACH * unit).max(from),
            step: guess * from.max(0.25 * unit),
        };
        let mut workspace = Workspace::new(self.u.len(), &self.solver.laplacian);
        match problem.raise_load(range, self.u, &mut workspace).ending {
            LoadingEnd::Lost { stable, unstable, .. } => Some([stable, unstable]),
            LoadingEnd::Stable | LoadingEnd::Unknown { .. } | LoadingEnd::WorkLimit { .. } => None,
        }
    }
}

impl WithMaterial for Onward<'_> {
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
