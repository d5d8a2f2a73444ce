//! Places for labels beside points, so that they cover neither points nor each other.

use std::ops::Range;

/// A place, or a width and a height.
type Pixel = (i32, i32);

/// A rectangle in pixels: left, top, right, bottom.
type Rect = [i32; 4];

/// Where a label's upper left corner stands, from its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    pub x: i32,
    pub y: i32,
}

/// What labels are to keep clear of.
pub struct Labels {
    frame: Rect,
    /// Points, which are not to be covered.
    taken: Vec<Rect>,
    /// Bits of lines, which are better not covered.
    lines: Vec<Rect>,
}

impl Labels {
    /// Within a frame given by its ranges of columns and rows.
    pub fn new([x, y]: [Range<i32>; 2]) -> Self {
        Self {
            frame: [x.start, y.start, x.end, y.end],
            taken: Vec::new(),
            lines: Vec::new(),
        }
    }

    /// Keeps a point of a radius free.
    pub fn avoid_point(&mut self, (x, y): (i32, i32), radius: i32) {
        self.taken.push([x - radius, y - radius, x + radius, y + radius]);
    }

    /// Keeps a line free where that can be had.
    pub fn avoid_line(&mut self, points: &[(i32, i32)]) {
        const BITS: i32 = 24;
        for pair in points.windows(2) {
            let ((x0, y0), (x1, y1)) = (pair[0], pair[1]);
            for k in 0..=BITS {
                let (x, y) = (x0 + (x1 - x0) * k / BITS, y0 + (y1 - y0) * k / BITS);
                self.lines.push([x - 2, y - 2, x + 2, y + 2]);
            }
        }
    }

    /// The best places for labels beside their points, `gap` pixels away or a little more, each by its size. They are placed one after the
    /// other, and each again where the others leave a better place.
    pub fn place(&self, wanted: &[(Pixel, Pixel)], gap: i32) -> Vec<Spot> {
        let mut placed: Vec<Option<Placed>> = vec![None; wanted.len()];
        for _ in 0..ROUNDS {
            let before = placed.clone();
            for (at, (point, size)) in wanted.iter().enumerate() {
                placed[at] = None;
                let others: Vec<Rect> = placed.iter().flatten().map(|other| other.own).collect();
                placed[at] = self.best(*point, *size, gap, &others);
            }
            if placed == before {
                break;
            }
        }
        placed.into_iter().flatten().map(|placed| placed.spot).collect()
    }

    fn best(&self, (x, y): (i32, i32), (width, height): (i32, i32), gap: i32, others: &[Rect]) -> Option<Placed> {
        let spots = [1, 2, 3, 4].into_iter().flat_map(|far| {
            let (gap, low, middle) = (far * gap, -height - far * gap, -height / 2);
            [
                (gap, middle),
                (gap / 2, low),
                (gap / 2, gap),
                (-width - gap, middle),
                (-width - gap / 2, gap),
                (-width - gap / 2, low),
                (-width / 2, low),
                (-width / 2, gap),
            ]
        });
        let air = gap / 3;
        let placed = spots.map(|(dx, dy)| {
            let (left, top) = (x + dx, y + dy);
            let own = [left - air, top - air, left + width + air, top + height + air];
            let spot = Spot { x: dx, y: dy };
            Placed { spot, own }
        });
        let cost = |(rank, placed): &(usize, Placed)| 4 * *rank as i64 + self.cost(placed.own, others);
        placed.enumerate().min_by_key(cost).map(|(_, placed)| placed)
    }

    fn cost(&self, own: Rect, others: &[Rect]) -> i64 {
        let count = |boxes: &[Rect]| boxes.iter().filter(|other| overlap(own, **other)).count() as i64;
        let [left, top, right, bottom] = self.frame;
        let outside = own[0] < left || own[1] < top || own[2] > right || own[3] > bottom;
        1000 * (count(&self.taken) + count(others)) + 25 * count(&self.lines) + if outside { 5000 } else { 0 }
    }
}

/// A label that has its place.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Placed {
    spot: Spot,
    /// What it covers, with some air around it.
    own: Rect,
}

/// Rounds after which labels stay where they are.
const ROUNDS: usize = 6;

fn overlap(a: Rect, b: Rect) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_close_points_cover_nothing_and_stay_inside() {
        let points = [(50, 50), (60, 52), (70, 48), (195, 195), (5, 5)];
        let mut labels = Labels::new([0..200, 0..200]);
        points.iter().for_each(|p| labels.avoid_point(*p, 4));
        let size = (40, 10);
        let spots = labels.place(&points.map(|point| (point, size)), 6);
        let boxes: Vec<Rect> = points
            .iter()
            .zip(&spots)
            .map(|((x, y), spot)| [x + spot.x, y + spot.y, x + spot.x + size.0, y + spot.y + size.1])
            .collect();
        for (at, own) in boxes.iter().enumerate() {
            assert!(own[0] >= 0 && own[1] >= 0 && own[2] <= 200 && own[3] <= 200, "{own:?}");
            let others = labels.taken.iter().chain(&boxes[at + 1..]);
            assert_eq!(others.filter(|other| overlap(*own, **other)).count(), 0, "{own:?}");
        }
    }

    #[test]
    fn a_label_gives_way_to_one_that_has_no_other_place() {
        // The first would stand to the right of its point, which is all the room that the second has.
        let mut labels = Labels::new([0..150, 0..40]);
        for other in [(50, 5), (50, 35), (95, 8), (95, 32)] {
            labels.avoid_point(other, 3);
        }
        let wanted = [((40, 20), (30, 10)), ((84, 20), (60, 10))];
        let spots = labels.place(&wanted, 6);
        let own = |at: usize| {
            let (((x, y), (width, height)), spot) = (wanted[at], spots[at]);
            [x + spot.x, y + spot.y, x + spot.x + width, y + spot.y + height]
        };
        assert!(!overlap(own(0), own(1)), "{:?} {:?}", own(0), own(1));
    }
}
