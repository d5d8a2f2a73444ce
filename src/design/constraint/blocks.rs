//! Repair on blocks that are at least as wide as the minimum width.
//!
//! For any choice of active blocks, squares of the minimum width cover the electrodes and the gaps, and blocks are
//! connected as their cells are. So pieces can be joined and removed as on cells, and the result always satisfies the
//! constraints.

use super::connect::connected;
use super::raster::RasterConstraints;
use deaflow_pattern::{Bits, Raster};

/// The nearest repaired pattern over all offsets of the blocks along the diagonal.
pub(super) fn repaired(raster: &RasterConstraints, bits: &Bits) -> Option<Bits> {
    let attempts =
        (0..raster.feature[0].max(raster.feature[1])).map(|offset| Blocks::new(raster, offset).repaired(raster, bits));
    let valid = attempts.filter(|found| !found.is_empty() && raster.satisfied_by(found));
    valid.min_by_key(|found| found.differing(bits))
}

/// The membrane divided into blocks. Block (i, j) is represented by cell (i, j) of the raster.
struct Blocks {
    raster: Raster,
    /// The block of each column and of each row of cells.
    of: [Vec<usize>; 2],
    /// The number of blocks along x and y.
    counts: [usize; 2],
    /// The blocks of which all cells are allowed.
    allowed: Bits,
    /// The allowed blocks that contain a lead.
    leads: Option<Bits>,
    /// The blocks with cells that are always active.
    kept_in: Option<Bits>,
}

impl Blocks {
    /// Blocks of the minimum width; the first and the last one are wider by the remainder.
    fn new(raster: &RasterConstraints, offset: usize) -> Self {
        let (square, sides) = (raster.feature, raster.allowed.sides());
        let offsets = square.map(|n| offset.min(n - 1));
        let counts = [0, 1].map(|k| (sides[k].saturating_sub(offsets[k]) / square[k]).max(1));
        let of = |k: usize| {
            let block = |cell: usize| cell.saturating_sub(offsets[k]) / square[k];
            (0..sides[k]).map(|cell| block(cell).min(counts[k] - 1)).collect()
        };
        let mut blocks = Self {
            raster: raster.allowed.raster(),
            of: [of(0), of(1)],
            counts,
            allowed: raster.allowed.clone(),
            leads: None,
            kept_in: None,
        };
        let all = blocks.tally(&Bits::full(blocks.raster));
        let allowed = blocks.tally(&raster.allowed);
        blocks.allowed = blocks.select(|block| allowed[block] == all[block]);
        blocks.leads = raster.leads.as_ref().map(|leads| {
            let leads = blocks.tally(leads);
            blocks.select(|block| leads[block] > 0).and(&blocks.allowed)
        });
        blocks.kept_in = raster.kept_in.as_ref().map(|kept| {
            let kept = blocks.tally(kept);
            blocks.select(|block| kept[block] > 0).and(&blocks.allowed)
        });
        blocks
    }

    /// The allowed blocks with a majority of active cells, connected, as cells.
    fn repaired(&self, raster: &RasterConstraints, bits: &Bits) -> Bits {
        let (active, all) = (self.tally(bits), self.tally(&Bits::full(self.raster)));
        let mostly = self.select(|block| 2 * active[block] > all[block]);
        let on_blocks = RasterConstraints {
            allowed: self.allowed.clone(),
            feature: [1; 2],
            islands: raster.islands,
            leads: self.leads.clone(),
            kept_in: self.kept_in.clone(),
        };
        let start = on_blocks.with_kept_in(&mostly.and(&self.allowed));
        let found = connected(&on_blocks, &start);
        let [columns, rows] = &self.of;
        Bits::from_fn(self.raster, |x, y| found.has(columns[x], rows[y]))
    }

    /// The number of active cells in each block, indexed as the cells of the raster.
    fn tally(&self, bits: &Bits) -> Vec<u32> {
        let mut tally = vec![0; self.raster.cells()];
        let [columns, rows] = &self.of;
        for (y, &row) in rows.iter().enumerate() {
            for (x, &column) in columns.iter().enumerate() {
                tally[row * self.raster.columns() + column] += u32::from(bits.has(x, y));
            }
        }
        tally
    }

    /// The blocks for whose index in a tally `is` is true.
    fn select(&self, is: impl Fn(usize) -> bool) -> Bits {
        let exists = |x, y| x < self.counts[0] && y < self.counts[1];
        Bits::from_fn(self.raster, |x, y| exists(x, y) && is(y * self.raster.columns() + x))
    }
}
