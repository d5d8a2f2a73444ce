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

use std::ops::Range;
use std::sync::Arc;

use pulp::Arch;

use super::coefficients::Coefficients;
use super::finite::{self, Step};
use crate::fem::layout::NodeLayout;
use crate::fem::memory::{self, Memory, NUMBERS, lines};
use crate::fem::operator::{Activity, metrics};
use crate::fem::stored::{integral, integral_of_rows, sum_of_logarithms};
use crate::scene::{Scene, ViscousLaw};

/// What is taken of a displacement to find what is linear in it.
const NEAR: f64 = 1e-3;

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
        let mut sum = self.known(activity);
        let factors = self.branches.iter().map(|branch| {
            let Coefficients { kept, before, .. } = Coefficients::new(step / branch.time);
            [branch.modulus * kept, branch.modulus * before]
        });
        let factors: Vec<[f64; 2]> = factors.collect();
        in_chunks(sum.len(), |range| {
            let (sum, metric) = (&mut sum[range.clone()], &self.metric[range.clone()]);
            for ([kept, before], state) in factors.iter().zip(&self.states) {
                let pairs = state[range.clone()].iter().zip(metric);
                sum.iter_mut()
                    .zip(pairs)
                    .for_each(|(sum, (state, metric))| *sum += kept * state + before * metric);
            }
        });
        activity.with_memory(Memory::new(self.layout, sum))
    }

    /// The modulus of branches that have relaxed at rest beside what a step of so many seconds at rest lets them forget, in units of μλp².
    #[must_use]
    pub fn slowness(&self, step: f64) -> f64 {
        let each = self.branches.iter();
        each.map(|branch| branch.modulus * (1.0 - Coefficients::new(step / branch.time).now))
            .sum()
    }

    /// What an activity has beside the law without branches.
    fn known(&self, activity: &Activity) -> Vec<f64> {
        let none = || vec![0.0; self.metric.len()];
        activity.memory().map_or_else(none, |memory| memory.view().to_vec())
    }

    /// The same at the end of a step that ends about a displacement.
    #[must_use]
    pub fn remembered_at(&self, activity: &Activity, step: f64, u: &[f64]) -> Activity {
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
        if !self.is_empty() {
            self.advance_to(metrics(activity, u), step);
        }
    }

    /// The same to a metric as if strains were small: linear in the displacement.
    pub fn advance_linearly(&mut self, activity: &Activity, step: f64, u: &[f64]) {
        if self.is_empty() {
            return;
        }
        // A central difference errs by the square of what it takes of the displacement.
        let near = |share: f64| {
            let part: Vec<f64> = u.iter().map(|u| share * u).collect();
            metrics(activity, &part)
        };
        let (at_rest, slope) = (near(0.0), near(NEAR).into_iter().zip(near(-NEAR)));
        let changes = slope.map(|(ahead, behind)| (ahead - behind) / (2.0 * NEAR));
        let metric = at_rest.iter().zip(changes).map(|(rest, change)| rest + change);
        self.advance_to(metric.collect(), step);
    }

    /// Moves the branches to the end of a step that ends at a metric.
    fn advance_to(&mut self, metric: Vec<f64>, step: f64) {
        match self.law {
            ViscousLaw::Linear => {
                let factors = self.branches.iter().map(|branch| Coefficients::new(step / branch.time));
                let factors: Vec<Coefficients> = factors.collect();
                let (states, old) = (&mut self.states, &self.metric);
                in_chunks(metric.len(), |range| {
                    let (old, new) = (&old[range.clone()], &metric[range.clone()]);
                    for (Coefficients { kept, before, now }, state) in factors.iter().zip(&mut *states) {
                        let pairs = old.iter().zip(new);
                        state[range.clone()]
                            .iter_mut()
                            .zip(pairs)
                            .for_each(|(state, (old, new))| *state = kept * *state + before * old + now * new);
                    }
                });
            }
            ViscousLaw::Finite => {
                for (branch, state) in self.branches.iter().zip(&mut self.states) {
                    let step = Step::new(step / branch.time);
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

    /// What energies of this state are made of.
    #[must_use]
    pub fn loaded(&self) -> Loaded {
        let mut sum = vec![0.0; self.metric.len()];
        in_chunks(sum.len(), |range| {
            let sum = &mut sum[range.clone()];
            for (branch, state) in self.branches.iter().zip(&self.states) {
                let pairs = sum.iter_mut().zip(&state[range.clone()]);
                pairs.for_each(|(sum, state)| *sum += branch.modulus * state);
            }
        });
        Loaded {
            part: self.layout.part(),
            sum,
            metric: self.metric.clone(),
        }
    }

    /// What the branches store in this state, in units of μH times the mean area of elements.
    #[must_use]
    pub fn stored(&self, loaded: &Loaded, activity: &Activity) -> f64 {
        if self.is_empty() {
            return 0.0;
        }
        let (grid, part) = (activity.grid(), self.layout.part());
        let mut at_points = vec![0.0; self.metric.len() / NUMBERS];
        memory::add_energy(part, [&loaded.sum, &loaded.metric], 0.5, &mut at_points);
        let area = integral_of_rows(activity, |_| {
            (0..self.layout.columns()).map(|at| grid.size(0, at)).sum()
        });
        let each = self.branches.iter().zip(&self.states).map(|(branch, state)| {
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

/// Does work on ranges of numbers that stay in the cache from one branch to the next.
fn in_chunks(len: usize, mut work: impl FnMut(Range<usize>)) {
    const CHUNK: usize = 1024;
    Arch::new().dispatch(
        #[inline(always)]
        || {
            (0..len)
                .step_by(CHUNK)
                .for_each(|start| work(start..(start + CHUNK).min(len)))
        },
    );
}

/// What energies of branches in a state are made of.
#[derive(Clone, Debug)]
pub struct Loaded {
    part: usize,
    /// Σ gA at all points.
    sum: Vec<f64>,
    /// c⁻¹ and j².
    metric: Vec<f64>,
}

impl Loaded {
    /// The work that a step did on the branches, from this state to a later one, in units of μH times the mean area of elements: the mean of
    /// their stress at both ends times the change of strain.
    #[must_use]
    pub fn work_to(&self, later: &Self, activity: &Activity) -> f64 {
        if self.metric.is_empty() {
            return 0.0;
        }
        let mut work = vec![0.0; self.metric.len() / NUMBERS];
        let both: Vec<f64> = self.sum.iter().zip(&later.sum).map(|(a, b)| a + b).collect();
        memory::add_energy(self.part, [&both, &later.metric], 0.25, &mut work);
        memory::add_energy(self.part, [&both, &self.metric], -0.25, &mut work);
        integral(activity, &work)
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
