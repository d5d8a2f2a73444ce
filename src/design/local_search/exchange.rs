//! Which units to turn on and off first, given what each alone would gain, so that the area stays in its range.

use super::units::Units;

/// How many of the best of either kind are looked at for one exchange: where units differ in size, the best two may not fit.
const WINDOW: usize = 4;

/// Exchanges units one after another, the most profitable first.
pub(super) struct Exchange<'a> {
    units: &'a Units,
    gains: &'a [f64],
    /// Least and most active cells.
    range: (usize, usize),
    /// Which units are on, after the exchanges so far.
    pub(super) on: Vec<bool>,
    area: usize,
    /// Units that may be turned on and off, the best last.
    adds: Vec<usize>,
    removes: Vec<usize>,
}

impl<'a> Exchange<'a> {
    /// From the units that are on. `gains` says what flipping each would gain, NaN where it may not be flipped.
    pub(super) fn new(units: &'a Units, on: &[bool], gains: &'a [f64], range: (usize, usize)) -> Self {
        let density = |unit: usize| gains[unit] / units.cells(unit).len() as f64;
        let sorted = |state: bool| {
            let mut list: Vec<usize> = (0..units.count())
                .filter(|&unit| on[unit] == state && !gains[unit].is_nan())
                .collect();
            list.sort_by(|&a, &b| density(a).total_cmp(&density(b)).then(b.cmp(&a)));
            list
        };
        Self {
            units,
            gains,
            range,
            area: units.area(on),
            adds: sorted(false),
            removes: sorted(true),
            on: on.to_vec(),
        }
    }

    /// Flips the units that bring the area into its range at the least loss; whether that is possible.
    pub(super) fn fit(&mut self) -> bool {
        while self.area > self.range.1 || self.area < self.range.0 {
            let list = if self.area > self.range.1 {
                &mut self.removes
            } else {
                &mut self.adds
            };
            let Some(unit) = list.pop() else { return false };
            self.flip(unit);
        }
        true
    }

    /// Makes the most profitable exchange: a unit on, one off, or both. Whether there is one with a gain.
    pub(super) fn step(&mut self) -> bool {
        self.step_above(0.0)
    }

    /// Makes the exchange that gains most or loses least. Whether there is one.
    pub(super) fn step_anyway(&mut self) -> bool {
        self.step_above(f64::NEG_INFINITY)
    }

    fn step_above(&mut self, least: f64) -> bool {
        let last = |list: &[usize]| -> Vec<Option<usize>> {
            list.iter()
                .rev()
                .take(WINDOW)
                .map(|&unit| Some(unit))
                .chain([None])
                .collect()
        };
        let (adds, removes) = (last(&self.adds), last(&self.removes));
        let mut best: Option<(f64, Option<usize>, Option<usize>)> = None;
        for &add in &adds {
            for &remove in &removes {
                let size = |unit: Option<usize>| unit.map_or(0, |unit| self.units.cells(unit).len());
                let gain = |unit: Option<usize>| unit.map_or(0.0, |unit| self.gains[unit]);
                let area = self.area + size(add) - size(remove);
                let gain = gain(add) + gain(remove);
                let flipped = add.is_some() || remove.is_some();
                if flipped && gain > best.map_or(least, |best| best.0) && (self.range.0..=self.range.1).contains(&area)
                {
                    best = Some((gain, add, remove));
                }
            }
        }
        let Some((_, add, remove)) = best else { return false };
        self.adds.retain(|&unit| Some(unit) != add);
        self.removes.retain(|&unit| Some(unit) != remove);
        [add, remove].into_iter().flatten().for_each(|unit| self.flip(unit));
        true
    }

    fn flip(&mut self, unit: usize) {
        let size = self.units.cells(unit).len();
        self.on[unit] = !self.on[unit];
        self.area = if self.on[unit] {
            self.area + size
        } else {
            self.area - size
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Raster;

    fn cells() -> Units {
        Units::new([50; 2], Raster::PAPER, &[true; 2500])
    }

    /// What flipping gains where each active cell is worth `worth`.
    fn gains(on: &[bool], worth: impl Fn(usize) -> f64) -> Vec<f64> {
        let gain = |(cell, on): (usize, &bool)| if *on { -worth(cell) } else { worth(cell) };
        on.iter().enumerate().map(gain).collect()
    }

    #[test]
    fn exchanges_lead_to_the_most_valuable_cells() {
        let units = cells();
        let worth = |cell: usize| 1000.0 - (cell * 37 % 2500) as f64;
        let start: Vec<bool> = (0..2500).map(|cell| cell % 2 == 0).collect();
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
            // A cell worth nothing may be on or off.
            let on = exchange.on.iter().filter(|on| **on).count();
            assert!(on == expected || on == expected + 1, "{range:?}: {on}");
            assert!(valuable[..expected].iter().all(|&cell| exchange.on[cell]), "{range:?}");
        }
    }

    #[test]
    fn what_may_not_be_flipped_is_not() {
        let units = cells();
        let start = vec![false; 2500];
        let mut gains = vec![1.0; 2500];
        gains[7] = f64::NAN;
        let mut exchange = Exchange::new(&units, &start, &gains, (0, 2500));
        while exchange.step() {}
        assert!(!exchange.on[7] && exchange.on.iter().filter(|on| **on).count() == 2499);
        assert!(!Exchange::new(&units, &start, &gains, (2500, 2500)).fit());
    }

    #[test]
    fn units_of_different_sizes_are_exchanged_within_the_range() {
        let units = Units::new([20; 2], Raster::PAPER, &[true; 2500]);
        let start: Vec<bool> = (0..400).map(|unit| unit % 20 < 10).collect();
        let gains: Vec<f64> = (0..400)
            .map(|unit| ((unit * 29 % 41) as f64 - 20.0) * units.cells(unit).len() as f64)
            .collect();
        let mut exchange = Exchange::new(&units, &start, &gains, (1238, 1262));
        let mut steps = 0;
        while exchange.step() {
            let area = units.area(&exchange.on);
            assert!((1238..=1262).contains(&area) && area == exchange.area);
            steps += 1;
        }
        assert!(steps > 50);
    }
}
