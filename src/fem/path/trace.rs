//! Tracing the curve of equilibria from rest: step lengths, events and end.

use crate::eigenvalue::Eigenpair;
use crate::margin::MAX_PATH_LOAD;
use crate::material::Material;

use super::curve::{Curve, CurvePoint};
use super::{EventKind, PathEnd};

/// First step, and largest step in units of the distance from rest, which is at least [`NEAR`].
const FIRST_STEP: f64 = 0.003;
const MAX_STEP: f64 = 0.05;
const NEAR: f64 = 1.0;
/// Smallest step.
const MIN_STEP: f64 = 1e-7;
/// Steps with a smaller cosine of the angle between their ends are halved.
const MIN_COSINE: f64 = 0.97;
/// Relative accuracy of the last share of a path that is complete.
const LAST: f64 = 1e-9;
/// Maximum number of points.
const MAX_POINTS: usize = 240;
/// Elements with less than this share of their area end the path.
const MIN_AREA: f64 = 0.02;
/// Range in which a branch that became stable again is followed, in units of the load at the first limit.
const RECOVERY_RANGE: f64 = 1.2;
/// Relative width in load to which an event is located; voltages are twice as accurate.
const EVENT_WIDTH: f64 = 2e-5;
/// Width in arc length to which a fold is located.
const FOLD_WIDTH: f64 = 1e-3;

/// An equilibrium on the path.
pub struct PathState {
    /// Displacements.
    pub u: Vec<f64>,
    /// Share of what changes along the path.
    pub share: f64,
    /// Negative eigenvalues of the tangent matrix.
    pub negative: usize,
    /// The smallest eigenvalue against the Laplacian.
    pub eigenvalue: f64,
    /// Whether it is stable and elliptic.
    pub stable: bool,
}

/// An event on the path.
pub struct TraceEvent {
    /// Kind.
    pub kind: EventKind,
    /// Share of what changes along the path.
    pub share: f64,
    /// Index of the state before it.
    pub state: usize,
}

/// A traced path.
pub struct Trace<M> {
    /// Data that the caller keeps of each state.
    pub states: Vec<M>,
    /// Events in order.
    pub events: Vec<TraceEvent>,
    /// Why it ends.
    pub end: PathEnd,
}

/// Traces a curve. `keep` converts each state to the data to keep.
pub fn follow<L: Material, F: Fn(f64) -> L, M>(curve: &Curve<'_, F>, keep: impl FnMut(PathState) -> M) -> Trace<M> {
    let mut tracer = Tracer {
        curve,
        keep,
        near: None,
        trace: Trace {
            states: Vec::new(),
            events: Vec::new(),
            end: PathEnd::Lost,
        },
    };
    if let Some(first) = curve.first() {
        tracer.trace.end = tracer.follow(first);
    }
    tracer.trace
}

struct Tracer<'a, F, K, M> {
    curve: &'a Curve<'a, F>,
    keep: K,
    near: Option<Eigenpair>,
    trace: Trace<M>,
}

impl<L: Material, F: Fn(f64) -> L, K: FnMut(PathState) -> M, M> Tracer<'_, F, K, M> {
    fn follow(&mut self, first: CurvePoint) -> PathEnd {
        let mut here = first;
        let mut arc = FIRST_STEP;
        self.record(&here);
        while self.trace.states.len() < MAX_POINTS {
            if let Some(end) = self.end(&here) {
                return end;
            }
            let longest = MAX_STEP * self.curve.distance(&here).max(NEAR);
            arc = arc.min(longest);
            let step = self.curve.step(&here, arc).filter(|step| step.cosine > MIN_COSINE);
            let Some(step) = step else {
                arc *= 0.5;
                if arc < MIN_STEP {
                    return PathEnd::Lost;
                }
                continue;
            };
            if let Some(shorter) = self.before_last(&here, &step.to, arc) {
                arc = shorter;
                continue;
            }
            let next = if self.has_event(&here, &step.to) {
                self.locate(here, step.to, arc)
            } else {
                step.to
            };
            self.record(&next);
            here = next;
            arc *= if step.easy { 1.5 } else { 0.8 };
        }
        PathEnd::Points
    }

    /// Returns the arc length to the last share, if a step went beyond.
    fn before_last(&self, here: &CurvePoint, to: &CurvePoint, arc: f64) -> Option<f64> {
        let last = self.curve.last_share()?;
        let is_beyond = to.share > last * (1.0 + LAST) && arc > MIN_STEP;
        is_beyond.then(|| arc * (last * (1.0 + 0.5 * LAST) - here.share) / (to.share - here.share))
    }

    /// Returns why the path ends at a state, if it does.
    fn end(&self, at: &CurvePoint) -> Option<PathEnd> {
        let first = self.trace.events.first();
        let last = self.curve.last_share();
        let is_far = |first: &TraceEvent| at.is_stable() && at.share > RECOVERY_RANGE * first.share;
        let recovered = last.is_none() && first.is_some_and(is_far);
        if at.ellipticity <= 0.0 {
            Some(PathEnd::NotElliptic)
        } else if at.is_slack() {
            Some(PathEnd::Slack)
        } else if at.smallest_det < MIN_AREA {
            Some(PathEnd::Squeezed)
        } else if last.is_some_and(|last| at.share >= last) {
            Some(PathEnd::Complete)
        } else if at.share > MAX_PATH_LOAD * self.curve.unit() || self.curve.is_bare() {
            Some(PathEnd::NoLimit)
        } else if recovered {
            Some(PathEnd::Recovered)
        } else {
            None
        }
    }

    /// Returns whether an event lies between two states.
    fn has_event(&self, here: &CurvePoint, next: &CurvePoint) -> bool {
        here.rises() != next.rises() || here.is_sound() != next.is_sound() || here.is_stable() != next.is_stable()
    }

    /// Locates an event between two states an arc length apart, records the state before it, and returns the one after
    /// it.
    fn locate(&mut self, mut before: CurvePoint, mut after: CurvePoint, mut arc: f64) -> CurvePoint {
        while !self.is_located(&before, &after, arc) {
            // The step over the whole arc succeeded, so that over half of it does, except for rounding.
            let Some(middle) = self.curve.step(&before, 0.5 * arc) else {
                break;
            };
            arc *= 0.5;
            if self.has_event(&before, &middle.to) {
                after = middle.to;
            } else {
                before = middle.to;
            }
        }
        let (kind, share) = if before.rises() != after.rises() {
            let is_maximum = before.rises();
            let share = if is_maximum {
                before.share.max(after.share)
            } else {
                before.share.min(after.share)
            };
            (EventKind::Fold, share)
        } else {
            let kind = match after.ellipticity <= 0.0 {
                true => EventKind::NotElliptic,
                false if after.is_slack() => EventKind::Slack,
                false => EventKind::Bifurcation,
            };
            (kind, 0.5 * (before.share + after.share))
        };
        self.record(&before);
        self.trace.events.push(TraceEvent {
            kind,
            share,
            state: self.trace.states.len() - 1,
        });
        after
    }

    fn is_located(&self, before: &CurvePoint, after: &CurvePoint, arc: f64) -> bool {
        let sharp = (after.share - before.share).abs() <= EVENT_WIDTH * after.share;
        let fold = before.rises() != after.rises();
        sharp && (!fold || arc <= FOLD_WIDTH * self.curve.distance(before).max(NEAR)) || arc < MIN_STEP
    }

    fn record(&mut self, at: &CurvePoint) {
        let found = self.curve.eigenpair(at, self.near.as_ref());
        let eigenvalue = found.as_ref().map_or(f64::NAN, |pair| pair.value);
        self.near = found.or(self.near.take());
        self.trace.states.push((self.keep)(PathState {
            u: at.u.clone(),
            share: at.share,
            negative: at.negative,
            eigenvalue,
            stable: at.is_stable(),
        }));
    }
}
