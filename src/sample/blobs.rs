//! Blobs: where a smooth random field is high.
//!
//! Like the stripes, patterns that no family of the source paper (Qin et al., doi 10.1089/soro.2024.0063) resembles: islands
//! and holes without any preferred place or direction, from a cell to a third of the membrane in size. White noise is
//! smoothed by a Gaussian whose standard deviation is drawn between 1 and 9 cells, uniformly in its logarithm, and the
//! highest cells are active, as many as an area fraction asks for that is drawn from a range, [0.3, 0.7] unless another is
//! given. The noise goes on beyond the frame, so the field is the same everywhere.

use super::areas::{AreaFractions, Areas, highest_of};
use super::canvas::Canvas;
use super::error::SampleError;
use super::family::{Family, FamilyError, FamilyParameters, MOST_SAMPLES, SampleGroup};
use super::membership::edges;
use deaflow_base::{Stream, parameters};
use deaflow_pattern::Pattern;

/// Standard deviation of the Gaussian, in cells.
const LENGTH: [f64; 2] = [1.0, 9.0];

/// Where the Gaussian is cut off, in standard deviations: what is beyond is below 0.3 % of it.
const REACH: f64 = 3.0;

/// More edges than a sample has. Neighbours in a Gaussian field that was smoothed over ℓ cells have the correlation
/// ρ = exp(−1/4ℓ²), and differ with the probability arccos(ρ)/π, where half of the cells are active, and less often elsewhere: for
/// ℓ = 1 that is 1057 of 4900 pairs. Of 4000 samples none had more than 1086.
const MOST_EDGES: usize = 1500;

parameters! {
    /// Islands and holes of any size: where a smooth random field is high.
    pub struct BlobsParameters as "a blobs sample" {
        /// Patterns to draw.
        pub count: u64 [1..=MOST_SAMPLES],
        /// Area fraction of the electrode, or smallest and largest to draw from.
        pub area: AreaFractions = [0.3, 0.7],
    }
}

impl FamilyParameters for BlobsParameters {
    const NAME: &'static str = "blobs";

    fn groups(&self, canvas: Canvas) -> Result<Vec<SampleGroup>, FamilyError> {
        let family = Blobs::new(self.area.areas(canvas)?);
        Ok(self.one_group(self.count, Box::new(family)))
    }

    /// Smooth regions have few edges.
    fn admits(pattern: &Pattern) -> bool {
        edges(pattern) <= MOST_EDGES
    }
}

/// Patterns of islands and holes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blobs {
    areas: Areas,
}

impl Blobs {
    /// The family at area fractions of a range.
    #[must_use]
    pub fn new(areas: Areas) -> Self {
        Self { areas }
    }
}

impl Family for Blobs {
    fn name(&self) -> &'static str {
        BlobsParameters::NAME
    }

    fn sample(&self, seed: u64, index: u64) -> Result<Pattern, SampleError> {
        let mut stream = Stream::new(seed, "blobs", index);
        let length = stream.range(LENGTH[0].ln(), LENGTH[1].ln()).exp();
        let area = self.areas.drawn(&mut stream);
        let canvas = self.areas.canvas();
        let field = smoothed(canvas, length, &mut stream);
        Ok(highest_of(canvas, area, field.into_iter()))
    }
}

/// White noise smoothed over a length, `[y][x]`, up to a factor.
fn smoothed(canvas: &Canvas, length: f64, stream: &mut Stream) -> Vec<f64> {
    let ([columns, rows], [width, height]) = (canvas.raster().sides(), canvas.cell());
    let [across, along] = [width, height].map(|cell| weights(length / cell));
    let [long, high] = [columns + across.len() - 1, rows + along.len() - 1];
    let smooth =
        |weights: &[f64], line: &[f64], at: usize| -> f64 { weights.iter().zip(&line[at..]).map(|(w, v)| w * v).sum() };
    // Smoothed along the rows, and laid out by columns.
    let mut turned = vec![0.0; columns * high];
    for row in 0..high {
        let noise: Vec<f64> = (0..long).map(|_| stream.normal()).collect();
        (0..columns).for_each(|x| turned[x * high + row] = smooth(&across, &noise, x));
    }
    let cell = |i: usize| smooth(&along, &turned[i % columns * high..][..high], i / columns);
    (0..columns * rows).map(cell).collect()
}

/// A Gaussian of a standard deviation in cells, as far as it is not cut off.
fn weights(deviation: f64) -> Vec<f64> {
    let reach = (REACH * deviation).ceil() as usize;
    let offset = |k: usize| (k as f64 - reach as f64) / deviation;
    (0..=2 * reach).map(|k| (-0.5 * offset(k).powi(2)).exp()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::CELLS;

    fn usual() -> Blobs {
        Blobs::new(Areas::new(Canvas::PAPER, 0.3, 0.7).unwrap())
    }

    fn drawn(family: &Blobs, seed: u64, index: u64) -> Pattern {
        family.sample(seed, index).unwrap()
    }

    #[test]
    fn the_field_is_correlated_over_its_length() {
        // The correlation of smoothed white noise at a distance d is exp(−d²/4ℓ²).
        for length in [1.0, 4.0] {
            let (mut product, mut square) = (0.0, 0.0);
            for index in 0..60 {
                let field = smoothed(&Canvas::PAPER, length, &mut Stream::new(3, "blob test", index));
                let d = length as usize;
                for at in (0..CELLS * CELLS).filter(|at| at % CELLS + d < CELLS) {
                    product += field[at] * field[at + d];
                    square += 0.5 * (field[at].powi(2) + field[at + d].powi(2));
                }
            }
            let found = product / square;
            assert!((found - (-0.25f64).exp()).abs() < 0.05, "{length}: {found}");
        }
    }

    #[test]
    fn areas_cover_the_range_and_a_single_one_is_met_exactly() {
        let areas: Vec<f64> = (0..200).map(|i| drawn(&usual(), 5, i).area_fraction()).collect();
        assert!(areas.iter().all(|area| (0.3..=0.7).contains(area)));
        let mean = areas.iter().sum::<f64>() / 200.0;
        // Uniform: mean 0.5, standard deviation 0.1155.
        assert!((mean - 0.5).abs() < 4.0 * 0.1155 / 200f64.sqrt(), "{mean}");
        let few = Blobs::new(Areas::new(Canvas::PAPER, 0.05, 0.05).unwrap());
        assert!((0..20).all(|i| drawn(&few, 1, i).active_cells() == 125));
    }

    #[test]
    fn samples_stay_what_they_are() {
        let cells: Vec<usize> = (0..6).map(|i| drawn(&usual(), 5, i).active_cells()).collect();
        assert_eq!(cells, [1482, 1475, 760, 1727, 1262, 979]);
    }

    #[test]
    fn a_sample_is_named_by_seed_and_index() {
        assert_eq!(drawn(&usual(), 1, 7), drawn(&usual(), 1, 7));
        assert_ne!(drawn(&usual(), 1, 7), drawn(&usual(), 1, 8));
        assert_ne!(drawn(&usual(), 1, 7), drawn(&usual(), 2, 7));
    }
}
