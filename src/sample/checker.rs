//! Checker: a checkerboard of any period and offset.
//!
//! Alternating squares put as many electrode edges into the membrane as a period allows, and neighbours pull against each
//! other, so displacements are small and coarse meshes err most. The period, two squares, is uniform in [2, 12] cells, the
//! offset in a period, and the area fraction in a range, [0.3, 0.7] unless another is given: at ½ the squares meet at their
//! corners, below they are islands, above they leave holes.

use std::f64::consts::TAU;

use super::areas::{AreaFractions, Areas, highest};
use super::canvas::Canvas;
use super::error::SampleError;
use super::family::{Family, FamilyError, FamilyParameters, MOST_SAMPLES, SampleGroup};
use deaflow_base::{Stream, parameters};
use deaflow_pattern::Pattern;

/// Period of the board, in cells.
const PERIOD: [f64; 2] = [2.0, 12.0];

parameters! {
    /// Checkerboards of any period and offset.
    pub struct CheckerParameters as "a checker sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
        /// Area fraction of the electrode, or smallest and largest to draw from.
        pub area: AreaFractions = [0.3, 0.7],
    }
}

impl FamilyParameters for CheckerParameters {
    const NAME: &'static str = "checker";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, FamilyError> {
        let family = Checker::new(self.area.areas(canvas)?);
        Ok(self.one_group(self.count, Box::new(family)))
    }
}

/// Checkerboards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checker {
    areas: Areas,
}

impl Checker {
    /// The family at area fractions of a range.
    #[must_use]
    pub fn new(areas: Areas) -> Self {
        Self { areas }
    }
}

impl Family for Checker {
    fn name(&self) -> &'static str {
        CheckerParameters::NAME
    }

    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        let mut stream = Stream::new(seed, "checker", index);
        let period = stream.range(PERIOD[0], PERIOD[1]);
        let [across, along] = [stream.range(0.0, TAU), stream.range(0.0, TAU)];
        let area = self.areas.drawn(&mut stream);
        let wave = |cells: f64, phase: f64| (TAU * cells / period + phase).cos();
        Ok(highest(self.areas.canvas(), area, |x, y| {
            wave(x, across) * wave(y, along)
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::CELLS;

    fn at_half(index: u64) -> Pattern {
        let family = Checker::new(Areas::new(Canvas::PAPER, 0.5, 0.5).unwrap());
        family.sample(3, index).unwrap()
    }

    #[test]
    fn areas_cover_the_range_and_a_single_one_is_met_exactly() {
        let usual = Checker::new(Areas::new(Canvas::PAPER, 0.3, 0.7).unwrap());
        let areas: Vec<f64> = (0..200).map(|i| usual.sample(5, i).unwrap().area_fraction()).collect();
        assert!(areas.iter().all(|area| (0.3..=0.7).contains(area)));
        let mean = areas.iter().sum::<f64>() / 200.0;
        // Uniform: mean 0.5, standard deviation 0.1155.
        assert!((mean - 0.5).abs() < 4.0 * 0.1155 / 200f64.sqrt(), "{mean}");
        assert!((0..20).all(|i| at_half(i).active_cells() == 1250));
    }

    #[test]
    fn half_a_period_away_the_state_is_the_other_one() {
        for index in 0..40 {
            let mut stream = Stream::new(3, "checker", index);
            let half = 0.5 * stream.range(PERIOD[0], PERIOD[1]);
            // A whole number of half periods that is a whole number of cells, to a twentieth.
            let steps = (1..CELLS).map(|n| (n, n as f64 * half));
            let Some((n, shift)) = steps
                .into_iter()
                .find(|(_, s)| (s - s.round()).abs() < 0.05 && *s < 40.0)
            else {
                continue;
            };
            let (pattern, shift) = (at_half(index), shift.round() as usize);
            let pairs = (0..CELLS).flat_map(|y| (shift..CELLS).map(move |x| (x, y)));
            let kept = |&(x, y): &(usize, usize)| pattern.is_active(x, y) == pattern.is_active(x - shift, y);
            let (all, equal) = (pairs.clone().count(), pairs.filter(kept).count());
            let expected = if n % 2 == 0 { equal } else { all - equal };
            assert!(
                expected as f64 > 0.9 * all as f64,
                "sample {index}: {expected} of {all}"
            );
        }
    }

    #[test]
    fn a_sample_is_named_by_seed_and_index() {
        let usual = Checker::new(Areas::new(Canvas::PAPER, 0.3, 0.7).unwrap());
        let sample = |seed, index| usual.sample(seed, index).unwrap();
        assert_eq!(sample(1, 7), sample(1, 7));
        assert_ne!(sample(1, 7), sample(1, 8));
        assert_ne!(sample(1, 7), sample(2, 7));
    }
}
