//! The area sweep: patterns of the other families at area fractions away from ½.
//!
//! The families of the source paper (Qin et al., doi 10.1089/soro.2024.0063) have an area fraction of ½ or near it, and its
//! second case asks for designs from 5 % to 95 %. A surrogate that never saw such patterns can only guess there.
//!
//! For each sample an area fraction α is drawn uniformly from a range, and one of three forms with equal odds: single cells
//! (exactly the nearest number of cells to α · 2500), a grid of N × N units with the nearest number of units to α N² on, or
//! one side of a Bézier curve that is shifted until the nearest number of cells to α · 2500 is active. N is drawn from 2 to 10
//! and drawn again where units so large cannot have an area within the range.

use super::areas::Areas;
use super::bezier::{Bezier, Ends};
use super::canvas::Canvas;
use super::error::SampleError;
use super::family::{Family, FamilyError, FamilyParameters, MOST_SAMPLES, SampleGroup};
use super::large_grid::{pattern_of_units, units_of};
use super::membership::is_grid_of;
use super::small_grid::SmallGrid;
use deaflow_base::{Decimal, Stream, parameters};
use deaflow_pattern::Pattern;

/// Grids drawn before single cells are taken instead: a range narrower than the steps of all grids has none.
const MOST_DRAWS: u32 = 100;

/// Units across the grids that are drawn.
const GRIDS: std::ops::RangeInclusive<usize> = 2..=10;

parameters! {
    /// Cells, grids of units and curves at drawn area fractions.
    pub struct AreaSweepParameters as "an area-sweep sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
        /// Area fractions to draw from, smallest and largest.
        pub area: [Decimal; 2] [0.0..=1.0] = [0.05, 0.95],
    }
}

impl FamilyParameters for AreaSweepParameters {
    const NAME: &'static str = "area-sweep";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, FamilyError> {
        let [low, high] = self.area.map(Decimal::to_f64);
        let family = AreaSweep::new(canvas, low, high).map_err(FamilyError::of("area"))?;
        Ok(self.one_group(self.count, Box::new(family)))
    }

    /// One of the three forms.
    fn admits(pattern: &Pattern) -> bool {
        let is_curve = super::bezier::BezierParameters::admits(pattern);
        is_curve
            || super::small_grid::SmallGridParameters::admits(pattern)
            || GRIDS.into_iter().any(|units| is_grid_of([units; 2], pattern))
    }
}

/// Patterns of several forms at drawn area fractions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaSweep {
    areas: Areas,
}

impl AreaSweep {
    /// The family at area fractions from `low` to `high`.
    ///
    /// # Errors
    /// When an end leaves nothing to draw, or the ends are not in order.
    pub fn new(canvas: Canvas, low: f64, high: f64) -> Result<Self, SampleError> {
        Ok(Self {
            areas: Areas::new(canvas, low, high)?,
        })
    }

    fn grid(&self, area: f64, stream: &mut Stream) -> Option<Pattern> {
        for _ in 0..MOST_DRAWS {
            let units = units_of(self.areas.canvas(), 2 + stream.index(9));
            let total = units[0] * units[1];
            let count = (area * total as f64).round() as usize;
            let mut on = vec![false; total];
            stream.choose(total, count).into_iter().for_each(|unit| on[unit] = true);
            let pattern = pattern_of_units(self.areas.canvas(), units, &on);
            if self.areas.contain(pattern.area_fraction()) {
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

    /// Never refuses an index: every fraction between two valid ones is valid.
    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        let mut stream = Stream::new(seed, "area-sweep", index);
        let (canvas, area) = (*self.areas.canvas(), self.areas.drawn(&mut stream));
        match stream.index(3) {
            0 => Ok(SmallGrid::new(canvas, area)?.drawn(&mut stream)),
            1 => match self.grid(area, &mut stream) {
                Some(pattern) => Ok(pattern),
                None => Ok(SmallGrid::new(canvas, area)?.drawn(&mut stream)),
            },
            _ => Ok(Bezier::new(canvas, Some(area), Ends::Opposite)?.drawn(&mut stream)),
        }
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
            let area = pattern.area_fraction();
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
    fn samples_stay_what_they_are() {
        let cells: Vec<usize> = drawn(9).iter().map(Pattern::active_cells).collect();
        assert_eq!(cells, [1956, 332, 561, 1650, 433, 771, 1199, 844, 1075]);
    }

    #[test]
    fn a_single_fraction_is_met_exactly() {
        let family = AreaSweep::new(Canvas::PAPER, 0.2, 0.2).unwrap();
        assert!((0..60).all(|i| family.sample(1, i).unwrap().active_cells() == 500));
    }

    #[test]
    fn a_sample_is_named_by_seed_and_index() {
        assert_eq!(usual().sample(1, 7), usual().sample(1, 7));
        assert_ne!(usual().sample(1, 7), usual().sample(1, 8));
        assert_ne!(usual().sample(1, 7), usual().sample(2, 7));
    }

    #[test]
    fn refuses_what_is_not_a_range() {
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
