//! Patterns as bits, one word for each row: what is asked of thousands of patterns is asked of these.

use super::raster::{CELLS, Pattern};

/// A word with all cells of a row.
const ROW: u64 = (1 << CELLS) - 1;

/// A pattern as one word for each row from below; bit x of row y is cell (x, y), higher bits are 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Bits([u64; CELLS]);

impl Bits {
    /// No cell.
    pub const EMPTY: Self = Self([0; CELLS]);

    /// All cells.
    pub const FULL: Self = Self([ROW; CELLS]);

    /// The cells (x, y) for which `active(x, y)`.
    #[must_use]
    pub fn from_fn(active: impl Fn(usize, usize) -> bool) -> Self {
        Self::from_rows(|y| (0..CELLS).fold(0, |row, x| row | u64::from(active(x, y)) << x))
    }

    /// The rows, of which bits beyond the membrane are left out.
    #[must_use]
    pub fn from_rows(row: impl FnMut(usize) -> u64) -> Self {
        Self(std::array::from_fn(row).map(|row: u64| row & ROW))
    }

    /// The active cells of a pattern.
    #[must_use]
    pub fn of(pattern: &Pattern) -> Self {
        let mut rows = pattern.cells().chunks_exact(CELLS);
        Self::from_rows(|_| {
            let cells = rows.next().unwrap_or_default().iter().rev();
            cells.fold(0, |row, &cell| row << 1 | u64::from(cell))
        })
    }

    /// The pattern.
    #[must_use]
    pub fn pattern(&self) -> Pattern {
        Pattern::from_fn(|x, y| self.has(x, y))
    }

    /// The words of the rows, from below.
    #[must_use]
    pub fn rows(&self) -> &[u64; CELLS] {
        &self.0
    }

    /// Whether the cell at column `x`, row `y` is active.
    ///
    /// # Panics
    /// When `y` is not below 50, or `x` not below 64.
    #[must_use]
    pub fn has(&self, x: usize, y: usize) -> bool {
        self.0[y] >> x & 1 == 1
    }

    /// How many cells are active.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.iter().map(|row| row.count_ones() as usize).sum()
    }

    /// Whether no cell is active.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.iter().all(|&row| row == 0)
    }

    /// Cells active in both.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        self.joined(other, |a, b| a & b)
    }

    /// Cells active in one or both.
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        self.joined(other, |a, b| a | b)
    }

    /// Cells active here and not there.
    #[must_use]
    pub fn without(&self, other: &Self) -> Self {
        self.joined(other, |a, b| a & !b)
    }

    /// The other cells.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self(self.0.map(|row| !row & ROW))
    }

    /// Whether some cell is active in both.
    #[must_use]
    pub fn meets(&self, other: &Self) -> bool {
        self.0.iter().zip(&other.0).any(|(a, b)| a & b != 0)
    }

    /// How many cells are active in one and not in the other.
    #[must_use]
    pub fn differing(&self, other: &Self) -> usize {
        let rows = self.0.iter().zip(&other.0);
        rows.map(|(a, b)| (a ^ b).count_ones() as usize).sum()
    }

    /// The images under the eight symmetries of the square, itself first.
    #[must_use]
    pub fn images(&self) -> [Self; 8] {
        let across = self.transposed();
        let [a, b, c, d] = self.mirrored();
        let [e, f, g, h] = across.mirrored();
        [a, b, c, d, e, f, g, h]
    }

    /// The [`distance`] from a pattern of which the images are at hand.
    #[must_use]
    pub fn distance_to(&self, images: &[Self; 8]) -> f64 {
        let least = images.iter().map(|image| self.differing(image)).min();
        least.unwrap_or_default() as f64 / (CELLS * CELLS) as f64
    }

    /// Itself, mirrored in x, in y, and in both.
    fn mirrored(&self) -> [Self; 4] {
        let in_x = Self(self.0.map(|row| row.reverse_bits() >> (64 - CELLS)));
        let in_y = |mut bits: Self| {
            bits.0.reverse();
            bits
        };
        [*self, in_x, in_y(*self), in_y(in_x)]
    }

    /// Rows and columns exchanged, by exchanging ever smaller blocks (Warren, Hacker's Delight, 2nd ed. 2012, section 7-3).
    fn transposed(&self) -> Self {
        let mut words = [0; 64];
        words[..CELLS].copy_from_slice(&self.0);
        let (mut width, mut mask) = (32, u64::from(u32::MAX));
        while width > 0 {
            for low in (0..64).filter(|row| row & width == 0) {
                let swap = (words[low] >> width ^ words[low + width]) & mask;
                words[low] ^= swap << width;
                words[low + width] ^= swap;
            }
            width /= 2;
            mask ^= mask << width;
        }
        Self::from_rows(|y| words[y])
    }

    fn joined(&self, other: &Self, by: impl Fn(u64, u64) -> u64) -> Self {
        Self(std::array::from_fn(|y| by(self.0[y], other.0[y])))
    }
}

/// How different two patterns are whichever way they are turned: the share of cells in which one differs from that image of
/// the other under the eight symmetries which is nearest.
#[must_use]
pub fn distance(one: &Pattern, other: &Pattern) -> f64 {
    Bits::of(one).distance_to(&Bits::of(other).images())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Symmetry;

    fn odd() -> Pattern {
        Pattern::from_fn(|x, y| (3 * x + y * y) % 7 < 3 && x > y / 2)
    }

    #[test]
    fn a_pattern_survives_the_way_to_bits_and_back() {
        let bits = Bits::of(&odd());
        assert_eq!(bits.pattern(), odd());
        assert_eq!(bits.count(), odd().active_cells());
        assert_eq!(bits.inverse().count(), 2500 - bits.count());
        assert_eq!(bits, Bits::from_fn(|x, y| odd().is_active(x, y)));
        assert!(Bits::EMPTY.is_empty() && Bits::FULL.count() == 2500);
    }

    #[test]
    fn the_images_are_those_of_the_symmetries() {
        let mut images = Bits::of(&odd()).images().map(|image| image.pattern());
        let mut expected = Symmetry::ALL.map(|g| odd().transformed(g));
        assert_eq!(images[0], odd());
        images.sort();
        expected.sort();
        assert_eq!(images, expected);
    }

    #[test]
    fn distances_do_not_depend_on_how_patterns_are_turned() {
        let mut cells = odd().cells().to_vec();
        for cell in [3, 700, 701, 2400] {
            cells[cell] ^= 1;
        }
        let other = Pattern::from_cells(&cells).unwrap();
        assert_eq!(distance(&odd(), &odd()), 0.0);
        for g in Symmetry::ALL {
            assert_eq!(distance(&odd(), &other.transformed(g)), 4.0 / 2500.0);
            assert_eq!(distance(&other.transformed(g), &odd()), 4.0 / 2500.0);
        }
        let (empty, full) = (Pattern::from_fn(|_, _| false), Pattern::from_fn(|_, _| true));
        assert_eq!(distance(&empty, &full), 1.0);
    }
}
