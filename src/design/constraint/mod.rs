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

use deaflow_pattern::{Bits, Layers, Membrane, Pattern, PatternEquivalence};
use deaflow_scene::Scene;
use morphology::surrounded;
use raster::RasterConstraints;

/// Valid constraints on the patterns of a membrane.
#[derive(Clone, Debug, PartialEq)]
pub struct Constraints {
    limits: Limits,
    membrane: Membrane,
    /// The cells that may carry electrodes, where there are frames or bodies.
    room: Option<Bits>,
    /// What the electrodes of each group keep to.
    raster: RasterConstraints,
    groups: usize,
    equivalence: PatternEquivalence,
    /// The least number of columns, or else of rows, between electrodes of different groups.
    gap: [usize; 2],
    /// The cells of the raster, row by row from below.
    allowed: Box<[bool]>,
}

/// What constraints are on: a membrane, what frames and bodies leave of it, and how many groups of electrodes there are.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Its sides and cells.
    pub membrane: Membrane,
    /// The cells that may carry electrodes, where there are frames or bodies.
    pub room: Option<Bits>,
    /// How many groups there are.
    pub groups: usize,
    /// Which patterns move it alike.
    pub equivalence: PatternEquivalence,
}

impl From<Membrane> for Ground {
    /// With room for one group everywhere.
    fn from(membrane: Membrane) -> Self {
        Self {
            membrane,
            room: None,
            groups: 1,
            equivalence: PatternEquivalence::new(membrane.symmetries(), vec![1]),
        }
    }
}

impl From<&Scene> for Ground {
    fn from(scene: &Scene) -> Self {
        Self {
            membrane: scene.membrane(),
            room: scene.free_cells(),
            groups: scene.groups(),
            equivalence: PatternEquivalence::new(scene.symmetries(), scene.alike_groups()),
        }
    }
}

impl Constraints {
    /// None.
    #[must_use]
    pub fn none(membrane: Membrane) -> Self {
        let raster = RasterConstraints::none(membrane.raster);
        Self::of(membrane.into(), Limits::default(), raster, [0; 2])
    }

    /// The constraints of a membrane.
    ///
    /// # Errors
    /// When a number is out of range, or the constraints contradict each other.
    pub fn new(limits: Limits, on: impl Into<Ground>) -> Result<Self, ConstraintError> {
        let on = on.into();
        let raster = limits.raster(on.membrane, on.room.as_ref())?;
        let gap = limits.gap(on.membrane, on.groups)?;
        Ok(Self::of(on, limits, raster, gap))
    }

    fn of(on: Ground, limits: Limits, raster: RasterConstraints, gap: [usize; 2]) -> Self {
        let Ground {
            membrane,
            room,
            groups,
            equivalence,
        } = on;
        let columns = membrane.raster.columns();
        let allowed = (0..membrane.raster.cells()).map(|cell| raster.allowed.has(cell % columns, cell / columns));
        Self {
            allowed: allowed.collect(),
            limits,
            membrane,
            room,
            raster,
            groups,
            equivalence,
            gap,
        }
    }

    /// Which patterns move the device alike.
    #[must_use]
    pub fn equivalence(&self) -> &PatternEquivalence {
        &self.equivalence
    }

    /// How many groups of electrodes there are.
    #[must_use]
    pub fn groups(&self) -> usize {
        self.groups
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
        self.raster.is_none() && self.gap == [0; 2]
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
        pattern.within(&self.raster.allowed)
    }

    /// A pattern as the electrodes of as many groups as there are.
    #[must_use]
    pub fn layers(&self, pattern: &Pattern) -> Layers {
        Layers::of(pattern, self.groups)
    }

    /// Whether a pattern keeps all that can be told from the pattern alone: all but the margins.
    #[must_use]
    pub fn hold(&self, pattern: &Pattern) -> bool {
        self.hold_layers(&self.layers(pattern))
    }

    /// The same of the electrodes of each group.
    #[must_use]
    pub fn hold_layers(&self, layers: &Layers) -> bool {
        layers.iter().all(|bits| self.raster.holds(bits)) && self.too_near(layers) == 0
    }

    /// How many cells are too near to electrodes of another group; each counts once.
    fn too_near(&self, layers: &Layers) -> usize {
        if self.gap == [0; 2] {
            return 0;
        }
        let near = |(group, bits): (usize, &Bits)| {
            let others = layers.iter().enumerate().filter(|(other, _)| *other != group);
            let around = others
                .map(|(_, other)| surrounded(other, self.gap))
                .reduce(|a, b| a.or(&b));
            around.map_or(0, |around| bits.and(&around).count())
        };
        layers.iter().enumerate().map(near).sum()
    }

    /// What of a pattern does not keep the constraints, margins aside.
    #[must_use]
    pub fn violations(&self, pattern: &Pattern) -> Violations {
        Violations::of(self, &self.layers(pattern))
    }

    /// A pattern nearby that keeps the constraints, margins aside: the pattern itself where it does. What is too narrow is
    /// opened or closed; a piece without a lead, or one too many, is joined by the shortest strip of the least width, or dropped
    /// where the strip would be larger than the piece. Groups with fewer cells give way to those with more. The area may change. None where
    /// nothing of the pattern is left.
    #[must_use]
    pub fn repaired(&self, pattern: &Pattern) -> Option<Pattern> {
        Some(self.repaired_layers(&self.layers(pattern))?.pattern())
    }

    /// The same of the electrodes of each group.
    #[must_use]
    pub fn repaired_layers(&self, layers: &Layers) -> Option<Layers> {
        let mut order: Vec<(usize, &Bits)> = layers.iter().enumerate().collect();
        order.sort_by_key(|(_, bits)| std::cmp::Reverse(bits.count()));
        let mut repaired = vec![Bits::empty(self.membrane.raster); order.len()];
        let mut taken = Bits::empty(self.membrane.raster);
        for (group, bits) in order {
            let found = match taken.is_empty() {
                true => repair::repaired(&self.raster, bits),
                false => self
                    .raster
                    .without(&taken)
                    .and_then(|raster| repair::repaired(&raster, bits)),
            };
            if let Some(found) = found {
                taken = taken.or(&surrounded(&found, self.gap));
                repaired[group] = found;
            }
        }
        let found = Layers::new(repaired);
        (found.count() > 0 || layers.count() == 0).then_some(found)
    }
}
