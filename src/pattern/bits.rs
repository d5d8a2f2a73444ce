//! Patterns as bits, for operations on thousands of patterns.

use super::raster::{Pattern, Raster};
use super::symmetry::{Symmetries, Symmetry};

/// Cells in a word.
const WORD: usize = u64::BITS as usize;

/// The active cells of a raster, row by row from below. Bit x % 64 of word x / 64 of row y is cell (x, y); bits beyond
/// the last column are 0.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Bits {
    columns: usize,
    rows: usize,
    words: Box<[u64]>,
}

impl Bits {
    /// Returns a set without cells.
    #[must_use]
    pub fn empty(raster: Raster) -> Self {
        Self::none(raster.columns(), raster.rows())
    }

    /// Returns a set of all cells.
    #[must_use]
    pub fn full(raster: Raster) -> Self {
        Self::empty(raster).inverse()
    }

    /// Returns the cells (x, y) for which `active(x, y)` is true.
    #[must_use]
    pub fn from_fn(raster: Raster, active: impl Fn(usize, usize) -> bool) -> Self {
        let mut bits = Self::empty(raster);
        for y in 0..bits.rows {
            for x in (0..bits.columns).filter(|x| active(*x, y)) {
                bits.set(x, y);
            }
        }
        bits
    }

    /// Returns the active cells of a pattern.
    #[must_use]
    pub fn of(pattern: &Pattern) -> Self {
        let mut bits = Self::empty(pattern.raster());
        let (columns, width) = (bits.columns, bits.width());
        for (row, cells) in bits
            .words
            .chunks_exact_mut(width)
            .zip(pattern.cells().chunks_exact(columns))
        {
            for (word, cells) in row.iter_mut().zip(cells.chunks(WORD)) {
                *word = cells
                    .iter()
                    .rev()
                    .fold(0, |word, &cell| word << 1 | u64::from(cell != 0));
            }
        }
        bits
    }

    /// Returns the pattern of one electrode group on these cells.
    ///
    /// # Panics
    /// When the set has more columns or rows than [`Raster::MOST`].
    #[must_use]
    pub fn pattern(&self) -> Pattern {
        Pattern::from_fn(self.raster(), |x, y| self.has(x, y))
    }

    /// Returns the raster.
    ///
    /// # Panics
    /// When the set has more columns or rows than [`Raster::MOST`].
    #[must_use]
    pub fn raster(&self) -> Raster {
        Raster::new(self.columns, self.rows).expect("the bits belong to a raster")
    }

    /// Returns the numbers of columns and rows.
    #[must_use]
    pub fn sides(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    /// Returns whether the cell at column `x`, row `y` is active.
    ///
    /// # Panics
    /// When the cell is beyond the last word.
    #[must_use]
    pub fn has(&self, x: usize, y: usize) -> bool {
        self.words[y * self.width() + x / WORD] >> (x % WORD) & 1 == 1
    }

    /// Returns the number of active cells.
    #[must_use]
    pub fn count(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Returns the run lengths, row by row from below: bare cells, active cells, bare cells, and so on.
    #[must_use]
    pub fn runs(&self) -> Vec<usize> {
        let (mut runs, mut is_active) = (vec![0], false);
        for at in 0..self.columns * self.rows {
            if self.has(at % self.columns, at / self.columns) != is_active {
                is_active = !is_active;
                runs.push(0);
            }
            *runs.last_mut().expect("the list is not empty") += 1;
        }
        runs
    }

    /// Returns the cells of run lengths; `None` if they do not add up to the cells of the raster.
    #[must_use]
    pub fn from_runs(raster: Raster, runs: &[usize]) -> Option<Self> {
        let total = runs.iter().try_fold(0_usize, |sum, run| sum.checked_add(*run));
        if total != Some(raster.cells()) {
            return None;
        }
        let each = runs
            .iter()
            .enumerate()
            .flat_map(|(at, &run)| std::iter::repeat_n(at % 2 == 1, run));
        let cells: Vec<bool> = each.collect();
        Some(Self::from_fn(raster, |x, y| cells[y * raster.columns() + x]))
    }

    /// Returns whether no cell is active.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|&word| word == 0)
    }

    /// Returns the cells active in both sets.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        self.joined(other, |a, b| a & b)
    }

    /// Returns the cells active in at least one of the sets.
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        self.joined(other, |a, b| a | b)
    }

    /// Returns the cells active in this set but not in the other.
    #[must_use]
    pub fn without(&self, other: &Self) -> Self {
        self.joined(other, |a, b| a & !b)
    }

    /// Returns the cells that are not active.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let mut bits = self.clone();
        bits.words.iter_mut().for_each(|word| *word = !*word);
        bits.clear_beyond();
        bits
    }

    /// Returns whether the sets share a cell.
    #[must_use]
    pub fn meets(&self, other: &Self) -> bool {
        self.words.iter().zip(&other.words).any(|(a, b)| a & b != 0)
    }

    /// Returns the number of cells in which the sets differ.
    #[must_use]
    pub fn differing(&self, other: &Self) -> usize {
        let words = self.words.iter().zip(&other.words);
        words.map(|(a, b)| (a ^ b).count_ones() as usize).sum()
    }

    /// Returns the cells shifted along x and y; cells shifted out of the raster are dropped.
    #[must_use]
    pub fn moved(&self, along_x: isize, along_y: isize) -> Self {
        let mut moved = Self::none(self.columns, self.rows);
        let width = self.width();
        for y in 0..self.rows {
            let from = y.wrapping_add_signed(along_y.wrapping_neg());
            if from < self.rows {
                shift(self.row(from), &mut moved.words[y * width..][..width], along_x);
            }
        }
        moved.clear_beyond();
        moved
    }

    /// Returns the cells on a raster of another size, shifted along x and y; cells outside of that raster are dropped.
    #[must_use]
    pub fn placed(&self, [columns, rows]: [usize; 2], along_x: isize, along_y: isize) -> Self {
        let mut placed = Self::none(columns, rows);
        let wide = Self::none(columns.max(self.columns), 1);
        for y in 0..rows {
            let from = y.wrapping_add_signed(along_y.wrapping_neg());
            if from < self.rows {
                let mut row = wide.words.clone();
                row[..self.width()].copy_from_slice(self.row(from));
                let mut to = wide.words.clone();
                shift(&row, &mut to, along_x);
                let width = placed.width();
                placed.words[y * width..][..width].copy_from_slice(&to[..width]);
            }
        }
        placed.clear_beyond();
        placed
    }

    /// Returns the lowest, then leftmost active cell.
    #[must_use]
    pub fn first(&self) -> Self {
        let mut first = Self::none(self.columns, self.rows);
        if let Some(at) = self.words.iter().position(|&word| word != 0) {
            first.words[at] = self.words[at] & self.words[at].wrapping_neg();
        }
        first
    }

    /// Returns the connected pieces (cells joined by their sides), the largest first; ties are ordered by the lowest,
    /// then leftmost cell.
    #[must_use]
    pub fn components(&self) -> Vec<Self> {
        let mut found = Vec::new();
        let mut left = self.clone();
        while !left.is_empty() {
            let component = left.flooded(&left.first());
            left = left.without(&component);
            found.push(component);
        }
        found.sort_by_key(|component| std::cmp::Reverse(component.count()));
        found
    }

    /// Returns the connected pieces (cells joined by their sides) that contain a cell of `seed`.
    #[must_use]
    pub fn flooded(&self, seed: &Self) -> Self {
        let (width, rows) = (self.width(), self.rows);
        let mut found = seed.and(self);
        for (row, within) in found.words.chunks_exact_mut(width).zip(self.words.chunks_exact(width)) {
            fill(row, within);
        }
        let mut has_changed = true;
        while has_changed {
            has_changed = false;
            let up = (1..rows).map(|y| (y, y - 1));
            let down = (0..rows.saturating_sub(1)).rev().map(|y| (y, y + 1));
            for (y, from) in up.chain(down) {
                let mut is_entered = false;
                for at in 0..width {
                    let entered = found.words[from * width + at] & self.words[y * width + at];
                    is_entered |= entered & !found.words[y * width + at] != 0;
                    found.words[y * width + at] |= entered;
                }
                if is_entered {
                    fill(&mut found.words[y * width..][..width], self.row(y));
                    has_changed = true;
                }
            }
        }
        found
    }

    /// Returns the images under those symmetries that keep the raster; the first is the set itself.
    #[must_use]
    pub fn images(&self, symmetries: Symmetries) -> Vec<Self> {
        let mut images: Vec<_> = self.mirrored().into_iter().zip(MIRRORED).collect();
        if self.columns == self.rows && symmetries.iter().any(Symmetry::exchanges_axes) {
            images.extend(self.transposed().mirrored().into_iter().zip(TRANSPOSED));
        }
        let is_wanted = |matrix| symmetries.iter().any(|g| g.matrix() == matrix);
        let wanted = images.into_iter().filter(|(_, matrix)| is_wanted(*matrix));
        wanted.map(|(image, _)| image).collect()
    }

    /// Returns the [`distance`] from a pattern with these images.
    #[must_use]
    pub fn distance_to(&self, images: &[Self]) -> f64 {
        let least = images.iter().map(|image| self.differing(image)).min();
        least.unwrap_or_default() as f64 / (self.columns * self.rows) as f64
    }

    fn none(columns: usize, rows: usize) -> Self {
        Self {
            columns,
            rows,
            words: vec![0; rows * columns.div_ceil(WORD)].into(),
        }
    }

    /// Words in a row.
    fn width(&self) -> usize {
        self.columns.div_ceil(WORD)
    }

    fn row(&self, y: usize) -> &[u64] {
        &self.words[y * self.width()..][..self.width()]
    }

    fn set(&mut self, x: usize, y: usize) {
        self.words[y * self.width() + x / WORD] |= 1 << (x % WORD);
    }

    fn clear_beyond(&mut self) {
        let used = self.columns % WORD;
        if used > 0 {
            let width = self.width();
            let mask = (1 << used) - 1;
            self.words
                .chunks_exact_mut(width)
                .for_each(|row| row[width - 1] &= mask);
        }
    }

    /// Returns the set itself, mirrored in x, mirrored in y, and mirrored in both.
    fn mirrored(&self) -> [Self; 4] {
        let in_x = |bits: &Self| {
            let width = bits.width();
            let beyond = width * WORD - bits.columns;
            let mut turned = bits.clone();
            for (row, to) in bits.words.chunks_exact(width).zip(turned.words.chunks_exact_mut(width)) {
                let reversed: Vec<u64> = row.iter().rev().map(|word| word.reverse_bits()).collect();
                shift(&reversed, to, -(beyond as isize));
            }
            turned
        };
        let in_y = |bits: &Self| {
            let rows = bits.words.chunks_exact(bits.width()).rev();
            Self {
                words: rows.flatten().copied().collect(),
                ..*bits
            }
        };
        let across = in_x(self);
        [self.clone(), across.clone(), in_y(self), in_y(&across)]
    }

    /// Exchanges rows and columns, one block of 64 × 64 bits at a time.
    fn transposed(&self) -> Self {
        let mut turned = Self::none(self.rows, self.columns);
        let (from, to) = (self.width(), turned.width());
        for up in 0..to {
            for right in 0..from {
                let mut words = [0; WORD];
                let rows = WORD.min(self.rows - up * WORD);
                for (y, word) in words[..rows].iter_mut().enumerate() {
                    *word = self.words[(up * WORD + y) * from + right];
                }
                transpose(&mut words);
                let rows = WORD.min(self.columns - right * WORD);
                for (y, word) in words[..rows].iter().enumerate() {
                    turned.words[(right * WORD + y) * to + up] = *word;
                }
            }
        }
        turned
    }

    fn joined(&self, other: &Self, by: impl Fn(u64, u64) -> u64) -> Self {
        let words = self.words.iter().zip(&other.words);
        Self {
            words: words.map(|(a, b)| by(*a, *b)).collect(),
            ..*self
        }
    }
}

/// Transposes a block of bits by exchanging ever smaller blocks (Warren, Hacker's Delight, 2nd ed. 2012, section 7-3).
fn transpose(words: &mut [u64; WORD]) {
    let (mut width, mut mask) = (WORD / 2, u64::from(u32::MAX));
    while width > 0 {
        for low in (0..WORD).filter(|row| row & width == 0) {
            let swap = (words[low] >> width ^ words[low + width]) & mask;
            words[low] ^= swap << width;
            words[low + width] ^= swap;
        }
        width /= 2;
        mask ^= mask << width;
    }
}

/// Writes a row shifted towards higher columns, or towards lower columns if `by` is negative.
fn shift(row: &[u64], to: &mut [u64], by: isize) {
    let (words, bits) = (by.unsigned_abs() / WORD, by.unsigned_abs() % WORD);
    let at = |index: Option<usize>| index.and_then(|index| row.get(index)).copied().unwrap_or(0);
    for (index, to) in to.iter_mut().enumerate() {
        *to = match (by >= 0, bits) {
            (true, 0) => at(index.checked_sub(words)),
            (true, _) => at(index.checked_sub(words)) << bits | at(index.checked_sub(words + 1)) >> (WORD - bits),
            (false, 0) => at(Some(index + words)),
            (false, _) => at(Some(index + words)) >> bits | at(Some(index + words + 1)) << (WORD - bits),
        };
    }
}

/// Extends a row to all runs of `within` that it touches.
fn fill(row: &mut [u64], within: &[u64]) {
    let last = row.len() - 1;
    loop {
        let mut goes_on = false;
        for at in 0..row.len() {
            row[at] = filled(row[at], within[at]);
            if at < last {
                let over = row[at] >> (WORD - 1) & within[at + 1] & !row[at + 1] & 1;
                row[at + 1] |= over;
            }
        }
        for at in (1..row.len()).rev() {
            let over = row[at] << (WORD - 1) & within[at - 1] & !row[at - 1];
            row[at - 1] |= over;
            goes_on |= over != 0;
        }
        if !goes_on {
            return;
        }
    }
}

/// Returns the runs of `within` that contain a bit of `seed`, by doubling the reach in each step.
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

impl Pattern {
    /// Returns the area fraction, 0 to 1: the share of the free membrane that is active. `free` are the cells that are
    /// neither frame nor body; `None` if all cells are free. Electrodes elsewhere have no effect and do not count.
    #[must_use]
    pub fn area_fraction(&self, free: Option<&Bits>) -> f64 {
        if let Some(coverage) = self.coverage() {
            let [columns, _] = self.raster().sides();
            let is_free = |at: usize| free.is_none_or(|free| free.has(at % columns, at / columns));
            let shares = coverage.shares().into_iter().enumerate();
            let area: f64 = shares.filter(|(at, _)| is_free(*at)).map(|(_, share)| share).sum();
            let all = free.map_or(self.raster().cells(), Bits::count);
            return area / all.max(1) as f64;
        }
        match free {
            None => self.active_cells() as f64 / self.raster().cells() as f64,
            Some(free) => Bits::of(self).and(free).count() as f64 / free.count().max(1) as f64,
        }
    }

    /// Returns the pattern without the electrodes outside of some cells.
    #[must_use]
    pub fn within(&self, area: &Bits) -> Self {
        Self::from_groups(self.raster(), |x, y| match area.has(x, y) {
            true => self.group(x, y),
            false => 0,
        })
    }
}

/// The matrices of the identity, of the mirrors in x and in y, and of both mirrors.
const MIRRORED: [[[i32; 2]; 2]; 4] = [
    [[1, 0], [0, 1]],
    [[-1, 0], [0, 1]],
    [[1, 0], [0, -1]],
    [[-1, 0], [0, -1]],
];

/// The same matrices after an exchange of x and y.
const TRANSPOSED: [[[i32; 2]; 2]; 4] = [
    [[0, 1], [1, 0]],
    [[0, -1], [1, 0]],
    [[0, 1], [-1, 0]],
    [[0, -1], [-1, 0]],
];

/// Returns the distance of two patterns on one raster: the fraction of cells in which one differs from the nearest
/// image of the other under the symmetries of the square.
#[must_use]
pub fn distance(one: &Pattern, other: &Pattern) -> f64 {
    Bits::of(one).distance_to(&Bits::of(other).images(Symmetries::SQUARE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Symmetry;

    /// Patterns without symmetry on rasters of one word a row, of several, and at their borders.
    fn odd() -> impl Iterator<Item = Pattern> {
        let rasters = [
            (50, 50),
            (64, 64),
            (65, 63),
            (128, 3),
            (3, 130),
            (1, 400),
            (400, 1),
            (200, 200),
        ];
        let rasters = rasters
            .into_iter()
            .filter_map(|(columns, rows)| Raster::new(columns, rows));
        rasters.map(|raster| Pattern::from_fn(raster, |x, y| (3 * x + y * y) % 7 < 3 && 2 * x + 3 > y / 2))
    }

    #[test]
    fn an_area_fraction_is_a_share_of_the_free_cells() {
        let free = Bits::from_fn(Raster::PAPER, |x, y| x >= 10 && y >= 10);
        let stripe = Pattern::from_fn(Raster::PAPER, |x, _| (5..20).contains(&x));
        // 10 of 40 free columns; the cells on the frame do not count.
        assert_eq!(stripe.area_fraction(Some(&free)), 0.25);
        assert_eq!(stripe.area_fraction(None), 0.3);
        assert_eq!(stripe.area_fraction(Some(&Bits::full(Raster::PAPER))), 0.3);
    }

    #[test]
    fn patterns_survive_the_conversion_to_bits() {
        for pattern in odd() {
            let bits = Bits::of(&pattern);
            let raster = pattern.raster();
            assert_eq!(bits.pattern(), pattern);
            assert_eq!(bits.count(), pattern.active_cells());
            assert_eq!(bits.inverse().count(), raster.cells() - bits.count());
            assert_eq!(bits, Bits::from_fn(raster, |x, y| pattern.is_active(x, y)));
            assert!(Bits::empty(raster).is_empty() && Bits::full(raster).count() == raster.cells());
            assert!(bits.first().count() == 1 && bits.first().meets(&bits));
        }
    }

    #[test]
    fn the_images_are_those_of_the_symmetries() {
        for pattern in odd() {
            let only = |wanted: &[usize]| Symmetries::SQUARE.filter(|g| wanted.contains(&g.index()));
            for group in [
                Symmetries::SQUARE,
                Symmetries::RECTANGLE,
                only(&[0]),
                only(&[0, 2]),
                only(&[0, 5]),
            ] {
                let images = Bits::of(&pattern).images(group);
                let mut images: Vec<Pattern> = images.iter().map(Bits::pattern).collect();
                let all = group.iter().map(|g| pattern.transformed(g));
                let mut expected: Vec<Pattern> = all.filter(|image| image.raster() == pattern.raster()).collect();
                assert_eq!(images[0], pattern);
                images.sort();
                expected.sort();
                assert_eq!(images, expected);
            }
        }
    }

    #[test]
    fn cells_are_moved_and_placed() {
        for pattern in odd() {
            let bits = Bits::of(&pattern);
            let [columns, rows] = bits.sides();
            let at = |x: isize, y: isize| {
                let inside = (0..columns as isize).contains(&x) && (0..rows as isize).contains(&y);
                inside && pattern.is_active(x as usize, y as usize)
            };
            for (dx, dy) in [(0, 0), (1, 0), (-1, 2), (64, -3), (-70, 1), (13, 0), (0, -500)] {
                let expected = Bits::from_fn(pattern.raster(), |x, y| at(x as isize - dx, y as isize - dy));
                assert_eq!(bits.moved(dx, dy), expected, "{columns} × {rows} by ({dx}, {dy})");
                let larger = bits.placed([columns + 70, rows + 9], 5, 7);
                assert_eq!(larger.count(), bits.count());
                assert_eq!(larger.placed([columns, rows], dx - 5, dy - 7), expected);
            }
        }
    }

    #[test]
    fn a_flood_fills_the_connected_cells() {
        for pattern in odd() {
            let bits = Bits::of(&pattern);
            let found = bits.flooded(&bits.first());
            // Cell by cell.
            let mut slow = bits.first();
            loop {
                let sides = [(1, 0), (-1, 0), (0, 1), (0, -1)];
                let next = sides
                    .iter()
                    .fold(slow.clone(), |all, (x, y)| all.or(&slow.moved(*x, *y)));
                let next = next.and(&bits);
                if next == slow {
                    break;
                }
                slow = next;
            }
            assert_eq!(found, slow);
            let full = Bits::full(pattern.raster());
            assert_eq!(full.flooded(&bits.first()), full);
        }
    }

    #[test]
    fn distances_are_invariant_under_rotation() {
        for pattern in odd() {
            let raster = pattern.raster();
            let mut cells = pattern.cells().to_vec();
            cells[raster.cells() / 2] ^= 1;
            let other = Pattern::from_cells(raster, &cells).unwrap();
            assert_eq!(distance(&pattern, &pattern), 0.0);
            for g in Symmetry::ALL.into_iter().filter(|g| raster.transformed(*g) == raster) {
                let least = distance(&pattern, &other);
                assert!(least <= 1.0 / raster.cells() as f64);
                assert_eq!(distance(&pattern, &other.transformed(g)), least);
                assert_eq!(distance(&other.transformed(g), &pattern), least);
            }
            let [empty, full] = [false, true].map(|active| Pattern::from_fn(raster, |_, _| active));
            assert_eq!(distance(&empty, &full), 1.0);
        }
    }

    #[test]
    fn runs_encode_cells() {
        let raster = Raster::new(7, 5).unwrap();
        for seed in 0..20 {
            let bits = Bits::from_fn(raster, |x, y| (x * x + 3 * y + seed) % 5 < seed % 4);
            let runs = bits.runs();
            assert_eq!(runs.iter().sum::<usize>(), 35);
            assert!(runs[1..].iter().all(|run| *run > 0));
            assert_eq!(Bits::from_runs(raster, &runs), Some(bits));
        }
        assert_eq!(Bits::full(raster).runs(), [0, 35]);
        for wrong in [&[][..], &[34], &[3, 33], &[usize::MAX, 36]] {
            assert_eq!(Bits::from_runs(raster, wrong), None);
        }
    }
}
