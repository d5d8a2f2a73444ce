//! Curves: regions bounded by one to three smooth random curves.
//!
//! The curves of the source paper (Qin et al., doi 10.1089/soro.2024.0063) all pass through the centre and halve the
//! membrane; these can lie anywhere, turn more often and cross. A curve is the graph of c + Σ aₘ sin(m π v / 50 + φₘ),
//! m = 1, 2, 3, over a line through the centre at a uniform angle: aₘ is normal with a standard deviation of 8/m cells,
//! φₘ uniform, and c uniform in [−12, 12) cells. Cells above an odd number of curves are active. By default the curves
//! determine the area. With a range of area fractions, cells are ranked by their height above the nearest curve, so
//! that the curves move apart or together until the drawn fraction is reached.

use std::f64::consts::{PI, TAU};

use super::areas::{AreaFractions, Areas, highest};
use super::canvas::Canvas;
use super::error::ParameterError;
use super::family::{Family, FamilyParameters, MOST_SAMPLES, SampleGroup};
use super::membership::{edges, longer_side};
use deaflow_base::{Stream, parameters};
use deaflow_pattern::Pattern;

/// The number of sine waves of a curve.
const WAVES: usize = 3;

/// Standard deviation of the first wave's amplitude, in cells.
const AMPLITUDE: f64 = 8.0;

/// The largest distance of a curve from the centre, without its waves, in cells.
const OFFSET: f64 = 12.0;

parameters! {
    /// Regions bounded by one to three smooth random curves.
    pub struct CurvesParameters as "a curves sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
        /// Electrode area, a share of the free membrane, or smallest and largest; without it the curves determine it.
        pub area: Option<AreaFractions>,
    }
}

impl FamilyParameters for CurvesParameters {
    const NAME: &'static str = "curves";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, ParameterError> {
        let areas = self.area.map(|area| area.areas(canvas.clone())).transpose()?;
        let family = Curves::new(canvas, areas);
        Ok(self.one_group(self.count, Box::new(family)))
    }

    /// Three curves that each row and column meets three times have 900 edges; the largest count in 8000 samples was
    /// 311.
    fn admits(pattern: &Pattern) -> bool {
        edges(pattern) <= 3 * 2 * 3 * longer_side(pattern)
    }
}

/// Patterns bounded by curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    canvas: Canvas,
    areas: Option<Areas>,
}

/// One curve, relative to the centre.
struct Graph {
    middle: [f64; 2],
    /// The shorter side.
    side: f64,
    sine: f64,
    cosine: f64,
    offset: f64,
    /// Amplitude and phase of each wave.
    waves: [(f64, f64); WAVES],
}

impl Graph {
    fn draw(canvas: &Canvas, stream: &mut Stream) -> Self {
        let [width, height] = canvas.size();
        let (sine, cosine) = stream.range(0.0, TAU).sin_cos();
        Self {
            middle: canvas.middle(),
            side: width.min(height),
            sine,
            cosine,
            offset: stream.range(-OFFSET, OFFSET),
            waves: std::array::from_fn(|m| {
                let amplitude = stream.normal() * AMPLITUDE / (m + 1) as f64;
                (amplitude, stream.range(0.0, TAU))
            }),
        }
    }

    /// Returns the height of a point above the curve.
    fn height(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x - self.middle[0], y - self.middle[1]);
        let (above, along) = (self.cosine * x + self.sine * y, self.cosine * y - self.sine * x);
        let wave = |(m, (amplitude, phase)): (usize, &(f64, f64))| {
            amplitude * ((m + 1) as f64 * PI * along / self.side + phase).sin()
        };
        above - self.offset - self.waves.iter().enumerate().map(wave).sum::<f64>()
    }
}

impl Curves {
    /// Creates the family with area fractions of a range; with `None` the curves determine the area.
    #[must_use]
    pub fn new(canvas: Canvas, areas: Option<Areas>) -> Self {
        Self { canvas, areas }
    }
}

impl Family for Curves {
    fn name(&self) -> &'static str {
        CurvesParameters::NAME
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let curves: Vec<Graph> = (0..1 + stream.index(3))
            .map(|_| Graph::draw(&self.canvas, stream))
            .collect();
        // The distance from the nearest curve, positive in active cells.
        let level = |x: f64, y: f64| {
            let heights = curves.iter().map(|curve| curve.height(x, y));
            let (nearest, odd) = heights.fold((f64::INFINITY, false), |(nearest, odd), height| {
                (nearest.min(height.abs()), odd ^ (height > 0.0))
            });
            if odd { nearest } else { -nearest }
        };
        match &self.areas {
            Some(areas) => highest(&self.canvas, areas.draw(stream), level),
            None => {
                let active: Vec<bool> = self.canvas.centres().map(|[x, y]| level(x, y) > 0.0).collect();
                self.canvas.pattern(&active)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::CELLS;

    fn usual() -> Curves {
        Curves::new(Canvas::PAPER, None)
    }

    fn drawn(family: &Curves, seed: u64, index: u64) -> Pattern {
        family.sample(seed, index).unwrap()
    }

    #[test]
    fn boundaries_are_few_and_smooth() {
        // Each curve crosses a row of cells a few times; single cells would change every second time.
        for index in 0..200 {
            let pattern = drawn(&usual(), 4, index);
            let pairs = (0..CELLS).flat_map(|y| (1..CELLS).map(move |x| (x, y)));
            let changes = pairs.filter(|&(x, y)| pattern.is_active(x, y) != pattern.is_active(x - 1, y));
            let changes = changes.count();
            assert!(changes < 450, "sample {index}: {changes}");
        }
    }

    #[test]
    fn areas_are_free_or_as_given() {
        let areas: Vec<f64> = (0..300).map(|i| drawn(&usual(), 5, i).area_fraction(None)).collect();
        let mean = areas.iter().sum::<f64>() / 300.0;
        let spread = (areas.iter().map(|a| (a - mean).powi(2)).sum::<f64>() / 300.0).sqrt();
        assert!(
            (mean - 0.5).abs() < 0.05 && (0.1..0.35).contains(&spread),
            "{mean} ± {spread}"
        );
        let tenth = Curves::new(Canvas::PAPER, Some(Areas::new(Canvas::PAPER, 0.1, 0.1).unwrap()));
        assert!((0..20).all(|i| drawn(&tenth, 1, i).active_cells() == 250));
    }

    #[test]
    fn an_area_moves_the_curves_and_keeps_their_form() {
        // What is active at a smaller area stays active at a larger one.
        let [small, large] = [0.3, 0.6].map(|a| {
            drawn(
                &Curves::new(Canvas::PAPER, Some(Areas::new(Canvas::PAPER, a, a).unwrap())),
                6,
                3,
            )
        });
        let cells = small.cells().iter().zip(large.cells());
        assert!(cells.into_iter().all(|(few, many)| few <= many));
    }

    #[test]
    fn samples_are_unchanged() {
        let cells: Vec<usize> = (0..6).map(|i| drawn(&usual(), 5, i).active_cells()).collect();
        assert_eq!(cells, [1036, 1648, 1680, 1482, 641, 979]);
    }
}
