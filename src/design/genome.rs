//! The genome of the genetic algorithm: the membrane in 20 × 20 units, each bare or with an electrode of one group.
//!
//! The source paper searches on 20 × 20 units (Qin et al., doi 10.1089/soro.2024.0063, "GA-based inverse design")
//! while patterns have 50 × 50 cells: cell i lies in unit floor(i · 20 / 50), so units are alternately 3 and 2 cells
//! wide. Other rasters are divided in the same way; with fewer than 20 columns or rows, several units share a cell.

use std::fmt;

use deaflow_base::Stream;
use deaflow_pattern::{Bits, Pattern, Raster};

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
        Self::random_within(&Units::all(), area, 1, grain, stream)
    }

    /// A random genome: round(`area` · 400) of the allowed units are on, or all of them if they are fewer.
    ///
    /// White noise is averaged over 3 × 3 units `grain` times, and the units with the highest values are on. At grain
    /// 0 each choice of units is equally likely; a higher grain gives coarser regions. The units are divided into
    /// groups by a second noise of the same grain; the share of each group is random.
    pub(super) fn random_within(units: &Units, area: f64, groups: usize, grain: usize, stream: &mut Stream) -> Self {
        let mut noise = || {
            let white: Vec<f64> = (0..UNITS * UNITS).map(|_| stream.uniform()).collect();
            let noise = (0..grain).fold(white, |noise, _| averaged(&noise));
            units.shared(noise)
        };
        let rank = |units: &mut Vec<usize>, noise: &[f64]| {
            units.sort_by(|&a, &b| noise[b].total_cmp(&noise[a]).then(a.cmp(&b)));
        };
        let values = noise();
        let on = (area.clamp(0.0, 1.0) * values.len() as f64).round() as usize;
        let mut ranked: Vec<usize> = (0..values.len())
            .filter(|&unit| units.allowed.genes[unit] != 0)
            .collect();
        rank(&mut ranked, &values);
        ranked.truncate(on);
        let mut genes = vec![0; values.len()].into_boxed_slice();
        if groups == 1 {
            ranked.into_iter().for_each(|unit| genes[unit] = 1);
            return units.unified(Self { genes });
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
        units.unified(Self { genes })
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

/// The units of a membrane.
pub(super) struct Units {
    /// Those that may be on.
    allowed: Genome,
    /// The unit that contains the cell of each unit, on a raster with fewer than 20 columns or rows: units that share a
    /// cell have the gene of that one.
    owners: Option<Box<[usize]>>,
}

impl Units {
    /// The units of a raster with 20 or more columns and rows, which all may be on.
    pub fn all() -> Self {
        Self {
            allowed: Genome::from_fn(|_, _| true),
            owners: None,
        }
    }

    /// The units of which some cells may carry electrodes.
    pub fn of(allowed: &Bits) -> Self {
        let raster = allowed.raster();
        let [columns, rows] = raster.sides();
        let mut units = [false; UNITS * UNITS];
        let cells = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
        for (x, y) in cells.filter(|&(x, y)| allowed.has(x, y)) {
            let [x, y] = unit_of(raster, [x, y]);
            units[y * UNITS + x] = true;
        }
        let owner = |unit: usize| {
            // Of the last cell that begins in the unit or before it.
            let along = |cells: usize, at: usize| unit_along(cells, ((at + 1) * cells - 1) / UNITS);
            along(rows, unit / UNITS) * UNITS + along(columns, unit % UNITS)
        };
        let is_shared = columns.min(rows) < UNITS;
        let owners: Option<Box<[usize]>> = is_shared.then(|| (0..UNITS * UNITS).map(owner).collect());
        let allowed = |unit: usize| units[owners.as_ref().map_or(unit, |owners| owners[unit])];
        Self {
            allowed: Genome::from_fn(|x, y| allowed(y * UNITS + x)),
            owners,
        }
    }

    /// The values of units, those that share a cell with the value of the one that contains it.
    pub fn shared<T: Copy>(&self, values: Vec<T>) -> Vec<T> {
        match &self.owners {
            Some(owners) => owners.iter().map(|owner| values[*owner]).collect(),
            None => values,
        }
    }

    /// The genome with equal genes where units share a cell.
    pub fn unified(&self, genome: Genome) -> Genome {
        Genome {
            genes: self.shared(genome.genes.into_vec()).into_boxed_slice(),
        }
    }

    /// The same with all units bare that are not allowed.
    pub fn restricted(&self, genome: Genome) -> Genome {
        let mut genome = self.unified(genome);
        let units = genome.genes.iter_mut().zip(&self.allowed.genes);
        units
            .filter(|(_, allowed)| **allowed == 0)
            .for_each(|(gene, _)| *gene = 0);
        genome
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
        for groups in [1, 2, 3, 16] {
            let genome = Genome::random_within(&Units::all(), 0.37, groups, 1, &mut Stream::new(1, "test", 3));
            let bytes = genome.to_bytes(groups);
            assert_eq!(bytes.len(), Genome::bytes(groups));
            assert_eq!(Genome::from_bytes(&bytes, groups), Some(genome));
        }
        assert_eq!(Genome::from_bytes(&[255; 100], 2), None);
    }

    #[test]
    fn units_that_are_not_allowed_stay_off() {
        let left = Units {
            allowed: Genome::from_fn(|x, _| x < 10),
            owners: None,
        };
        let on = |genome: &Genome| genome.genes().iter().filter(|&&g| g != 0).count();
        for (area, expected) in [(0.3, 120), (0.5, 200), (0.9, 200)] {
            let genome = Genome::random_within(&left, area, 1, 1, &mut Stream::new(1, "test", 0));
            assert_eq!((on(&genome), left.restricted(genome.clone())), (expected, genome));
        }
        assert_eq!(on(&left.restricted(Genome::from_fn(|_, y| y < 10))), 100);
        let several = Genome::random_within(&left, 0.3, 3, 1, &mut Stream::new(1, "test", 0));
        assert_eq!((on(&several), left.restricted(several.clone())), (120, several.clone()));
        assert!((1..=3).all(|group| several.genes().contains(&group)));
    }

    #[test]
    fn units_that_share_a_cell_are_equal() {
        for sides in [[10, 10], [12, 15], [1, 7]] {
            let raster = Raster::new(sides[0], sides[1]).unwrap();
            let right = Bits::from_fn(raster, |x, _| x >= sides[0] / 2);
            let units = Units::of(&right);
            // The last cell that begins in a unit or before it.
            let cell_of = |unit: usize, cells: usize| (0..cells).rfind(|cell| cell * UNITS / cells <= unit).unwrap();
            for seed in 0..5 {
                let random = Genome::random_within(&units, 0.25, 1, 1, &mut Stream::new(seed, "test", 0));
                let smoothed = units.restricted(crate::operators::smooth(&random, 1));
                for genome in [&random, &smoothed] {
                    let pattern = genome.pattern(raster);
                    for (y, x) in (0..UNITS).flat_map(|y| (0..UNITS).map(move |x| (y, x))) {
                        let [cx, cy] = [cell_of(x, sides[0]), cell_of(y, sides[1])];
                        assert_eq!(pattern.is_active(cx, cy), genome.group(x, y) != 0);
                        assert!(!pattern.is_active(cx, cy) || right.has(cx, cy));
                    }
                }
                if sides == [10, 10] {
                    // A quarter of the cells is on, and the filter does not remove what is not a speck.
                    assert_eq!(random.pattern(raster).active_cells(), 25);
                    assert!(smoothed.pattern(raster).active_cells() > 15);
                }
            }
        }
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
