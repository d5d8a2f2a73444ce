//! Glyphs: letters and digits.
//!
//! Strokes of one width with ends, corners and closed rings, in rows. A font of 5 × 7 dots stands in boxes of 6 × 8
//! dots. The width of a dot is uniform in 1 to 6 cells. The rows begin at a uniform offset, so that letters at the edge
//! are cut. Each letter is drawn independently. The letters are active, or all else, with equal probability.

use super::family::{Family, family};
use deaflow_base::Stream;
use deaflow_pattern::{Pattern, Raster};

/// Cells across the widest dot.
const WIDEST: usize = 6;

/// Dots of a letter, across and upwards; its box has one more in each direction.
const DOTS: [usize; 2] = [5, 7];

/// The letters A to Z and the digits, row by row from the top; the highest of five bits is on the left.
#[rustfmt::skip]
const FONT: [[u8; 7]; 36] = [
    [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001], // A
    [0b11110, 0b10001, 0b10001, 0b11110, 0b10001, 0b10001, 0b11110], // B
    [0b01110, 0b10001, 0b10000, 0b10000, 0b10000, 0b10001, 0b01110], // C
    [0b11110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b11110], // D
    [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111], // E
    [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000], // F
    [0b01110, 0b10001, 0b10000, 0b10111, 0b10001, 0b10001, 0b01110], // G
    [0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001], // H
    [0b01110, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110], // I
    [0b00111, 0b00010, 0b00010, 0b00010, 0b00010, 0b10010, 0b01100], // J
    [0b10001, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b10001], // K
    [0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b11111], // L
    [0b10001, 0b11011, 0b10101, 0b10101, 0b10001, 0b10001, 0b10001], // M
    [0b10001, 0b11001, 0b10101, 0b10011, 0b10001, 0b10001, 0b10001], // N
    [0b01110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110], // O
    [0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000, 0b10000], // P
    [0b01110, 0b10001, 0b10001, 0b10001, 0b10101, 0b10010, 0b01101], // Q
    [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001], // R
    [0b01111, 0b10000, 0b10000, 0b01110, 0b00001, 0b00001, 0b11110], // S
    [0b11111, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100], // T
    [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110], // U
    [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01010, 0b00100], // V
    [0b10001, 0b10001, 0b10001, 0b10101, 0b10101, 0b11011, 0b10001], // W
    [0b10001, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001, 0b10001], // X
    [0b10001, 0b10001, 0b01010, 0b00100, 0b00100, 0b00100, 0b00100], // Y
    [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111], // Z
    [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110], // 0
    [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110], // 1
    [0b01110, 0b10001, 0b00001, 0b00010, 0b00100, 0b01000, 0b11111], // 2
    [0b11111, 0b00010, 0b00100, 0b00010, 0b00001, 0b10001, 0b01110], // 3
    [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010], // 4
    [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110], // 5
    [0b00110, 0b01000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110], // 6
    [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b01000, 0b01000], // 7
    [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110], // 8
    [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00010, 0b01100], // 9
];

family! {
    /// Rows of letters and digits, or what is around them.
    Glyphs, GlyphsParameters as "a glyphs sample", "glyphs"
}

/// A page of letters.
struct Page {
    dot: usize,
    /// Cells of the first box that lie outside, to the left and below.
    cut: [usize; 2],
    /// Boxes in a row.
    columns: usize,
    /// Letters, row by row from below.
    letters: Vec<usize>,
    inside: bool,
}

impl Page {
    fn draw(raster: Raster, stream: &mut Stream) -> Self {
        let dot = 1 + stream.index(WIDEST);
        let sides = DOTS.map(|dots| dot * (dots + 1));
        let inside = stream.chance(0.5);
        let cut = sides.map(|side| stream.index(side));
        // The first box may be cut, so one more is needed.
        let cells = raster.sides();
        let [columns, rows] = [0, 1].map(|axis| cells[axis].div_ceil(sides[axis]) + 1);
        Self {
            dot,
            cut,
            columns,
            letters: (0..columns * rows).map(|_| stream.index(FONT.len())).collect(),
            inside,
        }
    }

    fn is_ink(&self, x: usize, y: usize) -> bool {
        let [across, upwards] = DOTS;
        let (x, y) = ((x + self.cut[0]) / self.dot, (y + self.cut[1]) / self.dot);
        let letter = self.letters[y / (upwards + 1) * self.columns + x / (across + 1)];
        let (x, y) = (x % (across + 1), y % (upwards + 1));
        x < across && y < upwards && FONT[letter][upwards - 1 - y] >> (across - 1 - x) & 1 == 1
    }
}

impl Family for Glyphs {
    fn name(&self) -> &'static str {
        "glyphs"
    }

    fn draw(&self, stream: &mut Stream) -> Pattern {
        let raster = self.canvas.raster();
        let page = Page::draw(raster, stream);
        Pattern::from_fn(raster, |x, y| page.is_ink(x, y) == page.inside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Canvas;
    use deaflow_pattern::CELLS;

    fn drawn(seed: u64, index: u64) -> Pattern {
        Glyphs::new(Canvas::PAPER).sample(seed, index).unwrap()
    }

    #[test]
    fn letters_stand_upright_and_are_read_from_the_left() {
        let page = Page {
            dot: 2,
            cut: [0, 0],
            columns: 2,
            letters: vec![5, 11, 0, 0], // F and L, and A above.
            inside: true,
        };
        let row = |y: usize| -> String {
            let dots = (0..12).map(|x| if page.is_ink(2 * x, 2 * y) { '#' } else { '.' });
            dots.collect()
        };
        let expected = [
            "#####.#.....",
            "#.....#.....",
            "#.....#.....",
            "####..#.....",
            "#.....#.....",
            "#.....#.....",
            "#.....#####.",
        ];
        for (y, expected) in expected.iter().rev().enumerate() {
            assert_eq!(row(y), *expected, "row {y}");
        }
        assert_eq!(row(7), "............", "rows are apart");
        assert_eq!(row(14), ".###...###..");
    }

    #[test]
    fn strokes_are_as_wide_as_a_dot() {
        for index in 0..60 {
            let page = Page::draw(Raster::PAPER, &mut Stream::new(3, "glyphs", index));
            let pattern = drawn(3, index);
            let same = |x: usize, y: usize| {
                let next = |k: usize, cut: usize| !(k + cut + 1).is_multiple_of(page.dot) && k + 1 < CELLS;
                let right = !next(x, page.cut[0]) || pattern.is_active(x, y) == pattern.is_active(x + 1, y);
                right && (!next(y, page.cut[1]) || pattern.is_active(x, y) == pattern.is_active(x, y + 1))
            };
            assert!((0..CELLS * CELLS).all(|i| same(i % CELLS, i / CELLS)), "sample {index}");
        }
    }

    #[test]
    fn letters_and_background_are_active_equally_often_and_every_letter_occurs() {
        let pages: Vec<Page> = (0..300)
            .map(|i| Page::draw(Raster::PAPER, &mut Stream::new(1, "glyphs", i)))
            .collect();
        let inside = pages.iter().filter(|page| page.inside).count();
        // Binomial: 150 ± 9.
        assert!((115..=185).contains(&inside), "{inside}");
        let mut seen = [false; 36];
        pages
            .iter()
            .flat_map(|page| &page.letters)
            .for_each(|&k| seen[k] = true);
        assert!(seen.iter().all(|seen| *seen));
        for index in 0..300 {
            let pattern = drawn(1, index);
            let area = pattern.area_fraction(None);
            let ink = if pages[index as usize].inside { area } else { 1.0 - area };
            // A letter has 10 to 20 dots of the 48 of its box, and large ones are cut anywhere.
            assert!((0.1..=0.5).contains(&ink), "sample {index}: {ink}");
        }
    }
}
