//! Constraints on the electrodes of one group, in cells.

use super::morphology::{Square, closed, components, opened};
use deaflow_pattern::{Bits, Raster};

/// Constraints on the electrodes of one group, in cells.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RasterConstraints {
    /// Cells that may be active; squares of the minimum width inside them cover them.
    pub allowed: Bits,
    /// Columns and rows of the square of the minimum width.
    pub feature: Square,
    /// The maximum number of pieces.
    pub islands: Option<usize>,
    /// Allowed cells at the frame; each piece must contain one of them.
    pub leads: Option<Bits>,
}

impl RasterConstraints {
    /// No constraints.
    pub fn none(raster: Raster) -> Self {
        Self {
            allowed: Bits::full(raster),
            feature: [1; 2],
            islands: None,
            leads: None,
        }
    }

    /// These constraints without the cells that are taken; `None` if no allowed cell is left.
    pub fn without(&self, taken: &Bits) -> Option<Self> {
        let mut allowed = opened(&self.allowed.without(taken), self.feature);
        let leads = self.leads.as_ref().map(|leads| leads.and(&allowed));
        if let Some(leads) = &leads {
            allowed = allowed.flooded(leads);
        }
        (!allowed.is_empty()).then_some(Self {
            allowed,
            leads,
            ..self.clone()
        })
    }

    /// Whether any pattern is valid.
    pub fn allow_any(&self) -> bool {
        *self == Self::none(self.allowed.raster())
    }

    /// Whether a pattern is valid.
    pub fn satisfied_by(&self, bits: &Bits) -> bool {
        if !bits.without(&self.allowed).is_empty() || !self.has_min_widths(bits) {
            return false;
        }
        if self.islands.is_none() && self.leads.is_none() {
            return true;
        }
        let pieces = components(bits);
        self.islands.is_none_or(|most| pieces.len() <= most) && pieces.iter().all(|piece| self.has_lead(piece))
    }

    /// Whether no electrode and no gap is narrower than the minimum width.
    pub fn has_min_widths(&self, bits: &Bits) -> bool {
        let n = self.feature;
        n == [1; 2] || (opened(bits, n) == *bits && closed(bits, n) == *bits)
    }

    /// Whether a piece touches the frame on a side with leads; true if no leads are required.
    pub fn has_lead(&self, piece: &Bits) -> bool {
        self.leads.as_ref().is_none_or(|leads| piece.meets(leads))
    }

    /// An upper bound of the number of cells of a valid pattern.
    pub fn most_cells(&self) -> usize {
        let pieces = components(&self.allowed);
        let most = self.islands.unwrap_or(usize::MAX);
        pieces.iter().take(most).map(Bits::count).sum()
    }
}
