//! Constraints that make a design possible to manufacture, to wire and to operate.
//!
//! An electrode is at least f wide if squares of side f inside it cover it. A gap is at least f wide if squares of
//! side f outside the electrodes cover it; everything outside the membrane counts as gap. Such a pattern equals its
//! opening and its closing by a square of that many cells (Serra, Image Analysis and Mathematical Morphology, 1982).

mod blocks;
mod connect;
mod limits;
mod morphology;
mod parameters;
mod raster;
mod repair;
mod violations;

#[cfg(test)]
mod tests;

pub use limits::{ConstraintError, Limits, Pad, Sides};
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
    domain: DesignDomain,
    /// Constraints on the electrodes of each group.
    raster: RasterConstraints,
    /// The same with the cells of each group that are always active; empty if there are none.
    of_groups: Vec<RasterConstraints>,
    /// Minimum number of columns or rows between electrodes of different groups.
    gap: [usize; 2],
}

/// The membrane that is designed: the cells available for electrodes and the electrode groups.
#[derive(Clone, Debug, PartialEq)]
pub struct DesignDomain {
    /// The membrane.
    pub membrane: Membrane,
    /// The cells that may carry electrodes; `None` if there are no frames or bodies.
    pub available: Option<Bits>,
    /// The number of electrode groups.
    pub groups: usize,
    /// The cells that the leads of the scene touch; `None` without leads.
    pub leads: Option<Bits>,
    /// Which patterns give equivalent displacements.
    pub equivalence: PatternEquivalence,
}

impl From<Membrane> for DesignDomain {
    /// One group; electrodes may be anywhere.
    fn from(membrane: Membrane) -> Self {
        Self {
            membrane,
            available: None,
            groups: 1,
            leads: None,
            equivalence: PatternEquivalence::new(membrane.symmetries(), vec![1]),
        }
    }
}

impl From<&Scene> for DesignDomain {
    fn from(scene: &Scene) -> Self {
        Self {
            membrane: scene.membrane(),
            available: scene.free_cells(),
            groups: scene.groups(),
            leads: scene.leads.as_ref().map(|leads| leads.touched(scene.membrane().raster)),
            equivalence: PatternEquivalence::new(scene.symmetries(), scene.equivalent_groups()),
        }
    }
}

impl Constraints {
    /// No constraints.
    #[must_use]
    pub fn none(membrane: Membrane) -> Self {
        Self {
            limits: Limits::default(),
            domain: membrane.into(),
            raster: RasterConstraints::none(membrane.raster),
            of_groups: Vec::new(),
            gap: [0; 2],
        }
    }

    /// Converts limits to constraints on the cells of a membrane.
    ///
    /// # Errors
    /// If a number is out of range, or the limits contradict each other.
    pub fn new(limits: Limits, domain: impl Into<DesignDomain>) -> Result<Self, ConstraintError> {
        let domain = domain.into();
        let raster = limits.raster(domain.membrane, domain.available.as_ref(), domain.leads.as_ref())?;
        let gap = limits.gap(domain.membrane, domain.groups)?;
        Ok(Self {
            of_groups: limits.of_groups(&raster, (domain.groups, gap), domain.membrane)?,
            raster,
            gap,
            limits,
            domain,
        })
    }

    /// The constraints on the electrodes of a group, from 0.
    fn of_group(&self, group: usize) -> &RasterConstraints {
        self.of_groups.get(group).unwrap_or(&self.raster)
    }

    /// The electrodes that are always there; `None` if there are none.
    #[must_use]
    pub fn kept_in(&self) -> Option<Layers> {
        let none = || Bits::empty(self.domain.membrane.raster);
        let of_group = |of: &RasterConstraints| of.kept_in.clone().unwrap_or_else(none);
        (!self.of_groups.is_empty()).then(|| Layers::new(self.of_groups.iter().map(of_group).collect()))
    }

    /// Which patterns give equivalent displacements.
    #[must_use]
    pub fn equivalence(&self) -> &PatternEquivalence {
        &self.domain.equivalence
    }

    /// The number of electrode groups.
    #[must_use]
    pub fn groups(&self) -> usize {
        self.domain.groups
    }

    /// The cells that may carry electrodes; `None` if there are no frames or bodies.
    #[must_use]
    pub fn available(&self) -> Option<&Bits> {
        self.domain.available.as_ref()
    }

    /// The pattern itself, or a valid pattern near it if a part of it is not connected to a lead of the scene.
    #[must_use]
    pub fn connected(&self, pattern: Pattern) -> Pattern {
        let Some(leads) = &self.domain.leads else {
            return pattern;
        };
        let layers = self.layers(&pattern);
        match layers.iter().all(|bits| bits.without(&bits.flooded(leads)).is_empty()) {
            true => pattern,
            false => self.repaired(&pattern).unwrap_or(pattern),
        }
    }

    /// The membrane.
    #[must_use]
    pub fn membrane(&self) -> Membrane {
        self.domain.membrane
    }

    /// The limits from which the constraints were made.
    #[must_use]
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Whether any pattern is valid; margins are ignored.
    #[must_use]
    pub fn allow_any_pattern(&self) -> bool {
        self.raster.allow_any() && self.of_groups.is_empty() && self.gap == [0; 2]
    }

    /// The minimum width of electrodes and gaps in columns and rows; 1 × 1 without a minimum.
    #[must_use]
    pub fn feature_cells(&self) -> [usize; 2] {
        self.raster.feature
    }

    /// The cells that are active in some valid pattern: not kept out, and covered by an electrode of the minimum width
    /// that can reach a lead.
    #[must_use]
    pub fn allowed(&self) -> &Bits {
        &self.raster.allowed
    }

    /// Whether regions are kept free of electrodes.
    #[must_use]
    pub fn keep_out(&self) -> bool {
        !self.limits.keep_out.is_empty()
    }

    /// An upper bound of the area fraction of valid patterns.
    #[must_use]
    pub fn largest_area(&self) -> f64 {
        self.raster.most_cells() as f64 / self.free_count() as f64
    }

    /// The number of cells that may carry electrodes.
    #[must_use]
    pub fn free_count(&self) -> usize {
        let raster = self.domain.membrane.raster;
        self.available().map_or(raster.cells(), Bits::count)
    }

    /// The area fraction of a pattern: its share of the cells that may carry electrodes.
    #[must_use]
    pub fn area_fraction(&self, pattern: &Pattern) -> f64 {
        pattern.area_fraction(self.available())
    }

    /// Checks an area fraction with its tolerance against bounds that need no search.
    ///
    /// # Errors
    /// If the constraints leave less area, the smallest electrode is larger, or the area is less than half a cell.
    pub fn check_area(&self, area: f64, tolerance: f64) -> Result<(), ConstraintError> {
        let (largest, cells) = (self.largest_area(), self.free_count());
        if area > largest + tolerance {
            return Err(ConstraintError::AreaTooLarge { area, largest });
        }
        let kept = self.kept_in().map_or(0, |kept| kept.count()) as f64 / self.free_count() as f64;
        if area + tolerance < kept {
            return Err(ConstraintError::AreaBelowKeepIn { area, smallest: kept });
        }
        let smallest = (self.raster.feature[0] * self.raster.feature[1]) as f64 / self.free_count() as f64;
        if area > tolerance && area + tolerance < smallest {
            return Err(ConstraintError::AreaTooSmall { area, smallest });
        }
        // The tolerance is absolute: within it a smaller area is met by many times as many cells, or by none.
        if area > 0.0 && area * (cells as f64) < 0.5 {
            return Err(ConstraintError::AreaBetweenCells {
                area,
                tolerance,
                cells,
                below_and_above: [0.0, 1.0 / cells as f64],
            });
        }
        Ok(())
    }

    /// The smallest and the largest number of cells whose area fraction is within a range; the smallest is larger if no
    /// number is.
    #[must_use]
    pub fn cells_of_areas(&self, range: (f64, f64)) -> [usize; 2] {
        let all = self.free_count() as f64;
        // Tolerates rounding errors of fractions that are a whole number of cells.
        let least = (range.0 * all - 1e-9).ceil().clamp(0.0, all);
        let most = (range.1 * all + 1e-9).floor().clamp(0.0, all);
        [least as usize, most as usize]
    }

    /// Checks that some number of cells has an area fraction within its tolerance.
    ///
    /// # Errors
    /// If the area lies between those of two numbers of cells.
    pub fn check_area_of_cells(&self, area: f64, tolerance: f64) -> Result<(), ConstraintError> {
        let cells = self.free_count();
        let [least, most] = self.cells_of_areas((area - tolerance, area + tolerance));
        match least <= most {
            true => Ok(()),
            false => Err(ConstraintError::AreaBetweenCells {
                area,
                tolerance,
                cells,
                below_and_above: [most, least].map(|count| count as f64 / cells as f64),
            }),
        }
    }

    /// The pattern without the cells that are not [allowed](Self::allowed).
    #[must_use]
    pub fn masked(&self, pattern: &Pattern) -> Pattern {
        pattern.within(&self.raster.allowed)
    }

    /// The electrodes of a pattern, one layer per group.
    #[must_use]
    pub fn layers(&self, pattern: &Pattern) -> Layers {
        Layers::of(pattern, self.groups())
    }

    /// Whether a pattern is valid; margins are ignored.
    #[must_use]
    pub fn satisfied_by(&self, pattern: &Pattern) -> bool {
        self.satisfied_by_layers(&self.layers(pattern))
    }

    /// [`Constraints::satisfied_by`] for the electrodes of each group.
    #[must_use]
    pub fn satisfied_by_layers(&self, layers: &Layers) -> bool {
        let mut groups = layers.iter().enumerate();
        groups.all(|(group, bits)| self.of_group(group).satisfied_by(bits)) && self.cells_in_gaps(layers) == 0
    }

    /// The number of cells that are too close to electrodes of another group; each counts once.
    fn cells_in_gaps(&self, layers: &Layers) -> usize {
        if self.gap == [0; 2] {
            return 0;
        }
        let close = |(group, bits): (usize, &Bits)| {
            let others = layers.iter().enumerate().filter(|(other, _)| *other != group);
            let around = others
                .map(|(_, other)| surrounded(other, self.gap))
                .reduce(|a, b| a.or(&b));
            around.map_or(0, |around| bits.and(&around).count())
        };
        layers.iter().enumerate().map(close).sum()
    }

    /// The constraints that a pattern violates; margins are ignored.
    #[must_use]
    pub fn violations(&self, pattern: &Pattern) -> Violations {
        Violations::of(self, &self.layers(pattern))
    }

    /// A valid pattern near a pattern, margins ignored: the pattern itself if it is valid. Opening and closing remove
    /// what is too narrow. A piece without a lead, or beyond the maximum number, is joined by the shortest strip of
    /// the minimum width, or removed if the strip would be larger than the piece. Cells that are always active are
    /// added. Groups with fewer cells give way to groups with more. The area may change. `None` if nothing of the
    /// pattern is left.
    #[must_use]
    pub fn repaired(&self, pattern: &Pattern) -> Option<Pattern> {
        Some(self.repaired_layers(&self.layers(pattern))?.pattern())
    }

    /// [`Constraints::repaired`] for the electrodes of each group.
    #[must_use]
    pub fn repaired_layers(&self, layers: &Layers) -> Option<Layers> {
        let mut order: Vec<(usize, &Bits)> = layers.iter().enumerate().collect();
        order.sort_by_key(|(_, bits)| std::cmp::Reverse(bits.count()));
        let mut taken = Bits::empty(self.domain.membrane.raster);
        let mut repaired = vec![taken.clone(); order.len()];
        for (group, bits) in order {
            let found = match taken.is_empty() {
                true => repair::repaired(self.of_group(group), bits),
                false => self
                    .of_group(group)
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
