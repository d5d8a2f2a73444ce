//! What a design must keep to so that it can be made, wired and run.
//!
//! Widths are those of squares: an electrode is at least f wide where squares of side f that lie within it cover it, and a gap
//! where squares within the gap do; all outside of the membrane is gap. So the pattern equals its opening and its closing by a
//! square of as many cells (Serra, Image Analysis and Mathematical Morphology, 1982).

mod blocks;
mod limits;
mod morphology;
mod parameters;
mod raster;
mod repair;
mod violations;

#[cfg(test)]
mod tests;

pub use limits::{ConstraintError, Limits, Sides};
pub use parameters::ConstraintParameters;
pub use violations::Violations;

use crate::pattern::{Bits, Membrane, Pattern};
use raster::RasterConstraints;

/// Valid constraints on the patterns of a membrane.
#[derive(Clone, Debug, PartialEq)]
pub struct Constraints {
    limits: Limits,
    membrane: Membrane,
    /// The cells that may carry electrodes, where there are frames or bodies.
    room: Option<Bits>,
    raster: RasterConstraints,
    /// The cells of the raster, row by row from below.
    allowed: Box<[bool]>,
}

impl Constraints {
    /// None.
    #[must_use]
    pub fn none(membrane: Membrane) -> Self {
        Self::on(
            membrane,
            None,
            Limits::default(),
            RasterConstraints::none(membrane.raster),
        )
    }

    /// The constraints of a membrane.
    ///
    /// # Errors
    /// When a number is out of range, or the constraints contradict each other.
    pub fn new(limits: Limits, membrane: Membrane) -> Result<Self, ConstraintError> {
        Self::within(limits, membrane, None)
    }

    /// The same where frames and bodies leave this room for electrodes.
    ///
    /// # Errors
    /// As [`Constraints::new`].
    pub fn within(limits: Limits, membrane: Membrane, room: Option<Bits>) -> Result<Self, ConstraintError> {
        let raster = limits.raster(membrane, room.as_ref())?;
        Ok(Self::on(membrane, room, limits, raster))
    }

    fn on(membrane: Membrane, room: Option<Bits>, limits: Limits, raster: RasterConstraints) -> Self {
        let columns = membrane.raster.columns();
        let allowed = (0..membrane.raster.cells()).map(|cell| raster.allowed.has(cell % columns, cell / columns));
        Self {
            allowed: allowed.collect(),
            limits,
            membrane,
            room,
            raster,
        }
    }

    /// The cells that may carry electrodes, where there are frames or bodies.
    #[must_use]
    pub fn room(&self) -> Option<&Bits> {
        self.room.as_ref()
    }

    /// What they are drawn on.
    #[must_use]
    pub fn membrane(&self) -> Membrane {
        self.membrane
    }

    /// What was asked for.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Whether nothing is asked of the pattern itself; margins may be.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.raster.is_none()
    }

    /// Columns and rows of the square that electrodes and gaps are at least as wide as; 1 × 1 where nothing is asked.
    #[must_use]
    pub fn feature_cells(&self) -> [usize; 2] {
        self.raster.feature
    }

    /// For each cell, row by row from below, whether any pattern that keeps the constraints may have it active: it is not kept
    /// out, and an electrode of the least width that can reach a lead covers it.
    #[must_use]
    pub fn allowed(&self) -> &[bool] {
        &self.allowed
    }

    /// The largest area fraction that a pattern within the constraints has at most.
    #[must_use]
    pub fn largest_area(&self) -> f64 {
        self.raster.most_cells() as f64 / self.all()
    }

    /// All cells of the membrane.
    fn all(&self) -> f64 {
        self.membrane.raster.cells() as f64
    }

    /// Whether some pattern may have an area fraction within a tolerance, as far as can be told without searching.
    ///
    /// # Errors
    /// When there is none: the area is more than the constraints leave, or less than the smallest electrode.
    pub fn check_area(&self, area: f64, tolerance: f64) -> Result<(), ConstraintError> {
        let largest = self.largest_area();
        if area > largest + tolerance {
            return Err(ConstraintError::TooMuchArea { area, largest });
        }
        let smallest = (self.raster.feature[0] * self.raster.feature[1]) as f64 / self.all();
        if area > tolerance && area + tolerance < smallest {
            return Err(ConstraintError::TooLittleArea { area, smallest });
        }
        Ok(())
    }

    /// The pattern without the cells that are not [allowed](Self::allowed).
    #[must_use]
    pub fn masked(&self, pattern: &Pattern) -> Pattern {
        Bits::of(pattern).and(&self.raster.allowed).pattern()
    }

    /// Whether a pattern keeps all that can be told from the pattern alone: all but the margins.
    #[must_use]
    pub fn hold(&self, pattern: &Pattern) -> bool {
        self.hold_bits(&Bits::of(pattern))
    }

    /// The same of a pattern as bits.
    #[must_use]
    pub fn hold_bits(&self, bits: &Bits) -> bool {
        self.raster.holds(bits)
    }

    /// What of a pattern does not keep the constraints, margins aside.
    #[must_use]
    pub fn violations(&self, pattern: &Pattern) -> Violations {
        Violations::of(self, &Bits::of(pattern))
    }

    /// A pattern nearby that keeps the constraints, margins aside: the pattern itself where it does. What is too narrow is
    /// opened or closed; a piece without a lead, or one too many, is joined by the shortest strip of the least width, or dropped
    /// where the strip would be larger than the piece. The area may change. None where nothing of the pattern is left.
    #[must_use]
    pub fn repaired(&self, pattern: &Pattern) -> Option<Pattern> {
        Some(self.repaired_bits(&Bits::of(pattern))?.pattern())
    }

    /// The same of a pattern as bits.
    #[must_use]
    pub fn repaired_bits(&self, bits: &Bits) -> Option<Bits> {
        repair::repaired(&self.raster, bits)
    }
}
