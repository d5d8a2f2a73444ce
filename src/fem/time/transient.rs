//! The transient problem that [`super::march`] solves: a membrane with a time-dependent voltage and creep.

use std::cell::Cell;

use super::leads::Conductor;
use super::supply::Supply;
use crate::continuation::Problem;
use crate::operator::Activity;
use crate::work::WorkLimit;
use deaflow_scene::{Scene, Side, Waveform};

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

    /// Returns whether the voltage of the electrodes lags behind that of the drive.
    pub(super) fn is_fed_slowly(&self) -> bool {
        self.supply.is_some() || self.conductor.is_some()
    }

    /// Returns the membrane with the additional terms of an activity.
    pub(super) fn problem_of<'c>(&'c self, activity: &'c Activity) -> Problem<'c, &'c F> {
        Problem {
            activity,
            laplacian: self.problem.laplacian,
            material: &self.problem.material,
            tolerance: self.problem.tolerance,
        }
    }
}
