//! Squares of the minimum width, which can be changed if single units cannot.

use super::gains::{Change, Gains};
use super::units::Units;

/// All squares that consist of units, one for each lower left cell.
pub(super) struct Squares {
    squares: Vec<Vec<usize>>,
}

impl Squares {
    /// Squares of a number of columns and rows, for units that are cells.
    pub(super) fn new(units: &Units, [wide, high]: [usize; 2]) -> Self {
        let [columns, rows] = units.raster().sides();
        let mut unit_of = vec![None; columns * rows];
        for unit in 0..units.count() {
            units.cells(unit).iter().for_each(|&cell| unit_of[cell] = Some(unit));
        }
        let last = [columns + 1 - wide.min(columns), rows + 1 - high.min(rows)];
        let square = |(x, y): (usize, usize)| -> Option<Vec<usize>> {
            let cells = (0..wide * high).map(|k| (y + k / wide) * columns + x + k % wide);
            cells.map(|cell| *unit_of.get(cell)?).collect()
        };
        let corners = (0..last[0] * last[1]).map(|k| (k % last[0], k / last[0]));
        Self {
            squares: corners.filter_map(square).collect(),
        }
    }

    /// The changes that move each square to a group (0 for bare), with the sum of their gains: the `count` best, the
    /// best first.
    pub(super) fn best(&self, on: &[u8], gains: &Gains, to: u8, count: usize) -> Vec<(f64, Vec<Change>)> {
        let changed = |square: &Vec<usize>| {
            let units = square.iter().copied().filter(|&unit| on[unit] != to);
            let changes: Vec<Change> = units.map(|unit| Change { unit, to }).collect();
            let gain: f64 = changes.iter().map(|&change| gains.of(change)).sum();
            (!changes.is_empty() && gain.is_finite()).then_some((gain, changes))
        };
        let units = |changes: &[Change]| -> Vec<usize> { changes.iter().map(|change| change.unit).collect() };
        let mut best: Vec<(f64, Vec<Change>)> = self.squares.iter().filter_map(changed).collect();
        best.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| units(&a.1).cmp(&units(&b.1))));
        best.dedup_by(|a, b| a.1 == b.1);
        best.truncate(count);
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::{Bits, Raster};

    #[test]
    fn a_square_changes_units_of_other_groups_only() {
        let units = Units::new([50; 2], &Bits::full(Raster::PAPER));
        let squares = Squares::new(&units, [3; 2]);
        assert_eq!(squares.squares.len(), 48 * 48);
        let on: Vec<u8> = (0..2500).map(|cell| u8::from(cell % 50 < 10)).collect();
        let mut gains = Gains::uniform(&on, 1, -1.0);
        (0..2500)
            .filter(|cell| cell % 50 == 10)
            .for_each(|unit| gains.set(Change { unit, to: 1 }, 1.0));
        // One column beyond the edge gains, two columns beyond it lose again.
        let best = squares.best(&on, &gains, 1, 1);
        assert_eq!(best[0].0, 3.0);
        assert!(best[0].1.iter().all(|change| change.unit % 50 == 10) && best[0].1.len() == 3);
        assert!(
            squares
                .best(&on, &gains, 0, 5)
                .iter()
                .all(|(gain, units)| *gain == -(units.len() as f64))
        );
    }
}
