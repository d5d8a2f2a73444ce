//! A membrane whose voltage changes in time and whose elastomer creeps: the problem that [`super::march`] solves.

use std::cell::Cell;

use super::leads::Conductor;
use super::supply::Supply;
use crate::continuation::Problem;
use crate::operator::Activity;
use crate::work::WorkLimit;
use deaflow_scene::{Scene, Side, Waveform};

/// What is followed.
pub struct TransientProblem<'a, F> {
    /// The membrane without what its branches remember.
    pub problem: Problem<'a, F>,
    /// The scene.
    pub scene: &'a Scene,
    /// How its voltage changes.
    pub waveform: Waveform,
    /// What stands between the voltage and the electrodes.
    pub supply: Option<Supply>,
    /// The electrodes, where charge takes its time to spread over them.
    pub conductor: Option<Conductor>,
    /// The times in s at which fields are wanted, in order.
    pub times: &'a [f64],
    /// Work for a pass.
    pub limit: Cell<WorkLimit>,
    /// The corner (column, row) whose displacement is followed.
    pub watched: Cell<[usize; 2]>,
    /// The charge that is held, in place of a voltage.
    pub held: Option<FixedCharge<'a>>,
    /// How states are estimated where they are not solved for.
    pub estimate: Option<Estimate<'a>>,
    /// Whether charges, energies and magnitudes of each instant are wanted beside the fields that were asked for.
    pub measures: bool,
}

/// A charge that was put on the electrodes, which then were cut off.
#[derive(Clone, Copy, Debug)]
pub struct FixedCharge<'a> {
    /// In C; none where there is no electrode.
    pub charge: f64,
    /// The membrane without the charge, where that was sprayed and stays where it is.
    pub uncharged: Option<&'a Activity>,
}

/// Estimates of the states at the ends of steps, with the tangent of the half-active membrane at rest.
#[derive(Clone, Copy, Debug)]
pub struct Estimate<'a> {
    /// How.
    pub how: StepEstimate,
    /// The half-active membrane.
    pub half_active: &'a Activity,
    /// Whether branches of a membrane at rest are part of its law.
    pub in_law: bool,
}

/// How the states at the ends of steps are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepEstimate {
    /// As if strains were small: one linear system for each step.
    Linear,
    /// By so many chord steps from where the states before lead.
    Chord(u32),
}

impl<F> TransientProblem<'_, F> {
    /// The load at a time, over that of the scene.
    pub(super) fn share(&self, time: f64, side: Side) -> f64 {
        let amplitude = self.scene.voltage_v();
        match amplitude > 0.0 {
            true => (self.voltage(time, side) / amplitude).powi(2),
            false => 0.0,
        }
    }

    /// The voltage at a time in V.
    pub(super) fn voltage(&self, time: f64, side: Side) -> f64 {
        self.waveform.voltage(self.scene.voltage_v(), time, side)
    }

    /// Whether the electrodes do not have the voltage of the drive at once.
    pub(super) fn is_fed_slowly(&self) -> bool {
        self.supply.is_some() || self.conductor.is_some()
    }

    /// The membrane with something beside its law.
    pub(super) fn problem_of<'c>(&'c self, activity: &'c Activity) -> Problem<'c, &'c F> {
        Problem {
            activity,
            laplacian: self.problem.laplacian,
            material: &self.problem.material,
            tolerance: self.problem.tolerance,
        }
    }
}
