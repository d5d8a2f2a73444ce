//! Solves for the equilibria of a membrane at successive times while its voltage changes and its elastomer creeps.
//!
//! A first pass chooses the steps: the difference between a solution and its extrapolation from the three before it
//! follows a tolerance. It is of third order in the step, as is the error of the exponential trapezoid. A second pass
//! halves all steps. Both are of second order, so a third of their difference is the error of the second pass; if that
//! exceeds the tolerance, a third pass halves again.

mod energies;
mod loading;
mod noise;
mod states;
mod supply;

use super::bodies;
use super::leads::{Charged, Conductor};
use super::pass::{Instant, MOST_STEPS, Pass, PassEnd, Steps, magnitude_at};
use super::smoothing::Smoothed;
use super::transient::{StepEstimate, TransientProblem};
use super::viscous::{BranchEnergy, Viscous};
use crate::continuation::StepFailure;
use crate::material::Material;
use crate::newton::Workspace;
use crate::stored::{Content, Units};
use deaflow_scene::Side;

/// Smallest step relative to the time since the start of the drive: the bracket of a delayed loss of stability.
const SMALLEST: f64 = 1e-5;
/// First step after a jump or kink of the voltage, relative to the shortest relaxation time or the time to the next
/// one.
const FIRST: f64 = 0.02;
/// Largest growth of a step.
const GROWTH: f64 = 1.8;
/// The error of a step over its difference from the extrapolation.
pub const ERROR_PER_DIFFERENCE: f64 = 0.1;
/// Minimum number of steps per period of a sine.
pub const IN_PERIOD: f64 = 40.0;

/// A state at the end of a step.
struct StepState {
    u: Vec<f64>,
    /// Voltage of the electrodes in V.
    volts: f64,
    /// The electrodes, if they have a resistance.
    charged: Option<Charged>,
}

/// An earlier state.
struct PastState {
    time: f64,
    u: Vec<f64>,
    /// Voltage of the drive in V.
    drive: f64,
    /// Potentials on the electrodes, if they have a resistance.
    potential: Vec<f64>,
}

impl<L: Material, F: Fn(f64) -> L> TransientProblem<'_, F> {
    /// Performs a pass over the time.
    pub fn pass(&self, steps: Steps<'_>, workspace: &mut Workspace) -> Pass {
        let activity = self.problem.activity;
        let rest = self.rest();
        let units = Units::new(self.scene, activity.grid().unit_mm());
        let [springs, work] = bodies::energies(units, activity.grid(), &rest);
        let viscous = Viscous::new(self.scene, activity, &rest);
        let mut run = March {
            transient: self,
            units,
            stored: 0.0,
            stored_at_rest: 0.0,
            // The pass that chooses the steps is never the last.
            measures: self.measures && matches!(steps, Steps::At(_)),
            unmoved: self
                .estimate
                .filter(|estimate| !estimate.in_law)
                .map(|_| viscous.clone()),
            loaded: BranchEnergy::default(),
            viscous,
            u: rest,
            volts: 0.0,
            volts_before: 0.0,
            smoothed: Smoothed::default(),
            smoothed_until: f64::NEG_INFINITY,
            is_off_average: false,
            estimates_noise: matches!(steps, Steps::At(_)),
            charged: self.conductor.as_ref().map(|conductor| conductor.uncharged(activity)),
            first: 0.0,
            recent: Vec::new(),
            content: Content::default(),
            electric: 0.0,
            elastic_at_rest: 0.0,
            springs,
            springs_at_rest: springs,
            work,
            dissipated: 0.0,
            supplied: 0.0,
            workspace,
            pass: Pass::new(PassEnd::Done, self.watched.get()),
        };
        run.workspace.begin(self.limit.get());
        run.workspace.refer_anew();
        run.pass.end = run.run(steps).err().unwrap_or(PassEnd::Done);
        run.pass.work += run.workspace.work();
        run.pass
    }
}

/// A pass in progress.
struct March<'a, 'b, F> {
    transient: &'a TransientProblem<'b, F>,
    units: Units,
    viscous: Viscous,
    /// The units of its energies.
    loaded: BranchEnergy,
    /// The branches of a membrane that stays at rest, if states are estimated and these branches are not part of the
    /// material.
    unmoved: Option<Viscous>,
    u: Vec<f64>,
    /// Voltage of the electrodes.
    volts: f64,
    /// The same at the start of the step.
    volts_before: f64,
    /// The drive averaged over steps up to the next stop; empty without noise.
    smoothed: Smoothed,
    /// This stop.
    smoothed_until: f64,
    /// Whether the voltage of the electrodes is not that of the averaged drive yet.
    is_off_average: bool,
    /// Whether the effect of averaging is estimated.
    estimates_noise: bool,
    /// The electrodes, if they have a resistance.
    charged: Option<Charged>,
    /// The first step after the last jump or kink.
    first: f64,
    /// Up to three earlier states since the last jump or kink.
    recent: Vec<PastState>,
    content: Content,
    electric: f64,
    elastic_at_rest: f64,
    /// Energy of springs, that at rest, and the work of loads.
    springs: f64,
    springs_at_rest: f64,
    work: f64,
    /// Energy of the branches in J.
    stored: f64,
    stored_at_rest: f64,
    /// Whether energies and charges are computed.
    measures: bool,
    dissipated: f64,
    supplied: f64,
    workspace: &'a mut Workspace,
    pass: Pass,
}

impl<L: Material, F: Fn(f64) -> L> March<'_, '_, F> {
    fn run(&mut self, steps: Steps<'_>) -> Result<(), PassEnd> {
        let transient = self.transient;
        if self.measures {
            self.elastic_at_rest = self.measure_at(0.0).elastic;
            self.loaded = self.viscous.loaded();
            self.stored_at_rest = self.units.energy * self.viscous.stored(&self.loaded, transient.problem.activity);
            self.stored = self.stored_at_rest;
        }
        let mut asked = transient.times.iter().copied().peekable();
        let stops = |at: usize| transient.knots.get(at).map(|knot| knot.time);
        if let Some(end) = stops(1) {
            let first = transient.times.iter().copied().find(|time| *time > 0.0);
            let stop = first.map_or(end, |time| time.min(end));
            self.smooth([0.0, stop], steps, self.first_step(end));
        }
        self.begin()?;
        if asked.peek().is_some_and(|time| *time <= 0.0) {
            self.face_noise(0.0)?;
        }
        while asked.next_if(|time| *time <= 0.0).is_some() {
            self.keep();
        }
        for (at, pair) in transient.knots.windows(2).enumerate() {
            let mut now = pair[0].time;
            self.first = self.first_step(pair[1].time - now);
            let mut length = self.first;
            while now < pair[1].time {
                let stop = asked.peek().map_or(pair[1].time, |time| time.min(pair[1].time));
                if self.smoothed_until <= now {
                    self.smooth([now, stop], steps, length);
                }
                self.meet_average(now)?;
                now = match steps {
                    Steps::Within(tolerance) => self.step_within(tolerance, now, stop, &mut length)?,
                    Steps::At(times) => {
                        let later = times.partition_point(|time| *time <= now);
                        self.step_to(now, times.get(later).map_or(stop, |time| time.min(stop)))?
                    }
                };
                if self.pass.steps.len() >= MOST_STEPS {
                    return Err(PassEnd::WorkLimit);
                }
                if now == pair[1].time && pair[1].jumps {
                    if let Some(end) = stops(at + 2) {
                        let later = transient.times.iter().copied().find(|time| *time > now);
                        self.smooth([now, later.map_or(end, |time| time.min(end))], steps, length);
                    }
                    self.jump(now)?;
                }
                if asked.peek().is_some_and(|time| *time <= now) {
                    self.face_noise(now)?;
                }
                while asked.next_if(|time| *time <= now).is_some() {
                    self.keep();
                }
            }
            self.restart(now)?;
        }
        Ok(())
    }

    /// Returns the shortest step to a time that is tried.
    fn shortest(&self, to: f64) -> f64 {
        SMALLEST * to.max(self.first)
    }

    /// Returns the first step after a jump or kink; the next one is `room` away.
    fn first_step(&self, room: f64) -> f64 {
        let charging = self
            .transient
            .supply
            .map(|supply| supply.time(self.capacitance(), self.transient.scene.voltage_v()));
        let spreading = self.transient.conductor.as_ref().map(Conductor::time);
        let times = self
            .viscous
            .shortest()
            .into_iter()
            .chain(charging.filter(|time| *time > 0.0))
            .chain(spreading);
        times.fold(room, f64::min) * FIRST
    }

    /// Takes the longest step within the tolerance that ends at `stop` at the latest; returns its end.
    fn step_within(&mut self, tolerance: f64, now: f64, stop: f64, length: &mut f64) -> Result<f64, PassEnd> {
        let period = self
            .transient
            .waveform
            .angular_frequency()
            .map_or(f64::INFINITY, |omega| std::f64::consts::TAU / omega);
        loop {
            let room = stop - now;
            let wanted = length.min(period / IN_PERIOD).min(self.graded([now, stop]));
            // The rest after a step is at least half of the step.
            let step = if wanted >= room {
                room
            } else if 1.5 * wanted > room {
                0.5 * room
            } else {
                wanted
            };
            let to = if step >= room { stop } else { now + step };
            let shortest = to - now <= self.shortest(to);
            if !self.smoothed.is_empty() {
                let ahead = (to + (to - now)).min(stop);
                self.smoothed = self.transient.continued(&self.smoothed, [now, to, ahead]);
            }
            if !shortest && !self.transient.is_straight(&self.smoothed, [now, to]) {
                *length = 0.5 * (to - now);
                continue;
            }
            let guess = self.extrapolated(to);
            match self.fed(now, to, guess.clone()) {
                Ok(found) => {
                    let error = ERROR_PER_DIFFERENCE * self.off_guess(&found, &guess, to);
                    let factor = 0.9 * (tolerance / error.max(1e-300)).powf(1.0 / 3.0);
                    if error > 2.0 * tolerance && !shortest {
                        *length = (to - now) * factor.clamp(0.2, 0.8);
                        continue;
                    }
                    self.advance(now, to, found);
                    let next = (to - now) * factor.clamp(0.3, GROWTH);
                    // A shortened step does not prevent longer steps later.
                    *length = if step < wanted && next < wanted {
                        wanted.min(next.max(*length))
                    } else {
                        next
                    };
                    return Ok(to);
                }
                Err(failure) if shortest => return Err(ended(failure, now, to)),
                Err(StepFailure::Work) => return Err(PassEnd::WorkLimit),
                Err(_) => *length = 0.5 * (to - now),
            }
        }
    }

    /// Steps to a time; divides the step if it fails.
    fn step_to(&mut self, now: f64, to: f64) -> Result<f64, PassEnd> {
        let (mut from, mut length) = (now, to - now);
        while from < to {
            let end = if from + length >= to - 1e-12 * to {
                to
            } else {
                from + length
            };
            let guess = self.extrapolated(end);
            match self.fed(from, end, guess) {
                Ok(found) => {
                    self.advance(from, end, found);
                    from = end;
                }
                Err(StepFailure::Work) => return Err(PassEnd::WorkLimit),
                Err(failure) if end - from <= self.shortest(end) => return Err(ended(failure, from, end)),
                Err(_) => length = 0.5 * (end - from),
            }
        }
        Ok(to)
    }

    /// Counts the work done; the parts of a step may start counting anew.
    fn count_work(&mut self) {
        self.pass.work += self.workspace.work();
        self.workspace.begin(self.transient.limit.get().less(self.pass.work));
    }

    fn advance(&mut self, from: f64, to: f64, found: StepState) {
        self.u = found.u;
        self.volts = found.volts;
        self.charged = found.charged;
        self.accept(to, to - from, false);
    }

    /// Accepts the state at the end of a step. A jump is an infinitely fast rise without losses.
    fn accept(&mut self, now: f64, step: f64, jump: bool) {
        let transient = self.transient;
        match transient.estimate.map(|estimate| estimate.how) {
            Some(StepEstimate::Linear) => self.viscous.advance_linearly(transient.problem.activity, step, &self.u),
            _ if self.measures => self.viscous.advance(transient.problem.activity, step, &self.u),
            _ => self.viscous.advance_later(transient.problem.activity, step, &self.u),
        }
        if let Some(unmoved) = &mut self.unmoved {
            unmoved.relax(step);
        }
        if self.measures {
            self.account([now - step, now], jump);
        }
        if !jump {
            self.pass.steps.push(now);
        }
        self.recent.push(PastState {
            time: now,
            u: self.u.clone(),
            drive: transient.voltage_along(&self.smoothed, now, Side::Before),
            potential: self
                .charged
                .as_ref()
                .map_or_else(Vec::new, |charged| charged.potential.clone()),
        });
        if self.recent.len() > 3 {
            self.recent.remove(0);
        }
        let [largest, watched] = match self.measures {
            true => {
                let field = transient.displacement(&self.u);
                [field.max_magnitude(), magnitude_at(&field, transient.watched.get())]
            }
            false => [0.0; 2],
        };
        self.pass.instants.push(Instant {
            time: now,
            voltage: self.volts,
            charge: self.content.charge,
            stored: self.content.elastic - self.elastic_at_rest + self.stored - self.stored_at_rest + self.springs
                - self.springs_at_rest,
            electric: self.electric,
            kinetic: 0.0,
            dissipated: self.dissipated,
            supplied: self.supplied,
            largest,
            watched,
            bodies: transient.problem.activity.grid().motions(&self.u),
            bars: transient.problem.activity.grid().bar_motions(&self.u),
        });
    }

    /// Records the last state as a requested one.
    fn keep(&mut self) {
        self.pass.kept.push(self.pass.instants.len() - 1);
        self.pass.fields.push(self.transient.displacement(&self.u));
    }
}

/// Converts the failure of a step between two times in s.
fn ended(failure: StepFailure, before: f64, after: f64) -> PassEnd {
    match failure {
        StepFailure::Lost(loss) => PassEnd::Lost { before, after, loss },
        StepFailure::Unknown => PassEnd::Unknown,
        StepFailure::Work => PassEnd::WorkLimit,
    }
}
