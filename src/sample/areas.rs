//! A range of area fractions, and the cells that a level function puts first at a fraction drawn from it.

use super::error::{SampleError, cells_at};
use super::family::Refusal;
use crate::base::{Canonical, Decimal, Dimension, InputError, Node, Parameter, Schema, Stream};
use crate::pattern::{CELLS, Pattern};

/// A range of area fractions to draw from; both ends may be equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Areas {
    low: f64,
    high: f64,
}

impl Areas {
    /// The fractions from `low` to `high`.
    ///
    /// # Errors
    /// When an end leaves nothing to draw, or the ends are not in order.
    pub fn new(low: f64, high: f64) -> Result<Self, SampleError> {
        cells_at(low)?;
        cells_at(high)?;
        if low <= high {
            Ok(Self { low, high })
        } else {
            Err(SampleError::AreaRange { low, high })
        }
    }

    /// A fraction, uniform in the range.
    pub(super) fn drawn(&self, stream: &mut Stream) -> f64 {
        stream.range(self.low, self.high)
    }

    /// Whether a fraction lies in the range.
    pub(super) fn contain(&self, area: f64) -> bool {
        (self.low..=self.high).contains(&area)
    }
}

/// Area fractions as a document gives them: one, or the smallest and the largest to draw from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AreaFractions([Decimal; 2]);

impl AreaFractions {
    /// The range.
    ///
    /// # Errors
    /// When an end leaves nothing to draw, or the ends are not in order.
    pub fn areas(&self) -> Result<Areas, Refusal> {
        let [low, high] = self.0.map(Decimal::to_f64);
        Areas::new(low, high).map_err(Refusal::of("area"))
    }
}

impl Parameter for AreaFractions {
    type Limits = ();
    type Literal = [f64; 2];

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let one = |node: &Node| Ok(node.quantity_in(key, Dimension::Number, 0.0, 1.0)?.base());
        match node.list(key) {
            Ok([low, high]) => Ok(Self([one(low)?, one(high)?])),
            Ok(_) => Err(node
                .error(format!("`{key}` must have two ends"))
                .help("for example [0.05, 0.95]")),
            Err(_) => Ok(Self([one(node)?; 2])),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.into_iter().collect())
    }

    fn schema((): &()) -> Schema {
        let one = || Schema::number(0.0, 1.0);
        Schema::any_of([one(), Schema::list(one(), 2, 2)])
    }

    fn literal(literal: [f64; 2]) -> Self {
        Self(literal.map(|end| Decimal::from_f64(end).unwrap_or(Decimal::ZERO)))
    }
}

/// The pattern of the cells at which a level is highest, so many that the area fraction is the nearest to `area`; cells at
/// equal levels go by their number. `level` takes the centre of a cell, in cells from the lower left corner.
pub(super) fn highest(area: f64, level: impl Fn(f64, f64) -> f64) -> Pattern {
    let mut ranked: Vec<(f64, usize)> = (0..CELLS * CELLS)
        .map(|cell| (level((cell % CELLS) as f64 + 0.5, (cell / CELLS) as f64 + 0.5), cell))
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut active = vec![false; CELLS * CELLS];
    let count = (area * (CELLS * CELLS) as f64).round() as usize;
    ranked.iter().take(count).for_each(|&(_, cell)| active[cell] = true);
    Pattern::from_fn(|x, y| active[y * CELLS + x])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_highest_cells_are_taken_and_equal_ones_by_number() {
        let right = highest(0.1, |x, _| x);
        assert_eq!(right, Pattern::from_fn(|x, _| x >= 45));
        let flat = highest(0.5, |_, _| 0.0);
        assert_eq!(flat, Pattern::from_fn(|_, y| y < 25));
    }

    #[test]
    fn refuses_what_is_not_a_range() {
        let wrong = Areas::new(0.6, 0.4);
        assert_eq!(wrong, Err(SampleError::AreaRange { low: 0.6, high: 0.4 }));
        for (low, high) in [(0.0, 0.5), (0.5, 1.0), (f64::NAN, 0.5)] {
            assert!(matches!(Areas::new(low, high), Err(SampleError::Area { .. })));
        }
    }
}
