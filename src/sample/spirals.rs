//! Spirals: Archimedean arms about a point near the middle.
//!
//! Bands as stripes have them, whose direction turns all the way round and whose curvature grows inwards, without any symmetry of
//! the square. One to four arms, wound to the left or to the right, lie 2.5 to 16 cells apart, uniform; their centre is uniform
//! within 10 cells of the middle in x and y. Cells nearest to the middle lines of the arms are active, as many as an area
//! fraction asks for that is drawn from a range, [0.2, 0.8] unless another is given.

use std::f64::consts::TAU;

use super::areas::{AreaFractions, Areas, highest};
use super::canvas::Canvas;
use super::error::SampleError;
use super::family::{Family, FamilyError, FamilyParameters, MOST_SAMPLES, SampleGroup};
use deaflow_base::{Stream, parameters};
use deaflow_pattern::Pattern;

/// Distance between the middle lines of neighbouring arms, in cells.
const DISTANCE: [f64; 2] = [2.5, 16.0];

/// Most arms.
const ARMS: usize = 4;

/// How far the centre lies from the middle at most along x and y, in cells.
const OFFSET: f64 = 10.0;

parameters! {
    /// Archimedean spirals of one to four arms.
    pub struct SpiralsParameters as "a spirals sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
        /// Area fraction of the electrode, or smallest and largest to draw from.
        pub area: AreaFractions = [0.2, 0.8],
    }
}

impl FamilyParameters for SpiralsParameters {
    const NAME: &'static str = "spirals";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, FamilyError> {
        let family = Spirals::new(self.area.areas(canvas)?);
        Ok(self.one_group(self.count, Box::new(family)))
    }
}

/// Patterns of spiral arms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spirals {
    areas: Areas,
}

impl Spirals {
    /// The family at area fractions of a range.
    #[must_use]
    pub fn new(areas: Areas) -> Self {
        Self { areas }
    }
}

/// One set of arms.
struct Arms {
    /// How many, negative where they are wound the other way.
    turns: f64,
    distance: f64,
    centre: [f64; 2],
    phase: f64,
}

impl Arms {
    fn drawn(canvas: &Canvas, stream: &mut Stream) -> Self {
        let count = (1 + stream.index(ARMS)) as f64;
        let hand = if stream.chance(0.5) { 1.0 } else { -1.0 };
        Self {
            turns: hand * count,
            distance: stream.range(DISTANCE[0], DISTANCE[1]),
            centre: canvas.middle().map(|middle| middle + stream.range(-OFFSET, OFFSET)),
            phase: stream.range(0.0, TAU),
        }
    }

    /// 1 on the middle line of an arm, −1 midway between two.
    fn level(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x - self.centre[0], y - self.centre[1]);
        (self.turns * y.atan2(x) - TAU * x.hypot(y) / self.distance + self.phase).cos()
    }
}

impl Family for Spirals {
    fn name(&self) -> &'static str {
        SpiralsParameters::NAME
    }

    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        let mut stream = Stream::new(seed, "spirals", index);
        let canvas = self.areas.canvas();
        let arms = Arms::drawn(canvas, &mut stream);
        let area = self.areas.drawn(&mut stream);
        Ok(highest(canvas, area, |x, y| arms.level(x, y)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usual() -> Spirals {
        Spirals::new(Areas::new(Canvas::PAPER, 0.2, 0.8).unwrap())
    }

    fn drawn(seed: u64, index: u64) -> Pattern {
        usual().sample(seed, index).unwrap()
    }

    #[test]
    fn areas_cover_the_range_and_a_single_one_is_met_exactly() {
        let areas: Vec<f64> = (0..300).map(|i| drawn(5, i).area_fraction()).collect();
        assert!(areas.iter().all(|area| (0.2..=0.8).contains(area)));
        let mean = areas.iter().sum::<f64>() / 300.0;
        // Uniform: mean 0.5, standard deviation 0.1732.
        assert!((mean - 0.5).abs() < 4.0 * 0.1732 / 300f64.sqrt(), "{mean}");
        let third = Spirals::new(Areas::new(Canvas::PAPER, 0.3, 0.3).unwrap());
        assert!((0..20).all(|i| third.sample(1, i).unwrap().active_cells() == 750));
    }

    #[test]
    fn a_turn_between_two_arms_and_a_step_to_the_next_keep_the_level() {
        for index in 0..60 {
            let arms = Arms::drawn(&Canvas::PAPER, &mut Stream::new(2, "spirals", index));
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
    fn arms_and_hands_are_drawn_alike() {
        let turns: Vec<f64> = (0..400)
            .map(|i| Arms::drawn(&Canvas::PAPER, &mut Stream::new(8, "spirals", i)).turns)
            .collect();
        for count in [-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0] {
            let n = turns.iter().filter(|t| **t == count).count();
            // An eighth: 50 ± 6.6.
            assert!((22..=78).contains(&n), "{count}: {n}");
        }
    }

    #[test]
    fn a_sample_is_named_by_seed_and_index() {
        assert_eq!(drawn(1, 7), drawn(1, 7));
        assert_ne!(drawn(1, 7), drawn(1, 8));
        assert_ne!(drawn(1, 7), drawn(2, 7));
    }
}
