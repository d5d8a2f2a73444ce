//! The artifact of a sample or a patterns stage.

use std::sync::Arc;

use super::element::{Packed, PerCell};
use super::error::ElementError;
use super::macros::arrays;
use deaflow_pattern::{Coverage, Electrodes, Pattern, Polygons};

/// The kinds of stages with this artifact.
pub const SAMPLED: [&str; 2] = ["sample", "patterns"];

/// The largest coordinate of an electrode in mm.
const LONGEST: f64 = 1e6;

/// The family of patterns from files.
pub const FROM_FILE: &str = "file";

arrays! {
    /// Patterns that were sampled or read from files.
    #[derive(Default)]
    pub struct Samples, SamplesView {
        /// The patterns and their origin.
        rows: SampleRows = group(""),
        /// Electrode area, a share of the free membrane.
        area: Vec<f64> = array("area", "1", [sample]),
    }
}

arrays! {
    /// Patterns and their origin.
    #[derive(Default)]
    pub struct SampleRows, SampleRowsView {
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [sample, y, x]),
        /// Family of the pattern; `file` if it was read from a file.
        family: Vec<String> = array("family", "", [sample]),
        /// Number of the sample within its family, parameters and seed; for a pattern from a file its number in the
        /// stage.
        index: Vec<u64> = array("index", "1", [sample]),
        /// Units across the membrane for the family large-grid, 0 for others.
        units: Vec<u64> = array("units", "1", [sample]),
        /// If elements follow drawn electrodes, their shapes.
        electrodes: Option<DrawnElectrodes> = group("electrodes"),
        /// If electrodes cover parts of cells, the shares.
        covered: Option<CoveredCells> = group("covered"),
    }
}

arrays! {
    /// The share of each cell that an electrode covers.
    #[derive(Default)]
    pub struct CoveredCells, CoveredCellsView {
        /// Share of each cell that is covered.
        share: Packed<PerCell<f64>> = array("share", "1", [sample, y, x]),
        /// Electrode group that covers the cell or a part of it, 0 if none.
        group: Packed<PerCell<u8>> = array("group", "1", [sample, y, x]),
    }
}

impl CoveredCells {
    /// Returns the shares of the cells of patterns; `None` if no pattern has cells that are covered in part.
    #[must_use]
    pub fn of(patterns: &[Pattern]) -> Option<Self> {
        patterns.iter().find_map(Pattern::coverage)?;
        Some(Self::of_all(patterns))
    }

    /// Returns the shares of the cells of patterns, also if all cells are whole.
    #[must_use]
    pub fn of_all(patterns: &[Pattern]) -> Self {
        let mut all = Self::default();
        for pattern in patterns {
            match pattern.coverage() {
                Some(coverage) => {
                    all.share.0.extend(coverage.shares());
                    all.group.0.extend(coverage.groups());
                }
                None => {
                    let whole = |cell: &u8| f64::from(u8::from(*cell != 0));
                    all.share.0.extend(pattern.cells().iter().map(whole));
                    all.group.0.extend(pattern.cells());
                }
            }
        }
        all
    }

    /// Adds the shares to patterns.
    ///
    /// # Errors
    /// If the arrays do not fit the patterns, or a value is out of range.
    pub(super) fn add_to(&self, patterns: Vec<Pattern>) -> Result<Vec<Pattern>, ElementError> {
        let refused = |why: &str| ElementError::Covered(why.to_owned());
        let cells: usize = patterns.iter().map(|pattern| pattern.cells().len()).sum();
        if self.share.0.len() != cells || self.group.0.len() != cells {
            return Err(refused("not one for each cell"));
        }
        if self
            .group
            .0
            .iter()
            .any(|group| usize::from(*group) > Pattern::MOST_GROUPS)
        {
            return Err(refused("a group is out of range"));
        }
        let mut first = 0;
        let one = |pattern: Pattern| {
            let own = first..first + pattern.cells().len();
            first = own.end;
            let coverage = Coverage::new(pattern.raster(), &self.group.0[own.clone()], &self.share.0[own]);
            let coverage = coverage.map_err(|error| ElementError::Covered(error.to_string()))?;
            match coverage.has_cut_cells() {
                _ if coverage.cells() != pattern.cells() => Err(refused(
                    "cells that are covered by half or more are not those of the pattern",
                )),
                true => Ok(Pattern::of_coverage(coverage)),
                false => Ok(pattern),
            }
        };
        patterns.into_iter().map(one).collect()
    }
}

arrays! {
    /// Drawn electrodes that elements follow: closed polygons, whose last vertex is joined to the first. Outer ones run
    /// anticlockwise, holes clockwise.
    #[derive(Default)]
    pub struct DrawnElectrodes, DrawnElectrodesView {
        /// Sides of the membrane.
        size: Vec<[f64; 2]> = array("size", "mm", [sample, xy]),
        /// Number of polygons of each sample, one after the other; 0 if its electrodes are the cells.
        polygons: Vec<u64> = array("polygons", "1", [sample]),
        /// Electrode group of each polygon.
        group: Vec<u64> = array("group", "1", [polygon]),
        /// Number of vertices of each polygon, one after the other.
        vertices: Vec<u64> = array("vertices", "1", [polygon]),
        /// Vertices, from the lower left corner of the membrane.
        vertex: Vec<[f64; 2]> = array("vertex", "mm", [vertex, xy]),
    }
}

impl DrawnElectrodes {
    /// Returns the drawn electrodes of patterns; `None` if no pattern has any.
    #[must_use]
    pub fn of(patterns: &[Pattern]) -> Option<Self> {
        patterns.iter().find_map(Pattern::electrodes)?;
        Some(Self::of_all(patterns))
    }

    fn of_all(patterns: &[Pattern]) -> Self {
        let mut all = Self::default();
        for pattern in patterns {
            let electrodes = pattern.electrodes();
            let size = electrodes.map_or([0.0; 2], |electrodes| electrodes.size_mm());
            let groups = electrodes.iter().flat_map(|electrodes| electrodes.groups());
            let polygons = groups.flat_map(|(group, region)| region.rings().iter().map(move |ring| (*group, ring)));
            let before = all.group.len();
            for (group, ring) in polygons {
                all.group.push(u64::from(group));
                all.vertices.push(ring.len() as u64);
                all.vertex.extend(ring);
            }
            all.size.push(size);
            all.polygons.push((all.group.len() - before) as u64);
        }
        all
    }

    /// Adds the drawn electrodes to patterns.
    ///
    /// # Errors
    /// If the arrays do not fit each other or the patterns, or a value is out of range.
    pub(super) fn add_to(&self, patterns: Vec<Pattern>) -> Result<Vec<Pattern>, ElementError> {
        self.check(patterns.len()).map_err(ElementError::Electrodes)?;
        let mut vertices = self.vertex.iter();
        let mut polygons = self.group.iter().zip(&self.vertices);
        let own = self.size.iter().zip(&self.polygons).map(|(size, count)| {
            let mut groups: Vec<(u8, Vec<Vec<[f64; 2]>>)> = Vec::new();
            for (group, length) in polygons.by_ref().take(*count as usize) {
                let ring = vertices.by_ref().take(*length as usize).copied().collect();
                match groups.last_mut() {
                    Some((last, rings)) if u64::from(*last) == *group => rings.push(ring),
                    _ => groups.push((*group as u8, vec![ring])),
                }
            }
            let groups = groups
                .into_iter()
                .map(|(group, rings)| (group, Polygons::of_rings(rings)));
            (*count > 0).then(|| Arc::new(Electrodes::of_parts(groups.collect(), *size)))
        });
        let pairs = patterns.into_iter().zip(own);
        Ok(pairs
            .map(|(pattern, electrodes)| pattern.with_electrodes(electrodes))
            .collect())
    }

    fn check(&self, patterns: usize) -> Result<(), &'static str> {
        let is_sum = |counts: &[u64], total: usize| {
            let sum = counts.iter().try_fold(0_u64, |sum, count| sum.checked_add(*count));
            sum == Some(total as u64)
        };
        let groups = 1..=Pattern::MOST_GROUPS as u64;
        let is_length = |value: &f64| (0.0..=LONGEST).contains(value);
        if self.size.len() != patterns || self.polygons.len() != patterns {
            return Err("not one for each pattern");
        }
        if self.group.len() != self.vertices.len()
            || !is_sum(&self.polygons, self.group.len())
            || !is_sum(&self.vertices, self.vertex.len())
        {
            return Err("numbers of polygons or vertices do not add up");
        }
        if !self.group.iter().all(|group| groups.contains(group)) {
            return Err("a group is out of range");
        }
        match self.size.iter().chain(&self.vertex).flatten().all(is_length) {
            true => Ok(()),
            false => Err("a coordinate is out of range"),
        }
    }
}

/// Adds drawn electrodes and covered shares of cells to patterns, which are read without them.
///
/// # Errors
/// If they are invalid.
pub fn drawn_patterns(
    patterns: Vec<Pattern>,
    electrodes: Option<&DrawnElectrodes>,
    covered: Option<&CoveredCells>,
) -> Result<Vec<Pattern>, ElementError> {
    let patterns = match electrodes {
        Some(electrodes) => electrodes.add_to(patterns)?,
        None => patterns,
    };
    match covered {
        Some(covered) => covered.add_to(patterns),
        None => Ok(patterns),
    }
}

impl SampleRows {
    /// Adds the drawn electrodes and the covered shares of cells to the patterns, which are read without them.
    ///
    /// # Errors
    /// If they are invalid.
    pub fn drawn(self) -> Result<Self, ElementError> {
        let patterns = drawn_patterns(self.patterns, self.electrodes.as_ref(), self.covered.as_ref())?;
        Ok(Self { patterns, ..self })
    }

    /// Returns some of the rows, in the order of `rows`.
    #[must_use]
    pub fn select(&self, rows: &[usize]) -> Self {
        let patterns: Vec<Pattern> = rows.iter().map(|&row| self.patterns[row].clone()).collect();
        Self {
            family: rows.iter().map(|&row| self.family[row].clone()).collect(),
            index: rows.iter().map(|&row| self.index[row]).collect(),
            units: rows.iter().map(|&row| self.units[row]).collect(),
            electrodes: self.electrodes.as_ref().map(|_| DrawnElectrodes::of_all(&patterns)),
            covered: self.covered.as_ref().map(|_| CoveredCells::of_all(&patterns)),
            patterns,
        }
    }
}
