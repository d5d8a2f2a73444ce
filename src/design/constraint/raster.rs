//! Constraints on the electrodes of one group, in cells.

use super::morphology::{Square, closed, opened};
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
    /// Allowed cells with leads; each piece must contain one of them.
    pub leads: Option<Bits>,
    /// Cells that are always active, with no part narrower than the minimum width.
    pub kept_in: Option<Bits>,
}

impl RasterConstraints {
    /// No constraints.
    pub fn none(raster: Raster) -> Self {
        Self {
            allowed: Bits::full(raster),
            feature: [1; 2],
            islands: None,
            leads: None,
            kept_in: None,
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
        let lacks = self.kept_in.as_ref().is_some_and(|kept| !kept.without(bits).is_empty());
        if lacks || !bits.without(&self.allowed).is_empty() || !self.has_min_widths(bits) {
            return false;
        }
        if self.islands.is_none() && self.leads.is_none() {
            return true;
        }
        let pieces = bits.components();
        self.islands.is_none_or(|most| pieces.len() <= most) && pieces.iter().all(|piece| self.has_lead(piece))
    }

    /// Whether no electrode and no gap is narrower than the minimum width.
    pub fn has_min_widths(&self, bits: &Bits) -> bool {
        let n = self.feature;
        n == [1; 2] || (opened(bits, n) == *bits && closed(bits, n) == *bits)
    }

    /// The pattern with the cells that are always active.
    pub fn with_kept_in(&self, bits: &Bits) -> Bits {
        self.kept_in.as_ref().map_or_else(|| bits.clone(), |kept| bits.or(kept))
    }

    /// Whether a piece has cells that are always active.
    pub fn is_kept(&self, piece: &Bits) -> bool {
        self.kept_in.as_ref().is_some_and(|kept| piece.meets(kept))
    }

    /// Whether a piece touches a lead; true if no leads are required.
    pub fn has_lead(&self, piece: &Bits) -> bool {
        self.leads.as_ref().is_none_or(|leads| piece.meets(leads))
    }

    /// An upper bound of the number of cells of a valid pattern.
    pub fn most_cells(&self) -> usize {
        let pieces = self.allowed.components();
        let most = self.islands.unwrap_or(usize::MAX);
        pieces.iter().take(most).map(Bits::count).sum()
    }
}
