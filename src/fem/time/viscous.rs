//! Viscoelastic branches at the quadrature points of a membrane, and what they add to its energy.
//!
//! A branch adds ½g (A : c + A₃₃ j⁻² − ln det A − ln A₃₃ − 3) with g = G/(μλp²). A follows c⁻¹, and A₃₃ follows j², with its relaxation
//! time. Within a step A = Ã + c₁ c₁⁻¹ with a known Ã, and the second part is a pressure that drops out in plane stress: the equilibrium at
//! the end of a step is a minimum of an energy with fixed coefficients, w + Σ ½g (Ã : c + Ã₃₃ j⁻²), which is what
//! [`Memory`] is for. Arrays are those of [`metrics`].

use std::sync::Arc;

use super::coefficients::Coefficients;
use crate::fem::layout::NodeLayout;
use crate::fem::memory::{Memory, NUMBERS};
use crate::fem::operator::{Activity, metrics};
use crate::scene::Scene;

/// The branches of a membrane and their states.
#[derive(Clone, Debug)]
pub struct Viscous {
    layout: NodeLayout,
    branches: Arc<[Branch]>,
    /// A of each branch, at all points.
    states: Vec<Vec<f64>>,
    /// c⁻¹ and j² at the beginning of the next step.
    metric: Vec<f64>,
}

/// A branch in the units of the membrane.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Branch {
    /// g.
    modulus: f64,
    /// τ in s.
    time: f64,
}

impl Viscous {
    /// The branches of a scene after the rest at the prestretch that its drive names; relaxed where it names none.
    #[must_use]
    pub fn new(scene: &Scene, activity: &Activity) -> Self {
        let prestretch = scene.mean_prestretch();
        let stiffness = scene.shear_modulus_pa() * prestretch.powi(2);
        let named = scene.effects.viscoelasticity.iter().flat_map(|effect| &effect.branches);
        let branches: Arc<[Branch]> = named
            .map(|branch| Branch {
                modulus: branch.modulus.value() / stiffness,
                time: branch.time.value(),
            })
            .filter(|branch| branch.modulus > 0.0)
            .collect();
        let layout = activity.grid().layout();
        if branches.is_empty() {
            return Self {
                layout,
                branches,
                states: Vec::new(),
                metric: Vec::new(),
            };
        }
        let metric = metrics(activity, &vec![0.0; layout.vector_len()]);
        let fresh = [prestretch.powi(2), 0.0, prestretch.powi(2), prestretch.powi(-4)];
        let state = |branch: &Branch| {
            let left = scene
                .drive
                .rest
                .as_ref()
                .map_or(0.0, |rest| (-rest.value() / branch.time).exp());
            let lines = metric.chunks_exact(layout.part()).enumerate();
            lines
                .flat_map(|(at, line)| {
                    line.iter()
                        .map(move |relaxed| relaxed + (fresh[at % NUMBERS] - relaxed) * left)
                })
                .collect()
        };
        Self {
            layout,
            states: branches.iter().map(state).collect(),
            branches,
            metric,
        }
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.branches.is_empty()
    }

    /// The shortest relaxation time in s.
    #[must_use]
    pub fn shortest(&self) -> Option<f64> {
        self.branches.iter().map(|branch| branch.time).reduce(f64::min)
    }

    /// An activity with what the branches add at the end of a step of so many seconds.
    #[must_use]
    pub fn remembered(&self, activity: &Activity, step: f64) -> Activity {
        if self.is_empty() {
            return activity.clone();
        }
        let mut sum = vec![0.0; self.metric.len()];
        for (branch, state) in self.branches.iter().zip(&self.states) {
            let Coefficients { kept, before, .. } = Coefficients::new(step / branch.time);
            let (kept, before) = (branch.modulus * kept, branch.modulus * before);
            let pairs = state.iter().zip(&self.metric);
            sum.iter_mut()
                .zip(pairs)
                .for_each(|(sum, (state, metric))| *sum += kept * state + before * metric);
        }
        activity.with_memory(Memory::new(self.layout, sum))
    }

    /// Moves the branches to the end of a step that ends at a displacement.
    pub fn advance(&mut self, activity: &Activity, step: f64, u: &[f64]) {
        if self.is_empty() {
            return;
        }
        let metric = metrics(activity, u);
        for (branch, state) in self.branches.iter().zip(&mut self.states) {
            let Coefficients { kept, before, now } = Coefficients::new(step / branch.time);
            let pairs = self.metric.iter().zip(&metric);
            state
                .iter_mut()
                .zip(pairs)
                .for_each(|(state, (old, new))| *state = kept * *state + before * old + now * new);
        }
        self.metric = metric;
    }

    /// Lets the branches relax for so many seconds at the strain that they are at.
    pub fn relax(&mut self, seconds: f64) {
        for (branch, state) in self.branches.iter().zip(&mut self.states) {
            let kept = (-seconds / branch.time).exp();
            let pairs = state.iter_mut().zip(&self.metric);
            pairs.for_each(|(state, metric)| *state = metric + kept * (*state - metric));
        }
    }

    /// Strains the branches at once.
    pub fn strain(&mut self, activity: &Activity, u: &[f64]) {
        if !self.is_empty() {
            self.metric = metrics(activity, u);
        }
    }

    /// What the branches store in this state, per area in units of μH, at each point.
    #[must_use]
    pub fn stored(&self) -> Vec<f64> {
        let lines = self.metric.len() / NUMBERS;
        let mut stored = vec![0.0; lines];
        for (branch, state) in self.branches.iter().zip(&self.states) {
            for (at, stored) in stored.iter_mut().enumerate() {
                let a = self.point(state, at);
                let volume = (a[0] * a[2] - a[1] * a[1]) * a[3];
                let twice = paired(a, self.point(&self.metric, at)) - volume.ln() - 3.0;
                *stored += 0.5 * branch.modulus * twice;
            }
        }
        stored
    }

    /// The work that a step did on the branches, from this state to a later one: the mean of their stress at both ends times the change of
    /// strain.
    #[must_use]
    pub fn work_to(&self, later: &Self) -> Vec<f64> {
        let mut work = vec![0.0; self.metric.len() / NUMBERS];
        let states = self.states.iter().zip(&later.states);
        for (branch, (before, after)) in self.branches.iter().zip(states) {
            for (at, work) in work.iter_mut().enumerate() {
                let [old, new] = [self.point(&self.metric, at), self.point(&later.metric, at)];
                let [a, b] = [self.point(before, at), self.point(after, at)];
                let mean: [f64; NUMBERS] = std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
                *work += 0.5 * branch.modulus * (paired(mean, new) - paired(mean, old));
            }
        }
        work
    }

    /// The numbers of a point, which are counted along the elements of a row first, then by the points of an element, then by rows.
    fn point(&self, values: &[f64], at: usize) -> [f64; NUMBERS] {
        let part = self.layout.part();
        let (line, element) = (at / part, at % part);
        std::array::from_fn(|number| values[(line * NUMBERS + number) * part + element])
    }
}

/// A : c + A₃₃ j⁻² from c⁻¹ and j².
fn paired([xx, xy, yy, normal]: [f64; NUMBERS], [ixx, ixy, iyy, square]: [f64; NUMBERS]) -> f64 {
    square * (xx * iyy - 2.0 * xy * ixy + yy * ixx) + normal / square
}
