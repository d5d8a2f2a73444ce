//! From rest to the full load.
//!
//! The full load is tried at once. Only where that does not lead to a stable equilibrium the load, which is proportional
//! to V², is raised in steps from the last stable state; steps that fail are halved until the loss of stability lies
//! between two voltages one part in a thousand apart.

use super::material::Material;
use super::newton::{self, NewtonFailure, Workspace};
use super::operator::{Activity, Operator};
use super::precondition::Laplacian;
use super::stability::{Stability, judge, same_basin};
use super::supports::Supports;

/// How the loading ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadingEnd {
    /// A stable equilibrium at the full load.
    Stable,
    /// Stability is lost between two shares of the full load.
    Lost {
        /// The highest share at which a stable equilibrium was found.
        stable: f64,
        /// The lowest share at which none was found.
        unstable: f64,
        /// What went first.
        loss: Loss,
    },
    /// The iteration did not end; nothing is known beyond a stable equilibrium.
    Unknown {
        /// The share at which that was found; 0 is rest.
        stable: f64,
    },
    /// The work that is allowed is done; nothing is known beyond a stable equilibrium.
    WorkLimit {
        /// The share at which that was found; 0 is rest.
        stable: f64,
    },
}

impl LoadingEnd {
    /// The highest share of the full load at which a stable equilibrium was found; 0 is rest.
    pub fn stable(self) -> f64 {
        match self {
            Self::Stable => 1.0,
            Self::Lost { stable, .. } | Self::Unknown { stable } | Self::WorkLimit { stable } => stable,
        }
    }
}

/// What an equilibrium can lose on the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// Stability.
    Stability,
    /// Ellipticity.
    Ellipticity,
    /// Tension, in a membrane that wrinkles.
    Tension,
}

/// The end of the loading and the work that it took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loading {
    /// How it ended.
    pub ending: LoadingEnd,
    /// Newton steps over all load steps, failed ones included.
    pub steps: u32,
    /// Relative residual of the last attempt.
    pub residual: f64,
    /// Whether the last stable state is stable beyond doubt: see [`Stability::Stable`].
    pub pointwise: bool,
}

impl Loading {
    /// Nothing done yet, from a share.
    fn from(stable: f64) -> Self {
        Self {
            ending: LoadingEnd::Unknown { stable },
            steps: 0,
            residual: 0.0,
            pointwise: false,
        }
    }
}

/// Why a load step is not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StepFailure {
    Lost(Loss),
    Limit,
    Work,
}

/// Relative width of the bracket in load: one part in a thousand of voltage.
const BRACKET: f64 = 2e-3;
/// Prestress, in units of μλp², that is none.
const LOOSE: f64 = 1e-9;
/// Load steps before the loading is given up.
const MAX_LOAD_STEPS: u32 = 200;

/// The first step of a search for a loss between two loads, in units of their difference.
const FIRST: f64 = 0.5;

/// Where loading begins and ends, as shares of the full load.
#[derive(Clone, Copy, Debug)]
pub struct LoadRange {
    /// The share of the state that it begins with.
    pub from: f64,
    /// The share that is wanted.
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

/// One membrane under a load that can be scaled.
pub struct Problem<'a, F> {
    /// Its elements, and where it is active.
    pub activity: &'a Activity,
    /// The preconditioner.
    pub laplacian: &'a Laplacian,
    /// The law at a share of the full load.
    pub material: F,
    /// Relative residual at which an equilibrium counts as found.
    pub tolerance: f64,
}

impl<L: Material, F: Fn(f64) -> L> Problem<'_, F> {
    /// Moves `u`, whatever it was, from rest to the full load, or to the last stable state on the way there.
    pub fn load(&self, u: &mut [f64], workspace: &mut Workspace) -> Loading {
        match self.rest(u, workspace) {
            Ok(()) => self.raise_load(LoadRange::FROM_REST, u, workspace),
            Err(loading) => loading,
        }
    }

    /// Moves `u`, whatever it was, to rest: the state without voltage, in which only the loads of bodies pull.
    ///
    /// # Errors
    /// When these are more than the membrane bears.
    pub fn rest(&self, u: &mut [f64], workspace: &mut Workspace) -> Result<(), Loading> {
        u.fill(0.0);
        if !self.is_loaded() {
            return Ok(());
        }
        let mut total = Loading::from(0.0);
        let (mut borne, mut step) = (0.0, 1.0_f64);
        let mut reached = u.to_vec();
        workspace.begin_again();
        for _ in 0..MAX_LOAD_STEPS {
            let pulled = f64::min(borne + step, 1.0);
            match self.attempt([0.0, pulled], Some(&reached), u, workspace, &mut total) {
                Ok(()) if pulled >= 1.0 => return Ok(()),
                Ok(()) => {
                    borne = pulled;
                    reached.copy_from_slice(u);
                }
                Err(refusal) => {
                    u.copy_from_slice(&reached);
                    if refusal == StepFailure::Work || step <= BRACKET {
                        total.ending = ending(refusal, 0.0, 0.0);
                        return Err(total);
                    }
                    step *= 0.5;
                }
            }
        }
        Err(total)
    }

    /// Whether bodies are pulled.
    fn is_loaded(&self) -> bool {
        self.activity.grid().supports().is_some_and(Supports::is_loaded)
    }

    /// How loading to a share ends, from rest, where stability is expected to be lost between a lower share and that one. `u` is
    /// then the last stable state.
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
            step: FIRST * (high - low),
        };
        self.raise_load(search, u, workspace).ending
    }

    /// Moves `u` on from a stable state, to a higher load or to the last stable state on the way there.
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
                    // Right after a failure a longer step would fail again: the search would shrink by a quarter, not by half.
                    step = if failed { step } else { 1.5 * step }.min(range.to - stable);
                    failed = false;
                }
                Err(refusal) => {
                    failed = true;
                    match &reached {
                        Some(reached) => u.copy_from_slice(reached),
                        None => u.fill(0.0),
                    }
                    if refusal == StepFailure::Work {
                        total.ending = ending(refusal, stable, share);
                        return total;
                    }
                    if stable == 0.0 && refusal != StepFailure::Limit && self.is_loose_at_rest() {
                        let loss = Loss::Tension;
                        total.ending = ending(StepFailure::Lost(loss), stable, share);
                        return total;
                    }
                    if step <= BRACKET * share {
                        total.ending = ending(refusal, stable, share);
                        return total;
                    }
                    step = (0.5 * step).min(self.largest_step(stable));
                }
            }
            // A membrane that does not move takes no Newton step that would notice.
            if workspace.is_spent() {
                total.ending = LoadingEnd::WorkLimit { stable };
                return total;
            }
        }
        total.ending = LoadingEnd::Unknown { stable };
        total
    }

    /// Whether the membrane bears no compression and has no prestress to lose: then any load that moves it takes all tension
    /// from somewhere, and there is no first stable state to look for.
    fn is_loose_at_rest(&self) -> bool {
        let identity = [[1.0, 0.0], [0.0, 1.0]];
        let unloaded = (self.material)(0.0);
        unloaded.wrinkles() && unloaded.self_stress(identity)[0][0].abs() < LOOSE
    }

    /// The largest step worth a try from rest; huge voltages come down to it at once.
    fn largest_step(&self, stable: f64) -> f64 {
        let material = (self.material)(1.0);
        if stable > 0.0 {
            f64::INFINITY
        } else {
            material.largest_load() / material.load()
        }
    }

    /// `shares` are those of the full load and of the loads of bodies.
    fn attempt(
        &self,
        [share, pulled]: [f64; 2],
        before: Option<&[f64]>,
        u: &mut [f64],
        workspace: &mut Workspace,
        total: &mut Loading,
    ) -> Result<(), StepFailure> {
        let material = (self.material)(share);
        let operator = Operator {
            material: &material,
            activity: self.activity,
            pulled,
        };
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
                Stability::Unstable => Err(StepFailure::Lost(Loss::Stability)),
                Stability::NotElliptic => Err(StepFailure::Lost(Loss::Ellipticity)),
                Stability::Slack => Err(StepFailure::Lost(Loss::Tension)),
            },
            Err((NewtonFailure::NegativeCurvature | NewtonFailure::LineSearch, _)) => {
                Err(StepFailure::Lost(Loss::Stability))
            }
            Err((NewtonFailure::Limit, _)) => Err(StepFailure::Limit),
            Err((NewtonFailure::Work, _)) => Err(StepFailure::Work),
        }
    }
}

fn ending(refusal: StepFailure, stable: f64, unstable: f64) -> LoadingEnd {
    match refusal {
        StepFailure::Limit => LoadingEnd::Unknown { stable },
        StepFailure::Work => LoadingEnd::WorkLimit { stable },
        StepFailure::Lost(loss) => LoadingEnd::Lost { stable, unstable, loss },
    }
}
