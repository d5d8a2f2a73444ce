//! Checker: a checkerboard of any period and offset.
//!
//! Alternating squares have the longest electrode edge that a period allows, and neighbours pull against each other, so
//! displacements are small and errors on coarse meshes are largest. The period, two squares, is uniform in [2, 12]
//! cells, the offset uniform in a period, and the area fraction uniform in a range (default [0.3, 0.7]). At ½ the
//! squares meet at their corners; below ½ they are islands, above they leave holes.

use std::f64::consts::TAU;

use super::areas::highest;
use super::family::{Family, family};
use deaflow_base::Stream;
use deaflow_pattern::Pattern;

/// Period of the board, in cells.
const PERIOD: [f64; 2] = [2.0, 12.0];

family! {
    /// Checkerboards of any period and offset.
    Checker, CheckerParameters as "a checker sample", "checker", area: [0.3, 0.7]
}

impl Family for Checker {
    fn name(&self) -> &'static str {
        "checker"
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let period = stream.range(PERIOD[0], PERIOD[1]);
        let [across, along] = [stream.range(0.0, TAU), stream.range(0.0, TAU)];
        let area = self.areas.draw(stream);
        let wave = |cells: f64, phase: f64| (TAU * cells / period + phase).cos();
        highest(self.areas.canvas(), area, |x, y| wave(x, across) * wave(y, along))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Areas, Canvas};
    use deaflow_pattern::CELLS;

    fn at_half(index: u64) -> Pattern {
        let family = Checker::new(Areas::new(Canvas::PAPER, 0.5, 0.5).unwrap());
        family.sample(3, index).unwrap()
    }

    #[test]
    fn areas_cover_the_range_and_a_single_one_is_met_exactly() {
        let usual = Checker::new(Areas::new(Canvas::PAPER, 0.3, 0.7).unwrap());
        let areas: Vec<f64> = (0..200)
            .map(|i| usual.sample(5, i).unwrap().area_fraction(None))
            .collect();
        assert!(areas.iter().all(|area| (0.3..=0.7).contains(area)));
        let mean = areas.iter().sum::<f64>() / 200.0;
        // Uniform: mean 0.5, standard deviation 0.1155.
        assert!((mean - 0.5).abs() < 4.0 * 0.1155 / 200f64.sqrt(), "{mean}");
        assert!((0..20).all(|i| at_half(i).active_cells() == 1250));
    }

    #[test]
    fn the_state_alternates_every_half_period() {
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
}
