//! Load stepping from rest to the full load.
//!
//! The full load is tried at once. If that does not give a stable equilibrium, the load, which is proportional to V²,
//! is raised in steps from the last stable state; failing steps are halved until the loss of stability is bracketed by
//! two voltages one part in a thousand apart.

use super::material::Material;
use super::newton::{self, NewtonFailure, Workspace};
use super::operator::{Activity, Operator};
use super::precondition::Laplacian;
use super::stability::{Loss, Stability, judge, same_basin};
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

/// Relative width of the bracket in load: one part in a thousand of the voltage.
const BRACKET: f64 = 2e-3;
/// Prestress, in units of μλp², that counts as none.
const NO_PRESTRESS: f64 = 1e-9;
/// Maximum number of load steps.
const MAX_LOAD_STEPS: u32 = 200;

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

impl<L: Material, F: Fn(f64) -> L> Problem<'_, F> {
    /// Moves `u` from rest to the full load, or to the last stable state before it.
    pub fn load(&self, u: &mut [f64], workspace: &mut Workspace) -> Loading {
        match self.rest(u, workspace) {
            Ok(()) => self.raise_load(LoadRange::FROM_REST, u, workspace),
            Err(loading) => loading,
        }
    }

    /// Moves `u` to the state without voltage, loaded only by the forces on bodies and sides.
    ///
    /// # Errors
    /// If these make the membrane unstable.
    pub fn rest(&self, u: &mut [f64], workspace: &mut Workspace) -> Result<(), Loading> {
        u.fill(0.0);
        if let Some(known) = self.at_rest {
            u.copy_from_slice(known);
            return Ok(());
        }
        if !self.is_loaded() {
            return Ok(());
        }
        let mut total = Loading::from(0.0);
        let (mut applied, mut step) = (0.0, 1.0_f64);
        let mut reached = u.to_vec();
        workspace.begin_again();
        for _ in 0..MAX_LOAD_STEPS {
            let body_load = f64::min(applied + step, 1.0);
            match self.attempt([0.0, body_load], Some(&reached), u, workspace, &mut total) {
                Ok(()) if body_load >= 1.0 => return Ok(()),
                Ok(()) => {
                    applied = body_load;
                    reached.copy_from_slice(u);
                }
                Err(failure) => {
                    u.copy_from_slice(&reached);
                    if failure == StepFailure::Work || step <= BRACKET {
                        total.ending = ending(failure, 0.0, 0.0);
                        return Err(total);
                    }
                    step *= 0.5;
                }
            }
        }
        Err(total)
    }

    /// Returns whether forces act on bodies or sides without voltage, so that the state of rest is not u = 0.
    fn is_loaded(&self) -> bool {
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
            match self.attempt([share, 1.0], reached.as_deref(), u, workspace, &mut total) {
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

    /// Solves at shares of the full load and of the forces on bodies, and checks stability.
    fn attempt(
        &self,
        loads: [f64; 2],
        before: Option<&[f64]>,
        u: &mut [f64],
        workspace: &mut Workspace,
        total: &mut Loading,
    ) -> Result<(), StepFailure> {
        let found = self.solve_at(loads, before, u, workspace, total);
        match found {
            // Nothing is known of the stability.
            Err(_) if is_interrupted() => Err(StepFailure::Work),
            found => found,
        }
    }

    fn solve_at(
        &self,
        [share, body_load]: [f64; 2],
        before: Option<&[f64]>,
        u: &mut [f64],
        workspace: &mut Workspace,
        total: &mut Loading,
    ) -> Result<(), StepFailure> {
        let material = (self.material)(share);
        let operator = Operator {
            material: &material,
            activity: self.activity,
            body_load,
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
                        && !same_basin(&operator, self.laplacian, before, u, workspace)
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

fn ending(failure: StepFailure, stable: f64, unstable: f64) -> LoadingEnd {
    match failure {
        StepFailure::Unknown => LoadingEnd::Unknown { stable },
        StepFailure::Work => LoadingEnd::WorkLimit { stable },
        StepFailure::Lost(loss) => LoadingEnd::Lost { stable, unstable, loss },
    }
}
