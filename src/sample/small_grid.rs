//! Small grid: single cells chosen at random.
//!
//! The first family of the source paper (Qin et al., doi 10.1089/soro.2024.0063, "Dataset construction"): half of the
//! 2500 cells. Here the area fraction is a parameter.

use super::canvas::Canvas;
use super::error::{ParameterError, SampleError, cells_at};
use super::family::{Family, FamilyParameters, MOST_SAMPLES, SampleGroup};
use super::membership::is_grid_of;
use deaflow_base::{Decimal, Stream, parameters};
use deaflow_pattern::Pattern;

parameters! {
    /// Single cells chosen at random.
    pub struct SmallGridParameters as "a small-grid sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
        /// Electrode area, a share of the free membrane.
        pub area: Decimal [0.0..=1.0] = 0.5,
    }
}

impl FamilyParameters for SmallGridParameters {
    const NAME: &'static str = "small-grid";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, ParameterError> {
        let family = SmallGrid::new(canvas, self.area.to_f64()).map_err(ParameterError::of("area"))?;
        Ok(self.one_group(self.count, Box::new(family)))
    }

    /// Every cell is on or off at random.
    fn admits(pattern: &Pattern) -> bool {
        is_grid_of(pattern.raster().sides(), pattern)
    }
}

/// Patterns with a fixed number of active free cells, each such pattern equally likely.
#[derive(Clone, Debug, PartialEq)]
pub struct SmallGrid {
    pub(super) canvas: Canvas,
    pub(super) active: usize,
}

impl SmallGrid {
    /// Creates the family with an area fraction (0.5 in the paper), rounded to a number of cells.
    ///
    /// # Errors
    /// When no cell or every cell would be active.
    pub fn new(canvas: Canvas, area: f64) -> Result<Self, SampleError> {
        Ok(Self {
            active: cells_at(area, &canvas)?,
            canvas,
        })
    }
}

impl Family for SmallGrid {
    fn name(&self) -> &'static str {
        SmallGridParameters::NAME
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let free = self.canvas.free_cells();
        let mut active = vec![false; self.canvas.raster().cells()];
        for at in stream.choose(free.len(), self.active) {
            active[free[at]] = true;
        }
        self.canvas.pattern(&active)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::CELLS;

    #[test]
    fn the_area_is_exact() {
        for (area, cells) in [(0.5, 1250), (0.05, 125), (0.9996, 2499)] {
            let family = SmallGrid::new(Canvas::PAPER, area).unwrap();
            for index in 0..20 {
                assert_eq!(family.sample(1, index).unwrap().active_cells(), cells);
            }
        }
    }

    #[test]
    fn every_cell_is_equally_likely() {
        let family = SmallGrid::new(Canvas::PAPER, 0.5).unwrap();
        let draws = 400;
        let mut counts = vec![0.0; CELLS * CELLS];
        for index in 0..draws {
            for (count, &cell) in counts.iter_mut().zip(family.sample(5, index).unwrap().cells()) {
                *count += f64::from(cell);
            }
        }
        // Choices without replacement: each count has variance draws/4, and the 2500 counts sum to a constant, so the
        // statistic has a chi-square distribution with 2499 degrees of freedom: mean 2499, standard deviation 70.7.
        let mean = draws as f64 / 2.0;
        let chi2: f64 = counts.iter().map(|c| (c - mean).powi(2) / (draws as f64 / 4.0)).sum();
        assert!((chi2 - 2499.0).abs() < 4.0 * 70.7, "chi-square {chi2}");
    }
}
