//! Balancing: selects rows such that all displacements occur equally often.
//!
//! The source paper has four steps (Qin et al., doi 10.1089/soro.2024.0063, "Dataset construction"): histogram of the
//! largest displacement; uniform level; removal of rows from bins above it; eightfold augmentation of bins below it by
//! rotation and mirror, then levelling again. Here [`super::level`] computes the final level directly, over the bins
//! that are not empty.
//!
//! The selection depends on the seed, the orbit and the image only, not on threads or the order of the samples.

use super::histogram::{BinIndex, Bins, Histogram};
use super::level::quotas;
use super::orbits::{Image, Orbit, orbits};
use super::split::Split;
use deaflow_base::{OrbitId, Stream, words};
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Symmetries, Symmetry};

words! {
    /// Symmetries for augmentation.
    pub enum SymmetryGroup {
        /// The symmetries of the membrane: the eight of a square, the four of a rectangle.
        D4 = "d4",
        /// No augmentation.
        None = "none",
    }
}

/// Options of balancing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BalanceOptions {
    /// Bins of the largest displacement.
    pub bins: Bins,
    /// Number of rows, images included.
    pub target: u64,
    /// Augmentation of sparse bins.
    pub symmetry: SymmetryGroup,
    /// The symmetries of the membrane.
    pub group: Symmetries,
    /// Seed of the random choices and the split.
    pub seed: u64,
}

/// A solved sample.
#[derive(Clone, Copy, Debug)]
pub struct Candidate<'a> {
    /// Its pattern.
    pub pattern: &'a Pattern,
    /// The largest displacement magnitude of its field in mm; `None` if the pattern has no stable solution.
    pub max_displacement: Option<f64>,
}

/// A row of the balanced dataset: an image of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BalancedRow {
    /// Index of the sample among the candidates.
    pub source: usize,
    /// The symmetry that maps pattern and field of the sample to the row.
    pub symmetry: Symmetry,
    /// The orbit of the pattern.
    pub orbit: OrbitId,
    /// The split of the orbit.
    pub split: Split,
    /// The bin of its largest displacement.
    pub bin: usize,
}

impl BalancedRow {
    /// Returns the pattern of the row, given that of its source.
    #[must_use]
    pub fn pattern(&self, source: &Pattern) -> Pattern {
        source.transformed(self.symmetry)
    }

    /// Returns the field of the row, given that of its source.
    #[must_use]
    pub fn field(&self, source: &Field) -> Field {
        source.transformed(self.symmetry)
    }
}

/// A balanced dataset: its rows refer to the samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Balanced {
    /// The rows, ordered by source and symmetry.
    pub rows: Vec<BalancedRow>,
    /// All solved candidates, repeats included. Candidates outside the range are not in the balanced dataset.
    pub before: Histogram,
    /// Distinct patterns, with all images in augmented bins.
    pub augmented: Histogram,
    /// The rows.
    pub after: Histogram,
    /// The uniform level in rows per bin; the largest bin when all rows together do not exceed the target.
    pub level: f64,
    /// Candidates that are omitted because they repeat the pattern of an earlier one.
    pub repeats: Vec<usize>,
    /// Candidates without a stable solution.
    pub unsolved: Vec<usize>,
}

/// Error of balancing.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BalanceError {
    /// The target is 0.
    #[error("the target of a balanced dataset must be at least one row")]
    NoTarget,
    /// A largest displacement is negative or not finite.
    #[error("the largest displacement of sample {index} is {found} mm; it must be finite and not negative")]
    Displacement {
        /// Index of the candidate.
        index: usize,
        /// Its largest displacement.
        found: f64,
    },
}

/// Balances samples.
///
/// # Errors
/// When the target is 0, or a displacement is negative or not finite.
pub fn balance(candidates: &[Candidate<'_>], options: &BalanceOptions) -> Result<Balanced, BalanceError> {
    if options.target == 0 {
        return Err(BalanceError::NoTarget);
    }
    let peaks = checked_peaks(candidates)?;
    let solved: Vec<(usize, &Pattern)> = peaks.iter().map(|&(i, _)| (i, candidates[i].pattern)).collect();
    let mut repeats = Vec::new();
    let mut content = vec![BinContent::default(); options.bins.count()];
    for orbit in orbits(&solved, options.group) {
        repeats.extend(&orbit.repeats);
        let first = candidates[orbit.images[0].source].max_displacement;
        if let Some(BinIndex::Bin(bin)) = first.map(|peak| options.bins.index_of(peak)) {
            content[bin].add(&orbit, bin, options);
        }
    }
    repeats.sort_unstable();
    let before = Histogram::of(options.bins, peaks.iter().map(|&(_, peak)| peak));
    let (level, augmented, mut rows) = levelled(content, options);
    rows.sort_by_key(|row| (row.source, row.symmetry));
    let mut after = Histogram::empty(options.bins);
    rows.iter().for_each(|row| after.add(BinIndex::Bin(row.bin), 1));
    let is_unsolved = |&i: &usize| candidates[i].max_displacement.is_none();
    Ok(Balanced {
        rows,
        before,
        augmented,
        after,
        level,
        repeats,
        unsolved: (0..candidates.len()).filter(is_unsolved).collect(),
    })
}

/// Returns index and largest displacement of each solved candidate.
fn checked_peaks(candidates: &[Candidate<'_>]) -> Result<Vec<(usize, f64)>, BalanceError> {
    let peaks = candidates.iter().enumerate();
    let peaks = peaks.filter_map(|(i, candidate)| Some((i, candidate.max_displacement?)));
    let peaks: Vec<(usize, f64)> = peaks.collect();
    match peaks.iter().find(|(_, peak)| !peak.is_finite() || *peak < 0.0) {
        Some(&(index, found)) => Err(BalanceError::Displacement { index, found }),
        None => Ok(peaks),
    }
}

/// The rows that a bin can give, each with a random number that determines the order of the selection.
#[derive(Clone, Default)]
struct BinContent {
    sampled: Vec<(u64, BalancedRow)>,
    images: Vec<(u64, BalancedRow)>,
}

impl BinContent {
    fn add(&mut self, orbit: &Orbit, bin: usize, options: &BalanceOptions) {
        let word = u64::from_le_bytes(orbit.id.as_bytes()[..8].try_into().expect("a digest has 32 bytes"));
        let mut stream = Stream::new(options.seed, "balance", word);
        for image in &orbit.images {
            let order = stream.next_u64();
            let row = row(orbit, image, bin, options.seed);
            if image.symmetry == Symmetry::IDENTITY {
                self.sampled.push((order, row));
            } else if options.symmetry == SymmetryGroup::D4 {
                self.images.push((order, row));
            }
        }
    }

    fn capacity(&self) -> u64 {
        (self.sampled.len() + self.images.len()) as u64
    }

    /// Selects `quota` rows: samples first, then images.
    fn choose(self, quota: usize) -> impl Iterator<Item = BalancedRow> {
        let ordered = |mut rows: Vec<(u64, BalancedRow)>| {
            rows.sort_by_key(|(order, row)| (*order, row.orbit, row.symmetry));
            rows
        };
        let all = ordered(self.sampled).into_iter().chain(ordered(self.images));
        all.take(quota).map(|(_, row)| row)
    }
}

fn row(orbit: &Orbit, image: &Image, bin: usize, seed: u64) -> BalancedRow {
    BalancedRow {
        source: image.source,
        symmetry: image.symmetry,
        orbit: orbit.id,
        split: Split::of(&orbit.id, seed),
        bin,
    }
}

/// Returns the level, the histogram after augmentation and the selected rows.
fn levelled(content: Vec<BinContent>, options: &BalanceOptions) -> (f64, Histogram, Vec<BalancedRow>) {
    let capacities: Vec<u64> = content.iter().map(BinContent::capacity).collect();
    let order = |bin| Stream::new(options.seed, "balance remainder", bin).next_u64();
    let order: Vec<u64> = (0..content.len() as u64).map(order).collect();
    let quotas = quotas(&capacities, options.target, &order);
    let mut augmented = Histogram::empty(options.bins);
    let mut rows = Vec::new();
    for (bin, (content, &quota)) in content.into_iter().zip(&quotas.rows).enumerate() {
        let sampled = content.sampled.len() as u64;
        let available = if sampled < quota { content.capacity() } else { sampled };
        augmented.add(BinIndex::Bin(bin), available);
        rows.extend(content.choose(quota as usize));
    }
    (quotas.level, augmented, rows)
}

#[cfg(test)]
mod tests;
