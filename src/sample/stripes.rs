//! Stripes: parallel bands at any angle.
//!
//! A surrogate is trained on the families of the source paper (Qin et al., doi 10.1089/soro.2024.0063), so new samples
//! of these do not show its error on other patterns. This family does. The angle is uniform in [0°, 180°), the period
//! in [3, 40) cells, the phase in a period, and the area fraction in a range (default [0.2, 0.8]). The cells nearest to
//! the centre lines of the bands are active, as many as the area fraction needs.

use std::f64::consts::{PI, TAU};

use super::areas::highest;
use super::family::{Family, family};
use deaflow_base::Stream;
use deaflow_pattern::Pattern;

/// Period of the bands, in cells.
const PERIOD: [f64; 2] = [3.0, 40.0];

family! {
    /// Parallel bands at any angle and period.
    Stripes, StripesParameters as "a stripes sample", "stripes", area: [0.2, 0.8]
}

impl Family for Stripes {
    fn name(&self) -> &'static str {
        "stripes"
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let (sine, cosine) = stream.range(0.0, PI).sin_cos();
        let period = stream.range(PERIOD[0], PERIOD[1]);
        let phase = stream.range(0.0, TAU);
        let area = self.areas.draw(stream);
        let level = |x: f64, y: f64| ((cosine * x + sine * y) * TAU / period + phase).cos();
        highest(self.areas.canvas(), area, level)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Areas, Canvas};
    use deaflow_pattern::CELLS;

    fn usual() -> Stripes {
        Stripes::new(Areas::new(Canvas::PAPER, 0.2, 0.8).unwrap())
    }

    fn drawn(family: &Stripes, seed: u64, index: u64) -> Pattern {
        family.sample(seed, index).unwrap()
    }

    #[test]
    fn areas_cover_the_range_and_a_single_one_is_met_exactly() {
        let areas: Vec<f64> = (0..300).map(|i| drawn(&usual(), 5, i).area_fraction(None)).collect();
        assert!(areas.iter().all(|area| (0.2..=0.8).contains(area)));
        let mean = areas.iter().sum::<f64>() / 300.0;
        // Uniform: mean 0.5, standard deviation 0.1732.
        assert!((mean - 0.5).abs() < 4.0 * 0.1732 / 300f64.sqrt(), "{mean}");
        let fifth = Stripes::new(Areas::new(Canvas::PAPER, 0.2, 0.2).unwrap());
        assert!((0..20).all(|i| drawn(&fifth, 1, i).active_cells() == 500));
    }

    #[test]
    fn bands_are_straight_and_parallel() {
        // Two cells whose offset is along the bands, to a tenth of a cell, have the same state but at the edge of a
        // band.
        for index in 0..40 {
            let pattern = drawn(&usual(), 2, index);
            let mut stream = Stream::new(2, "stripes", index);
            let (sine, cosine) = stream.range(0.0, PI).sin_cos();
            let steps = (1..CELLS).map(|n| n as f64).map(|n| (-sine * n, cosine * n));
            let near = |v: f64| (v - v.round()).abs() < 0.1;
            let Some((dx, dy)) = steps.into_iter().find(|(dx, dy)| near(*dx) && near(*dy)) else {
                continue;
            };
            let (dx, dy) = (dx.round() as isize, dy.round() as isize);
            let (mut equal, mut all) = (0, 0);
            for y in 0..CELLS {
                for x in 0..CELLS {
                    let other = (x.checked_add_signed(dx), y.checked_add_signed(dy));
                    if let (Some(u), Some(v)) = other
                        && u < CELLS
                        && v < CELLS
                    {
                        all += 1;
                        equal += usize::from(pattern.is_active(x, y) == pattern.is_active(u, v));
                    }
                }
            }
            assert!(equal as f64 >= 0.9 * f64::from(all), "sample {index}: {equal} of {all}");
        }
    }

    #[test]
    fn samples_are_unchanged() {
        let cells: Vec<usize> = (0..6).map(|i| drawn(&usual(), 5, i).active_cells()).collect();
        assert_eq!(cells, [1034, 1603, 1340, 699, 541, 1618]);
    }
}
