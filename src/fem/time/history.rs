//! How patterns move in time.

use std::cell::Cell;

use super::march::{Course, Instant, MOST_STEPS, Pass, PassEnd, Steps};
use super::modes::wave_speed;
use super::motion::Motion;
use crate::fem::continuation::Loss;
use crate::fem::effects::WithMaterial;
use crate::fem::energy::Material;
use crate::fem::error::SetupError;
use crate::fem::mass::Mass;
use crate::fem::operator::Activity;
use crate::fem::precondition::Laplacian;
use crate::fem::solver::MembraneSolver;
use crate::field::{Field, Outcome};
use crate::pattern::Pattern;

/// Error in time, in units of the largest displacement at each time, unless another is asked for.
const USUAL_ERROR: f64 = 2e-5;
/// Steps of the first pass over the shortest time of a motion.
const STEPS_IN_PERIOD: f64 = 40.0;
/// Times that the steps of the first pass are halved at most.
const MOST_HALVINGS: i32 = 6;
/// From so many on errors that hardly fall end them.
const PATIENCE: i32 = 4;
/// The same of a motion.
const MOST_HALVINGS_OF_MOTION: i32 = 5;
/// What an estimated error is multiplied by where it is one of fourth order.
const SAFETY: f64 = 3.0;

/// What is asked of a history.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoryRequest {
    /// The times in s at which fields are wanted, in order, from 0 on. 0 s is just after the drive has begun.
    pub times: Vec<f64>,
    /// The largest error in mm that steps in time may leave; a small part of the displacement where none is asked for.
    pub accuracy_mm: Option<f64>,
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
    /// Estimate of the largest error in mm that steps in time leave in the fields.
    pub time_error_mm: f64,
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

impl MembraneSolver {
    /// How a pattern moves in the time of the drive.
    ///
    /// # Errors
    /// When the drive is a charge, or the scene has inertia and bodies that cannot be moved.
    pub fn history(&self, pattern: &Pattern, request: &HistoryRequest) -> Result<History, SetupError> {
        if self.scene.drive.charge.is_some() {
            return Err(SetupError::Charge);
        }
        let (first, finer) = self.model.with(Follow {
            solver: self,
            activity: &self.model.activity(&self.grid, pattern),
            request,
            moving: Moving::new(self, request)?,
        });
        Ok(self.conclude(&first, finer))
    }

    fn conclude(&self, coarse: &Pass, fine: Refined) -> History {
        let watched = coarse.fields.last().map_or([0; 2], Field::most_moved);
        let Refined {
            pass,
            fields,
            error,
            newton_steps,
        } = fine;
        let outcome = match pass.end {
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
            PassEnd::WorkLimit => Outcome::WorkLimit,
        };
        History {
            outcome,
            watched,
            instants: pass.instants,
            kept: pass.kept,
            fields,
            time_error_mm: error,
            newton_steps,
            residual: pass.residual,
        }
    }
}

/// The last pass with its error in mm.
struct Refined {
    pass: Pass,
    fields: Vec<Field>,
    error: f64,
    newton_steps: u32,
}

/// Following a pattern.
struct Follow<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
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
        if scene.geometry.bodies.is_some() {
            return Err(SetupError::MovingBodies);
        }
        let speed = wave_speed(scene)?;
        let size = scene.membrane().size_mm;
        // Half a wave along the longer side: about the period of the first mode.
        let slowest = 2.0 * 1e-3 * f64::max(size[0], size[1]) / speed;
        let times = [
            Some(slowest),
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
        let per_second = speed / (1e-3 * solver.grid.unit_mm());
        Ok(Some(Self {
            mass: Mass::new(&solver.grid, false),
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
            request,
            moving,
        } = self;
        let course = Course {
            problem: solver.problem(activity, material),
            scene: &solver.scene,
            waveform: solver.scene.waveform(),
            times: &request.times,
            limit: solver.limit,
            watched: Cell::default(),
        };
        // The corner that moves most is known from the pass before.
        let watch = |pass: &Pass| {
            if let Some(field) = pass.fields.last() {
                course.watched.set(field.most_moved());
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
                course: &course,
                mass: &mass,
                per_second,
                laplacian: &laplacian,
                step,
            };
            return refine_motion(request, |halvings, last| {
                last.into_iter().for_each(watch);
                motion.step = step * 0.5_f64.powi(halvings);
                motion.pass()
            });
        }
        let mut workspace = solver.workspace();
        // A bound that every membrane has until its displacement is known.
        let guess = 1e-2 * solver.scene.side_mm();
        let wanted = request.accuracy_mm.unwrap_or(USUAL_ERROR * guess);
        let steps = Steps::Within(wanted / solver.grid.unit_mm());
        let coarse = course.pass(steps, &mut workspace);
        refine(coarse, request, |coarse| {
            watch(coarse);
            course.pass(Steps::At(&halved(&coarse.steps)), &mut workspace)
        })
    }
}

/// Passes with steps that are halved each time until their error is small enough: the last but one and the last.
fn refine(mut coarse: Pass, request: &HistoryRequest, mut halve: impl FnMut(&Pass) -> Pass) -> (Pass, Refined) {
    let mut newton_steps = coarse.newton_steps;
    let mut halvings: i32 = 0;
    let mut before = f64::INFINITY;
    loop {
        halvings += 1;
        let pass = halve(&coarse);
        newton_steps += pass.newton_steps;
        let error = pass.difference(&coarse) / 3.0;
        let is_enough = match request.accuracy_mm {
            Some(accuracy) => error <= accuracy,
            None => pass.relative_difference(&coarse) / 3.0 <= USUAL_ERROR,
        };
        // Second order divides it by four; what falls less is not smooth in time, as the mesh's own vibrations after a jump are.
        let is_slow = halvings >= PATIENCE && error > 0.5 * before;
        before = error;
        if is_enough || is_slow || halvings == MOST_HALVINGS || 2 * pass.steps.len() > MOST_STEPS {
            let refined = Refined {
                fields: pass.fields.clone(),
                pass,
                error,
                newton_steps,
            };
            return (coarse, refined);
        }
        coarse = pass;
    }
}

/// Passes with steps that are halved each time until fields that are extrapolated to no step hardly change.
fn refine_motion(request: &HistoryRequest, mut pass_with: impl FnMut(i32, Option<&Pass>) -> Pass) -> (Pass, Refined) {
    let mut before = pass_with(0, None);
    let mut coarse = pass_with(1, Some(&before));
    let mut newton_steps = before.newton_steps + coarse.newton_steps;
    let mut halvings = 1;
    loop {
        halvings += 1;
        let pass = pass_with(halvings, Some(&coarse));
        newton_steps += pass.newton_steps;
        let [old, new] = [coarse.difference(&before), pass.difference(&coarse)];
        // Second order divides it by four.
        let is_smooth = new <= 0.35 * old;
        let extrapolated = |fine: &Pass, coarse: &Pass| -> Vec<Field> {
            let pairs = fine.fields.iter().zip(&coarse.fields);
            pairs
                .map(|(fine, coarse)| fine.extrapolated(coarse, 1.0 / 3.0))
                .collect()
        };
        let [first, second] = [extrapolated(&coarse, &before), extrapolated(&pass, &coarse)];
        let change = first
            .iter()
            .zip(&second)
            .map(|(a, b)| a.max_difference(b))
            .fold(0.0, f64::max);
        let (fields, error) = if is_smooth {
            // That of fourth order is a fifteenth of the change.
            (second, SAFETY / 15.0 * change)
        } else {
            (pass.fields.clone(), new)
        };
        let largest = fields.iter().map(Field::max_magnitude).fold(0.0, f64::max);
        let wanted = request.accuracy_mm.unwrap_or(USUAL_ERROR * largest);
        let is_slow = halvings >= PATIENCE && new > 0.6 * old;
        if error <= wanted || is_slow || halvings >= MOST_HALVINGS_OF_MOTION || 2 * pass.steps.len() > MOST_STEPS {
            let refined = Refined {
                pass,
                fields,
                error,
                newton_steps,
            };
            return (coarse, refined);
        }
        before = coarse;
        coarse = pass;
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
