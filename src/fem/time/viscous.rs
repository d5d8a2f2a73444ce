//! Viscoelastic branches at the quadrature points of a membrane, and what they add to its energy.
//!
//! A branch adds ½g (A : c + A₃₃ j⁻² − ln det A − ln A₃₃ − 3) with g = G/(μλp²). A follows c⁻¹, and A₃₃ follows j², with its relaxation
//! time. Within a step A = Ã + c₁ c₁⁻¹ with a known Ã, and the second part is a pressure that drops out in plane stress: the equilibrium at
//! the end of a step is a minimum of an energy with fixed coefficients, w + Σ ½g (Ã : c + Ã₃₃ j⁻²), which is what
//! [`Memory`] is for. Arrays are those of [`metrics`].
//!
//! In the finite law A at the end of a step is a function of the strain there that has no such known part ([`super::finite`]). At a trial strain
//! c₁ the same mechanism carries A − σ c₁⁻¹, whose stress there is that of A, and whose change with strain is about that of A if σ c₁⁻¹
//! is about the part of A that follows: a few corrections of it end at the equilibrium ([`super::equilibrium`]).

use std::sync::Arc;

use super::coefficients::Coefficients;
use super::finite::{self, Step};
use crate::fem::layout::NodeLayout;
use crate::fem::memory::{Memory, NUMBERS};
use crate::fem::operator::{Activity, metrics};
use crate::scene::{Scene, ViscousLaw};

/// The branches of a membrane and their states.
#[derive(Clone, Debug)]
pub struct Viscous {
    layout: NodeLayout,
    law: ViscousLaw,
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
        let law = scene
            .effects
            .viscoelasticity
            .as_ref()
            .map_or(ViscousLaw::Linear, |effect| effect.law);
        let mut viscous = Self {
            layout,
            law,
            branches,
            states: Vec::new(),
            metric: Vec::new(),
        };
        if viscous.is_empty() {
            return viscous;
        }
        viscous.metric = metrics(activity, &vec![0.0; layout.vector_len()]);
        let Some(rest) = &scene.drive.rest else {
            viscous.states = vec![viscous.metric.clone(); viscous.branches.len()];
            return viscous;
        };
        let fresh = [prestretch.powi(2), 0.0, prestretch.powi(2), prestretch.powi(-4)];
        let lines = viscous.metric.chunks_exact(layout.part()).enumerate();
        let state: Vec<f64> = lines
            .flat_map(|(at, line)| line.iter().map(move |_| fresh[at % NUMBERS]))
            .collect();
        viscous.states = vec![state; viscous.branches.len()];
        viscous.relax(rest.value());
        viscous
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

    /// Whether what the branches add at the end of a step of so many seconds depends on the strain there.
    #[must_use]
    pub fn depends_on_end(&self, step: f64) -> bool {
        self.law == ViscousLaw::Finite && step > 0.0 && !self.is_empty()
    }

    /// An activity with what the branches add at the end of a step of so many seconds; of the finite law where it takes no time.
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

    /// The same at the end of a step that ends about a displacement.
    #[must_use]
    pub fn remembered_at(&self, activity: &Activity, step: f64, u: &[f64]) -> Activity {
        if !self.depends_on_end(step) {
            return self.remembered(activity, step);
        }
        let metric = metrics(activity, u);
        let mut sum = vec![0.0; metric.len()];
        for (branch, state) in self.branches.iter().zip(&self.states) {
            let Branch { modulus, time } = *branch;
            let step = Step::new(step / time);
            for at in places(self.layout, metric.len()) {
                let [state, from, to] = [state, &self.metric, &metric].map(|values| point(self.layout, values, at));
                let (end, share) = step.end(state, from, to);
                // No more than leaves it convex.
                let share = share.min(finite::least(end, to));
                let known: [f64; NUMBERS] = std::array::from_fn(|k| modulus * (end[k] - share * to[k]));
                for (number, known) in known.into_iter().enumerate() {
                    sum[place(self.layout, at, number)] += known;
                }
            }
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
            let r = step / branch.time;
            match self.law {
                ViscousLaw::Linear => {
                    let Coefficients { kept, before, now } = Coefficients::new(r);
                    let pairs = self.metric.iter().zip(&metric);
                    state
                        .iter_mut()
                        .zip(pairs)
                        .for_each(|(state, (old, new))| *state = kept * *state + before * old + now * new);
                }
                ViscousLaw::Finite => {
                    let step = Step::new(r);
                    change(self.layout, state, |at, state| {
                        let [from, to] = [&self.metric, &metric].map(|values| point(self.layout, values, at));
                        step.end(state, from, to).0
                    });
                }
            }
        }
        self.metric = metric;
    }

    /// Lets the branches relax for so many seconds at the strain that they are at.
    pub fn relax(&mut self, seconds: f64) {
        for (branch, state) in self.branches.iter().zip(&mut self.states) {
            let r = seconds / branch.time;
            match self.law {
                ViscousLaw::Linear => {
                    let kept = (-r).exp();
                    let pairs = state.iter_mut().zip(&self.metric);
                    pairs.for_each(|(state, metric)| *state = metric + kept * (*state - metric));
                }
                ViscousLaw::Finite => change(self.layout, state, |at, state| {
                    finite::relaxed(state, point(self.layout, &self.metric, at), r)
                }),
            }
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
                let a = point(self.layout, state, at);
                let volume = (a[0] * a[2] - a[1] * a[1]) * a[3];
                let twice = paired(a, point(self.layout, &self.metric, at)) - volume.ln() - 3.0;
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
                let [old, new] = [&self.metric, &later.metric].map(|values| point(self.layout, values, at));
                let [a, b] = [before, after].map(|values| point(self.layout, values, at));
                let mean: [f64; NUMBERS] = std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
                *work += 0.5 * branch.modulus * (paired(mean, new) - paired(mean, old));
            }
        }
        work
    }
}

/// Where a number of a point stands. Points are counted along the elements of a row first, then by the points of an element, then by rows.
fn place(layout: NodeLayout, at: usize, number: usize) -> usize {
    let part = layout.part();
    let (line, element) = (at / part, at % part);
    (line * NUMBERS + number) * part + element
}

/// The numbers of a point.
fn point(layout: NodeLayout, values: &[f64], at: usize) -> [f64; NUMBERS] {
    std::array::from_fn(|number| values[place(layout, at, number)])
}

/// The points of elements, without those that only fill up rows, in so many numbers.
fn places(layout: NodeLayout, numbers: usize) -> impl Iterator<Item = usize> {
    let lines = numbers / (NUMBERS * layout.part());
    (0..lines).flat_map(move |line| (0..layout.columns()).map(move |column| line * layout.part() + column))
}

/// Changes the numbers of each point to others.
fn change(layout: NodeLayout, values: &mut [f64], mut to: impl FnMut(usize, [f64; NUMBERS]) -> [f64; NUMBERS]) {
    for at in places(layout, values.len()) {
        let changed = to(at, point(layout, values, at));
        for (number, changed) in changed.into_iter().enumerate() {
            values[place(layout, at, number)] = changed;
        }
    }
}

/// A : c + A₃₃ j⁻² from c⁻¹ and j².
fn paired([xx, xy, yy, normal]: [f64; NUMBERS], [ixx, ixy, iyy, square]: [f64; NUMBERS]) -> f64 {
    square * (xx * iyy - 2.0 * xy * ixy + yy * ixx) + normal / square
}
