//! The histogram of the largest displacement: the source paper's measure of the coverage of a dataset.
//!
//! Qin et al. (doi 10.1089/soro.2024.0063, equations 1 and 2) divide [0, 2.5] mm into 100 bins. This histogram also
//! counts values outside the range, so that a dataset without its extremes does not look complete.

/// Equal bins over [low, high) in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bins {
    low: f64,
    high: f64,
    count: usize,
}

/// Why bins are invalid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BinsError {
    /// The number of bins is 0.
    #[error("a histogram needs at least one bin")]
    NoBins,
    /// The range is not finite and increasing.
    #[error("the range of a histogram must increase, found {low} mm to {high} mm")]
    Range {
        /// The lower end.
        low: f64,
        /// The upper end.
        high: f64,
    },
}

/// The bin of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BinIndex {
    /// Below the range.
    Below,
    /// In the bin with this index.
    Bin(usize),
    /// At the upper end of the range or above.
    Above,
}

impl Bins {
    /// Divides [`low`, `high`) mm into `count` bins.
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

    /// Returns the number of bins.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the lower end of a bin in mm; for the bin after the last, the upper end of the range.
    #[must_use]
    pub fn edge(&self, bin: usize) -> f64 {
        self.low + (self.high - self.low) * (bin as f64 / self.count as f64)
    }

    /// Returns the bin of a finite value in mm: bin b holds `edge(b) <= value < edge(b + 1)`.
    #[must_use]
    pub fn index_of(&self, value: f64) -> BinIndex {
        if value < self.low {
            return BinIndex::Below;
        }
        if value >= self.high {
            return BinIndex::Above;
        }
        let estimate = ((value - self.low) / (self.high - self.low) * self.count as f64) as usize;
        // Division and multiplication round differently, so near an edge the estimate may be off by one.
        let mut bin = estimate.min(self.count - 1);
        while bin > 0 && value < self.edge(bin) {
            bin -= 1;
        }
        while bin + 1 < self.count && value >= self.edge(bin + 1) {
            bin += 1;
        }
        BinIndex::Bin(bin)
    }
}

/// Numbers of values in each bin and outside the range.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// The bins.
    pub bins: Bins,
    /// Values in each bin.
    pub counts: Vec<u64>,
    /// Values below the range.
    pub below: u64,
    /// Values at the upper end of the range or above.
    pub above: u64,
}

impl Histogram {
    /// Creates an empty histogram.
    #[must_use]
    pub fn empty(bins: Bins) -> Self {
        Self {
            bins,
            counts: vec![0; bins.count()],
            below: 0,
            above: 0,
        }
    }

    /// Creates the histogram of finite values in mm.
    #[must_use]
    pub fn of(bins: Bins, values: impl IntoIterator<Item = f64>) -> Self {
        let mut histogram = Self::empty(bins);
        for value in values {
            histogram.add(bins.index_of(value), 1);
        }
        histogram
    }

    /// Adds `count` values to a bin.
    pub fn add(&mut self, index: BinIndex, count: u64) {
        match index {
            BinIndex::Below => self.below += count,
            BinIndex::Bin(bin) => self.counts[bin] += count,
            BinIndex::Above => self.above += count,
        }
    }

    /// Returns the indices of empty bins.
    #[must_use]
    pub fn empty_bins(&self) -> Vec<usize> {
        (0..self.counts.len()).filter(|&bin| self.counts[bin] == 0).collect()
    }

    /// Returns the number of values inside the range.
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
        assert_eq!(bins.index_of(0.0), BinIndex::Bin(0));
        assert_eq!(bins.index_of(2.499_999), BinIndex::Bin(99));
        assert_eq!(bins.index_of(2.5), BinIndex::Above);
        assert_eq!(bins.index_of(-1e-300), BinIndex::Below);
    }

    #[test]
    fn an_edge_belongs_to_the_bin_that_it_begins() {
        for (low, high, count) in [(0.0, 2.5, 100), (0.1, 0.7, 7), (-3.0, 11.0, 333)] {
            let bins = Bins::new(low, high, count).unwrap();
            for bin in 0..count {
                assert_eq!(bins.index_of(bins.edge(bin)), BinIndex::Bin(bin));
                assert_eq!(bins.index_of(bins.edge(bin + 1).next_down()), BinIndex::Bin(bin));
            }
        }
    }

    #[test]
    fn values_outside_the_range_are_counted() {
        let bins = Bins::new(1.0, 2.0, 4).unwrap();
        let histogram = Histogram::of(bins, [0.5, 1.0, 1.3, 1.3, 1.999, 2.0, 7.0]);
        assert_eq!(histogram.counts, [1, 2, 0, 1]);
        assert_eq!((histogram.below, histogram.above, histogram.inside()), (1, 2, 4));
        assert_eq!(histogram.empty_bins(), [2]);
    }

    #[test]
    fn invalid_ranges_are_refused() {
        assert_eq!(Bins::new(0.0, 1.0, 0), Err(BinsError::NoBins));
        for (low, high) in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            assert!(matches!(Bins::new(low, high, 3), Err(BinsError::Range { .. })));
        }
    }
}
