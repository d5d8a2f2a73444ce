//! Which constraints a pattern violates, and by how much.

use std::fmt;

use super::morphology::{closed, opened};
use super::raster::RasterConstraints;
use super::{Constraints, Sides};
use deaflow_pattern::{Bits, Layers};

/// The constraints that a pattern violates; `Display` lists them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Violations {
    /// Active cells that are not allowed: kept out, or out of reach of electrodes of the minimum width.
    pub kept_out: usize,
    /// Active cells of electrodes narrower than the minimum width.
    pub thin: usize,
    /// Bare cells of gaps narrower than the minimum width.
    pub narrow: usize,
    /// Pieces beyond the maximum number.
    pub surplus: usize,
    /// Pieces without a lead.
    pub unled: usize,
    /// Cells that are too close to electrodes of another group.
    pub near: usize,
    /// Bare cells that must be active.
    pub bare: usize,
    /// Cells of the smallest pieces beyond the maximum number, and of pieces without a lead.
    loose: usize,
    /// Cells of the membrane.
    all: usize,
    /// The limits, for `Display`.
    limits: ViolatedLimits,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct ViolatedLimits {
    pieces: usize,
    islands: usize,
    groups: usize,
    feature_mm: f64,
    gap_mm: f64,
    sides: Option<Sides>,
    has_pads: bool,
}

impl Violations {
    pub(super) fn of(constraints: &Constraints, layers: &Layers) -> Self {
        let limits = &constraints.limits;
        let mut found = Self {
            all: constraints.membrane().raster.cells(),
            near: constraints.cells_in_gaps(layers),
            limits: ViolatedLimits {
                pieces: 0,
                islands: limits.islands.unwrap_or_default(),
                groups: constraints.groups(),
                feature_mm: limits.min_feature_mm.unwrap_or_default(),
                gap_mm: limits
                    .gap_mm
                    .into_iter()
                    .chain(limits.min_feature_mm)
                    .fold(0.0, f64::max),
                sides: limits.leads,
                has_pads: !limits.pads.is_empty(),
            },
            ..Self::default()
        };
        for (group, bits) in layers.iter().enumerate() {
            found.add(constraints.of_group(group), bits);
        }
        found
    }

    /// Adds the violations of the electrodes of one group.
    fn add(&mut self, raster: &RasterConstraints, bits: &Bits) {
        let n = raster.feature;
        self.kept_out += bits.without(&raster.allowed).count();
        self.bare += raster.kept_in.as_ref().map_or(0, |kept| kept.without(bits).count());
        if n != [1; 2] {
            self.thin += bits.without(&opened(bits, n)).count();
            self.narrow += closed(bits, n).without(bits).count();
        }
        if raster.islands.is_some() || raster.leads.is_some() {
            let pieces = bits.components();
            let most = raster.islands.unwrap_or(pieces.len());
            self.surplus += pieces.len().saturating_sub(most);
            let loose = |(index, piece): &(usize, &Bits)| *index >= most || !raster.has_lead(piece);
            self.loose += pieces
                .iter()
                .enumerate()
                .filter(loose)
                .map(|(_, p)| p.count())
                .sum::<usize>();
            self.unled += pieces.iter().filter(|piece| !raster.has_lead(piece)).count();
            self.limits.pieces += pieces.len();
        }
    }

    /// Whether all constraints are satisfied.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.kept_out + self.thin + self.narrow + self.surplus + self.unled + self.near + self.bare == 0
    }

    /// The share of the membrane that violates constraints, 0 to 1. A cell counts once for each constraint that it
    /// violates.
    #[must_use]
    pub fn share(&self) -> f64 {
        ((self.kept_out + self.thin + self.narrow + self.loose + self.near + self.bare) as f64 / self.all.max(1) as f64)
            .min(1.0)
    }

    /// One line for each violated constraint, with the limit. The text is part of artifact digests.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let limits = &self.limits;
        let cells = |count| match count {
            1 => "1 cell".to_owned(),
            count => format!("{count} cells"),
        };
        let mut lines = Vec::new();
        if self.kept_out > 0 {
            lines.push(format!("{} active where none may be", cells(self.kept_out)));
        }
        if self.bare > 0 {
            lines.push(format!(
                "{} bare where `keep_in` asks for an electrode",
                cells(self.bare)
            ));
        }
        for (count, what) in [(self.thin, "electrode"), (self.narrow, "gap")] {
            if count > 0 {
                let width = limits.feature_mm;
                lines.push(format!("{} of {what} narrower than {width} mm", cells(count)));
            }
        }
        if self.surplus > 0 {
            let each = if limits.groups > 1 { " of each group" } else { "" };
            lines.push(format!(
                "{} islands, allowed: at most {}{each}",
                limits.pieces, limits.islands
            ));
        }
        if self.unled > 0 {
            let sides = limits.sides.unwrap_or(Sides::ALL).to_string();
            let lead = match limits.has_pads {
                true => "lead at one of its places".to_owned(),
                false => format!("lead on the frame, allowed: {sides}"),
            };
            lines.push(format!("{} of {} islands without a {lead}", self.unled, limits.pieces));
        }
        if self.near > 0 {
            let (near, gap) = (cells(self.near), limits.gap_mm);
            lines.push(format!("{near} nearer than {gap} mm to electrodes of another group"));
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
        let names: Vec<&str> = self.named().into_iter().filter(|(_, on)| *on).map(|(n, _)| n).collect();
        f.write_str(&names.join(", "))
    }
}
