//! Balancing: from samples crowded at some deformations to a set that covers all of them evenly.
//!
//! The four steps of the source paper (Qin et al., doi 10.1089/soro.2024.0063, "Dataset construction"): histogram of the
//! largest displacement; uniform level; bins above it are thinned; bins below it are augmented eightfold by rotation and
//! mirror, then levelled and thinned once more. The level that the repetition leads to is computed directly, as water
//! over steps ([`super::level`]), over the bins that hold anything; bins that hold nothing show in the histograms.
//!
//! What is kept depends on the seed, the orbit and the image only, not on threads or on the order of the samples.

use super::histogram::{Bins, Histogram, Place};
use super::level::quotas;
use super::orbits::{Image, Orbit, orbits};
use super::split::Split;
use deaflow_base::{OrbitId, Stream, words};
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Symmetries, Symmetry};

words! {
    /// By what images of patterns are made.
    pub enum SymmetryGroup {
        /// The symmetries of the membrane: the eight of a square, the four of a rectangle.
        D4 = "d4",
        /// Nothing: patterns stay as they were sampled.
        None = "none",
    }
}

/// How to balance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BalanceOptions {
    /// Bins of the largest displacement.
    pub bins: Bins,
    /// Rows wanted, images included.
    pub target: u64,
    /// By what sparse bins are augmented.
    pub symmetry: SymmetryGroup,
    /// The symmetries of the membrane.
    pub group: Symmetries,
    /// Names the random choices and the split.
    pub seed: u64,
}

/// A solved sample.
#[derive(Clone, Copy, Debug)]
pub struct Candidate<'a> {
    /// Its pattern.
    pub pattern: &'a Pattern,
    /// The largest displacement magnitude of its field in mm; `None` where the pattern has no stable solution.
    pub max_displacement: Option<f64>,
}

/// One row of the balanced set: an image of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BalancedRow {
    /// Index of the sample among the candidates.
    pub source: usize,
    /// What carries the sample, pattern and field alike, to the row.
    pub symmetry: Symmetry,
    /// Identity shared by all images of the pattern.
    pub orbit: OrbitId,
    /// Which part of the dataset the orbit belongs to.
    pub split: Split,
    /// The bin of its largest displacement.
    pub bin: usize,
}

impl BalancedRow {
    /// The row's pattern, from that of its source.
    #[must_use]
    pub fn pattern(&self, source: &Pattern) -> Pattern {
        source.transformed(self.symmetry)
    }

    /// The row's field, from that of its source: it moves with the pattern and its vectors rotate.
    #[must_use]
    pub fn field(&self, source: &Field) -> Field {
        source.transformed(self.symmetry)
    }
}

/// A balanced set, by reference to its samples, with an account of everything that is not in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Balanced {
    /// The rows, ordered by source and symmetry.
    pub rows: Vec<BalancedRow>,
    /// Every solved candidate, repeats included; what lies outside the range is not in the balanced set.
    pub before: Histogram,
    /// Distinct patterns once sparse bins have all their images.
    pub augmented: Histogram,
    /// The rows.
    pub after: Histogram,
    /// The uniform level in rows per bin; the largest bin when all rows together do not exceed the target.
    pub level: f64,
    /// Candidates that repeat the pattern of an earlier one and are left out.
    pub repeats: Vec<usize>,
    /// Candidates without a stable solution.
    pub unsolved: Vec<usize>,
}

/// What cannot be balanced.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BalanceError {
    /// Nothing was asked for.
    #[error("the target of a balanced set is at least one row")]
    NoTarget,
    /// A displacement that is no length.
    #[error("the largest displacement of sample {index} is {found} mm")]
    Displacement {
        /// Index of the candidate.
        index: usize,
        /// What was found.
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
        if let Some(Place::Bin(bin)) = first.map(|peak| options.bins.place(peak)) {
            content[bin].add(&orbit, bin, options);
        }
    }
    repeats.sort_unstable();
    let before = Histogram::of(options.bins, peaks.iter().map(|&(_, peak)| peak));
    let (level, augmented, mut rows) = levelled(content, options);
    rows.sort_by_key(|row| (row.source, row.symmetry));
    let mut after = Histogram::empty(options.bins);
    rows.iter().for_each(|row| after.add(Place::Bin(row.bin), 1));
    let unsolved = (0..candidates.len())
        .filter(|&i| candidates[i].max_displacement.is_none())
        .collect();
    Ok(Balanced {
        rows,
        before,
        augmented,
        after,
        level,
        repeats,
        unsolved,
    })
}

fn checked_peaks(candidates: &[Candidate<'_>]) -> Result<Vec<(usize, f64)>, BalanceError> {
    let peaks: Vec<(usize, f64)> = candidates
        .iter()
        .enumerate()
        .filter_map(|(i, candidate)| Some((i, candidate.max_displacement?)))
        .collect();
    match peaks.iter().find(|(_, peak)| !peak.is_finite() || *peak < 0.0) {
        Some(&(index, found)) => Err(BalanceError::Displacement { index, found }),
        None => Ok(peaks),
    }
}

/// The rows that a bin can give, each with the random number by which it is chosen.
#[derive(Clone, Default)]
struct BinContent {
    sampled: Vec<(u64, BalancedRow)>,
    images: Vec<(u64, BalancedRow)>,
}

impl BinContent {
    fn add(&mut self, orbit: &Orbit, bin: usize, options: &BalanceOptions) {
        let word = u64::from_le_bytes(orbit.digest.as_bytes()[..8].try_into().expect("a digest has 32 bytes"));
        let mut stream = Stream::new(options.seed, "balance", word);
        for image in &orbit.images {
            let chosen_by = stream.next_u64();
            let row = row(orbit, image, bin, options.seed);
            if image.symmetry == Symmetry::IDENTITY {
                self.sampled.push((chosen_by, row));
            } else if options.symmetry == SymmetryGroup::D4 {
                self.images.push((chosen_by, row));
            }
        }
    }

    fn capacity(&self) -> u64 {
        (self.sampled.len() + self.images.len()) as u64
    }

    /// `quota` rows: samples as they were drawn as far as there are enough, then images.
    fn choose(self, quota: usize) -> impl Iterator<Item = BalancedRow> {
        let ordered = |mut rows: Vec<(u64, BalancedRow)>| {
            rows.sort_by_key(|(chosen_by, row)| (*chosen_by, row.orbit, row.symmetry));
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
        orbit: orbit.digest,
        split: Split::of(&orbit.digest, seed),
        bin,
    }
}

fn levelled(content: Vec<BinContent>, options: &BalanceOptions) -> (f64, Histogram, Vec<BalancedRow>) {
    let capacities: Vec<u64> = content.iter().map(BinContent::capacity).collect();
    let order: Vec<u64> = (0..content.len() as u64)
        .map(|bin| Stream::new(options.seed, "balance remainder", bin).next_u64())
        .collect();
    let quotas = quotas(&capacities, options.target, &order);
    let mut augmented = Histogram::empty(options.bins);
    let mut rows = Vec::new();
    for (bin, (content, &quota)) in content.into_iter().zip(&quotas.rows).enumerate() {
        let sampled = content.sampled.len() as u64;
        let available = if sampled < quota { content.capacity() } else { sampled };
        augmented.add(Place::Bin(bin), available);
        rows.extend(content.choose(quota as usize));
    }
    (quotas.level, augmented, rows)
}

#[cfg(test)]
mod tests;
