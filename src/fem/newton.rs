//! Inexact Newton iteration at one load.
//!
//! The forcing terms are those of Eisenstat and Walker (SIAM J. Sci. Comput. 17 (1996) 16), choice 2; γ = 0.9 and α =
//! 1.3 were slightly faster than fourteen other pairs. A step is halved until no element is inverted and the residual
//! falls. Residuals are in double precision, steps in single precision: rounding adds to the inexactness of a step.

use std::sync::Arc;

use crate::registers::dispatch_widest;

use deaflow_base::{Stream, is_interrupted};

use super::direct::{Factorisation, Structure};
use super::krylov::{self, KrylovEnd, conjugate_gradients};
use super::material::Material;
use super::operator::Operator;
use super::precondition::{Laplacian, LaplacianScratch};
use super::work::{SWEEP, WorkLimit, factors};

/// Why the iteration stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewtonFailure {
    /// The tangent is not positive definite.
    NegativeCurvature,
    /// No step along the Newton direction reduces the residual.
    LineSearch,
    /// Too many steps.
    Limit,
    /// The work limit was reached, or the computation was interrupted.
    Work,
}

/// Number of Newton steps and final relative residual.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Number of steps.
    pub steps: u32,
    /// ‖R‖/‖R(u = 0)‖.
    pub residual: f64,
}

/// A residual at rest that serves several iterations in time.
#[derive(Clone, Copy, Debug)]
struct Reference {
    load: f64,
    residual: f64,
    /// Number of uses left.
    uses: u32,
}

impl Reference {
    /// Returns it for another use while the load is the same.
    fn reused(self, load: f64) -> Option<Self> {
        let uses = self.uses.checked_sub(1).filter(|_| self.load == load)?;
        Some(Self { uses, ..self })
    }
}

/// The vectors of the iteration.
pub struct Workspace {
    residual: Vec<f64>,
    trial: Vec<f64>,
    trial_residual: Vec<f64>,
    /// The displacement in single precision, for the tangent.
    single: Vec<f32>,
    /// Moduli of the tangent at the points.
    moduli: Vec<f32>,
    krylov: krylov::Scratch,
    laplacian: LaplacianScratch,
    /// The structure of the tangent after its first factorisation.
    structure: Option<Arc<Structure>>,
    limit: WorkLimit,
    /// Whether iterations start near their end.
    near: bool,
    /// The reference of relative residuals.
    reference: Option<Reference>,
    /// Work other than conjugate gradients, and their iterations before the count began.
    other_work: u64,
    iterations_before: u32,
}

impl Workspace {
    /// Creates vectors of a length, with the default work limit.
    #[must_use]
    pub fn new(len: usize, laplacian: &Laplacian) -> Self {
        Self {
            residual: vec![0.0; len],
            trial: vec![0.0; len],
            trial_residual: vec![0.0; len],
            single: vec![0.0; len],
            moduli: Vec::new(),
            krylov: krylov::Scratch::new(len),
            laplacian: laplacian.scratch(),
            structure: None,
            limit: WorkLimit::default(),
            near: false,
            reference: None,
            other_work: 0,
            iterations_before: 0,
        }
    }

    /// Prepares for iterations that start near their end, such as time steps: the first step is then a full linear one,
    /// with one system instead of two.
    #[must_use]
    pub fn near(self) -> Self {
        Self { near: true, ..self }
    }

    /// Makes later residuals relative to those at rest of the next problem, while its load stays the same.
    pub fn refer_anew(&mut self) {
        self.reference = None;
    }

    /// Starts counting work against a new limit.
    pub fn begin(&mut self, limit: WorkLimit) {
        self.limit = limit;
        self.begin_again();
    }

    /// Starts counting work.
    pub fn begin_again(&mut self) {
        self.other_work = 0;
        self.iterations_before = self.krylov.iterations;
    }

    /// Returns the work since the count began, in the units of [`WorkLimit`].
    #[must_use]
    pub fn work(&self) -> u64 {
        self.other_work + u64::from(self.krylov.iterations - self.iterations_before)
    }

    /// Returns whether the work limit is reached, or the computation is interrupted.
    #[must_use]
    pub fn is_spent(&self) -> bool {
        self.limit.is_spent(self.work()) || is_interrupted()
    }

    /// Factorises the tangent at `u`; `None` if a pivot is zero, memory is short, or the computation is interrupted.
    pub fn factorise<L: Material>(&mut self, operator: &Operator<'_, L>, u: &[f64]) -> Option<Factorisation> {
        self.other_work += factors(u.len());
        if is_interrupted() {
            return None;
        }
        if self.structure.is_none() {
            self.structure = Structure::new(operator.activity.grid());
        }
        self.structure.as_ref()?.factorise(operator, u)
    }

    /// Returns the conjugate-gradient iterations of all solutions with these vectors.
    #[must_use]
    pub fn krylov_iterations(&self) -> u32 {
        self.krylov.iterations
    }

    /// Converts a displacement to single precision.
    pub fn single(&mut self, u: &[f64]) -> &[f32] {
        narrow(u, 1.0, &mut self.single);
        &self.single
    }
}

const MAX_STEPS: u32 = 25;
const MAX_HALVINGS: u32 = 8;
/// Number of time steps with the same reference.
const REFERENCE_USES: u32 = 8;
/// First and largest forcing term.
const MAX_FORCING: f64 = 0.02;
/// Smallest forcing term that single precision reaches.
const MIN_FORCING: f64 = 1e-5;
/// Residual at which a probe of the tangent has seen every mode.
const PROBE_TOLERANCE: f64 = 1e-5;
/// Residual at rest per load and element below which it is rounding: the pattern is uniform or the voltage zero.
const ROUNDING: f64 = 1e-14;

/// Moves `u` to a nearby equilibrium, until the residual is `tolerance` times that of the undisplaced membrane.
///
/// # Errors
/// If it does not converge, with the progress; `u` is then the last iterate.
pub fn solve<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    tolerance: f64,
    u: &mut [f64],
    workspace: &mut Workspace,
) -> Result<Progress, (NewtonFailure, Progress)> {
    let load = operator.material.load();
    // The loads of elements are rounded even if their forces cancel.
    let rounding = (ROUNDING * load).max(operator.rounding());
    let is_displaced = u.iter().any(|&u| u != 0.0);
    let known = workspace.reference.filter(|_| workspace.near && is_displaced);
    let reference = match known.and_then(|known| known.reused(load)) {
        Some(known) => known,
        None => {
            workspace.trial.fill(0.0);
            operator.residual_at_rest(&workspace.trial, &mut workspace.residual);
            let given = force_of_given_motions(operator, workspace);
            if largest(&workspace.residual) <= rounding && given == 0.0 {
                u.fill(0.0);
                return Ok(Progress {
                    steps: 0,
                    residual: 0.0,
                });
            }
            Reference {
                load,
                residual: norm(&workspace.residual) + given,
                uses: REFERENCE_USES,
            }
        }
    };
    workspace.reference = Some(reference);
    let reference = reference.residual;
    let mut size = reference;
    if is_displaced {
        operator.residual(u, &mut workspace.residual);
        size = norm(&workspace.residual);
    }
    let goal = (tolerance * reference).max(rounding * (u.len() as f64).sqrt());
    // The residual after a Newton step is of the order of the square of the one before.
    let mut forcing = match workspace.near {
        true => size / reference,
        false => MAX_FORCING,
    };
    for steps in 0..MAX_STEPS {
        let progress = Progress {
            steps,
            residual: size / reference,
        };
        if size <= goal {
            return Ok(progress);
        }
        if workspace.is_spent() {
            return Err((NewtonFailure::Work, progress));
        }
        // The last step need not be more accurate than the goal.
        let inner = forcing.max(0.5 * goal / size).clamp(MIN_FORCING, MAX_FORCING);
        find_step(operator, laplacian, inner, size, u, workspace).map_err(|trouble| (trouble, progress))?;
        let Some(new_size) = line_search(operator, size, u, workspace) else {
            return Err((NewtonFailure::LineSearch, progress));
        };
        forcing = 0.9 * (new_size / size).powf(1.3);
        size = new_size;
    }
    let progress = Progress {
        steps: MAX_STEPS,
        residual: size / reference,
    };
    if size <= goal {
        Ok(progress)
    } else {
        Err((NewtonFailure::Limit, progress))
    }
}

/// Part of the given motions at which their force is measured: in full they may invert elements.
const SMALL_PART: f64 = 1e-3;

/// Returns the norm of the forces that the given motions of bars cause in an undisplaced membrane, to first order; 0
/// without any. The residual of the undisplaced membrane is in the workspace.
fn force_of_given_motions<L: Material>(operator: &Operator<'_, L>, workspace: &mut Workspace) -> f64 {
    let Workspace {
        residual,
        trial,
        trial_residual,
        ..
    } = workspace;
    let supports = operator.activity.grid().supports();
    let Some(supports) = supports.filter(|supports| supports.has_given_motions()) else {
        return 0.0;
    };
    trial.fill(0.0);
    supports.give_motions(SMALL_PART * operator.body_load, trial);
    operator.residual(trial, trial_residual);
    trial_residual
        .iter_mut()
        .zip(&*residual)
        .for_each(|(moved, rest)| *moved -= rest);
    norm(trial_residual) / SMALL_PART
}

/// Gives bars a share of their given motions, and moves the membrane with them by the solution of Laplace's equation.
pub fn give_motions<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    u: &mut [f64],
    workspace: &mut Workspace,
) {
    let grid = operator.activity.grid();
    let Some(supports) = grid.supports().filter(|supports| supports.has_given_motions()) else {
        return;
    };
    let before = u.to_vec();
    supports.give_motions(operator.body_load, u);
    let change: Vec<f64> = u.iter().zip(&before).map(|(u, before)| u - before).collect();
    operator.laplacian(&before, &change, &mut workspace.residual);
    let size = norm(&workspace.residual);
    if size == 0.0 {
        return;
    }
    narrow(&workspace.residual, 1.0 / size, &mut workspace.krylov.residual);
    let poses = grid.poses(u);
    let Workspace {
        krylov,
        laplacian: scratch,
        ..
    } = workspace;
    laplacian.solve(&krylov.residual, &poses, &mut krylov.solution, scratch);
    let correction = u.iter_mut().zip(&krylov.solution);
    correction.for_each(|(u, change)| *u -= size * f64::from(*change));
    grid.settle(u);
}

/// Settings of chord steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChordSteps {
    /// Number of steps.
    pub count: u32,
    /// Relative residual of each linear solution.
    pub inner: f64,
    /// Unit of energy of the linear operator relative to that of the actual one.
    pub unit: f64,
}

/// Makes steps −A⁻¹R from `u` with one matrix A, the tangent of `linear` at rest; `rest` is zero everywhere. The
/// returned residual is relative to that at the start.
///
/// # Errors
/// If A is not positive definite or a step inverts an element, with the progress.
pub fn chord<L: Material>(
    [actual, linear]: [&Operator<'_, L>; 2],
    laplacian: &Laplacian,
    ChordSteps { count, inner, unit }: ChordSteps,
    rest: &[f64],
    u: &mut [f64],
    workspace: &mut Workspace,
) -> Result<Progress, (NewtonFailure, Progress)> {
    actual.residual(u, &mut workspace.residual);
    let mut progress = Progress {
        steps: 0,
        residual: 0.0,
    };
    if largest(&workspace.residual) <= (ROUNDING * actual.material.load()).max(actual.rounding()) {
        return Ok(progress);
    }
    let reference = norm(&workspace.residual);
    let mut size = reference;
    for _ in 0..count {
        progress.residual = size / reference;
        find_step(linear, laplacian, inner, size, rest, workspace).map_err(|trouble| (trouble, progress))?;
        advance(u, -size / unit, &workspace.krylov.solution, &mut workspace.trial);
        actual.activity.grid().settle(&mut workspace.trial);
        u.copy_from_slice(&workspace.trial);
        if actual.residual(u, &mut workspace.residual) <= 0.0 {
            return Err((NewtonFailure::LineSearch, progress));
        }
        progress.steps += 1;
        size = norm(&workspace.residual);
    }
    progress.residual = size / reference;
    Ok(progress)
}

/// Solves A ψ = `load` with the tangent A at `u`, until the residual is `tolerance` times the load; each
/// single-precision solution corrects the remaining residual.
///
/// # Errors
/// If the tangent is not positive definite, or single precision does not reduce the residual.
pub fn solve_tangent<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    tolerance: f64,
    u: &[f64],
    load: &[f64],
    workspace: &mut Workspace,
) -> Result<Vec<f64>, NewtonFailure> {
    let mut solution = vec![0.0; load.len()];
    let reference = norm(load);
    workspace.residual.copy_from_slice(load);
    for _ in 0..MAX_STEPS {
        let size = norm(&workspace.residual);
        if size <= tolerance * reference {
            return Ok(solution);
        }
        find_step(operator, laplacian, 1e-4, size, u, workspace)?;
        advance(&solution, size, &workspace.krylov.solution, &mut workspace.trial);
        solution.copy_from_slice(&workspace.trial);
        operator.tangent(u, &solution, &mut workspace.trial_residual);
        let pairs = load.iter().zip(&workspace.trial_residual);
        workspace
            .residual
            .iter_mut()
            .zip(pairs)
            .for_each(|(r, (load, image))| *r = load - image);
    }
    Err(NewtonFailure::Limit)
}

/// Computes the Newton step −A⁻¹R, divided by −‖R‖, into the solution of the Krylov workspace: by conjugate gradients,
/// or by a factorisation if they take too long, as near a loss of stability.
fn find_step<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    goal: f64,
    size: f64,
    u: &[f64],
    workspace: &mut Workspace,
) -> Result<(), NewtonFailure> {
    let Workspace {
        residual,
        single,
        moduli,
        krylov,
        laplacian: scratch,
        other_work,
        ..
    } = workspace;
    *other_work += SWEEP;
    narrow(u, 1.0, single);
    operator.linearise(single, moduli);
    narrow(residual, 1.0 / size, &mut krylov.residual);
    let poses = operator.activity.grid().poses(u);
    let ending = conjugate_gradients(
        goal,
        krylov,
        |p, image| operator.tangent_at(single, moduli, p, image),
        |r, z| laplacian.solve(r, &poses, z, scratch),
    );
    match ending {
        KrylovEnd::Converged => Ok(()),
        KrylovEnd::NegativeCurvature => Err(NewtonFailure::NegativeCurvature),
        KrylovEnd::Limit => {
            let factors = workspace
                .factorise(operator, u)
                .ok_or(NewtonFailure::NegativeCurvature)?;
            if factors.negative_pivots() > 0 {
                return Err(NewtonFailure::NegativeCurvature);
            }
            let step = factors.solve(&workspace.residual);
            narrow(&step, 1.0 / size, &mut workspace.krylov.solution);
            Ok(())
        }
    }
}

/// Runs conjugate gradients with the tangent at `u`, minus `shift` times the Laplacian, on a random load. The load
/// contains every mode, so the iteration converges only without negative eigenvalues.
pub fn probe<L: Material>(
    operator: &Operator<'_, L>,
    laplacian: &Laplacian,
    shift: f32,
    u: &[f64],
    workspace: &mut Workspace,
) -> KrylovEnd {
    let mut stream = Stream::new(0, "stability probe", 0);
    let load = operator.activity.grid().random_load(&mut stream, u);
    if load.iter().all(|force| *force == 0.0) {
        // All nodes are fixed by the frame.
        return KrylovEnd::Converged;
    }
    let Workspace {
        single,
        moduli,
        krylov,
        laplacian: scratch,
        ..
    } = workspace;
    narrow(u, 1.0, single);
    operator.linearise(single, moduli);
    narrow(&load, 1.0 / norm(&load), &mut krylov.residual);
    let poses = operator.activity.grid().poses(u);
    let mut harmonic = vec![0.0; if shift > 0.0 { single.len() } else { 0 }];
    conjugate_gradients(
        PROBE_TOLERANCE,
        krylov,
        |p, image| {
            operator.tangent_at(single, moduli, p, image);
            if shift > 0.0 {
                operator.laplacian(single, p, &mut harmonic);
                image.iter_mut().zip(&harmonic).for_each(|(k, l)| *k -= shift * l);
            }
        },
        |r, z| laplacian.solve(r, &poses, z, scratch),
    )
}

/// Moves `u` along the step until the residual falls; returns the new norm.
fn line_search<L: Material>(
    operator: &Operator<'_, L>,
    size: f64,
    u: &mut [f64],
    workspace: &mut Workspace,
) -> Option<f64> {
    let Workspace {
        residual,
        trial,
        trial_residual,
        krylov,
        other_work,
        ..
    } = workspace;
    let mut length = 1.0;
    for _ in 0..=MAX_HALVINGS {
        *other_work += SWEEP;
        advance(u, -length * size, &krylov.solution, trial);
        operator.activity.grid().settle(trial);
        let smallest = operator.residual(trial, trial_residual);
        let new_size = norm(trial_residual);
        if smallest > 0.0 && new_size < (1.0 - 1e-4 * length) * size {
            u.copy_from_slice(trial);
            std::mem::swap(residual, trial_residual);
            return Some(new_size);
        }
        length *= 0.5;
    }
    None
}

/// Euclidean norm, summed in an order that depends on the length alone.
#[must_use]
pub fn norm(a: &[f64]) -> f64 {
    dispatch_widest(
        #[inline(always)]
        || {
            let mut sums = [0.0; 32];
            let chunks = a.chunks_exact(32);
            let rest: f64 = chunks.remainder().iter().map(|a| a * a).sum();
            for chunk in chunks {
                sums.iter_mut().zip(chunk).for_each(|(sum, a)| *sum += a * a);
            }
            (sums.iter().sum::<f64>() + rest).sqrt()
        },
    )
}

/// Largest absolute value.
#[must_use]
pub fn largest(a: &[f64]) -> f64 {
    a.iter().fold(0.0, |largest: f64, a| largest.max(a.abs()))
}

fn narrow(from: &[f64], factor: f64, to: &mut [f32]) {
    dispatch_widest(
        #[inline(always)]
        || {
            to.iter_mut()
                .zip(from)
                .for_each(|(to, from)| *to = (factor * from) as f32)
        },
    );
}

/// trial ← u + α · step.
fn advance(u: &[f64], alpha: f64, step: &[f32], trial: &mut [f64]) {
    dispatch_widest(
        #[inline(always)]
        || {
            let pairs = u.iter().zip(step);
            trial
                .iter_mut()
                .zip(pairs)
                .for_each(|(trial, (u, step))| *trial = u + alpha * f64::from(*step));
        },
    );
}
