//! The equilibria of a membrane one after the other in time, while its voltage changes and its elastomer creeps.
//!
//! A first pass picks the steps: the difference between a solution and its extrapolation from the three before it, which is of third order
//! in the step as the error of the exponential trapezoid is, follows a tolerance. A second pass halves them all. Both are of second order, so
//! a third of the difference between them is the error of the second; where it is more than was asked for, a third pass halves again.

use std::cell::Cell;
use std::mem;

use super::bodies;
use super::equilibrium::{at_charge, equilibrium};
use super::leads::{Charged, Circuit, Conductor, FIRST_STAGE, Relaxation};
use super::supply::{Electrodes, Supply};
use super::viscous::{Loaded, Viscous};
use crate::charge::{self, ChargedLoading, Reached};
use crate::continuation::{Climb, Ending, Loading, Loss, Problem};
use crate::law::Law;
use crate::newton::{self, ChordSteps, Trouble, Workspace};
use crate::operator::{Activity, Operator, metrics};
use crate::response::INNER;
use crate::stability::{Stability, judge};
use crate::stored::{Content, Units, content, deformation};
use crate::work::WorkLimit;
use deaflow_field::{Field, Motion};
use deaflow_scene::{Knot, Scene, Side, Waveform};

/// Smallest step, in units of the time since the drive began: the bracket of a delayed loss of stability.
const SMALLEST: f64 = 1e-5;
/// First step after a jump or a bend, in units of the shortest relaxation time or of the time until the next one.
const FIRST: f64 = 0.02;
/// Largest growth of a step.
const GROWTH: f64 = 1.8;
/// The error of a step over the difference from its extrapolation.
const SHARE: f64 = 0.1;
/// Steps of a sine at least, over a period.
pub const IN_PERIOD: f64 = 40.0;
/// Displacement that is hardly any, in units of the largest over all times.
pub const HARDLY: f64 = 0.02;
/// Solutions for the voltage behind a source at most, and when it is found, over that of the scene.
const MOST_ITERATIONS: usize = 30;
const SETTLED: f64 = 1e-10;
/// Chord steps beyond those of another step where there is no state to begin with.
const MORE_CHORD_STEPS: u32 = 2;
/// What the linear systems are solved to where nothing corrects them.
const INNER_ALONE: f64 = 1e-5;
/// Steps of a pass at most.
pub const MOST_STEPS: usize = 100_000;

/// What is followed.
pub struct Course<'a, F> {
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
    pub held: Option<Held<'a>>,
    /// How states are estimated where they are not solved for.
    pub estimate: Option<Estimate<'a>>,
    /// Whether charges, energies and magnitudes of each instant are wanted beside the fields that were asked for.
    pub measures: bool,
}

/// A charge that was put on the electrodes, which then were cut off.
#[derive(Clone, Copy, Debug)]
pub struct Held<'a> {
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

/// How steps are chosen.
#[derive(Clone, Copy, Debug)]
pub enum Steps<'a> {
    /// By an error of each step in units of displacements.
    Within(f64),
    /// So that they end at these times in s.
    At(&'a [f64]),
}

/// A membrane at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Instant {
    /// Time since the drive began in s.
    pub time: f64,
    /// Voltage of the electrodes in V: where they have a resistance, their charge over their capacitance.
    pub voltage: f64,
    /// Charge on all electrodes in C.
    pub charge: f64,
    /// Elastic energy of the law and the branches in J, from before the drive on.
    pub stored: f64,
    /// Energy of the electric field in J.
    pub electric: f64,
    /// Kinetic energy in J.
    pub kinetic: f64,
    /// What the branches and the resistances of the source and of the electrodes have dissipated, in J.
    pub dissipated: f64,
    /// What the source has supplied, in J.
    pub supplied: f64,
    /// Largest displacement magnitude over the cell corners in mm.
    pub largest: f64,
    /// Displacement magnitude of the corner that is watched in mm.
    pub watched: f64,
    /// How rigid bodies have moved; none where there are none.
    pub bodies: Option<Vec<Motion>>,
}

/// How a pass ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PassEnd {
    /// At the last time.
    Done,
    /// The drive begins with a load that the membrane does not bear.
    AtOnce(Ending),
    /// No state follows within a short time.
    Lost {
        /// The last time in s at which there was a stable state.
        before: f64,
        /// The first at which there was none.
        after: f64,
        /// What was lost.
        loss: Loss,
    },
    /// The iteration did not end.
    Unknown,
    /// The steps took more work than is allowed, or there were too many.
    WorkLimit,
}

/// A pass over the time.
#[derive(Clone, Debug)]
pub struct Pass {
    /// How it ended.
    pub end: PassEnd,
    /// The times at which steps ended, in s.
    pub steps: Vec<f64>,
    /// The membrane after each step; two at a jump.
    pub instants: Vec<Instant>,
    /// Which of them are at the times that were asked for, as far as it got.
    pub kept: Vec<usize>,
    /// The displacement then.
    pub fields: Vec<Field>,
    /// The corner (column, row) whose displacement was followed.
    pub watched: [usize; 2],
    /// Newton steps.
    pub newton_steps: u32,
    /// Work, in the units of [`WorkLimit`].
    pub work: u64,
    /// Relative residual at the end of the last step.
    pub residual: f64,
}

impl Pass {
    /// The largest difference in mm from another pass at the times that both got to.
    #[must_use]
    pub fn difference(&self, other: &Self) -> f64 {
        let pairs = self.fields.iter().zip(&other.fields);
        pairs.map(|(a, b)| a.max_difference(b)).fold(0.0, f64::max)
    }

    /// Whether it ended because it took too much work.
    #[must_use]
    pub fn is_cut_short(&self) -> bool {
        self.end == PassEnd::WorkLimit
    }

    /// Whether there can be none with steps half as long.
    #[must_use]
    pub fn is_last(&self) -> bool {
        self.is_cut_short() || 2 * self.steps.len() > MOST_STEPS
    }

    /// The same, at each time in units of the largest displacement then, but for times at which there is hardly any.
    #[must_use]
    pub fn relative_difference(&self, other: &Self) -> f64 {
        let sizes: Vec<f64> = self.fields.iter().map(Field::max_magnitude).collect();
        let least = HARDLY * sizes.iter().copied().fold(0.0, f64::max);
        let pairs = self.fields.iter().zip(&other.fields).zip(sizes);
        let ratios = pairs.map(|((a, b), size)| a.max_difference(b) / size.max(least));
        ratios.filter(|ratio| !ratio.is_nan()).fold(0.0, f64::max)
    }
}

/// Why a step is not accepted.
enum Refusal {
    Lost(Loss),
    Unknown,
    Work,
}

/// A state at the end of a step.
struct Found {
    u: Vec<f64>,
    /// Voltage of the electrodes in V.
    volts: f64,
    /// The electrodes, where they have a resistance.
    charged: Option<Charged>,
}

/// A state before now.
struct Past {
    time: f64,
    u: Vec<f64>,
    /// Potentials on the electrodes, where they have a resistance.
    potential: Vec<f64>,
}

impl<L: Law, F: Fn(f64) -> L> Course<'_, F> {
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
    fn is_fed_slowly(&self) -> bool {
        self.supply.is_some() || self.conductor.is_some()
    }

    /// The membrane with something beside its law.
    fn problem_of<'c>(&'c self, activity: &'c Activity) -> Problem<'c, &'c F> {
        Problem {
            activity,
            laplacian: self.problem.laplacian,
            material: &self.problem.material,
            tolerance: self.problem.tolerance,
        }
    }

    /// Goes through the time.
    pub fn pass(&self, steps: Steps<'_>, workspace: &mut Workspace) -> Pass {
        let activity = self.problem.activity;
        let viscous = Viscous::new(self.scene, activity);
        let mut run = Run {
            course: self,
            units: Units::new(self.scene, activity.grid().unit_mm()),
            stored: 0.0,
            stored_at_rest: 0.0,
            // The pass that picks the steps is never the last.
            measures: self.measures && matches!(steps, Steps::At(_)),
            unmoved: self
                .estimate
                .filter(|estimate| !estimate.in_law)
                .map(|_| viscous.clone()),
            loaded: Loaded::default(),
            viscous,
            u: vec![0.0; activity.grid().layout().vector_len()],
            volts: 0.0,
            charged: self.conductor.as_ref().map(|conductor| conductor.uncharged(activity)),
            first: 0.0,
            recent: Vec::new(),
            content: Content::default(),
            electric: 0.0,
            elastic_at_rest: 0.0,
            springs: 0.0,
            work: 0.0,
            dissipated: 0.0,
            supplied: 0.0,
            workspace,
            pass: Pass {
                end: PassEnd::Done,
                steps: Vec::new(),
                instants: Vec::new(),
                kept: Vec::new(),
                fields: Vec::new(),
                watched: self.watched.get(),
                newton_steps: 0,
                work: 0,
                residual: 0.0,
            },
        };
        run.workspace.begin(self.limit.get());
        run.workspace.refer_anew();
        run.pass.end = run.go(steps).err().unwrap_or(PassEnd::Done);
        run.pass.work += run.workspace.work();
        run.pass
    }
}

/// A pass on its way.
struct Run<'a, 'b, F> {
    course: &'a Course<'b, F>,
    units: Units,
    viscous: Viscous,
    /// What their energies are made of.
    loaded: Loaded,
    /// The branches of a membrane that stays at rest, where states are estimated and they are no part of its law.
    unmoved: Option<Viscous>,
    u: Vec<f64>,
    /// Voltage of the electrodes.
    volts: f64,
    /// The electrodes, where they have a resistance.
    charged: Option<Charged>,
    /// The first step after the last jump or bend.
    first: f64,
    /// Up to three states before now since the last jump or bend.
    recent: Vec<Past>,
    content: Content,
    electric: f64,
    elastic_at_rest: f64,
    /// Of the springs of bodies, and the work of their loads.
    springs: f64,
    work: f64,
    /// Energy of the branches in J.
    stored: f64,
    stored_at_rest: f64,
    /// Whether energies and charges are wanted.
    measures: bool,
    dissipated: f64,
    supplied: f64,
    workspace: &'a mut Workspace,
    pass: Pass,
}

impl<L: Law, F: Fn(f64) -> L> Run<'_, '_, F> {
    fn go(&mut self, steps: Steps<'_>) -> Result<(), PassEnd> {
        let course = self.course;
        let end = course.times.last().copied().unwrap_or(0.0);
        if self.measures {
            self.elastic_at_rest = self.measure_at(0.0).elastic;
            self.loaded = self.viscous.loaded();
            self.stored_at_rest = self.units.energy * self.viscous.stored(&self.loaded, course.problem.activity);
            self.stored = self.stored_at_rest;
        }
        self.begin()?;
        let mut knots = course.waveform.knots(end);
        knots.push(Knot {
            time: end,
            jumps: false,
        });
        let mut asked = course.times.iter().copied().peekable();
        while asked.next_if(|time| *time <= 0.0).is_some() {
            self.keep();
        }
        for pair in knots.windows(2) {
            let mut now = pair[0].time;
            self.first = self.first_step(pair[1].time - now);
            let mut length = self.first;
            while now < pair[1].time {
                let stop = asked.peek().map_or(pair[1].time, |time| time.min(pair[1].time));
                now = match steps {
                    Steps::Within(tolerance) => self.step_within(tolerance, now, stop, &mut length)?,
                    Steps::At(times) => {
                        let later = times.partition_point(|time| *time <= now);
                        self.step_to(now, times.get(later).map_or(stop, |time| time.min(stop)))?
                    }
                };
                if self.pass.steps.len() >= MOST_STEPS {
                    return Err(PassEnd::WorkLimit);
                }
                if now == pair[1].time && pair[1].jumps {
                    self.jump(now)?;
                }
                while asked.next_if(|time| *time <= now).is_some() {
                    self.keep();
                }
            }
            self.restart(now)?;
        }
        Ok(())
    }

    /// Puts on what the drive begins with, from rest: the loads of bodies and the voltage at 0 s.
    fn begin(&mut self) -> Result<(), PassEnd> {
        let course = self.course;
        // Electrodes behind a source are charged from there on.
        let share = match course.is_fed_slowly() {
            false => course.share(0.0, Side::After),
            true => 0.0,
        };
        if let Some(estimate) = course.estimate {
            let start = self.u.clone();
            self.u = self
                .estimate(estimate, 0.0, share, start)
                .map_err(|_| PassEnd::Unknown)?;
            self.volts = course.voltage(0.0, Side::After);
            self.accept(0.0, 0.0, true);
            return Ok(());
        }
        let loading = match course.held {
            None => {
                let activity = self.viscous.remembered(course.problem.activity, 0.0);
                self.load(&activity, 0.0, share)
            }
            Some(held) => self.charge(held),
        };
        self.pass.newton_steps += loading.steps;
        self.pass.residual = loading.residual;
        if loading.ending != Ending::Stable {
            return Err(PassEnd::AtOnce(loading.ending));
        }
        if !course.is_fed_slowly() && course.held.is_none() {
            self.volts = course.voltage(0.0, Side::After);
        }
        self.accept(0.0, 0.0, true);
        if course.conductor.is_some() {
            self.restart(0.0)?;
        }
        Ok(())
    }

    /// Puts a charge on the membrane at rest.
    fn charge(&mut self, Held { charge, uncharged }: Held<'_>) -> Loading {
        self.count_work();
        let course = self.course;
        let activity = self
            .viscous
            .remembered(uncharged.unwrap_or(course.problem.activity), 0.0);
        let problem = course.problem_of(&activity);
        let (u, workspace) = (&mut self.u, &mut *self.workspace);
        let ChargedLoading { loading, charged } = match uncharged {
            None => charge::conducting(&problem, course.scene, charge, u, workspace),
            Some(_) => charge::immobile(&problem, course.scene, charge, u, workspace),
        };
        self.volts = charged.and_then(|charged| charged.voltage).unwrap_or(0.0);
        loading
    }

    /// The stable state at the end of a step of so many seconds with a charge on electrodes that conduct.
    fn held(&mut self, charge: f64, seconds: f64, guess: &[f64]) -> Result<Found, Refusal> {
        let course = self.course;
        let problem = course.problem_of(course.problem.activity);
        self.count_work();
        let mut refusal = Refusal::Unknown;
        for start in [guess, &self.u.clone()] {
            let mut loading = Loading {
                ending: Ending::Stable,
                steps: 0,
                residual: 0.0,
                pointwise: false,
            };
            let room = (&mut *self.workspace, &mut loading);
            let branches = (&mut self.viscous, seconds);
            let found = at_charge(&problem, (course.scene, charge), branches, start, room);
            self.pass.newton_steps += loading.steps;
            self.pass.residual = loading.residual;
            match found {
                Ok(Reached { u, charged, .. }) => {
                    return Ok(Found {
                        u,
                        volts: charged.voltage.unwrap_or(0.0),
                        charged: None,
                    });
                }
                Err(charge::Refusal::Work) => return Err(Refusal::Work),
                Err(charge::Refusal::Lost(loss, _)) => refusal = Refusal::Lost(loss),
                Err(charge::Refusal::Unknown) => {}
            }
        }
        Err(refusal)
    }

    /// Counts the work that was done: parts of a step may count theirs anew.
    fn count_work(&mut self) {
        self.pass.work += self.workspace.work();
        self.workspace.begin(self.course.limit.get().less(self.pass.work));
    }

    /// Raises the load from a share to a higher one; from 0 on from rest.
    fn load(&mut self, activity: &Activity, from: f64, to: f64) -> Loading {
        self.count_work();
        let problem = &self.course.problem;
        let problem = Problem {
            activity,
            laplacian: problem.laplacian,
            material: |share: f64| (problem.material)(share * to),
            tolerance: problem.tolerance,
        };
        let workspace = &mut *self.workspace;
        if from > 0.0 {
            let climb = Climb {
                from: from / to,
                to: 1.0,
                step: 1.0,
            };
            return problem.climb(climb, &mut self.u, workspace);
        }
        if to > 0.0 {
            return problem.load(&mut self.u, workspace);
        }
        match problem.rest(&mut self.u, workspace) {
            Err(loading) => loading,
            Ok(()) => Loading {
                ending: Ending::Stable,
                steps: 0,
                residual: 0.0,
                pointwise: false,
            },
        }
    }

    /// The voltage jumps: the branches have no time to follow.
    fn jump(&mut self, now: f64) -> Result<(), PassEnd> {
        if self.course.is_fed_slowly() {
            // The charge does not jump.
            return self.restart(now);
        }
        let [before, after] = [Side::Before, Side::After].map(|side| self.course.share(now, side));
        if let Some(estimate) = self.course.estimate {
            let start = self.u.clone();
            let found = self.estimate(estimate, 0.0, after, start);
            self.u = found.map_err(|_| PassEnd::Unknown)?;
        } else if after > before {
            let activity = self.viscous.remembered(self.course.problem.activity, 0.0);
            let reached = self.u.clone();
            let loading = self.load(&activity, before.max(f64::MIN_POSITIVE), after);
            self.pass.newton_steps += loading.steps;
            if loading.ending != Ending::Stable {
                self.u = reached;
                return Err(match loading.ending {
                    Ending::Lost { loss, .. } => PassEnd::Lost {
                        before: now,
                        after: now,
                        loss,
                    },
                    Ending::WorkLimit { .. } => PassEnd::WorkLimit,
                    Ending::Stable | Ending::Unknown { .. } => PassEnd::Unknown,
                });
            }
        } else {
            let start = self.u.clone();
            let activity = self.course.problem.activity;
            let found = self
                .solve(activity, 0.0, after, start)
                .map_err(|refusal| match refusal {
                    Refusal::Lost(loss) => PassEnd::Lost {
                        before: now,
                        after: now,
                        loss,
                    },
                    Refusal::Unknown => PassEnd::Unknown,
                    Refusal::Work => PassEnd::WorkLimit,
                })?;
            self.u = found;
        }
        self.recent.clear();
        self.volts = self.course.voltage(now, Side::After);
        self.accept(now, 0.0, true);
        Ok(())
    }

    /// Forgets the states before now, from which none can be extrapolated. Where the leads have jumped, so has the potential.
    fn restart(&mut self, now: f64) -> Result<(), PassEnd> {
        let potential = match (&self.course.conductor, &self.charged) {
            (Some(conductor), Some(charged)) => {
                let circuit = self.circuit(conductor, &self.u);
                let volts = self.course.voltage(now, Side::After);
                let found = conductor.step(0.0, &charged.charge, [&circuit; 2], [volts; 2]);
                found.ok_or(PassEnd::Unknown)?
            }
            _ => Vec::new(),
        };
        self.recent = vec![Past {
            time: now,
            u: self.u.clone(),
            potential,
        }];
        Ok(())
    }

    /// The shortest step to a time that is tried.
    fn shortest(&self, to: f64) -> f64 {
        SMALLEST * to.max(self.first)
    }

    /// The first step after a jump or a bend, where the next one is so far away.
    fn first_step(&self, room: f64) -> f64 {
        let charging = self
            .course
            .supply
            .map(|supply| supply.time(self.capacitance(), self.course.scene.voltage_v()));
        let spreading = self.course.conductor.as_ref().map(Conductor::time);
        let times = self
            .viscous
            .shortest()
            .into_iter()
            .chain(charging.filter(|time| *time > 0.0))
            .chain(spreading);
        times.fold(room, f64::min) * FIRST
    }

    /// Of the electrodes as they are, in F.
    fn capacitance(&self) -> f64 {
        let full = self.course.scene.voltage_v();
        match full > 0.0 {
            true => self.measure_at(full).charge / full,
            false => 0.0,
        }
    }

    /// The longest step that keeps to a tolerance, to `stop` at the farthest; returns where it ends.
    fn step_within(&mut self, tolerance: f64, now: f64, stop: f64, length: &mut f64) -> Result<f64, PassEnd> {
        let period = self
            .course
            .waveform
            .angular_frequency()
            .map_or(f64::INFINITY, |omega| std::f64::consts::TAU / omega);
        loop {
            let wanted = length.min(period / IN_PERIOD);
            let room = stop - now;
            // What is left after a step is not shorter than a half of it.
            let step = if wanted >= room {
                room
            } else if 1.5 * wanted > room {
                0.5 * room
            } else {
                wanted
            };
            let to = if step >= room { stop } else { now + step };
            let shortest = to - now <= self.shortest(to);
            let guess = self.extrapolated(to);
            match self.fed(now, to, guess.clone()) {
                Ok(found) => {
                    let moved = found.u.iter().zip(&guess).map(|(a, b)| (a - b).abs());
                    let difference = moved.fold(self.charged_off(&found, to), f64::max);
                    let error = SHARE * difference;
                    let factor = 0.9 * (tolerance / error.max(1e-300)).powf(1.0 / 3.0);
                    if error > 2.0 * tolerance && !shortest {
                        *length = (to - now) * factor.clamp(0.2, 0.8);
                        continue;
                    }
                    self.advance(now, to, found);
                    let next = (to - now) * factor.clamp(0.3, GROWTH);
                    // A step that was cut short says nothing against longer ones.
                    *length = if step < wanted && next < wanted {
                        wanted.min(next.max(*length))
                    } else {
                        next
                    };
                    return Ok(to);
                }
                Err(refusal) if shortest => return Err(ended(&refusal, now, to)),
                Err(Refusal::Work) => return Err(PassEnd::WorkLimit),
                Err(_) => *length = 0.5 * (to - now),
            }
        }
    }

    /// A step to a time; in parts where the whole does not lead there.
    fn step_to(&mut self, now: f64, to: f64) -> Result<f64, PassEnd> {
        let (mut from, mut length) = (now, to - now);
        while from < to {
            let end = if from + length >= to - 1e-12 * to {
                to
            } else {
                from + length
            };
            let guess = self.extrapolated(end);
            match self.fed(from, end, guess) {
                Ok(found) => {
                    self.advance(from, end, found);
                    from = end;
                }
                Err(Refusal::Work) => return Err(PassEnd::WorkLimit),
                Err(refusal) if end - from <= self.shortest(end) => return Err(ended(&refusal, from, end)),
                Err(_) => length = 0.5 * (end - from),
            }
        }
        Ok(to)
    }

    /// The stable state at the end of a step with the voltage of its electrodes then.
    fn fed(&mut self, from: f64, to: f64, guess: Vec<f64>) -> Result<Found, Refusal> {
        let course = self.course;
        if let (Some(conductor), Some(charged)) = (&course.conductor, &self.charged) {
            let charged = charged.clone();
            return self.wired(conductor, &charged, [from, to], guess);
        }
        let activity = course.problem.activity;
        if let Some(held) = course.held {
            return match held.uncharged {
                None if held.charge > 0.0 => self.held(held.charge, to - from, &guess),
                // The law of what was sprayed is that without voltage.
                _ => Ok(Found {
                    u: self.solve(activity, to - from, 0.0, guess)?,
                    volts: 0.0,
                    charged: None,
                }),
            };
        }
        let Some(supply) = course.supply else {
            return Ok(Found {
                u: self.solve(activity, to - from, course.share(to, Side::Before), guess)?,
                volts: course.voltage(to, Side::Before),
                charged: None,
            });
        };
        let full = course.scene.voltage_v();
        let before = Electrodes {
            capacitance: self.capacitance(),
            source: course.voltage(from, Side::After),
        };
        let charge = before.capacitance * self.volts;
        let (mut volts, mut u) = (self.volts, guess);
        let mut last: Option<[f64; 2]> = None;
        for _ in 0..MOST_ITERATIONS {
            let share = if full > 0.0 { (volts / full).powi(2) } else { 0.0 };
            u = self.solve(activity, to - from, share, u)?;
            let reached = std::mem::replace(&mut self.u, u);
            let after = Electrodes {
                capacitance: self.capacitance(),
                source: course.voltage(to, Side::Before),
            };
            u = std::mem::replace(&mut self.u, reached);
            let target = match after.capacitance > 0.0 {
                true => supply.charge_after(to - from, charge, before, after) / after.capacitance,
                false => 0.0,
            };
            let off = target - volts;
            if off.abs() <= SETTLED * full {
                return Ok(Found {
                    u,
                    volts,
                    charged: None,
                });
            }
            // A secant, where it leads between what was there and what is wanted.
            let slope = last.map_or(-1.0, |[other, then]| (off - then) / (volts - other));
            last = Some([volts, off]);
            volts = if slope < -0.2 { volts - off / slope } else { target };
        }
        Err(Refusal::Unknown)
    }

    /// The same with electrodes that charge from their leads: potentials and displacement by turns.
    fn wired(
        &mut self,
        conductor: &Conductor,
        charged: &Charged,
        [from, to]: [f64; 2],
        guess: Vec<f64>,
    ) -> Result<Found, Refusal> {
        let course = self.course;
        let before = self.circuit(conductor, &self.u);
        let volts = [
            course.voltage(from + FIRST_STAGE * (to - from), Side::After),
            course.voltage(to, Side::Before),
        ];
        let (mut u, mut relaxation) = (guess, Relaxation::default());
        for _ in 0..MOST_ITERATIONS {
            let after = self.circuit(conductor, &u);
            let found = conductor.step(to - from, &charged.charge, [&before, &after], volts);
            let potential = found.ok_or(Refusal::Unknown)?;
            if relaxation.off(&potential) <= SETTLED * course.scene.voltage_v() {
                let charged = conductor.charged(potential, &after, charged);
                return Ok(Found {
                    u,
                    volts: charged.voltage,
                    charged: Some(charged),
                });
            }
            let (activity, share) = conductor.loads(relaxation.next(potential));
            u = self.solve(&activity, to - from, share, u)?;
        }
        Err(Refusal::Unknown)
    }

    /// The electrodes as a circuit at a displacement. The law knows how its capacitance depends on the stretch.
    fn circuit(&self, conductor: &Conductor, u: &[f64]) -> Circuit {
        let laws = [0.0, 1.0].map(|share| (self.course.problem.material)(share));
        let scale = 2.0 * self.units.energy / self.course.scene.voltage_v().powi(2);
        conductor.circuit(&metrics(self.course.problem.activity, u), |point| {
            let f = deformation(point);
            scale * (laws[0].energy(f, 1.0) - laws[1].energy(f, 1.0))
        })
    }

    /// How far the potentials at the end of a step are from those that were extrapolated, as a displacement.
    fn charged_off(&self, found: &Found, to: f64) -> f64 {
        match (&self.course.conductor, &found.charged) {
            (Some(conductor), Some(charged)) => {
                let guess = self.polynomial(to, charged.potential.len(), |past| &past.potential);
                conductor.difference(&charged.potential, &guess)
            }
            _ => 0.0,
        }
    }

    /// The stable state at the end of a step of so many seconds at a share of the load, from a guess and else from the state before it.
    fn solve(&mut self, activity: &Activity, seconds: f64, share: f64, guess: Vec<f64>) -> Result<Vec<f64>, Refusal> {
        let course = self.course;
        if let Some(estimate) = course.estimate {
            return self.estimate(estimate, seconds, share, guess);
        }
        let material = (course.problem.material)(share);
        self.count_work();
        let mut last = None;
        for mut u in [guess, self.u.clone()] {
            let problem = Problem {
                activity,
                laplacian: course.problem.laplacian,
                material: (),
                tolerance: course.problem.tolerance,
            };
            let workspace = &mut *self.workspace;
            match equilibrium(&problem, &material, &mut self.viscous, seconds, &mut u, workspace) {
                Ok((activity, progress)) => {
                    self.pass.newton_steps += progress.steps;
                    self.pass.residual = progress.residual;
                    let operator = Operator {
                        material: &material,
                        activity: &activity,
                        pulled: 1.0,
                    };
                    let stability = judge(&operator, problem.laplacian, &u, workspace);
                    self.viscous.recycle(activity);
                    match stability {
                        Stability::Stable { .. } => return Ok(u),
                        Stability::Unstable => last = Some(Refusal::Lost(Loss::Stability)),
                        Stability::NotElliptic => last = Some(Refusal::Lost(Loss::Ellipticity)),
                        Stability::Slack => last = Some(Refusal::Lost(Loss::Tension)),
                    }
                }
                Err((trouble, progress)) => {
                    self.pass.newton_steps += progress.steps;
                    last = Some(match trouble {
                        Trouble::NegativeCurvature | Trouble::LineSearch => Refusal::Lost(Loss::Stability),
                        Trouble::Limit => Refusal::Unknown,
                        Trouble::Work => return Err(Refusal::Work),
                    });
                }
            }
        }
        Err(last.unwrap_or(Refusal::Unknown))
    }

    /// An estimate of the state at the end of a step, from a guess. Steps that take no time have no states before them that lead there.
    fn estimate(
        &mut self,
        Estimate { how, half_active, .. }: Estimate<'_>,
        seconds: f64,
        share: f64,
        guess: Vec<f64>,
    ) -> Result<Vec<f64>, Refusal> {
        let course = self.course;
        let material = (course.problem.material)(share);
        self.count_work();
        if self.workspace.is_spent() {
            return Err(Refusal::Work);
        }
        let remembered = self.viscous.remembered(course.problem.activity, seconds);
        let slowness = self.viscous.slowness(seconds);
        let at_rest = (self.unmoved.as_mut()).map(|unmoved| unmoved.remembered(half_active, seconds));
        let slowed = match at_rest {
            None => (course.problem.material)(share).slowed(slowness),
            Some(_) => None,
        };
        let unit = slowed.as_ref().map_or(1.0, |_| 1.0 + slowness);
        let actual = Operator {
            material: &material,
            activity: &remembered,
            pulled: 1.0,
        };
        let linear = Operator {
            material: slowed.as_ref().unwrap_or(&material),
            activity: at_rest.as_ref().unwrap_or(half_active),
            pulled: 1.0,
        };
        let rest = vec![0.0; guess.len()];
        let (mut u, count, inner) = match how {
            StepEstimate::Linear => (rest.clone(), 1, INNER_ALONE),
            StepEstimate::Chord(steps) if seconds == 0.0 => (guess, steps + MORE_CHORD_STEPS, INNER),
            StepEstimate::Chord(steps) => (guess, steps, INNER),
        };
        let found = newton::chord(
            [&actual, &linear],
            course.problem.laplacian,
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
            Err(_) => Err(Refusal::Unknown),
        }
    }

    /// Numbers at a later time by the polynomial through those of the last states.
    fn polynomial(&self, to: f64, count: usize, of: impl Fn(&Past) -> &Vec<f64>) -> Vec<f64> {
        let mut guess = vec![0.0; count];
        for (at, past) in self.recent.iter().enumerate() {
            let others = self.recent.iter().enumerate().filter(|(other, _)| *other != at);
            let weight: f64 = others
                .map(|(_, other)| (to - other.time) / (past.time - other.time))
                .product();
            guess
                .iter_mut()
                .zip(of(past))
                .for_each(|(sum, value)| *sum += weight * value);
        }
        guess
    }

    /// The state at a later time by the polynomial through the last ones.
    fn extrapolated(&self, to: f64) -> Vec<f64> {
        let mut guess = self.polynomial(to, self.u.len(), |past| &past.u);
        if self.recent.is_empty() {
            guess.copy_from_slice(&self.u);
        }
        self.course.problem.activity.grid().settle(&mut guess);
        guess
    }

    fn advance(&mut self, from: f64, to: f64, found: Found) {
        self.u = found.u;
        self.volts = found.volts;
        self.charged = found.charged;
        self.accept(to, to - from, false);
    }

    /// Takes the state that was found for the end of a step. A jump is an infinitely fast rise without losses.
    fn accept(&mut self, now: f64, step: f64, jump: bool) {
        let course = self.course;
        match course.estimate.map(|estimate| estimate.how) {
            Some(StepEstimate::Linear) => self.viscous.advance_linearly(course.problem.activity, step, &self.u),
            _ if self.measures => self.viscous.advance(course.problem.activity, step, &self.u),
            _ => self.viscous.advance_later(course.problem.activity, step, &self.u),
        }
        if let Some(unmoved) = &mut self.unmoved {
            unmoved.relax(step);
        }
        if self.measures {
            self.account([now - step, now], jump);
        }
        if !jump {
            self.pass.steps.push(now);
        }
        self.recent.push(Past {
            time: now,
            u: self.u.clone(),
            potential: self
                .charged
                .as_ref()
                .map_or_else(Vec::new, |charged| charged.potential.clone()),
        });
        if self.recent.len() > 3 {
            self.recent.remove(0);
        }
        let [largest, watched] = match self.measures {
            true => {
                let field = course.problem.activity.grid().sample(&self.u);
                [field.max_magnitude(), magnitude_at(&field, course.watched.get())]
            }
            false => [0.0; 2],
        };
        self.pass.instants.push(Instant {
            time: now,
            voltage: self.volts,
            charge: self.content.charge,
            stored: self.content.elastic - self.elastic_at_rest + self.stored - self.stored_at_rest + self.springs,
            electric: self.electric,
            kinetic: 0.0,
            dissipated: self.dissipated,
            supplied: self.supplied,
            largest,
            watched,
            bodies: course.problem.activity.grid().motions(&self.u),
        });
    }

    /// Balances the energies of a step.
    fn account(&mut self, [before, now]: [f64; 2], jump: bool) {
        let course = self.course;
        let (measured, electric) = self.measure();
        if course.held.is_some_and(|held| held.uncharged.is_some()) && measured.charge > 0.0 {
            // That of the mean over the charge.
            self.volts = 2.0 * electric / measured.charge;
        }
        let content_before = mem::replace(&mut self.content, measured);
        let voltage = self.volts;
        let electric_before = mem::replace(&mut self.electric, electric);
        let loaded = self.viscous.loaded();
        let stored = self.units.energy * self.viscous.stored(&loaded, course.problem.activity);
        let earlier = mem::replace(&mut self.loaded, loaded);
        let [springs, work] = bodies::energies(course.scene, course.problem.activity.grid(), &self.u);
        let springs_before = mem::replace(&mut self.springs, springs);
        let work_before = mem::replace(&mut self.work, work);
        let change = stored - mem::replace(&mut self.stored, stored);
        if jump {
            let before = if self.pass.instants.is_empty() {
                self.elastic_at_rest
            } else {
                content_before.elastic
            };
            let elastic = self.content.elastic - before + springs - springs_before;
            self.supplied += elastic + change + self.electric - electric_before;
        } else {
            self.dissipated += self.units.energy * earlier.work_to(&self.loaded, course.problem.activity) - change;
            let charged = self.content.driven - content_before.driven;
            let old = self.pass.instants.last().map_or(0.0, |instant| instant.voltage);
            let to_electrodes = match &self.charged {
                None => 0.5 * (old + voltage) * charged,
                Some(charged) => charged.work,
            };
            let from_source = match course.is_fed_slowly() {
                false => to_electrodes,
                true => {
                    let sides = course.voltage(before, Side::After) + course.voltage(now, Side::Before);
                    0.5 * sides * charged
                }
            };
            self.supplied += from_source + work - work_before;
            self.dissipated += from_source - to_electrodes;
        }
    }

    /// The membrane as it is, and the energy of the field in J.
    fn measure(&self) -> (Content, f64) {
        if let Some(Held {
            charge,
            uncharged: Some(uncharged),
        }) = self.course.held
        {
            let activity = self.course.problem.activity;
            let elastic = self.content(uncharged, 0.0);
            let content = Content {
                charge,
                driven: charge,
                ..elastic
            };
            return (
                content,
                self.units.energy * charge::energy_of_sprayed(activity, &self.u),
            );
        }
        let Some(charged) = &self.charged else {
            let activity = self.course.problem.activity;
            // Branches that have followed know it.
            let content = match self.viscous.metric() {
                Some(metric) => self.content_at(metric, activity, self.volts),
                None => self.content(activity, self.volts),
            };
            return (content, 0.5 * content.driven * self.volts);
        };
        let volts = charged.share.sqrt() * self.course.scene.voltage_v();
        let content = self.content(&charged.activity, volts);
        let charge = charged.charge.iter().sum();
        let whole = Content {
            charge,
            driven: charge,
            ..content
        };
        (whole, 0.5 * content.driven * volts)
    }

    /// The membrane as it is, with so many V on its electrodes.
    fn measure_at(&self, volts: f64) -> Content {
        self.content(self.course.problem.activity, volts)
    }

    /// The membrane as it is, with so many V on electrodes with an activity.
    fn content(&self, activity: &Activity, volts: f64) -> Content {
        self.content_at(&metrics(activity, &self.u), activity, volts)
    }

    /// The membrane at a metric, with so many V on electrodes with an activity.
    fn content_at(&self, metric: &[f64], activity: &Activity, volts: f64) -> Content {
        let course = self.course;
        let full = course.scene.voltage_v();
        let ratio = if full > 0.0 { volts / full } else { 0.0 };
        // The electric energy is a difference, which is lost in rounding at low voltages; it is in proportion to their square, but where the
        // membrane wrinkles.
        let unloaded = (course.problem.material)(0.0);
        let (at, scale) = match unloaded.wrinkles() {
            true => (ratio, 1.0),
            false => (1.0, ratio),
        };
        let loaded = (course.problem.material)(at * at);
        let found = content([&unloaded, &loaded], activity, metric, at * full, self.units);
        Content {
            charge: scale * found.charge,
            driven: scale * found.driven,
            ..found
        }
    }

    /// Notes that the last state was asked for.
    fn keep(&mut self) {
        self.pass.kept.push(self.pass.instants.len() - 1);
        let field = self.course.problem.activity.grid().sample(&self.u);
        self.pass.fields.push(field);
    }
}

/// The displacement magnitude of a corner in mm.
pub fn magnitude_at(field: &Field, [x, y]: [usize; 2]) -> f64 {
    let [along, across] = field.at_corner(x, y);
    along.hypot(across)
}

fn ended(refusal: &Refusal, before: f64, after: f64) -> PassEnd {
    match refusal {
        Refusal::Lost(loss) => PassEnd::Lost {
            before,
            after,
            loss: *loss,
        },
        Refusal::Unknown => PassEnd::Unknown,
        Refusal::Work => PassEnd::WorkLimit,
    }
}
