//! Area sweep: cells, grids and curves at area fractions away from ½.
//!
//! The families of the source paper (Qin et al., doi 10.1089/soro.2024.0063) have an area fraction of about ½, but its
//! second case needs designs from 5 % to 95 %, to which a surrogate trained on them would have to extrapolate.
//!
//! For each sample an area fraction α is drawn uniformly from a range, and one of three forms with equal probability:
//! single cells (the nearest number of cells to α · 2500), a grid of N × N units with the nearest number of units to α
//! N² on, or one side of a Bézier curve, shifted until the nearest number of cells to α · 2500 is active. N is uniform
//! in 2 to 10; it is drawn again if its units are too large for an area within the range.

use super::areas::Areas;
use super::bezier::{Bezier, BezierParameters, Ends};
use super::canvas::Canvas;
use super::error::{ParameterError, SampleError, cells_at};
use super::family::{Family, FamilyParameters, MOST_SAMPLES, SampleGroup};
use super::large_grid::{pattern_of_units, units_of};
use super::membership::is_grid_of;
use super::small_grid::{SmallGrid, SmallGridParameters};
use deaflow_base::{Decimal, Stream, parameters};
use deaflow_pattern::Pattern;

/// Draws of a grid after which single cells are used: no grid may have an area fraction within a narrow range.
const MOST_DRAWS: u32 = 100;

/// Units across the grids.
const GRIDS: std::ops::RangeInclusive<usize> = 2..=10;

parameters! {
    /// Cells, grids of units and curves at drawn areas.
    pub struct AreaSweepParameters as "an area-sweep sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
        /// Electrode areas to draw from, smallest and largest, shares of the free membrane.
        pub area: [Decimal; 2] [0.0..=1.0] = [0.05, 0.95],
    }
}

impl FamilyParameters for AreaSweepParameters {
    const NAME: &'static str = "area-sweep";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, ParameterError> {
        let [low, high] = self.area.map(Decimal::to_f64);
        let family = AreaSweep::new(canvas, low, high).map_err(ParameterError::of("area"))?;
        Ok(self.one_group(self.count, Box::new(family)))
    }

    /// One of the three forms.
    fn admits(pattern: &Pattern) -> bool {
        BezierParameters::admits(pattern)
            || SmallGridParameters::admits(pattern)
            || GRIDS.into_iter().any(|units| is_grid_of([units; 2], pattern))
    }
}

/// Patterns of several forms at drawn area fractions.
#[derive(Clone, Debug, PartialEq)]
pub struct AreaSweep {
    areas: Areas,
}

impl AreaSweep {
    /// Creates the family with area fractions from `low` to `high`.
    ///
    /// # Errors
    /// As for [`Areas::new`].
    pub fn new(canvas: Canvas, low: f64, high: f64) -> Result<Self, SampleError> {
        Ok(Self {
            areas: Areas::new(canvas, low, high)?,
        })
    }

    fn draw_grid(&self, area: f64, stream: &mut Stream) -> Option<Pattern> {
        for _ in 0..MOST_DRAWS {
            let units = units_of(self.areas.canvas(), 2 + stream.index(9));
            let total = units[0] * units[1];
            let count = (area * total as f64).round() as usize;
            let mut on = vec![false; total];
            stream.choose(total, count).into_iter().for_each(|unit| on[unit] = true);
            let pattern = pattern_of_units(self.areas.canvas(), units, &on);
            if self.areas.contain(pattern.area_fraction(self.areas.canvas().free())) {
                return Some(pattern);
            }
        }
        None
    }
}

impl Family for AreaSweep {
    fn name(&self) -> &'static str {
        AreaSweepParameters::NAME
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let (canvas, area) = (self.areas.canvas().clone(), self.areas.draw(stream));
        let active = cells_at(area, &canvas).expect("a fraction between two valid ones is valid");
        let grid = match stream.index(3) {
            0 => None,
            1 => self.draw_grid(area, stream),
            _ => {
                let curve = Bezier {
                    canvas,
                    ends: Ends::Opposite,
                    active: Some(active),
                };
                return curve.draw(stream);
            }
        };
        grid.unwrap_or_else(|| SmallGrid { canvas, active }.draw(stream))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::CELLS;

    fn usual() -> AreaSweep {
        AreaSweep::new(Canvas::PAPER, 0.05, 0.95).unwrap()
    }

    fn drawn(count: u64) -> Vec<Pattern> {
        (0..count).map(|i| usual().sample(5, i).unwrap()).collect()
    }

    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Form {
        Cells,
        Grid,
        Curve,
    }

    fn form(pattern: &Pattern) -> Form {
        let of_units = |units: usize| {
            let corner = |c: usize| ((c * units / CELLS) * CELLS).div_ceil(units);
            let mut cells = (0..CELLS * CELLS).map(|i| (i % CELLS, i / CELLS));
            cells.all(|(x, y)| pattern.is_active(x, y) == pattern.is_active(corner(x), corner(y)))
        };
        let columns = (0..CELLS).flat_map(|y| (1..CELLS).map(move |x| (x, y)));
        let changes = columns.filter(|&(x, y)| pattern.is_active(x, y) != pattern.is_active(x - 1, y));
        // A row meets the boundary of a curve once or twice, single cells many times.
        match changes.count() {
            _ if (2..=10).any(of_units) => Form::Grid,
            few if few < 150 => Form::Curve,
            _ => Form::Cells,
        }
    }

    /// Σ (n − mean)² / mean.
    fn chi_square(counts: &[f64]) -> f64 {
        let mean = counts.iter().sum::<f64>() / counts.len() as f64;
        counts.iter().map(|n| (n - mean).powi(2) / mean).sum()
    }

    #[test]
    fn areas_lie_in_the_range_and_cover_it_evenly() {
        let mut tenths = [0.0; 9];
        for pattern in drawn(1800) {
            let area = pattern.area_fraction(None);
            assert!((0.05..=0.95).contains(&area), "{area}");
            // Grids have an area near the drawn one only.
            if form(&pattern) != Form::Grid {
                tenths[((area - 0.05) / 0.1).min(8.0) as usize] += 1.0;
            }
        }
        // Chi-square with 8 degrees of freedom: 26.1 is the 0.1 % quantile.
        assert!(chi_square(&tenths) < 26.1, "{tenths:?}");
    }

    #[test]
    fn all_three_forms_are_equally_frequent() {
        let forms: Vec<Form> = drawn(600).iter().map(form).collect();
        let counts = [Form::Cells, Form::Grid, Form::Curve]
            .map(|wanted| forms.iter().filter(|form| **form == wanted).count() as f64);
        // Chi-square with 2 degrees of freedom: 13.8 is the 0.1 % quantile.
        assert!(chi_square(&counts) < 13.8, "{counts:?}");
    }

    #[test]
    fn samples_are_unchanged() {
        let cells: Vec<usize> = drawn(9).iter().map(Pattern::active_cells).collect();
        assert_eq!(cells, [1956, 332, 561, 1650, 433, 771, 1199, 844, 1075]);
    }

    #[test]
    fn a_single_fraction_is_met_exactly() {
        let family = AreaSweep::new(Canvas::PAPER, 0.2, 0.2).unwrap();
        assert!((0..60).all(|i| family.sample(1, i).unwrap().active_cells() == 500));
    }

    #[test]
    fn ranges_in_the_wrong_order_are_rejected() {
        assert_eq!(
            AreaSweep::new(Canvas::PAPER, 0.6, 0.4),
            Err(SampleError::AreaRange { low: 0.6, high: 0.4 })
        );
        for (low, high) in [(0.0, 0.5), (0.5, 1.0), (f64::NAN, 0.5)] {
            assert!(matches!(
                AreaSweep::new(Canvas::PAPER, low, high),
                Err(SampleError::Area { .. })
            ));
        }
    }
}
