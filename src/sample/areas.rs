//! A range of area fractions, and the cells that a level function puts first at a fraction drawn from it.

use super::canvas::Canvas;
use super::error::{SampleError, cells_at};
use super::family::FamilyError;
use deaflow_base::{Canonical, Decimal, InputError, Node, Parameter, Schema, Stream};
use deaflow_pattern::Pattern;

/// A range of area fractions to draw from; both ends may be equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Areas {
    canvas: Canvas,
    low: f64,
    high: f64,
}

impl Areas {
    /// The fractions of a canvas from `low` to `high`.
    ///
    /// # Errors
    /// When an end leaves nothing to draw, or the ends are not in order.
    pub fn new(canvas: Canvas, low: f64, high: f64) -> Result<Self, SampleError> {
        cells_at(low, canvas.raster())?;
        cells_at(high, canvas.raster())?;
        if low <= high {
            Ok(Self { canvas, low, high })
        } else {
            Err(SampleError::AreaRange { low, high })
        }
    }

    /// What they are fractions of.
    pub(super) fn canvas(&self) -> &Canvas {
        &self.canvas
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
    pub fn areas(&self, canvas: Canvas) -> Result<Areas, FamilyError> {
        let [low, high] = self.0.map(Decimal::to_f64);
        Areas::new(canvas, low, high).map_err(FamilyError::of("area"))
    }
}

impl Parameter for AreaFractions {
    type Limits = ();
    type Literal = [f64; 2];

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let one = |node: &Node| Decimal::read(node, key, &(0.0..=1.0));
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
        let one = || Decimal::schema(&(0.0..=1.0));
        Schema::any_of([one(), Schema::list(one(), 2, 2)])
    }

    fn literal(literal: [f64; 2]) -> Self {
        Self(literal.map(|end| Decimal::from_f64(end).unwrap_or(Decimal::ZERO)))
    }
}

/// The pattern of the cells at which a level is highest, so many that the area fraction is the nearest to `area`; cells at
/// equal levels go by their number. `level` takes the centre of a cell.
pub(super) fn highest(canvas: &Canvas, area: f64, level: impl Fn(f64, f64) -> f64) -> Pattern {
    highest_of(canvas, area, canvas.centres().map(|[x, y]| level(x, y)))
}

/// The same where levels are given cell by cell, `[y][x]`.
pub(super) fn highest_of(canvas: &Canvas, area: f64, levels: impl Iterator<Item = f64>) -> Pattern {
    let mut ranked: Vec<(f64, usize)> = levels.zip(0..).collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let cells = canvas.raster().cells();
    let mut active = vec![false; cells];
    let count = (area * cells as f64).round() as usize;
    ranked.iter().take(count).for_each(|&(_, cell)| active[cell] = true);
    canvas.pattern(&active)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    #[test]
    fn the_highest_cells_are_taken_and_equal_ones_by_number() {
        let right = highest(&Canvas::PAPER, 0.1, |x, _| x);
        assert_eq!(right, Pattern::from_fn(Raster::PAPER, |x, _| x >= 45));
        let flat = highest(&Canvas::PAPER, 0.5, |_, _| 0.0);
        assert_eq!(flat, Pattern::from_fn(Raster::PAPER, |_, y| y < 25));
    }

    #[test]
    fn refuses_what_is_not_a_range() {
        let wrong = Areas::new(Canvas::PAPER, 0.6, 0.4);
        assert_eq!(wrong, Err(SampleError::AreaRange { low: 0.6, high: 0.4 }));
        for (low, high) in [(0.0, 0.5), (0.5, 1.0), (f64::NAN, 0.5)] {
            assert!(matches!(
                Areas::new(Canvas::PAPER, low, high),
                Err(SampleError::Area { .. })
            ));
        }
    }
}
