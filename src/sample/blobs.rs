//! Blobs: where a smooth random field is high.
//!
//! Like stripes, these differ from all families of the source paper (Qin et al., doi 10.1089/soro.2024.0063): islands
//! and holes of any position and direction, from one cell to a third of the membrane in size. White noise is smoothed
//! by a Gaussian whose standard deviation is log-uniform in [1, 9] cells. The highest cells are active, as many as the
//! area fraction needs, which is uniform in a range (default [0.3, 0.7]). The noise continues beyond the frame, so that
//! the field has the same statistics everywhere.

use super::areas::highest_of;
use super::canvas::Canvas;
use super::family::{Family, family};
use super::membership::edges;
use deaflow_base::Stream;
use deaflow_pattern::Pattern;

/// Standard deviation of the Gaussian, in cells.
const LENGTH: [f64; 2] = [1.0, 9.0];

/// Where the Gaussian is cut off, in standard deviations; less than 0.3 % of it lies beyond.
const REACH: f64 = 3.0;

/// More edges than any sample has. Neighbours in a Gaussian field smoothed over ℓ cells have the correlation ρ =
/// exp(−1/4ℓ²). At an area fraction of ½ they differ with probability arccos(ρ)/π, at others less often: for ℓ = 1 that
/// is 1057 of 4900 pairs. The largest count in 4000 samples was 1086.
const MOST_EDGES: usize = 1500;

family! {
    /// Islands and holes of any size: where a smooth random field is high.
    Blobs, BlobsParameters as "a blobs sample", "blobs", area: [0.3, 0.7],
    admits: |pattern| edges(pattern) <= MOST_EDGES
}

impl Family for Blobs {
    fn name(&self) -> &'static str {
        "blobs"
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let length = stream.range(LENGTH[0].ln(), LENGTH[1].ln()).exp();
        let area = self.areas.draw(stream);
        let canvas = self.areas.canvas();
        highest_of(canvas, area, smoothed(canvas, length, stream).into_iter())
    }
}

/// Returns white noise smoothed over a length, `[y][x]`, up to a factor.
fn smoothed(canvas: &Canvas, length: f64, stream: &mut Stream) -> Vec<f64> {
    let ([columns, rows], [width, height]) = (canvas.raster().sides(), canvas.cell());
    let [across, along] = [width, height].map(|cell| weights(length / cell));
    let [long, high] = [columns + across.len() - 1, rows + along.len() - 1];
    let smooth =
        |weights: &[f64], line: &[f64], at: usize| -> f64 { weights.iter().zip(&line[at..]).map(|(w, v)| w * v).sum() };
    // Smoothed along the rows and transposed.
    let mut transposed = vec![0.0; columns * high];
    for row in 0..high {
        let noise: Vec<f64> = (0..long).map(|_| stream.normal()).collect();
        (0..columns).for_each(|x| transposed[x * high + row] = smooth(&across, &noise, x));
    }
    let cell = |i: usize| smooth(&along, &transposed[i % columns * high..][..high], i / columns);
    (0..columns * rows).map(cell).collect()
}

/// Returns the weights of a Gaussian with this standard deviation in cells, up to the cut-off.
fn weights(deviation: f64) -> Vec<f64> {
    let reach = (REACH * deviation).ceil() as usize;
    let offset = |k: usize| (k as f64 - reach as f64) / deviation;
    (0..=2 * reach).map(|k| (-0.5 * offset(k).powi(2)).exp()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Areas;
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
        let areas: Vec<f64> = (0..200).map(|i| drawn(&usual(), 5, i).area_fraction(None)).collect();
        assert!(areas.iter().all(|area| (0.3..=0.7).contains(area)));
        let mean = areas.iter().sum::<f64>() / 200.0;
        // Uniform: mean 0.5, standard deviation 0.1155.
        assert!((mean - 0.5).abs() < 4.0 * 0.1155 / 200f64.sqrt(), "{mean}");
        let few = Blobs::new(Areas::new(Canvas::PAPER, 0.05, 0.05).unwrap());
        assert!((0..20).all(|i| drawn(&few, 1, i).active_cells() == 125));
    }

    #[test]
    fn samples_are_unchanged() {
        let cells: Vec<usize> = (0..6).map(|i| drawn(&usual(), 5, i).active_cells()).collect();
        assert_eq!(cells, [1482, 1475, 760, 1727, 1262, 979]);
    }
}
