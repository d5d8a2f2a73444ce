//! What changing units gains.

/// One unit that is to be of another group, or bare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Change {
    /// The unit.
    pub unit: usize,
    /// Its new group, 0 for none.
    pub to: u8,
}

impl Change {
    /// The groups of units after some changes.
    pub fn made(on: &[u8], changes: &[Self]) -> Vec<u8> {
        let mut on = on.to_vec();
        changes.iter().for_each(|change| on[change.unit] = change.to);
        on
    }
}

/// Of each unit what it gains to be of a group of electrodes, or bare; NaN where it may not be, or nobody knows.
#[derive(Clone, Debug)]
pub(super) struct Gains {
    /// Groups, and bare.
    choices: usize,
    /// Choices of the first unit, then of the next.
    values: Vec<f64>,
}

impl Gains {
    /// Nothing is known of units that may have so many groups.
    pub fn unknown(units: usize, groups: usize) -> Self {
        Self {
            choices: groups + 1,
            values: vec![f64::NAN; units * (groups + 1)],
        }
    }

    /// To first order, for units of these groups, by what each is worth with an electrode of each group: `worth[group][unit]`.
    pub fn first_order(on: &[u8], worth: &[Vec<f64>]) -> Self {
        let mut gains = Self::unknown(on.len(), worth.len());
        for (unit, &now) in on.iter().enumerate() {
            let of = |group: u8| worth[usize::from(group) - 1][unit];
            for to in (0..=worth.len() as u8).filter(|to| *to != now) {
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

    /// The same where every change of a unit gains so much.
    pub fn uniform(on: &[u8], groups: usize, gain: f64) -> Self {
        let mut gains = Self::unknown(on.len(), groups);
        for (unit, &now) in on.iter().enumerate() {
            for to in (0..=groups as u8).filter(|to| *to != now) {
                gains.set(Change { unit, to }, gain);
            }
        }
        gains
    }

    /// The same after units have changed: these are of the groups `before`, and now of others.
    pub fn after(&self, before: &[u8], now: &[u8]) -> Self {
        let groups = 0..self.choices as u8;
        let mut gains = Self::unknown(before.len(), self.choices - 1);
        for (unit, (&before, &now)) in before.iter().zip(now).enumerate() {
            let worth = |to: u8| {
                if to == before {
                    0.0
                } else {
                    self.of(Change { unit, to })
                }
            };
            for to in groups.clone().filter(|to| *to != now) {
                gains.set(Change { unit, to }, worth(to) - worth(now));
            }
        }
        gains
    }

    /// Those of the units for which `may` says so; nothing of others.
    pub fn masked(&self, mut may: impl FnMut(usize) -> bool) -> Self {
        let mut masked = self.clone();
        for (unit, values) in masked.values.chunks_exact_mut(self.choices).enumerate() {
            if !may(unit) {
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

    /// The best electrode that a unit of a group, or a bare one, may have instead; the first of equals.
    pub fn best_electrode(&self, unit: usize, now: u8) -> Option<Change> {
        let electrodes = (1..self.choices as u8).filter(|to| *to != now);
        let known = electrodes
            .map(|to| Change { unit, to })
            .filter(|change| !self.of(*change).is_nan());
        known.reduce(|best, one| if self.of(one) > self.of(best) { one } else { best })
    }

    /// To be bare, where it is known.
    pub fn removal(&self, unit: usize) -> Option<Change> {
        let change = Change { unit, to: 0 };
        (!self.of(change).is_nan()).then_some(change)
    }
}
