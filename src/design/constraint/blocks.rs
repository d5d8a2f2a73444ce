//! Repair on blocks that are at least as wide as the least width.
//!
//! Whichever of such blocks are active, squares of the least width cover the electrode and the gaps, and blocks are connected as
//! their cells are. So pieces can be joined and dropped as on cells, and the result always keeps the constraints.

use super::raster::RasterConstraints;
use super::repair::connected;
use deaflow_pattern::{Bits, Raster};

/// The nearest repaired pattern over all offsets of the blocks along the diagonal.
pub(super) fn repaired(raster: &RasterConstraints, bits: &Bits) -> Option<Bits> {
    let attempts =
        (0..raster.feature[0].max(raster.feature[1])).map(|offset| Blocks::new(raster, offset).repaired(raster, bits));
    let sound = attempts.filter(|found| !found.is_empty() && raster.holds(found));
    sound.min_by_key(|found| found.differing(bits))
}

/// The membrane in blocks.
struct Blocks {
    raster: Raster,
    /// The block of each column and of each row of cells.
    of: [Vec<usize>; 2],
    /// How many there are along x and y.
    counts: [usize; 2],
    /// The blocks that lie wholly within the room, at the places of as many cells.
    allowed: Bits,
    /// Those that hold a lead.
    leads: Option<Bits>,
}

impl Blocks {
    /// Blocks of the least width, the first and the last one wider by what remains.
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
        };
        let all = blocks.tally(&Bits::full(blocks.raster));
        let room = blocks.tally(&raster.allowed);
        blocks.allowed = blocks.those(|block| room[block] == all[block]);
        blocks.leads = raster.leads.as_ref().map(|leads| {
            let leads = blocks.tally(leads);
            blocks.those(|block| leads[block] > 0).and(&blocks.allowed)
        });
        blocks
    }

    /// The blocks of the room that are active by most of their cells, connected, as cells.
    fn repaired(&self, raster: &RasterConstraints, bits: &Bits) -> Bits {
        let (active, all) = (self.tally(bits), self.tally(&Bits::full(self.raster)));
        let mostly = self.those(|block| 2 * active[block] > all[block]);
        let on_blocks = RasterConstraints {
            allowed: self.allowed.clone(),
            feature: [1; 2],
            islands: raster.islands,
            leads: self.leads.clone(),
        };
        let found = connected(&on_blocks, &mostly.and(&self.allowed));
        let [columns, rows] = &self.of;
        Bits::from_fn(self.raster, |x, y| found.has(columns[x], rows[y]))
    }

    /// The number of active cells in each block, rows of blocks as far apart as rows of cells.
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

    /// The blocks of which `is` says so by their place in a tally.
    fn those(&self, is: impl Fn(usize) -> bool) -> Bits {
        let within = |x, y| x < self.counts[0] && y < self.counts[1];
        Bits::from_fn(self.raster, |x, y| within(x, y) && is(y * self.raster.columns() + x))
    }
}
