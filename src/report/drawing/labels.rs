//! Places for labels beside points, so that they cover neither points nor each other.

use std::ops::Range;

/// A rectangle in pixels: left, top, right, bottom.
type Rect = [i32; 4];

/// Where a label's upper left corner stands, from its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spot {
    pub x: i32,
    pub y: i32,
}

/// What has been placed so far.
pub struct Labels {
    frame: Rect,
    /// Points and labels, which are not to be covered.
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

    /// The best place for a label of a size beside a point, `gap` pixels away or a little more.
    pub fn place(&mut self, (x, y): (i32, i32), (width, height): (i32, i32), gap: i32) -> Spot {
        let candidates = [1, 2, 3, 4].into_iter().flat_map(|far| {
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
        let spots = candidates.map(|(dx, dy)| Spot { x: dx, y: dy });
        let air = gap / 3;
        let own = |spot: &Spot| {
            let (left, top) = (x + spot.x, y + spot.y);
            [left - air, top - air, left + width + air, top + height + air]
        };
        let mut best = (i64::MAX, Spot { x: gap, y: -height / 2 });
        for (rank, spot) in spots.enumerate() {
            let cost = 4 * rank as i64 + self.cost(own(&spot));
            if cost < best.0 {
                best = (cost, spot);
            }
        }
        self.taken.push(own(&best.1));
        best.1
    }

    fn cost(&self, own: Rect) -> i64 {
        let count = |boxes: &[Rect]| boxes.iter().filter(|other| overlap(own, **other)).count() as i64;
        let [left, top, right, bottom] = self.frame;
        let outside = own[0] < left || own[1] < top || own[2] > right || own[3] > bottom;
        1000 * count(&self.taken) + 25 * count(&self.lines) + if outside { 5000 } else { 0 }
    }
}

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
        for (x, y) in points {
            let spot = labels.place((x, y), (40, 10), 6);
            let own = [x + spot.x, y + spot.y, x + spot.x + 40, y + spot.y + 10];
            assert!(own[0] >= 0 && own[1] >= 0 && own[2] <= 200 && own[3] <= 200, "{own:?}");
        }
        for (i, a) in labels.taken.iter().enumerate() {
            assert!(
                labels.taken[i.max(points.len() - 1) + 1..]
                    .iter()
                    .all(|b| !overlap(*a, *b)),
                "{i}"
            );
        }
    }
}
