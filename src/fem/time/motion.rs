//! Motion with inertia, by steps that conserve energy and momentum.
//!
//! In a step from u₀ to u₁ = u₀ + Δu, with time in units in which the mass of an area is 1,
//!
//! ```text
//! (2/Δt²) M (Δu − Δt v₀) + F(u₀, u₁) = 0,   v₁ = 2Δu/Δt − v₀
//! ```
//!
//! where the work of F along Δu is the change of energy at the voltage in the middle of the step (Simo and Tarnow, Z.
//! angew. Math. Phys. 43 (1992) 757; Gonzalez, J. Nonlinear Sci. 6 (1996) 449). Viscoelastic branches relax for half of
//! a step before and after it, and are springs within it: their dissipation is never negative, and stored energy,
//! dissipation and supply balance to rounding.
//!
//! A rigid body that rotates from θ₀ to θ₁ moves its nodes by Δt + (R₁ − R₀)(X − Xc) = Δt + 2 sin ½Δθ J Rₘ (X − Xc), in
//! the span of the T of [`supports`](crate::supports) at the mean angle. The equation is projected onto this T (Betsch
//! and Steinmann, Int. J. Numer. Meth. Engng 53 (2002) 1775): its product with Δu has the same energies, so the balance
//! holds with bodies for any rotation.

use super::bodies;
use super::feed::{self, Feed, Passage};
use super::pass::{Instant, MOST_STEPS, Pass, PassEnd, magnitude_at};
use super::smoothing::Smoothed;
use super::transient::TransientProblem;
use super::viscous::Viscous;
use crate::charge;
use crate::krylov::{KrylovEnd, Scratch, conjugate_gradients};
use crate::mass::Mass;
use crate::material::Material;
use crate::newton::norm;
use crate::operator::{Activity, Operator, metrics};
use crate::precondition::Laplacian;
use crate::stability::Loss;
use crate::stored::{Content, Units, content};
use deaflow_scene::Side;

/// Residual of a step relative to its forces.
const TOLERANCE: f64 = 1e-10;
/// Maximum number of iterations of a step.
const MAX_ITERATIONS: usize = 30;
/// If the residual decreases by less than this factor, the tangent is updated.
const SLOW_REDUCTION: f64 = 0.2;
/// Maximum number of halvings of a step that fails.
const MAX_HALVINGS: u32 = 6;
/// Relative residual of the linear solution in each iteration.
const INNER: f64 = 1e-5;
/// Work besides conjugate gradients for each iteration and each step: forces, moduli and energies.
const STEP_WORK: u64 = 6;

/// The moving membrane.
pub struct Motion<'a, 'b, F> {
    /// The drive and equilibrium problem.
    pub transient: &'a TransientProblem<'b, F>,
    /// Its mass.
    pub mass: &'a Mass,
    /// Number of units of time, in which the mass of an area is 1, per second.
    pub per_second: f64,
    /// Preconditioner for steps of about this length.
    pub laplacian: &'a Laplacian,
    /// Longest step in s before it is divided.
    pub step: f64,
    /// Number of parts that steps are divided into.
    pub parts: usize,
}

/// A pass in progress.
struct MotionPass<'a, 'b, 'c, F> {
    motion: &'a Motion<'b, 'c, F>,
    viscous: Viscous,
    units: Units,
    u: Vec<f64>,
    /// Velocity, in units of length and time.
    v: Vec<f64>,
    /// Changes in the last steps since the last jump of the voltage, latest first, with their lengths.
    changes: Vec<(f64, Vec<f64>)>,
    feed: Feed<'c>,
    /// The drive averaged over steps up to the next stop; empty without noise.
    smoothed: Smoothed,
    /// The material at the full voltage.
    content: Content,
    /// Energy of the field of sprayed charge in J.
    sprayed: f64,
    elastic_at_rest: f64,
    branches: f64,
    branches_at_rest: f64,
    /// Energy of springs, that at rest, and the work of loads, in J.
    springs: f64,
    springs_at_rest: f64,
    work: f64,
    dissipated: f64,
    supplied: f64,
    krylov: Scratch,
    pass: Pass,
}

impl<L: Material, F: Fn(f64) -> L> Motion<'_, '_, F> {
    /// Simulates the drive.
    pub fn pass(&self) -> Pass {
        let activity = self.transient.problem.activity;
        let len = activity.grid().layout().vector_len();
        let rest = self.transient.rest();
        let viscous = Viscous::new(self.transient.scene, activity, &rest);
        let units = Units::new(self.transient.scene, activity.grid().unit_mm());
        let [springs, work] = bodies::energies(units, activity.grid(), &rest);
        let branches = units.energy * viscous.stored(&viscous.loaded(), activity);
        let mut run = MotionPass {
            motion: self,
            viscous,
            units,
            u: rest,
            v: vec![0.0; len],
            changes: Vec::new(),
            feed: Feed::of(self.transient),
            smoothed: Smoothed::default(),
            sprayed: 0.0,
            content: Content::default(),
            elastic_at_rest: 0.0,
            branches,
            branches_at_rest: branches,
            springs,
            springs_at_rest: springs,
            work,
            dissipated: 0.0,
            supplied: 0.0,
            krylov: Scratch::new(len),
            pass: Pass::new(PassEnd::Done, self.transient.watched.get()),
        };
        run.pass.end = run.run().err().unwrap_or(PassEnd::Done);
        run.pass.work = run.work();
        run.pass
    }

    /// Returns the number of steps in a time in s; even a short one is divided, so that more parts give shorter steps.
    fn steps_in(&self, seconds: f64) -> usize {
        let whole = (seconds / self.step * (1.0 - 1e-9)).ceil().max(1.0);
        (whole as usize).saturating_mul(self.parts)
    }
}

impl<L: Material, F: Fn(f64) -> L> MotionPass<'_, '_, '_, F> {
    fn run(&mut self) -> Result<(), PassEnd> {
        let transient = self.motion.transient;
        self.measure();
        self.elastic_at_rest = self.content.elastic;
        let charged = self.electric(0.0, Side::After);
        self.supplied += charged;
        self.record(0.0, Side::After);
        let mut asked = transient.times.iter().copied().peekable();
        while asked.next_if(|time| *time <= 0.0).is_some() {
            self.keep();
        }
        for pair in transient.knots.windows(2) {
            let mut now = pair[0].time;
            while now < pair[1].time {
                let stop = asked.peek().map_or(pair[1].time, |time| time.min(pair[1].time));
                let count = self.motion.steps_in(stop - now);
                let start = now;
                let end_of = |step: usize| {
                    if step == count {
                        stop
                    } else {
                        start + (stop - start) * step as f64 / count as f64
                    }
                };
                if transient.noisy {
                    let before = self.electric(now, Side::After);
                    let times: Vec<f64> = std::iter::once(now).chain((1..=count).map(end_of)).collect();
                    self.smoothed = transient.smoothed(&times);
                    // The average jumps at stops.
                    self.supplied += self.electric(now, Side::After) - before;
                }
                for step in 1..=count {
                    let to = end_of(step);
                    self.advance(now, to, 0)?;
                    now = to;
                    if step.is_multiple_of(self.motion.parts) {
                        self.pass.trace.record(&transient.displacement(&self.u));
                    }
                    if self.pass.steps.len() >= MOST_STEPS || transient.limit.get().is_spent(self.work()) {
                        return Err(PassEnd::WorkLimit);
                    }
                }
                if now == pair[1].time && pair[1].jumps {
                    let before = self.electric(now, Side::Before);
                    self.smoothed = Smoothed::default();
                    let after = self.electric(now, Side::After);
                    self.supplied += after - before;
                    self.changes.clear();
                    self.record(now, Side::After);
                }
                while asked.next_if(|time| *time <= now).is_some() {
                    self.keep();
                }
            }
        }
        Ok(())
    }

    /// Returns the work so far, in the units of [`WorkLimit`](crate::WorkLimit).
    fn work(&self) -> u64 {
        let sweeps = STEP_WORK * u64::from(self.pass.newton_steps) + STEP_WORK * self.pass.steps.len() as u64;
        u64::from(self.krylov.iterations) + sweeps
    }

    /// Returns the energy of the electric field in this state at the voltage of a time, in J.
    fn electric(&self, time: f64, side: Side) -> f64 {
        let capacitance = self.content.driven * self.scale();
        match self.feed {
            Feed::Voltage => capacitance * 0.5 * self.voltage(time, side).powi(2),
            Feed::Conducting { charge, .. } => feed::energy(charge, capacitance),
            Feed::Sprayed { .. } => self.sprayed,
        }
    }

    /// Returns the voltage of the drive, averaged over steps if it has noise, in V.
    fn voltage(&self, time: f64, side: Side) -> f64 {
        self.motion.transient.voltage_along(&self.smoothed, time, side)
    }

    /// Returns one over the voltage at which the content is measured.
    fn scale(&self) -> f64 {
        let full = self.motion.transient.scene.voltage_v();
        if full > 0.0 { 1.0 / full } else { 0.0 }
    }

    /// Measures the membrane in the current state.
    fn measure(&mut self) {
        let activity = self.motion.transient.problem.activity;
        if let Feed::Sprayed { uncharged, .. } = self.feed {
            self.content = self.content_at(uncharged, &self.u, 0.0);
            self.sprayed = self.units.energy * charge::energy_of_sprayed(activity, &self.u);
        } else {
            self.content = self.content_at(activity, &self.u, self.motion.transient.scene.voltage_v());
        }
    }

    /// Returns the content of a membrane with an activity at a voltage in V.
    fn content_at(&self, activity: &Activity, u: &[f64], volts: f64) -> Content {
        let laws = [0.0, 1.0].map(|share| (self.motion.transient.problem.material)(share));
        content([&laws[0], &laws[1]], activity, &metrics(activity, u), volts, self.units)
    }

    /// Returns the transfer of charge to conducting electrodes in a step by a change of displacement; `None` if they
    /// follow the voltage at once, or their charge is immobile.
    fn passage(&self, change: &[f64], step: [f64; 2]) -> Option<Passage> {
        let Feed::Conducting { supply, charge } = self.feed else {
            return None;
        };
        let transient = self.motion.transient;
        let end: Vec<f64> = self.u.iter().zip(change).map(|(u, change)| u + change).collect();
        let after = self.content_at(transient.problem.activity, &end, transient.scene.voltage_v());
        let capacitances = [self.content.driven, after.driven].map(|driven| driven * self.scale());
        let last = supply.map_or(charge, |supply| {
            supply.charge_along(charge, capacitances, &transient.points_along(&self.smoothed, step))
        });
        Some(Passage::new([charge, last], capacitances))
    }

    /// Returns the share of the load in a step with such a transfer.
    fn share(&self, passage: Option<Passage>, step: [f64; 2]) -> f64 {
        match (self.feed, passage) {
            (_, Some(passage)) => passage.square * self.scale().powi(2),
            (Feed::Sprayed { .. }, None) => 0.0,
            (_, None) => self.motion.transient.mean_share(&self.smoothed, step),
        }
    }

    fn stored_in_branches(&self) -> f64 {
        let activity = self.motion.transient.problem.activity;
        self.units.energy * self.viscous.stored(&self.viscous.loaded(), activity)
    }

    /// Makes a step, halved if it fails.
    fn advance(&mut self, from: f64, to: f64, depth: u32) -> Result<(), PassEnd> {
        match self.step(from, to) {
            Err(PassEnd::Lost {
                loss: Loss::Stability, ..
            }) if depth < MAX_HALVINGS => {
                let middle = 0.5 * (from + to);
                self.advance(from, middle, depth + 1)?;
                self.advance(middle, to, depth + 1)
            }
            other => other,
        }
    }

    /// Makes a step; changes nothing if it fails.
    fn step(&mut self, from: f64, to: f64) -> Result<(), PassEnd> {
        let transient = self.motion.transient;
        let activity = transient.problem.activity;
        let seconds = to - from;
        let lost = |loss| PassEnd::Lost {
            before: from,
            after: to,
            loss,
        };
        let mut viscous = self.viscous.clone();
        viscous.relax(0.5 * seconds);
        let remembered = viscous.remembered(activity, 0.0);
        let length = seconds * self.motion.per_second;
        let Some(change) = self.solve(&remembered, [from, to], length) else {
            return Err(lost(Loss::Stability));
        };
        let passage = self.passage(&change, [from, to]);
        let material = (transient.problem.material)(self.share(passage, [from, to]));
        let operator = Operator::new(&material, &remembered);
        self.viscous = viscous;
        self.dissipated += self.branches - self.stored_in_branches();
        let pairs = self.u.iter_mut().zip(&change);
        pairs.for_each(|(u, change)| *u += change);
        let pairs = self.v.iter_mut().zip(&change);
        pairs.for_each(|(v, change)| *v = 2.0 * change / length - *v);
        self.changes.insert(0, (length, change));
        self.changes.truncate(3);
        let margins = operator.margins(&self.u);
        if margins.ellipticity.is_nan() || margins.ellipticity <= 0.0 {
            return Err(lost(Loss::Ellipticity));
        }
        self.move_charge(passage, [from, to]);
        self.viscous.strain(activity, &self.u);
        let strained = self.stored_in_branches();
        self.viscous.relax(0.5 * seconds);
        self.branches = self.stored_in_branches();
        self.dissipated += strained - self.branches;
        let [springs, loads] = bodies::energies(self.units, activity.grid(), &self.u);
        self.springs = springs;
        self.supplied += loads - std::mem::replace(&mut self.work, loads);
        self.pass.steps.push(to);
        self.record(to, Side::Before);
        Ok(())
    }

    /// Measures the membrane after a step, with the energy supplied by the source and dissipated in its resistance.
    fn move_charge(&mut self, passage: Option<Passage>, [from, to]: [f64; 2]) {
        let transient = self.motion.transient;
        let electric_before = self.electric(from, Side::After);
        let before = self.content;
        self.measure();
        if let (Feed::Conducting { charge, .. }, Some(passage)) = (&mut self.feed, passage) {
            let volts = transient.mean_voltage(&self.smoothed, [from, to]);
            let moved = passage.charge - *charge;
            // Disconnected electrodes are not supplied.
            let supplied = if moved == 0.0 { 0.0 } else { volts * moved };
            *charge = passage.charge;
            self.supplied += supplied;
            self.dissipated += supplied - passage.work;
        } else if let Feed::Voltage = self.feed {
            let half_square = 0.5 * transient.mean_share(&self.smoothed, [from, to]) * transient.scene.voltage_v();
            self.supplied +=
                half_square * (self.content.driven - before.driven) + self.electric(to, Side::Before) - electric_before;
        }
    }

    /// Extrapolates the change of displacement in a step from the mean velocities in the last ones by a polynomial in
    /// time.
    fn guess(&self, length: f64) -> Vec<f64> {
        // Middles of the last steps relative to that of this one.
        let mut places = Vec::new();
        let mut behind = 0.5 * length;
        for (other, _) in &self.changes {
            places.push(-(behind + 0.5 * other));
            behind += other;
        }
        let mut guess = vec![0.0; self.v.len()];
        for (at, (other, change)) in self.changes.iter().enumerate() {
            let weight: f64 = places
                .iter()
                .enumerate()
                .filter(|(k, _)| *k != at)
                .map(|(_, place)| place / (place - places[at]))
                .product();
            let scale = weight * length / other;
            guess
                .iter_mut()
                .zip(change)
                .for_each(|(sum, change)| *sum += scale * change);
        }
        if self.changes.is_empty() {
            guess.iter_mut().zip(&self.v).for_each(|(sum, v)| *sum = length * v);
        }
        self.motion
            .transient
            .problem
            .activity
            .grid()
            .settle_change(&self.u, &mut guess);
        guess
    }

    /// Solves for the change of displacement in a step between two times in s, with the energy of the branches; `None`
    /// if it fails.
    fn solve(&mut self, activity: &Activity, step: [f64; 2], length: f64) -> Option<Vec<f64>> {
        let motion = self.motion;
        let grid = activity.grid();
        let weight = 2.0 / (length * length);
        let mut change = self.guess(length);
        let (mut residual, mut forces) = (vec![0.0; change.len()], vec![0.0; change.len()]);
        let mut against = vec![0.0; change.len()];
        let mut single: Vec<f32> = Vec::new();
        let mut moduli = Vec::new();
        // Poses of bodies at the tangent.
        let mut poses = Vec::new();
        let mut scratch = motion.laplacian.scratch();
        let mut heavy = vec![0.0_f32; change.len()];
        let mut reference: f64 = 0.0;
        let mut size = f64::INFINITY;
        for iteration in 0..MAX_ITERATIONS {
            let passage = self.passage(&change, step);
            let material = (motion.transient.problem.material)(self.share(passage, step));
            let operator = Operator::new(&material, activity);
            let halfway = grid.poses_between(&self.u, &change);
            operator.residual_between(&self.u, &change, &halfway, &mut forces);
            let moved: Vec<f64> = change
                .iter()
                .zip(&self.v)
                .map(|(change, v)| weight * (change - length * v))
                .collect();
            motion.mass.apply(&moved, &mut against);
            grid.restrict_at(&halfway, &mut against);
            let sums = forces.iter().zip(&against);
            residual
                .iter_mut()
                .zip(sums)
                .for_each(|(r, (force, inertia))| *r = force + inertia);
            reference = reference.max(norm(&forces)).max(norm(&against));
            let now = norm(&residual);
            if !now.is_finite() {
                return None;
            }
            self.pass.residual = now / reference.max(f64::MIN_POSITIVE);
            // A residual that no longer decreases is rounding; that of a membrane at rest is rounding only.
            let rounding = self.rounding(&operator, weight);
            if now <= TOLERANCE * reference || (now >= 0.5 * size && now <= (1e3 * TOLERANCE * reference).max(rounding))
            {
                return Some(change);
            }
            let is_slow = now > SLOW_REDUCTION * size;
            size = now;
            if iteration == 0 || is_slow {
                let mut half: Vec<f64> = self.u.iter().zip(&change).map(|(u, change)| u + 0.5 * change).collect();
                grid.settle(&mut half);
                single = half.iter().map(|value| *value as f32).collect();
                operator.linearise(&single, &mut moduli);
                poses = grid.poses(&single);
            }
            self.pass.newton_steps += 1;
            let targets = self.krylov.residual.iter_mut().zip(&residual);
            targets.for_each(|(target, r)| *target = (r / now) as f32);
            grid.restrict_at(&poses, &mut self.krylov.residual);
            let ending = conjugate_gradients(
                INNER,
                &mut self.krylov,
                |p, image| {
                    operator.tangent_at(&single, &moduli, p, image);
                    motion.mass.apply(p, &mut heavy);
                    grid.restrict_at(&poses, &mut heavy);
                    let pairs = image.iter_mut().zip(&heavy);
                    pairs.for_each(|(k, m)| *k = 0.5 * *k + weight as f32 * m);
                },
                |r, z| motion.laplacian.solve(r, &poses, z, &mut scratch),
            );
            if ending == KrylovEnd::NegativeCurvature {
                return None;
            }
            let steps = change.iter_mut().zip(&self.krylov.solution);
            steps.for_each(|(change, step)| *change -= now * f64::from(*step));
            grid.settle_change(&self.u, &mut change);
        }
        None
    }

    /// Returns the rounding of the residual of a step due to displacements, stresses and inertia, for a mass of this
    /// weight.
    fn rounding(&self, operator: &Operator<'_, L>, weight: f64) -> f64 {
        let largest = self.u.iter().fold(0.0, |largest: f64, u| largest.max(u.abs()));
        let each = operator.rounding() + 4.0 * f64::EPSILON * (1.0 + weight) * largest;
        each * (self.u.len() as f64).sqrt()
    }

    fn record(&mut self, now: f64, side: Side) {
        let transient = self.motion.transient;
        let voltage = self.voltage(now, side);
        let mut heavy = vec![0.0; self.v.len()];
        self.motion.mass.apply(&self.v, &mut heavy);
        let twice: f64 = self.v.iter().zip(&heavy).map(|(a, b)| a * b).sum();
        let electric = self.electric(now, side);
        let (voltage, charge) = match self.feed {
            Feed::Voltage => (voltage, self.content.charge * self.scale() * voltage),
            // For sprayed charge, the voltage of its mean.
            Feed::Conducting { charge, .. } | Feed::Sprayed { charge, .. } if charge > 0.0 => {
                (2.0 * electric / charge, charge)
            }
            Feed::Conducting { .. } | Feed::Sprayed { .. } => (0.0, 0.0),
        };
        let field = transient.displacement(&self.u);
        self.pass.instants.push(Instant {
            time: now,
            voltage,
            charge,
            stored: self.content.elastic - self.elastic_at_rest + self.branches - self.branches_at_rest + self.springs
                - self.springs_at_rest,
            electric,
            kinetic: 0.5 * self.units.energy * twice,
            dissipated: self.dissipated,
            supplied: self.supplied,
            largest: field.max_magnitude(),
            watched: magnitude_at(&field, transient.watched.get()),
            bodies: transient.problem.activity.grid().motions(&self.u),
            bars: transient.problem.activity.grid().bar_motions(&self.u),
        });
    }

    fn keep(&mut self) {
        self.pass.kept.push(self.pass.instants.len() - 1);
        self.pass.fields.push(self.motion.transient.displacement(&self.u));
    }
}
