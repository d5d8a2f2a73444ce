//! The gains of changing units.

/// The change of one unit to another group, or to bare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Change {
    /// The unit.
    pub unit: usize,
    /// The new group, 0 for bare.
    pub to: u8,
}

impl Change {
    /// The groups of units after changes.
    pub fn apply(on: &[u8], changes: &[Self]) -> Vec<u8> {
        let mut on = on.to_vec();
        changes.iter().for_each(|change| on[change.unit] = change.to);
        on
    }
}

/// The gain of moving each unit to each group or to bare; NaN if it is unknown or not allowed.
#[derive(Clone, Debug)]
pub(super) struct Gains {
    /// The number of groups + 1, for bare.
    choices: usize,
    /// `[unit][choice]`.
    values: Vec<f64>,
}

impl Gains {
    /// All gains are unknown.
    pub fn unknown(units: usize, groups: usize) -> Self {
        Self {
            choices: groups + 1,
            values: vec![f64::NAN; units * (groups + 1)],
        }
    }

    /// First-order gains from the values of an electrode of each group in each unit, `values[group][unit]`.
    pub fn first_order(on: &[u8], values: &[Vec<f64>]) -> Self {
        let mut gains = Self::unknown(on.len(), values.len());
        for (unit, &now) in on.iter().enumerate() {
            let of = |group: u8| values[usize::from(group) - 1][unit];
            for to in (0..=values.len() as u8).filter(|to| *to != now) {
                let gain = match (now, to) {
                    (0, to) => of(to),
                    (now, 0) => -of(now),
                    (now, to) => of(to) - of(now),
                };
                gains.set(Change { unit, to }, gain);
            }
        }
        gains
    }

    /// The same gain for all changes.
    pub fn uniform(on: &[u8], groups: usize, gain: f64) -> Self {
        let mut gains = Self::unknown(on.len(), groups);
        for (unit, &now) in on.iter().enumerate() {
            for to in (0..=groups as u8).filter(|to| *to != now) {
                gains.set(Change { unit, to }, gain);
            }
        }
        gains
    }

    /// The gains after units have changed from `before` to `now`.
    pub fn after(&self, before: &[u8], now: &[u8]) -> Self {
        let groups = 0..self.choices as u8;
        let mut gains = Self::unknown(before.len(), self.choices - 1);
        for (unit, (&before, &now)) in before.iter().zip(now).enumerate() {
            let gain = |to: u8| match to == before {
                true => 0.0,
                false => self.of(Change { unit, to }),
            };
            for to in groups.clone().filter(|to| *to != now) {
                gains.set(Change { unit, to }, gain(to) - gain(now));
            }
        }
        gains
    }

    /// The gains of the units for which `is_allowed` is true; the others become unknown.
    pub fn masked(&self, mut is_allowed: impl FnMut(usize) -> bool) -> Self {
        let mut masked = self.clone();
        for (unit, values) in masked.values.chunks_exact_mut(self.choices).enumerate() {
            if !is_allowed(unit) {
                values.fill(f64::NAN);
            }
        }
        masked
    }

    pub fn of(&self, change: Change) -> f64 {
        self.values[change.unit * self.choices + usize::from(change.to)]
    }

    pub fn set(&mut self, change: Change, gain: f64) {
        self.values[change.unit * self.choices + usize::from(change.to)] = gain;
    }

    /// The best change of a unit to another group; the first of equal ones.
    pub fn best_electrode(&self, unit: usize, now: u8) -> Option<Change> {
        let electrodes = (1..self.choices as u8).filter(|to| *to != now);
        let known = electrodes
            .map(|to| Change { unit, to })
            .filter(|change| !self.of(*change).is_nan());
        known.reduce(|best, one| if self.of(one) > self.of(best) { one } else { best })
    }

    /// The change of a unit to bare, if its gain is known.
    pub fn removal(&self, unit: usize) -> Option<Change> {
        let change = Change { unit, to: 0 };
        (!self.of(change).is_nan()).then_some(change)
    }
}
