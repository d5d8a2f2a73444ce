//! Bezier: patterns bounded by a cubic Bézier curve through the centre of the membrane.
//!
//! The third family of the source paper (Qin et al., doi 10.1089/soro.2024.0063), in which "two arbitrary points along
//! the edge and middle point" with two hyperparameters make the curve; the supplement with the details is not public.
//! Here P0 and P3 are uniform on the frame, M is the centre, and P1,2 = (8M − P0 − P3)/6 ∓ h (cos θ, sin θ), so that
//! B(½) = (P0 + 3P1 + 3P2 + P3)/8 = M for all h and θ. The direction θ is uniform in [0°, 360°), the reach h uniform in
//! [0, 25) cells (half the shorter side). A curve that crosses itself or leaves the membrane would not divide it in
//! two, and is drawn again. The left of the curve is active; P0 and P3 are exchangeable, so that is either side with
//! equal probability.
//!
//! By default the two ends lie on opposite sides of the frame. With [`Ends::Any`] a curve can cut off as little as 2 %
//! of the membrane; the largest displacement is then 1.5 ± 0.4 mm at κ = 0.0221. With opposite ends it is 1.79 ± 0.09
//! mm at an area fraction of 0.50 ± 0.08 (300 samples). That is near the paper's area fraction of ½ and near the top of
//! the displacement range, for which the paper introduces the family.
//!
//! With a given area, every point of the curve moves along its normal by the same distance until exactly that many
//! cells lie on the active side: cells are ranked by signed distance from the curve.

use std::f64::consts::TAU;

use super::canvas::Canvas;
use super::curve::{Cubic, on_frame};
use super::error::{ParameterError, SampleError, cells_at};
use super::family::{Family, FamilyParameters, MOST_SAMPLES, SampleGroup};
use super::membership::{edges, longer_side};
use deaflow_base::{Decimal, Stream, parameters, words};
use deaflow_pattern::Pattern;

/// Draws after which a straight line is used. Fewer than one draw in ten is rejected, so this only bounds the loop.
const MOST_DRAWS: u32 = 1000;

words! {
    /// Where on the frame a curve may end.
    pub enum Ends {
        /// On two opposite sides.
        Opposite = "opposite",
        /// Anywhere, independently.
        Any = "any",
    }
}

parameters! {
    /// Patterns on one side of a smooth curve through the centre.
    pub struct BezierParameters as "a bezier sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
        /// Electrode area, a share of the free membrane; without it the curve determines the area.
        pub area: Option<Decimal> [0.0..=1.0],
        /// Where on the frame a curve may end.
        pub ends: Ends = Ends::Opposite,
    }
}

impl FamilyParameters for BezierParameters {
    const NAME: &'static str = "bezier";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, ParameterError> {
        let family =
            Bezier::new(canvas, self.area.map(Decimal::to_f64), self.ends).map_err(ParameterError::of("area"))?;
        Ok(self.one_group(self.count, Box::new(family)))
    }

    /// A straight line meets a cubic curve at most three times.
    fn admits(pattern: &Pattern) -> bool {
        edges(pattern) <= 2 * 3 * longer_side(pattern)
    }
}

/// Patterns with one side of a Bézier curve active.
#[derive(Clone, Debug, PartialEq)]
pub struct Bezier {
    pub(super) canvas: Canvas,
    pub(super) ends: Ends,
    pub(super) active: Option<usize>,
}

impl Bezier {
    /// Creates the family with an area fraction; with `None` the curve stays at the centre and determines the area.
    ///
    /// # Errors
    /// When no cell or every cell would be active.
    pub fn new(canvas: Canvas, area: Option<f64>, ends: Ends) -> Result<Self, SampleError> {
        let active = area.map(|area| cells_at(area, &canvas)).transpose()?;
        Ok(Self { canvas, ends, active })
    }
}

impl Family for Bezier {
    fn name(&self) -> &'static str {
        BezierParameters::NAME
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let curve = draw_curve(&self.canvas, self.ends, stream);
        let mut active = curve.left_side();
        if let Some(count) = self.active {
            active = shifted_to(count, &self.canvas, &curve, &active);
        }
        self.canvas.pattern(&active)
    }
}

/// Draws a curve from frame to frame through the centre that stays inside and does not cross itself.
fn draw_curve(canvas: &Canvas, ends: Ends, stream: &mut Stream) -> Cubic {
    let centre = canvas.middle();
    let mut start = on_frame(canvas, 0.0);
    for _ in 0..MOST_DRAWS {
        let from = stream.range(0.0, 4.0);
        let to = match ends {
            Ends::Opposite => (from.floor() + 2.0 + stream.uniform()) % 4.0,
            Ends::Any => stream.range(0.0, 4.0),
        };
        start = on_frame(canvas, from);
        let end = on_frame(canvas, to);
        let (angle, reach) = (stream.range(0.0, TAU), stream.range(0.0, centre[0].min(centre[1])));
        let curve = through_centre(canvas, start, end, [reach * angle.cos(), reach * angle.sin()]);
        if !curve.crosses_itself() && curve.stays_inside() {
            return curve;
        }
    }
    let end = [0, 1].map(|k| 2.0 * centre[k] - start[k]);
    through_centre(canvas, start, end, [0.0, 0.0])
}

fn through_centre(canvas: &Canvas, start: [f64; 2], end: [f64; 2], reach: [f64; 2]) -> Cubic {
    let centre = canvas.middle();
    let middle: [f64; 2] = std::array::from_fn(|k| (8.0 * centre[k] - start[k] - end[k]) / 6.0);
    let control = |sign: f64| std::array::from_fn(|k| middle[k] + sign * reach[k]);
    Cubic([start, control(-1.0), control(1.0), end], canvas.clone())
}

/// Returns the `count` free cells that lie deepest on the active side; among equal depths the lower cell number comes
/// first.
fn shifted_to(count: usize, canvas: &Canvas, curve: &Cubic, active: &[bool]) -> Vec<bool> {
    let depths: Vec<f64> = curve
        .distances()
        .into_iter()
        .zip(active)
        .map(|(distance, &inside)| if inside { -distance } else { distance })
        .collect();
    let mut ranked = canvas.free_cells();
    ranked.sort_by(|&a, &b| depths[a].total_cmp(&depths[b]).then(a.cmp(&b)));
    let mut shifted = vec![false; active.len()];
    for &cell in &ranked[..count] {
        shifted[cell] = true;
    }
    shifted
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curves() -> impl Iterator<Item = Cubic> {
        let draw = |index| {
            let ends = [Ends::Opposite, Ends::Any][index as usize % 2];
            draw_curve(&Canvas::PAPER, ends, &mut Stream::new(4, "bezier", index))
        };
        (0..300).map(draw)
    }

    fn family(area: Option<f64>) -> Bezier {
        Bezier::new(Canvas::PAPER, area, Ends::Opposite).unwrap()
    }

    #[test]
    fn curves_pass_the_centre_and_end_on_the_frame() {
        for (index, curve) in curves().enumerate() {
            let middle = curve.at(0.5);
            assert!(middle.iter().all(|c| (c - 25.0).abs() < 1e-9), "{middle:?}");
            let (start, end) = (curve.at(0.0), curve.at(1.0));
            for point in [start, end] {
                assert!(point.iter().any(|&c| c == 0.0 || c == 50.0), "{point:?}");
            }
            let opposite = (0..2).any(|k| (start[k] - end[k]).abs() == 50.0);
            assert!(opposite || index % 2 == 1, "{start:?} {end:?}");
        }
    }

    #[test]
    fn no_curve_crosses_itself_or_leaves_the_membrane() {
        for curve in curves() {
            let points: Vec<_> = (0..=250).map(|i| curve.at(f64::from(i) / 250.0)).collect();
            assert!(points.iter().flatten().all(|&c| (-1e-9..=50.0 + 1e-9).contains(&c)));
            for (i, p) in points.windows(2).enumerate() {
                for q in points.windows(2).skip(i + 2) {
                    let turn = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
                        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
                    };
                    let apart = turn(p[0], p[1], q[0]) * turn(p[0], p[1], q[1]) >= 0.0
                        || turn(q[0], q[1], p[0]) * turn(q[0], q[1], p[1]) >= 0.0;
                    assert!(apart, "{curve:?}");
                }
            }
        }
    }

    #[test]
    fn the_boundary_runs_through_the_centre() {
        let family = family(None);
        for index in 0..200 {
            let pattern = family.sample(4, index).unwrap();
            // Some cell within three of the centre differs from another: the boundary is there.
            let near: Vec<bool> = (22..28)
                .flat_map(|y| (22..28).map(move |x| (x, y)))
                .map(|(x, y)| pattern.is_active(x, y))
                .collect();
            assert!(near.contains(&true) && near.contains(&false), "sample {index}");
        }
    }

    #[test]
    fn either_side_is_active_equally_often() {
        let family = family(None);
        let mean = (0..1000)
            .map(|i| family.sample(9, i).unwrap().area_fraction(None))
            .sum::<f64>()
            / 1000.0;
        assert!((mean - 0.5).abs() < 0.03, "mean area fraction {mean}");
        let corner = (0..1000)
            .filter(|&i| family.sample(9, i).unwrap().is_active(0, 0))
            .count();
        assert!((440..=560).contains(&corner), "{corner} of 1000 have the corner active");
    }

    #[test]
    fn a_given_area_is_met_exactly_on_the_same_side() {
        let free = family(None);
        for (area, cells) in [(0.5, 1250), (0.05, 125), (0.95, 2375)] {
            let family = family(Some(area));
            for index in 0..30 {
                let (pattern, at_centre) = (family.sample(4, index).unwrap(), free.sample(4, index).unwrap());
                assert_eq!(pattern.active_cells(), cells);
                // A shift only adds or only removes cells.
                let added = pattern
                    .cells()
                    .iter()
                    .zip(at_centre.cells())
                    .filter(|(a, b)| a > b)
                    .count();
                let removed = pattern
                    .cells()
                    .iter()
                    .zip(at_centre.cells())
                    .filter(|(a, b)| a < b)
                    .count();
                assert!(added == 0 || removed == 0);
            }
        }
        assert!(Bezier::new(Canvas::PAPER, Some(1.5), Ends::Any).is_err());
    }

    #[test]
    fn the_loop_ends_even_if_every_draw_is_rejected() {
        let ends = [0.3, 2.3].map(|position| on_frame(&Canvas::PAPER, position));
        let line = through_centre(&Canvas::PAPER, ends[0], ends[1], [0.0, 0.0]);
        assert!(!line.crosses_itself() && line.stays_inside());
        assert_eq!(line.left_side().iter().filter(|&&left| left).count(), 1250);
    }
}
