//! The genome of the genetic algorithm: the membrane in 20 × 20 units, each bare or with an electrode of one group.
//!
//! The source paper searches on 20 × 20 units (Qin et al., doi 10.1089/soro.2024.0063, "GA-based inverse design")
//! while patterns have 50 × 50 cells: cell i lies in unit floor(i · 20 / 50), so units are alternately 3 and 2 cells
//! wide. Other rasters are divided in the same way; with fewer than 20 columns or rows, some units contain no cell.

use std::fmt;

use deaflow_base::Stream;
use deaflow_pattern::{Pattern, Raster};

/// Units along one side of the membrane.
pub const UNITS: usize = 20;

/// The electrode group of each unit, 0 if it is bare, row by row from below.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Genome {
    genes: Box<[u8]>,
}

impl Genome {
    /// The genome with one group: unit (x, y) is on if `on(x, y)`.
    #[must_use]
    pub fn from_fn(on: impl Fn(usize, usize) -> bool) -> Self {
        Self::from_groups(|x, y| u8::from(on(x, y)))
    }

    /// The genome with unit (x, y) in group `group(x, y)`; 0 means bare.
    #[must_use]
    pub fn from_groups(group: impl Fn(usize, usize) -> u8) -> Self {
        Self {
            genes: (0..UNITS * UNITS).map(|i| group(i % UNITS, i / UNITS)).collect(),
        }
    }

    /// A random genome with one group, all units allowed.
    #[cfg(test)]
    pub(crate) fn random(area: f64, grain: usize, stream: &mut Stream) -> Self {
        Self::random_within(&Self::from_fn(|_, _| true), area, 1, grain, stream)
    }

    /// A random genome: round(`area` · 400) of the `allowed` units are on, or all of them if they are fewer.
    ///
    /// White noise is averaged over 3 × 3 units `grain` times, and the units with the highest values are on. At grain
    /// 0 each choice of units is equally likely; a higher grain gives coarser regions. The units are divided into
    /// groups by a second noise of the same grain; the share of each group is random.
    pub(super) fn random_within(allowed: &Self, area: f64, groups: usize, grain: usize, stream: &mut Stream) -> Self {
        let mut noise = || {
            let white: Vec<f64> = (0..UNITS * UNITS).map(|_| stream.uniform()).collect();
            (0..grain).fold(white, |noise, _| averaged(&noise))
        };
        let rank = |units: &mut Vec<usize>, noise: &[f64]| {
            units.sort_by(|&a, &b| noise[b].total_cmp(&noise[a]).then(a.cmp(&b)));
        };
        let values = noise();
        let on = (area.clamp(0.0, 1.0) * values.len() as f64).round() as usize;
        let mut ranked: Vec<usize> = (0..values.len()).filter(|&unit| allowed.genes[unit] != 0).collect();
        rank(&mut ranked, &values);
        ranked.truncate(on);
        let mut genes = vec![0; values.len()].into_boxed_slice();
        if groups == 1 {
            ranked.into_iter().for_each(|unit| genes[unit] = 1);
            return Self { genes };
        }
        rank(&mut ranked, &noise());
        let shares: Vec<f64> = (0..groups).map(|_| stream.uniform()).collect();
        let total: f64 = shares.iter().sum();
        let (count, mut below) = (ranked.len() as f64, 0.0);
        let mut ranked = ranked.into_iter().enumerate().peekable();
        for (group, share) in shares.iter().enumerate() {
            below += share / total;
            let last = group + 1 == groups;
            while let Some((_, unit)) = ranked.next_if(|(at, _)| last || (*at as f64) < below * count) {
                genes[unit] = group as u8 + 1;
            }
        }
        Self { genes }
    }

    /// All genes, `[y][x]` with the origin at the lower left.
    #[must_use]
    pub fn genes(&self) -> &[u8] {
        &self.genes
    }

    pub(super) fn genes_mut(&mut self) -> &mut [u8] {
        &mut self.genes
    }

    /// The group of the unit at column `x`, row `y`; 0 if it is bare.
    ///
    /// # Panics
    /// If `x` or `y` is not below 20.
    #[must_use]
    pub fn group(&self, x: usize, y: usize) -> u8 {
        assert!(x < UNITS && y < UNITS, "unit ({x}, {y}) is outside the membrane");
        self.genes[y * UNITS + x]
    }

    /// The size of [`Genome::to_bytes`].
    pub(super) const fn bytes(groups: usize) -> usize {
        planes(groups) * UNITS * UNITS / 8
    }

    /// Bit planes: the lowest bit of all genes, then the next; as many planes as the number of groups needs.
    pub(super) fn to_bytes(&self, groups: usize) -> Vec<u8> {
        let byte = |plane: usize, at: usize| {
            let bit = |bit: usize| (self.genes[8 * at + bit] >> plane & 1) << bit;
            (0..8).map(bit).fold(0, |byte, bit| byte | bit)
        };
        let of_plane = |plane| (0..UNITS * UNITS / 8).map(move |at| byte(plane, at));
        (0..planes(groups)).flat_map(of_plane).collect()
    }

    /// Inverse of [`Genome::to_bytes`]; `None` if the length is wrong or a gene exceeds the number of groups.
    pub(super) fn from_bytes(bytes: &[u8], groups: usize) -> Option<Self> {
        let gene = |at: usize| {
            let bits = bytes
                .chunks_exact(UNITS * UNITS / 8)
                .map(|plane| plane[at / 8] >> (at % 8) & 1);
            bits.rev().fold(0, |gene, bit| gene << 1 | bit)
        };
        let genes: Box<[u8]> = (0..UNITS * UNITS).map(gene).collect();
        let is_valid = bytes.len() == Self::bytes(groups) && genes.iter().all(|&gene| usize::from(gene) <= groups);
        is_valid.then_some(Self { genes })
    }

    /// The genome with all units bare that are not allowed.
    pub(super) fn within(mut self, allowed: &Self) -> Self {
        let units = self.genes.iter_mut().zip(&allowed.genes);
        units
            .filter(|(_, allowed)| **allowed == 0)
            .for_each(|(gene, _)| *gene = 0);
        self
    }

    /// The pattern on a raster.
    #[must_use]
    pub fn pattern(&self, raster: Raster) -> Pattern {
        // Divide once per column and row, not once per cell.
        let [columns, rows] = raster
            .sides()
            .map(|cells| (0..cells).map(|at| unit_along(cells, at)).collect::<Vec<_>>());
        Pattern::from_groups(raster, |x, y| self.genes[rows[y] * UNITS + columns[x]])
    }
}

/// Bits per gene.
const fn planes(groups: usize) -> usize {
    (usize::BITS - groups.leading_zeros()) as usize
}

/// The unit of a cell (column, row).
pub(super) fn unit_of(raster: Raster, cell: [usize; 2]) -> [usize; 2] {
    let sides = raster.sides();
    [0, 1].map(|axis| unit_along(sides[axis], cell[axis]))
}

/// The column or row of units that contains a column or row of cells.
fn unit_along(cells: usize, at: usize) -> usize {
    at * UNITS / cells
}

/// The 3 × 3 units around a unit, itself included, that lie on the membrane.
pub(super) fn around(x: usize, y: usize) -> impl Iterator<Item = (usize, usize)> {
    let near = |c: usize| c.saturating_sub(1)..(c + 2).min(UNITS);
    near(y).flat_map(move |j| near(x).map(move |i| (i, j)))
}

/// Averages the values over 3 × 3 units.
fn averaged(values: &[f64]) -> Vec<f64> {
    let mean = |at: usize| {
        let (sum, count) = around(at % UNITS, at / UNITS)
            .map(|(x, y)| values[y * UNITS + x])
            .fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
        sum / count
    };
    (0..values.len()).map(mean).collect()
}

impl fmt::Debug for Genome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let on = self.genes.iter().filter(|&&gene| gene != 0).count();
        write!(f, "Genome({on} of {} units on)", UNITS * UNITS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_alternately_three_and_two_cells_wide() {
        let columns = Genome::from_fn(|x, _| x % 2 == 0).pattern(Raster::PAPER);
        let row: Vec<u8> = columns.cells()[..10].to_vec();
        assert_eq!(row, [1, 1, 1, 0, 0, 1, 1, 1, 0, 0]);
        let single = Genome::from_fn(|x, y| (x, y) == (19, 0)).pattern(Raster::PAPER);
        assert!(single.is_active(49, 2) && single.is_active(48, 0) && single.active_cells() == 6);
    }

    #[test]
    fn random_genomes_have_the_wanted_number_of_units_on() {
        for (area, on) in [(0.5, 200), (0.05, 20), (0.0, 0), (1.0, 400)] {
            for grain in 0..4 {
                let genome = Genome::random(area, grain, &mut Stream::new(1, "test", 0));
                assert_eq!(genome.genes().iter().filter(|&&g| g != 0).count(), on);
            }
        }
    }

    #[test]
    fn genomes_round_trip_through_bytes() {
        let all = Genome::from_fn(|_, _| true);
        for groups in [1, 2, 3, 16] {
            let genome = Genome::random_within(&all, 0.37, groups, 1, &mut Stream::new(1, "test", 3));
            let bytes = genome.to_bytes(groups);
            assert_eq!(bytes.len(), Genome::bytes(groups));
            assert_eq!(Genome::from_bytes(&bytes, groups), Some(genome));
        }
        assert_eq!(Genome::from_bytes(&[255; 100], 2), None);
    }

    #[test]
    fn units_that_are_not_allowed_stay_off() {
        let left = Genome::from_fn(|x, _| x < 10);
        let on = |genome: &Genome| genome.genes().iter().filter(|&&g| g != 0).count();
        for (area, expected) in [(0.3, 120), (0.5, 200), (0.9, 200)] {
            let genome = Genome::random_within(&left, area, 1, 1, &mut Stream::new(1, "test", 0));
            assert_eq!((on(&genome), genome.clone().within(&left)), (expected, genome));
        }
        assert_eq!(on(&Genome::from_fn(|_, y| y < 10).within(&left)), 100);
        let several = Genome::random_within(&left, 0.3, 3, 1, &mut Stream::new(1, "test", 0));
        assert_eq!((on(&several), several.clone().within(&left)), (120, several.clone()));
        assert!((1..=3).all(|group| several.genes().contains(&group)));
    }

    #[test]
    fn grain_makes_regions_coarser() {
        let borders = |grain| {
            let pairs = (0..20).flat_map(|y| (0..19).map(move |x| (x, y)));
            let genome = Genome::random(0.5, grain, &mut Stream::new(1, "test", 0));
            pairs
                .filter(|&(x, y)| genome.group(x, y) != genome.group(x + 1, y))
                .count()
        };
        // Independent units differ from their neighbour half of the time: 190 of 380, with a standard deviation of 10.
        assert!((150..230).contains(&borders(0)));
        assert!(borders(1) < borders(0) && borders(4) < borders(1));
    }
}
