//! One face for all families, so that whoever draws samples need not know which family they come from.

use super::area_sweep::AreaSweep;
use super::bezier::Bezier;
use super::blobs::Blobs;
use super::curves::Curves;
use super::error::SampleError;
use super::large_grid::LargeGrid;
use super::small_grid::SmallGrid;
use super::stripes::Stripes;
use crate::pattern::Pattern;

/// A family of electrode patterns with its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Family {
    /// Every cell for itself.
    SmallGrid(SmallGrid),
    /// N × N units.
    LargeGrid(LargeGrid),
    /// One side of a Bézier curve.
    Bezier(Bezier),
    /// Several forms at drawn area fractions.
    AreaSweep(AreaSweep),
    /// Parallel bands.
    Stripes(Stripes),
    /// Islands and holes.
    Blobs(Blobs),
    /// Regions bounded by smooth curves.
    Curves(Curves),
}

impl Family {
    /// The word that stands in pipelines and files.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::SmallGrid(_) => "small-grid",
            Self::LargeGrid(_) => "large-grid",
            Self::Bezier(_) => "bezier",
            Self::AreaSweep(_) => "area-sweep",
            Self::Stripes(_) => "stripes",
            Self::Blobs(_) => "blobs",
            Self::Curves(_) => "curves",
        }
    }

    /// How many samples there are; `None` when there is no end to them.
    #[must_use]
    pub fn available(&self) -> Option<u64> {
        match self {
            Self::LargeGrid(family) => family.available(),
            _ => None,
        }
    }

    /// Sample `index` under a seed: a function of the family, its parameters, the seed and the index alone.
    ///
    /// # Errors
    /// When the family has no more than `index` samples.
    pub fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        match self {
            Self::SmallGrid(family) => Ok(family.sample(seed, index)),
            Self::LargeGrid(family) => family.sample(seed, index),
            Self::Bezier(family) => Ok(family.sample(seed, index)),
            Self::AreaSweep(family) => family.sample(seed, index),
            Self::Stripes(family) => Ok(family.sample(seed, index)),
            Self::Blobs(family) => Ok(family.sample(seed, index)),
            Self::Curves(family) => Ok(family.sample(seed, index)),
        }
    }
}
