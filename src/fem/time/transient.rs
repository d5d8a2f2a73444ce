//! The transient problem that [`super::march`] solves: a membrane with a time-dependent voltage and creep.

use std::cell::Cell;

use super::leads::Conductor;
use super::smoothing::Smoothed;
use super::supply::Supply;
use crate::continuation::Problem;
use crate::operator::Activity;
use crate::work::WorkLimit;
use deaflow_field::Field;
use deaflow_scene::{Knot, Scene, Side, Waveform};

/// A transient problem.
pub struct TransientProblem<'a, F> {
    /// The membrane without the memory of its branches.
    pub problem: Problem<'a, F>,
    /// The scene.
    pub scene: &'a Scene,
    /// The voltage over time.
    pub waveform: Waveform,
    /// The resistance between source and electrodes.
    pub supply: Option<Supply>,
    /// The electrodes, if they have a resistance.
    pub conductor: Option<Conductor>,
    /// The jumps of the voltage and the kinks that end steps, and the end of the drive.
    pub knots: Vec<Knot>,
    /// Largest distance in V² of the squared voltage within a step from the line between its ends.
    pub kink: f64,
    /// Whether the drive has noise, which is averaged over steps.
    pub noisy: bool,
    /// The requested times of fields in s, in order.
    pub times: &'a [f64],
    /// Limit of work for a pass.
    pub limit: Cell<WorkLimit>,
    /// The watched corner (column, row).
    pub watched: Cell<[usize; 2]>,
    /// The fixed charge, if the drive is a charge.
    pub held: Option<FixedCharge<'a>>,
    /// How states are estimated, if they are not solved for.
    pub estimate: Option<Estimate<'a>>,
    /// Whether charges, energies and magnitudes are computed at each instant in addition to the requested fields.
    pub measures: bool,
}

/// A charge put on the electrodes before they are disconnected.
#[derive(Clone, Copy, Debug)]
pub struct FixedCharge<'a> {
    /// In C; `None` without electrodes.
    pub charge: f64,
    /// The membrane without the charge, if the charge was sprayed on and does not move.
    pub uncharged: Option<&'a Activity>,
}

/// Estimates of the states at the ends of steps, with the tangent of the half-active membrane at rest.
#[derive(Clone, Copy, Debug)]
pub struct Estimate<'a> {
    /// The method.
    pub how: StepEstimate,
    /// The half-active membrane.
    pub half_active: &'a Activity,
    /// Whether the branches of a membrane at rest are part of its material.
    pub in_law: bool,
}

/// How the states at the ends of steps are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepEstimate {
    /// For small strains: one linear system for each step.
    Linear,
    /// By this number of chord steps from the extrapolated state.
    Chord(u32),
}

impl<F> TransientProblem<'_, F> {
    /// Returns the load at a time relative to that of the scene.
    pub(super) fn share(&self, time: f64, side: Side) -> f64 {
        let amplitude = self.scene.voltage_v();
        match amplitude > 0.0 {
            true => (self.voltage(time, side) / amplitude).powi(2),
            false => 0.0,
        }
    }

    /// Returns the voltage at a time in V.
    pub(super) fn voltage(&self, time: f64, side: Side) -> f64 {
        self.waveform.voltage(self.scene.voltage_v(), time, side)
    }

    /// Returns the times in s and voltages in V of a step between which the voltage is linear.
    pub(super) fn points(&self, [from, to]: [f64; 2]) -> Vec<[f64; 2]> {
        self.waveform.points(self.scene.voltage_v(), from, to)
    }

    /// Returns the voltage at a time in V, or that of the drive averaged over steps.
    pub(super) fn voltage_along(&self, smoothed: &Smoothed, time: f64, side: Side) -> f64 {
        let voltage = self.voltage(time, side);
        match (smoothed.is_empty(), self.is_fed_slowly()) {
            (true, _) => voltage,
            (false, true) => smoothed.at(time),
            (false, false) => smoothed.at(time).max(0.0).sqrt().copysign(voltage),
        }
    }

    /// Returns the load at a time relative to that of the scene, or that of the drive averaged over steps.
    pub(super) fn share_along(&self, smoothed: &Smoothed, time: f64, side: Side) -> f64 {
        match self.scene.voltage_v() {
            amplitude if amplitude > 0.0 => (self.voltage_along(smoothed, time, side) / amplitude).powi(2),
            _ => 0.0,
        }
    }

    /// Returns the times in s and voltages in V of a step between which the voltage is linear, or those of the drive
    /// averaged over steps.
    pub(super) fn points_along(&self, smoothed: &Smoothed, step @ [from, to]: [f64; 2]) -> Vec<[f64; 2]> {
        match smoothed.is_empty() {
            true => self.points(step),
            false => [(from, Side::After), (to, Side::Before)]
                .map(|(time, side)| [time, self.voltage_along(smoothed, time, side)])
                .to_vec(),
        }
    }

    /// Returns what of a voltage is averaged over steps: the voltage if a source or leads charge the electrodes, since
    /// the charge follows it, otherwise its square.
    fn averaged(&self, voltage: f64) -> f64 {
        match self.is_fed_slowly() {
            true => voltage,
            false => voltage * voltage,
        }
    }

    /// Averages the drive over steps with these ends in s; empty without noise.
    pub(super) fn smoothed(&self, times: &[f64]) -> Smoothed {
        match self.noisy {
            true => Smoothed::over(times, |step| self.points(step), |voltage| self.averaged(voltage)),
            false => Smoothed::default(),
        }
    }

    /// Continues an average over a step with a look ahead.
    pub(super) fn continued(&self, smoothed: &Smoothed, times: [f64; 3]) -> Smoothed {
        smoothed.continued(times, |step| self.points(step), |voltage| self.averaged(voltage))
    }

    /// Returns the mean voltage in V over a step.
    pub(super) fn mean_voltage(&self, smoothed: &Smoothed, step: [f64; 2]) -> f64 {
        match &self.points_along(smoothed, step)[..] {
            [[_, first], [_, last]] => 0.5 * (first + last),
            points => mean(points, |first, last| 0.5 * (first + last)),
        }
    }

    /// Returns the mean load over a step relative to that of the scene: exactly for a table, whose rows may lie within
    /// the step, otherwise that in the middle.
    pub(super) fn mean_share(&self, smoothed: &Smoothed, step @ [from, to]: [f64; 2]) -> f64 {
        let amplitude = self.scene.voltage_v();
        if !smoothed.is_empty() {
            let [first, last] = step.map(|time| self.share_along(smoothed, time, Side::Before));
            return 0.5 * (first + last);
        }
        if self.waveform.table.is_none() || amplitude <= 0.0 {
            return self.share(0.5 * (from + to), Side::After);
        }
        let square = |first: f64, last: f64| (first * first + first * last + last * last) / 3.0;
        mean(&self.points(step), square) / amplitude.powi(2)
    }

    /// Returns whether the squared voltage within a step is near the line between its ends, or between those of the
    /// drive averaged over steps.
    pub(super) fn is_straight(&self, smoothed: &Smoothed, step @ [from, to]: [f64; 2]) -> bool {
        let points = self.points(step);
        let square = |at: usize| points[at][1].powi(2);
        let ends = self.points_along(smoothed, step);
        let [low, high] = [ends[0], ends[ends.len() - 1]].map(|[_, voltage]| voltage * voltage);
        let line = |time: f64| low + (high - low) * (time - from) / (to - from);
        (1..points.len() - 1).all(|at| (square(at) - line(points[at][0])).abs() <= self.kink)
    }

    /// Returns whether the voltage of the electrodes lags behind that of the drive.
    pub(super) fn is_fed_slowly(&self) -> bool {
        self.supply.is_some() || self.conductor.is_some()
    }

    /// Returns the state before the drive: without voltage and with all loads if sides are not held, else the mount.
    pub(super) fn rest(&self) -> Vec<f64> {
        let len = self.problem.activity.grid().layout().vector_len();
        self.problem.at_rest.map_or_else(|| vec![0.0; len], <[f64]>::to_vec)
    }

    /// Returns nodal displacements from that state.
    pub(super) fn moved(&self, u: &[f64]) -> Vec<f64> {
        match self.problem.at_rest {
            Some(rest) => u.iter().zip(rest).map(|(u, rest)| u - rest).collect(),
            None => u.to_vec(),
        }
    }

    /// Returns the displacement from that state at the cell corners, in mm.
    pub(super) fn displacement(&self, u: &[f64]) -> Field {
        self.problem.activity.grid().sample(&self.moved(u))
    }

    /// Returns the membrane with the additional terms of an activity.
    pub(super) fn problem_of<'c>(&'c self, activity: &'c Activity) -> Problem<'c, &'c F> {
        Problem {
            activity,
            laplacian: self.problem.laplacian,
            material: &self.problem.material,
            tolerance: self.problem.tolerance,
            at_rest: self.problem.at_rest,
        }
    }
}

/// Returns the mean over successive points of what is known between two of them from their voltages.
fn mean(points: &[[f64; 2]], between: impl Fn(f64, f64) -> f64) -> f64 {
    let parts = points.windows(2).map(|pair| {
        let [[start, first], [end, last]] = [pair[0], pair[1]];
        (end - start) * between(first, last)
    });
    let whole = points[points.len() - 1][0] - points[0][0];
    parts.sum::<f64>() / whole
}

/// Largest offset of a kink within steps over the noise of the drive: that of no row of 10⁶ with normal noise.
const NOISE: f64 = 5.0;

/// Returns the largest offset in V² of a kink that steps integrate, for one that is allowed without noise.
#[must_use]
pub fn kink_with_noise(waveform: &Waveform, kink: f64) -> f64 {
    waveform.noise().map_or(kink, |noise| kink.max(NOISE * noise))
}

/// Returns the knots of a waveform that end steps, and the end of the drive: jumps, and kinks whose offset is larger
/// than a number of V². Steps integrate other kinks.
#[must_use]
pub fn knots(waveform: &Waveform, end: f64, kink: f64) -> Vec<Knot> {
    let mut knots = waveform.knots(end);
    knots.retain(|knot| knot.jumps || knot.time <= 0.0 || knot.offset > kink);
    knots.push(Knot {
        time: end,
        jumps: false,
        offset: f64::INFINITY,
    });
    knots
}
