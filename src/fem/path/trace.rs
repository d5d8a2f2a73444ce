//! Following the curve of equilibria from rest: how long the steps are, what happens on the way, and where to stop.

use crate::eigenvalue::Eigenpair;
use crate::margin::HIGHEST;
use crate::material::Material;

use super::curve::{Curve, Station};
use super::{EventKind, PathEnd};

/// The first step, and the longest in units of the distance from rest, at least [`NEAR`].
const FIRST: f64 = 0.003;
const LONGEST: f64 = 0.05;
const NEAR: f64 = 1.0;
/// Steps this short lead nowhere.
const SHORTEST: f64 = 1e-7;
/// A step around a bend sharper than this is made in smaller ones.
const STRAIGHT: f64 = 0.97;
/// Points after which the path ends.
const MOST_POINTS: usize = 240;
/// Elements squeezed to this part of their area are nearly turned over.
const SQUEEZED: f64 = 0.02;
/// How far a branch is followed that became stable again, in units of the load at the first limit.
const BEYOND: f64 = 1.2;
/// Relative width in load at which an event is located; voltages are twice as sharp.
const LOCATED: f64 = 2e-5;
/// Width in arc length at which a fold is located.
const NARROW: f64 = 1e-3;

/// An equilibrium on the path.
pub struct Mark {
    /// Displacements.
    pub u: Vec<f64>,
    /// Share of the full load.
    pub share: f64,
    /// Negative eigenvalues of the tangent matrix.
    pub negative: usize,
    /// The smallest eigenvalue against the Laplacian.
    pub eigenvalue: f64,
    /// Stable and elliptic.
    pub stable: bool,
}

/// Something that happens on the path.
pub struct Happening {
    /// What.
    pub kind: EventKind,
    /// Share of the full load.
    pub share: f64,
    /// The mark before it.
    pub mark: usize,
}

/// A path as it was followed.
pub struct Trace<M> {
    /// What the caller keeps of each mark.
    pub marks: Vec<M>,
    /// In the order in which they happen.
    pub happenings: Vec<Happening>,
    /// Why it ends.
    pub end: PathEnd,
}

/// Follows a curve. `keep` says what is kept of each mark.
pub fn follow<L: Material, F: Fn(f64) -> L, M>(curve: &Curve<'_, F>, keep: impl Fn(Mark) -> M) -> Trace<M> {
    let mut follower = Follower {
        curve,
        keep,
        near: None,
        trace: Trace {
            marks: Vec::new(),
            happenings: Vec::new(),
            end: PathEnd::Lost,
        },
    };
    if let Some(rest) = curve.rest() {
        follower.trace.end = follower.follow(rest);
    }
    follower.trace
}

struct Follower<'a, F, K, M> {
    curve: &'a Curve<'a, F>,
    keep: K,
    near: Option<Eigenpair>,
    trace: Trace<M>,
}

impl<L: Material, F: Fn(f64) -> L, K: Fn(Mark) -> M, M> Follower<'_, F, K, M> {
    fn follow(&mut self, rest: Station) -> PathEnd {
        let mut here = rest;
        let mut arc = FIRST;
        self.record(&here);
        while self.trace.marks.len() < MOST_POINTS {
            if let Some(end) = self.end(&here) {
                return end;
            }
            let longest = LONGEST * self.curve.distance(&here).max(NEAR);
            arc = arc.min(longest);
            let step = self.curve.step(&here, arc).filter(|step| step.cosine > STRAIGHT);
            let Some(step) = step else {
                arc *= 0.5;
                if arc < SHORTEST {
                    return PathEnd::Lost;
                }
                continue;
            };
            let next = if self.eventful(&here, &step.to) {
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

    /// Whether the path ends at a state.
    fn end(&self, at: &Station) -> Option<PathEnd> {
        let first = self.trace.happenings.first();
        let recovered = first.is_some_and(|first| at.is_stable() && at.share > BEYOND * first.share);
        if at.ellipticity <= 0.0 {
            Some(PathEnd::NotElliptic)
        } else if at.is_slack() {
            Some(PathEnd::Slack)
        } else if at.smallest_det < SQUEEZED {
            Some(PathEnd::Squeezed)
        } else if at.share > HIGHEST * self.curve.unit() || self.curve.is_bare() {
            Some(PathEnd::NoLimit)
        } else if recovered {
            Some(PathEnd::Recovered)
        } else {
            None
        }
    }

    /// Whether something worth telling lies between two states.
    fn eventful(&self, here: &Station, next: &Station) -> bool {
        here.rises() != next.rises() || here.is_sound() != next.is_sound() || here.is_stable() != next.is_stable()
    }

    /// Narrows an event down between two states an arc length apart, records what lies before it, and returns the state
    /// after it.
    fn locate(&mut self, mut before: Station, mut after: Station, mut arc: f64) -> Station {
        while !self.is_located(&before, &after, arc) {
            // The curve was found over the whole arc, so over half of it too but for rounding.
            let Some(middle) = self.curve.step(&before, 0.5 * arc) else {
                break;
            };
            arc *= 0.5;
            if self.eventful(&before, &middle.to) {
                after = middle.to;
            } else {
                before = middle.to;
            }
        }
        let (kind, share) = if before.rises() != after.rises() {
            let top = before.share.max(after.share);
            (
                EventKind::Fold,
                if before.rises() {
                    top
                } else {
                    before.share.min(after.share)
                },
            )
        } else if after.ellipticity <= 0.0 {
            (EventKind::NotElliptic, 0.5 * (before.share + after.share))
        } else if after.is_slack() {
            (EventKind::Slack, 0.5 * (before.share + after.share))
        } else {
            (EventKind::Bifurcation, 0.5 * (before.share + after.share))
        };
        self.record(&before);
        self.trace.happenings.push(Happening {
            kind,
            share,
            mark: self.trace.marks.len() - 1,
        });
        after
    }

    fn is_located(&self, before: &Station, after: &Station, arc: f64) -> bool {
        let sharp = (after.share - before.share).abs() <= LOCATED * after.share;
        let fold = before.rises() != after.rises();
        sharp && (!fold || arc <= NARROW * self.curve.distance(before).max(NEAR)) || arc < SHORTEST
    }

    fn record(&mut self, at: &Station) {
        let found = self.curve.eigenpair(at, self.near.as_ref());
        let eigenvalue = found.as_ref().map_or(f64::NAN, |pair| pair.value);
        self.near = found.or(self.near.take());
        self.trace.marks.push((self.keep)(Mark {
            u: at.u.clone(),
            share: at.share,
            negative: at.negative,
            eigenvalue,
            stable: at.is_stable(),
        }));
    }
}
