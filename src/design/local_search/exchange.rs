//! Exchanges of units in the order of their gains, with the area kept in its range.

use super::gains::{Change, Gains};
use super::units::Units;

/// Number of the best changes of each kind that are combined: if units differ in size, the best two may leave the area
/// range.
const WINDOW: usize = 4;

/// Exchanges units one after another, the best first.
pub(super) struct Exchange<'a> {
    units: &'a Units,
    gains: &'a Gains,
    /// Minimum and maximum number of active cells.
    range: (usize, usize),
    /// The group of each unit after the exchanges so far, 0 if it is off.
    pub(super) on: Vec<u8>,
    area: usize,
    /// Units that can be turned on, turned off and moved to another group, the best last.
    adds: Vec<Change>,
    removes: Vec<Change>,
    switches: Vec<Change>,
}

impl<'a> Exchange<'a> {
    /// Starts from the groups of the units.
    pub(super) fn new(units: &'a Units, on: &[u8], gains: &'a Gains, range: (usize, usize)) -> Self {
        let density = |change: &Change| gains.of(*change) / units.cells(change.unit).len() as f64;
        let sorted = |change: &dyn Fn(usize) -> Option<Change>| {
            let mut list: Vec<Change> = (0..units.count()).filter_map(change).collect();
            list.sort_by(|a, b| density(a).total_cmp(&density(b)).then(b.unit.cmp(&a.unit)));
            list
        };
        let is_on = |unit: usize| on[unit] != 0;
        Self {
            units,
            gains,
            range,
            area: units.area(on),
            adds: sorted(&|unit| gains.best_electrode(unit, 0).filter(|_| !is_on(unit))),
            removes: sorted(&|unit| gains.removal(unit).filter(|_| is_on(unit))),
            switches: sorted(&|unit| gains.best_electrode(unit, on[unit]).filter(|_| is_on(unit))),
            on: on.to_vec(),
        }
    }

    /// Brings the area into its range at the smallest loss. Returns whether that is possible.
    pub(super) fn fit(&mut self) -> bool {
        while self.area > self.range.1 || self.area < self.range.0 {
            let list = match self.area > self.range.1 {
                true => &mut self.removes,
                false => &mut self.adds,
            };
            let Some(change) = list.pop() else { return false };
            self.make(change);
        }
        true
    }

    /// Makes the best exchange: turns a unit on, one off, both, or moves one to another group. Returns whether there
    /// was a gain.
    pub(super) fn step(&mut self) -> bool {
        self.step_above(0.0)
    }

    /// Makes the best exchange, even at a loss. Returns whether there was an exchange.
    pub(super) fn step_anyway(&mut self) -> bool {
        self.step_above(f64::NEG_INFINITY)
    }

    fn step_above(&mut self, least: f64) -> bool {
        let last = |list: &[Change]| -> Vec<Option<Change>> {
            let best = list.iter().rev().take(WINDOW).copied();
            best.map(Some).chain([None]).collect()
        };
        let (adds, removes) = (last(&self.adds), last(&self.removes));
        let mut best: Option<(f64, [Option<Change>; 2])> = None;
        for &add in &adds {
            for &remove in &removes {
                let size = |change: Option<Change>| change.map_or(0, |change| self.units.cells(change.unit).len());
                let gain = |change: Option<Change>| change.map_or(0.0, |change| self.gains.of(change));
                let area = self.area + size(add) - size(remove);
                let gain = gain(add) + gain(remove);
                let changed = add.is_some() || remove.is_some();
                if changed
                    && gain > best.as_ref().map_or(least, |best| best.0)
                    && (self.range.0..=self.range.1).contains(&area)
                {
                    best = Some((gain, [add, remove]));
                }
            }
        }
        if let Some(&switch) = self.switches.last() {
            let gain = self.gains.of(switch);
            if gain > best.as_ref().map_or(least, |best| best.0) && (self.range.0..=self.range.1).contains(&self.area) {
                best = Some((gain, [Some(switch), None]));
            }
        }
        let Some((_, changes)) = best else { return false };
        for change in changes.into_iter().flatten() {
            self.adds.retain(|other| other.unit != change.unit);
            self.removes.retain(|other| other.unit != change.unit);
            self.make(change);
        }
        true
    }

    fn make(&mut self, change: Change) {
        let size = self.units.cells(change.unit).len();
        match (self.on[change.unit], change.to) {
            (0, _) => self.area += size,
            (_, 0) => self.area -= size,
            _ => {}
        }
        self.on[change.unit] = change.to;
        self.switches.retain(|other| other.unit != change.unit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::{Bits, Raster};

    fn cells() -> Units {
        Units::new([50; 2], &Bits::full(Raster::PAPER))
    }

    /// First-order gains for the value of each active cell.
    fn gains(on: &[u8], worth: impl Fn(usize) -> f64) -> Gains {
        Gains::first_order(on, &[(0..on.len()).map(worth).collect()])
    }

    #[test]
    fn exchanges_lead_to_the_most_valuable_cells() {
        let units = cells();
        let worth = |cell: usize| 1000.0 - (cell * 37 % 2500) as f64;
        let start: Vec<u8> = (0..2500).map(|cell| u8::from(cell % 2 == 0)).collect();
        for (range, expected) in [
            ((1250, 1250), 1250),
            ((0, 2500), 1000),
            ((1100, 1300), 1100),
            ((0, 500), 500),
        ] {
            let gains = gains(&start, worth);
            let mut exchange = Exchange::new(&units, &start, &gains, range);
            assert!(exchange.fit());
            while exchange.step() {}
            let mut valuable: Vec<usize> = (0..2500).collect();
            valuable.sort_by(|&a, &b| worth(b).total_cmp(&worth(a)));
            // A cell without value may be on or off.
            let on = exchange.on.iter().filter(|on| **on != 0).count();
            assert!(on == expected || on == expected + 1, "{range:?}: {on}");
            assert!(
                valuable[..expected].iter().all(|&cell| exchange.on[cell] != 0),
                "{range:?}"
            );
        }
    }

    #[test]
    fn masked_units_are_not_changed() {
        let units = cells();
        let start = vec![0; 2500];
        let gains = Gains::uniform(&start, 1, 1.0).masked(|unit| unit != 7);
        let mut exchange = Exchange::new(&units, &start, &gains, (0, 2500));
        while exchange.step() {}
        assert!(exchange.on[7] == 0 && exchange.on.iter().filter(|on| **on != 0).count() == 2499);
        assert!(!Exchange::new(&units, &start, &gains, (2500, 2500)).fit());
    }

    #[test]
    fn units_of_different_sizes_are_exchanged_within_the_range() {
        let units = Units::new([20; 2], &Bits::full(Raster::PAPER));
        let start: Vec<u8> = (0..400).map(|unit| u8::from(unit % 20 < 10)).collect();
        let mut gains = Gains::uniform(&start, 1, 0.0);
        for (unit, now) in start.iter().enumerate() {
            let gain = ((unit * 29 % 41) as f64 - 20.0) * units.cells(unit).len() as f64;
            let to = 1 - now;
            gains.set(Change { unit, to }, gain);
        }
        let mut exchange = Exchange::new(&units, &start, &gains, (1238, 1262));
        let mut steps = 0;
        while exchange.step() {
            let area = units.area(&exchange.on);
            assert!((1238..=1262).contains(&area) && area == exchange.area);
            steps += 1;
        }
        assert!(steps > 50);
    }

    #[test]
    fn units_move_to_the_group_with_the_largest_value() {
        let units = cells();
        let worth: [Vec<f64>; 2] = [
            (0..2500).map(|cell| 1.0 - (cell % 50) as f64 / 25.0).collect(),
            (0..2500).map(|cell| (cell % 50) as f64 / 25.0 - 1.5).collect(),
        ];
        let best = |cell: usize| match (worth[0][cell], worth[1][cell]) {
            (one, two) if one <= 0.0 && two <= 0.0 => 0,
            (one, two) => 1 + u8::from(two > one),
        };
        for start in [vec![0; 2500], vec![1; 2500], vec![2; 2500]] {
            let gains = Gains::first_order(&start, &worth);
            let mut exchange = Exchange::new(&units, &start, &gains, (0, 2500));
            while exchange.step() {}
            let right = (0..2500)
                .filter(|&cell| worth[0][cell] != 0.0 && exchange.on[cell] == best(cell))
                .count();
            assert_eq!(right, 2450, "all but the column that is worth nothing");
        }
        // With the area fixed, cells change groups and places, and their number stays.
        let start: Vec<u8> = (0..2500)
            .map(|cell| if cell < 500 { 1 + (cell % 2) as u8 } else { 0 })
            .collect();
        let gains = Gains::first_order(&start, &worth);
        let mut exchange = Exchange::new(&units, &start, &gains, (500, 500));
        let worth_of = |on: &[u8]| -> f64 {
            let each = on.iter().enumerate().filter(|(_, group)| **group != 0);
            each.map(|(cell, &group)| worth[usize::from(group) - 1][cell]).sum()
        };
        while exchange.step() {
            assert_eq!(units.area(&exchange.on), 500);
        }
        assert!(worth_of(&exchange.on) > worth_of(&start) + 300.0);
    }
}
