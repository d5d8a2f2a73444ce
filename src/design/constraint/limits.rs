//! Constraints in mm and counts, as users state them, and their conversion to cells.

use super::morphology::opened;
use super::morphology::{closed, surrounded};
use super::raster::RasterConstraints;
use deaflow_pattern::{Bits, Membrane, Raster, Region};

/// Tolerance of widths, in cells: rounding must not widen a feature by a cell.
const RESOLUTION: f64 = 1e-9;

/// Limits on a pattern; none by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Limits {
    /// Minimum width of electrodes and gaps in mm.
    pub min_feature_mm: Option<f64>,
    /// Minimum distance between electrodes of different groups in mm; `min_feature_mm` if that is larger.
    pub gap_mm: Option<f64>,
    /// Maximum number of 4-connected pieces of each group.
    pub islands: Option<usize>,
    /// Each piece must touch the frame on one of these sides.
    pub leads: Option<Sides>,
    /// Each piece must have a cell at one of these places, if there are any: on contact pads.
    pub pads: Vec<Pad>,
    /// Regions with electrodes, and their group from 1: a cell has one if its centre lies in the region.
    pub keep_in: Vec<(usize, Region)>,
    /// Regions without electrodes: a cell is excluded if its centre lies in one of them.
    pub keep_out: Vec<Region>,
    /// Minimum ratio of breakdown field to largest field; needs a simulation.
    pub breakdown_margin: Option<f64>,
    /// Minimum ratio of pull-in voltage to voltage; needs a simulation.
    pub pull_in_margin: Option<f64>,
}

/// A place of a lead.
#[derive(Clone, Debug, PartialEq)]
pub enum Pad {
    /// A cell by column and row.
    Cell([usize; 2]),
    /// A region.
    Region(Region),
}

/// Sides of the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sides {
    /// x = 0.
    pub left: bool,
    /// x = the side of the membrane.
    pub right: bool,
    /// y = 0.
    pub bottom: bool,
    /// y = the side of the membrane.
    pub top: bool,
}

/// Invalid constraints, or constraints that no pattern satisfies.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConstraintError {
    /// A number is out of range.
    #[error("`{name}` must be {allowed}, found {found}")]
    Number {
        /// The key.
        name: &'static str,
        /// The value.
        found: f64,
        /// The allowed values.
        allowed: &'static str,
    },
    /// The minimum width exceeds the membrane.
    #[error("`min_feature` is {found} mm, larger than the membrane of {size}")]
    Feature {
        /// The minimum width in mm.
        found: f64,
        /// The sides of the membrane.
        size: String,
    },
    /// The minimum distance exceeds the membrane.
    #[error("`gap` is {found} mm, larger than the membrane of {size}")]
    Gap {
        /// The minimum distance in mm.
        found: f64,
        /// The sides of the membrane.
        size: String,
    },
    /// A distance between groups needs several groups.
    #[error("`gap` is the distance between groups of electrodes; the scene has only one group")]
    OneGroup,
    /// A region contains no cell.
    #[error("`keep_out` number {number} contains no cell centre of the membrane of {size}")]
    Outside {
        /// The number of the region, from 1.
        number: usize,
        /// The sides of the membrane.
        size: String,
    },
    /// A mask in a region has other cells.
    #[error("`keep_out` number {number}: the mask has {found} cells, but the membrane has {raster}")]
    Mask {
        /// The number of the region, from 1.
        number: usize,
        /// The cells of the mask.
        found: Raster,
        /// The cells of the membrane.
        raster: Raster,
    },
    /// Electrodes of a group that the scene does not have.
    #[error("`keep_in` number {number} is of group {found}; groups of the scene: {groups}")]
    Group {
        /// The number of the region, from 1.
        number: usize,
        /// The group.
        found: usize,
        /// The number of groups.
        groups: usize,
    },
    /// Cells that must have an electrode cannot have one.
    #[error("`keep_in` number {number}: {why}")]
    KeepIn {
        /// The number of the region, from 1.
        number: usize,
        /// Why not.
        why: &'static str,
    },
    /// Regions with electrodes are too close.
    #[error("the regions of `keep_in` overlap, or leave gaps narrower than {least}")]
    Near {
        /// The key with the minimum width.
        least: &'static str,
    },
    /// No electrode can touch a place of a lead.
    #[error("`leads`: no cell at these places can have an electrode")]
    NoPad,
    /// No side for leads.
    #[error("`leads` names no side of the frame; allowed: left, right, bottom, top")]
    NoSide,
    /// No electrode can touch a side.
    #[error("`leads`: `keep_out` leaves no space for an electrode at the frame on the {side}")]
    Side {
        /// The side's name.
        side: &'static str,
    },
    /// No electrode can touch a lead of the scene.
    #[error("the constraints, the frame and bodies leave no space for an electrode at a lead of the scene")]
    NoLead,
    /// No cell can be active.
    #[error("`keep_out` and `min_feature` leave no space for electrodes")]
    NoSpace,
    /// The area exceeds what the constraints allow.
    #[error("area fraction {area} is not possible: the constraints allow at most {largest:.4}")]
    AreaTooLarge {
        /// The target area fraction.
        area: f64,
        /// An upper bound of the area fraction.
        largest: f64,
    },
    /// The area is smaller than the electrodes that are always there.
    #[error("area fraction {area} is not possible: the electrodes of `keep_in` have {smallest:.4}")]
    AreaBelowKeepIn {
        /// The target area fraction.
        area: f64,
        /// The area fraction of these electrodes.
        smallest: f64,
    },
    /// No number of cells has the area.
    #[error(
        "area fraction {area} within {tolerance} is not possible on {cells} cells; the nearest are {:.4} and {:.4}",
        below_and_above[0],
        below_and_above[1]
    )]
    AreaBetweenCells {
        /// The target area fraction.
        area: f64,
        /// Its tolerance.
        tolerance: f64,
        /// The number of cells that may carry electrodes.
        cells: usize,
        /// The nearest area fractions of a number of cells.
        below_and_above: [f64; 2],
    },
    /// The area is smaller than the smallest electrode.
    #[error("area fraction {area} is not possible: the smallest electrode of width `min_feature` has {smallest:.4}")]
    AreaTooSmall {
        /// The target area fraction.
        area: f64,
        /// The area fraction of the smallest electrode.
        smallest: f64,
    },
}

impl Sides {
    /// The whole frame.
    pub const ALL: Self = Self {
        left: true,
        right: true,
        bottom: true,
        top: true,
    };

    /// The names of the sides, in the order of [`Sides::named`].
    pub const NAMES: [&'static str; 4] = ["left", "right", "bottom", "top"];

    /// Each side, and whether it is included.
    #[must_use]
    pub fn named(self) -> [(&'static str, bool); 4] {
        let [left, right, bottom, top] = Self::NAMES;
        [
            (left, self.left),
            (right, self.right),
            (bottom, self.bottom),
            (top, self.top),
        ]
    }

    /// The cells next to the frame on one side: the first cell of each row or column from that side.
    fn cells(name: &str, membrane: &Bits) -> Bits {
        let is_row = matches!(name, "left" | "right");
        let from_low = matches!(name, "left" | "bottom");
        let [columns, rows] = membrane.sides();
        let (lines, length) = if is_row { (rows, columns) } else { (columns, rows) };
        let first = |line: usize| {
            let has = |at: &usize| match is_row {
                true => membrane.has(*at, line),
                false => membrane.has(line, *at),
            };
            match from_low {
                true => (0..length).find(has),
                false => (0..length).rfind(has),
            }
        };
        let first: Vec<Option<usize>> = (0..lines).map(first).collect();
        Bits::from_fn(membrane.raster(), |x, y| match is_row {
            true => first[y] == Some(x),
            false => first[x] == Some(y),
        })
    }
}

impl Limits {
    /// Whether there is a margin, which needs a simulation to check.
    #[must_use]
    pub fn has_margins(&self) -> bool {
        self.breakdown_margin.is_some() || self.pull_in_margin.is_some()
    }

    /// The limits in cells of a membrane; `available` are the cells that may carry electrodes, and `leads` those that
    /// the leads of the scene touch.
    pub(super) fn raster(
        &self,
        membrane: Membrane,
        available: Option<&Bits>,
        leads: Option<&Bits>,
    ) -> Result<RasterConstraints, ConstraintError> {
        let feature = self.feature(membrane)?;
        self.check_numbers()?;
        let available = available.cloned().unwrap_or_else(|| Bits::full(membrane.raster));
        let mut free = available.clone();
        for (index, region) in self.keep_out.iter().enumerate() {
            let (number, raster) = (index + 1, membrane.raster);
            if let Some(found) = region.other_raster(raster) {
                return Err(ConstraintError::Mask { number, found, raster });
            }
            let cells = region.cells(membrane);
            if cells.is_empty() {
                let size = membrane.size_text();
                return Err(ConstraintError::Outside { number, size });
            }
            free = free.without(&cells);
        }
        let mut allowed = opened(&free, feature);
        if allowed.is_empty() {
            return Err(ConstraintError::NoSpace);
        }
        let on_sides = match self.pads_in(membrane) {
            None => self.lead_cells(&available, &allowed)?,
            Some(pads) => {
                let pads = pads.and(&allowed);
                let pads = (!pads.is_empty()).then_some(pads);
                Some(pads.ok_or(ConstraintError::NoPad)?)
            }
        };
        let leads = match (on_sides, leads) {
            (sides, None) => sides,
            (None, Some(leads)) => Some(leads.and(&allowed)),
            (Some(sides), Some(leads)) => Some(sides.and(leads)),
        };
        if leads.as_ref().is_some_and(Bits::is_empty) {
            return Err(ConstraintError::NoLead);
        }
        if let Some(leads) = &leads {
            allowed = allowed.flooded(leads);
        }
        Ok(RasterConstraints {
            allowed,
            feature,
            islands: self.islands,
            leads,
            kept_in: None,
        })
    }

    /// The cells at the places of leads; `None` if there are none.
    fn pads_in(&self, membrane: Membrane) -> Option<Bits> {
        let cells = |pad: &Pad| match pad {
            Pad::Region(region) => region.cells(membrane),
            Pad::Cell([x, y]) => Bits::from_fn(membrane.raster, |column, row| [column, row] == [*x, *y]),
        };
        self.pads.iter().map(cells).reduce(|all, one| all.or(&one))
    }

    /// The constraints of each group if some cells are always active; empty otherwise. `common` are those of all
    /// groups, `gap` is the distance of other groups.
    pub(super) fn of_groups(
        &self,
        common: &RasterConstraints,
        (groups, gap): (usize, [usize; 2]),
        membrane: Membrane,
    ) -> Result<Vec<RasterConstraints>, ConstraintError> {
        if self.keep_in.is_empty() {
            return Ok(Vec::new());
        }
        let n = common.feature;
        let mut kept = vec![Bits::empty(membrane.raster); groups];
        for (index, (group, region)) in self.keep_in.iter().enumerate() {
            let number = index + 1;
            let refused = |why| Err(ConstraintError::KeepIn { number, why });
            if *group == 0 || *group > groups {
                let found = *group;
                return Err(ConstraintError::Group { number, found, groups });
            }
            if region.other_raster(membrane.raster).is_some() {
                return refused("the mask has other cells than the membrane");
            }
            let cells = region.cells(membrane);
            if cells.is_empty() {
                return refused("it contains no cell centre of the membrane");
            }
            if !cells.without(&common.allowed).is_empty() {
                return refused("a part of it may not have an electrode, or cannot be reached by a lead");
            }
            // What is narrower than the minimum width is left out.
            let wide = opened(&closed(&cells, n).and(&common.allowed), n);
            if wide.is_empty() {
                return refused("it is narrower than `min_feature`");
            }
            kept[group - 1] = kept[group - 1].or(&wide);
        }
        for (own, cells) in kept.iter().enumerate() {
            if closed(cells, n) != *cells {
                return Err(ConstraintError::Near { least: "`min_feature`" });
            }
            let mut others = kept.iter().enumerate().filter(|(other, _)| *other != own);
            if others.any(|(_, other)| surrounded(other, gap).meets(cells)) {
                return Err(ConstraintError::Near { least: "`gap`" });
            }
        }
        let of_group = |own: usize| {
            let others = kept.iter().enumerate().filter(|(other, _)| *other != own);
            let taken = others.map(|(_, other)| surrounded(other, gap)).reduce(|a, b| a.or(&b));
            let free = match taken {
                None => Some(common.clone()),
                Some(taken) => common.without(&taken),
            };
            let own = &kept[own];
            // A group may be left without space.
            let free = free.unwrap_or_else(|| RasterConstraints {
                allowed: own.clone(),
                ..common.clone()
            });
            RasterConstraints {
                allowed: free.allowed.or(own),
                kept_in: (!own.is_empty()).then(|| own.clone()),
                ..free
            }
        };
        Ok((0..groups).map(of_group).collect())
    }

    /// The minimum width in cells along x and y.
    fn feature(&self, membrane: Membrane) -> Result<[usize; 2], ConstraintError> {
        for side in membrane.size_mm {
            positive("side", side)?;
        }
        let Some(found) = self.min_feature_mm else {
            return Ok([1; 2]);
        };
        in_whole_cells("min_feature", found, membrane)?.ok_or_else(|| ConstraintError::Feature {
            found,
            size: membrane.size_text(),
        })
    }

    /// The minimum number of columns or rows between electrodes of different groups.
    pub(super) fn gap(&self, membrane: Membrane, groups: usize) -> Result<[usize; 2], ConstraintError> {
        if self.gap_mm.is_some() && groups == 1 {
            return Err(ConstraintError::OneGroup);
        }
        let widest = [self.gap_mm, self.min_feature_mm]
            .into_iter()
            .flatten()
            .reduce(f64::max)
            .filter(|_| groups > 1);
        let Some(found) = widest else {
            return Ok([0; 2]);
        };
        in_whole_cells("gap", found, membrane)?.ok_or_else(|| ConstraintError::Gap {
            found,
            size: membrane.size_text(),
        })
    }

    fn check_numbers(&self) -> Result<(), ConstraintError> {
        if self.islands == Some(0) {
            return Err(ConstraintError::Number {
                name: "islands",
                found: 0.0,
                allowed: "at least 1",
            });
        }
        let margins = [
            ("breakdown_margin", self.breakdown_margin),
            ("pull_in_margin", self.pull_in_margin),
        ];
        for (name, margin) in margins {
            if let Some(found) = margin.filter(|margin| !(margin.is_finite() && *margin >= 1.0)) {
                let allowed = "a number from 1";
                return Err(ConstraintError::Number { name, found, allowed });
            }
        }
        Ok(())
    }

    /// The allowed cells next to the frame on the sides for leads. If all sides are named, some of them may be kept
    /// out.
    fn lead_cells(&self, membrane: &Bits, allowed: &Bits) -> Result<Option<Bits>, ConstraintError> {
        let Some(sides) = self.leads else { return Ok(None) };
        let required = || sides.named().into_iter().filter(|(_, required)| *required);
        let at = |side| Sides::cells(side, membrane).and(allowed);
        let none = Bits::empty(allowed.raster());
        let all = required().fold(none, |all, (side, _)| all.or(&at(side)));
        match required().find(|(side, _)| at(side).is_empty()) {
            Some((side, _)) if sides != Sides::ALL || all.is_empty() => Err(ConstraintError::Side { side }),
            _ if all.is_empty() => Err(ConstraintError::NoSide),
            _ => Ok(Some(all)),
        }
    }
}

fn positive(name: &'static str, found: f64) -> Result<f64, ConstraintError> {
    match found.is_finite() && found > 0.0 {
        true => Ok(found),
        false => Err(ConstraintError::Number {
            name,
            found,
            allowed: "a positive length in mm",
        }),
    }
}

/// A length in columns and rows, rounded up; `None` if the membrane has fewer.
fn in_whole_cells(
    name: &'static str,
    length_mm: f64,
    membrane: Membrane,
) -> Result<Option<[usize; 2]>, ConstraintError> {
    let length = positive(name, length_mm)?;
    let cells = membrane
        .in_cells([length; 2])
        .map(|width| (width - RESOLUTION).ceil().max(1.0));
    let mut pairs = cells.iter().zip(membrane.raster.sides());
    let fits = pairs.all(|(width, side)| *width <= side as f64);
    Ok(fits.then(|| cells.map(|width| width as usize)))
}
