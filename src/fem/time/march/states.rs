//! The state at the end of a step: a stable equilibrium, or an estimate of it.

use super::super::equilibrium::equilibrium;
use super::super::transient::{Estimate, StepEstimate};
use super::{March, PastState};
use crate::continuation::{Problem, StepFailure};
use crate::material::Material;
use crate::newton::{self, ChordSteps, NewtonFailure};
use crate::operator::{Activity, Operator};
use crate::response::INNER;
use crate::stability::{Stability, judge};

/// Additional chord steps if there is no earlier state to start from.
const MORE_CHORD_STEPS: u32 = 2;
/// Relative residual of linear systems whose solution is not corrected later.
const INNER_UNCORRECTED: f64 = 1e-5;

impl<L: Material, F: Fn(f64) -> L> March<'_, '_, F> {
    /// Returns the stable state at the end of a step, which lasts some seconds, at a fraction of the load; starts from
    /// a guess, or else from the state before.
    pub(super) fn solve(
        &mut self,
        activity: &Activity,
        seconds: f64,
        share: f64,
        guess: Vec<f64>,
    ) -> Result<Vec<f64>, StepFailure> {
        let transient = self.transient;
        if let Some(estimate) = transient.estimate {
            return self.estimate(estimate, seconds, share, guess);
        }
        let material = (transient.problem.material)(share);
        self.count_work();
        let mut last = None;
        for mut u in [guess, self.u.clone()] {
            let problem = Problem {
                activity,
                laplacian: transient.problem.laplacian,
                material: (),
                tolerance: transient.problem.tolerance,
                at_rest: None,
            };
            let workspace = &mut *self.workspace;
            match equilibrium(&problem, &material, &mut self.viscous, seconds, &mut u, workspace) {
                Ok((activity, progress)) => {
                    self.pass.newton_steps += progress.steps;
                    self.pass.residual = progress.residual;
                    let operator = Operator::new(&material, &activity);
                    let stability = judge(&operator, problem.laplacian, &u, workspace);
                    self.viscous.recycle(activity);
                    match stability {
                        Stability::Stable { .. } => return Ok(u),
                        Stability::Lost(loss) => last = Some(StepFailure::Lost(loss)),
                    }
                }
                Err((failure, progress)) => {
                    self.pass.newton_steps += progress.steps;
                    last = Some(failure.into());
                    if failure == NewtonFailure::Work {
                        break;
                    }
                }
            }
        }
        Err(last.unwrap_or(StepFailure::Unknown))
    }

    /// Returns an estimate of the state at the end of a step, from a guess. Steps of zero length have no earlier states
    /// to extrapolate.
    pub(super) fn estimate(
        &mut self,
        Estimate { how, half_active, .. }: Estimate<'_>,
        seconds: f64,
        share: f64,
        guess: Vec<f64>,
    ) -> Result<Vec<f64>, StepFailure> {
        let transient = self.transient;
        let material = (transient.problem.material)(share);
        self.count_work();
        if self.workspace.is_spent() {
            return Err(StepFailure::Work);
        }
        let remembered = self.viscous.remembered(transient.problem.activity, seconds);
        let gamma = self.viscous.unrelaxed_modulus(seconds);
        let at_rest = (self.unmoved.as_mut()).map(|unmoved| unmoved.remembered(half_active, seconds));
        let stiffened = match at_rest {
            None => (transient.problem.material)(share).with_unrelaxed(gamma),
            Some(_) => None,
        };
        let unit = stiffened.as_ref().map_or(1.0, |_| 1.0 + gamma);
        let actual = Operator::new(&material, &remembered);
        let linear = Operator::new(
            stiffened.as_ref().unwrap_or(&material),
            at_rest.as_ref().unwrap_or(half_active),
        );
        let rest = vec![0.0; guess.len()];
        let (mut u, count, inner) = match how {
            StepEstimate::Linear => (rest.clone(), 1, INNER_UNCORRECTED),
            StepEstimate::Chord(steps) if seconds == 0.0 => (guess, steps + MORE_CHORD_STEPS, INNER),
            StepEstimate::Chord(steps) => (guess, steps, INNER),
        };
        let found = newton::chord(
            [&actual, &linear],
            transient.problem.laplacian,
            ChordSteps { count, inner, unit },
            &rest,
            &mut u,
            self.workspace,
        );
        self.viscous.recycle(remembered);
        if let (Some(unmoved), Some(at_rest)) = (&mut self.unmoved, at_rest) {
            unmoved.recycle(at_rest);
        }
        match found {
            Ok(progress) => {
                self.pass.newton_steps += progress.steps;
                self.pass.residual = progress.residual;
                Ok(u)
            }
            Err(_) => Err(StepFailure::Unknown),
        }
    }

    /// Extrapolates numbers to a later time by the polynomial through those of the last states.
    pub(super) fn polynomial(&self, to: f64, count: usize, of: impl Fn(&PastState) -> &Vec<f64>) -> Vec<f64> {
        let mut guess = vec![0.0; count];
        for (weight, past) in self.weights(to) {
            guess
                .iter_mut()
                .zip(of(past))
                .for_each(|(sum, value)| *sum += weight * value);
        }
        guess
    }

    /// Returns the last states with their weights in that polynomial.
    pub(super) fn weights(&self, to: f64) -> impl Iterator<Item = (f64, &PastState)> {
        self.recent.iter().enumerate().map(move |(at, past)| {
            let others = self.recent.iter().enumerate().filter(move |(other, _)| *other != at);
            let weight: f64 = others
                .map(|(_, other)| (to - other.time) / (past.time - other.time))
                .product();
            (weight, past)
        })
    }

    /// Extrapolates the state to a later time by the polynomial through the last states.
    pub(super) fn extrapolated(&self, to: f64) -> Vec<f64> {
        let mut guess = self.polynomial(to, self.u.len(), |past| &past.u);
        if self.recent.is_empty() {
            guess.copy_from_slice(&self.u);
        }
        self.transient.problem.activity.grid().settle(&mut guess);
        guess
    }
}
