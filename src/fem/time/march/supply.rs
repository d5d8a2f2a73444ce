//! The voltage of the electrodes at the end of a step: given by the drive, by a charge, behind a source, or by
//! conduction from the leads.

use super::super::equilibrium::at_charge;
use super::super::leads::{Charged, Circuit, Conductor, FIRST_STAGE, Relaxation};
use super::{March, StepState};
use crate::charge::{self, ChargedState};
use crate::continuation::{Loading, StepFailure};
use crate::kinematics::deformation_of_metric;
use crate::material::Material;
use crate::operator::metrics;
use deaflow_scene::Side;

/// Largest number of solutions for the voltage behind a source, and the change at which it has converged, relative to
/// that of the scene.
const MOST_ITERATIONS: usize = 30;
const SETTLED: f64 = 1e-10;

impl<L: Material, F: Fn(f64) -> L> March<'_, '_, F> {
    /// Returns the stable state at the end of a step and the voltage of its electrodes.
    pub(super) fn fed(&mut self, from: f64, to: f64, guess: Vec<f64>) -> Result<StepState, StepFailure> {
        let transient = self.transient;
        if let (Some(conductor), Some(charged)) = (&transient.conductor, &self.charged) {
            let charged = charged.clone();
            return self.wired(conductor, &charged, [from, to], guess);
        }
        let activity = transient.problem.activity;
        if let Some(held) = transient.held {
            return match held.uncharged {
                None if held.charge > 0.0 => self.held(held.charge, to - from, &guess),
                // The material with sprayed charge is that without voltage.
                _ => Ok(StepState {
                    u: self.solve(activity, to - from, 0.0, guess)?,
                    volts: 0.0,
                    charged: None,
                }),
            };
        }
        let Some(supply) = transient.supply else {
            return Ok(StepState {
                u: self.solve(
                    activity,
                    to - from,
                    transient.share_along(&self.smoothed, to, Side::Before),
                    guess,
                )?,
                volts: transient.voltage_along(&self.smoothed, to, Side::Before),
                charged: None,
            });
        };
        let full = transient.scene.voltage_v();
        let (before, points) = (self.capacitance(), transient.points_along(&self.smoothed, [from, to]));
        let charge = before * self.volts;
        let (mut volts, mut u) = (self.volts, guess);
        let mut last: Option<[f64; 2]> = None;
        for _ in 0..MOST_ITERATIONS {
            let share = if full > 0.0 { (volts / full).powi(2) } else { 0.0 };
            u = self.solve(activity, to - from, share, u)?;
            let reached = std::mem::replace(&mut self.u, u);
            let after = self.capacitance();
            u = std::mem::replace(&mut self.u, reached);
            let target = match after > 0.0 {
                true => supply.charge_along(charge, [before, after], &points) / after,
                false => 0.0,
            };
            let off = target - volts;
            if off.abs() <= SETTLED * full {
                return Ok(StepState {
                    u,
                    volts,
                    charged: None,
                });
            }
            // A secant step, if it lies between the previous and the target value.
            let slope = last.map_or(-1.0, |[other, then]| (off - then) / (volts - other));
            last = Some([volts, off]);
            volts = if slope < -0.2 { volts - off / slope } else { target };
        }
        Err(StepFailure::Unknown)
    }

    /// Returns the stable state at the end of a step of some seconds with a charge on conducting electrodes.
    pub(super) fn held(&mut self, charge: f64, seconds: f64, guess: &[f64]) -> Result<StepState, StepFailure> {
        let transient = self.transient;
        let problem = transient.problem_of(transient.problem.activity);
        self.count_work();
        let mut failure = StepFailure::Unknown;
        for start in [guess, &self.u.clone()] {
            let mut loading = Loading::from(0.0);
            let room = (&mut *self.workspace, &mut loading);
            let branches = (&mut self.viscous, seconds);
            let found = at_charge(&problem, (transient.scene, charge), branches, start, room);
            self.pass.newton_steps += loading.steps;
            self.pass.residual = loading.residual;
            match found {
                Ok(ChargedState { u, charged, .. }) => {
                    return Ok(StepState {
                        u,
                        volts: charged.voltage.unwrap_or(0.0),
                        charged: None,
                    });
                }
                Err(charge::ChargeFailure::Work) => return Err(StepFailure::Work),
                Err(charge::ChargeFailure::Lost(loss, _)) => failure = StepFailure::Lost(loss),
                Err(charge::ChargeFailure::Unknown) => {}
            }
        }
        Err(failure)
    }

    /// Returns the same with electrodes that charge from their leads; solves for potentials and displacement
    /// alternately.
    pub(super) fn wired(
        &mut self,
        conductor: &Conductor,
        charged: &Charged,
        [from, to]: [f64; 2],
        guess: Vec<f64>,
    ) -> Result<StepState, StepFailure> {
        let transient = self.transient;
        let before = self.circuit(conductor, &self.u);
        let points = transient.points_along(&self.smoothed, [from, to]);
        let last = points[points.len() - 1][1];
        let first = match points.len() {
            2 => transient.voltage_along(&self.smoothed, from + FIRST_STAGE * (to - from), Side::After),
            // The weights of the stages integrate the voltage exactly.
            _ => (transient.mean_voltage(&self.smoothed, [from, to]) - FIRST_STAGE * last) / (1.0 - FIRST_STAGE),
        };
        let volts = [first, last];
        let (mut u, mut relaxation) = (guess, Relaxation::default());
        for _ in 0..MOST_ITERATIONS {
            let after = self.circuit(conductor, &u);
            let found = conductor.step(to - from, &charged.charge, [&before, &after], volts);
            let potential = found.ok_or(StepFailure::Unknown)?;
            if relaxation.off(&potential) <= SETTLED * transient.scene.voltage_v() {
                let charged = conductor.charged(potential, &after, charged);
                return Ok(StepState {
                    u,
                    volts: charged.voltage,
                    charged: Some(charged),
                });
            }
            let (activity, share) = conductor.loads(relaxation.next(potential));
            u = self.solve(&activity, to - from, share, u)?;
        }
        Err(StepFailure::Unknown)
    }

    /// Returns the circuit of the electrodes at a displacement. The material gives the dependence of its capacitance on
    /// the stretch.
    pub(super) fn circuit(&self, conductor: &Conductor, u: &[f64]) -> Circuit {
        let laws = [0.0, 1.0].map(|share| (self.transient.problem.material)(share));
        let scale = 2.0 * self.units.energy / self.transient.scene.voltage_v().powi(2);
        conductor.circuit(&metrics(self.transient.problem.activity, u), |point| {
            let f = deformation_of_metric(point);
            scale * (laws[0].energy(f, 1.0) - laws[1].energy(f, 1.0))
        })
    }

    /// Returns the difference of the potentials at the end of a step from the extrapolated ones, less a voltage in
    /// V, as a displacement.
    pub(super) fn charged_off(&self, found: &StepState, to: f64, less: f64) -> f64 {
        match (&self.transient.conductor, &found.charged) {
            (Some(conductor), Some(charged)) => {
                let guess = self.polynomial(to, charged.potential.len(), |past| &past.potential);
                let less = conductor.difference(&[less], &[0.0]);
                (conductor.difference(&charged.potential, &guess) - less).max(0.0)
            }
            _ => 0.0,
        }
    }

    /// Returns the capacitance of the electrodes in their current state in F.
    pub(super) fn capacitance(&self) -> f64 {
        let full = self.transient.scene.voltage_v();
        match full > 0.0 {
            true => self.measure_at(full).charge / full,
            false => 0.0,
        }
    }
}
