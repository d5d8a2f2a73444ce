//! Diagonals: bands at 45 degrees, whose edges are staircases of single cells.
//!
//! Stripes rarely have this angle, at which a band of one cell is connected by corners only. The period along a row is
//! 2 to 12 cells and the width 1 to period − 1, both uniform integers. Bands are parallel, mirrored at a line of cells
//! (chevrons), or crossing, with equal probability. Crossing bands have a period of at least 3 and a width of at most
//! half of it, so that bare cells are left.

use super::family::{Family, family};
use deaflow_base::Stream;
use deaflow_pattern::{Pattern, Raster};

/// Longest period along a row, in cells.
const PERIOD: usize = 12;

family! {
    /// Bands, chevrons and lattices at 45 degrees.
    Diagonals, DiagonalsParameters as "a diagonals sample", "diagonals"
}

/// The arrangement of the bands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Arrangement {
    Parallel,
    /// Mirrored at a column.
    Chevrons(usize),
    /// A second set of bands with a phase of its own.
    Crossing(usize),
}

/// The bands of one pattern.
#[derive(Clone, Copy, Debug)]
struct Bands {
    /// Cells along the longer side.
    longer: usize,
    period: usize,
    width: usize,
    phase: usize,
    arrangement: Arrangement,
    /// Whether rows and columns are exchanged.
    transposed: bool,
    /// Whether bands fall from left to right.
    falling: bool,
}

impl Bands {
    fn draw(raster: Raster, stream: &mut Stream) -> Self {
        let longer = raster.columns().max(raster.rows());
        let arrangement = stream.index(3);
        let least = if arrangement == 2 { 3 } else { 2 };
        let period = least + stream.index(PERIOD + 1 - least);
        let widest = if arrangement == 2 { period / 2 } else { period - 1 };
        let width = 1 + stream.index(widest);
        Self {
            longer,
            period,
            width,
            phase: stream.index(period),
            arrangement: match arrangement {
                0 => Arrangement::Parallel,
                1 => Arrangement::Chevrons(stream.index(longer)),
                _ => Arrangement::Crossing(stream.index(period)),
            },
            transposed: stream.chance(0.5),
            falling: stream.chance(0.5),
        }
    }

    fn is_active(&self, x: usize, y: usize) -> bool {
        let (x, y) = if self.transposed { (y, x) } else { (x, y) };
        // Adding whole periods keeps the sum positive.
        let around = self.longer.next_multiple_of(self.period);
        let rising = |x: usize, phase: usize| (x + around - y + phase) % self.period < self.width;
        let falling = |x: usize, phase: usize| (x + y + phase) % self.period < self.width;
        let own = |x: usize| {
            if self.falling {
                falling(x, self.phase)
            } else {
                rising(x, self.phase)
            }
        };
        match self.arrangement {
            Arrangement::Parallel => own(x),
            Arrangement::Chevrons(column) => own(x.abs_diff(column)),
            Arrangement::Crossing(phase) => rising(x, self.phase) || falling(x, phase),
        }
    }
}

impl Family for Diagonals {
    fn name(&self) -> &'static str {
        "diagonals"
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let raster = self.canvas.raster();
        let bands = Bands::draw(raster, stream);
        Pattern::from_fn(raster, |x, y| bands.is_active(x, y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Canvas;
    use deaflow_pattern::CELLS;

    fn drawn(seed: u64, index: u64) -> (Bands, Pattern) {
        let bands = Bands::draw(Raster::PAPER, &mut Stream::new(seed, "diagonals", index));
        (bands, Diagonals::new(Canvas::PAPER).sample(seed, index).unwrap())
    }

    #[test]
    fn a_step_along_a_diagonal_keeps_the_state() {
        let mut kinds = [0; 3];
        for index in 0..150 {
            let (bands, pattern) = drawn(2, index);
            let inner = || (1..CELLS - 1).flat_map(|y| (1..CELLS - 1).map(move |x| (x, y)));
            let up = inner().all(|(x, y)| pattern.is_active(x, y) == pattern.is_active(x + 1, y + 1));
            let down = inner().all(|(x, y)| pattern.is_active(x, y) == pattern.is_active(x + 1, y - 1));
            let ahead = |x: usize, y: usize| pattern.is_active(x, y) == pattern.is_active(x + bands.period, y);
            let whole = (0..CELLS).all(|y| (0..CELLS - bands.period).all(|x| ahead(x, y)));
            match bands.arrangement {
                Arrangement::Parallel => assert!(whole && (up || down), "sample {index}: {bands:?}"),
                Arrangement::Chevrons(_) => {}
                Arrangement::Crossing(_) => assert!(whole, "sample {index}: {bands:?}"),
            }
            kinds[match bands.arrangement {
                Arrangement::Parallel => 0,
                Arrangement::Chevrons(_) => 1,
                Arrangement::Crossing(_) => 2,
            }] += 1;
        }
        // A third each: 50 ± 6.
        assert!(kinds.iter().all(|n| (26..=74).contains(n)), "{kinds:?}");
    }

    #[test]
    fn chevrons_are_their_own_image() {
        let mut seen = 0;
        for index in 0..200 {
            let (bands, pattern) = drawn(4, index);
            let Arrangement::Chevrons(line) = bands.arrangement else {
                continue;
            };
            let state = |a: usize, b: usize| match bands.transposed {
                true => pattern.is_active(b, a),
                false => pattern.is_active(a, b),
            };
            for step in 1..=line.min(CELLS - 1 - line) {
                assert!((0..CELLS).all(|k| state(line - step, k) == state(line + step, k)));
            }
            seen += 1;
        }
        assert!(seen > 30, "{seen}");
    }

    #[test]
    fn parallel_bands_have_their_share_and_none_is_empty_or_full() {
        for index in 0..300 {
            let (bands, pattern) = drawn(6, index);
            let area = pattern.area_fraction(None);
            assert!((0.04..=0.96).contains(&area), "sample {index}: {area}");
            if bands.arrangement == Arrangement::Parallel {
                let expected = bands.width as f64 / bands.period as f64;
                assert!((area - expected).abs() < 0.03, "sample {index}: {area} {expected}");
            }
        }
    }
}
