//! In what, and how far, a pattern does not keep its constraints.

use std::fmt;

use super::morphology::{closed, components, opened};
use super::{Constraints, Sides};
use crate::pattern::Bits;

/// What of a pattern does not keep the constraints; `Display` says it in words.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Violations {
    /// Active cells that are not allowed: kept out, or where no electrode of the least width reaches.
    pub kept_out: usize,
    /// Active cells of electrodes narrower than the least width.
    pub thin: usize,
    /// Bare cells of gaps narrower than the least width.
    pub narrow: usize,
    /// Pieces beyond the largest number.
    pub surplus: usize,
    /// Pieces that touch the frame nowhere that they must.
    pub unled: usize,
    /// Cells of the smallest pieces that are beyond the largest number, and of those without a lead.
    loose: usize,
    /// Cells of the membrane.
    all: usize,
    /// What is asked, for the words.
    asked: Asked,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Asked {
    pieces: usize,
    islands: usize,
    feature_mm: f64,
    sides: Option<Sides>,
}

impl Violations {
    pub(super) fn of(constraints: &Constraints, bits: &Bits) -> Self {
        let (raster, limits) = (&constraints.raster, &constraints.limits);
        let n = raster.feature;
        let mut found = Self {
            kept_out: bits.without(&raster.allowed).count(),
            all: bits.raster().cells(),
            ..Self::default()
        };
        if n != [1; 2] {
            found.thin = bits.without(&opened(bits, n)).count();
            found.narrow = closed(bits, n).without(bits).count();
        }
        if raster.islands.is_some() || raster.leads.is_some() {
            let pieces = components(bits);
            let most = raster.islands.unwrap_or(pieces.len());
            found.surplus = pieces.len().saturating_sub(most);
            let loose = |(index, piece): &(usize, &Bits)| *index >= most || !raster.is_led(piece);
            found.loose = pieces.iter().enumerate().filter(loose).map(|(_, p)| p.count()).sum();
            found.unled = pieces.iter().filter(|piece| !raster.is_led(piece)).count();
            found.asked.pieces = pieces.len();
        }
        found.asked = Asked {
            islands: raster.islands.unwrap_or_default(),
            feature_mm: limits.min_feature_mm.unwrap_or_default(),
            sides: limits.leads,
            ..found.asked
        };
        found
    }

    /// Whether all constraints are kept.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        [self.kept_out, self.thin, self.narrow, self.surplus, self.unled] == [0; 5]
    }

    /// How far the constraints are from being kept: the share of the membrane that does not keep them, 0 to 1. A cell counts
    /// once for each constraint that it does not keep.
    #[must_use]
    pub fn share(&self) -> f64 {
        ((self.kept_out + self.thin + self.narrow + self.loose) as f64 / self.all.max(1) as f64).min(1.0)
    }

    /// One line for each constraint that is not kept: what was found, and what is allowed.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let asked = &self.asked;
        let cells = |count| match count {
            1 => "1 cell".to_owned(),
            count => format!("{count} cells"),
        };
        let mut lines = Vec::new();
        if self.kept_out > 0 {
            lines.push(format!("{} active where none may be", cells(self.kept_out)));
        }
        for (count, what) in [(self.thin, "electrode"), (self.narrow, "gap")] {
            if count > 0 {
                let width = asked.feature_mm;
                lines.push(format!("{} of {what} narrower than {width} mm", cells(count)));
            }
        }
        if self.surplus > 0 {
            lines.push(format!("{} islands, allowed: at most {}", asked.pieces, asked.islands));
        }
        if self.unled > 0 {
            let sides = asked.sides.unwrap_or(Sides::ALL).to_string();
            lines.push(format!(
                "{} of {} islands without a lead on the frame, allowed: {sides}",
                self.unled, asked.pieces
            ));
        }
        lines
    }
}

impl fmt::Display for Violations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.is_empty() {
            true => f.write_str("none"),
            false => f.write_str(&self.lines().join("; ")),
        }
    }
}

impl fmt::Display for Sides {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Self::ALL {
            return f.write_str("any side");
        }
        let wanted: Vec<&str> = self.named().into_iter().filter(|(_, on)| *on).map(|(n, _)| n).collect();
        f.write_str(&wanted.join(", "))
    }
}
