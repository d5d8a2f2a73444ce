//! What the genetic algorithm varies: the membrane in 20 × 20 units, each with or without electrode.
//!
//! The source paper searches on 20 × 20 units (Qin et al., doi 10.1089/soro.2024.0063, "GA-based inverse design") while
//! patterns have 50 × 50 cells: cell i lies in unit floor(i · 20 / 50), so units are 3 and 2 cells wide in turn. On other rasters it is the same with
//! their columns and rows; where these are fewer than 20, some units hold no cell.

use std::fmt;

use crate::base::Stream;
use crate::pattern::{Pattern, Raster};

/// Units along one side of the membrane.
pub const UNITS: usize = 20;

/// One truth value for each unit, row by row from below.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Genome {
    genes: Box<[bool]>,
}

impl Genome {
    /// The genome whose unit (x, y) is on where `on(x, y)`.
    #[must_use]
    pub fn from_fn(on: impl Fn(usize, usize) -> bool) -> Self {
        Self {
            genes: (0..UNITS * UNITS).map(|i| on(i % UNITS, i / UNITS)).collect(),
        }
    }

    /// A random genome with the nearest number of units to `area` · 400 on. White noise is averaged over 3 × 3 units
    /// `grain` times and the units with the highest values are on: at grain 0 each choice of units is equally likely, with
    /// rising grain the regions become coarser.
    #[must_use]
    pub fn random(area: f64, grain: usize, stream: &mut Stream) -> Self {
        Self::random_within(&Self::from_fn(|_, _| true), area, grain, stream)
    }

    /// The same among the units of another genome alone: all of these are on where they are fewer.
    pub(super) fn random_within(allowed: &Self, area: f64, grain: usize, stream: &mut Stream) -> Self {
        let mut noise: Vec<f64> = (0..UNITS * UNITS).map(|_| stream.uniform()).collect();
        for _ in 0..grain {
            noise = averaged(&noise);
        }
        let on = (area.clamp(0.0, 1.0) * noise.len() as f64).round() as usize;
        let mut ranked: Vec<usize> = (0..noise.len()).filter(|&unit| allowed.genes[unit]).collect();
        ranked.sort_by(|&a, &b| noise[b].total_cmp(&noise[a]).then(a.cmp(&b)));
        let mut genes = vec![false; noise.len()].into_boxed_slice();
        for &unit in ranked.iter().take(on) {
            genes[unit] = true;
        }
        Self { genes }
    }

    /// All genes, `[y][x]` with the origin at the lower left.
    #[must_use]
    pub fn genes(&self) -> &[bool] {
        &self.genes
    }

    pub(super) fn genes_mut(&mut self) -> &mut [bool] {
        &mut self.genes
    }

    /// Whether the unit at column `x`, row `y` is on.
    ///
    /// # Panics
    /// When `x` or `y` is not below 20.
    #[must_use]
    pub fn is_on(&self, x: usize, y: usize) -> bool {
        assert!(x < UNITS && y < UNITS, "unit ({x}, {y}) is outside the membrane");
        self.genes[y * UNITS + x]
    }

    /// Bytes of a genome in a file.
    pub(super) const BYTES: usize = UNITS * UNITS / 8;

    /// One bit for each gene.
    pub(super) fn to_bytes(&self) -> [u8; Self::BYTES] {
        std::array::from_fn(|byte| (0..8).fold(0, |bits, bit| bits | u8::from(self.genes[8 * byte + bit]) << bit))
    }

    /// The genome of such bytes.
    pub(super) fn from_bytes(bytes: &[u8; Self::BYTES]) -> Self {
        let gene = |at: usize| bytes[at / 8] >> (at % 8) & 1 == 1;
        Self {
            genes: (0..UNITS * UNITS).map(gene).collect(),
        }
    }

    /// The genome with those units off of which no cell is allowed.
    pub(super) fn within(mut self, allowed: &Self) -> Self {
        self.genes
            .iter_mut()
            .zip(&allowed.genes)
            .for_each(|(gene, &allowed)| *gene &= allowed);
        self
    }

    /// The pattern of cells.
    #[must_use]
    pub fn pattern(&self, raster: Raster) -> Pattern {
        Pattern::from_fn(raster, |x, y| {
            let [x, y] = unit_of(raster, [x, y]);
            self.genes[y * UNITS + x]
        })
    }
}

/// The unit of a cell (column, row).
pub(super) fn unit_of(raster: Raster, cell: [usize; 2]) -> [usize; 2] {
    let sides = raster.sides();
    [0, 1].map(|axis| cell[axis] * UNITS / sides[axis])
}

/// The units of the 3 × 3 around a unit that lie on the membrane, the unit itself included.
pub(super) fn around(x: usize, y: usize) -> impl Iterator<Item = (usize, usize)> {
    let near = |c: usize| c.saturating_sub(1)..(c + 2).min(UNITS);
    near(y).flat_map(move |j| near(x).map(move |i| (i, j)))
}

/// Each value replaced by the mean of those around it.
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
        let on = self.genes.iter().filter(|&&gene| gene).count();
        write!(f, "Genome({on} of {} units on)", UNITS * UNITS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_three_and_two_cells_wide_in_turn() {
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
                assert_eq!(genome.genes().iter().filter(|&&g| g).count(), on);
            }
        }
    }

    #[test]
    fn a_genome_survives_the_way_to_bytes_and_back() {
        let genome = Genome::random(0.37, 1, &mut Stream::new(1, "test", 3));
        assert_eq!(Genome::from_bytes(&genome.to_bytes()), genome);
    }

    #[test]
    fn units_that_are_not_allowed_stay_off() {
        let left = Genome::from_fn(|x, _| x < 10);
        let on = |genome: &Genome| genome.genes().iter().filter(|&&g| g).count();
        for (area, expected) in [(0.3, 120), (0.5, 200), (0.9, 200)] {
            let genome = Genome::random_within(&left, area, 1, &mut Stream::new(1, "test", 0));
            assert_eq!((on(&genome), genome.clone().within(&left)), (expected, genome));
        }
        assert_eq!(on(&Genome::from_fn(|_, y| y < 10).within(&left)), 100);
    }

    #[test]
    fn grain_makes_regions_coarser() {
        let borders = |grain| {
            let pairs = (0..20).flat_map(|y| (0..19).map(move |x| (x, y)));
            let genome = Genome::random(0.5, grain, &mut Stream::new(1, "test", 0));
            pairs
                .filter(|&(x, y)| genome.is_on(x, y) != genome.is_on(x + 1, y))
                .count()
        };
        // Independent units differ from their neighbour half of the time: 190 of 380, with a standard deviation of 10.
        assert!((150..230).contains(&borders(0)));
        assert!(borders(1) < borders(0) && borders(4) < borders(1));
    }
}
