//! Repair on blocks that are at least as wide as the least width.
//!
//! Whichever of such blocks are active, squares of the least width cover the electrode and the gaps, and blocks are connected as
//! their cells are. So pieces can be joined and dropped as on cells, and the result always keeps the constraints.

use super::raster::RasterConstraints;
use super::repair::connected;
use crate::pattern::{Bits, CELLS};

/// The nearest repaired pattern over all offsets of the blocks along the diagonal.
pub(super) fn repaired(raster: &RasterConstraints, bits: &Bits) -> Option<Bits> {
    let attempts = (0..raster.feature).map(|offset| Blocks::new(raster, offset).repaired(raster, bits));
    let sound = attempts.filter(|found| !found.is_empty() && raster.holds(found));
    sound.min_by_key(|found| found.differing(bits))
}

/// The membrane in blocks.
struct Blocks {
    /// The block of each row or column of cells.
    of: [usize; CELLS],
    count: usize,
    /// The blocks that lie wholly within the room.
    allowed: Bits,
    /// Those that hold a lead.
    leads: Option<Bits>,
}

impl Blocks {
    /// Blocks of the least width, the first and the last one wider by what remains.
    fn new(raster: &RasterConstraints, offset: usize) -> Self {
        let n = raster.feature;
        let count = ((CELLS - offset) / n).max(1);
        let of = std::array::from_fn(|cell: usize| (cell.saturating_sub(offset) / n).min(count - 1));
        let mut blocks = Self {
            of,
            count,
            allowed: Bits::EMPTY,
            leads: None,
        };
        let all = blocks.tally(&Bits::FULL);
        let room = blocks.tally(&raster.allowed);
        blocks.allowed = blocks.those(|block| room[block] == all[block]);
        blocks.leads = raster.leads.map(|leads| {
            let leads = blocks.tally(&leads);
            blocks.those(|block| leads[block] > 0).and(&blocks.allowed)
        });
        blocks
    }

    /// The blocks of the room that are active by most of their cells, connected, as cells.
    fn repaired(&self, raster: &RasterConstraints, bits: &Bits) -> Bits {
        let (active, all) = (self.tally(bits), self.tally(&Bits::FULL));
        let mostly = self.those(|block| 2 * active[block] > all[block]);
        let on_blocks = RasterConstraints {
            allowed: self.allowed,
            feature: 1,
            islands: raster.islands,
            leads: self.leads,
        };
        let found = connected(&on_blocks, &mostly.and(&self.allowed));
        Bits::from_fn(|x, y| found.has(self.of[x], self.of[y]))
    }

    /// The number of active cells in each block, rows of blocks as far apart as rows of cells.
    fn tally(&self, bits: &Bits) -> [u16; CELLS * CELLS] {
        let mut tally = [0; CELLS * CELLS];
        for (y, &block) in self.of.iter().enumerate() {
            for (x, &column) in self.of.iter().enumerate() {
                tally[block * CELLS + column] += u16::from(bits.has(x, y));
            }
        }
        tally
    }

    /// The blocks of which `is` says so by their place in a tally.
    fn those(&self, is: impl Fn(usize) -> bool) -> Bits {
        let within = |x, y| x < self.count && y < self.count;
        Bits::from_fn(|x, y| within(x, y) && is(y * CELLS + x))
    }
}
