//! The histogram of the largest displacement: the source paper's measure of what a dataset covers.
//!
//! Qin et al. (doi 10.1089/soro.2024.0063, equations 1 and 2) divide [0, 2.5] mm into 100 bins. Here what lies outside
//! the range is counted below and above it: a dataset must not look complete because its extremes were left out.

/// Equal bins over [low, high) in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bins {
    low: f64,
    high: f64,
    count: usize,
}

/// Numbers that are not a division into bins.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BinsError {
    /// No bin at all.
    #[error("a histogram needs at least one bin")]
    NoBins,
    /// The ends are not two finite numbers in order.
    #[error("the range of a histogram goes from a smaller to a larger number, found {low} mm to {high} mm")]
    Range {
        /// The lower end as given.
        low: f64,
        /// The upper end as given.
        high: f64,
    },
}

/// Where a value lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Below the range.
    Below,
    /// In the bin of this number.
    Bin(usize),
    /// At the upper end of the range or above it.
    Above,
}

impl Bins {
    /// `count` bins over [`low`, `high`) mm.
    ///
    /// # Errors
    /// When there is no bin, or the range is not finite and increasing.
    pub fn new(low: f64, high: f64, count: usize) -> Result<Self, BinsError> {
        if count == 0 {
            return Err(BinsError::NoBins);
        }
        if !(low.is_finite() && high.is_finite() && low < high) {
            return Err(BinsError::Range { low, high });
        }
        Ok(Self { low, high, count })
    }

    /// How many bins there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// The lower end of bin `bin` in mm; that of the bin after the last is the upper end of the range.
    #[must_use]
    pub fn edge(&self, bin: usize) -> f64 {
        self.low + (self.high - self.low) * (bin as f64 / self.count as f64)
    }

    /// Where a finite value in mm lies: bin b holds `edge(b) <= value < edge(b + 1)`.
    #[must_use]
    pub fn place(&self, value: f64) -> Place {
        if value < self.low {
            return Place::Below;
        }
        if value >= self.high {
            return Place::Above;
        }
        let estimate = ((value - self.low) / (self.high - self.low) * self.count as f64) as usize;
        // Division and multiplication round differently: near an edge the estimate may be one off.
        let mut bin = estimate.min(self.count - 1);
        while bin > 0 && value < self.edge(bin) {
            bin -= 1;
        }
        while bin + 1 < self.count && value >= self.edge(bin + 1) {
            bin += 1;
        }
        Place::Bin(bin)
    }
}

/// How many values lie in each bin, and how many outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// The bins.
    pub bins: Bins,
    /// Values in each bin.
    pub counts: Vec<u64>,
    /// Values below the range.
    pub below: u64,
    /// Values above the range.
    pub above: u64,
}

impl Histogram {
    /// The histogram of no values.
    #[must_use]
    pub fn empty(bins: Bins) -> Self {
        Self {
            bins,
            counts: vec![0; bins.count()],
            below: 0,
            above: 0,
        }
    }

    /// The histogram of finite values in mm.
    #[must_use]
    pub fn of(bins: Bins, values: impl IntoIterator<Item = f64>) -> Self {
        let mut histogram = Self::empty(bins);
        for value in values {
            histogram.add(bins.place(value), 1);
        }
        histogram
    }

    /// Counts `number` more values at a place.
    pub fn add(&mut self, place: Place, number: u64) {
        match place {
            Place::Below => self.below += number,
            Place::Bin(bin) => self.counts[bin] += number,
            Place::Above => self.above += number,
        }
    }

    /// Numbers of the bins that hold nothing.
    #[must_use]
    pub fn empty_bins(&self) -> Vec<usize> {
        (0..self.counts.len()).filter(|&bin| self.counts[bin] == 0).collect()
    }

    /// Values inside the range.
    #[must_use]
    pub fn inside(&self) -> u64 {
        self.counts.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_bins_are_a_fortieth_of_a_millimetre() {
        let bins = Bins::new(0.0, 2.5, 100).unwrap();
        assert_eq!(bins.edge(1), 0.025);
        assert_eq!(bins.edge(100), 2.5);
        assert_eq!(bins.place(0.0), Place::Bin(0));
        assert_eq!(bins.place(2.499_999), Place::Bin(99));
        assert_eq!(bins.place(2.5), Place::Above);
        assert_eq!(bins.place(-1e-300), Place::Below);
    }

    #[test]
    fn an_edge_belongs_to_the_bin_that_it_begins() {
        for (low, high, count) in [(0.0, 2.5, 100), (0.1, 0.7, 7), (-3.0, 11.0, 333)] {
            let bins = Bins::new(low, high, count).unwrap();
            for bin in 0..count {
                assert_eq!(bins.place(bins.edge(bin)), Place::Bin(bin));
                assert_eq!(bins.place(bins.edge(bin + 1).next_down()), Place::Bin(bin));
            }
        }
    }

    #[test]
    fn what_lies_outside_is_counted() {
        let bins = Bins::new(1.0, 2.0, 4).unwrap();
        let histogram = Histogram::of(bins, [0.5, 1.0, 1.3, 1.3, 1.999, 2.0, 7.0]);
        assert_eq!(histogram.counts, [1, 2, 0, 1]);
        assert_eq!((histogram.below, histogram.above, histogram.inside()), (1, 2, 4));
        assert_eq!(histogram.empty_bins(), [2]);
    }

    #[test]
    fn refuses_what_is_not_a_range() {
        assert_eq!(Bins::new(0.0, 1.0, 0), Err(BinsError::NoBins));
        for (low, high) in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            assert!(matches!(Bins::new(low, high, 3), Err(BinsError::Range { .. })));
        }
    }
}
