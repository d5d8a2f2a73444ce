//! How patterns move in time.

use std::cell::Cell;

use super::bodies;
use super::extrapolation::Extrapolation;
use super::leads::Conductor;
use super::march::IN_PERIOD;
use super::modes::wave_speed;
use super::motion::Motion;
use super::pass::{Instant, MOST_STEPS, NEGLIGIBLE, Pass, PassEnd, Steps};
use super::supply::Supply;
use super::transient::{Estimate, FixedCharge, StepEstimate, TransientProblem};
use crate::charge;
use crate::continuation::Loss;
use crate::effects::WithMaterial;
use crate::error::SetupError;
use crate::mass::Mass;
use crate::material::Material;
use crate::operator::Activity;
use crate::precondition::Laplacian;
use crate::solver::MembraneSolver;
use crate::work::WorkLimit;
use deaflow_field::{Field, Outcome};
use deaflow_pattern::Pattern;
use deaflow_scene::{Scene, ViscousLaw};

/// Error in time, in units of the largest displacement at each time, unless another is asked for.
pub const USUAL_ERROR: f64 = 2e-5;
/// Error of a step of the first pass over what is wanted at the times that were asked for: what a step errs is forgotten while the membrane
/// relaxes, and passes with shorter steps follow where that is not enough.
const LOOSE: f64 = 30.0;
/// The same of a first pass that others follow, of which three are extrapolated: with steps twice as long.
const LOOSER: f64 = 240.0;
/// Difference between the times at which two passes lose the last stable state that is none, over these.
const TOGETHER: f64 = 3e-4;
/// Steps of the first pass over the shortest time of a motion.
const STEPS_IN_PERIOD: f64 = 40.0;
/// Times that the steps of the first pass are halved at most.
const MOST_HALVINGS: u32 = 6;
/// From so many on errors that hardly fall end them.
const PATIENCE: u32 = 4;
/// The same of a motion.
const MOST_HALVINGS_OF_MOTION: u32 = 5;
/// What an estimated error is multiplied by where it is one of fourth order.
const SAFETY: f64 = 3.0;

/// What is asked of a history.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoryRequest {
    /// The times in s at which fields are wanted, in order, from 0 on. 0 s is just after the drive has begun.
    pub times: Vec<f64>,
    /// The largest error in mm that steps in time may leave; a small part of the displacement where none is asked for.
    pub accuracy_mm: Option<f64>,
    /// Work for all steps of a pattern on a mesh.
    pub limit: WorkLimit,
    /// How states are estimated, where they are not solved for; the steps are then those of a first pass.
    pub estimate: Option<StepEstimate>,
    /// Whether charges, energies and magnitudes of each instant are wanted beside the fields that are asked for; they are 0 where not.
    pub measures: bool,
}

impl HistoryRequest {
    /// Fields at some times, within the usual error and work.
    #[must_use]
    pub fn at(times: Vec<f64>) -> Self {
        Self {
            times,
            accuracy_mm: None,
            limit: WorkLimit::of_history(None),
            estimate: None,
            measures: true,
        }
    }
}

/// Why states of a scene cannot be estimated step by step, if they cannot.
fn refusal_of_estimates(scene: &Scene) -> Option<SetupError> {
    let effects = &scene.effects;
    let law = effects.viscoelasticity.as_ref().map(|effect| effect.law);
    let has = [
        (scene.drive.charge.is_some(), "a voltage, and the drive is a `charge`"),
        (effects.inertia.is_some(), "creep alone, and the scene has `inertia`"),
        (
            effects.electrode_resistance.is_some() || scene.drive.source.is_some(),
            "electrodes that have their voltage at once, and the scene has a `source` or `electrode_resistance`",
        ),
        (
            law.is_none(),
            "an elastomer that creeps, and the scene has no `viscoelasticity`",
        ),
        (
            law == Some(ViscousLaw::Finite),
            "the linear law, and the scene has another",
        ),
    ];
    let why = has.into_iter().find_map(|(has, why)| has.then_some(why))?;
    Some(SetupError::StepEstimates { why })
}

/// How a pattern moves in time.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// How it ended.
    pub outcome: Outcome,
    /// The membrane after each step, two at a jump, as far as there is a stable state.
    pub instants: Vec<Instant>,
    /// Which of these are at the times that were asked for.
    pub kept: Vec<usize>,
    /// The displacement at the times that were asked for, as far as there is a stable state: with inertia extrapolated to no step.
    pub fields: Vec<Field>,
    /// The corner (column, row) that moves most at the last time that was asked for.
    pub watched: [usize; 2],
    /// Estimate of the largest error in mm that steps in time leave in the fields; none where it is not known.
    pub time_error_mm: Option<f64>,
    /// Steps in time of all passes.
    pub steps: usize,
    /// Newton steps of all passes.
    pub newton_steps: u32,
    /// Relative residual at the end of the last step.
    pub residual: f64,
}

impl History {
    /// The membrane at the times that were asked for, as far as there is a stable state.
    pub fn asked(&self) -> impl Iterator<Item = &Instant> {
        self.kept.iter().map(|&at| &self.instants[at])
    }

    /// The largest difference in mm from another history at the times that both got to.
    #[must_use]
    pub fn difference(&self, other: &Self) -> f64 {
        let pairs = self.fields.iter().zip(&other.fields);
        pairs.map(|(a, b)| a.max_difference(b)).fold(0.0, f64::max)
    }

    /// The current into the electrodes in A at each instant: the slope of the charge, of second order within the smooth parts of a waveform.
    #[must_use]
    pub fn current(&self) -> Vec<f64> {
        let slope = |a: &Instant, b: &Instant| (b.charge - a.charge) / (b.time - a.time);
        let at = |at: usize| {
            let here = &self.instants[at];
            let before = at
                .checked_sub(1)
                .map(|at| &self.instants[at])
                .filter(|before| before.time < here.time);
            let after = self.instants.get(at + 1).filter(|after| after.time > here.time);
            match (before, after) {
                (Some(before), Some(after)) => {
                    let [left, right] = [here.time - before.time, after.time - here.time];
                    (right * slope(before, here) + left * slope(here, after)) / (left + right)
                }
                (Some(before), None) => slope(before, here),
                (None, Some(after)) => slope(here, after),
                (None, None) => 0.0,
            }
        };
        (0..self.instants.len()).map(at).collect()
    }
}

/// Why a scene whose effects are decided cannot be followed in time, if it cannot.
#[must_use]
pub fn refusal(scene: &Scene) -> Option<SetupError> {
    let charges =
        scene.drive.source.is_some() || scene.drive.charge.as_ref().is_some_and(|charge| charge.total.is_some());
    if charges && scene.effects.inertia.is_some() && scene.effects.wrinkling.is_some() {
        return Some(SetupError::MovingCharge);
    }
    if scene.effects.electrode_resistance.is_some() {
        if scene.leads.is_none() {
            return Some(SetupError::Leads);
        }
        if let Some(with) = scene.conflict_of_resistance(&scene.effects) {
            return Some(SetupError::Resistance { with });
        }
    }
    None
}

/// Whether a scene whose effects are decided can be followed in time.
///
/// # Errors
/// When it cannot.
pub fn check(scene: &Scene) -> Result<(), SetupError> {
    refusal(scene).map_or(Ok(()), Err)
}

/// Whether it can with states that are estimated.
///
/// # Errors
/// When it cannot.
pub fn check_estimates(scene: &Scene) -> Result<(), SetupError> {
    check(scene)?;
    refusal_of_estimates(scene).map_or(Ok(()), Err)
}

impl MembraneSolver {
    /// How a pattern moves in the time of the drive.
    ///
    /// # Errors
    /// When the scene cannot be followed in time: with what, `refusal` says.
    pub fn history(&self, pattern: &Pattern, request: &HistoryRequest) -> Result<History, SetupError> {
        match request.estimate {
            None => check(&self.scene)?,
            Some(_) => check_estimates(&self.scene)?,
        }
        let plain = self.model.activity(&self.grid, pattern);
        let charge = self.scene.drive.charge.as_ref();
        let has_electrode = plain.elements().iter().any(|active| *active > 0.0);
        let is_sprayed = charge.is_some_and(|charge| charge.immobile.is_some());
        let activity = match charge {
            Some(charge) if is_sprayed => &charge::sprayed(&plain, &self.scene, charge.in_coulombs()),
            _ => &plain,
        };
        let half_active = request.estimate.map(|_| Activity::from_shares(&self.grid, |_, _| 0.5));
        let moving = Moving::new(self, request)?;
        self.check_steps(request, moving.as_ref())?;
        let (first, finer) = self.model.with(Follow {
            solver: self,
            activity,
            held: charge.map(|charge| FixedCharge {
                charge: if has_electrode { charge.in_coulombs() } else { 0.0 },
                uncharged: is_sprayed.then_some(&plain),
            }),
            estimate: (request.estimate.zip(half_active.as_ref())).map(|(how, half_active)| Estimate {
                how,
                half_active,
                in_law: self.model.law_takes_slowness() && self.scene.drive.rest.is_none(),
            }),
            request,
            moving,
        });
        Ok(self.conclude(&first, finer, request.estimate.is_some()))
    }

    /// Refuses what takes more steps than there may be, before the first of them.
    fn check_steps(&self, request: &HistoryRequest, moving: Option<&Moving>) -> Result<(), SetupError> {
        let waveform = self.scene.waveform();
        let end = request.times.last().copied().unwrap_or(0.0);
        let stops = waveform.knots(end).len() + request.times.len();
        // Errors are known from two halvings of a motion, and from one of equilibria.
        let (step, passes) = match (moving, &waveform.sine) {
            (Some(moving), _) => (moving.step, 4.0),
            (None, Some(sine)) => (1.0 / (IN_PERIOD * sine.frequency.value()), 2.0),
            (None, None) => (f64::INFINITY, 2.0),
        };
        let count = passes * (end / step + stops as f64);
        match count > MOST_STEPS as f64 {
            true => Err(SetupError::Steps {
                count,
                most: MOST_STEPS,
            }),
            false => Ok(()),
        }
    }

    fn conclude(&self, coarse: &Pass, fine: Refined, is_estimate: bool) -> History {
        let Refined {
            pass,
            fields,
            error,
            steps,
            newton_steps,
        } = fine;
        let outcome = match pass.end {
            PassEnd::Done if is_estimate => Outcome::Estimated,
            PassEnd::WorkLimit => Outcome::WorkLimit,
            _ if is_estimate => Outcome::NoEstimate,
            PassEnd::Done => Outcome::Converged,
            PassEnd::AtOnce(ending) => self.outcome(ending),
            PassEnd::Lost { before, after, loss } => {
                // The steps have an error of their own: where both passes lose it.
                let shift = match coarse.end {
                    PassEnd::Lost { before: other, .. } => (other - before).abs(),
                    _ => 0.0,
                };
                let (last_stable, first_unstable) = ((before - shift).max(0.0), after + shift);
                match loss {
                    Loss::Stability | Loss::Ellipticity => Outcome::DelayedPullIn {
                        last_stable,
                        first_unstable,
                    },
                    Loss::Tension => Outcome::DelayedSlack {
                        last_stable,
                        first_unstable,
                    },
                }
            }
            PassEnd::Unknown => Outcome::IterationLimit,
        };
        History {
            outcome,
            watched: pass.watched,
            instants: pass.instants,
            kept: pass.kept,
            fields,
            time_error_mm: error,
            steps,
            newton_steps,
            residual: pass.residual,
        }
    }
}

/// The last pass with its error in mm.
struct Refined {
    pass: Pass,
    fields: Vec<Field>,
    error: Option<f64>,
    /// Of all passes.
    steps: usize,
    newton_steps: u32,
}

/// Following a pattern.
struct Follow<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    held: Option<FixedCharge<'a>>,
    estimate: Option<Estimate<'a>>,
    request: &'a HistoryRequest,
    /// Where the membrane has a mass.
    moving: Option<Moving>,
}

/// What motion needs beside the membrane.
struct Moving {
    mass: Mass,
    laplacian: Laplacian,
    /// Units of time in a second.
    per_second: f64,
    /// The first step to try, in s.
    step: f64,
}

impl Moving {
    /// Of a solver whose scene has inertia.
    fn new(solver: &MembraneSolver, request: &HistoryRequest) -> Result<Option<Self>, SetupError> {
        let scene = &solver.scene;
        if scene.effects.inertia.is_none() {
            return Ok(None);
        }
        let speed = wave_speed(scene)?;
        let size = scene.membrane().size_mm;
        // Half a wave along the longer side: about the period of the first mode.
        let slowest = 2.0 * 1e-3 * f64::max(size[0], size[1]) / speed;
        let per_second = speed / (1e-3 * solver.grid.unit_mm());
        let mass = Mass::new(&solver.grid, false);
        let times = [
            Some(slowest),
            bodies::shortest_period(&solver.grid, &mass).map(|period| period / per_second),
            scene.drive.force_frequency_hz().map(f64::recip),
            scene.waveform().time_s(),
            request.times.last().copied(),
        ];
        let shortest = times
            .into_iter()
            .flatten()
            .filter(|time| *time > 0.0)
            .fold(f64::INFINITY, f64::min);
        let step = shortest / STEPS_IN_PERIOD;
        Ok(Some(Self {
            mass,
            // In the middle of the steps that will be tried.
            laplacian: Laplacian::with_mass(&solver.grid, 4.0 / (0.25 * step * per_second).powi(2))?,
            per_second,
            step,
        }))
    }
}

impl WithMaterial for Follow<'_> {
    type Output = (Pass, Refined);

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> (Pass, Refined) {
        let Self {
            solver,
            activity,
            held,
            estimate,
            request,
            moving,
        } = self;
        let transient = TransientProblem {
            problem: solver.problem(activity, material),
            scene: &solver.scene,
            waveform: solver.scene.waveform(),
            supply: Supply::of(&solver.scene),
            conductor: Conductor::of(&solver.scene, activity),
            times: &request.times,
            limit: Cell::new(match held {
                Some(_) => solver.scaled(request.limit).part(charge::WORK),
                None => solver.scaled(request.limit),
            }),
            watched: Cell::default(),
            held,
            estimate,
            measures: request.measures,
        };
        // The corner that moves most is known from the pass before.
        let watch = |pass: &Pass| {
            if !pass.fields.is_empty() {
                transient.watched.set(most_moved(pass));
            }
        };
        if let Some(Moving {
            mass,
            laplacian,
            per_second,
            step,
        }) = moving
        {
            let mut motion = Motion {
                transient: &transient,
                mass: &mass,
                per_second,
                laplacian: &laplacian,
                step,
                parts: 1,
            };
            return refine_motion(request, &transient.limit, |halvings, last| {
                last.into_iter().for_each(watch);
                motion.parts = 1 << halvings;
                motion.pass()
            });
        }
        let mut workspace = solver.workspace().near();
        // A bound that every membrane has until its displacement is known.
        let guess = 1e-2 * solver.scene.side_mm();
        let wanted = request.accuracy_mm.unwrap_or(USUAL_ERROR * guess);
        let loose = if estimate.is_some() { LOOSE } else { LOOSER };
        let steps = Steps::Within(loose * wanted / solver.grid.unit_mm());
        let mut coarse = transient.pass(steps, &mut workspace);
        if estimate.is_some() {
            coarse.watched = most_moved(&coarse);
            let refined = Refined {
                fields: coarse.fields.clone(),
                error: None,
                steps: coarse.steps.len(),
                newton_steps: coarse.newton_steps,
                pass: coarse.clone(),
            };
            return (coarse, refined);
        }
        refine(coarse, request, (&transient.limit, solver.tolerance), |coarse| {
            // One corner in all passes, which are extrapolated from each other.
            if transient.watched.get() == [0; 2] {
                watch(coarse);
            }
            transient.pass(Steps::At(&halved(&coarse.steps)), &mut workspace)
        })
    }
}

/// What all passes together take.
struct Spent<'a> {
    /// What is left to the next one.
    limit: &'a Cell<WorkLimit>,
    steps: usize,
    newton_steps: u32,
}

impl<'a> Spent<'a> {
    fn new(limit: &'a Cell<WorkLimit>) -> Self {
        Self {
            limit,
            steps: 0,
            newton_steps: 0,
        }
    }

    fn count(&mut self, pass: Pass) -> Pass {
        self.steps += pass.steps.len();
        self.newton_steps += pass.newton_steps;
        self.limit.set(self.limit.get().less(pass.work));
        pass
    }
}

/// The error of a pass where it is known: both it and the one before got to times that were asked for.
fn known(error: f64, coarse: &Pass, fine: &Pass) -> Option<f64> {
    let is_known = !(fine.is_cut_short() || fine.fields.is_empty() || coarse.fields.is_empty());
    is_known.then_some(error)
}

/// Whether the coarser of two passes got to all times that the finer one got to.
fn has_all(fine: &Pass, coarse: &Pass) -> bool {
    coarse.fields.len() >= fine.fields.len()
}

/// Whether two passes lose the last stable state at about the same time, if they do.
fn end_together(fine: &Pass, coarse: &Pass) -> bool {
    match (fine.end, coarse.end) {
        (PassEnd::Lost { before: fine, .. }, PassEnd::Lost { before: coarse, .. }) => {
            (fine - coarse).abs() <= TOGETHER * fine
        }
        (PassEnd::Lost { .. }, _) => false,
        _ => true,
    }
}

/// The largest difference in mm between two passes; all of the displacement where the coarser one ended before the finer one.
fn change(fine: &Pass, coarse: &Pass) -> f64 {
    match has_all(fine, coarse) {
        true => fine.difference(coarse),
        false => largest(&fine.fields),
    }
}

/// The corner that moves most at the last time that was asked for.
fn most_moved(pass: &Pass) -> [usize; 2] {
    pass.fields.last().map_or([0; 2], Field::most_moved)
}

fn largest(fields: &[Field]) -> f64 {
    fields.iter().map(Field::max_magnitude).fold(0.0, f64::max)
}

/// Passes with steps that are halved each time until their error is small enough, from the first one on: the last but one and the last,
/// extrapolated where three passes say that this errs less. What equilibria leave is an error too, `rounding` of the displacement.
fn refine(
    first: Pass,
    request: &HistoryRequest,
    (limit, rounding): (&Cell<WorkLimit>, f64),
    mut halve: impl FnMut(&Pass) -> Pass,
) -> (Pass, Refined) {
    let mut spent = Spent::new(limit);
    let mut before: Option<Pass> = None;
    let mut coarse = spent.count(first);
    let mut fine = spent.count(halve(&coarse));
    let mut halvings = 1;
    loop {
        let difference = change(&fine, &coarse);
        let old = before.as_ref().map(|before| change(&coarse, before));
        // Second order divides it by four; where it falls less, more is left.
        let ratio = old.map_or(0.25, |old| (difference / old).clamp(0.25, 0.75));
        let share = ratio / (1.0 - ratio);
        let rounded = rounding * largest(&fine.fields);
        let extrapolated = before
            .as_ref()
            .and_then(|before| Extrapolation::of([before, &coarse, &fine]));
        let extrapolated = extrapolated.filter(|found| found.error() < share * difference);
        let error = rounded + extrapolated.as_ref().map_or(share * difference, Extrapolation::error);
        let is_small = match (request.accuracy_mm, &extrapolated) {
            (Some(accuracy), _) => error <= accuracy,
            (None, Some(found)) => found.relative_error(NEGLIGIBLE) <= USUAL_ERROR,
            (None, None) => has_all(&fine, &coarse) && share * fine.relative_difference(&coarse) <= USUAL_ERROR,
        };
        let is_enough = is_small && end_together(&fine, &coarse);
        // What falls slowly is not smooth in time, as the mesh's own vibrations after a jump are.
        let is_slow = halvings >= PATIENCE && old.is_some_and(|old| difference > 0.5 * old);
        let is_last = is_enough || is_slow || halvings == MOST_HALVINGS || fine.is_last();
        let finer = (!is_last).then(|| spent.count(halve(&fine)));
        let Some(finer) = finer.filter(|finer| !finer.is_cut_short()) else {
            let pass = match extrapolated {
                Some(found) => found.applied(&coarse, fine),
                None => fine,
            };
            let refined = Refined {
                fields: pass.fields.clone(),
                error: known(error, &coarse, &pass),
                steps: spent.steps,
                newton_steps: spent.newton_steps,
                pass,
            };
            return (coarse, refined);
        };
        (before, coarse, fine) = (Some(coarse), fine, finer);
        halvings += 1;
    }
}

/// Passes with steps that are halved each time until fields that are extrapolated to no step hardly change.
fn refine_motion(
    request: &HistoryRequest,
    limit: &Cell<WorkLimit>,
    mut pass_with: impl FnMut(u32, Option<&Pass>) -> Pass,
) -> (Pass, Refined) {
    let mut spent = Spent::new(limit);
    let mut before = spent.count(pass_with(0, None));
    let mut coarse = spent.count(pass_with(1, Some(&before)));
    let mut fine = spent.count(pass_with(2, Some(&coarse)));
    let mut halvings = 2;
    loop {
        let [old, new] = [change(&coarse, &before), change(&fine, &coarse)];
        // Second order divides it by four.
        let is_smooth = new <= 0.35 * old && has_all(&fine, &coarse) && has_all(&coarse, &before);
        let extrapolated = |fine: &Pass, coarse: &Pass| -> Vec<Field> {
            let pairs = fine.fields.iter().zip(&coarse.fields);
            pairs
                .map(|(fine, coarse)| fine.extrapolated(coarse, 1.0 / 3.0))
                .collect()
        };
        let [first, second] = [extrapolated(&coarse, &before), extrapolated(&fine, &coarse)];
        let changes = first.iter().zip(&second).map(|(a, b)| a.max_difference(b));
        let moved = changes.fold(0.0, f64::max);
        let (fields, error) = match is_smooth {
            // That of fourth order is a fifteenth of the change.
            true => (second, SAFETY / 15.0 * moved),
            false => (fine.fields.clone(), new),
        };
        let wanted = request.accuracy_mm.unwrap_or(USUAL_ERROR * largest(&fields));
        let is_slow = halvings >= PATIENCE && new > 0.6 * old;
        let is_last = error <= wanted || is_slow || halvings == MOST_HALVINGS_OF_MOTION || fine.is_last();
        let finer = (!is_last).then(|| spent.count(pass_with(halvings + 1, Some(&fine))));
        let Some(finer) = finer.filter(|finer| !finer.is_cut_short()) else {
            let refined = Refined {
                fields,
                error: known(error, &coarse, &fine),
                steps: spent.steps,
                newton_steps: spent.newton_steps,
                pass: fine,
            };
            return (coarse, refined);
        };
        (before, coarse, fine) = (coarse, fine, finer);
        halvings += 1;
    }
}

/// The ends of steps, and their middles.
fn halved(steps: &[f64]) -> Vec<f64> {
    let starts = std::iter::once(&0.0).chain(steps);
    starts
        .zip(steps)
        .flat_map(|(start, end)| [0.5 * (start + end), *end])
        .collect()
}
