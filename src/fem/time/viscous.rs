//! Viscoelastic branches at the quadrature points of a membrane, and their part of its energy.
//!
//! A branch adds ½g (A : c + A₃₃ j⁻² − ln det A − ln A₃₃ − 3) with g = G/(μλp²). A follows c⁻¹, and A₃₃ follows j²,
//! with its relaxation time. Within a step A = Ã + c₁ c₁⁻¹ with a known Ã. The second part is a pressure that has no
//! effect in plane stress, so the equilibrium at the end of a step minimises an energy with fixed coefficients, w + Σ
//! ½g (Ã : c + Ã₃₃ j⁻²), which [`Memory`] implements. Arrays have the layout of [`metrics`].
//!
//! In the finite law A at the end of a step is a function of the strain there without such a known part
//! ([`super::finite`]). At a trial strain c₁ the same mechanism uses A − σ c₁⁻¹. Its stress there is that of A, and its
//! change with strain about that of A if σ c₁⁻¹ is about the part of A that follows the strain: a few corrections
//! converge to the equilibrium ([`super::equilibrium`]).

use std::mem;
use std::ops::Range;
use std::sync::Arc;

use crate::registers::dispatch;

use super::coefficients::Coefficients;
use super::finite::{self, Step};
use crate::layout::NodeLayout;
use crate::memory::{self, Memory, NUMBERS, lines};
use crate::operator::{Activity, metrics, write_metrics};
use crate::stored::{integral, integral_of_rows, sum_of_logarithms};
use deaflow_scene::{Scene, ViscousLaw};

/// Factor of a displacement in the linearisation.
const LINEAR_FACTOR: f64 = 1e-3;

/// The branches of a membrane and their states.
#[derive(Clone, Debug)]
pub struct Viscous {
    layout: NodeLayout,
    law: ViscousLaw,
    branches: Arc<[Branch]>,
    /// A of each branch at all points.
    states: Vec<Vec<f64>>,
    /// c⁻¹ and j² at the start of the next step.
    metric: Arc<Vec<f64>>,
    /// The step that the states have not followed yet.
    pending: Option<Pending>,
    /// Arrays for reuse: they exceed the caches, and allocating them takes as long as filling them.
    reserve: Reserve,
}

/// A step that the states follow when they are read next.
#[derive(Clone, Debug)]
struct Pending {
    /// c⁻¹ and j² at its start.
    old: Arc<Vec<f64>>,
    /// Length in s.
    step: f64,
}

/// Unused arrays. A clone has none.
#[derive(Debug, Default)]
struct Reserve {
    metric: Vec<f64>,
    memory: Option<Memory>,
}

impl Clone for Reserve {
    fn clone(&self) -> Self {
        Self::default()
    }
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
    /// Creates the branches of a scene at a state of rest, after the rest at the prestretch of its drive; relaxed
    /// without one.
    #[must_use]
    pub fn new(scene: &Scene, activity: &Activity, at_rest: &[f64]) -> Self {
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
            metric: Arc::default(),
            pending: None,
            reserve: Reserve::default(),
        };
        if viscous.is_empty() {
            return viscous;
        }
        viscous.metric = Arc::new(metrics(activity, at_rest));
        let Some(rest) = &scene.drive.rest else {
            viscous.states = vec![viscous.metric.to_vec(); viscous.branches.len()];
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

    /// Returns whether there are no branches.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.branches.is_empty()
    }

    /// Returns the shortest relaxation time in s.
    #[must_use]
    pub fn shortest(&self) -> Option<f64> {
        self.branches.iter().map(|branch| branch.time).reduce(f64::min)
    }

    /// Returns whether the energy of the branches at the end of a step, in s, depends on the strain there.
    #[must_use]
    pub fn depends_on_end(&self, step: f64) -> bool {
        self.law == ViscousLaw::Finite && step > 0.0 && !self.is_empty()
    }

    /// Adds the energy of the branches at the end of a step in s to an activity; with the finite law only for a step of
    /// zero length.
    #[must_use]
    pub fn remembered(&mut self, activity: &Activity, step: f64) -> Activity {
        if self.is_empty() {
            return activity.clone();
        }
        let pending = self.pending.take();
        let factors = self.branches.iter().map(|branch| {
            let Coefficients { kept, before, .. } = Coefficients::new(step / branch.time);
            let followed = pending
                .as_ref()
                .map(|pending| Coefficients::new(pending.step / branch.time));
            (branch.modulus * kept, branch.modulus * before, followed)
        });
        let factors: Vec<(f64, f64, Option<Coefficients>)> = factors.collect();
        let mut memory = self
            .reserve
            .memory
            .take()
            .unwrap_or_else(|| Memory::zeros(self.metric.len()));
        let known = activity.memory().map(Memory::view::<f64>);
        let (states, metric) = (&mut self.states, &self.metric);
        memory.refill(
            self.layout,
            #[inline(always)]
            |range, sum| {
                match known {
                    Some(known) => sum.copy_from_slice(&known[range.clone()]),
                    None => sum.fill(0.0),
                }
                let metric = &metric[range.clone()];
                for ((kept, before, followed), state) in factors.iter().zip(&mut *states) {
                    let state = &mut state[range.clone()];
                    if let (Some(step), Some(pending)) = (followed, &pending) {
                        follow(step, state, &pending.old[range.clone()], metric);
                    }
                    for ((sum, state), metric) in sum.iter_mut().zip(state).zip(metric) {
                        *sum += kept * *state + before * metric;
                    }
                }
            },
        );
        self.reuse(pending);
        activity.with_memory(memory)
    }

    /// Takes back the arrays of an activity.
    pub fn recycle(&mut self, activity: Activity) {
        if let Some(memory) = activity.into_memory()
            && memory.count() == self.metric.len()
        {
            self.reserve.memory = Some(memory);
        }
    }

    /// Takes back the metric before a step.
    fn reuse(&mut self, pending: Option<Pending>) {
        if let Some(old) = pending.and_then(|pending| Arc::into_inner(pending.old)) {
            self.reserve.metric = old;
        }
    }

    /// Returns the modulus of branches relaxed at rest, minus that lost by relaxation in a step in s at rest, in units
    /// of μλp².
    #[must_use]
    pub fn unrelaxed_modulus(&self, step: f64) -> f64 {
        let each = self.branches.iter();
        each.map(|branch| branch.modulus * (1.0 - Coefficients::new(step / branch.time).now))
            .sum()
    }

    /// Returns the additional energy of an activity without branches.
    fn known(&self, activity: &Activity) -> Vec<f64> {
        let none = || vec![0.0; self.metric.len()];
        activity.memory().map_or_else(none, |memory| memory.view().to_vec())
    }

    /// Like [`Self::remembered`], for a step that ends near a displacement.
    #[must_use]
    pub fn remembered_at(&mut self, activity: &Activity, step: f64, u: &[f64]) -> Activity {
        if !self.depends_on_end(step) {
            return self.remembered(activity, step);
        }
        let metric = metrics(activity, u);
        let mut sum = self.known(activity);
        for (branch, state) in self.branches.iter().zip(&self.states) {
            let Branch { modulus, time } = *branch;
            let step = Step::new(step / time);
            for at in places(self.layout, metric.len()) {
                let [state, from, to] = [state, &self.metric, &metric].map(|values| point(self.layout, values, at));
                let (end, share) = step.end(state, from, to);
                // At most as much as leaves it convex.
                let share = share.min(finite::least(end, to));
                let known: [f64; NUMBERS] = std::array::from_fn(|k| modulus * (end[k] - share * to[k]));
                for (number, known) in known.into_iter().enumerate() {
                    sum[place(self.layout, at, number)] += known;
                }
            }
        }
        activity.with_memory(Memory::new(self.layout, &sum))
    }

    /// Advances the branches to the end of a step that ends at a displacement.
    pub fn advance(&mut self, activity: &Activity, step: f64, u: &[f64]) {
        if !self.is_empty() {
            let metric = self.metric_at(activity, u);
            self.advance_to(metric, step);
        }
    }

    /// Like [`Self::advance`], but deferred until [`Viscous::remembered`] reads all states anyway.
    pub fn advance_later(&mut self, activity: &Activity, step: f64, u: &[f64]) {
        if self.law == ViscousLaw::Finite || self.is_empty() {
            return self.advance(activity, step, u);
        }
        self.apply_pending();
        let metric = self.metric_at(activity, u);
        let old = mem::replace(&mut self.metric, Arc::new(metric));
        self.pending = Some(Pending { old, step });
    }

    /// Advances the states by the deferred step.
    fn apply_pending(&mut self) {
        let Some(pending) = self.pending.take() else {
            return;
        };
        self.follow_all(&pending.old, pending.step);
        self.reuse(Some(pending));
    }

    /// Returns c⁻¹ and j² at a displacement.
    fn metric_at(&mut self, activity: &Activity, u: &[f64]) -> Vec<f64> {
        let mut metric = mem::take(&mut self.reserve.metric);
        write_metrics(activity, u, &mut metric);
        metric
    }

    /// Returns c⁻¹ and j² at the end of the last step; `None` without branches.
    #[must_use]
    pub fn metric(&self) -> Option<&[f64]> {
        (!self.is_empty()).then_some(&self.metric[..])
    }

    /// Like [`Self::advance`], with a metric for small strains, linear in the displacement.
    pub fn advance_linearly(&mut self, activity: &Activity, step: f64, u: &[f64]) {
        if self.is_empty() {
            return;
        }
        // The error of the central difference is quadratic in this factor.
        let near = |share: f64| {
            let part: Vec<f64> = u.iter().map(|u| share * u).collect();
            metrics(activity, &part)
        };
        let (at_rest, slope) = (near(0.0), near(LINEAR_FACTOR).into_iter().zip(near(-LINEAR_FACTOR)));
        let changes = slope.map(|(ahead, behind)| (ahead - behind) / (2.0 * LINEAR_FACTOR));
        let metric = at_rest.iter().zip(changes).map(|(rest, change)| rest + change);
        self.advance_to(metric.collect(), step);
    }

    /// Advances the branches to the end of a step that ends at a metric.
    fn advance_to(&mut self, metric: Vec<f64>, step: f64) {
        self.apply_pending();
        let old = mem::replace(&mut self.metric, Arc::new(metric));
        match self.law {
            ViscousLaw::Linear => self.follow_all(&old, step),
            ViscousLaw::Finite => {
                for (branch, state) in self.branches.iter().zip(&mut self.states) {
                    let step = Step::new(step / branch.time);
                    change(self.layout, state, |at, state| {
                        let [from, to] = [&old, &self.metric].map(|values| point(self.layout, values, at));
                        step.end(state, from, to).0
                    });
                }
            }
        }
        self.reuse(Some(Pending { old, step }));
    }

    /// Advances the states of the linear law from a metric to the current one, in a time in s.
    fn follow_all(&mut self, old: &[f64], step: f64) {
        let factors = self.branches.iter().map(|branch| Coefficients::new(step / branch.time));
        let factors: Vec<Coefficients> = factors.collect();
        let (states, metric) = (&mut self.states, &self.metric);
        in_chunks(
            old.len(),
            #[inline(always)]
            |range| {
                let (old, new) = (&old[range.clone()], &metric[range.clone()]);
                for (step, state) in factors.iter().zip(&mut *states) {
                    follow(step, &mut state[range.clone()], old, new);
                }
            },
        );
    }

    /// Relaxes the branches at their current strain for a time in s.
    pub fn relax(&mut self, seconds: f64) {
        self.apply_pending();
        for (branch, state) in self.branches.iter().zip(&mut self.states) {
            let r = seconds / branch.time;
            match self.law {
                ViscousLaw::Linear => {
                    let kept = (-r).exp();
                    let pairs = state.iter_mut().zip(&self.metric[..]);
                    pairs.for_each(|(state, metric)| *state = metric + kept * (*state - metric));
                }
                ViscousLaw::Finite => change(self.layout, state, |at, state| {
                    finite::relaxed(state, point(self.layout, &self.metric, at), r)
                }),
            }
        }
    }

    /// Strains the branches instantaneously.
    pub fn strain(&mut self, activity: &Activity, u: &[f64]) {
        if !self.is_empty() {
            self.apply_pending();
            self.metric = Arc::new(metrics(activity, u));
        }
    }

    /// Returns the data for the energies of this state.
    ///
    /// # Panics
    /// After [`Viscous::advance_later`].
    #[must_use]
    pub fn loaded(&self) -> BranchEnergy {
        assert!(
            self.pending.is_none(),
            "the branches must follow the state before its energies"
        );
        let mut sum = vec![0.0; self.metric.len()];
        in_chunks(sum.len(), |range| {
            let sum = &mut sum[range.clone()];
            for (branch, state) in self.branches.iter().zip(&self.states) {
                let pairs = sum.iter_mut().zip(&state[range.clone()]);
                pairs.for_each(|(sum, state)| *sum += branch.modulus * state);
            }
        });
        BranchEnergy {
            part: self.layout.part(),
            sum,
            metric: Arc::clone(&self.metric),
        }
    }

    /// Returns the energy of the branches in this state, in units of μH times the mean area of elements.
    #[must_use]
    pub fn stored(&self, loaded: &BranchEnergy, activity: &Activity) -> f64 {
        if self.is_empty() {
            return 0.0;
        }
        let (grid, part) = (activity.grid(), self.layout.part());
        let mut at_points = vec![0.0; self.metric.len() / NUMBERS];
        memory::add_energy(part, [&loaded.sum, &loaded.metric], 0.5, &mut at_points);
        let follows_borders = grid.follows_borders().is_some();
        let area = match follows_borders {
            true => integral(activity, &vec![1.0; at_points.len()]),
            false => integral_of_rows(activity, |_| {
                (0..self.layout.columns()).map(|at| grid.size(0, at)).sum()
            }),
        };
        let each = self.branches.iter().zip(&self.states).map(|(branch, state)| {
            if follows_borders {
                let logarithms: Vec<f64> = (0..at_points.len())
                    .map(|at| {
                        let [xx, xy, yy, normal] = point(self.layout, state, at);
                        ((xx * yy - xy * xy) * normal).ln()
                    })
                    .collect();
                return 0.5 * branch.modulus * (integral(activity, &logarithms) + 3.0 * area);
            }
            let logarithms = integral_of_rows(activity, |line| {
                let [xx, xy, yy, normal] = lines(part, &state[line * NUMBERS * part..][..NUMBERS * part]);
                let volume = |at: usize| (xx[at] * yy[at] - xy[at] * xy[at]) * normal[at];
                let columns = 0..self.layout.columns();
                match grid.is_uniform() {
                    true => grid.size(0, 0) * sum_of_logarithms(columns.map(volume)),
                    false => columns.map(|at| grid.size(0, at) * volume(at).ln()).sum(),
                }
            });
            0.5 * branch.modulus * (logarithms + 3.0 * area)
        });
        integral(activity, &at_points) - each.sum::<f64>()
    }
}

/// Advances states through a step between two metrics.
#[inline(always)]
fn follow(&Coefficients { kept, before, now }: &Coefficients, state: &mut [f64], old: &[f64], new: &[f64]) {
    for ((state, old), new) in state.iter_mut().zip(old).zip(new) {
        *state = kept * *state + before * old + now * new;
    }
}

/// Processes ranges of numbers that stay in the cache from one branch to the next.
fn in_chunks(len: usize, mut work: impl FnMut(Range<usize>)) {
    const CHUNK: usize = 1024;
    dispatch(
        #[inline(always)]
        || {
            (0..len)
                .step_by(CHUNK)
                .for_each(|start| work(start..(start + CHUNK).min(len)))
        },
    );
}

/// The data for energies of branches in a state.
#[derive(Clone, Debug, Default)]
pub struct BranchEnergy {
    part: usize,
    /// Σ gA at all points.
    sum: Vec<f64>,
    /// c⁻¹ and j².
    metric: Arc<Vec<f64>>,
}

impl BranchEnergy {
    /// Returns the work done on the branches between this state and a later one, in units of μH times the mean area of
    /// elements: the mean of their stress at both ends times the change of strain.
    #[must_use]
    pub fn work_to(&self, later: &Self, activity: &Activity) -> f64 {
        if self.metric.is_empty() {
            return 0.0;
        }
        let mut work = vec![0.0; self.metric.len() / NUMBERS];
        let (sums, metrics) = ([&self.sum[..], &later.sum], [&self.metric[..], &later.metric]);
        memory::add_work(self.part, sums, metrics, 0.25, &mut work);
        integral(activity, &work)
    }
}

/// Returns the index of a number of a point. Points are counted along the elements of a row, then by the points of an
/// element, then by rows.
fn place(layout: NodeLayout, at: usize, number: usize) -> usize {
    let part = layout.part();
    let (line, element) = (at / part, at % part);
    (line * NUMBERS + number) * part + element
}

/// Returns the numbers of a point.
fn point(layout: NodeLayout, values: &[f64], at: usize) -> [f64; NUMBERS] {
    std::array::from_fn(|number| values[place(layout, at, number)])
}

/// Returns the points of elements without padding, in arrays of this length.
fn places(layout: NodeLayout, numbers: usize) -> impl Iterator<Item = usize> {
    let lines = numbers / (NUMBERS * layout.part());
    (0..lines).flat_map(move |line| (0..layout.columns()).map(move |column| line * layout.part() + column))
}

/// Maps the numbers of each point.
fn change(layout: NodeLayout, values: &mut [f64], mut to: impl FnMut(usize, [f64; NUMBERS]) -> [f64; NUMBERS]) {
    for at in places(layout, values.len()) {
        let changed = to(at, point(layout, values, at));
        for (number, changed) in changed.into_iter().enumerate() {
            values[place(layout, at, number)] = changed;
        }
    }
}
