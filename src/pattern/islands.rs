//! The connected electrodes of a pattern.

use super::bits::Bits;
use super::raster::Pattern;

impl Pattern {
    /// Returns the islands of cells that share sides, the one with the most cells first. Groups that touch are one
    /// island.
    #[must_use]
    pub fn islands(&self) -> Vec<Bits> {
        Bits::of(self).components()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;

    #[test]
    fn cells_that_touch_at_a_corner_are_two_islands() {
        let pattern = Pattern::from_fn(Raster::new(4, 4).unwrap(), |x, y| {
            [[0, 0], [1, 1], [2, 1]].contains(&[x, y])
        });
        let sizes: Vec<usize> = pattern.islands().iter().map(Bits::count).collect();
        assert_eq!(sizes, [2, 1]);
        assert!(Pattern::from_fn(Raster::PAPER, |_, _| false).islands().is_empty());
    }
}
