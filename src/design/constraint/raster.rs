//! The constraints in terms of the cells of the raster.

use super::morphology::{Square, closed, components, opened};
use deaflow_pattern::{Bits, Raster};

/// Where electrodes may lie, and how.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RasterConstraints {
    /// Cells that may be active: squares of the least width within it cover it.
    pub allowed: Bits,
    /// Columns and rows of the square of the least width.
    pub feature: Square,
    /// The largest number of pieces.
    pub islands: Option<usize>,
    /// Cells of the room at the frame, one of which every piece must hold.
    pub leads: Option<Bits>,
}

impl RasterConstraints {
    /// Everything is allowed.
    pub fn none(raster: Raster) -> Self {
        Self {
            allowed: Bits::full(raster),
            feature: [1; 2],
            islands: None,
            leads: None,
        }
    }

    /// The same where some cells are taken; `None` where no room is left.
    pub fn without(&self, taken: &Bits) -> Option<Self> {
        let mut room = opened(&self.allowed.without(taken), self.feature);
        let leads = self.leads.as_ref().map(|leads| leads.and(&room));
        if let Some(leads) = &leads {
            room = room.flooded(leads);
        }
        (!room.is_empty()).then_some(Self {
            allowed: room,
            leads,
            ..self.clone()
        })
    }

    /// Whether nothing is asked.
    pub fn is_none(&self) -> bool {
        self.allowed.inverse().is_empty() && (self.feature, self.islands, &self.leads) == ([1; 2], None, &None)
    }

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
        n == [1; 2] || (opened(bits, n) == *bits && closed(bits, n) == *bits)
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
