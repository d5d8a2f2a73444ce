//! Spirals: Archimedean spiral arms around a point near the middle.
//!
//! Bands of all directions whose curvature grows inwards, without any symmetry of the square. The number of arms is 1
//! to 4, wound to the left or to the right; the distance between arms is uniform in [2.5, 16] cells, and the centre
//! uniform within 10 cells of the middle in x and y. The cells nearest to the centre lines of the arms are active, as
//! many as the area fraction needs, which is uniform in a range (default [0.2, 0.8]).

use std::f64::consts::TAU;

use super::areas::highest;
use super::canvas::Canvas;
use super::family::{Family, family};
use deaflow_base::Stream;
use deaflow_pattern::Pattern;

/// Distance between the centre lines of neighbouring arms, in cells.
const DISTANCE: [f64; 2] = [2.5, 16.0];

/// The largest number of arms.
const ARMS: usize = 4;

/// The largest distance of the centre from the middle along x and y, in cells.
const OFFSET: f64 = 10.0;

family! {
    /// Archimedean spirals of one to four arms.
    Spirals, SpiralsParameters as "a spirals sample", "spirals", area: [0.2, 0.8]
}

/// The arms of one pattern.
struct Arms {
    /// Their number; negative for the other direction of winding.
    turns: f64,
    distance: f64,
    centre: [f64; 2],
    phase: f64,
}

impl Arms {
    fn draw(canvas: &Canvas, stream: &mut Stream) -> Self {
        let count = (1 + stream.index(ARMS)) as f64;
        let direction = if stream.chance(0.5) { 1.0 } else { -1.0 };
        Self {
            turns: direction * count,
            distance: stream.range(DISTANCE[0], DISTANCE[1]),
            centre: canvas.middle().map(|middle| middle + stream.range(-OFFSET, OFFSET)),
            phase: stream.range(0.0, TAU),
        }
    }

    /// Returns 1 on the centre line of an arm, −1 midway between two.
    fn level(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x - self.centre[0], y - self.centre[1]);
        (self.turns * y.atan2(x) - TAU * x.hypot(y) / self.distance + self.phase).cos()
    }
}

impl Family for Spirals {
    fn name(&self) -> &'static str {
        "spirals"
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let canvas = self.areas.canvas();
        let arms = Arms::draw(canvas, stream);
        let area = self.areas.draw(stream);
        highest(canvas, area, |x, y| arms.level(x, y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Areas;

    fn usual() -> Spirals {
        Spirals::new(Areas::new(Canvas::PAPER, 0.2, 0.8).unwrap())
    }

    fn drawn(seed: u64, index: u64) -> Pattern {
        usual().sample(seed, index).unwrap()
    }

    #[test]
    fn areas_cover_the_range_and_a_single_one_is_met_exactly() {
        let areas: Vec<f64> = (0..300).map(|i| drawn(5, i).area_fraction(None)).collect();
        assert!(areas.iter().all(|area| (0.2..=0.8).contains(area)));
        let mean = areas.iter().sum::<f64>() / 300.0;
        // Uniform: mean 0.5, standard deviation 0.1732.
        assert!((mean - 0.5).abs() < 4.0 * 0.1732 / 300f64.sqrt(), "{mean}");
        let third = Spirals::new(Areas::new(Canvas::PAPER, 0.3, 0.3).unwrap());
        assert!((0..20).all(|i| third.sample(1, i).unwrap().active_cells() == 750));
    }

    #[test]
    fn the_level_is_periodic_from_arm_to_arm() {
        for index in 0..60 {
            let arms = Arms::draw(&Canvas::PAPER, &mut Stream::new(2, "spirals", index));
            let [x, y] = arms.centre;
            for (angle, radius) in [(0.3f64, 6.0), (2.0, 11.0), (4.4, 17.5)] {
                let at = |angle: f64, radius: f64| arms.level(x + radius * angle.cos(), y + radius * angle.sin());
                let here = at(angle, radius);
                assert!((here - at(angle + TAU / arms.turns.abs(), radius)).abs() < 1e-9);
                assert!((here - at(angle, radius + arms.distance)).abs() < 1e-9);
                // An arm winds outwards, by the distance of all arms in a whole turn.
                let turned = at(angle + 0.3, radius + 0.3 * arms.turns * arms.distance / TAU);
                assert!((here - turned).abs() < 1e-9, "sample {index}");
            }
        }
    }

    #[test]
    fn numbers_of_arms_and_directions_are_equally_frequent() {
        let turns: Vec<f64> = (0..400)
            .map(|i| Arms::draw(&Canvas::PAPER, &mut Stream::new(8, "spirals", i)).turns)
            .collect();
        for count in [-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0] {
            let n = turns.iter().filter(|t| **t == count).count();
            // An eighth: 50 ± 6.6.
            assert!((22..=78).contains(&n), "{count}: {n}");
        }
    }
}
