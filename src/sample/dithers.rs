//! Dithers: grey levels made of single cells, as a printer makes them.
//!
//! No other family alternates regularly from cell to cell: small grids do so at random, checkers rarely. A network that
//! was not trained on such patterns has an error several times as large on them as on its own, and so do coarse meshes.
//! The grey level is a plane: its mean is the area fraction, uniform in a range (default [0.3, 0.7]), and it falls by 0
//! to 0.6 over the side along a uniform direction. It is dithered by one of four methods with equal probability: the
//! threshold matrices of 2 × 2, 4 × 4 and 8 × 8 cells (Bayer, IEEE Int. Conf. Communications 1 (1973) 26-11), or error
//! diffusion along alternating rows (Floyd and Steinberg, Proc. SID 17 (1976) 75). The cells farthest above their
//! threshold are active, as many as the area fraction needs. The pattern is rotated and mirrored at random.

use std::f64::consts::TAU;

use super::areas::highest_of;
use super::family::{Family, family};
use deaflow_base::Stream;
use deaflow_pattern::{Bits, Pattern, Raster, Symmetry};

/// The largest fall of the grey level over the side.
const FALL: f64 = 0.6;

/// Side of the largest threshold matrix, as a power of two.
const LARGEST: usize = 3;

family! {
    /// Grey made of single cells: ordered dithers and error diffusion.
    Dithers, DithersParameters as "a dithers sample", "dithers", area: [0.3, 0.7]
}

impl Family for Dithers {
    fn name(&self) -> &'static str {
        "dithers"
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let method = stream.index(LARGEST + 1);
        let area = self.areas.draw(stream);
        let canvas = self.areas.canvas();
        let [width, height] = canvas.size();
        let fall = stream.range(0.0, FALL) / width.min(height);
        let (sine, cosine) = stream.range(0.0, TAU).sin_cos();
        let [right, up] = [stream.index(1 << LARGEST), stream.index(1 << LARGEST)];
        let image = Symmetry::ALL[stream.index(Symmetry::ALL.len())];
        let ([middle_x, middle_y], columns) = (canvas.middle(), canvas.raster().columns());
        let grey = |[x, y]: [f64; 2]| area + fall * (cosine * (x - middle_x) + sine * (y - middle_y));
        let levels: Vec<f64> = canvas.centres().map(grey).collect();
        let levels = if method < LARGEST {
            let order = method + 1;
            let less =
                |(cell, level): (usize, f64)| level - threshold(order, cell % columns + right, cell / columns + up);
            levels.into_iter().enumerate().map(less).collect()
        } else {
            diffused(canvas.raster(), levels)
        };
        // A quarter turn of a rectangle would not fit.
        let fits = canvas.raster().transformed(image) == canvas.raster();
        let image = if fits { image } else { Symmetry::IDENTITY };
        // The cells that the image moves to free ones.
        let free = canvas
            .free()
            .map(|free| Bits::of(&free.pattern().transformed(image.inverse())));
        let canvas = canvas.clone().with_free(free);
        highest_of(&canvas, area, levels.into_iter()).transformed(image)
    }
}

/// Returns the threshold of a cell in Bayer's matrix of 2ⁿ × 2ⁿ cells, between 0 and 1.
fn threshold(order: usize, x: usize, y: usize) -> f64 {
    let digit = |bit: usize| {
        let (x, y) = (x >> bit & 1, y >> bit & 1);
        (2 * (x ^ y) + y) << (2 * (order - 1 - bit))
    };
    let rank: usize = (0..order).map(digit).sum();
    (rank as f64 + 0.5) / (1 << (2 * order)) as f64
}

/// Returns the levels after error diffusion with Floyd and Steinberg's weights, `[y][x]`; every other row runs
/// backwards.
fn diffused(raster: Raster, mut levels: Vec<f64>) -> Vec<f64> {
    let [columns, rows] = raster.sides();
    for y in 0..rows {
        let ahead: isize = if y % 2 == 0 { 1 } else { -1 };
        for step in 0..columns {
            let x = if ahead > 0 { step } else { columns - 1 - step };
            let level = levels[y * columns + x];
            let error = level - f64::from(u8::from(level >= 0.5));
            for (dx, dy, weight) in [(ahead, 0, 7.0), (-ahead, 1, 3.0), (0, 1, 5.0), (ahead, 1, 1.0)] {
                if let Some(u) = x.checked_add_signed(dx).filter(|u| *u < columns)
                    && y + dy < rows
                {
                    levels[(y + dy) * columns + u] += error * weight / 16.0;
                }
            }
        }
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Areas, Canvas};
    use deaflow_pattern::CELLS;

    fn usual() -> Dithers {
        Dithers::new(Areas::new(Canvas::PAPER, 0.3, 0.7).unwrap())
    }

    fn drawn(family: &Dithers, seed: u64, index: u64) -> Pattern {
        family.sample(seed, index).unwrap()
    }

    #[test]
    fn areas_cover_the_range_and_a_single_one_is_met_exactly() {
        let areas: Vec<f64> = (0..300).map(|i| drawn(&usual(), 5, i).area_fraction(None)).collect();
        assert!(areas.iter().all(|area| (0.3..=0.7).contains(area)));
        let mean = areas.iter().sum::<f64>() / 300.0;
        // Uniform: mean 0.5, standard deviation 0.1155.
        assert!((mean - 0.5).abs() < 4.0 * 0.1155 / 300f64.sqrt(), "{mean}");
        let fifth = Dithers::new(Areas::new(Canvas::PAPER, 0.2, 0.2).unwrap());
        assert!((0..40).all(|i| drawn(&fifth, 1, i).active_cells() == 500));
    }

    #[test]
    fn thresholds_are_those_of_the_known_matrices() {
        let matrix = |order: usize| -> Vec<usize> {
            let side = 1 << order;
            let place = |cell: usize| threshold(order, cell % side, cell / side) * (side * side) as f64;
            (0..side * side).map(|cell| place(cell) as usize).collect()
        };
        assert_eq!(matrix(1), [0, 2, 3, 1]);
        assert_eq!(matrix(2), [0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5]);
        let mut all = matrix(3);
        all.sort_unstable();
        assert!(all.into_iter().eq(0..64));
    }

    #[test]
    fn the_edge_is_far_longer_than_that_of_random_cells() {
        let edge = |pattern: &Pattern| {
            let differs = |x: usize, y: usize| {
                let here = pattern.is_active(x, y);
                let right = x + 1 < CELLS && pattern.is_active(x + 1, y) != here;
                let above = y + 1 < CELLS && pattern.is_active(x, y + 1) != here;
                usize::from(right) + usize::from(above)
            };
            (0..CELLS * CELLS).map(|i| differs(i % CELLS, i / CELLS)).sum::<usize>() as f64
        };
        let half = Dithers::new(Areas::new(Canvas::PAPER, 0.5, 0.5).unwrap());
        let mean = (0..60).map(|i| edge(&drawn(&half, 4, i))).sum::<f64>() / 60.0;
        // Of random cells every other side is an edge.
        let random = 0.5 * (2 * CELLS * (CELLS - 1)) as f64;
        assert!(mean > 1.3 * random, "{mean} {random}");
    }

    #[test]
    fn the_mean_grey_level_is_preserved() {
        // The mean of error diffusion over blocks follows the plane.
        let plane = Canvas::PAPER.centres().map(|[x, _]| x / CELLS as f64);
        let levels = diffused(Raster::PAPER, plane.collect());
        let share = |from: usize| {
            let cells = (0..CELLS).flat_map(|y| (from..from + 10).map(move |x| y * CELLS + x));
            cells.filter(|&cell| levels[cell] >= 0.5).count() as f64 / (10 * CELLS) as f64
        };
        for block in 0..5 {
            let expected = (10.0 * f64::from(block) + 5.0) / 50.0;
            let found = share(10 * block as usize);
            assert!((found - expected).abs() < 0.03, "block {block}: {found}");
        }
    }
}
