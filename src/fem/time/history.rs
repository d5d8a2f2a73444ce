//! Simulates the history of a pattern.

use std::cell::Cell;

use super::bodies;
use super::extrapolation::Extrapolation;
use super::leads::Conductor;
use super::march::{ERROR_PER_DIFFERENCE, IN_PERIOD};
use super::modes::wave_speed;
use super::motion::Motion;
use super::pass::{Instant, MOST_STEPS, NEGLIGIBLE, Pass, PassEnd, Steps};
use super::supply::Supply;
use super::trace::Trace;
use super::transient::{Estimate, FixedCharge, StepEstimate, TransientProblem, kink_with_noise, knots};
use crate::charge;
use crate::continuation::Problem;
use crate::effects::WithMaterial;
use crate::error::SetupError;
use crate::gauge::check_resisted;
use crate::mass::Mass;
use crate::material::Material;
use crate::operator::Activity;
use crate::precondition::Laplacian;
use crate::solver::MembraneSolver;
use crate::stability::Loss;
use crate::work::WorkLimit;
use deaflow_field::{Field, Observation, Outcome, Simulation};
use deaflow_pattern::Pattern;
use deaflow_scene::{Scene, ViscousLaw, Waveform};

/// Default error in time, relative to the largest displacement at each time.
pub const USUAL_ERROR: f64 = 2e-5;
/// Error of a step of the first pass over the requested error at the requested times. The error of a step decays while
/// the membrane relaxes, and passes with shorter steps follow if it is too large.
const LOOSE: f64 = 30.0;
/// The same for a first pass followed by others, three of which are extrapolated: with steps twice as long.
const LOOSER: f64 = 240.0;
/// Displacement in units of the side, as an upper bound for the first steps.
const MOVED: f64 = 1e-2;
/// Largest part of the load by which a kink within a step may miss the line between the neighbouring rows of a table.
const KINK: f64 = 0.05;
/// Relative difference below which the times at which two passes lose the last stable state count as equal.
const TOGETHER: f64 = 3e-4;
/// Steps of the first pass in the shortest time of a motion.
const STEPS_IN_PERIOD: f64 = 40.0;
/// Largest number of times that the steps of the first pass are halved.
const MOST_HALVINGS: u32 = 6;
/// Number of halvings from which slowly falling errors end the refinement.
const PATIENCE: u32 = 4;
/// The same for a motion.
const MOST_HALVINGS_OF_MOTION: u32 = 5;
/// Safety factor on an estimated error of fourth order.
const SAFETY: f64 = 4.0;

/// The request for a history.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoryRequest {
    /// The times in s of the requested fields, in order, from 0 on. 0 s is just after the start of the drive.
    pub times: Vec<f64>,
    /// The largest error in mm due to steps in time; `None` for a small fraction of the displacement.
    pub accuracy_mm: Option<f64>,
    /// Limit of work for all steps of a pattern on a mesh.
    pub limit: WorkLimit,
    /// How states are estimated, if they are not solved for; the steps are then those of a first pass.
    pub estimate: Option<StepEstimate>,
    /// Whether charges, energies and magnitudes are computed at each instant in addition to the requested fields; they
    /// are 0 otherwise.
    pub measures: bool,
}

impl HistoryRequest {
    /// Requests fields at some times, with the default error and limit of work.
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

/// Returns why the states of a scene cannot be estimated step by step; `None` if they can.
fn refusal_of_estimates(scene: &Scene) -> Option<SetupError> {
    let effects = &scene.effects;
    let law = effects.viscoelasticity.as_ref().map(|effect| effect.law);
    let has = [
        (scene.drive.charge.is_some(), "the drive is a `charge`; give a voltage"),
        (effects.inertia.is_some(), "the scene has `inertia`"),
        (scene.geometry.sides.is_some(), "not all `sides` are held"),
        (
            effects.electrode_resistance.is_some() || scene.drive.source.is_some(),
            "the scene has a `source` or `electrode_resistance`",
        ),
        (law.is_none(), "the scene has no `viscoelasticity`"),
        (law == Some(ViscousLaw::Finite), "the viscous law must be linear"),
    ];
    let why = has.into_iter().find_map(|(has, why)| has.then_some(why))?;
    Some(SetupError::StepEstimates { why })
}

/// The history of a pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct History {
    /// How it ended.
    pub outcome: Outcome,
    /// The membrane after each step, up to the loss of stability; two instants at a jump.
    pub instants: Vec<Instant>,
    /// Indices of the instants at the requested times.
    pub kept: Vec<usize>,
    /// The displacement from the mount at the requested times, up to the loss of stability; with inertia, extrapolated
    /// to zero step length.
    pub fields: Vec<Field>,
    /// If a side is not held and there is a state without voltage, the displacement there, from which all other
    /// displacements count.
    pub rest: Option<Field>,
    /// The corner (column, row) that moves most at the last requested time.
    pub watched: [usize; 2],
    /// Estimate of the largest error in mm due to steps in time; `None` if unknown.
    pub time_error_mm: Option<f64>,
    /// Number of time steps of all passes.
    pub steps: usize,
    /// Number of Newton steps of all passes.
    pub newton_steps: u32,
    /// Relative residual at the end of the last step.
    pub residual: f64,
}

impl History {
    /// Returns the displacements from rest at the requested times, up to the loss of stability.
    #[must_use]
    pub fn strokes(&self) -> Vec<Field> {
        match &self.rest {
            Some(rest) => self.fields.iter().map(|field| field.plus(-1.0, rest)).collect(),
            None => self.fields.clone(),
        }
    }

    /// Returns the state at the end, with the motions of bodies and bars; without a field if it was not reached.
    #[must_use]
    pub fn last_state(&self) -> Simulation {
        let field = self.fields.last().filter(|_| self.outcome.is_converged());
        let observation = match (field, self.asked().last()) {
            (Some(_), Some(last)) => Observation {
                bodies: last.bodies.clone(),
                bars: last.bars.clone(),
                rest: self.rest.clone(),
                ..Observation::default()
            },
            _ => Observation::default(),
        };
        Simulation {
            outcome: self.outcome,
            field: field.cloned(),
            newton_iterations: self.newton_steps,
            residual: self.residual,
            observation,
        }
    }

    /// Returns the membrane at the requested times, up to the loss of stability.
    pub fn asked(&self) -> impl Iterator<Item = &Instant> {
        self.kept.iter().map(|&at| &self.instants[at])
    }

    /// Returns the largest difference in mm from another history at the times that both reached.
    #[must_use]
    pub fn difference(&self, other: &Self) -> f64 {
        let pairs = self.fields.iter().zip(&other.fields);
        pairs.map(|(a, b)| a.max_difference(b)).fold(0.0, f64::max)
    }

    /// Returns the current into the electrodes in A at each instant: the slope of the charge, of second order within
    /// the smooth parts of a waveform.
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

/// Returns why the history of a scene with resolved effects cannot be simulated; `None` if it can.
#[must_use]
pub fn refusal(scene: &Scene) -> Option<SetupError> {
    let charges =
        scene.drive.source.is_some() || scene.drive.charge.as_ref().is_some_and(|charge| charge.total.is_some());
    if charges && scene.effects.inertia.is_some() && scene.effects.wrinkling.is_some() {
        return Some(SetupError::MovingCharge);
    }
    if scene.effects.inertia.is_some()
        && let Err(refusal) = check_resisted(scene, "inertia")
    {
        return Some(refusal);
    }
    if scene.geometry.sides.is_some() && scene.effects.viscoelasticity.is_some() && scene.drive.rest.is_some() {
        // Branches that have not relaxed move the sides before the drive.
        let with = "`rest` in the drive";
        return Some(SetupError::Sides { with });
    }
    if scene.effects.electrode_resistance.is_some() {
        if scene.leads.is_none() {
            return Some(SetupError::Leads);
        }
        if scene.follows_borders() {
            return Some(SetupError::Curves {
                with: "electrode resistance",
            });
        }
        if let Some(with) = scene.resistance_conflict(&scene.effects) {
            return Some(SetupError::Resistance { with });
        }
    }
    None
}

/// Checks whether the history of a scene with resolved effects can be simulated.
///
/// # Errors
/// When it cannot.
pub fn check(scene: &Scene) -> Result<(), SetupError> {
    refusal(scene).map_or(Ok(()), Err)
}

/// Checks whether the history can be simulated with estimated states.
///
/// # Errors
/// When it cannot.
pub fn check_estimates(scene: &Scene) -> Result<(), SetupError> {
    check(scene)?;
    refusal_of_estimates(scene).map_or(Ok(()), Err)
}

impl MembraneSolver {
    /// Simulates the history of a pattern.
    ///
    /// # Errors
    /// When the history of the scene cannot be simulated, for the reason that `refusal` returns.
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
        let rest = match self.released(&plain) {
            Ok(rest) => rest,
            Err(ending) => {
                let unstable = Pass::new(PassEnd::AtOnce(ending), [0; 2]);
                return Ok(self.conclude(&unstable.clone(), Refined::unchecked(unstable), None, false));
            }
        };
        let half_active = request.estimate.map(|_| Activity::from_shares(&self.grid, |_, _| 0.5));
        let moving = Moving::new(self, request)?;
        self.check_steps(request, moving.as_ref())?;
        let (first, finer) = self.model.with(Follow {
            solver: self,
            activity,
            rest: rest.as_deref(),
            held: charge.map(|charge| FixedCharge {
                charge: if has_electrode { charge.in_coulombs() } else { 0.0 },
                uncharged: is_sprayed.then_some(&plain),
            }),
            estimate: (request.estimate.zip(half_active.as_ref())).map(|(how, half_active)| Estimate {
                how,
                half_active,
                in_law: self.model.law_includes_unrelaxed() && self.scene.drive.rest.is_none(),
            }),
            request,
            moving,
        });
        let rest = rest.map(|rest| self.grid.sample(&rest));
        Ok(self.conclude(&first, finer, rest, request.estimate.is_some()))
    }

    /// Rejects a request with too many steps before the first step.
    fn check_steps(&self, request: &HistoryRequest, moving: Option<&Moving>) -> Result<(), SetupError> {
        let waveform = self.scene.waveform();
        let end = request.times.last().copied().unwrap_or(0.0);
        let stops = knots(&waveform, end, self.kink(request, &waveform)).len() - 1 + request.times.len();
        // Two halvings give the error of a motion, one that of equilibria.
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

    /// Returns the largest displacement difference in mm of a step of the first pass from its extrapolation.
    fn first_difference(&self, request: &HistoryRequest) -> f64 {
        // An upper bound, until the displacement is known.
        let wanted = request
            .accuracy_mm
            .unwrap_or(USUAL_ERROR * (MOVED * self.scene.side_mm()));
        let loose = if request.estimate.is_some() { LOOSE } else { LOOSER };
        loose * wanted
    }

    /// Returns the largest offset in V² of a kink that the first steps may contain: that of a displacement below their
    /// tolerance, or of noise.
    fn kink(&self, request: &HistoryRequest, waveform: &Waveform) -> f64 {
        let share = self.first_difference(request) / ERROR_PER_DIFFERENCE / (MOVED * self.scene.side_mm());
        kink_with_noise(waveform, share.min(KINK) * self.scene.voltage_v().powi(2))
    }

    fn conclude(&self, coarse: &Pass, fine: Refined, rest: Option<Field>, is_estimate: bool) -> History {
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
                // The time of loss has an error due to the steps: the interval spans the times of both passes.
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
            fields: match &rest {
                Some(rest) => fields.iter().map(|field| field.plus(1.0, rest)).collect(),
                None => fields,
            },
            rest,
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
    /// Totals of all passes.
    steps: usize,
    newton_steps: u32,
}

impl Refined {
    /// Returns a pass of unknown error.
    fn unchecked(pass: Pass) -> Self {
        Self {
            fields: pass.fields.clone(),
            error: None,
            steps: pass.steps.len(),
            newton_steps: pass.newton_steps,
            pass,
        }
    }
}

/// The simulation of a pattern.
struct Follow<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    /// The state without voltage, if it is not the mount.
    rest: Option<&'a [f64]>,
    held: Option<FixedCharge<'a>>,
    estimate: Option<Estimate<'a>>,
    request: &'a HistoryRequest,
    /// With inertia only.
    moving: Option<Moving>,
}

/// The data that motion needs in addition to the membrane.
struct Moving {
    mass: Mass,
    laplacian: Laplacian,
    /// Units of time per second.
    per_second: f64,
    /// Length of the first step in s.
    step: f64,
}

impl Moving {
    /// Prepares the motion if the scene has inertia.
    fn new(solver: &MembraneSolver, request: &HistoryRequest) -> Result<Option<Self>, SetupError> {
        let scene = &solver.scene;
        if scene.effects.inertia.is_none() {
            return Ok(None);
        }
        let speed = wave_speed(scene)?;
        let size = scene.membrane().size_mm;
        // Half a wave along the longer side: about the period of the first mode, which a heavy bar makes longer.
        let slowest = 2.0 * 1e-3 * f64::max(size[0], size[1]) / speed * bodies::slowed_by_bars(&solver.grid);
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
            // The middle of the range of steps.
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
            rest,
            held,
            estimate,
            request,
            moving,
        } = self;
        let waveform = solver.scene.waveform();
        let kink = solver.kink(request, &waveform);
        let transient = TransientProblem {
            problem: Problem {
                at_rest: rest,
                ..solver.problem(activity, material)
            },
            scene: &solver.scene,
            knots: knots(&waveform, request.times.last().copied().unwrap_or(0.0), kink),
            kink,
            noisy: waveform.noise().is_some(),
            waveform,
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
        // The state of rest has the error of its residual, which is relative to that of the mount.
        let at_rest = rest.map_or(0.0, |rest| solver.tolerance * solver.grid.sample(rest).max_magnitude());
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
            return refine_motion(
                request,
                (&transient.limit, at_rest, transient.noisy),
                |halvings, last| {
                    last.into_iter().for_each(watch);
                    motion.parts = 1 << halvings;
                    motion.pass()
                },
            );
        }
        let mut workspace = solver.workspace().near();
        let steps = Steps::Within(solver.first_difference(request) / solver.grid.unit_mm());
        let mut coarse = transient.pass(steps, &mut workspace);
        if estimate.is_some() {
            coarse.watched = most_moved(&coarse);
            return (coarse.clone(), Refined::unchecked(coarse));
        }
        let mut spent = Spent::new(&transient.limit);
        coarse = spent.count(coarse);
        if transient.noisy && coarse.end == PassEnd::Done {
            // The first pass has averaged the drive over steps that it did not know all of.
            let again = spent.count(transient.pass(Steps::At(&coarse.steps), &mut workspace));
            if again.is_cut_short() {
                return spent.cut_short(again, Some(coarse));
            }
            coarse = again;
        }
        refine(
            coarse,
            request,
            (spent, [solver.tolerance, at_rest], transient.noisy),
            |coarse| {
                // All passes watch the same corner, since they are extrapolated from each other.
                if transient.watched.get() == [0; 2] {
                    watch(coarse);
                }
                transient.pass(Steps::At(&halved(&coarse.steps)), &mut workspace)
            },
        )
    }
}

/// The totals of all passes.
struct Spent<'a> {
    /// The work left for the next pass.
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

    /// Ends with a pass that the work limit cut short before an error was known: returns the one that got further, this
    /// or the one before it.
    fn cut_short(&self, pass: Pass, before: Option<Pass>) -> (Pass, Refined) {
        let reached = |pass: &Pass| {
            let time = pass.instants.last().map_or(0.0, |instant| instant.time);
            (pass.fields.len(), time)
        };
        let furthest = match before {
            Some(before) if reached(&before) > reached(&pass) => before,
            _ => pass,
        };
        let pass = Pass {
            end: PassEnd::WorkLimit,
            ..furthest
        };
        let refined = Refined {
            fields: pass.fields.clone(),
            error: None,
            steps: self.steps,
            newton_steps: self.newton_steps,
            pass: pass.clone(),
        };
        (pass, refined)
    }
}

/// Returns the error of a pass if it is known: the pass and the one before reached requested times.
fn known(error: f64, coarse: &Pass, fine: &Pass) -> Option<f64> {
    let is_known = !(fine.is_cut_short() || fine.fields.is_empty() || coarse.fields.is_empty());
    is_known.then_some(error)
}

/// Returns whether the coarser of two passes reached all times that the finer one reached.
fn has_all(fine: &Pass, coarse: &Pass) -> bool {
    coarse.fields.len() >= fine.fields.len()
}

/// Returns whether two passes lose the last stable state at about the same time.
fn end_together(fine: &Pass, coarse: &Pass) -> bool {
    match (fine.end, coarse.end) {
        (PassEnd::Lost { before: fine, .. }, PassEnd::Lost { before: coarse, .. }) => {
            (fine - coarse).abs() <= TOGETHER * fine
        }
        (PassEnd::Lost { .. }, _) => false,
        _ => true,
    }
}

/// Returns the largest difference in mm between two passes; the full displacement if the coarser one ended before the
/// finer one.
fn change(fine: &Pass, coarse: &Pass) -> f64 {
    match has_all(fine, coarse) {
        true => fine.difference(coarse),
        false => largest(&fine.fields),
    }
}

/// Returns the corner that moves most at the last requested time.
fn most_moved(pass: &Pass) -> [usize; 2] {
    pass.fields.last().map_or([0; 2], Field::most_moved)
}

fn largest(fields: &[Field]) -> f64 {
    fields.iter().map(Field::max_magnitude).fold(0.0, f64::max)
}

/// Halves the steps pass by pass until the error is small enough; returns the last two passes, extrapolated if three
/// passes show that this is more accurate. The tolerance of equilibria adds an error of a number times the
/// displacement, and one in mm. The error of a drive with noise is a whole difference. `spent` has counted the first
/// pass.
fn refine(
    mut coarse: Pass,
    request: &HistoryRequest,
    (mut spent, [rounding, at_rest], noisy): (Spent<'_>, [f64; 2], bool),
    mut halve: impl FnMut(&Pass) -> Pass,
) -> (Pass, Refined) {
    let mut before: Option<Pass> = None;
    if coarse.is_cut_short() {
        return spent.cut_short(coarse, None);
    }
    let mut fine = spent.count(halve(&coarse));
    if fine.is_cut_short() {
        return spent.cut_short(fine, Some(coarse));
    }
    let mut halvings = 1;
    loop {
        let difference = change(&fine, &coarse);
        let old = before.as_ref().map(|before| change(&coarse, before));
        // Second order divides the error by four; if it falls less, more is left.
        let ratio = old.map_or(0.25, |old| (difference / old).clamp(0.25, 0.75));
        let share = ratio / (1.0 - ratio);
        let rounded = rounding * largest(&fine.fields) + at_rest;
        let extrapolated = before
            .as_ref()
            .and_then(|before| Extrapolation::of([before, &coarse, &fine]));
        let extrapolated = extrapolated.filter(|found| found.error() < share * difference);
        let smooth = extrapolated.as_ref().map_or(share * difference, Extrapolation::error);
        // What averages of noise over steps leave is random: two passes may agree by chance.
        let random = f64::max(difference, old.map_or(0.0, |old| 0.25 * old));
        let in_steps = rounded + if noisy { smooth.max(random) } else { smooth };
        let error = in_steps + fine.noise;
        let is_small = match (request.accuracy_mm, &extrapolated) {
            // Shorter steps do not lower the effect of noise.
            (Some(accuracy), _) if fine.noise > accuracy => in_steps <= accuracy,
            (Some(accuracy), _) => error <= accuracy,
            (None, _) if largest(&fine.fields) <= at_rest => true,
            (None, Some(found)) => found.relative_error(NEGLIGIBLE) <= USUAL_ERROR,
            (None, None) => has_all(&fine, &coarse) && share * fine.relative_difference(&coarse) <= USUAL_ERROR,
        };
        let is_enough = is_small && end_together(&fine, &coarse) && (!noisy || old.is_some());
        // If it falls slowly, the solution is not smooth in time, as with vibrations of the mesh after a jump.
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

/// Halves the steps pass by pass until the fields extrapolated to zero step length hardly change, or by less than the
/// error of the state of rest in mm.
fn refine_motion(
    request: &HistoryRequest,
    (limit, at_rest, noisy): (&Cell<WorkLimit>, f64, bool),
    mut pass_with: impl FnMut(u32, Option<&Pass>) -> Pass,
) -> (Pass, Refined) {
    let mut spent = Spent::new(limit);
    let mut before = spent.count(pass_with(0, None));
    if before.is_cut_short() {
        return spent.cut_short(before, None);
    }
    let mut coarse = spent.count(pass_with(1, Some(&before)));
    if coarse.is_cut_short() {
        return spent.cut_short(coarse, Some(before));
    }
    let mut fine = spent.count(pass_with(2, Some(&coarse)));
    if fine.is_cut_short() {
        return spent.cut_short(fine, Some(coarse));
    }
    let mut halvings = 2;
    loop {
        let [old, new] = [[&coarse, &before], [&fine, &coarse]].map(|[fine, coarse]| {
            let throughout = Trace::largest([(1.0, &fine.trace), (-1.0, &coarse.trace)]);
            throughout.max(change(fine, coarse))
        });
        // Second order divides the error by four.
        let is_smooth = new <= 0.35 * old && has_all(&fine, &coarse) && has_all(&coarse, &before);
        let extrapolated = |fine: &Pass, coarse: &Pass| -> Vec<Field> {
            let pairs = fine.fields.iter().zip(&coarse.fields);
            pairs
                .map(|(fine, coarse)| fine.extrapolated(coarse, 1.0 / 3.0))
                .collect()
        };
        let [first, second] = [extrapolated(&coarse, &before), extrapolated(&fine, &coarse)];
        let changes = first.iter().zip(&second).map(|(a, b)| a.max_difference(b));
        let throughout = Trace::largest([
            (4.0 / 3.0, &fine.trace),
            (-5.0 / 3.0, &coarse.trace),
            (1.0 / 3.0, &before.trace),
        ]);
        let moved = changes.fold(throughout, f64::max);
        let (fields, error) = match is_smooth {
            // At fourth order the error is a fifteenth of the change.
            true => (second, SAFETY / 15.0 * moved),
            false => (fine.fields.clone(), new),
        };
        let wanted = request
            .accuracy_mm
            .unwrap_or((USUAL_ERROR * largest(&fields)).max(at_rest));
        let is_small = error <= wanted;
        // What averages of noise over steps leave does not fall at fourth order.
        let error = if noisy { error.max(moved) } else { error };
        let is_small = is_small && request.accuracy_mm.is_none_or(|accuracy| error <= accuracy);
        let is_slow = halvings >= PATIENCE && new > 0.6 * old;
        let is_last = is_small || is_slow || halvings == MOST_HALVINGS_OF_MOTION || fine.is_last();
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

/// Returns the ends of steps and their midpoints.
fn halved(steps: &[f64]) -> Vec<f64> {
    let starts = std::iter::once(&0.0).chain(steps);
    starts
        .zip(steps)
        .flat_map(|(start, end)| [0.5 * (start + end), *end])
        .collect()
}
