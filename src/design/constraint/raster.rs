//! The constraints in terms of the cells of the raster.

use super::morphology::{closed, components, opened};
use crate::pattern::Bits;

/// Where electrodes may lie, and how.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RasterConstraints {
    /// Cells that may be active: squares of the least width within it cover it.
    pub allowed: Bits,
    /// Side in cells of the square of the least width.
    pub feature: usize,
    /// The largest number of pieces.
    pub islands: Option<usize>,
    /// Cells of the room at the frame, one of which every piece must hold.
    pub leads: Option<Bits>,
}

impl Default for RasterConstraints {
    /// Everything is allowed.
    fn default() -> Self {
        Self {
            allowed: Bits::FULL,
            feature: 1,
            islands: None,
            leads: None,
        }
    }
}

impl RasterConstraints {
    /// Whether a pattern keeps to it.
    pub fn holds(&self, bits: &Bits) -> bool {
        if !bits.without(&self.allowed).is_empty() || !self.is_regular(bits) {
            return false;
        }
        if self.islands.is_none() && self.leads.is_none() {
            return true;
        }
        let pieces = components(bits);
        self.islands.is_none_or(|most| pieces.len() <= most) && pieces.iter().all(|piece| self.is_led(piece))
    }

    /// Whether no electrode and no gap is narrower than the least width.
    pub fn is_regular(&self, bits: &Bits) -> bool {
        let n = self.feature;
        n == 1 || (opened(bits, n) == *bits && closed(bits, n) == *bits)
    }

    /// Whether a piece touches the frame where it must.
    pub fn is_led(&self, piece: &Bits) -> bool {
        self.leads.as_ref().is_none_or(|leads| piece.meets(leads))
    }

    /// How many cells a pattern within it has at most.
    pub fn most_cells(&self) -> usize {
        let pieces = components(&self.allowed);
        let most = self.islands.unwrap_or(usize::MAX);
        pieces.iter().take(most).map(Bits::count).sum()
    }
}
