//! Squares of the least width that may be flipped, where single units may not.

use super::units::Units;

/// The cells of a membrane in squares, one from each cell, that are wholly among the units.
pub(super) struct Squares {
    squares: Vec<Vec<usize>>,
}

impl Squares {
    /// For units that are cells, squares of so many columns and rows.
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

    /// What turning each square on (or off) flips: its units that are not so yet, with the sum of their gains, the most
    /// profitable first, at most so many.
    pub(super) fn best(&self, on: &[bool], gains: &[f64], state: bool, most: usize) -> Vec<(f64, Vec<usize>)> {
        let flipped = |square: &Vec<usize>| {
            let units: Vec<usize> = square.iter().copied().filter(|&unit| on[unit] != state).collect();
            let gain: f64 = units.iter().map(|&unit| gains[unit]).sum();
            (!units.is_empty() && gain.is_finite()).then_some((gain, units))
        };
        let mut best: Vec<(f64, Vec<usize>)> = self.squares.iter().filter_map(flipped).collect();
        best.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| a.1.cmp(&b.1)));
        best.dedup_by(|a, b| a.1 == b.1);
        best.truncate(most);
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Raster;

    #[test]
    fn a_square_turns_over_what_is_not_as_it_will_be() {
        let units = Units::new([50; 2], Raster::PAPER, &[true; 2500]);
        let squares = Squares::new(&units, [3; 2]);
        assert_eq!(squares.squares.len(), 48 * 48);
        let on: Vec<bool> = (0..2500).map(|cell| cell % 50 < 10).collect();
        let gains: Vec<f64> = (0..2500).map(|cell| if cell % 50 == 10 { 1.0 } else { -1.0 }).collect();
        // One column beyond the edge gains, two columns beyond it lose again.
        let best = squares.best(&on, &gains, true, 1);
        assert_eq!(best[0].0, 3.0);
        assert!(best[0].1.iter().all(|unit| unit % 50 == 10) && best[0].1.len() == 3);
        assert!(
            squares
                .best(&on, &gains, false, 5)
                .iter()
                .all(|(gain, units)| *gain == -(units.len() as f64))
        );
    }
}
