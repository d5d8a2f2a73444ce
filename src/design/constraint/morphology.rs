//! Opening and closing of bit patterns by a square (Serra, Image Analysis and Mathematical Morphology, 1982), and
//! their connected components.

use deaflow_pattern::Bits;

/// Columns and rows of a square of the minimum width; cells need not be square.
pub(super) type Square = [usize; 2];

/// The erosion: positions (lower left cells) of a square at which it lies inside the pattern.
pub(super) fn eroded(bits: &Bits, square: Square) -> Bits {
    gathered(bits, square, -1, Bits::and)
}

/// The dilation: all cells of the squares whose lower left cells are given.
pub(super) fn dilated(bits: &Bits, square: Square) -> Bits {
    gathered(bits, square, 1, Bits::or)
}

/// The positions (lower left cells) of a square at which it overlaps the pattern.
pub(super) fn met(bits: &Bits, square: Square) -> Bits {
    gathered(bits, square, -1, Bits::or)
}

/// Combines the pattern shifted to each cell of a square by `join`, along x and then along y.
fn gathered(bits: &Bits, square: Square, direction: isize, join: fn(&Bits, &Bits) -> Bits) -> Bits {
    let moves = |n: usize| (1..n as isize).map(move |by| direction * by);
    let along_x = moves(square[0]).fold(bits.clone(), |all, by| join(&all, &bits.moved(by, 0)));
    moves(square[1]).fold(along_x.clone(), |all, by| join(&all, &along_x.moved(0, by)))
}

/// The opening: the part of the pattern that squares inside the pattern cover.
pub(super) fn opened(bits: &Bits, square: Square) -> Bits {
    dilated(&eroded(bits, square), square)
}

/// The closing: the pattern and the gaps that no square inside a gap covers; everything outside the membrane is gap.
pub(super) fn closed(bits: &Bits, square: Square) -> Bits {
    // Squares may extend beyond the frame.
    let sides = bits.sides();
    let [x, y] = square.map(|n| n as isize - 1);
    let wide = [sides[0] + square[0] - 1, sides[1] + square[1] - 1];
    let blocked = gathered(&bits.placed(wide, x, y), square, -1, Bits::or);
    gathered(&blocked, square, -1, Bits::and).placed(sides, 0, 0)
}

/// The pattern and its 8 neighbours.
pub(super) fn grown(bits: &Bits) -> Bits {
    let row = bits.or(&bits.moved(1, 0)).or(&bits.moved(-1, 0));
    row.or(&row.moved(0, 1)).or(&row.moved(0, -1))
}

/// The pattern and all cells within the given number of columns and rows.
pub(super) fn surrounded(bits: &Bits, [columns, rows]: Square) -> Bits {
    let sides = [-1, 1];
    let moved = |bits: &Bits, n: usize, step: &dyn Fn(isize) -> (isize, isize)| {
        let moves = (1..=n as isize).flat_map(|by| sides.map(|side| step(side * by)));
        moves.fold(bits.clone(), |all, (x, y)| all.or(&bits.moved(x, y)))
    };
    let row = moved(bits, columns, &|by| (by, 0));
    moved(&row, rows, &|by| (0, by))
}

/// The pattern and its 4 neighbours.
pub(super) fn spread(bits: &Bits) -> Bits {
    let sides = [(1, 0), (-1, 0), (0, 1), (0, -1)];
    sides
        .iter()
        .fold(bits.clone(), |all, (x, y)| all.or(&bits.moved(*x, *y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::Stream;
    use deaflow_pattern::Raster;

    fn noise(index: u64, density: f64) -> Bits {
        let mut stream = Stream::new(1, "test", index);
        let cells: Vec<bool> = (0..2500).map(|_| stream.chance(density)).collect();
        Bits::from_fn(Raster::PAPER, |x, y| cells[y * 50 + x])
    }

    /// The definition by exhaustive search: cells covered by a square that fits; squares may extend `beyond` the
    /// frame.
    fn covered(fits: &dyn Fn(i32, i32) -> bool, n: i32, beyond: i32) -> Bits {
        let square = |x: i32, y: i32| (0..n).flat_map(move |j| (0..n).map(move |i| (x + i, y + j)));
        let places = || (-beyond..=50 + beyond - n).flat_map(|y| (-beyond..=50 + beyond - n).map(move |x| (x, y)));
        let mut cells = vec![false; 2500];
        for (x, y) in places().filter(|&(x, y)| square(x, y).all(|(i, j)| fits(i, j))) {
            for (i, j) in square(x, y).filter(|(i, j)| (0..50).contains(i) && (0..50).contains(j)) {
                cells[(j * 50 + i) as usize] = true;
            }
        }
        Bits::from_fn(Raster::PAPER, |x, y| cells[y * 50 + x])
    }

    #[test]
    fn opening_and_closing_are_covered_by_squares() {
        for (index, n) in [(0, 1), (1, 2), (2, 3), (3, 5), (4, 9)] {
            for bits in [noise(index, 0.9), noise(index, 0.1)] {
                let inside = |x: i32, y: i32| (0..50).contains(&x) && (0..50).contains(&y);
                let electrode = |x: i32, y: i32| inside(x, y) && bits.has(x as usize, y as usize);
                let n_cells = n as i32;
                assert_eq!(opened(&bits, [n; 2]), covered(&electrode, n_cells, 0), "opening by {n}");
                let gap = |x: i32, y: i32| !electrode(x, y);
                let gaps = covered(&gap, n_cells, n_cells);
                assert_eq!(closed(&bits, [n; 2]), gaps.inverse(), "closing by {n}");
            }
        }
    }

    #[test]
    fn the_largest_square_is_the_membrane() {
        let [empty, full] = [Bits::empty(Raster::PAPER), Bits::full(Raster::PAPER)];
        assert_eq!(opened(&full, [50; 2]), full);
        assert_eq!(closed(&full, [50; 2]), full);
        assert_eq!(closed(&empty, [50; 2]), empty);
        assert!(opened(&noise(1, 0.99), [50; 2]).is_empty());
        // A gap at the frame opens into the outside, one inside the membrane does not.
        let strip = |from: usize| Bits::from_fn(Raster::PAPER, move |x, _| x != from);
        assert_eq!(closed(&strip(49), [4; 2]), strip(49));
        assert_eq!(closed(&strip(30), [4; 2]), full);
    }

    #[test]
    fn components_are_the_pieces_that_hang_together_by_sides() {
        for index in 0..20 {
            let bits = noise(index, 0.55);
            let found = bits.components();
            let empty = Bits::empty(Raster::PAPER);
            assert_eq!(found.iter().fold(empty, |all, c| all.or(c)), bits);
            assert_eq!(found.iter().map(Bits::count).sum::<usize>(), bits.count());
            assert!(found.windows(2).all(|pair| pair[0].count() >= pair[1].count()));
            for (k, component) in found.iter().enumerate() {
                // No neighbour is active, and a flood from any cell covers the component.
                assert_eq!(spread(component).and(&bits), *component);
                let last = (0..2500).rfind(|at| component.has(at % 50, at / 50)).unwrap();
                let seed = Bits::from_fn(Raster::PAPER, |x, y| y * 50 + x == last);
                assert_eq!(bits.flooded(&seed), *component, "component {k}");
            }
        }
    }

    #[test]
    fn corners_do_not_connect() {
        let diagonal = Bits::from_fn(Raster::PAPER, |x, y| x == y && x < 3);
        assert_eq!(diagonal.components().len(), 3);
        assert_eq!(grown(&diagonal).count(), 9 + 9 - 4);
    }

    #[test]
    fn a_meander_is_one_component() {
        // The longest path of a flood: every other row, joined at alternating ends.
        let meander = Bits::from_fn(Raster::PAPER, |x, y| y % 2 == 0 || x == if y % 4 == 1 { 49 } else { 0 });
        assert_eq!(meander.components(), [meander]);
    }
}
