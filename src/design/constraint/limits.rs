//! What is asked of a pattern, in the terms in which people ask it.

use super::morphology::opened;
use super::raster::RasterConstraints;
use deaflow_pattern::{Bits, Membrane, Region};

/// Widths within this part of a cell are equal: rounding must not widen a feature by a cell.
const RESOLUTION: f64 = 1e-9;

/// What is asked of a pattern; by default nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Limits {
    /// The least width of electrodes and gaps in mm.
    pub min_feature_mm: Option<f64>,
    /// The least distance between electrodes of different groups in mm; that of `min_feature_mm` where this is larger.
    pub gap_mm: Option<f64>,
    /// The largest number of 4-connected pieces, of each group.
    pub islands: Option<usize>,
    /// Every piece must touch the frame on one of these sides.
    pub leads: Option<Sides>,
    /// Cells whose centre lies in one of these are never active.
    pub keep_out: Vec<Region>,
    /// Breakdown must be at least this many times away; not told from the pattern.
    pub breakdown_margin: Option<f64>,
    /// Pull-in must be at least this many times away; not told from the pattern.
    pub pull_in_margin: Option<f64>,
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

/// Constraints that no pattern can keep, or that are none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConstraintError {
    /// Not a length, count or margin.
    #[error("`{name}` must be {allowed}, found {found}")]
    Number {
        /// Which.
        name: &'static str,
        /// What was found.
        found: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// Wider than all there is.
    #[error("`min_feature` is {found} mm, more than the membrane of {size}")]
    Feature {
        /// The least width in mm.
        found: f64,
        /// The sides of the membrane.
        size: String,
    },
    /// Wider than all there is.
    #[error("`gap` is {found} mm, more than the membrane of {size}")]
    Gap {
        /// The least distance in mm.
        found: f64,
        /// The sides of the membrane.
        size: String,
    },
    /// A distance between groups where there is one.
    #[error("`gap` is the distance between groups of electrodes, and the scene has one group")]
    OneGroup,
    /// A region without a cell.
    #[error("`keep_out` number {number} holds no cell of the membrane of {size}: no cell has its centre in it")]
    Outside {
        /// Which region, from 1.
        number: usize,
        /// The sides of the membrane.
        size: String,
    },
    /// No side to lead out on.
    #[error("`leads` names no side of the frame; allowed: left, right, bottom, top")]
    NoSide,
    /// No electrode can touch a side.
    #[error(
        "`leads`: no electrode of the least width can touch the frame on the {side}: `keep_out` leaves no room there"
    )]
    Side {
        /// The side's name.
        side: &'static str,
    },
    /// Nothing can be active.
    #[error("`keep_out` and `min_feature` leave no room for any electrode")]
    NoRoom,
    /// An area that is not left.
    #[error("an area fraction of {area} cannot be had: the constraints leave {largest:.4} at most")]
    TooMuchArea {
        /// The wanted area fraction.
        area: f64,
        /// The largest that is left.
        largest: f64,
    },
    /// An area smaller than the smallest electrode.
    #[error(
        "an area fraction of {area} cannot be had: the smallest electrode that `min_feature` allows has {smallest:.4}"
    )]
    TooLittleArea {
        /// The wanted area fraction.
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

    /// The names of the sides in the order of [`Sides::named`].
    pub const NAMES: [&'static str; 4] = ["left", "right", "bottom", "top"];

    /// Each side with whether it is one of these.
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

    /// The cells of a room at the side of this name: in each row or column the first one from there, which lies at the frame.
    fn cells(name: &str, room: &Bits) -> Bits {
        let [columns, rows] = room.sides();
        let is_row = matches!(name, "left" | "right");
        let is_near = matches!(name, "left" | "bottom");
        let (lines, places) = if is_row { (rows, columns) } else { (columns, rows) };
        let first: Vec<Option<usize>> = (0..lines)
            .map(|line| {
                let has = |place: &usize| {
                    if is_row {
                        room.has(*place, line)
                    } else {
                        room.has(line, *place)
                    }
                };
                if is_near {
                    (0..places).find(has)
                } else {
                    (0..places).rev().find(has)
                }
            })
            .collect();
        Bits::from_fn(room.raster(), |x, y| match is_row {
            true => first[y] == Some(x),
            false => first[x] == Some(y),
        })
    }
}

impl Limits {
    /// Whether a margin is asked for, which takes a simulation to check.
    #[must_use]
    pub fn has_margins(&self) -> bool {
        self.breakdown_margin.is_some() || self.pull_in_margin.is_some()
    }

    /// What the limits mean for the cells of a membrane.
    pub(super) fn raster(
        &self,
        membrane: Membrane,
        within: Option<&Bits>,
    ) -> Result<RasterConstraints, ConstraintError> {
        let feature = self.feature(membrane)?;
        self.check_numbers()?;
        let mut free = within.cloned().unwrap_or_else(|| Bits::full(membrane.raster));
        for (index, region) in self.keep_out.iter().enumerate() {
            let cells = region.cells(membrane);
            if cells.is_empty() {
                let (number, size) = (index + 1, membrane.size_text());
                return Err(ConstraintError::Outside { number, size });
            }
            free = free.without(&cells);
        }
        let mut room = opened(&free, feature);
        if room.is_empty() {
            return Err(ConstraintError::NoRoom);
        }
        let membrane = within.cloned().unwrap_or_else(|| Bits::full(membrane.raster));
        let leads = self.contacts(&membrane, &room)?;
        if let Some(leads) = &leads {
            room = room.flooded(leads);
        }
        Ok(RasterConstraints {
            allowed: room,
            feature,
            islands: self.islands,
            leads,
        })
    }

    /// The least width in cells along x and y.
    fn feature(&self, membrane: Membrane) -> Result<[usize; 2], ConstraintError> {
        for side in membrane.size_mm {
            positive("side", side)?;
        }
        let Some(found) = self.min_feature_mm else {
            return Ok([1; 2]);
        };
        let refused = |size| ConstraintError::Feature { found, size };
        in_whole_cells("min_feature", found, membrane)?.ok_or_else(|| refused(membrane.size_text()))
    }

    /// The least number of columns, or else of rows, between electrodes of different groups.
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
        let refused = |size| ConstraintError::Gap { found, size };
        in_whole_cells("gap", found, membrane)?.ok_or_else(|| refused(membrane.size_text()))
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

    /// The cells of the room at a wanted side of a membrane. With the whole frame wanted some sides may be kept out, but not all.
    fn contacts(&self, membrane: &Bits, room: &Bits) -> Result<Option<Bits>, ConstraintError> {
        let Some(sides) = self.leads else { return Ok(None) };
        let wanted = || sides.named().into_iter().filter(|(_, wanted)| *wanted);
        let at = |side| Sides::cells(side, membrane).and(room);
        let none = Bits::empty(room.raster());
        let all = wanted().fold(none, |all, (side, _)| all.or(&at(side)));
        match wanted().find(|(side, _)| at(side).is_empty()) {
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

/// The columns and rows that a length takes; `None` where there are not as many.
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
