//! The start of the drive, and jumps of the voltage.

use super::super::transient::FixedCharge;
use super::{March, PastState, ended};
use crate::charge::{self, ChargedLoading};
use crate::continuation::{LoadRange, Loading, LoadingEnd, Problem};
use crate::material::Material;
use crate::operator::Activity;
use crate::time::pass::PassEnd;
use deaflow_scene::Side;

impl<L: Material, F: Fn(f64) -> L> March<'_, '_, F> {
    /// Applies the initial loads from rest: the loads of bodies and the voltage at 0 s.
    pub(super) fn begin(&mut self) -> Result<(), PassEnd> {
        let transient = self.transient;
        // Electrodes behind a source start charging at that voltage.
        let share = match transient.is_fed_slowly() {
            false => transient.share_along(&self.smoothed, 0.0, Side::After),
            true => 0.0,
        };
        if let Some(estimate) = transient.estimate {
            let start = self.u.clone();
            self.u = self
                .estimate(estimate, 0.0, share, start)
                .map_err(|_| PassEnd::Unknown)?;
            self.volts = transient.voltage_along(&self.smoothed, 0.0, Side::After);
            self.accept(0.0, 0.0, true);
            return Ok(());
        }
        let loading = match transient.held {
            None => {
                let activity = self.viscous.remembered(transient.problem.activity, 0.0);
                self.load(&activity, 0.0, share)
            }
            Some(held) => self.charge(held),
        };
        self.pass.newton_steps += loading.steps;
        self.pass.residual = loading.residual;
        if loading.ending != LoadingEnd::Stable {
            return Err(PassEnd::AtOnce(loading.ending));
        }
        if !transient.is_fed_slowly() && transient.held.is_none() {
            self.volts = transient.voltage_along(&self.smoothed, 0.0, Side::After);
        }
        self.accept(0.0, 0.0, true);
        if transient.conductor.is_some() {
            self.restart(0.0)?;
        }
        Ok(())
    }

    /// Puts a charge on the membrane at rest.
    pub(super) fn charge(&mut self, FixedCharge { charge, uncharged }: FixedCharge<'_>) -> Loading {
        self.count_work();
        let transient = self.transient;
        let activity = self
            .viscous
            .remembered(uncharged.unwrap_or(transient.problem.activity), 0.0);
        let problem = transient.problem_of(&activity);
        let (u, workspace) = (&mut self.u, &mut *self.workspace);
        let ChargedLoading { loading, charged } = match uncharged {
            None => charge::conducting(&problem, transient.scene, charge, u, workspace),
            Some(_) => charge::immobile(&problem, transient.scene, charge, u, workspace),
        };
        self.volts = charged.and_then(|charged| charged.voltage).unwrap_or(0.0);
        loading
    }

    /// Raises the load from one fraction to a higher one; from rest if the first is 0.
    pub(super) fn load(&mut self, activity: &Activity, from: f64, to: f64) -> Loading {
        self.count_work();
        let problem = &self.transient.problem;
        let problem = Problem {
            activity,
            laplacian: problem.laplacian,
            material: |share: f64| (problem.material)(share * to),
            tolerance: problem.tolerance,
            at_rest: problem.at_rest,
        };
        let workspace = &mut *self.workspace;
        if from > 0.0 {
            let range = LoadRange {
                from: from / to,
                to: 1.0,
                step: 1.0,
            };
            return problem.raise_load(range, &mut self.u, workspace);
        }
        if to > 0.0 {
            return problem.load(&mut self.u, workspace);
        }
        match problem.rest(&mut self.u, workspace) {
            Err(loading) => loading,
            Ok(()) => Loading {
                ending: LoadingEnd::Stable,
                steps: 0,
                residual: 0.0,
                pointwise: false,
            },
        }
    }

    /// Applies a jump of the voltage: the branches have no time to follow.
    pub(super) fn jump(&mut self, now: f64) -> Result<(), PassEnd> {
        if self.transient.is_fed_slowly() {
            // The charge does not jump.
            return self.restart(now);
        }
        let before = self.transient.share(now, Side::Before);
        let after = self.transient.share_along(&self.smoothed, now, Side::After);
        self.is_off_average = false;
        if let Some(estimate) = self.transient.estimate {
            let start = self.u.clone();
            let found = self.estimate(estimate, 0.0, after, start);
            self.u = found.map_err(|_| PassEnd::Unknown)?;
        } else if after > before {
            let activity = self.viscous.remembered(self.transient.problem.activity, 0.0);
            let reached = self.u.clone();
            let loading = self.load(&activity, before.max(f64::MIN_POSITIVE), after);
            self.pass.newton_steps += loading.steps;
            if loading.ending != LoadingEnd::Stable {
                self.u = reached;
                return Err(match loading.ending {
                    LoadingEnd::Lost { loss, .. } => PassEnd::Lost {
                        before: now,
                        after: now,
                        loss,
                    },
                    LoadingEnd::WorkLimit { .. } => PassEnd::WorkLimit,
                    LoadingEnd::Stable | LoadingEnd::Unknown { .. } => PassEnd::Unknown,
                });
            }
        } else {
            let start = self.u.clone();
            let activity = self.transient.problem.activity;
            let found = self.solve(activity, 0.0, after, start);
            self.u = found.map_err(|failure| ended(failure, now, now))?;
        }
        self.recent.clear();
        self.volts = self.transient.voltage_along(&self.smoothed, now, Side::After);
        self.accept(now, 0.0, true);
        Ok(())
    }

    /// Discards the earlier states, which cannot be extrapolated across a jump. If the leads have jumped, so has the
    /// potential.
    pub(super) fn restart(&mut self, now: f64) -> Result<(), PassEnd> {
        let potential = match (&self.transient.conductor, &self.charged) {
            (Some(conductor), Some(charged)) => {
                let circuit = self.circuit(conductor, &self.u);
                let volts = self.transient.voltage(now, Side::After);
                let found = conductor.step(0.0, &charged.charge, [&circuit; 2], [volts; 2]);
                found.ok_or(PassEnd::Unknown)?
            }
            _ => Vec::new(),
        };
        self.recent = vec![PastState {
            time: now,
            u: self.u.clone(),
            drive: self.transient.voltage_along(&self.smoothed, now, Side::Before),
            potential,
        }];
        Ok(())
    }
}
