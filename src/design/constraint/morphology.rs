//! Opening and closing of bit patterns by a square (Serra, Image Analysis and Mathematical Morphology, 1982), and their
//! connected components.

use crate::pattern::{Bits, CELLS};

/// The places of an n × n square, by its lower left cell, in which it lies within the pattern.
pub(super) fn eroded(bits: &Bits, n: usize) -> Bits {
    let rows = bits.rows().map(|row| (1..n).fold(row, |met, shift| met & row >> shift));
    Bits::from_rows(|y| (y..y + n).fold(u64::MAX, |met, j| met & rows.get(j).copied().unwrap_or(0)))
}

/// All cells of the n × n squares whose lower left cells are given.
pub(super) fn dilated(bits: &Bits, n: usize) -> Bits {
    let rows = bits.rows().map(|row| (1..n).fold(row, |met, shift| met | row << shift));
    Bits::from_rows(|y| rows[(y + 1).saturating_sub(n)..=y].iter().fold(0, |met, row| met | row))
}

/// What n × n squares within the pattern and the membrane cover of it: all but what is narrower.
pub(super) fn opened(bits: &Bits, n: usize) -> Bits {
    dilated(&eroded(bits, n), n)
}

/// The pattern with those gaps that no n × n square within the gap covers; outside of the membrane all is gap.
pub(super) fn closed(bits: &Bits, n: usize) -> Bits {
    // Words wide enough for what a square beyond the frame covers: 50 + 49 cells.
    let mut grown = [0u128; 2 * CELLS];
    for (y, &row) in bits.rows().iter().enumerate() {
        let row = u128::from(row);
        let spread = (1..n).fold(row, |met, shift| met | row << shift);
        grown[y..y + n].iter_mut().for_each(|word| *word |= spread);
    }
    let rows = grown.map(|row| (1..n).fold(row, |met, shift| met & row >> shift));
    Bits::from_rows(|y| rows[y..y + n].iter().fold(u128::MAX, |met, row| met & row) as u64)
}

/// The pattern and the cells beside it, corner to corner too.
pub(super) fn grown(bits: &Bits) -> Bits {
    let rows = bits.rows().map(|row| row | row << 1 | row >> 1);
    let near = |y: usize| rows[y.saturating_sub(1)..(y + 2).min(CELLS)].iter();
    Bits::from_rows(|y| near(y).fold(0, |met, row| met | row))
}

/// The pattern and the cells that share a side with it.
pub(super) fn spread(bits: &Bits) -> Bits {
    let rows = bits.rows();
    let above = |y: usize| rows.get(y + 1).copied().unwrap_or(0);
    let below = |y: usize| if y > 0 { rows[y - 1] } else { 0 };
    Bits::from_rows(|y| rows[y] | rows[y] << 1 | rows[y] >> 1 | above(y) | below(y))
}

/// The 4-connected components, the largest first, of equal ones that with the lowest, then leftmost cell.
pub(super) fn components(bits: &Bits) -> Vec<Bits> {
    let mut found = Vec::new();
    let mut left = *bits;
    while let Some(y) = left.rows().iter().position(|&row| row != 0) {
        let first = left.rows()[y] & left.rows()[y].wrapping_neg();
        let component = flooded(&Bits::from_rows(|j| if j == y { first } else { 0 }), &left);
        left = left.without(&component);
        found.push(component);
    }
    found.sort_by_key(|component| std::cmp::Reverse(component.count()));
    found
}

/// All components of `within` that meet `seed`.
pub(super) fn flooded(seed: &Bits, within: &Bits) -> Bits {
    let within = within.rows();
    let mut rows: [u64; CELLS] = std::array::from_fn(|y| filled(seed.rows()[y], within[y]));
    let mut changed = true;
    while changed {
        changed = false;
        let up = (1..CELLS).map(|y| (y, y - 1));
        let down = (0..CELLS - 1).rev().map(|y| (y, y + 1));
        for (y, from) in up.chain(down) {
            let entered = rows[from] & within[y] & !rows[y];
            if entered != 0 {
                rows[y] |= filled(entered, within[y]);
                changed = true;
            }
        }
    }
    Bits::from_rows(|y| rows[y])
}

/// The runs of `within` that meet `seed`, by doubling the length of what spreads.
fn filled(seed: u64, within: u64) -> u64 {
    let seed = seed & within;
    if seed == 0 {
        return 0;
    }
    let (mut left, mut right) = ((seed, within), (seed, within));
    for shift in [1, 2, 4, 8, 16, 32] {
        left = (left.0 | left.1 & left.0 << shift, left.1 & left.1 << shift);
        right = (right.0 | right.1 & right.0 >> shift, right.1 & right.1 >> shift);
    }
    left.0 | right.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Stream;

    fn noise(index: u64, density: f64) -> Bits {
        let mut stream = Stream::new(1, "test", index);
        let cells: Vec<bool> = (0..2500).map(|_| stream.chance(density)).collect();
        Bits::from_fn(|x, y| cells[y * 50 + x])
    }

    /// The definition: cells covered by a square that fits, looked for one by one; squares may reach `beyond` the frame.
    fn covered(fits: &dyn Fn(i32, i32) -> bool, n: i32, beyond: i32) -> Bits {
        let square = |x: i32, y: i32| (0..n).flat_map(move |j| (0..n).map(move |i| (x + i, y + j)));
        let places = || (-beyond..=50 + beyond - n).flat_map(|y| (-beyond..=50 + beyond - n).map(move |x| (x, y)));
        let mut cells = vec![false; 2500];
        for (x, y) in places().filter(|&(x, y)| square(x, y).all(|(i, j)| fits(i, j))) {
            for (i, j) in square(x, y).filter(|(i, j)| (0..50).contains(i) && (0..50).contains(j)) {
                cells[(j * 50 + i) as usize] = true;
            }
        }
        Bits::from_fn(|x, y| cells[y * 50 + x])
    }

    #[test]
    fn opening_and_closing_are_what_squares_cover() {
        for (index, n) in [(0, 1), (1, 2), (2, 3), (3, 5), (4, 9)] {
            for bits in [noise(index, 0.9), noise(index, 0.1)] {
                let inside = |x: i32, y: i32| (0..50).contains(&x) && (0..50).contains(&y);
                let electrode = |x: i32, y: i32| inside(x, y) && bits.has(x as usize, y as usize);
                let n_cells = n as i32;
                assert_eq!(opened(&bits, n), covered(&electrode, n_cells, 0), "opening by {n}");
                let gap = |x: i32, y: i32| !electrode(x, y);
                let gaps = covered(&gap, n_cells, n_cells);
                assert_eq!(closed(&bits, n), gaps.inverse(), "closing by {n}");
            }
        }
    }

    #[test]
    fn the_largest_square_is_the_membrane() {
        assert_eq!(opened(&Bits::FULL, 50), Bits::FULL);
        assert_eq!(closed(&Bits::FULL, 50), Bits::FULL);
        assert_eq!(closed(&Bits::EMPTY, 50), Bits::EMPTY);
        assert!(opened(&noise(1, 0.99), 50).is_empty());
        // A gap at the frame opens into the outside, one inside the membrane does not.
        let strip = |from: usize| Bits::from_fn(move |x, _| x != from);
        assert_eq!(closed(&strip(49), 4), strip(49));
        assert_eq!(closed(&strip(30), 4), Bits::FULL);
    }

    #[test]
    fn components_are_the_pieces_that_hang_together_by_sides() {
        for index in 0..20 {
            let bits = noise(index, 0.55);
            let found = components(&bits);
            assert_eq!(found.iter().fold(Bits::EMPTY, |all, c| all.or(c)), bits);
            assert_eq!(found.iter().map(Bits::count).sum::<usize>(), bits.count());
            assert!(found.windows(2).all(|pair| pair[0].count() >= pair[1].count()));
            for (k, component) in found.iter().enumerate() {
                // Nothing beside it is active, and it cannot be parted: any of its cells reaches all.
                assert_eq!(spread(component).and(&bits), *component);
                let y = component.rows().iter().rposition(|&row| row != 0).unwrap();
                let last = 1 << (63 - component.rows()[y].leading_zeros());
                let seed = Bits::from_rows(|j| if j == y { last } else { 0 });
                assert_eq!(flooded(&seed, &bits), *component, "component {k}");
            }
        }
    }

    #[test]
    fn corners_do_not_connect() {
        let diagonal = Bits::from_fn(|x, y| x == y && x < 3);
        assert_eq!(components(&diagonal).len(), 3);
        assert_eq!(grown(&diagonal).count(), 9 + 9 - 4);
    }

    #[test]
    fn a_meander_is_one_component() {
        // The longest way that a flood can have: every other row, joined at alternating ends.
        let meander = Bits::from_fn(|x, y| y % 2 == 0 || x == if y % 4 == 1 { 49 } else { 0 });
        assert_eq!(components(&meander), [meander]);
    }
}
