//! From rest to the full load.
//!
//! The full load is tried at once. Only where that does not lead to a stable equilibrium the load, which is proportional
//! to V², is raised in steps from the last stable state; steps that fail are halved until the loss of stability lies
//! between two voltages one part in a thousand apart.

use super::energy::Law;
use super::mesh::Mesh;
use super::newton::{self, Trouble, Workspace};
use super::operator::{Activity, Operator};
use super::precondition::Laplacian;
use super::stability::{Stability, judge};

/// How the loading ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ending {
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
    /// The iteration did not end; nothing is known.
    Unknown,
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
    pub ending: Ending,
    /// Newton steps over all load steps, failed ones included.
    pub steps: u32,
    /// Relative residual of the last attempt.
    pub residual: f64,
    /// Whether the last stable state is stable beyond doubt: see [`Stability::Stable`].
    pub pointwise: bool,
}

/// Why a load step is not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Refusal {
    Lost(Loss),
    Limit,
}

/// Relative width of the bracket in load: one part in a thousand of voltage.
const BRACKET: f64 = 2e-3;
/// Load steps before the loading is given up.
const MAX_LOAD_STEPS: u32 = 200;

/// One membrane under a load that can be scaled.
pub struct Problem<'a, F> {
    /// Where.
    pub mesh: Mesh,
    /// Where it is active.
    pub activity: &'a Activity,
    /// The preconditioner.
    pub laplacian: &'a Laplacian,
    /// The law at a share of the full load.
    pub law: F,
    /// Relative residual at which an equilibrium counts as found.
    pub tolerance: f64,
}

impl<L: Law, F: Fn(f64) -> L> Problem<'_, F> {
    /// Moves `u`, whatever it was, from rest to the full load, or to the last stable state on the way there.
    pub fn load(&self, u: &mut [f64], workspace: &mut Workspace) -> Loading {
        u.fill(0.0);
        let mut total = Loading {
            ending: Ending::Unknown,
            steps: 0,
            residual: 0.0,
            pointwise: false,
        };
        let (mut stable, mut step) = (0.0, 1.0);
        let mut reached: Option<Vec<f64>> = None;
        for _ in 0..MAX_LOAD_STEPS {
            let share: f64 = stable + step;
            match self.attempt(share, u, workspace, &mut total) {
                Ok(()) if share >= 1.0 => {
                    total.ending = Ending::Stable;
                    return total;
                }
                Ok(()) => {
                    reached.get_or_insert_with(|| vec![0.0; u.len()]).copy_from_slice(u);
                    stable = share;
                    step = (1.5 * step).min(1.0 - stable);
                }
                Err(refusal) => {
                    match &reached {
                        Some(reached) => u.copy_from_slice(reached),
                        None => u.fill(0.0),
                    }
                    if step <= BRACKET * share {
                        total.ending = ending(refusal, stable, share);
                        return total;
                    }
                    step = (0.5 * step).min(self.largest_step(stable));
                }
            }
        }
        total
    }

    /// The largest step worth a try from rest; huge voltages come down to it at once.
    fn largest_step(&self, stable: f64) -> f64 {
        let law = (self.law)(1.0);
        if stable > 0.0 {
            f64::INFINITY
        } else {
            law.largest_load() / law.load()
        }
    }

    fn attempt(
        &self,
        share: f64,
        u: &mut [f64],
        workspace: &mut Workspace,
        total: &mut Loading,
    ) -> Result<(), Refusal> {
        let law = (self.law)(share);
        let operator = Operator {
            mesh: self.mesh,
            law: &law,
            activity: self.activity,
        };
        let result = newton::solve(&operator, self.laplacian, self.tolerance, u, workspace);
        let (Ok(progress) | Err((_, progress))) = result;
        total.steps += progress.steps;
        total.residual = progress.residual;
        match result {
            Ok(_) => match judge(&operator, self.laplacian, u, workspace) {
                Stability::Stable { pointwise } => {
                    total.pointwise = pointwise;
                    Ok(())
                }
                Stability::Unstable => Err(Refusal::Lost(Loss::Stability)),
                Stability::NotElliptic => Err(Refusal::Lost(Loss::Ellipticity)),
                Stability::Slack => Err(Refusal::Lost(Loss::Tension)),
            },
            Err((Trouble::NegativeCurvature | Trouble::LineSearch, _)) => Err(Refusal::Lost(Loss::Stability)),
            Err((Trouble::Limit, _)) => Err(Refusal::Limit),
        }
    }
}

fn ending(refusal: Refusal, stable: f64, unstable: f64) -> Ending {
    match refusal {
        Refusal::Limit => Ending::Unknown,
        Refusal::Lost(loss) => Ending::Lost { stable, unstable, loss },
    }
}
