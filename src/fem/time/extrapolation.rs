//! Extrapolation of passes to zero step length.
//!
//! The error of a pass is C Δt² plus small terms if the solution is smooth within its steps: a pass with steps twice as
//! long gives C. Two such extrapolations, from three passes, give their own error.

use super::pass::{Instant, Pass, PassEnd, magnitude_at};
use deaflow_field::{Field, Motion};

/// The correction of a pass over its difference from the pass with steps twice as long.
const FRACTION: f64 = 1.0 / 3.0;
/// The error of the later of two extrapolations over their difference: an eighth of the error of the earlier one at
/// third order, less at fourth.
const LEFT: f64 = 1.0 / 7.0;
/// The largest ratio of the differences between passes of second order.
const SMOOTH: f64 = 0.35;

/// The extrapolation of the last of three passes; each has half the steps of the one before.
pub struct Extrapolation {
    /// The displacement at the requested times.
    pub fields: Vec<Field>,
    /// For each, the difference from the extrapolation of the two passes before, scaled to an error estimate.
    changes: Vec<f64>,
}

impl Extrapolation {
    /// Extrapolates; `None` if a pass did not reach the end, or the differences do not fall as the square of the step.
    #[must_use]
    pub fn of([before, coarse, fine]: [&Pass; 3]) -> Option<Self> {
        let passes = [before, coarse, fine];
        if passes.iter().any(|pass| pass.end != PassEnd::Done) {
            return None;
        }
        if fine.difference(coarse) > SMOOTH * coarse.difference(before) {
            return None;
        }
        let [first, fields] = [[before, coarse], [coarse, fine]].map(|[coarse, fine]| {
            let pairs = fine.fields.iter().zip(&coarse.fields);
            let each = pairs.map(|(fine, coarse)| fine.extrapolated(coarse, FRACTION));
            each.collect::<Vec<Field>>()
        });
        let changes = first.iter().zip(&fields).map(|(a, b)| LEFT * a.max_difference(b));
        Some(Self {
            changes: changes.collect(),
            fields,
        })
    }

    /// Returns an estimate of the largest error in mm.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.changes.iter().copied().fold(0.0, f64::max)
    }

    /// Returns the error relative to the largest displacement at each time, without times of negligible displacement.
    #[must_use]
    pub fn relative_error(&self, negligible: f64) -> f64 {
        let sizes: Vec<f64> = self.fields.iter().map(Field::max_magnitude).collect();
        let least = negligible * sizes.iter().copied().fold(0.0, f64::max);
        let ratios = self
            .changes
            .iter()
            .zip(sizes)
            .map(|(change, size)| change / size.max(least));
        ratios.filter(|ratio| !ratio.is_nan()).fold(0.0, f64::max)
    }

    /// Returns the last pass with these fields, and with its instants extrapolated if the pass before has them too.
    #[must_use]
    pub fn applied(self, coarse: &Pass, fine: Pass) -> Pass {
        let mut pass = Pass {
            fields: self.fields,
            ..fine
        };
        let Some(instants) = instants(&coarse.instants, &pass.instants) else {
            return pass;
        };
        pass.instants = instants;
        for (&at, field) in pass.kept.iter().zip(&pass.fields) {
            let instant = &mut pass.instants[at];
            instant.largest = field.max_magnitude();
            instant.watched = magnitude_at(field, pass.watched);
        }
        pass
    }
}

/// Extrapolates the instants of a pass from those of one with steps twice as long. The correction is linear in time
/// between them: this conserves sums such as the energy balance.
fn instants(coarse: &[Instant], fine: &[Instant]) -> Option<Vec<Instant>> {
    let mut at = 0;
    let mut pairs = Vec::with_capacity(coarse.len());
    for of_coarse in coarse {
        at += fine[at..].iter().position(|instant| instant.time == of_coarse.time)?;
        pairs.push((at, Numbers::between(of_coarse, &fine[at])));
        at += 1;
    }
    let ((first, _), (last, _)) = (pairs.first()?, pairs.last()?);
    if *first != 0 || last + 1 != fine.len() {
        return None;
    }
    let mut found = vec![pairs[0].1.added_to(&fine[0])];
    for pair in pairs.windows(2) {
        let [(from, before), (to, after)] = [&pair[0], &pair[1]];
        let (start, end) = (fine[*from].time, fine[*to].time);
        for (offset, instant) in fine[from + 1..=*to].iter().enumerate() {
            let is_end = from + 1 + offset == *to;
            let share = if is_end {
                1.0
            } else {
                (instant.time - start) / (end - start)
            };
            found.push(before.towards(after, share).added_to(instant));
        }
    }
    Some(found)
}

/// All numbers of an instant without the time, or corrections to them.
struct Numbers {
    of_all: [f64; 9],
    /// Of bodies and bars.
    of_bodies: Vec<[f64; 3]>,
}

impl Numbers {
    fn of(instant: &Instant) -> Self {
        let bodies = instant.bodies.iter().chain(&instant.bars).flatten();
        Self {
            of_all: [
                instant.voltage,
                instant.charge,
                instant.stored,
                instant.electric,
                instant.kinetic,
                instant.dissipated,
                instant.supplied,
                instant.largest,
                instant.watched,
            ],
            of_bodies: bodies
                .map(
                    |Motion {
                         translation: [x, y],
                         rotation,
                     }| [*x, *y, *rotation],
                )
                .collect(),
        }
    }

    /// Combines each number with its counterpart.
    fn with(&self, other: &Self, both: impl Fn(f64, f64) -> f64) -> Self {
        let bodies = self.of_bodies.iter().zip(&other.of_bodies);
        Self {
            of_all: std::array::from_fn(|k| both(self.of_all[k], other.of_all[k])),
            of_bodies: bodies
                .map(|(own, other)| std::array::from_fn(|k| both(own[k], other[k])))
                .collect(),
        }
    }

    /// Returns the corrections to an instant from that of a pass with steps twice as long.
    fn between(coarse: &Instant, fine: &Instant) -> Self {
        let (own, mut other) = (Self::of(fine), Self::of(coarse));
        for ([.., own], [.., other]) in own.of_bodies.iter().zip(&mut other.of_bodies) {
            *other = own - the_shorter_way(own - *other);
        }
        own.with(&other, |fine, coarse| FRACTION * (fine - coarse))
    }

    /// Interpolates towards another set of numbers.
    fn towards(&self, other: &Self, share: f64) -> Self {
        self.with(other, |from, to| from + share * (to - from))
    }

    fn added_to(&self, instant: &Instant) -> Instant {
        let sum = Self::of(instant).with(self, |own, change| own + change);
        let [
            voltage,
            charge,
            stored,
            electric,
            kinetic,
            dissipated,
            supplied,
            largest,
            watched,
        ] = sum.of_all;
        let moved = |[x, y, rotation]: [f64; 3]| Motion {
            translation: [x, y],
            rotation: the_shorter_way(rotation),
        };
        let mut moved = sum.of_bodies.into_iter().map(moved);
        let mut take = |like: &Option<Vec<Motion>>| {
            like.as_ref()
                .map(|like| moved.by_ref().take(like.len()).collect::<Vec<_>>())
        };
        Instant {
            time: instant.time,
            voltage,
            charge,
            stored,
            electric,
            kinetic,
            dissipated,
            supplied,
            largest: largest.max(0.0),
            watched: watched.max(0.0),
            bodies: take(&instant.bodies),
            bars: take(&instant.bars),
        }
    }
}

/// Returns an angle in degrees from −180 to 180.
fn the_shorter_way(turn: f64) -> f64 {
    turn - 360.0 * (turn / 360.0).round()
}
