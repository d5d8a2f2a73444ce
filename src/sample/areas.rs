//! A range of area fractions, and patterns of the cells with the highest levels at such a fraction.

use super::canvas::Canvas;
use super::error::{ParameterError, SampleError, cells_at};
use deaflow_base::{Canonical, Decimal, InputError, Node, Parameter, Schema, Stream};
use deaflow_pattern::Pattern;

/// A range of area fractions to draw from; both ends may be equal.
#[derive(Clone, Debug, PartialEq)]
pub struct Areas {
    canvas: Canvas,
    low: f64,
    high: f64,
}

impl Areas {
    /// Creates the range from `low` to `high` on a canvas.
    ///
    /// # Errors
    /// When no cell or every cell would be active at an end, or the ends are not in order.
    pub fn new(canvas: Canvas, low: f64, high: f64) -> Result<Self, SampleError> {
        cells_at(low, &canvas)?;
        cells_at(high, &canvas)?;
        if low <= high {
            Ok(Self { canvas, low, high })
        } else {
            Err(SampleError::AreaRange { low, high })
        }
    }

    /// The canvas.
    pub(super) fn canvas(&self) -> &Canvas {
        &self.canvas
    }

    /// Draws a fraction, uniform in the range.
    pub(super) fn draw(&self, stream: &mut Stream) -> f64 {
        stream.range(self.low, self.high)
    }

    /// Returns whether a fraction lies in the range.
    pub(super) fn contain(&self, area: f64) -> bool {
        (self.low..=self.high).contains(&area)
    }
}

/// Area fractions in a document: one, or the smallest and the largest to draw from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AreaFractions([Decimal; 2]);

impl AreaFractions {
    /// Returns the range on a canvas.
    ///
    /// # Errors
    /// As for [`Areas::new`].
    pub fn areas(&self, canvas: Canvas) -> Result<Areas, ParameterError> {
        let [low, high] = self.0.map(Decimal::to_f64);
        Areas::new(canvas, low, high).map_err(ParameterError::of("area"))
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
                .error(format!("`{key}` must have two values"))
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

/// Returns the pattern of the free cells with the highest level, as many as give the area fraction nearest to `area`;
/// among equal levels the lower cell number comes first. `level` takes the centre of a cell.
pub(super) fn highest(canvas: &Canvas, area: f64, level: impl Fn(f64, f64) -> f64) -> Pattern {
    highest_of(canvas, area, canvas.centres().map(|[x, y]| level(x, y)))
}

/// Does the same for levels given by cell, `[y][x]`.
pub(super) fn highest_of(canvas: &Canvas, area: f64, levels: impl Iterator<Item = f64>) -> Pattern {
    let levels: Vec<f64> = levels.collect();
    let mut ranked = canvas.free_cells();
    let count = (area * ranked.len() as f64).round() as usize;
    ranked.sort_by(|&a, &b| levels[b].total_cmp(&levels[a]).then(a.cmp(&b)));
    let mut active = vec![false; levels.len()];
    ranked.iter().take(count).for_each(|&cell| active[cell] = true);
    canvas.pattern(&active)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::{Bits, Raster};

    #[test]
    fn the_highest_cells_are_taken_and_equal_ones_by_number() {
        let right = highest(&Canvas::PAPER, 0.1, |x, _| x);
        assert_eq!(right, Pattern::from_fn(Raster::PAPER, |x, _| x >= 45));
        let flat = highest(&Canvas::PAPER, 0.5, |_, _| 0.0);
        assert_eq!(flat, Pattern::from_fn(Raster::PAPER, |_, y| y < 25));
    }

    #[test]
    fn areas_are_shares_of_the_free_cells() {
        let free = Bits::from_fn(Raster::PAPER, |x, y| x >= 10 && y < 40);
        let canvas = Canvas::PAPER.with_free(Some(free.clone()));
        let right = highest(&canvas, 0.25, |x, _| x);
        assert_eq!(right, Pattern::from_fn(Raster::PAPER, |x, y| x >= 40 && y < 40));
        assert!((right.area_fraction(Some(&free)) - 0.25).abs() < 1e-15);
        assert_eq!((cells_at(0.25, &canvas), canvas.free_count()), (Ok(400), 1600));
    }

    #[test]
    fn ranges_in_the_wrong_order_are_rejected() {
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
