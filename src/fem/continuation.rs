//! Load stepping from rest to the full load.
//!
//! The full load is tried at once. If that does not give a stable equilibrium, the load, which is proportional to V²,
//! is raised in steps from the last stable state; failing steps are halved until the loss of stability is bracketed by
//! two voltages one part in a thousand apart.

use super::material::Material;
use super::newton::{self, NewtonFailure, Workspace};
use super::operator::{Activity, Operator};
use super::precondition::Laplacian;
use super::stability::{Basin, Loss, Stability, is_in_basin, judge};
use deaflow_base::is_interrupted;

/// How the load stepping ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadingEnd {
    /// A stable equilibrium at the full load.
    Stable,
    /// Stability is lost between two shares of the full load.
    Lost {
        /// The highest share with a stable equilibrium.
        stable: f64,
        /// The lowest share without one.
        unstable: f64,
        /// What is lost first.
        loss: Loss,
    },
    /// The iteration did not converge.
    Unknown {
        /// The highest share with a stable equilibrium; 0 is rest.
        stable: f64,
    },
    /// The work limit was reached.
    WorkLimit {
        /// The highest share with a stable equilibrium; 0 is rest.
        stable: f64,
    },
}

impl LoadingEnd {
    /// Returns the highest share of the full load with a stable equilibrium; 0 is rest.
    pub fn stable(self) -> f64 {
        match self {
            Self::Stable => 1.0,
            Self::Lost { stable, .. } | Self::Unknown { stable } | Self::WorkLimit { stable } => stable,
        }
    }
}

/// End and work of a load stepping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loading {
    /// How it ended.
    pub ending: LoadingEnd,
    /// Newton steps over all load steps, including failed ones.
    pub steps: u32,
    /// Relative residual of the last attempt.
    pub residual: f64,
    /// Whether the stability of the last state is proven: see [`Stability::Stable`].
    pub pointwise: bool,
}

impl Loading {
    /// The start of a load stepping from a share.
    pub(super) fn from(stable: f64) -> Self {
        Self {
            ending: LoadingEnd::Unknown { stable },
            steps: 0,
            residual: 0.0,
            pointwise: false,
        }
    }
}

/// Why a load or time step fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepFailure {
    /// The state is not stable.
    Lost(Loss),
    /// The iteration did not converge.
    Unknown,
    /// The work limit was reached.
    Work,
}

impl From<NewtonFailure> for StepFailure {
    fn from(failure: NewtonFailure) -> Self {
        match failure {
            NewtonFailure::NegativeCurvature | NewtonFailure::LineSearch => Self::Lost(Loss::Stability),
            NewtonFailure::Limit => Self::Unknown,
            NewtonFailure::Work => Self::Work,
        }
    }
}

/// The loads of a state.
#[derive(Clone, Copy, Debug)]
pub struct Loads<'a> {
    /// Share of the full load, which is proportional to V².
    pub voltage: f64,
    /// Share of the forces on bodies and sides, and of the released prestress.
    pub bodies: f64,
    /// Further dead forces on nodes, with the opposite sign.
    pub dead: Option<&'a [f64]>,
}

impl Loads<'_> {
    /// The full forces on bodies and sides, and a share of the full load.
    pub const fn at(voltage: f64) -> Self {
        Self {
            voltage,
            bodies: 1.0,
            dead: None,
        }
    }
}

/// Relative width of the bracket in load: one part in a thousand of the voltage.
pub(super) const BRACKET: f64 = 2e-3;
/// Prestress, in units of μλp², that counts as none.
const NO_PRESTRESS: f64 = 1e-9;
/// Maximum number of load steps.
pub(super) const MAX_LOAD_STEPS: u32 = 200;

/// First step of a search between two loads, in units of their difference.
pub(super) const FIRST_STEP: f64 = 0.5;

/// Range of a load stepping, as shares of the full load.
#[derive(Clone, Copy, Debug)]
pub struct LoadRange {
    /// Share of the first state.
    pub from: f64,
    /// Requested share.
    pub to: f64,
    /// The first step.
    pub step: f64,
}

impl LoadRange {
    const FROM_REST: Self = Self {
        from: 0.0,
        to: 1.0,
        step: 1.0,
    };
}

/// The equilibrium problem of one membrane with a variable load.
pub struct Problem<'a, F> {
    /// Elements and activity.
    pub activity: &'a Activity,
    /// The preconditioner.
    pub laplacian: &'a Laplacian,
    /// The law at a share of the full load.
    pub material: F,
    /// Relative residual of an equilibrium.
    pub tolerance: f64,
    /// The state without voltage, if it is known.
    pub at_rest: Option<&'a [f64]>,
}

impl<F> Problem<'_, F> {
    /// Moves `u` to the state without voltage if it is known, otherwise to the mount.
    pub(super) fn start(&self, u: &mut [f64]) {
        match self.at_rest {
            Some(rest) => u.copy_from_slice(rest),
            None => u.fill(0.0),
        }
    }
}

impl<L: Material, F: Fn(f64) -> L> Problem<'_, F> {
    /// Moves `u` from rest to the full load, or to the last stable state before it.
    pub fn load(&self, u: &mut [f64], workspace: &mut Workspace) -> Loading {
        match self.rest(u, workspace) {
            Ok(()) => self.raise_load(LoadRange::FROM_REST, u, workspace),
            Err(loading) => loading,
        }
    }

    /// Returns whether forces act on bodies or sides without voltage, so that the state of rest is not u = 0.
    pub(super) fn is_loaded(&self) -> bool {
        // Whatever is loaded or released is among the supports.
        self.activity.grid().supports().is_some() && Operator::new(&(self.material)(0.0), self.activity).is_loaded()
    }

    /// Loads from rest through two shares, between which a loss of stability is expected. `u` is then the last stable
    /// state.
    pub fn load_through(&self, [low, high]: [f64; 2], u: &mut [f64], workspace: &mut Workspace) -> LoadingEnd {
        if let Err(loading) = self.rest(u, workspace) {
            return loading.ending;
        }
        let approach = LoadRange {
            from: 0.0,
            to: low,
            step: low,
        };
        let ending = self.raise_load(approach, u, workspace).ending;
        if ending != LoadingEnd::Stable {
            return ending;
        }
        let search = LoadRange {
            from: low,
            to: high,
            step: FIRST_STEP * (high - low),
        };
        self.raise_load(search, u, workspace).ending
    }

    /// Moves `u` from a stable state to a higher load, or to the last stable state before it.
    pub fn raise_load(&self, range: LoadRange, u: &mut [f64], workspace: &mut Workspace) -> Loading {
        let mut total = Loading::from(range.from);
        let (mut stable, mut step) = (range.from, range.step.min(range.to - range.from));
        let mut failed = false;
        let mut reached: Option<Vec<f64>> = (range.from > 0.0 || self.is_loaded()).then(|| u.to_vec());
        workspace.begin_again();
        for _ in 0..MAX_LOAD_STEPS {
            let share: f64 = stable + step;
            let basin = reached.as_deref().map_or(Basin::Rest, Basin::Of);
            match self.attempt(Loads::at(share), basin, u, workspace, &mut total) {
                Ok(()) if share >= range.to => {
                    total.ending = LoadingEnd::Stable;
                    return total;
                }
                Ok(()) => {
                    reached.get_or_insert_with(|| vec![0.0; u.len()]).copy_from_slice(u);
                    stable = share;
                    // After a failure, a longer step would fail again and reduce the bracket by a quarter instead of a
                    // half.
                    step = if failed { step } else { 1.5 * step }.min(range.to - stable);
                    failed = false;
                }
                Err(failure) => {
                    failed = true;
                    match &reached {
                        Some(reached) => u.copy_from_slice(reached),
                        None => u.fill(0.0),
                    }
                    if failure == StepFailure::Work {
                        total.ending = ending(failure, stable, share);
                        return total;
                    }
                    if stable == 0.0 && failure != StepFailure::Unknown && self.is_loose_at_rest() {
                        let loss = Loss::Tension;
                        total.ending = ending(StepFailure::Lost(loss), stable, share);
                        return total;
                    }
                    if step <= BRACKET * share {
                        total.ending = ending(failure, stable, share);
                        return total;
                    }
                    step = (0.5 * step).min(self.largest_step(stable));
                }
            }
            // A membrane that does not move makes no Newton steps, which would check the limit.
            if workspace.is_spent() {
                total.ending = LoadingEnd::WorkLimit { stable };
                return total;
            }
        }
        total.ending = LoadingEnd::Unknown { stable };
        total
    }

    /// Returns whether the membrane wrinkles and has no prestress: any load that moves it then removes the tension
    /// somewhere, so there is no stable state to search for.
    fn is_loose_at_rest(&self) -> bool {
        let identity = [[1.0, 0.0], [0.0, 1.0]];
        let unloaded = (self.material)(0.0);
        unloaded.wrinkles() && unloaded.self_stress(identity)[0][0].abs() < NO_PRESTRESS
    }

    /// Returns the largest useful step from rest, which limits huge voltages.
    fn largest_step(&self, stable: f64) -> f64 {
        let material = (self.material)(1.0);
        if stable > 0.0 {
            f64::INFINITY
        } else {
            material.largest_load() / material.load()
        }
    }

    /// Solves at some loads, and checks stability and the basin.
    pub(super) fn attempt(
        &self,
        loads: Loads<'_>,
        basin: Basin<'_>,
        u: &mut [f64],
        workspace: &mut Workspace,
        total: &mut Loading,
    ) -> Result<(), StepFailure> {
        let found = self.solve_at(loads, basin, u, workspace, total);
        match found {
            // Nothing is known of the stability.
            Err(_) if is_interrupted() => Err(StepFailure::Work),
            found => found,
        }
    }

    fn solve_at(
        &self,
        loads: Loads<'_>,
        basin: Basin<'_>,
        u: &mut [f64],
        workspace: &mut Workspace,
        total: &mut Loading,
    ) -> Result<(), StepFailure> {
        let material = (self.material)(loads.voltage);
        let operator = Operator {
            body_load: loads.bodies,
            release: loads.bodies,
            dead: loads.dead,
            ..Operator::new(&material, self.activity)
        };
        newton::give_motions(&operator, self.laplacian, u, workspace);
        let result = newton::solve(&operator, self.laplacian, self.tolerance, u, workspace);
        let (Ok(progress) | Err((_, progress))) = result;
        total.steps += progress.steps;
        total.residual = progress.residual;
        match result {
            Ok(_) => match judge(&operator, self.laplacian, u, workspace) {
                Stability::Stable { pointwise } => {
                    if operator.material.has_several_branches()
                        && !is_in_basin(&operator, self.laplacian, basin, u, workspace)
                    {
                        return Err(StepFailure::Lost(Loss::Stability));
                    }
                    total.pointwise = pointwise;
                    Ok(())
                }
                Stability::Lost(loss) => Err(StepFailure::Lost(loss)),
            },
            Err((failure, _)) => Err(failure.into()),
        }
    }
}

pub(super) fn ending(failure: StepFailure, stable: f64, unstable: f64) -> LoadingEnd {
    match failure {
        StepFailure::Unknown => LoadingEnd::Unknown { stable },
        StepFailure::Work => LoadingEnd::WorkLimit { stable },
        StepFailure::Lost(loss) => LoadingEnd::Lost { stable, unstable, loss },
    }
}
